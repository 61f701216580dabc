"""The scene: a rock on a pedestal with the engine's settings, as a value."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Mapping
from dataclasses import astuple, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import assert_never

import numpy as np

from vsr2.argument_names import checked_names
from vsr2.config.problems import shown
from vsr2.config.study import Contact, Engine, MeshPedestal, MeshRock, Study, UrdfRock
from vsr2.errors import GeometryError
from vsr2.one_line import OneLine
from vsr2.scene.body import Box, Hull, PedestalBody, Pose, RockBody, Triangles
from vsr2.scene.build import build_pedestal, build_rock, contact_notes
from vsr2.scene.field_values import check_kinds
from vsr2.scene.mechanisms import Mechanisms
from vsr2.scene.mesh import Mesh, mesh_from_arrays
from vsr2.scene.notes import WARNINGS, SceneWarning
from vsr2.scene.rotation import (
    IDENTITY,
    matrix_from_quaternion,
    multiply,
    quaternion_from_matrix,
)


@checked_names(GeometryError)
@dataclass(frozen=True, eq=False, repr=False)
class Scene(OneLine):
    """A rock on a pedestal with its engine settings.

    It is a description: it can be copied, pickled and sent to another machine, and its arrays are
    read-only. The native core's own scene is built from it where trials are run. Scenes are equal
    where content and start pose are; names and sources do not count.

    Attributes:
        rock, pedestal: the bodies; `rock.start` is where trials begin that name no start.
        engine: settings of the engine.
        contact: materials of the two.
        mechanisms: mechanics beyond rigid bodies with Coulomb friction.

    Raises:
        GeometryError: a field of another type.
    """

    rock: RockBody
    pedestal: PedestalBody
    engine: Engine
    contact: Contact
    mechanisms: Mechanisms = field(default_factory=Mechanisms)

    def __post_init__(self) -> None:
        check_kinds(
            self,
            rock=RockBody,
            pedestal=PedestalBody,
            engine=Engine,
            contact=Contact,
            mechanisms=Mechanisms,
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Scene):
            return NotImplemented
        return (self.sha256, self.rock.start) == (other.sha256, other.rock.start)

    def __hash__(self) -> int:
        return hash(self.sha256)

    @property
    def facts(self) -> Mapping[str, object]:
        """The bodies by their files, the mass [kg], and the engine that was asked for."""
        return {
            "rock": Path(self.rock.source).name,
            "mass": self.rock.mass.mass,
            "pedestal": Path(self.pedestal.source).name,
            "engine": self.engine.mode,
        }

    @cached_property
    def sha256(self) -> str:
        """Hash of everything the physics depends on, the start pose aside."""
        digest = hashlib.sha256()
        for section in (self.engine, self.contact):
            digest.update(section.model_dump_json().encode())
        rock, pedestal, mass = self.rock, self.pedestal, self.rock.mass
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
        for body in (rock, pedestal):
            # Counts come first, so that no part can be taken for another body's, or another part.
            digest.update(f"{len(body.parts)} parts".encode())
            for part in body.parts:
                match part:
                    case Hull():
                        digest.update(f"hull {len(part.points)}".encode() + part.points.tobytes())
                    case Box():
                        pose = (*part.size, *part.center, *part.orientation)
                        digest.update(b"box" + np.asarray(pose, dtype=np.float64).tobytes())
                    case Triangles():
                        counts = f"triangles {len(part.vertices)} {len(part.faces)}"
                        digest.update(counts.encode() + part.vertices.tobytes())
                        digest.update(part.faces.tobytes())
                    case _:
                        assert_never(part)
        # What is not used adds nothing, so that it does not tell scenes apart.
        digest.update(self.mechanisms.key.encode())
        if pedestal.slope != IDENTITY:
            digest.update(b"slope" + np.asarray(pedestal.slope, dtype=np.float64).tobytes())
        if pedestal.pitch_pivot is not None:
            digest.update(b"pivot" + np.float64(pedestal.pitch_pivot).tobytes())
        if pedestal.pitch_spring is not None:
            digest.update(b"spring" + np.array(astuple(pedestal.pitch_spring)).tobytes())
        return digest.hexdigest()

    @cached_property
    def body_frame(self) -> Pose:
        """X_MB: the body frame (mass centre, principal axes) in the model frame."""
        x, y, z = (float(value) for value in self.rock.mass.mass_center)
        return Pose((x, y, z), quaternion_from_matrix(self.rock.mass.principal_axes))

    @property
    def pitches(self) -> bool:
        """Whether the pedestal pitches on a spring, whatever the motion."""
        return self.pedestal.pitch_spring is not None

    @property
    def pitch_pivot(self) -> float:
        """Height in the world, at the start, of the pedestal's pitch axis [m]."""
        pivot = self.pedestal.pitch_pivot
        return self.pedestal.top if pivot is None else pivot

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


@checked_names(GeometryError)
def build_scene(study: Study, *, rock: Mesh = None, pedestal: Mesh = None) -> Scene:
    """The scene of a study: reads its meshes and places the rock.

    Args:
        study: what is not given here comes from it: of the rock density or mass, start, scale,
            repair; of a pedestal mesh collision, scale, mass and base.
        rock: a trimesh.Trimesh, or vertices (n, 3) [m] and triangles (m, 3), in place of the rock's
            box or mesh.
        pedestal: the same in place of the pedestal's prism or mesh.

    Raises:
        GeometryError: a mesh, URDF or start pose that cannot be used, or a rock larger than its
            prism.

    Warns:
        SceneWarning: the rock's size is unusual, it sinks into a soft contact, or its impacts may
            gain energy.
    """
    if not isinstance(study, Study):
        raise GeometryError(
            f"build_scene: got {shown(study)}, a {type(study).__name__}; give a Study, as "
            "`load_study` reads it from a file"
        )
    under = _pedestal(study, pedestal)
    body = _rock(study, rock, under)
    notes = contact_notes(body, study.contact, study.engine)
    body = replace(body, notes=(*body.notes, *notes))
    for note in body.notes:
        if note.code in WARNINGS:
            text = WARNINGS[note.code].format(**note.values)
            warnings.warn(text, SceneWarning, stacklevel=2)
    return Scene(body, under, study.engine, study.contact)


def _pedestal(study: Study, mesh: Mesh) -> PedestalBody:
    own = study.pedestal
    if mesh is None:
        return build_pedestal(own)
    if not isinstance(own, MeshPedestal):
        own = MeshPedestal(shape="mesh", file=Path("pedestal"), mass=own.mass, base=own.base)
    closed = own.collision == "decomposition"
    loaded = mesh_from_arrays(mesh, scale=own.scale, closed=closed, name="pedestal")
    return build_pedestal(own, mesh=loaded)


def _rock(study: Study, mesh: Mesh, pedestal: PedestalBody) -> RockBody:
    own, clearance = study.rock, 2.0 * study.engine.collision_margin
    if mesh is None:
        return build_rock(own, pedestal, clearance=clearance)
    if isinstance(own, UrdfRock):
        raise GeometryError(
            f"study {study.name!r}: its rock is a URDF, which has a mass and inertia of its own; "
            "give `rock.shape: mesh` or `box` with a density beside a mesh in memory"
        )
    if not isinstance(own, MeshRock):
        own = MeshRock(
            shape="mesh", file=Path("rock"), density=own.density, mass=own.mass, start=own.start
        )
    loaded = mesh_from_arrays(mesh, scale=own.scale, repair=own.repair, name="rock")
    return build_rock(own, pedestal, clearance=clearance, mesh=loaded)
