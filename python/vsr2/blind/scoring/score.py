"""Scores of a pack: what is asked of each case, and the figures over cases."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis.intervals import (
    Score,
    area_under_roc,
    calibration_error,
    calibration_noise,
    proportion,
    resampled,
)
from vsr2.blind.form.pack_form import EffectAxis
from vsr2.blind.form.pack_settings import Kind
from vsr2.blind.scoring.cases import Case, groups
from vsr2.diagnosis.verdict.statements import VerdictKind
from vsr2.diagnosis.where.scan import LocationAxis
from vsr2.ensemble.simulated.library import NONE, UNKNOWN

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ScoringRules:
    """What scores count; all are choices, none is fitted.

    Attributes:
        least_probability: that counts in the log score: one verdict cannot cost more than 6.9.
        false_alarm: share of other campaigns that may count as unknown, for the rate at which the
            unknown is found; the usual level of a test.
        most_classes: that a verdict may name and be right: a longer list says little to whoever has
            to measure next.
        location_gain: share of the effect over share of the trials that a location should hold:
            twice that of trials drawn at random, which hold the effect by their share.
    """

    least_probability: float = 1e-3
    false_alarm: float = 0.05
    most_classes: int = 3
    location_gain: float = 2.0


SCORING = ScoringRules()
THRESHOLDS = frozenset({("catch", "slack"), ("outcome_rule", "tilt")})
"""Strengths that are tilts beyond which something acts: without the effect there is none. Engines
state that as infinity or as a tilt that no trial reaches, from which no distance is a size."""


FITTING: Mapping[EffectAxis, frozenset[LocationAxis]] = {
    EffectAxis.CONDITIONS: frozenset({LocationAxis.CONDITIONS}),
    EffectAxis.ORDER: frozenset({LocationAxis.ORDER, LocationAxis.SESSION}),
    EffectAxis.NONE: frozenset(),
}
"""Axes of locations that fit the axis of an effect."""


class ScoreCode(StrEnum):
    """A score; `vsr2.report.messages.scores` words it."""

    ANSWER = "answer"
    LEADS = "leads"
    NAMED = "named"
    DETECTED = "detected"
    WRONG = "wrong_of_named"
    NONE_NAMED = "none_named"
    NONE_SAID = "none_said"
    REFERENCE_NONE = "reference_none"
    REFERENCE_EFFECTS = "reference_effects"
    PAIR_NAMED = "pair_named"
    PAIR_WRONG = "pair_wrong_of_named"
    UNKNOWN_SAID = "unknown_said"
    UNKNOWN_AUROC = "unknown_auroc"
    UNKNOWN_RATE = "unknown_rate"
    SET_COVERAGE = "set_coverage"
    SET_SIZE = "set_size"
    LOG_SCORE = "log_score"
    CALIBRATION = "calibration"
    CALIBRATION_NOISE = "calibration_noise"
    ESTIMATED = "magnitude_estimated"
    ERROR = "magnitude_error"
    INTERVAL = "magnitude_interval"
    CLOSURE = "closure"
    HEADLINE = "headline"
    LOSS_FALLS = "loss_falls"
    LOSS_RISES = "loss_rises"
    WHERE_GAIN = "where_gain"
    WHERE_TWICE = "where_twice"
    WHERE_AXIS = "where_axis"
    WHERE_FALSE = "where_false"
    UNRESOLVED = "unresolved"


Scores = dict[ScoreCode, Score]

SAYING_NOTHING = {ScoreCode.ERROR: 1.0, ScoreCode.CLOSURE: 0.0, ScoreCode.WHERE_GAIN: 1.0}
"""What a diagnosis gets that estimates no magnitude, adds no effect, and names all trials or random
ones: the trivial baseline of these scores."""
BEST_HIGH = (
    ScoreCode.ANSWER,
    ScoreCode.NAMED,
    ScoreCode.LEADS,
    ScoreCode.UNKNOWN_AUROC,
    ScoreCode.UNKNOWN_RATE,
)
"""Scores that a trivial baseline has too, the higher the better."""
BEST_LOW = (ScoreCode.CALIBRATION, ScoreCode.LOG_SCORE, ScoreCode.WRONG, ScoreCode.NONE_NAMED)
"""The same, the lower the better."""


def is_named(case: Case) -> bool:
    """Whether the verdict names effects."""
    return case.verdict.kind.names_effects


def detected(case: Case) -> bool:
    """Whether the verdict says that there is a gap, of whatever cause."""
    return case.verdict.kind is not VerdictKind.NONE and not case.verdict.failed


def right(case: Case) -> bool:
    """Whether the verdict is the truth, by classes.

    Of one effect: it names it, or at most 3 classes with it. Of two: it is a pair of just these.
    A verdict of no gap, or of the unknown, is right for a campaign of that kind.
    """
    named, truth = _named(case), set(case.truth)
    if not is_named(case):
        return truth == {case.verdict.kind}
    if case.verdict.kind.names_several:
        return len(truth) > 1 and named == truth
    return len(truth) == 1 and truth <= named and len(named) <= SCORING.most_classes


def wrong(case: Case) -> bool | None:
    """Whether a name is wrong: a pair with one that does not act, others without any that does.

    None: nothing is named.
    """
    if not is_named(case):
        return None
    named, truth = _named(case), set(case.truth)
    return not (named <= truth if case.verdict.kind.names_several else named & truth)


def _named(case: Case) -> set[str]:
    return set(case.labels(case.verdict.effects)) - {NONE, UNKNOWN}


def leading_class(case: Case) -> str:
    """The most probable class that is an effect's; of a verdict without any, the first it names."""
    ranked = [name for name in case.class_probabilities if name not in (NONE, UNKNOWN)]
    return next(iter(ranked + case.labels(case.verdict.effects)), "")


def in_set(case: Case) -> bool:
    """Whether the 90 % set holds a true class."""
    return bool(set(case.labels(case.verdict.conformal)) & set(case.truth))


def log_loss(case: Case) -> float:
    """- ln of the probability of the true class, at least 0.001."""
    found = case.class_probabilities.get(case.truth[0], 0.0)
    return -math.log(min(1.0, max(found, SCORING.least_probability)))


def magnitude(case: Case) -> tuple[float, bool | None] | None:
    """Of the strength: error over the effect's :func:`size`, whether its interval holds the truth.

    None: the diagnosis has no estimate of it, or no interval.
    """
    effect = case.effects[0]
    estimate = case.verdict.parameters.get(effect["name"], {}).get(effect["strength"])
    if estimate is None:
        return None
    truth, ends = effect["values"][effect["strength"]], estimate.ci90
    holds = None if ends is None else ends[0] <= truth <= ends[1]
    return abs(estimate.mean - truth) / size(effect), holds


def _error(case: Case) -> float | None:
    found = magnitude(case)
    return None if found is None else found[0]


def _holds(case: Case) -> bool | None:
    found = magnitude(case)
    return None if found is None else found[1]


def size(effect: Mapping[str, Any]) -> float:
    """|truth - null| of a sealed effect's strength; |truth| for a null of infinity or a threshold.

    Args:
        effect: of a key.
    """
    name, strength, null = effect["name"], effect["strength"], effect["null"]
    truth: float = effect["values"][strength]
    absent = null is None or (name, strength) in THRESHOLDS
    return abs(truth) if absent else abs(truth - null)


def where_gain(case: Case) -> float | None:
    """Share of the effect's changes over that of the trials, in the median of its locations.

    One drawn at random holds as much of the one as of the other. None: no location stands out, or
    the changes are not known.
    """
    weights = case.where["weights"]
    total = math.fsum(weights)
    if not case.verdict.where or total <= 0:
        return None
    weight = dict(zip(case.trials, weights, strict=True))
    mean = total / len(weights)
    inside = [[weight[trial] for trial in one.trials or ()] for one in case.verdict.where]
    return median(math.fsum(own) / len(own) / mean for own in inside)


def axis_named(case: Case) -> bool:
    """Whether a location stands out along the axis of the effect."""
    wanted = FITTING[EffectAxis(case.where["axis"])]
    return any(location.axis in wanted for location in case.verdict.where)


Question = Callable[[Case], float | bool | None]
"""What is asked of a case; None: it does not count."""


def _both(test: Callable[[float], bool], value: Question) -> Question:
    """Whether a value passes a test, where there is one."""

    def asked(case: Case) -> bool | None:
        found = value(case)
        return None if found is None else test(found)

    return asked


def _end(case: Case, i: int) -> float | None:
    return None if case.verdict.gain is None else case.verdict.gain[i]


def _located(gain: float) -> bool:
    return gain >= SCORING.location_gain


_ONE = (Kind.SINGLE, Kind.NONE, Kind.UNKNOWN)
_SHARES: Mapping[ScoreCode, tuple[tuple[Kind, ...], Question]] = {
    ScoreCode.ANSWER: ((Kind.SINGLE,), lambda c: c.first[0] in c.truth),
    ScoreCode.LEADS: ((Kind.SINGLE,), lambda c: leading_class(c) in c.truth),
    ScoreCode.NAMED: ((Kind.SINGLE,), right),
    ScoreCode.DETECTED: ((Kind.SINGLE,), detected),
    ScoreCode.WRONG: (_ONE, wrong),
    ScoreCode.NONE_NAMED: ((Kind.NONE,), is_named),
    ScoreCode.NONE_SAID: ((Kind.NONE,), right),
    ScoreCode.REFERENCE_NONE: ((Kind.REFERENCE,), lambda c: None if c.effects else right(c)),
    ScoreCode.REFERENCE_EFFECTS: ((Kind.REFERENCE,), lambda c: right(c) if c.effects else None),
    ScoreCode.PAIR_NAMED: ((Kind.PAIR,), right),
    ScoreCode.PAIR_WRONG: ((Kind.PAIR,), wrong),
    ScoreCode.UNKNOWN_SAID: ((Kind.UNKNOWN,), right),
    ScoreCode.SET_COVERAGE: (_ONE, in_set),
    ScoreCode.ESTIMATED: ((Kind.SINGLE,), lambda c: magnitude(c) is not None),
    ScoreCode.INTERVAL: ((Kind.SINGLE,), _holds),
    ScoreCode.LOSS_FALLS: ((Kind.SINGLE,), _both(lambda low: low > 0, lambda c: _end(c, 0))),
    ScoreCode.LOSS_RISES: ((Kind.SINGLE,), _both(lambda high: high < 0, lambda c: _end(c, 1))),
    ScoreCode.WHERE_TWICE: (
        (Kind.SINGLE,),
        _both(_located, where_gain),
    ),
    ScoreCode.WHERE_AXIS: ((Kind.SINGLE,), axis_named),
    ScoreCode.WHERE_FALSE: ((Kind.NONE,), lambda c: bool(c.verdict.where)),
    ScoreCode.UNRESOLVED: (tuple(Kind), lambda c: c.verdict.kind is VerdictKind.UNRESOLVED),
}
_MEDIANS: Mapping[ScoreCode, tuple[tuple[Kind, ...], Question]] = {
    ScoreCode.SET_SIZE: (_ONE, lambda c: len(set(c.labels(c.verdict.conformal)))),
    ScoreCode.ERROR: ((Kind.SINGLE,), _error),
    ScoreCode.CLOSURE: ((Kind.SINGLE,), lambda c: c.verdict.closure),
    ScoreCode.HEADLINE: ((Kind.SINGLE,), lambda c: c.verdict.headline),
    ScoreCode.WHERE_GAIN: ((Kind.SINGLE,), where_gain),
}


def score_cases(
    cases: Sequence[Case], of: Collection[str] | None = None
) -> dict[tuple[str, str], Scores]:
    """Scores by tier and group, each with its 95 % interval.

    Proportions have exact intervals, all else a bootstrap over campaigns.

    Args:
        cases: of one or more packs.
        of: groups to be scored; None: all.
    """
    return {
        name: _scores(members)
        for name, members in groups(cases).items()
        if of is None or name[1] in of
    }


def _scores(cases: Sequence[Case]) -> Scores:
    found: Scores = {}
    for code, asked in _SHARES.items():
        answers = _answers(cases, *asked)
        found[code] = proportion(int(sum(answers)), len(answers))
    for code, asked in _MEDIANS.items():
        found[code] = resampled(_answers(cases, *asked), lambda rows: np.median(rows, axis=1))
    one = [case for case in cases if case.kind in _ONE]
    stated = [min(case.first[1], 1.0) for case in one]
    true = [case.first[0] in case.truth for case in one]
    found[ScoreCode.LOG_SCORE] = resampled([log_loss(c) for c in one], lambda r: r.mean(axis=1))
    found[ScoreCode.CALIBRATION] = resampled(np.column_stack([stated, true]), calibration_error)
    found[ScoreCode.CALIBRATION_NOISE] = calibration_noise(stated)
    found |= _unknown_scores(cases)
    return {code: found[code] for code in ScoreCode if code in found and found[code].count}


def _answers(cases: Sequence[Case], kinds: Sequence[Kind], question: Question) -> list[float]:
    asked = [question(case) for case in cases if case.kind in kinds]
    return [float(answer) for answer in asked if answer is not None]


def _unknown_scores(cases: Sequence[Case]) -> Scores:
    def stated(*kinds: Kind) -> Array:
        return np.array(
            [c.verdict.probabilities.get(UNKNOWN, 0.0) for c in cases if c.kind in kinds]
        )

    mine, other = stated(Kind.UNKNOWN), stated(Kind.SINGLE, Kind.NONE, Kind.PAIR)
    if not (mine.size and other.size):
        return {}
    rows = np.column_stack([np.append(mine, other), np.repeat([1.0, 0.0], [mine.size, other.size])])
    # The least threshold that at most 5 % of the others exceed.
    threshold = np.sort(other)[::-1][int(SCORING.false_alarm * other.size)]
    return {
        ScoreCode.UNKNOWN_AUROC: resampled(rows, area_under_roc),
        ScoreCode.UNKNOWN_RATE: proportion(int((mine > threshold).sum()), mine.size),
    }
