"""Reading YAML that may come from anywhere: bounded in size, depth and number of values.

Only plain data is built: mappings with text keys, lists, text, numbers, booleans and null. Tags
that ask for anything else are refused. Scalars are read as YAML 1.2 reads them, because YAML 1.1
takes ``1e7`` for text, ``1:30`` for ninety and ``010`` for eight; the last two are text here, so a
key that wants a number refuses them.
"""

from __future__ import annotations

import os
import re
import stat
from dataclasses import dataclass

import yaml
from yaml.composer import Composer
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from yaml.parser import Parser
from yaml.reader import Reader, ReaderError
from yaml.resolver import Resolver
from yaml.scanner import Scanner

from vsr2.errors import ConfigError

MAX_BYTES = 1_000_000
MAX_DEPTH = 20
MAX_VALUES = 20_000
"""Counted after aliases are followed, which is what bounds a bomb of nested aliases."""

Value = None | bool | int | float | str | list["Value"] | dict[str, "Value"]
KeyPath = tuple[str | int, ...]

_TAG = "tag:yaml.org,2002:"
_PLAIN = {
    "null": re.compile(r"(?:~|null|Null|NULL|)\Z"),
    "bool": re.compile(
        r"(?:(true|True|TRUE|yes|Yes|YES|on|On|ON)|false|False|FALSE|no|No|NO|off|Off|OFF)\Z"
    ),
    "int": re.compile(r"[-+]?(?:0|[1-9][0-9]*)\Z"),
    "float": re.compile(
        r"(?:[-+]?(?:\.[0-9]+|[0-9]+\.[0-9]*|[0-9]+(?=[eE]))(?:[eE][-+]?[0-9]+)?"
        r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))\Z"
    ),
}


@dataclass(frozen=True)
class YamlDocument:
    """What a YAML file holds, and where.

    Attributes:
        data: the file's mapping.
        lines: line of each key and list item, counted from 1.
    """

    data: dict[str, Value]
    lines: dict[KeyPath, int]


def read_yaml(path: str | os.PathLike[str]) -> YamlDocument:
    """Read one YAML file that holds one mapping.

    Raises:
        ConfigError: the file is missing, not a regular file, larger than `MAX_BYTES`, not UTF-8,
            not YAML, not one mapping, nested deeper than `MAX_DEPTH`, longer than `MAX_VALUES`, has
            a key twice, or a tag for anything but plain data.
    """
    return parse_yaml(_read_bounded(path), os.fspath(path))


def parse_yaml(content: bytes, label: str) -> YamlDocument:
    """As :func:`read_yaml`, for content already at hand; `label` names it in errors."""
    if len(content) > MAX_BYTES:
        raise _too_large(label)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"{label}: byte {content[error.start]:#04x} at offset {error.start} is not UTF-8; "
            "give a text file saved as UTF-8"
        ) from None
    loader = None
    try:
        loader = _Loader(text)
        root = loader.get_single_node()
    except ReaderError as error:
        raise ConfigError(
            f"{label}: character {error.position} ({error.character!r}) does not belong in a text "
            "file; is it binary?"
        ) from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f":{mark.line + 1}" if mark else ""
        what = ", ".join(part for part in (error.context, error.problem) if part)
        raise ConfigError(f"{label}{where}: not valid YAML: {what}") from None
    except _TooMuchError as error:
        raise ConfigError(f"{label}{error}") from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        # PyYAML lets a few of these out, e.g. for an escape beyond Unicode.
        where = f":{loader.line + 1}" if loader else ""
        raise ConfigError(f"{label}{where}: not valid YAML: {error}") from None
    if root is None:
        raise ConfigError(f"{label}: the file is empty; give a mapping of keys to values")
    if not isinstance(root, MappingNode):
        raise ConfigError(
            f"{label}:{_line(root)}: the file holds no mapping; write it as `key: value` lines"
        )
    builder = _Builder(label)
    data = builder.build(root, ())
    assert isinstance(data, dict)
    return YamlDocument(data, builder.lines)


def _read_bounded(path: str | os.PathLike[str]) -> bytes:
    label = os.fspath(path)
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise ConfigError(f"{label}: not a file; give the path of a YAML file")
        with open(path, "rb") as stream:
            content = stream.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise ConfigError(f"{label}: no such file; check the path") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise ConfigError(f"{label}: cannot be read: {reason}") from None
    if len(content) > MAX_BYTES:
        raise _too_large(label)
    return content


def _too_large(label: str) -> ConfigError:
    return ConfigError(
        f"{label}: larger than {MAX_BYTES} bytes, so it is no configuration; check the path"
    )


def _line(node: Node) -> int:
    return int(node.start_mark.line) + 1


def plain_tag(text: str) -> str | None:
    """The YAML tag of the unquoted scalar `text`, or none where it is just text."""
    return next((_TAG + name for name, pattern in _PLAIN.items() if pattern.match(text)), None)


class _TooMuchError(Exception):
    """A bound was passed while composing; the text starts with `:line`."""


class _Loader(Reader, Scanner, Parser, Composer, Resolver):
    """PyYAML up to the node graph, with bounds, and with scalars as YAML 1.2 reads them."""

    def __init__(self, text: str) -> None:
        Reader.__init__(self, text)
        Scanner.__init__(self)
        Parser.__init__(self)
        Composer.__init__(self)
        Resolver.__init__(self)
        self._depth = 0
        self._nodes = 0

    def compose_node(self, parent: Node | None, index: int) -> Node | None:
        self._depth += 1
        self._nodes += 1
        if self._depth > MAX_DEPTH:
            raise _TooMuchError(f":{self.line + 1}: nested deeper than {MAX_DEPTH}; flatten it")
        if self._nodes > MAX_VALUES:
            raise _TooMuchError(f":{self.line + 1}: more than {MAX_VALUES} values; shorten it")
        node: Node | None = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def resolve(self, kind: type[Node], value: str, implicit: tuple[bool, bool]) -> str:
        if kind is ScalarNode:
            return (plain_tag(value) if implicit[0] else None) or _TAG + "str"
        return _TAG + ("seq" if kind is SequenceNode else "map")


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
        name = node.tag.removeprefix(_TAG)
        text: str = node.value
        if name == "str":
            if any("\ud800" <= c <= "\udfff" for c in text):
                raise self._error(node, "text holds half of a surrogate pair, no character")
            return text
        pattern = _PLAIN.get(name)
        if pattern is None or not node.tag.startswith(_TAG):
            raise self._tag_error(node)
        match = pattern.match(text) or (name == "float" and _PLAIN["int"].match(text))
        if not match:
            raise self._error(node, f"{_short(text)} is not of the type its tag !!{name} says")
        if name == "null":
            return None
        if name == "bool":
            return match.group(1) is not None
        if name == "float" or len(text) > 20:
            # No key takes an integer of more than 20 digits.
            return _float(text)
        return int(text)

    def _tag_error(self, node: Node) -> ConfigError:
        return self._error(
            node, f"tag {_short(node.tag)} is not allowed; only plain values are read"
        )

    def _error(self, node: Node, what: str) -> ConfigError:
        return ConfigError(f"{self._label}:{_line(node)}: {what}")


def _float(text: str) -> float:
    special = text.lower().lstrip("+-")
    if special in (".inf", ".nan"):
        return float(text.lower().replace(".", ""))
    return float(text)


def _short(text: str) -> str:
    shown = ascii(text)
    return shown if len(shown) <= 60 else shown[:57] + "..."
