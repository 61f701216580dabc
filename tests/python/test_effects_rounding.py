"""The opening of a convex body by a ball."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from vsr2.effects import effect
from vsr2.effects.geometry import box_with_margin
from vsr2.effects.rounding import rounded_hull
from vsr2.errors import GeometryError
from vsr2.scene import Box, Hull, Pose
from vsr2.scene.shapes import box_corners
from vsr2.simulation.bench import EffectBench

CORNERS = box_corners(Box(size=(0.4, 0.6, 1.2)))
DOWN = np.array([0.0, 0.0, -1.0])


def support(points: np.ndarray, direction: np.ndarray) -> float:
    return float((points @ direction).max())


@pytest.mark.parametrize("radius", [0.002, 0.015, 0.1])
def test_support_function_of_a_rounded_block(radius: float) -> None:
    # Opening: the eroded block's support function plus the radius.
    points = rounded_hull(CORNERS, radius, DOWN)
    half = np.array([0.2, 0.3, 0.6]) - radius
    for tilt in np.radians([0.0, 0.5, 3.0, 10.0, 30.0, 43.0]):
        for azimuth in np.radians([0.0, 20.0, 90.0, 215.0]):
            level = np.sin(tilt)
            direction = np.array([level * np.cos(azimuth), level * np.sin(azimuth), -np.cos(tilt)])
            exact = float(np.abs(direction) @ half) + radius
            # Directions lie 4 degrees apart: at most 1 - cos 3 degrees short of the ball.
            assert -1e-9 <= exact - support(points, direction) <= 0.0014 * radius + 1e-9


def test_the_top_stays_sharp_and_inside() -> None:
    points = rounded_hull(CORNERS, 0.015, DOWN)
    assert support(points, np.array([0.6, 0.0, 0.8])) == pytest.approx(0.6 * 0.2 + 0.8 * 0.6)
    planes = ConvexHull(CORNERS).equations
    assert (points @ planes[:, :3].T + planes[:, 3]).max() <= 1e-12


def test_small_radii_give_the_hull_back() -> None:
    rng = np.random.default_rng(3)
    cloud = rng.standard_normal((200, 3)) * [0.3, 0.3, 0.6]
    points = rounded_hull(cloud, 1e-6, DOWN)
    directions = rng.standard_normal((400, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    # A corner of opening angle t recedes by r (1 / sin(t / 2) - 1) at most; sharp corners of a
    # random cloud are no sharper than a tenth.
    away = (cloud @ directions.T).max(axis=0) - (points @ directions.T).max(axis=0)
    assert away.min() > -1e-9
    assert away.max() < 2e-5


def test_the_engine_s_margin_completes_the_ball() -> None:
    complete = rounded_hull(CORNERS, 0.01, DOWN)
    inner = rounded_hull(CORNERS, 0.01, DOWN, ball=0.009)
    for direction in (DOWN, np.array([0.6, 0.0, -0.8]), np.array([0.0, 0.28, -0.96])):
        assert support(inner, direction) + 0.001 == pytest.approx(
            support(complete, direction), abs=2e-5
        )
    up = np.array([0.0, 0.0, 1.0])
    assert support(inner, up) + 0.001 == pytest.approx(support(complete, up))


def test_a_ball_that_does_not_fit_is_refused() -> None:
    with pytest.raises(GeometryError, match="does not fit"):
        rounded_hull(CORNERS, 0.25, DOWN)


# --- as the effect of a trial --------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["exact", "fast"])
@pytest.mark.parametrize(
    ("name", "parameter"), [("edge_rounding", "radius"), ("base_asperity", "height")]
)
def test_small_roundings_and_bumps_stand_on_the_base_of_the_box(
    name: str, parameter: str, mode: Literal["exact", "fast"]
) -> None:
    # The engine's margin around a hull must not narrow the base: 1 mm would be 0.5 %. On bumps the
    # block first tips by height over the distance of tip and edge.
    bench = EffectBench(mode)
    block = bench.block()
    threshold = block.scene.engine.gravity * 0.2 / 0.6
    tipped = [
        float(
            bench.run(
                replace(block, motion=bench.push(share * threshold)),
                effect(name), {parameter: 1e-5},
            ).tilt[:700].max()
        )
        for share in (0.65, 0.997, 1.006)
    ]  # fmt: skip
    assert tipped[0] < 1e-4
    assert tipped[2] > 3e-3
    if name == "edge_rounding":
        assert tipped[1] < 1e-4


def test_a_rounding_is_continuous_at_the_margin() -> None:
    block = EffectBench().block()
    margin = block.scene.engine.collision_margin
    below, above = (
        effect("edge_rounding").change(block, {"radius": margin * share}).scene.rock.parts[0]
        for share in (1 - 1e-9, 1)
    )
    assert isinstance(below, Hull)
    assert isinstance(above, Hull)
    for point in above.points:
        assert np.linalg.norm(below.points - point, axis=1).min() < 1e-9


def test_a_rounding_below_the_margin_narrows_the_base_of_a_box_on_its_side() -> None:
    box = Box(size=(1.2, 0.6, 0.4), center=(0.0, 0.1, 0.0))
    block = EffectBench().block()
    half = math.sqrt(0.5)
    lying = replace(block, start=Pose(block.start_pose.position, (0.0, half, 0.0, half)))
    points = box_with_margin(box, lying, 4e-4)
    assert np.ptp(points, axis=0) == pytest.approx([1.198, 0.5992, 0.3992])
