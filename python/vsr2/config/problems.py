"""Says what is wrong with a study in the user's words: key as written, value, remedy."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sized
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from vsr2.config.schema import Variants, all_sections, choices, variants
from vsr2.config.section import Section
from vsr2.config.study import Study
from vsr2.config.yaml_file import KeyPath
from vsr2.errors import ConfigError
from vsr2.near_words import nearest
from vsr2.one_line import counted

_EXPECTED = {
    "float_type": "must be a number, without quotes",
    "int_type": "must be a whole number, without point and quotes",
    "bool_type": "must be true or false",
    "string_type": "must be text; put it in quotes",
    "path_type": "must be a path",
    "tuple_type": "must be a list such as [1.0, 2.0, 3.0]",
    "dict_type": "must be a mapping of names to values",
    "finite_number": "must be finite",
    "string_unicode": "must be text",
    "invalid_key": "a key must be text",
    "string_too_short": "must not be empty",
    "string_too_long": "must have at most {max_length} characters",
    "string_pattern_mismatch": "must match {pattern}",
    "greater_than": "must be greater than {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be less than {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "too_short": "must hold at least {min_length}",
    "too_long": "must have {max_length} values",
}
"""What a value must be, by pydantic's type of error, with the numbers that pydantic gives."""
_PATTERNS = {
    r"^[A-Za-z0-9][A-Za-z0-9._ -]*$": (
        "must begin with a letter or digit and hold only letters, digits, blanks, `.`, `_` and `-`"
    ),
    r"^[A-Za-z][A-Za-z0-9_]*$": "must begin with a letter and hold only letters, digits and `_`",
    r"^[a-z_0-9]+(\.[a-z_0-9]+)*$": "must be a key of the study, such as contact.rock.restitution",
}
"""Patterns of names in words."""


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong: where in the study, and what (with value and remedy)."""

    path: KeyPath
    what: str


def dotted(path: KeyPath) -> str:
    """A key path as the user would say it: `rock.start.position[2]`."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            name = part if part.isprintable() and 0 < len(part) <= 60 else shown(part)
            text += f".{name}" if text else name
    return text


def config_error(
    problems: Iterable[Problem], label: str, place: Callable[[KeyPath], str]
) -> ConfigError:
    """One error that lists `problems`, each as `place: key.path: what`.

    Args:
        problems: at least one.
        label: names the file in the heading where there are several.
        place: where a key path stands, e.g. `study.yaml:12`.
    """
    lines = []
    for problem in problems:
        key = f"{dotted(problem.path)}: " if problem.path else ""
        lines.append(f"{place(problem.path)}: {key}{problem.what}")
    if len(lines) == 1:
        return ConfigError(lines[0])
    return ConfigError("\n  ".join([f"{label}: {counted(len(lines), 'problem')}", *lines]))


def construction_error(error: ValidationError, root: type[Section]) -> ConfigError:
    """The error of a section that was built from Python values: the class stands for the file."""
    name = root.__name__
    return config_error(problems_of(error, root), name, lambda _: name)


def problems_of(error: ValidationError, root: type[Section] = Study) -> list[Problem]:
    """Translate pydantic's report on a :class:`Study`, or on another `root` section."""
    return [
        _translate(dict(entry), root)
        for entry in error.errors(include_url=False)
        if not _too_short_without_the_wrong(dict(entry))
    ]


def _too_short_without_the_wrong(entry: dict[str, Any]) -> bool:
    """Whether a list is long enough, and pydantic counts only those of its items that are right."""
    if entry["type"] != "too_short" or not isinstance(entry["input"], Sized):
        return False
    return len(entry["input"]) >= int(entry["ctx"]["min_length"])


def _translate(entry: dict[str, Any], root: type[Section]) -> Problem:
    path, owner, field = _walk(entry["loc"], root)
    context: dict[str, Any] = entry.get("ctx", {})
    kind: str = entry["type"]
    value = entry.get("input")
    if kind == "inapplicable_key":
        return Problem((*path, *context["key"].split(".")), context["reason"])
    if kind == "value_error":
        return Problem(path, str(context["error"]))
    if kind == "extra_forbidden":
        return Problem(path, _unknown_key(str(path[-1]), path[:-1], owner, root))
    if kind == "missing":
        return Problem(path, f"is missing{_meaning(field)}")
    held = variants(field) if field else None
    if kind == "union_tag_not_found" and held:
        return Problem((*path, held.tag_key or ""), f"is missing; give {_either(held.by_tag)}")
    if kind == "union_tag_invalid" and held:
        tag = context["tag"]
        if isinstance(value, Mapping) and not isinstance(value.get(held.tag_key), str):
            tag = value.get(held.tag_key)
        return Problem((*path, held.tag_key or ""), _not_one_of(tag, list(held.by_tag)))
    words = choices(field) if field else ()
    if kind in ("literal_error", "enum") and words:
        return Problem(path, _not_one_of(value, list(words)))
    if kind in ("model_type", "model_attributes_type"):
        return Problem(path, f"must hold {_keys(held, owner)} (is {shown(value)})")
    template = _PATTERNS.get(context.get("pattern", "")) or _EXPECTED.get(kind)
    expected = entry["msg"] if template is None else template.format(**context)
    return Problem(path, f"{expected} (is {shown(value)})")


def _walk(
    location: tuple[str | int, ...], root: type[Section]
) -> tuple[KeyPath, type[Section] | None, FieldInfo | None]:
    """Key path without pydantic's tags of unions; the section that owns its last key; that key."""
    path: list[str | int] = []
    section: type[Section] | None = root
    owner: type[Section] | None = root
    field: FieldInfo | None = None
    held: Variants | None = None
    for part in location:
        if held is not None and held.tag_key is not None and part in held.by_tag:
            section, held = held.by_tag[str(part)], None
            continue
        path.append(part)
        if held is not None and held.named:
            section, held = held.by_tag[""], None
            continue
        if isinstance(part, int):
            continue  # A place in a list belongs to the key of the list.
        owner = section
        field = section.model_fields.get(part) if section else None
        held = variants(field) if field else None
        section = held.by_tag[""] if held and held.tag_key is None and not held.named else None
    return tuple(path), owner, field


_CALIBRATION = (
    *("campaign", "parameters", "method", "folds", "resamples", "replicates", "objective"),
    "judged_with",
)
_OF_ANOTHER_VERB = {"fragility": "vsr2 fragility", **dict.fromkeys(_CALIBRATION, "vsr2 calibrate")}
"""Keys of a file that is no plain study, with the verb that takes it."""


def of_another_verb(keys: Iterable[str], known: Collection[str]) -> Problem | None:
    """That a file is one of another verb, by the first of its top-level keys that only that has.

    Args:
        keys: of the file.
        known: those that a file of the verb at hand may have.
    """
    for key in keys:
        if key in _OF_ANOTHER_VERB and key not in known:
            verb = _OF_ANOTHER_VERB[key]
            what = f"is a key of `{verb}`; run the file by `{verb}`, or remove the key"
            return Problem((key,), what)
    return None


def _unknown_key(
    key: str, parent: KeyPath, section: type[Section] | None, root: type[Section]
) -> str:
    if section is None:
        return "is no key here; remove it"
    if not nearest(key, section.model_fields):
        for place, other in all_sections(root):
            if place[:-1] == parent and key in other.model_fields:
                return f"applies only with `{place[-1]}`; remove it"
        for place, other in all_sections(root):
            if key in other.model_fields:
                keys = [part for part in place if ": " not in part]
                return f"is no key here; did you mean `{dotted((*keys, key))}`?"
    return unknown_key(key, section.model_fields)


def unknown_key(key: str, known: Iterable[str]) -> str:
    """That `key` is none of `known`, with the one that it most likely means."""
    known = list(known)
    near = nearest(key, known)
    return "is no key here; " + (
        f"did you mean `{near}`?" if near else f"known are {', '.join(known)}"
    )


def _not_one_of(value: object, choices: list[str]) -> str:
    near = nearest(value, choices) if isinstance(value, str) else None
    hint = f"; did you mean {near}?" if near and len(choices) > 1 else ""
    return f"must be {_either(choices)} (is {shown(value)}){hint}"


def _either(choices: Iterable[str]) -> str:
    *most, last = choices
    return f"{', '.join(most)} or {last}" if most else last


def _keys(held: Variants | None, owner: type[Section] | None) -> str:
    if held is not None and held.tag_key is not None:
        return f"keys, among them `{held.tag_key}` ({_either(held.by_tag)})"
    section = held.by_tag[""] if held else owner
    return f"the keys {', '.join(section.model_fields)}" if section else "keys"


def _meaning(field: FieldInfo | None) -> str:
    if field is None or not field.description:
        return "; give it"
    return f"; give it: {field.description.replace(chr(10), ' ')}"


def shown(value: object) -> str:
    """A value as it goes into a message: one line, bounded."""
    try:
        # A key without a value, as YAML names what it holds.
        if isinstance(value, str):
            text = ascii(value)
        else:
            text = "null" if value is None else " ".join(repr(value).split())
    except Exception:
        # The value may be any object where a study is built from Python.
        text = f"a {type(value).__name__}"
    return text if len(text) <= 60 else text[:57] + "..."
