"""Regressions behind the emulator: one response, all trials at once, simulated campaigns as rows.

    logit P(overturned) = x . b_i + s_id                          (logistic)
    feature_i           = x . b_i + s_id + t_4 noise              (robust)

with regressors x of each campaign. A trial's coefficients, in units of its noise, have a normal
prior whose variance by column is estimated from all trials (empirical Bayes: C. M. Bishop, "Pattern
Recognition and Machine Learning", 2006, 3.5 and 4.5); what an effect does not touch shrinks to
zero.

Campaigns simulated with the same draw of nuisances share all that is random: where an effect is
weak they end alike, trial by trial, and are far from independent. So each draw d shifts each trial
by an amount of its own, s_id (a random intercept: N. M. Laird and J. H. Ware, "Random-effects
models for longitudinal data", Biometrics 38, 1982), whose variance is estimated with the rest:
differences between effects are known better than what all have in common.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DEGREES = 4.0
"""Of freedom of Student's t, the distribution of features around the emulator: near the boundary of
overturning a largest tilt is far from any smooth function (EM for t: K. L. Lange et al., "Robust
statistical modeling using the t distribution", JASA 84, 1989)."""
ERROR = 0.15
"""Relative error of an effect's polynomial that the regression allows for."""
_INTERCEPT_VARIANCE = 30.0
_START_VARIANCE = 1.0
_LEAST_VARIANCE = 1e-6
_MOST_SHIFT = 100.0
_FAR = 3.0
"""Scales beyond which a residual is taken for an outlier."""
_LEAST_STRAY = 0.03
_STRAY_WEIGHT = 30.0
_EM_STEPS = 6
_NEWTON_STEPS = (6, 2)
"""In the first EM step, and in each later one."""
_NOISE_STEPS = 8


@dataclass(frozen=True, eq=False)
class Fit:
    """Coefficients of one response in all trials.

    Attributes:
        mean: shape (trials, columns).
        covariance: shape (trials, columns, columns).
        noise: square of the residuals' scale, that of the draws' shifts within; of outcomes that
            of the shifts alone, shape (trials,).
        loading: of the common residual factors, shape (trials, factors).
        outlier: density of responses that have nothing to do with the fit, the share of such times
            their flat density, shape (trials,): a rock that just fails to lift off, or to overturn,
            leaves a largest tilt far from any smooth function.
    """

    mean: Array
    covariance: Array
    noise: Array
    loading: Array
    outlier: Array

    @property
    def scatter(self) -> Array:
        """Noise with what it has in common, shape (trials,)."""
        return np.asarray(self.noise + (self.loading**2).sum(axis=1), dtype=np.float64)


class Draws:
    """Which campaigns were simulated with the same draw of nuisances.

    Args:
        nuisances: of each campaign, shape (rows, q).
    """

    def __init__(self, nuisances: Array) -> None:
        _, index, counts = np.unique(nuisances, axis=0, return_inverse=True, return_counts=True)
        index = index.ravel()
        repeated = np.flatnonzero(counts > 1)
        self.groups = [np.flatnonzero(index == k) for k in repeated]
        """Rows of each draw that several campaigns share."""
        self.single = np.flatnonzero(counts[index] == 1)
        """Rows whose draw no other shares."""
        self._size = counts[index].astype(np.float64)
        self.rows = len(index)

    def share(self) -> Array:
        """Of each row in its draw: draws count alike, shape (rows,)."""
        return np.asarray(1 / self._size, dtype=np.float64)

    def __len__(self) -> int:
        return len(self.groups)

    def part(self, effect: Array, variance: Array) -> Array:
        """What campaigns have of their draw's shift, shape (trials, rows).

        All of it where an effect moves a trial by little beside what is random, next to nothing
        where by much: near overturning, small changes decide what small changes do.

        Args:
            effect: change of each trial in each campaign, shape (trials, rows).
            variance: of what is random, shape (trials,).
        """
        out = 1 / (1 + effect**2 / variance[:, None])
        out[:, self.single] = 0.0
        return np.asarray(out, dtype=np.float64)

    def spread(self, shift: Array) -> Array:
        """Shifts (trials, draws) at each row, 0 where its draw is its own, shape (trials, rows)."""
        out = np.zeros((len(shift), self.rows))
        for k, rows in enumerate(self.groups):
            out[:, rows] = shift[:, k, None]
        return out

    def summed(self, values: Array) -> Array:
        """Sums of (trials, rows) over each draw's rows, shape (trials, draws)."""
        out = np.zeros((len(values), len(self)))
        for k, rows in enumerate(self.groups):
            out[:, k] = values[:, rows].sum(axis=1)
        return out

    def products(self, x: Array, weight: Array) -> Array:
        """Sums of weight times regressors likewise, shape (trials, columns, draws)."""
        out = np.zeros((len(weight), x.shape[1], len(self)))
        for k, rows in enumerate(self.groups):
            out[:, :, k] = weight[:, rows] @ x[rows]
        return out


class _Gram:
    """X' W X for many weights W of the same regressors.

    A campaign has entries in the common columns and in those of its own effect alone: campaigns
    with entries in the same columns are summed at once.

    Args:
        x: regressors, shape (rows, columns).
    """

    def __init__(self, x: Array) -> None:
        self._columns = x.shape[1]
        used, group = np.unique(x != 0, axis=0, return_inverse=True)
        self._groups: list[tuple[NDArray[np.int64], NDArray[np.int64], Array]] = []
        """Rows, columns and, for each row, products of all pairs of columns."""
        for k, mask in enumerate(used):
            rows, columns = np.flatnonzero(group.ravel() == k), np.flatnonzero(mask)
            part = x[np.ix_(rows, columns)]
            products = (part[:, :, None] * part[:, None, :]).reshape(rows.size, -1)
            self._groups.append((rows, columns, products))

    def __call__(self, weight: Array) -> Array:
        """Of weights (trials, rows), shape (trials, columns, columns)."""
        out = np.zeros((len(weight), self._columns, self._columns))
        for rows, columns, products in self._groups:
            block = (weight[:, rows] @ products).reshape(-1, columns.size, columns.size)
            out[:, columns[:, None], columns[None, :]] += block
        return out


def logistic_regression(x: Array, draws: Draws, common: int, y: Array) -> Fit:
    """Logistic regression by Newton's method.

    Args:
        x: regressors, shape (rows, columns).
        draws: of the rows.
        common: number of columns that all campaigns have; the others belong to effects.
        y: outcomes, 0 or 1, shape (rows, trials), NaN where unknown.
    """
    trials, columns = y.shape[1], x.shape[1]
    known = np.isfinite(y)
    target = np.where(known, y, 0.0).T
    use = known.T.astype(np.float64)
    share = (target * use).sum(axis=1) + 0.5
    mean = np.zeros((trials, columns))
    mean[:, 0] = np.log(share / (use.sum(axis=1) + 1.0 - share))
    prior = np.full(columns, _START_VARIANCE)
    prior[0] = _INTERCEPT_VARIANCE
    covariance = np.zeros((trials, columns, columns))
    ones, weighted = np.ones(trials), _Gram(x)
    shift, variance = np.zeros((trials, len(draws))), _START_VARIANCE if len(draws) else 0.0
    for em in range(_EM_STEPS):
        precision = np.diag(1 / prior)
        for _ in range(_NEWTON_STEPS[min(em, 1)]):
            part = draws.part(mean[:, common:] @ x[:, common:].T, np.full(trials, 1 + variance))
            logits = np.clip(mean @ x.T + part * draws.spread(shift), -30, 30)
            p = 1.0 / (1.0 + np.exp(-logits))
            # What a campaign does not share of a shift is averaged over, to first order.
            weaker = 1 / (1 + variance * (1 - part**2) * p * (1 - p))
            off, weight = use * (target - p) * weaker, use * p * (1 - p) * weaker
            slope = off @ x - mean @ precision
            hessian = weighted(weight) + precision
            mixed = draws.products(x, part * weight)
            own = draws.summed(part**2 * weight) + 1 / max(variance, 1e-12)
            pull = draws.summed(part * off) - shift / max(variance, 1e-12)
            hessian -= (mixed / own[:, None, :]) @ np.swapaxes(mixed, 1, 2)
            slope -= (mixed @ (pull / own)[:, :, None])[:, :, 0]
            step = np.linalg.solve(hessian, slope[:, :, None])[:, :, 0]
            turn = (pull - (step[:, None, :] @ mixed)[:, 0]) / own
            # A full step may overshoot where outcomes separate.
            largest = np.abs(step @ x.T + part * draws.spread(turn)).max(axis=1)
            damped = np.minimum(1.0, 4.0 / np.maximum(largest, 1e-12))[:, None]
            mean, shift = mean + damped * step, shift + damped * turn
        covariance = np.asarray(np.linalg.inv(hessian), dtype=np.float64)
        prior = _updated(mean, covariance, ones, prior)
        error = 1 / own + _through(covariance, mixed) / own**2
        variance = _shift_variance(shift, error, ones, variance)
    none = np.zeros((trials, 0))
    return Fit(mean, covariance, np.full(trials, variance), none, np.zeros(trials))


def robust_regression(x: Array, draws: Draws, common: int, y: Array) -> tuple[Fit, Array]:
    """Robust regression, and each draw's residuals, shape (draws, trials).

    Args:
        x: regressors, shape (rows, columns).
        draws: of the rows.
        common: number of columns that all campaigns have; the others belong to effects.
        y: responses, shape (rows, trials), NaN where unknown.
    """
    trials, columns = y.shape[1], x.shape[1]
    known = np.isfinite(y).T
    target = np.where(known, y.T, 0.0)
    use = known.astype(np.float64)
    count = np.maximum(use.sum(axis=1), 1.0)
    centre = (target * use).sum(axis=1) / count
    spread = ((target - centre[:, None]) ** 2 * use).sum(axis=1) / count
    pooled = float(np.median(spread[use.sum(axis=1) > 2])) if (use.sum(axis=1) > 2).any() else 1.0
    pooled = max(pooled, 1e-8)
    noise = np.maximum(spread, 0.05 * pooled)
    prior = np.full(columns, _START_VARIANCE)
    prior[0] = 100 * _INTERCEPT_VARIANCE * max(pooled, 1.0) / pooled
    mean = np.zeros((trials, columns))
    covariance = np.zeros((trials, columns, columns))
    weight, trust = use, np.ones_like(use)
    weighted = _Gram(x)
    shift, variance = np.zeros((trials, len(draws))), _START_VARIANCE if len(draws) else 0.0
    for _ in range(_EM_STEPS):
        part = draws.part(mean[:, common:] @ x[:, common:].T, noise * (1 + variance))
        # What a campaign does not share of a shift is noise.
        more = 1 + variance * (1 - part**2)
        weight = weight / more
        gram = weighted(weight)
        mixed = draws.products(x, part * weight)
        each = draws.summed(part**2 * weight)
        stiff = each + 1 / max(variance, 1e-12)
        hessian = gram + np.diag(1 / prior) - (mixed / stiff[:, None, :]) @ np.swapaxes(mixed, 1, 2)
        covariance = np.asarray(np.linalg.inv(hessian / noise[:, None, None]), dtype=np.float64)
        gathered = draws.summed(part * weight * target)
        drive = (weight * target) @ x - (mixed @ (gathered / stiff)[:, :, None])[:, :, 0]
        mean = np.einsum("tij,tj->ti", covariance, drive / noise[:, None])
        shift = (gathered - (mean[:, None, :] @ mixed)[:, 0]) / stiff
        through = _through(covariance, mixed)
        error = noise[:, None] / stiff + through / stiff**2
        raw = use * (target - mean @ x.T)
        residual = raw - use * part * draws.spread(shift)
        explained = np.einsum("tij,tji->t", covariance, gram) + (each * error).sum(axis=1)
        explained -= 2 * (through / stiff).sum(axis=1)
        # Two pseudo-residuals of pooled size keep few data from claiming certainty.
        believed = (use * trust).sum(axis=1)
        noise = ((weight * residual**2).sum(axis=1) + explained + 0.1 * pooled) / (believed + 2)
        noise = np.maximum(noise, 1e-8)
        # Where an effect is strong the polynomial is off by a share of it: that is not noise.
        off = ERROR * mean[:, common:] @ x[:, common:].T
        trust = 1 / (1 + off**2 / noise[:, None])
        size = trust * residual**2 / more / noise[:, None]
        weight = use * trust * (DEGREES + 1) / (DEGREES + size)
        prior = _updated(mean, covariance, noise, prior)
        variance = _shift_variance(shift, error, noise, variance)
    total = _total_noise(raw, use * trust * draws.share(), noise, pooled, common)
    far = (use * (raw**2 > (_FAR**2) * total[:, None])).sum(axis=1)
    share = (far + _LEAST_STRAY * _STRAY_WEIGHT) / (count + _STRAY_WEIGHT)
    breadth = np.sqrt(np.maximum(2 * np.pi * spread, pooled))
    fit = Fit(mean, covariance, total, np.zeros((trials, 0)), share / breadth)
    seen = draws.summed(use) > 0
    alone = np.where(known, raw, np.nan)[:, draws.single]
    return fit, np.concatenate([np.where(seen, shift, np.nan), alone], axis=1).T


def _total_noise(rest: Array, weight: Array, noise: Array, pooled: float, common: int) -> Array:
    """Square of the scale of Student's t about the fit, draws' shifts and all, shape (trials,).

    Args:
        rest: residuals, 0 where unknown, shape (trials, rows).
        weight: of the rows, likewise; each draw has 1 at most.
        noise: within draws, to begin with.
        pooled: variance of all trials: two pseudo-residuals, as within draws.
        common: columns that all campaigns have, which take as many degrees of freedom.
    """
    count = weight.sum(axis=1)
    left = np.maximum(count - common, 0.5 * count)
    total = noise
    for _ in range(_NOISE_STEPS):
        own = weight * (DEGREES + 1) / (DEGREES + rest**2 / total[:, None])
        total = np.maximum(((own * rest**2).sum(axis=1) + 0.1 * pooled) / (left + 2), 1e-8)
    return np.asarray(total, dtype=np.float64)


def _through(covariance: Array, mixed: Array) -> Array:
    """Variance of each draw's summed predictions, shape (trials, draws)."""
    return np.asarray((mixed * (covariance @ mixed)).sum(axis=1), dtype=np.float64)


def _shift_variance(shift: Array, error: Array, noise: Array, old: float) -> float:
    """Variance of the draws' shifts over trials, in units of the noise: as `_updated`."""
    if not shift.size:
        return 0.0
    known = np.maximum(1 - error / noise[:, None] / old, 1e-3).sum()
    return float(np.clip((shift**2 / noise[:, None]).sum() / known, _LEAST_VARIANCE, _MOST_SHIFT))


def _updated(mean: Array, covariance: Array, noise: Array, old: Array) -> Array:
    """Variance of each column over trials, in units of each trial's noise.

    D. J. C. MacKay's fixed point ("Bayesian interpolation", Neural Computation 4, 1992), which
    drops columns that say nothing far sooner than EM does.
    """
    own = np.diagonal(covariance, axis1=1, axis2=2) / noise[:, None]
    known = np.maximum(1 - own / old, 1e-3).sum(axis=0)
    out = np.clip((mean**2 / noise[:, None]).sum(axis=0) / known, _LEAST_VARIANCE, None)
    out[0] = old[0]
    return np.asarray(out, dtype=np.float64)
