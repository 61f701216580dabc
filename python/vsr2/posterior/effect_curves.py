"""What each effect gives in the discriminants by its size, as a smooth curve.

Discriminants are whitened, so that chance has unit covariance in them. Curves are by kernel
regression, additive in the effects (J. Quinonero-Candela and C. E. Rasmussen, J. Mach. Learn. Res.
6, 2005, subset of regressors).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vsr2.ensemble.simulated.campaigns import Acting, Campaigns
from vsr2.ensemble.simulated.library import Library, free_parameters, is_angle, turn_of
from vsr2.ensemble.simulated.linear_algebra import ridge
from vsr2.posterior.summaries import SUMMARY

Array = NDArray[np.float64]
Rows = NDArray[np.int64]


@dataclass(frozen=True)
class EffectCurveConstants:
    """How curves of effects are fitted; chosen by hand.

    Attributes:
        points: of each effect's curve.
        width: of the kernel, in the logarithm of the size; half that in other coordinates.
        added_size: to sizes [detection limits] before the logarithm.
        variance: of what an effect of size 1 gives, over that of chance.
        nuisance: variance of what a nuisance gives, over the same.
        shrunk: share of independent chance in the covariance of what is left.
        jitter: added to the kernel's diagonal, so that it has an inverse.
        tiny: by nothing less is divided.
    """

    points: int = 48
    width: float = 1.0
    added_size: float = 0.2
    variance: float = 0.3
    nuisance: float = 0.1
    shrunk: float = 0.05
    jitter: float = 1e-6
    tiny: float = 1e-7


EFFECT_CURVE = EffectCurveConstants()


@dataclass(frozen=True, eq=False)
class Curves:
    """What effects give in whitened discriminants.

    Attributes:
        white: from discriminants to those of unit chance, shape (targets, whitened).
        origin: of the former without effect, shape (targets,).
        means: of each point of each effect's curve, shape (effects, points, whitened).
        sizes: of the points [detection limits], shape (effects, points).
    """

    white: Array
    origin: Array
    means: Array
    sizes: Array

    @cached_property
    def half_squares(self) -> Array:
        """Of the means, shape (effects, points)."""
        return np.asarray(0.5 * (self.means**2).sum(axis=-1))

    @cached_property
    def singles(self) -> NDArray[np.float32]:
        """The means in single precision, which saves time, shape (effects, points, whitened)."""
        return self.means.astype(np.float32)


def kernel_coordinates(library: Library, name: str, acting: Sequence[Acting]) -> Array:
    """Where effects lie for the kernel: amplitude, side, logarithms of sizes, other coordinates.

    A parameter whose null is not known, as no scene was asked for it, has no size.
    """
    free = free_parameters(library[name])
    index = [list(library[name].parameters).index(p) for p in free]
    values = np.array([[one.values[k] for k in index] for one in acting])
    size = np.array([one.size for one in acting])
    gaps, others = [], []
    for p, value in zip(free, values.T, strict=True):
        if is_angle(p):
            turn = 2 * np.pi * (value - p.lower) / turn_of(p)
            others += [np.cos(turn), np.sin(turn)]
        elif p.secondary or np.isnan(p.null):
            others.append(2 * (value - p.lower) / (p.upper - p.lower))
        else:
            gap = np.abs(1 / value if np.isinf(p.null) else value - p.null)
            gaps.append(gap / max(float(gap.max()), EFFECT_CURVE.tiny))
    share = np.array(gaps).reshape(len(gaps), len(size))
    share /= np.maximum(share.max(axis=0, initial=0.0), EFFECT_CURVE.tiny)
    amplitude = np.minimum(size, SUMMARY.largest) ** SUMMARY.power
    side = np.array([float(one.side) for one in acting])
    logs = np.log(share * size + EFFECT_CURVE.added_size) / EFFECT_CURVE.width
    return np.stack(
        [amplitude, side, *logs, *(2 * one / EFFECT_CURVE.width for one in others)], axis=1
    )


def kernel(one: Array, other: Array) -> Array:
    """Covariance of what effects give at two sets of coordinates."""
    apart = ((one[:, None, 2:] - other[None, :, 2:]) ** 2).sum(axis=-1)
    same = one[:, None, 1] == other[None, :, 1]
    amplitude = one[:, None, 0] * other[None, :, 0]
    return np.asarray(EFFECT_CURVE.variance * amplitude * same * np.exp(-0.5 * apart))


@dataclass(frozen=True, eq=False)
class Design:
    """What acts in campaigns, as regressors of which discriminants are a sum.

    Attributes:
        regressors: of effects, then nuisances, shape (n, regressors).
        curves: of points to those of effects, one a curve that has any: effect, the first of its
            regressors, matrix of shape (points, points).
        sizes: of the points, shape (effects, points).
    """

    regressors: Array
    curves: tuple[tuple[int, int, Array], ...]
    sizes: Array

    @classmethod
    def of(cls, campaigns: Campaigns, library: Library) -> Design:
        """Points of a curve are spread over the campaigns in which the effect acts."""
        parts: list[Array] = []
        curves: list[tuple[int, int, Array]] = []
        sizes = np.zeros((len(library), EFFECT_CURVE.points))
        for e, name in enumerate(library):
            own = [(r, a) for r, s in enumerate(campaigns.sets) for a in s if a.name == name]
            if not own:
                continue
            where = kernel_coordinates(library, name, [a for _, a in own])
            order = sorted(range(len(own)), key=lambda k: (own[k][1].side, own[k][1].size))
            chosen = [
                order[k] for k in np.linspace(0, len(own) - 1, EFFECT_CURVE.points).astype(int)
            ]
            sizes[e] = [own[k][1].size for k in chosen]
            points = where[chosen]
            covariance = kernel(points, points)
            most = max(covariance.max(), EFFECT_CURVE.tiny)
            covariance[np.diag_indices(EFFECT_CURVE.points)] += EFFECT_CURVE.jitter * most
            # Regressors of unit prior variance.
            root: Array = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
            part = np.zeros((len(campaigns), EFFECT_CURVE.points))
            part[[r for r, _ in own]] = np.linalg.solve(root, kernel(points, where)).T
            curves.append((e, sum(one.shape[1] for one in parts), root))
            parts.append(part)
        parts.append(np.sqrt(EFFECT_CURVE.nuisance) * campaigns.nuisances)
        return cls(np.concatenate(parts, axis=1), tuple(curves), sizes)

    def fitted(self, mean: Array, origin: Array, rows: Rows) -> tuple[Array, Array]:
        """Curves from some campaigns, and what effects give in all by them.

        Args:
            mean: discriminants, over copies, shape (n, targets).
            origin: of those without effect, shape (targets,).
            rows: campaigns that are fitted.

        Returns:
            Shape (effects, points, targets), and (n, targets).
        """
        weights = ridge(self.regressors[rows], mean[rows] - origin, 1.0)
        means = np.zeros((*self.sizes.shape, mean.shape[1]))
        for effect, first, root in self.curves:
            means[effect] = root @ weights[first : first + EFFECT_CURVE.points]
        count = len(self.curves) * EFFECT_CURVE.points
        return means, self.regressors[:, :count] @ weights[:count]


def fit_curves(
    found: Array, campaigns: Campaigns, library: Library, fold: Rows
) -> tuple[Curves, ...]:
    """One of each fold, made of the other folds.

    There are none where all campaigns are without effect, or none is.

    Args:
        found: discriminants of each copy of campaigns, shape (copies, n, targets).
        campaigns: simulated.
        library: effects.
        fold: group of each campaign.
    """
    if not campaigns.gap_free.any() or campaigns.gap_free.all():
        return ()
    mean = found.mean(axis=0)
    design = Design.of(campaigns, library)
    origin = mean[campaigns.gap_free].mean(axis=0)
    means, given = [], np.zeros(mean.shape)
    for k in range(SUMMARY.folds):
        points, by_others = design.fitted(mean, origin, np.flatnonzero(fold != k))
        means.append(points)
        given[fold == k] = by_others[fold == k]
    white = _whitening(found[1:] - origin - given)
    return tuple(Curves(white, origin, one @ white, design.sizes) for one in means)


def _whitening(left: Array) -> Array:
    """From discriminants to those whose chance has unit covariance; large ones count for less."""
    flat = left.reshape(-1, left.shape[-1])
    scale = flat.std(axis=0) + EFFECT_CURVE.tiny
    flat = flat / scale
    size = np.sqrt((flat**2).mean(axis=1, keepdims=True))
    flat = flat / np.maximum(size / np.median(size), 1.0)
    covariance = (1 - EFFECT_CURVE.shrunk) * flat.T @ flat / len(flat)
    covariance[np.diag_indices(len(covariance))] += EFFECT_CURVE.shrunk
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)).T / scale[:, None])
