"""What a run, a reader or a diagnosis states, as data: codes with typed values.

Nothing here is worded. The modules of :mod:`vsr2.report.messages` make sentences of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Literal, Self, get_args

Tier = Literal["B", "M", "T"]
TIERS: tuple[Tier, ...] = get_args(Tier)
"""Information of a campaign, rising: outcomes, largest tilts, series."""

NAMES: type = tuple
"""Type of a value that lists names."""
NUMBERS: type = tuple
"""Type of a value that lists numbers."""


class Code(StrEnum):
    """A code, with the type of each value that goes with it."""

    types: Mapping[str, type]

    def __new__(cls, code: str, types: Mapping[str, type] | None = None) -> Self:
        """A member: its text, and the types."""
        member = str.__new__(cls, code)
        member._value_ = code
        member.types = {} if types is None else types
        return member


@dataclass(frozen=True)
class Statement:
    """A code and its values.

    Attributes:
        code: of what is stated: a reason, a limit, an event.
        values: one of each name that the code declares, of its type.

    Raises:
        TypeError: another name, or a value of another type.
    """

    code: Code
    values: Mapping[str, Any]

    def __post_init__(self) -> None:
        if set(self.values) != set(self.code.types):
            raise TypeError(f"{self.code}: has values {sorted(self.values)}")
        for name, kind in self.code.types.items():
            if not isinstance(self.values[name], (int, float) if kind is float else kind):
                raise TypeError(f"{self.code}: {name} is {self.values[name]!r}")

    @classmethod
    def of(cls, code: Code, **values: Any) -> Statement:
        """A statement with values by name."""
        return cls(code, values)

    def to_json(self) -> dict[str, Any]:
        """As it stands in files of JSON."""
        return {"code": str(self.code), "values": dict(self.values)}
