"""Both routes on held-out simulated campaigns and on the observed one; probabilities calibrated.

Simulated campaigns are dealt into folds by draw, so that no campaign is judged by an emulator or a
classifier that saw its draw of nuisances. On the held-out ones the two routes' log probabilities
are weighted (a product of experts with fitted exponents, G. E. Hinton, 2002, fitted by log score),
so that stated probabilities are those at which labels are right.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.likelihood.emulator import Emulator, fit_emulator, relative_errors
from vsr2.diagnosis.likelihood.equivalence import classes, evened, taken_for_same
from vsr2.diagnosis.likelihood.evidence import (
    Data,
    Posterior,
    Prediction,
    Table,
    posterior,
    predict,
    tabulate,
)
from vsr2.diagnosis.likelihood.linear_algebra import one_blas_thread
from vsr2.diagnosis.likelihood.score import crossfitted_none, losses, novelty_statistics
from vsr2.diagnosis.simulated.design import Design
from vsr2.diagnosis.simulated.library import (
    NONE,
    UNKNOWN,
    Entry,
    Library,
    free_parameters,
    is_angle,
)
from vsr2.diagnosis.where.discrepancy import disturbed
from vsr2.diagnosis.where.null_campaigns import null_campaigns
from vsr2.diagnosis.where.scan import residuals
from vsr2.diagnosis.which.amortised import Classifier, TrialConditions, train
from vsr2.diagnosis.which.novelty import PRIOR, Misfit, OutOfLibrary, fit_out_of_library
from vsr2.diagnosis.which.tempering import (
    Judged,
    Tempering,
    pairwise_exponent,
    sharpness,
    strengths,
)

Array = NDArray[np.float64]
Step = Callable[[float], None]

FOLDS = 6
PRIOR_NONE = 0.25
"""Prior probability that nothing is missing; the effects share the rest equally."""
SET_LEVEL = 0.9
EXPECTED = (0.6, 0.2, 0.06, 3.5, 0.06)
"""Of a combination: power, error, against, limit, exponent of route B. About what two protocols of
a block, 133 trials and 24 draws of 28 effects each, gave without a prior."""
DOUBT = (0.7, 0.7, 1.0, 0.5, 1.2)
"""Standard deviations of their logarithms: what few campaigns do not tell must not run away."""
STARTS = (EXPECTED, (0.07, 0.04, 0.05, 3.5, 0.1), (0.5, 0.1, 0.5, 10.0, 0.5))
"""From which a combination is sought."""
CALIBRATED = 24, 192
"""Draws of every effect, and without, that calibrate at most: more of them would sharpen the
emulators, which take little time, and hardly the calibration, which takes most of it."""
LEAST_HALF = 6
"""Draws of an effect from which half of them are judged alone."""
GAP_QUANTILE = 0.95
"""Of the strengths of campaigns without effect: above it there is something to tell apart."""


@dataclass(frozen=True)
class Combination:
    """How the two routes' log probabilities become one.

    Exponents of routes A and B temper what the data say; the prior counts in full. What route A
    says for an effect, against none, is worth another power than what it says against it: that an
    effect explains what none does not is a finding, that it does worse than none is often the
    emulator's error where the effect is weak. Against it, therefore, it says no more than a limit.

    Attributes:
        likelihood: exponent of route A where it speaks for an effect.
        against: the same where it speaks against one.
        limit: that a tempered log likelihood ratio against an effect approaches [nat].
        classifier: exponent of route B.
    """

    likelihood: Tempering
    against: float
    limit: float
    classifier: float

    def log_probability(self, likelihood: Array, classifier: Array, prior: Array) -> Array:
        """Of each label, normalised, shape (..., labels).

        Args:
            likelihood: log probabilities by route A, the prior within, "none" first, shape
                (..., labels).
            classifier: log probabilities by route B, of equally frequent labels, likewise.
            prior: its logarithm, shape (labels,).
        """
        ratio = likelihood - prior
        ratio = ratio - ratio[..., :1]
        unlimited = self.likelihood.weight(likelihood)[..., None] * np.maximum(ratio, 0.0)
        against = self.against * np.minimum(ratio, 0.0)
        if np.isfinite(self.limit):
            against = self.limit * np.expm1(against / self.limit)
        return _normal(unlimited + against + self.classifier * classifier + prior)


@dataclass(frozen=True, eq=False)
class Calibration:
    """Held-out simulated campaigns, as the observed one is treated.

    Attributes:
        labels: hypotheses, "none" first.
        truth: index of the true label, shape (rows,).
        weight: of each campaign, its label's prior probability over the label's number of
            campaigns, shape (rows,).
        likelihood, classifier: log probabilities of routes A and B, shape (rows, labels).
        combination: of A and B.
        pairwise: exponent of a log likelihood ratio of two effects, where there is a gap.
        sharpness: of the posterior of parameters, for estimates and for intervals, learnt on
            campaigns as another simulator would have them.
        probability: weighted and normalised, shape (rows, labels).
        gap: cross-fitted mean loss of the model without effects, shape (rows,).
        floor: of each trial, its mean loss in the gap-free campaigns, shape (trials,).
        misfit: of the best hypotheses by route A.
        out_of_library: what misfit says of a cause outside the library.
        unknown: probability of such a cause in each campaign, shape (rows,).
        unknown_left_out: the same of campaigns whose effect was left out, shape (campaigns,).
        null: residuals and variances of the gap-free campaigns, as another simulator would have
            them, each (campaigns, channels, trials).
    """

    labels: tuple[str, ...]
    truth: NDArray[np.int64]
    weight: Array
    likelihood: Array
    classifier: Array
    combination: Combination
    pairwise: float
    sharpness: tuple[Tempering, Tempering]
    probability: Array
    gap: Array
    floor: Array
    misfit: Misfit
    out_of_library: OutOfLibrary
    unknown: Array
    unknown_left_out: Array
    null: tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class Inference:
    """What the observed campaign says.

    Attributes:
        labels: hypotheses, "none" first.
        posteriors: route A, by label.
        likelihood, classifier: log probabilities of routes A and B, shape (labels,).
        probability: calibrated, shape (labels,); in a class, of effects that theory takes for about
            the same, with odds that their separation allows.
        classes: of effects that the campaign does not tell apart, the most probable first.
        unlimited: as calibrated, without a limit to what route A says against effects, shape
            (labels,).
        exponent: with which a log likelihood ratio of two effects counts, at most 1.
        before: cross-fitted prediction of the model without effects.
        loss: of each trial under it, shape (trials,).
        gap_p, direction_p: share of simulated gap-free campaigns with at least this gap, and with
            at least these odds against "none".
        novelty_p: share of simulated campaigns of the library that the best hypothesis fits no
            better.
        strength: S^2 of the best effect.
        unknown: probability of a cause outside the library.
        conformal: labels of the 90 % sets of both routes together, "unknown" and what theory takes
            for the same as its leading member among them, of A and of B.
    """

    labels: tuple[str, ...]
    posteriors: dict[str, Posterior]
    likelihood: Array
    classifier: Array
    probability: Array
    classes: list[list[str]]
    unlimited: Array
    exponent: float
    before: Prediction
    loss: Array
    gap_p: float
    direction_p: float
    novelty_p: float
    strength: float
    unknown: float
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
        drawn: as `Calibration.null`, of campaigns drawn from the fitted model of no effect.
        conditions: of the trials.
        motion: index of each trial's ground motion.
        halves: the same by draws of odd and of even number alone, with the calibration of all;
            empty where these are fewer than `LEAST_HALF` of an effect.
    """

    library: Library
    labels: tuple[str, ...]
    emulator: Emulator
    tables: dict[str, Table]
    classifier: Classifier
    calibration: Calibration
    drawn: tuple[Array, Array]
    conditions: TrialConditions
    motion: NDArray[np.int64]
    halves: tuple[Prepared, ...] = ()


@one_blas_thread()
def prepare(
    library: Library,
    design: Design,
    draws: NDArray[np.int64],
    conditions: TrialConditions,
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
        conditions: of the trials.
        motion: index of each trial's ground motion.
        seed: of the classifier.
        step: called with the share done.
    """
    labels = (NONE, *library)
    report = (lambda share: None) if step is None else step
    judged = draws <= np.where(design.effect == "", CALIBRATED[1], CALIBRATED[0])
    folds = [
        (np.flatnonzero(draws % FOLDS != fold), np.flatnonzero((draws % FOLDS == fold) & judged))
        for fold in range(FOLDS)
    ]
    emulators = [fit_emulator(library, design.take(inside)) for inside, _ in folds]
    wrong = relative_errors(
        library, [(e, design.take(held)) for e, (_, held) in zip(emulators, folds, strict=True)]
    )
    emulators = [replace(emulator, wrong=wrong) for emulator in emulators]
    calibration = _calibrate(
        library, design, folds, emulators, conditions, motion, labels, seed, report
    )
    emulator = replace(fit_emulator(library, design), wrong=wrong)
    tables = _tables(emulator, labels)
    classifier = train(library, design, conditions, labels, seed)
    gap_free = Data(design.overturned, design.features).take(
        np.flatnonzero((design.effect == "") & judged)
    )
    drawn = null_campaigns(tables[NONE], gap_free, seed=seed)
    rng = np.random.default_rng([seed, 8])
    drawn = _of_another(drawn, emulator, motion, rng)
    nulls = residuals(crossfitted_none(tables[NONE], drawn, motion), drawn)
    fitted = Prepared(
        library, labels, emulator, tables, classifier, calibration, nulls, conditions, motion
    )
    parts = [np.flatnonzero(draws % 2 == parity) for parity in (1, 0)]
    fewest = min(np.count_nonzero(design.effect[p] == name) for p in parts for name in library)
    if fewest >= LEAST_HALF:
        halves = tuple(_refitted(fitted, design.take(part), seed) for part in parts)
        fitted = replace(fitted, halves=halves)
    report(1.0)
    return fitted


def _refitted(prepared: Prepared, design: Design, seed: int) -> Prepared:
    """Both routes fitted to other simulated campaigns, their calibration as it is."""
    emulator = fit_emulator(prepared.library, design)
    emulator = replace(emulator, wrong=prepared.emulator.wrong)
    return replace(
        prepared,
        emulator=emulator,
        tables=_tables(emulator, prepared.labels),
        classifier=train(prepared.library, design, prepared.conditions, prepared.labels, seed),
    )


def _tables(emulator: Emulator, labels: Sequence[str]) -> dict[str, Table]:
    return {label: tabulate(emulator, "" if label == NONE else label) for label in labels}


def infer(prepared: Prepared, observed: Data) -> Inference:
    """Evidence, calibrated probabilities, conformal sets and p values of one campaign."""
    labels, tables, calibration = prepared.labels, prepared.tables, prepared.calibration
    posteriors = {label: posterior(tables[label], observed) for label in labels}
    likelihood = _normal(
        np.array([posteriors[label].evidence[0] for label in labels]) + log_prior(labels)
    )
    classifier = prepared.classifier.log_probability(observed)[0]
    prior = log_prior(labels)
    combination = calibration.combination
    unlimited = replace(combination, limit=np.inf)
    probability = np.exp(combination.log_probability(likelihood, classifier, prior))
    best = labels[int(np.argmax(likelihood))]
    novelty = novelty_statistics(
        predict(tables[best], posteriors[best]), observed, prepared.conditions.directions()
    )[0]
    before = crossfitted_none(tables[NONE], observed, prepared.motion)
    loss = losses(before, observed)[0]
    strength = float(strengths(likelihood))
    novelty_p = calibration.misfit.p_value(novelty, labels.index(best), strength)
    unknown = float(calibration.out_of_library.probability(np.array(novelty_p), np.array(strength)))
    none = calibration.truth == 0
    against = _odds(calibration.probability)[none]
    stated = dict(zip(labels, probability.tolist(), strict=True))
    groups = classes(stated, tables, posteriors, observed, exponent=calibration.pairwise)
    conformal = _sets(calibration, probability, likelihood, classifier, unknown)
    conformal["both"] = _closed(conformal["both"], taken_for_same(stated, groups[0]))
    even = evened(stated, groups)
    return Inference(
        labels=labels,
        posteriors=posteriors,
        likelihood=likelihood,
        classifier=classifier,
        probability=np.array([even[label] for label in labels]),
        classes=groups,
        unlimited=np.exp(unlimited.log_probability(likelihood, classifier, prior)),
        exponent=calibration.pairwise,
        before=before,
        loss=loss,
        gap_p=upper_tail(calibration.gap[none], float(loss.mean())),
        direction_p=upper_tail(against, float(_odds(probability[None])[0])),
        novelty_p=novelty_p,
        strength=strength,
        unknown=unknown,
        conformal=conformal,
    )


def _closed(chosen: tuple[str, ...], same: Sequence[str]) -> tuple[str, ...]:
    """A set with all of those that theory takes for the same, where it holds one of them."""
    return tuple(dict.fromkeys((*chosen, *same))) if set(chosen) & set(same) else chosen


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
    folds: Sequence[tuple[NDArray[np.int64], NDArray[np.int64]]],
    emulators: Sequence[Emulator],
    conditions: TrialConditions,
    motion: NDArray[np.int64],
    labels: tuple[str, ...],
    seed: int,
    report: Step,
) -> Calibration:
    rows = len(design.effect)
    truth = np.array([labels.index(name or NONE) for name in design.effect])
    a, b = np.zeros((rows, len(labels))), np.zeros((rows, len(labels)))
    loss = np.zeros((rows, motion.size))
    known_misfit, left_out_misfit = np.zeros((rows, 0)), np.zeros((rows, 0))
    null: list[tuple[Array, Array]] = []
    judged: list[Judged] = []
    directions = conditions.directions()
    rng = np.random.default_rng([seed, 9])
    for fold, ((inside, held), emulator) in enumerate(zip(folds, emulators, strict=True)):
        data = Data(design.overturned[held], design.features[held])
        tables = [tabulate(emulator, "" if label == NONE else label) for label in labels]
        found = [posterior(table, data) for table in tables]
        a[held] = np.stack([one.evidence for one in found], axis=1)
        for k in range(1, len(labels)):
            mine = np.flatnonzero(truth[held] == k)
            true = [design.quantiles[held[row]] for row in mine]
            other = _of_another(data.take(mine), emulator, motion, rng)
            own = a[held[mine]] + log_prior(labels)
            judged += _judged(library[labels[k]], tables[k], other, true, own)
        plain = crossfitted_none(tables[0], data, motion)
        loss[held] = losses(plain, data)
        gap_free = np.flatnonzero(truth[held] == 0)
        other = _of_another(data.take(gap_free), emulator, motion, rng)
        null.append(residuals(crossfitted_none(tables[0], other, motion), other))
        own = a[held] + log_prior(labels)
        known_misfit = _placed(
            known_misfit, held, _misfits(tables, data, np.argmax(own, axis=1), directions)
        )
        left = np.where(_is_truth(truth[held], own), -np.inf, own)
        left_out_misfit = _placed(
            left_out_misfit, held, _misfits(tables, data, np.argmax(left, axis=1), directions)
        )
        classifier = train(library, design.take(inside), conditions, labels, seed)
        b[held] = classifier.log_probability(data)
        report((fold + 1) / (FOLDS + 1))
    chosen = np.sort(np.concatenate([held for _, held in folds]))
    truth, a, b, loss = truth[chosen], a[chosen], b[chosen], loss[chosen]
    known_misfit, left_out_misfit = known_misfit[chosen], left_out_misfit[chosen]
    prior = log_prior(labels)
    a = _normal(a + prior)
    counts = np.bincount(truth, minlength=len(labels))
    weight = np.exp(prior)[truth] / counts[truth]
    combination = _combination(a, b, prior, truth, weight)
    probability = np.exp(combination.log_probability(a, b, prior))
    floor = loss[truth == 0].mean(axis=0)
    gap = loss.mean(axis=1)
    misfit = Misfit(known_misfit, np.argmax(a, axis=1), strengths(a), weight)
    known_p = misfit.p_values(known_misfit, misfit.best, misfit.strength)
    left_out = np.flatnonzero(truth > 0)
    others = np.where(_is_truth(truth, a), -np.inf, a)[left_out]
    left_out_strength = strengths(others)
    left_out_p = misfit.p_values(
        left_out_misfit[left_out], np.argmax(others, axis=1), left_out_strength
    )
    out_of_library = fit_out_of_library(
        (known_p, misfit.strength),
        weight,
        (left_out_p, left_out_strength),
        _shows_gap(probability, gap, truth)[left_out],
    )
    return Calibration(
        labels,
        truth,
        weight,
        a,
        b,
        combination,
        _pairwise(a - prior, truth, strengths(a)),
        sharpness(judged),
        probability,
        gap,
        floor,
        misfit,
        out_of_library,
        out_of_library.probability(known_p, misfit.strength),
        out_of_library.probability(left_out_p, left_out_strength),
        (np.concatenate([n[0] for n in null]), np.concatenate([n[1] for n in null])),
    )


def _judged(
    entry: Entry, table: Table, data: Data, truth: Sequence[Array], likelihood: Array
) -> list[Judged]:
    """Posteriors of the parameters of campaigns' own effect."""
    if not len(data):
        return []
    straight = [j for j, p in enumerate(free_parameters(entry)) if not is_angle(p)]
    nodes = posterior(table, data).nodes
    return [
        Judged(
            nodes[i],
            table.fine.quantiles[:, straight],
            table.nearest(entry, true),
            true[straight],
            likelihood[i],
        )
        for i, true in enumerate(truth)
    ]


def _of_another(
    data: Data, emulator: Emulator, motion: NDArray[np.int64], rng: np.random.Generator
) -> Data:
    """Campaigns as another correct simulator would have them."""
    return Data(data.overturned, disturbed(data.features, emulator.scatter, motion, rng))


def _is_truth(truth: NDArray[np.int64], table: Array) -> NDArray[np.bool_]:
    """Where the columns of effects are a row's own effect; gap-free campaigns have none."""
    columns = np.arange(table.shape[1])
    return np.asarray((columns == truth[:, None]) & (columns > 0))


def _misfits(
    tables: Sequence[Table], data: Data, best: NDArray[np.int64], directions: Array
) -> Array:
    """Statistics of misfit of campaigns to the hypotheses given, shape (campaigns, statistics)."""
    out = np.zeros((best.size, 0))
    for k, table in enumerate(tables):
        mine = np.flatnonzero(best == k)
        if mine.size:
            part = data.take(mine)
            found = novelty_statistics(predict(table, posterior(table, part)), part, directions)
            out = _placed(out, mine, found)
    return out


def _placed(table: Array, rows: NDArray[np.int64], values: Array) -> Array:
    """The table with some rows filled; an empty one gets its columns."""
    if table.shape[1] == 0:
        table = np.zeros((len(table), values.shape[1]))
    table[rows] = values
    return table


def _shows_gap(probability: Array, gap: Array, truth: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Campaigns of effects with a larger gap, or greater odds, than nearly all gap-free ones."""
    none, odds = truth == 0, _odds(probability)
    large = gap > np.quantile(gap[none], 0.975)
    return np.asarray(~none & (large | (odds > np.quantile(odds[none], 0.975))))


def _normal(logs: Array) -> Array:
    from scipy.special import logsumexp

    return np.asarray(logs - logsumexp(logs, axis=-1, keepdims=True), dtype=np.float64)


def _combination(
    a: Array, b: Array, prior: Array, truth: NDArray[np.int64], weight: Array
) -> Combination:
    from scipy.optimize import minimize

    rows = np.arange(truth.size)

    def made(theta: Array) -> Combination:
        power, error, against, limit, classifier = (float(value) for value in np.exp(theta))
        # No likelihood is worth more than itself.
        return Combination(Tempering(min(power, 1.0), error), min(against, 1.0), limit, classifier)

    def loss(theta: Array) -> float:
        found = made(theta).log_probability(a, b, prior)
        lost = -float((weight * found[rows, truth]).sum() / weight.sum())
        return truth.size * lost + 0.5 * float((((theta - np.log(EXPECTED)) / DOUBT) ** 2).sum())

    # A sure likelihood and a doubtful one are two basins.
    found = [
        minimize(loss, np.log(start), method="Nelder-Mead", options={"maxiter": 600})
        for start in STARTS
    ]
    return made(min(found, key=lambda one: float(one.fun)).x)


def _pairwise(evidence: Array, truth: NDArray[np.int64], strength: Array) -> float:
    """Of campaigns stronger than nearly all without effect; of all with one where none is."""
    known = truth > 0
    strong = known & (strength > np.quantile(strength[truth == 0], GAP_QUANTILE))
    rows = strong if strong.any() else known
    return pairwise_exponent(evidence[rows][:, 1:], truth[rows] - 1)


def _odds(probability: Array) -> Array:
    none = np.clip(probability[:, 0], 1e-12, 1 - 1e-12)
    return np.asarray(np.log1p(-none) - np.log(none), dtype=np.float64)


def _sets(
    calibration: Calibration,
    probability: Array,
    likelihood: Array,
    classifier: Array,
    unknown: float,
) -> dict[str, tuple[str, ...]]:
    """Split-conformal sets: labels as probable as the true label was in 90 % of campaigns.

    The score of a label is its probability (V. Vovk et al., "Algorithmic Learning in a Random
    World", 2005); campaigns weigh by the prior of their label, those from outside the library by
    that of the unknown.
    """
    rows = np.arange(calibration.truth.size)

    def chosen(known: Array, own: Array, labels: tuple[str, ...], strange: Array) -> list[str]:
        weight = calibration.weight / calibration.weight.sum()
        scores = np.concatenate([known[rows, calibration.truth], strange])
        if strange.size:
            each = np.full(strange.size, PRIOR / strange.size)
            weight = np.concatenate([(1 - PRIOR) * weight, each])
        order = np.argsort(scores)
        total = np.cumsum(weight[order])
        # The finite-sample correction leaves one campaign more outside.
        place = int(np.searchsorted(total, 1 - SET_LEVEL - 1 / scores.size))
        threshold = scores[order][min(place, scores.size - 1)]
        ranked = [i for i in np.argsort(-own) if own[i] >= threshold] or [int(np.argmax(own))]
        return [labels[i] for i in ranked]

    blank = np.zeros(0)
    labels = calibration.labels
    fitted = calibration.probability * (1 - calibration.unknown[:, None])
    both = np.append(probability * (1 - unknown), unknown)
    return {
        "both": tuple(chosen(fitted, both, (*labels, UNKNOWN), calibration.unknown_left_out)),
        "likelihood": tuple(
            chosen(np.exp(calibration.likelihood), np.exp(likelihood), labels, blank)
        ),
        "classifier": tuple(
            chosen(np.exp(calibration.classifier), np.exp(classifier), labels, blank)
        ),
    }
