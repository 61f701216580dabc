"""From a calibration study to its result: search, folds, profiles, comparison."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vsr2 import _native
from vsr2.analysis import baseline_scores, classification_intervals
from vsr2.analysis.baseline import LOGISTIC, BaselineScore, Fitted
from vsr2.analysis.intervals import INTERVALS
from vsr2.analysis.probability import RELIABILITY
from vsr2.calibration.calibration_study import (
    CALIBRATION,
    CalibrationSettings,
    CalibrationStudy,
    Joint,
    campaign_folder,
    start_values,
)
from vsr2.calibration.evaluation import Evaluator, campaign_sha256, usable_trials
from vsr2.calibration.evaluation_store import Evaluation, EvaluationStore
from vsr2.calibration.objective import Objective, as_predictions, metrics_of, objective_of
from vsr2.calibration.profile import Profile, profiles
from vsr2.calibration.search import (
    Score,
    Step,
    best_step,
    design_values,
    joint_search,
    profile_values,
    sequential_search,
)
from vsr2.campaign import Campaign, load_campaign, motion_folds, motion_resamples
from vsr2.config.extended import Plain
from vsr2.ensemble.simulated.motion_noise import MOTION_NOISE
from vsr2.ensemble.simulated.simulator import SIMULATION
from vsr2.errors import CampaignError, ResultError
from vsr2.one_line import counted
from vsr2.results import base_provenance
from vsr2.simulation.run_constants import run_constants

if TYPE_CHECKING:
    import distributed

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Fold:
    """One fold: values chosen on the other trials, judged on its own.

    Attributes:
        held_out: its trials, shape (trials,).
        chosen: the set chosen without them.
        training: objective on the other trials, as the search saw it.
        judged: objective on its own.
        predicted: of all trials with the chosen values, shape (trials,); of its own trials all were
            simulated, as :attr:`CalibrationSettings.judged_with` has it.
    """

    held_out: Mask
    chosen: Evaluation
    training: float
    judged: float
    predicted: Array

    @property
    def values(self) -> Mapping[str, Plain]:
        """The values chosen."""
        return self.chosen.values


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


class NoBaselines(StrEnum):
    """Why a campaign gives no baselines; `vsr2.report.messages.runs` words it."""

    FEW_MOTIONS = "few_motions"
    NO_INTENSITIES = "no_intensities"


@dataclass(frozen=True, eq=False)
class CalibrationResult:
    """What a calibration found.

    Attributes:
        campaign: the trials that were matched.
        settings: parameters, method, folds.
        evaluations: every evaluated set once, in order: those of the search on all trials, then
            those of folds and profiles.
        steps: of the search on all trials, in order.
        searched: the best step of the search on all trials, which compares with the folds'.
        searched_predicted: prediction of each trial with its values, judged as the folds are
            (probability or NaN), shape (trials,).
        best: the best on all trials of all evaluated sets.
        in_sample: prediction of each trial with its values (probability or NaN), shape (trials,).
        start: the evaluation of the study's own values; None: they lie outside the ranges.
        folds: empty where there are none.
        fold: of each trial, -1 where there are none, shape (trials,).
        screen: None: every set was run on all trials.
        scores: of the calibrated simulator in sample and out of fold, then of the baselines.
        no_baselines: why the campaign gives no baselines; None: it does.
        profiles: of each parameter.
        provenance: versions, hashes, seeds, wall time (JSON-serialisable).
    """

    campaign: Campaign
    settings: CalibrationSettings
    evaluations: tuple[Evaluation, ...]
    steps: tuple[Step, ...]
    searched: Step
    searched_predicted: Array
    best: Step
    in_sample: Array
    start: Evaluation | None
    folds: tuple[Fold, ...]
    fold: NDArray[np.int64]
    screen: Screen | None = None
    scores: tuple[BaselineScore, ...] = ()
    no_baselines: NoBaselines | None = None
    profiles: tuple[Profile, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @property
    def observed(self) -> Mask:
        """Outcomes, shape (trials,)."""
        found: Mask = self.campaign.overturned == 1
        return found

    @property
    def out_of_fold(self) -> Array:
        """Prediction of each trial with values chosen without its motion, shape (trials,).

        Probability or NaN; all NaN where there are no folds.
        """
        found = np.full(len(self.campaign), np.nan)
        for one in self.folds:
            found[one.held_out] = one.predicted[one.held_out]
        return found

    @property
    def searched_in_sample(self) -> float:
        """Objective of the search on all trials, judged as the folds are."""
        return objective_of(self.observed, self.searched_predicted, None, self.settings.objective)

    @property
    def optimism(self) -> float:
        """Objective of the search in sample minus out of fold; NaN without folds."""
        if not self.folds:
            return float("nan")
        outside = objective_of(self.observed, self.out_of_fold, None, self.settings.objective)
        return self.searched_in_sample - outside


Search = Callable[[Score, int], list[Step]]
"""Runs a search on a score; the number tells folds apart (0: all trials)."""


def cross_validate(
    search: Search,
    observed: Mask,
    fold: NDArray[np.int64],
    objective: Objective = Objective.MEAN_OF_THREE,
) -> list[Fold]:
    """Choose values on the other folds, judge them on each.

    The whole search is run again for each fold, on a score of the training trials alone, and
    chooses among the sets that it looked at itself: sets which another search found with the help
    of the held-out trials are no candidates.

    Args:
        search: gives the steps of a search on a score.
        observed: outcomes, shape (trials,).
        fold: of each trial from 0, shape (trials,).
        objective: by which values are chosen and judged.
    """
    found = []
    for k in range(int(fold.max()) + 1):
        held_out = fold == k
        training = ~held_out

        def score(evaluation: Evaluation, training: Mask = training) -> float:
            return objective_of(observed, evaluation.predicted, training, objective)

        best = best_step(search(score, k + 1))
        found.append(
            Fold(
                held_out=held_out,
                chosen=best.evaluation,
                training=best.score,
                judged=objective_of(observed, best.evaluation.predicted, held_out, objective),
                predicted=best.evaluation.predicted,
            )
        )
    return found


def evaluations_at_most(settings: CalibrationSettings) -> int | None:
    """Parameter sets that a calibration evaluates at most; None: not known beforehand."""
    method = settings.method
    if not isinstance(method, Joint):
        return None
    slices = len(profile_values(settings.parameters, {}, method.profile_points))
    searches = 1 + settings.folds
    judged = searches if method.screen or settings.judged_with else 0
    return method.design + len(method.sets) + searches * method.refine + slices + judged


def calibrate(
    study: CalibrationStudy,
    folder: str | Path,
    *,
    threads: int | None = None,
    client: distributed.Client | None = None,
    on_evaluation: Callable[[Evaluation], None] | None = None,
) -> CalibrationResult:
    """Calibrate a study against its campaign.

    What is finished is kept in `folder`, of an evaluation under way its trials; the same call in
    the same folder goes on from there and gives what an uninterrupted call would have given.

    Args:
        study: what is calibrated.
        folder: for the evaluations; it exists.
        threads: as in :func:`vsr2.simulation.run_batch`; no result depends on it.
        client: run on its Dask cluster; None: in threads of this process.
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
            f"campaign {campaign.name!r}: all {counted(len(campaign), 'usable trial')} ended "
            "alike: no fit"
        )
    seed, settings, digest = study.study.seed, study.own, campaign_sha256(campaign)
    with EvaluationStore(folder, digest, len(campaign)) as store:
        evaluator = Evaluator(study, campaign, store, Path(folder), threads=threads, client=client)
        found = _evaluated(study, evaluator, campaign, on_evaluation)
    points = settings.method.profile_points if isinstance(settings.method, Joint) else 0
    scores, no_baselines = _compare(found, seed)
    return replace(
        found,
        scores=scores,
        no_baselines=no_baselines,
        profiles=profiles(
            settings.parameters,
            found.evaluations,
            observed,
            motion_resamples(campaign.motion_ids, settings.resamples, seed),
            found.best.evaluation.values,
            cells=points or CALIBRATION.cells,
            objective=settings.objective,
        ),
        provenance=base_provenance(_native.build_facts())
        | {
            "study": study.study.model_dump(mode="json"),
            "calibration": settings.model_dump(mode="json"),
            "constants": calibration_constants(),
            "campaign": {"name": campaign.name, "trials": len(campaign), "sha256": digest},
            "seed": seed,
            "evaluations": len(found.evaluations),
            "simulated_in_this_run": evaluator.simulated,
            "seconds_of_simulation": sum(one.seconds for one in found.evaluations),
            "wall_time_s": time.time() - started,
        },
    )


def calibration_constants() -> dict[str, dict[str, Any]]:
    """Tuned numbers that a calibration rests on, by what they are of."""
    return {
        **run_constants(),
        "calibration": asdict(CALIBRATION),
        "baselines": asdict(LOGISTIC),
        "intervals": asdict(INTERVALS),
        "reliability": asdict(RELIABILITY),
        "motion_noise": asdict(MOTION_NOISE),
        "simulation": asdict(SIMULATION),
    }


def _evaluated(
    study: CalibrationStudy,
    evaluator: Evaluator,
    campaign: Campaign,
    on_evaluation: Callable[[Evaluation], None] | None,
) -> CalibrationResult:
    """Search, cross-validate, and judge what was chosen; without scores and profiles."""
    settings, method, seed = study.own, study.own.method, study.study.seed
    count, observed = len(campaign), campaign.overturned == 1
    fold = motion_folds(campaign, settings.folds, seed) if settings.folds else np.full(count, -1)
    screened = method.screen if isinstance(method, Joint) else 0
    evaluate = _Remembered(evaluator, on_evaluation, screened, count)
    search = _search(study, evaluate, seed)

    def score(one: Evaluation) -> float:
        return objective_of(observed, one.predicted, None, settings.objective)

    steps = search(score, 0)
    searched = best_step(steps)
    folds = cross_validate(search, observed, fold, settings.objective) if settings.folds else []
    if isinstance(method, Joint):
        best_values = searched.evaluation.values
        for values in profile_values(settings.parameters, best_values, method.profile_points):
            evaluate(values)
    everything = tuple(evaluate.seen.values())
    looked_at = {id(step.evaluation) for step in steps}
    extra = [one for one in everything if id(one) not in looked_at]
    beyond = [Step(0, "extra", one, score(one)) for one in extra]
    best = best_step([searched, *beyond])

    def judge(one: Evaluation, among: Mask) -> Array:
        if not screened and not settings.judged_with:
            return one.predicted
        found = evaluator(one.values, among=among, keys=settings.judged_with)
        if on_evaluation is not None:
            on_evaluation(found)
        return np.where(among, found.predicted, one.predicted)

    every = np.ones(count, dtype=np.bool_)
    final = judge(searched.evaluation, every)
    in_sample = final if best is searched else judge(best.evaluation, every)
    for k, one in enumerate(folds):
        predicted = judge(one.chosen, one.held_out)
        judged = objective_of(observed, predicted, one.held_out, settings.objective)
        folds[k] = replace(one, predicted=predicted, judged=judged)
    return CalibrationResult(
        campaign=campaign,
        settings=settings,
        evaluations=everything,
        steps=tuple(steps),
        searched=searched,
        searched_predicted=final,
        best=best,
        in_sample=in_sample,
        start=evaluate.seen.get(_as_key(start_values(study))),
        folds=tuple(folds),
        fold=fold,
        screen=_screen(evaluate, best, in_sample, folds) if screened else None,
    )


def _screen(evaluate: _Remembered, best: Step, in_sample: Array, folds: Sequence[Fold]) -> Screen:
    """How often the screen was wrong where it was checked."""
    # A fold that chose the same values is no further check.
    others = [one for one in folds if one.values != best.evaluation.values]
    checks = [(evaluate.certain, in_sample)]
    checks += [(evaluate.certain & one.held_out, one.predicted) for one in others]
    return Screen(
        certain=evaluate.certain,
        checked=int(sum(among.sum() for among, _ in checks)),
        wrong=int(sum((among & (p != evaluate.assumed)).sum() for among, p in checks)),
    )


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
                ends = np.stack([one.predicted for one in self.seen.values()])
                unanimous = np.all([one.unanimous for one in self.seen.values()], axis=0)
                self.certain = (ends == ends[0]).all(axis=0) & unanimous
                self.assumed = np.where(self.certain, ends[0], np.nan)
            if self._on_evaluation is not None:
                self._on_evaluation(self.seen[key])
        return self.seen[key]


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
    result: CalibrationResult, seed: int
) -> tuple[tuple[BaselineScore, ...], NoBaselines | None]:
    """The simulator's scores by how it was fitted, then the baselines' or why there are none."""
    campaign, observed = result.campaign, result.observed
    resamples = result.settings.resamples
    chosen = {Fitted.OUT_OF_FOLD: result.out_of_fold} if result.folds else {}
    chosen[Fitted.IN_SAMPLE] = result.searched_predicted
    if result.best is not result.searched:
        chosen[Fitted.BEST_OF_ALL] = result.in_sample
    found = tuple(
        BaselineScore(
            name="simulator",
            fitted=fitted,
            metrics=metrics_of(observed, predicted),
            intervals=classification_intervals(
                observed,
                as_predictions(observed, predicted),
                campaign.motion_ids,
                replicates=resamples,
                seed=seed,
            ),
        )
        for fitted, predicted in chosen.items()
    )
    motions = len(set(campaign.motion_ids))
    folds = result.settings.folds or min(CALIBRATION.baseline_folds, motions)
    try:
        baselines = baseline_scores(campaign, folds=folds, seed=seed, replicates=resamples)
    except CampaignError:
        return found, NoBaselines.FEW_MOTIONS
    except ResultError:
        return found, NoBaselines.NO_INTENSITIES
    return (*found, *baselines), None
