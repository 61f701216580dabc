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
from vsr2.diagnosis.verdict.limits import LIMITS
from vsr2.diagnosis.verdict.next_measurement import MEASUREMENT
from vsr2.diagnosis.where.scan import SCAN
from vsr2.ensemble.ensemble_constants import ensemble_constants
from vsr2.posterior.posterior_constants import posterior_constants


def diagnosis_constants() -> dict[str, dict[str, Any]]:
    """Tuned numbers of a diagnosis, by what they are of; those of its campaigns among them."""
    return {
        "schedule": asdict(SCHEDULE),
        "scan": asdict(SCAN),
        "held_out": asdict(HELD_OUT),
        "negative_controls": asdict(NEGATIVE_CONTROLS),
        "waterfall": asdict(WATERFALL),
        "intervals": asdict(INTERVALS),
        "reliability": asdict(RELIABILITY),
        "measurement": asdict(MEASUREMENT),
        "limits": asdict(LIMITS),
        **posterior_constants(),
        **ensemble_constants(),
    }
