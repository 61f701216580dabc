"""What an experimenter would have written down of a simulated campaign."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vsr2.blind.design import Row
from vsr2.blind.mujoco import GroundMotion
from vsr2.blind.mujoco.ground import acceleration_of
from vsr2.blind.settings import PackSettings
from vsr2.blind.shake import Observed
from vsr2.campaign import Campaign, CampaignTrial, MeasurementNoise, Series, Specimen
from vsr2.motion import Record

Array = NDArray[np.float64]

SPECIMEN = "rock"
RANGE = 1.2
"""Of the camera [rad]: what fell is seen as far as this, whichever engine simulated it."""


def written_campaign(
    name: str,
    rows: Sequence[Row],
    motions: Sequence[GroundMotion],
    seen: Sequence[Observed],
    settings: PackSettings,
    rng: np.random.Generator,
) -> Campaign:
    """The campaign with noise, in the one form, with nothing of how it was made.

    Every campaign has the same columns, files, keys and digits whatever acts in it: all numbers
    are rounded to a fixed number of decimals, trials are named by their order, motions by the order
    in which they first come, and there is no provenance.
    """
    tolerances = settings.tolerances
    sizes = [_log_uniform(rng, *r) for r in _ranges(settings)]
    noise = MeasurementNoise(
        displacement=sizes[0],
        acceleration=sizes[1],
        peak_tilt=tolerances.peak_tilt_noise,
        tilt=tolerances.tilt_noise if settings.series_interval else None,
        position=tolerances.position_noise if settings.series_interval else None,
        orientation=tolerances.orientation_noise if settings.series_interval else None,
    )
    names: dict[int, str] = {}
    trials, records = [], {}
    digits = len(str(len(rows)))
    for i, (row, one) in enumerate(zip(rows, seen, strict=True)):
        label = f"T{i + 1:0{digits}d}"
        motion = motions[row.motion]
        moved = motion.displacement * row.pga
        felt = acceleration_of(moved, motion.interval)
        draws = rng.standard_normal((2, moved.size))
        records[label] = Record(
            name=label,
            sample_interval=motion.interval,
            displacement=np.round(moved + sizes[0] * draws[0], 8),
            acceleration=np.round(felt + sizes[1] * draws[1], 5),
        )
        peak = min(one.peak_tilt, RANGE) + tolerances.peak_tilt_noise * rng.standard_normal()
        speed = np.abs(np.gradient(motion.displacement, motion.interval)).max()
        trials.append(
            CampaignTrial(
                trial=label,
                motion=names.setdefault(row.motion, f"M{len(names) + 1:02d}"),
                session=f"S{row.session + 1}",
                order=i + 1,
                specimen=SPECIMEN,
                overturned=one.overturned,
                motion_file=label,
                peak_tilt=float(np.clip(round(float(peak), 5), 0.0, 3.14159)),
                pga=row.pga,
                pgv_pga=round(float(speed), 5),
                series=_series(one, settings, rng) if settings.series_interval else None,
            )
        )
    return Campaign(
        name=name,
        trials=tuple(trials),
        motions=records,
        specimens={SPECIMEN: Specimen()},
        noise=noise,
    )


def _ranges(settings: PackSettings) -> tuple[tuple[float, float], tuple[float, float]]:
    return settings.tolerances.displacement_noise, settings.tolerances.acceleration_noise


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(f"{low * (high / low) ** float(rng.random()):.3g}")


def _series(one: Observed, settings: PackSettings, rng: np.random.Generator) -> Series:
    tolerances = settings.tolerances
    beyond = np.flatnonzero(one.tilt > RANGE)
    rows = max(1, int(beyond[0])) if beyond.size else one.time.size
    draws = rng.standard_normal((rows, 7))
    half = 0.5 * tolerances.orientation_noise * draws[:, 4:7]
    x, y, z = half.T
    a, b, c, d = one.orientation[:rows].T
    # small rotation times orientation, x, y, z, w
    turned = np.stack(
        [
            a + x * d + y * c - z * b,
            b - x * c + y * d + z * a,
            c + x * b - y * a + z * d,
            d - x * a - y * b - z * c,
        ],
        axis=1,
    )
    return Series(
        time=np.round(one.time[:rows], 6),
        tilt=np.round(one.tilt[:rows] + tolerances.tilt_noise * draws[:, 0], 6),
        position=np.round(one.position[:rows] + tolerances.position_noise * draws[:, 1:4], 6),
        orientation=np.round(turned / np.linalg.norm(turned, axis=1, keepdims=True), 7),
    )
