"""Effects that a simulation may lack: the library, and how users add their own."""

from vsr2.effects.apply import apply_effects, each_with_effects, with_effects
from vsr2.effects.effect import STAGES, Bench, Check, Circumstances, Effect, Response
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

__all__ = [
    "STAGES",
    "Bench",
    "Check",
    "Circumstances",
    "Effect",
    "EffectRangeWarning",
    "EffectWarning",
    "Parameter",
    "Response",
    "apply_effects",
    "check_study_effects",
    "chosen",
    "each_with_effects",
    "effect",
    "in_order",
    "library",
    "module_effects",
    "register",
    "with_effects",
]
