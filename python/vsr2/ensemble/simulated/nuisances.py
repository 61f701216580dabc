"""Nuisances: what is uncertain about a set-up and not to be diagnosed.

Each is an effect whose parameter has a prior about its nominal value. The list is open: a user's
effect may stand in it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from typing import Any

from vsr2.effects import Effect, Parameter
from vsr2.effects import library as known_effects
from vsr2.effects.own_code import own_code
from vsr2.ensemble.simulated.distributions import (
    MAX_REACH,
    REMEDIES,
    DrawnByEffect,
    LogNormal,
    Normal,
    Prior,
    distribution,
    number,
    reach,
    stated,
)
from vsr2.ensemble.simulated.motion_noise import MotionNoise
from vsr2.errors import DiagnosisError
from vsr2.near_words import offer


class Scope(StrEnum):
    """What a draw belongs to."""

    CAMPAIGN = "campaign"
    TRIAL = "trial"
    MOTION = "motion"


OWN_EFFECTS: Mapping[str, Effect] = {MotionNoise.name: MotionNoise()}
"""Of nuisances alone."""


JOINING = ("joins and multiplies",)
"""What nuisances do that join or multiply others in each trial or motion; new words where it
changes, so that no kept simulation of another meaning is taken."""


@dataclass(frozen=True)
class Nuisance:
    """What is uncertain about a set-up.

    Values beyond what can be simulated are its ends: the parameter's limits, of a relative one
    those of the factor on its nominal value.

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
        DiagnosisError: no such effect or parameter, a standard deviation below 0, a correlation
            beyond -1 to 1 or without a group, or a prior that reaches what cannot be simulated.
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
        for key, name in (("parameter", self.parameter), ("direction", self.direction)):
            if name or key == "parameter":
                _parameter(self.acting, name, key)
        if not -1 <= self.correlation <= 1:
            raise DiagnosisError(
                f"correlation is {self.correlation}; give -1 to 1 (nuisance {self.name!r})"
            )
        if self.correlation != 1 and not self.group:
            raise _ungrouped(self.correlation)
        if self.group and isinstance(self.prior, DrawnByEffect):
            raise DiagnosisError(
                f"group is {self.group!r}, and the effect draws {self.parameter} itself, with no "
                "other; leave group out, or give another distribution"
            )
        if not 0 <= self.prior.sd < math.inf:
            raise DiagnosisError(
                f"sd is {self.prior.sd}; give a number of 0 or more (nuisance {self.name!r})"
            )
        self._check_reach()

    def _check_reach(self) -> None:
        """Refuse a prior of what cannot be simulated."""
        (least, most), (low, high) = reach(self.prior), self.bounds
        # Ends come out of rounding functions.
        slack = 1e-9 * max((abs(end) for end in (low, high) if math.isfinite(end)), default=0.0)
        if low - slack <= least and most <= high + slack:
            return
        unit = _parameter(self.acting, self.parameter).unit
        unit = "" if self.relative or unit == "1" else f" {unit}"
        far = f" within {MAX_REACH:g} sd" if isinstance(self.prior, Normal | LogNormal) else ""
        remedy = REMEDIES.get(type(self.prior), "narrow it")
        turned = [one.name for one in self.acting.parameters if one.name.endswith("azimuth")]
        if turned and least < 0 <= low:
            remedy += f", or {turned[0]} as direction"
        raise DiagnosisError(
            f"nuisance {self.name!r}: {self.acting.name}.{self.parameter} reaches {least:g} to "
            f"{most:g}{unit}{far}{', as a factor' if self.relative else ''}, and can be simulated "
            f"from {low:g} to {high:g}{unit}; {remedy}",
            key="distribution",
        )

    @cached_property
    def acting(self) -> Effect:
        """The effect."""
        return _acting(self.effect)

    @cached_property
    def bounds(self) -> tuple[float, float]:
        """Ends of what values may be; of a relative one, of what multiplies the nominal value."""
        own = _parameter(self.acting, self.parameter)
        low, high = own.limits or (own.lower, own.upper)
        nominal = _nominal(own)
        if self.relative and 0 < nominal < math.inf and not self.direction:
            return low / nominal, high / nominal
        if self.relative:
            return (-math.inf if self.direction or low < 0 else 0.0), math.inf
        return (-high, high) if self.direction else (low, high)

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
        low, high = self.bounds
        value = min(max(self.prior.value(z), low), high)
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
        same effect and parameter in `DEFAULT_NUISANCES`. `mean` and `median` are by default the
        value without effect, where it is relative 1. Where the effect draws the default nuisance
        itself, it does so here, with the standard deviation of what is stated. What an effect draws
        belongs to a trial, whatever `scope` says.

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
        acting = _acting(name)
        concerned = _parameter(acting, parameter)
        usual = _usual(name, parameter)
        relative = content.get("relative", usual is not None and usual.relative)
        if not isinstance(relative, bool):
            raise DiagnosisError(f"relative is {relative!r}; give true or false")
        correlation = number("correlation", content.get("correlation", 1.0))
        if "correlation" in content and not text["group"]:
            raise _ungrouped(correlation)
        complete = _with_middle(content, concerned, relative)
        prior = distribution(complete, (*words, "relative", "correlation"))
        own = usual and usual.prior
        if isinstance(own, DrawnByEffect) and not isinstance(prior, DrawnByEffect):
            if not math.isclose(prior.sd + prior.value(0.0), prior.sd):
                raise DiagnosisError(
                    f"{name} draws {parameter} about 0 in each trial, and this distribution has "
                    f"its middle at {prior.value(0.0):g}; give one about 0, or `by_effect` with "
                    "its sd; what is alike in every trial is an effect or a nuisance of its own, "
                    "such as registration"
                )
            prior = replace(own, sd=prior.sd)
        if isinstance(prior, DrawnByEffect):
            scope = Scope.TRIAL
        beside = {one.name for one in acting.parameters if one.secondary}
        usually = "azimuth" if "azimuth" in beside and parameter not in beside else ""
        return cls(
            name,
            parameter,
            prior,
            Scope(scope),
            direction=content.get("direction", usually),
            relative=relative,
            label=text["name"] if text["name"] != name else "",
            group=text["group"],
            correlation=correlation,
        )


def _acting(effect: Effect | str) -> Effect:
    """An effect by its name."""
    if isinstance(effect, Effect):
        return effect
    known = {**known_effects(), **OWN_EFFECTS}
    if effect not in known:
        raise DiagnosisError(
            f"there is no effect {effect!r}; {offer(effect, [*known])}", key="effect"
        )
    return known[effect]


def _parameter(effect: Effect, name: str, key: str = "parameter") -> Parameter:
    """A parameter of an effect, which a nuisance names in a key."""
    known = {one.name: one for one in effect.parameters}
    if name not in known:
        raise DiagnosisError(
            f"effect {effect.name!r} has no parameter {name!r}; it has {', '.join(known)}", key=key
        )
    return known[name]


def _nominal(parameter: Parameter) -> float:
    """The value without effect; 1 where the scene has it, as nominal values are relative to it."""
    return 1.0 if math.isnan(parameter.null) else parameter.null


def _with_middle(
    content: Mapping[str, Any], parameter: Parameter, relative: bool
) -> Mapping[str, Any]:
    """What a file states with the middle of its distribution, which it may leave out."""
    name = content.get("distribution")
    middles = {"normal": "mean", "lognormal": "median"}
    key = middles.get(name, "") if isinstance(name, str) else ""
    if not key or key in content:
        return content
    middle = 1.0 if relative else parameter.null
    if not math.isfinite(middle) or (key == "median" and middle <= 0):
        raise DiagnosisError(
            f"{key} is missing; give it, as the value of {parameter.name} without effect, "
            f"{middle:g}, cannot be the middle of a {name} distribution"
        )
    return {**content, key: middle}


def _ungrouped(correlation: float) -> DiagnosisError:
    return DiagnosisError(
        f"correlation is {correlation:g} without a group, and is with the first of one; give the "
        "nuisances that are drawn together the same group, or leave correlation out"
    )


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
