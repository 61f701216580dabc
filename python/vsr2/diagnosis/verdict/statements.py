"""What a diagnosis states, as data: codes with typed values.

Nothing here is worded. :mod:`vsr2.report.messages.verdicts` makes sentences of it.
"""

from __future__ import annotations

from enum import StrEnum

from vsr2.codes import NAMES, Code
from vsr2.errors import Fault

# The rule of a name, by which training calibrates, decides on the kind.
from vsr2.posterior.naming import VerdictKind as VerdictKind


class GapState(StrEnum):
    """Whether there is a gap."""

    NOT_FOUND = "not_found"
    FOUND = "found"


class BudgetState(StrEnum):
    """Whether the budget sufficed, or is less than the least needs."""

    SUFFICIENT = "sufficient"
    EXCEEDED = "exceeded"


class ReasonCode(Code):
    """Why a verdict is what it is. Shares and probabilities are in [0, 1]."""

    NO_GAP = "no_gap", {"none": float, "limit": float}
    NONE_LESS_PROBABLE = "none_less_probable", {"favoured": NAMES}
    """`favoured`: effects; none: a cause outside the library."""
    GAP = "gap", {"none": float, "limit": float}
    MISFIT = "misfit", {"fit": float, "limit": float, "none": float}
    """`fit`: tail probability of the campaign among simulated ones without effect."""
    NAME_REACHED = "name_reached", {"probability": float, "wanted": float}
    TOGETHER_REACHED = "together_reached", {"probability": float, "wanted": float}
    SECOND_EFFECT_LIKELY = "second_effect_likely", {"probability": float}
    EQUIVALENT_HERE = "equivalent_here"
    OUTSIDE_OUTWEIGHS = "outside_outweighs", {"probability": float}
    TOO_MANY_NEEDED = (
        "too_many_needed",
        {"effects": NAMES, "probability": float, "wanted": float, "classes": int},
    )


class LimitCode(Code):
    """What the data, or the budget, cannot support. Shares and probabilities are in [0, 1]."""

    POSSIBLY_OUT_OF_LIBRARY = "possibly_out_of_library", {"probability": float, "prior": float}
    NO_GAIN = "no_gain", {"effects": NAMES}
    CONTROL_CLOSES_AS_MUCH = "control_closes_as_much"
    FEW_CAMPAIGNS = "few_campaigns", {"count": int}
    PART_OF_TRIALS = "part_of_trials", {"count": int, "of": int}
    EQUIVALENT_TO_MEMBER = "equivalent_to_member", {"effect": str, "others": NAMES}
    EQUIVALENT_EXCLUDED = "equivalent_excluded", {"effect": str, "others": NAMES}
    BEYOND_TOLERANCE = "beyond_tolerance", {"nuisances": NAMES}
    SIZE_MAY_BE_NULL = (
        "size_may_be_null",
        {"effect": str, "parameter": str, "low": float, "high": float, "unit": str, "null": float},
    )
    SIZE_AS_WIDE_AS_PRIOR = (
        "size_as_wide_as_prior",
        {"effect": str, "parameter": str, "low": float, "high": float, "unit": str},
    )
    TRIALS_INCOMPLETE = "trials_incomplete", {"count": int}
    EFFECTS_EXCLUDED = "effects_excluded", {"effects": NAMES}
    EFFECT_UNAVAILABLE = "effect_unavailable", {"effect": str, "fault": Fault}
    SPECIMENS = "specimens", {"specimens": NAMES}
    FEW_TRIALS = "few_trials", {"count": int}
    FEW_MOTIONS = "few_motions", {"count": int}
    OUTCOMES_ALONE = "outcomes_alone"
    TILTS_LACKING = "tilts_lacking", {"count": int}
    TILTS_UNUSED = "tilts_unused", {"count": int, "of": int}
    SERIES_UNUSED = "series_unused", {"count": int, "of": int}
    ALL_OVERTURNED = "all_overturned"
    ALL_STOOD = "all_stood"
    NO_NAMES = "no_names"
    OFTEN_WRONG = "often_wrong", {"share": float}
    LOW_DETECTION_RATE = "low_detection_rate", {"rate": float}
    NO_DETECTION_RATE = "no_detection_rate"
    INTERLEAVED_SESSIONS = "interleaved_sessions"
    INTERLEAVED_IN_ONE_SESSION = "interleaved_in_one_session"
    INTERLEAVED_MOTIONS = "interleaved_motions"
    ONE_SESSION = "one_session"
    FEW_SESSIONS = "few_sessions", {"permutations": int, "p": float}
    FEW_UNCERTAIN = "few_uncertain", {"count": int}
    INSENSITIVE = "insensitive", {"effects": NAMES}
    BUDGET_EXCEEDED = "budget_exceeded", {"simulations": int, "allowed": int}
    REFERENCE_DIFFERS = "reference_differs", {"reference": str, "probability": float}
    NOT_HELD_OUT = "not_held_out"
    NO_REPEATS = "no_repeats"
    REPEATS_SCATTER = "repeats_scatter", {"pairs": int, "share": float, "expected": float}
    MEASURES_LACKING = "measures_lacking"
