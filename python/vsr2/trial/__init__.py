"""A trial: what is run, as a value that effects change and simulations take."""

from vsr2.trial.trial import Applied, Observation, Trial, rows_only

__all__ = ["Applied", "Observation", "Trial", "rows_only"]
