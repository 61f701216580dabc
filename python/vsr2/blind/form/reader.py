"""Values out of a JSON mapping that anybody may have written."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

from vsr2.config.problems import shown
from vsr2.errors import BlindError


@dataclass(frozen=True)
class Node:
    """One mapping of a file, read key by key.

    All methods raise BlindError, which names file, key, value and what is wanted there. A key
    whose value is null counts as missing.

    Attributes:
        content: of the mapping.
        label: the file, in front of messages.
        place: of the mapping in the file, in front of keys; "": it is all of it.
    """

    content: Mapping[str, Any]
    label: str
    place: str = ""

    def key(self, name: str) -> str:
        """A key with its place in the file."""
        return f"{self.place}.{name}" if self.place else name

    def error(self, name: str, wanted: str) -> BlindError:
        """That the value of a key is not what is wanted."""
        value = self.content.get(name)
        found = "missing" if value is None else shown(value)
        return BlindError(f"{self.label}: {self.key(name)} is {found}; wanted is {wanted}")

    def has(self, name: str) -> bool:
        """Whether a key is there."""
        return self.content.get(name) is not None

    def text(self, name: str, wanted: str = "a name") -> str:
        """Text that is not empty."""
        value = self.content.get(name)
        if not isinstance(value, str) or not value:
            raise self.error(name, wanted)
        return value

    def choice(self, name: str, options: Collection[str]) -> str:
        """One of several words."""
        value = self.content.get(name)
        if not isinstance(value, str) or value not in options:
            raise self.error(name, f"one of {', '.join(options)}")
        return value

    def flag(self, name: str) -> bool:
        """Whether it is true; false where it is missing."""
        value = self.content.get(name)
        if value is not None and not isinstance(value, bool):
            raise self.error(name, "true or false")
        return bool(value)

    def whole(self, name: str) -> int:
        """A whole number from 0; 0 where it is missing."""
        value = self.content.get(name)
        if value is None:
            return 0
        if isinstance(value, bool) or not isinstance(value, int) or value < 0:
            raise self.error(name, "a whole number from 0")
        return value

    def number(self, name: str, wanted: str = "a finite number") -> float:
        """A finite number."""
        found = finite(self.content.get(name))
        if found is None:
            raise self.error(name, wanted)
        return found

    def probability(self, name: str) -> float:
        """A number from 0 to 1."""
        found = finite(self.content.get(name))
        if found is None or not 0 <= found <= 1 + 1e-9:
            raise self.error(name, "a probability from 0 to 1")
        return found

    def interval(self, name: str) -> tuple[float, float]:
        """Two finite numbers, the lower one first."""
        value = self.content.get(name)
        ends = [finite(end) for end in value] if isinstance(value, list) else []
        if len(ends) != 2 or ends[0] is None or ends[1] is None or ends[0] > ends[1]:
            raise self.error(name, "two finite numbers, the lower one first")
        return ends[0], ends[1]

    def items(self, name: str) -> list[Any]:
        """A list; empty where it is missing."""
        value = self.content.get(name)
        if value is None:
            return []
        if not isinstance(value, list):
            raise self.error(name, "a list")
        return value

    def check_count(self, name: str, bounds: tuple[int, int | None], why: str) -> None:
        """That a list is as long as it may be: least and greatest length, None for any."""
        least, most = bounds
        count = len(self.items(name))
        if count < least or (most is not None and count > most):
            number = f"{least}" if least == most else f"{least} or more"
            raise self.error(name, f"a list of {number}, {why}")

    def names(self, name: str, what: str = "names") -> tuple[str, ...]:
        """A list of text that is not empty; empty where it is missing."""
        found = self.items(name)
        if not all(isinstance(one, str) and one for one in found):
            raise self.error(name, f"a list of {what}")
        return tuple(found)

    def node(self, name: str) -> Node:
        """The mapping at a key."""
        value = self.content.get(name)
        if not isinstance(value, Mapping):
            raise self.error(name, "a mapping")
        return Node(value, self.label, self.key(name))

    def nodes(self, name: str) -> list[Node]:
        """A list of mappings; empty where it is missing."""
        found = self.items(name)
        listed = Node({f"{name}[{i}]": one for i, one in enumerate(found)}, self.label, self.place)
        return [listed.node(key) for key in listed.content]


def finite(value: object) -> float | None:
    """A finite number as float; None: it is none."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None
