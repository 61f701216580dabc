"""Novelty: whether a campaign fits its best hypothesis worse than the library's own campaigns do.

A conformal test (V. Vovk et al., "Algorithmic Learning in a Random World", 2005). What it can
notice is measured by leaving each effect out of the library in turn: then its simulated campaigns
are strangers, and the best that is left explains them or does not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEVEL = 0.05
"""Of the test."""
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
        those with the same best label, because an effect whose outcomes cannot be foretold (labels
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


@dataclass(frozen=True, eq=False)
class Strangers:
    """The test on campaigns whose effect was left out of the library.

    Attributes:
        p_values: of those that show a gap, sorted.
    """

    p_values: Array

    @property
    def noticed(self) -> float | None:
        """Share that the test notices; None: there are none."""
        if not self.p_values.size:
            return None
        return float(np.mean(self.p_values <= LEVEL))

    def probability(self, p_value: float) -> float:
        """That a campaign with this p value is a stranger, if strangers are as many as others."""
        at = np.count_nonzero(self.p_values <= p_value) + 0.5
        share = at / (self.p_values.size + 1)
        return float(share / (share + p_value))


def _share(null: Array, own: float, weight: Array) -> float:
    """Weighted share of null values at or above `own`, which counts once: never 0."""
    relative = weight / weight.mean()
    return float((relative[null >= own].sum() + 1) / (relative.sum() + 1))
