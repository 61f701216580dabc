"""A calibration's result as plain files.

    table.csv          sequential: one row a step, in the columns of the supplement's Table S2
    evaluations.csv    every evaluated set with its scores on all trials
    predictions.csv    one row a trial: observed, predicted in sample and out of fold
    folds.csv          one row a fold: trials, objectives, values chosen without it
    scores.csv         simulator and baselines with 95 % intervals
    profiles.csv       one row a cell of a parameter's range
    best.yaml          the study with the calibrated values
    provenance.json    versions, hashes, seeds, settings

`evaluations.jsonl`, which a search resumes from, stays beside them.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from vsr2.analysis import Classification
from vsr2.analysis.bootstrap import SCORES
from vsr2.analysis.probability import RELIABILITY
from vsr2.calibration.calibrate import CalibrationResult
from vsr2.calibration.calibration_study import CalibrationStudy, Sequential, study_values
from vsr2.calibration.evaluation import RUNNING
from vsr2.calibration.evaluation_store import EVALUATIONS_FILE
from vsr2.calibration.objective import metrics_of, objective_of
from vsr2.calibration.search import Step
from vsr2.config import dump_study
from vsr2.results import JOURNAL_FILE, prepare_work_folder
from vsr2.results.atomic import csv_text, write_text

TABLE_FILE = "table.csv"
OWN_FILES = (
    "provenance.json", TABLE_FILE, "evaluations.csv", "predictions.csv", "folds.csv", "scores.csv",
    "profiles.csv", "best.yaml", "report.md",
)  # fmt: skip


def prepare_calibration_folder(
    folder: str | Path, *, overwrite: bool = False, resume: bool = False
) -> Path:
    """Make a folder ready, before any work is spent.

    Args:
        folder: created with its parents where it does not exist.
        overwrite: remove a calibration that is there (only files that VSR2 wrote).
        resume: go on with one that is there.

    Raises:
        ResultError: as :func:`vsr2.results.prepare_work_folder`.
    """
    own = (*OWN_FILES, EVALUATIONS_FILE, f"{RUNNING}/*/{JOURNAL_FILE}")
    return prepare_work_folder(folder, own, "a calibration", overwrite=overwrite, resume=resume)


def save_calibration(
    result: CalibrationResult, study: CalibrationStudy, folder: str | Path
) -> list[Path]:
    """Write the tables, the calibrated study and the provenance.

    Returns:
        The files written.

    Raises:
        ResultError: one cannot be written.
    """
    path = Path(folder)
    tables = {
        "evaluations.csv": evaluation_rows(result),
        "predictions.csv": prediction_rows(result),
        "scores.csv": score_rows(result),
        "profiles.csv": profile_rows(result),
    }
    if isinstance(result.settings.method, Sequential):
        tables[TABLE_FILE] = sequential_rows(result)
    if result.folds:
        tables["folds.csv"] = fold_rows(result)
    texts = {name: csv_text(rows) for name, rows in tables.items()}
    best = study.with_values(study_values(study, dict(result.best.evaluation.values)))
    texts["best.yaml"] = dump_study(best)
    texts["provenance.json"] = json.dumps(result.provenance, indent=2) + "\n"
    for name, text in texts.items():
        write_text(path / name, text)
    return [path / name for name in texts]


def sequential_rows(result: CalibrationResult) -> list[dict[str, Any]]:
    """The procedure's table in the columns of the supplement's Table S2."""
    return [
        {
            "iteration": step.iteration,
            "group": step.group,
            **step.evaluation.values,
            **{
                name: "" if math.isnan(value) else f"{value:.3f}"
                for name, value in _scores(
                    metrics_of(result.observed, step.evaluation.predicted)
                ).items()
            },
        }
        for step in result.steps
        if step.iteration > 0
    ]


def _scores(metrics: Classification) -> dict[str, float]:
    return {name: float(getattr(metrics, name)) for name in SCORES}


def evaluation_rows(result: CalibrationResult) -> list[dict[str, Any]]:
    """Every set once: those of the search in order, then those of folds and profiles."""
    stages: dict[int, str] = {}
    for step in result.steps:
        stages.setdefault(id(step.evaluation), step.group)
    return [
        {
            "evaluation": i,
            "stage": stages.get(id(one), "fold or profile"),
            **one.values,
            **_scores(metrics_of(result.observed, one.predicted)),
            # As the search saw it: undefined parts count as 0.
            "objective": objective_of(
                result.observed, one.predicted, None, result.settings.objective
            ),
            "failed": one.failed,
            "seconds": one.seconds,
            "plan_sha256": one.plan,
        }
        for i, one in enumerate(result.evaluations)
    ]


def prediction_rows(result: CalibrationResult) -> list[dict[str, Any]]:
    """One row a trial; blank: it failed, or there are no folds."""
    return [
        {
            "trial": trial.trial,
            "motion": trial.motion,
            "fold": int(result.fold[i]) if result.folds else "",
            "observed": int(result.observed[i]),
            "in_sample": _outcome(result.in_sample[i]),
            "out_of_fold": _outcome(result.out_of_fold[i]),
            **_probabilities(result, i),
        }
        for i, trial in enumerate(result.campaign.trials)
    ]


def _outcome(value: float) -> str:
    return "" if np.isnan(value) else f"{int(value > RELIABILITY.threshold)}"


def _probabilities(result: CalibrationResult, i: int) -> dict[str, float]:
    """Of a trial, where sets are judged by replicates."""
    if result.settings.replicates == 1:
        return {}
    return {
        "in_sample_probability": float(result.in_sample[i]),
        "out_of_fold_probability": float(result.out_of_fold[i]),
    }


def fold_rows(result: CalibrationResult) -> list[dict[str, Any]]:
    """One row a fold: its trials, objectives, and the values chosen without it."""
    return [
        {
            "fold": k,
            "trials": int(one.held_out.sum()),
            "training": one.training,
            "held_out": one.judged,
            **one.values,
        }
        for k, one in enumerate(result.folds)
    ]


def score_rows(result: CalibrationResult) -> list[dict[str, Any]]:
    """Simulator and baselines, each score with its 95 % interval."""
    rows = []
    for one in result.scores:
        row: dict[str, Any] = {
            "prediction": one.name,
            "fitted": one.fitted,
            "trials": one.metrics.trials,
        }
        for name in SCORES:
            found = one.intervals[name]
            row |= {name: found.value, f"{name}_low": found.low, f"{name}_high": found.high}
        rows.append(row)
    return rows


def profile_rows(result: CalibrationResult) -> list[dict[str, Any]]:
    """One row a cell of each parameter's range."""
    return [
        {
            "parameter": profile.name,
            "verdict": profile.verdict,
            "low": cell.low,
            "high": cell.high,
            "sets": cell.sets,
            "objective": cell.objective,
            "deficit": cell.deficit,
            "deficit_low": cell.deficit_low,
            "deficit_high": cell.deficit_high,
            "compatible": int(cell.compatible),
        }
        for profile in result.profiles
        for cell in profile.cells
    ]


def best_of_sweeps(result: CalibrationResult) -> list[Step]:
    """Of each sweep of the sequential procedure the step with the highest score, in order."""
    sweeps: dict[tuple[int, str], Step] = {}
    for step in result.steps:
        key = (step.iteration, step.group)
        if key not in sweeps or step.score > sweeps[key].score:
            sweeps[key] = step
    return list(sweeps.values())
