"""Diagnosis of the sim-to-real gap: where it lies, which effect causes it, how far it shrinks."""

from vsr2.diagnosis.api import diagnose
from vsr2.diagnosis.budget import Budget, BudgetWarning
from vsr2.diagnosis.corrected import corrected_study, drawn_studies
from vsr2.diagnosis.iteration import Iteration, iterate
from vsr2.diagnosis.pipeline import Question, diagnose_with
from vsr2.diagnosis.verdict.diagnosis_schema import schema
from vsr2.diagnosis.verdict.document import SCHEMA, Diagnosis

__all__ = [
    "SCHEMA",
    "Budget",
    "BudgetWarning",
    "Diagnosis",
    "Iteration",
    "Question",
    "corrected_study",
    "diagnose",
    "diagnose_with",
    "drawn_studies",
    "iterate",
    "schema",
]
