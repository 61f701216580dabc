"""The study: every setting of a simulation, typed, frozen and in SI units.

A study has one section per concept of supplement S1.2: ``engine``, ``pedestal``, ``rock``,
``contact``, ``motion``, ``effects``, ``settling``, ``outcome``, ``output``. A key that would do
nothing is refused, not ignored. Paths are kept as written here; :mod:`vsr2.config.load` resolves
them against the folder of the file that names them.

Numbers are strict: text and booleans are no numbers, NaN and infinity are refused. Upper bounds are
far outside anything physical; they stop a slip of units or of a digit before it costs memory.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    Strict,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic_core import PydanticCustomError

Real = Annotated[float, Strict()]
Positive = Annotated[float, Strict(), Field(gt=0)]
NonNegative = Annotated[float, Strict(), Field(ge=0)]
Length = Annotated[float, Strict(), Field(gt=0, le=1e5)]
Scale = Annotated[float, Strict(), Field(gt=0, le=1e6)]
Mass = Annotated[float, Strict(), Field(gt=0, le=1e12)]
Flag = Annotated[bool, Strict()]
Vector3 = tuple[Real, Real, Real]
Size = tuple[Length, Length, Length]

RecordUnits = Literal[
    "g", "m/s^2", "cm/s^2", "mm/s^2", "m/s", "cm/s", "mm/s", "m", "cm", "mm", "in"
]

MAX_GRID_TRIALS = 1_000_000
MIN_STEPS_A_PERIOD = 10


def _encodable(value: Path) -> Path:
    text = str(value)
    if "\0" in text or any("\ud800" <= c <= "\udfff" for c in text):
        raise ValueError("is no file name: it holds a character that no file system stores")
    return value


FilePath = Annotated[Path, AfterValidator(_encodable)]


def _nearly_unit(value: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    # One per cent admits orientations written with two decimals; it is kept as given because the
    # original passes it on without normalising.
    norm = math.hypot(*value)
    if abs(norm - 1.0) > 0.01:
        raise ValueError(f"is no rotation: the quaternion's norm is {norm:.4g}; scale it to 1")
    return value


QuaternionXyzw = Annotated[tuple[Real, Real, Real, Real], AfterValidator(_nearly_unit)]


def _assume(key: str, tag: str) -> BeforeValidator:
    """Let `key` default to `tag`: a tagged union does not look at the defaults of its members."""

    def fill(value: object) -> object:
        if isinstance(value, Mapping) and key not in value:
            return {key: tag, **value}
        return value

    return BeforeValidator(fill)


def _inapplicable(key: str, reason: str) -> PydanticCustomError:
    """An error at `key` (dotted, below the section that raises it) for a key without effect."""
    return PydanticCustomError("inapplicable_key", "{reason}", {"key": key, "reason": reason})


class Section(BaseModel):
    """Base of all sections: frozen, unknown keys refused, NaN and infinity refused."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )


MAX_SWEEPS_A_STEP = 1_000_000
"""Most solver sweeps of one time step: some tenths of a second."""


class Engine(Section):
    """The physics engine (supplement S1.2)."""

    mode: Literal["auto", "parity", "exact", "fast"] = "auto"
    """`parity`: Bullet's own code, bit-identical with PyBullet on the same machine; `exact`: the
    same bits, two to four times sooner; `fast`: the same model in a stepper of our own for one
    convex rock on a prism's flat top, equal to rounding (which a chaotic response enlarges within
    seconds), so equal in ensembles; `auto`: `fast` where it takes the scene, else `exact`."""
    gravity: Annotated[float, Strict(), Field(gt=0, le=1000)] = 9.81
    """Acceleration of gravity, downwards [m/s^2]."""
    time_step: Annotated[float, Strict(), Field(ge=1e-6, le=0.02)] = 0.001
    """Interval between two drive set-points and two log rows [s]."""
    substeps: Annotated[int, Strict(), Field(ge=1, le=1000)] = 1
    """Solver steps per `time_step`, each of `time_step / substeps`."""
    solver_iterations: Annotated[int, Strict(), Field(ge=1, le=100_000)] = 150
    """Sequential-impulse sweeps per solver step."""
    residual_threshold: NonNegative = 0.0
    """Stop the sweeps once the largest squared velocity change is at most this [(m/s)^2]; 0:
    never."""
    restitution_velocity_threshold: NonNegative = 0.2
    """Approach speed under which an impact does not bounce [m/s]."""
    cone_friction: Flag = True
    """Bound friction by a cone (implicit cone), not by a pyramid along two directions."""
    deterministic_overlapping_pairs: Flag = True
    """Sort overlapping pairs before the narrow phase."""
    split_impulse: Flag = True
    """Kept for files of the original; Bullet ignores it for multibody contacts, so only the
    default is accepted."""
    split_impulse_penetration_threshold: Real = -0.04
    """As `split_impulse` [m]."""
    collision_margin: Annotated[float, Strict(), Field(ge=0, le=0.1)] = 0.001
    """Margin around every collision shape [m]."""
    contact_breaking_threshold: Annotated[float, Strict(), Field(gt=0, le=0.5)] = 0.02
    """Distance at which a cached contact point is dropped, per angular motion disc (about the
    greatest radius) of the smaller body [1]."""
    linear_damping: Annotated[float, Strict(), Field(ge=0, lt=1)] = 0.04
    """Bullet's velocity damping of the bodies' translation, linear and quadratic term [1/s]."""
    angular_damping: Annotated[float, Strict(), Field(ge=0, lt=1)] = 0.04
    """Bullet's velocity damping of the bodies' rotation, linear and quadratic term [1/s]."""

    @model_validator(mode="after")
    def _step_stays_short(self) -> Self:
        if self.substeps * self.solver_iterations > MAX_SWEEPS_A_STEP:
            raise ValueError(
                f"substeps ({self.substeps}) times solver_iterations ({self.solver_iterations}) is "
                f"above {MAX_SWEEPS_A_STEP} sweeps a time step; a run could not be interrupted"
            )
        return self

    @field_validator("split_impulse", "split_impulse_penetration_threshold")
    @classmethod
    def _refuse_dead_keys(cls, value: float, info: ValidationInfo) -> float:
        if info.field_name is not None and value != cls.model_fields[info.field_name].default:
            raise ValueError(
                "has no effect: Bullet solves the contacts of multibodies (rock and pedestal) "
                "without split impulse; remove the key"
            )
        return value


class Base(Section):
    """The static block under the pedestal."""

    size: Size = (50.0, 14.0, 2.0)
    """Edge lengths along x, y, z [m]; it stands on z = 0."""


class PrismPedestal(Section):
    """A prism with a flat top; serves lab tables and idealised studies."""

    shape: Literal["prism"] = "prism"
    size: Size = (10.0, 10.0, 0.5)
    """Edge lengths along x, y, z [m]."""
    mass: Mass = 2.0e5
    """Mass carried by the prismatic joint [kg]; accepted only with `drive: motor`, since a
    prescribed motion does not depend on it."""
    base: Base = Base()
    """The static block under the pedestal."""


class MeshPedestal(Section):
    """A pedestal from topography."""

    shape: Literal["mesh"]
    file: FilePath
    """OBJ, STL or PLY in metres [m]."""
    scale: Scale = 1.0
    """Factor on the mesh's coordinates."""
    collision: Literal["hull", "decomposition", "triangles"] = "decomposition"
    """`hull`: convex hull (a pedestal without hollows); `decomposition`: several hulls (hollows);
    `triangles`: the exact moving surface (fine relief; a rock on many small triangles trembles by
    some mm/s, so raise the rest speeds of `settling` with it)."""
    mass: Mass = 2.0e5
    """Mass carried by the prismatic joint [kg]; accepted only with `drive: motor`, since a
    prescribed motion does not depend on it."""
    base: Base = Base()
    """The static block under the pedestal."""


class FixedStart(Section):
    """The rock's model frame placed as told."""

    mode: Literal["pose"]
    position: Vector3
    """Position of the model frame's origin in the world [m]."""
    orientation: QuaternionXyzw = (0.0, 0.0, 0.0, 1.0)
    """Rotation of the model frame, quaternion x, y, z, w."""


class YawStart(Section):
    """The rock turned about the vertical and lowered until it touches."""

    mode: Literal["yaw"] = "yaw"
    yaw: Real = 0.0
    """Turn about the world's z axis [degree]."""
    base_orientation: QuaternionXyzw = (0.0, 0.0, 0.0, 1.0)
    """Rotation of the model frame before the turn (what stands up), quaternion x, y, z, w."""
    position_xy: tuple[Real, Real] = (0.0, 0.0)
    """Where the mass centre stands above the pedestal, x and y [m]."""


Start = Annotated[FixedStart | YawStart, Field(discriminator="mode"), _assume("mode", "yaw")]


class _Massive(Section):
    density: Annotated[float, Strict(), Field(gt=0, le=1e5)] | None = None
    """Density of the homogeneous solid [kg/m^3]; give this or `mass`."""
    mass: Mass | None = None
    """Mass [kg]; give this or `density`."""
    start: Start = YawStart()
    """Where the rock stands before it settles."""

    @model_validator(mode="after")
    def _one_of_mass_and_density(self) -> Self:
        if (self.mass is None) == (self.density is None):
            raise ValueError("give exactly one of `density` [kg/m^3] and `mass` [kg]")
        return self


class BoxRock(_Massive):
    """A homogeneous block."""

    shape: Literal["box"]
    size: Size
    """Edge lengths along x, y, z of the model frame [m]."""


class MeshRock(_Massive):
    """A scanned rock; collides as its convex hull."""

    shape: Literal["mesh"]
    file: FilePath
    """OBJ, STL or PLY, watertight, in metres [m]."""
    scale: Scale = 1.0
    """Factor on the mesh's coordinates."""
    inertia: Literal["mesh", "aabb"] = "mesh"
    """`mesh`: mass centre and principal inertia of the homogeneous solid (trimesh); `aabb`: the
    original's: mass centre at the model origin, inertia of Bullet's bounding box."""
    repair: Flag = False
    """Try to close a mesh that is not watertight; what was changed is reported."""


class UrdfRock(Section):
    """A rock described by a one-link URDF; mass and inertia come from the file."""

    shape: Literal["urdf"]
    file: FilePath
    """The URDF; meshes it names are found relative to it."""
    scale: Scale = 1.0
    """Factor on the lengths in the file."""
    inertia: Literal["file", "mesh", "aabb"] = "file"
    """`file`: the URDF's `<inertial>`; `mesh`: of the homogeneous solid with the file's mass;
    `aabb`: Bullet's bounding box."""
    start: Start = YawStart()
    """Where the rock stands before it settles."""


Rock = Annotated[BoxRock | MeshRock | UrdfRock, Field(discriminator="shape")]
Pedestal = Annotated[
    PrismPedestal | MeshPedestal, Field(discriminator="shape"), _assume("shape", "prism")
]


class Material(Section):
    """Body-level contact inputs (supplement S2.1); pair values follow from both bodies by Eq. 1.

    The defaults are the supplement's best values (Table S1).
    """

    restitution: Annotated[float, Strict(), Field(ge=0, le=1)] = 0.35
    """Coefficient of restitution; the pair's is the product of both bodies'."""
    lateral_friction: NonNegative = 0.7
    """Coulomb friction coefficient; the pair's is the product of both bodies'."""
    spinning_friction: NonNegative = 0.5
    """Resistance against turning about the contact normal."""
    rolling_friction: NonNegative = 0.0
    """Resistance against rolling; the original leaves it at 0."""
    stiffness: Positive = 2.6e9
    """Contact stiffness, per contact point [N/m]."""
    damping: NonNegative = 1.0e7
    """Contact damping, per contact point [N s/m]."""


class Contact(Section):
    """The contact between rock and pedestal, as inputs of each body (supplement S2.1)."""

    rock: Material = Material()
    """The rock's material."""
    pedestal: Material = Material()
    """The pedestal's material."""


class Range(Section):
    """`min`, `min + step`, ... up to and including `max` (within half a millionth of a step)."""

    min: Positive
    """First value."""
    max: Positive
    """Last value, where the steps reach it."""
    step: Positive
    """Spacing."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.max < self.min:
            raise ValueError(f"max ({self.max}) is below min ({self.min})")
        if (self.max - self.min) / self.step > 100_000:
            raise ValueError("more than 100 000 values; raise `step`")
        return self

    @property
    def count(self) -> int:
        """Number of values."""
        return math.floor((self.max - self.min) / self.step + 5e-7) + 1


class _Driven(Section):
    drive: Literal["motor", "prescribed"] = "prescribed"
    """`motor`: Bullet's joint motor follows the set-points (the original; lags); `prescribed`: the
    pedestal moves exactly as told."""


class SingleCosine(_Driven):
    """x(t) = A (1 - cos 2 pi F t), one period (S1.3). Give A and F, or PGA and PGV/PGA."""

    mode: Literal["single_cosine"]
    amplitude: Annotated[float, Strict(), Field(gt=0, le=100)] | None = None
    """A, half the peak displacement [m]."""
    frequency: Annotated[float, Strict(), Field(ge=1e-3, le=1e3)] | None = None
    """F [Hz]."""
    pga: Annotated[float, Strict(), Field(gt=0, le=100)] | None = None
    """Peak ground acceleration [g]."""
    pgv_pga: Annotated[float, Strict(), Field(gt=0, le=100)] | None = None
    """PGV/PGA, which is 1 / (2 pi F) [s]."""

    @model_validator(mode="after")
    def _one_parametrisation(self) -> Self:
        by_af = self.amplitude is not None and self.frequency is not None
        by_im = self.pga is not None and self.pgv_pga is not None
        given = sum(v is not None for v in (self.amplitude, self.frequency, self.pga, self.pgv_pga))
        if given != 2 or by_af == by_im:
            raise ValueError("give `amplitude` and `frequency`, or `pga` and `pgv_pga`")
        return self


class GridCosine(_Driven):
    """Single cosines over a grid of PGA and PGV/PGA (S1.3)."""

    mode: Literal["grid_cosine"]
    pga: Range
    """Peak ground accelerations [g]; at most 100."""
    pgv_pga: Range
    """Ratios PGV/PGA [s]; at most 100."""

    @model_validator(mode="after")
    def _bounded(self) -> Self:
        for key in ("pga", "pgv_pga"):
            if getattr(self, key).max > 100:
                raise ValueError(f"{key}.max is above 100; check its unit")
        if self.pga.count * self.pgv_pga.count > MAX_GRID_TRIALS:
            raise ValueError(
                f"{self.pga.count} x {self.pgv_pga.count} trials are more than "
                f"{MAX_GRID_TRIALS}; raise `step`"
            )
        return self


class Filter(Section):
    """Zero-phase Butterworth band-pass applied to the recording at its own sampling."""

    low: NonNegative = 0.1
    """Lower corner [Hz]; 0: none."""
    high: Positive = 25.0
    """Upper corner [Hz]."""
    order: Annotated[int, Strict(), Field(ge=1, le=10)] = 3
    """Order of the filter, run forward and backward."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.low >= self.high:
            raise ValueError(f"low ({self.low} Hz) must be below high ({self.high} Hz)")
        return self


class _Recorded(_Driven):
    channel: Literal["auto", "displacement", "velocity", "acceleration", "fused"] = "auto"
    """Which recorded channel drives the pedestal; `auto`: displacement where there is one, else
    velocity, else acceleration; `fused`: displacement and acceleration together, each weighted by
    its noise."""
    units: RecordUnits | None = None
    """Of recordings in a format that carries none (text in columns, the original's `.tab`,
    miniSEED, SAC); for other formats it is refused."""
    filter: Filter | None = None
    """Band-pass before use; none given: the recording as it is."""
    scale: Scale = 1.0
    """Factor on the motion."""


class SingleRecording(_Recorded):
    """One recording."""

    mode: Literal["single_recording"]
    file: FilePath
    """The recording."""


def _file_name_pattern(value: str) -> str:
    if "/" in value or "\\" in value or "\0" in value:
        raise ValueError("is matched against file names; name the folder in `folder`")
    return value


class AllRecordings(_Recorded):
    """Every recording of a folder."""

    mode: Literal["all_recordings"]
    folder: FilePath
    """Folder with the recordings; its subfolders are not searched."""
    pattern: Annotated[
        str, Field(min_length=1, max_length=200), AfterValidator(_file_name_pattern)
    ] = "*"
    """Glob over the file names; all matches in order of name."""


MotionSource = Annotated[
    SingleCosine | GridCosine | SingleRecording | AllRecordings, Field(discriminator="mode")
]


class Settling(Section):
    """Before the motion: the rock is let go and must come to rest."""

    linear_speed: Positive = 1.0e-3
    """At rest when the mass centre is slower than this relative to the pedestal ... [m/s]"""
    angular_speed: Positive = 2.0e-3
    """... and the rock turns slower than this ... [rad/s]"""
    window: Annotated[float, Strict(), Field(gt=0, le=3600)] = 0.25
    """... without a break for this long [s]."""
    timeout: Annotated[float, Strict(), Field(gt=0, le=3600)] = 60.0
    """Not at rest by then: the trial ends with status `settling_timeout` [s]."""

    @model_validator(mode="after")
    def _window_fits(self) -> Self:
        if self.window > self.timeout:
            raise ValueError(
                f"window ({self.window} s) is longer than timeout ({self.timeout} s), so no rock "
                "could settle"
            )
        return self


class Outcome(Section):
    """How a trial's end is told; tilt is the angle of the body away from its settled pose."""

    tail: Annotated[float, Strict(), Field(gt=0, le=3600)] = 30.0
    """After the motion the trial runs on until the rock rests, at most this long [s]."""
    rest_linear_speed: Positive = 0.02
    """The tail ends when the mass centre is slower than this relative to the pedestal ... [m/s]"""
    rest_angular_speed: Positive = 0.05
    """... and the rock turns slower than this ... [rad/s]"""
    rest_window: Annotated[float, Strict(), Field(gt=0, le=3600)] = 0.5
    """... without a break for this long, and eight times as long while it leans by `rocked_tilt` or
    more, as it may pause at its point of balance: too slow to overturn any more [s]."""
    overturned_tilt: Annotated[float, Strict(), Field(gt=0, lt=3.1416)] = 1.4
    """A tilt from which nothing comes back: the trial may stop [rad]."""
    toppled_tilt: Annotated[float, Strict(), Field(gt=0, lt=3.1416)] = 0.35
    """Tilted more than this in the end: it rests on another face and has overturned [rad]."""
    rocked_tilt: Positive = 0.01
    """Peak tilt from which a trial counts as rocked [rad]."""
    slid_distance: Positive = 0.005
    """Travel of the rock's foot (its point under the mass centre) relative to the pedestal in the
    end from which it slid [m]."""
    rotated_angle: Positive = 0.035
    """Turn about the vertical in the end from which it rotated [rad]."""
    stop_early: Flag = True
    """Stop once overturned irreversibly, or at rest after the motion and not creeping so fast that
    the rest of the tail could make it slid or rotated."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.rocked_tilt <= self.toppled_tilt <= self.overturned_tilt:
            raise ValueError(
                f"rocked_tilt ({self.rocked_tilt}), toppled_tilt ({self.toppled_tilt}) and "
                f"overturned_tilt ({self.overturned_tilt}) must not decrease in this order"
            )
        return self


class Output(Section):
    """What a run writes."""

    log_every: Annotated[int, Strict(), Field(ge=0)] = 10
    """Log the state every so many time steps; 0: no log."""
    log_settling: Flag = False
    """Log the settling before the motion, too."""
    contacts_every: Annotated[int, Strict(), Field(ge=0)] = 0
    """Log contacts every so many time steps; 0: no contact log."""
    contact_trials: tuple[Annotated[int, Strict(), Field(ge=0)], ...] | None = None
    """Trials whose contacts are logged, counted from 0; none given: all."""
    npy: Flag = False
    """Also write the original's `.npy` rows."""
    figures: Flag = True
    """Write figures."""

    @model_validator(mode="after")
    def _refuse_dead_keys(self) -> Self:
        for key in ("log_settling", "npy"):
            if getattr(self, key) and self.log_every == 0:
                raise _inapplicable(
                    key, "has no effect without a log; set output.log_every above 0"
                )
        if self.contacts_every and self.log_every == 0:
            raise _inapplicable(
                "contacts_every", "needs the state's log beside it; set output.log_every above 0"
            )
        if self.contact_trials is not None and self.contacts_every == 0:
            raise _inapplicable(
                "contact_trials",
                "has no effect without a contact log; set output.contacts_every above 0",
            )
        return self


_EFFECT_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,99}\Z")


def _effects_mapping(given: object) -> object:
    """Check the form of `effects`; which names and values exist the library of effects knows."""
    if not isinstance(given, Mapping):
        raise ValueError(
            f"must hold names of effects, each with its parameters (is {str(given)[:60]!r}); "
            "`vsr2 effects list` prints the names"
        )
    for name, values in given.items():
        key = str(name)[:100]
        if not isinstance(name, str) or not _EFFECT_WORD.match(name):
            raise ValueError(f"{key!r} is no name of an effect; `vsr2 effects list` prints them")
        if not isinstance(values, Mapping) or not values:
            raise _inapplicable(
                key,
                f"must hold parameters, {{PARAMETER: VALUE, ...}}; `vsr2 effects show {name}` "
                "prints them",
            )
        for parameter, value in values.items():
            if not isinstance(parameter, str) or not _EFFECT_WORD.match(parameter):
                raise _inapplicable(key, f"{str(parameter)[:100]!r} is no name of a parameter")
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if number and math.isfinite(value):
                continue
            if isinstance(value, str) and _EFFECT_WORD.match(value):
                continue
            raise _inapplicable(
                f"{key}.{parameter}",
                f"must be a finite number, or a word where `vsr2 effects show {name}` says so "
                f"(is {str(value)[:60]!r})",
            )
    return {name: dict(values) for name, values in given.items()}


Effects = Annotated[dict[str, dict[str, float | str]], BeforeValidator(_effects_mapping)]


class Study(Section):
    """Everything `vsr2 run` needs."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._ -]*$", max_length=100)] = "study"
    """Name of the study and of its result folder: letters, digits, `.`, `_`, `-` and blanks."""
    seed: Annotated[int, Strict(), Field(ge=0, lt=2**63)] = 0
    """Seed of everything random."""
    engine: Engine = Engine()
    """The physics engine."""
    pedestal: Pedestal = PrismPedestal()
    """The body that is driven."""
    rock: Rock
    """The body that stands on it."""
    contact: Contact = Contact()
    """Contact between both."""
    motion: MotionSource
    """The ground motion, or several."""
    effects: Effects = {}
    """Effects added to the simulation, by name, each with its parameters: `{edge_rounding: {radius:
    0.006}}`; `vsr2 effects list` prints the library (docs/reference/effects.md)."""
    settling: Settling = Settling()
    """The rest before the motion."""
    outcome: Outcome = Outcome()
    """How a trial's end is told."""
    output: Output = Output()
    """What is written."""

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.motion.drive == "prescribed" and "mass" in self.pedestal.model_fields_set:
            raise _inapplicable(
                "pedestal.mass",
                "has no effect with `motion.drive: prescribed`, where the pedestal moves exactly "
                "as told; remove the key, or set `motion.drive: motor`",
            )
        period = _shortest_period(self.motion)
        if period is not None and period < MIN_STEPS_A_PERIOD * self.engine.time_step:
            raise ValueError(
                f"the shortest cosine lasts {period:.4g} s, less than {MIN_STEPS_A_PERIOD} time "
                f"steps of {self.engine.time_step:g} s; lower engine.time_step, or the frequency"
            )
        return self


def _shortest_period(
    motion: SingleCosine | GridCosine | SingleRecording | AllRecordings,
) -> float | None:
    """Shortest period of a cosine motion [s], from PGV/PGA = 1 / (2 pi F); none for recordings."""
    if isinstance(motion, GridCosine):
        return 2 * math.pi * motion.pgv_pga.min
    if isinstance(motion, SingleCosine):
        if motion.frequency is not None:
            return 1 / motion.frequency
        if motion.pgv_pga is not None:
            return 2 * math.pi * motion.pgv_pga
    return None
