"""The table's motion itself: whether its two recordings tell of one motion.

A campaign drives the simulation with a recorded motion. Where a trial has both a displacement and
an acceleration of the table, they check each other: the acceleration's gain over the displacement's
second difference, and its delay, band by band, over their standard errors. Instruments are off too:
one calibration error of gain and delay, the same for all records, counts beside their noise.

In a band of m frequencies with coherence c^2, logarithm of the gain and phase have variance
(1 - c^2) / (2 m c^2) (J. S. Bendat and A. G. Piersol, "Random Data", 4th ed., 2010, table 9.6).
Which channel the incoherent rest belongs to is not known: the gain is sqrt(S_aa / S_xx), between
the two extremes, and half their distance, -ln(c^2) / 2, counts as an error that all bands share.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.campaign import Campaign
from vsr2.diagnosis.features import Feature
from vsr2.motion import Record

Array = NDArray[np.float64]
Residuals = tuple[Array, Array]
"""And their variances, each (campaigns, channels, trials)."""

TABLE_FEATURES = (
    Feature("record_gain", "table", "whole motion"),
    Feature("record_delay", "table", "whole motion"),
)
"""Acceleration over displacement: logarithm of the gain, and delay [s], over their errors."""
CALIBRATION = (0.005, 0.0005)
"""Standard errors of the two instruments' gains, and of their delays [s], against each other."""
BANDS = ((0.5, 1.0), (1.0, 2.0), (2.0, 4.0), (4.0, 8.0), (8.0, 12.0), (12.0, 25.0))
"""[Hz]"""
LEAST_COHERENCE = 0.9
"""Of a band that is used."""
LEAST_FREQUENCIES = 4
MOST = 4.0
"""Standard errors that one record counts at most."""


def agreement(record: Record) -> Array:
    """Gain and delay of one record's acceleration over its displacement.

    Returns:
        Shape (2, 2): logarithm of the gain and delay [s], each with its standard error from noise;
        NaN without both channels, or where no band is coherent.
    """
    none = np.full((len(TABLE_FEATURES), 2), np.nan)
    if record.displacement is None or record.acceleration is None or record.size < 16:
        return none
    interval = record.sample_interval
    second = np.diff(record.displacement, 2) / interval**2
    measured = record.acceleration[1:-1] - np.mean(record.acceleration)
    frequency = np.fft.rfftfreq(second.size, interval)
    x = np.fft.rfft(second) / np.sinc(frequency * interval) ** 2
    y = np.fft.rfft(measured)
    rows = []
    for low, high in BANDS:
        inside = (frequency >= low) & (frequency < high)
        if inside.sum() < LEAST_FREQUENCIES or high > 0.4 / interval:
            continue
        xx = float((np.abs(x[inside]) ** 2).sum())
        yy = float((np.abs(y[inside]) ** 2).sum())
        xy = complex((np.conj(x[inside]) * y[inside]).sum())
        if xx <= 0 or yy <= 0:
            continue
        coherence = min(abs(xy) ** 2 / (xx * yy), 1 - 1e-9)
        if coherence < LEAST_COHERENCE:
            continue
        # The frequency at which the band's power lies, and about how many share it.
        power = np.abs(x[inside]) ** 2 / xx
        middle = float(power @ frequency[inside])
        count = 1.0 / float((power**2).sum())
        spread = (1 - coherence) / (2 * count * coherence)
        rows.append(
            (
                0.5 * np.log(yy / xx),
                -np.angle(xy) / (2 * np.pi * middle),
                spread,
                spread / (2 * np.pi * middle) ** 2,
                -0.5 * np.log(coherence),
            )
        )
    if not rows:
        return none
    gain, delay, gain_variance, delay_variance, shared = np.array(rows).T
    return np.array(
        [
            _weighted(gain, gain_variance, shared),
            _weighted(delay, delay_variance, np.zeros_like(delay)),
        ]
    )


def _weighted(value: Array, variance: Array, shared: Array) -> tuple[float, float]:
    """Mean, each weighted by what is known of it, and its standard error."""
    weight = 1.0 / (variance + shared**2)
    weight /= weight.sum()
    error = np.sqrt((weight**2 * variance).sum() + float(weight @ shared) ** 2)
    return float(weight @ value), float(error)


@dataclass(frozen=True, eq=False)
class TableResiduals:
    """Residuals of the table's own channel.

    Attributes:
        residual: shape (2, trials); trials that share a record share it.
        variance: shape (2, trials), 0 where the record lacks a channel.
        null: what instruments in order would make of it, shape (campaigns, 2, trials).
    """

    residual: Array
    variance: Array
    null: Array

    def beside(self, other: Residuals, rows: slice | None) -> Residuals:
        """Other channels with these behind them: the observed ones (None), or some of the null."""
        own = self.residual[None] if rows is None else self.null[rows]
        variance = np.broadcast_to(self.variance, own.shape)
        return np.concatenate([other[0], own], 1), np.concatenate([other[1], variance], 1)


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
    common = np.array(CALIBRATION)
    error = np.sqrt(noise**2 + common**2)
    rng = np.random.default_rng([seed, 8])
    drawn = noise * rng.standard_normal((null, *value.shape))
    drawn += common * rng.standard_normal((null, 1, len(common)))
    return TableResiduals(
        _clipped(value / error)[index].T,
        np.isfinite(value).astype(np.float64)[index].T,
        _clipped(drawn / error)[:, index].swapaxes(1, 2),
    )


def _clipped(residual: Array) -> Array:
    return np.asarray(np.clip(np.nan_to_num(residual), -MOST, MOST), dtype=np.float64)


def _of_file(campaign: Campaign, name: str | None) -> Array:
    if name is None:
        return np.full((len(TABLE_FEATURES), 2), np.nan)
    return agreement(campaign.motions[name])
