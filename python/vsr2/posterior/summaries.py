"""Summaries of a campaign: what the learned posterior sees of it.

Every outcome and feature is standardised by campaigns without effect. Ridge regression of what acts
in a campaign on all of these gives one number for each effect, its discriminant, and for each
nuisance: regression summaries as in P. Fearnhead and D. Prangle, "Constructing summary statistics
for approximate Bayesian computation", J. R. Stat. Soc. B 74, 2012. Beside them stand the size of
the residuals, and of what the discriminants do not reproduce: a cause outside the library shows
there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.ensemble.simulated.campaigns import Campaigns
from vsr2.ensemble.simulated.linear_algebra import ridge

Array = NDArray[np.float64]
Rows = NDArray[np.int64]


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
    def of(cls, overturned: Array, features: Array, gap_free: NDArray[np.bool_]) -> Standard:
        """From simulated campaigns, shape (n, trials) and (n, trials, k).

        Where a feature is seldom known without effect, campaigns with effects stand in.
        """
        own = overturned[gap_free]
        known = np.isfinite(own).sum(axis=0)
        probability = (np.nansum(own, axis=0) + 0.5) / (known + 1)
        means, variances = zip(
            *(moments(part) for part in (features[gap_free], features)), strict=True
        )
        count = np.isfinite(features[gap_free]).sum(axis=0)
        weight = count / (count + SUMMARY.own)
        centre = weight * means[0] + (1 - weight) * means[1]
        scatter = np.sqrt(weight * variances[0] + (1 - weight) * variances[1])
        for k in range(scatter.shape[1]):
            there = scatter[:, k][scatter[:, k] > 0]
            least = SUMMARY.least_scatter * float(np.median(there)) if there.size else 1.0
            scatter[:, k] = np.maximum(scatter[:, k], least)
        return cls(probability, centre, scatter)

    def residuals(self, overturned: Array, features: Array) -> Array:
        """Standardised campaigns, 0 where nothing is known, shape (n, (1 + k) trials)."""
        p = self.probability
        outcome = (overturned - p) / np.sqrt(p * (1 - p) + SUMMARY.chance)
        rest = np.clip((features - self.centre) / self.scatter, -SUMMARY.most, SUMMARY.most)
        parts = np.concatenate([outcome[..., None], rest], axis=-1)
        return np.asarray(np.nan_to_num(parts.swapaxes(-1, -2).reshape(len(parts), -1)))


def moments(values: Array) -> tuple[Array, Array]:
    """Mean and variance over campaigns of what is known, 0 where nothing is."""
    known = np.isfinite(values)
    count = np.maximum(known.sum(axis=0), 1)
    mean = np.where(known, values, 0.0).sum(axis=0) / count
    variance = np.where(known, (values - mean) ** 2, 0.0).sum(axis=0) / count
    return mean, variance


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

    def __call__(self, residuals: Array) -> Array:
        """Of campaigns that no regression saw, shape (n, summaries)."""
        found = np.mean(
            [residuals @ b + a for b, a in zip(self.coefficients, self.intercepts, strict=True)],
            axis=0,
        )
        return self.complete(residuals, found)

    def complete(self, residuals: Array, discriminants: Array) -> Array:
        """Discriminants in their deviations, sizes of residuals, means of channels.

        Shape (n, summaries). The mean of a channel shows what is rare in single trials and common
        to many, such as outcomes that their series contradict.
        """
        left = residuals - discriminants @ self.reproduction
        own, rest = (part.reshape(len(part), -1, self.trials) for part in (residuals, left))
        sizes = [np.log((part**2).mean(axis=2) + SUMMARY.least_size) for part in (own, rest)]
        return np.concatenate([discriminants / self.deviation, *sizes, own.mean(axis=2)], axis=1)

    def unexplained(self, summaries: Array) -> tuple[Array, Array]:
        """Misfit of campaigns, and the share of it that the discriminants do not reproduce.

        Args:
            summaries: shape (n, summaries).

        Returns:
            Logarithms of both, means over the channels, each shape (n,).
        """
        sizes = summaries[:, len(self.deviation) :]
        own, left, _ = np.split(sizes, 3, axis=1)
        return own.mean(axis=1), (left - own).mean(axis=1)


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
    copies: list[Array], campaigns: Campaigns, names: tuple[str, ...], fold: Rows, trials: int
) -> tuple[Summaries, list[Array]]:
    """Regressions, and the summaries of the campaigns that they are made on.

    They have intercepts. Residuals are centred by the campaigns without effect, those of a fold
    among them, so that without one a regression on the other folds would know this fold's mean.

    Args:
        copies: residuals of all campaigns, undisturbed and disturbed, each (n, columns).
        campaigns: the same.
        names: of the effects.
        fold: group of each campaign; it is summarised by regressions on the other groups.
        trials: of a campaign.

    Returns:
        The summaries, and those of each copy, shape (n, summaries).
    """
    wanted, effect = targets(campaigns, names)
    used = copies[: SUMMARY.copies]
    columns = copies[0].shape[1]
    best: tuple[float, list[Array], list[Array], list[Array]] | None = None
    for penalty in SUMMARY.penalties:
        found = [np.zeros(wanted.shape) for _ in copies]
        fitted, intercepts = [], []
        for k in range(SUMMARY.folds):
            rows = fold != k
            x, y = (
                np.concatenate([c[rows] for c in used]),
                np.concatenate([wanted[rows]] * len(used)),
            )
            centre = x.mean(axis=0)
            fitted.append(ridge(x - centre, y - y.mean(axis=0), penalty * columns))
            intercepts.append(y.mean(axis=0) - centre @ fitted[-1])
            for one, copy in zip(found, copies, strict=True):
                one[~rows] = copy[~rows] @ fitted[-1] + intercepts[-1]
        miss = float(((found[-1] - wanted)[:, effect >= 0] ** 2).mean())
        if best is None or miss < best[0]:
            best = (miss, fitted, intercepts, found)
    assert best is not None
    _, fitted, intercepts, found = best
    plain = np.concatenate([one[campaigns.gap_free] for one in found])
    joined = np.concatenate(found[: len(used)])
    reproduction = ridge(joined, np.concatenate(used), SUMMARY.reproduction)
    out = Summaries(
        np.stack(fitted),
        np.stack(intercepts),
        reproduction,
        plain.std(axis=0) + SUMMARY.least_deviation,
        effect,
        trials,
    )
    return out, [out.complete(copy, one) for copy, one in zip(copies, found, strict=True)]
