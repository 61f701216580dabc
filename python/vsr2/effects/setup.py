"""What a trial is built from, before the native scene; effects change it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from vsr2.config.study import Contact, Engine, Outcome, Settling
from vsr2.errors import GeometryError
from vsr2.motion import Motion
from vsr2.scene import Box, Hull, Mechanisms, PedestalBody, Pose, RockBody, height_above


@dataclass(frozen=True, eq=False)
class Setup:
    """All that a trial is built from, before the native scene.

    Attributes:
        rock, pedestal, engine, contact, mechanisms: of the scene; `rock.start` is not used.
        motion, drive: how it is shaken.
        start: pose X_WM of the rock's model frame.
        outcome: how the end is told.
        settling: when it is at rest before the motion.
    """

    rock: RockBody
    pedestal: PedestalBody
    engine: Engine
    contact: Contact
    motion: Motion
    start: Pose
    mechanisms: Mechanisms = field(default_factory=Mechanisms)
    drive: Literal["prescribed", "motor"] = "prescribed"
    outcome: Outcome = field(default_factory=Outcome)
    settling: Settling = field(default_factory=Settling)

    @property
    def body(self) -> RockBody:
        """The rock with its start pose in it, as the functions of `vsr2.scene` take it."""
        return replace(self.rock, start=self.start)


@dataclass(frozen=True)
class Circumstances:
    """Of one trial in its campaign.

    Attributes:
        order: 0 at the first trial, 1 at the last.
        session: of the trial.
        sessions: all of the campaign, in order of execution.
        rng: for this trial and effect, from seeds alone: common random numbers.
    """

    order: float
    session: str
    sessions: tuple[str, ...]
    rng: np.random.Generator


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
        return self.outcome == "overturned"


def settle_at(setup: Setup, factor: float) -> Setup:
    """The setup at rest below `factor` times the default speeds, or below its own if greater.

    Hulls may tremble on their contacts without end, by micrometres, as the engine's choice of
    contact points changes from step to step; at the default speeds they never count as at rest.
    """
    own, usual = setup.settling, Settling()
    return replace(
        setup,
        settling=own.model_copy(
            update={
                "linear_speed": max(own.linear_speed, factor * usual.linear_speed),
                "angular_speed": max(own.angular_speed, factor * usual.angular_speed),
            }
        ),
    )


def restand(setup: Setup, parts: Sequence[Hull | Box], start: Pose | None = None) -> Pose:
    """The start raised or lowered so that other parts keep the present gap to the pedestal.

    Args:
        setup: with the present parts and start.
        parts: new collision parts of the rock in M.
        start: new start, whose height is set; by default the present one.

    Raises:
        GeometryError: the pedestal is no longer under the rock.
    """
    moved = setup.start if start is None else start
    before = height_above(setup.rock.parts, setup.start, setup.pedestal)
    after = height_above(parts, moved, setup.pedestal)
    if before is None or after is None:
        raise GeometryError("the effect leaves no pedestal under the rock; make it smaller")
    x, y, z = moved.position
    return Pose((x, y, z + (before - after)), moved.orientation)
