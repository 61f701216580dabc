"""What an experimenter would have written down of a simulated campaign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.blind.custodian.design import Protocol, trial_name
from vsr2.blind.form.pack_settings import PackSettings
from vsr2.blind.mujoco import Response
from vsr2.campaign import Campaign, CampaignTrial, MeasurementNoise, Series, Specimen
from vsr2.motion import STANDARD_GRAVITY
from vsr2.scene.rotation import quaternion_product

Array = NDArray[np.float64]

SPECIMEN = "rock"


@dataclass(frozen=True)
class RecordingConstants:
    """What the camera sees; chosen by hand, sealed with a pack.

    Attributes:
        range: greatest tilt [rad]: what fell is seen as far as this, whichever engine simulated it.
        tail: for which the camera runs on after the recorded motion [s]: longer than a rock of half
            a metre rocks on, and than any effect draws the motion out.
    """

    range: float = 1.2
    tail: float = 3.0


RECORDING = RecordingConstants()


def recorded_campaign(
    name: str,
    protocol: Protocol,
    seen: Sequence[Response],
    settings: PackSettings,
    rng: np.random.Generator,
) -> Campaign:
    """The campaign with noise, in the one form, with nothing of how it was made.

    Every campaign has the same columns, files, keys and digits whatever acts in it: all numbers
    are rounded to a fixed number of decimals, trials are named by their order, motions by the order
    in which they first come, and there is no provenance. Series begin with the recorded motion and
    end `RECORDING.tail` after it, whatever the engine simulated; those of rocks that fell end at
    `RECORDING.range`.
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
        peak = (
            min(one.peak_tilt, RECORDING.range) + tolerances.peak_tilt_noise * rng.standard_normal()
        )
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
                pga_g=round(row.peak_acceleration / STANDARD_GRAVITY, 5),
                pgv_pga_s=round(float(speed), 5),
                series=_series(one, motion.duration, settings, rng)
                if settings.series_interval
                else None,
            )
        )
    return Campaign(
        name=name,
        trials=tuple(trials),
        motions=dict(protocol.records),
        specimens={SPECIMEN: Specimen()},
        noise=noise,
    )


def _series(
    one: Response, duration: float, settings: PackSettings, rng: np.random.Generator
) -> Series:
    """As the camera saw it; what rests when its simulation ends is seen to rest on."""
    tolerances = settings.tolerances
    interval = settings.series_interval
    time = interval * np.arange(int((duration + RECORDING.tail) / interval + 1e-9) + 1)
    if one.peak_tilt > RECORDING.range:
        beyond = (np.interp(time, one.time, one.tilt) > RECORDING.range) | (
            time > one.time[-1] + 1e-9
        )
        if beyond.any():
            time = time[: max(1, int(np.argmax(beyond)))]

    def at(values: Array) -> Array:
        columns = values.reshape(one.time.size, -1).T
        return np.stack([np.interp(time, one.time, column) for column in columns], axis=1)

    draws = rng.standard_normal((time.size, 7))
    small = np.insert(0.5 * tolerances.orientation_noise * draws[:, 4:7], 3, 1.0, axis=1)
    turned = quaternion_product(small, at(one.orientation))
    return Series(
        time=np.round(time, 6),
        tilt=np.round(at(one.tilt)[:, 0] + tolerances.tilt_noise * draws[:, 0], 6),
        position=np.round(at(one.position) + tolerances.position_noise * draws[:, 1:4], 6),
        orientation=np.round(turned / np.linalg.norm(turned, axis=1, keepdims=True), 7),
    )
