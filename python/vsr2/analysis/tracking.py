"""How well the pedestal follows its command (supplement S1.3, Fig. S1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.errors import ResultError
from vsr2.one_line import counted
from vsr2.results import TrialLog

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TrackingConstants:
    """How a log is compared with its command; chosen by hand.

    Attributes:
        segment: length of a spectral segment [s]: lines 0.25 Hz apart.
        least_rows: rows of a log that are enough for a lag and a spectrum.
        excited: lines on which the command has less than this share of its largest power density
            are left NaN: there the ratio is one of leakage and rounding.
    """

    segment: float = 4.0
    least_rows: int = 16
    excited: float = 1e-6


TRACKING = TrackingConstants()


@dataclass(frozen=True, eq=False)
class Tracking:
    """Commanded against achieved pedestal motion of one trial.

    Attributes:
        peak_error: greatest magnitude of achieved minus commanded position [m].
        rms_error: root mean square of the same while the command moves [m].
        peak_command: greatest magnitude of the commanded position [m].
        lag: delay of the achieved motion that fits the command best [s]; positive: late; NaN: the
            command or the pedestal never moves.
        frequency: of the spectral lines, shape (n,) [Hz].
        gain: magnitude of achieved over commanded motion, shape (n,); NaN on lines that the command
            does not excite.
        phase: of achieved against commanded motion, shape (n,) [rad], within +-pi; negative: late.
        coherence: share of the achieved power that is linear in the command, shape (n,).
        commanded_power: one-sided power spectral density of the commanded acceleration, averaged
            over the log, shape (n,) [(m/s^2)^2/Hz].
        achieved_power: the same of the achieved acceleration.
    """

    peak_error: float
    rms_error: float
    peak_command: float
    lag: float
    frequency: Array
    gain: Array
    phase: Array
    coherence: Array
    commanded_power: Array
    achieved_power: Array


def tracking(log: TrialLog) -> Tracking:
    """Compare commanded and achieved pedestal motion of a trial, settling left out.

    Errors are of positions at equal times, so a pure delay counts as an error. The lag is the delay
    tau that maximises the cross-correlation of both positions, sum over t of x(t - tau) p(t), each
    held at its last value, refined between samples by the correlation's own Fourier series; low
    frequencies, where displacements are large, weigh most. The transfer function is H = S_xy / S_xx
    (cross over auto power spectral density, Welch's method, Hann windows a quarter apart) of the
    second differences of both positions: any linear filter relates them as it does the positions,
    and they are nearly white where positions are so red that leakage would cover the upper lines.
    The lag is taken out before and put back into the phase, because a delay between the windows
    biases Welch's ratio by about delay / segment.

    Raises:
        ResultError: fewer than 16 rows, times not evenly spaced, or values that are not finite.
    """
    during = log.time >= 0
    time = log.time[during]
    command = log.column("commanded_position")[during]
    achieved = log.column("pedestal_position")[during]
    interval = _interval(time)
    bad = np.flatnonzero(~(np.isfinite(command) & np.isfinite(achieved)))
    if bad.size:
        raise ResultError(
            f"tracking: the pedestal's position is not finite at t = {time[bad[0]]:g} s; the trial "
            "diverged, use its log up to there"
        )
    error = achieved - command
    moving = _moving(command)
    lag = _lag(command, achieved, interval)
    spectra = _spectra(command, achieved, interval, lag)
    return Tracking(
        peak_error=float(np.abs(error).max()),
        rms_error=float(np.sqrt(np.mean(error[moving] ** 2))),
        peak_command=float(np.abs(command).max()),
        lag=lag,
        **spectra,
    )


def _interval(time: Array) -> float:
    if time.size < TRACKING.least_rows:
        raise ResultError(
            f"tracking: the log has {counted(time.size, 'row')} from the motion's start on; "
            f"{TRACKING.least_rows} are needed, lower output.log_every"
        )
    steps = np.diff(time)
    interval = float(time[-1] - time[0]) / (time.size - 1)
    if not (interval > 0 and np.abs(steps - interval).max() <= 1e-6 * interval):
        raise ResultError("tracking: the log's times are not evenly spaced")
    return interval


def _moving(command: Array) -> slice:
    """From the start to the last change of the command; everything where it never changes."""
    changes = np.flatnonzero(np.diff(command))
    return slice(0, int(changes[-1]) + 2 if changes.size else command.size)


def _lag(command: Array, achieved: Array, interval: float) -> float:
    from scipy.fft import irfft, next_fast_len, rfft
    from scipy.optimize import minimize_scalar

    # Differences are zero beyond their ends where positions may hold an offset; the sum is undone
    # on the spectrum. The line at 0 carries no delay.
    x, y = np.diff(command), np.diff(achieved)
    peak, answer = np.abs(x).max(), np.abs(y).max()
    if peak == 0 or answer == 0:
        return float("nan")
    count = next_fast_len(2 * x.size, real=True)  # padded: no wrapping around
    # Scaled, because the squares of very small motions would vanish.
    cross = np.conj(rfft(x / peak, count)) * rfft(y / answer, count)
    omega = 2 * np.pi * np.arange(cross.size) / count
    cross[0] = 0.0
    cross[1:] /= 4.0 * np.sin(0.5 * omega[1:]) ** 2
    best = int(np.argmax(irfft(cross, count)))

    def negative(shift: float) -> float:
        return -float(np.real(np.sum(cross * np.exp(1j * omega * shift))))

    refined = minimize_scalar(
        negative, bounds=(best - 1.0, best + 1.0), method="bounded", options={"xatol": 1e-6}
    )
    # The bounded search never tries its starting sample; a pure delay lies exactly there.
    shift = best if negative(best) <= refined.fun else float(refined.x)
    return float(shift - count if shift > count / 2 else shift) * interval


def _spectra(command: Array, achieved: Array, interval: float, lag: float) -> dict[str, Array]:
    from scipy.signal import csd, welch

    # Of four hops: the squares of Hann windows three quarters apart add up to a constant, so that
    # every sample counts alike, those of a short pulse, too.
    segment = 4 * (
        min(command.size, max(TRACKING.least_rows, round(TRACKING.segment / interval))) // 4
    )
    # Zeros around give the first and last samples their full weight under the windows.
    x = np.pad(np.diff(command, 2), segment) / interval**2
    y = np.pad(np.diff(achieved, 2), segment) / interval**2
    shift = round(lag / interval) if np.isfinite(lag) else 0
    if abs(shift) >= segment:
        shift = 0
    y = np.roll(y, -shift)
    # Scaled, because the squares of very small motions would vanish.
    scale = float(np.abs(x).max()) or 1.0
    options = {"fs": 1.0 / interval, "nperseg": segment, "noverlap": 3 * segment // 4}
    options["detrend"] = False
    frequency, power = welch(x / scale, **options)
    cross = csd(x / scale, y / scale, **options)[1]
    answer = welch(y / scale, **options)[1]
    excited = power > TRACKING.excited * power.max()
    # The second difference has no power at 0 Hz, whatever leaks there.
    excited[0] = False
    transfer = np.full(cross.shape, complex(np.nan, np.nan))
    transfer[excited] = cross[excited] / power[excited]
    delayed = transfer * np.exp(-2j * np.pi * frequency * shift * interval)
    coherence = np.full(power.shape, np.nan)
    answered = excited & (answer > 0)
    coherence[answered] = np.abs(cross[answered]) ** 2 / (power[answered] * answer[answered])
    # Welch's mean is over the segments, of which many hold zeros only; this one is over the log.
    segments = (x.size - 3 * segment // 4) // (segment // 4)
    density = scale**2 * segments * (segment // 4) / command.size
    return {
        "frequency": frequency,
        "gain": np.abs(transfer),
        "phase": np.angle(delayed),
        "coherence": coherence,
        "commanded_power": power * density,
        "achieved_power": answer * density,
    }
