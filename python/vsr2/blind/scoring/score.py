"""Scores of a pack: what was asked of each case, and the figures over cases."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.blind.form.diagnosis_form import NAMING, NONE, UNKNOWN
from vsr2.blind.form.pack_form import Axis
from vsr2.blind.form.pack_settings import KINDS, Kind
from vsr2.blind.scoring.cases import Case, groups
from vsr2.blind.scoring.intervals import (
    Score,
    area_under_roc,
    calibration_error,
    calibration_noise,
    proportion,
    resampled,
)
from vsr2.diagnosis.verdict.statements import VerdictKind

Array = NDArray[np.float64]

LEAST_PROBABILITY = 1e-3
"""Probabilities count as at least this in the log score: one verdict cannot cost more than 6.9."""
FALSE_ALARM = 0.05
SIGNIFICANT = 0.05
ANSWER = "most probable answer, whatever the verdict (single)"
FIRST = "most probable effect's class, whatever the verdict (single)"
NAMED = "top-1 class (single)"
NOT_NONE = "not called none, unresolved counted (none)"
CALIBRATION_NOISE = "calibration error: of true probabilities"
ERROR = "magnitude: median relative error"
CLOSURE = "closure over oracle: median"
SILENT_CLOSURE = "closure over oracle, 0 where no effect is named: median"
GAIN = "where: median mass over share of trials, smallest location"
SAYING_NOTHING = {ERROR: 1.0, CLOSURE: 0.0, SILENT_CLOSURE: 0.0, GAIN: 1.0}
"""What a diagnosis gets that estimates no magnitude, adds no effect, and names all trials or random
ones: the trivial baseline of these scores."""
THRESHOLDS = frozenset({("catch", "slack"), ("outcome_rule", "tilt")})
"""Strengths that are tilts beyond which something acts: without the effect there is none. Engines
state that as infinity or as a tilt that no trial reaches, from which no distance is a size."""
BEST_HIGH = (
    NAMED,
    ANSWER,
    FIRST,
    "top-3 class (single)",
    "log score below uniform",
    "unknown: AUROC",
    "unknown: rate at 5 % false alarms",
)
"""Scores that a trivial baseline has too, the higher the better."""
BEST_LOW = ("calibration error", "false alarms (none)")
"""The same, the lower the better."""

Scores = dict[str, Score]


def is_alarm(case: Case) -> bool:
    """Whether the verdict says that something is missing."""
    return case.verdict.kind in NAMING or case.verdict.kind is VerdictKind.UNKNOWN


def not_none(case: Case) -> bool:
    """Whether the verdict is anything but no gap: a name, the unknown, or unresolved."""
    return case.verdict.kind is not VerdictKind.NONE


def top_one(case: Case) -> bool:
    """Whether the verdict's most probable class is the true one.

    A verdict of no gap, of the unknown, or `unresolved` stands for itself: it is right for a
    campaign of that kind only. Of a pair either class counts.
    """
    kind = case.verdict.kind
    if kind in NAMING:
        return leading_class(case) in case.truth
    return case.truth == (kind,)


def leading_class(case: Case) -> str:
    """The most probable class that is an effect's; of a verdict without any, the first it names."""
    ranked = [name for name in case.class_probabilities if name not in (NONE, UNKNOWN)]
    return next(iter(ranked + case.labels(case.verdict.effects)), "")


def top_three(case: Case) -> bool:
    """Whether a true class is among the three most probable."""
    return bool(set(list(case.class_probabilities)[:3]) & set(case.truth))


def pair_found(case: Case) -> bool:
    """Whether the verdict is a pair of exactly the true classes."""
    named = set(case.labels(case.verdict.effects))
    return case.verdict.kind is VerdictKind.PAIR and named == set(case.truth)


def in_set(case: Case) -> bool:
    """Whether the 90 % set holds a true class."""
    return bool(set(case.labels(case.verdict.conformal)) & set(case.truth))


def log_loss(case: Case) -> float:
    """- ln of the probability of the true class, at least 0.001."""
    found = case.class_probabilities.get(case.truth[0], 0.0)
    return -math.log(min(1.0, max(found, LEAST_PROBABILITY)))


def magnitude(case: Case) -> tuple[float, bool, float] | None:
    """Of the strength: relative error, whether its interval holds the truth, width.

    Error and width are over the effect's :func:`size`. None: the diagnosis has no estimate of it.
    """
    if case.kind != Kind.SINGLE:
        return None
    effect = case.effects[0]
    estimate = case.verdict.parameters.get(effect["name"], {}).get(effect["strength"])
    if estimate is None:
        return None
    truth, (low, high) = effect["values"][effect["strength"]], estimate.ci95
    scale = size(effect)
    return abs(estimate.mean - truth) / scale, low <= truth <= high, (high - low) / scale


def size(effect: Mapping[str, Any]) -> float:
    """|truth - null| of a sealed effect's strength; |truth| for a null of infinity or a threshold.

    Args:
        effect: of a key.
    """
    name, strength, null = effect["name"], effect["strength"], effect["null"]
    truth: float = effect["values"][strength]
    absent = null is None or (name, strength) in THRESHOLDS
    return abs(truth) if absent else abs(truth - null)


def closure(case: Case, *, silent: bool = False) -> float | None:
    """Closure of the verdict over that of the true effect (the oracle); None: no ratio.

    `silent`: 0 where the verdict names no effect, so that nothing is added, also where the
    diagnosis gives the true effect no closure, as one that sees no gap does.
    """
    if case.kind != Kind.SINGLE:
        return None
    if silent and case.verdict.kind not in NAMING:
        return 0.0
    own = case.verdict.closure
    oracle = case.verdict.closures.get(case.effects[0]["name"])
    return None if own is None or oracle is None or oracle <= 0 else own / oracle


def where_mass(case: Case) -> tuple[float, float, float] | None:
    """Of the locations named at p <= 0.05 their shares of the effect's changes, and of the trials.

    Both are of all locations together. The third number is the one over the other in the smallest
    location: one drawn at random holds as much of the one as of the other. None: none names trials.
    """
    named = [f.trials for f in case.verdict.where if f.p_familywise <= SIGNIFICANT and f.trials]
    weights = case.where["weights"]
    total = math.fsum(weights)
    if not named or not weights or total <= 0:
        return None
    weight = dict(zip(case.trials, weights, strict=True))

    def mass(trials: frozenset[str]) -> float:
        return math.fsum(weight[n] for n in trials) / total

    inside = frozenset[str]().union(*named)
    smallest = min(named, key=lambda trials: (len(trials), sorted(trials)))
    count = len(case.trials)
    return mass(inside), len(inside) / count, mass(smallest) / (len(smallest) / count)


def axis_named(case: Case) -> bool:
    """Whether a location at p <= 0.05 lies on the axis along which the effect acts."""
    drifts = case.where["axis"] == Axis.ORDER
    wanted = {"order", "session"} if drifts else {"conditions"}
    return any(
        axis in location.axis
        for location in case.verdict.where
        if location.p_familywise <= SIGNIFICANT
        for axis in wanted
    )


def score_cases(cases: Sequence[Case]) -> dict[tuple[str, str], Scores]:
    """Scores by tier and group, each with its 95 % interval.

    Proportions have exact intervals, all else a bootstrap over campaigns.
    """
    return {name: _scores(members) for name, members in groups(cases).items()}


def _share(test: Callable[[Case], bool], cases: Sequence[Case]) -> Score:
    return proportion(sum(map(test, cases)), len(cases))


def _of_median(values: Sequence[float]) -> Score:
    return resampled(values, lambda samples: np.asarray(np.median(samples, axis=1)))


def _scores(cases: Sequence[Case]) -> Scores:
    def of(*kinds: Kind) -> list[Case]:
        return [case for case in cases if case.kind in kinds]

    single, none, pair, unknown, reference = (of(kind) for kind in KINDS)
    one = of(Kind.SINGLE, Kind.NONE, Kind.UNKNOWN)
    stated = [min(case.first[1], 1.0) for case in one]
    true = [case.first[0] in case.truth for case in one]
    out: Scores = {
        NAMED: _share(top_one, single),
        ANSWER: _share(lambda c: c.first[0] in c.truth, single),
        FIRST: _share(lambda c: leading_class(c) in c.truth, single),
        "top-3 class (single)": _share(top_three, single),
        "90 % set: coverage": _share(in_set, one),
        "90 % set: median size": _of_median([len(set(c.labels(c.verdict.conformal))) for c in one]),
        "log score": resampled(
            [log_loss(c) for c in one], lambda samples: np.asarray(samples.mean(axis=1))
        ),
        "log score below uniform": resampled(
            [(log_loss(c), math.log(_hypotheses(c))) for c in one], _below
        ),
        "calibration error": resampled(list(zip(stated, true, strict=True)), calibration_error),
        CALIBRATION_NOISE: calibration_noise(stated),
        "false alarms (none)": _share(is_alarm, none),
        NOT_NONE: _share(not_none, none),
        "detected (single)": _share(is_alarm, single),
        "pair found (pair)": _share(pair_found, pair),
        "one of pair first (pair)": _share(top_one, pair),
        "unknown named (unknown)": _share(lambda c: c.verdict.kind == UNKNOWN, unknown),
        "open truth found (reference)": _share(top_one, reference),
        "failed or unresolved": _share(lambda c: c.verdict.kind == VerdictKind.UNRESOLVED, cases),
    }
    out |= _unknown_scores(unknown, of(Kind.SINGLE, Kind.NONE, Kind.PAIR))
    estimated = [found for case in single if (found := magnitude(case)) is not None]
    out["magnitude: estimated (single)"] = proportion(len(estimated), len(single))
    out[ERROR] = _of_median([error for error, _, _ in estimated])
    out["magnitude: interval coverage"] = proportion(
        sum(h for _, h, _ in estimated), len(estimated)
    )
    out["magnitude: median width of interval"] = _of_median([w for _, _, w in estimated])
    out[CLOSURE] = _of_median([r for case in single if (r := closure(case)) is not None])
    out[SILENT_CLOSURE] = _of_median(
        [r for case in single if (r := closure(case, silent=True)) is not None]
    )
    highs = [c.verdict.closure_high for c in single if c.verdict.closure_high is not None]
    out["closure below 0 beyond its interval"] = proportion(sum(h < 0 for h in highs), len(highs))
    located = [shares for case in single if (shares := where_mass(case)) is not None]
    out["where: median mass inside"] = _of_median([mass for mass, _, _ in located])
    out["where: median share of trials inside"] = _of_median([n for _, n, _ in located])
    out[GAIN] = _of_median([gain for _, _, gain in located])
    out["where: axis named (single)"] = _share(axis_named, single)
    out["where: false locations (none)"] = _share(
        lambda c: any(f.p_familywise <= SIGNIFICANT for f in c.verdict.where), none
    )
    return {name: score for name, score in out.items() if score.count}


def _unknown_scores(unknown: Sequence[Case], others: Sequence[Case]) -> Scores:
    if not (unknown and others):
        return {}
    mine = np.array([case.verdict.novelty for case in unknown])
    other = np.array([case.verdict.novelty for case in others])
    rows = np.column_stack([np.append(mine, other), np.repeat([1.0, 0.0], [mine.size, other.size])])
    # The least threshold that at most 5 % of the others exceed.
    threshold = np.sort(other)[::-1][int(FALSE_ALARM * other.size)]
    return {
        "unknown: AUROC": resampled(rows, area_under_roc),
        "unknown: rate at 5 % false alarms": proportion(int((mine > threshold).sum()), mine.size),
    }


def _hypotheses(case: Case) -> int:
    """Classes that a diagnosis may choose among, with none and unknown.

    Those of the canonical effects that are not excluded, and the true ones.
    """
    effects = set(case.labels(name for name in canonical() if name not in case.exclude))
    return len(effects | {NONE, UNKNOWN, *case.truth})


@cache
def canonical() -> frozenset[str]:
    """Names of the library's effects."""
    from vsr2.effects import library

    return frozenset(library())


def _below(samples: Array) -> Array:
    loss, uniform = samples.mean(axis=1).T
    return np.asarray(1 - loss / uniform, dtype=np.float64)
