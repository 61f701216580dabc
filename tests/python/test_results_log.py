"""Quantities derived from a state log, against closed forms and scipy."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from synthetic_results import CENTER_HEIGHT, about, falling_log, make_log, make_result, make_trials
from vsr2.errors import ResultError
from vsr2.results import BatchResult, TrialLog
from vsr2.scene.rotation import quaternion_product, rotate

ROUNDING = 1e-12
"""A handful of operations on numbers of order 1 in double precision."""

angles = st.floats(-3.1, 3.1)
unit_quaternions = st.integers(0, 2**32 - 1).map(
    lambda seed: Rotation.from_quat(np.random.default_rng(seed).normal(size=4))
)


def turned(rotations: Rotation, **more: object) -> TrialLog:
    return make_log(np.linspace(0.0, 1.0, len(rotations)), rotations=rotations, **more)


@given(unit_quaternions, unit_quaternions)
def test_product_and_rotation_are_scipys(a: Rotation, b: Rotation) -> None:
    product = Rotation.from_quat(quaternion_product(a.as_quat(), b.as_quat()))
    assert (product.inv() * (a * b)).magnitude() < 1e-7
    v = np.array([0.3, -1.2, 2.0])
    np.testing.assert_allclose(rotate(a.as_quat(), v), a.apply(v), atol=ROUNDING)


@given(angles, st.floats(-1.5, 1.5), angles)
def test_roll_pitch_yaw_are_about_the_fixed_axes(roll: float, pitch: float, yaw: float) -> None:
    # scipy's lower-case "xyz" is extrinsic: about the fixed axes x, y, z in this order.
    rotations = Rotation.from_euler("xyz", [[roll, pitch, yaw]] * 2)
    # 1 / cos(1.5) = 14 is the condition of roll and yaw at the greatest pitch.
    np.testing.assert_allclose(
        turned(rotations).roll_pitch_yaw[0], [roll, pitch, yaw], atol=20 * ROUNDING
    )


def test_roll_pitch_yaw_do_not_depend_on_the_quaternions_length_or_sign() -> None:
    rotations = Rotation.from_euler("xyz", [[0.2, -0.4, 1.0]] * 3)
    log = turned(rotations)
    state = log.state.copy()
    state[:, 8:12] *= np.array([[1.0], [-1.0], [1.01]])
    scaled = TrialLog(
        state,
        log.contacts,
        log.settled_position,
        log.settled_orientation,
        log.foot,
        log.mass_center,
        log.principal_axes,
    )
    np.testing.assert_allclose(scaled.roll_pitch_yaw, log.roll_pitch_yaw, atol=ROUNDING)
    np.testing.assert_allclose(scaled.tilt, log.tilt, atol=ROUNDING)


def test_pitch_keeps_its_digits_near_a_quarter_turn() -> None:
    pitch = np.pi / 2 - np.array([1e-3, 1e-5, 1e-7])
    # An arc sine would be off by the square root of the rounding, 1e-8.
    np.testing.assert_allclose(
        turned(about("y", pitch)).roll_pitch_yaw[:, 1], pitch, atol=1e-15 * 10
    )


def test_angles_go_on_through_full_turns() -> None:
    ramp = np.linspace(0.0, 9.0, 200)
    np.testing.assert_allclose(turned(about("z", ramp)).roll_pitch_yaw[:, 2], ramp, atol=ROUNDING)
    np.testing.assert_allclose(turned(about("z", ramp)).turn, ramp, atol=ROUNDING)
    np.testing.assert_allclose(turned(about("x", ramp)).roll_pitch_yaw[:, 0], ramp, atol=ROUNDING)


@given(unit_quaternions, unit_quaternions)
def test_orientation_is_of_the_model_frame(model: Rotation, axes: Rotation) -> None:
    # R_WB = R_WM R_MB
    body = model * axes
    log = turned(Rotation.concatenate([body, body]), axes=axes)
    got = Rotation.from_quat(log.orientation[0])
    assert (got.inv() * model).magnitude() < 1e-7


@given(unit_quaternions, st.floats(0.0, 3.1), st.floats(-3.0, 3.0), angles)
def test_tilt_is_the_angle_of_the_settled_vertical(
    settled: Rotation, tilt: float, turn: float, azimuth: float
) -> None:
    # Turn about the vertical first, then tilt about a horizontal axis.
    axis = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    motion = Rotation.from_rotvec(tilt * axis) * about("z", [turn])
    log = turned(Rotation.concatenate([settled, motion * settled]), settled=settled)
    # Near an upright rock upside down the arc sine costs half the digits.
    np.testing.assert_allclose(log.tilt, [0.0, tilt], atol=1e-7)
    vertical = (motion * settled * settled.inv()).apply([0.0, 0.0, 1.0])[0]
    np.testing.assert_allclose(np.cos(log.tilt[1]), vertical[2], atol=1e-9)


@given(unit_quaternions, st.floats(-3.0, 3.0))
def test_turn_about_the_vertical(settled: Rotation, turn: float) -> None:
    ramp = about("z", np.linspace(0.0, turn, 5))
    log = turned(ramp * settled, settled=settled)
    np.testing.assert_allclose(log.turn, np.linspace(0.0, turn, 5), atol=1e-12)
    np.testing.assert_allclose(log.tilt, 0.0, atol=1e-7)


def test_turn_starts_within_half_a_turn_for_either_sign_of_the_quaternion() -> None:
    rotations = about("z", [0.1, 0.2, 0.3])
    log = turned(rotations)
    state = log.state.copy()
    state[:, 8:12] *= -1.0
    negated = TrialLog(
        state,
        log.contacts,
        log.settled_position,
        log.settled_orientation,
        log.foot,
        log.mass_center,
        log.principal_axes,
    )
    np.testing.assert_allclose(negated.turn, [0.1, 0.2, 0.3], atol=ROUNDING)


def test_slip_is_travel_relative_to_the_pedestal() -> None:
    time = np.linspace(0.0, 1.0, 11)
    table = 0.2 * time
    position = np.column_stack([table + 0.03 * time, -0.01 * time, np.full(11, CENTER_HEIGHT)])
    slip = make_log(time, command=table, position=position).slip
    np.testing.assert_allclose(slip, np.column_stack([0.03 * time, -0.01 * time]), atol=ROUNDING)


def test_rocking_about_the_foot_is_no_slip() -> None:
    time = np.linspace(0.0, 1.0, 21)
    angle = 0.3 * np.sin(2 * np.pi * time)
    rotations = about("y", angle)
    # The foot stays: the mass centre is 0.5 m from it along the body's z axis.
    foot = np.array([0.0, 0.0, CENTER_HEIGHT - 0.5])
    position = foot + rotations.apply([0.0, 0.0, 0.5])
    log = make_log(time, rotations=rotations, position=position)
    np.testing.assert_allclose(log.slip, 0.0, atol=ROUNDING)
    np.testing.assert_allclose(log.tilt, np.abs(angle), atol=1e-9)


def test_arrays_are_read_only_and_not_copied() -> None:
    log = falling_log()
    with pytest.raises(ValueError, match="read-only"):
        log.state[0, 0] = 1.0
    state = np.zeros((2, 18))
    kept = make_log(np.array([0.0, 1.0]))
    again = TrialLog(
        state, kept.contacts, kept.settled_position, kept.settled_orientation, kept.foot,
        kept.mass_center, kept.principal_axes,
    )  # fmt: skip
    assert np.shares_memory(again.state, state)
    state[0, 0] = 3.0  # the caller's own array stays writeable


def test_wrong_shapes_are_refused() -> None:
    log = falling_log()
    with pytest.raises(ResultError, match=r"state must have shape \(n, 18\), it has \(2, 17\)"):
        TrialLog(
            np.zeros((2, 17)), log.contacts, log.settled_position, log.settled_orientation,
            log.foot, log.mass_center, log.principal_axes,
        )  # fmt: skip
    with pytest.raises(ResultError, match="known: time, commanded_position"):
        log.column("tilt")


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("state", np.ma.array(np.zeros((2, 18)), mask=True), "state is a masked array"),
        ("state", np.zeros((2, 18), complex), r"state is not an array of numbers \(but of complex"),
        ("foot", ["0", "0", "0"], "foot is not an array of numbers"),
        ("pivot", np.zeros(3, bool), "but of bool"),
        ("excursions", None, "excursions is not an array of numbers"),
    ],
)
def test_a_log_of_anything_but_real_numbers_is_refused(
    field: str, value: Any, message: str
) -> None:
    with pytest.raises(ResultError, match=f"trial log: .*{message}"):
        replace(falling_log(rows=2), **{field: value})


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("peak_tilt", np.ma.array([0.1, 0.2], mask=[0, 1]), "column peak_tilt is a masked array"),
        ("peak_tilt", [1j, 0.0], "column peak_tilt is not an array of numbers"),
        ("pga_g", ["0.1", "0.2"], "column pga_g is not an array of numbers"),
        ("seed", [0.5, 1.0], "column seed is not an array of integers"),
        ("seed", [0, -1], "column seed is -1; give 0 or more"),
        ("seed", np.array([0, 2**64 - 1], np.uint64), "column seed is .*; give at most"),
        ("name", np.ma.array(["a", "b"], mask=[0, 1]), "column name is a masked array"),
        ("name", ["a", np.ma.masked], "column name is a masked array"),
        ("name", [1, 2], "column name holds .*1.* of type .*; give text"),
        ("motion", np.array(["a", None]), "column motion holds null of type NoneType; give text"),
        ("status", np.ma.array(["ok", "ok"], mask=[0, 1]), "column status is a masked array"),
    ],
)
def test_a_column_of_anything_else_is_refused(name: str, value: Any, message: str) -> None:
    with pytest.raises(ResultError, match=message):
        BatchResult({**make_trials(2), name: value}, (None, None))


def test_a_column_of_text_holds_objects() -> None:
    made = BatchResult({**make_trials(2), "name": ["a", "b"]}, (None, None))
    assert made["name"].dtype == object
    assert made["name"].tolist() == ["a", "b"]


def test_batch_result_checks_its_columns() -> None:
    with pytest.raises(ResultError, match=r"logs\[1\] is 1; give a TrialLog or None"):
        BatchResult(make_trials(2), (None, 1))  # type: ignore[arg-type]
    trials = make_trials(2)
    with pytest.raises(ResultError, match="for 3 trials"):
        BatchResult(trials, (None, None, None))
    del trials["outcome"]
    with pytest.raises(ResultError, match="outcome"):
        BatchResult(trials, (None, None))


def test_stack_pads_with_nan() -> None:
    short, long = falling_log(rows=11), falling_log(rows=21)
    result = make_result([short, None, long])
    tilt = result.stack("tilt")
    assert tilt.shape == (3, 21)
    np.testing.assert_array_equal(tilt[0, :11], short.tilt)
    assert np.isnan(tilt[0, 11:]).all()
    assert np.isnan(tilt[1]).all()
    np.testing.assert_array_equal(tilt[2], long.tilt)
    assert result.stack("position").shape == (3, 21, 3)
    with pytest.raises(ResultError, match="unknown quantity 'speed'"):
        result.stack("speed")
    with pytest.raises(ResultError, match="no trial has a log"):
        make_result([None]).stack("tilt")


def test_missing_logs_and_columns_are_named() -> None:
    result = make_result([falling_log(), None])
    assert result.log(0).time[0] == 0.0
    with pytest.raises(ResultError, match=r"trial 1 \(trial 1\) has no log; set output.log_every"):
        result.log(1)
    for index in (2, -1):
        with pytest.raises(ResultError, match=f"no trial {index}; there are 2"):
            result.log(index)
    for odd in ("0", "trial 1", 0.0, True, None, [0]):
        with pytest.raises(
            ResultError, match=r"log: trial is .*give its index.*result\[\"name\"\]"
        ):
            result.log(odd)  # type: ignore[arg-type]
    for odd in (None, 0, ["tilt"], np.array(["tilt", "slip"])):
        with pytest.raises(ResultError, match=r"unknown quantity .*known: state"):
            result.stack(odd)  # type: ignore[arg-type]
        with pytest.raises(ResultError, match=r"no column .*known: time"):
            result.log(0).column(odd)  # type: ignore[arg-type]
    with pytest.raises(ResultError, match="no column 'tilt'"):
        result["tilt"]
    assert [row["trial"] for row in result] == [0, 1]
