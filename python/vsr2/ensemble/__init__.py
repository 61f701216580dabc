"""A campaign as numbers: as it was observed, and as scenes give it with what is uncertain drawn."""

from vsr2.ensemble.execution import Execution
from vsr2.ensemble.protocol_cache import ProtocolCache
from vsr2.ensemble.simulated.campaign_steps import campaign_step_trials
from vsr2.ensemble.simulated.distributions import (
    DrawnByEffect,
    LogNormal,
    LogUniform,
    Normal,
    Uniform,
)
from vsr2.ensemble.simulated.hypotheses import Hypotheses
from vsr2.ensemble.simulated.nuisances import DEFAULT_NUISANCES, Nuisance, Scope, with_deviations
from vsr2.ensemble.simulated.simulator import Request, Responses, Simulator

__all__ = [
    "DEFAULT_NUISANCES",
    "DrawnByEffect",
    "Execution",
    "Hypotheses",
    "LogNormal",
    "LogUniform",
    "Normal",
    "Nuisance",
    "ProtocolCache",
    "Request",
    "Responses",
    "Scope",
    "Simulator",
    "Uniform",
    "campaign_step_trials",
    "with_deviations",
]
