"""One-link URDF files: collision parts, mass and inertia of a rock.

The model frame M is the link's frame. Lengths of the file times `scale` are metres; the mass stays
as written, and the file's tensor, mass times length squared, is multiplied by `scale` squared.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np

from vsr2.codes import Statement
from vsr2.config.study import InertiaRule
from vsr2.errors import GeometryError
from vsr2.one_line import counted
from vsr2.scene.body import Array, Box, Hull, MassProperties, Triangles
from vsr2.scene.mass import (
    box_inertia,
    box_mass_properties,
    mesh_mass_properties,
    principal_axes,
    principal_mass_properties,
)
from vsr2.scene.mesh import LoadedMesh, Scale, load_mesh
from vsr2.scene.mesh_files import bytes_of
from vsr2.scene.notes import SceneNote
from vsr2.scene.rotation import matrix_from_rpy, quaternion_from_matrix
from vsr2.scene.shapes import box_surface, cylinder_points, hull_surface, join_surfaces

MAX_URDF_BYTES = 1_000_000
"""Greater files are refused unread."""
MAX_COLLISIONS = 200
"""Most shapes of a body; each is a part of its own for the engine."""


@dataclass(frozen=True)
class UrdfConstants:
    """How a URDF's body is built and looked at; chosen by hand.

    Attributes:
        cylinder_sides: of the prism that stands for a cylinder: its sides lie up to 0.12 % inside.
        inertia_ratio: a moment off by more than this factor from the homogeneous solid's is worth a
            note.
    """

    cylinder_sides: int = 64
    inertia_ratio: float = 2.0


URDF = UrdfConstants()


@dataclass(frozen=True, eq=False)
class UrdfModel:
    """What a URDF says about a rock, in its link's frame.

    Attributes:
        parts: collision parts.
        mass: mass properties by the chosen rule.
        surface: the collision geometry as triangles, for figures.
        inertia_from_aabb: the core is to use Bullet's bounding-box inertia.
        source: the file.
        sha256: of the URDF's bytes followed by those of its meshes' hashes.
        notes: approximations and suspicions.
    """

    parts: tuple[Hull | Box, ...]
    mass: MassProperties
    surface: Triangles
    inertia_from_aabb: bool
    source: str
    sha256: str
    notes: tuple[Statement, ...]


@dataclass(frozen=True, eq=False)
class _Collision:
    parts: tuple[Hull | Box, ...]
    surface: Triangles
    rotation: Array
    translation: Array
    mesh: LoadedMesh | None = None
    box: tuple[float, float, float] | None = None


def load_urdf(path: str | Path, scale: float = 1.0, *, inertia: InertiaRule = "file") -> UrdfModel:
    """Read a URDF with one link.

    Collision geometry: `box`; `mesh` (convex hull; one per object of an OBJ); `cylinder` as a
    prism of 64 sides inscribed in it, whose radius falls short by up to 0.12 %. A sphere is
    refused: as a polyhedron it would stand where a sphere rolls.

    Args:
        path: the URDF; meshes lie in its folder or below it, and are named relative to it.
        scale: factor on all lengths.
        inertia: `file`: the `<inertial>` element; a diagonal tensor is taken as it stands along
            the axes of `<inertial><origin rpy>`, another one is diagonalised, closest to these
            axes. `mesh`: homogeneous solid of the only collision element, with the file's mass.
            `aabb`: mass centre and axes of `<inertial><origin>`, moments by Bullet's bounding box.

    Raises:
        GeometryError: missing, too large, not XML, with document type or entities, several links
            or joints, elements missing or not understood, values not finite, no body's inertia;
            names file, element and remedy.
    """
    source = Path(path)
    if not (math.isfinite(scale) and scale > 0):
        raise GeometryError(f"{source}: scale {scale} must be positive and finite")
    data = bytes_of(source, MAX_URDF_BYTES)
    link = _only_link(source, data)
    collisions = _collisions(source, link, scale)
    notes = [note for item in collisions if item.mesh for note in item.mesh.notes]
    if next(link.iter("cylinder"), None) is not None:
        prism = {"file": source.name, "sides": URDF.cylinder_sides}
        notes.append(Statement.of(SceneNote.CYLINDER_AS_PRISM, **prism))
    mass = _inertial(source, link, scale, rule=inertia)
    if inertia == "mesh":
        mass = _solid(source, collisions, mass.mass)
    elif inertia == "aabb":
        mass = _bounding_box(mass, collisions)
    elif len(collisions) == 1 and _is_closed(collisions[0]):
        notes += _compare(source, mass, _solid(source, collisions, mass.mass))
    digest = hashlib.sha256(data)
    for item in collisions:
        if item.mesh:
            digest.update(bytes.fromhex(item.mesh.sha256))
    return UrdfModel(
        parts=tuple(part for item in collisions for part in item.parts),
        mass=mass,
        surface=join_surfaces([item.surface for item in collisions]),
        inertia_from_aabb=inertia == "aabb",
        source=str(source),
        sha256=digest.hexdigest(),
        notes=tuple(notes),
    )


def _only_link(path: Path, data: bytes) -> ElementTree.Element:
    try:
        # Other encodings could hide the words searched for below.
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise GeometryError(f"{path}: not UTF-8 text; save the URDF as UTF-8") from error
    upper = text.upper()
    for word in ("<!DOCTYPE", "<!ENTITY"):
        if word in upper:
            raise GeometryError(
                f"{path}: {word} is refused (entities can make a small file huge); remove it"
            )
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise GeometryError(f"{path}: not valid XML ({error}); correct the file") from error
    if root.tag != "robot":
        raise GeometryError(
            f"{path}: the outermost element is <{_brief(root.tag)}>, not <robot>; a URDF is needed "
            "(for xacro, run xacro first)"
        )
    links = root.findall("link")
    joints = root.findall("joint")
    if len(links) != 1 or joints:
        raise GeometryError(
            f"{path}: {counted(len(links), 'link')} and {counted(len(joints), 'joint')}; a rock is "
            "one rigid body: put all <collision> elements into one <link> and remove the joints"
        )
    return links[0]


def _brief(text: str) -> str:
    return text if len(text) <= 60 else text[:57] + "..."


def _numbers(
    path: Path, element: ElementTree.Element, name: str, count: int, default: str | None = None
) -> list[float]:
    text = element.get(name, default)
    where = f"<{_brief(element.tag)} {name}>"
    if text is None:
        raise GeometryError(f"{path}: {where} is missing")
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not all(abs(value) < 1e30 for value in values):
        raise GeometryError(
            f"{path}: {where} is {_brief(text)!r}; {count} finite number(s) are needed"
        )
    return values


def _positive(path: Path, element: ElementTree.Element, name: str, count: int) -> list[float]:
    values = _numbers(path, element, name, count)
    if min(values) <= 0:
        raise GeometryError(f"{path}: <{element.tag} {name}> is {values}; it must be positive")
    return values


def _origin(path: Path, parent: ElementTree.Element, scale: float) -> tuple[Array, Array]:
    """Rotation (3, 3) and translation (3,) [m] of an element's <origin>."""
    origin = parent.find("origin")
    if origin is None:
        return np.eye(3), np.zeros(3)
    translation = np.array(_numbers(path, origin, "xyz", 3, "0 0 0")) * scale
    return matrix_from_rpy(*_numbers(path, origin, "rpy", 3, "0 0 0")), translation


def _collisions(path: Path, link: ElementTree.Element, scale: float) -> list[_Collision]:
    elements = link.findall("collision")
    if not elements:
        raise GeometryError(
            f"{path}: no <collision> in the link; <visual> alone does not collide, copy its "
            "geometry"
        )
    if len(elements) > MAX_COLLISIONS:
        raise GeometryError(
            f"{path}: {len(elements)} <collision> elements; at most {MAX_COLLISIONS} are taken"
        )
    meshes = _Meshes()
    return [_collision(path, element, scale, meshes) for element in elements]


class _Meshes:
    """Meshes of one URDF: each is read once at a scale, and moved once to a pose."""

    def __init__(self) -> None:
        self._read: dict[tuple[Path, Scale], LoadedMesh] = {}
        self._moved: dict[tuple[object, ...], tuple[tuple[Hull, ...], Triangles]] = {}

    def read(self, file: Path, scale: Scale) -> LoadedMesh:
        """The mesh of a file, however often and by whichever path it is named."""
        key = file.resolve(), scale
        if key not in self._read:
            self._read[key] = load_mesh(file, scale=scale, closed=False)
        return self._read[key]

    def collision(self, mesh: LoadedMesh, rotation: Array, translation: Array) -> _Collision:
        """A mesh at a pose; copies of a file share their hulls, which are then thinned once."""
        kind = Path(mesh.source).suffix
        pose = rotation.tobytes(), translation.tobytes()
        key = (mesh.sha256, kind, mesh.scale, *pose)
        if key not in self._moved:
            surface = mesh.surface
            hulls = tuple(Hull(_moved(one, rotation, translation)) for one in mesh.hull_points)
            vertices = _moved(surface.vertices, rotation, translation)
            self._moved[key] = hulls, Triangles(vertices, surface.faces)
        hulls, surface = self._moved[key]
        return _Collision(hulls, surface, rotation, translation, mesh=mesh)


def _collision(
    path: Path, element: ElementTree.Element, scale: float, meshes: _Meshes
) -> _Collision:
    rotation, translation = _origin(path, element, scale)
    shapes = [child for geometry in element.findall("geometry") for child in geometry]
    if len(shapes) != 1:
        raise GeometryError(
            f"{path}: <collision> with {counted(len(shapes), 'shape')} in <geometry>; it takes "
            "exactly one"
        )
    shape = shapes[0]
    if shape.tag == "box":
        x, y, z = (edge * scale for edge in _positive(path, shape, "size", 3))
        box = Box(
            size=(x, y, z),
            center=(float(translation[0]), float(translation[1]), float(translation[2])),
            orientation=quaternion_from_matrix(rotation),
        )
        return _Collision((box,), box_surface(box), rotation, translation, box=(x, y, z))
    if shape.tag == "cylinder":
        radius = _positive(path, shape, "radius", 1)[0] * scale
        length = _positive(path, shape, "length", 1)[0] * scale
        points = _moved(cylinder_points(radius, length, URDF.cylinder_sides), rotation, translation)
        return _Collision((Hull(points),), hull_surface(points), rotation, translation)
    if shape.tag == "mesh":
        return meshes.collision(_mesh(path, shape, scale, meshes), rotation, translation)
    raise GeometryError(
        f"{path}: <geometry> with <{_brief(shape.tag)}>; rocks collide as box, cylinder or mesh"
        + ("; give the ball as a mesh if its facets do not matter" if shape.tag == "sphere" else "")
    )


def _mesh(path: Path, shape: ElementTree.Element, scale: float, meshes: _Meshes) -> LoadedMesh:
    """The mesh that an element names."""
    name = shape.get("filename", "")
    if name.startswith("file://"):
        name = unquote(name.removeprefix("file://"))
    if not name or "://" in name:
        raise GeometryError(
            f"{path}: <mesh filename> is {_brief(name)!r}; give a path relative to the URDF's "
            "folder (there are no ROS packages here)"
        )
    factors = [factor * scale for factor in _numbers(path, shape, "scale", 3, "1 1 1")]
    if min(factors) <= 0:
        raise GeometryError(
            f"{path}: <mesh scale> gives the factors {factors}; they must be positive (mirror the "
            "mesh in an editor)"
        )
    factor = factors[0] if factors[0] == factors[1] == factors[2] else tuple(factors)
    return meshes.read(_inside(path, name), cast(Scale, factor))


def _inside(path: Path, name: str) -> Path:
    """The path of a mesh, which has to lie in the URDF's folder or below it."""
    folder = path.parent
    target = folder / name
    try:
        inside = target.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):
        inside = False
    if not inside:
        raise GeometryError(
            f"{path}: <mesh filename> {_brief(name)!r} leads out of the URDF's folder; copy the "
            "mesh into it, and name it relative to it"
        )
    return target


def _moved(points: Array, rotation: Array, translation: Array) -> Array:
    # Without a transform the points must keep every bit, for the parity with the original.
    if not translation.any() and np.array_equal(rotation, np.eye(3)):
        return points
    moved: Array = points @ rotation.T + translation
    return moved


def _inertial(
    path: Path, link: ElementTree.Element, scale: float, rule: InertiaRule
) -> MassProperties:
    inertial = link.find("inertial")
    element = None if inertial is None else inertial.find("mass")
    if inertial is None or element is None:
        raise GeometryError(
            f"{path}: <inertial> with <mass> is missing; add it, or use a mesh rock with `density`"
        )
    mass = _positive(path, element, "value", 1)[0]
    rotation, translation = _origin(path, inertial, scale)
    if rule != "file":
        # The moments are replaced later: by the mesh's, or by Bullet's bounding box in the core.
        return MassProperties(mass, translation, np.full(3, np.nan), rotation)
    element = inertial.find("inertia")
    if element is None:
        raise GeometryError(
            f"{path}: <inertial> has no <inertia>; add it, or choose `inertia: mesh`"
        )
    xx, xy, xz, yy, yz, zz = (
        _numbers(path, element, name, 1, None if name in ("ixx", "iyy", "izz") else "0")[0]
        for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) * scale**2
    moments, axes = principal_axes(tensor, f"{path}: <inertia>")
    return MassProperties(mass, translation, moments, rotation @ axes)


def _is_closed(item: _Collision) -> bool:
    if item.mesh is None:
        return True
    try:
        load_mesh(item.mesh.source, scale=item.mesh.scale)
    except GeometryError:
        return False
    return True


def _solid(path: Path, collisions: list[_Collision], mass: float) -> MassProperties:
    """Homogeneous solid of the only collision element."""
    import trimesh

    if len(collisions) > 1:
        raise GeometryError(
            f"{path}: `inertia: mesh` with {len(collisions)} <collision> elements, which may "
            "overlap; use `inertia: file`, or one closed mesh"
        )
    item = collisions[0]
    if item.box is not None:
        own = box_mass_properties(item.box, mass=mass, source=str(path))
    elif item.mesh is not None:
        closed = load_mesh(item.mesh.source, scale=item.mesh.scale)
        own = mesh_mass_properties(closed.mesh, mass=mass, source=str(path))
    else:
        hull = trimesh.Trimesh(item.surface.vertices, item.surface.faces, process=False)
        return mesh_mass_properties(hull, mass=mass, source=str(path))
    axes = item.rotation @ own.principal_axes
    return principal_mass_properties(
        mass,
        _moved(own.mass_center[None, :], item.rotation, item.translation)[0],
        axes @ np.diag(own.principal_inertia) @ axes.T,
        str(path),
    )


def _bounding_box(mass: MassProperties, collisions: list[_Collision]) -> MassProperties:
    """Moments of the bounding box along the inertial axes, without the core's margins."""
    points = np.vstack([item.surface.vertices for item in collisions])
    size = np.ptp(points @ mass.principal_axes, axis=0)
    return replace(mass, principal_inertia=box_inertia(mass.mass, size))


def _compare(path: Path, mass: MassProperties, solid: MassProperties) -> list[Statement]:
    """Say where the file's inertia cannot be that of the rock's own shape."""
    expected = np.sort(solid.principal_inertia)
    ratio = np.sort(mass.principal_inertia) / expected
    notes = []
    if ratio.max() > URDF.inertia_ratio or ratio.min() < 1.0 / URDF.inertia_ratio:
        values = {"moments": mass.principal_inertia, "ratios": ratio, "solid": expected}
        lists = {name: tuple(found.tolist()) for name, found in values.items()}
        notes.append(Statement.of(SceneNote.UNUSUAL_INERTIA, file=path.name, **lists))
    distance = float(np.linalg.norm(mass.mass_center - solid.mass_center))
    size = float(np.linalg.norm(np.sqrt(solid.principal_inertia / solid.mass)))
    if distance > 0.5 * size:
        notes.append(Statement.of(SceneNote.DISTANT_MASS_CENTER, file=path.name, distance=distance))
    return notes
