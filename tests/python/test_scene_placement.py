"""Start poses: even tops in closed form, any surface against linear programming."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from vsr2.config.study import FixedStart, YawStart
from vsr2.errors import GeometryError
from vsr2.scene import (
    Box,
    Hull,
    MassProperties,
    PedestalBody,
    Pose,
    Triangles,
    box_mass_properties,
    drop_height,
    height_above,
    heights_above,
    start_pose,
)
from vsr2.scene.placement import stands_over
from vsr2.scene.rotation import matrix_from_quaternion, quaternion_from_matrix, transform_points
from vsr2.scene.shapes import part_points, pedestal_surface

SIZE = (0.4, 0.6, 1.0)


def prism(size: tuple[float, float, float] = (4.0, 4.0, 0.5)) -> PedestalBody:
    return PedestalBody(
        parts=(Box(size),),
        origin=(0.0, 0.0, 2.0 + 0.5 * size[2]),
        top=2.0 + size[2],
        mass=1e5,
        base_size=(10.0, 10.0, 2.0),
    )


def terrain(vertices: np.ndarray, faces: np.ndarray) -> PedestalBody:
    surface = Triangles(np.asarray(vertices, dtype=float), np.asarray(faces, dtype=np.int32))
    return PedestalBody(
        parts=(surface,),
        origin=(0.0, 0.0, 2.0),
        top=2.0 + float(surface.vertices[:, 2].max()),
        mass=1e5,
        base_size=(10.0, 10.0, 2.0),
    )


@pytest.mark.parametrize("yaw", [0.0, 30.0, 90.0, -135.0])
def test_upright_block_stands_on_the_top_with_the_gap(yaw: float) -> None:
    mass = box_mass_properties(SIZE, mass=1.0)
    pose = start_pose(
        YawStart(yaw=yaw, position_xy=(0.3, -0.2)), (Box(SIZE),), mass, prism(), clearance=0.002
    )
    np.testing.assert_allclose(pose.position, [0.3, -0.2, 2.5 + 0.002 + 0.5], atol=1e-14)
    axis = matrix_from_quaternion(pose.orientation)[:, 0]
    np.testing.assert_allclose(
        axis, [math.cos(math.radians(yaw)), math.sin(math.radians(yaw)), 0.0], atol=1e-15
    )


def test_base_orientation_comes_before_the_turn() -> None:
    # x up first, then a quarter turn: the model's x axis stays up, whatever the yaw.
    up = quaternion_from_matrix(np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]))
    mass = box_mass_properties(SIZE, mass=1.0)
    start = YawStart(yaw=90.0, base_orientation=up)
    pose = start_pose(start, (Box(SIZE),), mass, prism(), clearance=0.0)
    rotation = matrix_from_quaternion(pose.orientation)
    np.testing.assert_allclose(rotation[:, 0], [0.0, 0.0, 1.0], atol=1e-15)
    np.testing.assert_allclose(rotation[:, 1], [-1.0, 0.0, 0.0], atol=1e-15)
    assert pose.position[2] == pytest.approx(2.5 + 0.5 * SIZE[0], abs=1e-14)


def test_the_mass_centre_not_the_model_origin_stands_at_position_xy() -> None:
    center = np.array([0.1, 0.05, -0.2])
    mass = MassProperties(1.0, center, np.ones(3), np.eye(3))
    pose = start_pose(
        YawStart(yaw=77.0, position_xy=(0.5, 0.25)), (Box(SIZE),), mass, prism(), clearance=0.0
    )
    np.testing.assert_allclose(transform_points(pose, center[None])[0, :2], [0.5, 0.25], atol=1e-14)


def test_yaw_turns_the_placed_rock_rigidly_about_the_mass_centre() -> None:
    rng = np.random.default_rng(5)
    part = Hull(rng.normal(size=(30, 3)) * 0.2)
    mass = MassProperties(1.0, part.points.mean(axis=0), np.ones(3), np.eye(3))
    poses = [
        start_pose(YawStart(yaw=yaw), (part,), mass, prism(), clearance=0.002)
        for yaw in (0.0, 65.0)
    ]
    first, second = (transform_points(pose, part.points) for pose in poses)
    turn = matrix_from_quaternion(
        (0.0, 0.0, math.sin(math.radians(32.5)), math.cos(math.radians(32.5)))
    )
    np.testing.assert_allclose(second, first @ turn.T, atol=1e-13)


def test_fixed_start_is_taken_to_the_last_bit() -> None:
    # The original's quaternion: 1e-6 off unit length, and kept so.
    quaternion = (0.86766, 0.06594, 0.4791, 0.11521)
    start = FixedStart(mode="pose", position=(0.0, 0.0, 2.78), orientation=quaternion)
    pose = start_pose(
        start, (Box(SIZE),), box_mass_properties(SIZE, mass=1.0), prism(), clearance=0.002
    )
    assert pose.orientation == quaternion
    assert pose.position == (0.0, 0.0, 2.78)


@pytest.mark.parametrize("quaternion", [(1.0, 1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)])
def test_quaternions_must_have_unit_length(
    quaternion: tuple[float, float, float, float],
) -> None:
    mass = box_mass_properties(SIZE, mass=1.0)
    # The configuration refuses them too; bodies built in Python may come without it.
    for start in (
        FixedStart.model_construct(position=(0.0, 0.0, 5.0), orientation=quaternion),
        YawStart.model_construct(base_orientation=quaternion),
    ):
        with pytest.raises(GeometryError, match="length"):
            start_pose(start, (Box(SIZE),), mass, prism(), clearance=0.0)


def test_beside_the_pedestal_is_an_error() -> None:
    mass = box_mass_properties(SIZE, mass=1.0)
    with pytest.raises(GeometryError, match=r"no pedestal under the rock.*x -2 to 2 m"):
        start_pose(YawStart(position_xy=(5.0, 0.0)), (Box(SIZE),), mass, prism(), clearance=0.0)
    assert stands_over(prism(), 1.9, -1.9)
    assert not stands_over(prism(), 2.1, 0.0)


def test_overhanging_a_prism_touches_its_edge() -> None:
    """A block on its edge, that edge beyond the rim: the slanted face meets the rim."""
    mass = box_mass_properties((1.0, 1.0, 1.0), mass=1.0)
    half = math.radians(45.0) / 2.0
    tilt = (0.0, math.sin(half), 0.0, math.cos(half))
    pose = start_pose(
        YawStart(base_orientation=tilt, position_xy=(2.2, 0.0)),
        (Box((1.0, 1.0, 1.0)),),
        mass,
        prism(),
        clearance=0.0,
    )
    # The lowest edge hangs at x = 2.2; at the rim, x = 2, the face is 0.2 higher (45 degrees).
    assert pose.position[2] == pytest.approx(2.5 + math.sqrt(0.5) - 0.2, abs=1e-12)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_drop_height_against_linear_programming(seed: int) -> None:
    """Any hull, any triangles: max over one triangle and one hull of z_T - z_H at equal x, y."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(10, 3))
    vertices = rng.uniform(-1.5, 1.5, size=(9, 3))
    faces = np.array([rng.choice(9, size=3, replace=False) for _ in range(6)])
    expected = -math.inf
    for face in faces:
        corners = vertices[face]
        solved = linprog(
            np.concatenate([-corners[:, 2], points[:, 2]]),
            A_eq=np.vstack(
                [
                    np.hstack([corners[:, :2].T, -points[:, :2].T]),
                    [1.0] * 3 + [0.0] * 10,
                    [0.0] * 3 + [1.0] * 10,
                ]
            ),
            b_eq=[0.0, 0.0, 1.0, 1.0],
        )
        if solved.status == 0:
            expected = max(expected, -solved.fun)
    found = drop_height(points, Triangles(vertices, faces.astype(np.int32)))
    if expected == -math.inf:
        assert found is None
    else:
        # The solver's feasibility tolerance is 1e-7, on slopes of a few tens.
        assert found == pytest.approx(expected, abs=1e-5)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), chunk=st.sampled_from([7, 10**6]))
def test_drop_height_does_not_depend_on_chunks(seed: int, chunk: int) -> None:
    from vsr2.scene import placement

    rng = np.random.default_rng(seed)
    points = rng.normal(size=(20, 3))
    vertices = rng.uniform(-1.5, 1.5, size=(20, 3))
    faces = np.array([rng.choice(20, size=3, replace=False) for _ in range(30)], dtype=np.int32)
    surface = Triangles(vertices, faces)
    reference = drop_height(points, surface)
    before = placement._PAIRS
    placement._PAIRS = chunk
    try:
        assert drop_height(points, surface) == reference
    finally:
        placement._PAIRS = before


@pytest.mark.parametrize("slope", [0.0, 0.2, 0.6])
def test_gap_is_kept_along_the_normal(slope: float) -> None:
    corners = np.array([[x, y, slope * x + 1.0] for x in (-3.0, 3.0) for y in (-3.0, 3.0)])
    ground = terrain(corners, np.array([[0, 2, 3], [0, 3, 1]]))
    mass = box_mass_properties(SIZE, mass=1.0)
    clearance = 0.01
    pose = start_pose(YawStart(yaw=20.0), (Box(SIZE),), mass, ground, clearance=clearance)
    from vsr2.scene.shapes import box_corners

    placed = transform_points(pose, box_corners(Box(SIZE)))
    gap = (placed[:, 2] - slope * placed[:, 0] - 3.0) / math.hypot(1.0, slope)
    assert clearance * 0.985 <= gap.min() <= clearance * (1 + 1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_a_sloping_box_carries_as_its_surface_does(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turned = rng.permutation(np.eye(3))  # any face on top, handed either way
    tilt = matrix_from_quaternion((*rng.uniform(-0.2, 0.2, 3), 1.0))
    axes = tilt @ turned * np.linalg.det(turned)
    flat = prism()
    box = Box((4.0, 4.5, 5.0), (0.1, 0.2, 0.3), quaternion_from_matrix(axes))
    sloping = replace(flat, parts=(box,))
    parts = (Hull(rng.uniform(-0.5, 0.5, (40, 3))), Box(SIZE))
    for x in (0.0, 2.0, 2.4):  # over the face, over its rim, beside it in part
        pose = Pose((x, 0.0, 9.0), quaternion_from_matrix(tilt))
        placed = [transform_points(pose, points) for points in part_points(parts)]
        lifts = [drop_height(points, pedestal_surface(sloping)) for points in placed]
        expected = max(lift for lift in lifts if lift is not None)
        assert height_above(parts, pose, sloping) == pytest.approx(-expected, abs=1e-13)


def test_a_point_under_the_flat_of_the_rock_carries_it() -> None:
    """A pin below the base: only the reverse test (surface vertex against hull face) sees it."""
    pin = np.array([[0.01, 0.0, 0.5], [-0.01, 0.01, 0.1], [-0.01, -0.01, 0.1]])
    floor = np.array([[-3.0, -3, 0], [3, -3, 0], [0, 4, 0]])
    ground = terrain(np.vstack([floor, pin]), np.array([[0, 1, 2], [3, 4, 5]]))
    pose = start_pose(
        YawStart(), (Box(SIZE),), box_mass_properties(SIZE, mass=1.0), ground, clearance=0.0
    )
    assert pose.position[2] == pytest.approx(2.0 + 0.5 + 0.5, abs=1e-12)


def test_crossing_edges_carry() -> None:
    """A ridge along x under a block on its edge along y: they meet where the edges cross."""
    ridge = np.array([[-3.0, 0, 1], [3, 0, 1], [-3, -2, 0], [3, -2, 0], [-3, 2, 0], [3, 2, 0]])
    ground = terrain(ridge, np.array([[0, 3, 1], [0, 2, 3], [0, 1, 5], [0, 5, 4]]))
    half = math.radians(45.0) / 2.0
    tilt = (0.0, math.sin(half), 0.0, math.cos(half))
    pose = start_pose(
        YawStart(base_orientation=tilt),
        (Box((1.0, 1.0, 1.0)),),
        box_mass_properties((1.0, 1.0, 1.0), mass=1.0),
        ground,
        clearance=0.0,
    )
    assert pose.position[2] == pytest.approx(2.0 + 1.0 + math.sqrt(0.5), abs=1e-12)


def test_height_above_measures_gap_and_penetration() -> None:
    mass = box_mass_properties(SIZE, mass=1.0)
    pose = start_pose(YawStart(), (Box(SIZE),), mass, prism(), clearance=0.25)
    assert height_above((Box(SIZE),), pose, prism()) == pytest.approx(0.25, abs=1e-13)
    ball = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
    points = np.array(ball.vertices) + np.array([0.0, 0.0, 3.0])
    low = type(pose)((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    assert height_above((Hull(points),), low, prism()) == pytest.approx(-0.5, abs=1e-12)
    away = type(pose)((50.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    assert height_above((Hull(points),), away, prism()) is None


@pytest.mark.parametrize("top", [4.0, 1.2, 0.5], ids=["even", "overhung by some", "overhung"])
def test_heights_of_many_poses_are_those_of_each(top: float) -> None:
    rng = np.random.default_rng(1)
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.5)
    parts = (Box(SIZE, center=(0.1, 0.0, 0.2)), Hull(np.array(ball.vertices)))
    poses = []
    for axes in rng.normal(size=(40, 4)):
        x, y, z, w = (axes / np.linalg.norm(axes)).tolist()
        at_x, at_y, at_z = (np.array([0.0, 0.0, 3.5]) + 0.3 * rng.normal(size=3)).tolist()
        poses.append(Pose((at_x, at_y, at_z), (x, y, z, w)))
    pedestal = prism((top, top, 0.5))
    # Starts are to be the same to the last bit, whether they are found together or alone.
    found = heights_above(parts, poses, pedestal)
    assert found == [height_above(parts, pose, pedestal) for pose in poses]
