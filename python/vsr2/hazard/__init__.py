"""Hazard: how often shaking of a site overturns a rock, and what a standing rock says of that."""

from vsr2.hazard.hazard_curve import HazardCurve, read_hazard_curve
from vsr2.hazard.overturning_rate import (
    RateDraws,
    excluded_age,
    overturning_rate,
    rate_draws,
    read_lognormal,
    survival,
)

__all__ = [
    "HazardCurve",
    "RateDraws",
    "excluded_age",
    "overturning_rate",
    "rate_draws",
    "read_hazard_curve",
    "read_lognormal",
    "survival",
]
