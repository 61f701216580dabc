"""Pages from the templates in `templates/`; whatever a template is given is escaped."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any


def render(template: str, filters: Mapping[str, Callable[..., str]], **content: Any) -> str:
    """One page, ending in a line end.

    Text that goes into HTML is escaped, but for what is marked as `markupsafe.Markup`. A name that
    the template wants and `content` lacks is an error.

    Args:
        template: name of a file in `templates/` without `.j2`; its suffix decides on escaping.
        filters: functions by the name that the template calls them by.
        content: what the template shows.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

    environment = Environment(
        loader=PackageLoader("vsr2.report"),
        autoescape=select_autoescape(enabled_extensions=("html.j2",)),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"plain": plain, "listed": listed, **filters}
    return environment.get_template(f"{template}.j2").render(content)


def plain(name: object) -> str:
    """A name of an effect or a place as words."""
    return str(name).replace("_", " ")


def listed(names: Sequence[str], last: str = "or") -> str:
    """Names as one phrase: a, b or c."""
    return f" {last} ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))
