"""The detection floor: how strong an effect must be before a campaign can show it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.blind.design import Protocol, Row, log_uniform
from vsr2.blind.mujoco import GroundMotion
from vsr2.blind.settings import PackSettings
from vsr2.blind.shake import Drawable, Engine, Nuisances, Shake

Array = NDArray[np.float64]

DETECTED = 3.0
"""Signal over noise at the floor."""
NUISANCES = ("width", "depth", "height", "energy_ratio", "friction")
_SMALL = 0.05
"""Standard deviation of ln tilt beyond what replicates show."""
_TRIES = 4
_TILTS = (0.005, 1.0)


def observations(overturned: Sequence[bool], peak_tilt: Sequence[float]) -> Array:
    """Outcome and logarithm of the largest tilt (clipped to 0.005 to 1 rad), shape (2 n,)."""
    tilt = np.log(np.clip(np.asarray(peak_tilt, dtype=np.float64), *_TILTS))
    return np.concatenate([np.asarray(overturned, dtype=np.float64), tilt])


def draw_nuisances(rng: np.random.Generator, settings: PackSettings) -> Nuisances:
    """Of one campaign: normal, cut at three standard deviations."""
    draws = np.clip(rng.standard_normal(len(NUISANCES)), -3, 3)
    factors = {
        name: float(1 + getattr(settings.tolerances, name) * draw)
        for name, draw in zip(NUISANCES, draws, strict=True)
    }
    return Nuisances(**factors)


@dataclass(frozen=True)
class Own:
    """What is uncertain in one trial alone.

    Attributes:
        yaw: of the start [rad].
        offset: of the start, x and y [m].
        gain: of the motion, 1 as recorded.
    """

    yaw: float
    offset: tuple[float, float]
    gain: float


def draw_own(rng: np.random.Generator, settings: PackSettings, input_gain: float) -> Own:
    """Of one trial, in a campaign with that standard error of the motion."""
    yaw, x, y, gain = (float(draw) for draw in rng.standard_normal(4))
    tolerances = settings.tolerances
    return Own(
        tolerances.yaw * yaw, (tolerances.offset * x, tolerances.offset * y), 1 + input_gain * gain
    )


@dataclass(frozen=True)
class Floor:
    """Of one effect on one side of its null.

    Attributes:
        magnitude: distance of the strength from its null at which signal over noise is 3, in the
            strength's scale; infinity where its range does not reach it.
        signal: (magnitude, signal over noise) as measured.
    """

    magnitude: float
    signal: tuple[tuple[float, float], ...]


class FloorMeter:
    """Measures floors on one engine, scene and part of a protocol with common random numbers.

    The null campaign is simulated with 10 R draws of nuisances and starts, R / 2 of them again
    under the effect. The observations (outcomes and ln largest tilts) are regressed on the
    nuisances, which gives their covariance S: slopes times slopes, and each observation's own
    scatter, the latter scaled by trials of the design over trials of the campaign, and the slopes'
    error. With d the mean change under the effect, signal over noise is (d' S^-1 d)^(1/2), what
    Monte Carlo error adds to the form taken off: how far a campaign under the effect lies from the
    nominal one where nuisances are unknown.
    """

    def __init__(
        self, engine: Engine, protocol: Protocol, settings: PackSettings, seed: int
    ) -> None:
        self._engine = engine
        self._settings = settings
        self._seed = seed
        trials = len(protocol.rows)
        count = min(settings.floor_trials, trials)
        rng = np.random.default_rng([seed, 202])
        self._places = [int(i) for i in np.sort(rng.permutation(trials)[:count])]
        self._design = [(protocol.rows[i], protocol.motions[i]) for i in self._places]
        count = 10 * settings.replicates
        self._null = np.stack([self._run(r, {}) for r in range(count)])
        drawn = np.stack([self._drawn(r) for r in range(count)])
        slopes, *_ = np.linalg.lstsq(
            np.hstack([np.ones((count, 1)), drawn]), self._null, rcond=None
        )
        fitted = slopes[0] + drawn @ slopes[1:]
        scatter = ((self._null - fitted) ** 2).sum(axis=0) / (count - 1 - drawn.shape[1])
        # Few replicates do not tell that an outcome is certain: Laplace's rule of succession.
        outcomes = len(self._design)
        chance = (self._null[:, :outcomes].sum(axis=0) + 1) / (count + 2)
        scatter[:outcomes] = np.maximum(scatter[:outcomes], chance * (1 - chance))
        scatter[outcomes:] += _SMALL**2
        # All of the campaign's trials, of which the design is a part; and the slopes' own error,
        # without which a nuisance in disguise would seem to be a signal.
        scatter *= outcomes / settings.trials + drawn.shape[1] / count
        self._inverse = np.linalg.inv(slopes[1:].T @ slopes[1:] + np.diag(scatter))

    def _drawn(self, replicate: int) -> Array:
        """Standardised nuisances of a replicate."""
        nuisances = draw_nuisances(
            np.random.default_rng([self._seed, 203, replicate]), self._settings
        )
        tolerances = self._settings.tolerances
        return np.array(
            [
                (getattr(nuisances, name) - 1) / max(getattr(tolerances, name), 1e-9)
                for name in NUISANCES
            ]
        )

    def _run(self, replicate: int, effects: dict[str, dict[str, float]]) -> Array:
        settings = self._settings
        rng = np.random.default_rng([self._seed, 203, replicate])
        nuisances = draw_nuisances(rng, settings)
        gain = log_uniform(rng, *settings.tolerances.input_gain)
        shakes = [
            shake_of(
                row,
                motion,
                place / max(1, settings.trials - 1),
                settings.sessions,
                nuisances,
                draw_own(rng, settings, gain),
                effects,
                (self._seed + replicate, 1000 * replicate + place),
            )
            for place, (row, motion) in zip(self._places, self._design, strict=True)
        ]
        seen = list(self._engine.run(shakes, 1.0))
        return observations([s.overturned for s in seen], [s.peak_tilt for s in seen])

    def signal(self, effect: Drawable, magnitude: float) -> float:
        """Signal over noise of an effect at a signed distance from its null."""
        count = self._settings.replicates // 2
        changes = []
        for r in range(count):
            quantiles = np.random.default_rng([self._seed, 204, r]).random(len(effect.others))
            values = effect.values(magnitude, [float(q) for q in quantiles])
            changes.append(self._run(r, {effect.name: values}) - self._null[r])
        change = np.stack(changes)
        mean = change.mean(axis=0)
        noise = change.var(axis=0, ddof=1) / count
        square = float(mean @ self._inverse @ mean - np.diag(self._inverse) @ noise)
        return math.sqrt(max(square, 0.0))

    def floor(self, effect: Drawable, sign: int) -> Floor:
        """Where signal over noise is 3, by at most four simulated magnitudes.

        Signals grow about as the magnitude, which gives the next one to try, within what is known
        to be above and below.
        """
        low, high = effect.strength.reach()[sign]
        least = max(low, 0.001 * high)
        found: dict[float, float] = {}
        below, above = 0.0, math.inf
        magnitude = max(least, 0.3 * high)
        for _ in range(_TRIES):
            ratio = self.signal(effect, sign * magnitude) / DETECTED
            found[magnitude] = ratio * DETECTED
            if ratio >= 1:
                above = min(above, magnitude)
            else:
                below = max(below, magnitude)
            if 0.85 < ratio < 1.2:
                break
            after = magnitude / min(max(ratio, 0.1), 10.0)
            if below > 0 and above < math.inf and not below < after < above:
                after = math.sqrt(below * above)
            magnitude = min(high, max(least, after))
            if magnitude in found:
                break
        measured = tuple(sorted(found.items()))
        return Floor(_crossing(measured, least, high), measured)


def shake_of(
    row: Row,
    motion: GroundMotion,
    order: float,
    sessions: int,
    nuisances: Nuisances,
    own: Own,
    effects: dict[str, dict[str, float]],
    seeds: tuple[int, int],
) -> Shake:
    """A row of a design as an order to an engine; `order` is 0 for the first, 1 for the last."""
    return Shake(
        interval=motion.interval,
        displacement=motion.displacement * (row.pga * own.gain),
        effects=effects,
        nuisances=nuisances,
        yaw=own.yaw,
        offset=own.offset,
        order=order,
        session=row.session / sessions,
        campaign_seed=seeds[0],
        trial_seed=seeds[1],
    )


def _crossing(measured: Sequence[tuple[float, float]], least: float, high: float) -> float:
    """The magnitude at the detection level, from the measured one that is nearest to it."""
    heard = [(m, s) for m, s in measured if s > 0]
    if not heard or max(s for _, s in heard) < 0.85 * DETECTED:
        return math.inf
    m, s = min(heard, key=lambda pair: abs(math.log(pair[1] / DETECTED)))
    if m == least and s > DETECTED:
        # Strong wherever it acts: the floor lies below the range.
        return m * DETECTED / s
    return min(high, m * min(max(DETECTED / s, 0.5), 2.0))
