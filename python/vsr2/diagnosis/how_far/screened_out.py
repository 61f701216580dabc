"""Trials that screening dismissed: simulated again under what the others favour.

Screening drops a trial for what its simulations did, never for its outcome. An effect of a strength
that screening did not try may turn some of them, rightly or not. So each is simulated under the
models by which its group of motions is judged, parameters and nuisances drawn from what the kept
trials of the other groups say of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.how_far.held_out import HeldOutLosses
from vsr2.diagnosis.likelihood.evidence import PREDICTED
from vsr2.diagnosis.simulated.cache import SimulationCache
from vsr2.diagnosis.simulated.design import Screening
from vsr2.diagnosis.simulated.simulator import Request

Array = NDArray[np.float64]


SCREENED_OUT_RUNS = 3 * PREDICTED
"""Simulations of each such trial: without effect, with the chosen one, with the control."""


@dataclass(frozen=True, eq=False)
class ScreenedOut:
    """What the screened-out trials do.

    Attributes:
        trials: indices in the campaign, shape (n,).
        group: by which each is judged, shape (n,).
        certain: whether it does the same whenever it is simulated without effect, shape (n,).
        before, after, negative_control: probability of overturning without effect, with the effect
            chosen on the other motions, and with the negative control so chosen, each (n,).
    """

    trials: NDArray[np.int64]
    group: NDArray[np.int64]
    certain: NDArray[np.bool_]
    before: Array
    after: Array
    negative_control: Array


def simulate_screened_out(
    store: SimulationCache, screening: Screening, held_out: HeldOutLosses, motion: NDArray[np.int64]
) -> ScreenedOut:
    """Simulate them without effect and under the models of their motions' group.

    Motions none of whose trials was kept belong to the first group: no model saw them.

    Args:
        store: of simulations.
        screening: which trials were screened out.
        held_out: the models of each group of kept trials.
        motion: index of each trial's ground motion, shape (trials,).
    """
    kept = screening.kept
    trials = np.setdiff1d(np.arange(motion.size), kept)
    names = np.unique(held_out.group)
    group_of = dict(zip(motion[kept].tolist(), held_out.group.tolist(), strict=True))
    group = np.array([group_of.get(int(m), names[0]) for m in motion[trials]], dtype=np.int64)

    def overturned(role: str) -> Array:
        """Shape (n, PREDICTED)."""
        requests = [
            Request(int(trial), effects, nuisance, 1)
            for trial, k in zip(trials, np.searchsorted(names, group).tolist(), strict=True)
            for effects, nuisance in held_out.draws[held_out.chosen[role][k]][k]
        ]
        if not requests:
            return np.zeros((0, PREDICTED))
        return store.run(requests).overturned.reshape(-1, PREDICTED)

    # What all simulations agree on is as certain as all of them make it.
    alike, likely = screening.alike[trials], screening.probability[trials] > 0.5

    def predicted(table: Array) -> tuple[Array, NDArray[np.bool_]]:
        count = np.isfinite(table).sum(axis=1)
        own = (np.nansum(table, axis=1) + 0.5) / (count + 1)
        same = alike & ((table > 0.5) == likely[:, None]).all(axis=1)
        return np.where(same, screening.probability[trials], own), same

    before, certain = predicted(overturned("before"))
    after, negative_control = (
        predicted(overturned(role))[0] for role in ("after", "negative_control")
    )
    return ScreenedOut(trials, group, certain, before, after, negative_control)


def surprise_p(outcome: Array, probability: Array) -> float:
    """Chance of so many outcomes against what was more probable.

    Args:
        outcome: 1 overturned, 0 not, shape (n,).
        probability: of overturning, shape (n,).
    """
    from scipy.stats import poisson

    if not outcome.size:
        return 1.0
    wrong = np.abs(outcome - probability) > 0.5
    expected = np.minimum(probability, 1 - probability).sum()
    return float(poisson.sf(wrong.sum() - 1, max(expected, 1e-9)))
