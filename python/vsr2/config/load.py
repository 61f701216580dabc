"""Reading a study from YAML, and writing it."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from vsr2.argument_names import checked_names
from vsr2.config.bounded import from_here, near_path
from vsr2.config.problems import Problem, config_error, of_another_verb, problems_of
from vsr2.config.section import Section
from vsr2.config.study import Study
from vsr2.config.yaml_file import KeyPath, dump_yaml, nearest_above, parse_yaml, read_yaml
from vsr2.errors import ConfigError
from vsr2.one_line import counted

S = TypeVar("S", bound=Section)

_logger = logging.getLogger(__name__)


@checked_names(ConfigError)
def load_study(
    path: str | os.PathLike[str], *, overrides: Sequence[str] = (), check_files: bool = True
) -> Study:
    """Read a study from a YAML file.

    Files and folders which it names are taken relative to its own folder and come back absolute.

    Args:
        path: the YAML file.
        overrides: settings that replace the file's, each `key.path=value` with the value in YAML;
            their files and folders are relative to the working directory.
        check_files: refuse a study that names a file or folder which does not exist.

    Raises:
        ConfigError: one error that lists every problem as `file:line: key.path: what is wrong
            (value), remedy`.
    """
    label = os.fspath(path)
    if isinstance(overrides, str):
        raise ConfigError(f"overrides is the text {overrides!r}; give a list, as [{overrides!r}]")
    document = read_yaml(path)
    replaced = apply_overrides(document.data, overrides)
    _logger.debug("%s: read; %s replaced", label, counted(len(overrides), "setting"))
    place = locator(label, document.lines, replaced)
    base = from_here(label).parent
    return build_study(document.data, base, label=label, place=place, check_files=check_files)


def locator(
    label: str, lines: Mapping[KeyPath, int], replaced: Mapping[KeyPath, str] | None = None
) -> Callable[[KeyPath], str]:
    """Tells where a key path stands, as `file:line`, or which override gives its value.

    Args:
        label: name of the file.
        lines: of its keys; a missing key has no line of its own: its section's serves.
        replaced: overrides, by the key path that each sets.
    """

    def place(key_path: KeyPath) -> str:
        for path, override in (replaced or {}).items():
            # Of a section that the file lacks, the override made the keys above its own, too.
            if key_path[: len(path)] == path or (
                path[: len(key_path)] == key_path and key_path not in lines
            ):
                return f"override {override!r}"
        line = nearest_above(lines, key_path)
        return label if line is None else f"{label}:{line}"

    return place


def file_locator(label: str | os.PathLike[str]) -> Callable[[KeyPath], str]:
    """As :func:`locator`, for a file that was read before; its name alone where there is none."""
    name = os.fspath(label)
    if not os.path.isfile(name):
        return locator(name, {})
    try:
        return locator(name, read_yaml(name).lines)
    except ConfigError:
        return locator(name, {})


def apply_overrides(data: dict[str, Any], overrides: Sequence[str]) -> dict[KeyPath, str]:
    """Set keys of a study's mapping, each from `key.path=value` with the value in YAML.

    Of two of one key the later counts.

    Returns:
        The overrides, by the path of the key that each sets.

    Raises:
        ConfigError: one is not of that form, or leads through a value that is no section.
    """
    replaced: dict[KeyPath, str] = {}
    for override in overrides:
        path, value = _read_override(override)
        section = data
        for key in path[:-1]:
            section = section.setdefault(key, {})
            if not isinstance(section, dict):
                raise ConfigError(f"override {override!r}: {key} is not a section of the study")
        section[path[-1]] = value
        replaced[path] = override
    return replaced


def _read_override(override: str) -> tuple[tuple[str, ...], Any]:
    """The path of the key that an override sets, and its value."""
    key_path, equals, text = override.partition("=")
    keys = key_path.strip().split(".")
    if not equals or not all(keys):
        raise ConfigError(
            f"override {override!r}: is not of the form key.path=value, such as "
            "contact.rock.restitution=0.5"
        )
    value = parse_yaml(f"value: {text}".encode(), f"override {override!r}").data["value"]
    if keys[-1] in ("file", "folder", "campaign") and isinstance(value, str):
        value = str(from_here(value))
    return tuple(keys), value


def study_from_mapping(
    mapping: Mapping[str, Any],
    base: str | os.PathLike[str],
    *,
    label: str = "study",
    check_files: bool = True,
) -> Study:
    """Build a study from the mapping which a YAML file would hold.

    Args:
        mapping: keys and values as in a file.
        base: folder against which paths are resolved.
        label: stands for the file's name in errors.
        check_files: refuse a study that names a file or folder which does not exist.

    Raises:
        ConfigError: as :func:`load_study`, without line numbers.
    """
    if not isinstance(mapping, Mapping):
        raise ConfigError(f"{label}: must be a mapping (is a {type(mapping).__name__})")
    return build_study(mapping, from_here(base), label=label, check_files=check_files)


def build_study(
    data: Mapping[str, Any],
    base: Path,
    *,
    label: str,
    place: Callable[[KeyPath], str] | None = None,
    check_files: bool,
) -> Study:
    """Validate `data`, resolve its paths against `base`, and check that they exist.

    Args:
        data: keys and values as in a file.
        base: absolute folder.
        label: stands for the file's name in errors.
        place: where a key path stands, e.g. `study.yaml:12`; `label` everywhere if none.
        check_files: refuse a study that names a file or folder which does not exist.

    Raises:
        ConfigError: lists every problem.
    """
    where = place if place is not None else lambda _: label
    if foreign := of_another_verb(map(str, data), Study.model_fields):
        raise config_error([foreign], label, where)
    try:
        study = Study.model_validate(dict(data))
    except ValidationError as error:
        raise config_error(problems_of(error), label, where) from None
    study = with_absolute_paths(study, base)
    if check_files:
        missing = list(_missing_files(study))
        if missing:
            raise config_error(missing, label, where)
    return study


def with_absolute_paths(study: Study, base: Path) -> Study:
    """The same study with its relative paths resolved against the absolute folder `base`."""
    # Not normalised: `..` after a symbolic link means the folder above the link's target.
    return _map_paths(study, lambda path: base / path)


def dump_study(study: Study, *, relative_to: str | os.PathLike[str] | None = None) -> str:
    """Write a study as YAML that loads back equal, all defaults spelt out.

    Args:
        study: its paths are written as they are, unless
        relative_to: a folder; paths inside it are written relative to it. Give the folder in which
            the file is going to lie.

    Returns:
        The text of the YAML file.
    """
    if relative_to is not None:
        folder = from_here(relative_to)
        study = _map_paths(
            study, lambda path: path.relative_to(folder) if path.is_relative_to(folder) else path
        )
    data = study.model_dump(mode="json", exclude_none=True)
    if study.motion.drive == "prescribed":
        # Refused when read, for it has no effect there.
        del data["pedestal"]["mass"]
    return dump_yaml(_tags_first(data), flow_lists=True)


def _tags_first(data: dict[str, Any]) -> dict[str, Any]:
    """The same mapping with `shape` and `mode` first, as people write it."""
    ordered = {key: data[key] for key in ("shape", "mode") if key in data} | data
    return {
        key: _tags_first(value) if isinstance(value, dict) else value
        for key, value in ordered.items()
    }


def _path_fields(section: Section) -> Iterator[tuple[str, Path]]:
    for key in type(section).model_fields:
        value = getattr(section, key)
        if isinstance(value, Path):
            yield key, value


def _subsections(section: Section) -> Iterator[tuple[str, Section]]:
    for key in type(section).model_fields:
        value = getattr(section, key)
        if isinstance(value, Section):
            yield key, value


def _map_paths(section: S, change: Callable[[Path], Path]) -> S:
    # Copies keep which keys were given, so that the same keys stay refused or accepted.
    update: dict[str, Any] = {key: change(path) for key, path in _path_fields(section)}
    for key, inner in _subsections(section):
        changed = _map_paths(inner, change)
        if changed is not inner:
            update[key] = changed
    return section.model_copy(update=update) if update else section


def _missing(kind: str, path: Path) -> str:
    if os.path.exists(path):
        return f"is no {kind} ({path}); correct the path"
    near = near_path(path)
    return f"no such {kind} ({path}); {f'did you mean {near}?' if near else 'correct the path'}"


def _missing_files(section: Section, above: KeyPath = ()) -> Iterator[Problem]:
    for key, path in _path_fields(section):
        if key == "folder":
            if not os.path.isdir(path):
                yield Problem((*above, key), _missing("folder", path))
        elif not os.path.isfile(path):
            yield Problem((*above, key), _missing("file", path))
    for key, inner in _subsections(section):
        yield from _missing_files(inner, (*above, key))
