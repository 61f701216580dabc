"""How far each effect's range reaches beyond where it overwhelms all else.

A prior's end is a matter of what is conceivable, not of what a campaign shows: a table that pitches
by a fiftieth of its prior's end is plain to see, and at that end it overturns everything. Draws
spread over the prior would leave few where an effect has to be found. So each effect is tried at a
few shares of its range, and the draws are placed by what is seen.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.observed.observations import LEAST_TILT
from vsr2.diagnosis.simulated.bank import Bank
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

SHARES = (1.0, 0.25, 0.0625, 0.015625, 0.00390625)
"""Of the range on one side of the null at which an effect is tried."""
OVERWHELMING = 3.0
"""Root mean square change of the trials, in standard deviations of what nuisances leave, at an
effect's reach."""
TRIALS = 24
"""On which effects are tried at most."""
PLAIN = 24
"""Draws without effect, from which that standard deviation is taken."""
_NUISANCES = 4
"""Draws of nuisances that the trials take in turn."""
_MOST = 8.0
"""Standard deviations that one trial counts for at most."""
_LEAST_SCATTER = 0.3
"""Of a trial, over the median of all."""


def reaching(
    bank: Bank,
    screening: Screening,
    *,
    most: int = TRIALS,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Library:
    """The simulator's library with the reach of each effect.

    The response is the logarithm of the largest tilt, 1 rad for a rock that overturns, whatever the
    tier, so that all tiers share their simulations. An effect that changes it by `OVERWHELMING` at
    the smallest share already leaps beside its null: it keeps its whole range.

    Args:
        bank: of simulations.
        screening: which trials were near the verge.
        most: trials that are used.
        seed: of the draws.
        progress: called with simulations done and all.
    """
    library = bank.simulator.library
    chosen = screening.verge if screening.verge.size else screening.kept
    trials = chosen[np.linspace(0, chosen.size - 1, min(most, chosen.size)).astype(int)]
    ladders = [(entry, above) for entry in library.values() for above in _sides(entry)]
    plain = [Request(int(t), (), m, 1) for m in range(1, PLAIN + 1) for t in trials]

    def tried(entry: Entry, above: bool, share: float, m: int) -> Effects:
        secondary = effect_quantiles(entry, m, seed)
        return ((entry.name, at_share(entry, share, above=above, secondary=secondary)),)

    steps = [
        Request(int(t), tried(entry, above, share, _nuisance(i)), _nuisance(i), 1)
        for entry, above in ladders
        for share in SHARES
        for i, t in enumerate(trials)
    ]
    total = len(plain) + len(steps)
    done = None if progress is None else (lambda n: progress(n, total))
    found = _severity(bank.run(plain + steps, done=done))
    bare = found[: len(plain)].reshape(PLAIN, trials.size)
    nuisances = np.stack([bank.simulator.nuisance_draw(m) for m in range(1, PLAIN + 1)])
    scatter = _scatter(bare, nuisances)
    own = bare[[_nuisance(i) - 1 for i in range(trials.size)], np.arange(trials.size)]
    moved = found[len(plain) :].reshape(len(ladders), len(SHARES), trials.size)
    size = np.clip((moved - own) / scatter, -_MOST, _MOST)
    sizes = np.sqrt(np.nanmean(size**2, axis=2))
    reach = {
        (entry.name, above): _reach(row) for (entry, above), row in zip(ladders, sizes, strict=True)
    }
    return {name: _with_reach(entry, reach) for name, entry in library.items()}


def tries(library: Library) -> int:
    """Simulations under effects of each trial on which they are tried."""
    return len(SHARES) * sum(len(_sides(entry)) for entry in library.values())


def _nuisance(i: int) -> int:
    return 1 + i % _NUISANCES


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
    tilt = np.where(found.overturned > 0.5, 1.0, np.clip(found.peak_tilt, LEAST_TILT, 1.0))
    return np.where(np.isfinite(found.overturned), np.log(tilt), np.nan)


def _scatter(bare: Array, nuisances: Array) -> Array:
    """Standard deviation of each trial beside a linear effect of the nuisances, shape (trials,)."""
    x = np.hstack([np.ones((len(bare), 1)), nuisances])
    known = np.where(np.isfinite(bare), bare, np.nanmean(bare))
    rest = known - x @ np.linalg.lstsq(x, known, rcond=None)[0]
    out = np.sqrt((rest**2).sum(axis=0) / max(len(bare) - x.shape[1], 1))
    return np.asarray(np.maximum(out, max(_LEAST_SCATTER * float(np.median(out)), 1e-3)))


def _reach(sizes: Array) -> float:
    """Share at which an effect's size reaches `OVERWHELMING`, by interpolation of logarithms."""
    rising = np.maximum.accumulate(np.maximum(sizes[::-1], 1e-3))
    shares = np.log(SHARES[::-1])
    if rising[0] >= OVERWHELMING or rising[-1] < OVERWHELMING:
        return 1.0
    k = int(np.argmax(rising >= OVERWHELMING))
    low, high = np.log(rising[k - 1]), np.log(rising[k])
    part = (np.log(OVERWHELMING) - low) / max(high - low, 1e-9)
    return float(np.exp(shares[k - 1] + part * (shares[k] - shares[k - 1])))


def _with_reach(entry: Entry, reach: dict[tuple[str, bool], float]) -> Entry:
    above = reach.get((entry.name, True), 1.0)
    below = reach.get((entry.name, False), above)
    return entry if below == above == 1.0 else Reaching(entry, below, above)
