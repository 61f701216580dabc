"""Kept trials re-simulated under what is found: whether the effect does what was predicted of it.

The held-out losses of kept trials are the emulator's. Before an effect is named, these trials are
simulated again without effect and with the one chosen on the other motions, parameters and
nuisances drawn from what those say of them, starts and noise fresh, and judged by the simulations
alone: neither an error of the emulator nor the luck of the draws that led to the choice is in that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.how_far.held_out import HeldOutLosses, Interval, interval, resampled_means
from vsr2.diagnosis.likelihood.evidence import PREDICTED, Data
from vsr2.diagnosis.likelihood.score import by_kind
from vsr2.diagnosis.observed.observations import Observations
from vsr2.diagnosis.simulated.cache import SimulationCache
from vsr2.diagnosis.simulated.design import Screening
from vsr2.diagnosis.simulated.simulator import Request

Array = NDArray[np.float64]

RESIMULATION_RUNS = 2 * PREDICTED
"""Simulations of each kept trial: without effect, and with the chosen one."""
FRESH = 2
"""Replicate of starts and noise: that of no other simulation with nuisances."""


@dataclass(frozen=True)
class ResimulationConstants:
    """How a re-simulation is judged; chosen by hand.

    Attributes:
        least_closed: share of what the emulator predicts that simulations must close, if
            significantly less.
    """

    least_closed: float = 0.5


RESIMULATION = ResimulationConstants()


@dataclass(frozen=True)
class Resimulation:
    """What simulations close of the gap of the kept trials.

    Attributes:
        closure: their closure, with its interval over motions. Its floor is what simulations
            without effect lose when each is judged by the others.
        predicted: the emulator's on the same trials.
        short: whether it is significantly less than `RESIMULATION.least_closed` of that.
    """

    closure: Interval
    predicted: float
    short: bool


def resimulate(
    store: SimulationCache,
    seen: Observations,
    screening: Screening,
    held_out: HeldOutLosses,
    floor: Array,
    seed: int,
) -> Resimulation:
    """Simulate the kept trials without effect and with what was chosen, and judge both.

    Args:
        store: of simulations.
        seen: the observed campaign.
        screening: which trials were kept.
        held_out: the models of each group of kept trials, and their losses.
        floor: mean loss of each kept trial in campaigns without effect.
        seed: of noise and resamples.
    """
    kept = screening.kept
    groups = np.searchsorted(np.unique(held_out.group), held_out.group).tolist()

    def simulated(role: str) -> Data:
        """`PREDICTED` campaigns."""
        requests = [
            Request(int(trial), effects, nuisance, FRESH)
            for trial, k in zip(kept, groups, strict=True)
            for effects, nuisance in held_out.draws[held_out.chosen[role][k]][k]
        ]
        found = store.run(requests)
        shape = (kept.size, PREDICTED)
        series = None
        if found.features is not None:
            series = found.features.reshape(*shape, -1).swapaxes(0, 1)
        overturned = found.overturned.reshape(shape).T
        peak = found.peak_tilt.reshape(shape).T
        return Data(overturned, seen.noted(overturned, peak, series, seed))

    observed = Data(seen.overturned[None, kept], seen.features[None, kept])
    parts = [simulated(role) for role in ("before", "after")]
    before, after = (outcome_loss(part, observed) for part in parts)
    scores = [feature_scores(part, observed) for part in parts]
    # A feature counts where both have it: a rock that falls has no largest tilt.
    both = np.isfinite(scores[0]) & np.isfinite(scores[1])
    before, after = (
        loss + by_kind(np.where(both, score, 0.0))
        for loss, score in zip((before, after), scores, strict=True)
    )
    closed, predicted = before - after, held_out.before - held_out.after
    gaps = [before - _own_loss(parts[0], both), held_out.before - floor]
    values = np.stack([closed, predicted, *gaps])
    means, draws = values.mean(axis=1), resampled_means(values, seen.motion[kept], seed=seed)
    own, emulated = (max(float(gap), 1e-9) for gap in means[2:])
    return Resimulation(
        interval(float(means[0]) / own, draws[:, 0] / np.maximum(draws[:, 2], 1e-9)),
        float(means[1]) / emulated,
        bool(np.quantile(draws[:, 0] - RESIMULATION.least_closed * draws[:, 1], 0.975) < 0),
    )


def _own_loss(simulated: Data, counts: NDArray[np.bool_]) -> Array:
    """Mean loss of each simulation by the others, shape (trials,); `counts`: which features do."""
    out = np.zeros(len(counts))
    for i in range(len(simulated)):
        order = np.roll(np.arange(len(simulated)), -i)
        one, others = simulated.take(order[:1]), simulated.take(order[1:])
        score = feature_scores(others, one)
        score = np.where(counts & np.isfinite(score), score, 0.0)
        out += outcome_loss(others, one) + by_kind(score)
    return out / len(simulated)


def outcome_loss(simulated: Data, observed: Data) -> Array:
    """Log loss of outcomes by the share of simulations, half a count on each side, (trials,)."""
    y = observed.overturned[0]
    ones = np.nansum(simulated.overturned, axis=0)
    p = (ones + 0.5) / (np.isfinite(simulated.overturned).sum(axis=0) + 1)
    return np.where(np.isfinite(y), -np.where(y > 0.5, np.log(p), np.log1p(-p)), 0.0)


def feature_scores(simulated: Data, observed: Data) -> Array:
    """CRPS of each feature by the simulations as an ensemble, shape (trials, k).

    Fair: what a few members would lose against many is taken off (C. A. T. Ferro, "Fair scores for
    ensemble forecasts", Q. J. R. Meteorol. Soc. 140, 2014). NaN where it was not observed, or fewer
    than two simulations have it.
    """
    x, y = simulated.features, observed.features[0]
    count = np.isfinite(x).sum(axis=0)
    pairs = np.nansum(np.abs(x[:, None] - x[None]), axis=(0, 1))
    with np.errstate(invalid="ignore", divide="ignore"):
        score = np.nansum(np.abs(x - y), axis=0) / count - pairs / (2 * count * (count - 1))
    return np.where(np.isfinite(y) & (count > 1), score, np.nan)
