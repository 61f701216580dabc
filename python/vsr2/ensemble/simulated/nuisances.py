"""Nuisances: what is uncertain about a set-up and not to be diagnosed.

Each is an effect whose parameter has a prior about its nominal value. The list is open: a user's
effect may stand in it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from enum import StrEnum
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from vsr2.effects import Circumstances, Effect, Parameter
from vsr2.effects import library as known_effects
from vsr2.effects.own_code import own_code
from vsr2.errors import DiagnosisError
from vsr2.motion.processing import differentiate
from vsr2.near_words import offer
from vsr2.trial import Trial


class Scope(StrEnum):
    """What a draw belongs to."""

    CAMPAIGN = "campaign"
    TRIAL = "trial"
    MOTION = "motion"


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
        return math.sqrt(max(0.0, (self.high**2 - self.low**2) / (2 * span) - mean**2))

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
        _number(key, value)
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
    elif made.sd < 0 or (isinstance(made, LogNormal) and made.median <= 0):
        raise DiagnosisError(f"{given}: sd should be 0 or more, median above 0")
    elif isinstance(made, DrawnByEffect) and made.reach < 0:
        raise DiagnosisError(f"reach is {made.reach:g}; give 0 or more")
    return made


def _number(key: str, value: Any) -> float:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not (number and math.isfinite(value)):
        raise DiagnosisError(f"{key} is {value!r}; give a finite number")
    return value  # type: ignore[no-any-return]


def stated(prior: Prior) -> dict[str, Any]:
    """A prior as plain data: what :func:`distribution` reads.

    A prior of a caller's own class has the name of the class, which no file may state.
    """
    own = type(prior).__name__
    name = next((n for n, kind in DISTRIBUTIONS.items() if type(prior) is kind), own)
    numbers = {key: value for key, value in vars(prior).items() if math.isfinite(value)}
    return {"distribution": name, **numbers}


@dataclass(frozen=True)
class MotionNoiseConstants:
    """How noise is brought in and out; chosen by hand.

    Attributes:
        taper: share of the motion over which it is, at either end.
        power: of the sine there; from 4 on the third derivative vanishes where it begins and ends,
            so that the table starts at rest.
    """

    taper: float = 0.1
    power: int = 4


MOTION_NOISE = MotionNoiseConstants()


class MotionNoise(Effect):
    """The table does not do what was recorded: noise is added to the motion.

    Gaussian, of a flat spectrum of displacement up to the corner, brought in and out at
    its ends. It is a nuisance and no cause: the library does not have it.
    """

    name = "motion_noise"
    meaning = "The table's motion differs from the recorded one by noise"
    parameters = (
        Parameter(
            "displacement", "m", 0.0, 0.0, 0.001, "uniform", "standard deviation",
            limits=(0.0, 0.1),
        ),
        Parameter(
            "corner", "Hz", 10.0, 1.0, 25.0, "fixed", "upper end of its spectrum",
            limits=(0.5, 100.0), secondary=True,
        ),
    )  # fmt: skip
    channels = ("motion", "tilt")
    stage = "actuation"
    rank = 9

    def at(self, values: Mapping[str, float], circumstances: Circumstances) -> Mapping[str, float]:
        """With the seed of the trial's noise."""
        return {**values, "seed": float(circumstances.rng.integers(2**31))}

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        """The trial with noise in its motion."""
        motion = trial.motion
        count, step = motion.displacement.size, motion.time_step
        rng = np.random.default_rng(int(values["seed"]))
        frequency = np.fft.rfftfreq(count, step)
        within = (frequency > 0) & (frequency <= values["corner"])
        parts = rng.standard_normal((2, frequency.size)) * within
        noise = np.fft.irfft(parts[0] + 1j * parts[1], count)
        noise *= values["displacement"] / max(float(noise.std()), 1e-300)
        tapers = 1 / MOTION_NOISE.taper
        ends = np.minimum(np.linspace(0, tapers, count), np.linspace(tapers, 0, count))
        noise *= np.sin(0.5 * np.pi * np.minimum(ends, 1.0)) ** MOTION_NOISE.power
        more = differentiate(noise, step)
        noisy = replace(
            motion,
            displacement=motion.displacement + more.displacement - more.displacement[0],
            velocity=motion.velocity + more.velocity,
            acceleration=motion.acceleration + more.acceleration,
            source=f"{motion.source}; noise of {values['displacement']:.4g} m",
            recorded=None,
        )
        return replace(trial, motion=noisy)


OWN_EFFECTS: Mapping[str, Effect] = {MotionNoise.name: MotionNoise()}
"""Of nuisances alone."""


JOINING = ("joins and multiplies",)
"""What nuisances do that join or multiply others in each trial or motion; new words where it
changes, so that no kept simulation of another meaning is taken."""


@dataclass(frozen=True)
class Nuisance:
    """What is uncertain about a set-up.

    Attributes:
        effect: that acts, or the name of a registered one.
        parameter: of the effect.
        prior: of the parameter.
        scope: whether a value holds for a campaign, or each trial or ground motion has its own.
        direction: parameter of the effect that is an azimuth [degree]: a negative value acts as
            its size in the opposite direction.
        relative: the value multiplies that of the same effect where it is a cause, or else that of
            the nuisance of this parameter with a wider scope, or else the effect's nominal value of
            the campaign's first trial.
        label: name of the nuisance; empty: the effect's.
        group: nuisances of one group and scope are drawn together; empty: alone.
        correlation: of its draw with that of the first of its group, -1 to 1. Two others correlate
            by the product.

    Raises:
        DiagnosisError: no such effect or parameter, a standard deviation below 0, or a correlation
            beyond -1 to 1.
    """

    effect: Effect | str
    parameter: str
    prior: Prior
    scope: Scope = Scope.CAMPAIGN
    direction: str = ""
    relative: bool = False
    label: str = ""
    group: str = ""
    correlation: float = 1.0

    def __post_init__(self) -> None:
        names = [parameter.name for parameter in self.acting.parameters]
        for key, name in (("parameter", self.parameter), ("direction", self.direction)):
            if name not in names and (name or key == "parameter"):
                raise DiagnosisError(
                    f"effect {self.acting.name!r} has no parameter {name!r}; it has "
                    f"{', '.join(names)}",
                    key=key,
                )
        if not -1 <= self.correlation <= 1:
            raise DiagnosisError(
                f"correlation is {self.correlation}; give -1 to 1 (nuisance {self.name!r})"
            )
        if not 0 <= self.prior.sd < math.inf:
            raise DiagnosisError(
                f"sd is {self.prior.sd}; give a number of 0 or more (nuisance {self.name!r})"
            )

    @cached_property
    def acting(self) -> Effect:
        """The effect."""
        if isinstance(self.effect, Effect):
            return self.effect
        known = {**known_effects(), **OWN_EFFECTS}
        if self.effect not in known:
            raise DiagnosisError(
                f"there is no effect {self.effect!r}; {offer(self.effect, [*known])}", key="effect"
            )
        return known[self.effect]

    @property
    def name(self) -> str:
        """Of the nuisance."""
        return self.label or self.acting.name

    @property
    def secondary(self) -> bool:
        """Whether it acts only beside another parameter of its effect."""
        return not self.relative and self.acting.parameter(self.parameter).secondary

    @property
    def drawn_for(self) -> Scope:
        """Its scope; what an effect draws itself acts with what is drawn for a campaign."""
        return Scope.CAMPAIGN if isinstance(self.prior, DrawnByEffect) else self.scope

    @property
    def identity(self) -> tuple[object, ...]:
        """All that simulations with it depend on, for hashes."""
        plain = self.to_json(), repr(self.prior), own_code(type(self.acting))
        joins = self.relative or self.secondary
        return (*plain, *JOINING) if joins and self.drawn_for is not Scope.CAMPAIGN else plain

    def values(self, z: float) -> dict[str, float]:
        """Of the effect's parameters at a standard normal draw, those not concerned left out."""
        value = self.prior.value(z)
        if not self.direction:
            return {self.parameter: value}
        return {self.parameter: abs(value), self.direction: 0.0 if value > 0 else 180.0}

    def to_json(self) -> dict[str, Any]:
        """What :meth:`from_json` reads; so it stands in the provenance of `diagnosis.json`."""
        group = {"group": self.group, "correlation": self.correlation} if self.group else {}
        return {
            "name": self.name,
            "effect": self.acting.name,
            "parameter": self.parameter,
            "scope": str(self.scope),
            "direction": self.direction,
            "relative": self.relative,
            **stated(self.prior),
            **group,
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Nuisance:
        """A nuisance as a file states it.

        Keys are `effect`, `parameter`, `distribution` and its numbers, and where wanted `scope`,
        `name`, `direction`, `relative`, `group` and `correlation`. `direction` is by default the
        effect's `azimuth`, where it has one. `relative` is by default that of the nuisance of the
        same effect and parameter in `DEFAULT_NUISANCES`. Where the effect draws that one itself, it
        does so here, with the standard deviation of what is stated. What an effect draws belongs to
        a trial, whatever `scope` says.

        Raises:
            DiagnosisError: names the key, its value and what is wanted.
        """
        words = ("effect", "parameter", "scope", "name", "group", "direction")
        for key in words[:2]:
            if key not in content:
                raise DiagnosisError(f"{key} is missing; give it")
        text = {key: content.get(key, "") for key in words}
        for key, value in text.items():
            if not isinstance(value, str):
                raise DiagnosisError(f"{key} is {value!r}; give text")
        scopes = [str(one) for one in Scope]
        scope = text["scope"] or Scope.CAMPAIGN
        if scope not in scopes:
            raise DiagnosisError(f"scope is {scope!r}; {offer(scope, scopes)}")
        name, parameter = text["effect"], text["parameter"]
        usual = _usual(name, parameter)
        relative = content.get("relative", usual is not None and usual.relative)
        if not isinstance(relative, bool):
            raise DiagnosisError(f"relative is {relative!r}; give true or false")
        correlation = _number("correlation", content.get("correlation", 1.0))
        prior = distribution(content, (*words, "relative", "correlation"))
        own = usual and usual.prior
        if isinstance(own, DrawnByEffect) and not isinstance(prior, DrawnByEffect):
            prior = replace(own, sd=prior.sd)
        if isinstance(prior, DrawnByEffect):
            scope = Scope.TRIAL
        made = cls(
            name,
            parameter,
            prior,
            Scope(scope),
            direction=text["direction"],
            relative=relative,
            label=text["name"] if text["name"] != name else "",
            group=text["group"],
            correlation=correlation,
        )
        if "direction" in content:
            return made
        beside = {one.name for one in made.acting.parameters if one.secondary}
        usually = "azimuth" if "azimuth" in beside and parameter not in beside else ""
        return replace(made, direction=usually)


def _usual(effect: str, parameter: str) -> Nuisance | None:
    """The first of the default nuisances of an effect's parameter."""
    same = (one for one in DEFAULT_NUISANCES if (one.effect, one.parameter) == (effect, parameter))
    return next(same, None)


DEFAULT_NUISANCES: tuple[Nuisance, ...] = (
    Nuisance("slenderness", "change", Normal(0.02)),
    Nuisance("inertia", "change", Normal(0.02, least=-0.5)),
    Nuisance("com_offset", "distance", Normal(0.001), direction="azimuth"),
    Nuisance("friction", "factor", LogNormal(0.1)),
    Nuisance("contact_stiffness", "decades", Normal(0.1)),
    Nuisance("restitution", "energy_ratio", LogNormal(0.02), relative=True),
    Nuisance("table_gain", "change", Normal(0.005)),
    Nuisance("placement", "yaw", DrawnByEffect(1.0, math.sqrt(3)), scope=Scope.TRIAL, label="yaw"),
    Nuisance("placement", "offset", DrawnByEffect(0.002, 2.0), scope=Scope.TRIAL, label="offset"),
    Nuisance("table_gain", "change", Normal(0.005), scope=Scope.TRIAL, label="trial_gain"),
)
"""What a careful set-up leaves open, chosen by hand.

For a campaign: proportions and inertia to 2 %, the mass centre along the shaking to 1 mm, friction
to 10 %, contact stiffness to a tenth of a decade, the energy that an impact leaves to 2 %, the
table's gain to 0.5 %. For each trial: yaw to 1 degree, position in plan to 2 mm, and the motion, by
its noise, to 0.5 %.
"""


def with_deviations(deviations: Mapping[str, float]) -> tuple[Nuisance, ...]:
    """The usual nuisances with other standard deviations.

    Args:
        deviations: by name, in the unit of the parameter.

    Raises:
        DiagnosisError: an unknown name, or a number that is not finite and at least 0.
    """
    names = [one.name for one in DEFAULT_NUISANCES]
    for name in deviations:
        if name not in names:
            raise DiagnosisError(f"nuisances: there is no {name!r}; names are {', '.join(names)}")
    return tuple(
        replace(one, prior=replace(one.prior, sd=deviations[one.name]))  # type: ignore[type-var]
        if one.name in deviations
        else one
        for one in DEFAULT_NUISANCES
    )


def with_stated(
    given: Sequence[Nuisance], nuisances: Sequence[Nuisance] = DEFAULT_NUISANCES
) -> tuple[Nuisance, ...]:
    """The same list with those that are given.

    One that is given takes the place of that of the same effect, parameter and scope.
    """

    def key(one: Nuisance) -> tuple[str, str, str]:
        return one.acting.name, one.parameter, one.scope

    taken = {key(one) for one in given}
    return (*(one for one in nuisances if key(one) not in taken), *given)
