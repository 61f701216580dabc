"""Probability of overturning as a function of one or two intensity measures, with bands.

A generalised linear model of binomial outcomes with a probit link, in logarithms of the measures:
one measure gives the lognormal curve of hazard studies, P = Phi(ln(x / median) / beta); two give
the surface probit P = c0 + c1 a + c2 b + c3 a^2 + c4 a b + c5 b^2, a and b the logarithms,
standardised, or its linear part alone.

**Prior.** Where a line parts the outcomes without error the likelihood has no maximum: the slope
runs away. Each coefficient (of standardised terms) therefore has a weak prior, given as data
(Greenland and Mansournia 2015): half a trial that overturned and half one that stood, at 0.1 on the
coefficient's own axis and 0 on all others. It is nearly flat up to coefficients of some 20 and
falls as a normal density of standard deviation 14 beyond; half a trial decides nothing where data
do.

**Bands.** Quantiles of the posterior's curves, which no normal approximation gives where outcomes
are nearly separated and the steepness is open upwards. Scalings, azimuths and replicates of one
ground motion resemble each other, so that the likelihood overstates what was learnt; it is raised
to the power 1 / d, where d is the mean ratio, over directions, of the covariance clustered by
motion (Liang and Zeger 1986, times G / (G - 1), with Student's t of G - 1 degrees of freedom for G
motions) to the model's (inverse information, prior included), and at least 1. Median and beta have
normal intervals of their logarithms, from the wider of both covariances.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsr2.analysis.intervals import INTERVALS
from vsr2.errors import ResultError
from vsr2.fragility.settings import FIT
from vsr2.one_line import counted
from vsr2.read_only import label_argument, real_argument, truth_argument

Array = NDArray[np.float64]

_CHUNK = 500
"""Intensities whose curves are drawn at once: bounds the memory; no result depends on it."""


@dataclass(frozen=True)
class Lognormal:
    """P = Phi(ln(x / median) / beta).

    Attributes:
        median: in the unit of the measure.
        median_lower, median_upper: confidence interval.
        beta: standard deviation of the logarithm [1].
        beta_lower, beta_upper: confidence interval.
        fits: whether square and cube of the logarithm add nothing significant, by the wider
            covariance; separated outcomes cannot tell, and any steep curve fits them.
    """

    median: float
    median_lower: float
    median_upper: float
    beta: float
    beta_lower: float
    beta_upper: float
    fits: bool


@dataclass(frozen=True, eq=False)
class _Posterior:
    """The coefficients' posterior: its mode, and draws of it.

    Attributes:
        mode: shape (p,).
        model, clustered: covariances, shape (p, p).
        degrees: of freedom of the clustered one; 0: there is none.
        power: of the likelihood and prior, at most 1.
        terms: of different intensities, shape (c, p), those of the prior among them.
        hits, misses: numbers of trials there that overturned and stood, shape (c,).
    """

    mode: Array
    model: Array
    clustered: Array
    degrees: int
    power: float
    terms: Array
    hits: Array
    misses: Array

    @cached_property
    def draws(self) -> Array:
        """Draws, shape (draws, p), always the same; ensemble sampler of Goodman and Weare (2010).

        Each half of the walkers is moved along lines through walkers of the other half, which suits
        every affine shape alike.
        """
        rng = np.random.default_rng(0)
        size = self.mode.size
        half = FIT.half_walkers * size
        value, vector = np.linalg.eigh(self.model / self.power)
        spread = vector * np.sqrt(np.maximum(value, 0.0))
        first = FIT.first_spread * rng.standard_normal((2, half, size))
        walkers = self.mode + first @ spread.T
        density = np.stack([self._density(some) for some in walkers])
        kept = []
        for step in range(FIT.burn_in + FIT.steps):
            for k in (0, 1):
                partner = walkers[1 - k][rng.integers(half, size=half)]
                stretch = (1.0 + rng.random(half)) ** 2 / 2.0
                moved = partner + stretch[:, None] * (walkers[k] - partner)
                there = self._density(moved)
                odds = (size - 1) * np.log(stretch) + there - density[k]
                taken = np.log(rng.random(half)) < odds
                walkers[k][taken] = moved[taken]
                density[k][taken] = there[taken]
            if step >= FIT.burn_in and step % FIT.thin == 0:
                kept.append(walkers.reshape(-1, size).copy())
        return np.concatenate(kept)

    def _density(self, coefficients: Array) -> Array:
        """Logarithm of the posterior density but for a constant, shape (m,), of (m, p)."""
        from scipy.special import log_ndtr

        linear = coefficients @ self.terms.T
        found: Array = self.power * (log_ndtr(linear) @ self.hits + log_ndtr(-linear) @ self.misses)
        return found


class FitNote(StrEnum):
    """What keeps a fit from being a curve."""

    ALL_OVERTURNED = "all_overturned"
    ALL_STOOD = "all_stood"
    NOT_RISING = "not_rising"


@dataclass(frozen=True, eq=False)
class FragilityFit:
    """A fitted curve (k = 1) or surface (k = 2).

    Attributes:
        names: of the measures.
        trials, overturned, groups: numbers of trials, of those that overturned, of ground motions.
        separated: the curve or surface parts the outcomes without error; its steepness is then the
            prior's, and its middle is known no better than the gap between them.
        note: what keeps it from being a curve; None: nothing.
        falling: measures with which a surface falls, in part of the range, by more than `FIT.fall`.
        low, high: least and greatest value of each measure, shape (k,).
        lognormal: median and beta; None: two measures, or the probability does not rise.
    """

    names: tuple[str, ...]
    trials: int
    overturned: int
    groups: int
    separated: bool
    note: FitNote | None
    falling: tuple[str, ...]
    low: Array
    high: Array
    lognormal: Lognormal | None
    _center: Array
    _spread: Array
    _level: float
    _points: Array
    _quadratic: bool
    _posterior: _Posterior | None
    _interval: tuple[float, float, float] | None

    def probability(self, measures: ArrayLike) -> tuple[Array, Array, Array]:
        """Probability of overturning with the band's lower and upper end.

        Args:
            measures: above 0, shape (n,) for one measure or (n, k).

        Returns:
            Three arrays of shape (n,).

        Raises:
            ResultError: another shape, or a value that is not above 0.
        """
        from scipy.special import ndtr

        values = _checked(measures, len(self.names))
        if self._interval is not None:
            shape = np.ones(len(values))
            return self._interval[1] * shape, self._interval[0] * shape, self._interval[2] * shape
        assert self._posterior is not None
        terms = _terms((np.log(values) - self._center) / self._spread, self._quadratic)
        middle = terms @ self._posterior.mode
        lower, upper = middle.copy(), middle.copy()
        tails = [0.5 * (1.0 - self._level), 0.5 * (1.0 + self._level)]
        for start in range(0, len(terms), _CHUNK):
            rows = slice(start, start + _CHUNK)
            low, high = np.quantile(terms[rows] @ self._posterior.draws.T, tails, axis=1)
            lower[rows] = np.minimum(lower[rows], low)
            upper[rows] = np.maximum(upper[rows], high)
        return ndtr(middle), ndtr(lower), ndtr(upper)

    def inside(self, measures: ArrayLike) -> NDArray[np.bool_]:
        """Whether intensities lie amid the fitted trials (their convex hull), shape (n,).

        Elsewhere the fit extrapolates.
        """
        values = np.log(_checked(measures, len(self.names)))
        slack = 1e-9
        if len(self.names) == 1:
            low, high = np.log(self.low) - slack, np.log(self.high) + slack
            return np.asarray(((values >= low) & (values <= high)).all(axis=1))
        from scipy.spatial import ConvexHull, QhullError

        try:
            hull = ConvexHull(self._points)
        except QhullError:
            # All on one line: nothing lies amid them.
            return np.zeros(len(values), dtype=np.bool_)
        scaled = (values - self._center) / self._spread
        distance = scaled @ hull.equations[:, :-1].T + hull.equations[:, -1]
        amid: NDArray[np.bool_] = distance.max(axis=1) <= FIT.on_hull
        return amid

    def grid(self, points: int) -> Array:
        """Levels evenly spaced in logarithm over the range of the trials.

        Returns:
            Shape (points, 1), or (points^2, 2) with the first measure running slowest.
        """
        axes = [
            np.geomspace(a, b, points) if b > a else np.full(points, a)
            for a, b in zip(self.low, self.high, strict=True)
        ]
        mesh = np.meshgrid(*axes, indexing="ij")
        return np.stack([part.ravel() for part in mesh], axis=1)


def _checked(measures: ArrayLike, count: int) -> Array:
    values = real_argument(measures, "intensities", ResultError)
    if values.ndim == 1 and count == 1:
        values = values[:, None]
    if values.ndim != 2 or values.shape[1] != count:
        raise ResultError(f"intensities have shape {np.shape(measures)}, wanted is (n, {count})")
    if not (np.isfinite(values) & (values > 0)).all():
        raise ResultError("intensities must be finite and above 0; leave other trials out")
    return values


def _terms(scaled: Array, quadratic: bool) -> Array:
    columns = [np.ones(len(scaled)), *scaled.T]
    if scaled.shape[1] == 2 and quadratic:
        a, b = scaled.T
        columns += [a * a, a * b, b * b]
    return np.stack(columns, axis=1)


def _reach(terms: Array, posterior: _Posterior, level: float) -> Array:
    """Half the normal interval of linear combinations of the coefficients, shape (n,)."""
    from scipy.stats import norm, t

    tail = 0.5 * (1.0 + level)

    def error(covariance: Array) -> Array:
        variance = np.einsum("ni,ij,nj->n", terms, covariance, terms)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    wide: Array = norm.ppf(tail) * error(posterior.model)
    if posterior.degrees > 0:
        wide = np.maximum(wide, t.ppf(tail, posterior.degrees) * error(posterior.clustered))
    return wide


def fit_fragility(
    measures: ArrayLike,
    overturned: ArrayLike,
    groups: ArrayLike,
    *,
    names: Sequence[str] = ("pga_g",),
    level: float = INTERVALS.level,
    surface: Literal["quadratic", "linear"] = "quadratic",
) -> FragilityFit:
    """Fit a fragility curve or surface.

    Where all trials ended alike there is no curve: the probability is (overturned + 1/2) / (n + 1)
    throughout, with an interval of Jeffreys' posterior.

    Args:
        measures: above 0, shape (n,) or (n, k) with k = 1 or 2.
        overturned: boolean, shape (n,).
        groups: ground motion of each trial, shape (n,).
        names: of the measures.
        level: of the bands.
        surface: terms in two measures; a curve is linear.

    Raises:
        ResultError: shapes that do not fit, no trials, or a measure that is not above 0.
    """
    values = _checked(measures, len(names))
    truth, member = _outcomes(overturned, groups, len(values))
    if not 0 < level < 1:
        raise ResultError(f"level {level} must lie between 0 and 1")
    logs = np.log(values)
    center, spread = logs.mean(axis=0), logs.std(axis=0)
    spread[spread < 1e-9] = 1.0
    scaled = (logs - center) / spread
    quadratic = surface == "quadratic"
    terms = _terms(scaled, quadratic)
    motions = int(member.max()) + 1
    note: FitNote | None = None
    separated = False
    posterior: _Posterior | None = None
    interval: tuple[float, float, float] | None = None
    if truth.all() or not truth.any():
        note = FitNote.ALL_OVERTURNED if truth.all() else FitNote.ALL_STOOD
        interval = _constant(truth, level)
    else:
        posterior = _fit(terms, truth, member, level)
        linear = terms @ posterior.mode
        separated = bool(linear[truth].min() > linear[~truth].max())
    lognormal = None
    if len(names) == 1 and posterior is not None:
        lognormal = _lognormal(posterior, level, float(center[0]), float(spread[0]))
        if lognormal is None:
            note = FitNote.NOT_RISING
        elif not separated and not _straight(scaled, truth, member, level):
            lognormal = replace(lognormal, fits=False)
    fit = FragilityFit(
        names=tuple(names),
        trials=int(truth.size),
        overturned=int(truth.sum()),
        groups=motions,
        separated=separated,
        note=note,
        falling=(),
        low=values.min(axis=0),
        high=values.max(axis=0),
        lognormal=lognormal,
        _center=center,
        _spread=spread,
        _level=level,
        _points=scaled,
        _quadratic=quadratic,
        _posterior=posterior,
        _interval=interval,
    )
    return replace(fit, falling=_falling(fit)) if len(names) == 2 and note is None else fit


def _outcomes(
    overturned: ArrayLike, groups: ArrayLike, count: int
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Outcomes, and the number of each trial's group."""
    truth = truth_argument(overturned, "overturned", ResultError)
    labels = label_argument(groups, "groups", ResultError)
    member = np.unique(labels, return_inverse=True)[1]
    if not count == truth.size == member.size or not truth.size:
        raise ResultError(
            f"{count} intensities, {counted(truth.size, 'outcome')} and "
            f"{counted(member.size, 'group')}; give one each"
        )
    return truth, member


def _falling(fit: FragilityFit) -> tuple[str, ...]:
    """Measures with which the probability falls by more than `FIT.fall` amid the trials."""
    count = FIT.fall_grid
    levels = fit.grid(count)
    probability = np.where(fit.inside(levels), fit.probability(levels)[0], np.nan)
    grid = probability.reshape(count, count)
    found = []
    for axis, name in enumerate(fit.names):
        # Outside counts as 0 on the way up, so that it starts no fall.
        highest = np.maximum.accumulate(np.nan_to_num(grid), axis=axis)
        if np.nanmax(highest - grid, initial=0.0) > FIT.fall:
            found.append(name)
    return tuple(found)


def _constant(truth: NDArray[np.bool_], level: float) -> tuple[float, float, float]:
    """Lower end, probability, upper end by Jeffreys' posterior."""
    from scipy.stats import beta

    count, hits = truth.size, int(truth.sum())
    tail = 0.5 * (1.0 - level)
    low, high = beta.ppf([tail, 1.0 - tail], hits + 0.5, count - hits + 0.5)
    return float(low), (hits + 0.5) / (count + 1.0), float(high)


def _fit(
    terms: Array, truth: NDArray[np.bool_], member: NDArray[np.intp], level: float
) -> _Posterior:
    import statsmodels.api as sm
    from scipy.special import ndtr
    from scipy.stats import norm, t

    size = terms.shape[1]
    prior = np.concatenate([FIT.prior_location * np.eye(size)] * 2)
    design = np.concatenate([terms, prior])
    response = np.concatenate([truth.astype(float), np.ones(size), np.zeros(size)])
    weight = np.concatenate([np.ones(len(terms)), np.full(2 * size, 0.5)])
    family = sm.families.Binomial(link=sm.families.links.Probit())
    with warnings.catch_warnings():
        # Steps on the way may overshoot where the outcomes are separated; the end is checked.
        warnings.simplefilter("ignore")
        found = sm.GLM(response, design, family=family, freq_weights=weight).fit(
            maxiter=FIT.iterations, tol=FIT.converged
        )
    coefficients = np.asarray(found.params, dtype=np.float64)
    model = np.asarray(found.cov_params(), dtype=np.float64)
    if not (np.isfinite(coefficients).all() and np.isfinite(model).all()):
        raise ResultError(
            "the fragility fit does not converge; leave out a measure, or give more trials"
        )
    linear = terms @ coefficients
    share = np.clip(ndtr(linear), 1e-12, 1.0 - 1e-12)
    density = np.exp(-0.5 * linear**2) / np.sqrt(2.0 * np.pi)
    score = terms * ((truth - share) * density / (share * (1.0 - share)))[:, None]
    count = int(member.max()) + 1
    sums = np.zeros((count, size))
    np.add.at(sums, member, score)
    middle = sums.T @ sums * (count / max(count - 1, 1))
    clustered = model @ middle @ model
    power = 1.0
    if count > 1:
        tail = 0.5 * (1.0 + level)
        wider = float((t.ppf(tail, count - 1) / norm.ppf(tail)) ** 2)
        effect = float(np.trace(middle @ model)) / size
        power = 1.0 / max(1.0, wider * effect)
    distinct, which = np.unique(design, axis=0, return_inverse=True)
    which = which.ravel()
    return _Posterior(
        mode=coefficients,
        model=model,
        clustered=clustered,
        degrees=count - 1,
        power=power,
        terms=distinct,
        hits=np.bincount(which, weights=weight * response).astype(np.float64),
        misses=np.bincount(which, weights=weight * (1.0 - response)).astype(np.float64),
    )


def _lognormal(
    posterior: _Posterior, level: float, center: float, spread: float
) -> Lognormal | None:
    a, b = (float(value) for value in posterior.mode)
    if b <= 0:
        return None
    # probit P = a + b (ln x - center) / spread: gradients of ln median and ln beta in (a, b).
    ln_median, ln_beta = center - spread * a / b, np.log(spread / b)
    gradients = np.array([[-spread / b, spread * a / b**2], [0.0, -1.0 / b]])
    reach = _reach(gradients, posterior, level)
    with np.errstate(over="ignore"):
        ends = np.exp(
            np.array([ln_median, ln_beta])[:, None] + reach[:, None] * np.array([-1.0, 0.0, 1.0])
        )
    (low, median, high), (narrow, beta, wide) = ends.tolist()
    return Lognormal(median, low, high, beta, narrow, wide, fits=True)


def _straight(
    scaled: Array, truth: NDArray[np.bool_], member: NDArray[np.intp], level: float
) -> bool:
    """Whether square and cube of the logarithm add nothing significant (Wald's test of both)."""
    from scipy.stats import chi2

    x = scaled[:, 0]
    if np.unique(x).size < FIT.fewest_levels:
        return True
    found = _fit(np.stack([np.ones_like(x), x, x**2, x**3], axis=1), truth, member, level)
    curved = found.mode[2:]
    least = min(
        float(curved @ np.linalg.pinv(covariance[2:, 2:]) @ curved)
        for covariance in (found.model, found.clustered)
    )
    return bool(least < chi2.ppf(FIT.significant, 2))
