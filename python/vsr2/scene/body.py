"""Bodies as the native core needs them: collision points, mass properties, frames."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vsr2.codes import Statement
from vsr2.one_line import OneLine
from vsr2.read_only import ReadOnlyArrays, read_only
from vsr2.scene.field_values import (
    check_kinds,
    keep_array,
    keep_indices,
    keep_number,
    keep_numbers,
    keep_tuples,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pose:
    """A rigid transform: `position` (3,) [m], `orientation` quaternion x, y, z, w (4,), unit.

    Raises:
        GeometryError: a field is not so many real numbers.
    """

    position: tuple[float, float, float]
    orientation: tuple[float, float, float, float]

    def __post_init__(self) -> None:
        keep_numbers(self, position=3, orientation=4)


@dataclass(frozen=True, eq=False, repr=False)
class MassProperties(ReadOnlyArrays, OneLine):
    """Mass properties of a rigid body; its arrays are read-only.

    Attributes:
        mass: [kg].
        mass_center: in the model frame M, shape (3,) [m].
        principal_inertia: about the mass centre along the principal axes, shape (3,) [kg m^2].
        principal_axes: R_MB, columns are the principal axes in M (right-handed), shape (3, 3).

    Raises:
        GeometryError: an array of another shape, with a mask, or of something else than real
            numbers.
    """

    mass: float
    mass_center: Array
    principal_inertia: Array
    principal_axes: Array

    def __post_init__(self) -> None:
        keep_number(self, "mass")
        keep_array(self, "mass_center", (3,))
        keep_array(self, "principal_inertia", (3,))
        keep_array(self, "principal_axes", (3, 3))
        super().__post_init__()

    @property
    def facts(self) -> Mapping[str, object]:
        """What the notation in one line shows."""
        return {
            "mass_kg": float(self.mass),
            "mass_center_m": [float(f"{one:.6g}") for one in self.mass_center],
            "principal_inertia_kg_m2": [float(f"{one:.6g}") for one in self.principal_inertia],
        }


@dataclass(frozen=True, eq=False)
class Hull(ReadOnlyArrays):
    """One convex collision part: points in the model frame, shape (k, 3) [m], read-only."""

    points: Array

    def __post_init__(self) -> None:
        keep_array(self, "points", (None, 3))
        super().__post_init__()

    @cached_property
    def distinct(self) -> Array:
        """The points, each once, shape (j, 3) [m]: a mesh lists a vertex with every face."""
        return read_only(np.unique(self.points, axis=0))


@dataclass(frozen=True)
class Box:
    """One box collision part.

    Attributes:
        size: edge lengths [m].
        center: of the box in the body's frame [m].
        orientation: rotation of the box's axes in that frame, quaternion x, y, z, w.

    Raises:
        GeometryError: a field is not so many real numbers.
    """

    size: tuple[float, float, float]
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    orientation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        keep_numbers(self, size=3, center=3, orientation=4)


@dataclass(frozen=True, eq=False)
class Triangles(ReadOnlyArrays):
    """An exact surface: vertices (n, 3) [m], triangles (m, 3) of vertex indices; read-only."""

    vertices: Array
    faces: NDArray[np.int32]

    def __post_init__(self) -> None:
        keep_array(self, "vertices", (None, 3))
        keep_indices(self, "faces", 3)
        super().__post_init__()


@dataclass(frozen=True, eq=False)
class RockBody:
    """The rock: collision parts in the model frame M, mass properties, start pose X_WM.

    `inertia_from_aabb` asks the core for Bullet's bounding-box inertia (the original's rule); then
    `mass.principal_inertia` is not used and `mass.mass_center` is the model origin.

    Raises:
        GeometryError: a field of another type, or a part that is none.
    """

    parts: tuple[Hull | Box, ...]
    mass: MassProperties
    start: Pose
    inertia_from_aabb: bool = False
    surface: Triangles | None = None
    """The mesh for figures and replay; not used by the physics."""
    source: str = ""
    sha256: str = ""
    notes: tuple[Statement, ...] = field(default=())
    """What a repair changed, or other things the user should know, as `SceneNote`."""

    def __post_init__(self) -> None:
        keep_tuples(self, parts=Hull | Box, notes=Statement)
        check_kinds(
            self,
            mass=MassProperties,
            start=Pose,
            inertia_from_aabb=bool,
            surface=Triangles | None,
            source=str,
            sha256=str,
        )


@dataclass(frozen=True)
class PitchSpring:
    """The pedestal's pitch axis as a sprung and damped joint, on which the rock pushes back.

    pitch'' + 2 damping w pitch' + w^2 pitch = -w^2 compliance a + M / inertia, with a the
    acceleration along x and M the moment about the axis of all that the rock exerts on the
    pedestal. docs/explanation/mechanisms.md; `cpp/include/vsr2/pitch_spring.hpp` is the definition.

    Attributes:
        frequency: without a rock and damping, w / (2 pi) [Hz].
        damping: damping ratio [1].
        compliance: lean against a constant acceleration [rad / (m/s^2)].
        inertia: of the pedestal about the axis [kg m^2]; infinite: the rock does not push back.

    Raises:
        GeometryError: a field is no real number.
    """

    frequency: float
    damping: float
    compliance: float
    inertia: float = math.inf

    def __post_init__(self) -> None:
        keep_number(self, "frequency", "damping", "compliance", "inertia")


@dataclass(frozen=True, eq=False)
class PedestalBody:
    """The pedestal: collision parts in the pedestal frame P, whose origin starts at `origin`.

    Attributes:
        parts: hulls, boxes or one exact surface.
        origin: start of P in the world, shape (3,) [m].
        top: greatest z of the pedestal in the world at the start [m].
        mass: carried by the prismatic joint [kg].
        base_size: edge lengths of the static base, which stands on z = 0 [m].
        pitch_pivot: height in the world, at the start, of the axis about which a motion's pitch
            turns the pedestal, and of a sprung joint [m]; None: its top.
        pitch_spring: of a pedestal that pitches by itself; None: it follows the motion's pitch.
        slope: rotation from level by which the pedestal was turned, quaternion x, y, z, w. Bodies
            on it stand level in that frame; for statics, the parts are turned already.

    Raises:
        GeometryError: a field of another type, or a part that is none.
    """

    parts: tuple[Hull | Box | Triangles, ...]
    origin: tuple[float, float, float]
    top: float
    mass: float
    base_size: tuple[float, float, float]
    source: str = ""
    sha256: str = ""
    surface: Triangles | None = None
    pitch_pivot: float | None = None
    pitch_spring: PitchSpring | None = None
    slope: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        keep_tuples(self, parts=Hull | Box | Triangles)
        keep_numbers(self, origin=3, base_size=3, slope=4)
        keep_number(self, "top", "mass", *(["pitch_pivot"] if self.pitch_pivot is not None else []))
        check_kinds(
            self,
            source=str,
            sha256=str,
            surface=Triangles | None,
            pitch_spring=PitchSpring | None,
        )
