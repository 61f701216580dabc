"""The observed campaign as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.campaign import Campaign, Tier, intensity_measures
from vsr2.diagnosis.features import TILT_FEATURES, tilt_features
from vsr2.errors import DiagnosisError

Array = NDArray[np.float64]

LEAST_TRIALS = 40
"""Fewer trials with motion and outcome are refused."""
LEAST_MOTIONS = 4
"""Fewer ground motions cannot be split into fit, choose and judge with something to resample."""
LEAST_TILT = 0.003
"""Added to largest tilts before the logarithm where the campaign states no noise [rad]."""


@dataclass(frozen=True, eq=False)
class Observations:
    """What was observed, one value a trial.

    Attributes:
        campaign: trials with motion and outcome, in order of execution.
        tier: information used: B, M or T.
        overturned: 1 or 0, shape (n,).
        features: shape (n, k): none (B), logarithm of the largest tilt (M), and features of the
            series (T); NaN where one does not apply.
        names: of the features.
        tilt_offset: added to tilts before the logarithm [rad].
        tilt_noise: standard error of the largest tilt [rad].
        motion, session, specimen: indices from 0, shape (n,).
        order: 0 at the first trial, 1 at the last, shape (n,).
        log_pga, log_ratio: ln PGA [m/s^2] and ln PGV/PGA [s], shape (n,).
    """

    campaign: Campaign
    tier: Tier
    overturned: Array
    features: Array
    names: tuple[str, ...]
    tilt_offset: float
    tilt_noise: float
    motion: NDArray[np.int64]
    session: NDArray[np.int64]
    specimen: NDArray[np.int64]
    order: Array
    log_pga: Array
    log_ratio: Array

    def __len__(self) -> int:
        return self.overturned.size

    def noted(self, overturned: Array, peak: Array, series: Array | None, seed: int) -> Array:
        """Features of simulated responses as this campaign would have noted them.

        Args:
            overturned: shape (..., n).
            peak: largest tilts [rad], shape (..., n).
            series: of simulated series, shape (..., n, k), needed for tier T.
            seed: of the noise of the largest tilt.

        Returns:
            Shape (..., n, features).
        """
        shape = (*overturned.shape, len(self.names))
        out = np.full(shape, np.nan)
        if self.tier == "B":
            return out
        noise = np.random.default_rng(seed).standard_normal(overturned.shape) * self.tilt_noise
        standing = overturned < 0.5
        seen = np.log(np.maximum(peak + noise, 0.0) + self.tilt_offset)
        out[..., 0] = np.where(standing, seen, np.nan)
        if self.tier == "T" and series is not None:
            out[..., 1:] = series
        return out


def observe_campaign(campaign: Campaign, tier: Tier | None = None) -> Observations:
    """The campaign's usable trials as arrays.

    Args:
        campaign: trials without motion or outcome are left out.
        tier: information to use; None: all that the campaign shares.

    Raises:
        DiagnosisError: too few trials or motions, outcomes all alike, or a tier that the campaign
            does not reach.
    """
    kept = [
        i
        for i, trial in enumerate(campaign.trials)
        if trial.motion_file is not None and trial.overturned is not None
    ]
    motions = {campaign.trials[i].motion for i in kept}
    if len(kept) < LEAST_TRIALS or len(motions) < LEAST_MOTIONS:
        raise DiagnosisError(
            f"campaign {campaign.name!r}: {len(kept)} trials of {len(motions)} motions have both "
            f"motion and outcome; a diagnosis needs {LEAST_TRIALS} of {LEAST_MOTIONS} motions"
        )
    kept.sort(key=lambda i: campaign.trials[i].order)
    mask = np.zeros(len(campaign), dtype=bool)
    mask[kept] = True
    used = campaign.select(mask)
    used = _in_order(used)
    if tier is not None and tier > used.tier:
        raise DiagnosisError(
            f"campaign {campaign.name!r}: reaches tier {used.tier}, not {tier}; choose tier "
            f"{used.tier}, or measure more"
        )
    tier = used.tier if tier is None else tier
    overturned = used.overturned
    noise = used.noise.peak_tilt or 0.0
    offset = max(LEAST_TILT, noise)
    columns: list[Array] = []
    names: list[str] = []
    if tier != "B":
        peaks = np.array([_peak(trial) for trial in used.trials])
        seen = np.log(np.maximum(peaks, 0.0) + offset)
        columns.append(np.where(overturned < 0.5, seen, np.nan))
        names.append("largest_tilt")
    if tier == "T":
        rows = np.stack([_series_features(trial) for trial in used.trials])
        columns.extend(rows.T)
        names.extend(TILT_FEATURES)
    order = np.array([trial.order for trial in used.trials], dtype=np.float64)
    measures = intensity_measures(used)
    with np.errstate(divide="ignore"):
        log_pga, log_ratio = np.log(measures.pga), np.log(measures.pgv_pga)
    return Observations(
        campaign=used,
        tier=tier,
        overturned=overturned,
        features=np.stack(columns, axis=1) if columns else np.zeros((len(used), 0)),
        names=tuple(names),
        tilt_offset=offset,
        tilt_noise=noise,
        motion=_index([trial.motion for trial in used.trials]),
        session=_index([trial.session for trial in used.trials]),
        specimen=_index([trial.specimen for trial in used.trials]),
        order=(order - order.min()) / max(float(np.ptp(order)), 1.0),
        log_pga=log_pga,
        log_ratio=log_ratio,
    )


def _in_order(campaign: Campaign) -> Campaign:
    from dataclasses import replace

    return replace(campaign, trials=tuple(sorted(campaign.trials, key=lambda t: t.order)))


def _index(names: list[str]) -> NDArray[np.int64]:
    """Numbers in order of first appearance."""
    places = {name: i for i, name in enumerate(dict.fromkeys(names))}
    return np.array([places[name] for name in names], dtype=np.int64)


def _peak(trial: object) -> float:
    peak = getattr(trial, "peak_tilt", None)
    if peak is not None:
        return float(peak)
    series = getattr(trial, "series", None)
    if series is not None and series.tilt is not None:
        return float(np.max(np.abs(series.tilt)))
    return float("nan")


def _series_features(trial: object) -> Array:
    series = getattr(trial, "series", None)
    if series is None or series.tilt is None:
        return np.full(len(TILT_FEATURES), np.nan)
    return tilt_features(series.time, np.abs(series.tilt)[:, None])[0]
