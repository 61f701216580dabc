"""Both routes on held-out simulated campaigns and on the observed one; probabilities calibrated.

Simulated campaigns are dealt into folds by draw, so that no campaign is judged by an emulator or a
classifier that saw its draw of nuisances. On the held-out ones the two routes' log probabilities
are weighted (a product of experts with fitted exponents, G. E. Hinton, 2002, fitted by log score),
so that stated probabilities are those at which labels are right.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.amortised import Classifier, Places, train
from vsr2.diagnosis.emulator import Design, Emulator, fit_emulator
from vsr2.diagnosis.evidence import Data, Posterior, Prediction, Table, posterior, predict, tabulate
from vsr2.diagnosis.library import NONE, Library
from vsr2.diagnosis.score import crossfitted_none, losses, novelty_statistics
from vsr2.diagnosis.where import residuals

Array = NDArray[np.float64]
Step = Callable[[float], None]

FOLDS = 3
PRIOR_NONE = 0.25
"""Prior probability that nothing is missing; the effects share the rest equally."""
SET_LEVEL = 0.9
_LEAST_ALIKE = 8


@dataclass(frozen=True, eq=False)
class Calibration:
    """Held-out simulated campaigns, as the observed one is treated.

    Attributes:
        labels: hypotheses, "none" first.
        truth: index of the true label, shape (rows,).
        weight: of each campaign, its label's prior probability over the label's number of
            campaigns, shape (rows,).
        likelihood, classifier: log probabilities of routes A and B, shape (rows, labels).
        exponents: of A and of B.
        sharpness: exponent of the posterior of parameters, at most 1.
        probability: weighted and normalised, shape (rows, labels).
        gap: cross-fitted mean loss of the model without effects, shape (rows,).
        floor: of each trial, its mean loss in the gap-free campaigns, shape (trials,).
        best: index of the best hypothesis by route A, shape (rows,).
        novelty: statistics of misfit of the best hypothesis, shape (rows, statistics).
        null: residuals and variances of the gap-free campaigns, each (campaigns, channels, trials).
    """

    labels: tuple[str, ...]
    truth: NDArray[np.int64]
    weight: Array
    likelihood: Array
    classifier: Array
    exponents: tuple[float, float]
    sharpness: float
    probability: Array
    gap: Array
    floor: Array
    best: NDArray[np.int64]
    novelty: Array
    null: tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class Inference:
    """What the observed campaign says.

    Attributes:
        labels: hypotheses, "none" first.
        posteriors: route A, by label.
        likelihood, classifier: log probabilities of routes A and B, shape (labels,).
        probability: calibrated, shape (labels,).
        before: cross-fitted prediction of the model without effects.
        loss: of each trial under it, shape (trials,).
        gap_p, direction_p: share of simulated gap-free campaigns with at least this gap, and with
            at least these odds against "none".
        novelty_p: share of simulated campaigns of the library that the best hypothesis fits no
            better.
        conformal: labels of the 90 % sets of both routes together, of A and of B.
    """

    labels: tuple[str, ...]
    posteriors: dict[str, Posterior]
    likelihood: Array
    classifier: Array
    probability: Array
    before: Prediction
    loss: Array
    gap_p: float
    direction_p: float
    novelty_p: float
    conformal: dict[str, tuple[str, ...]]


@dataclass(frozen=True, eq=False)
class Prepared:
    """All that does not depend on what was observed.

    Attributes:
        library: effects offered.
        labels: hypotheses, "none" first.
        emulator: fitted to all simulated campaigns.
        tables: route A, by label.
        classifier: route B, trained on all simulated campaigns.
        calibration: both on held-out campaigns.
        places: of the trials.
        motion: index of each trial's ground motion.
    """

    library: Library
    labels: tuple[str, ...]
    emulator: Emulator
    tables: dict[str, Table]
    classifier: Classifier
    calibration: Calibration
    places: Places
    motion: NDArray[np.int64]


def prepare(
    library: Library,
    design: Design,
    draws: NDArray[np.int64],
    places: Places,
    motion: NDArray[np.int64],
    *,
    seed: int = 0,
    step: Step | None = None,
) -> Prepared:
    """Fit and calibrate both routes.

    Args:
        library: effects offered.
        design: simulated campaigns of the kept trials.
        draws: of each simulated campaign.
        places: of the trials.
        motion: index of each trial's ground motion.
        seed: of the classifier.
        step: called with the share done.
    """
    labels = (NONE, *library)
    report = (lambda share: None) if step is None else step
    calibration = _calibrate(library, design, draws, places, motion, labels, seed, report)
    emulator = fit_emulator(library, design)
    tables = {label: tabulate(emulator, "" if label == NONE else label) for label in labels}
    classifier = train(library, design, places, labels, seed)
    report(1.0)
    return Prepared(library, labels, emulator, tables, classifier, calibration, places, motion)


def infer(prepared: Prepared, observed: Data) -> Inference:
    """Evidence, calibrated probabilities, conformal sets and p values of one campaign."""
    labels, tables, calibration = prepared.labels, prepared.tables, prepared.calibration
    posteriors = {label: posterior(tables[label], observed) for label in labels}
    likelihood = _normal(
        np.array([posteriors[label].evidence[0] for label in labels]) + log_prior(labels)
    )
    classifier = prepared.classifier.log_probability(observed)[0]
    probability = np.exp(_combined(likelihood, classifier, calibration.exponents))
    best = labels[int(np.argmax(likelihood))]
    novelty = novelty_statistics(
        predict(tables[best], posteriors[best]), observed, prepared.places.directions()
    )[0]
    before = crossfitted_none(tables[NONE], observed, prepared.motion)
    loss = losses(before, observed)[0]
    none = calibration.truth == 0
    against = _odds(calibration.probability)[none]
    return Inference(
        labels=labels,
        posteriors=posteriors,
        likelihood=likelihood,
        classifier=classifier,
        probability=probability,
        before=before,
        loss=loss,
        gap_p=upper_tail(calibration.gap[none], float(loss.mean())),
        direction_p=upper_tail(against, float(_odds(probability[None])[0])),
        novelty_p=_novelty_p(calibration, novelty, labels.index(best)),
        conformal=_sets(calibration, probability, likelihood, classifier),
    )


def log_prior(labels: tuple[str, ...]) -> Array:
    """Of the hypotheses, shape (labels,)."""
    out = np.full(len(labels), np.log((1 - PRIOR_NONE) / max(len(labels) - 1, 1)))
    out[0] = np.log(PRIOR_NONE)
    return out


def upper_tail(null: Array, value: float) -> float:
    """Share of null values at or above `value`, the value itself counted: never 0."""
    return float((1 + np.count_nonzero(null >= value)) / (1 + null.size))


def _calibrate(
    library: Library,
    design: Design,
    draws: NDArray[np.int64],
    places: Places,
    motion: NDArray[np.int64],
    labels: tuple[str, ...],
    seed: int,
    report: Step,
) -> Calibration:
    rows = len(design.effect)
    truth = np.array([labels.index(name or NONE) for name in design.effect])
    a, b = np.zeros((rows, len(labels))), np.zeros((rows, len(labels)))
    loss = np.zeros((rows, motion.size))
    novelty: Array | None = None
    null: list[tuple[Array, Array]] = []
    known: list[tuple[Array, int]] = []
    directions = places.directions()
    for fold in range(FOLDS):
        inside = np.flatnonzero(draws % FOLDS != fold)
        held = np.flatnonzero(draws % FOLDS == fold)
        emulator = fit_emulator(library, design.take(inside))
        data = Data(design.overturned[held], design.features[held])
        tables = [tabulate(emulator, "" if label == NONE else label) for label in labels]
        found = [posterior(table, data) for table in tables]
        a[held] = np.stack([one.evidence for one in found], axis=1)
        for k in range(1, len(labels)):
            for row in np.flatnonzero(truth[held] == k):
                node = tables[k].nearest(library[labels[k]], design.quantiles[held[row]])
                known.append((found[k].nodes[row], node))
        plain = crossfitted_none(tables[0], data, motion)
        loss[held] = losses(plain, data)
        gap_free = np.flatnonzero(truth[held] == 0)
        null.append(residuals(_rows(plain, gap_free), data.take(gap_free)))
        best = np.argmax(a[held] + log_prior(labels), axis=1)
        for k, table in enumerate(tables):
            mine = np.flatnonzero(best == k)
            if mine.size:
                part = data.take(mine)
                values = novelty_statistics(
                    predict(table, posterior(table, part)), part, directions
                )
                if novelty is None:
                    novelty = np.zeros((rows, values.shape[1]))
                novelty[held[mine]] = values
        classifier = train(library, design.take(inside), places, labels, seed)
        b[held] = classifier.log_probability(data)
        report((fold + 1) / (FOLDS + 1))
    a = _normal(a + log_prior(labels))
    counts = np.bincount(truth, minlength=len(labels))
    weight = np.exp(log_prior(labels))[truth] / counts[truth]
    exponents = _exponents(a, b, truth, weight)
    probability = np.exp(_combined(a, b, exponents))
    assert novelty is not None
    floor = loss[truth == 0].mean(axis=0)
    gap = loss.mean(axis=1)
    return Calibration(
        labels,
        truth,
        weight,
        a,
        b,
        exponents,
        _sharpness(known),
        probability,
        gap,
        floor,
        np.argmax(a, axis=1),
        novelty,
        (np.concatenate([n[0] for n in null]), np.concatenate([n[1] for n in null])),
    )


def _rows(prediction: Prediction, rows: NDArray[np.int64]) -> Prediction:
    return Prediction(
        prediction.probability[rows], prediction.centre[rows], prediction.deviation[rows]
    )


def _normal(logs: Array) -> Array:
    from scipy.special import logsumexp

    return np.asarray(logs - logsumexp(logs, axis=-1, keepdims=True), dtype=np.float64)


def _combined(a: Array, b: Array, exponents: tuple[float, float]) -> Array:
    # Route A is bounded, so that no single route rules a label out beyond all evidence.
    return _normal(
        exponents[0] * np.maximum(a, a.max(axis=-1, keepdims=True) - 30.0) + exponents[1] * b
    )


def _exponents(a: Array, b: Array, truth: NDArray[np.int64], weight: Array) -> tuple[float, float]:
    from scipy.optimize import minimize

    rows = np.arange(truth.size)

    def loss(theta: Array) -> float:
        pair = (float(np.exp(theta[0])), float(np.exp(theta[1])))
        return -float((weight * _combined(a, b, pair)[rows, truth]).sum() / weight.sum())

    found = minimize(loss, np.log([0.5, 0.5]), method="Nelder-Mead", options={"maxiter": 120})
    return float(np.exp(found.x[0])), float(np.exp(found.x[1]))


def _sharpness(known: list[tuple[Array, int]]) -> float:
    """Exponent at which posteriors of parameters give their true values the best log score."""
    from scipy.special import logsumexp

    powers = np.geomspace(0.03, 1.0, 25)
    score = np.zeros(powers.size)
    for nodes, true in known:
        scaled = powers[:, None] * nodes[None]
        score += scaled[:, true] - logsumexp(scaled, axis=1)
    return float(powers[int(np.argmax(score))]) if known else 1.0


def _odds(probability: Array) -> Array:
    none = np.clip(probability[:, 0], 1e-12, 1 - 1e-12)
    return np.asarray(np.log1p(-none) - np.log(none), dtype=np.float64)


def _novelty_p(calibration: Calibration, value: Array, best: int) -> float:
    """Share of the library's campaigns that fit no better: all, and those of the same best label.

    The larger share counts: an effect whose outcomes cannot be foretold (labels noted wrongly)
    leaves every one of its campaigns with a poor fit.
    """
    centre = np.median(calibration.novelty, axis=0)
    spread = np.quantile(calibration.novelty, 0.9, axis=0) - centre
    scale = np.maximum(spread, 1e-9)
    null = ((calibration.novelty - centre) / scale).max(axis=1)
    own = float(((value - centre) / scale).max())
    weight = calibration.weight / calibration.weight.mean()
    shares = [(weight[null >= own].sum() + 1) / (weight.sum() + 1)]
    alike = calibration.best == best
    if alike.sum() >= _LEAST_ALIKE:
        shares.append((np.count_nonzero(null[alike] >= own) + 1) / (alike.sum() + 1))
    return float(max(shares))


def _sets(
    calibration: Calibration, probability: Array, likelihood: Array, classifier: Array
) -> dict[str, tuple[str, ...]]:
    """Split-conformal sets: labels as probable as the true label was in 90 % of campaigns.

    The score of a label is its probability (V. Vovk et al., "Algorithmic Learning in a Random
    World", 2005); campaigns weigh by the prior of their label.
    """
    rows = np.arange(calibration.truth.size)
    out = {}
    for name, known, own in (
        ("both", calibration.probability, probability),
        ("likelihood", np.exp(calibration.likelihood), np.exp(likelihood)),
        ("classifier", np.exp(calibration.classifier), np.exp(classifier)),
    ):
        scores = known[rows, calibration.truth]
        order = np.argsort(scores)
        total = np.cumsum(calibration.weight[order]) / calibration.weight.sum()
        # The finite-sample correction leaves one campaign more outside.
        place = int(np.searchsorted(total, 1 - SET_LEVEL - 1 / rows.size))
        threshold = scores[order][min(place, rows.size - 1)]
        chosen = np.flatnonzero(own >= threshold)
        ranked = chosen[np.argsort(-own[chosen])]
        if not ranked.size:
            ranked = np.array([int(np.argmax(own))])
        out[name] = tuple(calibration.labels[i] for i in ranked)
    return out
