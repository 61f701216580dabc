"""Route B: a classifier trained on whole simulated campaigns, without a likelihood.

Each simulated campaign is reduced to residuals against what is expected without effect, and these
to their projections on directions in which each effect moves campaigns, on leading principal
components, and on order and condition. Extremely randomised trees (P. Geurts et al., "Extremely
randomized trees", Machine Learning 63, 2006) learn the class; their probabilities are calibrated
later, on campaigns that they did not see.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.likelihood.emulator import design_matrix
from vsr2.diagnosis.likelihood.evidence import Data
from vsr2.diagnosis.likelihood.linear_algebra import singular_values
from vsr2.diagnosis.simulated.design import Design
from vsr2.diagnosis.simulated.library import Library

Array = NDArray[np.float64]

TREES = 200
_COMPONENTS = 12
_RIDGE = 1.0


@dataclass(frozen=True, eq=False)
class TrialConditions:
    """Where each trial stands, for residuals by place.

    Attributes:
        order: 0 to 1, shape (trials,).
        log_pga, log_ratio: shape (trials,).
    """

    order: Array
    log_pga: Array
    log_ratio: Array

    def directions(self) -> Array:
        """Orthogonal weights of trials: mean, order, conditions, shape (directions, trials)."""

        def centred(value: Array) -> Array:
            filled = np.where(np.isfinite(value), value, np.nanmean(value))
            return np.asarray(filled - filled.mean(), dtype=np.float64)

        rows = [np.ones(self.order.size), centred(self.order)]
        rows += [centred(self.log_pga), centred(self.log_ratio)]
        rows.append(centred(np.abs(centred(self.order))))
        norms = [max(float(np.linalg.norm(row)), 1e-9) for row in rows]
        return np.stack([row / norm for row, norm in zip(rows, norms, strict=True)])


@dataclass(frozen=True, eq=False)
class Classifier:
    """A trained classifier and the reduction it was trained on."""

    labels: tuple[str, ...]
    centre: Array
    scale: Array
    directions: Array
    model: Any

    def reduce(self, data: Data) -> Array:
        """Projections of campaigns' residuals, shape (campaigns, directions)."""
        return _standard(_flat(data), self.centre, self.scale) @ self.directions.T

    def log_probability(self, data: Data) -> Array:
        """Of each label, shape (campaigns, labels)."""
        found = self.model.predict_proba(self.reduce(data))
        out = np.full((len(data), len(self.labels)), 1e-4)
        for k, label in enumerate(self.model.classes_):
            out[:, self.labels.index(label)] += found[:, k]
        return np.asarray(np.log(out / out.sum(axis=1, keepdims=True)), dtype=np.float64)


def train(
    library: Library,
    design: Design,
    conditions: TrialConditions,
    labels: tuple[str, ...],
    seed: int,
) -> Classifier:
    """Train on simulated campaigns; "" of the design is the first label."""
    from sklearn.ensemble import ExtraTreesClassifier

    data = _flat(Data(design.overturned, design.features))
    none = design.effect == ""
    with np.errstate(invalid="ignore"):
        known = np.isfinite(data[none]).sum(axis=0)
        centre = np.where(known > 0, np.nansum(data[none], axis=0) / np.maximum(known, 1), 0.0)
        square = np.nansum((data[none] - centre) ** 2, axis=0) / np.maximum(known, 1)
    trials = design.overturned.shape[1]
    least = np.full(data.shape[1], 0.04)
    least[:trials] = 0.05
    scale = np.sqrt(square + least)
    residual = _standard(data, centre, scale)
    directions = _directions(library, design, residual, conditions, data.shape[1] // trials)
    names = np.where(none, labels[0], design.effect)
    model = ExtraTreesClassifier(
        TREES,
        min_samples_leaf=2,
        max_features="sqrt",
        class_weight="balanced",
        random_state=seed,
        n_jobs=1,
    )
    model.fit(residual @ directions.T, names)
    return Classifier(labels, centre, scale, directions, model)


def _flat(data: Data) -> Array:
    """Outcomes, then features one after the other, shape (campaigns, trials * (1 + k))."""
    parts = [data.overturned] + [data.features[..., k] for k in range(data.features.shape[-1])]
    return np.concatenate(parts, axis=1)


def _standard(data: Array, centre: Array, scale: Array) -> Array:
    return np.clip(np.nan_to_num((data - centre) / scale, nan=0.0), -5, 5)


def _directions(
    library: Library, design: Design, residual: Array, conditions: TrialConditions, channels: int
) -> Array:
    x, blocks = design_matrix(library, list(design.effect), design.quantiles, design.nuisances)
    rows = [residual[design.effect == ""]]
    found: list[Array] = []
    for name, block in blocks.items():
        member = design.effect == name
        part = x[member][:, block]
        gram = part.T @ part + _RIDGE * np.eye(part.shape[1])
        slopes = np.linalg.solve(gram, part.T @ residual[member])
        found.extend(slopes)
        rows.append(residual[member])
    nuisance = np.linalg.lstsq(
        np.hstack([np.ones((len(x), 1)), design.nuisances]), residual, rcond=None
    )[0][1:]
    found.extend(nuisance)
    pooled = np.concatenate(rows)
    pooled = pooled - pooled.mean(axis=0)
    components = singular_values(pooled)[2][:_COMPONENTS]
    plain = conditions.directions()
    spread = [np.kron(np.eye(channels)[c], row) for c in range(channels) for row in plain]
    out = np.stack([*found, *components, *spread])
    return np.asarray(
        out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9), dtype=np.float64
    )
