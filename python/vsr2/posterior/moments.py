"""Means and variances of campaigns that are too many to be held twice."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.ensemble.simulated.linear_algebra import blocks

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Moments:
    """Of what is known in some campaigns, so that those of more campaigns follow by addition.

    Two groups are combined as in T. F. Chan, G. H. Golub, R. J. LeVeque, "Algorithms for computing
    the sample variance: analysis and recommendations", The American Statistician 37, 1983.

    Attributes:
        count: of campaigns in which a value is known.
        mean: of these, 0 where there are none.
        squares: sum of their squared deviations from it.
    """

    count: Array
    mean: Array
    squares: Array

    @classmethod
    def of(cls, values: NDArray[np.floating[Any]]) -> Moments:
        """Of campaigns in any precision, shape (n, ...), to (...)."""
        zero = np.zeros(values.shape[1:])
        out = cls(zero, zero, zero)
        for rows in blocks(len(values), zero.size):
            part = values[rows].astype(np.float64)
            known = np.isfinite(part)
            count = known.sum(axis=0).astype(np.float64)
            mean = np.where(known, part, 0.0).sum(axis=0) / np.maximum(count, 1)
            squares = (np.where(known, part - mean, 0.0) ** 2).sum(axis=0)
            out = out + cls(count, mean, squares)
        return out

    def __add__(self, other: Moments) -> Moments:
        """Of both groups together."""
        count = self.count + other.count
        share = other.count / np.maximum(count, 1)
        apart = other.mean - self.mean
        return Moments(
            count,
            self.mean + apart * share,
            self.squares + other.squares + apart**2 * self.count * share,
        )

    @property
    def variance(self) -> Array:
        """0 where nothing is known."""
        return np.asarray(self.squares / np.maximum(self.count, 1))
