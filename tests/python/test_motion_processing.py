"""Filtering, integration and ends, against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import butter, sosfiltfilt

from vsr2.config.motion_source import Filter
from vsr2.errors import MotionError
from vsr2.motion import STANDARD_GRAVITY, band_pass, pga_g, remove_baseline
from vsr2.motion.processing import (
    differentiate,
    integrate_acceleration,
    integrate_velocity,
    rest_level,
    taper_ends,
)

H = 1 / 800
T = np.arange(32001) * H


def amplitude_and_phase(signal, frequency, interval):
    """Of the part at `frequency` in the middle half, where the filter's ends have rung out."""
    middle = slice(signal.size // 4, 3 * signal.size // 4)
    turns = 2 * np.pi * frequency * np.arange(signal.size)[middle] * interval
    (c, s), *_ = np.linalg.lstsq(
        np.vstack([np.cos(turns), np.sin(turns)]).T, signal[middle], rcond=None
    )
    return np.hypot(c, s), np.arctan2(c, s)


@pytest.mark.parametrize("order", [1, 3, 6])
@pytest.mark.parametrize("frequency", [0.05, 0.1, 0.5, 2.0, 25.0, 40.0])
def test_band_pass_has_the_butterworth_gain_squared_and_no_phase(order, frequency):
    """Bilinear Butterworth: |H|^2 = 1 / (1 + u^(2 n)), u the band's mapped frequency."""
    interval = 0.01
    wave = np.sin(2 * np.pi * frequency * np.arange(60_001) * interval)
    gain, phase = amplitude_and_phase(
        band_pass(wave, interval, Filter(order=order)), frequency, interval
    )
    low, high, here = np.tan(np.pi * interval * np.array([0.1, 25.0, frequency]))
    u = (here**2 - low * high) / (here * (high - low))
    assert gain == pytest.approx(1 / (1 + u ** (2 * order)), abs=1e-4)
    if gain > 0.1:
        assert phase == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("filter", [Filter(), Filter(low=0.0, high=3.0, order=2)])
@pytest.mark.parametrize("size", [16, 20, 5000])
def test_a_band_pass_is_scipys_to_the_last_bit_whatever_stands_beside_it(size, filter):
    signals = np.cumsum(np.random.default_rng(size).standard_normal((3, size)), axis=1)
    corners = [filter.low, filter.high] if filter.low else filter.high
    kind = "bandpass" if filter.low else "lowpass"
    sections = butter(filter.order, corners, kind, fs=1 / H, output="sos")
    # scipy's own padding, which these sections without a zero at the origin have.
    padding = min(3 * (2 * len(sections) + 1), size - 1)
    together = band_pass(signals, H, filter)
    for signal, beside in zip(signals, together, strict=True):
        expected = sosfiltfilt(sections, signal, padlen=padding)
        np.testing.assert_array_equal(band_pass(signal, H, filter), expected)
        np.testing.assert_array_equal(beside, expected)


def test_a_band_pass_takes_the_offset_and_a_low_pass_keeps_it():
    wave = np.sin(2 * np.pi * 2 * T)
    middle = slice(8000, 24000)
    assert abs(band_pass(5 + wave, H, Filter())[middle].mean()) < 1e-3
    assert band_pass(5 + wave, H, Filter(low=0.0))[middle].mean() == pytest.approx(5, abs=1e-3)


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        (Filter(high=400.0), r"filter.high = 400 Hz is not below .* 400 Hz"),
        (Filter(high=1000.0), "quake.csv: filter.high"),
        (Filter(low=1e-7), "set 0 for none"),
    ],
)
def test_filters_that_do_not_fit_are_refused(chosen, message):
    with pytest.raises(MotionError, match=message):
        band_pass(np.sin(T), H, chosen, name="quake.csv")


@pytest.mark.parametrize("count", [16, 17, 40])
@pytest.mark.parametrize("chosen", [Filter(), Filter(order=10), Filter(low=0, order=10)])
def test_short_records_can_be_filtered(count, chosen):
    assert np.isfinite(band_pass(np.sin(np.arange(count)), H, chosen)).all()


def test_the_rest_before_shaking_tells_the_offset():
    noise = 1e-3 * np.random.default_rng(3).standard_normal(T.size)
    shaking = np.where(T > 5, np.sin(2 * np.pi * 2 * (T - 5)) + 0.3, 0.0)
    # the mean of 4000 samples: 1e-3 / sqrt(4000), five times
    assert rest_level(0.7 + noise + shaking, H) == pytest.approx(0.7, abs=1e-4)


def test_a_record_cut_to_the_shaking_takes_its_mean():
    wave = 0.7 + np.cos(2 * np.pi * 5 * T[:-1])
    assert rest_level(wave, H) == pytest.approx(0.7, abs=1e-12)


def bump(t, middle=20.0, width=0.4):
    """A smooth pulse and its second derivative."""
    u = (t - middle) / width
    return np.exp(-(u**2)), (4 * u**2 - 2) * np.exp(-(u**2)) / width**2


@given(offset=st.floats(-0.5, 0.5), amplitude=st.floats(0.01, 1.0))
def test_integration_undoes_differentiation_and_any_offset(offset, amplitude):
    displacement, acceleration = bump(T)
    integrated = integrate_acceleration(amplitude * acceleration + offset, H).displacement
    # an offset's drift would be offset T^2 / 2 = 400 m; quadrature by cubic splines: (h / width)^4
    assert np.abs(integrated - amplitude * displacement).max() < 1e-8 * amplitude + 1e-10


def test_integration_and_band_pass_exchange():
    """Both are linear and the same at all times, so their order does not matter."""
    displacement, acceleration = bump(T, width=0.3)
    integrated = integrate_acceleration(acceleration, H, Filter()).displacement
    passed = band_pass(displacement, H, Filter())
    passed = passed - passed[0]
    # what is left is the filter's response beyond the record's ends
    assert np.abs(integrated - passed).max() < 0.01 * np.abs(passed).max()


def test_filtered_integration_does_not_drift_on_noise():
    noise = np.random.default_rng(5).standard_normal(T.size) * 0.1
    free = integrate_acceleration(noise, H).displacement
    held = integrate_acceleration(noise + 0.2, H, Filter()).displacement
    assert np.abs(free).max() > 0.05
    # white noise of density 0.1^2 h, integrated twice above 0.1 Hz: s^2 = S / (3 (2 pi)^4 f^3),
    # with S = 2 h 0.1^2; five of it
    deviation = np.sqrt(2 * H * 0.01 / (3 * (2 * np.pi) ** 4 * 0.1**3))
    assert np.abs(held - held.mean()).max() < 5 * deviation


def test_a_record_at_rest_at_its_ends_is_left_alone():
    displacement, _ = bump(T)
    np.testing.assert_array_equal(taper_ends(displacement, H), displacement - displacement[0])
    pulse = 0.1 * (1 - np.cos(2 * np.pi * 2.0 * np.arange(401) * H))
    np.testing.assert_array_equal(taper_ends(pulse, H), pulse - pulse[0])


@pytest.mark.parametrize("phase", [0.0, 0.7, 2.0, -2.5])
def test_moving_ends_are_brought_to_rest(phase):
    wave = 0.3 + 0.1 * np.sin(2 * np.pi * 1.3 * T + phase)
    tapered = taper_ends(wave, H)
    velocity = np.gradient(tapered, H, edge_order=2)
    assert tapered[0] == 0.0
    assert np.abs(velocity[[0, -1]]).max() < 1e-3 * np.abs(velocity).max()
    inside = slice(math.ceil(0.5 / H), -math.ceil(0.5 / H))
    np.testing.assert_allclose(tapered[inside], (wave - wave[0])[inside], rtol=0, atol=1e-15)
    assert tapered[-1] == pytest.approx(wave[-1] - wave[0])


def test_the_recorded_pga_is_the_peak_after_the_band_pass():
    envelope = np.exp(-(((T - 20) / 3) ** 2))
    acceleration = 0.2 + envelope * (
        3 * np.sin(2 * np.pi * 3 * T) + 5 * np.sin(2 * np.pi * 200 * T)
    )
    assert pga_g(band_pass(acceleration, H, Filter())) == pytest.approx(
        3.0 / STANDARD_GRAVITY, rel=0.02
    )
    assert pga_g(band_pass(acceleration, H, Filter(high=390.0))) > 7.0 / STANDARD_GRAVITY


@pytest.mark.parametrize("degree", [0, 1, 2, 5, 10])
def test_a_baseline_takes_its_polynomial_and_no_more(degree):
    s = np.linspace(0, 1, 5000)
    polynomial = sum((-1) ** k * 3 * s**k for k in range(degree + 1))
    # orthogonal to what is taken: nothing happens the second time
    once = remove_baseline(polynomial + np.sin(2 * np.pi * 40 * s), degree)
    np.testing.assert_allclose(remove_baseline(once, degree), once, rtol=0, atol=1e-12)
    np.testing.assert_allclose(remove_baseline(polynomial, degree), 0, atol=1e-10)
    # 40 waves hardly look like a polynomial of degree 10
    assert np.abs(once - np.sin(2 * np.pi * 40 * s))[500:-500].max() < 0.05
    if degree == 0:
        assert once.mean() == pytest.approx(0.0, abs=1e-12)


def test_a_baseline_of_higher_degree_stays_when_a_lower_is_taken():
    s = np.linspace(-1, 1, 1001)
    np.testing.assert_allclose(remove_baseline(5 + 2 * s + s**2, 1), s**2 - 1 / 3, atol=2e-3)


@pytest.mark.parametrize("degree", [-1, 11])
def test_impossible_baselines_are_refused(degree):
    with pytest.raises(MotionError, match=r"q\.csv: baseline of degree"):
        remove_baseline(np.zeros(50), degree, name="q.csv")


def velocity_of_bump(t, middle=20.0, width=0.4):
    u = (t - middle) / width
    return -2 * u * np.exp(-(u**2)) / width


@pytest.mark.parametrize("chosen", [None, Filter(low=0.01, high=300.0)])
def test_a_velocity_integrates_and_differentiates(chosen):
    displacement, acceleration = bump(T)
    found = integrate_velocity(velocity_of_bump(T), H, chosen)
    # cubic splines, (h / width)^4 and (h / width)^3; the wide band-pass takes the slowest per cents
    tolerance = 1e-6 if chosen is None else 0.05
    peak = np.abs(acceleration).max()
    np.testing.assert_allclose(found.displacement, displacement, rtol=0, atol=tolerance)
    np.testing.assert_allclose(found.acceleration, acceleration, rtol=0, atol=tolerance * peak)
    assert found.displacement[0] == 0.0


def test_an_offset_of_the_velocity_drifts_until_a_baseline_takes_it():
    velocity = velocity_of_bump(T) + 0.1
    assert integrate_velocity(velocity, H).displacement[-1] == pytest.approx(4.0, rel=1e-6)
    clean = integrate_velocity(remove_baseline(velocity, 0), H)
    np.testing.assert_allclose(clean.displacement, bump(T)[0], rtol=0, atol=1e-6)


def test_the_three_histories_belong_together():
    displacement, acceleration = bump(T)
    for found in (
        integrate_acceleration(acceleration + 0.3, H),
        differentiate(displacement + 0.3, H),
    ):
        np.testing.assert_allclose(found.displacement, displacement, rtol=0, atol=1e-7)
        np.testing.assert_allclose(found.velocity, velocity_of_bump(T), rtol=0, atol=1e-6)
        np.testing.assert_allclose(found.acceleration, acceleration, rtol=0, atol=1e-5)
