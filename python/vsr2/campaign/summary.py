"""What a campaign holds, as data."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from vsr2.campaign.campaign import Campaign
from vsr2.campaign.intensity import intensity_measures


def campaign_summary(campaign: Campaign) -> dict[str, Any]:
    """Counts and ranges (JSON-serialisable).

    Raises:
        MotionError: intensity is to be computed from a motion that cannot be filtered.
    """
    trials = campaign.trials
    measures = intensity_measures(campaign)
    outcomes = campaign.overturned
    return {
        "name": campaign.name,
        "description": campaign.description,
        "tier": campaign.tier,
        "trials": len(trials),
        "overturned": int(np.nansum(outcomes)),
        "standing": int(np.count_nonzero(outcomes == 0)),
        "outcome_unknown": int(np.count_nonzero(np.isnan(outcomes))),
        "with_motion": sum(trial.motion_file is not None for trial in trials),
        "with_peak_tilt": sum(trial.peak_tilt is not None for trial in trials),
        "with_series": sum(trial.series is not None for trial in trials),
        "ground_motions": len({trial.motion for trial in trials}),
        "motion_files": len({t.motion_file for t in trials if t.motion_file is not None}),
        "sessions": len({trial.session for trial in trials}),
        "specimens": {
            key: {
                "trials": sum(trial.specimen == key for trial in trials),
                "mass_kg": specimen.mass,
                "model_file": None if specimen.model_file is None else str(specimen.model_file),
            }
            for key, specimen in campaign.specimens.items()
        },
        "pga_g": _range(measures.pga_g),
        "pgv_pga_s": _range(measures.pgv_pga_s),
        "extra_columns": list(campaign.extra_columns),
        "notes": dict(Counter(trial.note for trial in trials if trial.note)),
    }


def _range(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> list[float] | None:
    known = values[~np.isnan(values)]
    return [float(known.min()), float(known.max())] if known.size else None
