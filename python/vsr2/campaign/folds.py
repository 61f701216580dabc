"""Folds and resamples that never part the trials of one ground motion.

Scalings of one motion resemble each other, so that a trial says much about its neighbours: scores
on trials of motions that were seen in fitting are too good, and intervals that resample single
trials are too narrow.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsr2.campaign.campaign import Campaign
from vsr2.config.seeds import checked_seed
from vsr2.errors import CampaignError
from vsr2.one_line import counted
from vsr2.read_only import label_argument, real_argument

MAX_REPLICATES = 100_000
"""Of a bootstrap; bounds its memory."""


def motion_folds(campaign: Campaign, folds: int, seed: int = 0) -> NDArray[np.int64]:
    """The fold of each trial, 0 to `folds` - 1, shape (trials,).

    No motion has trials in two folds; numbers of overturned, standing and unknown trials are as
    equal over the folds as whole motions allow. The same trials, folds and seed give the same
    folds, in whatever order the trials stand.

    Raises:
        CampaignError: fewer than 2 folds, more than there are motions, or outcomes that are no
            numbers.
    """
    return grouped_folds(campaign.motion_ids, campaign.overturned, folds, seed)


def grouped_folds(
    groups: ArrayLike, outcomes: ArrayLike, folds: int, seed: int = 0
) -> NDArray[np.int64]:
    """As :func:`motion_folds`, for any groups.

    Groups are dealt in random order, each to the fold where the sum over folds and outcomes of
    (count - target)^2 / target grows least; then groups move or change places as long as that
    lowers the sum.

    Args:
        groups: of each trial, shape (n,).
        outcomes: 1, 0 or NaN, shape (n,).
        folds: 2 or more.
        seed: of the random order.

    Raises:
        CampaignError: as :func:`motion_folds`.
    """
    labels = label_argument(groups, "groups", CampaignError)
    names, member = np.unique(labels, return_inverse=True)
    outcome = real_argument(outcomes, "outcomes", CampaignError, truths=True)
    if outcome.shape != labels.shape:
        raise CampaignError(
            f"{outcome.size} outcomes of {counted(labels.size, 'trial')}; give one each"
        )
    if not 2 <= folds <= names.size:
        raise CampaignError(
            f"{folds} folds of {counted(names.size, 'motion')}; choose from 2 to the number of "
            "motions"
        )
    counts = np.zeros((names.size, 3))
    kinds = np.where(np.isnan(outcome), 2, outcome).astype(np.intp)
    np.add.at(counts, (member, kinds), 1.0)
    target = np.maximum(counts.sum(axis=0) / folds, 1e-9)
    weight = 1.0 / target
    order = np.random.default_rng(checked_seed(seed, CampaignError)).permutation(names.size)
    fold = _deal(counts, order, folds, target, weight)
    _even_out(counts, order, fold, folds, target, weight)
    return fold[member]


def _deal(
    counts: NDArray[np.float64],
    order: NDArray[np.int64],
    folds: int,
    target: NDArray[np.float64],
    weight: NDArray[np.float64],
) -> NDArray[np.int64]:
    fold = np.zeros(len(counts), dtype=np.int64)
    held = np.zeros((folds, 3))
    for i, group in enumerate(order):
        # (h + c - t)^2 - (h - t)^2 = c (2 h + c - 2 t)
        growth = (counts[group] * (2 * held + counts[group] - 2 * target) * weight).sum(axis=1)
        empty = np.flatnonzero(held.sum(axis=1) == 0)
        if len(order) - i <= empty.size:
            # As many groups as folds without one are left: none may stay empty.
            growth = np.where(held.sum(axis=1) == 0, growth, np.inf)
        fold[group] = int(np.argmin(growth))
        held[fold[group]] += counts[group]
    return fold


def _even_out(
    counts: NDArray[np.float64],
    order: NDArray[np.int64],
    fold: NDArray[np.int64],
    folds: int,
    target: NDArray[np.float64],
    weight: NDArray[np.float64],
) -> None:
    """Move single groups, or exchange two, while that lowers the sum of squares (in place)."""
    held = np.zeros((folds, 3))
    np.add.at(held, fold, counts)

    def change(source: int, delta: NDArray[np.float64]) -> NDArray[np.float64]:
        """Change of the sum where `delta` goes from `source` to each fold; delta (3,) or (n, 3)."""
        out = (delta * (delta - 2 * (held[source] - target)) * weight).sum(axis=-1)
        into = (delta * (delta + 2 * (held - target)) * weight).sum(axis=-1)
        moved: NDArray[np.float64] = out + into
        return moved

    improved = True
    while improved:  # The sum falls by more than rounding each time, so that this ends.
        improved = False
        for group in order:
            source = int(fold[group])
            if np.count_nonzero(fold == source) > 1:
                gain = change(source, counts[group])
                gain[source] = 0.0
                best = int(np.argmin(gain))
                if gain[best] < -1e-9:
                    held[source] -= counts[group]
                    held[best] += counts[group]
                    fold[group] = best
                    improved = True
                    continue
            delta = counts[group] - counts
            out = (delta * (delta - 2 * (held[source] - target)) * weight).sum(axis=1)
            into = (delta * (delta + 2 * (held[fold] - target)) * weight).sum(axis=1)
            exchange = np.where(fold == source, 0.0, out + into)
            other = int(np.argmin(exchange))
            if exchange[other] < -1e-9:
                there = int(fold[other])
                held[source] -= delta[other]
                held[there] += delta[other]
                fold[group], fold[other] = there, source
                improved = True
        if not improved:
            return


def motion_resamples(motions: ArrayLike, replicates: int, seed: int = 0) -> NDArray[np.int32]:
    """How often each trial stands in each bootstrap replicate over motions.

    A replicate draws as many motions as there are, with replacement, each with all its trials.

    Args:
        motions: ground motion of each trial, shape (n,).
        replicates: number of replicates.
        seed: of the draws.

    Returns:
        Counts, shape (replicates, n); the trials of one motion have equal counts.

    Raises:
        CampaignError: no trials, no or too many replicates, or what is no label or seed.
    """
    labels = label_argument(motions, "motions", CampaignError)
    names, member = np.unique(labels, return_inverse=True)
    if names.size == 0:
        raise CampaignError("no trials to draw from")
    if not 1 <= replicates <= MAX_REPLICATES:
        raise CampaignError(f"{replicates} replicates; choose from 1 to {MAX_REPLICATES}")
    rng = np.random.default_rng(checked_seed(seed, CampaignError))
    drawn = rng.multinomial(names.size, np.full(names.size, 1.0 / names.size), size=replicates)
    counts: NDArray[np.int32] = drawn[:, member].astype(np.int32)
    return counts
