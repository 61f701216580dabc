"""Options of which a command line may have one."""

from __future__ import annotations

from cyclopts import ArgumentCollection


class ExclusiveOptionsError(ValueError):
    """More than one of them was given."""


def one_of(group: ArgumentCollection) -> None:
    """Refuse more than one option of a group; a validator of the library's groups.

    Raises:
        ExclusiveOptionsError: names those that were given.
    """
    given = [one for one in group if one.has_tokens]
    if len(given) > 1:
        names = [one.tokens[0].keyword or one.name for one in given]
        raise ExclusiveOptionsError(f"{' and '.join(names)} exclude each other; give one of them")
