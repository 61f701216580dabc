"""Campaigns of the planar block with a known cause, for development, tests and calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vsr2.campaign import Campaign, CampaignTrial, MeasurementNoise, Specimen
from vsr2.diagnosis.planar import GRAVITY
from vsr2.diagnosis.planar_simulator import PlanarSimulator
from vsr2.diagnosis.simulator import Effects, Request
from vsr2.motion import Record

Array = NDArray[np.float64]

INTERVAL = 0.005
"""Sampling interval of the motions [s]."""


def shaken_campaign(
    motions: int = 15,
    scalings: int = 10,
    *,
    duration: float = 5.0,
    pga: tuple[float, float] = (0.3, 1.4),
    session_size: int = 20,
    seed: int = 0,
) -> Campaign:
    """Trials without outcomes: pulses in band-limited noise, each scaled several times.

    Every motion has a pulse frequency of its own between 0.8 and 4 Hz; its scalings spread over
    the range of PGA [g] widened by the frequency, as a slow motion overturns sooner. Trials are
    run motion by motion, the motions in random order, scalings rising.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, duration, INTERVAL)
    records: dict[str, Record] = {}
    trials: list[CampaignTrial] = []
    for m in rng.permutation(motions):
        frequency = float(np.exp(rng.uniform(np.log(0.8), np.log(4.0))))
        shape = _shape(time, frequency, rng)
        low, high = (value * frequency**0.35 for value in pga)
        for k in range(scalings):
            peak = GRAVITY * low * (high / low) ** ((k + rng.random()) / scalings)
            name = f"M{m:02d}-{k:02d}"
            records[name] = Record(name=name, sample_interval=INTERVAL, acceleration=shape * peak)
            trials.append(
                CampaignTrial(
                    trial=f"T{len(trials):03d}",
                    motion=f"M{m:02d}",
                    session=f"S{len(trials) // session_size:02d}",
                    order=len(trials),
                    specimen="block",
                    motion_file=name,
                )
            )
    return Campaign(
        name="planar", trials=tuple(trials), motions=records, specimens={"block": Specimen()}
    )


def _shape(time: Array, frequency: float, rng: np.random.Generator) -> Array:
    """A motion of unit peak acceleration that begins and ends at rest."""
    from scipy.signal import butter, sosfiltfilt

    centre = 0.4 * time[-1]
    pulse = np.cos(2 * np.pi * frequency * (time - centre) + rng.uniform(0, 2 * np.pi))
    pulse *= np.exp(-((frequency * (time - centre) / 1.2) ** 2))
    band = butter(2, [0.5, 8.0], "bandpass", fs=1 / INTERVAL, output="sos")
    noise = sosfiltfilt(band, rng.standard_normal(time.size))
    noise *= np.exp(-(((time - centre) / (0.25 * time[-1])) ** 2)) / np.abs(noise).max()
    shape = (pulse + 0.5 * noise) * np.sin(np.pi * time / time[-1]) ** 0.5
    shape -= shape.mean()
    return np.asarray(shape / np.abs(shape).max(), dtype=np.float64)


def observe(
    campaign: Campaign,
    simulator: PlanarSimulator,
    effects: Effects = (),
    *,
    nuisance: int,
    tier: str = "B",
    peak_noise: float = 0.003,
    seed: int = 0,
) -> Campaign:
    """The campaign with outcomes (and largest tilts, from tier M on) that a simulator gives.

    Args:
        campaign: made by :func:`shaken_campaign`.
        simulator: with a seed other than the diagnosis uses, so that its draws stay unknown.
        effects: what is planted.
        nuisance: draw of the simulator's nuisances.
        tier: B or M.
        peak_noise: standard error of the largest tilt [rad].
        seed: of that noise.
    """
    found = simulator.run([Request(i, effects, nuisance, 1) for i in range(len(campaign))])
    rng = np.random.default_rng(seed)
    noisy = np.clip(found.peak_tilt + peak_noise * rng.standard_normal(len(campaign)), 0, np.pi)
    trials: Sequence[CampaignTrial] = [
        replace(
            trial,
            overturned=bool(found.overturned[i]),
            peak_tilt=None if tier == "B" else float(noisy[i]),
        )
        for i, trial in enumerate(campaign.trials)
    ]
    return replace(campaign, trials=tuple(trials), noise=MeasurementNoise(peak_tilt=peak_noise))
