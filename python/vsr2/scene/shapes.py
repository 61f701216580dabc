"""Collision shapes as triangles: what figures draw and what start poses are lowered onto."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vsr2.errors import GeometryError
from vsr2.scene.body import Array, Box, Hull, PedestalBody, RockBody, Triangles
from vsr2.scene.rotation import matrix_from_quaternion

_BOX_SIGNS = np.array([[x, y, z] for z in (-0.5, 0.5) for y in (-0.5, 0.5) for x in (-0.5, 0.5)])
"""Corners of the unit box."""
_BOX_FACES = np.array(
    [
        [0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
        [2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5],
    ],
    dtype=np.int32,
)  # fmt: skip
"""Its faces by corner, outside anticlockwise."""


def box_corners(box: Box) -> Array:
    """The eight corners in the frame the box is given in, shape (8, 3) [m]."""
    corners = _BOX_SIGNS * np.asarray(box.size)
    if box.orientation != (0.0, 0.0, 0.0, 1.0):
        corners = corners @ matrix_from_quaternion(box.orientation).T
    moved: Array = corners + np.asarray(box.center)
    return moved


def box_surface(box: Box) -> Triangles:
    """A box as 12 outward triangles."""
    return Triangles(box_corners(box), _BOX_FACES.copy())


def cylinder_points(radius: float, length: float, sides: int) -> Array:
    """Corners of the regular prism inscribed in a cylinder along z, shape (2 sides, 3) [m]."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    half = np.full((sides, 1), 0.5 * length)
    return np.vstack([np.hstack([ring, -half]), np.hstack([ring, half])])


def hull_surface(points: Array, source: str = "collision hull") -> Triangles:
    """Convex hull of points as outward triangles over the hull's own vertices.

    Raises:
        GeometryError: the points lie in a plane, or are fewer than four.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(np.asarray(points, dtype=np.float64))
    except (QhullError, ValueError) as error:
        raise GeometryError(
            f"{source}: no convex hull: the points are fewer than four or lie in one plane; "
            "a solid shape is needed"
        ) from error
    corners = hull.points[hull.simplices]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = np.einsum("ij,ij->i", normal, hull.equations[:, :3]) < 0
    faces = np.where(inwards[:, None], hull.simplices[:, ::-1], hull.simplices)
    used, renumbered = np.unique(faces, return_inverse=True)
    return Triangles(hull.points[used], renumbered.reshape(-1, 3).astype(np.int32))


def join_surfaces(surfaces: Sequence[Triangles]) -> Triangles:
    """Several surfaces as one list of triangles."""
    offsets = np.cumsum([0] + [len(surface.vertices) for surface in surfaces[:-1]])
    return Triangles(
        np.vstack([surface.vertices for surface in surfaces]),
        np.vstack(
            [surface.faces + offset for surface, offset in zip(surfaces, offsets, strict=True)]
        ).astype(np.int32),
    )


def part_points(parts: Sequence[Hull | Box]) -> list[Array]:
    """Points whose convex hull is each part, in the body's frame, each of shape (k, 3) [m]."""
    return [part.points if isinstance(part, Hull) else box_corners(part) for part in parts]


def part_surface(parts: Sequence[Hull | Box | Triangles]) -> Triangles:
    """All collision parts as triangles, in the body's frame."""
    surfaces = []
    for part in parts:
        if isinstance(part, Triangles):
            surfaces.append(part)
        elif isinstance(part, Box):
            surfaces.append(box_surface(part))
        else:
            surfaces.append(hull_surface(part.points))
    return join_surfaces(surfaces)


def rock_points(rock: RockBody) -> Array:
    """All collision points of a rock in the model frame M, shape (k, 3) [m]."""
    return np.vstack(part_points(rock.parts))


def pedestal_surface(pedestal: PedestalBody) -> Triangles:
    """Collision surface of the pedestal in the world at the start."""
    surface = part_surface(pedestal.parts)
    return Triangles(surface.vertices + np.asarray(pedestal.origin), surface.faces)
