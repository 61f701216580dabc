"""Effects as the planar block knows them, under their canonical names."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planar.planar_block import GRAVITY
from vsr2.effects import effect

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlanarParameter:
    """A parameter with a uniform or log-uniform prior."""

    name: str
    unit: str
    null: float
    lower: float
    upper: float
    logarithmic: bool = False
    secondary: bool = False
    full_range: bool = False

    @property
    def prior(self) -> str:
        """Kind of the prior."""
        return "loguniform" if self.logarithmic else "uniform"

    def ppf(self, u: float, /) -> float:
        """Prior quantile."""
        if self.logarithmic:
            return math.exp(math.log(self.lower) + u * math.log(self.upper / self.lower))
        return self.lower + u * (self.upper - self.lower)


@dataclass(frozen=True, eq=False)
class Lanes:
    """Runs of planar blocks that an effect changes in place.

    Attributes:
        values: fields of `PlanarBlocks` by name, each (n,).
        order: 0 at the campaign's first trial, 1 at its last, (n,).
        uniform: a draw in (0, 1) that belongs to trial and replicate, (n,).
    """

    values: dict[str, Array]
    order: Array
    uniform: Array


@dataclass(frozen=True, eq=False)
class PlanarEffect:
    """One entry; `act(lanes, rows, values)` applies it to some runs, values (rows, parameters)."""

    name: str
    parameters: tuple[PlanarParameter, ...]
    channels: tuple[str, ...]
    stage: str
    act: Callable[[Lanes, NDArray[np.int64], Array], None]

    @property
    def confounded_with(self) -> tuple[str, ...]:
        """As the library declares."""
        return effect(self.name).confounded_with


def _scale(field: str, by: Callable[[Array], Array]) -> Callable[..., None]:
    def act(lanes: Lanes, rows: NDArray[np.int64], values: Array) -> None:
        lanes.values[field][rows] *= by(values[:, 0])

    return act


def _add(field: str, by: Callable[[Array], Array] = lambda v: v) -> Callable[..., None]:
    def act(lanes: Lanes, rows: NDArray[np.int64], values: Array) -> None:
        lanes.values[field][rows] += by(values[:, 0])

    return act


def _set(*names: str) -> Callable[..., None]:
    def act(lanes: Lanes, rows: NDArray[np.int64], values: Array) -> None:
        for k, name in enumerate(names):
            lanes.values[name][rows] = values[:, k]

    return act


def _wear(lanes: Lanes, rows: NDArray[np.int64], values: Array) -> None:
    lanes.values["half_width"][rows] *= 1 - values[:, 0] * lanes.order[rows]


def _change(lanes: Lanes, rows: NDArray[np.int64], values: Array) -> None:
    after = lanes.order[rows] >= values[:, 1]
    lanes.values["half_height"][rows] /= np.where(after, 1 + values[:, 0], 1.0)


def _outcome(lanes: Lanes, rows: NDArray[np.int64], values: Array) -> None:
    lanes.values["outcome_tilt"][rows] = values[:, 0]
    lanes.values["flipped"][rows] = lanes.uniform[rows] < values[:, 1]


def _effect(
    name: str, stage: str, channels: str, act: Callable[..., None], *parameters: PlanarParameter
) -> PlanarEffect:
    return PlanarEffect(name, parameters, tuple(channels.split()), stage, act)


P = PlanarParameter

PLANAR_LIBRARY: dict[str, PlanarEffect] = {
    effect.name: effect
    for effect in (
        _effect(
            "table_gain",
            "actuation",
            "outcome tilt table",
            _scale("gain", lambda v: 1 + v),
            P("gain", "1", 0.0, -0.15, 0.15),
        ),
        _effect(
            "slenderness",
            "geometry",
            "outcome tilt",
            _scale("half_height", lambda v: 1 / (1 + v)),
            P("change", "1", 0.0, -0.06, 0.06),
        ),
        _effect(
            "table_pitch",
            "actuation",
            "outcome tilt table",
            _set("pitch", "pitch_frequency"),
            P("pitch", "rad/g", 0.0, 0.0, 0.1),
            P("frequency", "Hz", math.inf, 5.0, 20.0, secondary=True),
        ),
        _effect(
            "edge_rounding",
            "geometry",
            "outcome tilt",
            _set("radius"),
            P("radius", "m", 0.0, 0.0, 0.015),
        ),
        _effect(
            "table_bandwidth",
            "actuation",
            "outcome tilt table",
            _set("low_pass"),
            P("corner", "Hz", math.inf, 3.0, 25.0, logarithmic=True),
        ),
        _effect(
            "table_resonance",
            "actuation",
            "outcome tilt table",
            _set("resonance", "amplification"),
            P("frequency", "Hz", math.inf, 8.0, 20.0, secondary=True),
            P("amplification", "1", 1.0, 1.0, 2.0),
        ),
        _effect(
            "table_saturation",
            "actuation",
            "outcome tilt table",
            _set("cap"),
            P("acceleration", "m/s^2", math.inf, 3.0, 15.0, logarithmic=True),
        ),
        _effect(
            "base_slope",
            "geometry",
            "outcome tilt",
            _add("offset", lambda v: GRAVITY * np.sin(v)),
            P("slope", "rad", 0.0, -0.026, 0.026),
        ),
        _effect(
            "com_offset",
            "inertia",
            "outcome tilt",
            _add("com_offset"),
            P("offset", "m", 0.0, -0.015, 0.015),
        ),
        _effect(
            "inertia",
            "inertia",
            "outcome tilt",
            _scale("inertia", lambda v: 1 + 4 * v),
            P("change", "1", 0.0, -0.15, 0.15),
        ),
        _effect(
            "restitution",
            "mechanism",
            "outcome tilt decay",
            _scale("energy_ratio", lambda v: v),
            P("energy_ratio", "1", 1.0, 0.65, 1.1),
        ),
        _effect(
            "rocking_damping",
            "mechanism",
            "outcome tilt decay",
            _add("damping"),
            P("ratio", "1", 0.0, 0.0, 0.05),
        ),
        _effect(
            "rolling_resistance",
            "mechanism",
            "outcome tilt decay",
            _add("rolling"),
            P("arm", "m", 0.0, 0.0, 0.01),
        ),
        _effect(
            "time_scale",
            "actuation",
            "outcome tilt table",
            _scale("speed", lambda v: 1 + v),
            P("change", "1", 0.0, -0.1, 0.1),
        ),
        _effect("wear", "order", "outcome tilt order", _wear, P("loss", "1", 0.0, 0.0, 0.15)),
        _effect(
            "change_point",
            "order",
            "outcome tilt order",
            _change,
            P("change", "1", 0.0, -0.06, 0.06),
            P("place", "1", math.inf, 0.15, 0.85, secondary=True),
        ),
        _effect(
            "catch",
            "mechanism",
            "outcome tilt",
            _set("catch_slack"),
            P("slack", "rad", math.inf, 0.09, 0.44),
        ),
        _effect(
            "outcome_rule",
            "outcome",
            "outcome",
            _outcome,
            P("tilt", "rad", math.inf, 0.1, 1.0),
            P("flips", "1", 0.0, 0.0, 0.03),
        ),
    )
}
"""By name. The inertia's `change` is of the moment about an edge, four thirds m R^2, of which the
mass centre's is a quarter."""
