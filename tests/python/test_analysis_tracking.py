"""Tracking of the drive, against filters whose lag and gain are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from synthetic_results import make_log
from vsr2.analysis import tracking
from vsr2.errors import ResultError

STEP = 0.001


def gain_at(found, frequency):
    """Gain between lines; NaN: not excited there."""
    return float(np.interp(frequency, found.frequency, found.gain, left=np.nan, right=np.nan))


def record(seconds: float = 20.0, corner: float = 25.0, seed: int = 1) -> np.ndarray:
    """Broad-band displacement up to about `corner` [Hz] that starts and ends at rest [m]."""
    count = round(seconds / STEP)
    spectrum = np.fft.rfft(np.random.default_rng(seed).normal(size=count))
    frequency = np.fft.rfftfreq(count, STEP)
    # Falls as displacement spectra of earthquakes do, with f^-2.
    spectrum *= (frequency > 0.2) / (1 + frequency**2) / (1 + (frequency / corner) ** 8)
    motion = np.fft.irfft(spectrum, count) * np.hanning(count)
    return 0.05 * motion / np.abs(motion).max()


def times(command: np.ndarray, step: float = STEP) -> np.ndarray:
    return np.arange(len(command)) * step


def test_first_order_lag_of_the_position_motor() -> None:
    # p += 0.1 (x - p) each millisecond: H = 0.1 / (1 - 0.9 exp(-i w dt)).
    command = record()
    achieved = lfilter([0.1], [1.0, -0.9], command)
    got = tracking(make_log(times(command), command=command, achieved=achieved))
    # At low frequencies the delay is 0.9 / 0.1 = 9 steps; at 20 Hz it is 6.4.
    assert got.lag == pytest.approx(0.009, abs=3e-4)
    for frequency, printed in ((5.0, 0.96), (10.0, 0.86), (20.0, 0.64)):
        exact = 0.1 / (1 - 0.9 * np.exp(-2j * np.pi * frequency * STEP))
        assert abs(exact) == pytest.approx(printed, abs=0.005)
        # The delay within a segment costs lag / segment = 9 ms / 4 s, a quarter of a per cent.
        assert gain_at(got, frequency) == pytest.approx(abs(exact), rel=0.005)
        line = np.argmin(np.abs(got.frequency - frequency))
        assert got.phase[line] == pytest.approx(np.angle(exact), abs=0.01)
        assert got.coherence[line] > 0.999
    error = achieved - command
    assert got.peak_error == np.abs(error).max()
    assert got.peak_command == pytest.approx(0.05)


@pytest.mark.parametrize("decimation", [1, 5, 10])
@pytest.mark.parametrize("delay", [0.0, 0.0031, -0.0123, 0.0567])
def test_pure_delay(delay: float, decimation: int) -> None:
    # A delay between samples, exact for a band-limited motion that is at rest at both ends.
    command = record(corner=12.0)
    frequency = np.fft.rfftfreq(len(command), STEP)
    achieved = np.fft.irfft(
        np.fft.rfft(command) * np.exp(-2j * np.pi * frequency * delay), len(command)
    )
    log = make_log(
        times(command)[::decimation],
        command=command[::decimation],
        achieved=achieved[::decimation],
    )
    got = tracking(log)
    # A hundredth of the finest sample; the log may be ten times coarser.
    assert got.lag == pytest.approx(delay, abs=1e-5)
    assert gain_at(got, 5.0) == pytest.approx(1.0, abs=0.01)


def test_exact_drive_has_no_error() -> None:
    command = record(5.0)
    got = tracking(make_log(times(command), command=command))
    assert (got.peak_error, got.rms_error) == (0.0, 0.0)
    assert got.lag == pytest.approx(0.0, abs=1e-8)
    excited = np.isfinite(got.gain)
    assert excited.sum() > 50
    np.testing.assert_allclose(got.gain[excited], 1.0, rtol=1e-9)
    np.testing.assert_allclose(got.phase[excited], 0.0, atol=1e-9)


def test_power_is_the_mean_square_acceleration() -> None:
    # Parseval: the integral of a one-sided density is the mean square.
    command = record()
    got = tracking(make_log(times(command), command=command, achieved=2 * command))
    acceleration = np.diff(command, 2) / STEP**2
    spacing = got.frequency[1]
    # The mean over n samples of n - 2 second differences.
    assert got.commanded_power.sum() * spacing == pytest.approx(np.mean(acceleration**2), rel=1e-3)
    np.testing.assert_allclose(got.achieved_power, 4 * got.commanded_power, rtol=1e-9)


def test_cosine_pulse_with_a_long_rest_after_it() -> None:
    time = np.arange(0.0, 5.0, STEP)
    period = 0.5
    pulse = time < period
    command = np.where(pulse, 0.05 * (1 - np.cos(2 * np.pi * time / period)), 0.0)
    got = tracking(make_log(time, command=command, achieved=lfilter([0.1], [1, -0.9], command)))
    assert got.lag == pytest.approx(0.009, abs=5e-4)
    assert gain_at(got, 5.0) == pytest.approx(0.958, abs=0.01)
    # The rest does not dilute the mean: the lag of 9 ms times the rms velocity of the pulse.
    speed = 0.05 * 2 * np.pi / period / np.sqrt(2)
    assert got.rms_error == pytest.approx(0.009 * speed, rel=0.05)


def test_lines_without_excitation_are_unknown() -> None:
    command = record(corner=5.0)
    got = tracking(make_log(times(command), command=command))
    assert np.isnan(got.gain[got.frequency > 100.0]).all()
    assert np.isnan(gain_at(got, 100.0))
    assert np.isfinite(gain_at(got, 5.0))


def test_incoherent_noise_lowers_the_coherence() -> None:
    command = record()
    noise = record(seed=2)
    got = tracking(make_log(times(command), command=command, achieved=command + noise))
    band = (got.frequency > 1) & (got.frequency < 20)
    # Equal powers: half of the response is linear in the command.
    assert np.median(got.coherence[band]) == pytest.approx(0.5, abs=0.15)


def test_settling_rows_do_not_count() -> None:
    time = np.arange(-200, 1000) * STEP
    command = np.where(time > 0, 0.01 * np.sin(2 * np.pi * 5 * time) ** 2, 0.0)
    achieved = command + np.where(time < 0, 1.0, 0.0)
    assert tracking(make_log(time, command=command, achieved=achieved)).peak_error == 0.0


def test_no_motion_has_errors_but_no_lag() -> None:
    time = np.arange(100) * STEP
    got = tracking(make_log(time, achieved=np.full(100, 0.002)))
    assert got.peak_error == got.rms_error == pytest.approx(0.002)
    assert np.isnan(got.lag)
    assert np.isnan(got.gain).all()


def test_a_micrometre_is_tracked_like_a_metre() -> None:
    command = record(5.0)
    achieved = lfilter([0.1], [1, -0.9], command)
    large = tracking(make_log(times(command), command=command, achieved=achieved))
    small = tracking(make_log(times(command), command=1e-200 * command, achieved=1e-200 * achieved))
    assert small.lag == pytest.approx(large.lag, rel=1e-6)
    np.testing.assert_allclose(small.gain, large.gain, rtol=1e-6)


def test_logs_that_cannot_be_used() -> None:
    time = np.arange(40) * STEP
    with pytest.raises(ResultError, match=r"has 10 rows.*output\.log_every"):
        tracking(make_log(time[:10]))
    uneven = time.copy()
    uneven[20:] += 0.5 * STEP
    with pytest.raises(ResultError, match="not evenly spaced"):
        tracking(make_log(uneven))
    achieved = np.zeros(40)
    achieved[30:] = np.nan
    with pytest.raises(ResultError, match=r"not finite at t = 0\.03 s"):
        tracking(make_log(time, achieved=achieved))
