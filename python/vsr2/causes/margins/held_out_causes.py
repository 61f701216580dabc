"""What causes take off the loss of motions that they were not inferred from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis.probability import RELIABILITY, outcome_loss
from vsr2.analysis.shapley import mean_gain, shapley_share
from vsr2.campaign.folds import grouped_folds
from vsr2.causes.margins.acting_posterior import sample_posterior
from vsr2.causes.margins.margin_streams import MarginStream
from vsr2.causes.margins.outcome_model import OutcomeModel, Particles, acting_share

Array = NDArray[np.float64]
Allowed = frozenset[str]


@dataclass(frozen=True)
class HeldOutCausesConstants:
    """How causes are judged; chosen by hand.

    Attributes:
        folds: of motions.
        particles: of each posterior where some causes may act.
        everything: of each posterior where all effects may act, which has more to tell apart.
        judged: causes that are judged one by one, the most probable ones.
    """

    folds: int = 10
    particles: int = 300
    everything: int = 1000
    judged: int = 4


HELD_OUT_CAUSES = HeldOutCausesConstants()


def folds_of(model: OutcomeModel) -> NDArray[np.int64]:
    """Fold of each trial, shape (trials,); the trials of a motion are of one fold."""
    count = min(HELD_OUT_CAUSES.folds, len(set(model.motions.tolist())))
    return grouped_folds(model.motions, model.overturned.astype(np.float64), count)


def held_out_probability(
    model: OutcomeModel, seed: int, threads: int = 1, sampled: Callable[[int], None] | None = None
) -> Array:
    """Of overturning, each motion by what the outcomes of other folds tell, shape (trials,).

    Args:
        model: of outcomes.
        seed: of draws; each fold has its own.
        threads: that share the folds; the result does not depend on them.
        sampled: as of :func:`fold_posteriors`.
    """
    fold = folds_of(model)
    models = dict.fromkeys(np.unique(fold).tolist(), model)
    found = fold_posteriors(models, fold, HELD_OUT_CAUSES.particles, seed, threads, sampled)
    return _probability(models, found, fold)


def fold_posteriors(
    models: Mapping[int, OutcomeModel],
    fold: NDArray[np.int64],
    particles: int,
    seed: int,
    threads: int,
    sampled: Callable[[int], None] | None = None,
) -> dict[int, Particles]:
    """What acts by the outcomes outside each fold.

    Args:
        models: of outcomes, by fold.
        fold: of each trial, shape (trials,).
        particles: of each posterior.
        seed: of draws; each fold has its own.
        threads: that share the folds; the result does not depend on them.
        sampled: called with the particles of a fold, as each is done, in the order of the folds.
    """

    def of_fold(k: int) -> Particles:
        rng = np.random.default_rng([seed, MarginStream.FOLDS, k])
        seen = np.flatnonzero(fold != k)
        return sample_posterior(models[k], seen, rng, particles=particles).particles

    found = {}
    with ThreadPoolExecutor(threads) as pool:
        for k, one in zip(models, pool.map(of_fold, models), strict=True):
            found[k] = one
            if sampled is not None:
                sampled(particles)
    return found


def _probability(
    models: Mapping[int, OutcomeModel], found: Mapping[int, Particles], fold: NDArray[np.int64]
) -> Array:
    """Of overturning in the trials of each fold, shape (trials,)."""
    out = np.full(fold.size, np.nan)
    for k, particles in found.items():
        rest = np.flatnonzero(fold == k)
        out[rest] = models[k].probability(particles, rest)
    return out


@dataclass(frozen=True, eq=False)
class HeldOutCauses:
    """Losses of motions that were not seen, by which causes may act.

    Attributes:
        causes: that are judged one by one, the most probable first.
        probability: of overturning, shape (trials,), by which of these causes may act.
        everything: where all effects may act, shape (trials,).
        likely: where those act that are likely by the other folds, and no others, shape (trials,).
        likely_in: names of these, by fold.
        overturned: of each trial, shape (trials,).
        fold: of each trial, shape (trials,).
    """

    causes: tuple[str, ...]
    probability: Mapping[Allowed, Array]
    everything: Array
    likely: Array
    likely_in: Mapping[int, Allowed]
    overturned: NDArray[np.bool_]
    fold: NDArray[np.int64]

    def loss(self, allowed: Allowed) -> Array:
        """Logarithmic loss of each trial, shape (trials,)."""
        return outcome_loss(self.probability[allowed], self.overturned.astype(np.float64))

    def everything_loss(self) -> Array:
        """The same where all effects may act, shape (trials,)."""
        return outcome_loss(self.everything, self.overturned.astype(np.float64))

    def likely_loss(self) -> Array:
        """The same where those act that are likely by the other folds, shape (trials,)."""
        return outcome_loss(self.likely, self.overturned.astype(np.float64))

    def fold_rows(self, motions: Sequence[str] | NDArray[np.str_]) -> tuple[dict[str, Any], ...]:
        """One row a fold: its size, what is likely by the other folds, losses and wrong outcomes.

        Args:
            motions: of each trial.
        """
        named = np.asarray(motions)
        judged = {
            "all": (self.everything_loss(), self.everything),
            "likely": (self.likely_loss(), self.likely),
        }
        rows = []
        for k, causes in sorted(self.likely_in.items()):
            own = self.fold == k
            row = {
                "fold": int(k),
                "motions": len(set(named[own].tolist())),
                "trials": int(own.sum()),
                "overturned": int(self.overturned[own].sum()),
                "likely_causes": " ".join(sorted(causes)),
            }
            for name, (loss, probability) in judged.items():
                row[f"loss_{name}"] = round(float(loss[own].mean()), 6)
                wrong = (probability[own] > RELIABILITY.threshold) != self.overturned[own]
                row[f"wrong_{name}"] = int(wrong.sum())
            rows.append(row)
        return tuple(rows)

    def gains(self, cause: str) -> dict[str, Array]:
        """What a cause takes off each trial's loss, shapes (trials,).

        `share` is the mean over all orders of adding causes, `first` where it is added first, and
        `last` where all the others act already.
        """
        losses = {allowed: self.loss(allowed) for allowed in self.probability}
        return {
            "share": shapley_share(losses, cause),
            "first": mean_gain(losses, cause, 0),
            "last": mean_gain(losses, cause, len(self.causes) - 1),
        }


def judge_causes(
    model: OutcomeModel,
    causes: Sequence[str],
    *,
    likely: float,
    seed: int = 0,
    threads: int = 1,
    progress: Callable[[float], None] | None = None,
) -> HeldOutCauses:
    """Losses with every choice of the causes, with all effects, and with the likely ones.

    Which causes are judged was chosen with all outcomes; whether each acts, how strongly, and the
    scatter come from the other folds.

    Args:
        model: in which all effects that are looked for may act.
        causes: that are judged one by one.
        likely: probability from which a cause is taken to act.
        seed: of all draws; choices share it.
        threads: as of :func:`held_out_probability`.
        progress: called with the share that is done.
    """
    choices = [
        frozenset(chosen)
        for size in range(len(causes) + 1)
        for chosen in combinations(causes, size)
    ]
    fold = folds_of(model)
    models = dict.fromkeys(np.unique(fold).tolist(), model)
    few, many = HELD_OUT_CAUSES.particles, HELD_OUT_CAUSES.everything
    total, done = len(models) * ((len(choices) + 1) * few + many), 0

    def sampled(particles: int) -> None:
        nonlocal done
        done += particles
        if progress is not None:
            progress(done / total)

    found = {
        allowed: held_out_probability(replace(model, allowed=allowed), seed, threads, sampled)
        for allowed in choices
    }
    posteriors = fold_posteriors(models, fold, many, seed, threads, sampled)
    everything = _probability(models, posteriors, fold)
    named = {k: _likely(model, one, likely) for k, one in posteriors.items()}
    sure = {k: replace(model, allowed=own, certain=own) for k, own in named.items()}
    again = fold_posteriors(sure, fold, few, seed, threads, sampled)
    return HeldOutCauses(
        tuple(causes), found, everything, _probability(sure, again, fold), named,
        model.overturned, fold,
    )  # fmt: skip


def _likely(model: OutcomeModel, particles: Particles, least: float) -> Allowed:
    """Names of the effects that act with some probability at least."""
    return frozenset(n for n, acts in acting_share(particles, model.names).items() if acts >= least)
