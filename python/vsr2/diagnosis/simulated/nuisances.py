"""Nuisances: what is uncertain about a set-up and not to be diagnosed.

Each is an effect whose parameter has a prior about its nominal value. The list is open: a user's
effect may stand in it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Protocol

import numpy as np

from vsr2.effects import Effect
from vsr2.effects import library as known_effects
from vsr2.errors import DiagnosisError


class Scope(StrEnum):
    """What a draw belongs to."""

    CAMPAIGN = "campaign"
    TRIAL = "trial"


class Prior(Protocol):
    """Value of a parameter at a standard normal draw; `sd` is its standard deviation."""

    @property
    def sd(self) -> float: ...  # noqa: D102

    def value(self, z: float) -> float: ...  # noqa: D102


@dataclass(frozen=True)
class Normal:
    """Normal about 0, in the parameter's unit; values below `least` are `least`."""

    sd: float
    least: float = -math.inf

    def value(self, z: float) -> float:
        """`sd` times the draw."""
        return max(float(self.sd * z), self.least)


@dataclass(frozen=True)
class LogNormal:
    """A factor whose logarithm is normal about 0."""

    sd: float

    def value(self, z: float) -> float:
        """Exponential of `sd` times the draw."""
        return float(np.exp(self.sd * z))


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


@dataclass(frozen=True)
class Nuisance:
    """What is uncertain about a set-up.

    Attributes:
        effect: that acts, or the name of a registered one.
        parameter: of the effect.
        prior: of the parameter.
        scope: whether a value holds for a campaign, or each trial has a fresh one.
        direction: parameter of the effect that is an azimuth [degree]: a negative value acts as
            its size in the opposite direction.
        relative: the value multiplies that of the same effect where it is a cause, or else the
            scene's own impact energy ratio.
        label: name of the nuisance; empty: the effect's.

    Raises:
        DiagnosisError: no such effect or parameter, or a standard deviation below 0.
    """

    effect: Effect | str
    parameter: str
    prior: Prior
    scope: Scope = Scope.CAMPAIGN
    direction: str = ""
    relative: bool = False
    label: str = ""

    def __post_init__(self) -> None:
        names = [parameter.name for parameter in self.acting.parameters]
        for name in filter(None, (self.parameter, self.direction)):
            if name not in names:
                raise DiagnosisError(
                    f"nuisance {self.name!r}: effect {self.acting.name!r} has no parameter "
                    f"{name!r}; it has {', '.join(names)}"
                )
        if not 0 <= self.prior.sd < math.inf:
            raise DiagnosisError(
                f"nuisance {self.name!r}: sd is {self.prior.sd}; give a number of 0 or more"
            )

    @property
    def acting(self) -> Effect:
        """The effect."""
        if isinstance(self.effect, Effect):
            return self.effect
        known = known_effects()
        if self.effect not in known:
            raise DiagnosisError(
                f"nuisance: there is no effect {self.effect!r}; there are {', '.join(known)}"
            )
        return known[self.effect]

    @property
    def name(self) -> str:
        """Of the nuisance."""
        return self.label or self.acting.name

    def values(self, z: float) -> dict[str, float]:
        """Of the effect's parameters at a standard normal draw, those not concerned left out."""
        value = self.prior.value(z)
        if not self.direction:
            return {self.parameter: value}
        return {self.parameter: abs(value), self.direction: 0.0 if value > 0 else 180.0}

    def to_json(self) -> dict[str, Any]:
        """As it stands in the provenance of `diagnosis.json`."""
        return {
            "name": self.name,
            "effect": self.acting.name,
            "parameter": self.parameter,
            "prior": type(self.prior).__name__,
            "sd": self.prior.sd,
            "scope": str(self.scope),
        }


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


def with_deviations(
    deviations: Mapping[str, float], nuisances: Sequence[Nuisance] = DEFAULT_NUISANCES
) -> tuple[Nuisance, ...]:
    """The same list with other standard deviations.

    Args:
        deviations: by name, in the unit of the parameter.
        nuisances: to begin with.

    Raises:
        DiagnosisError: an unknown name, or a number that is not finite and at least 0.
    """
    names = [one.name for one in nuisances]
    for name in deviations:
        if name not in names:
            raise DiagnosisError(f"nuisances: there is no {name!r}; names are {', '.join(names)}")
    return tuple(
        replace(one, prior=replace(one.prior, sd=deviations[one.name]))  # type: ignore[type-var]
        if one.name in deviations
        else one
        for one in nuisances
    )
