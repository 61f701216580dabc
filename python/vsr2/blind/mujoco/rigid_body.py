"""Bodies that stand freely on the table: a block, or a convex hull."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
GRAVITY = 9.80665
"""Standard gravity [m/s^2] (CGPM 1901)."""


@dataclass(frozen=True)
class HullConstants:
    """What of a hull touches the table; chosen by hand, sealed with a pack.

    Attributes:
        flat: height above the lowest point up to which points are of the base [m].
        reach: share of the height below which points can touch the table.
        level: share of the mass centre's height up to which points are of the base.
    """

    flat: float = 1e-3
    reach: float = 0.5
    level: float = 1e-3


HULL = HullConstants()


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body with its base in the plane z = 0 of its own frame, x along the shaking.

    Attributes:
        points: where it can touch the table, shape (n, 3) [m].
        inward: from each point into the body along x and y, shape (n, 2): how its centre moves per
            metre of rounding, so that flat faces beside it stay where they are.
        mass: [kg].
        center: mass centre, shape (3,) [m].
        inertia: about the mass centre, shape (3, 3) [kg m^2].
    """

    points: Array
    inward: Array
    mass: float
    center: Array
    inertia: Array

    @property
    def base(self) -> Array:
        """Corners of the base along x and y, shape (n, 2) [m]."""
        return self.points[self.points[:, 2] < HULL.level * self.center[2], :2]

    @property
    def half_width(self) -> float:
        """Least horizontal distance along x from the mass centre to the base's edges [m]."""
        return min(self.levers)

    @property
    def levers(self) -> tuple[float, float]:
        """Horizontal distances from the mass centre to the base's edges, to -x and to +x [m]."""
        offset = self.base[:, 0] - self.center[0]
        return float(-offset.min()), float(offset.max())

    @property
    def slenderness_angle(self) -> float:
        """Angle atan(half width / height of the mass centre), alpha [rad]."""
        return math.atan2(self.half_width, float(self.center[2]))

    @property
    def radius(self) -> float:
        """From the edge of the base to the mass centre, R [m]."""
        return math.hypot(self.half_width, float(self.center[2]))

    @property
    def base_area(self) -> float:
        """Of the rectangle around the base [m^2]."""
        return float(np.prod(np.ptp(self.base, axis=0)))

    @property
    def pivot_inertia(self) -> float:
        """About the edge of the base along y, I_O [kg m^2]."""
        return float(self.inertia[1, 1]) + self.mass * self.radius**2

    @property
    def housner_ratio(self) -> float:
        """Kinetic energy after over before an impact (Housner 1963), for this inertia.

        Angular momentum about the new edge is kept: r = (1 - 2 m b^2 / I_O)^2 for equal half
        widths b; for a block (1 - 3/2 sin^2 alpha)^2.
        """
        return (1 - 2 * self.mass * self.half_width**2 / self.pivot_inertia) ** 2


def block(width: float, depth: float, height: float, density: float) -> Body:
    """A homogeneous block, `width` along x.

    Only its base can touch the table: a trial ends before a side does.

    Args:
        width: along x [m].
        depth: along y [m].
        height: along z [m].
        density: [kg/m^3].
    """
    half = np.array([width, depth, height]) / 2
    signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    points = np.column_stack([signs * half[:2], np.zeros(4)])
    mass = density * width * depth * height
    squares = (2 * half) ** 2
    inertia = np.diag(mass / 12 * (squares.sum() - squares))
    return Body(points, -signs, mass, np.array([0.0, 0.0, half[2]]), inertia)


def read_hull(path: Path, density: float) -> Body:
    """The convex hull of an OBJ file's vertices [m], standing as the file has it.

    Points within `HULL.flat` of the lowest are the base and are brought to z = 0; of the others
    those below `HULL.reach` of the height can touch the table.

    Args:
        path: an OBJ file in metres, z up.
        density: [kg/m^3]; mass and inertia are the hull's.

    Raises:
        ValueError: fewer than four vertices, or a base of fewer than three.
    """
    import trimesh

    # An OBJ without faces is a cloud of points, which has a hull too.
    loaded: Any = trimesh.load(path, process=False)
    vertices = np.asarray(loaded.vertices, dtype=np.float64)
    if len(vertices) < 4:
        raise ValueError(f"{path}: has {len(vertices)} vertices; a hull needs 4 or more")
    hull = trimesh.convex.convex_hull(vertices)
    hull.density = density
    center = np.array(hull.center_mass)
    outer = np.array(hull.vertices)
    lowest = vertices[:, 2].min()
    base = outer[:, 2] < lowest + HULL.flat
    if base.sum() < 3:
        raise ValueError(f"{path}: its base has {base.sum()} vertices; level it")
    height = np.ptp(vertices[:, 2])
    kept = outer[outer[:, 2] < lowest + HULL.reach * height]
    origin = np.array([center[0], center[1], lowest])
    points = kept - origin
    points[points[:, 2] < HULL.flat, 2] = 0.0
    inward = -points[:, :2] / np.maximum(np.linalg.norm(points[:, :2], axis=1), 1e-9)[:, None]
    return Body(points, inward, float(hull.mass), center - origin, np.array(hull.moment_inertia))
