"""Calibration on simulated campaigns that no network saw: limits of what is said."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from vsr2.posterior.naming import (
    NEVER,
    Candidates,
    Naming,
    NamingLimits,
    VerdictKind,
    candidates,
    decide,
    is_wrong,
    one_cause,
    several_causes,
)
from vsr2.posterior.sets import Sets
from vsr2.posterior.truth import PRIOR, Truth

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class PosteriorCalibrationConstants:
    """What the limits are to keep; chosen by hand.

    Attributes:
        false_alarms: share of gap-free campaigns of which none is not said.
        wrong: what a wrong name of one cause costs [causes named rightly].
        wrong_beside: what each wrong one costs of causes that are named together [causes named
            rightly].
        coverage: of the sets of hypotheses.
        temperatures: ends of the logarithm of the temperature that is sought.
        one: probabilities that the name of one cause may be asked to have.
        together: those that names of causes which act together may be asked to have. Of all pairs
            of both the one is used that gains most, less what wrong names cost; of equally good
            ones the strictest.
    """

    false_alarms: float = 0.05
    wrong: float = 4.0
    wrong_beside: float = 2.0
    coverage: float = 0.90
    temperatures: tuple[float, float] = (-1.0, 1.5)
    one: tuple[float, ...] = tuple(k / 100 for k in range(50, 100))
    together: tuple[float, ...] = tuple(k / 100 for k in range(10, 100))


CALIBRATED = PosteriorCalibrationConstants()


@dataclass(frozen=True, eq=False)
class Levels:
    """What calibration on held-out campaigns sets.

    Attributes:
        none_limit: 5 % point of the probability of none over gap-free campaigns.
        least_name: probability, given a gap, that the name of one cause must have.
        least_together: that of the names of causes that act together.
        none_set_level: where there is no gap, probability before a label up to which the 90 % sets
            hold it, so that nine in ten hold a true one, causes outside the library counted.
        gap_set_level: the same where there is a gap.
        known_held: share of the 90 % sets that hold a true label where the library has the cause.
        wrong, named: of held-out campaigns the share of names that are wrong, and that of campaigns
            which get a name.
        detection_rate: share of causes outside the library that are said to be so.
    """

    none_limit: float
    least_name: float
    least_together: float
    none_set_level: float
    gap_set_level: float
    known_held: float
    wrong: float
    named: float
    detection_rate: float

    @property
    def naming(self) -> NamingLimits:
        """Those of the rule."""
        return NamingLimits(self.none_limit, self.least_name, self.least_together)

    def set_level(self, kind: VerdictKind) -> float:
        """Probability before a label up to which the 90 % set of such a verdict holds it."""
        return self.none_set_level if kind is VerdictKind.NONE else self.gap_set_level


class HeldOut(Protocol):
    """What networks make of campaigns that they did not see, disturbed."""

    def score(self, index: NDArray[np.int64], temperature: float) -> Array:
        """Log probability of one set a campaign, by each network, shape (networks, n)."""


def pooled(log_probability: Array, temperature: float) -> Array:
    """Mean over networks of probabilities whose logarithms are divided by a temperature.

    Args:
        log_probability: shape (networks, ..., sets).
        temperature: above 0; below 1 it makes up for the flatness that a mean brings.

    Returns:
        Shape (..., sets).
    """
    scaled = log_probability / temperature
    out = np.exp(scaled - scaled.max(axis=-1, keepdims=True))
    return np.asarray((out / out.sum(axis=-1, keepdims=True)).mean(axis=0))


def best_temperature(held_out: HeldOut, truth: Truth) -> float:
    """By which log probabilities are divided, so that the logarithmic score is best.

    Args:
        held_out: all campaigns.
        truth: of these.
    """
    from scipy.optimize import minimize_scalar

    def score(log_temperature: float) -> float:
        p = np.exp(held_out.score(truth.index, float(np.exp(log_temperature)))).mean(axis=0)
        logs = np.log(np.maximum(p, 1e-12))
        return float(-(truth.weight * logs).sum() / truth.weight.sum())

    sought = minimize_scalar(score, bounds=CALIBRATED.temperatures, method="bounded")
    return float(np.exp(sought.x))


@dataclass(frozen=True, eq=False)
class JudgedCampaigns:
    """What is made of simulated campaigns by what did not see them.

    Attributes:
        row: index of each campaign; of one whose cause was withheld once more, shape (judged,).
        unknown: whether the cause was withheld, shape (judged,).
        weight: of each, as the prior has it, shape (judged,).
        found: what could be named.
        labels: probability of none, of every effect that leads and of outside, shape (judged,
            effects + 2).
    """

    row: NDArray[np.int64]
    unknown: Bools
    weight: Array
    found: tuple[Candidates, ...]
    labels: Array

    @classmethod
    def of(cls, truth: Truth, parts: Iterable[tuple[NDArray[np.int64], bool, Array]]) -> Self:
        """From the probability of every set, a part of the campaigns at a time.

        Args:
            truth: of the campaigns.
            parts: indices of campaigns, whether their cause was withheld, and the probability of
                every set, shape (rows, sets).
        """
        rows: list[NDArray[np.int64]] = []
        unknown: list[Bools] = []
        found: list[Candidates] = []
        labels: list[Array] = []
        for row, withheld, probability in parts:
            rows.append(row)
            unknown.append(np.full(row.size, withheld))
            found += [candidates(p, truth.sets, truth.alike) for p in probability]
            labels.append(label_probability(probability, truth.sets))
        row, lacks = np.concatenate(rows), np.concatenate(unknown)
        weight = np.array(truth.weight[row])
        if lacks.any():
            odds = PRIOR.outside / (1 - PRIOR.outside)
            weight[lacks] *= odds * weight[~lacks].sum() / weight[lacks].sum()
        return cls(row, lacks, weight, tuple(found), np.concatenate(labels))


def calibrate(judged: JudgedCampaigns, truth: Truth, fit: Array) -> Levels:
    """The limits of the rule, from campaigns that no network saw.

    Args:
        judged: what is made of them.
        truth: of all campaigns.
        fit: tail probability of each judged campaign among those without effect, shape (judged,).
    """
    acting = truth.acting[judged.row] & ~judged.unknown[:, None]
    plain = judged.labels[~truth.acting[judged.row].any(axis=1), 0]
    none_limit = float(np.quantile(plain, CALIBRATED.false_alarms)) if plain.size else 0.5
    owners = [tuple(np.flatnonzero(row).tolist()) for row in acting]
    kinds = _kinds(judged, truth, fit, NamingLimits(none_limit, NEVER, NEVER))
    unresolved = kinds == VerdictKind.UNRESOLVED
    chosen, wrong, named = _naming_limits(judged, owners, unresolved, truth.alike, none_limit)
    withheld, known = judged.unknown, ~judged.unknown
    unknown = _kinds(judged, truth, fit, chosen)[withheld] == VerdictKind.UNKNOWN
    index = np.where(withheld, truth.sets.outside, truth.index[judged.row])
    before = _before_true(judged.labels, index, truth.sets)
    gap = kinds != VerdictKind.NONE
    of_none, of_gap = (_set_level(before[own], judged.weight[own]) for own in (~gap, gap))
    held = before <= np.where(gap, of_gap, of_none)
    return Levels(
        none_limit=none_limit,
        least_name=chosen.one,
        least_together=chosen.together,
        none_set_level=of_none,
        gap_set_level=of_gap,
        known_held=float(np.average(held[known], weights=judged.weight[known])),
        wrong=wrong,
        named=named,
        detection_rate=float(np.average(unknown, weights=judged.weight[withheld]))
        if unknown.size
        else 0.0,
    )


def _kinds(
    judged: JudgedCampaigns, truth: Truth, fit: Array, limits: NamingLimits
) -> NDArray[np.str_]:
    """What the verdicts of campaigns are, shape (judged,)."""
    said = [
        decide(one, limits, truth.alike, fit=float(own)).kind
        for one, own in zip(judged.found, fit, strict=True)
    ]
    return np.array(said, dtype=np.str_)


def _naming_limits(
    judged: JudgedCampaigns,
    owners: Sequence[tuple[int, ...]],
    unresolved: Bools,
    alike: Bools,
    none_limit: float,
) -> tuple[NamingLimits, float, float]:
    """Limits by which names gain most, less what wrong ones cost: see `CALIBRATED`.

    That names are withheld where a wrong one would cost more than a right one gains is due to
    C. K. Chow, IEEE Trans. Inf. Theory 16, 1970.

    Args:
        judged: campaigns that no network saw.
        owners: effects of the library that act in each.
        unresolved: those that names are sought for, shape (judged,).
        alike: effects declared alike, shape (effects, effects).
        none_limit: as it is chosen.

    Returns:
        The limits; of the campaigns the shares that they name wrongly, of those named, and name.
    """
    found, weight = judged.found, judged.weight

    def said_by(name: Callable[[Candidates], Naming | None]) -> Array:
        """Whether a campaign is named, wrongly, and what the name gains, shape (3, n)."""
        out = np.zeros((3, len(found)))
        for k, (one, own) in enumerate(zip(found, owners, strict=True)):
            said = name(one) if unresolved[k] else None
            if said is not None and said.kind.names_effects:
                out[:, k] = 1.0, is_wrong(said, own), _gain(said, own)
        return out * weight

    ones = [said_by(partial(one_cause, least=least, alike=alike)) for least in CALIBRATED.one]
    best, chosen = 0.0, (NamingLimits(none_limit, NEVER, NEVER), 0.0, 0.0)
    for together in reversed(CALIBRATED.together):
        several = said_by(partial(several_causes, least=together))
        left = several[0] == 0
        for one, of_one in zip(reversed(CALIBRATED.one), reversed(ones), strict=True):
            named, wrong, gain = several.sum(axis=1) + of_one[:, left].sum(axis=1)
            # Rounded, so that equal sums of other order are equal.
            own = round(float(gain), 9)
            if own > best:
                share = float(wrong / max(named, 1e-9))
                limits = NamingLimits(none_limit, one, together)
                best, chosen = own, (limits, share, float(named / weight.sum()))
    return chosen


def _gain(said: Naming, acting: tuple[int, ...]) -> float:
    """Causes that are named rightly, less what wrong ones cost."""
    cost = CALIBRATED.wrong_beside if said.kind.names_several else CALIBRATED.wrong
    wrong = sum(not set(finding) & set(acting) for finding in said.findings)
    return len(said.findings) - wrong - cost * wrong


def label_probability(probability: Array, sets: Sets) -> Array:
    """Of none, every effect that leads and outside, shape (n, effects + 2)."""
    return np.concatenate(
        [probability[:, :1], sets.leading(probability), probability[:, -1:]], axis=1
    )


def _before_true(labels: Array, index: NDArray[np.int64], sets: Sets) -> Array:
    """Probability held by the labels before the first true one, shape (n,).

    Of two effects, either is true.

    Args:
        labels: probability of each, shape (n, effects + 2).
        index: of the true set, shape (n,).
        sets: the hypotheses.
    """
    order = np.argsort(-labels, axis=1, kind="stable")
    ordered = np.take_along_axis(labels, order, axis=1)
    before = np.cumsum(ordered, axis=1) - ordered
    true = np.zeros(labels.shape, dtype=bool)
    true[:, 1:-1] = sets.members[index]
    true[index == 0, 0] = True
    true[index == sets.outside, -1] = True
    first = np.take_along_axis(true, order, axis=1).argmax(axis=1)
    return np.asarray(before[np.arange(len(index)), first])


def _set_level(before: Array, weight: Array) -> float:
    """Probability down to which sets of labels must reach to hold nine of ten truths.

    Conformal (Y. Romano, M. Sesia, E. Candes, "Classification with valid and adaptive coverage",
    2020; there the true label counts in part, by chance). Campaigns with a gap have a level of
    their own, and so have those without: what is stated then holds of either (V. Vovk, "Conditional
    validity of inductive conformal predictors", 2013). The campaign that is asked about counts as
    one more, whose truth no set holds.

    Args:
        before: of held-out campaigns, probability held by the labels before a true one, shape (n,).
        weight: of each campaign, shape (n,).
    """
    if not before.size:
        return 1.0
    sequence = np.argsort(before)
    total = np.cumsum(weight[sequence]) / (weight.sum() + weight.mean())
    last = np.searchsorted(total, CALIBRATED.coverage)
    return float(before[sequence][last]) if last < total.size else 1.0


def label_set(labels: Array, level: float) -> tuple[int, ...]:
    """Labels of the 90 % set, most probable first: 0 none, 1 to n effects, n + 1 outside.

    Args:
        labels: probability of each, shape (effects + 2,).
        level: probability before a label up to which the set holds it.
    """
    order = np.argsort(-labels, kind="stable")
    before = np.cumsum(labels[order]) - labels[order]
    return tuple(int(i) for i in order[before <= level + 1e-12])
