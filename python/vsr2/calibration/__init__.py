"""Calibration: values that agree best with a campaign, judged on motions they were not fit to."""

from vsr2.calibration.calibrate import (
    CalibrationResult,
    Fold,
    Screen,
    calibrate,
    cross_validate,
    evaluations_at_most,
)
from vsr2.calibration.calibration_study import (
    CalibrationParameter,
    CalibrationSettings,
    CalibrationStudy,
    calibration_schema,
    load_calibration,
)
from vsr2.calibration.calibration_tables import prepare_calibration_folder, save_calibration
from vsr2.calibration.evaluation import CalibrationInterrupted, Evaluator, usable_trials
from vsr2.calibration.evaluation_store import Evaluation, EvaluationStore
from vsr2.calibration.profile import Identifiability, Profile, profiles
from vsr2.calibration.search import Step, joint_search, sequential_search

__all__ = [
    "CalibrationInterrupted",
    "CalibrationParameter",
    "CalibrationResult",
    "CalibrationSettings",
    "CalibrationStudy",
    "Evaluation",
    "EvaluationStore",
    "Evaluator",
    "Fold",
    "Identifiability",
    "Profile",
    "Screen",
    "Step",
    "calibrate",
    "calibration_schema",
    "cross_validate",
    "evaluations_at_most",
    "joint_search",
    "load_calibration",
    "prepare_calibration_folder",
    "profiles",
    "save_calibration",
    "sequential_search",
    "usable_trials",
]
