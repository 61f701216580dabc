"""Overturning margins: by how much a motion may grow before the rock overturns.

An outcome is one bit; the factor on the motion at which it turns is a number. Its mean over
replicates, which differ chaotically near the boundary, tells how near to it a trial is. The
probability of overturning is that of a normal variable: what motion and rock differ from the scene
by, as a logarithm of the factor, exceeds the margin. This is the fragility function of a single
trial (J. W. Baker, "Efficient analytical fragility function fitting using dynamic structural
analysis", Earthquake Spectra 31, 2015).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsr2.campaign.folds import grouped_folds
from vsr2.errors import ResultError
from vsr2.read_only import label_argument, real_argument

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MarginConstants:
    """How margins become probabilities; chosen by hand.

    Attributes:
        lapse: probability that an outcome has nothing to do with the margin, such as a slip of a
            pen, so that the logarithmic loss is finite.
        bias: standard deviation of the prior of the bias, about 0: scenes are a fifth off.
        scatter: median of the prior of the scatter: that of intensity measures' thresholds of
            equal rocks is some .1 to .3.
        spread: standard deviation of the logarithm of the scatter, in that prior.
        tilts: standard deviations of the logarithms of weights, of which one is chosen by folds of
            the trials that are fitted.
        folds: of motions there.
    """

    lapse: float = 0.01
    bias: float = 0.2
    scatter: float = 0.15
    spread: float = 0.7
    tilts: tuple[float, ...] = (0.0, 0.5, 1.0, 2.0)
    folds: int = 5


MARGIN = MarginConstants()


@dataclass(frozen=True)
class MarginModel:
    """From margins to probabilities.

    Attributes:
        bias: logarithm of the factor by which the real motion is stronger than the scene's.
        scatter: standard deviation of that logarithm from trial to trial.
        weights: of the replicates in the mean margin, which sum to 1; empty: equal ones.
    """

    bias: float = 0.0
    scatter: float = MARGIN.scatter
    weights: tuple[float, ...] = ()

    def mean(self, margins: ArrayLike) -> Array:
        """Weighted mean over replicates with a margin, NaN where none has one, shape (trials,).

        Args:
            margins: NaN where a simulation failed, shape (replicates, trials).

        Raises:
            ResultError: margins that are no real numbers.
        """
        given = real_argument(margins, "margins", ResultError)
        weights = np.array(self.weights or [1.0] * len(given))
        with np.errstate(invalid="ignore"):
            return np.asarray(weights @ np.nan_to_num(given) / (weights @ np.isfinite(given)))

    def probability(self, margins: ArrayLike) -> Array:
        """Of overturning, (1 - lapse) Phi((bias - mean) / scatter) + lapse / 2, shape (trials,).

        Where no replicate has a margin it is 1/2.

        Args:
            margins: logarithm of the factor at which each replicate overturns, shape (replicates,
                trials).
        """
        from scipy.special import ndtr

        normal = np.nan_to_num(ndtr((self.bias - self.mean(margins)) / self.scatter), nan=0.5)
        return np.asarray((1 - MARGIN.lapse) * normal + 0.5 * MARGIN.lapse)


def seek_margins(
    overturns: Callable[[Array], Array],
    shape: tuple[int, ...],
    ends: tuple[float, float],
    halvings: int,
) -> Array:
    """Margins by halving a range; each is good to half of what is left of it.

    Args:
        overturns: called with logarithms of factors on motions, gives 1, 0, or NaN where a
            simulation failed, both of the shape asked for.
        shape: of the margins.
        ends: of the range.
        halvings: calls.

    Returns:
        Margins, NaN where a simulation failed. One beyond the range lies next to its end.
    """
    low, high = (np.full(shape, end) for end in ends)
    failed = np.zeros(shape, dtype=bool)
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        fell = overturns(middle)
        failed |= np.isnan(fell)
        low, high = np.where(fell > 0.5, low, middle), np.where(fell > 0.5, middle, high)
    return np.where(failed, np.nan, 0.5 * (low + high))


def fit_margin_model(
    margins: ArrayLike,
    overturned: ArrayLike,
    motions: ArrayLike | None = None,
    *,
    biased: bool = True,
) -> MarginModel:
    """The most probable bias, scatter and weights.

    Replicates that draw much of what is uncertain of a scene are not equally near to the truth.
    Their weights have a prior about equal ones; how tight it is, is chosen by folds. To weight
    predictors by how they predict together is stacking (Y. Yao et al., "Using stacking to average
    Bayesian predictive distributions", Bayesian Analysis 13, 2018).

    Args:
        margins: of each trial, NaN where a simulation failed, shape (replicates, trials).
        overturned: 1 or 0, NaN where unknown, shape (trials,).
        motions: ground motion of each trial, shape (trials,); None: weights are equal.
        biased: whether the real motion may be stronger or weaker; else the bias is 0.

    Raises:
        ResultError: margins or outcomes that are no real numbers.
    """
    given = real_argument(margins, "margins", ResultError)
    ends = real_argument(overturned, "overturned", ResultError, truths=True)
    known = np.isfinite(ends) & np.isfinite(given).any(axis=0)
    if not known.any():
        return MarginModel()
    given, fell = given[:, known], ends[known] > 0.5
    tilt = MARGIN.tilts[0]
    if motions is not None and len(given) > 1:
        groups = label_argument(motions, "motions", ResultError)[known]
        folds = min(MARGIN.folds, np.unique(groups).size)
        if folds > 1:
            fold = grouped_folds(groups, fell.astype(float), folds)
            losses = [
                sum(
                    _loss(_fitted(given[:, fold != k], fell[fold != k], one, biased=biased),
                          given[:, fold == k], fell[fold == k])
                    for k in range(folds)
                )
                for one in MARGIN.tilts
            ]  # fmt: skip
            tilt = MARGIN.tilts[int(np.argmin(losses))]
    return _fitted(given, fell, tilt, biased=biased)


def _loss(model: MarginModel, margins: Array, fell: NDArray[np.bool_]) -> float:
    p = model.probability(margins)
    return float(-np.log(np.where(fell, p, 1 - p)).sum())


def _fitted(margins: Array, fell: NDArray[np.bool_], tilt: float, *, biased: bool) -> MarginModel:
    from scipy.optimize import minimize
    from scipy.special import softmax

    count = len(margins) if tilt > 0 else 0
    width = MARGIN.bias if biased else 0.0

    def model(theta: Array) -> MarginModel:
        weights = tuple(softmax(tilt * theta[2:]).tolist()) if count else ()
        return MarginModel(width * theta[0], _scatter(theta[1]), weights)

    def cost(theta: Array) -> tuple[float, Array]:
        made = model(theta)
        mean, p = made.mean(margins), made.probability(margins)
        u = (made.bias - mean) / made.scatter
        # By u: of minus the log likelihood.
        slope = np.where(fell, -1 / p, 1 / (1 - p)) * (1 - MARGIN.lapse)
        slope *= np.exp(-0.5 * u**2) / np.sqrt(2 * np.pi)
        found = theta.copy()
        found[0] += width * slope.sum() / made.scatter
        found[1] -= MARGIN.spread * (slope * u).sum()
        if count:
            # A trial's mean is over what is known of it.
            share = np.array(made.weights) @ np.isfinite(margins)
            away = np.nan_to_num(margins - mean) @ (-slope / made.scatter / share)
            found[2:] += tilt * np.array(made.weights) * away
        return 0.5 * float(theta @ theta) + _loss(made, margins, fell), found

    found = minimize(cost, np.zeros(2 + count), jac=True, method="L-BFGS-B")
    return model(found.x)


def _scatter(z: float) -> float:
    return float(MARGIN.scatter * np.exp(MARGIN.spread * z))


def out_of_fold_probability(
    margins: ArrayLike,
    overturned: ArrayLike,
    motions: ArrayLike,
    folds: int,
    *,
    biased: bool = True,
) -> Array:
    """Probability of each trial by a model fitted to the trials of other motions.

    Args:
        margins: of each trial, shape (replicates, trials).
        overturned: 1 or 0, NaN where unknown, shape (trials,).
        motions: ground motion of each trial, shape (trials,).
        folds: groups of motions.
        biased: as for :func:`fit_margin_model`.

    Returns:
        Shape (trials,).

    Raises:
        ResultError: margins or outcomes that are no real numbers.
    """
    given = real_argument(margins, "margins", ResultError)
    ends = real_argument(overturned, "overturned", ResultError, truths=True)
    groups = label_argument(motions, "motions", ResultError)
    fold = grouped_folds(groups, ends, folds)
    out = np.zeros(ends.size)
    for k in np.unique(fold):
        other = fold != k
        model = fit_margin_model(given[:, other], ends[other], groups[other], biased=biased)
        out[~other] = model.probability(given[:, ~other])
    return out
