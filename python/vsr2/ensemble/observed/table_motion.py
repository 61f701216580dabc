"""The table's motion itself: whether its two recordings tell of one motion.

A campaign drives the simulation with a recorded motion. Where a trial has both a displacement and
an acceleration of the table, they check each other: gain and phase of the acceleration over the
displacement's second difference, for slow and for fast motion apart, because instruments err by
frequency (an accelerometer that does not pass slow motion leads and is low there; a delay grows
with frequency). Each is divided by its standard error. Instruments are off too: one calibration
error, the same for all records, counts beside their noise.

In a band of m frequencies with coherence c^2, logarithm of the gain and phase have variance
(1 - c^2) / (2 m c^2) (J. S. Bendat and A. G. Piersol, "Random Data", 4th ed., 2010, table 9.6).
Which channel the incoherent rest belongs to is not known: the gain is sqrt(S_aa / S_xx), between
the two extremes, and half their distance, -ln(c^2) / 2, counts as an error that all bands share.
Where bands that are taken together differ by more than their errors, the error is raised to match.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.campaign import Campaign
from vsr2.ensemble.observed.features import Feature, FeatureChannel, Phase
from vsr2.ensemble.observed.random_streams import Stream, generator
from vsr2.motion import Record

Array = NDArray[np.float64]

TABLE_FEATURES = (
    Feature("record_gain_slow", FeatureChannel.TABLE, Phase.MOTION),
    Feature("record_phase_slow", FeatureChannel.TABLE, Phase.MOTION),
    Feature("record_gain_fast", FeatureChannel.TABLE, Phase.MOTION),
    Feature("record_phase_fast", FeatureChannel.TABLE, Phase.MOTION),
)
"""Acceleration over displacement: logarithm of the gain, and phase lead [rad], over their errors;
slow: 0.5 to 2 Hz, fast: 2 to 12 Hz."""


@dataclass(frozen=True)
class TableMotionConstants:
    """How the table's two recordings are compared; chosen by hand.

    Attributes:
        bands: taken together: slow, fast [Hz].
        calibration: standard error of the logarithm of the two instruments' gain against each
            other, and of their phase [rad].
        least_coherence: of a band that is used.
        least_power: share of the motion's power up to the last band that such a band must have:
            less may be leakage. Beyond it a displacement's second difference is mostly noise.
        taper: share of a record over which its ends fade, so that their steps do not fill other
            bands.
        least_frequencies: in such a band: fewer are always coherent.
        most: standard errors that one record counts at most.
        least_samples: of a record; shorter ones are not compared.
        highest: end of a band over the sampling rate at most.
    """

    bands: tuple[tuple[tuple[float, float], ...], ...] = (
        ((0.5, 1.0), (1.0, 2.0)),
        ((2.0, 4.0), (4.0, 8.0), (8.0, 12.0)),
    )
    calibration: float = 0.01
    least_coherence: float = 0.9
    least_power: float = 1e-4
    taper: float = 0.1
    least_frequencies: int = 4
    most: float = 4.0
    least_samples: int = 16
    highest: float = 0.4


TABLE_MOTION = TableMotionConstants()


def agreement(record: Record) -> Array:
    """Gain and phase of one record's acceleration over its displacement.

    Returns:
        Shape (4, 2): the values of `TABLE_FEATURES`, each with its standard error from noise; NaN
        without both channels, or where no band is coherent.
    """
    out = np.full((len(TABLE_FEATURES), 2), np.nan)
    if record.displacement is None or record.acceleration is None:
        return out
    if record.size < TABLE_MOTION.least_samples:
        return out
    from scipy.signal.windows import tukey

    interval = record.sample_interval
    second = np.diff(record.displacement, 2) / interval**2
    measured = record.acceleration[1:-1] - np.mean(record.acceleration)
    frequency = np.fft.rfftfreq(second.size, interval)
    window = tukey(second.size, TABLE_MOTION.taper)
    x = np.fft.rfft(window * second) / np.sinc(frequency * interval) ** 2
    y = np.fft.rfft(window * measured)
    least = TABLE_MOTION.least_power * float(
        (np.abs(x[frequency < TABLE_MOTION.bands[-1][-1][1]]) ** 2).sum()
    )
    for k, bands in enumerate(TABLE_MOTION.bands):
        rows = []
        for low, high in bands:
            inside = (frequency >= low) & (frequency < high)
            if high <= TABLE_MOTION.highest / interval:
                rows += _of_band(x[inside], y[inside], least)
        if rows:
            gain, phase, variance, common = np.array(rows).T
            out[2 * k] = _together(gain, variance, common)
            out[2 * k + 1] = _together(phase, variance, np.zeros_like(phase))
    return out


def _of_band(
    x: NDArray[np.complex128], y: NDArray[np.complex128], least: float
) -> list[tuple[float, float, float, float]]:
    """Log gain, phase, their variance and the gain's common error; nothing if not coherent.

    Nor is there anything where the power is not above `least`.
    """
    xx, yy = float((np.abs(x) ** 2).sum()), float((np.abs(y) ** 2).sum())
    if x.size < TABLE_MOTION.least_frequencies or xx <= least or yy <= 0:
        return []
    xy = complex((np.conj(x) * y).sum())
    coherence = min(abs(xy) ** 2 / (xx * yy), 1 - 1e-9)
    if coherence < TABLE_MOTION.least_coherence:
        return []
    # About how many frequencies share the band's power.
    count = xx**2 / float((np.abs(x) ** 4).sum())
    variance = (1 - coherence) / (2 * count * coherence)
    return [(0.5 * np.log(yy / xx), float(np.angle(xy)), variance, -0.5 * np.log(coherence))]


def _together(value: Array, variance: Array, common: Array) -> tuple[float, float]:
    """Mean, each weighted by what is known of it, and its standard error."""
    own = variance + common**2
    weight = 1.0 / own
    weight /= weight.sum()
    mean = float(weight @ value)
    error = np.sqrt((weight**2 * variance).sum() + float(weight @ common) ** 2)
    if value.size > 1:
        excess = float(((value - mean) ** 2 / own).sum()) / (value.size - 1)
        error *= np.sqrt(max(excess, 1.0))
    return mean, float(error)


@dataclass(frozen=True, eq=False)
class TableResiduals:
    """Residuals of the table's own channel.

    Attributes:
        residual: shape (4, trials), 0 where the record lacks a channel; trials that share a record
            share it.
        null: what instruments in order would make of it, shape (campaigns, 4, trials).
    """

    residual: Array
    null: Array


def table_residuals(campaign: Campaign, *, null: int, seed: int = 0) -> TableResiduals | None:
    """Compare the two recordings of every trial's motion; None: no record has both channels.

    Args:
        campaign: the trials.
        null: campaigns wanted.
        seed: of them.
    """
    files = [trial.motion_file for trial in campaign.trials]
    names = list(dict.fromkeys(files))
    found = np.stack([_of_file(campaign, name) for name in names])
    if not np.isfinite(found).any():
        return None
    index = np.array([names.index(name) for name in files])
    value, noise = np.moveaxis(found, 2, 0)
    error = np.hypot(noise, TABLE_MOTION.calibration)
    rng = generator(seed, Stream.TABLE_MOTION)
    drawn = noise * rng.standard_normal((null, *value.shape))
    drawn += TABLE_MOTION.calibration * rng.standard_normal((null, 1, len(TABLE_FEATURES)))
    return TableResiduals(
        _clipped(value / error)[index].T,
        _clipped(drawn / error)[:, index].swapaxes(1, 2),
    )


def _clipped(residual: Array) -> Array:
    return np.asarray(
        np.clip(np.nan_to_num(residual), -TABLE_MOTION.most, TABLE_MOTION.most), dtype=np.float64
    )


def _of_file(campaign: Campaign, name: str | None) -> Array:
    if name is None:
        return np.full((len(TABLE_FEATURES), 2), np.nan)
    return agreement(campaign.motions[name])
