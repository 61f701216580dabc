"""Static stability: stable poses, support polygon, slenderness angles, frequency parameter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vsr2.config.study import Engine
from vsr2.errors import GeometryError
from vsr2.one_line import counted
from vsr2.scene.body import Array, MassProperties, RockBody
from vsr2.scene.mass import box_inertia, mesh_mass_properties
from vsr2.scene.mesh import load_mesh
from vsr2.scene.mesh_repair import REPAIR, signed_volume
from vsr2.scene.rotation import (
    IDENTITY,
    Quaternion,
    matrix_from_quaternion,
    normalized,
    quaternion_from_matrix,
)
from vsr2.scene.shapes import hull_surface, rock_points
from vsr2.scene.urdf import URDF, load_urdf


@dataclass(frozen=True)
class StabilityConstants:
    """What a report of a body's mass and stability rests on; chosen by hand, but the density.

    Attributes:
        gravity: that of a study [m/s^2].
        support: points less than this share of the mass centre's height above the lowest one give
            support: a scan's base is uneven by some millimetres.
        granite_density: assumed where neither density nor mass is given [kg/m^3]; granites have
            about 2600 to 2800.
        azimuths: directions of a report, anticlockwise from x [degree].
        rare: stable poses of at most this probability are left out.
    """

    gravity: float = Engine().gravity
    support: float = 0.01
    granite_density: float = 2700.0
    azimuths: tuple[float, ...] = tuple(float(azimuth) for azimuth in range(0, 360, 15))
    rare: float = 0.005


STABILITY = StabilityConstants()


def stability_constants(**given: Any) -> dict[str, dict[str, Any]]:
    """Tuned numbers that a report rests on, by what they are of.

    Args:
        given: what was asked for in place of some of :class:`StabilityConstants`.
    """
    stability = asdict(STABILITY) | given
    return {"stability": stability, "mesh_repair": asdict(REPAIR), "urdf": asdict(URDF)}


@dataclass(frozen=True)
class StablePose:
    """A pose in which a body rests on a plane.

    Attributes:
        orientation: rotation of the model frame, quaternion x, y, z, w.
        probability: that it comes to rest so after a quasi-static drop at random orientation.
        height: of the mass centre above the plane [m].
        min_slenderness: smallest slenderness angle over all azimuths [rad].
        weakest_azimuth: where it is, anticlockwise from x in this orientation [degree].
    """

    orientation: Quaternion
    probability: float
    height: float
    min_slenderness: float
    weakest_azimuth: float


@dataclass(frozen=True)
class Slenderness:
    """Rocking geometry of a body in one direction.

    Attributes:
        azimuth: direction of the tilt, anticlockwise from x in the world [degree].
        alpha: slenderness angle: tan alpha = distance / h [rad]. A static acceleration g tan alpha
            along the azimuth begins to tip the body.
        distance: from the mass centre's projection to the support polygon's edge, along the
            azimuth [m].
        radius: R, distance of the mass centre from the rocking edge [m].
        frequency_parameter: p = sqrt(m g R / I_O) [rad/s], I_O about the rocking edge.
    """

    azimuth: float
    alpha: float
    distance: float
    radius: float
    frequency_parameter: float


@dataclass(frozen=True, eq=False)
class Support:
    """What a body stands on in a given orientation.

    Attributes:
        polygon: convex hull in plan of the supporting points relative to the mass centre, in
            anticlockwise order, shape (k, 2) [m].
        height: h, of the mass centre above the lowest point [m].
        margin: distance of the mass centre's projection from the nearest edge, negative where it
            lies outside and the body cannot stand so [m].
        tolerance: points up to this high above the lowest one were counted [m].
    """

    polygon: Array
    height: float
    margin: float
    tolerance: float


def stable_poses(
    mesh: object, *, mass_center: Array | None = None, threshold: float = STABILITY.rare
) -> list[StablePose]:
    """Poses in which a body rests on a horizontal plane, most probable first.

    Probabilities by trimesh: the share of directions, seen from the mass centre, of the hull faces
    from which the body tips, face by face, into the pose (Goldberg et al., Part pose statistics,
    1999).

    Args:
        mesh: trimesh mesh [m].
        mass_center: in the mesh's frame, shape (3,) [m]; none: of the homogeneous solid.
        threshold: poses of at most this probability are left out.

    Raises:
        GeometryError: no solid hull, or the mass centre does not lie inside it.
    """
    import trimesh

    center = np.asarray(
        mesh.center_mass if mass_center is None else mass_center,  # type: ignore[attr-defined]
        dtype=np.float64,
    )
    hull = hull_surface(np.asarray(mesh.vertices), "stable poses")  # type: ignore[attr-defined]
    solid = trimesh.Trimesh(hull.vertices - center, hull.faces, process=False)
    depth = -np.einsum("ij,ij->i", solid.triangles_center, solid.face_normals)
    # Outside or on the hull trimesh would look for a sample inside without end.
    if not depth.max() < 0:
        raise GeometryError(
            f"stable poses: the mass centre {center.tolist()} lies outside the hull; check the "
            "inertial origin"
        )
    transforms, probabilities = trimesh.poses.compute_stable_poses(
        solid, center_mass=np.zeros(3), sigma=0.0, threshold=threshold, seed=0
    )
    found = []
    for transform, probability in zip(transforms, probabilities, strict=True):
        orientation = quaternion_from_matrix(np.asarray(transform)[:3, :3])
        support = support_polygon(hull.vertices, center, orientation)
        weakest = _smallest_slenderness(support)
        found.append(
            StablePose(orientation, float(probability), support.height, weakest[0], weakest[1])
        )
    return found


def support_polygon(
    points: Array,
    mass_center: Array,
    orientation: Quaternion,
    *,
    tolerance: float = STABILITY.support,
) -> Support:
    """What a body on a horizontal plane stands on.

    Args:
        points: of the body in M, shape (k, 3) [m].
        mass_center: in M, shape (3,) [m].
        orientation: of M, quaternion x, y, z, w.
        tolerance: points less than this share of the mass centre's height above the lowest one
            count as support: a start orientation is rarely exactly that at rest.

    Raises:
        GeometryError: fewer than three supporting points, or all on one line.
    """
    from scipy.spatial import ConvexHull, QhullError

    rotation = matrix_from_quaternion(normalized(orientation))
    placed = (np.asarray(points) - mass_center) @ rotation.T
    height = -float(placed[:, 2].min())
    reach = tolerance * abs(height)
    low = placed[placed[:, 2] <= -height + reach, :2]
    try:
        outline = ConvexHull(low)
    except (QhullError, ValueError) as error:
        raise GeometryError(
            f"support: within {reach:.3g} m of the lowest point the body has "
            f"{counted(len(np.unique(low)), 'point')} on one line; it does not stand in this "
            "orientation (see the stable poses of `vsr2 inertia`)"
        ) from error
    return Support(
        polygon=low[outline.vertices],
        height=height,
        margin=-float(outline.equations[:, 2].max()),
        tolerance=reach,
    )


def slenderness(
    body: RockBody,
    azimuths: Sequence[float] = STABILITY.azimuths,
    *,
    gravity: float = STABILITY.gravity,
    tolerance: float = STABILITY.support,
) -> list[Slenderness]:
    """Slenderness angle, rocking radius and frequency parameter of a rock in its start orientation.

    Housner (1963), here for the edge of the support polygon that the azimuth crosses:
    tan alpha = d / h, R^2 = h^2 + (distance to the edge's line)^2, p^2 = m g R / I_O with
    I_O = I_edge + m R^2.

    Args:
        body: the rock; with `inertia_from_aabb` its moments are the bounding box's without margins.
        azimuths: anticlockwise from x in the world [degree].
        gravity: [m/s^2].
        tolerance: see :func:`support_polygon`.

    Raises:
        GeometryError: the mass centre is not above the support polygon.
    """
    return _slenderness(
        rock_points(body), body.mass, body.start.orientation, azimuths, gravity, tolerance
    )


def _slenderness(
    points: Array,
    mass: MassProperties,
    orientation: Quaternion,
    azimuths: Sequence[float],
    gravity: float,
    tolerance: float,
) -> list[Slenderness]:
    support = support_polygon(points, mass.mass_center, orientation, tolerance=tolerance)
    if support.margin <= 0:
        raise GeometryError(
            f"support: the mass centre lies {-support.margin:.3g} m outside the support polygon; "
            "it does not stand in this orientation (see the stable poses of `vsr2 inertia`)"
        )
    axes = matrix_from_quaternion(orientation) @ mass.principal_axes
    tensor = axes @ np.diag(mass.principal_inertia) @ axes.T
    rows = []
    for azimuth in azimuths:
        direction = np.array([math.cos(math.radians(azimuth)), math.sin(math.radians(azimuth))])
        distance, edge, normal_distance = _edge_along(support.polygon, direction)
        radius = math.hypot(support.height, normal_distance)
        about_edge = float(edge @ tensor[:2, :2] @ edge) + mass.mass * radius**2
        rows.append(
            Slenderness(
                azimuth=float(azimuth),
                alpha=math.atan2(distance, support.height),
                distance=distance,
                radius=radius,
                frequency_parameter=math.sqrt(mass.mass * gravity * radius / about_edge),
            )
        )
    return rows


def _edge_along(polygon: Array, direction: Array) -> tuple[float, Array, float]:
    """Where a ray from the origin leaves a polygon around it.

    Returns the distance along the direction, the unit vector along the edge met, and the distance
    of that edge's line from the origin.
    """
    normal, offset = _edges(polygon)
    slope = normal @ direction
    # From inside a convex polygon the ray leaves through the first edge line ahead of it.
    reach = np.where(slope > 1e-12, offset / np.where(slope > 1e-12, slope, 1.0), np.inf)
    met = int(np.argmin(reach))
    return float(reach[met]), np.array([-normal[met, 1], normal[met, 0]]), float(offset[met])


def _edges(polygon: Array) -> tuple[Array, Array]:
    """Outward unit normals of the edges, shape (k, 2), and their distances from the origin (k,)."""
    along = np.roll(polygon, -1, axis=0) - polygon
    normal = np.column_stack([along[:, 1], -along[:, 0]])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return normal, (normal * polygon).sum(axis=1)


def _smallest_slenderness(support: Support) -> tuple[float, float]:
    """Smallest slenderness angle [rad] and its azimuth [degree]: towards the nearest edge."""
    normal, offset = _edges(support.polygon)
    nearest = int(np.argmin(offset))
    azimuth = math.degrees(math.atan2(normal[nearest, 1], normal[nearest, 0])) % 360.0
    return math.atan2(float(offset[nearest]), support.height), azimuth


def inertia_summary(
    path: str | Path,
    *,
    scale: float = 1.0,
    density: float | None = None,
    mass: float | None = None,
    repair: bool = False,
    orientation: Quaternion = IDENTITY,
    azimuths: Sequence[float] = STABILITY.azimuths,
    gravity: float = STABILITY.gravity,
) -> dict[str, Any]:
    """Mass properties, stable poses and slenderness of a mesh or URDF, ready for JSON.

    Slenderness by azimuth holds for the given orientation where the body stands in it, else for
    the stable pose whose upward direction in the model frame is nearest to its own.

    Args:
        path: OBJ, STL, PLY or URDF.
        scale: factor on lengths.
        density: [kg/m^3]; neither this nor mass: granite, 2700, which the summary says.
        mass: [kg]; density and mass are refused for a URDF, which has its own.
        repair: see :func:`vsr2.scene.mesh.load_mesh`.
        orientation: of the model frame, quaternion x, y, z, w.
        azimuths: [degree].
        gravity: [m/s^2].

    Raises:
        GeometryError: as the readers; both density and mass given.
    """
    import trimesh

    source = Path(path)
    if density is not None and mass is not None:
        raise GeometryError(f"{source}: give density or mass, not both")
    orientation = normalized(orientation)
    assumed = False
    if source.suffix.lower() in (".urdf", ".xml"):
        if density is not None or mass is not None:
            raise GeometryError(f"{source}: a URDF has its own mass; drop density and mass")
        model = load_urdf(source, scale)
        properties, notes, sha256 = model.mass, model.notes, model.sha256
        shape = trimesh.Trimesh(model.surface.vertices, model.surface.faces, process=False)
        volume = None
    else:
        loaded = load_mesh(source, scale=scale, repair=repair)
        shape, notes, sha256 = loaded.mesh, loaded.notes, loaded.sha256
        if density is None and mass is None:
            density, assumed = STABILITY.granite_density, True
        properties = mesh_mass_properties(shape, density=density, mass=mass, source=str(source))
        volume = float(shape.volume)
    vertices = np.asarray(shape.vertices, dtype=np.float64)
    hull = hull_surface(vertices, str(source))
    poses = stable_poses(shape, mass_center=properties.mass_center)
    standing, rows = _standing(hull.vertices, properties, orientation, poses, azimuths, gravity)
    return {
        "file": str(source),
        "sha256": sha256,
        "notes": [note.to_json() for note in notes],
        "scale": scale,
        "vertices": len(vertices),
        "faces": len(shape.faces),
        "hull_vertices": len(hull.vertices),
        "extents_m": np.ptp(vertices, axis=0).tolist(),
        "volume_m3": volume,
        "hull_volume_m3": signed_volume(hull.vertices, hull.faces.astype(np.int64)),
        "density_kg_m3": None if volume is None else properties.mass / volume,
        "density_assumed": assumed,
        "mass_kg": properties.mass,
        "mass_center_m": properties.mass_center.tolist(),
        "principal_inertia_kg_m2": properties.principal_inertia.tolist(),
        "principal_axes": properties.principal_axes.tolist(),
        "bounding_box_inertia_kg_m2": box_inertia(
            properties.mass, np.ptp(vertices, axis=0)
        ).tolist(),
        "stable_poses": [asdict(pose) | {"orientation": list(pose.orientation)} for pose in poses],
        "slenderness_orientation": list(standing),
        "slenderness_as_given": standing == orientation,
        "slenderness": [asdict(row) for row in rows],
        "constants": stability_constants(gravity=gravity, azimuths=list(azimuths)),
    }


def _standing(
    points: Array,
    mass: MassProperties,
    orientation: Quaternion,
    poses: Sequence[StablePose],
    azimuths: Sequence[float],
    gravity: float,
) -> tuple[Quaternion, list[Slenderness]]:
    closest = sorted(
        (pose.orientation for pose in poses),
        key=lambda pose: -_upright(pose, orientation),
    )
    for candidate in (orientation, *closest):
        try:
            rows = _slenderness(points, mass, candidate, azimuths, gravity, STABILITY.support)
        except GeometryError:
            continue
        return candidate, rows
    return orientation, []


def _upright(first: Quaternion, second: Quaternion) -> float:
    """Cosine of the angle between the model directions that point up in two orientations."""
    return float(matrix_from_quaternion(first)[2] @ matrix_from_quaternion(second)[2])


def start_support(body: RockBody, *, tolerance: float = STABILITY.support) -> Support:
    """Support polygon of a rock in its start orientation; see :func:`support_polygon`."""
    return support_polygon(
        rock_points(body), body.mass.mass_center, body.start.orientation, tolerance=tolerance
    )
