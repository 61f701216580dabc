"""Negative controls: what closes a part of a gap without being its cause.

One rescales the probabilities of the scene as it is, fitted on other motions. The other gives each
trial the change of probability that the causes made in another trial of like intensity.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.ensemble.observed.random_streams import Stream, generator

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NegativeControlConstants:
    """How controls are made; chosen by hand.

    Attributes:
        dealt: ways of dealing the response to wrong trials.
        neighbours: trials of like intensity among which it is dealt.
        rescaling: standard deviation of the prior on shift and slope of rescaled probabilities,
            about none.
        least_probability: of either outcome.
    """

    dealt: int = 8
    neighbours: int = 8
    rescaling: float = 2.0
    least_probability: float = 1e-3


NEGATIVE_CONTROLS = NegativeControlConstants()


def recalibrated(probability: Array, outcome: Array, group: NDArray[np.int64]) -> Array:
    """Platt's scaling of each group's probabilities, fitted to the others with a weak pull to none.

    J. Platt, "Probabilistic outputs for support vector machines", 1999.

    Args:
        probability: of overturning, above 0 and below 1, shape (trials,).
        outcome: 1 or 0, NaN where unknown, shape (trials,).
        group: of each trial, shape (trials,).
    """
    from scipy.optimize import minimize
    from scipy.special import expit, logit

    out, variance = probability.copy(), NEGATIVE_CONTROLS.rescaling**2
    for k in np.unique(group):
        used = (group != k) & np.isfinite(outcome)
        x, target = logit(probability[used]), outcome[used]

        def cost(theta: Array, x: Array = x, target: Array = target) -> tuple[float, Array]:
            line = theta[0] + theta[1] * x
            pull = (theta - [0.0, 1.0]) / variance
            wrong = expit(line) - target
            value = np.logaddexp(0.0, line).sum() - (target * line).sum()
            value += 0.5 * variance * (pull**2).sum()
            return float(value), np.array([wrong.sum(), (wrong * x).sum()]) + pull

        shift, slope = minimize(cost, np.array([0.0, 1.0]), jac=True, method="BFGS").x
        line = shift + slope * logit(probability[group == k])
        out[group == k] = _within(expit(line))
    return out


def wrong_partners(log_pga_g: Array, seed: int) -> Iterator[NDArray[np.int64]]:
    """For each trial another one of like intensity, in several ways, each shape (trials,).

    Args:
        log_pga_g: ln PGA [g], shape (trials,).
        seed: of the draws.
    """
    rng = generator(seed, Stream.DEALT)
    order, width = np.argsort(log_pga_g, kind="stable"), NEGATIVE_CONTROLS.neighbours
    for _ in range(NEGATIVE_CONTROLS.dealt):
        partner = np.empty(order.size, dtype=np.int64)
        for first in range(0, order.size, width):
            block = order[first : first + width]
            mixed = block[rng.permutation(block.size)]
            partner[mixed] = np.roll(mixed, 1)
        yield partner


def with_change_of(before: Array, after: Array, partner: NDArray[np.int64]) -> Array:
    """Probabilities that change as those of a partner do, in log odds, shape (trials,)."""
    from scipy.special import expit, logit

    start = logit(before)
    return _within(expit(start + (logit(after) - start)[partner]))


def _within(probability: Array) -> Array:
    least = NEGATIVE_CONTROLS.least_probability
    return np.asarray(np.clip(probability, least, 1 - least), dtype=np.float64)
