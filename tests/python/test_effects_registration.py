"""How the specimen stands: `registration`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vsr2 import apply_effects, run_batch
from vsr2.config.study import Output
from vsr2.effects.standing import mass_height, support_of
from vsr2.errors import GeometryError
from vsr2.scene.rotation import matrix_from_quaternion
from vsr2.simulation.bench import EffectBench
from vsr2.trial import Trial

ROOT = Path(__file__).resolve().parents[2]
Array = np.ndarray
Values = Mapping[str, float]


@pytest.fixture(scope="module")
def bench() -> EffectBench:
    return EffectBench("auto", ROOT / "models" / "pbr_scan.obj")


def centre(trial: Trial) -> Array:
    """Of the mass, in the world at the start."""
    start = trial.start_pose
    turned = matrix_from_quaternion(start.orientation) @ trial.scene.rock.mass.mass_center
    return np.asarray(turned + np.asarray(start.position))


def changed(trial: Trial, **given: Values) -> Trial:
    return apply_effects([trial], given)[0]


def yaw_of(trial: Trial) -> float:
    x, y, z, w = trial.start_pose.orientation
    return math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


# --- registration --------------------------------------------------------------------------------


def test_a_specimen_stands_alike_in_every_trial(bench: EffectBench) -> None:
    trials = [replace(bench.scan(), motion=bench.pulse(a, 2.0), seed=i) for i, a in
              enumerate((2.0, 3.0, 4.0))]  # fmt: skip
    made = apply_effects(trials, {"registration": {"yaw": 70.0, "lean": 1.0}})
    assert len({id(trial.scene) for trial in made}) == 1
    assert len({trial.start_pose for trial in made}) == 1
    assert yaw_of(made[0]) == pytest.approx(yaw_of(trials[0]) + 70.0)


def test_half_a_turn_mirrors_the_motion(bench: EffectBench) -> None:
    pulse = bench.pulse(4.0, 2.0)
    scan = replace(bench.scan(), output=Output(log_every=1))
    turned = changed(replace(scan, motion=pulse), registration={"yaw": 180.0})
    logs = run_batch([turned, replace(scan, motion=pulse.scaled(-1.0))], threads=1).logs
    ways = []
    for log in logs:
        assert log is not None
        shaken = log.tilt[(log.time >= 0) & (log.time < 0.4)]
        ways.append(shaken)
    assert ways[0].max() > 1e-3
    np.testing.assert_allclose(ways[0], ways[1], atol=0.02 * ways[0].max())


@pytest.mark.parametrize("slope", [0.0, 1.0])
def test_the_rock_leans_about_its_foot(slope: float, bench: EffectBench) -> None:
    block = bench.block()
    if slope:
        block = changed(block, base_slope={"angle": slope, "azimuth": 200.0})
    made = changed(block, registration={"lean": 2.0, "lean_azimuth": 30.0})
    top = matrix_from_quaternion(block.scene.pedestal.slope)
    h, lean, azimuth = mass_height(block), math.radians(2.0), math.radians(30.0)
    along = h * math.sin(lean)
    expected = [along * math.cos(azimuth), along * math.sin(azimuth), h * math.cos(lean) - h]
    np.testing.assert_allclose(top.T @ (centre(made) - centre(block)), expected, atol=1e-12)
    # What bears stays: only where the mass lies over it changes.
    assert made.start_pose == block.start_pose
    assert made.scene.rock.parts == block.scene.rock.parts
    before, after = (support_of(one).polygon for one in (block, made))
    np.testing.assert_allclose(before - after, [expected[:2]] * len(before), atol=1e-12)


def test_a_box_inertia_keeps_its_axes(bench: EffectBench) -> None:
    block = bench.block()
    aabb = block.with_scene(rock=replace(block.scene.rock, inertia_from_aabb=True))
    made = changed(aabb, registration={"lean": 2.0})
    assert np.array_equal(made.scene.rock.mass.principal_axes, aabb.scene.rock.mass.principal_axes)
    np.testing.assert_allclose(
        centre(made), centre(changed(block, registration={"lean": 2.0})), atol=1e-12
    )


def test_an_offset_is_told_in_the_world_in_which_the_specimen_stands(bench: EffectBench) -> None:
    turn, offset = {"yaw": 90.0}, {"distance": 0.01, "azimuth": 0.0}
    both = changed(bench.scan(), com_offset=offset, registration=turn)
    moved = centre(both) - centre(changed(bench.scan(), registration=turn))
    np.testing.assert_allclose(moved, [0.01, 0.0, 0.0], atol=1e-12)


@pytest.mark.filterwarnings("ignore::vsr2.effects.EffectRangeWarning")
def test_a_rock_that_leans_beyond_its_base_is_refused(bench: EffectBench) -> None:
    message = r"effects\.registration\.lean: 20 degree takes the mass centre beyond"
    with pytest.raises(GeometryError, match=message):
        changed(bench.block(), registration={"lean": 20.0})
