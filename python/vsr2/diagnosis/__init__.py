"""Diagnosis of the sim-to-real gap: where it lies, which effect causes it, how far it shrinks."""

from vsr2.diagnosis.budget import Budget
from vsr2.diagnosis.diagnose import diagnose_with
from vsr2.diagnosis.result import SCHEMA, Diagnosis, schema
from vsr2.diagnosis.simulator import Request, Responses, Simulator

__all__ = [
    "SCHEMA",
    "Budget",
    "Diagnosis",
    "Request",
    "Responses",
    "Simulator",
    "diagnose_with",
    "schema",
]
