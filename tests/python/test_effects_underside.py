"""Other undersides of a convex body, and the effect `support` that is made of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from vsr2.effects import apply_effects
from vsr2.effects.underside import flattened, narrowed, settled_down, smoothed
from vsr2.errors import GeometryError
from vsr2.scene import Box, Hull
from vsr2.scene.rotation import matrix_from_quaternion
from vsr2.scene.shapes import box_corners
from vsr2.simulation.bench import EffectBench

CORNERS = box_corners(Box(size=(0.4, 0.6, 1.2)))
DOWN = np.array([0.0, 0.0, -1.0])


def turned(degrees: float) -> np.ndarray:
    """Rotation about y."""
    half = np.radians(degrees) / 2
    return matrix_from_quaternion((0.0, float(np.sin(half)), 0.0, float(np.cos(half))))


def cloud() -> np.ndarray:
    rng = np.random.default_rng(3)
    points = rng.standard_normal((300, 3))
    return points / np.linalg.norm(points, axis=1)[:, None] * [0.3, 0.35, 0.5]


def polygon(points: np.ndarray, down: np.ndarray) -> np.ndarray:
    """Equations of the edges of the face that a body settles on, in plan."""
    reach = points @ down
    first = np.cross(down, [1.0, 0.3, 0.2])
    first /= np.linalg.norm(first)
    axes = np.column_stack([first, np.cross(down, first)])
    edges = ConvexHull(points[reach > reach.max() - 1e-7] @ axes).equations
    return edges[np.lexsort(np.round(edges[:, :2], 6).T)]


@pytest.mark.parametrize(
    ("degrees", "onto"), [(0.0, 2), (10.0, 2), (18.0, 2), (19.0, 0), (60.0, 0)]
)
def test_a_tilted_block_settles_on_the_face_over_which_its_mass_centre_lies(
    degrees: float, onto: int
) -> None:
    # tan(alpha) = 1/3, 18.4 degrees.
    down = settled_down(CORNERS, np.zeros(3), turned(degrees) @ DOWN)
    assert np.abs(down).argmax() == onto
    assert np.abs(down).max() == pytest.approx(1.0)


def test_a_body_settles_on_a_face_from_which_it_does_not_tip() -> None:
    points = cloud()
    center = np.array([0.01, -0.02, 0.05])
    rng = np.random.default_rng(5)
    hull = ConvexHull(points)
    for start in rng.standard_normal((40, 3)):
        down = settled_down(points, center, start / np.linalg.norm(start))
        reach = points @ down
        # The foot of the mass centre lies in the hull, so on the face.
        foot = center + (reach.max() - center @ down) * down
        assert (hull.equations[:, :3] @ foot + hull.equations[:, 3]).max() < 1e-9


def test_a_flat_is_the_section_of_the_hull_at_its_height() -> None:
    points = cloud()
    down = settled_down(points, np.zeros(3), DOWN)
    level = float((points @ down).max())
    made = flattened(points, down, level, 0.01)
    assert (made @ down).max() == pytest.approx(level)
    base = made[made @ down > level - 1e-9] - 0.01 * down
    hull = ConvexHull(points).equations
    # Section: on the surface of the hull, at the height.
    surface = (base @ hull[:, :3].T + hull[:, 3]).max(axis=1)
    np.testing.assert_allclose(surface, 0.0, atol=1e-9)
    kept = points[points @ down < level - 0.01]
    grown = ConvexHull(made).equations
    assert (kept @ grown[:, :3].T + grown[:, 3]).max() < 1e-9
    np.testing.assert_array_equal(flattened(points, down, level + 0.02, 0.01), points)


def test_a_flat_block_stays_as_it_is() -> None:
    made = flattened(CORNERS, DOWN, 0.6, 0.003)
    np.testing.assert_allclose(np.sort(made, axis=0), np.sort(CORNERS, axis=0), atol=1e-12)


@pytest.mark.parametrize("inward", [0.01, -0.01])
def test_edges_of_the_base_move_in_by_the_radius_of_the_disc(inward: float) -> None:
    for points in (CORNERS, cloud()):
        down = settled_down(points, np.zeros(3), DOWN)
        made = narrowed(points, down, inward)
        assert (made @ down).max() == pytest.approx((points @ down).max(), abs=1e-9)
        before, after = polygon(points, down), polygon(made, down)
        # Edges that stay move by the disc's radius; where the base grows others may appear.
        moved = [
            offset - old[2]
            for old in before
            for *normal, offset in after
            if np.abs(np.array(normal) - old[:2]).max() < 1e-5
        ]
        assert len(moved) >= 2
        np.testing.assert_allclose(moved, inward, atol=1e-6)


@pytest.mark.filterwarnings("ignore::vsr2.effects.EffectRangeWarning")
def test_a_disc_that_leaves_nothing_is_refused() -> None:
    with pytest.raises(GeometryError, match="leaves nothing"):
        narrowed(CORNERS, DOWN, 0.21)
    block = EffectBench().block()
    with pytest.raises(GeometryError, match=r"effects\.support: .*leaves nothing of the box"):
        apply_effects([block], {"support": {"shrink": 0.2}})


def test_smoothing_moves_no_point_farther_than_it_may_and_none_above_the_zone() -> None:
    rng = np.random.default_rng(1)
    plan = rng.uniform(-0.1, 0.1, (400, 2))
    bowl = 0.5 * (plan**2).sum(axis=1)
    points = np.column_stack([plan, bowl + rng.uniform(0, 0.001, 400) - 0.5])
    points = np.vstack([points, [[0.3, 0.3, 0.5], [-0.3, 0.3, 0.5], [0.0, -0.3, 0.5]]])
    made = smoothed(points, DOWN, 0.5, 0.005, 0.0003)
    moved = made - points
    np.testing.assert_allclose(moved[:, :2], 0.0, atol=1e-15)
    assert np.abs(moved[:, 2]).max() == pytest.approx(0.0003)
    assert not moved[points[:, 2] > -0.495].any()
    # Six points fix a quadric, and there is nothing to smooth.
    np.testing.assert_array_equal(smoothed(CORNERS, DOWN, 0.6, 0.01, 0.001), CORNERS)


def test_mass_properties_and_the_gap_to_the_pedestal_stay() -> None:
    scan = EffectBench().scan()
    values = {"shrink": 0.005, "flat": 0.001, "rim": 0.005, "smoothing": 0.0005}
    made = apply_effects([scan], {"support": values})[0]
    assert made.scene.rock.mass is scan.scene.rock.mass
    (old,), (new,) = scan.scene.rock.parts, made.scene.rock.parts
    assert isinstance(old, Hull)
    assert isinstance(new, Hull)
    lowest = [
        float((part.points @ matrix_from_quaternion(one.start_pose.orientation).T)[:, 2].min())
        + one.start_pose.position[2]
        for part, one in ((old, scan), (new, made))
    ]
    assert lowest[0] == pytest.approx(lowest[1], abs=1e-9)


def test_a_box_stays_a_box_but_for_its_rim_and_parts_above_the_base_stay() -> None:
    block = EffectBench().block()
    above = Box(size=(0.2, 0.2, 0.2), center=(0.0, 0.0, 0.7))
    rock = replace(block.scene.rock, parts=(*block.scene.rock.parts, above))
    double = block.with_scene(rock=rock)
    narrow = apply_effects([double], {"support": {"shrink": 0.01, "flat": 0.002}})[0]
    base, top = narrow.scene.rock.parts
    assert isinstance(base, Box)
    assert base.size == pytest.approx((0.38, 0.58, 1.2))
    assert top == above
    rimmed = apply_effects([double], {"support": {"rim": 0.005}})[0]
    assert [type(part) for part in rimmed.scene.rock.parts] == [Hull, Box]
