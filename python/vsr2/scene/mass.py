"""Mass properties: of the homogeneous solid inside a mesh, of a box, of a given tensor.

Principal axes: of the 24 right-handed ways to number and sign the eigenvectors of the inertia
tensor, the one closest to the reference axes (greatest trace of the rotation matrix; for equal
moments the free rotation is used up for the same aim) is taken. So a body that is aligned already
keeps its axes, and small changes of a mesh never swap them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import permutations, product

import numpy as np

from vsr2.errors import GeometryError
from vsr2.read_only import real_argument
from vsr2.scene.body import Array, MassProperties
from vsr2.scene.mesh_files import IntArray

DIAGONAL_TOLERANCE = 1.0e-12
"""Products of inertia below this share of the tensor's trace are rounding errors."""
EQUAL_MOMENTS = 1.0e-9
"""Principal moments closer than this share of the largest are equal."""
TRIANGLE_TOLERANCE = 1.0e-6
"""A lamina fulfils I1 + I2 = I3 exactly, so the inequality is checked with this slack."""


def mesh_mass_properties(
    mesh: object,
    *,
    density: float | None = None,
    mass: float | None = None,
    source: str = "mesh",
) -> MassProperties:
    """Mass properties of the homogeneous solid inside a closed mesh.

    Volume, mass centre and inertia tensor are the exact polynomial integrals over the polyhedron
    as trimesh computes them (Eberly, Polyhedral Mass Properties, 2002), here about the centre of
    the bounding box so that a distant origin costs no digits.

    Args:
        mesh: trimesh mesh, closed and oriented outwards [m].
        density: [kg/m^3]; give this or `mass`.
        mass: [kg].
        source: named in errors.

    Raises:
        GeometryError: not exactly one of density and mass, not positive, or no volume.
    """
    volume, mass_center, unit_tensor = solid_properties(mesh, source)
    mass = _mass(source, density, mass, (volume,))
    return principal_mass_properties(mass, mass_center, unit_tensor * (mass / volume), source)


def solid_properties(mesh: object, source: str = "mesh") -> tuple[float, Array, Array]:
    """Volume [m^3], centroid (3,) [m] and inertia tensor about it at unit density (3, 3) [m^5].

    Raises:
        GeometryError: the volume is not positive.
    """
    from trimesh.triangles import mass_properties

    vertices = np.asarray(mesh.vertices, dtype=np.float64)  # type: ignore[attr-defined]
    faces: IntArray = np.asarray(mesh.faces, dtype=np.int64)  # type: ignore[attr-defined]
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    with np.errstate(all="ignore"):
        found = mass_properties((vertices - middle)[faces], density=1.0, skip_inertia=False)
    volume = float(found["volume"])
    if not volume > 0:
        raise GeometryError(
            f"{source}: the volume is {volume:g} m^3; the mesh must be closed with its faces "
            "pointing outwards (`repair: true`)"
        )
    centroid: Array = np.asarray(found["center_mass"], dtype=np.float64) + middle
    return volume, centroid, np.asarray(found["inertia"], dtype=np.float64)


def box_mass_properties(
    size: tuple[float, float, float],
    *,
    density: float | None = None,
    mass: float | None = None,
    source: str = "box",
) -> MassProperties:
    """Mass properties of a homogeneous box about its centre: I_x = m (l_y^2 + l_z^2) / 12.

    Args:
        size: edge lengths [m].
        density: [kg/m^3]; give this or `mass`.
        mass: [kg].
        source: named in errors.

    Raises:
        GeometryError: not exactly one of density and mass, or not positive.
    """
    for edge in size:
        _check_positive(source, "edge length", edge, "m")
    return _box_about_origin(_mass(source, density, mass, size), size)


def box_inertia(mass: float, size: tuple[float, float, float] | Array) -> Array:
    """Principal moments of a homogeneous box, shape (3,) [kg m^2]."""
    x, y, z = (float(edge) for edge in size)
    return mass / 12.0 * np.array([y * y + z * z, x * x + z * z, x * x + y * y])


def aabb_mass_properties(
    mass: float, points: tuple[Array, ...], source: str = "mesh"
) -> MassProperties:
    """The original's rule: mass centre at the model origin, inertia of the bounding box.

    The core recomputes the inertia with Bullet, whose box is wider by collision margins; the
    values here leave the margins out and serve display only.

    Args:
        mass: [kg].
        points: collision points in the model frame, each of shape (k, 3) [m].
        source: named in errors.

    Raises:
        GeometryError: the mass is not positive.
    """
    _check_positive(source, "mass", mass, "kg")
    return _box_about_origin(mass, np.ptp(np.vstack(points), axis=0))


def _mass(
    source: str, density: float | None, mass: float | None, lengths: Sequence[float]
) -> float:
    """The mass given, or density times the product of `lengths` from left to right."""
    if (density is None) == (mass is None):
        raise GeometryError(f"{source}: give exactly one of density [kg/m^3] and mass [kg]")
    if mass is None:
        assert density is not None
        _check_positive(source, "density", density, "kg/m^3")
        mass = math.prod(lengths, start=density)
    _check_positive(source, "mass", mass, "kg")
    return mass


def _box_about_origin(mass: float, size: tuple[float, float, float] | Array) -> MassProperties:
    return MassProperties(mass, np.zeros(3), box_inertia(mass, size), np.eye(3))


def principal_mass_properties(
    mass: float, mass_center: Array, tensor: Array, source: str
) -> MassProperties:
    """Mass properties from an inertia tensor about the mass centre along the model axes.

    Args:
        mass: [kg].
        mass_center: in the model frame, shape (3,) [m].
        tensor: symmetric, shape (3, 3) [kg m^2].
        source: named in errors.

    Raises:
        GeometryError: mass or moments not positive, or no body can have such moments.
    """
    _check_positive(source, "mass", mass, "kg")
    moments, axes = principal_axes(tensor, source)
    return MassProperties(
        mass=mass,
        mass_center=mass_center,
        principal_inertia=moments,
        principal_axes=axes,
    )


def principal_axes(tensor: Array, source: str = "inertia tensor") -> tuple[Array, Array]:
    """Principal moments (3,) [kg m^2] and axes (3, 3), columns, right-handed, closest to identity.

    A tensor that is diagonal already comes back to the last bit, with identity axes.

    Raises:
        GeometryError: not finite, not positive, or against the triangle inequality
            I1 <= I2 + I3 that the moments of every body fulfil.
    """
    given = real_argument(tensor, f"{source}: the inertia tensor", GeometryError)
    symmetric = 0.5 * (given + given.T)
    if symmetric.shape != (3, 3) or not np.isfinite(symmetric).all():
        raise GeometryError(f"{source}: the inertia tensor {symmetric.tolist()} is not finite")
    off_diagonal = np.abs(symmetric[np.triu_indices(3, 1)]).max()
    if off_diagonal <= DIAGONAL_TOLERANCE * np.abs(np.trace(symmetric)):
        moments, axes = np.diag(symmetric).copy(), np.eye(3)
    else:
        values, vectors = np.linalg.eigh(symmetric)
        moments, axes = _closest_to_identity(values, vectors)
    _check_moments(moments, source)
    return moments, axes


def _closest_to_identity(values: Array, vectors: Array) -> tuple[Array, Array]:
    best, best_trace = (values, vectors), -np.inf
    for order in permutations(range(3)):
        chosen = _turn_equal(values[list(order)], vectors[:, list(order)])
        for signs in product((1.0, -1.0), repeat=3):
            axes = chosen * np.array(signs)
            if np.linalg.det(axes) < 0:
                continue
            # The slack lets the first of equals win, whatever the rounding.
            if np.trace(axes) > best_trace + 1e-9:
                best, best_trace = (values[list(order)], axes), float(np.trace(axes))
    return best[0].copy(), best[1].copy()


def _turn_equal(values: Array, vectors: Array) -> Array:
    """Turn eigenvectors of equal moments within their space towards the axes they stand for."""
    result = vectors.copy()
    scale = np.abs(values).max()
    for group in ([0, 1, 2], [0, 1], [0, 2], [1, 2]):
        if np.ptp(values[group]) <= EQUAL_MOMENTS * scale:
            left, _, right = np.linalg.svd(vectors[group][:, group])
            result[:, group] = vectors[:, group] @ (left @ right).T
            break
    return result


def _check_moments(moments: Array, source: str) -> None:
    if not (moments > 0).all():
        raise GeometryError(
            f"{source}: principal moments of inertia {moments.tolist()} kg m^2 must be positive; "
            "check <inertia>, or compute it from the mesh (`inertia: mesh`)"
        )
    largest = float(moments.max())
    rest = float(moments.sum()) - largest
    if largest > rest * (1.0 + TRIANGLE_TOLERANCE):
        raise GeometryError(
            f"{source}: principal moments of inertia {moments.tolist()} kg m^2: the largest "
            "exceeds the sum of the others, which no body can have; check units and signs of "
            "<inertia>, or compute it from the mesh (`inertia: mesh`)"
        )


def _check_positive(source: str, name: str, value: float, unit: str) -> None:
    if not (np.isfinite(value) and value > 0):
        raise GeometryError(f"{source}: {name} {value:g} {unit} must be positive")
