"""Agreement of predicted with observed outcomes (supplement S3)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vsr2.errors import ResultError
from vsr2.one_line import counted
from vsr2.read_only import truth_argument


@dataclass(frozen=True)
class Classification:
    """Counts of a two-way classification, overturned being positive, and what S3 derives from them.

    A ratio whose denominator is 0 is NaN: it is unknown, neither 0 nor 1. The objective is NaN
    where one of its three parts is.

    Attributes:
        true_positives: overturned, and predicted so.
        false_positives: predicted to overturn, but did not.
        false_negatives: overturned, but not predicted to.
        true_negatives: neither.
    """

    true_positives: int
    false_positives: int
    false_negatives: int
    true_negatives: int

    @property
    def trials(self) -> int:
        """Number of trials."""
        return (
            self.true_positives + self.false_positives + self.false_negatives + self.true_negatives
        )

    @property
    def accuracy(self) -> float:
        """Share of trials predicted rightly; NaN: no trials."""
        return _ratio(self.true_positives + self.true_negatives, self.trials)

    @property
    def precision(self) -> float:
        """Share of the predicted overturnings that were observed; NaN: none was predicted."""
        return _ratio(self.true_positives, self.true_positives + self.false_positives)

    @property
    def recall(self) -> float:
        """Share of the observed overturnings that were predicted; NaN: none was observed."""
        return _ratio(self.true_positives, self.true_positives + self.false_negatives)

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall, 2 TP / (2 TP + FP + FN).

        NaN: none was observed or predicted. It is 0 where only one of the two is unknown.
        """
        both = 2 * self.true_positives
        return _ratio(both, both + self.false_positives + self.false_negatives)

    @property
    def objective(self) -> float:
        """Unweighted mean of accuracy, precision and recall, which S3 maximises."""
        return (self.accuracy + self.precision + self.recall) / 3.0


def _ratio(part: int, total: int) -> float:
    return part / total if total else math.nan


def classification_metrics(observed: ArrayLike, predicted: ArrayLike) -> Classification:
    """Compare predicted with observed overturning.

    Args:
        observed: whether each trial overturned, boolean, shape (n,).
        predicted: whether it was predicted to, boolean, shape (n,). Leave trials without an outcome
            (`failed`) out of both and say how many: they count for neither side.

    Raises:
        ResultError: not boolean, masked, not of one dimension, or of different lengths.
    """
    truth = truth_argument(observed, "observed", ResultError)
    guess = truth_argument(predicted, "predicted", ResultError)
    if truth.shape != guess.shape:
        raise ResultError(f"observed has {counted(truth.size, 'trial')}, predicted {guess.size}")
    return Classification(
        true_positives=int(np.count_nonzero(truth & guess)),
        false_positives=int(np.count_nonzero(~truth & guess)),
        false_negatives=int(np.count_nonzero(truth & ~guess)),
        true_negatives=int(np.count_nonzero(~truth & ~guess)),
    )
