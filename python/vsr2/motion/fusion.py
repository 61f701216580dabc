"""One motion from a table's displacement and acceleration channels together.

A displacement transducer is good where the motion is slow, an accelerometer where it is fast; what
each says of the other's band is noise. Both are brought together by the fixed-interval smoother of
Rauch, Tung & Striebel (1965, AIAA J. 3(8)) in the model

- motion: displacement, velocity, acceleration; the acceleration is a Wiener process whose
  increments have three times the variance that the record's own acceleration has while it shakes,
  less the noise's share. So shaking well above the noise is hardly smoothed, and what neither
  channel tells from noise is smoothed away;
- channels: motion plus noise. The noise is a first-order autoregressive part plus white noise; both
  are fitted to the record's own rest by its autocovariances at lags 0, 1 and 2.

Filter and smoother are in their steady state, as after a long rest, which makes them linear filters
with constant gains. So the cost is that of a few recursions, and a record must start at rest.

Standard errors come from the smoother and hold if the channels differ by noise only. Where they
differ by more (a transducer's gain, a table that bends), the innovations are greater than the model
says; their root mean square over the shaking, relative to it, is `consistency`, and standard errors
are multiplied by it where it is above 1 (the ratio of Birge 1932, Phys. Rev. 40). That is honest on
average, not sample by sample; :func:`input_uncertainty` tells in which band the channels disagree.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.errors import MotionError
from vsr2.motion.motion import Array
from vsr2.motion.processing import PROCESSING, Kinematics, remove_baseline, rest_level
from vsr2.motion.record import Record


@dataclass(frozen=True)
class FusionConstants:
    """How two channels are brought together; chosen by hand.

    Attributes:
        rest_window: length of the windows in which rest is looked for [s].
        rest_ratio: at rest: variance within this factor of the quiet windows' in both channels.
        quiet_share: the quiet windows: this share of them, with the least variance.
        shaking_share: shaking lasts from this share of the squared acceleration's sum to one minus
            it.
        peak_shaking: prior variance over the shaking's mean: its peaks, which overturn, must not be
            smoothed.
        run_up: most samples for which the filter runs up to the record's start.
        segment: length of the segments of its spectra [s].
        least_wiener: prior variance over the noise's, where weak shaking hides in the noise.
        fewest_shaking: samples that count as shaking; of fewer, all of the record's do.
        most_persistence: of a channel's noise: beyond it, noise is a drift.
        most_share: of the autoregressive part in it: some of it is white.
        bands: of :func:`input_uncertainty` [Hz].
    """

    rest_window: float = 0.5
    rest_ratio: float = 2.0
    quiet_share: float = 0.1
    shaking_share: float = 0.05
    peak_shaking: float = 3.0
    run_up: int = 4000
    segment: float = 4.0
    least_wiener: float = 0.1
    fewest_shaking: int = 16
    most_persistence: float = 0.99
    most_share: float = 0.98
    bands: tuple[tuple[float, float], ...] = (
        (0.1, 0.5), (0.5, 1.0), (1.0, 2.0), (2.0, 4.0), (4.0, 8.0), (8.0, 12.0), (12.0, 25.0),
    )  # fmt: skip


FUSION = FusionConstants()


@dataclass(frozen=True)
class Noise:
    """Noise of a channel: an autoregressive part of order one and white noise.

    Attributes:
        deviation: standard deviation of both together [unit of the channel].
        share: share of the autoregressive part in the variance, 0 to 1.
        persistence: correlation of the autoregressive part between samples, 0 to 1.
    """

    deviation: float
    share: float = 0.0
    persistence: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.deviation) and self.deviation > 0):
            raise MotionError(f"noise: deviation {self.deviation} is not positive and finite")
        if not (0 <= self.share < 1 and 0 <= self.persistence < 1):
            raise MotionError(
                f"noise: share {self.share} and persistence {self.persistence} must lie from 0 to "
                "below 1"
            )


@dataclass(frozen=True)
class ChannelNoise:
    """Noise of a record's two channels.

    Attributes:
        displacement: [m].
        acceleration: [m/s^2].
        rest: duration of the rest they were estimated from [s]; 0 if given.
    """

    displacement: Noise
    acceleration: Noise
    rest: float = 0.0


@dataclass(frozen=True, eq=False)
class FusedMotion(Kinematics):
    """What a table did, as far as its two channels tell.

    Attributes:
        sample_interval: [s].
        displacement_error: standard error (n,) [m].
        velocity_error: standard error (n,) [m/s].
        acceleration_error: standard error (n,) [m/s^2].
        noise: of the channels.
        consistency: disagreement of the channels over what their noise explains [1].
    """

    sample_interval: float
    displacement_error: Array
    velocity_error: Array
    acceleration_error: Array
    noise: ChannelNoise
    consistency: float


@dataclass(frozen=True, eq=False)
class InputUncertainty:
    """How far a record's two channels agree, band by band, over its shaking.

    Attributes:
        bands: shape (k, 2), lower and upper edge [Hz].
        displacement_rms: shape (k,), of the displacement differentiated twice [m/s^2].
        acceleration_rms: shape (k,), of the accelerometer [m/s^2].
        difference_rms: shape (k,), of their difference [m/s^2].
        coherence: shape (k,), `|S_ax|^2 / (S_aa S_xx)` with the spectra summed over the band [1].
        gain: shape (k,), accelerometer over displacement, `|S_ax| / S_xx`, both as accelerations
            [1].
    """

    bands: Array
    displacement_rms: Array
    acceleration_rms: Array
    difference_rms: Array
    coherence: Array
    gain: Array


def channel_noise(record: Record) -> ChannelNoise:
    """Noise of both channels, from the record's own rest.

    Rest are the windows of 0.5 s in which the variance of both channels is within a factor of 2 of
    the quietest tenth's median. A record without rest (cut to the shaking) overstates its noise.

    Raises:
        MotionError: a channel is missing, no window is at rest, or a channel is exactly constant
            there (a computed motion has no noise: drive one of its channels, or give `noise`).
    """
    displacement, acceleration = _both_channels(record)
    length = round(FUSION.rest_window / record.sample_interval)
    count = record.size // max(length, 1)
    if length < 8 or count < 1:
        raise MotionError(
            f"{record.label}: {record.duration:g} s sampled every {record.sample_interval:g} s "
            f"hold no rest of {FUSION.rest_window:g} s to tell noise from; give `noise`, or drive "
            "one channel"
        )
    windows = [
        signal[: count * length].reshape(count, length) for signal in (displacement, acceleration)
    ]
    at_rest = np.ones(count, dtype=bool)
    for window in windows:
        variance = window.var(axis=1)
        quiet = np.sort(variance)[: max(1, math.ceil(FUSION.quiet_share * count))]
        at_rest &= variance <= FUSION.rest_ratio * float(np.median(quiet))
    if not at_rest.any():
        raise MotionError(
            f"{record.label}: no {FUSION.rest_window:g} s in which both channels rest, so their "
            "noise cannot be estimated; give `noise`, or drive one channel"
        )
    return ChannelNoise(
        displacement=_fitted_noise(record, windows[0][at_rest], "displacement"),
        acceleration=_fitted_noise(record, windows[1][at_rest], "acceleration"),
        rest=float(at_rest.sum()) * length * record.sample_interval,
    )


def fuse(
    record: Record, *, noise: ChannelNoise | None = None, baseline: int | None = None
) -> FusedMotion:
    """Displacement, velocity and acceleration from both channels, with standard errors.

    Args:
        record: with both channels; starts at rest.
        noise: of the channels; None: estimated from the record's rest (:func:`channel_noise`).
        baseline: degree of a polynomial to take off both channels first; None: none.

    Raises:
        MotionError: a channel is missing, or the noise cannot be estimated.
    """
    displacement, acceleration = _both_channels(record)
    if noise is None:
        noise = channel_noise(record)
    if baseline is not None:
        displacement = remove_baseline(displacement, baseline, name=record.label)
        acceleration = remove_baseline(acceleration, baseline, name=record.label)
    interval = record.sample_interval
    shaking = _shaking(acceleration - rest_level(acceleration, interval))
    first = max(2, math.ceil(PROCESSING.rest_time / interval))
    # in units of the sampling interval, so that all states are lengths of like size
    measured = np.stack(
        [
            displacement - np.median(displacement[:first]),
            (acceleration - rest_level(acceleration, interval)) * interval**2,
        ],
        axis=1,
    )
    smoother = _Smoother(noise, interval, _wiener_variance(measured[shaking, 1], noise, interval))
    # the displacement tells the accelerometer's offset better than its rest does
    states = smoother.smooth(measured)[0]
    measured[:, 1] -= np.mean(measured[:, 1] - states[:, 2])
    states, variances, innovations = smoother.smooth(measured)
    consistency = math.sqrt(float(np.mean(innovations[shaking])))
    errors = np.sqrt(variances) * max(1.0, consistency)
    return FusedMotion(
        sample_interval=interval,
        displacement=states[:, 0] - states[0, 0],
        velocity=states[:, 1] / interval,
        acceleration=states[:, 2] / interval**2,
        displacement_error=errors[:, 0],
        velocity_error=errors[:, 1] / interval,
        acceleration_error=errors[:, 2] / interval**2,
        noise=noise,
        consistency=consistency,
    )


def input_uncertainty(
    record: Record, bands: tuple[tuple[float, float], ...] = FUSION.bands
) -> InputUncertainty:
    """Compare the accelerometer with the twice-differentiated displacement, band by band.

    Cross spectra by Welch's method over the shaking (Hann windows of 4 s, half overlapping). The
    displacement goes through a second difference, whose gain (2 sin(w h / 2) / (w h))^2 is taken
    out of the spectra.

    Args:
        record: with both channels.
        bands: edges [Hz]; those at or above the Nyquist frequency or narrower than the resolution
            come out as NaN.

    Raises:
        MotionError: a channel is missing.
    """
    from scipy.signal import csd

    displacement, acceleration = _both_channels(record)
    interval = record.sample_interval
    inside = _shaking(acceleration - rest_level(acceleration, interval))
    # at least two segments, as one alone is always coherent
    least = min(record.size - 2, round(3 * FUSION.segment / interval))
    start, stop = int(inside[0]), int(inside[-1]) + 1
    missing = max(0, least - (stop - start))
    start = max(1, start - missing // 2)
    stop = min(record.size - 1, start + max(stop - start, least))
    start = max(1, stop - max(stop - start, least))
    second = (
        displacement[start + 1 : stop + 1]
        - 2 * displacement[start:stop]
        + displacement[start - 1 : stop - 1]
    ) / interval**2
    measured = acceleration[start:stop]
    length = min(round(FUSION.segment / interval), measured.size // 2)

    def spectrum(a: Array, b: Array) -> tuple[Array, NDArray[Any]]:
        frequency, density = csd(a, b, fs=1 / interval, nperseg=length, detrend="constant")
        return frequency, density

    frequency, aa = spectrum(measured, measured)
    xx, xa = spectrum(second, second)[1], spectrum(second, measured)[1]
    gain = np.sinc(frequency * interval) ** 2
    aa, xx, xa = aa.real, xx.real / gain**2, xa / gain
    step = float(frequency[1])
    table = np.full((len(bands), 5), math.nan)
    for row, (low, high) in zip(table, bands, strict=True):
        within = (frequency >= low) & (frequency < high)
        if not within.any() or high > 0.5 / interval:
            continue
        s_aa, s_xx = float(aa[within].sum()) * step, float(xx[within].sum()) * step
        s_xa = complex(xa[within].sum()) * step
        row[:3] = np.sqrt([s_xx, s_aa, max(s_aa + s_xx - 2 * s_xa.real, 0.0)])
        if s_aa > 0 and s_xx > 0:
            row[3:] = abs(s_xa) ** 2 / (s_aa * s_xx), abs(s_xa) / s_xx
    return InputUncertainty(
        np.array(bands, dtype=np.float64).reshape(-1, 2),
        table[:, 0],
        table[:, 1],
        table[:, 2],
        table[:, 3],
        table[:, 4],
    )


class _Smoother:
    """Steady-state filter and smoother, in units of the sampling interval.

    States: x, v h, a h^2, then the autoregressive noise of the displacement and of the
    acceleration, where there is one.
    """

    def __init__(self, noise: ChannelNoise, interval: float, wiener: float) -> None:
        deviations = (noise.displacement.deviation, noise.acceleration.deviation * interval**2)
        models = (noise.displacement, noise.acceleration)
        coloured = [i for i in (0, 1) if models[i].share > 0 and models[i].persistence > 0]
        size = 3 + len(coloured)
        self.step = np.eye(size)
        self.step[:3, :3] = np.array([[1, 1, 0.5], [0, 1, 1], [0, 0, 1]])
        driven = np.zeros((size, size))
        driven[:3, :3] = wiener * np.array(
            [[1 / 20, 1 / 8, 1 / 6], [1 / 8, 1 / 3, 1 / 2], [1 / 6, 1 / 2, 1]]
        )
        self.observed = np.zeros((2, size))
        self.observed[0, 0] = self.observed[1, 2] = 1
        white = np.diag(np.square(deviations))
        for state, i in enumerate(coloured, 3):
            variance = models[i].share * deviations[i] ** 2
            self.step[state, state] = models[i].persistence
            driven[state, state] = variance * (1 - models[i].persistence ** 2)
            self.observed[i, state] = 1
            white[i, i] -= variance
        self._solve(driven, white)

    def _solve(self, driven: Array, white: Array) -> None:
        from scipy.linalg import solve_discrete_are

        # states are of very different size; the Riccati solver wants them alike
        scale = np.sqrt(np.maximum(np.diag(driven), 1e-300))
        measured = np.sqrt(np.diag(white))
        step = self.step * scale / scale[:, None]
        observed = self.observed * scale / measured[:, None]
        inner = driven / np.outer(scale, scale)
        try:
            predicted = solve_discrete_are(step.T, observed.T, inner, np.eye(2))
        except (np.linalg.LinAlgError, ValueError) as error:
            raise MotionError(
                f"the channels cannot be fused ({error}): their noise levels are too far from the "
                "motion's; give `noise`, or drive one channel"
            ) from None
        innovation = observed @ predicted @ observed.T + np.eye(2)
        gain = np.linalg.solve(innovation, observed @ predicted).T
        filtered = predicted - gain @ innovation @ gain.T
        self._scale, self._measured = scale, measured
        self._step, self._observed = step, observed
        self._gain, self._innovation = gain, innovation
        self._predicted, self._filtered = predicted, filtered
        self._back = np.linalg.solve(predicted, step @ filtered).T

    def smooth(self, measured: Array) -> tuple[Array, Array, Array]:
        """States (n, 3), their variances (n, 3), and innovations squared over the model's (n,)."""
        size, count = self._step.shape[0], len(measured)
        # run up on the mirrored start: reversed in time, a motion from rest is a motion to rest
        run_up = min(FUSION.run_up, count - 1)
        scaled = np.vstack([measured[run_up:0:-1], measured]) / self._measured
        closed = (np.eye(size) - self._gain @ self._observed) @ self._step
        filtered = _recursion(closed, scaled @ self._gain.T)
        before = np.vstack([np.zeros(size), filtered[:-1]]) @ self._step.T
        innovation = scaled - before @ self._observed.T
        normal = np.einsum(
            "ni,ni->n", innovation, np.linalg.solve(self._innovation, innovation.T).T
        )
        inputs = filtered @ (np.eye(size) - self._back @ self._step).T
        inputs[-1] = filtered[-1]
        smoothed = _recursion(self._back, inputs[::-1])[::-1]
        return (
            smoothed[run_up:, :3] * self._scale[:3],
            self._variances(count) * self._scale[:3] ** 2,
            normal[run_up:] / 2,
        )

    def _variances(self, count: int) -> Array:
        """Diagonal of the smoothed covariance (n, 3); constant but for the record's end."""
        covariance = self._filtered
        diagonals = [np.diag(covariance)[:3]]
        while len(diagonals) < count:
            following = self._filtered + self._back @ (covariance - self._predicted) @ self._back.T
            settled = np.allclose(following, covariance, rtol=1e-12, atol=0)
            covariance = following
            diagonals.append(np.diag(covariance)[:3])
            if settled:
                break
        last = np.maximum(np.array(diagonals[::-1]), 0)
        return np.vstack([np.repeat(last[:1], count - len(last), axis=0), last])


def _recursion(matrix: Array, inputs: Array) -> Array:
    """s_k = matrix s_(k-1) + inputs_k from rest, shape (n, m).

    In the basis of the complex Schur form the matrix is triangular, so the states are one scalar
    recursion after the other, the last first; its basis is unitary, so no digit is lost.
    """
    from scipy.linalg import schur
    from scipy.signal import lfilter

    triangle, basis = schur(matrix, output="complex")
    driven = inputs @ basis.conj()
    states = np.empty_like(driven)
    for row in range(len(triangle) - 1, -1, -1):
        own = driven[:, row].copy()
        own[1:] += states[:-1, row + 1 :] @ triangle[row, row + 1 :]
        states[:, row] = lfilter([1.0], [1.0, -triangle[row, row]], own)
    result: Array = (states @ basis.T).real
    return result


def _wiener_variance(acceleration: Array, noise: ChannelNoise, interval: float) -> float:
    """Variance of the acceleration's increments while it shakes, the noise's share taken off."""
    model = noise.acceleration
    per_step = 2 * (model.deviation * interval**2) ** 2 * (1 - model.share * model.persistence)
    total = float(np.mean(np.diff(acceleration) ** 2))
    return FUSION.peak_shaking * max(total - per_step, FUSION.least_wiener * per_step)


def _shaking(acceleration: Array) -> NDArray[np.intp]:
    """Sample numbers between 5 % and 95 % of the squared acceleration's sum, or all."""
    total = np.cumsum(acceleration**2)
    inside = np.flatnonzero(
        (total >= FUSION.shaking_share * total[-1])
        & (total <= (1 - FUSION.shaking_share) * total[-1])
    )
    return inside if inside.size >= FUSION.fewest_shaking else np.arange(acceleration.size)


def _fitted_noise(record: Record, windows: Array, channel: str) -> Noise:
    centred = windows - windows.mean(axis=1, keepdims=True)
    c0, c1, c2 = (
        float(np.mean(centred[:, : centred.shape[1] - lag] * centred[:, lag:])) for lag in (0, 1, 2)
    )
    if not c0 > 0:
        raise MotionError(
            f"{record.label}: the {channel} channel is constant at rest, so it has no noise to "
            "weigh it by; give `noise`, or drive one channel"
        )
    # autoregressive part p: c1 = p^1 s c0, c2 = p^2 s c0
    if c1 <= 0 or c2 <= 0:
        return Noise(math.sqrt(c0))
    persistence = min(c2 / c1, FUSION.most_persistence)
    share = min(c1 / c0 / persistence, FUSION.most_share)
    return Noise(math.sqrt(c0), share, persistence)


def _both_channels(record: Record) -> tuple[Array, Array]:
    if record.displacement is None or record.acceleration is None:
        missing = "displacement" if record.displacement is None else "acceleration"
        raise MotionError(
            f"{record.label}: has no {missing} channel, and fusing needs both; give a recording "
            "with both, or drive by the channel 'auto'"
        )
    return record.displacement, record.acceleration
