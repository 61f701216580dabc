"""One trial: scene, motion, start, and how its end is judged."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

from vsr2._native import Outcome as Ending
from vsr2.argument_names import checked_names
from vsr2.config.motion_source import DRIVE_MODES, DriveMode
from vsr2.config.problems import shown
from vsr2.config.seeds import checked_seed
from vsr2.config.study import Outcome, Output, Settling, Study
from vsr2.errors import SimulationError
from vsr2.motion import Motion
from vsr2.one_line import OneLine
from vsr2.scene import Pose, RockBody, Scene


def rows_only(output: Output, log_every: int = 0) -> Output:
    """The output that keeps a row of the state every so many time steps of shaking, and no more."""
    return output.model_copy(
        update={
            "log_every": log_every,
            "log_settling": False,
            "contacts_every": 0,
            "contact_trials": None,
            "npy": False,
        }
    )


@dataclass(frozen=True)
class Observation:
    """What is written down of a trial.

    Attributes:
        outcome: stable, rocked, slid, rotated, overturned.
        peak_tilt, final_tilt: [rad].
        final_slip: [m].
        final_yaw: [rad].
    """

    outcome: str
    peak_tilt: float
    final_tilt: float
    final_slip: float
    final_yaw: float

    @property
    def overturned(self) -> bool:
        """Whether the trial counts as overturned."""
        return self.outcome == Ending.overturned.name


class ActingEffect(Protocol):
    """What a trial needs of an effect that is in it: a :class:`vsr2.effects.Effect`."""

    @property
    def name(self) -> str:
        """As a study writes it."""

    @property
    def stage(self) -> str:
        """What it changes."""

    @property
    def code(self) -> str:
        """What tells a user's effect from another of its name; empty for those of the library."""

    def observe(self, observation: Observation, values: Mapping[str, float]) -> Observation:
        """What is written down instead."""


@dataclass(frozen=True)
class Applied:
    """An effect as it is in one trial.

    Attributes:
        effect: of the library.
        given: values as asked for, the same in all trials.
        values: in force in the trial.
    """

    effect: ActingEffect
    given: tuple[tuple[str, float], ...]
    values: tuple[tuple[str, float], ...]

    @property
    def key(self) -> str:
        """Text that tells it from others."""
        return f"{self.effect.name}{self.values!r}{self.effect.code}"

    @property
    def bits(self) -> bytes:
        """What tells it from another of its effect that has values of the same names."""
        return struct.pack(f"{len(self.values)}d", *[value for _, value in self.values])


_FIELDS: Mapping[str, tuple[Any, str]] = {
    "scene": (Scene, "a Scene; `vsr2.build_scene(study)` makes one"),
    "motion": (Motion, "a Motion; `vsr2.motion` makes them of records and cosines"),
    "start": (Pose | None, "a vsr2.scene.Pose or None"),
    "name": (str, "text"),
    "settling": (Settling, "a vsr2.config.study.Settling"),
    "outcome": (Outcome, "a vsr2.config.study.Outcome"),
    "output": (Output, "a vsr2.config.study.Output"),
}
"""What the fields of a trial are, and where a value comes from."""


@checked_names(SimulationError)
@dataclass(frozen=True, eq=False, repr=False)
class Trial(OneLine):
    """One run of one scene under one motion; equal to another where content and names are.

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
        effects: that are in it, as `vsr2.effects.apply_effects` notes them; those on the outcome
            are applied to the result.

    Raises:
        SimulationError: a field of another type, an unknown drive, or a seed outside 0 to 2^63 - 1;
            names field and remedy.
    """

    scene: Scene
    motion: Motion
    drive: DriveMode = "prescribed"
    start: Pose | None = None
    name: str = ""
    seed: int = 0
    settling: Settling = field(default_factory=Settling)
    outcome: Outcome = field(default_factory=Outcome)
    output: Output = field(default_factory=Output)
    effects: tuple[Applied, ...] = ()

    def __post_init__(self) -> None:
        for key, (kind, remedy) in _FIELDS.items():
            value = getattr(self, key)
            if not isinstance(value, kind) or isinstance(value, bool):
                raise SimulationError(
                    f"Trial: {key} must be {remedy} (is {shown(value)} of type "
                    f"{type(value).__name__})"
                )
        object.__setattr__(self, "seed", checked_seed(self.seed, SimulationError, "Trial: seed"))
        try:
            object.__setattr__(self, "effects", tuple(self.effects))
        except TypeError:  # Refused below, as what it is.
            object.__setattr__(self, "effects", (self.effects,))
        if not all(isinstance(one, Applied) for one in self.effects):
            raise SimulationError("Trial: effects must be those that `vsr2.apply_effects` put in")
        if self.drive not in DRIVE_MODES:
            raise SimulationError(
                f"Trial: drive must be {' or '.join(DRIVE_MODES)} (is {shown(self.drive)})"
            )

    @classmethod
    def of_study(
        cls,
        study: Study,
        scene: Scene,
        motion: Motion,
        *,
        name: str,
        output: Output,
        seed: int = 0,
    ) -> Trial:
        """One with a study's drive, settling and rules of the outcome; effects are not in it.

        Raises:
            ConfigError: the study's time step is still to be chosen.
        """
        study.engine.check_time_step()
        return cls(
            scene=scene,
            motion=motion,
            drive=study.motion.drive,
            name=name,
            seed=seed,
            settling=study.settling,
            outcome=study.outcome,
            output=output,
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Trial):
            return NotImplemented
        return self.content == other.content and self.motion == other.motion

    def __hash__(self) -> int:
        return hash(self.content)

    @property
    def facts(self) -> Mapping[str, object]:
        """Its label, scene, motion and effects."""
        return {
            "label": self.label,
            "scene": self.scene,
            "motion": self.motion,
            "effects": [applied.effect.name for applied in self.effects],
        }

    @property
    def label(self) -> str:
        """Its name, or the motion's."""
        return self.name or self.motion.name

    @property
    def start_pose(self) -> Pose:
        """Where the rock begins, X_WM."""
        return self.start or self.scene.rock.start

    @property
    def body(self) -> RockBody:
        """The rock with the trial's start in it, as the functions of `vsr2.scene` take it."""
        return replace(self.scene.rock, start=self.start_pose)

    @property
    def goes_beside_x(self) -> bool:
        """Whether the pedestal moves along y or z or pitches."""
        return self.motion.is_spatial or self.scene.pitches

    def with_parts(self, rest: Trial, moved: Trial, effects: tuple[Applied, ...]) -> Trial:
        """The trial with motion and drive of one, with scene, start and rules of another.

        Nothing is checked again, as all of it is of trials.

        Args:
            rest: of which scene, start, settling and outcome are.
            moved: of which motion and drive are.
            effects: that are in it.
        """
        return self._with(
            motion=moved.motion, drive=moved.drive, scene=rest.scene, start=rest.start,
            outcome=rest.outcome, settling=rest.settling, effects=effects,
        )  # fmt: skip

    def under(self, motion: Motion) -> Trial:
        """The trial under another motion; nothing else is checked again."""
        return self._with(motion=motion)

    def starting(self, start: Pose) -> Trial:
        """The trial with another start; nothing else is checked again."""
        return self._with(start=start)

    def _with(self, **changes: Any) -> Trial:
        """The trial with other fields of the right types: `replace` would check all of them."""
        made = object.__new__(type(self))
        vars(made).update(vars(self), **changes)
        return made

    def with_scene(self, **changes: Any) -> Trial:
        """The trial with other fields of its scene, such as `rock` or `contact`."""
        return replace(self, scene=replace(self.scene, **changes))

    @property
    def content(self) -> bytes:
        """Text of all that its result depends on, scene and motion by their hashes."""
        parts = (
            self.name,
            self.scene.sha256,
            self.motion.sha256,
            self.motion.kind,
            self.drive,
            repr(self.start_pose),
            str(self.seed),
            self.settling.model_dump_json(),
            self.outcome.model_dump_json(),
            self.output.model_dump_json(),
            *(applied.key for applied in self.effects),
        )
        return b"".join(part.encode() + b"\0" for part in parts)

    @property
    def sha256(self) -> str:
        """Hash of all that its result depends on."""
        return hashlib.sha256(self.content).hexdigest()
