"""Simulations on the native core: one interactive world, and batches of trials."""

from vsr2.simulation.batch import run_batch
from vsr2.simulation.contact_model import (
    ContactPair,
    contact_softness,
    effective_pair,
    inverse_mass_along,
    normal_impulse,
    restitution_target,
)
from vsr2.simulation.distributed import connect
from vsr2.simulation.effects import apply_effects
from vsr2.simulation.planning import study_trials
from vsr2.simulation.scene import Scene, build_scene, make_scene
from vsr2.simulation.shards import Shard, merge_shards, run_shard
from vsr2.simulation.simulation import Simulation, State
from vsr2.simulation.trial import Trial

__all__ = [
    "ContactPair",
    "Scene",
    "Shard",
    "Simulation",
    "State",
    "Trial",
    "apply_effects",
    "build_scene",
    "connect",
    "contact_softness",
    "effective_pair",
    "inverse_mass_along",
    "make_scene",
    "merge_shards",
    "normal_impulse",
    "restitution_target",
    "run_batch",
    "run_shard",
    "study_trials",
]
