"""Simulations on the native core: one interactive world, and batches of trials."""

from vsr2.simulation.batch import run_batch, run_trials
from vsr2.simulation.distributed import connect
from vsr2.simulation.estimate import BatchEstimate, estimate_batch
from vsr2.simulation.native_scenes import native_scene
from vsr2.simulation.planning import check_trials, plan_sha256, study_trials
from vsr2.simulation.shards import Shard, merge_shards, run_shard
from vsr2.simulation.simulation import Simulation, State

__all__ = [
    "BatchEstimate",
    "Shard",
    "Simulation",
    "State",
    "check_trials",
    "connect",
    "estimate_batch",
    "merge_shards",
    "native_scene",
    "plan_sha256",
    "run_batch",
    "run_shard",
    "run_trials",
    "study_trials",
]
