"""Rotations: quaternions x, y, z, w and matrices. Names carry frames: R_WM takes M to W.

Start poses, principal axes and collision points reach the core through these lines. scipy's
rotations differ from them in the last bits (docs/architecture.md, "Kept libraries"), which a
chaotic response enlarges, so they are written out.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vsr2.config.section import MAX_NORM_ERROR
from vsr2.errors import GeometryError
from vsr2.scene.body import Array, Pose

Quaternion = tuple[float, float, float, float]
IDENTITY: Quaternion = (0.0, 0.0, 0.0, 1.0)
"""No rotation; x, y, z, w."""
ALONG = 0.9
"""Component of a unit vector along x from which another axis is taken to cross it with."""


def check_unit(quaternion: Quaternion, name: str) -> None:
    """Refuse a quaternion that is not of unit length (within `MAX_NORM_ERROR`).

    Raises:
        GeometryError: naming `name`, the value and the remedy.
    """
    norm = math.sqrt(sum(component * component for component in quaternion))
    if not abs(norm - 1.0) <= MAX_NORM_ERROR:
        raise GeometryError(
            f"{name}: quaternion {quaternion} has length {norm:g}, not 1; "
            "give x, y, z, w (w last) and divide by the length"
        )


def normalized(quaternion: Quaternion, name: str = "orientation") -> Quaternion:
    """Return the quaternion at unit length; a unit one comes back unchanged to the last bit.

    Raises:
        GeometryError: its length is not 1 within `MAX_NORM_ERROR`.
    """
    check_unit(quaternion, name)
    squared = sum(component * component for component in quaternion)
    if squared == 1.0:
        return quaternion
    norm = math.sqrt(squared)
    x, y, z, w = quaternion
    return (x / norm, y / norm, z / norm, w / norm)


def multiply(first: Quaternion, second: Quaternion) -> Quaternion:
    """Hamilton product: the rotation `second` followed by `first` (both about fixed axes)."""
    x1, y1, z1, w1 = first
    x2, y2, z2, w2 = second
    return (
        w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
        w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
        w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
        w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
    )


def quaternion_product(a: Array, b: Array) -> Array:
    """Hamilton product of arrays of quaternions x, y, z, w, shapes (..., 4); see `multiply`."""
    return np.stack(multiply(_components(a), _components(b)), axis=-1)


def _components(q: Array) -> tuple[Any, Any, Any, Any]:
    return (q[..., 0], q[..., 1], q[..., 2], q[..., 3])


def conjugate(q: Array) -> Array:
    """The inverse of unit quaternions x, y, z, w, shape (..., 4)."""
    inverse: Array = q * np.array([-1.0, -1.0, -1.0, 1.0])
    return inverse


def rotate(q: Array, v: Array) -> Array:
    """Rotates vectors v (..., 3) by unit quaternions q (..., 4)."""
    u, w = q[..., :3], q[..., 3:]
    t = 2.0 * np.cross(u, v)
    return v + w * t + np.cross(u, t)


def axis_aside(direction: Array) -> Array:
    """The x axis, or the y axis where a unit vector points along x: one that is not along it."""
    axis: Array = np.eye(3)[int(abs(direction[0]) >= ALONG)]
    return axis


def yaw_quaternion(yaw: float) -> Quaternion:
    """Rotation about z by `yaw` [rad]."""
    return (0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw))


def matrix_from_quaternion(quaternion: Quaternion) -> Array:
    """Rotation matrix of a quaternion of any length but 0, shape (3, 3)."""
    x, y, z, w = quaternion
    s = 2.0 / (x * x + y * y + z * z + w * w)
    return np.array(
        [
            [1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
            [s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w)],
            [s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y)],
        ]
    )


def quaternion_from_matrix(rotation: Array) -> Quaternion:
    """Quaternion with w >= 0 of a rotation matrix (3, 3).

    Shepperd's method (J. Guidance and Control 1, 1978): divides by the largest component, so that
    half turns keep their precision.
    """
    r = np.asarray(rotation, dtype=np.float64)
    trace = r[0, 0] + r[1, 1] + r[2, 2]
    largest = int(np.argmax([r[0, 0], r[1, 1], r[2, 2], trace]))
    if largest == 3:
        q = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], 1.0 + trace])
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        q = np.empty(4)
        q[i] = 1.0 + r[i, i] - r[j, j] - r[k, k]
        q[j] = r[j, i] + r[i, j]
        q[k] = r[k, i] + r[i, k]
        q[3] = r[k, j] - r[j, k]
    q /= np.linalg.norm(q)
    if q[3] < 0:
        q = -q
    return (float(q[0]), float(q[1]), float(q[2]), float(q[3]))


def matrix_from_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Rotation by roll, pitch, yaw [rad] about the fixed axes x, y, z in this order (URDF)."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def transform_points(pose: Pose, points: Array) -> Array:
    """Points of the moved frame in the fixed frame, shape (n, 3) [m].

    Written out, because the last bit of a library's matrix product depends on processor and number
    of threads, and a start pose must not.
    """
    x, y, z = points[:, 0], points[:, 1], points[:, 2]
    moved = np.empty((3, len(points)))
    rows = matrix_from_quaternion(pose.orientation).tolist()
    for out, (along_x, along_y, along_z), origin in zip(moved, rows, pose.position, strict=True):
        np.multiply(x, along_x, out=out)
        out += y * along_y
        out += z * along_z
        out += origin
    return moved.T
