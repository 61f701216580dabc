"""The trials of a study, what they depend on, how large they get, and whether they can be run."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from vsr2 import _native
from vsr2.config import Study
from vsr2.effects import apply_effects, chosen
from vsr2.errors import Fault, SimulationError
from vsr2.motion import build_motions
from vsr2.one_line import counted
from vsr2.results import CONTACT_COLUMNS, STATE_COLUMNS
from vsr2.results.trial_log import EXCURSION_COLUMNS
from vsr2.scene import Scene, build_scene
from vsr2.scene.build import CONTACT_POINTS
from vsr2.simulation.native_scenes import native_scene
from vsr2.trial import Trial

MAX_LOG_BYTES = 2e9
"""Greatest state log of one trial that is accepted: it is held in memory. The longest
motion, logged at every step, takes 0.3 GB."""


def study_trials(study: Study, scene: Scene | None = None) -> list[Trial]:
    """The trials of a study: one per motion.

    Args:
        study: its paths resolved. Its effects are applied; order in the campaign is the order of
            the motions, all of one session.
        scene: in place of the study's own, as of a rock in memory (:func:`vsr2.build_scene`).

    Raises:
        ConfigError, GeometryError, MotionError, SimulationError: something of the study cannot be
            used.
    """
    chosen(study.effects)  # refused before any mesh is read
    motions = build_motions(study.motion, study.engine.time_step)
    scene = build_scene(study) if scene is None else scene
    contact_trials = study.output.contact_trials
    if contact_trials is not None:
        beyond = [i for i in contact_trials if i >= len(motions)]
        if beyond:
            raise SimulationError(
                f"output.contact_trials names trial {beyond[0]}, but the study makes only "
                f"{counted(len(motions), 'trial')}, counted from 0"
            )
    silent = study.output.model_copy(update={"contacts_every": 0})
    seeds = np.random.SeedSequence(study.seed).generate_state(max(1, len(motions)), np.uint32)
    trials = [
        Trial.of_study(
            study,
            scene,
            motion,
            name=motion.name,
            output=study.output if contact_trials is None or i in contact_trials else silent,
            seed=int(seeds[i]),
        )
        for i, motion in enumerate(motions)
    ]
    return apply_effects(trials, study.effects, seed=study.seed)


def plan_sha256(trials: Sequence[Trial]) -> str:
    """Hash of all that the results of these trials depend on."""
    digest = hashlib.sha256(str(_native.build_facts()["version"]).encode())
    for trial in trials:
        digest.update(trial.content)
    return digest.hexdigest()


def check_trials(trials: Sequence[Trial]) -> None:
    """Refuse what cannot be run, before any trial runs.

    Raises:
        SimulationError: something that is no trial, a scene that no engine can use, a motion of
            another time step than its scene's, a motor asked to drive a motion beside x or a
            pedestal that pitches on a spring, a motion that pitches such a pedestal, or a log that
            could outgrow memory.
    """
    for i, one in enumerate(trials):
        if not isinstance(one, Trial):
            raise SimulationError(
                f"trial {i} of the batch is of type {type(one).__name__}; give objects of "
                "vsr2.trial.Trial, a Study, or the path of one"
            )
    for scene in {trial.scene.sha256: trial.scene for trial in trials}.values():
        native_scene(scene)
    for trial in trials:
        scene, motion = trial.scene, trial.motion
        if abs(motion.time_step - scene.engine.time_step) > 1e-12 * scene.engine.time_step:
            raise SimulationError(
                f"motion {motion.name!r} is sampled at {motion.time_step:g} s but the engine steps "
                f"at {scene.engine.time_step:g} s; resample the motion in time"
            )
        if motion.is_spatial and trial.drive != "prescribed":
            raise SimulationError(
                f"motion {motion.name!r} goes beside x; only drive: prescribed follows it",
                fault=Fault.drive,
            )
        if scene.pitches and trial.drive != "prescribed":
            raise SimulationError(
                f"trial {trial.label!r}: the pedestal pitches on a spring; only drive: prescribed "
                "lets it",
                fault=Fault.drive,
            )
        if scene.pitches and motion.pitch is not None:
            raise SimulationError(
                f"motion {motion.name!r} pitches, and the pedestal pitches on a spring; leave one "
                "of them out",
                fault=Fault.drive,
            )
        size, every = log_bytes(trial, contacts=False), trial.output.log_every
        if size > MAX_LOG_BYTES:
            raise SimulationError(
                f"trial {trial.label!r}: its log could take {size / 1e9:.3g} GB "
                f"({_longest(trial):g} s, a row every {every * scene.engine.time_step:g} s); raise "
                "output.log_every or shorten outcome.tail"
            )


EDGE_ROWS = 2
"""Rows of a log beside those of its intervals: at the start, and of an interval that is begun."""


ROW_BYTES = 256
"""Size of a trial's row, in the journal as in the table, about."""


def log_bytes(trial: Trial, *, contacts: bool = True, least: bool = False) -> float:
    """Size of a trial's log in memory [byte].

    Args:
        trial: of which the state's rows count, and contacts as `CONTACT_POINTS` in each row.
        contacts: False: of the state alone.
        least: of the shortest log of a trial that runs to its end; else of the longest.
    """
    output, step = trial.output, trial.scene.engine.time_step
    seconds = _longest(trial)
    if least:
        seconds = 0.0 if trial.outcome.stop_early else trial.motion.duration
    size = 0.0
    if output.log_every:
        columns = len(STATE_COLUMNS) + (len(EXCURSION_COLUMNS) if trial.goes_beside_x else 0)
        rows = seconds / (step * output.log_every) + (0 if least else EDGE_ROWS)
        size += rows * columns * 8
    if contacts and output.contacts_every and not least:
        rows = (trial.motion.duration + trial.outcome.tail) / (
            step * output.contacts_every
        ) + EDGE_ROWS
        size += rows * CONTACT_POINTS * len(CONTACT_COLUMNS) * 8
    return size


def _longest(trial: Trial) -> float:
    """The longest time that a trial can log [s]."""
    seconds = trial.motion.duration + trial.outcome.tail
    return seconds + (2 * trial.settling.timeout if trial.output.log_settling else 0.0)
