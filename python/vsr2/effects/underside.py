"""The underside of a convex body: the face it settles on, and other undersides near it.

Bodies are points whose hull they are; `down` is a unit vector towards the pedestal, and heights
count from a `level`, the greatest reach of the settled body along `down`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsr2.effects.rounding import convex_hull, deep_point, distinct_planes, outline
from vsr2.errors import GeometryError

Array = NDArray[np.float64]
_LEVEL = 1e-9
"""Components of unit vectors below this are 0."""
_COEFFICIENTS = 6
"""Of a quadric over the base."""


def settled_down(points: Array, mass_center: Array, down: Array) -> Array:
    """Downward normal of the face of the hull on which a body comes to rest, shape (3,).

    The body is let down without speed and tips from face to face: the ray from the mass centre
    along the present downward direction leaves the hull through the next one, and each lies nearer
    to the mass centre than the one before (Goldberg et al., Part pose statistics, 1999).

    Args:
        points: shape (k, 3) [m].
        mass_center: inside the hull, shape (3,) [m].
        down: at the start, shape (3,).
    """
    planes = convex_hull(points).equations
    normals = planes[:, :3]
    distance = -(normals @ mass_center) - planes[:, 3]
    direction, last = down, np.inf
    while True:
        rate = normals @ direction
        ahead = rate > _LEVEL
        reach = np.where(ahead, distance / np.where(ahead, rate, 1.0), np.inf)
        met = int(np.argmin(reach))
        if distance[met] >= last * (1 - _LEVEL):
            return np.asarray(direction)
        direction, last = normals[met], float(distance[met])


def flattened(points: Array, down: Array, level: float, depth: float) -> Array:
    """Points of a body that stands on its section at a height, put down to the level.

    Args:
        points: shape (k, 3) [m].
        down: shape (3,).
        level: reach of the whole body along `down` [m].
        depth: height of the section above the level [m].
    """
    cut = level - depth
    reach = points @ down
    if reach.max() <= cut:
        return points
    faces = convex_hull(points).simplices
    edges = np.unique(np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    a, b = edges.T
    crossed = (reach[a] > cut) != (reach[b] > cut)
    a, b = a[crossed], b[crossed]
    share = ((cut - reach[a]) / (reach[b] - reach[a]))[:, None]
    section = points[a] + share * (points[b] - points[a])
    return outline(np.vstack([points[reach <= cut], section + depth * down]))


def narrowed(points: Array, down: Array, inward: float) -> Array:
    """Points of a body whose sides and underside are eroded by a level disc.

    Every plane that does not look up moves inwards by the disc's radius times the level part of its
    normal: the base keeps its height, and its edges move in by the radius. A negative radius moves
    them out; then corners stay sharp.

    Args:
        points: shape (k, 3) [m].
        down: shape (3,).
        inward: radius of the disc [m].

    Raises:
        GeometryError: nothing is left.
    """
    from scipy.spatial import HalfspaceIntersection, QhullError

    planes = distinct_planes(convex_hull(points).equations)
    normals, offsets = planes[:, :3], planes[:, 3]
    below = normals @ down
    beside = np.sqrt(np.maximum(1.0 - below**2, 0.0))
    moved = offsets + np.where(below > -_LEVEL, inward * beside, 0.0)
    center = deep_point(normals, moved)
    if center is None or (normals @ center + moved).max() >= 0:
        raise GeometryError(f"{inward:g} m inwards leaves nothing of the rock; make it smaller")
    try:
        left = HalfspaceIntersection(np.column_stack([normals, moved]), center)
    except QhullError as error:
        raise GeometryError(f"moving the base by {inward:g} m fails; change it slightly") from error
    return outline(left.intersections)


def smoothed(points: Array, down: Array, level: float, zone: float, most: float) -> Array:
    """Points near the base moved vertically towards a quadric, by `most` at most [m].

    The quadric z = q(x, y) is fitted by least squares to the hull's own points up to the height
    `zone` above the level. Points above the hull move, too: some come to lie on it.

    Args:
        points: shape (k, 3) [m].
        down: shape (3,).
        level: reach of the whole body along `down` [m].
        zone: [m].
        most: [m].
    """
    reach = points @ down
    near = reach > level - zone
    outer = np.zeros(len(points), dtype=bool)
    outer[convex_hull(points).vertices] = True
    if np.count_nonzero(near & outer) <= _COEFFICIENTS:
        return points
    first = np.eye(3)[np.argmin(np.abs(down))]
    first = first - (first @ down) * down
    first /= np.linalg.norm(first)
    plan = points[near] @ np.column_stack([first, np.cross(down, first)])
    plan = (plan - plan.mean(axis=0)) / max(float(np.ptp(plan)), 1e-12)
    x, y = plan.T
    terms = np.column_stack([np.ones(x.size), x, y, x * x, x * y, y * y])
    own = outer[near]
    fitted = terms @ np.linalg.lstsq(terms[own], reach[near][own], rcond=None)[0]
    moved = points.copy()
    moved[near] += np.clip(fitted - reach[near], -most, most)[:, None] * down
    return moved
