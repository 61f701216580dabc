"""Route A: the evidence of each hypothesis.

Parameters are integrated by quadrature, nuisances by Laplace's method.

A hypothesis is laid out on nodes g of its prior (equal weights: midpoints of equal slices of prior
probability for one parameter, a low-discrepancy sequence for more). At a node the emulator is
nearly linear in the nuisances z, whose prior is N(0, 1), so that the campaign's log likelihood plus
log prior is nearly concave in z and Laplace's method applies (D. J. C. MacKay, "Information Theory,
Inference, and Learning Algorithms", 2003, ch. 27):

    log L(g) = max_z [log p(y | g, z) + log N(z)] + (q/2) log 2 pi - (1/2) log det H.

The emulator's own uncertainty v and a discrepancy of variance t^2 between any two correct engines
enter by MacKay's averaging of the logistic function, E sigma(m + e) ~
sigma(m / sqrt(1 + pi (v + t^2) / 8)). Outcomes are noted wrongly with probability
`LAPSE`, which bounds what one trial can say. Features have Student's t with 4 degrees of freedom
around the emulator, or are outliers of flat density, which bounds what one feature can say.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.likelihood.emulator import Emulator, common_columns, design_matrix
from vsr2.diagnosis.likelihood.regression import DEGREES, Fit
from vsr2.diagnosis.simulated.library import NONE, Entry, coordinates, free_parameters, is_angle
from vsr2.diagnosis.simulated.simulator import quasi_random

Array = NDArray[np.float64]

LAPSE = 0.004
DISCREPANCY = 0.3
"""Standard deviation on the logit's scale."""
NODES = {0: 1, 1: 11, 2: 40}
"""By number of parameters; more have `NODES_MORE`."""
NODES_MORE = 60
FINE = {0: 1, 1: 121, 2: 250}
FINE_MORE = 400
PREDICTED = 8
"""Fine nodes, drawn by their weights, over which a prediction is averaged."""
_STEPS = 5
_BLOCK = 60_000


@dataclass(frozen=True, eq=False)
class Layout:
    """A hypothesis' predictions at some values of its parameters.

    Attributes:
        quantiles: of the parameters at each node, shape (nodes, parameters).
        logit: averaged over the emulator's error, at nominal nuisances, shape (nodes, trials).
        factor: of averaging, shape (nodes, trials).
        centre, variance: of each feature at nominal nuisances, each (nodes, trials).
    """

    quantiles: Array
    logit: Array
    factor: Array
    centre: tuple[Array, ...]
    variance: tuple[Array, ...]

    def at(self, node: int) -> Layout:
        """One node."""
        return self.at_some(slice(node, node + 1))

    def at_some(self, one: slice) -> Layout:
        """Some nodes."""
        return Layout(
            self.quantiles[one],
            self.logit[one],
            self.factor[one],
            tuple(part[one] for part in self.centre),
            tuple(part[one] for part in self.variance),
        )


@dataclass(frozen=True, eq=False)
class Change:
    """How one response of all trials changes with the nuisances.

    Attributes:
        linear: shape (trials, q).
        squared: which nuisances act by their square less 1 too, shape (k,).
        square: by that, shape (trials, k).
    """

    linear: Array
    squared: NDArray[np.int64]
    square: Array

    def __call__(self, z: Array) -> Array:
        """Change at nuisances (..., q), shape (..., trials)."""
        out = z @ self.linear.T
        if self.squared.size:
            out = out + (z[..., self.squared] ** 2 - 1) @ self.square.T
        return np.asarray(out, dtype=np.float64)

    def back(self, z: Array, weight: Array) -> Array:
        """Sum over trials of weight (..., trials) times the derivative, shape (..., q)."""
        out = np.asarray(weight @ self.linear, dtype=np.float64)
        if self.squared.size:
            out[..., self.squared] += 2 * z[..., self.squared] * (weight @ self.square)
        return out

    def at(self, z: Array) -> Array:
        """Derivative at nuisances (..., q), shape (..., trials, q)."""
        out = np.broadcast_to(self.linear, (*z.shape[:-1], *self.linear.shape)).copy()
        out[..., self.squared] += 2 * z[..., None, self.squared] * self.square
        return out


class _Products:
    """Of a response's derivatives, summed over trials with weights: a part of the Hessian."""

    def __init__(self, change: Change) -> None:
        q, self._squared = change.linear.shape[1], change.squared
        self._upper = np.triu_indices(q)
        self._plain = change.linear[:, self._upper[0]] * change.linear[:, self._upper[1]]
        k = change.squared.size
        mixed = change.square[:, :, None] * change.linear[:, None, :]
        square = change.square[:, :, None] * change.square[:, None, :]
        trials = len(change.linear)
        self._mixed = mixed.reshape(trials, k * q)
        self._square = square.reshape(trials, k * k)

    def add(self, hessian: Array, z: Array, weight: Array) -> None:
        """Add sum_t weight_t d_i d_j, d the derivative at z (..., q), to (..., q, q)."""
        q, k, squared = hessian.shape[-1], self._squared.size, self._squared
        own = np.empty_like(hessian)
        own[..., self._upper[0], self._upper[1]] = weight @ self._plain
        own[..., self._upper[1], self._upper[0]] = own[..., self._upper[0], self._upper[1]]
        hessian += own
        if not k:
            return
        turn = 2 * z[..., squared, None]
        mixed = turn * (weight @ self._mixed).reshape(*weight.shape[:-1], k, q)
        hessian[..., squared, :] += mixed
        hessian[..., :, squared] += np.swapaxes(mixed, -1, -2)
        square = (weight @ self._square).reshape(*weight.shape[:-1], k, k)
        hessian[..., squared[:, None], squared] += turn * np.swapaxes(turn, -1, -2) * square


@dataclass(frozen=True, eq=False)
class Table:
    """A hypothesis, ready for any campaign of the same trials.

    Attributes:
        name: of the hypothesis.
        coarse: where Laplace's method is applied.
        fine: where the evidence is integrated.
        weights: interpolate from coarse to fine nodes, shape (fine nodes, coarse nodes).
        slope, response: how the logit, before the averaging factor, and each feature change with
            the nuisances; the features' common residual factors are nuisances too.
        outlier: density of each feature's outliers, each (trials,).
    """

    name: str
    coarse: Layout
    fine: Layout
    weights: Array
    slope: Change
    response: tuple[Change, ...]
    outlier: tuple[Array, ...]

    @property
    def nuisances(self) -> int:
        """Their number, common factors included."""
        return int(self.slope.linear.shape[1])

    def nearest(self, entry: Entry, quantiles: Array) -> int:
        """The fine node nearest to some quantiles of the parameters."""
        angles = [is_angle(p) for p in free_parameters(entry)]
        gap = coordinates(self.fine.quantiles, angles) - coordinates(quantiles[None], angles)
        return int(np.argmin((gap**2).sum(axis=1)))


@dataclass(frozen=True, eq=False)
class Data:
    """Observed or simulated campaigns of the same trials.

    Attributes:
        overturned: shape (campaigns, trials), NaN where unknown or left out.
        features: shape (campaigns, trials, k), NaN likewise.
    """

    overturned: Array
    features: Array

    def only(self, trials: NDArray[np.bool_]) -> Data:
        """The same with the other trials left out (NaN)."""
        return Data(
            np.where(trials[None, :], self.overturned, np.nan),
            np.where(trials[None, :, None], self.features, np.nan),
        )

    def take(self, rows: NDArray[np.int64]) -> Data:
        """Some of the campaigns."""
        return Data(self.overturned[rows], self.features[rows])

    def __len__(self) -> int:
        return len(self.overturned)


@dataclass(frozen=True, eq=False)
class Posterior:
    """What campaigns say of one hypothesis.

    Attributes:
        evidence: log, shape (campaigns,).
        nodes: log posterior of the fine nodes, shape (campaigns, fine nodes).
        nuisance: mode at each coarse node, shape (campaigns, coarse nodes, q).
        covariance: at the most probable coarse node, shape (campaigns, q, q).
        best: greatest log likelihood plus log prior density of the nuisances over the nodes, up to
            a constant common to all hypotheses, shape (campaigns,).
    """

    evidence: Array
    nodes: Array
    nuisance: Array
    covariance: Array
    best: Array


def node_quantiles(parameters: int) -> Array:
    """Prior quantiles of the coarse nodes, shape (nodes, parameters)."""
    return _spread(parameters, NODES.get(parameters, NODES_MORE), 0)


def _spread(parameters: int, count: int, seed: int) -> Array:
    if parameters == 0:
        return np.zeros((1, 0))
    if parameters == 1:
        return ((np.arange(count) + 0.5) / count)[:, None]
    return np.array([quasi_random(seed, parameters, i + 1) for i in range(count)])


@lru_cache(maxsize=32)
def _refined(angles: tuple[bool, ...]) -> tuple[Array, Array]:
    """Fine nodes and how each is mixed of coarse ones; `angles`: which parameters turn.

    Shares are not negative and sum to 1: what lies between nodes of very different evidence must
    not overshoot.
    """
    count = len(angles)
    coarse = node_quantiles(count)
    fine = _spread(count, FINE.get(count, FINE_MORE), 3)
    if count == 0:
        return fine, np.ones((1, 1))
    if count == 1 and not angles[0]:
        hats = [np.interp(fine[:, 0], coarse[:, 0], row) for row in np.eye(len(coarse))]
        return fine, np.stack(hats, axis=1)
    here, there = coordinates(fine, angles), coordinates(coarse, angles)
    square = ((here[:, None, :] - there[None, :, :]) ** 2).sum(axis=2)
    near = np.sort(square, axis=1)[:, here.shape[1] + 1]
    shares = np.maximum(near[:, None] / np.maximum(square, 1e-12) - 1.0, 0.0) + 1e-12
    return fine, shares / shares.sum(axis=1, keepdims=True)


def tabulate(emulator: Emulator, effect: str) -> Table:
    """Lay out a hypothesis: one effect, or none ("")."""
    free = free_parameters(emulator.library[effect]) if effect else ()
    fine, weights = _refined(tuple(is_angle(p) for p in free))
    used = emulator.columns(effect)
    layouts = []
    for given in (node_quantiles(len(free)), fine):
        x, _ = _regressors(emulator, effect, given)
        layouts.append(_layout(emulator, x, used, given))
    return _table(emulator, effect or NONE, layouts[0], layouts[1], weights)


def tabulate_pair(
    emulator: Emulator, first: str, second: str, quantiles: tuple[Array, Array]
) -> Table:
    """Lay out two effects that add up on the logit and in the features.

    Args:
        emulator: fitted.
        first: an effect.
        second: another.
        quantiles: nodes of each, combined row by row.
    """
    x, _ = _regressors(emulator, first, quantiles[0])
    other, blocks = _regressors(emulator, second, quantiles[1])
    x[:, blocks[second]] += other[:, blocks[second]]
    used = np.union1d(emulator.columns(first), emulator.columns(second))
    layout = _layout(emulator, x, used, np.hstack(quantiles))
    return _table(emulator, f"{first}+{second}", layout, layout, np.eye(len(x)))


def _regressors(emulator: Emulator, effect: str, given: Array) -> tuple[Array, dict[str, slice]]:
    blank = np.ones((len(given), emulator.nuisances))
    x, blocks = design_matrix(emulator.library, [effect] * len(given), list(given), blank)
    # Nuisances at their nominal values, their squares at their mean.
    x[:, 1 : common_columns(emulator.nuisances)] = 0.0
    return x, blocks


def _layout(emulator: Emulator, x: Array, used: NDArray[np.int64], quantiles: Array) -> Layout:
    q = emulator.nuisances
    logit, variance = _predicted(emulator.outcome, x, used, q)
    variance += _model_error(emulator, emulator.outcome, x, 0) + emulator.outcome.noise
    factor = 1.0 / np.sqrt(1.0 + np.pi * (variance + DISCREPANCY**2) / 8.0)
    centre, spread = [], []
    for fit in emulator.features:
        value, own = _predicted(fit, x, used, q)
        own += _model_error(emulator, fit, x, 1)
        centre.append(value)
        spread.append(own + fit.noise[None, :])
    return Layout(quantiles, logit * factor, factor, tuple(centre), tuple(spread))


def _table(emulator: Emulator, name: str, coarse: Layout, fine: Layout, weights: Array) -> Table:
    q, bends = emulator.nuisances, emulator.bends

    def change(fit: Fit) -> Change:
        linear = np.hstack([fit.mean[:, 1 : 1 + q], fit.loading])
        return Change(linear, bends, fit.mean[:, 1 + q + bends])

    return Table(
        name=name,
        coarse=coarse,
        fine=fine,
        weights=weights,
        slope=change(emulator.outcome),
        response=tuple(change(fit) for fit in emulator.features),
        outlier=tuple(fit.outlier for fit in emulator.features),
    )


def _predicted(fit: Fit, x: Array, used: NDArray[np.int64], q: int) -> tuple[Array, Array]:
    part = x[:, used]
    covariance = fit.covariance[:, used[:, None], used[None, :]]
    variance = np.einsum("gi,tij,gj->gt", part, covariance, part, optimize=True)
    # Nuisances of unit variance, and their squares less 1 of variance 2, carry their
    # coefficients' errors along.
    own = np.diagonal(fit.covariance, axis1=1, axis2=2)
    variance += (own[:, 1 : 1 + q].sum(axis=1) + 2 * own[:, 1 + q : 1 + 2 * q].sum(axis=1))[None, :]
    return part @ fit.mean[:, used].T, variance


def _model_error(emulator: Emulator, fit: Fit, x: Array, kind: int) -> Array:
    """Variance of what the effects' polynomials leave out, shape (nodes, trials)."""
    out = np.zeros((len(x), len(fit.mean)))
    for name, block in emulator.blocks.items():
        error = emulator.wrong.get(name, (0.0, 0.0))[kind]
        if error and x[:, block].any():
            out += (error * (x[:, block] @ fit.mean[:, block].T)) ** 2
    return out


def _lapsed(p: Array) -> Array:
    return LAPSE + (1 - 2 * LAPSE) * p


def posterior(table: Table, data: Data) -> Posterior:
    """Evidence and posterior of one hypothesis under each campaign."""
    # Blocks that stay in the processor's cache.
    size = max(1, _BLOCK // (len(table.coarse.logit) * data.overturned.shape[1]))
    parts = [
        _posterior(table, data.take(np.arange(start, min(start + size, len(data)))))
        for start in range(0, len(data), size)
    ]
    if len(parts) == 1:
        return parts[0]
    return Posterior(
        np.concatenate([p.evidence for p in parts]),
        np.concatenate([p.nodes for p in parts]),
        np.concatenate([p.nuisance for p in parts]),
        np.concatenate([p.covariance for p in parts]),
        np.concatenate([p.best for p in parts]),
    )


def _posterior(table: Table, data: Data) -> Posterior:
    campaigns, q = len(data), table.nuisances
    at = table.coarse
    nodes = len(at.logit)
    known = np.isfinite(data.overturned)[:, None, :]
    y = np.where(known, data.overturned[:, None, :], 0.5)
    shown = known * at.factor
    z = np.zeros((campaigns, nodes, q))
    parts = _feature_parts(table, at, data)
    outer = _Products(table.slope)
    products = [_Products(part.response) for part in parts]
    for _ in range(_STEPS):
        p = 1 / (1 + np.exp(-np.clip(at.logit + at.factor * table.slope(z), -30, 30)))
        slope = table.slope.back(z, (y - p) * shown) - z
        hessian = np.broadcast_to(np.eye(q), (campaigns, nodes, q, q)).copy()
        outer.add(hessian, z, p * (1 - p) * shown * at.factor)
        for part, product in zip(parts, products, strict=True):
            gap = part.value - part.response(z)
            tail = 1.0 / (DEGREES * part.variance + gap**2)
            own = _density(tail * DEGREES * part.variance, part.variance)
            tail *= part.known * ((DEGREES + 1) * own / (own + part.outlier))
            slope += part.response.back(z, tail * gap)
            product.add(hessian, z, tail)
        step = np.linalg.solve(hessian, slope[..., None])[..., 0]
        length = np.linalg.norm(step, axis=-1, keepdims=True)
        z = z + step * np.minimum(1.0, 2.0 / np.maximum(length, 1e-12))
    peak = log_likelihood(table, at, data, z).sum(axis=-1) - 0.5 * (z**2).sum(axis=-1)
    bend = 0.5 * np.linalg.slogdet(hessian)[1]
    middle = hessian[np.arange(campaigns), (peak - bend).argmax(axis=1)]
    if table.fine is not table.coarse:
        peak = _between(table, data, z)
        bend = bend @ table.weights.T
    value = peak - bend
    top = value.max(axis=1, keepdims=True)
    evidence = np.log(np.exp(value - top).mean(axis=1)) + top[:, 0]
    return Posterior(
        evidence,
        value - evidence[:, None] - np.log(value.shape[1]),
        z,
        np.asarray(np.linalg.inv(middle), dtype=np.float64),
        np.asarray(peak.max(axis=1), dtype=np.float64),
    )


def _between(table: Table, data: Data, z: Array) -> Array:
    """Log likelihood plus log prior of the nuisances at the fine nodes, nuisances mixed."""
    size = len(table.coarse.logit)
    parts = []
    for start in range(0, len(table.weights), size):
        some = slice(start, start + size)
        own = table.weights[some] @ z
        found = log_likelihood(table, table.fine.at_some(some), data, own).sum(axis=-1)
        parts.append(found - 0.5 * (own**2).sum(axis=-1))
    return np.concatenate(parts, axis=1)


class _Part(NamedTuple):
    """One feature: observed minus centre (0 where unknown), known, response, variance."""

    value: Array
    known: NDArray[np.bool_]
    response: Change
    variance: Array
    outlier: Array


def _density(ratio: Array, variance: Array) -> Array:
    """Student's t density with 4 degrees of freedom from 1 / (1 + gap^2 / (4 variance))."""
    return np.asarray(0.375 * ratio**2 * np.sqrt(ratio / variance), dtype=np.float64)


def _feature_parts(table: Table, at: Layout, data: Data) -> list[_Part]:
    out = []
    for k, (centre, response, variance, outlier) in enumerate(
        zip(at.centre, table.response, at.variance, table.outlier, strict=True)
    ):
        value = data.features[:, None, :, k]
        known = np.isfinite(value)
        out.append(_Part(np.where(known, value - centre, 0.0), known, response, variance, outlier))
    return out


def log_likelihood(table: Table, at: Layout, data: Data, z: Array) -> Array:
    """Of each trial at given nuisances, shape (campaigns, nodes, trials); 0 where unknown."""
    p = 1 / (1 + np.exp(-np.clip(at.logit + at.factor * table.slope(z), -30, 30)))
    p = _lapsed(p)
    y = data.overturned[:, None, :]
    known = np.isfinite(y)
    # An expected outcome between 0 and 1 gives the expected log likelihood.
    likely = np.nan_to_num(y)
    out = np.where(known, likely * np.log(p) + (1 - likely) * np.log1p(-p), 0.0)
    for value, shown, response, variance, outlier in _feature_parts(table, at, data):
        gap = value - response(z)
        density = _density(1.0 / (1.0 + gap**2 / (DEGREES * variance)), variance)
        out = out + np.log(density + outlier) * shown
    return np.asarray(out, dtype=np.float64)


def mode(table: Table, found: Posterior) -> tuple[int, Array]:
    """Most probable fine node of a single campaign and the nuisances there, shape (q,)."""
    node = int(np.argmax(found.nodes[0]))
    return node, np.asarray(table.weights[node] @ found.nuisance[0], dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Prediction:
    """Predictive distributions of campaigns' trials.

    Attributes:
        probability: of overturning, shape (campaigns, trials).
        centre, deviation: of each feature, shape (campaigns, trials, k).
    """

    probability: Array
    centre: Array
    deviation: Array


def drawn_nodes(found: Posterior) -> NDArray[np.int64]:
    """Fine nodes by their weights, of equal weight each, shape (campaigns, PREDICTED)."""
    total = np.cumsum(np.exp(found.nodes), axis=1)
    levels = (np.arange(PREDICTED) + 0.5) / PREDICTED
    return np.stack([np.searchsorted(row / row[-1], levels) for row in total])


def predict(table: Table, found: Posterior) -> Prediction:
    """Average a hypothesis' predictions over its posterior, `PREDICTED` draws of equal weight."""
    at = table.fine
    drawn = drawn_nodes(found)
    z = np.einsum("cpg,cgq->cpq", table.weights[drawn], found.nuisance)
    middle = z.mean(axis=1)
    spread = _spread_of(table.slope.at(middle), found.covariance)
    factor = at.factor[drawn]
    logit = at.logit[drawn] + factor * table.slope(z)
    probability = _lapsed(
        1 / (1 + np.exp(-logit / np.sqrt(1 + np.pi / 8 * factor**2 * spread[:, None])))
    ).mean(axis=1)
    centres, deviations = [], []
    for centre, response, variance in zip(at.centre, table.response, at.variance, strict=True):
        value = centre[drawn] + response(z)
        own = _spread_of(response.at(middle), found.covariance)
        mean = value.mean(axis=1)
        second = (value**2 + variance[drawn]).mean(axis=1) + own
        centres.append(mean)
        deviations.append(np.sqrt(np.maximum(second - mean**2, 1e-12)))
    shape = (*probability.shape, 0)
    return Prediction(
        probability,
        np.stack(centres, axis=-1) if centres else np.zeros(shape),
        np.stack(deviations, axis=-1) if deviations else np.zeros(shape),
    )


def _spread_of(change: Array, covariance: Array) -> Array:
    """Variance that nuisances of a covariance (c, q, q) give by derivatives (c, trials, q)."""
    return np.asarray(((change @ covariance) * change).sum(axis=-1), dtype=np.float64)
