"""A small network from summaries to the probability of every set of effects.

Its outputs are a score for every effect alone, one for every effect as a part of a larger set, and
one each for none, a pair, three effects and so on. The logit of a larger set is the sum of its
parts and of that of its size, so that a set needs no campaigns of its own. Trained by
the logarithmic score on simulated campaigns, its probabilities are those of the hypotheses given
the summaries (P. Pudlo et al., "Reliable ABC model choice via random forests", Bioinformatics 32,
2016; S. T. Radev et al., "Amortized Bayesian model comparison with evidential deep learning", IEEE
Trans. Neural Netw. Learn. Syst. 34, 2023).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.posterior.sets import Sets

Array = NDArray[np.float64]
Floats = NDArray[np.floating[Any]]
"""In single or double precision."""
FORBIDDEN = -1e9
"""Logit of a cause outside, and of a size all of whose sets have a probability too small for a
number: its exponential is 0 beside any other, and it can be subtracted, which infinity cannot."""


@dataclass(frozen=True)
class NetworkConstants:
    """The network and its training; chosen by hand, judged by `python studies/diagnosis_planar.py`.

    Attributes:
        hidden: widths of the layers.
        first_outputs: weights of the last layer that training starts from, over He's.
        rate: of Adam, falling linearly.
        last_rate: of Adam at the end, over the first.
        mean_share, square_share: of a step's slope in Adam's running means, 1 - beta_1 and 1 -
            beta_2; with `least_root` the values of Kingma and Ba.
        least_root: added to the root of the mean square, their epsilon.
        decay: of weights.
        dropout: share of units that a step leaves out.
        batch: campaigns a step.
        passes: over the training campaigns.
        least_passes: before the best weights are looked for.
    """

    hidden: tuple[int, ...] = (256, 128)
    first_outputs: float = 0.1
    rate: float = 2e-3
    last_rate: float = 0.05
    mean_share: float = 0.1
    square_share: float = 0.001
    least_root: float = 1e-8
    decay: float = 3e-4
    dropout: float = 0.5
    batch: int = 128
    passes: int = 60
    least_passes: int = 16


NETWORK = NetworkConstants()


@dataclass(eq=False)
class Network:
    """Weights, and what they make of summaries.

    Attributes:
        sets: the hypotheses.
        weights, biases: of each layer, in single precision, which saves time;
            what follows from the outputs is in double precision.
    """

    sets: Sets
    weights: list[Floats] = field(default_factory=list)
    biases: list[Floats] = field(default_factory=list)

    @classmethod
    def drawn(cls, sets: Sets, inputs: int, rng: np.random.Generator) -> Network:
        """With the weights that training starts from (He initialisation)."""
        sizes = [inputs, *NETWORK.hidden, sets.parts.shape[1]]
        weights = [rng.standard_normal((a, b)) * np.sqrt(2 / a) for a, b in pairwise(sizes)]
        weights[-1] *= NETWORK.first_outputs
        singles = [one.astype(np.float32) for one in weights]
        return cls(sets, singles, [np.zeros(b, dtype=np.float32) for b in sizes[1:]])

    def outputs(self, inputs: Array) -> Array:
        """Of which the logit of every set is a sum, shape (n, outputs).

        Args:
            inputs: shape (n, inputs).
        """
        return self._layers(inputs, None)[0][-1].astype(np.float64)

    def log_probability(self, inputs: Array) -> Array:
        """Of every set, shape (n, sets).

        Args:
            inputs: shape (n, inputs).
        """
        return _log_softmax(_logits(self.sets, self.outputs(inputs)))

    def _layers(
        self, inputs: Array, rng: np.random.Generator | None
    ) -> tuple[list[Floats], list[Floats]]:
        """Values of every layer, and which units are kept (all without `rng`)."""
        precision = self.weights[0].dtype
        values: list[Floats] = [inputs.astype(precision, copy=False)]
        kept: list[Floats] = []
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            value = np.maximum(values[-1] @ weight + bias, 0.0)
            keep: Floats = np.ones(1, dtype=precision)
            if rng is not None:
                drawn = rng.random(value.shape, dtype=precision.type)
                keep = (drawn > NETWORK.dropout).astype(precision) / (1 - NETWORK.dropout)
            values.append(value * keep)
            kept.append(keep)
        return [*values, values[-1] @ self.weights[-1] + self.biases[-1]], kept

    def step(
        self,
        inputs: Array,
        truth: NDArray[np.int64],
        weight: Array,
        rng: np.random.Generator,
    ) -> list[Floats]:
        """Gradients of the weighted logarithmic score: of weights, then of biases."""
        values, kept = self._layers(inputs, rng)
        slope = self._slope(values[-1].astype(np.float64), truth)
        back = (slope * (weight / weight.sum())[:, None]).astype(self.weights[0].dtype)
        weights: list[Floats] = []
        biases: list[Floats] = []
        for layer in range(len(self.weights) - 1, -1, -1):
            weights.insert(0, values[layer].T @ back + NETWORK.decay * self.weights[layer])
            biases.insert(0, back.sum(axis=0))
            if layer:
                back = (back @ self.weights[layer].T) * kept[layer - 1] * (values[layer] > 0)
        return [*weights, *biases]

    def score(self, inputs: Array, truth: NDArray[np.int64]) -> Array:
        """Log probability of the true set, shape (n,).

        Args:
            inputs: shape (n, inputs).
            truth: index of the true set, shape (n,).
        """
        return _score(self.sets, self.outputs(inputs), truth)

    def _slope(self, outputs: Array, truth: NDArray[np.int64]) -> Array:
        """Of minus the log probability of the truth, by the outputs."""
        count = len(self.sets.names)
        logits, factor, before, sums = _kinds(self.sets, outputs)
        probability = np.exp(_log_softmax(logits))
        out = np.zeros(outputs.shape)
        out[:, :count], out[:, 2 * count :] = probability[:, :count], probability[:, count:]
        after = _sums_before(factor[:, ::-1], len(self.sets.by_size) - 1)
        for size in range(2, len(self.sets.by_size) + 1):
            # The polynomial of the other parts, one size smaller; all terms are positive.
            others = sum(before[k] * after[size - 1 - k][:, ::-1] for k in range(size))
            of_size = probability[:, [count + size - 1]]
            out[:, count : 2 * count] += of_size * factor * others / sums[size]
        out -= self.sets.parts[truth]
        return out


@dataclass(frozen=True, eq=False)
class SetOutputs:
    """What networks make of campaigns; the probability of every set follows a few at a time.

    Attributes:
        sets: the hypotheses.
        outputs: of each network, shape (networks, n, outputs).
    """

    sets: Sets
    outputs: Array

    def score(self, index: NDArray[np.int64], temperature: float) -> Array:
        """Log probability of one set a campaign, by each network, shape (networks, n).

        Logits are linear in the outputs, so that the temperature divides these.

        Args:
            index: of the set, shape (n,).
            temperature: by which logits are divided.
        """
        return np.stack([_score(self.sets, one / temperature, index) for one in self.outputs])

    def log_probability(self, rows: NDArray[np.int64]) -> Array:
        """Of every set in some campaigns, by each network, shape (networks, rows, sets)."""
        return np.stack([_log_softmax(_logits(self.sets, one[rows])) for one in self.outputs])


def _logits(sets: Sets, outputs: Array) -> Array:
    """Of every set, shape (n, sets); no network knows a cause outside."""
    logits = outputs @ sets.parts.T
    logits[:, sets.outside] = FORBIDDEN
    return logits


def _score(sets: Sets, outputs: Array, index: NDArray[np.int64]) -> Array:
    """Log probability of one set a campaign, shape (n,)."""
    logits, *_ = _kinds(sets, outputs)
    most = logits.max(axis=1, keepdims=True)
    total = np.log(np.exp(logits - most).sum(axis=1)) + most[:, 0]
    return np.asarray((outputs * sets.parts[index]).sum(axis=1) - total)


def _kinds(sets: Sets, outputs: Array) -> tuple[Array, Array, list[Array], list[Array]]:
    """Logits of every effect alone, of none, of all sets of each size together.

    The sum over sets of one size of the products of their parts is an elementary symmetric
    polynomial of the parts, so that no set is computed by itself.

    Returns:
        The logits; of every part its exponential, over that of the greatest; the polynomials of
        the parts before each, of degree 0 and more; those of all parts, of the same and one more.
    """
    count, sizes = len(sets.names), len(sets.by_size)
    own, part = outputs[:, :count], outputs[:, count : 2 * count]
    kinds = np.array(outputs[:, 2 * count :])
    most = part.max(axis=1, keepdims=True)
    factor = np.exp(part - most)
    before = _sums_before(factor, sizes - 1)
    tiny = np.finfo(np.float64).tiny
    sums = [np.ones((len(factor), 1))]
    sums += [np.maximum((factor * one).sum(axis=1, keepdims=True), tiny) for one in before]
    for size in range(2, sizes + 1):
        there = sums[size] > tiny
        kinds[:, [size - 1]] += size * most + np.log(sums[size])
        kinds[:, [size - 1]] = np.where(there, kinds[:, [size - 1]], FORBIDDEN)
    return np.concatenate([own, kinds], axis=1), factor, before, sums


def _sums_before(factor: Array, most: int) -> list[Array]:
    """Elementary symmetric polynomials of the factors before each place, of degree 0 to `most`.

    Each is of the shape of `factor`.

    Nothing is subtracted: factors of one row may differ by more than a number has digits.
    """
    out = [np.ones(factor.shape)]
    for _ in range(most):
        running = np.cumsum(factor * out[-1], axis=1)
        out.append(np.concatenate([np.zeros((len(factor), 1)), running[:, :-1]], axis=1))
    return out


Batches = Callable[[np.random.Generator], tuple[Array, NDArray[np.int64], Array]]
"""One pass of training campaigns: inputs, true sets, weights."""


def train_network(
    sets: Sets,
    batches: Batches,
    held_out: tuple[Array, NDArray[np.int64], Array],
    rng: np.random.Generator,
) -> Network:
    """Train by Adam, and keep the weights that are best on held-out campaigns.

    D. P. Kingma and J. Ba, "Adam: a method for stochastic optimization", 2015.

    Args:
        sets: the hypotheses.
        batches: makes one pass of training campaigns.
        held_out: campaigns by which training is stopped.
        rng: of weights, order and dropout.
    """
    first = batches(rng)
    network = Network.drawn(sets, first[0].shape[1], rng)
    parameters = [*network.weights, *network.biases]
    mean = [np.zeros_like(one) for one in parameters]
    square = [np.zeros_like(one) for one in parameters]
    best, kept, count = np.inf, [one.copy() for one in parameters], 0
    for number in range(NETWORK.passes):
        rate = NETWORK.rate * max(1 - number / NETWORK.passes, NETWORK.last_rate)
        inputs, truth, weight = batches(rng)
        for start in range(0, len(truth), NETWORK.batch):
            part = slice(start, start + NETWORK.batch)
            count += 1
            own_mean, own_square = (
                1 - (1 - share) ** count for share in (NETWORK.mean_share, NETWORK.square_share)
            )
            slopes = network.step(inputs[part], truth[part], weight[part], rng)
            for one, m, v, slope in zip(parameters, mean, square, slopes, strict=True):
                m += NETWORK.mean_share * (slope - m)
                v += NETWORK.square_share * (slope**2 - v)
                root = np.sqrt(v / own_square) + NETWORK.least_root
                one -= (rate / own_mean) * m / root
        if number + 1 >= NETWORK.least_passes:
            score = log_score(network, *held_out)
            if score < best:
                best, kept = score, [one.copy() for one in parameters]
    layers = len(network.weights)
    return Network(sets, kept[:layers], kept[layers:])


def log_score(
    network: Network,
    inputs: Array,
    truth: NDArray[np.int64],
    weight: Array,
) -> float:
    """Weighted mean of minus the log probability of the true set [nat]."""
    found = network.score(inputs, truth)
    return float(-(weight * found).sum() / weight.sum())


def _log_softmax(logits: Array) -> Array:
    shifted = logits - logits.max(axis=1, keepdims=True)
    return np.asarray(shifted - np.log(np.exp(shifted).sum(axis=1, keepdims=True)))
