"""Diagnosis of the sim-to-real gap: where it lies, which effect causes it, how far it shrinks."""

from vsr2.diagnosis.api import diagnose
from vsr2.diagnosis.budget import Budget
from vsr2.diagnosis.diagnose import diagnose_with
from vsr2.diagnosis.shared import Shared
from vsr2.diagnosis.simulated.scene_simulator import Nuisances
from vsr2.diagnosis.simulated.simulator import Request, Responses, Simulator
from vsr2.diagnosis.verdict.result import SCHEMA, Diagnosis, schema

__all__ = [
    "SCHEMA",
    "Budget",
    "Diagnosis",
    "Nuisances",
    "Request",
    "Responses",
    "Shared",
    "Simulator",
    "diagnose",
    "diagnose_with",
    "schema",
]
