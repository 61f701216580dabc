"""Emulator of each trial's response over effects' parameters and nuisances.

For trial i, effect e at prior quantiles u and standardised nuisances z (each about N(0, 1)),

    logit P(overturned) = a_i + c_i . z + d_i . (z^2 - 1) + b_ie . phi_e(u)      (logistic)
    feature_ik          = a_ik + c_ik . z + d_ik . (z^2 - 1) + b_iek . phi_e(u) + s_ik t_4

(the latter by robust regression) with the functions phi_e of
:func:`vsr2.diagnosis.library.basis`. All effects share the nuisances' coefficients, so that every
simulation informs them. A trial's coefficients, in units of its noise, have a normal prior whose
variance by column is estimated from all trials (empirical Bayes: C. M. Bishop, "Pattern Recognition
and Machine Learning", 2006, 3.5 and 4.5); what an effect does not touch shrinks to zero. The
coefficients' posterior covariance is kept: it is the Monte Carlo error of the emulator, and enters
every probability drawn from it.

Campaigns simulated with the same draw of nuisances share all that is random: where an effect is
weak they end alike, trial by trial, and are far from independent. So each draw shifts each trial by
an amount of its own (a random intercept: N. M. Laird and J. H. Ware, "Random-effects models for
longitudinal data", Biometrics 38, 1982), whose variance is estimated with the rest: differences
between effects are known better than what all have in common.

What the features of a campaign have in common beyond that (an effect that changes how z acts)
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
_LEAST_VARIANCE = 1e-6
_NOISE_STEPS = 8
_MOST_SHIFT = 100.0
LEAST_BEND = 1.0
"""Twice the log likelihood that a nuisance's square makes out in a typical campaign, below which it
is left out [nat]."""
_FAR = 3.0
"""Scales beyond which a residual is taken for stray."""
_LEAST_STRAY = 0.03
_STRAY_WEIGHT = 30.0
ERROR = 0.15
"""Relative error of an effect's polynomial that the regression allows for."""
ERRORS = np.array([0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0])
"""Relative errors that are tried."""
_POOLED = 0.1
"""Weight of the mean effect's score in each effect's choice."""
_NEWTON_STEPS = (6, 2)
"""In the first EM step, and in each later one."""
_EM_STEPS = 6


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
        noise: square of the residuals' scale, that of the draws' shifts within; of outcomes that
            of the shifts alone, shape (trials,).
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

    @property
    def scatter(self) -> Array:
        """Noise with what it has in common, shape (trials,)."""
        return np.asarray(self.noise + (self.loading**2).sum(axis=1), dtype=np.float64)


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


class _Draws:
    """Which campaigns were simulated with the same draw of nuisances.

    Args:
        nuisances: of each campaign, shape (rows, q).
    """

    def __init__(self, nuisances: Array) -> None:
        _, index, counts = np.unique(nuisances, axis=0, return_inverse=True, return_counts=True)
        index = index.ravel()
        shared = np.flatnonzero(counts > 1)
        self.groups = [np.flatnonzero(index == k) for k in shared]
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


def fit_emulator(library: Library, design: Design) -> Emulator:
    """Fit outcomes and features of all trials to the simulated campaigns."""
    x, blocks = design_matrix(library, list(design.effect), design.quantiles, design.nuisances)
    draws = _Draws(design.nuisances)
    q = design.nuisances.shape[1]
    common = common_columns(q)
    outcome = _logistic(x, draws, common, design.overturned)
    fits, rests = [], []
    for k in range(design.features.shape[2]):
        fit, rest = _linear(x, draws, common, design.features[:, :, k])
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
    whole = np.clip(np.nan_to_num(np.concatenate(parts, axis=1), nan=0.0), -3, 3)
    left, size, _ = np.linalg.svd(whole, full_matrices=False)
    shuffled = np.random.default_rng(0).permuted(whole, axis=0)
    threshold = np.linalg.svd(shuffled, compute_uv=False)[0]
    count = min(int(np.count_nonzero(size > threshold)), MOST_FACTORS)
    score = left[:, :count] * np.sqrt(len(whole))
    loading = (whole.T @ score) / (known.T.astype(np.float64) @ score**2 + 1.0)
    out = []
    for fit, own in zip(fits, np.split(loading, len(fits)), strict=True):
        share = np.minimum((own**2).sum(axis=1), _MOST_SHARED)
        own = own * np.sqrt(share / np.maximum((own**2).sum(axis=1), 1e-12))[:, None]
        scaled = own * np.sqrt(fit.noise)[:, None]
        out.append(replace(fit, noise=fit.noise * (1 - share), loading=scaled))
    return tuple(out)


def _logistic(x: Array, draws: _Draws, common: int, y: Array) -> Fit:
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
    ones = np.ones(trials)
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
            hessian = _weighted(x, weight) + precision
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


def _linear(x: Array, draws: _Draws, common: int, y: Array) -> tuple[Fit, Array]:
    """Robust regression, and each draw's residuals, shape (draws, trials).

    Args:
        x: regressors.
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
    shift, variance = np.zeros((trials, len(draws))), _START_VARIANCE if len(draws) else 0.0
    for _ in range(_EM_STEPS):
        part = draws.part(mean[:, common:] @ x[:, common:].T, noise * (1 + variance))
        # What a campaign does not share of a shift is noise.
        more = 1 + variance * (1 - part**2)
        weight = weight / more
        gram = _weighted(x, weight)
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
        whole = use * (target - mean @ x.T)
        residual = whole - use * part * draws.spread(shift)
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
    total = _total_noise(whole, use * trust * draws.share(), noise, pooled, common)
    far = (use * (whole**2 > (_FAR**2) * total[:, None])).sum(axis=1)
    share = (far + _LEAST_STRAY * _STRAY_WEIGHT) / (count + _STRAY_WEIGHT)
    breadth = np.sqrt(np.maximum(2 * np.pi * spread, pooled))
    fit = Fit(mean, covariance, total, np.zeros((trials, 0)), share / breadth)
    seen = draws.summed(use) > 0
    alone = np.where(known, whole, np.nan)[:, draws.single]
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
                    whole = variance + (error * by_effect) ** 2
                    log = _log_score(kind == 0, y, mean, whole, fit.stray)
                    score[name][kind, k] += float(np.nansum(log))
    pooled = sum(score.values()) / max(len(score), 1)
    out = {}
    for name, own_score in score.items():
        best = np.argmax(own_score + _POOLED * pooled, axis=1)
        out[name] = (float(ERRORS[best[0]]), float(ERRORS[best[1]]))
    return out


def _log_score(outcome: bool, y: Array, mean: Array, variance: Array, stray: Array) -> Array:
    if outcome:
        logit = mean / np.sqrt(1 + np.pi / 8 * variance)
        p = 0.996 / (1 + np.exp(-np.clip(logit, -30, 30))) + 0.002
        return np.asarray(np.log(np.where(y > 0.5, p, 1 - p)) + 0 * y, dtype=np.float64)
    ratio = 1 / (1 + (y - mean) ** 2 / (DEGREES * variance))
    return np.asarray(np.log(0.375 * ratio**2.5 / np.sqrt(variance) + stray), dtype=np.float64)


def _weighted(x: Array, weight: Array) -> Array:
    """X' W_i X for each row i of `weight`, shape (rows, columns, columns).

    A campaign has entries in the common columns and in those of its own effect alone: campaigns
    with entries in the same columns are summed at once.
    """
    used, group = np.unique(x != 0, axis=0, return_inverse=True)
    out = np.zeros((len(weight), x.shape[1], x.shape[1]))
    for k, mask in enumerate(used):
        rows, columns = np.flatnonzero(group.ravel() == k), np.flatnonzero(mask)
        part = x[np.ix_(rows, columns)]
        products = (part[:, :, None] * part[:, None, :]).reshape(rows.size, -1)
        block = (weight[:, rows] @ products).reshape(-1, columns.size, columns.size)
        out[:, columns[:, None], columns[None, :]] += block
    return out


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
