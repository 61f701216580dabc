"""Scores of a pack: what was asked of each case, and the figures over cases."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.blind.form.verdict import NONE, UNKNOWN, Estimate
from vsr2.blind.scoring.cases import Case, groups
from vsr2.blind.scoring.intervals import (
    Score,
    area_under_roc,
    calibration_error,
    calibration_noise,
    proportion,
    resampled,
)

Array = NDArray[np.float64]

LEAST_PROBABILITY = 1e-3
"""Probabilities count as at least this in the log score: one verdict cannot cost more than 6.9."""
FALSE_ALARM = 0.05
SIGNIFICANT = 0.05
ANSWER = "most probable answer, whatever the verdict (single)"
FIRST = "most probable effect's class, whatever the verdict (single)"
NAMED = "top-1 class (single)"
CALIBRATION_NOISE = "calibration error: of true probabilities"
ERROR = "magnitude: median relative error"
CLOSURE = "closure over oracle: median"
SILENT_CLOSURE = "closure over oracle, 0 where no effect is named: median"
GAIN = "where: median mass over share of trials, smallest place"
SAYING_NOTHING = {ERROR: 1.0, CLOSURE: 0.0, SILENT_CLOSURE: 0.0, GAIN: 1.0}
"""What a diagnosis gets that tells no magnitude, adds no effect, and names all trials or random
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
    return case.verdict.kind in ("effect", "class", "pair", "unknown")


def top_one(case: Case) -> bool:
    """Whether the verdict's most probable class is the true one.

    A verdict of no gap, of the unknown, or `unresolved` stands for itself: it is right for a
    campaign of that kind only. Of a pair either class counts.
    """
    kind = case.verdict.kind
    if kind in (NONE, UNKNOWN):
        return case.truth == (kind,)
    if kind == "unresolved":
        return False
    return leading_class(case) in case.truth


def leading_class(case: Case) -> str:
    """The most probable class that is an effect's; of a verdict without any, the first it names."""
    ranked = [name for name in case.class_probabilities if name not in (NONE, UNKNOWN)]
    named = [case.label(name) for name in case.verdict.effects]
    return next(iter(ranked + named), "")


def top_three(case: Case) -> bool:
    """Whether a true class is among the three most probable."""
    return bool(set(list(case.class_probabilities)[:3]) & set(case.truth))


def pair_found(case: Case) -> bool:
    """Whether the verdict is a pair of exactly the true classes."""
    named = {case.label(name) for name in case.verdict.effects}
    return case.verdict.kind == "pair" and named == set(case.truth)


def in_set(case: Case) -> bool:
    """Whether the 90 % set holds a true class."""
    return bool({case.label(name) for name in case.verdict.conformal} & set(case.truth))


def set_size(case: Case) -> int:
    """Classes in the 90 % set."""
    return len({case.label(name) for name in case.verdict.conformal})


def log_loss(case: Case) -> float:
    """- ln of the probability of the true class, at least 0.001."""
    found = case.class_probabilities.get(case.truth[0], 0.0)
    return -math.log(min(1.0, max(found, LEAST_PROBABILITY)))


def magnitude(case: Case) -> tuple[float, bool, float] | None:
    """Of the strength: relative error, whether its interval holds the truth, width; None: not told.

    Error and width are over the effect's :func:`size`.
    """
    if case.kind != "single":
        return None
    effect = case.effects[0]
    told = case.verdict.parameters.get(effect["name"], {})
    estimate: Estimate | None = told.get(effect["strength"])
    if estimate is None:
        return None
    truth = effect["values"][effect["strength"]]
    held = estimate.low <= truth <= estimate.high
    whole = size(effect)
    return abs(estimate.mean - truth) / whole, held, (estimate.high - estimate.low) / whole


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
    if case.kind != "single":
        return None
    if silent and case.verdict.kind not in ("effect", "class", "pair"):
        return 0.0
    own = case.verdict.closure
    oracle = case.verdict.closures.get(case.effects[0]["name"])
    return None if own is None or oracle is None or oracle <= 0 else own / oracle


def where_mass(case: Case) -> tuple[float, float, float] | None:
    """Of the places named at p <= 0.05 their shares of the effect's changes, and of the trials.

    Both are of all places together. The third number is the one over the other in the smallest
    place: a place drawn at random holds as much of the one as of the other. None: none names
    trials.
    """
    named = [f.trials for f in case.verdict.where if f.p <= SIGNIFICANT and f.trials]
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
    """Whether a place at p <= 0.05 lies on the axis along which the effect acts."""
    wanted = ("order", "session") if case.where["axis"] == "order" else ("conditions",)
    named = [f.axis for f in case.verdict.where if f.p <= SIGNIFICANT]
    return any(axis in name for name in named for axis in wanted)


def score_cases(cases: Sequence[Case]) -> dict[tuple[str, str], Scores]:
    """Scores by tier and group, each with its 95 % interval.

    Proportions have exact intervals, all else a bootstrap over campaigns.
    """
    return {name: _scores(members) for name, members in groups(cases).items()}


def _scores(cases: Sequence[Case]) -> Scores:
    def of(*kinds: str) -> list[Case]:
        return [case for case in cases if case.kind in kinds]

    def share(test: Callable[[Case], bool], members: Sequence[Case]) -> Score:
        return proportion(sum(map(test, members)), len(members))

    single, none, pair, unknown = of("single"), of(NONE), of("pair"), of(UNKNOWN)
    told = [case for case in of("single", NONE, UNKNOWN)]
    out: Scores = {
        NAMED: share(top_one, single),
        ANSWER: share(lambda c: c.first[0] in c.truth, single),
        FIRST: share(lambda c: leading_class(c) in c.truth, single),
        "top-3 class (single)": share(top_three, single),
        "90 % set: coverage": share(in_set, told),
        "90 % set: median size": resampled([set_size(c) for c in told], _median),
        "log score": resampled([log_loss(c) for c in told], _mean),
        "log score below uniform": resampled(
            [(log_loss(c), math.log(_hypotheses(c))) for c in told], _below
        ),
        "calibration error": resampled(
            np.array([(min(c.first[1], 1.0), c.first[0] in c.truth) for c in told]).reshape(-1, 2),
            calibration_error,
        ),
        CALIBRATION_NOISE: calibration_noise([min(c.first[1], 1.0) for c in told]),
        "false alarms (none)": share(is_alarm, none),
        "detected (single)": share(is_alarm, single),
        "pair found (pair)": share(pair_found, pair),
        "one of pair first (pair)": share(top_one, pair),
        "unknown named (unknown)": share(lambda c: c.verdict.kind == UNKNOWN, unknown),
        "failed or unresolved": share(lambda c: c.verdict.kind == "unresolved", cases),
    }
    out |= _unknown_scores(unknown, of("single", NONE, "pair"))
    errors = [found for case in single if (found := magnitude(case)) is not None]
    out["magnitude: told (single)"] = proportion(len(errors), len(single))
    out[ERROR] = resampled([error for error, _, _ in errors], _median)
    out["magnitude: interval coverage"] = proportion(sum(h for _, h, _ in errors), len(errors))
    out["magnitude: median width of interval"] = resampled([w for _, _, w in errors], _median)
    ratios = [r for case in single if (r := closure(case)) is not None]
    out[CLOSURE] = resampled(ratios, _median)
    ratios = [r for case in single if (r := closure(case, silent=True)) is not None]
    out[SILENT_CLOSURE] = resampled(ratios, _median)
    highs = [c.verdict.closure_high for c in single if c.verdict.closure_high is not None]
    out["closure below 0 beyond its interval"] = proportion(sum(h < 0 for h in highs), len(highs))
    places = [place for case in single if (place := where_mass(case)) is not None]
    out["where: median mass inside"] = resampled([mass for mass, _, _ in places], _median)
    out["where: median share of trials inside"] = resampled([n for _, n, _ in places], _median)
    out[GAIN] = resampled([gain for _, _, gain in places], _median)
    out["where: axis named (single)"] = share(axis_named, single)
    out["where: false places (none)"] = share(
        lambda c: any(f.p <= SIGNIFICANT for f in c.verdict.where), none
    )
    return {name: score for name, score in out.items() if score.count}


def _unknown_scores(unknown: Sequence[Case], others: Sequence[Case]) -> Scores:
    if not (unknown and others):
        return {}
    rows = np.array(
        [(c.verdict.novelty, 1.0) for c in unknown] + [(c.verdict.novelty, 0.0) for c in others]
    )
    # The least threshold that at most 5 % of the others exceed.
    other = np.sort(rows[rows[:, 1] == 0, 0])[::-1]
    threshold = other[int(FALSE_ALARM * other.size)]
    found = int((rows[rows[:, 1] == 1, 0] > threshold).sum())
    return {
        "unknown: AUROC": resampled(rows, area_under_roc),
        "unknown: rate at 5 % false alarms": proportion(found, len(unknown)),
    }


def _hypotheses(case: Case) -> int:
    """Classes that a diagnosis may choose among, with none and unknown.

    Those of the canonical effects that are not excluded, and the true ones.
    """
    effects = {case.label(name) for name in canonical() if name not in case.exclude}
    return len(effects | {NONE, UNKNOWN, *case.truth})


@cache
def canonical() -> frozenset[str]:
    """Names of the library's effects."""
    from vsr2.effects import library

    return frozenset(library())


def _median(samples: Array) -> Array:
    out: Array = np.median(samples, axis=1)
    return out


def _mean(samples: Array) -> Array:
    out: Array = samples.mean(axis=1)
    return out


def _below(samples: Array) -> Array:
    loss, uniform = samples.mean(axis=1).T
    out: Array = 1 - loss / uniform
    return out
