"""HOW FAR the gap shrinks: trials simulated again, without effect and with what is named.

Motions are dealt into groups. Parameters of what is named come from the trials of the other groups
alone; then the trials of the group are simulated with them, nuisances drawn again, and judged by
these simulations: before and after on motions that were not seen. Differences are of equal trials
and are bootstrapped over motions. All of it is reported; nothing is named or withheld for it.

Two negative controls close a part of a gap without being its cause: a plain rescaling of the
probabilities, fitted on the other motions, and what is named, with its response dealt to wrong
trials of like intensity.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis.intervals import INTERVALS
from vsr2.diagnosis.how_far.ensemble_losses import (
    Ensemble,
    LossInterval,
    floor_loss,
    interval,
    resampled_means,
    share_of_gap,
    simulated_loss,
)
from vsr2.diagnosis.how_far.negative_controls import (
    recalibrated,
    with_change_of,
    wrong_partners,
)
from vsr2.effects import Effect
from vsr2.ensemble.observed.observations import Observations
from vsr2.ensemble.observed.random_streams import Stream, generator
from vsr2.ensemble.simulated.cache import Progress, SimulationCache
from vsr2.ensemble.simulated.library import free_parameters
from vsr2.ensemble.simulated.simulator import Effects, Request
from vsr2.posterior.training import Posterior

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class HeldOutConstants:
    """How the gap is judged; chosen by hand.

    Attributes:
        members: simulations of each trial, without effect and with what is named.
        groups: of motions.
        nuisances: draw of the nuisances of the first simulation with what is named.
        replicate: of starts and noise there.
        resamples: of motions, from which intervals are taken.
    """

    members: int = 24
    groups: int = 5
    nuisances: int = 500
    replicate: int = 2
    resamples: int = INTERVALS.replicates


HELD_OUT = HeldOutConstants()


class Loss(StrEnum):
    """Whose loss on trials not seen."""

    BEFORE = "before"
    """The nominal model."""
    AFTER = "after"
    """The model with what is named."""
    RECALIBRATED = "recalibrated"
    """A negative control: probabilities of the nominal model, rescaled."""
    DEALT = "dealt"
    """A negative control: the response of what is named, dealt to wrong trials."""
    FLOOR = "floor"
    """The noise floor."""


CONTROLS = (Loss.RECALIBRATED, Loss.DEALT)
"""Negative controls."""


@dataclass(frozen=True, eq=False)
class HowFar:
    """Losses of every trial that was simulated, and predictions.

    Attributes:
        losses: each (trials,); after and controls NaN where nothing is named.
        before, after: probabilities of overturning, shape (trials,).
        trials: indices of those in the campaign, shape (trials,).
        motion: of each trial, shape (trials,).
        names: of the effects that `after` has.
    """

    losses: dict[Loss, Array]
    before: Array
    after: Array
    trials: NDArray[np.int64]
    motion: NDArray[np.int64]
    names: tuple[str, ...]

    @cached_property
    def _means(self) -> dict[Loss, Array]:
        """Mean losses, then those of each replicate, shape (1 + replicates,)."""
        values = np.stack([self.losses[name] for name in Loss])
        drawn = resampled_means(values, self.motion, replicates=HELD_OUT.resamples)
        means = np.vstack([values.mean(axis=1), drawn])
        return dict(zip(Loss, means.T, strict=True))

    def mean(self, name: Loss) -> LossInterval:
        """Mean loss."""
        return interval(self._means[name])

    def excess(self, name: Loss) -> LossInterval:
        """Mean loss over the floor."""
        return interval(self._means[name] - self._means[Loss.FLOOR])

    def gain(self) -> LossInterval:
        """Mean loss before minus after, of equal trials."""
        return interval(self._means[Loss.BEFORE] - self._means[Loss.AFTER])

    def closure(self, name: Loss) -> LossInterval:
        """(before - model) / (before - floor); none where there is no gap."""
        return self._share(self._means[Loss.BEFORE] - self._means[name])

    def headline(self) -> LossInterval:
        """Closure minus that of the better control, or minus 0 where both make it worse."""
        controls = [self._means[name] for name in (Loss.BEFORE, *CONTROLS)]
        return self._share(np.min(controls, axis=0) - self._means[Loss.AFTER])

    def _share(self, part: Array) -> LossInterval:
        return share_of_gap(part, self._means[Loss.BEFORE] - self._means[Loss.FLOOR])


def simulations(trials: int) -> int:
    """That judging asks for."""
    return HELD_OUT.members * trials


class Inferred(NamedTuple):
    """What is known of a campaign.

    Attributes:
        posterior: trained.
        residuals: of the campaign, shape (columns,).
        trials: indices of those that the posterior knows.
    """

    posterior: Posterior
    residuals: Array
    trials: NDArray[np.int64]


def judge(
    cache: SimulationCache,
    seen: Observations,
    trials: NDArray[np.int64],
    inferred: Inferred,
    names: Sequence[str],
    *,
    seed: int = 0,
    progress: Progress | None = None,
) -> HowFar:
    """Simulate the trials again and judge before and after.

    Args:
        cache: of simulations.
        seen: the observed campaign.
        trials: indices of those that are judged.
        inferred: from some of them.
        names: effects that are named, or lead; none: before alone is judged.
        seed: of draws.
        progress: called with simulations done and all.
    """
    members, motion = HELD_OUT.members, seen.motion[trials]
    plain: list[Effects] = [()] * members
    draws = range(1, members + 1)
    noise = generator(seed, Stream.BEFORE_NOISE)
    before = ensemble(cache, seen, trials, [plain] * trials.size, draws, 1, noise)
    outcome, features = seen.overturned[trials], seen.features[trials]
    losses = {Loss.BEFORE: simulated_loss(before, before.probability, outcome, features)}
    losses[Loss.FLOOR] = floor_loss(before)
    blank = np.full(trials.size, np.nan)
    if not names:
        losses |= dict.fromkeys((Loss.AFTER, *CONTROLS), blank)
        return HowFar(losses, before.probability, blank, trials, motion, ())
    group = motion_groups(motion, outcome)
    known = group[np.isin(trials, inferred.trials)]
    drawn: list[list[Effects]] = [[] for _ in trials]
    for k in np.unique(group):
        rng = generator(seed, Stream.HELD_OUT_PARAMETERS, int(k))
        effects = _drawn_effects(inferred, known != k, names, rng)
        for i in np.flatnonzero(group == k):
            drawn[i] = effects
    later = range(HELD_OUT.nuisances, HELD_OUT.nuisances + members)
    after = ensemble(
        cache,
        seen,
        trials,
        drawn,
        later,
        HELD_OUT.replicate,
        generator(seed, Stream.HELD_OUT_NOISE),
        progress=progress,
    )
    losses[Loss.AFTER] = simulated_loss(after, after.probability, outcome, features)
    scaled = recalibrated(before.probability, outcome, group)
    losses[Loss.RECALIBRATED] = simulated_loss(before, scaled, outcome, features)
    losses[Loss.DEALT] = _dealt(before, after, outcome, features, seen.log_pga_g[trials], seed)
    return HowFar(losses, before.probability, after.probability, trials, motion, tuple(names))


def ensemble(
    cache: SimulationCache,
    seen: Observations,
    trials: NDArray[np.int64],
    effects: Sequence[Sequence[Effects]],
    draws: range,
    replicate: int,
    noise: np.random.Generator,
    *,
    progress: Progress | None = None,
) -> Ensemble:
    """Each trial under its effects, one member a draw of the nuisances, measured with noise."""
    requests = [
        Request(int(trial), own[m], draw, replicate)
        for m, draw in enumerate(draws)
        for trial, own in zip(trials, effects, strict=True)
    ]
    found = cache.run(requests, progress=progress)
    shape = (len(draws), trials.size)
    series = None if found.features is None else found.features.reshape(*shape, -1)
    overturned = found.overturned.reshape(shape)
    noted = seen.noted(overturned, found.peak_tilt.reshape(shape), series, noise)
    return Ensemble(overturned, noted.astype(np.float64, copy=False))


def motion_groups(motion: NDArray[np.int64], outcome: Array) -> NDArray[np.int64]:
    """Group of each trial; the trials of a motion are of one group."""
    from vsr2.campaign.folds import grouped_folds

    return grouped_folds(motion, outcome, min(HELD_OUT.groups, np.unique(motion).size), seed=0)


def _drawn_effects(
    inferred: Inferred, known: Bools, names: Sequence[str], rng: np.random.Generator
) -> list[Effects]:
    """Effects with parameters drawn from what some trials say of them."""
    residuals, parameters = inferred.residuals, inferred.posterior.parameters
    library = parameters.library
    columns = np.tile(known, residuals.size // known.size)
    sampled = {name: parameters.sample(name, residuals, rng, columns=columns) for name in names}
    out: list[Effects] = []
    for m in range(HELD_OUT.members):
        acting = []
        for name in sorted(names, key=list(library).index):
            acting.append((name, parameter_values(library[name], sampled[name][m])))
        out.append(tuple(acting))
    return out


def parameter_values(effect: Effect, free: Array) -> tuple[float, ...]:
    """All parameters of an effect, those that are not free at their nulls.

    Args:
        effect: of the library.
        free: values of its free parameters.
    """
    given = dict(zip((p.name for p in free_parameters(effect)), free, strict=True))
    return tuple(float(given.get(p.name, p.null)) for p in effect.parameters)


def _dealt(
    before: Ensemble, after: Ensemble, outcome: Array, features: Array, log_pga_g: Array, seed: int
) -> Array:
    """Loss where every trial gets the change of another one of like intensity."""
    with np.errstate(invalid="ignore"):
        moved = _mean(after.features) - _mean(before.features)
    losses = []
    for partner in wrong_partners(log_pga_g, seed):
        shifted = before.features + np.nan_to_num(moved[partner])
        probability = with_change_of(before.probability, after.probability, partner)
        losses.append(
            simulated_loss(Ensemble(before.overturned, shifted), probability, outcome, features)
        )
    return np.asarray(np.mean(losses, axis=0))


def _mean(values: Array) -> Array:
    known = np.isfinite(values)
    total = np.where(known, values, 0.0).sum(axis=0)
    return np.where(known.any(axis=0), total / np.maximum(known.sum(axis=0), 1), np.nan)


def rows(
    how_far: HowFar, seen: Observations, predicted: Mapping[int, float]
) -> list[dict[str, Any]]:
    """One row a trial of the campaign; blank for those that never lift off or were not run.

    Args:
        how_far: before and after.
        seen: the observed campaign.
        predicted: by the trial's index, probability of overturning with all effects of the
            posterior that the trials of other motions give; others are not judged.
    """
    place, nan = {int(t): i for i, t in enumerate(how_far.trials)}, float("nan")
    out = []
    for i, trial in enumerate(seen.campaign.trials):
        k = place.get(i)

        def at(values: Array, k: int | None = k) -> float:
            return nan if k is None else float(values[k])

        out.append(
            {
                "trial": trial.trial,
                "motion": trial.motion,
                "session": trial.session,
                "order": trial.order,
                "log_pga_g": float(seen.log_pga_g[i]),
                "log_pgv_pga_s": float(seen.log_pgv_pga_s[i]),
                "overturned": int(seen.overturned[i]),
                "uncertain": int(k is not None),
                "before": at(how_far.before),
                "after": at(how_far.after),
                "predicted": predicted.get(i, nan),
                "loss_before": at(how_far.losses[Loss.BEFORE]),
                "loss_after": at(how_far.losses[Loss.AFTER]),
                "floor": at(how_far.losses[Loss.FLOOR]),
            }
        )
    return out
