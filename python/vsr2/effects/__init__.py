"""Effects that a simulation may lack: the library, and how users add their own."""

from vsr2.effects.effect import STAGES, Applied, Bench, Check, Effect, Response
from vsr2.effects.parameter import EffectRangeWarning, EffectWarning, Parameter
from vsr2.effects.registry import (
    check_study_effects,
    chosen,
    effect,
    in_order,
    library,
    module_effects,
    register,
)
from vsr2.effects.setup import Circumstances, Observation, Setup, restand

__all__ = [
    "STAGES",
    "Applied",
    "Bench",
    "Check",
    "Circumstances",
    "Effect",
    "EffectRangeWarning",
    "EffectWarning",
    "Observation",
    "Parameter",
    "Response",
    "Setup",
    "check_study_effects",
    "chosen",
    "effect",
    "in_order",
    "library",
    "module_effects",
    "register",
    "restand",
]
