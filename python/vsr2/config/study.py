"""The study: every setting of a simulation, typed, frozen and in SI units.

A study has one section per concept of supplement S1.2: ``engine``, ``pedestal``, ``rock``,
``contact``, ``motion``, ``effects``, ``settling``, ``outcome``, ``output``. A key that would do
nothing is refused, not ignored. Paths are kept as written here; :mod:`vsr2.config.load` resolves
them against the folder of the file that names them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from os import PathLike
from typing import Annotated, Any, Literal, Self

from pydantic import (
    Field,
    Strict,
    model_validator,
)

from vsr2 import _native
from vsr2.config import sources as of
from vsr2.config.engine_settings import Engine as Engine
from vsr2.config.engine_settings import EngineMode as EngineMode
from vsr2.config.motion_source import MIN_STEPS_A_PERIOD, MotionSource, shortest_period
from vsr2.config.section import (
    MAX_SEED,
    FilePath,
    Flag,
    Mass,
    Positive,
    QuaternionXyzw,
    Real,
    Scale,
    Section,
    Size,
    Vector3,
    assume,
    inapplicable,
)
from vsr2.config.study_effects import Effects
from vsr2.one_line import OneLine

InertiaRule = Literal["file", "mesh", "aabb"]
"""Where mass and inertia of a URDF come from."""


class Base(Section):
    """The static block under the pedestal."""

    size: Annotated[Size, of.BASE_SIZE] = (50.0, 14.0, 2.0)
    """Edge lengths along x, y, z [m]; it stands on z = 0."""


class _Pedestal(Section):
    mass: Annotated[Mass, of.PEDESTAL_MASS] = 2.0e5
    """Mass carried by the prismatic joint [kg]; accepted only with `drive: motor`, since a
    prescribed motion does not depend on it."""
    base: Base = Base()
    """The static block under the pedestal."""


class PrismPedestal(_Pedestal):
    """A prism with a flat top; serves lab tables and idealised studies."""

    shape: Literal["prism"] = "prism"
    size: Annotated[Size, of.PEDESTAL_SIZE] = (10.0, 10.0, 0.5)
    """Edge lengths along x, y, z [m]."""


class MeshPedestal(_Pedestal):
    """A pedestal from topography."""

    shape: Literal["mesh"]
    file: FilePath
    """OBJ, STL or PLY in metres [m]."""
    scale: Annotated[Scale, of.NEUTRAL] = 1.0
    """Factor on the mesh's coordinates."""
    collision: Literal["hull", "decomposition", "triangles"] = "decomposition"
    """`hull`: convex hull (a pedestal without hollows); `decomposition`: several hulls (hollows);
    `triangles`: the exact moving surface (fine relief). A rock on many small triangles trembles by
    some mm/s, so raise the rest speeds of `settling` with them."""


class FixedStart(Section):
    """The rock's model frame placed as given."""

    mode: Literal["pose"]
    position: Vector3
    """Position of the model frame's origin in the world [m]."""
    orientation: Annotated[QuaternionXyzw, of.NEUTRAL] = (0.0, 0.0, 0.0, 1.0)
    """Rotation of the model frame, quaternion x, y, z, w."""


class YawStart(Section):
    """The rock turned about the vertical and lowered until it touches."""

    mode: Literal["yaw"] = "yaw"
    yaw: Annotated[Real, of.NEUTRAL] = 0.0
    """Turn about the world's z axis [degree]."""
    base_orientation: Annotated[QuaternionXyzw, of.NEUTRAL] = (0.0, 0.0, 0.0, 1.0)
    """Rotation of the model frame before the turn (what stands up), quaternion x, y, z, w."""
    position_xy: Annotated[tuple[Real, Real], of.NEUTRAL] = (0.0, 0.0)
    """Where the mass centre stands above the pedestal, x and y [m]."""


Start = Annotated[FixedStart | YawStart, Field(discriminator="mode"), assume("mode", "yaw")]


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
    scale: Annotated[Scale, of.NEUTRAL] = 1.0
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
    """The URDF; the meshes that it names lie in its folder or below it."""
    scale: Annotated[Scale, of.NEUTRAL] = 1.0
    """Factor on the lengths in the file."""
    inertia: InertiaRule = "file"
    """`file`: the URDF's `<inertial>`; `mesh`: of the homogeneous solid with the file's mass;
    `aabb`: Bullet's bounding box."""
    start: Start = YawStart()
    """Where the rock stands before it settles."""


Rock = Annotated[BoxRock | MeshRock | UrdfRock, Field(discriminator="shape")]
Pedestal = Annotated[
    PrismPedestal | MeshPedestal, Field(discriminator="shape"), assume("shape", "prism")
]


_CONTACT_PARAMETERS = {one.name: one for one in _native.contact_parameters()}


def _of_core(name: str) -> Any:
    """A contact parameter with default and range of the core, which checks it again."""
    core = _CONTACT_PARAMETERS[name]
    return Field(
        default=core.usual,
        strict=True,
        gt=core.least if core.above else None,
        ge=None if core.above else core.least,
        le=core.greatest if math.isfinite(core.greatest) else None,
    )


class Material(Section):
    """Body-level contact inputs (supplement S2.1); pair values follow from both bodies by Eq. 1.

    The defaults are the supplement's best values (Table S1), but for `spinning_friction`.
    """

    # Defaults and ranges stand in the core's table (cpp/include/vsr2/contact_model.hpp).
    restitution: Annotated[float, of.SUPPLEMENT_CONTACT] = _of_core("restitution")
    """Coefficient of restitution; the pair's is the product of both bodies'."""
    lateral_friction: Annotated[float, of.SUPPLEMENT_CONTACT] = _of_core("lateral_friction")
    """Coulomb friction coefficient; the pair's is the product of both bodies'."""
    spinning_friction: Annotated[float, of.POINT_CONTACT] = _of_core("spinning_friction")
    """Resistance against turning about the contact normal [m]. The pair's lever is that of the one
    times `lateral_friction` of the other, summed over both; a contact point bears a moment of at
    most lever times normal force. A real contact patch has a few tenths of a millimetre; `preset:
    original` has 0.5, a lever of 0.7 m (docs/explanation/contact_model.md)."""
    rolling_friction: Annotated[float, of.ORIGINAL_SETUP] = _of_core("rolling_friction")
    """Resistance against rolling, a lever as that of spinning [m]; the original leaves it at 0."""
    stiffness: Annotated[float, of.SUPPLEMENT_CONTACT] = _of_core("stiffness")
    """Contact stiffness, per contact point [N/m]."""
    damping: Annotated[float, of.SUPPLEMENT_CONTACT] = _of_core("damping")
    """Contact damping, per contact point [N s/m]."""

    @property
    def values(self) -> _native.ContactValues:
        """As the core takes them."""
        return _native.ContactValues(**self.model_dump())


class Contact(Section):
    """The contact between rock and pedestal, as inputs of each body (supplement S2.1)."""

    rock: Material = Material()
    """The rock's material."""
    pedestal: Material = Material()
    """The pedestal's material."""

    @property
    def pair(self) -> _native.ContactValues:
        """In force between the two (supplement Eq. 1)."""
        return _native.combine(a=self.rock.values, b=self.pedestal.values)


class Settling(Section):
    """Before the motion: the rock is let go and must come to rest."""

    linear_speed: Annotated[Positive, of.CALM] = 1.0e-3
    """At rest when the mass centre is slower than this relative to the pedestal ... [m/s]"""
    angular_speed: Annotated[Positive, of.CALM] = 2.0e-3
    """... and the rock turns slower than this ... [rad/s]"""
    window: Annotated[float, Strict(), Field(gt=0, le=3600), of.CALM] = 0.25
    """... without a break for this long [s]."""
    timeout: Annotated[float, Strict(), Field(gt=0, le=3600), of.SETTLING_TIMEOUT] = 60.0
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
    """How a trial's end is judged; tilt is the angle of the body away from its settled pose."""

    tail: Annotated[float, Strict(), Field(gt=0, le=3600), of.TAIL] = 30.0
    """After the motion the trial runs on until the rock rests, at most this long [s]."""
    rest_linear_speed: Annotated[Positive, of.REST] = 0.02
    """The tail ends when the mass centre is slower than this relative to the pedestal ... [m/s]"""
    rest_angular_speed: Annotated[Positive, of.REST] = 0.05
    """... and the rock turns slower than this ... [rad/s]"""
    rest_window: Annotated[float, Strict(), Field(gt=0, le=3600), of.REST_WINDOW] = 0.5
    """... without a break for this long, and eight times as long while it leans by `rocked_tilt` or
    more, as it may pause at its point of balance: too slow to overturn any more [s]."""
    overturned_tilt: Annotated[float, Strict(), Field(gt=0, lt=3.1416), of.OVERTURNED] = 1.4
    """A tilt from which nothing comes back: the trial may stop [rad]."""
    toppled_tilt: Annotated[float, Strict(), Field(gt=0, lt=3.1416), of.TOPPLED] = 0.35
    """Tilted more than this in the end: it rests on another face and has overturned [rad]."""
    rocked_tilt: Annotated[Positive, of.ROCKED] = 0.01
    """Peak tilt from which a trial counts as rocked [rad]."""
    slid_distance: Annotated[Positive, of.SLID] = 0.005
    """Travel of the rock's foot (its point under the mass centre) relative to the pedestal in the
    end from which it slid [m]."""
    rotated_angle: Annotated[Positive, of.ROTATED] = 0.035
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

    log_every: Annotated[int, Strict(), Field(ge=0), of.LOG] = 10
    """Log the state every so many time steps; 0: no log."""
    log_settling: Flag = False
    """Log the settling before the motion, too."""
    contacts_every: Annotated[int, Strict(), Field(ge=0), of.OFF] = 0
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
                raise inapplicable(key, "has no effect without a log; set output.log_every above 0")
        if self.contacts_every and self.log_every == 0:
            raise inapplicable(
                "contacts_every", "needs the state's log beside it; set output.log_every above 0"
            )
        if self.contact_trials is not None and self.contacts_every == 0:
            raise inapplicable(
                "contact_trials",
                "has no effect without a contact log; set output.contacts_every above 0",
            )
        return self


ORIGINAL: Mapping[str, Mapping[str, Any]] = {
    "engine": {
        "linear_damping": 0.04,
        "angular_damping": 0.04,
        "converged_contacts": False,
        "skip": "none",
    },
    "contact": {
        body: {
            one.name: one.original
            for one in _CONTACT_PARAMETERS.values()
            if one.original != one.usual
        }
        for body in ("rock", "pedestal")
    },
}
"""What `preset: original` puts in place of the defaults."""


def _completed(given: object, values: Mapping[str, Any]) -> object:
    """`given` with `values` where it is silent; as it is where it is no section."""
    if isinstance(given, Section):
        given = given.model_dump(exclude_unset=True)
    if not isinstance(given, Mapping):
        return given
    added = {
        key: _completed(given.get(key, {}), value)
        if isinstance(value, Mapping)
        else given.get(key, value)
        for key, value in values.items()
    }
    return {**given, **added}


class Study(OneLine, Section):
    """Everything `vsr2 run` needs."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._ -]*$", max_length=100)] = "study"
    """Name of the study and of its result folder: letters, digits, `.`, `_`, `-` and blanks."""
    seed: Annotated[int, Strict(), Field(ge=0, lt=MAX_SEED + 1), of.ANY_SEED] = 0
    """Seed of everything random."""
    preset: Literal["physical", "original"] = "physical"
    """What keys that are not given mean. `physical`: the defaults of this page. `original`: the
    same but Bullet's velocity damping (0.04) and the supplement's `spinning_friction` (0.5), which
    are habits of the original system; none given, `engine.mode: parity` takes these."""
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
    effects: Effects = Field(default={})
    """Effects added to the simulation, by name, each with its parameters: `{edge_rounding: {radius:
    0.006}}`; `vsr2 effects list` prints the library (docs/reference/effects.md)."""
    settling: Settling = Settling()
    """The rest before the motion."""
    outcome: Outcome = Outcome()
    """How a trial's end is judged."""
    output: Output = Output()
    """What is written."""

    @classmethod
    def from_dict(cls, mapping: Mapping[str, Any], base: str | PathLike[str] = ".") -> Study:
        """As :func:`vsr2.config.load_study`, of what the file would hold, without line numbers."""
        from vsr2.config.load import study_from_mapping  # which knows the study

        return study_from_mapping(mapping, base)

    def at_time_step(self, step: float) -> Study:
        """The study with a time step [s], and no tolerance that chooses one."""
        return self.model_copy(update={"engine": self.engine.at_time_step(step)})

    @property
    def facts(self) -> Mapping[str, object]:
        """Its name, kinds of rock, motion and engine, and the number of its effects."""
        kinds = {"rock": self.rock.shape, "motion": self.motion.mode, "engine": self.engine.mode}
        return {"name": self.name, **kinds, "effects": len(self.effects) or None}

    @model_validator(mode="before")
    @classmethod
    def _apply_preset(cls, given: object) -> object:
        if not isinstance(given, Mapping):
            return given
        engine = given.get("engine")
        mode = engine.get("mode") if isinstance(engine, Mapping) else getattr(engine, "mode", None)
        preset = given.get("preset", "original" if mode == "parity" else "physical")
        completed = {**given, "preset": preset}
        return _completed(completed, ORIGINAL) if preset == "original" else completed

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.motion.drive == "prescribed" and "mass" in self.pedestal.model_fields_set:
            raise inapplicable(
                "pedestal.mass",
                "has no effect with `motion.drive: prescribed`, where the pedestal moves exactly "
                "as commanded; remove the key, or set `motion.drive: motor`",
            )
        period = shortest_period(self.motion)
        if period is not None and period < MIN_STEPS_A_PERIOD * self.engine.time_step:
            raise ValueError(
                f"the shortest cosine lasts {period:.4g} s, less than {MIN_STEPS_A_PERIOD} time "
                f"steps of {self.engine.time_step:g} s; lower engine.time_step, or the frequency"
            )
        return self
