"""How much a log likelihood counts, learnt from simulated campaigns that the emulators did not see.

Emulators are short polynomials, and their errors hang together over trials, so that a product of
likelihoods is far too sure. A power of it is not; of what power is measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ERRORS = (0.0, 0.03, 0.06, 0.1, 0.2, 0.3)
COVERAGE = 0.95
"""Of central intervals of parameters."""


def strengths(likelihood: Array) -> Array:
    """S^2 of campaigns: 2 log (evidence of the best effect / evidence of none), at least 0.

    Args:
        likelihood: log probabilities of labels by route A, "none" first, shape (..., labels).
    """
    gain = likelihood[..., 1:].max(axis=-1) - likelihood[..., 0]
    return np.asarray(2 * np.maximum(gain, 0.0), dtype=np.float64)


@dataclass(frozen=True)
class Tempering:
    """How much a log likelihood counts.

    Where an effect is strong, the emulator's error is about proportional to it. With S^2 = 2 log
    (evidence of the best effect / evidence of none), the squared strength in noise's units, an
    error e S beside unit noise leaves 1 / (1 + e^2 S^2) of a log likelihood ratio.

    Attributes:
        power: of weak effects.
        error: e.
    """

    power: float
    error: float

    def weight(self, likelihood: Array) -> Array:
        """Exponent, for route A's log probabilities of labels (..., labels), shape (...)."""
        square = strengths(likelihood)
        return np.asarray(self.power / (1 + self.error**2 * square), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Judged:
    """The posterior of the parameters of a campaign's own effect, and where they truly lie.

    Attributes:
        nodes: log posterior, shape (nodes,).
        quantiles: of the nodes, of the parameters that do not turn, shape (nodes, parameters).
        node: the one nearest to the truth.
        truth: quantiles, shape (parameters,).
        likelihood: log probabilities of labels by route A, shape (labels,).
    """

    nodes: Array
    quantiles: Array
    node: int
    truth: Array
    likelihood: Array


def below(quantiles: Array, weight: Array, value: float | Array) -> Array:
    """Posterior probability below values of one parameter; half of a node's own lies below it.

    Args:
        quantiles: of the nodes, shape (nodes,).
        weight: of the nodes, shape (..., nodes), sums to 1.
        value: quantile.
    """
    order = np.argsort(quantiles)
    total = np.cumsum(weight[..., order], axis=-1) - 0.5 * weight[..., order]
    rows = total.reshape(-1, order.size)
    found = [np.interp(value, quantiles[order], row) for row in rows]
    return np.array(found).reshape(weight.shape[:-1])


def sharpness(campaigns: Sequence[Judged]) -> tuple[Tempering, Tempering]:
    """The temperings of posteriors of parameters: the best estimate's, and that of intervals.

    The first has the best log score, the second the best among those whose central 95 % intervals
    hold the truth in 95 % of the weaker half of the campaigns, and of the stronger; where none
    does so in both, it is that with the least power.
    """
    from scipy.special import logsumexp

    options = [Tempering(p, e) for p in np.geomspace(0.01, 1.0, 15) for e in ERRORS]
    if not campaigns:
        return Tempering(1.0, 0.0), Tempering(1.0, 0.0)
    score = np.zeros(len(options))
    strength = np.array([float(strengths(one.likelihood)) for one in campaigns])
    strong = strength > np.median(strength)
    tail = (1 - COVERAGE) / 2
    held, count = np.zeros((2, len(options))), np.zeros((2, 1))
    for one, half in zip(campaigns, strong.astype(int), strict=True):
        powers = np.array([float(option.weight(one.likelihood)) for option in options])
        log = powers[:, None] * one.nodes[None]
        log -= logsumexp(log, axis=1, keepdims=True)
        score += log[:, one.node]
        for column, value in zip(one.quantiles.T, one.truth, strict=True):
            share = below(column, np.exp(log), float(value))
            held[half] += (share >= tail) & (share <= 1 - tail)
            count[half] += 1
    covers = (held >= COVERAGE * count).all(axis=0)
    best = options[int(np.argmax(score))]
    if not covers.any():
        return best, options[0]
    return best, options[int(np.argmax(np.where(covers, score, -np.inf)))]


def pairwise_exponent(evidence: Array, truth: NDArray[np.int64]) -> float:
    """With what exponent a log likelihood ratio tells two effects apart.

    The odds that the true effect of a campaign beats another are taken as the ratio's power, or as
    even in a share of the pairs (both by maximum likelihood over all pairs).

    Args:
        evidence: log, of every effect in campaigns of known cause, shape (campaigns, effects).
        truth: index of the campaign's own effect, shape (campaigns,).

    Returns:
        At most 1; 1 where there is no pair.
    """
    from scipy.optimize import minimize
    from scipy.special import expit

    rows = np.arange(truth.size)
    ratio = evidence[rows, truth][:, None] - evidence
    others = np.arange(evidence.shape[1]) != truth[:, None]
    if not others.any():
        return 1.0
    count = np.bincount(truth, minlength=evidence.shape[1])
    weight = np.broadcast_to(1.0 / count[truth][:, None], others.shape)[others]
    ratio = ratio[others]

    def loss(theta: Array) -> float:
        even = expit(theta[1])
        right = (1 - even) * expit(np.exp(theta[0]) * ratio) + even / 2
        return -float(np.average(np.log(np.maximum(right, 1e-300)), weights=weight))

    found = minimize(loss, np.array([-2.0, -3.0]), method="Nelder-Mead")
    return min(float(np.exp(found.x[0])), 1.0)
