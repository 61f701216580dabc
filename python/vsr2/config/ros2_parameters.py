"""The parameters in ROS 2 parameter files, by their dotted names, with the places they stand in."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field
from pathlib import Path

from vsr2.config.problems import shown
from vsr2.config.yaml_file import KeyPath, Value, YamlDocument, read_yaml
from vsr2.errors import ConfigError

_YAML_1_1_FLAGS = {"yes": True, "on": True, "no": False, "off": False}
"""Words that ROS 2 takes for booleans, and that are text in YAML 1.2."""


@dataclass(frozen=True)
class Given:
    """A parameter's value, where it stands (`file:line`), and the file."""

    value: Value
    place: str
    file: Path


@dataclass
class Ros2Parameters:
    """Parameters by their full dotted name, the last one given counting."""

    given: dict[str, Given] = field(default_factory=dict)
    nodes: list[str] = field(default_factory=list)
    foreign: list[str] = field(default_factory=list)
    used: set[str] = field(default_factory=set)
    integers: list[str] = field(default_factory=list)
    """Names given as whole numbers where the original declares decimal ones."""

    def read(self, path: str | os.PathLike[str]) -> None:
        """Take the parameters of a file.

        Raises:
            ConfigError: it cannot be read, or holds none.
        """
        document = read_yaml(path)
        found = False
        for key, value in document.data.items():
            if key == "file_paths" and isinstance(value, dict):
                self._take(document, Path(path), value, (key,), "file_paths.")
                found = True
            else:
                found |= self._nodes_below(document, Path(path), value, (key,))
        if not found:
            raise ConfigError(
                f"{os.fspath(path)}: holds no ROS 2 parameters; expected a node's name (or `/**`) "
                "over `ros__parameters`"
            )

    def _nodes_below(
        self, document: YamlDocument, file: Path, value: Value, above: KeyPath
    ) -> bool:
        if not isinstance(value, dict):
            return False
        found = False
        for key, inner in value.items():
            if key != "ros__parameters":
                found |= self._nodes_below(document, file, inner, (*above, key))
                continue
            found = True
            name = "/".join(str(part).strip("/") for part in above)
            if name.rsplit("/")[-1] not in ("**", "*", "simulation_node", "control_node"):
                self.foreign.append(name)
            elif isinstance(inner, dict):
                self.nodes.append(name)
                self._take(document, file, inner, (*above, key), "")
            elif inner is not None:
                raise ConfigError(
                    f"{file}:{document.lines[(*above, key)]}: ros__parameters must hold keys "
                    f"(is {shown(inner)})"
                )
        return found

    def _take(
        self, document: YamlDocument, file: Path, group: dict[str, Value], at: KeyPath, prefix: str
    ) -> None:
        for key, value in group.items():
            if isinstance(value, dict):
                self._take(document, file, value, (*at, key), f"{prefix}{key}.")
            else:
                place = f"{file}:{document.lines[(*at, key)]}"
                self.given[prefix + key] = Given(value, place, file)

    def has(self, name: str) -> bool:
        """Whether a file gave `name`."""
        return name in self.given

    def number(self, name: str) -> float:
        """A finite number; an error names file and line otherwise."""
        return self._number(name, self._get(name))

    def numbers(self, name: str, count: int) -> list[float]:
        """A list of `count` finite numbers."""
        value = self._get(name)
        if not isinstance(value, list) or len(value) != count:
            raise self.error(name, f"must be a list of {count} numbers")
        return [self._number(name, item) for item in value]

    def vector(self, name: str) -> list[float]:
        """Three finite numbers."""
        return self.numbers(name, 3)

    def quaternion(self, name: str) -> list[float]:
        """Four finite numbers."""
        return self.numbers(name, 4)

    def gravity(self, name: str) -> float:
        """The magnitude of a vector that points down the z axis."""
        x, y, z = self.vector(name)
        if x != 0 or y != 0 or z > 0:
            raise self.error(name, "must point down the z axis, e.g. [0.0, 0.0, -9.81]")
        return abs(z)

    def text(self, name: str) -> str:
        """Text."""
        value = self._get(name)
        if not isinstance(value, str):
            raise self.error(name, "must be text")
        return value

    def integer(self, name: str) -> int:
        """A whole number."""
        value = self._get(name)
        if not isinstance(value, int):
            raise self.error(name, "must be a whole number")
        return int(value)

    def flag(self, name: str) -> bool:
        """True or false, also in the words that ROS 2 takes."""
        value = self._get(name)
        if isinstance(value, str):
            value = _YAML_1_1_FLAGS.get(value.lower(), value)
        if not isinstance(value, int):
            raise self.error(name, "must be true or false")
        return bool(value)

    def error(self, name: str, what: str) -> ConfigError:
        """The error that `name` has a wrong value."""
        given = self.given[name]
        return ConfigError(f"{given.place}: {name}: {what} (is {shown(given.value)})")

    def _get(self, name: str) -> Value:
        self.used.add(name)
        return self.given[name].value

    def _number(self, name: str, value: Value) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.error(name, "must be a number")
        if isinstance(value, int) and name not in self.integers:
            self.integers.append(name)
        if not math.isfinite(value):
            raise self.error(name, "must be finite")
        return float(value)
