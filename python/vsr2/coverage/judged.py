"""Planted campaigns as the posterior answers them, beside the truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis.ranks import rank
from vsr2.coverage.planted_campaigns import Planted
from vsr2.ensemble.observed.random_streams import Stream, generator
from vsr2.ensemble.simulated.library import NONE, free_parameters
from vsr2.posterior.calibration import label_probability
from vsr2.posterior.sets import Sets
from vsr2.posterior.training import Found, Posterior

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RankOf:
    """Place of one true value among the samples of its posterior.

    Attributes:
        effect, parameter: whose.
        unit: of the parameter.
        truth: the planted value, in that unit.
        rank: share of samples below it, in (0, 1) [1].
    """

    effect: str
    parameter: str
    unit: str
    truth: float
    rank: float


@dataclass(frozen=True)
class Judged:
    """One planted campaign and its answer.

    Attributes:
        row: number of the campaign.
        truth: what acts, joined by `+`, or none.
        answer: the most probable label.
        stated: its probability [1].
        right: whether the truth is what the label stands for.
        held: whether the 90 % set of labels has a true one.
        size: labels in that set.
        ranks: of the parameters of what acts.
    """

    row: int
    truth: str
    answer: str
    stated: float
    right: bool
    held: bool
    size: int
    ranks: tuple[RankOf, ...]


def judge_planted(
    posterior: Posterior,
    planted: Sequence[Planted],
    overturned: Array,
    features: Array,
    *,
    seed: int = 0,
) -> Iterator[Judged]:
    """Infer each planted campaign as if it were observed.

    Its cause is in the library, so that probabilities are those given this.

    Args:
        posterior: that is checked.
        planted: what acts.
        overturned: outcomes of the trials that were simulated, shape (n, trials).
        features: of the same, as the campaign would have noted them, shape (n, trials, k).
        seed: of the diagnosis.
    """
    for one, outcome, noted in zip(planted, overturned, features, strict=True):
        yield _judged(posterior, one, posterior.infer(outcome, noted), seed)


def _judged(posterior: Posterior, one: Planted, found: Found, seed: int) -> Judged:
    sets, names = posterior.sets, [effect.name for effect in one.acting]
    true = sets.index(names)
    given = np.append(found.probability[:-1], 0.0)
    labels = label_probability(given[None] / given.sum(), sets)[0]
    words = (NONE, *sets.names)
    top = int(labels.argmax())
    return Judged(
        row=one.row,
        truth="+".join(names) or NONE,
        answer=words[top],
        stated=float(labels[top]),
        right=top == true_label(sets, true, found.probability),
        held=bool(set(found.held) & true_labels(sets, true)),
        size=len(found.held),
        ranks=tuple(_ranks(posterior, one, found, seed)),
    )


def true_label(sets: Sets, true: int, probability: Array) -> int:
    """The label that stands for a set: of effects that act together, the one that leads.

    By that a label's probability is that of a single event, of which a share can be counted.

    Args:
        sets: hypotheses.
        true: index of the set that acts, 0 of none.
        probability: of every set, shape (sets,).
    """
    members = np.flatnonzero(sets.members[true])
    if not members.size:
        return 0
    return 1 + int(members[sets.marginal(probability)[members].argmax()])


def true_labels(sets: Sets, true: int) -> set[int]:
    """Labels that are true of a set: of effects that act together, each."""
    if true == sets.outside:
        return {len(sets.names) + 1}
    if not sets.members[true].any():
        return {0}
    return {1 + int(i) for i in np.flatnonzero(sets.members[true])}


def _ranks(posterior: Posterior, one: Planted, found: Found, seed: int) -> Iterator[RankOf]:
    rng = generator(seed, Stream.RANKS, one.row)
    for acting in one.acting:
        if acting.name not in posterior.parameters.known:
            continue
        effect = posterior.parameters.library[acting.name]
        samples = posterior.parameters.sample(acting.name, found.residuals, rng)
        names = [parameter.name for parameter in effect.parameters]
        for parameter, column in zip(free_parameters(effect), samples.T, strict=True):
            truth = acting.values[names.index(parameter.name)]
            yield RankOf(
                effect.name, parameter.name, parameter.unit, truth, rank(column, truth, rng)
            )
