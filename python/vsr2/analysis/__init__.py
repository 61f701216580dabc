"""Numbers drawn from results and campaigns: agreement, tracking, baselines, time steps."""

from vsr2.analysis.baseline import baseline_scores, logistic_baseline
from vsr2.analysis.bootstrap import classification_intervals
from vsr2.analysis.metrics import Classification, classification_metrics
from vsr2.analysis.probability import overturning_probability, probability_intervals, reliability
from vsr2.analysis.time_step_choice import TimeStepChoice, TimeStepWarning, choose_time_step
from vsr2.analysis.time_steps import TimeStepError, compare_time_steps, longest_time_step
from vsr2.analysis.tracking import Tracking, tracking

__all__ = [
    "Classification",
    "TimeStepChoice",
    "TimeStepError",
    "TimeStepWarning",
    "Tracking",
    "baseline_scores",
    "choose_time_step",
    "classification_intervals",
    "classification_metrics",
    "compare_time_steps",
    "logistic_baseline",
    "longest_time_step",
    "overturning_probability",
    "probability_intervals",
    "reliability",
    "tracking",
]
