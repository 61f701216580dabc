"""Constants of the document's limits, chosen by hand unless a command is named."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LimitConstants:
    """From where on a limit is stated.

    Attributes:
        few_trials: fewer are called few; about what an experiment of one day has.
        few_motions: fewer are called few.
        few_uncertain: uncertain trials; fewer are called few.
        low_detection_rate: of causes outside the library.
        all_of_prior: share of a prior's range beyond which an interval determines no size.
        scatter: standard deviations by which repeats must differ more than expected.
        moved_outcomes: outcomes that an effect must move for a campaign to respond to it.
        moved_features: the same for a feature, as a sum of squares in standard deviations.
        locations: the most significant that are written down, beside those of all trials.
    """

    few_trials: int = 100
    few_motions: int = 10
    few_uncertain: int = 20
    low_detection_rate: float = 0.5
    all_of_prior: float = 0.85
    scatter: float = 3.0
    moved_outcomes: float = 2.0
    moved_features: float = 4.0
    locations: int = 20


LIMITS = LimitConstants()
