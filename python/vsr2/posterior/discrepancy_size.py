"""How much a campaign differs from its engine beyond contact models, inferred from its summaries.

The size of the disturbance is drawn for each campaign (:mod:`vsr2.posterior.discrepancy`). Its
logarithm is regressed on the summaries of simulated campaigns. Intervals are what the regression
missed in campaigns that it did not see: split conformal prediction (J. Lei et al.,
"Distribution-free predictive inference for regression", J. Am. Stat. Assoc. 113, 2018).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis.intervals import INTERVALS
from vsr2.ensemble.simulated.linear_algebra import ridge
from vsr2.posterior.discrepancy import DISCREPANCY
from vsr2.posterior.summaries import SUMMARY

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DiscrepancySizeConstants:
    """How the size is regressed; chosen by hand.

    Attributes:
        penalty: of the ridge regression, in campaigns.
    """

    penalty: float = 30.0


DISCREPANCY_SIZE = DiscrepancySizeConstants()


class DiscrepancyInterval(NamedTuple):
    """Standard deviation of the logarithm of a largest tilt between correct simulators [1].

    Attributes:
        median: of it.
        low, high: ends of its 95 % interval.
    """

    median: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class DiscrepancySize:
    """The regression, and what it misses.

    Attributes:
        constant: of the regression of the logarithm of the factor on `DISCREPANCY.parts`.
        coefficients: of the networks' inputs, shape (inputs,).
        missed: logarithms less the regressed ones, of campaigns not seen, rising, shape (n,).
    """

    constant: float
    coefficients: Array
    missed: Array

    @classmethod
    def of(cls, inputs: Array, factor: Array, fold: NDArray[np.int64]) -> Self:
        """From simulated campaigns.

        Args:
            inputs: of the networks, of a disturbed copy, shape (n, inputs).
            factor: by which that copy is disturbed, shape (n,).
            fold: group of each campaign.
        """
        logs = np.log(factor)
        missed = np.zeros(len(logs))
        for k in range(SUMMARY.folds):
            own = fold == k
            constant, coefficients = _regressed(inputs[~own], logs[~own])
            missed[own] = logs[own] - constant - inputs[own] @ coefficients
        return cls(*_regressed(inputs, logs), np.sort(missed))

    def interval(self, inputs: Array) -> DiscrepancyInterval:
        """Of one campaign, within the sizes that are drawn.

        Args:
            inputs: of the networks, shape (inputs,).
        """
        logs = self.constant + inputs @ self.coefficients
        logs += np.quantile(self.missed, (0.5, *INTERVALS.ends))
        factor = np.clip(np.exp(logs), DISCREPANCY.least, DISCREPANCY.most)
        return DiscrepancyInterval(*(factor * np.linalg.norm(DISCREPANCY.parts)).tolist())


def _regressed(inputs: Array, logs: Array) -> tuple[float, Array]:
    """Constant and coefficients of a ridge regression."""
    centre, mean = inputs.mean(axis=0), float(logs.mean())
    own = ridge(inputs - centre, (logs - mean)[:, None], DISCREPANCY_SIZE.penalty)[:, 0]
    return mean - float(centre @ own), own
