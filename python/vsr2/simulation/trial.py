"""One trial: what is run, what its result depends on, and whether it can be run."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from vsr2 import _native
from vsr2.config.study import Outcome, Output, Settling
from vsr2.effects import Applied
from vsr2.errors import SimulationError
from vsr2.motion import Motion
from vsr2.results import STATE_COLUMNS
from vsr2.scene import Pose
from vsr2.simulation.scene import Scene

MAX_LOG_BYTES = 2e9
"""Greatest state log of one trial that is accepted."""


@dataclass(frozen=True, eq=False)
class Trial:
    """One run of one scene under one motion.

    Attributes:
        scene: what is shaken.
        motion: how; its time step must be the scene's. One that goes beside x needs the drive
            "prescribed".
        drive: "prescribed", or "motor" (S1.3: position and velocity reference for cosine motions,
            position only for recordings).
        start: pose X_WM of the rock's model frame; None: the scene's.
        name: default: the motion's.
        seed: of whatever was drawn for this trial before dispatch; kept with the result.
        settling, outcome, output: as in a study.
        effects: that are in it, as `apply_effects` notes them; those on the outcome are applied to
            the result.
    """

    scene: Scene
    motion: Motion
    drive: Literal["prescribed", "motor"] = "prescribed"
    start: Pose | None = None
    name: str = ""
    seed: int = 0
    settling: Settling = field(default_factory=Settling)
    outcome: Outcome = field(default_factory=Outcome)
    output: Output = field(default_factory=Output)
    effects: tuple[Applied, ...] = ()


def plan_sha256(trials: Sequence[Trial]) -> str:
    """Hash of all that the results of these trials depend on."""
    digest = hashlib.sha256(str(_native.build_facts()["version"]).encode())
    for trial in trials:
        start = trial.start or trial.scene.rock.start
        for text in (
            trial.name,
            trial.scene.sha256,
            trial.motion.sha256,
            trial.motion.kind,
            trial.drive,
            repr(start),
            str(trial.seed),
            trial.settling.model_dump_json(),
            trial.outcome.model_dump_json(),
            trial.output.model_dump_json(),
            *(applied.key for applied in trial.effects),
        ):
            digest.update(text.encode() + b"\0")
    return digest.hexdigest()


def check_trials(trials: Sequence[Trial]) -> None:
    """Refuse what cannot be run, before any trial runs.

    Raises:
        SimulationError: a motion of another time step than its scene's, a motor asked to drive a
            motion beside x or a pedestal that pitches on a spring, a motion that pitches such a
            pedestal, or a log that could outgrow memory.
    """
    for trial in trials:
        scene, motion = trial.scene, trial.motion
        if abs(motion.time_step - scene.engine.time_step) > 1e-12 * scene.engine.time_step:
            raise SimulationError(
                f"motion {motion.name!r} is sampled at {motion.time_step:g} s but the engine steps "
                f"at {scene.engine.time_step:g} s; resample the motion in time"
            )
        if motion.is_spatial and trial.drive != "prescribed":
            raise SimulationError(
                f"motion {motion.name!r} goes beside x; only drive: prescribed follows it"
            )
        if scene.pitches and trial.drive != "prescribed":
            raise SimulationError(
                f"trial {trial.name or motion.name!r}: the pedestal pitches on a spring; only "
                "drive: prescribed lets it"
            )
        if scene.pitches and motion.pitch is not None:
            raise SimulationError(
                f"motion {motion.name!r} pitches, and the pedestal pitches on a spring; leave one "
                "of them out"
            )
        size, every = state_bytes(trial), trial.output.log_every * scene.engine.time_step
        if size > MAX_LOG_BYTES:
            raise SimulationError(
                f"trial {trial.name or motion.name!r}: its log could take {size / 1e9:.3g} GB "
                f"({_longest(trial):g} s, a row every {every:g} s); raise output.log_every or "
                "shorten outcome.tail"
            )


def goes_beside_x(trial: Trial) -> bool:
    """Whether the pedestal moves along y or z or pitches."""
    return trial.motion.is_spatial or trial.scene.pitches


def _longest(trial: Trial) -> float:
    """The longest time that a trial can log [s]."""
    seconds = trial.motion.duration + trial.outcome.tail
    return seconds + (2 * trial.settling.timeout if trial.output.log_settling else 0.0)


def state_bytes(trial: Trial) -> float:
    """Size that a trial's state log cannot exceed [byte]."""
    if trial.output.log_every == 0:
        return 0.0
    rows = _longest(trial) / (trial.scene.engine.time_step * trial.output.log_every)
    return float(rows * state_columns(trial) * 8)


def state_columns(trial: Trial) -> int:
    """Columns of a trial's state log."""
    return len(STATE_COLUMNS) + (3 if goes_beside_x(trial) else 0)
