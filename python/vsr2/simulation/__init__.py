"""Simulations on the native core: one interactive world, and batches of trials."""

from vsr2.simulation.batch import Trial, run_batch, study_trials
from vsr2.simulation.contact_model import (
    ContactPair,
    contact_softness,
    effective_pair,
    inverse_mass_along,
    normal_impulse,
    restitution_target,
)
from vsr2.simulation.scene import Scene, build_scene, make_scene
from vsr2.simulation.simulation import Simulation, State

__all__ = [
    "ContactPair",
    "Scene",
    "Simulation",
    "State",
    "Trial",
    "build_scene",
    "contact_softness",
    "effective_pair",
    "inverse_mass_along",
    "make_scene",
    "normal_impulse",
    "restitution_target",
    "run_batch",
    "study_trials",
]
