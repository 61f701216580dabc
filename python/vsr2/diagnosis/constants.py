"""Tuned numbers that a diagnosis rests on, gathered for its provenance."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from vsr2.analysis.intervals import INTERVALS
from vsr2.analysis.probability import RELIABILITY
from vsr2.diagnosis.budget import SCHEDULE
from vsr2.diagnosis.how_far.held_out import HELD_OUT
from vsr2.diagnosis.how_far.negative_controls import NEGATIVE_CONTROLS
from vsr2.diagnosis.how_far.waterfall import WATERFALL
from vsr2.diagnosis.noise_floor import NOISE_FLOOR
from vsr2.diagnosis.observed.features import SERIES
from vsr2.diagnosis.observed.observations import OBSERVED
from vsr2.diagnosis.observed.table_motion import TABLE_MOTION
from vsr2.diagnosis.posterior.calibration import CALIBRATED
from vsr2.diagnosis.posterior.discrepancy import DISCREPANCY
from vsr2.diagnosis.posterior.goodness_of_fit import LIBRARY_FIT
from vsr2.diagnosis.posterior.naming import NAMING
from vsr2.diagnosis.posterior.network import NETWORK
from vsr2.diagnosis.posterior.parameters import PARAMETERS
from vsr2.diagnosis.posterior.summaries import SUMMARY
from vsr2.diagnosis.posterior.training import TRAINING
from vsr2.diagnosis.posterior.truth import PRIOR
from vsr2.diagnosis.simulated.campaigns import SET_PRIOR
from vsr2.diagnosis.simulated.hypotheses import HYPOTHESIS
from vsr2.diagnosis.simulated.look import LOOK
from vsr2.diagnosis.simulated.nuisances import MOTION_NOISE
from vsr2.diagnosis.simulated.simulator import SIMULATION
from vsr2.diagnosis.verdict.limits import LIMITS
from vsr2.diagnosis.verdict.next_measurement import MEASUREMENT
from vsr2.diagnosis.where.scan import SCAN
from vsr2.simulation.run_constants import run_constants


def diagnosis_constants() -> dict[str, dict[str, Any]]:
    """Tuned numbers of a diagnosis, by what they are of; those of its trials among them."""
    return {
        "observed": asdict(OBSERVED),
        "series": asdict(SERIES),
        "table_motion": asdict(TABLE_MOTION),
        "schedule": asdict(SCHEDULE),
        "simulation": asdict(SIMULATION),
        "look": asdict(LOOK),
        "motion_noise": asdict(MOTION_NOISE),
        "hypotheses": asdict(HYPOTHESIS),
        "set_prior": asdict(SET_PRIOR),
        "discrepancy": asdict(DISCREPANCY),
        "summaries": asdict(SUMMARY),
        "network": asdict(NETWORK),
        "prior": asdict(PRIOR),
        "training": asdict(TRAINING),
        "calibration": asdict(CALIBRATED),
        "parameters": asdict(PARAMETERS),
        "library_fit": asdict(LIBRARY_FIT),
        "naming": asdict(NAMING),
        "noise_floor": asdict(NOISE_FLOOR),
        "scan": asdict(SCAN),
        "held_out": asdict(HELD_OUT),
        "negative_controls": asdict(NEGATIVE_CONTROLS),
        "waterfall": asdict(WATERFALL),
        "intervals": asdict(INTERVALS),
        "reliability": asdict(RELIABILITY),
        "measurement": asdict(MEASUREMENT),
        "limits": asdict(LIMITS),
        **run_constants(),
    }
