"""What all sections of a configuration share: their base, and types of numbers with bounds.

Numbers are strict: text and booleans are no numbers, NaN and infinity are refused. Upper bounds are
far outside anything physical; they stop a slip of units or of a digit before it costs memory.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    Strict,
    ValidationError,
)
from pydantic_core import PydanticCustomError

DEFAULT_TIME_STEP = 0.001
"""Of simulations, and of the motions that they follow [s]."""
MAX_SEED = 2**63 - 1
"""Of a seed: columns of result tables are 64-bit integers with a sign."""

Real = Annotated[float, Strict()]
Positive = Annotated[float, Strict(), Field(gt=0)]
NonNegative = Annotated[float, Strict(), Field(ge=0)]
Length = Annotated[float, Strict(), Field(gt=0, le=1e5)]
Scale = Annotated[float, Strict(), Field(gt=0, le=1e6)]
Mass = Annotated[float, Strict(), Field(gt=0, le=1e12)]
Flag = Annotated[bool, Strict()]
Vector3 = tuple[Real, Real, Real]
Size = tuple[Length, Length, Length]


def _encodable(value: Path) -> Path:
    text = str(value)
    if "\0" in text or any("\ud800" <= c <= "\udfff" for c in text):
        raise ValueError("is no file name: it holds a character that no file system stores")
    return value


FilePath = Annotated[Path, AfterValidator(_encodable)]


MAX_NORM_ERROR = 0.01
"""Of a quaternion: more is a mistake, not rounding; it admits what is written with two decimals."""


def _nearly_unit(value: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    # It is kept as given because the original passes it on without normalising.
    norm = math.hypot(*value)
    if abs(norm - 1.0) > MAX_NORM_ERROR:
        raise ValueError(f"is no rotation: the quaternion's norm is {norm:.4g}; scale it to 1")
    return value


QuaternionXyzw = Annotated[tuple[Real, Real, Real, Real], AfterValidator(_nearly_unit)]


def assume(key: str, tag: str) -> BeforeValidator:
    """Let `key` default to `tag`: a tagged union does not look at the defaults of its members."""

    def fill(value: object) -> object:
        if isinstance(value, Mapping) and key not in value:
            return {key: tag, **value}
        return value

    return BeforeValidator(fill)


def inapplicable(key: str, reason: str) -> PydanticCustomError:
    """An error at `key` (dotted, below the section that raises it) for a key without effect."""
    return PydanticCustomError("inapplicable_key", "{reason}", {"key": key, "reason": reason})


class Section(BaseModel):
    """Base of all sections: frozen, unknown keys refused, NaN and infinity refused."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )

    if not TYPE_CHECKING:  # For which the fields are the arguments.

        def __init__(self, **values: Any) -> None:
            """Refuses what a file would be refused for, by :class:`vsr2.errors.ConfigError`."""
            try:
                super().__init__(**values)
            except ValidationError as error:
                # Which knows the study, a section.
                from vsr2.config.problems import construction_error

                raise construction_error(error, type(self)) from None

        # So that validation of a mapping builds sections without this, and tells all problems.
        __init__.__pydantic_base_init__ = True
