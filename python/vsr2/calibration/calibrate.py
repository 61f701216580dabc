"""From a calibration study to its result: search, folds, profiles, comparison."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2 import _native
from vsr2.analysis import baseline_scores, classification_intervals
from vsr2.analysis.baseline import BaselineScore
from vsr2.calibration.calibration_study import (
    CalibrationSettings,
    CalibrationStudy,
    Joint,
    campaign_folder,
    start_values,
)
from vsr2.calibration.evaluation import Evaluator, campaign_sha256, usable_trials
from vsr2.calibration.profile import DEFAULT_CELLS, Profile, profiles
from vsr2.calibration.scores import as_predictions, metrics_of, objective_of
from vsr2.calibration.search import (
    Score,
    Step,
    best_step,
    design_values,
    joint_search,
    profile_values,
    sequential_search,
)
from vsr2.calibration.store import Evaluation, EvaluationStore
from vsr2.campaign import Campaign, load_campaign, motion_folds, motion_resamples
from vsr2.config.extended import Plain
from vsr2.errors import CampaignError, ResultError
from vsr2.results import base_provenance

_logger = logging.getLogger(__name__)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Fold:
    """One fold: values chosen on the other trials, judged on its own.

    Attributes:
        held_out: its trials, shape (trials,).
        values: chosen without them.
        training: objective on the other trials, as the search saw it.
        judged: objective on its own.
        predicted: of all trials with these values, shape (trials,); of its own trials all were
            simulated, as :attr:`CalibrationSettings.judged_with` has it.
    """

    held_out: Mask
    values: Mapping[str, Plain]
    training: float
    judged: float
    predicted: Array


@dataclass(frozen=True, eq=False)
class Screen:
    """What the screen assumed, and whether it held.

    Attributes:
        certain: trials that ended alike in all sets of the screen, shape (trials,).
        checked: of these how many were simulated with a chosen set: all with the calibrated
            values, and those of each fold with its values where they differ.
        wrong: of the checked how many ended otherwise than assumed.
    """

    certain: Mask
    checked: int
    wrong: int


@dataclass(frozen=True, eq=False)
class CalibrationResult:
    """What a calibration found.

    Attributes:
        campaign: the trials that were matched.
        settings: parameters, method, folds.
        steps: of the search on all trials, in order.
        extra: evaluations beyond these: of folds and profiles.
        searched: the best step of the search on all trials, which compares with the folds'.
        searched_in_sample: its objective on all trials, judged as the folds are.
        best: the best on all trials of all evaluated sets, those of folds and profiles included.
        start: the evaluation of the study's own values; None: they lie outside the ranges.
        folds: empty where there are none.
        fold: of each trial, -1 where there are none, shape (trials,).
        out_of_fold: prediction of each trial with values chosen without its motion (1, 0, NaN),
            shape (trials,); all NaN where there are no folds.
        in_sample: prediction of each trial with the best values (1, 0, NaN), shape (trials,).
        scores: of the calibrated simulator in sample and out of fold, then of the baselines.
        screen: None: every set was run on all trials.
        no_baselines: why the campaign gives no baselines; empty: it does.
        profiles: of each parameter.
        provenance: versions, hashes, seeds, wall time (JSON-serialisable).
    """

    campaign: Campaign
    settings: CalibrationSettings
    steps: tuple[Step, ...]
    extra: tuple[Evaluation, ...]
    searched: Step
    best: Step
    start: Evaluation | None
    folds: tuple[Fold, ...]
    fold: NDArray[np.int64]
    out_of_fold: Array
    searched_in_sample: float
    in_sample: Array
    scores: tuple[BaselineScore, ...]
    profiles: tuple[Profile, ...]
    screen: Screen | None = None
    no_baselines: str = ""
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @property
    def observed(self) -> Mask:
        """Outcomes, shape (trials,)."""
        found: Mask = self.campaign.overturned == 1
        return found

    @property
    def optimism(self) -> float:
        """Objective of the search in sample minus out of fold; NaN without folds."""
        if not self.folds:
            return float("nan")
        return self.searched_in_sample - objective_of(self.observed, self.out_of_fold)


Search = Callable[[Score, int], list[Step]]
"""Runs a search on a score; the number tells folds apart (0: all trials)."""


def cross_validate(search: Search, observed: Mask, fold: NDArray[np.int64]) -> list[Fold]:
    """Choose values on the other folds, judge them on each.

    The whole search is run again for each fold, on a score of the training trials alone, and
    chooses among the sets that it looked at itself: sets which another search found with the help
    of the held-out trials are no candidates.

    Args:
        search: gives the steps of a search on a score.
        observed: outcomes, shape (trials,).
        fold: of each trial from 0, shape (trials,).
    """
    found = []
    for k in range(int(fold.max()) + 1):
        held_out = fold == k
        training = ~held_out

        def score(evaluation: Evaluation, training: Mask = training) -> float:
            return objective_of(observed, evaluation.predicted, training)

        best = best_step(search(score, k + 1))
        found.append(
            Fold(
                held_out=held_out,
                values=best.evaluation.values,
                training=best.score,
                judged=objective_of(observed, best.evaluation.predicted, held_out),
                predicted=best.evaluation.predicted,
            )
        )
    return found


def evaluations_at_most(settings: CalibrationSettings) -> int | None:
    """Parameter sets that a calibration evaluates at most; None: not known beforehand."""
    method = settings.method
    if not isinstance(method, Joint):
        return None
    slices = sum(
        method.profile_points if one.values is None else len(one.values)
        for one in settings.parameters.values()
    )
    searches = 1 + settings.folds
    judged = searches if method.screen or settings.judged_with else 0
    sets = (
        method.design
        + len(method.sets)
        + searches * method.refine
        + (slices if method.profile_points else 0)
    )
    return sets + judged


def calibrate(
    study: CalibrationStudy,
    folder: str | Path,
    *,
    threads: int | None = None,
    on_evaluation: Callable[[Evaluation], None] | None = None,
) -> CalibrationResult:
    """Calibrate a study against its campaign.

    What is finished is kept in `folder`, of an evaluation under way its trials; the same call in
    the same folder goes on from there and gives what an uninterrupted call would have given.

    Args:
        study: what is calibrated.
        folder: for the evaluations; it exists.
        threads: as in :func:`vsr2.simulation.run_batch`; no result depends on it.
        on_evaluation: called with every new parameter set's evaluation, found or simulated.

    Raises:
        CalibrationInterrupted: Ctrl-C; what is finished is kept.
        CampaignError: the campaign cannot be used, or has fewer motions than folds.
        ConfigError, GeometryError, MotionError, SimulationError: a set that cannot be run.
        ResultError: the folder cannot be used, or holds evaluations on another campaign.
    """
    started = time.time()
    campaign = usable_trials(load_campaign(campaign_folder(study)))
    observed = campaign.overturned == 1
    if observed.all() or not observed.any():
        raise CampaignError(
            f"campaign {campaign.name!r}: all {len(campaign)} usable trials ended alike: no fit"
        )
    seed, settings = study.study.seed, study.own
    count = len(campaign)
    fold = motion_folds(campaign, settings.folds, seed) if settings.folds else np.full(count, -1)
    digest = campaign_sha256(campaign)
    with EvaluationStore(folder, digest, count) as store:
        evaluator = Evaluator(study, campaign, store, Path(folder), threads=threads)
        found = _evaluated(study, evaluator, observed, fold, on_evaluation)
        _logger.info(
            "%d sets searched, best objective %.4g; %d sets in all, %d of them simulated now",
            len(found.steps),
            found.searched.score,
            len(found.evaluate.seen),
            evaluator.simulated,
        )
    resamples = motion_resamples(campaign.motion_ids, settings.replicates, seed)
    out_of_fold = np.full(count, np.nan)
    for one in found.folds:
        out_of_fold[one.held_out] = one.predicted[one.held_out]
    chosen = {"out of fold": out_of_fold} if found.folds else {}
    chosen["in sample"] = found.final
    if found.best is not found.searched:
        chosen["in sample, best of all sets"] = found.in_sample
    scores, no_baselines = _compare(campaign, settings, seed, chosen)
    everything = list(found.evaluate.seen.values())
    best, cells = found.best.evaluation.values, _cells(settings)
    provenance = base_provenance(_native.build_facts()) | {
        "study": study.study.model_dump(mode="json"),
        "calibration": settings.model_dump(mode="json"),
        "campaign": {"name": campaign.name, "trials": len(campaign), "sha256": digest},
        "seed": seed,
        "evaluations": len(everything),
        "simulated_in_this_run": evaluator.simulated,
        "seconds_of_simulation": sum(one.seconds for one in everything),
        "wall_time_s": time.time() - started,
    }
    return CalibrationResult(
        campaign=campaign,
        settings=settings,
        steps=tuple(found.steps),
        extra=found.extra,
        searched=found.searched,
        best=found.best,
        start=found.evaluate.seen.get(_as_key(start_values(study))),
        folds=tuple(found.folds),
        fold=fold,
        out_of_fold=out_of_fold,
        searched_in_sample=objective_of(observed, found.final),
        in_sample=found.in_sample,
        screen=_screen(found),
        scores=tuple(scores),
        profiles=tuple(
            profiles(settings.parameters, everything, observed, resamples, best, cells=cells)
        ),
        no_baselines=no_baselines,
        provenance=provenance,
    )


@dataclass(frozen=True, eq=False)
class _Found:
    """What the evaluations of a calibration gave.

    Attributes:
        evaluate: with all evaluations it has seen.
        steps: of the search; the best of them is `searched`.
        extra: evaluations beside the search.
        best: of all.
        folds: judged on what they held out.
        final, in_sample: predictions of `searched` and `best`, as they are judged, shape (trials,).
    """

    evaluate: _Remembered
    steps: list[Step]
    extra: tuple[Evaluation, ...]
    searched: Step
    best: Step
    folds: list[Fold]
    final: Array
    in_sample: Array


def _evaluated(
    study: CalibrationStudy,
    evaluator: Evaluator,
    observed: Mask,
    fold: NDArray[np.int64],
    on_evaluation: Callable[[Evaluation], None] | None,
) -> _Found:
    """Search, cross-validate, and judge what was chosen."""
    settings, method = study.own, study.own.method
    screened = method.screen if isinstance(method, Joint) else 0
    evaluate = _Remembered(evaluator, on_evaluation, screened, len(observed))
    search = _search(study, evaluate, study.study.seed)
    steps = search(lambda one: objective_of(observed, one.predicted), 0)
    searched = best_step(steps)
    folds = cross_validate(search, observed, fold) if settings.folds else []
    if isinstance(method, Joint):
        chosen = searched.evaluation.values
        for values in profile_values(settings.parameters, chosen, method.profile_points):
            evaluate(values)
    everything = list(evaluate.seen.values())
    looked_at = {id(step.evaluation) for step in steps}
    extra = tuple(one for one in everything if id(one) not in looked_at)
    beyond = [Step(0, "extra", one, objective_of(observed, one.predicted)) for one in extra]
    best = best_step([searched, *beyond])

    def judge(one: Evaluation, among: Mask) -> Array:
        if not screened and not settings.judged_with:
            return one.predicted
        found = evaluator(one.values, among=among, keys=settings.judged_with)
        if on_evaluation is not None:
            on_evaluation(found)
        return np.where(among, found.predicted, one.predicted)

    every = np.ones(len(observed), dtype=np.bool_)
    final = judge(searched.evaluation, every)
    in_sample = final if best is searched else judge(best.evaluation, every)
    by_id = {id(one.predicted): one for one in everything}
    folds = [
        replace(
            one,
            predicted=(predicted := judge(by_id[id(one.predicted)], one.held_out)),
            judged=objective_of(observed, predicted, one.held_out),
        )
        for one in folds
    ]
    return _Found(evaluate, steps, extra, searched, best, folds, final, in_sample)


def _screen(found: _Found) -> Screen | None:
    """How often the screen was wrong where it was checked; None: nothing was screened."""
    evaluate = found.evaluate
    if not evaluate.screen:
        return None
    # A fold that chose the same values is no further check.
    others = [one for one in found.folds if one.values != found.best.evaluation.values]
    checks = [(evaluate.certain, found.in_sample)]
    checks += [(evaluate.certain & one.held_out, one.predicted) for one in others]
    return Screen(
        certain=evaluate.certain,
        checked=int(sum(among.sum() for among, _ in checks)),
        wrong=int(sum((among & (p != evaluate.assumed)).sum() for among, p in checks)),
    )


def _cells(settings: CalibrationSettings) -> int:
    points = settings.method.profile_points if isinstance(settings.method, Joint) else 0
    return points or DEFAULT_CELLS


def _as_key(values: Mapping[str, Plain]) -> str:
    return repr(sorted(values.items()))


class _Remembered:
    """Evaluates each parameter set once a run, and remembers all in order.

    Once the first `screen` sets are there, trials that ended alike in all of them are taken to end
    so, and are run no more.
    """

    def __init__(
        self,
        evaluate: Evaluator,
        on_evaluation: Callable[[Evaluation], None] | None,
        screen: int,
        trials: int,
    ) -> None:
        self.seen: dict[str, Evaluation] = {}
        self.certain = np.zeros(trials, dtype=np.bool_)
        self.assumed = np.full(trials, np.nan)
        self._evaluate = evaluate
        self._on_evaluation = on_evaluation
        self.screen = screen

    def __call__(self, values: Mapping[str, Plain]) -> Evaluation:
        key = _as_key(values)
        if key not in self.seen:
            found = self._evaluate(values, among=~self.certain)
            # Also where an earlier run knows better: a resumed search must see the same.
            predicted = np.where(self.certain, self.assumed, found.predicted)
            self.seen[key] = replace(found, predicted=predicted)
            if len(self.seen) == self.screen:
                self._settle()
            if self._on_evaluation is not None:
                self._on_evaluation(self.seen[key])
        return self.seen[key]

    def _settle(self) -> None:
        ends = np.stack([one.predicted for one in self.seen.values()])
        self.certain = (ends == ends[0]).all(axis=0)
        self.assumed = np.where(self.certain, ends[0], np.nan)


def _search(study: CalibrationStudy, evaluate: _Remembered, seed: int) -> Search:
    settings, method = study.own, study.own.method
    parameters, start = settings.parameters, start_values(study)
    if not isinstance(method, Joint):
        return lambda score, _: sequential_search(parameters, start, evaluate, score, method)
    design: list[Evaluation] = []

    def search(score: Score, part: int) -> list[Step]:
        if not design:
            sets = design_values(parameters, start, method.design, seed)
            sets += [dict(start) | given for given in method.sets]
            design.extend(evaluate(values) for values in sets)
        own = int(np.random.SeedSequence(seed, spawn_key=(part,)).generate_state(1)[0])
        return joint_search(parameters, design, evaluate, score, method, own)

    return search


def _compare(
    campaign: Campaign,
    settings: CalibrationSettings,
    seed: int,
    chosen: Mapping[str, Array],
) -> tuple[list[BaselineScore], str]:
    """The simulator's scores by how it was fitted, then the baselines' or why there are none."""
    observed = campaign.overturned == 1

    def score(fitted: str, predicted: Array) -> BaselineScore:
        return BaselineScore(
            name="simulator",
            fitted=fitted,
            metrics=metrics_of(observed, predicted),
            intervals=classification_intervals(
                observed,
                as_predictions(observed, predicted),
                campaign.motion_ids,
                replicates=settings.replicates,
                seed=seed,
            ),
        )

    found = [score(fitted, predicted) for fitted, predicted in chosen.items()]
    folds = settings.folds or min(10, len(set(campaign.motion_ids)))
    try:
        return [
            *found,
            *baseline_scores(campaign, folds=folds, seed=seed, replicates=settings.replicates),
        ], ""
    except (CampaignError, ResultError) as error:
        return found, str(error)
