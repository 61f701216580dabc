"""Overturning margins: by how much a motion may grow before the rock overturns.

An outcome is one bit; the factor on the motion at which it turns is a number. Its mean over
replicates, which differ chaotically near the boundary, tells how near to it a trial is. The
probability of overturning is that of a normal variable: what motion and rock differ from the scene
by, as a logarithm of the factor, exceeds the margin. This is the fragility function of a single
trial (J. W. Baker, "Efficient analytical fragility function fitting using dynamic structural
analysis", Earthquake Spectra 31, 2015).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsr2.campaign.folds import grouped_folds

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
    """

    lapse: float = 0.01
    bias: float = 0.2
    scatter: float = 0.15
    spread: float = 0.7


MARGIN = MarginConstants()


@dataclass(frozen=True)
class MarginModel:
    """From margins to probabilities.

    Attributes:
        bias: logarithm of the factor by which the real motion is stronger than the scene's.
        scatter: standard deviation of that logarithm from trial to trial.
    """

    bias: float = 0.0
    scatter: float = MARGIN.scatter

    def probability(self, margin: ArrayLike) -> Array:
        """Of overturning, (1 - lapse) Phi((bias - margin) / scatter) + lapse / 2, shape (trials,).

        Args:
            margin: logarithm of the factor at which each trial overturns, shape (trials,).
        """
        from scipy.special import ndtr

        normal = ndtr((self.bias - np.asarray(margin, dtype=np.float64)) / self.scatter)
        return np.asarray((1 - MARGIN.lapse) * normal + 0.5 * MARGIN.lapse)


def fit_margin_model(margin: ArrayLike, overturned: ArrayLike) -> MarginModel:
    """The most probable bias and scatter.

    Args:
        margin: of each trial, shape (trials,).
        overturned: 1 or 0, NaN where unknown, shape (trials,).
    """
    from scipy.optimize import minimize

    margins, ends = np.asarray(margin, dtype=np.float64), np.asarray(overturned, dtype=np.float64)
    known = np.isfinite(ends) & np.isfinite(margins)
    margins, fell = margins[known], ends[known] > 0.5

    def cost(theta: Array) -> float:
        bias, log_scatter = float(theta[0]), float(theta[1])
        p = MarginModel(bias, float(np.exp(log_scatter))).probability(margins)
        prior = (bias / MARGIN.bias) ** 2
        prior += ((log_scatter - np.log(MARGIN.scatter)) / MARGIN.spread) ** 2
        return float(0.5 * prior - np.log(np.where(fell, p, 1 - p)).sum())

    found = minimize(cost, np.array([0.0, np.log(MARGIN.scatter)]), method="Nelder-Mead")
    return MarginModel(float(found.x[0]), float(np.exp(found.x[1])))


def out_of_fold_probability(
    margin: ArrayLike, overturned: ArrayLike, motions: ArrayLike, folds: int
) -> Array:
    """Probability of each trial by a model fitted to the trials of other motions.

    Args:
        margin: of each trial, shape (trials,).
        overturned: 1 or 0, NaN where unknown, shape (trials,).
        motions: ground motion of each trial, shape (trials,).
        folds: groups of motions.

    Returns:
        Shape (trials,).
    """
    margins, ends = np.asarray(margin, dtype=np.float64), np.asarray(overturned, dtype=np.float64)
    fold = grouped_folds(motions, ends, folds)
    out = np.zeros(margins.size)
    for k in np.unique(fold):
        other = fold != k
        out[~other] = fit_margin_model(margins[other], ends[other]).probability(margins[~other])
    return out
