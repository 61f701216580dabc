"""The engine's settings, as a section of the study, and its time step."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    Strict,
    ValidationInfo,
    field_validator,
    model_serializer,
    model_validator,
)

from vsr2._native import EngineMode as EngineMode
from vsr2.config import sources as of
from vsr2.config.section import (
    DEFAULT_TIME_STEP,
    Flag,
    NonNegative,
    Real,
    Section,
    inapplicable,
)
from vsr2.errors import ConfigError

MAX_SWEEPS_A_STEP = 1_000_000
"""Most solver sweeps of one time step: some tenths of a second."""


class Engine(Section):
    """The physics engine (supplement S1.2)."""

    mode: EngineMode = "auto"
    """`parity`: Bullet's own code, bit-identical on the same machine with PyBullet whose bodies
    `createMultiBody` made, not `loadURDF`. `exact`: the same bits, in about half the time. `fast`:
    the same model in a stepper of our own, for one convex rock on a prism's flat top. It solves
    contacts to the end; with `converged_contacts: false` it equals `exact` to rounding, which a
    chaotic response enlarges within seconds. `auto`: `fast` where it takes the scene, else
    `exact`."""
    gravity: Annotated[float, Strict(), Field(gt=0, le=1000), of.GRAVITY] = 9.81
    """Acceleration of gravity, downwards [m/s^2]."""
    time_step: Annotated[float, Strict(), Field(ge=1e-6, le=0.02), of.TIME_STEP] = DEFAULT_TIME_STEP
    """Interval between two drive set-points and two log rows [s]."""
    time_step_tolerance: Annotated[float, Strict(), Field(gt=0, le=1)] | None = None
    """In place of `time_step`: a verb that simulates takes the longest step, up to 4 ms, that
    surely changes the mean logarithm of the strength at which motions overturn the rock by no more
    than this; 0.02 are 2 % (docs/reference/engines.md)."""
    substeps: Annotated[int, Strict(), Field(ge=1, le=1000), of.SUPPLEMENT_SOLVER] = 1
    """Solver steps per `time_step`, each of `time_step / substeps`."""
    solver_iterations: Annotated[int, Strict(), Field(ge=1, le=100_000), of.SUPPLEMENT_SOLVER] = 150
    """Sequential-impulse sweeps per solver step."""
    residual_threshold: Annotated[NonNegative, of.EVERY_SWEEP] = 0.0
    """Stop the sweeps once the largest squared velocity change is at most this [(m/s)^2]; 0:
    never."""
    converged_contacts: Annotated[Flag, of.CONVERGED] = True
    """Engine `fast`: contacts that stick are solved to where the sweeps lead in the end, and those
    of a hull are its vertices; false: every step is swept and level vertices are searched between,
    as Bullet does. `preset: original` takes false."""
    skip: Annotated[Literal["quiet", "none"], of.QUIET] = "quiet"
    """Engine `fast`: `quiet`: a rock at rest is not stepped while its contacts can bear the
    pedestal's acceleration; `none`: every step is taken. `preset: original` takes `none`."""
    restitution_velocity_threshold: Annotated[NonNegative, of.BULLET] = 0.2
    """Approach speed under which an impact does not bounce [m/s]."""
    cone_friction: Annotated[Flag, of.SUPPLEMENT_SOLVER] = True
    """Bound friction by a cone (implicit cone), not by a pyramid along two directions."""
    deterministic_overlapping_pairs: Annotated[Flag, of.SUPPLEMENT_SOLVER] = True
    """Sort overlapping pairs before the narrow phase."""
    split_impulse: Flag = True
    """Kept for files of the original; Bullet ignores it for multibody contacts, so only the
    default is accepted."""
    split_impulse_penetration_threshold: Annotated[Real, of.SUPPLEMENT_SOLVER] = -0.04
    """As `split_impulse` [m]."""
    collision_margin: Annotated[float, Strict(), Field(ge=0, le=0.1), of.PYBULLET] = 0.001
    """Margin around every collision shape [m]."""
    contact_breaking_threshold: Annotated[float, Strict(), Field(gt=0, le=0.5), of.BULLET] = 0.02
    """Distance at which a cached contact point is dropped, per angular motion disc (about the
    greatest radius) of the smaller body [1]."""
    linear_damping: Annotated[float, Strict(), Field(ge=0, lt=1), of.NO_DAMPING] = 0.0
    """Bullet's velocity damping of the bodies' translation, linear and quadratic term [1/s]. It
    acts on the velocity in space, so also on a rock at rest on a moving pedestal; `preset:
    original` has 0.04, Bullet's own default."""
    angular_damping: Annotated[float, Strict(), Field(ge=0, lt=1), of.NO_DAMPING] = 0.0
    """Bullet's velocity damping of the bodies' rotation, linear and quadratic term [1/s];
    `preset: original` has 0.04."""

    @model_validator(mode="after")
    def _step_stays_short(self) -> Self:
        if self.substeps * self.solver_iterations > MAX_SWEEPS_A_STEP:
            raise ValueError(
                f"substeps ({self.substeps}) times solver_iterations ({self.solver_iterations}) is "
                f"above {MAX_SWEEPS_A_STEP} sweeps a time step; a run could not be interrupted"
            )
        return self

    @model_validator(mode="after")
    def _step_or_tolerance(self) -> Self:
        if self.time_step_tolerance is not None and "time_step" in self.model_fields_set:
            raise inapplicable(
                "time_step_tolerance",
                f"chooses the time step, and engine.time_step states one ({self.time_step:g} s); "
                "leave one of them out; `--set engine.time_step_tolerance=null` does",
            )
        return self

    @model_serializer(mode="wrap")
    def _tolerance_where_stated(self, usual: SerializerFunctionWrapHandler) -> dict[str, Any]:
        # A key that is not stated must not tell scenes apart, whose hashes are of this.
        out: dict[str, Any] = usual(self)
        if self.time_step_tolerance is None:
            out.pop("time_step_tolerance", None)
        else:
            out.pop("time_step", None)
        return out

    def at_time_step(self, step: float) -> Engine:
        """The same with a time step [s], and no tolerance that chooses one."""
        return self.model_copy(update={"time_step": step, "time_step_tolerance": None})

    def check_time_step(self) -> None:
        """Refuse to simulate where the time step is still to be chosen.

        Raises:
            ConfigError: names the key and what chooses.
        """
        if self.time_step_tolerance is not None:
            raise ConfigError(
                f"engine.time_step_tolerance is {self.time_step_tolerance:g}, and no time step is "
                "chosen by it; call vsr2.analysis.choose_time_step(study), or state "
                "engine.time_step in its place"
            )

    @field_validator("split_impulse", "split_impulse_penetration_threshold")
    @classmethod
    def _refuse_dead_keys(cls, value: float, info: ValidationInfo) -> float:
        if info.field_name is not None and value != cls.model_fields[info.field_name].default:
            raise ValueError(
                "has no effect: Bullet solves the contacts of multibodies (rock and pedestal) "
                "without split impulse; remove the key"
            )
        return value
