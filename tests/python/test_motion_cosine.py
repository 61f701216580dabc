"""Cosine pulses against their closed form."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsr2.config.motion_source import Range
from vsr2.errors import MotionError
from vsr2.motion import STANDARD_GRAVITY, cosine_measures, cosine_motion, cosine_parameters
from vsr2.motion.cosine import grid_values

positive = st.floats(1e-3, 1e3)


@given(pga=positive, ratio=positive)
def test_parameters_and_measures_are_inverse(pga, ratio):
    assert cosine_measures(*cosine_parameters(pga, ratio)) == pytest.approx((pga, ratio), rel=1e-13)


def test_parameters_follow_the_formula():
    amplitude, frequency = cosine_parameters(0.5, 0.1)
    assert frequency == pytest.approx(1 / (2 * math.pi * 0.1))
    assert amplitude * (2 * math.pi * frequency) ** 2 == pytest.approx(0.5 * STANDARD_GRAVITY)
    assert amplitude * 2 * math.pi * frequency == pytest.approx(0.1 * 0.5 * STANDARD_GRAVITY)


@given(
    amplitude=st.floats(1e-4, 1.0),
    frequency=st.floats(0.2, 20.0),
    time_step=st.floats(1e-4, 5e-3),
)
def test_samples_are_the_analytic_values(amplitude, frequency, time_step):
    pulse = cosine_motion(amplitude, frequency, time_step)
    omega = 2 * math.pi * frequency
    t = pulse.times[:-1]
    # cosines of phases up to 2 pi carry 2 pi eps; ten times that for the products
    scale = 1e-14
    np.testing.assert_allclose(
        pulse.displacement[:-1], amplitude * (1 - np.cos(omega * t)), rtol=0, atol=scale * amplitude
    )
    np.testing.assert_allclose(
        pulse.velocity[:-1],
        amplitude * omega * np.sin(omega * t),
        rtol=0,
        atol=scale * amplitude * omega,
    )
    np.testing.assert_allclose(
        pulse.acceleration[:-1], amplitude * omega**2 * np.cos(omega * t), rtol=0,
        atol=scale * amplitude * omega**2,
    )  # fmt: skip


@given(frequency=st.floats(0.2, 20.0), time_step=st.floats(1e-4, 5e-3))
def test_it_ends_at_rest_with_the_first_sample_after_the_period(frequency, time_step):
    pulse = cosine_motion(0.1, frequency, time_step)
    assert pulse.displacement[-1] == pulse.velocity[-1] == pulse.acceleration[-1] == 0.0
    period = 1 / frequency
    assert pulse.duration >= period - 2e-9 * time_step
    assert pulse.duration < period + time_step
    assert pulse.times[-2] < period


def test_a_period_of_integer_steps_has_no_extra_sample():
    # in floating point 1 / F / step is often just above the whole number
    assert any(1 / (1 / (steps * 0.001)) / 0.001 > steps for steps in range(10, 600))
    for steps in range(10, 600):
        assert cosine_motion(0.1, 1 / (steps * 0.001), 0.001).displacement.size == steps + 1


def test_an_odd_period_is_not_stretched():
    pulse = cosine_motion(0.1, 3.0, 0.001)
    assert pulse.displacement.size == 335  # 333.3 steps, rounded up, and the start
    half = np.argmax(pulse.displacement)
    assert pulse.times[half] == pytest.approx(1 / 6, abs=5e-4)


@pytest.mark.parametrize(("pga", "ratio"), [(0.05, 0.02), (0.5, 0.1), (1.5, 0.3)])
def test_the_driven_measures_are_those_asked_for(pga, ratio):
    pulse = cosine_motion(*cosine_parameters(pga, ratio), 0.001)
    # PGA is the first sample; PGV is missed by at most 1 - cos(half a step's phase)
    missed = 1 - math.cos(0.5 * 0.001 / ratio)
    assert pulse.pga_g == pytest.approx(pga, rel=1e-14)
    assert (1 - missed) * ratio * (1 - 1e-13) <= pulse.pgv_pga_s <= ratio * (1 + 1e-13)


@pytest.mark.parametrize(
    ("amplitude", "frequency", "time_step", "message"),
    [
        (0.0, 1.0, 0.001, "amplitude"),
        (0.1, -1.0, 0.001, "frequency"),
        (0.1, float("nan"), 0.001, "frequency"),
        (0.1, 1.0, 0.0, "time step"),
        (0.1, 200.0, 0.001, "lower the frequency"),
        (0.1, 1e-9, 0.001, "raise the frequency"),
        (0.1, 1e-300, 1e-300, "raise the frequency"),
        (1e308, 20.0, 0.001, "nan|inf"),
    ],
)
def test_impossible_pulses_are_refused(amplitude, frequency, time_step, message):
    with pytest.raises(MotionError, match=message):
        cosine_motion(amplitude, frequency, time_step)


def test_grid_values_include_the_maximum_and_read_cleanly():
    assert grid_values(Range(min=0.1, max=0.5, step=0.1)) == [0.1, 0.2, 0.3, 0.4, 0.5]
    assert grid_values(Range(min=0.1, max=0.49, step=0.1)) == [0.1, 0.2, 0.3, 0.4]
    assert grid_values(Range(min=0.3, max=0.3, step=1.0)) == [0.3]
