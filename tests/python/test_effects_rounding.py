"""The opening of a convex body by a ball."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from vsr2.effects.rounding import rounded_hull
from vsr2.errors import GeometryError
from vsr2.scene import Box
from vsr2.scene.shapes import box_corners

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
