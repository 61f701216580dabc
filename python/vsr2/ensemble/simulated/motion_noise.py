"""Noise of the table about the recorded motion: a nuisance, and no cause."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from vsr2.effects import Circumstances, Effect, Parameter
from vsr2.motion.processing import differentiate
from vsr2.trial import Trial


@dataclass(frozen=True)
class MotionNoiseConstants:
    """How noise is brought in and out; chosen by hand.

    Attributes:
        taper: share of the motion over which it is, at either end.
        power: of the sine there; from 4 on the third derivative vanishes where it begins and ends,
            so that the table starts at rest.
    """

    taper: float = 0.1
    power: int = 4


MOTION_NOISE = MotionNoiseConstants()


class MotionNoise(Effect):
    """The table does not do what was recorded: noise is added to the motion.

    Gaussian, of a flat spectrum of displacement up to the corner, brought in and out at
    its ends. It is a nuisance and no cause: the library does not have it.
    """

    name = "motion_noise"
    meaning = "The table's motion differs from the recorded one by noise"
    parameters = (
        Parameter(
            "displacement", "m", 0.0, 0.0, 0.001, "uniform", "standard deviation",
            limits=(0.0, 0.1),
        ),
        Parameter(
            "corner", "Hz", 10.0, 1.0, 25.0, "fixed", "upper end of its spectrum",
            limits=(0.5, 100.0), secondary=True,
        ),
    )  # fmt: skip
    channels = ("motion", "tilt")
    stage = "actuation"
    rank = 9

    def at(self, values: Mapping[str, float], circumstances: Circumstances) -> Mapping[str, float]:
        """With the seed of the trial's noise."""
        return {**values, "seed": float(circumstances.rng.integers(2**31))}

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        """The trial with noise in its motion."""
        motion = trial.motion
        count, step = motion.displacement.size, motion.time_step
        rng = np.random.default_rng(int(values["seed"]))
        frequency = np.fft.rfftfreq(count, step)
        within = (frequency > 0) & (frequency <= values["corner"])
        parts = rng.standard_normal((2, frequency.size)) * within
        noise = np.fft.irfft(parts[0] + 1j * parts[1], count)
        noise *= values["displacement"] / max(float(noise.std()), 1e-300)
        tapers = 1 / MOTION_NOISE.taper
        ends = np.minimum(np.linspace(0, tapers, count), np.linspace(tapers, 0, count))
        noise *= np.sin(0.5 * np.pi * np.minimum(ends, 1.0)) ** MOTION_NOISE.power
        more = differentiate(noise, step)
        noisy = replace(
            motion,
            displacement=motion.displacement + more.displacement - more.displacement[0],
            velocity=motion.velocity + more.velocity,
            acceleration=motion.acceleration + more.acceleration,
            source=f"{motion.source}; noise of {values['displacement']:.4g} m",
            recorded=None,
        )
        return replace(trial, motion=noisy)
