"""The planar block as a simulator of a whole campaign."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from planar.planar_block import (
    DEFAULTS,
    GRAVITY,
    STEP,
    PlanarBlocks,
    simulate_planar,
)
from planar.planar_library import PLANAR_LIBRARY, Lanes, PlanarEffect
from vsr2.campaign import Campaign
from vsr2.config.motion_source import Filter
from vsr2.ensemble.simulated.library import Library
from vsr2.ensemble.simulated.simulator import Request, Responses, nuisance_normal
from vsr2.errors import DiagnosisError
from vsr2.motion import build_recorded_motion

Array = NDArray[np.float64]

TAIL = 1.5
"""Rest after the motion [s]."""


@dataclass(frozen=True)
class PlanarBlock:
    """Nominal geometry [m]: half width along the shaking, half height of the mass centre."""

    half_width: float = 0.2
    half_height: float = 0.475


@dataclass(frozen=True)
class PlanarNuisances:
    """Standard deviations of what is uncertain about a planar set-up.

    Attributes:
        slenderness, size: of the block's proportions and scale, one draw a campaign [1].
        energy_ratio: of an impact, one draw a campaign [1].
        slope: of the table, one draw a campaign [rad].
        trial_gain: of the motion, one draw a trial [1].
        trial_slope: of the base where the block was put down, one draw a trial [rad].
    """

    slenderness: float = 0.02
    size: float = 0.02
    energy_ratio: float = 0.02
    slope: float = 0.002
    trial_gain: float = 0.01
    trial_slope: float = 0.002


class PlanarSimulator:
    """Simulates a campaign's trials with the planar block.

    Args:
        campaign: every trial needs a motion.
        block: nominal geometry.
        nuisances: their priors.
        library: effects to offer; default: all.
        exclude: names left out.
        series: also give features of the tilt's series.
        seed: of nuisances and of what belongs to single trials.

    Raises:
        DiagnosisError: a trial without motion.
    """

    def __init__(
        self,
        campaign: Campaign,
        block: PlanarBlock | None = None,
        *,
        nuisances: PlanarNuisances | None = None,
        library: Mapping[str, PlanarEffect] | None = None,
        exclude: Collection[str] = (),
        series: bool = False,
        seed: int = 0,
    ) -> None:
        self._block = PlanarBlock() if block is None else block
        self._sd = PlanarNuisances() if nuisances is None else nuisances
        offered = PLANAR_LIBRARY if library is None else library
        self._library = {name: e for name, e in offered.items() if name not in exclude}
        self._series = series
        self._seed = seed
        self._accelerations, self._motion = _accelerations(campaign)
        order = np.array([trial.order for trial in campaign.trials], dtype=np.float64)
        span = np.ptp(order) or 1.0
        self._order = (order - order.min()) / span
        digest = hashlib.sha256(self._accelerations.tobytes() + self._motion.tobytes())
        digest.update(repr((self._block, self._sd, self._order.tolist(), series, seed)).encode())
        self._identity = digest.hexdigest()

    @property
    def library(self) -> Library:
        """Effects that it can apply."""
        # A planar effect has what a diagnosis asks of an effect: name, parameters, channels, stage.
        return cast(Library, self._library)

    @property
    def identity(self) -> str:
        """Hash of block, priors and motions."""
        return self._identity

    @property
    def variants(self) -> tuple[int, ...]:
        """None: the step is fixed and nothing iterates."""
        return ()

    @property
    def nuisance_names(self) -> tuple[str, ...]:
        """Drawn once a campaign."""
        return ("slenderness", "size", "energy_ratio", "slope")

    def nuisance_draw(self, index: int) -> Array:
        """Standardised nuisances of a draw."""
        return nuisance_normal(self._seed, 4, index)

    def run(self, requests: Sequence[Request]) -> Responses:
        """Simulate, all at once."""
        count = len(requests)
        trial = np.array([r.trial for r in requests], dtype=np.int64)
        values: dict[str, Array] = {name: np.full(count, v) for name, v in DEFAULTS.items()}
        draws = {i: self.nuisance_draw(i) for i in {r.nuisance for r in requests}}
        z = np.array([draws[r.nuisance] for r in requests]).reshape(count, 4)
        own = np.array([self._trial_draw(r) for r in requests]).reshape(count, 3)
        sd, block = self._sd, self._block
        size = np.exp(sd.size * z[:, 1])
        values["half_width"] = block.half_width * size
        values["half_height"] = block.half_height * size / np.exp(sd.slenderness * z[:, 0])
        values["energy_ratio"] *= np.exp(sd.energy_ratio * z[:, 2])
        values["offset"] += GRAVITY * (sd.slope * z[:, 3] + sd.trial_slope * own[:, 1])
        values["gain"] *= 1 + sd.trial_gain * own[:, 0]
        lanes = Lanes(values, self._order[trial], own[:, 2])
        named: dict[str, list[int]] = {}
        for i, request in enumerate(requests):
            for name, _ in request.effects:
                named.setdefault(name, []).append(i)
        for name, members in named.items():
            rows = np.array(members, dtype=np.int64)
            given = np.array([dict(requests[i].effects)[name] for i in members])
            self._library[name].act(lanes, rows, given)
        # Runs of one motion end together; neighbours in the order given usually share effects.
        blocks = PlanarBlocks(motion=self._motion[trial], **values)
        over, peak, features = simulate_planar(blocks, self._accelerations, series=self._series)
        over = np.where(
            values["outcome_tilt"] < DEFAULTS["outcome_tilt"], peak > values["outcome_tilt"], over
        )
        over = np.where(values["flipped"] > 0, 1 - over, over)
        return Responses(over, peak, features)

    def _trial_draw(self, request: Request) -> Array:
        """Two normals and a uniform of a trial under one nuisance draw and replicate.

        Effects do not enter, so that all effects see the same draws (common random numbers).
        """
        if request.nuisance == 0 and request.replicate == 0:
            return np.array([0.0, 0.0, 0.5])
        rng = np.random.Generator(
            np.random.Philox(
                key=self._seed,
                counter=[0, request.trial, request.nuisance, request.replicate],
            )
        )
        return np.append(rng.standard_normal(2), rng.random())


def _accelerations(campaign: Campaign) -> tuple[Array, NDArray[np.int64]]:
    """Table accelerations every `STEP`, one column a motion file, and each trial's column."""
    columns: dict[str, int] = {}
    rows: list[Array] = []
    motion = np.zeros(len(campaign), dtype=np.int64)
    for i, trial in enumerate(campaign.trials):
        record = campaign.record(trial)
        if record is None or trial.motion_file is None:
            raise DiagnosisError(
                f"campaign {campaign.name!r}: trial {trial.trial!r} has no motion; keep those that "
                "have one with `with_motion`"
            )
        if trial.motion_file not in columns:
            columns[trial.motion_file] = len(rows)
            built = build_recorded_motion(
                record,
                record.sample_interval,
                channel="displacement" if record.acceleration is None else "acceleration",
                filter=Filter(low=0.1, high=min(25.0, 0.45 / record.sample_interval)),
            )
            time = np.arange(0.0, built.duration, STEP)
            rows.append(np.interp(time, built.times, built.acceleration))
        motion[i] = columns[trial.motion_file]
    steps = max(row.size for row in rows) + round(TAIL / STEP)
    out = np.zeros((steps, len(rows)))
    for k, row in enumerate(rows):
        out[: row.size, k] = row
    return out, motion
