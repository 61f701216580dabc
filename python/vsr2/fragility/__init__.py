"""Fragility: the probability of overturning as a function of ground-motion intensity."""

from vsr2.fragility.fit import FitNote, FragilityFit, Lognormal, fit_fragility
from vsr2.fragility.fragility_steps import fragility_step_trials
from vsr2.fragility.fragility_tables import remove_old_tables, save_fragility
from vsr2.fragility.run import FragilityResult, is_fragility_finished, run_fragility
from vsr2.fragility.settings import (
    FragilitySettings,
    FragilityStudy,
    Jitter,
    fragility_schema,
    load_fragility,
)
from vsr2.fragility.trials import PlannedTrial, fragility_trials

__all__ = [
    "FitNote",
    "FragilityFit",
    "FragilityResult",
    "FragilitySettings",
    "FragilityStudy",
    "Jitter",
    "Lognormal",
    "PlannedTrial",
    "fit_fragility",
    "fragility_schema",
    "fragility_step_trials",
    "fragility_trials",
    "is_fragility_finished",
    "load_fragility",
    "remove_old_tables",
    "run_fragility",
    "save_fragility",
]
