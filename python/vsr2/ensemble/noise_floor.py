"""The noise floor in its layers: how often an outcome changes although nothing of substance did."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.ensemble.observed.observations import OBSERVED, Observations
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.simulator import FINE_SOLVER, HALF_STEP, PERTURBED, Request

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NoiseFloorConstants:
    """How the noise floor is measured; chosen by hand.

    Attributes:
        replicates: simulations of a trial in each layer that is drawn.
        most_trials: uncertain trials that are used.
    """

    replicates: int = 4
    most_trials: int = 40

    @property
    def runs(self) -> int:
        """Simulations of each trial used: nominal, three drawn layers, two numerical variants."""
        return 1 + 3 * self.replicates + 2


NOISE_FLOOR = NoiseFloorConstants()


def noise_floor(
    cache: SimulationCache,
    seen: Observations,
    trials: NDArray[np.int64],
    probability: Array,
) -> dict[str, float | int | None]:
    """Share of outcomes that differ from the nominal simulation's, layer by layer.

    Args:
        cache: of simulations.
        seen: the observed campaign.
        trials: indices of those that lift off.
        probability: of overturning in campaigns without effect, of each of them.

    Returns:
        `numerical`: under perturbations of the start by 1e-6 to 1e-4 m; `time_step`: at half the
        time step; `solver`: with twice the iterations (None: the simulator has no such variant);
        `input`: under fresh placement and motion noise (replicates above 0); `nuisance`: under
        fresh geometry, contact and the like; `physical`: between repeats in the campaign (of one
        motion file, or of one motion with PGA and PGV within 2 %), None without repeats;
        `physical_expected`: the same where each repeat overturns with its probability in gap-free
        campaigns, nuisances and starts drawn again: no fewer than if some of these were
        common to both; `trials` and `repeats` behind them. Shares are of the uncertain trials, but
        of repeats of all.
    """
    near = trials[np.argsort(np.abs(probability - 0.5), kind="stable")]
    used = np.sort(near[: NOISE_FLOOR.most_trials])
    spots = [(0, 0)]
    spots += [(0, PERTURBED - r) for r in range(NOISE_FLOOR.replicates)]
    spots += [(0, r) for r in range(1, NOISE_FLOOR.replicates + 1)]
    spots += [(n, 0) for n in range(1, NOISE_FLOOR.replicates + 1)]
    variants = [v for v in (HALF_STEP, FINE_SOLVER) if v in cache.simulator.variants]
    spots += [(0, v) for v in variants]
    requests = [Request(int(t), (), n, r) for n, r in spots for t in used]
    found = cache.run(requests).overturned.reshape(len(spots), -1)
    differs = np.where(
        np.isfinite(found[1:]) & np.isfinite(found[0]), found[1:] != found[0], np.nan
    )
    layers = differs[: 3 * NOISE_FLOOR.replicates].reshape(3, NOISE_FLOOR.replicates, -1)
    numerical, own, nuisance = (float(np.nanmean(layer)) for layer in layers)
    varied = dict(zip(variants, differs[3 * NOISE_FLOOR.replicates :], strict=True))
    shares = {v: float(np.nanmean(row)) for v, row in varied.items()}
    pairs, unequal = _repeats(seen)
    everyone = np.zeros(len(seen))
    everyone[trials] = 2 * probability * (1 - probability)
    expected = everyone[pairs].mean() if len(pairs) else None
    return {
        "numerical": numerical,
        "time_step": shares.get(HALF_STEP),
        "solver": shares.get(FINE_SOLVER),
        "input": own,
        "nuisance": nuisance,
        "physical": float(unequal.mean()) if len(pairs) else None,
        "physical_expected": None if expected is None else float(expected),
        "trials": int(used.size),
        "repeats": len(pairs),
    }


def _repeats(seen: Observations) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Trials of which a later one is a repeat, once for each, and whether the two end otherwise.

    Repeats have one specimen and one ground motion, and the same motion file or, as each trial has
    a recording of its own, PGA and PGV within `OBSERVED.repeated`.
    """
    same = (seen.motion[:, None] == seen.motion) & (seen.specimen[:, None] == seen.specimen)
    files = np.array([trial.motion_file or "" for trial in seen.campaign.trials])
    log_pgv = seen.log_pga_g + seen.log_pgv_pga_s
    near = np.abs(seen.log_pga_g[:, None] - seen.log_pga_g) <= OBSERVED.repeated
    near &= np.abs(log_pgv[:, None] - log_pgv) <= OBSERVED.repeated
    near |= files[:, None] == files
    one, other = np.nonzero(np.triu(same & near, k=1))
    return one, seen.overturned[one] != seen.overturned[other]
