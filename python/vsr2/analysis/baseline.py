"""What a simulator has to beat: a logistic curve without physics, and peers' predictions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsr2.analysis.bootstrap import Interval, classification_intervals
from vsr2.analysis.intervals import INTERVALS
from vsr2.analysis.metrics import Classification, classification_metrics
from vsr2.campaign import Campaign, intensity_measures, motion_folds
from vsr2.errors import ResultError
from vsr2.motion import STANDARD_GRAVITY
from vsr2.one_line import counted
from vsr2.read_only import real_argument, truth_argument

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LogisticRules:
    """How the logistic curve is fitted; all are choices, none is fitted.

    Attributes:
        prior_width: standard deviation of the normal prior on coefficients of standardised terms:
            so wide that it decides only where the data do not, as where a line parts the outcomes
            without error.
        constant: spread below which a term counts as constant.
        iterations: of the solver at most.
        tolerance: of its gradient.
        folds: by motion; usual for cross-validation (Kohavi 1995).
    """

    prior_width: float = 10.0
    constant: float = 1e-12
    iterations: int = 10_000
    tolerance: float = 1e-8
    folds: int = 10


LOGISTIC = LogisticRules()


class Fitted(StrEnum):
    """On which trials a way of predicting was fitted."""

    OUT_OF_FOLD = "out_of_fold"
    IN_SAMPLE = "in_sample"
    BEST_OF_ALL = "best_of_all"
    """In sample, and the best of all sets that were evaluated."""
    GIVEN = "given"
    """Not by us: predictions that came with the campaign."""


@dataclass(frozen=True, eq=False)
class LogisticBaseline:
    """The no-physics model's probabilities of overturning.

    Attributes:
        used: which trials of the campaign it covers (outcome, PGA and PGV/PGA known), shape
            (trials,).
        fold: of each covered trial, shape (n,).
        out_of_fold: by the fit on the other folds, shape (n,).
        in_sample: by the fit on all, shape (n,).
    """

    used: NDArray[np.bool_]
    fold: NDArray[np.int64]
    out_of_fold: Array
    in_sample: Array


@dataclass(frozen=True, eq=False)
class BaselineScore:
    """How well one way of predicting agrees with the observed outcomes.

    Attributes:
        name: of the model, or of the campaign's column.
        fitted: on which trials.
        metrics: counts and scores.
        intervals: 95 %, by the names in :data:`vsr2.analysis.bootstrap.SCORES`.
    """

    name: str
    fitted: Fitted
    metrics: Classification
    intervals: Mapping[str, Interval]


def logistic_probability(
    pga: ArrayLike,
    pgv_pga: ArrayLike,
    overturned: ArrayLike,
    at_pga: ArrayLike,
    at_ratio: ArrayLike,
) -> Array:
    """Probability of overturning by a logistic curve in a = ln PGA and b = ln PGV/PGA.

    logit p = c0 + c1 a + c2 b + c3 a^2 + c4 a b + c5 b^2, terms standardised on the fitted trials,
    coefficients but c0 under a normal prior (:class:`LogisticRules`), so that the fit exists for
    separable data, too. Where all fitted trials ended alike, p is (overturned + 1) / (n + 2).

    Args:
        pga: of the fitted trials, above 0, shape (n,), any unit.
        pgv_pga: of the fitted trials, above 0, shape (n,), any unit.
        overturned: of the fitted trials, boolean, shape (n,).
        at_pga: where p is wanted, shape (m,), unit of `pga`.
        at_ratio: where p is wanted, shape (m,), unit of `pgv_pga`.

    Returns:
        Shape (m,).

    Raises:
        ResultError: no trials, shapes that differ, an intensity that is not above 0, or outcomes
            that are not boolean.
    """
    truth = truth_argument(overturned, "overturned", ResultError)
    terms, wanted = _terms(pga, pgv_pga), _terms(at_pga, at_ratio)
    if truth.shape != (len(terms),) or truth.size == 0:
        raise ResultError(
            f"{counted(truth.size, 'outcome')} for {len(terms)} intensities; give one each"
        )
    if truth.all() or not truth.any():
        return np.full(len(wanted), (truth.sum() + 1.0) / (truth.size + 2.0))
    from sklearn.linear_model import LogisticRegression

    center, spread = terms.mean(axis=0), terms.std(axis=0)
    spread[spread < LOGISTIC.constant] = 1.0
    # scikit-learn minimises |c|^2 / 2 + C sum of losses, so C is the prior's variance.
    model = LogisticRegression(
        C=LOGISTIC.prior_width**2, max_iter=LOGISTIC.iterations, tol=LOGISTIC.tolerance
    )
    model.fit((terms - center) / spread, truth)
    probability = model.predict_proba((wanted - center) / spread)[:, 1]
    # Far from all fitted trials it rounds to 1, for which no score holds.
    least = float(np.finfo(np.float64).eps)
    return np.asarray(np.clip(probability, least, 1 - least))


def _terms(pga: ArrayLike, pgv_pga: ArrayLike) -> Array:
    first = np.atleast_1d(real_argument(pga, "PGA", ResultError))
    second = np.atleast_1d(real_argument(pgv_pga, "PGV/PGA", ResultError))
    if first.ndim != 1 or first.shape != second.shape:
        raise ResultError(f"PGA has shape {first.shape}, PGV/PGA {second.shape}; both must be (n,)")
    if not ((first > 0) & (second > 0) & np.isfinite(first + second)).all():
        raise ResultError("PGA and PGV/PGA must be finite and above 0; leave other trials out")
    a, b = np.log(first), np.log(second)
    return np.stack([a, b, a * a, a * b, b * b], axis=1)


def logistic_baseline(
    campaign: Campaign, *, folds: int = LOGISTIC.folds, seed: int = 0
) -> LogisticBaseline:
    """Fit the no-physics model to a campaign, in sample and out of fold.

    Folds keep the trials of a ground motion together (:func:`vsr2.campaign.motion_folds`).

    Args:
        campaign: trials without outcome, PGA or PGV/PGA are left out.
        folds: number of folds.
        seed: of the folds.

    Raises:
        ResultError: no trial has all three.
        CampaignError: fewer motions than folds.
        MotionError: intensity is to be measured of a motion that cannot be filtered.
    """
    measures = intensity_measures(campaign)
    # NaN compares as false, so that unknown intensities drop out, too.
    used = ~np.isnan(campaign.overturned) & (measures.pga_g > 0) & (measures.pgv_pga_s > 0)
    if not used.any():
        raise ResultError(
            f"campaign {campaign.name!r}: no trial has an outcome, PGA and PGV/PGA; give "
            "trials.csv pga_g and pgv_pga_s, or motions"
        )
    chosen = campaign.select(used)
    ratio, truth = measures.pgv_pga_s[used], chosen.overturned == 1
    # In m/s^2, as in the published figures: the prior is of squares, too, and so of the unit.
    pga = measures.pga_g[used] * STANDARD_GRAVITY
    fold = motion_folds(chosen, folds, seed)
    out_of_fold = np.full(truth.size, np.nan)
    for left_out in range(folds):
        test = fold == left_out
        out_of_fold[test] = logistic_probability(
            pga[~test], ratio[~test], truth[~test], pga[test], ratio[test]
        )
    return LogisticBaseline(
        used=used,
        fold=fold,
        out_of_fold=out_of_fold,
        in_sample=logistic_probability(pga, ratio, truth, pga, ratio),
    )


def peer_columns(campaign: Campaign) -> tuple[str, ...]:
    """The extra columns that hold predictions of the outcome: 0, 1 or blank throughout."""
    return tuple(name for name in campaign.extra_columns if _is_prediction(campaign.extra(name)))


def _is_prediction(column: Array) -> bool:
    known = column[~np.isnan(column)]
    return bool(known.size > 0 and np.isin(known, (0.0, 1.0)).all())


def baseline_scores(
    campaign: Campaign,
    *,
    folds: int = LOGISTIC.folds,
    seed: int = 0,
    replicates: int = INTERVALS.replicates,
) -> list[BaselineScore]:
    """The logistic curve (out of fold and in sample) and peers' predictions, scored alike.

    Overturning is predicted where its probability is above one half. All scores are over the
    trials that the logistic curve covers (a peer's over those it predicts), with intervals from the
    same bootstrap over motions.

    Args:
        campaign: what was observed.
        folds: of the logistic curve.
        seed: of folds and bootstrap.
        replicates: of the bootstrap.

    Raises:
        ResultError, CampaignError, MotionError: as :func:`logistic_baseline`.
    """
    baseline = logistic_baseline(campaign, folds=folds, seed=seed)
    chosen = campaign.select(baseline.used)
    truth, motions = chosen.overturned == 1, chosen.motion_ids

    def score(name: str, fitted: Fitted, guess: Array, threshold: float = 0.5) -> BaselineScore:
        known = ~np.isnan(guess)
        observed, predicted = truth[known], guess[known] > threshold
        return BaselineScore(
            name=name,
            fitted=fitted,
            metrics=classification_metrics(observed, predicted),
            intervals=classification_intervals(
                observed, predicted, motions[known], replicates=replicates, seed=seed
            ),
        )

    scores = [
        score("logistic", Fitted.OUT_OF_FOLD, baseline.out_of_fold),
        score("logistic", Fitted.IN_SAMPLE, baseline.in_sample),
    ]
    for name in peer_columns(campaign):
        column = campaign.extra(name)[baseline.used]
        if not np.isnan(column).all():
            scores.append(score(name, Fitted.GIVEN, column))
    return scores
