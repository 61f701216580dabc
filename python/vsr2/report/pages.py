"""Pages from the templates in `templates/`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment


def environment(filters: Mapping[str, Callable[..., object]]) -> Environment:
    """Of templates: what they are given is escaped if they are HTML, and a lacking name refused.

    Args:
        filters: functions by the name that the template calls them by.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

    made = Environment(
        loader=PackageLoader("vsr2.report"),
        autoescape=select_autoescape(enabled_extensions=("html.j2",), default_for_string=False),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    made.filters |= {"plain": plain, "listed": listed, **filters}
    return made


def render(template: str, filters: Mapping[str, Callable[..., object]], **content: Any) -> str:
    """One page, ending in a line end.

    Args:
        template: name of a file in `templates/` without `.j2`; its suffix decides on escaping, but
            what is marked as `markupsafe.Markup` stays.
        filters: see :func:`environment`.
        content: what the template shows.
    """
    return environment(filters).get_template(f"{template}.j2").render(content)


def plain(name: object) -> str:
    """A name of an effect or a location as words."""
    return str(name).replace("_", " ")


def listed(names: Sequence[str], last: str = "or") -> str:
    """Names as one phrase: a, b or c."""
    return f" {last} ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))
