"""How far each effect's range reaches beyond where it overwhelms all else.

A prior's end is a matter of what is conceivable, not of what a campaign shows: a table that pitches
by a fiftieth of its prior's end is plain to see, and at that end it overturns everything. Draws
spread over the prior would leave few where an effect has to be found. So each effect is tried at a
few shares of its range, and the draws are placed by what is seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.observed.observations import OBSERVED
from vsr2.diagnosis.simulated.cache import Progress, SimulationCache
from vsr2.diagnosis.simulated.design import Screening, effect_quantiles
from vsr2.diagnosis.simulated.library import (
    Entry,
    Library,
    Reaching,
    at_share,
    free_parameters,
    null_quantile,
)
from vsr2.diagnosis.simulated.simulator import Effects, Request, Responses

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ReachConstants:
    """How effects are tried; chosen by hand.

    Attributes:
        shares: of the range on one side of the null at which an effect is tried.
        overwhelming: root mean square change of the trials at an effect's reach, in standard
            deviations of what nuisances leave.
        trials: on which effects are tried at most.
        plain: draws without effect, from which that standard deviation is taken.
        nuisances: draws of nuisances that the trials take in turn.
        most: standard deviations that one trial counts for at most.
        least_scatter: of a trial, over the median of all.
    """

    shares: tuple[float, ...] = (1.0, 0.25, 0.0625, 0.015625, 0.00390625)
    overwhelming: float = 3.0
    trials: int = 24
    plain: int = 24
    nuisances: int = 4
    most: float = 8.0
    least_scatter: float = 0.3


REACH = ReachConstants()


def reaching(
    cache: SimulationCache,
    screening: Screening,
    *,
    most: int = REACH.trials,
    seed: int = 0,
    progress: Progress | None = None,
) -> Library:
    """The simulator's library with the reach of each effect.

    The response is the logarithm of the largest tilt, 1 rad for a rock that overturns, whatever the
    tier, so that all tiers share their simulations. An effect that changes it by
    `REACH.overwhelming` at the smallest share already leaps beside its null: it keeps its range.

    Args:
        cache: of simulations.
        screening: which trials were near the boundary of overturning.
        most: trials that are used.
        seed: of the draws.
        progress: called with simulations done and all.
    """
    library = cache.simulator.library
    chosen = screening.uncertain_at_first if screening.uncertain_at_first.size else screening.kept
    trials = chosen[np.linspace(0, chosen.size - 1, min(most, chosen.size)).astype(int)]
    ladders = [(entry, above) for entry in library.values() for above in _sides(entry)]
    plain = [Request(int(t), (), m, 1) for m in range(1, REACH.plain + 1) for t in trials]

    def tried(entry: Entry, above: bool, share: float, m: int) -> Effects:
        secondary = effect_quantiles(entry, m, seed)
        return ((entry.name, at_share(entry, share, above=above, secondary=secondary)),)

    steps = [
        Request(int(t), tried(entry, above, share, _nuisance(i)), _nuisance(i), 1)
        for entry, above in ladders
        for share in REACH.shares
        for i, t in enumerate(trials)
    ]
    found = _severity(cache.run(plain + steps, progress=progress))
    bare = found[: len(plain)].reshape(REACH.plain, trials.size)
    nuisances = np.stack([cache.simulator.nuisance_draw(m) for m in range(1, REACH.plain + 1)])
    scatter = _scatter(bare, nuisances)
    own = bare[[_nuisance(i) - 1 for i in range(trials.size)], np.arange(trials.size)]
    moved = found[len(plain) :].reshape(len(ladders), len(REACH.shares), trials.size)
    size = np.clip((moved - own) / scatter, -REACH.most, REACH.most)
    sizes = np.sqrt(np.nanmean(size**2, axis=2))
    reach = {
        (entry.name, above): _reach(row) for (entry, above), row in zip(ladders, sizes, strict=True)
    }
    return {name: _with_reach(entry, reach) for name, entry in library.items()}


def tries(library: Library) -> int:
    """Simulations under effects of each trial on which they are tried."""
    return len(REACH.shares) * sum(len(_sides(entry)) for entry in library.values())


def _nuisance(i: int) -> int:
    return 1 + i % REACH.nuisances


def _sides(entry: Entry) -> tuple[bool, ...]:
    """Sides of the null on which an effect has values; none where no null is known."""
    primary = [p for p in free_parameters(entry) if not p.secondary]
    if not primary or any(np.isnan(p.null) for p in primary):
        return ()
    nulls = [null_quantile(p) for p in primary]
    two = any(n is not None and 1e-6 < n < 1 - 1e-6 for n in nulls)
    return (False, True) if two else (True,)


def _severity(found: Responses) -> Array:
    """Logarithm of the largest tilt [rad], 1 rad for a rock that overturned."""
    tilt = np.where(found.overturned > 0.5, 1.0, np.clip(found.peak_tilt, OBSERVED.least_tilt, 1.0))
    return np.where(np.isfinite(found.overturned), np.log(tilt), np.nan)


def _scatter(bare: Array, nuisances: Array) -> Array:
    """Standard deviation of each trial beside a linear effect of the nuisances, shape (trials,)."""
    x = np.hstack([np.ones((len(bare), 1)), nuisances])
    known = np.where(np.isfinite(bare), bare, np.nanmean(bare))
    rest = known - x @ np.linalg.lstsq(x, known, rcond=None)[0]
    out = np.sqrt((rest**2).sum(axis=0) / max(len(bare) - x.shape[1], 1))
    return np.asarray(np.maximum(out, max(REACH.least_scatter * float(np.median(out)), 1e-3)))


def _reach(sizes: Array) -> float:
    """Share at which an effect's size is overwhelming, by interpolation of logarithms."""
    rising = np.maximum.accumulate(np.maximum(sizes[::-1], 1e-3))
    shares = np.log(REACH.shares[::-1])
    if rising[0] >= REACH.overwhelming or rising[-1] < REACH.overwhelming:
        return 1.0
    k = int(np.argmax(rising >= REACH.overwhelming))
    low, high = np.log(rising[k - 1]), np.log(rising[k])
    part = (np.log(REACH.overwhelming) - low) / max(high - low, 1e-9)
    return float(np.exp(shares[k - 1] + part * (shares[k] - shares[k - 1])))


def _with_reach(entry: Entry, reach: dict[tuple[str, bool], float]) -> Entry:
    above = reach.get((entry.name, True), 1.0)
    below = reach.get((entry.name, False), above)
    return entry if below == above == 1.0 else Reaching(entry, below, above)
