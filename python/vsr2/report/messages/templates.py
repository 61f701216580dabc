"""Templates of sentences: one of each code, and how values go into them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

NO_BOUNDS = "[no bounds]"
"""In place of an interval, where the gap that a share is of may be nothing."""


def check_worded(codes: Iterable[object], sentences: Mapping[Any, str], where: str) -> None:
    """See that each code has a sentence.

    A module calls it where it lists its sentences, so that a code without one is found when the
    module is imported, and not at the end of a run.

    Args:
        codes: all that may be stated, such as the members of an enumeration.
        sentences: by code.
        where: they stand, for whoever adds one.

    Raises:
        TypeError: a code has no sentence, or a sentence no code.
    """
    wanted = list(codes)
    lacking = [str(code) for code in wanted if code not in sentences]
    spare = [str(code) for code in sentences if code not in wanted]
    if lacking or spare:
        raise TypeError(
            f"{where}: no sentence for {lacking or 'none'}, no code for {spare or 'none'}; "
            "every code has one sentence"
        )


def written(value: float, form: str) -> str:
    """A number in a form of `format`; a blank stands before the sign of per cent."""
    return format(value, form).replace("%", " %")


def filled_in(template: str, values: Mapping[str, Any]) -> str:
    """A template of `str.format` with its values: lists parted by commas, numbers of six digits."""
    return template.format(
        **{
            name: ", ".join(one if isinstance(one, str) else f"{one:.6g}" for one in value)
            if isinstance(value, tuple | list)
            else value
            for name, value in values.items()
        }
    )
