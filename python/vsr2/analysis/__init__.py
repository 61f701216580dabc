"""Figures drawn from results: agreement with observed outcomes, tracking of the drive."""

from vsr2.analysis.metrics import Classification, classification_metrics
from vsr2.analysis.tracking import Tracking, tracking

__all__ = ["Classification", "Tracking", "classification_metrics", "tracking"]
