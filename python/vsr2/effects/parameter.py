"""Parameters of effects: unit, null value, prior, accepted range."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Literal, get_args

from vsr2.config.problems import shown
from vsr2.errors import ConfigError


class EffectWarning(UserWarning):
    """An effect that may not do what was meant."""


class EffectRangeWarning(EffectWarning):
    """A value outside its parameter's prior, though it can be simulated."""


Prior = Literal["uniform", "loguniform", "normal", "fixed"]
NORMAL_ENDS = 2.0
"""Standard deviations from the middle of a normal prior to its ends, where it is cut."""
Twice = Literal["", "sum", "product", "growth", "loss", "spread", "least", "later"]
"""How two values of a parameter make one; empty: no value does what both do."""
_TWICE: Mapping[Twice, Callable[[float, float], float]] = {
    "sum": lambda one, other: one + other,
    "product": lambda one, other: one * other,
    "growth": lambda one, other: (1 + one) * (1 + other) - 1,
    "loss": lambda one, other: 1 - (1 - one) * (1 - other),
    "spread": math.hypot,
    "least": min,
    "later": lambda one, other: other,
}


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Attributes:
        name: as a study writes it.
        unit: "1" for a number without one.
        null: value without effect, or, of a `secondary` one, the value where none is given. NaN
            stands for "as the study has it".
        lower, upper: ends of the prior.
        prior: "uniform" and "loguniform" between the ends; "normal" about their middle, with a
            quarter of their distance as standard deviation, cut at the ends; "fixed" at `null`.
        meaning: for people.
        limits: range in which it can be simulated; by default the prior's. Outside the prior a
            study is warned, outside the limits refused.
        secondary: without effect on its own (an azimuth, a frequency); whether an effect is null
            is decided by the others.
        choices: words a study may write, in the order of their values 0, 1, 2, ...
        full_range: the prior is meant as it stands, as of a direction that nobody has noted down.
            Other parameters are drawn near what a campaign just shows, for a greater value is seen
            anyway; of this one a diagnosis draws values over the full prior, too.
        twice: how the value and another on top of it make one: their sum or product, that of
            relative changes (`growth`) or losses, the root of the sum of squares of two
            independent draws (`spread`), the least, the later one. Empty: no value does.
    """

    name: str
    unit: str
    null: float
    lower: float
    upper: float
    prior: Prior
    meaning: str
    limits: tuple[float, float] | None = None
    secondary: bool = False
    choices: tuple[str, ...] = ()
    full_range: bool = False
    twice: Twice = ""

    def __post_init__(self) -> None:
        if self.prior not in get_args(Prior):
            raise ConfigError(
                f"parameter {self.name!r}: prior is {self.prior!r}; give one of "
                f"{', '.join(get_args(Prior))}"
            )
        if not (math.isfinite(self.lower) and self.lower <= self.upper < math.inf):
            raise ConfigError(
                f"parameter {self.name!r}: lower ({self.lower}) and upper ({self.upper}) must be "
                "finite and not decrease"
            )
        if self.prior == "loguniform" and self.lower <= 0:
            raise ConfigError(
                f"parameter {self.name!r}: a loguniform prior needs a positive lower end, it is "
                f"{self.lower}"
            )

    def ppf(self, u: float) -> float:
        """Quantile of the prior at `u`, 0 to 1.

        Raises:
            ConfigError: `u` is outside 0 to 1.
        """
        if not 0 <= u <= 1:
            raise ConfigError(f"parameter {self.name!r}: quantile at {u}, which is not in 0 to 1")
        if self.prior == "fixed":
            return self.null
        if self.prior == "loguniform":
            # The ends are themselves, whatever the rounding.
            value = math.exp(math.log(self.lower) * (1 - u) + math.log(self.upper) * u)
        elif self.prior == "normal":
            from scipy.stats import norm

            low, high = norm.cdf(-NORMAL_ENDS), norm.cdf(NORMAL_ENDS)
            middle, half = 0.5 * (self.lower + self.upper), 0.5 * (self.upper - self.lower)
            value = middle + half / NORMAL_ENDS * float(norm.ppf(low + u * (high - low)))
        else:
            value = self.lower * (1 - u) + self.upper * u
        return min(max(value, self.lower), self.upper)

    @property
    def extreme(self) -> float:
        """The end of the prior that is farther from the null value; `null` where it is fixed."""
        if self.prior == "fixed":
            return self.null
        if not math.isfinite(self.null):
            return self.lower
        if self.prior == "loguniform" and self.null > 0:
            far = math.log(self.upper / self.null) >= math.log(self.null / self.lower)
        else:
            far = self.upper - self.null >= self.null - self.lower
        return self.upper if far else self.lower

    def is_null(self, value: float) -> bool:
        """Whether `value` is the null value."""
        return value == self.null or (math.isnan(value) and math.isnan(self.null))

    def accept(self, value: float | str, where: str, *, warn: bool = True) -> float:
        """The value as a number.

        Args:
            value: a number, or one of the `choices`.
            where: key of the study, for errors and warnings.
            warn: of a value outside the prior.

        Raises:
            ConfigError: no such word, no number, or outside the limits.
        """
        if isinstance(value, str) and value in self.choices:
            return float(self.choices.index(value))
        if isinstance(value, bool) or not isinstance(value, Real):
            wanted = f"one of {', '.join(self.choices)}" if self.choices else "a number"
            raise ConfigError(f"must be {wanted} (is {shown(value)})", key=where)
        number = float(value)
        if self.is_null(number):
            return number
        low, high = self.limits or (self.lower, self.upper)
        if self.choices and number not in range(len(self.choices)):
            raise ConfigError(f"must be one of {', '.join(self.choices)} (is {value})", key=where)
        unit = "" if self.unit == "1" else f" {self.unit}"
        # Ends of priors come out of rounding functions.
        slack = 1e-9 * max(abs(low), abs(high))
        if not low - slack <= number <= high + slack:
            raise ConfigError(
                f"{number:g}{unit} is outside {low:g} to {high:g}{unit}; check unit and sign",
                key=where,
            )
        slack = 1e-9 * max(abs(self.lower), abs(self.upper))
        inside = self.lower - slack <= number <= self.upper + slack
        if warn and not inside and self.prior != "fixed":
            warnings.warn(
                f"{where}: {number:g}{unit} is outside the prior, {self.lower:g} to "
                f"{self.upper:g}{unit}",
                EffectRangeWarning,
                stacklevel=3,
            )
        return number

    def joined(self, one: float, other: float, where: str) -> float:
        """The value that does what one does and another on top of it.

        Args:
            one: acts first.
            other: acts on top.
            where: key of the study, for errors.

        Raises:
            ConfigError: no value does.
        """
        if one == other and self.secondary:
            return one
        if self.is_null(other):
            return one
        if self.is_null(one):
            return other
        if not self.twice:
            raise ConfigError(f"no value does what {one:g} and {other:g} on top do", key=where)
        return _TWICE[self.twice](one, other)

    @property
    def range_text(self) -> str:
        """The prior for people, with its unit."""
        if self.choices:
            return ", ".join(self.choices)
        unit = "" if self.unit == "1" else f" {self.unit}"
        if self.prior == "fixed":
            return f"fixed at {self.null:g}{unit}"
        return f"{self.prior} {self.lower:g} to {self.upper:g}{unit}"
