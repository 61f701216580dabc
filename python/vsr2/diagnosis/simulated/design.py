"""Which simulations are run: screening of certain trials, then rounds of simulated campaigns.

Draw m of any effect uses nuisance draw m and the same draws for each trial (common random numbers).
Every simulation serves both routes of inference; nothing is simulated twice.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.observed.observations import Observations
from vsr2.diagnosis.simulated.cache import Progress, SimulationCache
from vsr2.diagnosis.simulated.library import Entry, Library, free_parameters, values_at
from vsr2.diagnosis.simulated.simulator import Effects, Request, quasi_random

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ScreeningConstants:
    """How trials are screened, and how many campaigns are simulated without effect.

    Chosen by hand; `least_none` by what a test at 0.025 asks for.

    Attributes:
        plain: screening draws without effect at most, each with its own nuisances.
        first_look: simulations that every trial gets; others go to trials that may be uncertain.
        moved: largest tilt of a trial that may yet overturn under another effect [rad].
        guard: share of certain trials kept at random.
        none_share: draws without effect for each draw of an effect: they carry the calibration of
            false alarms.
        least_none: draws without effect at least: fewer could not show a significance of 0.025.
    """

    plain: int = 8
    first_look: int = 16
    moved: float = 0.02
    guard: float = 0.1
    none_share: int = 4
    least_none: int = 48


SCREENING = ScreeningConstants()


@dataclass(frozen=True, eq=False)
class Design:
    """Simulated campaigns: one row each, all trials simulated.

    Attributes:
        effect: name, "" without effect, shape (rows,).
        quantiles: of the effect's parameters, one array a row.
        nuisances: standardised, shape (rows, q).
        overturned: shape (rows, trials), NaN where unknown.
        features: shape (rows, trials, k), NaN where one does not apply.
    """

    effect: NDArray[np.str_]
    quantiles: tuple[Array, ...]
    nuisances: Array
    overturned: Array
    features: Array

    def take(self, rows: NDArray[np.int64]) -> Design:
        """Some of the campaigns."""
        return Design(
            self.effect[rows],
            tuple(self.quantiles[i] for i in rows),
            self.nuisances[rows],
            self.overturned[rows],
            self.features[rows],
        )


@dataclass(frozen=True, eq=False)
class Screening:
    """Trials worth simulating further.

    Attributes:
        kept: indices, uncertain ones and the guard, rising.
        guard: indices of the guard alone.
        probability: of overturning over all screening draws with half a pseudo-count on each side,
            for every trial, shape (trials,).
        alike: whether all of its draws ended alike, shape (trials,).
        left_out: uncertain trials that the budget does not reach.
        uncertain_at_first: indices, after the first look; the same at any tier.
    """

    kept: NDArray[np.int64]
    guard: NDArray[np.int64]
    probability: Array
    alike: NDArray[np.bool_]
    left_out: int
    uncertain_at_first: NDArray[np.int64]


def effect_quantiles(entry: Entry, draw: int, seed: int) -> Array:
    """Prior quantiles of an effect's parameters in draw `draw`, shape (parameters,)."""
    name = int.from_bytes(entry.name.encode()[:6], "little")
    return quasi_random((seed * 1_000_003 + name) % 2**63, len(free_parameters(entry)), draw)


def effect_draw(entry: Entry, draw: int, seed: int) -> Effects:
    """The effect at its values in draw `draw`."""
    return ((entry.name, values_at(entry, effect_quantiles(entry, draw, seed))),)


def screen(
    cache: SimulationCache,
    seen: Observations,
    *,
    runs: int,
    most: int,
    seed: int = 0,
    progress: Progress | None = None,
) -> Screening:
    """Tell certain trials from uncertain ones.

    Every trial is simulated without effect and with effects in turn, all with nuisances:
    `SCREENING.first_look` times, and up to `runs` times if it rocked or always overturned. It is
    certain if all draws overturn, or none does. From tier M on a standing trial is uncertain too if
    its largest tilt rises above the noise in half the draws. A random tenth of the certain trials
    is kept as a guard.

    Args:
        cache: of simulations.
        seen: the observed campaign.
        runs: simulations a trial.
        most: trials kept, the guard included, nearest to the boundary of overturning.
        seed: of the guard.
        progress: called with simulations done and all.
    """
    library = cache.simulator.library
    plain = min(SCREENING.plain, max(runs // 2, 1))
    spots = [(effect_draw(e, m, seed), m) for m in (1, 2) for e in library.values()]
    each = min(runs - plain, len(spots))

    def requests_of(i: int) -> list[Request]:
        """Without and with effects in turn, other effects for each trial."""
        bare = [Request(i, (), m, 1) for m in range(1, plain + 1)]
        chosen = [spots[(i * each + j) % len(spots)] for j in range(each)]
        dressed = [Request(i, label, draw, 1) for label, draw in chosen]
        first = min(plain, SCREENING.first_look // 2)
        return (
            bare[:first]
            + dressed[: SCREENING.first_look - first]
            + bare[first:]
            + dressed[SCREENING.first_look - first :]
        )

    asked = [requests_of(i) for i in range(len(seen))]
    total = sum(len(row) for row in asked)
    first = [row[: SCREENING.first_look] for row in asked]
    notify = None if progress is None else (lambda n, _: progress(n, total))
    outcome, peaks = _screened(cache, first, notify)
    uncertain, rocking = _worthwhile(outcome, peaks, seen)
    uncertain_at_first = np.flatnonzero(uncertain)
    # What neither moved nor nearly overturned needs no second look, nor does what is kept anyway.
    standing = np.nanmax(np.where(outcome < 0.5, peaks, 0.0), axis=0)
    near = (np.nanmin(outcome, axis=0) > 0.5) | (standing > SCREENING.moved)
    again = np.flatnonzero(near & ~uncertain & ~rocking)
    rest = [asked[i][SCREENING.first_look :] for i in again]
    if rest and rest[0]:
        more, higher = _screened(cache, rest, None)
        blank = np.full((len(more), len(seen)), np.nan)
        outcome, peaks = np.vstack([outcome, blank]), np.vstack([peaks, blank])
        outcome[-len(more) :, again], peaks[-len(more) :, again] = more, higher
        uncertain, rocking = _worthwhile(outcome, peaks, seen)
    if progress is not None:
        progress(total, total)
    count = np.isfinite(outcome).sum(axis=0)
    probability = (np.nansum(outcome, axis=0) + 0.5) / (count + 1)
    certain = np.flatnonzero(~(uncertain | rocking))
    rng = np.random.default_rng([seed, 77])
    size = min(int(np.ceil(SCREENING.guard * certain.size)), most // 10 + 1)
    guard = np.sort(rng.choice(certain, size=size, replace=False)) if size else certain[:0]
    # Nearest to the boundary of overturning first; of rocking trials, those that rock most.
    worth = np.where(uncertain, 2 - np.abs(2 * probability - 1), 0.0)
    worth += np.where(
        rocking & ~uncertain, 0.5 * np.tanh(np.nan_to_num(np.nanmean(peaks, axis=0))), 0.0
    )
    wanted = np.flatnonzero(uncertain | rocking)
    ranked = wanted[np.argsort(-worth[wanted], kind="stable")][: max(most - guard.size, 1)]
    kept = np.union1d(ranked, guard)
    return Screening(
        kept, guard, probability, ~uncertain, int(wanted.size - ranked.size), uncertain_at_first
    )


def _screened(
    cache: SimulationCache,
    requests: Sequence[Sequence[Request]],
    progress: Progress | None,
) -> tuple[Array, Array]:
    """Overturned and largest tilt, shape (runs, trials)."""
    found = cache.run([request for row in requests for request in row], progress=progress)
    shape = (len(requests), -1)
    return found.overturned.reshape(shape).T, found.peak_tilt.reshape(shape).T


def _worthwhile(
    outcome: Array, peaks: Array, seen: Observations
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Trials whose outcome is uncertain, and those that rock measurably."""
    ones, count = np.nansum(outcome, axis=0), np.isfinite(outcome).sum(axis=0)
    uncertain = (ones > 0) & (ones < count)
    rocking = np.zeros(len(seen), dtype=bool)
    if seen.tier != "B":
        rocking = np.nan_to_num(_median_standing(outcome, peaks)) > max(3 * seen.tilt_noise, 0.01)
    return uncertain, rocking


def _median_standing(found: Array, peaks: Array) -> Array:
    out = np.full(found.shape[1], np.nan)
    for i in range(found.shape[1]):
        standing = peaks[found[:, i] < 0.5, i]
        if standing.size:
            out[i] = np.median(standing)
    return out


def run_table(
    cache: SimulationCache,
    trials: NDArray[np.int64],
    labels: Sequence[Effects],
    draws: Sequence[int],
    progress: Progress | None = None,
    *,
    replicate: int = 1,
) -> tuple[Array, Array, Array | None]:
    """Simulate campaigns: one row a label and draw, one column a trial.

    Returns:
        Overturned and largest tilt, shape (rows, trials), and features (rows, trials, k).
    """
    requests = [
        Request(int(trial), label, draw, replicate)
        for label, draw in zip(labels, draws, strict=True)
        for trial in trials
    ]
    found = cache.run(requests, progress=progress)
    shape = (len(labels), trials.size)
    features = None if found.features is None else found.features.reshape(*shape, -1)
    return found.overturned.reshape(shape), found.peak_tilt.reshape(shape), features


def simulate_design(
    cache: SimulationCache,
    seen: Observations,
    screening: Screening,
    library: Library,
    draws: Mapping[str, int],
    *,
    seed: int = 0,
    progress: Progress | None = None,
) -> tuple[Design, NDArray[np.int64]]:
    """Complete campaigns of the kept trials.

    Args:
        cache: of simulations.
        seen: the observed campaign.
        screening: which trials.
        library: effects.
        draws: of each effect; :func:`none_draws` go without effect.
        seed: of the draws.
        progress: called with simulations done and all.

    Returns:
        The campaigns and the draw of each, by which folds are formed.
    """
    plain = none_draws(max(draws.values()))
    names: list[str] = [""] * plain
    labels: list[Effects] = [()] * plain
    quantiles: list[Array] = [np.zeros(0)] * plain
    indices = list(range(1, plain + 1))
    for entry in library.values():
        for draw in range(1, draws[entry.name] + 1):
            names.append(entry.name)
            quantiles.append(effect_quantiles(entry, draw, seed))
            labels.append(effect_draw(entry, draw, seed))
            indices.append(draw)
    found, peaks, series = run_table(cache, screening.kept, labels, indices, progress)
    features = seen.noted(found, peaks, series, seed)
    z = np.stack([cache.simulator.nuisance_draw(i) for i in indices])
    design = Design(np.array(names), tuple(quantiles), z, found, features)
    return design, np.array(indices, dtype=np.int64)


def simulations(draws: Mapping[str, int], trials: int) -> int:
    """Number of simulations that :func:`simulate_design` asks for."""
    return (none_draws(max(draws.values())) + sum(draws.values())) * trials


def none_draws(most: int) -> int:
    """Draws without effect beside `most` draws of an effect."""
    return max(SCREENING.none_share * most, SCREENING.least_none)
