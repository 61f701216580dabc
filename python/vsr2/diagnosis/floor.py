"""The noise floor in its layers: how often an outcome changes although nothing of substance did."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.observed.observations import Observations
from vsr2.diagnosis.simulated.bank import Bank
from vsr2.diagnosis.simulated.design import Screening
from vsr2.diagnosis.simulated.simulator import FINE_SOLVER, HALF_STEP, PERTURBED, Request

Array = NDArray[np.float64]

REPLICATES = 4
MAX_TRIALS = 40
FLOOR_RUNS = 1 + 3 * REPLICATES + 2
REPEATED = 0.02
"""Greatest difference of ln PGA and of ln PGV between recordings of one motion repeated: for noise
of the records and the table's scatter; the next amplitude of a campaign lies 5 % off or more."""


def noise_floor(
    bank: Bank,
    seen: Observations,
    screening: Screening,
    *,
    most: int = MAX_TRIALS,
    seed: int = 0,
) -> dict[str, float | int | None]:
    """Share of outcomes that differ from the nominal simulation's, layer by layer.

    Args:
        bank: of simulations.
        seen: the observed campaign.
        screening: which trials are uncertain, and how they ended.
        most: uncertain trials that are used, drawn at random.
        seed: of that draw.

    Returns:
        `numerical`: under perturbations of the start by 1e-6 to 1e-4 m; `time_step`: at half the
        time step; `solver`: with twice the iterations (None: the simulator has no such variant);
        `input`: under fresh placement and motion noise (replicates above 0); `nuisance`: under
        fresh geometry, contact and the like; `physical`: between repeats in the campaign (of one
        motion file, or of one motion with PGA and PGV within 2 %), None without repeats;
        `physical_expected`: the same where each repeat has the share of overturned that screening
        found, nuisances, starts and effects drawn anew: no fewer than if some of these were
        common to both; `trials` and `repeats` behind them. Shares are of the uncertain trials, but
        of repeats of all.
    """
    rng = np.random.default_rng([seed, 3])
    count = min(screening.kept.size, most)
    trials = np.sort(rng.choice(screening.kept, size=count, replace=False))
    spots = [(0, 0)]
    spots += [(0, PERTURBED - r) for r in range(REPLICATES)]
    spots += [(0, r) for r in range(1, REPLICATES + 1)]
    spots += [(n, 0) for n in range(1, REPLICATES + 1)]
    variants = [v for v in (HALF_STEP, FINE_SOLVER) if v in bank.simulator.variants]
    spots += [(0, v) for v in variants]
    requests = [Request(int(t), (), n, r) for n, r in spots for t in trials]
    found = bank.run(requests).overturned.reshape(len(spots), -1)
    differs = np.where(
        np.isfinite(found[1:]) & np.isfinite(found[0]), found[1:] != found[0], np.nan
    )
    layers = differs[: 3 * REPLICATES].reshape(3, REPLICATES, -1)
    numerical, own, nuisance = (float(np.nanmean(layer)) for layer in layers)
    varied = dict(zip(variants, differs[3 * REPLICATES :], strict=True))
    shares = {v: float(np.nanmean(row)) for v, row in varied.items()}
    pairs, unequal = _repeats(seen)
    expected = _expected(screening)[pairs].mean() if len(pairs) else None
    return {
        "numerical": numerical,
        "time_step": shares.get(HALF_STEP),
        "solver": shares.get(FINE_SOLVER),
        "input": own,
        "nuisance": nuisance,
        "physical": float(unequal.mean()) if len(pairs) else None,
        "physical_expected": None if expected is None else float(expected),
        "trials": int(count),
        "repeats": len(pairs),
    }


def _expected(screening: Screening) -> Array:
    """Chance that a trial and its repeat end otherwise, all drawn anew, shape (trials,)."""
    p = np.where(screening.alike, 0.0, screening.probability)
    return np.asarray(2 * p * (1 - p), dtype=np.float64)


def _repeats(seen: Observations) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Trials of which a later one is a repeat, once for each, and whether the two end otherwise.

    Repeats have one specimen and one ground motion, and the same motion file or, as each trial has
    a recording of its own, PGA and PGV within `REPEATED`.
    """
    same = (seen.motion[:, None] == seen.motion) & (seen.specimen[:, None] == seen.specimen)
    files = np.array([trial.motion_file or "" for trial in seen.campaign.trials])
    log_pgv = seen.log_pga + seen.log_ratio
    near = np.abs(seen.log_pga[:, None] - seen.log_pga) <= REPEATED
    near &= np.abs(log_pgv[:, None] - log_pgv) <= REPEATED
    near |= files[:, None] == files
    one, other = np.nonzero(np.triu(same & near, k=1))
    return one, seen.overturned[one] != seen.overturned[other]
