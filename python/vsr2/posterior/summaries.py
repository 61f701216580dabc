"""Summaries of a campaign: what the learned posterior sees of it.

Every outcome and feature is standardised by campaigns without effect. Ridge regression of what acts
in a campaign on all of these gives one number for each effect, its discriminant, and for each
nuisance: regression summaries as in P. Fearnhead and D. Prangle, "Constructing summary statistics
for approximate Bayesian computation", J. R. Stat. Soc. B 74, 2012. Beside them stand the size of
the residuals, and of what the discriminants do not reproduce.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from vsr2.ensemble.simulated.campaigns import Campaigns
from vsr2.ensemble.simulated.linear_algebra import blocks, ridge_of_copies
from vsr2.posterior.moments import Moments

Array = NDArray[np.float64]
Floats = NDArray[np.floating[Any]]
"""In single or double precision."""
_Float = TypeVar("_Float", bound=np.floating[Any])
Rows = NDArray[np.int64]
Copies = Sequence[tuple[Floats, Floats]]
"""Outcomes, shape (n, trials), and features, shape (n, trials, k), of each copy of campaigns."""


@dataclass(frozen=True)
class SummaryConstants:
    """How campaigns are summarised; chosen by hand, the penalties from those named.

    Attributes:
        most: standard deviations that a feature counts for at most.
        least_scatter: of a feature in one trial, over the median of all trials.
        own: campaigns without effect in which a feature is known, from which on its mean there
            counts for more than that of all campaigns.
        chance: added to the variance of outcomes, so that certain ones do not rule.
        power: of the size of an effect [detection limits] that is regressed on.
        largest: size that counts [detection limits].
        folds: groups of campaigns, each summarised by regressions on the others.
        penalties: of ridge regressions over the number of columns, of which one is chosen.
        copies: of each campaign that a regression is made on, the first undisturbed.
        reproduction: penalty of the regression of residuals on discriminants.
        least_size: added to mean squares of residuals before the logarithm.
        least_deviation: added to that of discriminants.
    """

    most: float = 5.0
    least_scatter: float = 0.25
    own: float = 5.0
    chance: float = 0.02
    power: float = 0.7
    largest: float = 16.0
    folds: int = 5
    penalties: tuple[float, ...] = (0.3, 1.0, 3.0)
    copies: int = 2
    reproduction: float = 50.0
    least_size: float = 0.02
    least_deviation: float = 1e-3


SUMMARY = SummaryConstants()


@dataclass(frozen=True, eq=False)
class StandardMoments:
    """What campaigns are standardised by, of some of them; that of more follows by addition.

    Attributes:
        outcome: without effect, shape (trials,).
        plain, acting: of features without effect and with, shape (trials, k).
    """

    outcome: Moments
    plain: Moments
    acting: Moments

    @classmethod
    def of(cls, overturned: Floats, features: Floats, gap_free: NDArray[np.bool_]) -> Self:
        """From simulated campaigns, shape (n, trials) and (n, trials, k)."""
        return cls(
            Moments.of(overturned[gap_free]),
            Moments.of(features[gap_free]),
            Moments.of(features[~gap_free]),
        )

    def __add__(self, other: StandardMoments) -> StandardMoments:
        """Of both groups together."""
        return StandardMoments(
            self.outcome + other.outcome, self.plain + other.plain, self.acting + other.acting
        )


@dataclass(frozen=True, eq=False)
class Standard:
    """Campaigns without effect, by which others are standardised.

    Attributes:
        probability: of overturning, shape (trials,).
        centre, scatter: of features, shape (trials, k).
    """

    probability: Array
    centre: Array
    scatter: Array

    @classmethod
    def of(cls, overturned: Floats, features: Floats, gap_free: NDArray[np.bool_]) -> Standard:
        """From simulated campaigns, shape (n, trials) and (n, trials, k)."""
        return cls.by([StandardMoments.of(overturned, features, gap_free)])

    @classmethod
    def by(cls, groups: Iterable[StandardMoments]) -> Standard:
        """From the moments of groups of campaigns.

        Where a feature is seldom known without effect, campaigns with effects stand in.
        """
        found = reduce(add, groups)
        outcome, plain, everything = found.outcome, found.plain, found.plain + found.acting
        probability = (outcome.count * outcome.mean + 0.5) / (outcome.count + 1)
        weight = plain.count / (plain.count + SUMMARY.own)
        centre = weight * plain.mean + (1 - weight) * everything.mean
        scatter = np.sqrt(weight * plain.variance + (1 - weight) * everything.variance)
        # What differs by rounding alone does not differ.
        scatter[scatter < np.finfo(np.float32).eps * np.abs(centre)] = 0.0
        for k in range(scatter.shape[1]):
            there = scatter[:, k][scatter[:, k] > 0]
            least = SUMMARY.least_scatter * float(np.median(there)) if there.size else 1.0
            scatter[:, k] = np.maximum(scatter[:, k], least)
        return cls(probability, centre, scatter)

    def residuals(self, overturned: Floats, features: NDArray[_Float]) -> NDArray[_Float]:
        """Standardised campaigns, 0 where nothing is known, shape (n, (1 + k) trials).

        They are computed in double precision and have that of the features.
        """
        count, trials, channels = features.shape
        out = np.empty((count, (1 + channels) * trials), dtype=features.dtype)
        p = self.probability
        for rows in blocks(count, out.shape[1]):
            outcome = (overturned[rows] - p) / np.sqrt(p * (1 - p) + SUMMARY.chance)
            rest = (features[rows] - self.centre) / self.scatter
            rest = np.clip(rest, -SUMMARY.most, SUMMARY.most)
            parts = np.concatenate([outcome[..., None], rest], axis=-1)
            out[rows] = np.nan_to_num(parts.swapaxes(-1, -2).reshape(len(parts), -1))
        return out


@dataclass(frozen=True, eq=False)
class Standards:
    """By all campaigns, and by those outside of each fold.

    Attributes:
        by_all: by all campaigns.
        others: by the other folds, one a fold.
    """

    by_all: Standard
    others: tuple[Standard, ...]

    @classmethod
    def of(cls, copies: Copies, gap_free: NDArray[np.bool_], fold: Rows) -> Standards:
        """From copies of campaigns: each fold is summed once.

        Args:
            copies: of all campaigns.
            gap_free: which have no effect, shape (n,).
            fold: group of each campaign, shape (n,).
        """
        groups = [
            reduce(
                add,
                (StandardMoments.of(o[own], f[own], gap_free[own]) for o, f in copies),
            )
            for own in (fold == k for k in range(SUMMARY.folds))
        ]
        others = [groups[:k] + groups[k + 1 :] for k in range(SUMMARY.folds)]
        return cls(Standard.by(groups), tuple(Standard.by(own) for own in others))


@dataclass(frozen=True, eq=False)
class Summaries:
    """From residuals to summaries.

    Attributes:
        coefficients: of each fold's regression, shape (folds, columns, targets).
        intercepts: of these, shape (folds, targets).
        reproduction: of residuals by discriminants, shape (targets, columns).
        deviation: of the discriminants without effect, shape (targets,).
        effect: index of the effect of each discriminant, -1 of a nuisance, shape (targets,).
        trials: of a campaign.
    """

    coefficients: Array
    intercepts: Array
    reproduction: Array
    deviation: Array
    effect: NDArray[np.int64]
    trials: int

    def without_regressions(self) -> Summaries:
        """The same, where all campaigns are summarised: the regressions take most memory."""
        count = self.deviation.size
        return replace(
            self,
            coefficients=np.zeros((0, 0, count)),
            intercepts=np.zeros((0, count)),
            reproduction=np.zeros((count, 0)),
        )

    def __call__(self, residuals: Array) -> Array:
        """Of campaigns that no regression saw, shape (n, summaries)."""
        found = np.mean(
            [residuals @ b + a for b, a in zip(self.coefficients, self.intercepts, strict=True)],
            axis=0,
        )
        return self.complete(residuals, found)

    def by_folds(self, residuals: Floats, fold: Rows) -> Array:
        """The same, each campaign by the regression of its fold alone, as those regressed on are.

        Args:
            residuals: shape (n, columns).
            fold: group of each campaign, shape (n,).
        """
        found = np.zeros((len(fold), self.deviation.size))
        for k in range(len(self.coefficients)):
            own = np.flatnonzero(fold == k)
            for part in blocks(own.size, residuals.shape[1]):
                found[own[part]] = self.discriminants(residuals[own[part]], k)
        return self.complete(residuals, found * self.deviation)

    def discriminants(self, residuals: Floats, fold: int) -> Array:
        """By the regression of one fold, in their deviations, shape (n, targets)."""
        found = residuals.astype(np.float64) @ self.coefficients[fold] + self.intercepts[fold]
        return np.asarray(found / self.deviation)

    def complete(self, residuals: Floats, discriminants: Array) -> Array:
        """Discriminants in their deviations, sizes of residuals, means of channels.

        Shape (n, summaries). The mean of a channel shows what is rare in single trials and common
        to many, such as outcomes that their series contradict.
        """
        return np.concatenate(
            [
                self._complete(residuals[rows].astype(np.float64), discriminants[rows])
                for rows in blocks(*residuals.shape)
            ]
        )

    def _complete(self, residuals: Array, discriminants: Array) -> Array:
        left = residuals - discriminants @ self.reproduction
        own, rest = (part.reshape(len(part), -1, self.trials) for part in (residuals, left))
        sizes = [np.log((part**2).mean(axis=2) + SUMMARY.least_size) for part in (own, rest)]
        return np.concatenate([discriminants / self.deviation, *sizes, own.mean(axis=2)], axis=1)


def targets(campaigns: Campaigns, names: tuple[str, ...]) -> tuple[Array, NDArray[np.int64]]:
    """What is regressed on residuals: signed sizes, sizes where both signs occur, nuisances.

    Returns:
        Shape (n, targets), and the effect of each, -1 of a nuisance.
    """
    size = np.zeros((len(campaigns), len(names)))
    for row, acting in enumerate(campaigns.sets):
        for one in acting:
            strength = min(one.size, SUMMARY.largest) ** SUMMARY.power
            size[row, names.index(one.name)] = one.side * strength
    both = np.flatnonzero((size.max(axis=0) > 0) & (size.min(axis=0) < 0))
    out = np.concatenate([size, np.abs(size[:, both]), campaigns.nuisances], axis=1)
    nuisances = np.full(campaigns.nuisances.shape[1], -1)
    return out - out.mean(axis=0), np.concatenate([np.arange(len(names)), both, nuisances])


def fit_summaries(
    copies: Sequence[Floats],
    campaigns: Campaigns,
    names: tuple[str, ...],
    fold: Rows,
    trials: int,
    among: Rows | None = None,
) -> tuple[Summaries, list[Array]]:
    """Regressions, and the summaries of the campaigns that they are made on.

    They have intercepts. Residuals are centred by the campaigns without effect, those of a fold
    among them, so that without one a regression on the other folds would know this fold's mean.

    Args:
        copies: residuals of campaigns, undisturbed and disturbed, each (n, columns).
        campaigns: the same, or those among them that are used.
        names: of the effects.
        fold: group of each campaign; it is summarised by regressions on the other groups.
        trials: of a campaign.
        among: indices of those that are used among the copies; None: all, in their order.

    Returns:
        The summaries, and those of each copy, shape (n, summaries).
    """
    wanted, effect = targets(campaigns, names)
    used = copies[: SUMMARY.copies]
    penalties = [one * copies[0].shape[1] for one in SUMMARY.penalties]
    rows_of = np.arange(len(fold)) if among is None else among
    held = [np.flatnonzero(fold == k) for k in range(SUMMARY.folds)]
    # By penalty.
    fitted: list[list[Array]] = [[] for _ in penalties]
    intercepts: list[list[Array]] = [[] for _ in penalties]
    for k in range(SUMMARY.folds):
        rows = np.flatnonzero(fold != k)
        mean = wanted[rows].mean(axis=0)
        centre, ways = ridge_of_copies(used, rows_of[rows], wanted[rows] - mean, penalties)
        for p, way in enumerate(ways):
            fitted[p].append(way)
            intercepts[p].append(mean - centre @ way)

    def discriminants(p: int, copy: Floats) -> Array:
        out = np.zeros(wanted.shape)
        for own, way, intercept in zip(held, fitted[p], intercepts[p], strict=True):
            for part in blocks(own.size, copy.shape[1]):
                out[own[part]] = copy[rows_of[own[part]]].astype(np.float64) @ way + intercept
        return out

    acts = effect >= 0
    misses = [
        float(((discriminants(p, copies[-1]) - wanted)[:, acts] ** 2).mean())
        for p in range(len(penalties))
    ]
    best = int(np.argmin(misses))
    found = [discriminants(best, copy) for copy in copies]
    out = Summaries(
        np.stack(fitted[best]),
        np.stack(intercepts[best]),
        _reproduction(found, used, rows_of),
        np.concatenate([one[campaigns.gap_free] for one in found]).std(axis=0)
        + SUMMARY.least_deviation,
        effect,
        trials,
    )
    return out, [out.complete(copy[rows_of], one) for copy, one in zip(copies, found, strict=True)]


def _reproduction(discriminants: Sequence[Array], copies: Sequence[Floats], among: Rows) -> Array:
    """Ridge regression of residuals on discriminants, shape (targets, columns).

    Args:
        discriminants: of each copy, shape (n, targets); of more copies than the residuals.
        copies: residuals, each of more campaigns, with as many columns.
        among: indices of the campaigns among these, shape (n,).
    """
    count = discriminants[0].shape[1]
    gram = SUMMARY.reproduction * np.eye(count)
    product = np.zeros((count, copies[0].shape[1]))
    for own, copy in zip(discriminants, copies, strict=False):
        gram += own.T @ own
        for rows in blocks(among.size, copy.shape[1]):
            product += own[rows].T @ copy[among[rows]].astype(np.float64)
    return np.asarray(np.linalg.solve(gram, product))
