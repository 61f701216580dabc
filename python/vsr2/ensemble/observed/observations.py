"""The observed campaign as arrays."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.campaign import Campaign, CampaignTrial, Tier, intensity_measures
from vsr2.ensemble.observed.features import (
    LARGEST_TILT,
    REST_FEATURES,
    SERIES,
    TILT_FEATURES,
    Feature,
    Sampling,
    noted_tilt_features,
    rest_features,
    tilt_features,
)
from vsr2.ensemble.observed.stated_noise import tilt_noise, travel_noise, turn_noise, typical
from vsr2.errors import DiagnosisError
from vsr2.motion import Record
from vsr2.one_line import counted

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ObservedConstants:
    """What a campaign must have, and how its measurements are taken.

    Chosen by hand, but `rest_scatter` by `python studies/engine_discrepancy.py`.

    Attributes:
        least_trials: fewer with motion and outcome are refused.
        least_motions: fewer cannot be split into fit, choose and judge with something to resample.
        most_lacking: one trial in so many may lack what a tier rests on: of those that stood the
            largest tilt (M), of all series (T).
        least_tilt: added to largest tilts before the logarithm where the campaign states no noise
            [rad].
        rest_resolution: final turns [rad] and travels [m] below these are taken for one. How far a
            rocking block creeps on its edges is a matter of the contact model: where one engine
            has it stay within a millimetre, another lets it go several.
        rest_scatter: standard deviation of the logarithm of larger ones between two correct
            engines.
        distinct: standard errors from which a turn or a travel is distinguished from none.
        repeated: greatest difference of ln PGA and of ln PGV between recordings of one motion
            repeated: for noise of the records and the table's scatter. The next amplitude of a
            campaign lies 5 % off or more.
    """

    least_trials: int = 40
    least_motions: int = 4
    most_lacking: int = 10
    least_tilt: float = 0.003
    rest_resolution: tuple[float, float] = (0.05, 0.01)
    rest_scatter: float = 0.3
    distinct: float = 3.0
    repeated: float = 0.02


OBSERVED = ObservedConstants()


@dataclass(frozen=True, eq=False)
class Observations:
    """What was observed, one value a trial.

    Attributes:
        campaign: trials with motion and outcome, in order of execution.
        tier: information used: B, M or T.
        overturned: 1 or 0, shape (n,).
        features: shape (n, k): none (B), logarithm of the largest tilt (M), and features of the
            series (T); NaN where one does not apply.
        measured: what the features are.
        tilt_offset: added to tilts before the logarithm [rad].
        tilt_noise: standard error of the largest tilt [rad].
        relative_tilt_noise: of its logarithm, beside that.
        from_series: trials whose largest tilt is that of their series, shape (n,).
        rest_noise: standard errors of the final turn [rad] and of the final travel [m].
        motion, session, specimen: indices from 0, shape (n,).
        order: 0 at the first trial, 1 at the last, shape (n,).
        log_pga_g, log_pgv_pga_s: ln PGA [g] and ln PGV/PGA [s], shape (n,).
    """

    campaign: Campaign
    tier: Tier
    overturned: Array
    features: Array
    measured: tuple[Feature, ...]
    tilt_offset: float
    tilt_noise: float
    relative_tilt_noise: float
    from_series: NDArray[np.bool_]
    rest_noise: tuple[float, float]
    motion: NDArray[np.int64]
    session: NDArray[np.int64]
    specimen: NDArray[np.int64]
    order: Array
    log_pga_g: Array
    log_pgv_pga_s: Array

    def __len__(self) -> int:
        return self.overturned.size

    @property
    def reads_series(self) -> bool:
        """Whether anything that counts is read from series."""
        return self.tier == "T" or (self.tier == "M" and bool(self.from_series.any()))

    def noted(
        self,
        overturned: Array,
        peak: Array,
        series: NDArray[np.floating[Any]] | None,
        rng: np.random.Generator,
    ) -> NDArray[np.floating[Any]]:
        """Features of simulated responses as this campaign would have noted them.

        Args:
            overturned: shape (..., n).
            peak: largest tilts [rad], shape (..., n).
            series: of simulated series, as `Responses.features`, shape (..., n, k), needed for
                tier T. Where a largest tilt is that of a series, it is that of the simulated one,
                sampled and noisy as it is; without these it is taken as measured by itself.
            rng: of the measurements' noise.

        Returns:
            Shape (..., n, features), in the precision of the series, else in double.
        """
        precision = np.dtype(np.float64) if series is None else series.dtype
        out = np.full((*overturned.shape, len(self.measured)), np.nan, dtype=precision)
        if self.tier == "B":
            return out
        standing = overturned < 0.5
        largest = self.noted_tilt(peak, rng)
        if series is not None and self.from_series.any():
            largest = np.where(self.from_series, np.exp(series[..., 0]), largest)
        seen = np.log(largest + self.tilt_offset)
        out[..., 0] = np.where(standing, seen, np.nan)
        if self.tier != "T" or series is None:
            return out
        tilts = len(TILT_FEATURES)
        out[..., 1 : 1 + tilts] = noted_tilt_features(series[..., :tilts], overturned)
        for k, feature in enumerate(REST_FEATURES[: series.shape[-1] - tilts]):
            noise = self.rest_noise[k] * rng.standard_normal(overturned.shape)
            if feature in self.measured:
                scatter = np.exp(OBSERVED.rest_scatter * rng.standard_normal(overturned.shape))
                raw = scatter * np.abs(series[..., tilts + k] + noise)
                known = rest_logarithm(raw, OBSERVED.rest_resolution[k], self.rest_noise[k])
                out[..., self.measured.index(feature)] = np.where(standing, known, np.nan)
        return out

    def noted_tilt(self, peak: Array, rng: np.random.Generator) -> Array:
        """Largest tilts as this campaign would have noted them by themselves [rad].

        Args:
            peak: true ones [rad], of any shape.
            rng: of the noise.
        """
        noted = peak + self.tilt_noise * rng.standard_normal(peak.shape)
        if self.relative_tilt_noise:
            noted = noted * np.exp(self.relative_tilt_noise * rng.standard_normal(peak.shape))
        return np.asarray(np.maximum(noted, 0.0))


def rest_logarithm(size: Array, resolution: float, noise: float) -> Array:
    """Logarithm of turns or travels, those within what can be distinguished taken for one."""
    return np.asarray(
        np.log(np.maximum(size, max(resolution, OBSERVED.distinct * noise))), dtype=np.float64
    )


def same_trials(one: Observations, other: Observations) -> bool:
    """Whether two campaigns have the same trials in equal order: motion, and PGA and PGV about."""
    names = [[trial.motion for trial in seen.campaign.trials] for seen in (one, other)]
    if names[0] != names[1]:
        return False
    far = [
        np.abs(a - b) > OBSERVED.repeated
        for a, b in (
            (one.log_pga_g, other.log_pga_g),
            (one.log_pga_g + one.log_pgv_pga_s, other.log_pga_g + other.log_pgv_pga_s),
        )
    ]
    return not np.any(far)


def outcomes_hash(overturned: Array, features: Array | None = None) -> str:
    """Of what the trials came to, by which campaigns of one schedule differ.

    Args:
        overturned: 1, 0 or NaN, shape (trials,).
        features: that the tier has, shape (trials, features); None: outcomes alone.
    """
    digest = hashlib.blake2b(overturned.tobytes(), digest_size=8)
    if features is not None:
        digest.update(np.ascontiguousarray(features).tobytes())
    return digest.hexdigest()


def observe_campaign(campaign: Campaign, tier: Tier | None = None) -> Observations:
    """The campaign's usable trials as arrays.

    Args:
        campaign: trials without motion or outcome are left out.
        tier: information to use; None: all that nine in ten trials have.

    Raises:
        DiagnosisError: too few trials or motions, one that does not move, or a tier that the
            campaign does not reach.
    """
    kept = [
        i
        for i, trial in enumerate(campaign.trials)
        if trial.motion_file is not None and trial.overturned is not None
    ]
    motions = {campaign.trials[i].motion for i in kept}
    if len(kept) < OBSERVED.least_trials or len(motions) < OBSERVED.least_motions:
        raise DiagnosisError(
            f"campaign {campaign.name!r}: motion and outcome are known of "
            f"{counted(len(kept), 'trial')} of {counted(len(motions), 'motion')}; a diagnosis "
            f"needs {OBSERVED.least_trials} trials, of {OBSERVED.least_motions} motions"
        )
    mask = np.zeros(len(campaign), dtype=bool)
    mask[kept] = True
    used = campaign.select(mask)
    used = _in_order(used)
    tier = _reached_tier(used, tier)
    overturned = used.overturned
    noise = used.noise.peak_tilt or 0.0
    offset = max(OBSERVED.least_tilt, noise)
    rest_noise = _rest_noise(used)
    columns: list[Array] = []
    measured: list[Feature] = []
    if tier != "B":
        peaks = np.array([_peak(trial) for trial in used.trials])
        seen = np.log(np.maximum(peaks, 0.0) + offset)
        columns.append(np.where(overturned < 0.5, seen, np.nan))
        measured.append(LARGEST_TILT)
    if tier == "T":
        found = np.stack([_tilt_features(trial) for trial in used.trials])
        columns.extend(noted_tilt_features(found, overturned).T)
        measured.extend(TILT_FEATURES)
        rest = np.stack([_rest_features(trial, used.record(trial)) for trial in used.trials])
        for k, feature in enumerate(REST_FEATURES):
            if np.isfinite(rest[:, k]).any():
                raw = rest_logarithm(rest[:, k], OBSERVED.rest_resolution[k], rest_noise[k])
                columns.append(np.where(overturned < 0.5, raw, np.nan))
                measured.append(feature)
    measures = intensity_measures(used)
    still = np.flatnonzero(~(measures.pga_g > 0))
    if still.size:
        trial = used.trials[int(still[0])]
        more = f" and of {still.size - 1} others" if still.size > 1 else ""
        raise DiagnosisError(
            f"campaign {campaign.name!r}: the table rests in the motion {trial.motion_file!r} of "
            f"trial {trial.trial!r}{more}; leave such trials out"
        )
    log_pga_g, log_pgv_pga_s = np.log(measures.pga_g), np.log(measures.pgv_pga_s)
    return Observations(
        campaign=used,
        tier=tier,
        overturned=overturned,
        features=np.stack(columns, axis=1) if columns else np.zeros((len(used), 0)),
        measured=tuple(measured),
        tilt_offset=offset,
        tilt_noise=noise,
        relative_tilt_noise=used.noise.peak_tilt_relative or 0.0,
        from_series=np.array([t.peak_tilt is None and _tilt(t) is not None for t in used.trials]),
        rest_noise=rest_noise,
        motion=_index([trial.motion for trial in used.trials]),
        session=_index([trial.session for trial in used.trials]),
        specimen=_index([trial.specimen for trial in used.trials]),
        order=used.relative_order,
        log_pga_g=log_pga_g,
        log_pgv_pga_s=log_pgv_pga_s,
    )


def _rest_noise(campaign: Campaign) -> tuple[float, float]:
    """Standard errors of a final turn [rad] and of a final travel [m], typical of its series."""
    series = [trial.series for trial in campaign.trials if trial.series is not None]
    turn, travel = (typical(series, campaign.noise, of) for of in (turn_noise, travel_noise))
    return SERIES.rest_noise * turn, SERIES.rest_noise * travel


def _reached_tier(campaign: Campaign, wanted: Tier | None) -> Tier:
    """The tier that nine in ten trials reach (`OBSERVED.most_lacking`), or a lower one."""
    standing = [t for t in campaign.trials if not t.overturned]
    without_tilt = [t.trial for t in standing if not np.isfinite(_peak(t))]
    without_series = [t.trial for t in campaign.trials if _tilt(t) is None]
    reached: Tier = "B"
    lacking, measured = without_tilt, "largest tilt"
    tilts = OBSERVED.most_lacking * len(without_tilt) <= len(standing)
    if tilts if standing else campaign.tier > "B":
        reached, lacking, measured = "M", without_series, "series"
        if OBSERVED.most_lacking * len(without_series) <= len(campaign):
            reached = "T"
    if wanted is not None and wanted > reached:
        raise DiagnosisError(
            f"campaign {campaign.name!r}: reaches tier {reached}, not {wanted}: "
            f"{counted(len(lacking), 'trial')} without {measured} (the first is "
            f"{lacking[0] if lacking else '-'}); choose tier {reached}, or measure more"
        )
    return reached if wanted is None else wanted


def series_sampling(campaign: Campaign) -> Sampling | None:
    """How the campaign's tilts were measured in time; None: they were not.

    The median sampling interval of all trials, and the median of their noise. The errors of an
    orientation count about two axes, where most tilts are read from one.
    """
    known = [trial.series for trial in campaign.trials if trial.series is not None]
    series = [one for one in known if one.tilt_angle is not None]
    intervals = [float(np.median(np.diff(one.time))) for one in series if one.time.size > 1]
    if not intervals:
        return None
    axes = 1 if 2 * sum(one.tilt is not None for one in series) >= len(series) else 2
    noise = typical(series, campaign.noise, tilt_noise)
    return Sampling(float(np.median(intervals)), noise, axes)


def _in_order(campaign: Campaign) -> Campaign:
    return replace(campaign, trials=tuple(sorted(campaign.trials, key=lambda t: t.order)))


def _index(names: list[str]) -> NDArray[np.int64]:
    """Numbers in order of first appearance."""
    index = {name: i for i, name in enumerate(dict.fromkeys(names))}
    return np.array([index[name] for name in names], dtype=np.int64)


def _peak(trial: CampaignTrial) -> float:
    if trial.peak_tilt is not None:
        return trial.peak_tilt
    tilt = _tilt(trial)
    return float("nan") if tilt is None else float(np.max(np.abs(tilt)))


def _tilt(trial: CampaignTrial) -> Array | None:
    """In time [rad]; None: not measured."""
    return None if trial.series is None else trial.series.tilt_angle


def _tilt_features(trial: CampaignTrial) -> Array:
    series, tilt = trial.series, _tilt(trial)
    if series is None or tilt is None:
        return np.full(len(TILT_FEATURES), np.nan)
    return tilt_features(series.time, np.abs(tilt))


def _rest_features(trial: CampaignTrial, record: Record | None) -> Array:
    series = trial.series
    if series is None:
        return np.full(len(REST_FEATURES), np.nan)
    moved = None
    if record is not None and record.displacement is not None:
        moved = record.displacement - record.displacement[0]
        moved = np.interp(series.time, record.sample_interval * np.arange(moved.size), moved)
    return rest_features(series.tilt_angle, series.position, series.orientation, moved, series.yaw)
