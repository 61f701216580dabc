"""Tuned numbers that a simulated campaign rests on, gathered for provenance."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from vsr2.ensemble.noise_floor import NOISE_FLOOR
from vsr2.ensemble.observed.features import SERIES
from vsr2.ensemble.observed.observations import OBSERVED
from vsr2.ensemble.observed.table_motion import TABLE_MOTION
from vsr2.ensemble.simulated.campaigns import SET_PRIOR
from vsr2.ensemble.simulated.hypotheses import HYPOTHESIS
from vsr2.ensemble.simulated.look import LOOK
from vsr2.ensemble.simulated.motion_noise import MOTION_NOISE
from vsr2.ensemble.simulated.simulator import SIMULATION
from vsr2.simulation.run_constants import run_constants


def ensemble_constants() -> dict[str, dict[str, Any]]:
    """Tuned numbers of a campaign observed and simulated, those of its trials among them."""
    return {
        "observed": asdict(OBSERVED),
        "series": asdict(SERIES),
        "table_motion": asdict(TABLE_MOTION),
        "simulation": asdict(SIMULATION),
        "look": asdict(LOOK),
        "motion_noise": asdict(MOTION_NOISE),
        "hypotheses": asdict(HYPOTHESIS),
        "set_prior": asdict(SET_PRIOR),
        "noise_floor": asdict(NOISE_FLOOR),
        **run_constants(),
    }
