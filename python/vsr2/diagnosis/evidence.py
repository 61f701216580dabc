"""Route A: the evidence of each hypothesis.

Parameters are integrated by quadrature, nuisances by Laplace's method.

A hypothesis is laid out on nodes g of its prior (equal weights: midpoints of equal slices of prior
probability for one parameter, a low-discrepancy sequence for more). At a node the emulator is
linear in the nuisances z, whose prior is N(0, 1), so that the campaign's log likelihood plus log prior is
concave in z and Laplace's method applies (D. J. C. MacKay, "Information Theory, Inference, and
Learning Algorithms", 2003, ch. 27):

    log L(g) = max_z [log p(y | g, z) + log N(z)] + (q/2) log 2 pi - (1/2) log det H.

The emulator's own uncertainty v and a discrepancy of variance t^2 between any two correct engines
enter by MacKay's averaging of the logistic function, E sigma(m + e) ~
sigma(m / sqrt(1 + pi (v + t^2) / 8)). Outcomes are noted wrongly with probability `LAPSE`, which bounds what one trial can say.
Features have Student's t with 4 degrees of freedom around the emulator.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.emulator import DEGREES, Emulator, Fit, design_matrix
from vsr2.diagnosis.library import NONE, free_parameters
from vsr2.diagnosis.simulator import quasi_random

Array = NDArray[np.float64]

LAPSE = 0.004
DISCREPANCY = 0.3
"""Standard deviation on the logit's scale."""
NODES_ONE = 15
NODES_MORE = 60
_STEPS = 5


@dataclass(frozen=True, eq=False)
class Table:
    """A hypothesis on its nodes, ready for any campaign of the same trials.

    Attributes:
        name: of the hypothesis.
        quantiles: of the parameters at each node, shape (nodes, parameters).
        logit: averaged over the emulator's error, at nominal nuisances, shape (nodes, trials).
        slope: of the logit by nuisance, before the averaging factor, shape (trials, q).
        factor: of averaging, shape (nodes, trials).
        centre, response, variance: of each feature: at nominal nuisances (nodes, trials), by
            nuisance (trials, q), and of the prediction (nodes, trials).
    """

    name: str
    quantiles: Array
    logit: Array
    slope: Array
    factor: Array
    centre: tuple[Array, ...]
    response: tuple[Array, ...]
    variance: tuple[Array, ...]

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return len(self.logit)


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
        nodes: log posterior of the nodes, shape (campaigns, nodes).
        nuisance: mode at each node, shape (campaigns, nodes, q).
        covariance: at each node, shape (campaigns, nodes, q, q).
        best: greatest log likelihood plus log prior density of the nuisances over the nodes, up to
            a constant common to all hypotheses, shape (campaigns,).
    """

    evidence: Array
    nodes: Array
    nuisance: Array
    covariance: Array
    best: Array


def node_quantiles(parameters: int) -> Array:
    """Prior quantiles of the nodes, shape (nodes, parameters)."""
    if parameters == 0:
        return np.zeros((1, 0))
    if parameters == 1:
        return ((np.arange(NODES_ONE) + 0.5) / NODES_ONE)[:, None]
    return np.array([quasi_random(0, parameters, i + 1) for i in range(NODES_MORE)])


def tabulate(
    emulator: Emulator,
    effect: str,
    quantiles: Array | None = None,
    *,
    second: str = "",
    second_quantiles: Array | None = None,
) -> Table:
    """Lay out a hypothesis: one effect, none ("") or, with `second`, a pair that adds up.

    Args:
        emulator: fitted.
        effect: name, "" for none.
        quantiles: nodes; by default those of :func:`node_quantiles`.
        second: a second effect.
        second_quantiles: its nodes, combined row by row with `quantiles`.
    """
    q = emulator.nuisances
    count = len(free_parameters(emulator.library[effect])) if effect else 0
    given = node_quantiles(count) if quantiles is None else quantiles
    nodes = len(given)
    x, _ = design_matrix(emulator.library, [effect] * nodes, list(given), np.zeros((nodes, q)))
    used = emulator.columns(effect)
    if second and second_quantiles is not None:
        other, _ = design_matrix(
            emulator.library, [second] * nodes, list(second_quantiles), np.zeros((nodes, q))
        )
        x[:, emulator.blocks[second]] += other[:, emulator.blocks[second]]
        used = np.union1d(used, emulator.columns(second))
    logit, variance = _predicted(emulator.outcome, x, used, q)
    factor = 1.0 / np.sqrt(1.0 + np.pi * (variance + DISCREPANCY**2) / 8.0)
    centre, response, spread = [], [], []
    for fit in emulator.features:
        value, own = _predicted(fit, x, used, q)
        centre.append(value)
        response.append(fit.mean[:, 1 : 1 + q])
        spread.append(own + fit.noise[None, :])
    return Table(
        name=f"{effect}+{second}" if second else effect or NONE,
        quantiles=given if second_quantiles is None else np.hstack([given, second_quantiles]),
        logit=logit * factor,
        slope=emulator.outcome.mean[:, 1 : 1 + q],
        factor=factor,
        centre=tuple(centre),
        response=tuple(response),
        variance=tuple(spread),
    )


def _predicted(fit: Fit, x: Array, used: NDArray[np.int64], q: int) -> tuple[Array, Array]:
    part = x[:, used]
    covariance = fit.covariance[:, used[:, None], used[None, :]]
    variance = np.einsum("gi,tij,gj->gt", part, covariance, part, optimize=True)
    # Nuisances of unit variance carry their coefficients' errors along.
    variance += np.einsum("tii->t", fit.covariance[:, 1 : 1 + q, 1 : 1 + q])[None, :]
    return part @ fit.mean[:, used].T, variance


def _lapsed(p: Array) -> Array:
    return LAPSE + (1 - 2 * LAPSE) * p


def posterior(table: Table, data: Data) -> Posterior:
    """Evidence and posterior of one hypothesis under each campaign."""
    campaigns, q = len(data), table.slope.shape[1]
    nodes = table.nodes
    known = np.isfinite(data.overturned)[:, None, :]
    y = np.where(known, data.overturned[:, None, :], 0.5)
    z = np.zeros((campaigns, nodes, q))
    outer = (table.slope[:, :, None] * table.slope[:, None, :]).reshape(-1, q * q)
    feature_parts = _feature_parts(table, data)
    hessian = np.zeros((campaigns, nodes, q, q))
    for _ in range(_STEPS):
        shift = z @ table.slope.T
        p = 1 / (1 + np.exp(-np.clip(table.logit + table.factor * shift, -30, 30)))
        residual = np.where(known, y - p, 0.0) * table.factor
        weight = np.where(known, p * (1 - p), 0.0) * table.factor**2
        slope = residual @ table.slope - z
        hessian = (weight.reshape(-1, weight.shape[-1]) @ outer).reshape(campaigns, nodes, q, q)
        for value, response, variance, products in feature_parts:
            gap = value - z @ response.T
            tail = (DEGREES + 1) / (DEGREES * variance + np.nan_to_num(gap) ** 2)
            tail = np.where(np.isfinite(gap), tail, 0.0)
            slope += (tail * np.nan_to_num(gap)) @ response
            hessian += (tail.reshape(-1, tail.shape[-1]) @ products).reshape(hessian.shape)
        hessian[..., np.arange(q), np.arange(q)] += 1.0
        step = np.linalg.solve(hessian, slope[..., None])[..., 0]
        length = np.linalg.norm(step, axis=-1, keepdims=True)
        z = z + step * np.minimum(1.0, 2.0 / np.maximum(length, 1e-12))
    value = log_likelihood(table, data, z).sum(axis=-1) - 0.5 * (z**2).sum(axis=-1)
    best = value.max(axis=1)
    value -= 0.5 * np.linalg.slogdet(hessian)[1]
    top = value.max(axis=1, keepdims=True)
    evidence = np.log(np.exp(value - top).mean(axis=1)) + top[:, 0]
    return Posterior(
        evidence, value - evidence[:, None] - np.log(nodes), z, np.linalg.inv(hessian), best
    )


def _feature_parts(table: Table, data: Data) -> list[tuple[Array, Array, Array, Array]]:
    out = []
    q = table.slope.shape[1]
    for k, (centre, response, variance) in enumerate(
        zip(table.centre, table.response, table.variance, strict=True)
    ):
        value = data.features[:, None, :, k] - centre[None]
        products = (response[:, :, None] * response[:, None, :]).reshape(-1, q * q)
        out.append((value, response, variance, products))
    return out


def log_likelihood(table: Table, data: Data, z: Array) -> Array:
    """Of each trial at given nuisances, shape (campaigns, nodes, trials); 0 where unknown."""
    from scipy.special import gammaln

    p = 1 / (1 + np.exp(-np.clip(table.logit + table.factor * (z @ table.slope.T), -30, 30)))
    p = _lapsed(p)
    y = data.overturned[:, None, :]
    known = np.isfinite(y)
    # An expected outcome between 0 and 1 gives the expected log likelihood.
    likely = np.nan_to_num(y)
    out = np.where(known, likely * np.log(p) + (1 - likely) * np.log1p(-p), 0.0)
    constant = gammaln(0.5 * (DEGREES + 1)) - gammaln(0.5 * DEGREES)
    constant -= 0.5 * np.log(DEGREES * np.pi)
    for value, response, variance, _ in _feature_parts(table, data):
        gap = value - z @ response.T
        density = constant - 0.5 * np.log(variance)
        density = density - 0.5 * (DEGREES + 1) * np.log1p(gap**2 / (DEGREES * variance))
        out = out + np.where(np.isfinite(gap), density, 0.0)
    return np.asarray(out, dtype=np.float64)


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


def predict(table: Table, found: Posterior) -> Prediction:
    """Average a hypothesis' predictions over its posterior."""
    weight = np.exp(found.nodes)
    spread = np.einsum("ti,cgij,tj->cgt", table.slope, found.covariance, table.slope, optimize=True)
    logit = table.logit + table.factor * (found.nuisance @ table.slope.T)
    p = _lapsed(1 / (1 + np.exp(-logit / np.sqrt(1 + np.pi / 8 * table.factor**2 * spread))))
    probability = np.einsum("cg,cgt->ct", weight, p)
    centres, deviations = [], []
    for centre, response, variance in zip(
        table.centre, table.response, table.variance, strict=True
    ):
        value = centre + found.nuisance @ response.T
        own = variance + np.einsum(
            "ti,cgij,tj->cgt", response, found.covariance, response, optimize=True
        )
        middle = np.einsum("cg,cgt->ct", weight, value)
        second = np.einsum("cg,cgt->ct", weight, value**2 + own)
        centres.append(middle)
        deviations.append(np.sqrt(np.maximum(second - middle**2, 1e-12)))
    shape = (*probability.shape, 0)
    return Prediction(
        probability,
        np.stack(centres, axis=-1) if centres else np.zeros(shape),
        np.stack(deviations, axis=-1) if deviations else np.zeros(shape),
    )
