"""What an experimenter would have written down of a simulated campaign."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vsr2.blind.design import Protocol, trial_name
from vsr2.blind.settings import PackSettings
from vsr2.blind.shake import Observed
from vsr2.campaign import Campaign, CampaignTrial, MeasurementNoise, Series, Specimen

Array = NDArray[np.float64]

SPECIMEN = "rock"
RANGE = 1.2
"""Of the camera [rad]: what fell is seen as far as this, whichever engine simulated it."""


def written_campaign(
    name: str,
    protocol: Protocol,
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
    noise = MeasurementNoise(
        displacement=protocol.displacement_noise,
        acceleration=protocol.acceleration_noise,
        peak_tilt=tolerances.peak_tilt_noise,
        tilt=tolerances.tilt_noise if settings.series_interval else None,
        position=tolerances.position_noise if settings.series_interval else None,
        orientation=tolerances.orientation_noise if settings.series_interval else None,
    )
    names: dict[int, str] = {}
    trials = []
    for i, (row, motion, one) in enumerate(zip(protocol.rows, protocol.motions, seen, strict=True)):
        label = trial_name(i, len(protocol.rows))
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
        motions=dict(protocol.records),
        specimens={SPECIMEN: Specimen()},
        noise=noise,
    )


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
