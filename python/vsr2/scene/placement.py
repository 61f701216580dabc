"""Start poses: as given, or turned about the vertical and lowered onto the pedestal.

How far a convex part can be lowered is found exactly, up to rounding: over one triangle of the
pedestal the difference "triangle minus underside of the hull" is concave and piecewise linear in
x and y, so its maximum lies at a hull vertex over the triangle, at a triangle vertex under the
hull, or where an edge of one crosses an edge of the other in plan. All such places are looked at.

Over one face of a box, level or not, the point that is nearest to the face decides.

The gap (sum of the collision margins) is kept along the contact normal: over such a face it is
exact, elsewhere the hull is first grown by a faceted ball, which makes the gap at most 1.5 % too
small.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from vsr2.config.study import FixedStart, YawStart
from vsr2.errors import GeometryError
from vsr2.scene.body import Array, Box, Hull, MassProperties, PedestalBody, Pose, Triangles
from vsr2.scene.rotation import (
    IDENTITY,
    check_unit,
    matrix_from_quaternion,
    multiply,
    normalized,
    transform_points,
    yaw_quaternion,
)
from vsr2.scene.shapes import box_corners, hull_surface, part_points, pedestal_surface

_PAIRS = 1_000_000
"""Pairs of features looked at together: bounds the memory."""


@dataclass(frozen=True)
class PlacementConstants:
    """How a hull is lifted by a clearance; chosen by hand.

    Attributes:
        ball_step: angle between neighbouring corners of the faceted ball [degree].
    """

    ball_step: float = 12.0


PLACEMENT = PlacementConstants()


def start_pose(
    start: FixedStart | YawStart,
    parts: Sequence[Hull | Box],
    mass: MassProperties,
    pedestal: PedestalBody,
    *,
    clearance: float,
) -> Pose:
    """Pose X_WM of the model frame at the start.

    Args:
        start: `FixedStart`: taken as it stands. `YawStart`: `base_orientation`, then the turn by
            `yaw`; the mass centre above `position_xy`; lowered until the lowest support is
            `clearance` above the pedestal.
        parts: the rock's collision parts in M.
        mass: gives the mass centre in M.
        pedestal: what it stands on.
        clearance: gap to keep, the sum of the collision margins of rock and pedestal [m].

    Raises:
        GeometryError: a quaternion that is not of unit length, or no pedestal under the rock.
    """
    if not (math.isfinite(clearance) and clearance >= 0):
        raise GeometryError(f"clearance {clearance} m must be zero or positive")
    if isinstance(start, FixedStart):
        check_unit(start.orientation, "rock.start.orientation")
        return Pose(position=start.position, orientation=start.orientation)
    base = normalized(start.base_orientation, "rock.start.base_orientation")
    turned = base
    if start.yaw != 0.0:
        turn = yaw_quaternion(math.radians(start.yaw))
        turned = turn if base == IDENTITY else multiply(turn, base)
    offset = transform_points(Pose((0.0, 0.0, 0.0), turned), mass.mass_center[None, :])[0]
    x, y = (float(start.position_xy[axis] - offset[axis]) for axis in range(2))
    lift = _lift(parts, Pose((x, y, 0.0), turned), pedestal, clearance)
    if lift is None:
        raise GeometryError(
            f"rock.start.position_xy {start.position_xy} m: no pedestal under the rock; its top "
            f"spans {_span(pedestal)}"
        )
    return Pose(position=(x, y, lift), orientation=turned)


@lru_cache(maxsize=16)  # Of the same rock in many starts, one is common to all: where it stood.
def height_above(parts: tuple[Hull | Box, ...], pose: Pose, pedestal: PedestalBody) -> float | None:
    """Vertical distance by which the rock may be lowered before it touches [m].

    Margins are left out; negative: by how much it must be raised to be free; None: the pedestal is
    not under the rock.
    """
    lift = _lift(parts, pose, pedestal, 0.0)
    return None if lift is None else -lift


def heights_above(
    parts: tuple[Hull | Box, ...], poses: Sequence[Pose], pedestal: PedestalBody
) -> list[float | None]:
    """As :func:`height_above`, of one rock in many poses."""
    found: list[float | None] = []
    placed = np.vstack(_corners(parts))
    for chunk in _chunks(len(poses), placed.size):
        some = poses[chunk]
        low, high = _spans(some, placed)
        for pose, least, most in zip(some, low, high, strict=True):
            if _covered_by_even_top(pedestal, least, most):
                found.append(-float(pedestal.top - least[2]))
            else:
                found.append(height_above(parts, pose, pedestal))
    return found


def _spans(poses: Sequence[Pose], points: Array) -> tuple[Array, Array]:
    """Least and greatest coordinates of points (k, 3) in each of n poses, both of shape (n, 3)."""
    rows = np.array([matrix_from_quaternion(pose.orientation) for pose in poses])
    x, y, z = points.T
    # As in transform_points, of which the bits are those of a start.
    placed = rows[:, :, 0, None] * x
    placed += rows[:, :, 1, None] * y
    placed += rows[:, :, 2, None] * z
    placed += np.array([pose.position for pose in poses])[:, :, None]
    return placed.min(axis=2), placed.max(axis=2)


def _corners(parts: Sequence[Hull | Box]) -> list[Array]:
    """Points of each part in the model frame, each once."""
    return [part.distinct if isinstance(part, Hull) else box_corners(part) for part in parts]


def stands_over(pedestal: PedestalBody, x: float, y: float) -> bool:
    """Whether the vertical through (x, y) [m] meets the pedestal at its start."""
    surface = pedestal_surface(pedestal)
    corners = surface.vertices[surface.faces][:, :, :2]
    inside, _ = _barycentric(corners, np.array([[x, y]]))
    return bool(inside.any())


def _span(pedestal: PedestalBody) -> str:
    low, high = (
        extreme(pedestal_surface(pedestal).vertices[:, :2], axis=0) for extreme in (np.min, np.max)
    )
    return f"x {low[0]:g} to {high[0]:g} m, y {low[1]:g} to {high[1]:g} m"


def _lift(
    parts: Sequence[Hull | Box], pose: Pose, pedestal: PedestalBody, clearance: float
) -> float | None:
    """Rise from `pose` at which the rock is `clearance` above the pedestal; None: beside it."""
    placed = transform_points(pose, np.vstack(_corners(parts)))
    low, high = placed.min(axis=0), placed.max(axis=0)
    if _covered_by_even_top(pedestal, low, high):
        return float(pedestal.top + clearance - low[2])
    lift = _lift_over_face(placed, pedestal, clearance)
    if lift is not None:
        return lift
    surface = pedestal_surface(pedestal)
    lifts = [
        _hull_lift(transform_points(pose, points), surface, clearance)
        for points in part_points(parts)
    ]
    found = [lift for lift in lifts if lift is not None]
    return max(found) if found else None


def _covered_by_even_top(pedestal: PedestalBody, low: Array, high: Array) -> bool:
    """Whether the pedestal is one upright box whose top reaches beyond the rock on all sides."""
    if len(pedestal.parts) != 1:
        return False
    part = pedestal.parts[0]
    if not isinstance(part, Box) or part.orientation != IDENTITY:
        return False
    for axis in (0, 1):
        center, half = pedestal.origin[axis] + part.center[axis], 0.5 * part.size[axis]
        if low[axis] < center - half or high[axis] > center + half:
            return False
    return True


def _lift_over_face(placed: Array, pedestal: PedestalBody, clearance: float) -> float | None:
    """Rise above the top face of a pedestal of one box; None: some point is not above the face."""
    box = pedestal.parts[0]
    if len(pedestal.parts) != 1 or not isinstance(box, Box):
        return None
    x, y, z, w = box.orientation
    center = np.asarray(pedestal.origin) + np.asarray(box.center)
    in_box = transform_points(Pose((0.0, 0.0, 0.0), (-x, -y, -z, w)), placed - center)
    vertical = matrix_from_quaternion(box.orientation)[2]
    up = int(np.argmax(np.abs(vertical)))
    half, cosine = 0.5 * np.asarray(box.size), abs(float(vertical[up]))
    drop = (np.copysign(1.0, vertical[up]) * in_box[:, up] - half[up]) / cosine
    landing = np.delete(in_box - drop[:, None] * vertical, up, axis=1)
    if (np.abs(landing) > np.delete(half, up)).any():
        return None
    return clearance / cosine - float(drop.min())


def _hull_lift(points: Array, surface: Triangles, clearance: float) -> float | None:
    lift = drop_height(points, surface)
    if lift is None or clearance == 0.0:
        return lift
    # What lies above the surface's highest point when touching cannot decide; the facets that
    # reach below it are kept whole, so that the underside stays the same there.
    hull = hull_surface(points)
    low, high = points.min(axis=0) - clearance, points.max(axis=0) + clearance
    near = surface.vertices[surface.faces]
    overlap = (near.min(axis=1)[:, :2] <= high[:2]) & (near.max(axis=1)[:, :2] >= low[:2])
    ceiling = float(near[overlap.all(axis=1)][:, :, 2].max())
    reaches = hull.vertices[:, 2] + lift <= ceiling + clearance
    kept = np.unique(hull.faces[reaches[hull.faces].any(axis=1)])
    grown = (hull.vertices[kept][:, None, :] + clearance * _ball()[None, :, :]).reshape(-1, 3)
    return drop_height(grown, surface)


def _ball() -> Array:
    """Corners of the lower half of a faceted unit ball, straight down included, shape (n, 3)."""
    corners = [np.array([[0.0, 0.0, -1.0]])]
    step = math.radians(PLACEMENT.ball_step)
    for ring in range(1, math.ceil(0.5 * math.pi / step) + 1):
        polar = min(ring * step, 0.5 * math.pi)
        count = math.ceil(2.0 * math.pi * math.sin(polar) / step)
        azimuth = 2.0 * math.pi * np.arange(count) / count
        corners.append(
            np.column_stack(
                [
                    math.sin(polar) * np.cos(azimuth),
                    math.sin(polar) * np.sin(azimuth),
                    np.full(count, -math.cos(polar)),
                ]
            )
        )
    return np.vstack(corners)


def drop_height(points: Array, surface: Triangles) -> float | None:
    """Rise at which the convex hull of `points`, coming from above, first touches a surface.

    Args:
        points: of a solid, shape (k, 3) [m].
        surface: triangles in the same frame, in any arrangement.

    Returns:
        The largest of "surface minus underside of the hull" over all verticals [m]; None where no
        vertical meets both.

    Raises:
        GeometryError: the points have no solid hull.
    """
    underside = _Underside(points)
    corners = surface.vertices[surface.faces]
    overlap = (corners.min(axis=1)[:, :2] <= underside.high) & (
        corners.max(axis=1)[:, :2] >= underside.low
    )
    corners = corners[overlap.all(axis=1)]
    if len(corners) == 0:
        return None
    best = underside.over_points(np.unique(corners.reshape(-1, 3), axis=0))
    corners = corners[corners[:, :, 2].max(axis=1) - underside.bottom >= best]
    if len(corners):
        best = max(best, underside.vertices_over(corners, best))
        corners = corners[corners[:, :, 2].max(axis=1) - underside.bottom >= best]
    if len(corners):
        best = max(best, underside.edges_across(corners, best))
    return best if math.isfinite(best) else None


def _chunks(count: int, partners: int) -> Iterator[slice]:
    step = max(1, _PAIRS // max(1, partners))
    for begin in range(0, count, step):
        yield slice(begin, begin + step)


def _barycentric(triangles: Array, points: Array) -> tuple[NDArray[np.bool_], Array]:
    """Whether points (p, 2) lie in triangles (t, 3, 2), shape (p, t), and weights (p, t, 3)."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    e, f = b - a, c - a
    area = e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]
    # Triangles that stand upright have no area in plan; their edges and corners count elsewhere.
    longest = np.maximum((e**2).sum(axis=1), (f**2).sum(axis=1))
    flat = np.abs(area) > 1e-12 * longest
    d = points[:, None, :] - a[None, :, :]
    safe = np.where(flat, area, 1.0)
    v = (d[..., 0] * f[:, 1] - d[..., 1] * f[:, 0]) / safe
    w = (e[:, 0] * d[..., 1] - e[:, 1] * d[..., 0]) / safe
    weights = np.stack([1.0 - v - w, v, w], axis=-1)
    return (weights.min(axis=-1) >= -1e-9) & flat, weights


def _plane_values(points: Array, planes: Array) -> Array:
    """Values of a x + b y + c for all points (p, 3) and planes (q, 3), shape (p, q)."""
    # Written out for the reason given at transform_points.
    values: Array = points[:, :1] * planes[:, 0] + points[:, 1:2] * planes[:, 1] + planes[:, 2]
    return values


class _Underside:
    """The downward faces of a convex hull, as planes, vertices and edges."""

    def __init__(self, points: Array) -> None:
        from scipy.spatial import ConvexHull, QhullError

        hull = hull_surface(points)
        corners = hull.vertices[hull.faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(normal, axis=1)
        down = normal[:, 2] < -1e-9 * length
        faces = hull.faces[down]
        normal, corners = normal[down], corners[down]
        slope = -normal[:, :2] / normal[:, 2:]
        self.planes = np.column_stack(
            [slope, corners[:, 0, 2] - (slope * corners[:, 0, :2]).sum(1)]
        )
        self.vertices = hull.vertices[np.unique(faces)]
        edges = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
        self.edges = hull.vertices[edges]
        try:
            self.outline = ConvexHull(hull.vertices[:, :2]).equations
        except QhullError as error:
            raise GeometryError(
                "a collision part of the rock is a sheet standing on edge; a solid shape is needed"
            ) from error
        self.low = hull.vertices[:, :2].min(axis=0)
        self.high = hull.vertices[:, :2].max(axis=0)
        self.bottom = float(hull.vertices[:, 2].min())
        self.size = float(np.ptp(hull.vertices, axis=0).max())

    def over_points(self, points: Array) -> float:
        """Greatest height of surface points (p, 3) above the underside; -inf: none is under it."""
        best = -math.inf
        for chunk in _chunks(len(points), max(len(self.planes), len(self.outline))):
            some = points[chunk]
            outside = _plane_values(some, self.outline)
            some = some[outside.max(axis=1) <= 1e-12 * self.size]
            if len(some):
                height = _plane_values(some, self.planes).max(axis=1)
                best = max(best, float((some[:, 2] - height).max()))
        return best

    def vertices_over(self, triangles: Array, best: float) -> float:
        """Greatest height of triangles (t, 3, 3) above the hull's vertices."""
        ceiling = float(triangles[:, :, 2].max())
        vertices = self.vertices[ceiling - self.vertices[:, 2] >= best]
        for chunk in _chunks(len(vertices), len(triangles)):
            inside, weights = _barycentric(triangles[:, :, :2], vertices[chunk][:, :2])
            rise = (weights * triangles[None, :, :, 2]).sum(axis=-1) - vertices[chunk][:, 2:]
            if inside.any():
                best = max(best, float(rise[inside].max()))
        return best

    def edges_across(self, triangles: Array, best: float) -> float:
        """Greatest height of triangle edges above hull edges where they cross in plan."""
        rims = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2, 3)
        ordered = np.sort(rims.view([("x", "f8"), ("y", "f8"), ("z", "f8")]), axis=1)
        rims = np.unique(ordered.view("f8").reshape(-1, 6), axis=0).reshape(-1, 2, 3)
        rims = rims[rims[:, :, 2].max(axis=1) - self.bottom >= best]
        ceiling = float(triangles[:, :, 2].max())
        edges = self.edges[ceiling - self.edges[:, :, 2].min(axis=1) >= best]
        along = edges[:, 1] - edges[:, 0]
        for chunk in _chunks(len(rims), len(edges)):
            begin, run = rims[chunk, 0][:, None], (rims[chunk, 1] - rims[chunk, 0])[:, None]
            cross = run[..., 0] * along[:, 1] - run[..., 1] * along[:, 0]
            span = np.linalg.norm(run[..., :2], axis=-1) * np.linalg.norm(along[:, :2], axis=-1)
            usable = np.abs(cross) > 1e-12 * span
            safe = np.where(usable, cross, 1.0)
            offset = edges[None, :, 0] - begin
            s = (offset[..., 0] * along[:, 1] - offset[..., 1] * along[:, 0]) / safe
            u = (offset[..., 0] * run[..., 1] - offset[..., 1] * run[..., 0]) / safe
            hit = usable & (s >= 0) & (s <= 1) & (u >= 0) & (u <= 1)
            if hit.any():
                rise = begin[..., 2] + s * run[..., 2] - edges[None, :, 0, 2] - u * along[:, 2]
                best = max(best, float(rise[hit].max()))
        return best
