"""The study's shape as data: which section a key leads to, and the JSON schema for editors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Any, Literal, get_args, get_origin

from pydantic.fields import FieldInfo

from vsr2.config.section import Section
from vsr2.config.study import Study

DIALECT = "https://json-schema.org/draft/2020-12/schema"
"""Of the JSON schemas."""


@dataclass(frozen=True)
class Variants:
    """The sections a key may hold.

    Attributes:
        tag_key: the key which tells them apart (`shape`, `mode`), or none where there is but one.
        by_tag: sections by the value of `tag_key`; by "" where there is but one.
        named: whether the key holds a mapping of free names to such sections.
    """

    tag_key: str | None
    by_tag: dict[str, type[Section]]
    named: bool = False


def variants(field: FieldInfo) -> Variants | None:
    """The sections which `field` may hold, or none if it holds plain values."""
    sections = list(_sections(field.annotation))
    if not sections:
        return None
    tag_key = field.discriminator if isinstance(field.discriminator, str) else None
    if tag_key is None:
        return Variants(None, {"": sections[0]}, named=get_origin(field.annotation) is dict)
    return Variants(tag_key, {tag_of(section, tag_key): section for section in sections})


def choices(field: FieldInfo) -> tuple[str, ...]:
    """The words of which `field` takes one; none if it takes other values."""
    return tuple(dict.fromkeys(_words(field.annotation)))


def tag_of(section: type[Section], tag_key: str) -> str:
    """The value of `tag_key` that selects `section`."""
    return str(get_args(section.model_fields[tag_key].annotation)[0])


def all_sections(root: type[Section]) -> Iterable[tuple[tuple[str, ...], type[Section]]]:
    """Every section with its place; a member of a union adds a last part such as `shape: box`."""

    def below(
        place: tuple[str, ...], section: type[Section]
    ) -> Iterable[tuple[tuple[str, ...], type[Section]]]:
        yield place, section
        for key, field in section.model_fields.items():
            held = variants(field)
            for tag, inner in held.by_tag.items() if held else ():
                tagged = (f"{held.tag_key}: {tag}",) if held and held.tag_key else ()
                yield from below((*place, key, *tagged), inner)

    return below((), root)


def study_schema() -> dict[str, Any]:
    """The JSON schema of a study, for editors that check and complete YAML."""
    return {"$schema": DIALECT, **Study.model_json_schema(), "title": "VSR2 study"}


def extended_schema(own: type[Section], title: str) -> dict[str, Any]:
    """The JSON schema of a study with the keys of `own` beside a study's own.

    Args:
        own: as of :func:`vsr2.config.extended.load_extended`; its docstring describes the file.
        title: of the schema.
    """
    study, beside = study_schema(), own.model_json_schema()
    return {
        **study,
        "title": title,
        "description": beside["description"],
        "$defs": {**study["$defs"], **beside.get("$defs", {})},
        "properties": {**study["properties"], **beside["properties"]},
        "required": sorted({*study["required"], *beside.get("required", ())}),
    }


def _words(annotation: Any) -> Iterator[str]:
    if get_origin(annotation) is Literal:
        yield from map(str, get_args(annotation))
    elif isinstance(annotation, type) and issubclass(annotation, Enum):
        yield from (str(one.value) for one in annotation)
    else:
        for part in get_args(annotation):
            yield from _words(part)


def _sections(annotation: Any) -> Iterator[type[Section]]:
    if isinstance(annotation, type) and issubclass(annotation, Section):
        yield annotation
    else:
        for part in get_args(annotation):
            yield from _sections(part)
