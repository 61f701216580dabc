"""Novelty: whether a campaign fits its best hypothesis worse than the library's own campaigns do.

A conformal test (V. Vovk et al., "Algorithmic Learning in a Random World", 2005). What it says of a
cause outside the library is measured by leaving each effect out in turn: then its simulated
campaigns stand for causes outside the library, and the best that is left explains them or not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEVEL = 0.05
"""Of the test."""
PRIOR = 0.15
"""Prior probability of a cause that the library lacks."""
_LEAST_ALIKE = 24
"""Fewer campaigns cannot show a significance of 0.05 with any margin."""
_LEAST_NEAR = 40


@dataclass(frozen=True, eq=False)
class Misfit:
    """How badly the library's campaigns fit their best hypotheses, on emulators without them.

    Attributes:
        statistics: of misfit, shape (rows, statistics).
        best: index of the best hypothesis, shape (rows,).
        strength: see `strengths`, shape (rows,).
        weight: of each campaign, shape (rows,).
    """

    statistics: Array
    best: NDArray[np.int64]
    strength: Array
    weight: Array

    def p_value(self, value: Array, best: int, strength: float) -> float:
        """Share of the library's campaigns that fit no better.

        Of those whose effect is about as strong, because the emulator's error grows with it, and of
        those with the same best label, because an effect whose outcomes cannot be predicted (labels
        noted wrongly) leaves every one of its campaigns with a poor fit. The larger share counts.

        Args:
            value: statistics of the campaign, shape (statistics,).
            best: index of its best hypothesis.
            strength: of its effect.
        """
        centre = np.median(self.statistics, axis=0)
        spread = np.quantile(self.statistics, 0.9, axis=0) - centre
        scale = np.maximum(spread, 1e-9)
        null = ((self.statistics - centre) / scale).max(axis=1)
        own = float(((value - centre) / scale).max())
        gap = np.abs(np.log1p(self.strength) - np.log1p(strength))
        count = min(max(_LEAST_NEAR, gap.size // 8), gap.size)
        near = np.argsort(gap, kind="stable")[:count]
        shares = [_share(null[near], own, self.weight[near])]
        alike = self.best == best
        if alike.sum() >= _LEAST_ALIKE:
            shares.append(_share(null[alike], own, np.ones(int(alike.sum()))))
        return float(max(shares))

    def p_values(self, values: Array, best: NDArray[np.int64], strength: Array) -> Array:
        """The same of many campaigns, shape (campaigns,)."""
        rows = zip(values, best, strength, strict=True)
        return np.array([self.p_value(v, int(b), float(s)) for v, b, s in rows])


@dataclass(frozen=True, eq=False)
class OutOfLibrary:
    """What misfit says of a cause outside the library.

    The log likelihood ratio of campaigns from outside the library against the library's own is
    taken as linear in the logarithms of the p value and of the strength, and in their product
    (logistic regression).

    Attributes:
        weights: of 1, ln p, ln(1 + S^2) and ln p ln(1 + S^2); they give the log likelihood ratio.
        detection_rate: share of the former with a gap that the test detects; None: there are none.
    """

    weights: Array
    detection_rate: float | None

    def probability(self, p_value: Array, strength: Array, prior: float = PRIOR) -> Array:
        """That campaigns with these p values and strengths come from outside the library."""
        from scipy.special import expit, logit

        return np.asarray(expit(_terms(p_value, strength) @ self.weights + logit(prior)))


def fit_out_of_library(
    known: tuple[Array, Array],
    weight: Array,
    left_out: tuple[Array, Array],
    shows_gap: NDArray[np.bool_],
) -> OutOfLibrary:
    """Learn from the library's campaigns, each as it is and with its effect left out.

    Args:
        known: p values and strengths, each shape (rows,).
        weight: of the known campaigns, shape (rows,).
        left_out: p values and strengths where its effect is left out, each shape (campaigns,).
        shows_gap: which of the latter show a gap at all, shape (campaigns,).
    """
    from sklearn.linear_model import LogisticRegression

    if not left_out[0].size:
        return OutOfLibrary(np.zeros(4), None)
    x = np.concatenate([_terms(*known), _terms(*left_out)])
    y = np.repeat([0, 1], [known[0].size, left_out[0].size])
    each = np.concatenate([weight / weight.sum(), np.full(left_out[0].size, 1 / left_out[0].size)])
    model = LogisticRegression(C=10.0, fit_intercept=False, max_iter=500)
    model.fit(x, y, sample_weight=each * x.shape[0])
    loud = left_out[0][shows_gap]
    detection_rate = float(np.mean(loud <= LEVEL)) if loud.size else None
    return OutOfLibrary(np.asarray(model.coef_[0], dtype=np.float64), detection_rate)


def _terms(p_value: Array, strength: Array) -> Array:
    log_p, log_s = np.log(p_value), np.log1p(strength)
    return np.stack([np.ones_like(log_p), log_p, log_s, log_p * log_s], axis=-1)


def _share(null: Array, own: float, weight: Array) -> float:
    """Weighted share of null values at or above `own`, which counts once: never 0."""
    relative = weight / weight.mean()
    return float((relative[null >= own].sum() + 1) / (relative.sum() + 1))
