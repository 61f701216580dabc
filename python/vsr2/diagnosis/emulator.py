"""Emulator of each trial's response over effects' parameters and nuisances.

For trial i, effect e at prior quantiles u and standardised nuisances z (each about N(0, 1)),

    logit P(overturned) = a_i + c_i . z + b_ie . phi_e(u)         (logistic regression)
    feature_ik          = a_ik + c_ik . z + b_iek . phi_e(u) + s_ik t_4   (robust regression)

with the functions phi_e of :func:`vsr2.diagnosis.library.basis`. All effects share the nuisances'
coefficients, so that every simulation informs them. Coefficients of one column have a normal prior
over trials, whose variance is estimated from all trials (empirical Bayes, EM: C. M. Bishop,
"Pattern Recognition and Machine Learning", 2006, 3.5 and 4.5); what an effect does not touch
shrinks to zero. The coefficients' posterior covariance is kept: it is the Monte Carlo error of the
emulator, and enters every probability drawn from it.

What the features of a campaign have in common beyond that (curvature in z, an effect that changes
how z acts) would make errors of trials alike where they are taken for independent, and the
evidence far too sure. The leading principal components of the residuals, those beyond what
residuals shuffled column by column show (parallel analysis: J. L. Horn, Psychometrika 30, 1965),
stand as further nuisances of unit variance that act on the features alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.library import Library, basis, basis_size

Array = NDArray[np.float64]

DEGREES = 4.0
"""Of freedom of Student's t, the distribution of features around the emulator: near the verge of
overturning a largest tilt is far from any smooth function (EM for t: K. L. Lange et al., "Robust
statistical modeling using the t distribution", JASA 84, 1989)."""
MOST_FACTORS = 8
_MOST_SHARED = 0.8
"""Share of a feature's noise that factors may take."""
_INTERCEPT_VARIANCE = 30.0
_START_VARIANCE = 1.0
_LEAST_VARIANCE = 1e-4
_GREATEST_VARIANCE = 25.0
_FAR = 3.0
"""Scales beyond which a residual is taken for stray."""
_LEAST_STRAY = 0.03
_STRAY_WEIGHT = 30.0
_NEWTON_STEPS = (6, 2)
"""In the first EM step, and in each later one."""
_EM_STEPS = 4


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
class Fit:
    """Coefficients of one response in all trials.

    Attributes:
        mean: shape (trials, columns).
        covariance: shape (trials, columns, columns).
        noise: square of the residuals' scale, shape (trials,); 0 of outcomes.
        loading: of the common residual factors, shape (trials, factors).
        stray: density of responses that have nothing to do with the fit, the share of such times
            their flat density, shape (trials,): a rock that just fails to lift off, or to overturn,
            leaves a largest tilt far from any smooth function.
    """

    mean: Array
    covariance: Array
    noise: Array
    loading: Array
    stray: Array


@dataclass(frozen=True, eq=False)
class Emulator:
    """Fits of outcomes and features over common columns.

    Attributes:
        library: effects in the order of their columns.
        blocks: columns of each effect.
        nuisances: q.
        factors: common to the features' residuals.
        outcome: fit of the logit.
        features: one fit a feature.
    """

    library: Library
    blocks: Mapping[str, slice]
    nuisances: int
    factors: int
    outcome: Fit
    features: tuple[Fit, ...]

    def columns(self, effect: str) -> NDArray[np.int64]:
        """Columns that a campaign under `effect` uses: intercept, nuisances, its own."""
        common = np.arange(1 + self.nuisances)
        if not effect:
            return common
        block = self.blocks[effect]
        return np.concatenate([common, np.arange(block.start, block.stop)])


def design_matrix(
    library: Library, effect: Sequence[str], quantiles: Sequence[Array], nuisances: Array
) -> tuple[Array, dict[str, slice]]:
    """Rows of regressors, shape (rows, columns), and the columns of each effect."""
    q = nuisances.shape[1]
    blocks: dict[str, slice] = {}
    at = 1 + q
    for name, entry in library.items():
        blocks[name] = slice(at, at + basis_size(entry))
        at += basis_size(entry)
    x = np.zeros((len(effect), at))
    x[:, 0] = 1.0
    x[:, 1 : 1 + q] = nuisances
    names = np.asarray(effect)
    for name, entry in library.items():
        rows = np.flatnonzero(names == name)
        if rows.size:
            x[rows, blocks[name]] = basis(entry, np.array([quantiles[int(i)] for i in rows]))
    return x, blocks


def fit_emulator(library: Library, design: Design) -> Emulator:
    """Fit outcomes and features of all trials to the simulated campaigns."""
    x, blocks = design_matrix(library, list(design.effect), design.quantiles, design.nuisances)
    outcome = _logistic(x, design.overturned)
    fits = [_linear(x, design.features[:, :, k]) for k in range(design.features.shape[2])]
    features = _with_factors(x, design.features, fits)
    factors = features[0].loading.shape[1] if features else 0
    none = np.zeros((design.overturned.shape[1], factors))
    return Emulator(
        library,
        blocks,
        design.nuisances.shape[1],
        factors,
        replace(outcome, loading=none),
        features,
    )


def _with_factors(x: Array, features: Array, fits: Sequence[Fit]) -> tuple[Fit, ...]:
    """The fits with what their residuals have in common taken out of the noise."""
    if not fits:
        return ()
    parts = []
    for k, fit in enumerate(fits):
        residual = (features[:, :, k] - x @ fit.mean.T) / np.sqrt(fit.noise)
        parts.append(np.clip(np.nan_to_num(residual, nan=0.0), -3, 3))
    whole = np.concatenate(parts, axis=1)
    known = np.concatenate([np.isfinite(features[:, :, k]) for k in range(len(fits))], axis=1)
    left, size, _ = np.linalg.svd(whole, full_matrices=False)
    shuffled = np.random.default_rng(0).permuted(whole, axis=0)
    threshold = np.linalg.svd(shuffled, compute_uv=False)[0]
    count = min(int(np.count_nonzero(size > threshold)), MOST_FACTORS)
    score = left[:, :count] * np.sqrt(len(x))
    loading = (whole.T @ score) / (known.T.astype(np.float64) @ score**2 + 1.0)
    out = []
    for fit, own in zip(fits, np.split(loading, len(fits)), strict=True):
        share = np.minimum((own**2).sum(axis=1), _MOST_SHARED)
        own = own * np.sqrt(share / np.maximum((own**2).sum(axis=1), 1e-12))[:, None]
        scaled = own * np.sqrt(fit.noise)[:, None]
        out.append(replace(fit, noise=fit.noise * (1 - share), loading=scaled))
    return tuple(out)


def _logistic(x: Array, y: Array) -> Fit:
    trials, columns = y.shape[1], x.shape[1]
    known = np.isfinite(y)
    target = np.where(known, y, 0.0).T
    use = known.T.astype(np.float64)
    share = (target * use).sum(axis=1) + 0.5
    mean = np.zeros((trials, columns))
    mean[:, 0] = np.log(share / (use.sum(axis=1) + 1.0 - share))
    variance = np.full(columns, _START_VARIANCE)
    variance[0] = _INTERCEPT_VARIANCE
    covariance = np.zeros((trials, columns, columns))
    for em in range(_EM_STEPS):
        for _ in range(_NEWTON_STEPS[min(em, 1)]):
            logits = np.clip(mean @ x.T, -30, 30)
            p = 1.0 / (1.0 + np.exp(-logits))
            slope = (use * (target - p)) @ x - mean / variance
            weight = use * p * (1 - p)
            hessian = _weighted(x, weight)
            hessian[:, np.arange(columns), np.arange(columns)] += 1.0 / variance
            step = np.linalg.solve(hessian, slope[:, :, None])[:, :, 0]
            # A full step may overshoot where outcomes separate.
            largest = np.abs(step @ x.T).max(axis=1)
            mean += step * np.minimum(1.0, 4.0 / np.maximum(largest, 1e-12))[:, None]
        covariance = np.asarray(np.linalg.inv(hessian), dtype=np.float64)
        variance = _updated(mean, covariance, variance)
    return Fit(mean, covariance, np.zeros(trials), np.zeros((trials, 0)), np.zeros(trials))


def _linear(x: Array, y: Array) -> Fit:
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
    variance = np.full(columns, _START_VARIANCE * pooled)
    mean = np.zeros((trials, columns))
    covariance = np.zeros((trials, columns, columns))
    weight = use
    for _ in range(_EM_STEPS):
        variance[0] = _INTERCEPT_VARIANCE * max(pooled, 1.0)
        gram = _weighted(x, weight)
        hessian = gram / noise[:, None, None]
        hessian[:, np.arange(columns), np.arange(columns)] += 1.0 / variance
        covariance = np.asarray(np.linalg.inv(hessian), dtype=np.float64)
        mean = np.einsum("tij,tj->ti", covariance, ((weight * target) @ x) / noise[:, None])
        residual = use * (target - mean @ x.T)
        explained = np.einsum("tij,tji->t", covariance, gram)
        # Two pseudo-residuals of pooled size keep few data from claiming certainty.
        noise = ((weight * residual**2).sum(axis=1) + explained + 0.1 * pooled) / (count + 2)
        noise = np.maximum(noise, 1e-8)
        weight = use * (DEGREES + 1) / (DEGREES + residual**2 / noise[:, None])
        variance = _updated(mean, covariance, variance, scale=pooled)
    far = (use * (residual**2 > (_FAR**2) * noise[:, None])).sum(axis=1)
    share = (far + _LEAST_STRAY * _STRAY_WEIGHT) / (count + _STRAY_WEIGHT)
    breadth = np.sqrt(np.maximum(2 * np.pi * spread, pooled))
    return Fit(mean, covariance, noise, np.zeros((trials, 0)), share / breadth)


def _weighted(x: Array, weight: Array) -> Array:
    """X' W_i X for each row i of `weight`, shape (rows, columns, columns)."""
    out = np.empty((len(weight), x.shape[1], x.shape[1]))
    for i, row in enumerate(weight):
        used = row > 1e-9
        part = x[used]
        out[i] = part.T @ (part * row[used, None])
    return out


def _updated(mean: Array, covariance: Array, old: Array, scale: float = 1.0) -> Array:
    second = mean**2 + np.diagonal(covariance, axis1=1, axis2=2)
    out = np.clip(second.mean(axis=0), _LEAST_VARIANCE * scale, _GREATEST_VARIANCE * scale)
    out[0] = old[0]
    return np.asarray(out, dtype=np.float64)
