"""Resampling in time against closed forms: sines (with the spline's exact error) and quintics."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsr2.errors import MotionError
from vsr2.motion import resample

TIME_STEP = 0.001
SAMPLINGS = [pytest.param(1 / 800, id="800Hz"), pytest.param(1 / 200, id="200Hz")]


def sine_error(frequency, sample_interval, *, derivative=0):
    """Greatest error of the spline through samples of a unit sine, relative to its amplitude.

    Through samples of exp(i w t) at unit interval, the cardinal spline of degree n = 5 is the sum
    of c_k exp(i (w + 2 pi k) t) with c_k = (w + 2 pi k)^-(n+1) / sum_j (w + 2 pi j)^-(n+1)
    (the exponential Euler spline of Schoenberg 1973, *Cardinal Spline Interpolation*). The error of
    the d-th derivative is at most w^d (1 - c_0) + sum_(k != 0) c_k |w + 2 pi k|^d, here divided by
    w^d. It holds away from the record's ends.

    """
    omega = 2 * np.pi * frequency * sample_interval
    multiples = np.concatenate([np.arange(-200, 0), np.arange(1, 201)])
    images = omega + 2 * np.pi * multiples
    weights = (omega / images) ** (5 + 1)
    total = 1 + weights.sum()
    own = weights.sum() / total
    folded = float((weights * np.abs(images / omega) ** derivative).sum()) / total
    return float(own + folded)


def sine(frequency, interval, duration=4.0, phase=0.3):
    t = np.arange(round(duration / interval) + 1) * interval
    return np.sin(2 * np.pi * frequency * t + phase)


def errors_against(frequency, resampled, phase=0.3):
    """Greatest error of displacement, velocity, acceleration, each relative, away from the ends."""
    omega = 2 * np.pi * frequency
    t = np.arange(resampled.displacement.size - 1) * TIME_STEP
    middle = (t > 0.5) & (t < t[-1] - 0.5)
    exact = [
        np.sin(omega * t + phase),
        omega * np.cos(omega * t + phase),
        -(omega**2) * np.sin(omega * t + phase),
    ]
    got = [resampled.displacement, resampled.velocity, resampled.acceleration]
    return [
        np.abs(g[:-1] - e)[middle].max() / omega**d
        for d, (g, e) in enumerate(zip(got, exact, strict=True))
    ]


@pytest.mark.parametrize("interval", SAMPLINGS)
@pytest.mark.parametrize("frequency", [1.0, 5.0, 10.0, 25.0, 50.0])
def test_a_sine_is_met_within_the_closed_form_and_not_better(interval, frequency):
    resampled = resample(sine(frequency, interval), interval, TIME_STEP)
    for derivative, error in enumerate(errors_against(frequency, resampled)):
        bound = sine_error(frequency, interval, derivative=derivative)
        # phases up to 200 pi round to some 1e-14; derivatives amplify that by 1 / (w h)^d
        rounding = 5e-14 / (2 * np.pi * frequency * interval) ** derivative
        assert error <= bound + rounding
        if bound > 10 * rounding:
            assert error > 0.3 * bound


@pytest.mark.parametrize(
    ("interval", "displacement", "acceleration"),
    # of a 25 Hz sine, the upper corner of the usual band-pass
    [(1 / 800, 3.9e-9, 2.2e-6), (1 / 200, 2.2e-5, 6.5e-4)],
)
def test_the_errors_at_25_hz_are_as_stated(interval, displacement, acceleration):
    assert 0.5 * displacement < sine_error(25.0, interval) < displacement
    assert 0.5 * acceleration < sine_error(25.0, interval, derivative=2) < acceleration
    resampled = resample(sine(25.0, interval), interval, TIME_STEP)
    errors = errors_against(25.0, resampled)
    assert errors[0] < displacement
    assert errors[2] < acceleration


@pytest.mark.parametrize("interval", SAMPLINGS)
@pytest.mark.parametrize("frequency", [3.0, 12.0, 25.0])
def test_the_stated_error_is_above_the_real_one(interval, frequency):
    resampled = resample(sine(frequency, interval), interval, TIME_STEP)
    assert resampled.error > errors_against(frequency, resampled)[0]
    assert 0 < resampled.error_rms < resampled.error
    # it is the error at twice the interval: not below that closed form, less a phase that may miss
    assert resampled.error > 0.5 * sine_error(frequency, 2 * interval)


def test_the_stated_error_sees_what_the_record_does_not_resolve():
    rough = np.random.default_rng(1).standard_normal(2001)
    smooth = sine(2.0, 1 / 800, duration=2.5)
    assert resample(rough, 1 / 800, TIME_STEP).error > 1.0
    assert resample(smooth, 1 / 800, TIME_STEP).error < 1e-10


@settings(max_examples=40)
@given(
    coefficients=st.lists(st.floats(-1, 1), min_size=6, max_size=6),
    rate=st.sampled_from([200, 250, 800, 977, 1000]),
)
def test_quintics_are_reproduced_with_their_derivatives(coefficients, rate):
    interval = 1 / rate
    quintic = np.polynomial.Polynomial(coefficients)
    resampled = resample(quintic(np.arange(rate + 1) * interval), interval, TIME_STEP)
    t = np.arange(resampled.displacement.size - 1) * TIME_STEP
    # the k-th difference of samples rounded to 1e-15 is divided by the k-th power of the interval
    for k, signal in enumerate(
        (resampled.displacement, resampled.velocity, resampled.acceleration)
    ):
        exact = quintic.deriv(k)(t) if k else quintic(t)
        np.testing.assert_allclose(signal[:-1], exact, rtol=0, atol=1e-13 * (10.0 * rate) ** k)


def test_the_time_base_is_kept():
    """A sample-by-step replay would be 1.25 times too fast at 800 Hz."""
    interval = 1 / 800
    t = np.arange(8001) * interval
    peak_at = 6.2
    bump = np.exp(-(((t - peak_at) / 0.3) ** 2))
    resampled = resample(bump, interval, TIME_STEP)
    assert np.argmax(resampled.displacement) * TIME_STEP == pytest.approx(peak_at, abs=0.5e-3)
    assert (resampled.displacement.size - 2) * TIME_STEP == pytest.approx(t[-1])


def test_one_more_sample_holds_the_end_at_rest():
    resampled = resample(sine(3.0, 1 / 800), 1 / 800, TIME_STEP)
    assert resampled.displacement.size == 4002
    assert resampled.displacement[-1] == resampled.displacement[-2]
    assert resampled.velocity[-1] == resampled.acceleration[-1] == 0.0


@pytest.mark.parametrize("steps", [1, 2, 5])
def test_samples_that_fall_on_samples_pass_unchanged(steps):
    values = sine(2.0, 0.001)
    resampled = resample(values, 0.001, steps * 0.001)
    np.testing.assert_array_equal(resampled.displacement[:-1], values[::steps])
    assert resampled.error == resampled.error_rms == 0.0


@pytest.mark.parametrize("frequency", [520.0, 700.0, 990.0])
def test_content_that_would_fold_down_is_refused(frequency):
    record = sine(5.0, 1 / 2000) + 1e-3 * sine(frequency, 1 / 2000)
    with pytest.raises(MotionError, match=r"above 500 Hz.*motion.filter"):
        resample(record, 1 / 2000, TIME_STEP, name="file.csv")


def test_content_below_the_new_nyquist_frequency_is_kept():
    interval = 1 / 2000
    resampled = resample(sine(50.0, interval), interval, TIME_STEP)
    # every second sample: exact
    assert errors_against(50.0, resampled)[0] < 1e-14
    assert errors_against(50.0, resampled)[2] < 2 * sine_error(50.0, interval, derivative=2)


def test_a_permanent_displacement_is_not_taken_for_aliasing():
    t = np.arange(8001) / 2000
    step = 0.5 * (1 + np.tanh((t - 2) / 0.05))
    resampled = resample(step, 1 / 2000, TIME_STEP)
    assert resampled.displacement[-1] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("values", "interval", "time_step", "message"),
    [
        (np.zeros(15), 0.005, 0.001, "at least 16"),
        (np.zeros((20, 2)), 0.005, 0.001, "one dimension"),
        (np.zeros(20), 0.0, 0.001, "sampling interval"),
        (np.zeros(20), 0.005, float("inf"), "time step"),
        (np.zeros(20), 1e6, 1e-6, "at most"),
    ],
)
def test_impossible_resampling_is_refused(values, interval, time_step, message):
    with pytest.raises(MotionError, match=message):
        resample(values, interval, time_step)
