"""Effects that move the pedestal beside its axis: across, vertically, in pitch."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import ClassVar, Literal

from vsr2.config.study import Contact, Engine
from vsr2.effects.effect import Effect
from vsr2.effects.parameter import Parameter
from vsr2.effects.standing import mass_height
from vsr2.errors import ConfigError, Fault, MotionError, SimulationError
from vsr2.motion import STANDARD_GRAVITY, SideMotion
from vsr2.scene import Mechanisms, PedestalBody, PitchSpring, RockBody, Scene
from vsr2.scene.rotation import IDENTITY
from vsr2.trial import Trial

MAX_PITCH_FREQUENCY = 0.25
"""Of a table that pitches, over the solver's steps in a second: faster ones are not resolved."""


class MotionBeside(Effect):
    """A share of the motion along x in another direction, beside what is there already.

    Attributes:
        direction: a name of :attr:`vsr2.motion.Motion.sides`.
    """

    direction: ClassVar[Literal["transverse", "vertical"]]
    stage = "actuation"

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        _assert_prescribed(trial)
        motion, share = trial.motion, values["share"]
        side = motion.sides[self.direction]
        displacement, velocity = share * motion.displacement, share * motion.velocity
        if side is not None:
            displacement, velocity = displacement + side.displacement, velocity + side.velocity
        source = f"{motion.source}; {self.direction} {share:.12g} of it"
        made = motion.with_sides(source, **{self.direction: SideMotion(displacement, velocity)})
        return trial.under(made)


class OffAxisMotion(MotionBeside):
    """The table moves across its axis, too.

    The same displacement along y, times the share.
    """

    name = "off_axis_motion"
    meaning = "The table moves across the shaking in proportion to it"
    parameters = (
        Parameter(
            "share", "1", 0.0, 0.0, 0.20, "uniform", "of the motion along x", limits=(-2.0, 2.0),
            twice="sum",
        ),
    )  # fmt: skip
    channels = ("motion", "yaw", "tilt")
    confounded_with = ("spin_friction", "placement")
    source = "cross-coupling of a table's axes"
    rank = 6
    direction = "transverse"


class VerticalMotion(MotionBeside):
    """The table moves up and down, too.

    The same displacement along z, times the share. Uplift begins at a = g (b / h) / (1 - share b /
    h).
    """

    name = "vertical_motion"
    meaning = "The table moves vertically in proportion to the motion along x"
    parameters = (
        Parameter(
            "share", "1", 0.0, 0.0, 0.5, "uniform", "of the motion along x", limits=(-2.0, 2.0),
            twice="sum",
        ),
    )  # fmt: skip
    channels = ("motion", "tilt", "slip")
    source = "statics under g plus the vertical acceleration"
    rank = 7
    direction = "vertical"


def _assert_prescribed(trial: Trial) -> None:
    if trial.drive != "prescribed":
        raise SimulationError(
            f"moves the pedestal beside x, which motion.drive: {trial.drive} cannot follow; set "
            "motion.drive to prescribed, or leave the effect out",
            fault=Fault.drive,
        )


class TablePitch(Effect):
    """A table that pitches.

    A joint about y, `depth` below the pedestal's top, on a spring and a dashpot. The table's
    acceleration drives it, and the rock pushes back: its contacts and the joint are solved together
    in every step. Under a sine, and a rock far lighter than the table, it acts like a gain of 1 +
    compliance (1 + w^2 / p^2 + w^2 depth / g), p being the rock's frequency parameter.

    How far the joint gives way to the rock follows from what drives it: a table of mass m, its
    centre h above the joint, leans by m h g / k under 1 g. So the stiffness is k = moment g /
    compliance with moment = m h, and the table's inertia about the joint k / w^2. As the compliance
    goes to 0 the table becomes rigid. With a given inertia it would not: that table gives way to
    every impact of the rock, whatever drives it.
    """

    name = "table_pitch"
    meaning = (
        "A sprung joint under the pedestal lets it pitch: an oscillator driven by the table's "
        "acceleration, leaning back as the table accelerates, and by the rock"
    )
    parameters = (
        Parameter(
            "compliance", "rad/g", 0.0, 0.0, 0.02, "uniform",
            "pitch under a constant acceleration, without a rock", limits=(-0.2, 0.2),
        ),
        Parameter(
            "frequency", "Hz", 10.0, 5.0, 20.0, "uniform", "of the pitching, without a rock",
            limits=(1.0, 200.0), secondary=True,
        ),
        Parameter(
            "damping", "1", 0.1, 0.02, 1.0, "fixed", "damping ratio of the pitching",
            limits=(0.001, 10.0), secondary=True,
        ),
        Parameter(
            "depth", "m", 0.5, 0.0, 2.0, "fixed", "of the joint below the pedestal's top",
            limits=(0.0, 20.0), secondary=True,
        ),
        Parameter(
            "moment", "kg m", 1000.0, 200.0, 1e4, "fixed",
            "mass of the table times the height of its centre over the joint: 2 t at 0.5 m; the "
            "greater, the less the rock pushes back", limits=(1.0, 1e12), secondary=True,
        ),
    )  # fmt: skip
    channels = ("motion", "tilt", "slip")
    confounded_with = ("table_gain",)
    source = "pitch'' + 2 zeta w pitch' + w^2 pitch = -w^2 compliance a / g + M_rock / inertia"
    stage = "actuation"
    rank = 8
    once = "the pedestal has one joint"

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        _assert_prescribed(trial)
        frequency, compliance = values["frequency"], values["compliance"]
        if trial.motion.pitch is not None:
            raise MotionError(
                f"motion {trial.motion.name!r} pitches already; leave its pitch out, or the effect"
            )
        fastest = MAX_PITCH_FREQUENCY * trial.scene.engine.substeps / trial.scene.engine.time_step
        if frequency >= fastest:
            raise ConfigError(
                f"{frequency:g} Hz is not below a quarter of the solver's steps in a second, "
                f"{fastest:g} Hz; lower it, or engine.time_step",
                key="effects.table_pitch.frequency",
            )
        stiffness = values["moment"] * STANDARD_GRAVITY / abs(compliance)
        weight = trial.scene.rock.mass.mass * trial.scene.engine.gravity
        burden = weight * (mass_height(trial) + values["depth"])
        if burden >= stiffness:
            raise ConfigError(
                f"{values['moment']:g} kg m makes a joint of {stiffness:.3g} N m/rad, which does "
                f"not carry the rock, m g h = {burden:.3g} N m; raise it, or lower compliance",
                key="effects.table_pitch.moment",
            )
        # A slope raises one rim of the top; the joint stays below where the rock stands.
        pedestal = trial.scene.pedestal
        level = pedestal.top
        if pedestal.slope != IDENTITY and pedestal.pitch_pivot is not None:
            level = pedestal.pitch_pivot
        spring = PitchSpring(
            frequency=frequency,
            damping=values["damping"],
            compliance=compliance / STANDARD_GRAVITY,
            inertia=stiffness / (2 * math.pi * frequency) ** 2,
        )
        return replace(trial, scene=_sprung(*_bodies(trial.scene), level - values["depth"], spring))


def _bodies(scene: Scene) -> tuple[RockBody, PedestalBody, Engine, Contact, Mechanisms]:
    return scene.rock, scene.pedestal, scene.engine, scene.contact, scene.mechanisms


@lru_cache(maxsize=16)  # One scene under many motions, so that its hash is found once.
def _sprung(
    rock: RockBody,
    pedestal: PedestalBody,
    engine: Engine,
    contact: Contact,
    mechanisms: Mechanisms,
    pivot: float,
    spring: PitchSpring,
) -> Scene:
    """The scene with a sprung joint under its pedestal, its axis at a height [m]."""
    under = replace(pedestal, pitch_pivot=pivot, pitch_spring=spring)
    return Scene(rock, under, engine, contact, mechanisms)
