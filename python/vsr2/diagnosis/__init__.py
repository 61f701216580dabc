"""Diagnosis of the sim-to-real gap: where it lies, which effect causes it, how far it shrinks."""

from vsr2.diagnosis.api import Execution, diagnose
from vsr2.diagnosis.budget import Budget
from vsr2.diagnosis.causes import Causes, find_causes
from vsr2.diagnosis.corrected import corrected_study, drawn_studies
from vsr2.diagnosis.iteration import Iteration, iterate
from vsr2.diagnosis.pipeline import Question, diagnose_with
from vsr2.diagnosis.posterior_check import PosteriorCheck, check_posterior
from vsr2.diagnosis.prediction import Prediction, predict
from vsr2.diagnosis.protocol_cache import ProtocolCache
from vsr2.diagnosis.simulated.hypotheses import Hypotheses
from vsr2.diagnosis.simulated.nuisances import (
    DEFAULT_NUISANCES,
    DrawnByEffect,
    LogNormal,
    LogUniform,
    Normal,
    Nuisance,
    Scope,
    Uniform,
    with_deviations,
)
from vsr2.diagnosis.simulated.simulator import Request, Responses, Simulator
from vsr2.diagnosis.verdict.causes_schema import causes_schema
from vsr2.diagnosis.verdict.diagnosis_schema import schema
from vsr2.diagnosis.verdict.document import SCHEMA, Diagnosis

__all__ = [
    "DEFAULT_NUISANCES",
    "SCHEMA",
    "Budget",
    "Causes",
    "Diagnosis",
    "DrawnByEffect",
    "Execution",
    "Hypotheses",
    "Iteration",
    "LogNormal",
    "LogUniform",
    "Normal",
    "Nuisance",
    "PosteriorCheck",
    "Prediction",
    "ProtocolCache",
    "Question",
    "Request",
    "Responses",
    "Scope",
    "Simulator",
    "Uniform",
    "causes_schema",
    "check_posterior",
    "corrected_study",
    "diagnose",
    "diagnose_with",
    "drawn_studies",
    "find_causes",
    "iterate",
    "predict",
    "schema",
    "with_deviations",
]
