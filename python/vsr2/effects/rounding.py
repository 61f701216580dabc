"""Rounded edges: the opening of a convex body by a ball, as points of a hull.

Opening a body K by a ball of radius r (erosion, then dilation, both by the ball; Serra 1982, *Image
Analysis and Mathematical Morphology*) leaves the union of all balls of radius r inside K: plane
faces stay, every edge and corner becomes round with radius r. For a convex polyhedron erosion moves
the planes of its faces inwards by r; dilation puts a piece of sphere on every vertex of what is
left.

Only the underside is rounded, up to the equator of the body in its start orientation: what lies
above meets the pedestal after overturning only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vsr2.errors import GeometryError
from vsr2.one_line import counted
from vsr2.scene.rotation import axis_aside

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RoundingConstants:
    """How finely round edges are made of points; chosen by hand.

    Attributes:
        fine_step: spacing of directions on the pieces of sphere that meet the pedestal while
            rocking [rad].
        coarse_step: of the other directions [rad].
        fine_reach: tilt up to which the spacing is fine [rad].
        least_radius: smaller radii leave a hull as it is [m].
    """

    fine_step: float = math.radians(4.0)
    coarse_step: float = math.radians(12.0)
    fine_reach: float = math.radians(44.0)
    least_radius: float = 1e-4


ROUNDING = RoundingConstants()
_SAME = 1e-9
"""Components of unit vectors below this are 0."""
_PAIRS = 2**18
"""Of vertices and planes that are looked at together."""


def rounded_hull(points: Array, radius: float, down: Array, *, ball: float | None = None) -> Array:
    """Points whose hull is the hull of `points`, its underside opened by a ball.

    Args:
        points: shape (k, 3) [m].
        radius: of the ball [m].
        down: unit vector towards the pedestal, in the frame of the points, shape (3,).
        ball: radius of the dilation [m], where the engine dilates by the rest (its collision
            margin); by default `radius`.

    Raises:
        GeometryError: no ball of this radius fits into the body.
    """
    from scipy.spatial import HalfspaceIntersection, QhullError

    grown = radius if ball is None else ball
    hull = convex_hull(points)
    planes = distinct_planes(hull.equations)
    normals, offsets = planes[:, :3], planes[:, 3]
    center = deep_point(normals, offsets)
    assert center is not None, "a hull has an inside"
    depth = float((-(normals @ center) - offsets).min())
    if depth <= radius * (1 + 1e-6):
        raise GeometryError(
            f"a ball of radius {radius:g} m does not fit into the rock (at most "
            f"{depth:.3g} m); lower the radius"
        )
    try:
        eroded = HalfspaceIntersection(np.column_stack([normals, offsets + radius]), center)
    except QhullError as error:
        raise GeometryError(
            f"eroding the rock by {radius:g} m fails; change the radius slightly"
        ) from error
    vertices = merged(eroded.intersections)
    scale = float(np.ptp(points, axis=0).max())
    lower = normals @ down > -_SAME
    vertex, face = _touching(vertices, normals[lower], offsets[lower] + radius, 1e-7 * scale)
    pieces = [vertices[vertex] + grown * normals[lower][face]]
    directions = _directions(down)
    reach = vertices @ directions.T
    # All vertices that share the farthest reach, so that an edge across the tilt stays whole.
    tied, towards = np.nonzero(reach > reach.max(axis=0) - 1e-9 * scale)
    pieces.append(vertices[tied] + grown * directions[towards])
    shrunk = radius - grown
    # Hull vertices none of whose faces looks down.
    touched = hull.simplices[hull.equations[:, :3] @ down > _SAME]
    above = points[np.setdiff1d(hull.vertices, touched)]
    if shrunk > 0 and len(above):
        # The engine dilates all of the hull, the part above included.
        dilated = HalfspaceIntersection(np.column_stack([normals, offsets + shrunk]), center)
        above = dilated.intersections[(dilated.intersections - center) @ down < 0]
    pieces.append(above)
    return outline(np.unique(np.vstack(pieces), axis=0))


def _touching(
    vertices: Array, normals: Array, offsets: Array, near: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Vertices, and planes that they lie on, by less than `near` inside or anywhere beyond.

    A rock that was rounded before has millions of such pairs, which are looked at by the block.
    """
    rows = max(1, _PAIRS // len(normals))
    inside = np.empty((rows, len(normals)))
    vertex, face = [], []
    for start in range(0, len(vertices), rows):
        block = inside[: len(vertices[start : start + rows])]
        np.matmul(vertices[start : start + rows], normals.T, out=block)
        block += offsets
        on, plane = np.divmod(np.flatnonzero(block > -near), len(normals))
        vertex.append(on + start)
        face.append(plane)
    return np.concatenate(vertex), np.concatenate(face)


def outline(points: Array) -> Array:
    """The vertices of a hull, without near copies, in their order."""
    distinct = merged(points)
    found: Array = distinct[np.sort(convex_hull(distinct).vertices)]
    return found


def convex_hull(points: Array) -> ConvexHull:
    """Qhull's convex hull of points, shape (k, 3) [m].

    Erosion leaves many nearly coplanar points, of which Qhull merges some into facets some 1e-10 m
    thick and then refuses them (QH6297). Its option Q12 allows these and changes nothing else.

    Raises:
        GeometryError: the points have no volume.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        return ConvexHull(points, qhull_options="Qt Q12 Pp")
    except QhullError as error:
        raise GeometryError(
            f"the convex hull of {counted(len(points), 'point')} fails; is the rock flat?"
        ) from error


def distinct_planes(equations: Array) -> Array:
    """Planes of a hull; Qhull gives one for each triangle of a face."""
    order = np.lexsort(np.round(equations, 9).T)
    kept: list[Array] = []
    for plane in equations[order]:
        if not kept or np.abs(np.asarray(kept[-1]) - plane).max() > 1e-8:
            kept.append(plane)
    return np.asarray(kept)


def deep_point(normals: Array, offsets: Array) -> Array | None:
    """Centre of the largest ball inside (Chebyshev centre); None where nothing is inside."""
    from scipy.optimize import linprog

    count = len(normals)
    found = linprog(
        [0.0, 0.0, 0.0, -1.0],
        A_ub=np.column_stack([normals, np.ones(count)]),
        b_ub=-offsets,
        bounds=[(None, None)] * 3 + [(0, None)],
    )
    return None if found.x is None else np.asarray(found.x[:3])


def merged(points: Array, tolerance: float = 1e-7) -> Array:
    """Points without near copies; the first of each cluster in a grid stays."""
    _, first = np.unique(np.round(points / tolerance), axis=0, return_index=True)
    return points[np.sort(first)]


def _directions(down: Array) -> Array:
    """Directions of the lower half of a sphere about `down`, rings through four meridians."""
    helper = axis_aside(down)
    first = helper - (helper @ down) * down
    first /= np.linalg.norm(first)
    second = np.cross(down, first)
    rows = [down[None, :]]
    polar = 0.0
    while polar < 0.5 * math.pi - 1e-9:
        fine = polar < ROUNDING.fine_reach - 1e-9
        step = ROUNDING.fine_step if fine else ROUNDING.coarse_step
        polar = min(polar + step, 0.5 * math.pi)
        # A multiple of 4, so that the directions of the frame's own axes are among them.
        count = 4 * math.ceil(0.5 * math.pi * math.sin(polar) / step)
        azimuth = 2.0 * math.pi * np.arange(count) / count
        rows.append(
            math.cos(polar) * down
            + math.sin(polar)
            * (np.cos(azimuth)[:, None] * first + np.sin(azimuth)[:, None] * second)
        )
    return np.vstack(rows)
