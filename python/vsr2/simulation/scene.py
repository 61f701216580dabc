"""The scene: the study's bodies and engine settings, made ready for the native core."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2 import _native
from vsr2.config.study import Contact, Engine, Material, Study
from vsr2.errors import SimulationError
from vsr2.scene import (
    Box,
    Hull,
    Mechanisms,
    PedestalBody,
    Pose,
    RockBody,
    Triangles,
    build_pedestal,
    build_rock,
)
from vsr2.scene.rotation import (
    matrix_from_quaternion,
    multiply,
    quaternion_from_matrix,
)


@dataclass(frozen=True, eq=False)
class Scene:
    """A rock on a pedestal with its engine settings; immutable and shared by trials and threads.

    Attributes:
        rock, pedestal: the bodies.
        engine, contact: settings they were built with.
        native: the core's scene, with its collision shapes.
        mechanisms: mechanics beyond rigid bodies with Coulomb friction.
    """

    rock: RockBody
    pedestal: PedestalBody
    engine: Engine
    contact: Contact
    native: _native.Scene
    mechanisms: Mechanisms = field(default_factory=Mechanisms)

    @property
    def engine_name(self) -> str:
        """Engine that runs the scene: parity, exact or fast."""
        return str(self.native.engine)

    @property
    def rock_inertia(self) -> NDArray[np.float64]:
        """Principal inertia the engine uses, shape (3,) [kg m^2]."""
        return np.asarray(self.native.rock_inertia)

    @property
    def rock_hull_vertices(self) -> NDArray[np.float64]:
        """Vertices of the reduced collision hull in the body frame B, shape (k, 3) [m]."""
        return np.asarray(self.native.rock_hull_vertices)

    @cached_property
    def sha256(self) -> str:
        """Hash of everything the physics depends on, the start pose aside."""
        return scene_sha256(self.rock, self.pedestal, self.engine, self.contact, self.mechanisms)

    @cached_property
    def body_frame(self) -> Pose:
        """X_MB: the body frame (mass centre, principal axes) in the model frame."""
        return _body_frame(self.rock)

    @property
    def pitches(self) -> bool:
        """Whether the pedestal pitches on a spring, whatever the motion."""
        return self.pedestal.pitch_spring is not None

    @property
    def pitch_pivot(self) -> float:
        """Height in the world, at the start, of the pedestal's pitch axis [m]."""
        return _pitch_pivot(self.pedestal)

    @property
    def pedestal_surface(self) -> Triangles | None:
        """The pedestal's display mesh in the world, at its start."""
        surface = self.pedestal.surface
        if surface is None:
            return None
        return Triangles(surface.vertices + np.asarray(self.pedestal.origin), surface.faces)

    def body_pose(self, start: Pose) -> Pose:
        """X_WB of a model-frame pose X_WM."""
        frame = self.body_frame
        rotation = matrix_from_quaternion(start.orientation)
        center = rotation @ np.asarray(frame.position) + np.asarray(start.position)
        x, y, z = (float(value) for value in center)
        return Pose((x, y, z), multiply(start.orientation, frame.orientation))


def scene_sha256(
    rock: RockBody, pedestal: PedestalBody, engine: Engine, contact: Contact, mechanisms: Mechanisms
) -> str:
    """Hash of everything the physics depends on, the start pose aside."""
    digest = hashlib.sha256()
    for section in (engine, contact):
        digest.update(section.model_dump_json().encode())
    mass = rock.mass
    for values in (
        [mass.mass, float(rock.inertia_from_aabb)],
        mass.mass_center,
        mass.principal_inertia,
        mass.principal_axes,
        pedestal.origin,
        [pedestal.top, pedestal.mass],
        pedestal.base_size,
    ):
        digest.update(np.asarray(values, dtype=np.float64).tobytes())
    for part in (*rock.parts, *pedestal.parts):
        match part:
            case Hull():
                digest.update(b"hull" + part.points.tobytes())
            case Box():
                pose = (*part.size, *part.center, *part.orientation)
                digest.update(b"box" + np.asarray(pose, dtype=np.float64).tobytes())
            case Triangles():
                digest.update(b"triangles" + part.vertices.tobytes() + part.faces.tobytes())
    # What is not used adds nothing: hashes of scenes without it stay as they are.
    digest.update(mechanisms.key.encode())
    if pedestal.pitch_pivot is not None:
        digest.update(b"pivot" + np.float64(pedestal.pitch_pivot).tobytes())
    if pedestal.pitch_spring is not None:
        digest.update(b"spring" + np.array(astuple(pedestal.pitch_spring)).tobytes())
    return digest.hexdigest()


def _body_frame(rock: RockBody) -> Pose:
    x, y, z = (float(value) for value in rock.mass.mass_center)
    return Pose((x, y, z), quaternion_from_matrix(rock.mass.principal_axes))


def _pitch_pivot(pedestal: PedestalBody) -> float:
    return pedestal.top if pedestal.pitch_pivot is None else pedestal.pitch_pivot


def _native_material(material: Material) -> _native.Material:
    return _native.Material(**material.model_dump())


def _native_parts(parts: Sequence[Hull | Box | Triangles]) -> list[Any]:
    out: list[Any] = []
    for part in parts:
        match part:
            case Hull():
                out.append(_native.HullPart(part.points))
            case Box():
                out.append(_native.BoxPart(part.size, part.center, part.orientation))
            case Triangles():
                out.append(_native.TrianglesPart(part.vertices, part.faces))
    return out


def _native_engine(engine: Engine) -> _native.EngineSettings:
    values = engine.model_dump(
        exclude={"mode", "split_impulse", "split_impulse_penetration_threshold"}
    )
    # Bullet's own default damping is the single-precision 0.04; parity needs its bits.
    for key in ("linear_damping", "angular_damping"):
        values[key] = float(np.float32(values[key]))
    return _native.EngineSettings(kind=getattr(_native.EngineKind, engine.mode), **values)


def make_scene(
    rock: RockBody,
    pedestal: PedestalBody,
    engine: Engine,
    contact: Contact,
    mechanisms: Mechanisms | None = None,
) -> Scene:
    """The scene of given bodies.

    Args:
        rock: body to be shaken.
        pedestal: body that it stands on.
        engine: settings of the engine.
        contact: materials of the two.
        mechanisms: mechanics beyond rigid bodies with Coulomb friction; None: none.

    Raises:
        SimulationError: values that no engine can use.
    """
    frame = _body_frame(rock)
    mechanisms = mechanisms or Mechanisms()
    spring = pedestal.pitch_spring
    try:
        native = _native.Scene(
            engine=_native_engine(engine),
            pedestal=_native.PedestalSpec(
                parts=_native_parts(pedestal.parts),
                origin=pedestal.origin,
                mass=pedestal.mass,
                base_size=pedestal.base_size,
                top=pedestal.top,
                material=_native_material(contact.pedestal),
                pitch_pivot=_pitch_pivot(pedestal),
                pitch_spring=None if spring is None else _native.PitchSpring(**asdict(spring)),
            ),
            rock=_native.RockSpec(
                parts=_native_parts(rock.parts),
                mass=rock.mass.mass,
                principal_inertia=rock.mass.principal_inertia,
                inertia_from_aabb=rock.inertia_from_aabb,
                mass_center=frame.position,
                principal_axes=frame.orientation,
                material=_native_material(contact.rock),
            ),
            mechanisms=_native.Mechanisms(**asdict(mechanisms)),
        )
        if engine.mode == "fast" and native.fast_domain_violation:
            raise SimulationError(
                f"engine.mode: fast does not take this scene: {native.fast_domain_violation}; "
                "choose auto or exact"
            )
    except _native.InvalidInput as error:
        raise SimulationError(f"{rock.source or 'scene'}: {error}") from error
    return Scene(rock, pedestal, engine, contact, native, mechanisms)


_logger = logging.getLogger(__name__)


def build_scene(study: Study) -> Scene:
    """The scene of a study: reads its meshes and places the rock.

    Raises:
        GeometryError: a mesh, URDF or start pose that cannot be used.
        SimulationError: values that no engine can use.
    """
    pedestal = build_pedestal(study.pedestal)
    rock = build_rock(study.rock, pedestal, clearance=2.0 * study.engine.collision_margin)
    _logger.debug("bodies of a scene built: %s on %s", rock.source, pedestal.source)
    return make_scene(rock, pedestal, study.engine, study.contact)
