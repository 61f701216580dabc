"""Intensity measures against closed forms and against eqsig."""

import math
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsr2.config.motion_source import Filter
from vsr2.errors import MotionError
from vsr2.motion import (
    STANDARD_GRAVITY,
    Record,
    arias_intensity,
    build_recorded_motion,
    cosine_motion,
    cumulative_absolute_velocity,
    intensity_measures,
    kinematics,
    read_record,
    significant_duration,
    write_record,
)

FOLDER = Path(__file__).parents[2] / "configs" / "motions"
H = 0.001


@given(amplitude=st.floats(0.01, 0.5), frequency=st.floats(0.5, 5.0))
def test_a_cosine_pulse_has_the_measures_of_its_closed_form(amplitude, frequency):
    measures = intensity_measures(cosine_motion(amplitude, frequency, H))
    omega = 2 * math.pi * frequency
    peak = amplitude * omega**2
    # the trapezium rule ends up to a step late; with a step's phase w h of at most 0.03
    assert measures.pga_g == pytest.approx(peak / STANDARD_GRAVITY, rel=1e-12)
    assert measures.pgv_m_s == pytest.approx(amplitude * omega, rel=1e-3)
    assert measures.pgd == pytest.approx(2 * amplitude, rel=1e-3)
    assert measures.pgv_pga_s == pytest.approx(1 / omega, rel=1e-3)
    assert measures.arias == pytest.approx(
        math.pi / (2 * STANDARD_GRAVITY) * peak**2 / (2 * frequency), rel=0.02
    )
    assert measures.cav == pytest.approx(4 * amplitude * omega, rel=0.02)
    assert measures.pga_g == pytest.approx(peak / STANDARD_GRAVITY)


@given(rate=st.floats(0.2, 3.0), start=st.floats(0.0, 0.4), length=st.floats(0.1, 0.55))
def test_significant_duration_of_an_exponential_decay(rate, start, length):
    """Of a = exp(-r t) the share s is reached at t = -ln(1 - s (1 - exp(-2 r T))) / (2 r)."""
    duration, end = 10.0, start + length
    t = np.arange(round(duration / H) + 1) * H
    first, last = (
        -math.log(1 - s * (1 - math.exp(-2 * rate * duration))) / (2 * rate) for s in (start, end)
    )
    # interpolated within a step; the integrand changes by 2 r h = 0.6 % in it
    assert significant_duration(np.exp(-rate * t), H, start, end) == pytest.approx(
        last - first, abs=1e-5
    )


def test_significant_duration_of_steady_shaking_is_its_share():
    t = np.arange(0, 20, H)
    measures = intensity_measures(
        Record("r", H, acceleration=np.sin(2 * np.pi * 5 * t) * (t < 20)), channel="acceleration"
    )
    # half a period of 0.2 s bounds the unsteadiness
    assert measures.duration_5_75 == pytest.approx(0.7 * 20, abs=0.05)
    assert measures.duration_5_95 == pytest.approx(0.9 * 20, abs=0.05)


@given(factor=st.floats(0.01, 100))
def test_measures_scale_as_their_units_say(factor):
    motion = cosine_motion(0.1, 1.3, H)
    one, scaled = intensity_measures(motion), intensity_measures(motion.scaled(-factor))
    for name in ("pga_g", "pgv_m_s", "pgd", "cav"):
        assert getattr(scaled, name) == pytest.approx(factor * getattr(one, name), rel=1e-12)
    assert scaled.arias == pytest.approx(factor**2 * one.arias, rel=1e-12)
    for name in ("pgv_pga_s", "duration_5_75", "duration_5_95", "time_step", "duration"):
        assert getattr(scaled, name) == pytest.approx(getattr(one, name), rel=1e-9)


def test_every_channel_of_one_motion_tells_the_same_measures():
    t = np.arange(-6, 6, 0.002)
    w = 2 * np.pi * 1.5
    gauss = np.exp(-(t**2))
    x = 0.1 * gauss * np.cos(w * t)
    v = 0.1 * gauss * (-2 * t * np.cos(w * t) - w * np.sin(w * t))
    a = 0.1 * gauss * ((4 * t**2 - 2 - w**2) * np.cos(w * t) + 4 * t * w * np.sin(w * t))
    wanted = (np.abs(a).max(), np.abs(v).max(), np.abs(x).max())
    for channel, signal in {"displacement": x, "velocity": v, "acceleration": a}.items():
        measures = intensity_measures(Record("r", 0.002, **{channel: signal}))
        # splines at 2 ms and 1.5 Hz
        assert (measures.pga_g * STANDARD_GRAVITY, measures.pgv_m_s, measures.pgd) == pytest.approx(
            wanted, rel=1e-5
        )


def test_a_record_tells_by_its_acceleration_first():
    t = np.arange(0, 10, 0.01)
    a = np.sin(2 * np.pi * t)
    record = Record("r", 0.01, displacement=np.zeros(t.size), acceleration=a)
    assert intensity_measures(record).pga_g == pytest.approx(1 / STANDARD_GRAVITY, rel=1e-2)
    assert intensity_measures(record, channel="displacement").pga_g == 0.0
    assert intensity_measures(record, channel="displacement").pgv_pga_s == 0.0
    assert intensity_measures(record, channel="displacement").duration_5_95 == 0.0


def test_a_record_with_all_three_histories_is_taken_at_its_word(tmp_path):
    motion = cosine_motion(0.1, 1.3, H)
    write_record(motion, tmp_path / "m.csv")
    record = read_record(tmp_path / "m.csv")
    assert intensity_measures(record) == intensity_measures(motion)
    assert intensity_measures(record, channel="acceleration") != intensity_measures(motion)


def test_filter_and_baseline_of_a_record():
    t = np.arange(0, 20, 0.005)
    clean = np.exp(-(((t - 10) / 2) ** 2)) * np.sin(2 * np.pi * 2 * t)
    noisy = clean + 0.3 * np.sin(2 * np.pi * 60 * t)
    record = Record("r", 0.005, acceleration=noisy)
    assert intensity_measures(record).pga_g > 1.2 / STANDARD_GRAVITY
    filtered = intensity_measures(record, filter=Filter())
    assert filtered.pga_g == pytest.approx(np.abs(clean).max() / STANDARD_GRAVITY, rel=0.01)
    drifting = Record("r", 0.005, acceleration=clean + 0.2 + 0.01 * t)
    assert intensity_measures(drifting, baseline=1).pga_g == pytest.approx(
        np.abs(clean).max() / STANDARD_GRAVITY, rel=0.01
    )


def test_what_does_not_apply_is_refused():
    motion = cosine_motion(0.1, 1.0, H)
    with pytest.raises(MotionError, match="a motion is measured as driven"):
        intensity_measures(motion, filter=Filter())
    with pytest.raises(MotionError, match=r"has no velocity channel; choose the channel"):
        kinematics(Record("r", 0.01, displacement=np.zeros(20)), channel="velocity")
    with pytest.raises(MotionError, match="0 <= start < end <= 1"):
        significant_duration([1.0, 2.0], H, 0.9, 0.1)
    for measure in (arias_intensity, cumulative_absolute_velocity, significant_duration):
        with pytest.raises(MotionError, match="no samples"):
            measure([], H)


@pytest.mark.skipif(find_spec("eqsig") is None, reason="eqsig is not installed (test extra)")
@pytest.mark.parametrize("number", [2, 5, 11])
def test_measures_agree_with_eqsig(number):
    from eqsig import AccSignal, im

    motion = build_recorded_motion(read_record(FOLDER / f"synthetic_{number:02d}.csv"), 0.001)
    measures = intensity_measures(motion)
    other = AccSignal(motion.acceleration, motion.time_step)
    assert measures.pga_g == pytest.approx(other.pga / STANDARD_GRAVITY, rel=1e-12)
    # eqsig integrates by the trapezium rule: its drift after 10 s of 20 Hz content at 1 ms
    assert measures.pgv_m_s == pytest.approx(other.pgv, rel=1e-3)
    assert measures.pgd == pytest.approx(other.pgd, rel=0.02)
    # eqsig's g is 9.81 m/s^2
    arias = im.calc_arias_intensity(other)[-1] * 9.81 / STANDARD_GRAVITY
    assert measures.arias == pytest.approx(arias, rel=1e-6)
    assert measures.cav == pytest.approx(im.calc_cav(other)[-1], rel=1e-9)
    for end, ours in ((0.75, measures.duration_5_75), (0.95, measures.duration_5_95)):
        # eqsig counts whole samples inside the interval
        theirs = im.calc_sig_dur_vals(motion.acceleration, motion.time_step, 0.05, end)
        assert ours == pytest.approx(theirs, abs=2.1 * motion.time_step)
