"""Mass properties against closed forms, and the convention of principal axes."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from vsr2.errors import GeometryError
from vsr2.scene import (
    Box,
    Hull,
    MassProperties,
    Pose,
    Triangles,
    aabb_mass_properties,
    box_mass_properties,
    load_mesh,
    mesh_mass_properties,
    principal_mass_properties,
)
from vsr2.scene.mass import principal_axes
from vsr2.scene.rotation import matrix_from_quaternion, matrix_from_rpy, quaternion_from_matrix

ROOT = Path(__file__).resolve().parents[2]
LAB = Path(os.environ.get("VSR2_LAB_DATA", ROOT.parent / "shared" / "lab")) / "models"
needs_lab = pytest.mark.skipif(
    not LAB.is_dir(), reason="laboratory meshes absent (set VSR2_LAB_DATA)"
)
angle = st.floats(-3.1, 3.1)


def test_box_closed_form_and_mesh_agree() -> None:
    size = (0.4, 0.55, 0.95)
    box = box_mass_properties(size, density=2500.0)
    assert box.mass == pytest.approx(2500.0 * 0.4 * 0.55 * 0.95, rel=1e-15)
    m = box.mass
    np.testing.assert_allclose(
        box.principal_inertia,
        [m * (0.55**2 + 0.95**2) / 12, m * (0.4**2 + 0.95**2) / 12, m * (0.4**2 + 0.55**2) / 12],
        rtol=1e-15,
    )
    mesh = mesh_mass_properties(trimesh.creation.box(extents=size), mass=m)
    np.testing.assert_allclose(mesh.principal_inertia, box.principal_inertia, rtol=1e-12)
    np.testing.assert_array_equal(mesh.principal_axes, np.eye(3))
    np.testing.assert_allclose(mesh.mass_center, 0.0, atol=1e-15)


def test_tetrahedron_closed_form() -> None:
    """Corner tetrahedron with legs a: centroid a/4; I_xx about it 3 m a^2 / 40 (Tonon 2004)."""
    a = 2.0
    corners = a * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    found = mesh_mass_properties(trimesh.Trimesh(corners, faces, process=False), density=3.0)
    mass = 3.0 * a**3 / 6.0
    assert found.mass == pytest.approx(mass, rel=1e-13)
    np.testing.assert_allclose(found.mass_center, a / 4, rtol=1e-13)
    tensor = found.principal_axes @ np.diag(found.principal_inertia) @ found.principal_axes.T
    np.testing.assert_allclose(np.diag(tensor), 3.0 * mass * a**2 / 40.0, rtol=1e-12)
    # Products of inertia about the centroid: m a^2 (1/20 - 1/16) = -m a^2 / 80, so +1/80 here.
    np.testing.assert_allclose(tensor[0, 1], mass * a**2 / 80.0, rtol=1e-12)


def test_a_distant_origin_costs_no_digits() -> None:
    near = trimesh.creation.box(extents=(0.4, 0.5, 0.9))
    shift = np.array([4096.0, -2048.0, 1024.0])
    far = trimesh.Trimesh(near.vertices + shift, near.faces, process=False)
    properties = mesh_mass_properties(far, mass=100.0)
    # Coordinates near 4096 m carry 5e-13 m, a relative 1e-12 of the edges.
    np.testing.assert_allclose(
        properties.principal_inertia,
        box_mass_properties((0.4, 0.5, 0.9), mass=100.0).principal_inertia,
        rtol=1e-11,
    )
    np.testing.assert_allclose(properties.mass_center, shift, atol=1e-11)


def test_aabb_rule_puts_the_mass_centre_at_the_model_origin() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]])
    found = aabb_mass_properties(12.0, (points,))
    np.testing.assert_array_equal(found.mass_center, 0.0)
    np.testing.assert_allclose(found.principal_inertia, [13.0, 10.0, 5.0])


@settings(max_examples=50, deadline=None)
@given(
    moments=st.tuples(*[st.floats(1.0, 1.99)] * 3),
    rpy=st.tuples(angle, angle, angle),
)
def test_principal_axes_diagonalise_and_are_closest_to_identity(
    moments: tuple[float, float, float], rpy: tuple[float, float, float]
) -> None:
    rotation = matrix_from_rpy(*rpy)
    tensor = rotation @ np.diag(moments) @ rotation.T
    found, axes = principal_axes(tensor)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    np.testing.assert_allclose(axes @ np.diag(found) @ axes.T, tensor, atol=1e-12)
    np.testing.assert_allclose(np.sort(found), np.sort(moments), rtol=1e-12)
    # No quarter turn about an own axis, and no cyclic exchange, comes closer to the identity.
    for turn in (
        np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
        np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
        np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]),
        np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]),
        np.diag([1.0, -1.0, -1.0]),
    ):
        for power in (turn, turn.T):
            assert np.trace(axes) >= np.trace(axes @ power) - 1e-6


def test_equal_moments_leave_no_arbitrary_turn() -> None:
    # Exactly equal moments, made visible to the solver by a turn about another axis.
    rotation = matrix_from_rpy(0.0, 0.3, 0.0)
    tensor = rotation @ np.diag([2.0, 2.0, 3.0]) @ rotation.T
    _, axes = principal_axes(tensor)
    # The axis of the odd moment is fixed; of all turns about it, the one taken is the closest.
    np.testing.assert_allclose(axes, rotation, atol=1e-9)
    np.testing.assert_array_equal(principal_axes(np.diag([2.0, 2.0, 2.0]))[1], np.eye(3))


def test_small_changes_do_not_swap_axes() -> None:
    rng = np.random.default_rng(2)
    rotation = matrix_from_rpy(0.2, -0.1, 0.3)
    tensor = rotation @ np.diag([1.5, 1.2, 1.4]) @ rotation.T
    _, axes = principal_axes(tensor)
    noise = rng.normal(scale=1e-6, size=(3, 3))
    _, changed = principal_axes(tensor + noise + noise.T)
    # Turn of eigenvectors: perturbation over the smallest gap, 0.1.
    np.testing.assert_allclose(changed, axes, atol=1e-4)


@pytest.mark.parametrize(
    ("tensor", "message"),
    [
        (np.diag([1.0, 1.0, 2.1]), "exceeds the sum"),
        (np.diag([1.0, 1.0, -0.5]), "positive"),
        (np.diag([1.0, 1.0, 0.0]), "positive"),
        (np.diag([1.0, np.nan, 1.0]), "not finite"),
    ],
)
def test_impossible_tensors_are_refused(tensor: np.ndarray, message: str) -> None:
    with pytest.raises(GeometryError, match=message) as caught:
        principal_mass_properties(1.0, np.zeros(3), tensor, "rock.urdf")
    assert "rock.urdf" in str(caught.value)


def test_a_lamina_is_possible() -> None:
    moments, _ = principal_axes(np.diag([1.0, 1.0, 2.0]))
    np.testing.assert_array_equal(moments, [1.0, 1.0, 2.0])


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_mass_and_density_must_be_positive(value: float) -> None:
    box = trimesh.creation.box()
    for arguments in ({"mass": value}, {"density": value}):
        with pytest.raises(GeometryError, match="positive"):
            mesh_mass_properties(box, **arguments)
        with pytest.raises(GeometryError, match="positive"):
            box_mass_properties((1.0, 1.0, 1.0), **arguments)
    with pytest.raises(GeometryError, match="exactly one"):
        mesh_mass_properties(box)
    with pytest.raises(GeometryError, match="exactly one"):
        box_mass_properties((1.0, 1.0, 1.0), mass=1.0, density=1.0)


@settings(max_examples=50, deadline=None)
@given(rpy=st.tuples(angle, angle, angle))
def test_quaternions_and_matrices_agree(rpy: tuple[float, float, float]) -> None:
    rotation = matrix_from_rpy(*rpy)
    quaternion = quaternion_from_matrix(rotation)
    assert sum(component**2 for component in quaternion) == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_allclose(matrix_from_quaternion(quaternion), rotation, atol=1e-14)


@needs_lab
def test_laboratory_specimen() -> None:
    loaded = load_mesh(LAB / "final_sp1_pca.obj")
    solid = mesh_mass_properties(loaded.mesh, mass=353.8)
    np.testing.assert_allclose(solid.principal_inertia, [11.8, 18.8, 25.2], atol=0.05)
    np.testing.assert_allclose(solid.principal_axes, np.eye(3), atol=1e-6)
    box = aabb_mass_properties(353.8, loaded.hull_points)
    # Bullet's values with its margins (a few millimetres on 0.4 to 1 m) are some per cent larger.
    np.testing.assert_allclose(box.principal_inertia, [22.9, 33.7, 46.5], rtol=0.025)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"principal_inertia": np.ones((3, 1))}, r"principal_inertia has shape \(3, 1\)"),
        ({"principal_inertia": np.ma.array(np.ones(3), mask=[0, 1, 0])}, "is a masked array"),
        ({"mass_center": np.zeros((1, 3))}, "mass_center has shape"),
        ({"mass_center": ["0", "0", "0"]}, "not an array of numbers"),
        ({"principal_axes": np.eye(3, dtype=bool)}, "but of bool"),
        ({"principal_axes": np.eye(9)}, r"it needs \(3, 3\)"),
        ({"mass": "1"}, "mass is not an array of numbers"),
        ({"mass": np.ones(1)}, r"mass has shape \(1,\)"),
    ],
)
def test_properties_that_the_hash_would_not_tell_apart_are_refused(
    changes: dict[str, object], message: str
) -> None:
    fields = {"mass": 1.0, "mass_center": np.zeros(3), "principal_inertia": np.ones(3),
              "principal_axes": np.eye(3)}  # fmt: skip
    MassProperties(**fields)
    with pytest.raises(GeometryError, match=message):
        MassProperties(**{**fields, **changes})


@pytest.mark.parametrize(
    "make",
    [
        lambda: Pose(("0", "0", "0"), (0.0, 0.0, 0.0, 1.0)),
        lambda: Pose((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        lambda: Box((1.0, True, 1.0)),
        lambda: Box(np.ma.array(np.ones(3), mask=[0, 1, 0])),
        lambda: Hull(np.ones((3, 4, 1))),
        lambda: Hull(np.ones((4, 3), complex)),
        lambda: Triangles(np.ma.array(np.ones((3, 3))), np.array([[0, 1, 2]])),
        lambda: Triangles(np.ones((3, 3)), np.array([[0.0, 1.0, 2.0]])),
        lambda: Triangles(np.ones((3, 3)), np.array([0, 1, 2])),
    ],
)
def test_bodies_of_anything_but_real_numbers_are_refused(make: Callable[[], object]) -> None:
    with pytest.raises(GeometryError, match=r"not an array of|masked array|has shape"):
        make()
