"""The reference of all keys, `docs/reference/configuration.md`, written from the models."""

from __future__ import annotations

import re
from collections.abc import Iterator
from enum import StrEnum
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from vsr2.config.schema import all_sections, variants
from vsr2.config.section import Section
from vsr2.config.sources import source_of
from vsr2.config.study import Study

_HEAD = """\
# Configuration

A study is one YAML file in SI units. Written by `vsr2.config.reference_markdown()` from the models
in `python/vsr2/config/`; a test keeps both equal.

- Files and folders are taken relative to the folder of the YAML file that names them.
- Unknown keys, keys given twice, keys without effect, NaN and infinity are refused; the error names
  file, line, key, value and the nearest valid key.
- Values are read by the core schema of YAML 1.2: `1e7` is a number, `010` is ten, `yes` and `on`
  are text. Quoted numbers are text and refused.
- Only plain data is read: no tags but those of plain values, at most 1 MB, at most 20 levels.
  `<<: *anchor` merges mappings.
- Quaternions are x, y, z, w.
- The last column says where a default comes from. "Chosen" is a judgement of ours, with its reason.

The smallest study:

```yaml
rock:
  shape: box
  size: [0.4, 0.4, 1.2]
  density: 2600
motion:
  mode: single_cosine
  pga_g: 0.3
  pgv_pga_s: 0.1
```
"""

_UNIT = re.compile(r"\s*\[([^\[\]]+)\]")


def reference_markdown() -> str:
    """The text of `docs/reference/configuration.md`: every key, its type, default and meaning."""
    return "\n".join([_HEAD, *key_tables(Study)])


def key_tables(root: type[Section]) -> Iterator[str]:
    """Lines of the tables of keys, of a section and of those below, each with its heading."""
    headings: dict[type[Section], list[str]] = {}
    for above, section in all_sections(root):
        known = headings.setdefault(section, [])
        if _place(above) not in known:
            known.append(_place(above))
    for section, known in headings.items():
        yield from _table(known, section)


def _place(parts: tuple[str, ...]) -> str:
    keys = ".".join(part for part in parts if ": " not in part)
    return f"{keys} ({parts[-1]})" if parts and ": " in parts[-1] else keys


def _table(headings: list[str], section: type[Section]) -> Iterator[str]:
    if section is Study:
        yield "## Top level\n"
    elif any(headings):
        yield f"## {', '.join(f'`{place}`' for place in headings)}\n"
        yield _one_line(section.__doc__ or "") + "\n"
    yield "| key | type | default | unit | meaning | source of the default |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for key, field in section.model_fields.items():
        yield _row(key, field)
    yield ""


def _row(key: str, field: FieldInfo) -> str:
    text = _one_line(field.description or "Selects this section.")
    unit = _UNIT.search(text)
    if unit:
        text = text[: unit.start()] + text[unit.end() :]
    cells = [f"`{key}`", _type(field), _default(field), unit.group(1) if unit else "", text]
    cells.append(source_of(field))
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _type(field: FieldInfo) -> str:
    held = variants(field)
    if held and held.tag_key:
        return f"section, by `{held.tag_key}`: " + ", ".join(f"`{tag}`" for tag in held.by_tag)
    if held:
        return "section"
    return _type_name(field.annotation, field.metadata)


def _type_name(annotation: Any, metadata: list[Any] | tuple[Any, ...]) -> str:
    origin, args = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return ", ".join(f"`{choice}`" for choice in args)
    if origin is tuple:
        if args[-1] is Ellipsis:
            return f"list of {_type_name(args[0], ())}"
        return f"list of {len(args)}: {_type_name(args[0], ())}"
    if origin is dict:
        deep = get_origin(args[1]) is dict
        return f"mapping of names to {'parameters' if deep else 'values'}"
    if hasattr(annotation, "__metadata__"):
        return _type_name(args[0], annotation.__metadata__)
    if isinstance(annotation, type) and issubclass(annotation, StrEnum):
        return ", ".join(f"`{choice}`" for choice in annotation)
    if (origin is Union or isinstance(annotation, UnionType)) and type(None) not in args:
        return " or ".join(dict.fromkeys(_type_name(arg, ()) for arg in args))
    if type(None) in args:
        return _type_name(next(arg for arg in args if arg is not type(None)), metadata)
    names = {"float": "number", "int": "whole number", "bool": "true, false", "str": "text"}
    name = names.get(annotation.__name__, "path")
    return ", ".join([name, *_bounds(metadata)])


def _bounds(metadata: list[Any] | tuple[Any, ...]) -> Iterator[str]:
    flat = [m for item in metadata for m in (getattr(item, "metadata", None) or [item])]
    for bound in flat:
        for kind, sign in ((Gt, ">"), (Ge, "≥"), (Lt, "<"), (Le, "≤")):
            if isinstance(bound, kind):
                yield f"{sign} {getattr(bound, kind.__name__.lower()):g}"


def _default(field: FieldInfo) -> str:
    value = field.default
    if value is PydanticUndefined and field.default_factory is None:
        return "required"
    if value in (None, PydanticUndefined, {}, (), ""):
        return "none"
    if isinstance(value, Section):
        held = variants(field)
        return f"`{getattr(value, held.tag_key)}`" if held and held.tag_key else "its defaults"
    if isinstance(value, bool):
        return "`true`" if value else "`false`"
    if isinstance(value, tuple):
        return f"`[{', '.join(v if isinstance(v, str) else f'{v:g}' for v in value)}]`"
    return f"`{value:g}`" if isinstance(value, float) else f"`{value}`"


def _one_line(text: str) -> str:
    return " ".join(text.split())
