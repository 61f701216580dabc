"""The trials of a study."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vsr2.config import Study
from vsr2.effects import chosen
from vsr2.errors import SimulationError
from vsr2.motion import Motion, build_motions
from vsr2.simulation.effects import apply_effects
from vsr2.simulation.scene import build_scene
from vsr2.simulation.trial import Trial


def study_trials(study: Study, *, motions: Sequence[Motion] | None = None) -> list[Trial]:
    """The trials of a study: one per motion.

    Args:
        study: its paths resolved. Its effects are applied; order in the campaign is the order of
            the motions, all of one session.
        motions: to drive instead of the study's own; their time step must be the engine's.

    Raises:
        ConfigError, GeometryError, MotionError, SimulationError: something of the study cannot be
            used.
    """
    chosen(study.effects)  # refused before any mesh is read
    if motions is None:
        motions = build_motions(study.motion, study.engine.time_step)
    scene = build_scene(study)
    contact_trials = study.output.contact_trials
    if contact_trials is not None:
        beyond = [i for i in contact_trials if i >= len(motions)]
        if beyond:
            raise SimulationError(
                f"output.contact_trials names trial {beyond[0]}, but there are only "
                f"{len(motions)} trials, counted from 0"
            )
    silent = study.output.model_copy(update={"contacts_every": 0})
    seeds = np.random.SeedSequence(study.seed).generate_state(max(1, len(motions)), np.uint32)
    trials = [
        Trial(
            scene=scene,
            motion=motion,
            drive=study.motion.drive,
            name=motion.name,
            seed=int(seeds[i]),
            settling=study.settling,
            outcome=study.outcome,
            output=study.output if contact_trials is None or i in contact_trials else silent,
        )
        for i, motion in enumerate(motions)
    ]
    return apply_effects(trials, study.effects, seed=study.seed)
