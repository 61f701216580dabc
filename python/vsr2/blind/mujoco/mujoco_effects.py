"""Unmodelled effects by their canonical names, implemented here and nowhere else."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from vsr2.blind.mujoco.driven_table import (
    low_passed,
    pitched,
    resonated,
    saturated,
    shaded,
    stretched,
)
from vsr2.blind.mujoco.mujoco_trial import Response
from vsr2.blind.mujoco.situation import Situation

Array = NDArray[np.float64]
Values = Mapping[str, float]


@dataclass(frozen=True)
class TrialContext:
    """The position of a trial in its campaign.

    Attributes:
        order: 0 at the first trial, 1 at the last.
        session: number of the trial's session, from 0.
        sessions: number of sessions.
        campaign_seed: of what is drawn once for a campaign.
        trial_seed: of what is drawn for this trial.
    """

    order: float = 0.0
    session: int = 0
    sessions: int = 1
    campaign_seed: int = 0
    trial_seed: int = 0


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Attributes:
        name, unit: of it.
        null: value at which the effect does nothing.
        low, high: least and greatest value.
        reciprocal: the effect grows in 1 / value, with a null of infinity, not in value - null.
    """

    name: str
    unit: str
    null: float
    low: float
    high: float
    reciprocal: bool = False

    def value(self, magnitude: float) -> float:
        """The value at a signed distance from the null."""
        return 1 / magnitude if self.reciprocal else self.null + magnitude

    def reach(self) -> dict[int, tuple[float, float]]:
        """Least and greatest distance from the null within the range, by sign."""
        if self.reciprocal:
            return {1: (1 / self.high, 1 / self.low)}
        out = {}
        if self.high > self.null:
            out[1] = (max(0.0, self.low - self.null), self.high - self.null)
        if self.low < self.null:
            out[-1] = (max(0.0, self.null - self.high), self.null - self.low)
        return out


@dataclass(frozen=True)
class Drawable:
    """An effect as a custodian draws it.

    Attributes:
        name: canonical.
        strength: says how strong it is.
        others: say of what kind it is.
        drifts: whether it changes over the campaign.
    """

    name: str
    strength: Parameter
    others: tuple[Parameter, ...] = ()
    drifts: bool = False

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All of them, the strength first."""
        return (self.strength, *self.others)

    def values(self, magnitude: float, quantiles: Sequence[float]) -> dict[str, float]:
        """By parameter, at a signed distance of the strength and given quantiles of the others."""
        out = {self.strength.name: self.strength.value(magnitude)}
        for other, quantile in zip(self.others, quantiles, strict=True):
            out[other.name] = other.low + quantile * (other.high - other.low)
        return out


@dataclass(frozen=True, kw_only=True)
class MujocoEffect(Drawable):
    """An entry.

    Attributes:
        apply: the situation under the effect; the strength at its null leaves it as it is.
    """

    apply: Callable[[Situation, Values, TrialContext], Situation]


@dataclass(frozen=True)
class RoughBaseConstants:
    """From what the bumps under a rough base are drawn; chosen by hand, sealed with a pack.

    Attributes:
        bumps: under a base.
        evenness: of the weights of the base's corners, of a Dirichlet law: below 1 near a corner.
        within: of the way from the middle that they lie at most.
        heights: ends of a uniform draw, over the effect's height.
    """

    bumps: int = 8
    evenness: float = 0.4
    within: float = 0.9
    heights: tuple[float, float] = (0.3, 1.0)


ROUGH_BASE = RoughBaseConstants()
_FIRST = TrialContext()


def with_effects(
    situation: Situation, effects: Mapping[str, Values], context: TrialContext = _FIRST
) -> Situation:
    """The situation under effects, applied in the order of :data:`EFFECTS`.

    Raises:
        KeyError: an effect, or a parameter, that is not known or not given.
    """
    unknown = set(effects) - set(EFFECTS)
    if unknown:
        raise KeyError(f"no effect {min(unknown)!r}; there are {', '.join(EFFECTS)}")
    for name, effect in EFFECTS.items():
        if name in effects and effects[name][effect.strength.name] != effect.strength.null:
            situation = effect.apply(situation, effects[name], context)
    return situation


def observe(
    response: Response, effects: Mapping[str, Values], context: TrialContext = _FIRST
) -> Response:
    """What is written down of a response: `outcome_rule` labels it by its own rule."""
    if "outcome_rule" not in effects:
        return response
    values = effects["outcome_rule"]
    fallen = response.overturned or response.peak_tilt >= values["tilt"]
    rng = _rng(context.trial_seed, "flip")
    if rng.random() < values["flips"]:
        fallen = not fallen
    return replace(response, overturned=fallen)


def _rng(seed: int, what: str) -> np.random.Generator:
    return np.random.default_rng([seed, *what.encode()])


def _with_body(s: Situation, **changes: Any) -> Situation:
    return replace(s, body=replace(s.body, **changes))


def _with_slenderness(s: Situation, factor: float) -> Situation:
    """Base over height of the mass centre times `factor`, by that height."""
    return _with_body(s, center=s.body.center * [1.0, 1.0, 1 / factor])


def _change_point(s: Situation, v: Values, context: TrialContext) -> Situation:
    """Between the two sessions that lie nearest to `at`; with one session, between two trials."""
    if context.sessions < 2:
        after = context.order >= v["at"]
    else:
        first = min(max(1, round(v["at"] * context.sessions)), context.sessions - 1)
        after = context.session >= first
    return _with_slenderness(s, 1 + v["slenderness_change"]) if after else s


def _polar(length: float, azimuth: float) -> tuple[float, float]:
    """Along x and y; the azimuth from x to y [degree]."""
    angle = math.radians(azimuth)
    return length * math.cos(angle), length * math.sin(angle)


def _support(s: Situation, v: Values, _: TrialContext) -> Situation:
    """Each point moves into the body, so that faces beside it move in by `shrink`."""
    points = s.body.points.copy()
    points[:, :2] += v["shrink"] * s.body.inward
    return replace(_with_body(s, points=points), rounding=s.rounding + v["rim"])


def _base_asperity(s: Situation, v: Values, context: TrialContext) -> Situation:
    rng = _rng(context.campaign_seed, "bumps")
    base = s.body.base
    middle = base.mean(axis=0)
    weights = rng.dirichlet(np.full(len(base), ROUGH_BASE.evenness), size=ROUGH_BASE.bumps)
    points = middle + ROUGH_BASE.within * (weights @ base - middle)
    heights = v["height"] * rng.uniform(*ROUGH_BASE.heights, size=ROUGH_BASE.bumps)
    rows = zip(points, heights, strict=True)
    return replace(s, bumps=tuple((float(x), float(y), float(h)) for (x, y), h in rows))


def _moved(s: Situation, x: Array) -> Situation:
    if s.table.others:
        raise ValueError("effects of the table's x come before those of its other channels")
    return replace(s, table=replace(s.table, x=x))


def _with_channel(s: Situation, channel: Literal["y", "z", "pitch"], samples: Array) -> Situation:
    return replace(s, table=replace(s.table, others={**s.table.others, channel: samples}))


def _table_pitch(s: Situation, v: Values, _: TrialContext) -> Situation:
    turned = pitched(s.table.acceleration, s.table.interval, v["compliance"], v["frequency"])
    return _with_channel(s, "pitch", turned)


def _base_slope(s: Situation, v: Values, _: TrialContext) -> Situation:
    x, y = _polar(math.radians(v["angle"]), v["azimuth"])
    return replace(s, slope=(s.slope[0] + x, s.slope[1] + y))


def _placement(s: Situation, v: Values, context: TrialContext) -> Situation:
    turn, share, azimuth = _rng(context.trial_seed, "placement").random(3)
    # uniform over a disc
    x, y = _polar(v["offset"] * math.sqrt(share), 360.0 * azimuth)
    return replace(
        s,
        yaw=s.yaw + math.radians(v["yaw"]) * (2 * turn - 1),
        offset=(s.offset[0] + x, s.offset[1] + y),
    )


def _effect(
    name: str,
    *parameters: tuple[str, str, float, float, float],
    apply: Callable[[Situation, Values, TrialContext], Situation],
    drifts: bool = False,
) -> MujocoEffect:
    """An entry from rows of name, unit, null, least and greatest value, the strength's first."""
    strength, *others = (Parameter(*row, reciprocal=math.isinf(row[2])) for row in parameters)
    return MujocoEffect(name, strength, tuple(others), drifts, apply=apply)


def _table(change: Callable[[Array, float, Values], Array]) -> Callable[..., Situation]:
    """Changes the table's displacement, given with its sampling interval."""
    return lambda s, v, _: _moved(s, change(s.table.x, s.table.interval, v))


_ENTRIES = (
    _effect(
        "slenderness",
        ("change", "1", 0.0, -0.06, 0.06),
        apply=lambda s, v, _: _with_slenderness(s, 1 + v["change"]),
    ),
    _effect(
        "wear",
        ("loss", "1", 0.0, 0.0, 0.15),
        apply=lambda s, v, context: _with_slenderness(s, 1 - v["loss"] * context.order),
        drifts=True,
    ),
    _effect(
        "change_point",
        ("slenderness_change", "1", 0.0, -0.15, 0.15),
        ("at", "1", 1.0, 0.1, 0.9),
        apply=_change_point,
        drifts=True,
    ),
    _effect(
        "com_offset",
        ("distance", "m", 0.0, 0.0, 0.015),
        ("azimuth", "degree", 0.0, 0.0, 360.0),
        apply=lambda s, v, _: _with_body(
            s, center=s.body.center + np.array([*_polar(v["distance"], v["azimuth"]), 0.0])
        ),
    ),
    _effect(
        "inertia",
        ("change", "1", 0.0, -0.15, 0.15),
        apply=lambda s, v, _: _with_body(s, inertia=s.body.inertia * (1 + v["change"])),
    ),
    _effect(
        "support",
        ("shrink", "m", 0.0, -0.01, 0.01),
        ("rim", "m", 0.0, 0.0, 0.01),
        apply=_support,
    ),
    _effect(
        "edge_rounding",
        ("radius", "m", 0.0, 0.0, 0.015),
        apply=lambda s, v, _: replace(s, rounding=s.rounding + v["radius"]),
    ),
    _effect("base_asperity", ("height", "m", 0.0, 0.0, 0.002), apply=_base_asperity),
    _effect(
        "friction_rate",
        ("ratio", "1", 1.0, 1.0, 1.6),
        ("speed", "m/s", 0.0, 0.005, 0.05),
        apply=lambda s, v, _: replace(s, friction_ratio=v["ratio"], friction_speed=v["speed"]),
    ),
    _effect(
        "spin_friction",
        ("coefficient", "m", 0.0, 0.0, 0.3),
        apply=lambda s, v, _: replace(s, spin_friction=v["coefficient"]),
    ),
    _effect(
        "rolling_resistance",
        ("arm", "m", 0.0, 0.0, 0.01),
        apply=lambda s, v, _: replace(s, rolling_resistance=v["arm"]),
    ),
    # A contact's time constant is (m / k)^(1/2).
    _effect(
        "contact_stiffness",
        ("decades", "1", 0.0, -2.5, 0.0),
        apply=lambda s, v, _: replace(s, contact=s.contact.stiffened(v["decades"])),
    ),
    _effect(
        "restitution",
        ("energy_ratio", "1", 1.0, 0.65, 1.1),
        apply=lambda s, v, _: replace(
            s, impact_energy_ratio=s.impact_energy_ratio * v["energy_ratio"]
        ),
    ),
    _effect(
        "rocking_damping",
        ("ratio", "1", 0.0, 0.0, 0.05),
        apply=lambda s, v, _: replace(s, rocking_damping=v["ratio"]),
    ),
    _effect(
        "adhesion",
        ("strength", "kPa", 0.0, 0.0, 50.0),
        apply=lambda s, v, _: replace(s, adhesion=1000 * v["strength"]),
    ),
    _effect(
        "catch",
        ("slack", "degree", math.inf, 5.0, 25.0),
        apply=lambda s, v, _: replace(s, catch_slack=math.radians(v["slack"])),
    ),
    _effect(
        "input_channel",
        ("low_gain", "1", 0.0, -0.4, 0.4),
        ("high_gain", "1", 0.0, -0.4, 0.4),
        apply=_table(lambda x, dt, v: shaded(x, dt, v["low_gain"], v["high_gain"])),
    ),
    _effect(
        "table_gain",
        ("change", "1", 0.0, -0.15, 0.15),
        apply=_table(lambda x, _, v: x * (1 + v["change"])),
    ),
    _effect(
        "time_scale",
        ("change", "1", 0.0, -0.03, 0.03),
        apply=_table(lambda x, _, v: stretched(x, 1 + v["change"])),
    ),
    _effect(
        "table_bandwidth",
        ("corner", "Hz", math.inf, 3.0, 25.0),
        ("delay", "s", 0.0, 0.0, 0.02),
        apply=_table(lambda x, dt, v: low_passed(x, dt, v["corner"], v["delay"])),
    ),
    _effect(
        "table_resonance",
        ("amplification", "1", 1.0, 1.0, 2.0),
        ("frequency", "Hz", 0.0, 8.0, 20.0),
        apply=_table(lambda x, dt, v: resonated(x, dt, v["frequency"], v["amplification"])),
    ),
    _effect(
        "table_saturation",
        ("acceleration", "m/s^2", math.inf, 2.0, 20.0),
        apply=_table(lambda x, dt, v: saturated(x, dt, math.inf, v["acceleration"])),
    ),
    _effect(
        "table_pitch",
        ("compliance", "rad/g", 0.0, 0.0, 0.02),
        ("frequency", "Hz", 0.0, 5.0, 20.0),
        apply=_table_pitch,
    ),
    _effect(
        "off_axis_motion",
        ("share", "1", 0.0, 0.0, 0.2),
        apply=lambda s, v, _: _with_channel(s, "y", v["share"] * s.table.x),
    ),
    _effect(
        "vertical_motion",
        ("share", "1", 0.0, 0.0, 0.5),
        apply=lambda s, v, _: _with_channel(s, "z", v["share"] * s.table.x),
    ),
    _effect(
        "base_slope",
        ("angle", "degree", 0.0, 0.0, 1.5),
        ("azimuth", "degree", 0.0, 0.0, 360.0),
        apply=_base_slope,
    ),
    # Beyond a quarter turn a block is one that is turned the other way.
    _effect(
        "registration",
        ("yaw", "degree", 0.0, -90.0, 90.0),
        apply=lambda s, v, _: replace(s, yaw=s.yaw + math.radians(v["yaw"])),
    ),
    _effect(
        "placement",
        ("yaw", "degree", 0.0, 0.0, 10.0),
        ("offset", "m", 0.0, 0.0, 0.02),
        apply=_placement,
    ),
    # Acts in `observe`.
    _effect(
        "outcome_rule",
        ("tilt", "rad", math.inf, 0.1, 1.0),
        ("flips", "1", 0.0, 0.0, 0.03),
        apply=lambda s, _, __: s,
    ),
)

EFFECTS: Mapping[str, MujocoEffect] = {effect.name: effect for effect in _ENTRIES}
"""By canonical name, in the order in which they are applied. Not `friction`: MuJoCo's convex
contacts lift a body that slides, so that it hops and rocks where a rigid one only slides; nor
`session`, which steps it. Of `registration` the turn alone: its lean is `com_offset`."""
