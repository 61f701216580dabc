"""Words for how predictions agree with outcomes: on what they were fitted, what the data tell."""

from __future__ import annotations

from vsr2.analysis.baseline import Fitted
from vsr2.calibration.profile import Identifiability
from vsr2.report.messages.templates import check_worded

FITTED = {
    Fitted.OUT_OF_FOLD: "out of fold",
    Fitted.IN_SAMPLE: "in sample",
    Fitted.BEST_OF_ALL: "in sample, best of all sets",
    Fitted.GIVEN: "not by us",
}
"""On which trials a way of predicting was fitted."""
check_worded(Fitted, FITTED, __name__)

IDENTIFIABILITY = {
    Identifiability.IDENTIFIED: "identified",
    Identifiability.BOUNDED_ABOVE: "bounded above",
    Identifiability.BOUNDED_BELOW: "bounded below",
    Identifiability.NOT_IDENTIFIED: "not identified",
}
"""How far the data tell a parameter."""
check_worded(Identifiability, IDENTIFIABILITY, __name__)
