"""Distributions of what is uncertain, as classes and as files state them."""

from __future__ import annotations

import math
import sys
from collections.abc import Collection, Mapping
from dataclasses import MISSING, dataclass, fields
from typing import Any, Protocol

import numpy as np

from vsr2.config.problems import shown
from vsr2.errors import DiagnosisError
from vsr2.near_words import offer


class Prior(Protocol):
    """Value of a parameter at a standard normal draw; `sd` is its standard deviation."""

    @property
    def sd(self) -> float: ...  # noqa: D102

    def value(self, z: float) -> float: ...  # noqa: D102


@dataclass(frozen=True)
class Normal:
    """Normal, in the parameter's unit; values below `least` are `least`."""

    sd: float
    least: float = -math.inf
    mean: float = 0.0

    def value(self, z: float) -> float:
        """Mean and `sd` times the draw."""
        return max(float(self.mean + self.sd * z), self.least)


@dataclass(frozen=True)
class LogNormal:
    """A factor whose logarithm is normal, with standard deviation `sd`."""

    sd: float
    median: float = 1.0

    def value(self, z: float) -> float:
        """The median times the exponential of `sd` times the draw."""
        return float(self.median * np.exp(self.sd * z))


@dataclass(frozen=True)
class Uniform:
    """Between two ends."""

    low: float
    high: float

    @property
    def sd(self) -> float:
        """(high - low) / 12^(1/2)."""
        return (self.high - self.low) / math.sqrt(12)

    def value(self, z: float) -> float:
        """The quantile at the draw's own."""
        return self.low + (self.high - self.low) * _quantile(z)


@dataclass(frozen=True)
class LogUniform:
    """Uniform in the logarithm, between two ends above 0."""

    low: float
    high: float

    @property
    def sd(self) -> float:
        """Of the value, not of its logarithm."""
        span = math.log(self.high / self.low)
        if span == 0:
            return 0.0
        mean = (self.high - self.low) / span
        square = (self.high * self.high - self.low * self.low) / (2 * span)
        return math.sqrt(max(0.0, square - mean * mean))

    def value(self, z: float) -> float:
        """The quantile at the draw's own."""
        return float(self.low * (self.high / self.low) ** _quantile(z))


def _quantile(z: float) -> float:
    return 0.5 * math.erfc(-z / math.sqrt(2))


@dataclass(frozen=True)
class DrawnByEffect:
    """The effect draws for each trial itself, up to `reach` standard deviations.

    The deviation of a uniform draw between -w and w is w / sqrt(3), over a disc of radius w it is
    w / 2 along each axis.
    """

    sd: float
    reach: float

    def value(self, z: float) -> float:
        """Greatest value, whatever the draw."""
        return self.sd * self.reach


Distribution = Normal | LogNormal | Uniform | LogUniform | DrawnByEffect
DISTRIBUTIONS: Mapping[str, type[Distribution]] = {
    "normal": Normal,
    "lognormal": LogNormal,
    "uniform": Uniform,
    "loguniform": LogUniform,
    "by_effect": DrawnByEffect,
}
"""By the names that files give them."""


def distribution(content: Mapping[str, Any], more: Collection[str] = ()) -> Distribution:
    """A distribution as files have it: its name and its numbers.

    Args:
        content: `distribution` and the numbers of its class; other keys are refused.
        more: keys that are allowed beside them.

    Raises:
        DiagnosisError: an unknown name or key, or a number that is missing or cannot be.
    """
    name = content.get("distribution")
    kind = DISTRIBUTIONS.get(name) if isinstance(name, str) else None
    if kind is None:
        raise DiagnosisError(f"distribution is {name!r}; {offer(str(name), [*DISTRIBUTIONS])}")
    given = {key: value for key, value in content.items() if key not in ("distribution", *more)}
    numbers = {one.name: one.default is MISSING for one in fields(kind)}
    for key, value in given.items():
        if key not in numbers:
            raise DiagnosisError(f"{key}: no number of {name}; {offer(key, [*numbers, *more])}")
        number(key, value)
    for key, needed in numbers.items():
        if needed and key not in given:
            raise DiagnosisError(f"{key} is missing; {name} has {', '.join(numbers)}")
    made = kind(**given)
    if isinstance(made, Uniform | LogUniform):
        above = 0.0 if isinstance(made, LogUniform) else -math.inf
        if not above < made.low <= made.high:
            raise DiagnosisError(
                f"low is {made.low:g} and high {made.high:g}; give the lower one first"
                f"{', above 0' if above == 0 else ''}"
            )
    elif made.sd < 0:
        raise DiagnosisError(f"sd is {made.sd:g}; give 0 or more")
    elif isinstance(made, LogNormal) and made.median <= 0:
        raise DiagnosisError(f"median is {made.median:g}; give a number above 0")
    elif isinstance(made, DrawnByEffect) and made.reach < 0:
        raise DiagnosisError(f"reach is {made.reach:g}; give 0 or more")
    return made


def number(key: str, value: Any) -> float:
    """A finite number that a file states.

    Raises:
        DiagnosisError: it is none.
    """
    real = isinstance(value, int | float) and not isinstance(value, bool)
    # Integers are of any size, and comparing them does not overflow.
    if not (real and abs(value) <= sys.float_info.max):
        raise DiagnosisError(f"{key} is {shown(value)}; give a finite number")
    return value  # type: ignore[no-any-return]


def stated(prior: Prior) -> dict[str, Any]:
    """A prior as plain data: what :func:`distribution` reads.

    A prior of a caller's own class has the name of the class, which no file may state.
    """
    own = type(prior).__name__
    name = next((n for n, kind in DISTRIBUTIONS.items() if type(prior) is kind), own)
    numbers = {key: value for key, value in vars(prior).items() if math.isfinite(value)}
    return {"distribution": name, **numbers}


MAX_REACH = 3.0
"""Standard deviations up to which a distribution without ends is held against what can be
simulated; of 370 draws one lies beyond."""
REMEDIES: Mapping[type, str] = {
    Normal: "give a smaller sd, another mean or least",
    LogNormal: "give a smaller sd or another median",
    Uniform: "give other ends",
    LogUniform: "give other ends",
    DrawnByEffect: "give a smaller sd or reach",
}
"""What to do about a distribution that reaches too far."""


def reach(prior: Prior) -> tuple[float, float]:
    """Ends of a distribution; of one without ends those of `MAX_REACH` standard deviations."""
    far = math.inf if isinstance(prior, Uniform | LogUniform) else MAX_REACH
    with np.errstate(over="ignore"):
        ends = prior.value(-far), prior.value(far)
    return min(ends), max(ends)
