"""The detection limit: how well a campaign can show an effect, measured by simulation."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vsr2.blind.custodian.design import NUISANCES, Protocol, draw_inputs, draw_nuisances
from vsr2.blind.custodian.engine import PackEngine
from vsr2.blind.custodian.pack_streams import PackStream, pack_generator
from vsr2.blind.form.pack_settings import PackSettings
from vsr2.blind.mujoco import Drawable

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SignalRules:
    """How signals are measured and magnitudes drawn; sealed with a pack.

    All are choices, none is fitted; `studies/blind_signals.py --spread` shows the scatter of the
    signals that they give.

    Attributes:
        detected: signal over noise at the detection limit.
        window: least and greatest magnitude that is drawn, over the detection limit.
        extra_scatter: standard deviation of ln tilt beyond what replicates show.
        most_deviations: own standard deviations that the mean change of one observation counts for
            at most.
        tilts: to which largest tilts are clipped [rad].
        search_steps: magnitudes that a search tries at most.
        search_shares: of the strength's range that a search tries at least and, where no magnitude
            is near, first.
        search_close: least and greatest signal over the detected one that end a search.
        search_factor: between two magnitudes at most.
        attempts: draws of an effect for a campaign, until one is measured in `window`.
        step: by which a measured draw moves the next ones at most.
        nulls: draws of the null campaign, over the replicates.
        search_twins: that a search measures at least; half of the replicates where these are more.
    """

    detected: float = 3.0
    window: tuple[float, float] = (0.5, 6.0)
    extra_scatter: float = 0.05
    most_deviations: float = 3.0
    tilts: tuple[float, float] = (0.005, 1.0)
    search_steps: int = 6
    search_shares: tuple[float, float] = (0.001, 0.3)
    search_close: tuple[float, float] = (0.85, 1.2)
    search_factor: float = 10.0
    attempts: int = 8
    step: float = 4.0
    nulls: int = 5
    search_twins: int = 4


RULES = SignalRules()


def observations(overturned: Sequence[bool], peak_tilt: Sequence[float]) -> Array:
    """Outcome and logarithm of the largest tilt (clipped to 0.005 to 1 rad), shape (2 n,)."""
    tilt = np.log(np.clip(np.asarray(peak_tilt, dtype=np.float64), *RULES.tilts))
    return np.concatenate([np.asarray(overturned, dtype=np.float64), tilt])


def squared_signal(changes: Array, covariance: Array) -> float:
    """Squared length of the mean change in the metric of a covariance, without bias.

    (|sum d|^2 - sum |d|^2) / (R (R - 1)) over the R changes d, with |d|^2 = d' S^-1 d: each pair
    of two independent draws, none with itself. Its expectation is that of the mean change alone,
    however observations of one draw go together (a U-statistic, Hoeffding 1948). It may be
    negative.

    Args:
        changes: of the observations, one row a draw, shape (R, n), R at least 2.
        covariance: S, shape (n, n).
    """
    count = len(changes)
    total = changes.sum(axis=0)
    together = float(total @ np.linalg.solve(covariance, total))
    own = float((changes * np.linalg.solve(covariance, changes.T).T).sum())
    return (together - own) / (count * (count - 1))


class SignalMeter:
    """Measures signals on one engine, scene and part of a protocol with common random numbers.

    The null campaign is simulated with `nulls` R draws of nuisances and starts, the first R of them
    again under the effect (twins). The observations (outcomes and ln largest tilts) are regressed
    on the nuisances, which gives their covariance S: slopes times slopes, and each observation's
    own scatter, the mean of that without the effect and with it (half the variance of its change
    between twins more), so that no trial which an effect makes uncertain counts as certain. It is
    at least a third of the mean change, so that no single trial that leaps decides. Scatters are
    scaled by trials of the design over trials of the campaign, and by the slopes' error. Signal
    over noise is the length of the mean change in the metric S^-1 (:func:`squared_signal`; with the
    mean of both covariances it is the first term of the distance of Bhattacharyya 1943, times 8):
    how far a campaign under the effect lies from the nominal one where nuisances are unknown.

    Args:
        engine: that simulates.
        protocol: of the campaign; the design is every so manieth of its trials, so that it has all
            motions, amplitudes and sessions in their proportions.
        settings: of the pack; `signal_trials` of the design, `replicates` twins.
        seed: of the choice of trials, nuisances and starts.

    Attributes:
        trials: of the design, by index in the protocol.
    """

    def __init__(
        self, engine: PackEngine, protocol: Protocol, settings: PackSettings, seed: int
    ) -> None:
        self._engine = engine
        self._settings = settings
        self._seed = seed
        self._protocol = protocol
        total = len(protocol.rows)
        count = min(settings.signal_trials, total)
        shift = float(pack_generator(seed, PackStream.SIGNAL_TRIALS).random())
        self.trials = [int((i + shift) * total / count) for i in range(count)]

    @cached_property
    def _null(self) -> Array:
        """Observations of the null campaign, one row a draw."""
        count = RULES.nulls * self._settings.replicates
        return np.stack([self._run(r, {}) for r in range(count)])

    @cached_property
    def _noise(self) -> tuple[Array, Array, float]:
        """Of the null campaign: slopes times slopes, own scatters, and what scales scatters."""
        count = len(self._null)
        drawn = np.stack([self._drawn(r) for r in range(count)])
        slopes, *_ = np.linalg.lstsq(
            np.hstack([np.ones((count, 1)), drawn]), self._null, rcond=None
        )
        fitted = slopes[0] + drawn @ slopes[1:]
        scatter = ((self._null - fitted) ** 2).sum(axis=0) / (count - 1 - drawn.shape[1])
        # Few replicates do not tell that an outcome is certain: Laplace's rule of succession.
        outcomes = len(self.trials)
        chance = (self._null[:, :outcomes].sum(axis=0) + 1) / (count + 2)
        scatter[:outcomes] = np.maximum(scatter[:outcomes], chance * (1 - chance))
        scatter[outcomes:] += RULES.extra_scatter**2
        # All of the campaign's trials, of which the design is a part; and the slopes' own error,
        # without which a nuisance in disguise would seem to be a signal.
        scale = outcomes / len(self._protocol.rows) + drawn.shape[1] / count
        return slopes[1:].T @ slopes[1:], scatter, scale

    def _drawn(self, replicate: int) -> Array:
        """Standardised nuisances of a replicate."""
        nuisances = draw_nuisances(
            pack_generator(self._seed, PackStream.SIGNAL_REPLICATES, replicate), self._settings
        )
        tolerances = self._settings.tolerances
        return np.array(
            [
                (getattr(nuisances, name) - 1) / max(getattr(tolerances, name), 1e-9)
                for name in NUISANCES
            ]
        )

    def _run(self, replicate: int, effects: Mapping[str, Mapping[str, float]]) -> Array:
        rng = pack_generator(self._seed, PackStream.SIGNAL_REPLICATES, replicate)
        _, inputs = draw_inputs(rng, self._protocol, self._settings, self.trials)
        draws = pack_generator(self._seed, PackStream.SIGNAL_SEEDS, replicate)
        common, *seeds = (int(one) for one in draws.integers(2**31, size=len(inputs) + 1))
        responses = self._engine.run(
            (
                replace(
                    one,
                    effects=effects,
                    context=replace(one.context, campaign_seed=common, trial_seed=own),
                )
                for one, own in zip(inputs, seeds, strict=True)
            ),
            1.0,
        )
        seen = list(responses)
        return observations([s.overturned for s in seen], [s.peak_tilt for s in seen])

    def signal(
        self, effect: str, values: Mapping[str, float], *, twins: int | None = None
    ) -> float:
        """Signal over noise of an effect with given values of all its parameters.

        Args:
            effect: its name.
            values: by parameter.
            twins: at least 2; None: `replicates` of the settings.
        """
        count = self._settings.replicates if twins is None else twins
        changes = np.stack([self._run(r, {effect: values}) - self._null[r] for r in range(count)])
        common, scatter, scale = self._noise
        own = scatter + 0.5 * changes.var(axis=0, ddof=1)
        own = scale * np.maximum(own, (changes.mean(axis=0) / RULES.most_deviations) ** 2)
        return math.sqrt(max(0.0, squared_signal(changes, common + np.diag(own))))

    def limit(self, effect: Drawable, sign: int, near: float = math.inf) -> float:
        """Magnitude at which signal over noise is about 3, by a search over simulated ones.

        It is the distance of the strength from its null on one side, in the strength's scale;
        infinity where none was found in the window.

        Other parameters lie at quantiles of their own for each magnitude. Signals grow about as the
        magnitude, which gives the next one to try, within what is known to be above and below. What
        begins at the null and is detected at a thousandth of its range jumps there: it has no
        detection limit.

        Args:
            effect: of the engine.
            sign: side of its null.
            near: magnitude to try first, such as another engine's limit; infinity: not known.
        """
        low, high = effect.strength.reach()[sign]
        share, first = RULES.search_shares
        least = max(low, share * high)
        found: dict[float, float] = {}

        def ratio_at(magnitude: float) -> float:
            rng = pack_generator(self._seed, PackStream.SIGNAL_VALUES, len(found))
            quantiles = [float(q) for q in rng.random(len(effect.others))]
            values = effect.values(sign * magnitude, quantiles)
            twins = max(RULES.search_twins, self._settings.replicates // 2)
            found[magnitude] = self.signal(effect.name, values, twins=twins)
            return found[magnitude] / RULES.detected

        below, above = 0.0, math.inf
        if low < least and ratio_at(least) >= 1:
            return math.inf
        magnitude = max(least, min(near, high) if math.isfinite(near) else first * high)
        for _ in range(RULES.search_steps):
            ratio = ratio_at(magnitude)
            if ratio >= 1:
                above = min(above, magnitude)
            else:
                below = max(below, magnitude)
            if RULES.search_close[0] < ratio < RULES.search_close[1]:
                break
            factor = RULES.search_factor
            after = magnitude / min(max(ratio, 1 / factor), factor)
            if below > 0 and above < math.inf and not below < after < above:
                after = math.sqrt(below * above)
            magnitude = min(high, max(least, after))
            if magnitude in found:
                break
        return _crossing(sorted(found.items()), high)


def _crossing(measured: Sequence[tuple[float, float]], high: float) -> float:
    """The magnitude at the detection level, from the measured one that is nearest to it."""
    near = [(m, s) for m, s in measured if RULES.window[0] <= s / RULES.detected <= RULES.window[1]]
    if not near:
        return math.inf
    m, s = min(near, key=lambda pair: abs(math.log(pair[1] / RULES.detected)))
    # Of what is strong wherever it acts, the limit lies below the range.
    return min(high, m * RULES.detected / s)
