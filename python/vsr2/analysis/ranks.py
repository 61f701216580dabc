"""Ranks of true values among posterior samples, and whether they are uniform.

Simulation-based calibration (S. Talts, M. Betancourt, D. Simpson, A. Vehtari, A. Gelman,
"Validating Bayesian inference algorithms with simulation-based calibration", arXiv:1804.06788,
2018): where the truth is drawn from the prior and samples from the posterior, the rank is uniform.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsr2.analysis.intervals import INTERVALS
from vsr2.errors import ResultError
from vsr2.read_only import real_argument

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RankRules:
    """How uniformity is judged; all are choices, none is fitted.

    Attributes:
        points: at which the distribution of ranks is compared with the uniform one: 5 % apart.
        level: of the band that holds all points at once: that of intervals.
        draws: of uniform ranks, that say how far these scatter: the level of the band is then known
            to sqrt(0.95 x 0.05 / 4000), 0.3 %.
        seed: of these draws, beside the number of ranks.
    """

    points: int = 19
    level: float = INTERVALS.level
    draws: int = 4000
    seed: int = 51


RANKS = RankRules()


@dataclass(frozen=True, eq=False)
class Uniformity:
    """Ranks against the uniform distribution.

    Attributes:
        count: of ranks.
        p_value: probability that uniform ranks lie as far off at some point, or farther.
        points: in (0, 1), shape (points,).
        share: of ranks up to each, shape (points,).
        low, high: band that holds uniform ranks at all points at once, shape (points,).
    """

    count: int
    p_value: float
    points: Array
    share: Array
    low: Array
    high: Array


def rank(samples: ArrayLike, truth: float, rng: np.random.Generator) -> float:
    """Share of samples below the truth; its place among equal ones is drawn, and within a step.

    Of a truth that is one more sample it is uniform on (0, 1) [1].

    Args:
        samples: shape (n,).
        truth: the true value.
        rng: of the draw.

    Raises:
        ResultError: samples that are no real numbers.
    """
    values = real_argument(samples, "samples", ResultError)
    below, equal = int((values < truth).sum()), int((values == truth).sum())
    return float((below + rng.random() * (equal + 1)) / (values.size + 1))


def uniformity(ranks: ArrayLike) -> Uniformity:
    """Whether ranks are uniform on (0, 1).

    The number of ranks up to each point is binomial. The least of the two-sided tail probabilities
    over all points is compared with that of uniform ranks, drawn by a seed of its own; its quantile
    gives the band (T. Saeilynoja, P.-C. Buerkner, A. Vehtari, "Graphical test for discrete
    uniformity and its applications in goodness-of-fit evaluation and multiple sample comparison",
    Statistics and Computing 32, 2022).

    Args:
        ranks: independent, shape (n,), at least one.

    Raises:
        ResultError: ranks that are no real numbers.
    """
    from scipy.stats import binom

    values = real_argument(ranks, "ranks", ResultError)
    count = values.size
    points, least = np.arange(1, RANKS.points + 1) / (RANKS.points + 1), _least_tails(count)
    found = _least_tail((values[:, None] <= points).sum(axis=0)[None], count)[0]
    tail = float(np.quantile(least, 1 - RANKS.level)) / 2
    return Uniformity(
        count,
        float((1 + (least <= found * (1 + 1e-9)).sum()) / (1 + least.size)),
        points,
        np.asarray((values[:, None] <= points).mean(axis=0)),
        np.asarray(binom.ppf(tail, count, points) / count),
        np.asarray(binom.isf(tail, count, points) / count),
    )


@lru_cache(maxsize=256)
def _least_tails(count: int) -> Array:
    """Of so many uniform ranks, `RANKS.draws` times."""
    # Counts up to the points are sums of a multinomial over the cells between them.
    rng = np.random.default_rng([count, RANKS.seed])
    cells = np.full(RANKS.points + 1, 1 / (RANKS.points + 1))
    return _least_tail(rng.multinomial(count, cells, RANKS.draws).cumsum(axis=1)[:, :-1], count)


def _least_tail(counts: NDArray[np.int64], count: int) -> Array:
    """Least two-sided tail probability of counts up to the points, shape (draws,)."""
    from scipy.stats import binom

    points = np.arange(1, RANKS.points + 1) / (RANKS.points + 1)
    known = np.arange(count + 1)[:, None]
    tails = 2 * np.minimum(binom.cdf(known, count, points), binom.sf(known - 1, count, points))
    return np.asarray(tails[counts, np.arange(RANKS.points)].min(axis=1))
