"""Emulator of each trial's response over effects' parameters and nuisances.

For trial i, effect e at prior quantiles u and standardised nuisances z (each about N(0, 1)),

    logit P(overturned) = a_i + c_i . z + d_i . (z^2 - 1) + b_ie . phi_e(u)      (logistic)
    feature_ik          = a_ik + c_ik . z + d_ik . (z^2 - 1) + b_iek . phi_e(u) + s_ik t_4

(:mod:`vsr2.diagnosis.likelihood.regression`) with the functions phi_e of
:func:`vsr2.diagnosis.simulated.library.basis`. All effects share the nuisances' coefficients, so
that every simulation informs them. The coefficients' posterior covariance is kept: it is the Monte
Carlo error of the emulator, and enters every probability drawn from it.

What the features of a campaign have in common beyond their draw (an effect that changes how z acts)
would make errors of trials alike where they are taken for independent, and the
evidence far too sure. The leading principal components of the residuals, those beyond what
residuals shuffled column by column show (parallel analysis: J. L. Horn, Psychometrika 30, 1965),
stand as further nuisances of unit variance that act on the features alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.likelihood.linear_algebra import singular_values
from vsr2.diagnosis.likelihood.regression import (
    DEGREES,
    Draws,
    Fit,
    logistic_regression,
    robust_regression,
)
from vsr2.diagnosis.simulated.design import Design
from vsr2.diagnosis.simulated.library import Library, basis, basis_size

Array = NDArray[np.float64]

MOST_FACTORS = 8
_MOST_SHARED = 0.8
"""Share of a feature's noise that factors may take."""
LEAST_BEND = 1.0
"""Twice the log likelihood that a nuisance's square makes out in a typical campaign, below which it
is left out [nat]."""
ERRORS = np.array([0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0])
"""Relative errors that are tried."""
_POOLED = 0.1
"""Weight of the mean effect's score in each effect's choice."""


@dataclass(frozen=True, eq=False)
class Emulator:
    """Fits of outcomes and features over common columns.

    Attributes:
        library: effects in the order of their columns.
        blocks: columns of each effect.
        nuisances: q.
        bends: which nuisances' squares count.
        factors: common to the features' residuals.
        outcome: fit of the logit.
        features: one fit a feature.
        wrong: relative error of each effect's part of the logit, and of the features, beyond what
            the coefficients' covariance says.
    """

    library: Library
    blocks: Mapping[str, slice]
    nuisances: int
    bends: NDArray[np.int64]
    factors: int
    outcome: Fit
    features: tuple[Fit, ...]
    wrong: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def scatter(self) -> Array:
        """Of the features, shape (trials, k)."""
        trials = len(self.outcome.mean)
        return np.array([fit.scatter for fit in self.features]).reshape(-1, trials).T

    def columns(self, effect: str) -> NDArray[np.int64]:
        """Columns that a campaign under `effect` uses: those common to all, its own."""
        common = np.arange(common_columns(self.nuisances))
        if not effect:
            return common
        block = self.blocks[effect]
        return np.concatenate([common, np.arange(block.start, block.stop)])


def common_columns(nuisances: int) -> int:
    """Number of the intercept, the nuisances and their squares."""
    return 1 + 2 * nuisances


def design_matrix(
    library: Library, effect: Sequence[str], quantiles: Sequence[Array], nuisances: Array
) -> tuple[Array, dict[str, slice]]:
    """Rows of regressors, shape (rows, columns), and the columns of each effect."""
    q = nuisances.shape[1]
    blocks: dict[str, slice] = {}
    at = common_columns(q)
    for name, entry in library.items():
        blocks[name] = slice(at, at + basis_size(entry))
        at += basis_size(entry)
    x = np.zeros((len(effect), at))
    x[:, 0] = 1.0
    x[:, 1 : 1 + q] = nuisances
    x[:, 1 + q : 1 + 2 * q] = nuisances**2 - 1
    names = np.asarray(effect)
    for name, entry in library.items():
        rows = np.flatnonzero(names == name)
        if rows.size:
            x[rows, blocks[name]] = basis(entry, np.array([quantiles[int(i)] for i in rows]))
    return x, blocks


def fit_emulator(library: Library, design: Design) -> Emulator:
    """Fit outcomes and features of all trials to the simulated campaigns."""
    x, blocks = design_matrix(library, list(design.effect), design.quantiles, design.nuisances)
    draws = Draws(design.nuisances)
    q = design.nuisances.shape[1]
    common = common_columns(q)
    outcome = logistic_regression(x, draws, common, design.overturned)
    fits, rests = [], []
    for k in range(design.features.shape[2]):
        fit, rest = robust_regression(x, draws, common, design.features[:, :, k])
        fits.append(fit)
        rests.append(rest)
    features = _with_factors(fits, rests)
    factors = features[0].loading.shape[1] if features else 0
    none = np.zeros((design.overturned.shape[1], factors))
    return Emulator(
        library,
        blocks,
        q,
        _bends(outcome, fits, q),
        factors,
        replace(outcome, loading=none),
        features,
    )


def _bends(outcome: Fit, features: Sequence[Fit], q: int) -> NDArray[np.int64]:
    """Nuisances whose squares count."""
    squares = slice(1 + q, 1 + 2 * q)
    p = 1 / (1 + np.exp(-np.clip(outcome.mean[:, 0], -30, 30)))
    weight = 2 * (p * (1 - p)) @ outcome.mean[:, squares] ** 2
    for fit in features:
        weight += 2 * (fit.mean[:, squares] ** 2 / fit.noise[:, None]).sum(axis=0)
    return np.flatnonzero(weight > LEAST_BEND)


def _with_factors(fits: Sequence[Fit], rests: Sequence[Array]) -> tuple[Fit, ...]:
    """The fits with what their draws' residuals have in common taken out of the noise.

    Args:
        fits: of each feature.
        rests: residual of each draw in each, shape (draws, trials), NaN where it is not known.
    """
    if not fits:
        return ()
    parts = [own / np.sqrt(fit.noise) for fit, own in zip(fits, rests, strict=True)]
    known = np.isfinite(np.concatenate(parts, axis=1))
    joined = np.clip(np.nan_to_num(np.concatenate(parts, axis=1), nan=0.0), -3, 3)
    left, size, _ = singular_values(joined)
    shuffled = np.random.default_rng(0).permuted(joined, axis=0)
    threshold = singular_values(shuffled)[1][0]
    count = min(int(np.count_nonzero(size > threshold)), MOST_FACTORS)
    score = left[:, :count] * np.sqrt(len(joined))
    loading = (joined.T @ score) / (known.T.astype(np.float64) @ score**2 + 1.0)
    out = []
    for fit, own in zip(fits, np.split(loading, len(fits)), strict=True):
        share = np.minimum((own**2).sum(axis=1), _MOST_SHARED)
        own = own * np.sqrt(share / np.maximum((own**2).sum(axis=1), 1e-12))[:, None]
        scaled = own * np.sqrt(fit.noise)[:, None]
        out.append(replace(fit, noise=fit.noise * (1 - share), loading=scaled))
    return tuple(out)


def relative_errors(
    library: Library, held: Sequence[tuple[Emulator, Design]]
) -> dict[str, tuple[float, float]]:
    """How wrong each effect's part of the predictions is, by maximum likelihood.

    The emulator is a short polynomial; where an effect is strong, its error is about proportional
    to the effect. One number an effect for the logit and one for the features, from simulated
    campaigns that the emulators did not see.

    Args:
        library: effects.
        held: emulators, each with the campaigns that it was not fitted to.
    """
    score = {name: np.zeros((2, ERRORS.size)) for name in library}
    for emulator, design in held:
        x, blocks = design_matrix(library, list(design.effect), design.quantiles, design.nuisances)
        for name, block in blocks.items():
            rows = np.flatnonzero(design.effect == name)
            part, own = x[rows], x[rows][:, block]
            for kind, fit, y in [
                (0, emulator.outcome, design.overturned[rows]),
                *((1, f, design.features[rows, :, k]) for k, f in enumerate(emulator.features)),
            ]:
                mean, by_effect = part @ fit.mean.T, own @ fit.mean[:, block].T
                variance = np.einsum("ri,tij,rj->rt", part, fit.covariance, part, optimize=True)
                variance += fit.scatter
                for k, error in enumerate(ERRORS):
                    joined = variance + (error * by_effect) ** 2
                    log = _log_score(kind == 0, y, mean, joined, fit.outlier)
                    score[name][kind, k] += float(np.nansum(log))
    pooled = sum(score.values()) / max(len(score), 1)
    out = {}
    for name, own_score in score.items():
        best = np.argmax(own_score + _POOLED * pooled, axis=1)
        out[name] = (float(ERRORS[best[0]]), float(ERRORS[best[1]]))
    return out


def _log_score(outcome: bool, y: Array, mean: Array, variance: Array, outlier: Array) -> Array:
    if outcome:
        logit = mean / np.sqrt(1 + np.pi / 8 * variance)
        p = 0.996 / (1 + np.exp(-np.clip(logit, -30, 30))) + 0.002
        return np.asarray(np.log(np.where(y > 0.5, p, 1 - p)) + 0 * y, dtype=np.float64)
    ratio = 1 / (1 + (y - mean) ** 2 / (DEGREES * variance))
    return np.asarray(np.log(0.375 * ratio**2.5 / np.sqrt(variance) + outlier), dtype=np.float64)
