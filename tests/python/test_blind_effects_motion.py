"""Effects of the independent simulation on the table, the start and the outcome."""

import math

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the blind extra installs mujoco")

from test_blind_mujoco import (
    BLOCK,
    INTERVAL,
    G,
    lifts,
    situation,
)
from threshold_samples import THRESHOLD, assert_threshold, lifts_at, middle, strongest, under
from vsr2.blind.mujoco import (
    TableMotion,
    TrialContext,
    drive,
    observe,
    run_trial,
    with_effects,
)
from vsr2.blind.mujoco.ground import acceleration_of


def test_a_table_that_may_rise_stays_where_it_is() -> None:
    # The joint of a vertical motion that does nothing: weight does not move the table in a step.
    soft = {"contact_stiffness": middle("contact_stiffness", strongest("contact_stiffness"))}
    both = soft | {"vertical_motion": {"share": 1e-9}}
    plain, free = (run_trial(with_effects(situation(5.5), values)) for values in (soft, both))
    assert plain.peak_tilt > 0.01
    assert free.peak_tilt == pytest.approx(plain.peak_tilt, rel=0.01)


def test_the_gain_scales_the_threshold() -> None:
    assert_threshold(1 / 1.15, "table_gain", change=0.15)


def test_time_scales_the_threshold_by_its_square() -> None:
    assert_threshold(1.03**2, "time_scale", change=0.03)


def test_vertical_motion_changes_the_weight() -> None:
    # Downwards as it pulls to one side: a h = (g - s a) b.
    slope = math.tan(BLOCK.slenderness_angle)
    assert_threshold(1 / (1 + 0.5 * slope), "vertical_motion", share=0.5)


def test_off_axis_motion_is_a_share() -> None:
    base = under("off_axis_motion", situation(5.0), share=0.2)
    np.testing.assert_array_equal(base.table.others["y"], 0.2 * base.table.x)
    response = run_trial(base)
    np.testing.assert_allclose(response.position[:5, 1], base.table.others["y"][:20:4], atol=1e-6)


def test_pitch_joins_the_acceleration() -> None:
    # In axes that move with the table: the base accelerates by a + (p + h) pitch'' at the mass
    # centre, the body must turn with it, and weight leans by the pitch.
    base = under("table_pitch", situation(1.0), compliance=0.02, frequency=20.0)
    pitch = base.table.others["pitch"]
    turning = acceleration_of(pitch, INTERVAL)
    h, inertia = BLOCK.center[2], BLOCK.inertia[1, 1]
    arm = base.table.pivot + h + inertia / (BLOCK.mass * h)
    felt = base.table.acceleration + arm * turning - G * pitch
    expected = THRESHOLD / np.abs(felt).max()
    assert expected < 0.95 * THRESHOLD
    for factor, up in ((0.98, False), (1.03, True)):
        shaken = under("table_pitch", situation(factor * expected), compliance=0.02, frequency=20.0)
        response = run_trial(shaken, series_interval=0.001)
        lean = np.abs(drive(shaken.table.others["pitch"], INTERVAL, 0.001)[0])
        rows = min(len(lean), len(response.tilt))
        assert (np.abs(response.tilt[:rows] - lean[:rows]).max() > 1e-4) == up


def test_filters_of_the_table_reach_the_table() -> None:
    base = situation(5.0)
    for name, values in (
        ("table_bandwidth", {"corner": 3.0, "delay": 0.01}),
        ("table_resonance", {"amplification": 1.8, "frequency": 8.0}),
        ("table_saturation", {"acceleration": 3.0}),
    ):
        assert not np.allclose(under(name, base, **values).table.x, base.table.x)
    assert not lifts_at(1.4, "table_saturation", acceleration=0.9 * THRESHOLD)
    assert lifts(1.4 * THRESHOLD)


def test_placement_is_drawn_for_each_trial() -> None:
    starts = [
        under("placement", situation(), TrialContext(trial_seed=i), yaw=10.0, offset=0.02)
        for i in range(200)
    ]
    yaw = np.degrees([s.yaw for s in starts])
    assert np.abs(yaw).max() <= 10.0
    # Uniform: a standard deviation of 10 / 3^(1/2), its standard error about 4 %.
    assert np.std(yaw) == pytest.approx(10 / math.sqrt(3), rel=0.15)
    radius = np.array([math.hypot(*s.offset) for s in starts]) / 0.02
    assert radius.max() <= 1
    # Uniform over a disc: the mean square is 1/2, its standard error 0.02.
    assert np.mean(radius**2) == pytest.approx(0.5, abs=0.07)
    again = under("placement", situation(), TrialContext(trial_seed=7), yaw=10.0, offset=0.02)
    assert (again.yaw, again.offset) == (starts[7].yaw, starts[7].offset)


@pytest.mark.parametrize("yaw", [-30.0, 30.0])
def test_a_turned_block_lifts_later(yaw: float) -> None:
    # About the edge whose normal is turned away: a h cos(yaw) = g b.
    assert_threshold(1 / math.cos(math.radians(yaw)), "registration", yaw=yaw)
    starts = {
        under("registration", situation(yaw=0.1), TrialContext(trial_seed=i), yaw=yaw).yaw
        for i in range(5)
    }
    assert starts == {0.1 + math.radians(yaw)}, "the same in every trial"


def test_an_outcome_rule_labels_and_flips() -> None:
    response = run_trial(situation(4.6))
    assert not response.overturned
    low = {"outcome_rule": {"tilt": response.peak_tilt / 2, "flips": 0.0}}
    assert observe(response, low).overturned
    high = {"outcome_rule": {"tilt": response.peak_tilt * 2, "flips": 0.0}}
    assert not observe(response, high).overturned
    flips = {"outcome_rule": {"tilt": 1.0, "flips": 0.03}}
    seen = [observe(response, flips, TrialContext(trial_seed=i)).overturned for i in range(2000)]
    # A binomial's standard deviation is 8 of 60.
    assert abs(sum(seen) - 60) < 32


@pytest.mark.parametrize("frequency", [0.5, 2.0, 4.0, 8.0, 16.0])
def test_the_gain_of_a_record_depends_on_frequency(frequency: float) -> None:
    time = np.arange(round(12.0 / INTERVAL)) * INTERVAL
    x = 0.01 * np.sin(np.pi * time / 12.0) ** 4 * np.sin(2 * np.pi * frequency * time)
    base = situation(table=TableMotion(INTERVAL, x))
    found = under("input_channel", base, low_gain=0.3, high_gain=-0.2).table.x
    slow, fast = 1 / (1 + (frequency / 2) ** 4), 1 - 1 / (1 + (frequency / 8) ** 4)
    assert np.ptp(found) / np.ptp(x) == pytest.approx(1 + 0.3 * slow - 0.2 * fast, abs=0.01)
    assert np.abs(np.diff(found[-20:])).max() < 1e-6
