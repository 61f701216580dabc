"""The `Motion` type and the intensity measures."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsr2.errors import MotionError
from vsr2.motion import (
    STANDARD_GRAVITY,
    Motion,
    SideMotion,
    cosine_motion,
    intensity_measures,
    pga_g,
    pgv_m_s,
)
from vsr2.motion.samples import Deferred


def motion(**changes):
    fields = {
        "name": "m",
        "time_step": 0.001,
        "displacement": np.array([0.0, -0.001, -0.0025]),
        "velocity": np.array([1.0, -3.0, 0.0]),
        "acceleration": np.array([-4000.0, -4000.0, 10000.0]),
        "kind": "recording",
    }
    return Motion(**(fields | changes))


def test_measures_are_peaks_of_the_driven_signals():
    assert motion().peak_acceleration == 10000.0
    assert motion().pgv_m_s == 3.0
    assert motion().pgv_pga_s == 3e-4
    assert motion().duration == pytest.approx(0.002)
    assert pga_g([1.0, -2.0]) == 2.0 / STANDARD_GRAVITY
    assert pgv_m_s(np.array([-3.0, 1.0])) == 3.0


def test_a_motion_at_rest_has_no_ratio():
    rest = motion(displacement=np.zeros(3), velocity=np.zeros(3), acceleration=np.zeros(3))
    assert rest.pgv_pga_s == 0.0


def test_peaks_of_nothing_are_refused():
    with pytest.raises(MotionError, match="no samples"):
        pga_g([])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"displacement": np.array([0.0, np.nan, 1.0])}, r"nan at sample 1 \(t = 0.001 s\)"),
        ({"velocity": np.array([0.0, 1.0, np.inf])}, "velocity is inf at sample 2"),
        ({"acceleration": np.zeros(2)}, "the same number"),
        ({"displacement": np.zeros((3, 1))}, "one dimension"),
        ({"displacement": np.zeros(1)}, "at least|2 to"),
        ({"displacement": np.array([1e-3, 0.0, -1.5e-3])}, "subtract the first value"),
        ({"displacement": ["a", "b", "c"]}, "not an array of numbers"),
        ({"displacement": ["0", "0", "0"]}, "displacement is not an array of numbers"),
        ({"displacement": np.zeros(3, bool)}, "but of bool"),
        ({"velocity": [0.0, True, 0.0]}, "truth values"),
        ({"velocity": np.zeros(3, complex)}, "but of complex128"),
        ({"acceleration": np.zeros(3, "datetime64[s]")}, r"but of datetime64\[s\]"),
        ({"velocity": np.ma.array(np.zeros(3), mask=[0, 1, 0])}, "velocity is a masked array"),
        ({"time_step": 0.0}, "time_step must be a positive number"),
        ({"time_step": float("nan")}, "time_step must be a positive number"),
        ({"time_step": "fast"}, "time_step must be a positive number"),
        ({"time_step": True}, "time_step must be a positive number"),
        ({"resampling_error": "low"}, r"resampling_error must be a finite number \[m\]"),
        ({"resampling_error": -1.0}, r"resampling_error must be a finite number \[m\], 0 or more"),
        ({"resampling_error_rms": -1e-9}, "resampling_error_rms must be .*0 or more"),
        ({"source": None}, r"source must be text \(is of type NoneType"),
        ({"source": 3}, "source must be text"),
        ({"recorded": 3}, "recorded must be a vsr2.motion.Recorded or None"),
        ({"transverse": 3}, "transverse must be a vsr2.motion.SideMotion or None"),
        ({"pitch": np.zeros(3)}, "pitch must be a vsr2.motion.SideMotion or None"),
        ({"name": 7}, "name must be text"),
        ({"kind": "record"}, "kind must be cosine or recording"),
        ({"velocity": np.zeros(3)}, "displacement and velocity contradict each other"),
        ({"velocity": np.array([-1.0, 3.0, 0.0])}, "displacement and velocity contradict"),
        ({"displacement": np.array([0.0, -1.0, -2.5])}, "displacement and velocity contradict"),
        ({"displacement": np.array([0.0, -1e-6, -2.5e-6])}, "displacement and velocity contradict"),
        ({"displacement": np.zeros(3)}, "displacement and velocity contradict"),
    ],
)
def test_unusable_motions_are_refused(changes, message):
    with pytest.raises(MotionError, match=message):
        motion(**changes)


def test_the_callers_arrays_stay_their_own():
    displacement = np.array([0.0, -0.001, -0.0025])
    made = motion(displacement=displacement)
    displacement[1] = 7.0
    assert made.displacement[1] == -0.001
    with pytest.raises(ValueError, match="read-only"):
        made.displacement[1] = 7.0


def test_channels_with_noise_do_not_contradict_each_other():
    # White noise differentiated from sample to sample is the worst that a record holds.
    noise = np.random.default_rng(0).normal(size=500)
    noise[0] = 0.0
    velocity = np.gradient(noise, 0.001)
    made = motion(displacement=noise, velocity=velocity, acceleration=np.gradient(velocity, 0.001))
    assert made.size == 500


def swaying(amplitude=0.05, frequency=1.0, step=0.001, seconds=20):
    """Displacement, velocity and acceleration of a sine, differentiated from sample to sample."""
    time = np.arange(round(seconds / step) + 1) * step
    displacement = amplitude * np.sin(2 * np.pi * frequency * time)
    velocity = np.gradient(displacement, step)
    return displacement, velocity, np.gradient(velocity, step)


@pytest.mark.parametrize("factor", [9.81, 1 / 9.81, -1.0, 0.1, 0.0])
def test_an_acceleration_of_another_unit_or_sign_is_refused(factor):
    displacement, velocity, acceleration = swaying()
    changes = {"displacement": displacement, "velocity": velocity}
    with pytest.raises(MotionError, match="velocity and acceleration contradict each other"):
        motion(**changes, acceleration=factor * acceleration)


@pytest.mark.parametrize("shape", [np.ones, lambda n: np.sin(np.linspace(0, 60, n))])
def test_an_acceleration_of_what_rests_is_refused(shape):
    rest = np.zeros(20_001)
    with pytest.raises(MotionError, match=r"0 m/s against .*acceleration's integral; check units"):
        motion(displacement=rest, velocity=rest, acceleration=10 * shape(rest.size))


def test_an_acceleration_with_the_errors_of_a_record_is_taken():
    displacement, velocity, acceleration = swaying()
    noise = np.random.default_rng(0).normal(size=displacement.size)
    changes = {"displacement": displacement, "velocity": velocity}
    # What a high-pass filter on the velocity has taken off.
    slow = 0.3 * np.sin(np.linspace(0, 2 * np.pi, displacement.size))
    # A sensor that leans, white noise of a quarter of the peak, another gain.
    for wrong in (
        acceleration + 0.1,
        acceleration + 0.5 * noise,
        1.5 * acceleration,
        acceleration + slow,
    ):
        assert motion(**changes, acceleration=wrong).size == displacement.size
    # A lean that is half of the peak is no error of a sensor.
    with pytest.raises(MotionError, match="velocity and acceleration contradict"):
        motion(**changes, acceleration=acceleration + 2.0)


def test_a_table_at_steady_speed_has_an_acceleration_of_noise():
    time = np.arange(2001) * 1e-3
    displacement = 0.1 * time
    velocity = np.gradient(displacement, 1e-3)
    noise = 1e-3 * np.random.default_rng(0).normal(size=time.size)
    for acceleration in (np.zeros(time.size), noise):
        assert motion(
            displacement=displacement, velocity=velocity, acceleration=acceleration
        ).pgv_m_s == pytest.approx(0.1)


@given(factor=st.floats(-100, 100).filter(lambda value: abs(value) > 1e-3))
def test_scaling_scales_every_measure_and_keeps_the_ratio(factor):
    pulse = cosine_motion(0.02, 3.0, 0.001)
    scaled = pulse.scaled(factor)
    # one rounding of each product, one of the unit
    assert scaled.pga_g == pytest.approx(abs(factor) * pulse.pga_g, rel=1e-15)
    assert scaled.pgv_pga_s == pytest.approx(pulse.pgv_pga_s, rel=1e-14)
    assert scaled.name != pulse.name
    assert scaled.kind == "cosine"


def test_a_scaled_motion_holds_factors_and_not_samples():
    pulse = cosine_motion(0.02, 3.0, 0.001)
    twice = pulse.scaled(1.1).scaled(0.7)
    for name in ("displacement", "velocity", "acceleration"):
        expected = getattr(pulse, name) * 1.1 * 0.7
        assert name not in vars(twice)
        np.testing.assert_array_equal(getattr(twice, name), expected)
        np.testing.assert_array_equal(getattr(replace(twice, name="x"), name), expected)
    assert twice.peak_acceleration == float(np.abs(twice.acceleration).max())
    assert len(pickle.dumps(twice)) < 1.1 * len(pickle.dumps(pulse))
    with pytest.raises(AttributeError, match="no attribute 'speed'"):
        _ = twice.speed


def test_an_acceleration_may_be_made_when_it_is_asked_for():
    pulse, asked = cosine_motion(0.02, 3.0, 0.001), []

    def made():
        asked.append(True)
        return pulse.acceleration

    def late():
        return replace(pulse, acceleration=Deferred(made))

    motion, scaled = late(), late().scaled(-1.1).scaled(0.7)
    assert motion == pulse
    assert motion.pgv_m_s == pulse.pgv_m_s
    assert scaled == pulse.scaled(-1.1).scaled(0.7)
    assert not asked
    assert motion.peak_acceleration == pulse.peak_acceleration
    np.testing.assert_array_equal(motion.acceleration, pulse.acceleration)
    assert len(asked) == 1
    assert not motion.acceleration.flags.writeable
    expected = pulse.scaled(-1.1).scaled(0.7)
    assert scaled.peak_acceleration == expected.peak_acceleration
    np.testing.assert_array_equal(scaled.acceleration, expected.acceleration)
    for copied in (pickle.loads(pickle.dumps(late())), replace(late(), name="x")):
        np.testing.assert_array_equal(copied.acceleration, pulse.acceleration)


@pytest.mark.parametrize(
    ("given", "message"), [(np.zeros(2), "the same number"), (np.full(3, np.nan), "nan at sample")]
)
def test_an_acceleration_made_later_is_checked_then(given, message):
    late = motion(acceleration=Deferred(lambda: given))
    with pytest.raises(MotionError, match=message):
        _ = late.peak_acceleration


def test_a_motion_with_others_beside_it_refers_to_its_samples():
    pulse = cosine_motion(0.02, 3.0, 0.001).scaled(1.1)
    side = SideMotion(0.1 * pulse.displacement, 0.1 * pulse.velocity)
    found = pulse.with_sides("made", transverse=side)
    built = replace(pulse, transverse=side, source="made")
    assert found == built
    assert (found.source, found.is_spatial) == ("made", True)
    for name in ("displacement", "velocity", "acceleration"):
        assert name not in vars(found)
        np.testing.assert_array_equal(getattr(found, name), getattr(built, name))
    assert found.pgv_m_s == built.pgv_m_s
    assert found.with_sides("again", vertical=side).transverse is not None
    assert pickle.loads(pickle.dumps(found)) == built
    assert not pulse.is_spatial
    with pytest.raises(MotionError, match="they must be equal"):
        pulse.with_sides("made", transverse=SideMotion(np.zeros(3), np.zeros(3)))
    with pytest.raises(MotionError, match="subtract the first value"):
        pulse.with_sides("made", transverse=SideMotion(side.displacement + 1, side.velocity))


def test_mirroring_twice_gives_the_motion_back():
    pulse = cosine_motion(0.02, 3.0, 0.001)
    assert pulse.scaled(-1, name="a").scaled(-1, name="b").sha256 == pulse.sha256
    assert pulse.scaled(-1).sha256 != pulse.sha256


@pytest.mark.parametrize("factor", [0.0, float("nan"), float("inf"), 1e308])
def test_scaling_to_nonsense_is_refused(factor):
    with pytest.raises(MotionError):
        motion().scaled(factor)


def test_scaling_scales_the_stated_error():
    assert motion(resampling_error=1e-6).scaled(-2).resampling_error == 2e-6


def test_names_whose_unit_was_not_in_them_are_refused():
    pulse = cosine_motion(0.1, 1.0, 0.001)
    for one in (pulse, pulse.scaled(2)):
        with pytest.raises(
            AttributeError, match=r"Motion.pga is gone; use pga_g \[g\] or peak_acc"
        ):
            _ = one.pga
        with pytest.raises(AttributeError, match="use scaled_to_pga_g, which takes g"):
            one.scaled_to_pga(3.0)
        with pytest.raises(AttributeError, match="has no attribute 'pgx'"):
            _ = one.pgx
    with pytest.raises(AttributeError, match=r"IntensityMeasures.pga is gone; use pga_g"):
        _ = intensity_measures(pulse).pga


@pytest.mark.parametrize(
    ("old", "new"), [("pgv", r"pgv_m_s \[m/s\]"), ("pgv_pga", r"pgv_pga_s \[s\]")]
)
def test_names_of_pgv_without_their_unit_are_refused(old, new):
    pulse = cosine_motion(0.1, 1.0, 0.001)
    for one in (pulse, intensity_measures(pulse)):
        with pytest.raises(
            AttributeError, match=rf"{type(one).__name__}\.{old} is gone; use {new}"
        ):
            getattr(one, old)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_scaling_to_a_pga_keeps_sign_and_shape(sign):
    motion = cosine_motion(0.1, 1.0, 0.001).scaled(sign)
    scaled = motion.scaled_to_pga_g(3.0 / STANDARD_GRAVITY, name="x")
    assert scaled.peak_acceleration == pytest.approx(3.0, rel=1e-14)
    assert scaled.name == "x"
    factor = 3.0 / motion.peak_acceleration
    np.testing.assert_allclose(scaled.displacement, factor * motion.displacement, rtol=1e-14)


@pytest.mark.parametrize("pga", [0.0, -1.0, float("nan"), float("inf")])
def test_impossible_targets_of_pga_are_refused(pga):
    with pytest.raises(MotionError, match="target PGA"):
        cosine_motion(0.1, 1.0, 0.001).scaled_to_pga_g(pga)


def test_a_motion_at_rest_has_no_pga_to_scale():
    rest = Motion("rest", 0.001, *(np.zeros(5),) * 3, kind="recording")
    with pytest.raises(MotionError, match="at rest"):
        rest.scaled_to_pga_g(1.0)
