"""Intensity of the table's motion in each trial."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.campaign.campaign import Campaign
from vsr2.config.motion_source import Filter
from vsr2.errors import Renamed
from vsr2.motion import Record, build_recorded_motion

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TrialIntensities:
    """Of each trial, NaN where unknown.

    Attributes:
        pga_g: shape (trials,) [g].
        pgv_pga_s: PGV/PGA, shape (trials,) [s].
    """

    pga_g: Array
    pgv_pga_s: Array

    pga = Renamed("pga_g", " [g]")
    pgv_pga = Renamed("pgv_pga_s", " [s]")


def intensity_measures(campaign: Campaign, *, filter: Filter | None = None) -> TrialIntensities:
    """PGA and PGV/PGA: as published with the trial, otherwise from its motion.

    From a motion they are those of the acceleration channel, or without one of the displacement's
    derivatives, at the motion's own sampling and after a band-pass
    (:func:`vsr2.motion.build_recorded_motion`).

    Args:
        campaign: may mix both sources and none.
        filter: None: 0.1-25 Hz, order 3.

    Raises:
        MotionError: a motion that cannot be filtered.
    """
    used = Filter() if filter is None else filter
    pga = np.full(len(campaign), np.nan)
    ratio = np.full(len(campaign), np.nan)
    measured: dict[str, tuple[float, float]] = {}
    for i, trial in enumerate(campaign.trials):
        if trial.pga_g is not None:
            pga[i] = trial.pga_g
        if trial.pgv_pga_s is not None:
            ratio[i] = trial.pgv_pga_s
        record = campaign.record(trial)
        if record is None or trial.motion_file is None or not np.isnan(pga[i] + ratio[i]):
            continue
        if trial.motion_file not in measured:
            measured[trial.motion_file] = _measured(record, used)
        own_pga, own_ratio = measured[trial.motion_file]
        pga[i] = own_pga if np.isnan(pga[i]) else pga[i]
        ratio[i] = own_ratio if np.isnan(ratio[i]) else ratio[i]
    return TrialIntensities(pga, ratio)


def _measured(record: Record, filter: Filter) -> tuple[float, float]:
    motion = build_recorded_motion(
        record,
        record.sample_interval,
        channel="displacement" if record.acceleration is None else "acceleration",
        filter=filter,
    )
    return motion.pga_g, motion.pgv_pga_s
