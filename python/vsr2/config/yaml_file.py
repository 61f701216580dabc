"""YAML that may come from anywhere, bounded in size, depth and number of values; and writing it.

Only plain data is built: mappings with text keys, lists, text, numbers, booleans and null. Tags
that ask for anything else are refused. Unquoted values are read by the core schema of YAML 1.2.2
(section 10.3.2), so `1e7` is a number, `on` and `1:30` are text, and `010` is ten. The schema is
given to ruamel.yaml, whose own rules for YAML 1.2 take `1_000` for a number, `2021-06-30` for a
date and `.5e6` for text.
"""

from __future__ import annotations

import io
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer, MaxDepthExceededError
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.reader import ReaderError
from ruamel.yaml.representer import SafeRepresenter
from ruamel.yaml.resolver import BaseResolver, implicit_resolvers

from vsr2.config.bounded import UnreadableError, read_bounded
from vsr2.errors import ConfigError

MAX_BYTES = 1_000_000
"""Greater files are refused unread."""
MAX_DEPTH = 20
"""Of nested values, before Python's own limit of recursion."""
MAX_VALUES = 20_000
"""Counted after aliases are followed, which is what bounds a bomb of nested aliases."""

Value = None | bool | int | float | str | list["Value"] | dict[str, "Value"]
KeyPath = tuple[str | int, ...]
T = TypeVar("T")

_NO_CONFIGURATION = "so it is no configuration; check the path"
_TAG = "tag:yaml.org,2002:"
_CORE_SCHEMA = {
    "null": (r"(?:~|null|Null|NULL|)\Z", ["~", "n", "N", ""]),
    "bool": (r"(?:(true|True|TRUE)|false|False|FALSE)\Z", list("tTfF")),
    "int": (r"(?:[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+)\Z", list("-+0123456789")),
    "float": (
        r"(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
        r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))\Z",
        list("-+.0123456789"),
    ),
}
_PATTERNS = {name: re.compile(pattern) for name, (pattern, _) in _CORE_SCHEMA.items()}


class _Resolver(BaseResolver):
    def __init__(self, version: object = None, loader: Any = None) -> None:
        super().__init__(loader)

    @property
    def processing_version(self) -> tuple[int, int]:
        return (1, 2)


class _CoreResolver(_Resolver):
    """Tells the type of an unquoted value by the core schema."""


class _QuotingResolver(_Resolver):
    """Tells which text must be quoted: what YAML 1.1 or 1.2 takes for another type."""


for _name, (_, _starts) in _CORE_SCHEMA.items():
    for _resolver in (_CoreResolver, _QuotingResolver):
        _resolver.add_implicit_resolver_base(_TAG + _name, _PATTERNS[_name], _starts)
for _implicit in implicit_resolvers:
    _QuotingResolver.add_implicit_resolver_base(*_implicit[1:])


class _BoundedComposer(Composer):
    """Stops at `MAX_VALUES` nodes, before a long file costs minutes."""

    def __init__(self, loader: Any = None) -> None:
        super().__init__(loader)
        self.warn_double_anchors = False
        self._nodes = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        self._nodes += 1
        if self._nodes > MAX_VALUES:
            raise _TooManyValuesError(problem_mark=self.parser.peek_event().start_mark)
        return super().compose_node(parent, index)


class _TooManyValuesError(MarkedYAMLError):
    pass


class _PlainRepresenter(SafeRepresenter):
    """Writes numbers that YAML 1.1 reads as numbers, too: `1.0e-05` for `1e-05`."""

    def ignore_aliases(self, data: Any) -> bool:
        return True

    def represent_float(self, data: Any) -> Any:
        node = super().represent_float(data)
        if "e" in node.value and "." not in node.value:
            node.value = node.value.replace("e", ".0e")
        return node


_PlainRepresenter.add_representer(float, _PlainRepresenter.represent_float)


class _FlowListRepresenter(_PlainRepresenter):
    """Writes lists in one line."""

    def represent_sequence(self, tag: Any, sequence: Any, flow_style: Any = None) -> Any:
        return super().represent_sequence(tag, sequence, flow_style=True)


@dataclass(frozen=True)
class YamlDocument:
    """What a YAML file holds, and where.

    Attributes:
        data: the file's mapping.
        lines: line of each key and list item, counted from 1.
    """

    data: dict[str, Value]
    lines: dict[KeyPath, int]


def nearest_above(known: Mapping[KeyPath, T], path: KeyPath) -> T | None:
    """What `known` holds of `path`, or else of the nearest section above it."""
    found = (path[:length] for length in range(len(path), 0, -1) if path[:length] in known)
    return next((known[key] for key in found), None)


def read_yaml(path: str | os.PathLike[str]) -> YamlDocument:
    """Read one YAML file that holds one mapping.

    Raises:
        ConfigError: the file is missing, not a regular file, larger than `MAX_BYTES`, not UTF-8,
            not YAML, not one mapping, nested deeper than `MAX_DEPTH`, longer than `MAX_VALUES`, has
            a key twice, or a tag for anything but plain data.
    """
    label = os.fspath(path)
    try:
        content = read_bounded(path, MAX_BYTES, remedy=_NO_CONFIGURATION)
    except UnreadableError as error:
        raise ConfigError(str(error), file=label) from None
    return parse_yaml(content, label)


def parse_yaml(content: bytes, label: str) -> YamlDocument:
    """As :func:`read_yaml`, for content already at hand; `label` names it in errors."""
    if len(content) > MAX_BYTES:
        raise ConfigError(f"larger than {MAX_BYTES} bytes; {_NO_CONFIGURATION}", file=label)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"byte {content[error.start]:#04x} at offset {error.start} is not UTF-8; "
            "give a text file saved as UTF-8",
            file=label,
        ) from None
    root = _composed(text, label)
    if root is None:
        raise ConfigError("the file is empty; give a mapping of keys to values", file=label)
    if not isinstance(root, MappingNode):
        raise ConfigError(
            "the file holds no mapping; write it as `key: value` lines",
            file=label,
            line=_line(root),
        )
    builder = _Builder(label)
    data = builder.build(root, ())
    assert isinstance(data, dict)
    return YamlDocument(data, builder.lines)


def dump_yaml(data: dict[str, Any], *, flow_lists: bool = False) -> str:
    """Plain data as YAML text that YAML 1.1 and 1.2 read alike.

    Args:
        data: mappings with text keys, lists, text, numbers, booleans and None.
        flow_lists: write each list in one line.
    """
    yaml = YAML(typ="safe", pure=True)
    yaml.Representer = _FlowListRepresenter if flow_lists else _PlainRepresenter
    yaml.Resolver = _QuotingResolver
    yaml.default_flow_style = False
    yaml.width = 100
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    stream = io.StringIO()
    yaml.dump(data, stream)
    return stream.getvalue()


def _composed(text: str, label: str) -> Node | None:
    yaml = YAML(typ="safe", pure=True)
    yaml.Composer, yaml.Resolver = _BoundedComposer, _CoreResolver
    yaml.max_depth = MAX_DEPTH
    try:
        node: Node | None = yaml.compose(io.StringIO(text))
        return node
    except ReaderError as error:
        raise ConfigError(
            f"character {error.position} ({error.character!r}) does not belong in a text "
            "file; is it binary?",
            file=label,
        ) from None
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else None
        if isinstance(error, MaxDepthExceededError):
            raise ConfigError(
                f"nested deeper than {MAX_DEPTH}; flatten it", file=label, line=line
            ) from None
        if isinstance(error, _TooManyValuesError):
            raise ConfigError(
                f"more than {MAX_VALUES} values; shorten it", file=label, line=line
            ) from None
        what = ", ".join(part for part in (error.context, error.problem) if part)
        if "'\\t'" in what:
            what = "a tab stands where blanks indent; use blanks"
        if "undefined alias" in what:
            what += "; put text that begins with `*` in quotes"
        raise ConfigError(f"not valid YAML: {what}", file=label, line=line) from None
    except (YAMLError, ValueError, OverflowError) as error:
        # The scanner lets a few of these out, e.g. for an escape beyond Unicode.
        line = yaml.reader.line + 1
        raise ConfigError(f"not valid YAML: {error}", file=label, line=line) from None


def _line(node: Node) -> int:
    return int(node.start_mark.line) + 1


class _Builder:
    """Builds plain data from a node graph, following aliases within the bounds."""

    def __init__(self, label: str) -> None:
        self.lines: dict[KeyPath, int] = {}
        self._label = label
        self._values = 0

    def build(self, node: Node, path: KeyPath) -> Value:
        self._values += 1
        if self._values > MAX_VALUES:
            raise self._error(node, f"more than {MAX_VALUES} values once aliases are followed")
        if len(path) > MAX_DEPTH:
            raise self._error(node, f"nested deeper than {MAX_DEPTH} once aliases are followed")
        if isinstance(node, ScalarNode):
            return self._scalar(node)
        kind = "seq" if isinstance(node, SequenceNode) else "map"
        if node.tag != _TAG + kind:
            raise self._tag_error(node)
        if isinstance(node, MappingNode):
            return self._mapping(node, path)
        items: list[Value] = []
        for i, item in enumerate(node.value):
            self.lines[(*path, i)] = _line(item)
            items.append(self.build(item, (*path, i)))
        return items

    def _mapping(self, node: MappingNode, path: KeyPath) -> dict[str, Value]:
        own: dict[str, Value] = {}
        merged: dict[str, Value] = {}
        seen: dict[str, int] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, ScalarNode) or key_node.tag != _TAG + "str":
                raise self._error(key_node, "a key must be text; put it in quotes")
            key = self._scalar(key_node)
            assert isinstance(key, str)
            if key in seen:
                raise self._error(
                    key_node, f"key `{key}` is given twice (first in line {seen[key]}); remove one"
                )
            seen[key] = _line(key_node)
            if key == "<<" and key_node.style is None:
                sources = value_node.value if isinstance(value_node, SequenceNode) else [value_node]
                for source in sources:
                    if not isinstance(source, MappingNode):
                        raise self._error(source, "`<<` takes a mapping, or a list of mappings")
                    part = self.build(source, path)
                    assert isinstance(part, dict)
                    merged = {**part, **merged}
                continue
            own[key] = self.build(value_node, (*path, key))
        for key, line in seen.items():
            self.lines[(*path, key)] = line
        return {**merged, **own}

    def _scalar(self, node: ScalarNode) -> Value:
        tag = str(node.tag)
        name = tag.removeprefix(_TAG)
        text: str = node.value
        if name == "str":
            if any("\ud800" <= c <= "\udfff" for c in text):
                raise self._error(node, "text holds half of a surrogate pair, no character")
            return text
        if name not in _PATTERNS or not tag.startswith(_TAG):
            raise self._tag_error(node)
        match = _PATTERNS[name].match(text)
        if not match:
            raise self._error(node, f"{_short(text)} is not of the type its tag !!{name} says")
        if name == "null":
            return None
        if name == "bool":
            return match.group(1) is not None
        if name == "float" or len(text) > 20:
            # No key takes an integer of more than 20 digits.
            return _float(text)
        return int(text, {"0o": 8, "0x": 16}.get(text[:2], 10))

    def _tag_error(self, node: Node) -> ConfigError:
        return self._error(
            node, f"tag {_short(str(node.tag))} is not allowed; only plain values are read"
        )

    def _error(self, node: Node, what: str) -> ConfigError:
        return ConfigError(what, file=self._label, line=_line(node))


def _float(text: str) -> float:
    special = text.lower().lstrip("+-")
    if special in (".inf", ".nan"):
        return float(text.lower().replace(".", ""))
    return float(text)


def _short(text: str) -> str:
    shown = ascii(text)
    return shown if len(shown) <= 60 else shown[:57] + "..."
