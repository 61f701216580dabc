"""`vsr2.predict`: the probability that each trial of a campaign overturns, and how right it is."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2 import _native
from vsr2.analysis import logistic_baseline
from vsr2.analysis.baseline import LOGISTIC, Fitted
from vsr2.analysis.bootstrap import Interval
from vsr2.analysis.overturning_margin import (
    MARGIN,
    MarginModel,
    out_of_fold_probability,
)
from vsr2.analysis.probability import (
    PROBABILITY_SCORES,
    RELIABILITY,
    ReliabilityBin,
    overturning_probability,
    probability_error,
    probability_intervals,
    reliability,
)
from vsr2.argument_names import checked_names
from vsr2.campaign import Campaign, load_campaign
from vsr2.config import Study, load_study
from vsr2.config.seeds import checked_seed
from vsr2.diagnosis.diagnosis_constants import diagnosis_constants
from vsr2.effects import check_study_effects, effect
from vsr2.ensemble.execution import EXECUTION, Execution, made_folder
from vsr2.ensemble.protocol_cache import SIMULATIONS
from vsr2.ensemble.simulated.hypotheses import Hypotheses
from vsr2.ensemble.simulated.library import GAIN
from vsr2.ensemble.simulated.linear_algebra import one_blas_thread
from vsr2.ensemble.simulated.scene_simulator import HYPOTHESES
from vsr2.errors import CampaignError, ConfigError, DiagnosisError, MotionError, ResultError
from vsr2.one_line import OneLine
from vsr2.prediction.replicates import PREDICTION, PROVENANCE, Replicates
from vsr2.results import base_provenance
from vsr2.results.atomic import csv_text, write_text

Array = NDArray[np.float64]
Scene = Study | str | PathLike[str]
PREDICTIONS, SCORES_FILE, CURVE = "predictions.csv", "scores.csv", "reliability.csv"
WORK_FILES = (PREDICTIONS, SCORES_FILE, CURVE, PROVENANCE, SIMULATIONS)
"""Files of a prediction's folder."""


class PredictedBy(StrEnum):
    """What gives probabilities."""

    SIMULATOR = "simulator"
    """The share of replicates that overturn."""
    MARGINS = "margins"
    """The mean margin, with bias and scatter of other motions."""
    LOGISTIC = "logistic"
    """A curve in intensity measures, without physics."""


@dataclass(frozen=True, eq=False)
class PredictionScore:
    """How well probabilities agree with the observed outcomes.

    Attributes:
        name: of what gave them.
        fitted: on which trials it was fitted.
        trials: number with an outcome.
        intervals: 95 %, by the names in `vsr2.analysis.probability.PROBABILITY_SCORES`.
    """

    name: PredictedBy
    fitted: Fitted
    trials: int
    intervals: Mapping[str, Interval]


@dataclass(frozen=True, eq=False, repr=False)
class Prediction(OneLine):
    """Predictions of a campaign's trials.

    Attributes:
        campaign: its trials with a motion.
        outcomes: of each replicate, 1 or 0, NaN where a simulation has no outcome, shape
            (replicates, trials).
        scores: of the simulator, then of the logistic curve; empty: no outcome is known.
        curve: the calibration curve; empty: no outcome is known.
        margins: logarithm of the factor on the motion at which each replicate overturns, NaN where
            a simulation has no outcome, shape (replicates, trials); None: not sought.
        provenance: versions, scenes, nuisances, seed (JSON-serialisable).
    """

    campaign: Campaign
    outcomes: Array
    scores: tuple[PredictionScore, ...] = ()
    curve: tuple[ReliabilityBin, ...] = ()
    margins: Array | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @property
    def facts(self) -> Mapping[str, object]:
        """What the notation in one line shows."""
        replicates, trials = self.outcomes.shape
        return {"campaign": self.campaign.name, "trials": trials, "replicates": replicates}

    @property
    def probability(self) -> Array:
        """Of overturning, shape (trials,).

        With margins by these, of bias and scatter that other motions have; else (k + 1/2) / (n + 1)
        of k in n replicates.
        """
        if self.margins is not None:
            return _by_margins(self.campaign, self.margins)
        return overturning_probability(self.outcomes)

    @property
    def standard_error(self) -> Array:
        """Monte-Carlo standard error of the probability, shape (trials,); NaN with margins.

        A probability by margins rests on all replicates and motions together.
        """
        if self.margins is not None:
            return np.full(len(self.campaign), np.nan)
        return probability_error(self.outcomes)

    @property
    def predicted(self) -> NDArray[np.bool_]:
        """Whether the probability is above 0.5, shape (trials,)."""
        return np.asarray(self.probability > RELIABILITY.threshold)

    def tables(self) -> dict[str, str]:
        """CSV files by name: predictions.csv and, where outcomes are known, two of scores."""
        margin = np.full(len(self.campaign), np.nan)
        if self.margins is not None:
            margin = MarginModel().mean(self.margins)
        columns = zip(
            self.campaign.trials,
            margin.tolist(),
            self.probability.tolist(),
            self.standard_error.tolist(),
            self.predicted.tolist(),
            np.isnan(self.outcomes).sum(axis=0).tolist(),
            strict=True,
        )
        rows = [
            {
                "trial": trial.trial,
                "motion": trial.motion,
                "probability": p,
                "standard_error": error,
                "predicted": int(guess),
                "observed": "" if trial.overturned is None else int(trial.overturned),
                "failed": failed,
                "margin": margin,
            }
            for trial, margin, p, error, guess, failed in columns
        ]
        out = {PREDICTIONS: csv_text(rows)}
        if self.scores:
            out[SCORES_FILE] = csv_text([row for one in self.scores for row in _score_rows(one)])
            out[CURVE] = csv_text([_curve_row(one) for one in self.curve])
        return out

    def save(self, folder: str | Path) -> list[Path]:
        """Write tables and provenance; tables of an earlier prediction are replaced or removed.

        Raises:
            ResultError: a file cannot be written.
        """
        path = Path(folder)
        texts = self.tables() | {PROVENANCE: json.dumps(self.provenance, indent=2) + "\n"}
        for name in (SCORES_FILE, CURVE):
            (path / name).unlink(missing_ok=True)
        for name, text in texts.items():
            write_text(path / name, text)
        return [path / name for name in texts]


def _score_rows(one: PredictionScore) -> list[dict[str, Any]]:
    return [
        {
            "prediction": one.name,
            "fitted": str(one.fitted),
            "trials": one.trials,
            "score": name,
            "value": one.intervals[name].value,
            "low": one.intervals[name].low,
            "high": one.intervals[name].high,
        }
        for name in PROBABILITY_SCORES
    ]


def _curve_row(one: ReliabilityBin) -> dict[str, Any]:
    return {
        "from": one.low,
        "to": one.high,
        "trials": one.trials,
        "predicted": one.predicted,
        "observed": one.observed.value,
        "observed_low": one.observed.low,
        "observed_high": one.observed.high,
    }


@checked_names(DiagnosisError)
@one_blas_thread()
def predict(
    campaign: Campaign | str | PathLike[str],
    scene: Scene | Sequence[Scene],
    *,
    out: str | PathLike[str] | None = None,
    replicates: int | None = None,
    margins: bool = False,
    hypotheses: Hypotheses = HYPOTHESES,
    execution: Execution = EXECUTION,
    seed: int = 0,
) -> Prediction:
    """The probability that each trial of a campaign overturns.

    Args:
        campaign: trials, or the folder that holds them; those without a motion are left out.
        scene: the study of the scene, its effects included, or its file; or several, or a folder
            of files, draws of a posterior: replicates take them in turn. Motions of the study are
            not used.
        out: folder for tables and simulations, which later runs reuse; None: nothing is written.
        replicates: of each trial; None: 16, or one for each scene where these are more.
        margins: seek in each replicate the factor on the motion at which the rock overturns, which
            takes five more simulations; their mean tells more than the share that overturns.
        hypotheses: of which nuisances and contact models are drawn.
        execution: threads or a cluster, who gets progress, and a cache that a diagnosis shares.
        seed: of all draws; equal seeds have equal draws, and more replicates keep the earlier ones.

    Returns:
        The prediction.

    Raises:
        DiagnosisError: an option or the folder cannot be used.
        CampaignError, ConfigError, GeometryError, MotionError, SimulationError: campaign or scene
            cannot be used.
        ResultError: a file cannot be written, or is a finished result of other work.
    """
    given = campaign if isinstance(campaign, Campaign) else load_campaign(campaign)
    used = given.with_motion()
    scenes = _scenes(scene)
    count = max(PREDICTION.replicates, len(scenes)) if replicates is None else replicates
    if count < len(scenes) or count < 1:
        raise DiagnosisError(
            f"replicates is {count}; give at least one for each scene ({len(scenes)})"
        )
    seed = checked_seed(seed, DiagnosisError)
    scaling = {GAIN: effect(GAIN)} if margins else {}
    plain = replace(hypotheses, library=scaling, exclude=(), priors={})
    folder = None if out is None else made_folder(Path(out))
    runs = Replicates(used, scenes, plain, execution, seed)
    runs.check()
    outcomes = runs.outcomes(count, folder)
    sought = runs.margins(outcomes, folder) if margins else None
    given_by = {PredictedBy.SIMULATOR: overturning_probability(outcomes)}
    if sought is not None:
        given_by[PredictedBy.MARGINS] = _by_margins(used, sought)
    scores, curve = _scored(used, given_by, seed)
    found = Prediction(
        used, outcomes, scores, curve, sought,
        base_provenance(_native.build_facts()) | {
            **execution.notes,
            "campaign": used.name,
            "trials": len(used),
            "left_out": len(given) - len(used),
            "scenes": [{"name": one.name, "effects": one.effects} for one in scenes],
            "simulators": runs.identities,
            "replicates": count,
            "nuisances": [one.to_json() for one in (*plain.nuisances, *plain.contact_family)],
            "constants": prediction_constants(),
            "seed": seed,
        },
    )  # fmt: skip
    if folder is not None:
        found.save(folder)
    return found


def prediction_constants() -> dict[str, dict[str, Any]]:
    """Tuned numbers that a prediction rests on, by what they are of."""
    return {
        "prediction": asdict(PREDICTION),
        "margin": asdict(MARGIN),
        "logistic": asdict(LOGISTIC),
        **diagnosis_constants(),
    }


def _scenes(given: Scene | Sequence[Scene]) -> list[Study]:
    """All scenes, read and checked.

    Raises:
        ConfigError: one cannot be used, or a folder has none.
    """
    many = [given] if isinstance(given, Study | str | PathLike) else list(given)
    files: list[Scene] = []
    for one in many:
        if isinstance(one, Study) or not Path(one).is_dir():
            files.append(one)
            continue
        inside = sorted(Path(one).glob("*.yaml"))
        if not inside:
            raise ConfigError(f"{one}: holds no .yaml file; give a study or a folder of studies")
        files += inside
    if not files:
        raise ConfigError("no scene is given; give a study")
    out = []
    for one in files:
        study = one if isinstance(one, Study) else load_study(one)
        check_study_effects(study.effects, study.name if isinstance(one, Study) else one)
        out.append(study)
    return out


def _by_margins(campaign: Campaign, margins: Array) -> Array:
    """Probability by margins; weights, bias and scatter from the outcomes of other motions."""
    folds = min(PREDICTION.folds, len(set(campaign.motion_ids)))
    if np.isnan(campaign.overturned).all() or folds < 2:
        return MarginModel().probability(margins)
    return out_of_fold_probability(margins, campaign.overturned, campaign.motion_ids, folds)


def _scored(
    campaign: Campaign, given: Mapping[PredictedBy, Array], seed: int
) -> tuple[tuple[PredictionScore, ...], tuple[ReliabilityBin, ...]]:
    """Scores of trials whose outcome is known, and the calibration curve of the last prediction."""
    known = ~np.isnan(campaign.overturned)
    if not known.any():
        return (), ()
    seen = campaign.select(known)
    truth = seen.overturned == 1
    scores = []
    for name, probability in given.items():
        p = probability[known]
        intervals = probability_intervals(truth, p, seen.motion_ids, seed=seed)
        fitted = Fitted.OUT_OF_FOLD if name is PredictedBy.MARGINS else Fitted.GIVEN
        scores.append(PredictionScore(name, fitted, len(seen), intervals))
    scores += _logistic(seen, seed)
    return tuple(scores), reliability(truth, p, seen.motion_ids, seed=seed)


def _logistic(campaign: Campaign, seed: int) -> list[PredictionScore]:
    """The curve without physics, out of fold; none where the campaign gives none."""
    folds = min(PREDICTION.folds, len(set(campaign.motion_ids)))
    try:
        curve = logistic_baseline(campaign, folds=folds, seed=seed)
    except (CampaignError, MotionError, ResultError):
        return []
    used = campaign.select(curve.used)
    intervals = probability_intervals(
        used.overturned == 1, curve.out_of_fold, used.motion_ids, seed=seed
    )
    return [PredictionScore(PredictedBy.LOGISTIC, Fitted.OUT_OF_FOLD, len(used), intervals)]
