"""Numbers drawn from results and campaigns: agreement with outcomes, tracking, baselines."""

from vsr2.analysis.baseline import baseline_scores, logistic_baseline
from vsr2.analysis.bootstrap import classification_intervals
from vsr2.analysis.metrics import Classification, classification_metrics
from vsr2.analysis.probability import overturning_probability, probability_intervals, reliability
from vsr2.analysis.tracking import Tracking, tracking

__all__ = [
    "Classification",
    "Tracking",
    "baseline_scores",
    "classification_intervals",
    "classification_metrics",
    "logistic_baseline",
    "overturning_probability",
    "probability_intervals",
    "reliability",
    "tracking",
]
