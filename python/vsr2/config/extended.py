"""Studies with sections of their own beside a study's: read once, rebuilt with other values."""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

from pydantic import ValidationError

from vsr2.config.bounded import from_here
from vsr2.config.load import apply_overrides, build_study, locator
from vsr2.config.problems import (
    Problem,
    config_error,
    of_another_verb,
    problems_of,
    shown,
    unknown_key,
)
from vsr2.config.section import Section
from vsr2.config.study import Study
from vsr2.config.yaml_file import read_yaml
from vsr2.errors import ConfigError

T = TypeVar("T", bound=Section)
Plain = bool | int | float | str
"""A single value of a study."""


@dataclass(frozen=True, eq=False)
class ExtendedStudy(Generic[T]):
    """A study, and what the file held beside it.

    Attributes:
        study: with the file's own values, its paths absolute.
        own: the sections beside it; paths in it are as written.
        mapping: the study's part as plain data.
        base: folder against which paths are resolved.
        label: stands for the file in errors.
    """

    study: Study
    own: T
    mapping: Mapping[str, Any]
    base: Path
    label: str

    def with_values(self, values: Mapping[str, Plain], *, label: str | None = None) -> Study:
        """The study with other values.

        Args:
            values: by dotted key, such as `contact.rock.restitution`; a number as part of the key
                counts from 0 within a list, as in `rock.start.position_xy.0`.
            label: stands for the file in errors; by default the file and the values.

        Raises:
            ConfigError: a key that the study has not, or a value that it refuses.
        """
        data = copy.deepcopy(dict(self.mapping))
        defaults = self.study.model_dump(mode="json")
        for key, value in values.items():
            _set(data, defaults, key.split("."), value, f"{self.label}: {key}")
        given = ", ".join(f"{key} = {shown(value)}" for key, value in values.items())
        where = f"{self.label} with {given}" if label is None else label
        return build_study(data, self.base, label=where, check_files=False)

    def at_time_step(self, step: float) -> ExtendedStudy[T]:
        """The same with a time step [s], and no tolerance that chooses one."""
        engine = {**self.mapping.get("engine", {}), "time_step": step}
        engine.pop("time_step_tolerance", None)
        mapping = {**self.mapping, "engine": engine}
        return replace(self, study=self.study.at_time_step(step), mapping=mapping)

    def value(self, key: str) -> Plain:
        """The study's value at a dotted key, defaults included.

        Raises:
            ConfigError: no such key, or a section.
        """
        found: Any = self.study.model_dump(mode="json")
        for part in key.split("."):
            if isinstance(found, list) and part.isdigit() and int(part) < len(found):
                found = found[int(part)]
            elif isinstance(found, dict) and part in found:
                found = found[part]
            else:
                remedy = "docs/reference/configuration.md lists all"
                if key.startswith("effects."):
                    remedy = "name the effect in the study first, with the value it begins with"
                raise ConfigError(
                    f"{self.label}: {shown(key)}: {shown(part)} is no key of the study as it is; "
                    f"{remedy}"
                )
        if not isinstance(found, (bool, int, float, str)):
            raise ConfigError(
                f"{self.label}: {shown(key)} is {shown(found)}, not a single value; name a key "
                "below it, or give it in the study first"
            )
        return found


def _set(data: Any, defaults: Any, keys: Sequence[str], value: Plain, label: str) -> None:
    key, rest = keys[0], keys[1:]
    if isinstance(data, list):
        if not key.isdigit() or int(key) >= len(data):
            raise ConfigError(f"{label}: {shown(key)} is no place in a list of {len(data)}")
        if rest:
            _set(data[int(key)], None, rest, value, label)
        else:
            data[int(key)] = value
        return
    if not isinstance(data, dict):
        raise ConfigError(f"{label}: leads through {shown(data)}, which is no section")
    if not rest:
        data[key] = value
        return
    below = defaults.get(key) if isinstance(defaults, dict) else None
    if key not in data:
        # A list cannot be given in part, a section can: its defaults fill the rest.
        data[key] = copy.deepcopy(below) if isinstance(below, list) else {}
    _set(data[key], below, rest, value, label)


def load_extended(
    path: str | os.PathLike[str],
    own: type[T],
    *,
    overrides: Sequence[str] = (),
    complete: Callable[[dict[str, Any], T, Path], None] | None = None,
) -> ExtendedStudy[T]:
    """Read a YAML file whose top-level keys are a study's and those of `own`.

    Args:
        path: the YAML file; paths in it are relative to its folder.
        own: the sections beside the study's; no key is in both.
        overrides: as in :func:`vsr2.config.load_study`, for keys of both.
        complete: changes the study's mapping before it is built; gets the mapping, the own
            sections, and the absolute folder of the file.

    Raises:
        ConfigError: one error that lists every problem of one part as
            `file:line: key.path: what is wrong (value), remedy`.
    """
    label = os.fspath(path)
    document = read_yaml(path)
    data: dict[str, Any] = document.data
    replaced = apply_overrides(data, overrides)
    place = locator(label, document.lines, replaced)
    known = [*Study.model_fields, *own.model_fields]
    odd = [key for key in data if key not in known]
    if foreign := of_another_verb(odd, known):
        raise config_error([foreign], label, place)
    if odd:
        raise config_error([Problem((key,), unknown_key(key, known)) for key in odd], label, place)
    mine = {key: data[key] for key in own.model_fields if key in data}
    mapping = {key: value for key, value in data.items() if key not in own.model_fields}
    try:
        sections = own.model_validate(mine)
    except ValidationError as error:
        raise config_error(problems_of(error, own), label, place) from None
    base = from_here(label).parent
    if complete is not None:
        complete(mapping, sections, base)
    study = build_study(mapping, base, label=label, place=place, check_files=True)
    return ExtendedStudy(study=study, own=sections, mapping=mapping, base=base, label=label)
