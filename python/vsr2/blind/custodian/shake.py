"""One trial as the custodian orders it from an engine, and what comes back."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Values = Mapping[str, float]


@dataclass(frozen=True)
class Nuisances:
    """What is uncertain in every campaign and not to be diagnosed; factors on nominal values.

    Attributes:
        width, depth, height: of the body.
        energy_ratio: of an impact.
        friction: coefficient.
    """

    width: float = 1.0
    depth: float = 1.0
    height: float = 1.0
    energy_ratio: float = 1.0
    friction: float = 1.0


@dataclass(frozen=True, eq=False)
class Shake:
    """One trial to simulate.

    Attributes:
        interval: of the table's motion [s].
        displacement: of the table before any effect, shape (n,) [m].
        effects: by canonical name, with values by parameter.
        nuisances: of the campaign.
        yaw: of the start [rad].
        offset: of the start, x and y [m].
        order: 0 at the campaign's first trial, 1 at its last.
        session: number of the session, from 0.
        sessions: number of sessions.
        campaign_seed: of what an effect draws once for a campaign.
        trial_seed: of what an effect draws for this trial.
    """

    interval: float
    displacement: Array
    effects: Mapping[str, Values] = field(default_factory=dict)
    nuisances: Nuisances = field(default_factory=Nuisances)
    yaw: float = 0.0
    offset: tuple[float, float] = (0.0, 0.0)
    order: float = 0.0
    session: int = 0
    sessions: int = 1
    campaign_seed: int = 0
    trial_seed: int = 0


@dataclass(frozen=True, eq=False)
class Observed:
    """What an engine gave for a trial, without noise; as :class:`vsr2.campaign.Series`.

    Attributes:
        overturned: as an experimenter would label it.
        peak_tilt: [rad].
        time, tilt, position, orientation: of the series.
    """

    overturned: bool
    peak_tilt: float
    time: Array
    tilt: Array
    position: Array
    orientation: Array


@dataclass(frozen=True)
class Strength:
    """The parameter that says how strong an effect is.

    Attributes:
        name, unit: of it.
        null: value without effect.
        low, high: its range.
        reciprocal: the effect grows in 1 / value, with a null of infinity.
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
    """An effect as the custodian draws it.

    Attributes:
        name: canonical.
        strength: drawn relative to the detection floor.
        others: name, least and greatest value of each other parameter, drawn uniformly.
        drifts: whether it changes over the campaign.
    """

    name: str
    strength: Strength
    others: tuple[tuple[str, float, float], ...] = ()
    drifts: bool = False

    def values(self, magnitude: float, others: Sequence[float]) -> dict[str, float]:
        """By parameter, at a signed distance of the strength and given quantiles of the others."""
        out = {self.strength.name: self.strength.value(magnitude)}
        for (name, low, high), quantile in zip(self.others, others, strict=True):
            out[name] = low + quantile * (high - low)
        return out


class Engine(Protocol):
    """Simulates trials of one nominal scene."""

    @property
    def name(self) -> Literal["mujoco", "bullet"]:
        """Of the engine."""
        ...

    @property
    def versions(self) -> Mapping[str, str]:
        """Of what simulates."""
        ...

    @property
    def effects(self) -> Mapping[str, Drawable]:
        """What it can apply."""
        ...

    @property
    def static_pga(self) -> float:
        """Acceleration at which the nominal body lifts off, g b / h [m/s^2]."""
        ...

    def run(self, shakes: Iterable[Shake], series_interval: float) -> Iterator[Observed]:
        """Simulate trials, in their order."""
        ...
