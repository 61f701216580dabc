"""The verdict: what the numbers allow one to say."""

from __future__ import annotations

from dataclasses import dataclass

from vsr2.diagnosis.how_far.held_out import Pair
from vsr2.diagnosis.how_far.resimulation import Resimulation
from vsr2.diagnosis.likelihood.equivalence import LEAST_PROBABILITY
from vsr2.diagnosis.verdict.statements import GapState, ReasonCode, Statement, VerdictKind
from vsr2.diagnosis.which.novelty import LEVEL as NOVELTY_LEVEL
from vsr2.diagnosis.which.novelty import PRIOR as UNKNOWN_PRIOR

GAP_LEVEL = 0.025
"""Of each of the two tests for a gap: 0.05 together."""
SURPRISE_LEVEL = 0.005
"""Of so many outcomes of certain trials against their certainty: beside the two tests above."""
LEAST_NONE = 0.02
"""Probability of none below which a campaign without a significant gap is unresolved."""
MOST_NAMED = 0.25
"""Share of the library that a class may hold: that it is one of more is no finding."""
UNEXPLAINED = 0.2
"""Share of the gap that the best effect must leave to be called no explanation. A strong effect
that closes nearly all of a large gap leaves a significant rest, because no emulator is perfect."""
DOUBTFUL = 0.1
"""p value of the misfit of an effect that leaves that much, up to which it is not named either."""
LEAST_UNKNOWN = 2 * UNKNOWN_PRIOR
"""Probability of a cause outside the library that a significant misfit must have besides."""
MOST_REST = 3.0
"""What the best effect may leave, at least, over the floor's own loss, and yet be named."""
MOST_LEFT = 0.8
"""Share of the gap that the best effect may leave, significantly, and yet be named."""
PAIR_UNEXPLAINED = 0.5
"""Share of the gap below which what a pair leaves must lie."""
PAIR_CLOSED = 0.5
"""Share of what the best effect leaves above which a second one tells a pair even where one alone
would not be called a misfit: under one effect, or one outside the library, it closes less."""
PAIR_BEYOND = 0.25
"""Share of the gap that a pair must close beyond a rescaling of the probabilities to tell itself
from a cause outside the library: outcomes dealt at random over the trials are rescaled nearly as
well as any two effects fit them (studies/diagnosis_seeds.py)."""
PAIR_MISFIT = 0.2
"""p value of the best effect's misfit above which it fits as well as most, and no second is called.
"""


@dataclass(frozen=True)
class Verdict:
    """The verdict and why.

    Attributes:
        kind: none, effect, class, pair, unknown or unresolved.
        effects: named, the most probable first; empty for none and unknown.
        probability: of what is said.
        reasons: what led to it.
    """

    kind: VerdictKind
    effects: tuple[str, ...]
    probability: float
    reasons: tuple[Statement, ...]

    @property
    def named(self) -> tuple[str, ...]:
        """Effects that it says are missing; none where it says something else."""
        kinds = (VerdictKind.EFFECT, VerdictKind.CLASS, VerdictKind.PAIR)
        return self.effects if self.kind in kinds else ()


@dataclass(frozen=True)
class Findings:
    """What the verdict rests on.

    Attributes:
        gap_low: lower end of the gap's interval, of the kept trials.
        touches_floor: whether that of all trials reaches down to zero.
        gap_p, direction_p: against gap-free campaigns (see `Inference`).
        surprise_p: chance of so many outcomes of screened-out trials that do the same in all
            simulations, without effects too, against that.
        none_probability: calibrated.
        none_in_set: whether the 90 % set holds none.
        leading: the fewest classes that reach `LEAST_PROBABILITY`, most probable effect first.
        alike: those of them that the campaign does not tell from the first.
        alike_probability: of these, given that something is missing.
        offered: effects in the library.
        class_probability: of `leading`, given that something is missing.
        agreement: None, or why the routes disagree.
        pair_agreement: the same where the pair is named: of two effects that act together a route
            that knows single ones may see either.
        novelty_p: of the best single effect's misfit.
        unknown_probability: of a cause outside the library, by that p value.
        favoured: most probable hypothesis.
        after_low: lower end of the interval of the gap that the best effect leaves in the kept
            trials.
        floor: mean loss of the kept trials in campaigns without effect.
        left: share of their gap that it leaves.
        left_of_all: share of the gap of all trials that it leaves.
        pair: the pair, if its held-out gain over one effect has a lower bound above zero.
        halves: the leading class by either half of the draws; empty: these are too few to tell.
        resimulation: what simulations close under what is named; None: nothing was simulated yet.
    """

    gap_low: float
    touches_floor: bool
    gap_p: float
    direction_p: float
    surprise_p: float
    none_probability: float
    none_in_set: bool
    leading: tuple[str, ...]
    alike: tuple[str, ...]
    alike_probability: float
    offered: int
    class_probability: float
    agreement: Statement | None
    pair_agreement: Statement | None
    novelty_p: float
    unknown_probability: float
    favoured: str
    after_low: float
    floor: float
    left: float
    left_of_all: float
    pair: Pair | None
    halves: tuple[tuple[str, ...], ...]
    resimulation: Resimulation | None = None

    @property
    def gap_state(self) -> GapState:
        """Whether there is a gap, and whether its size is known from zero."""
        if not beyond_noise(self.gap_low, self.gap_p, self.direction_p, self.surprise_p):
            return GapState.NOT_FOUND
        return GapState.SIZE_OPEN if self.touches_floor else GapState.FOUND


def beyond_noise(gap_low: float, gap_p: float, direction_p: float, surprise_p: float = 1.0) -> bool:
    """Whether there is a gap.

    Its size is significant and its interval above zero, or its odds are, or too many trials did
    what they never do in simulations.
    """
    large = gap_low > 0 and gap_p <= 2 * GAP_LEVEL
    return large or direction_p <= GAP_LEVEL or surprise_p <= SURPRISE_LEVEL


def decide(f: Findings) -> Verdict:
    """The rules, in their order: none, unresolved, unknown, pair, class, effect."""
    if f.gap_state is GapState.NOT_FOUND:
        return _no_gap(f)
    reasons = _signs(f)
    if f.touches_floor:
        return _unresolved(f, *reasons, Statement.of(ReasonCode.SIZE_OPEN, leading=f.leading[0]))
    rest = f.after_low > 0 and f.left > UNEXPLAINED
    misfit = rest and f.novelty_p <= NOVELTY_LEVEL and f.unknown_probability > LEAST_UNKNOWN
    pair = f.pair if f.pair and rest and _explains(f.pair, misfit, f.novelty_p) else None
    if misfit and pair is None:
        return _misfit(f, reasons)
    doubt = _doubt(f, pair) or (_left(f, rest) if pair is None else None) or _short(f)
    if doubt is not None:
        return _unresolved(f, *reasons, doubt)
    if pair is not None:
        reasons.append(Statement.of(ReasonCode.SECOND_EFFECT_HELPS))
        probability = f.class_probability * pair.probability
        return Verdict(VerdictKind.PAIR, pair.names, probability, tuple(reasons))
    kind = VerdictKind.EFFECT
    if len(f.leading) > 1:
        kind = VerdictKind.CLASS
        reasons.append(
            Statement.of(ReasonCode.EQUIVALENT_HERE)
            if len(f.alike) == len(f.leading)
            else Statement.of(
                ReasonCode.OTHERS_FIT_WORSE,
                first=f.alike,
                probability=f.alike_probability,
                wanted=LEAST_PROBABILITY,
            )
        )
    return Verdict(kind, f.leading, f.class_probability, tuple(reasons))


def _no_gap(f: Findings) -> Verdict:
    significant = f.gap_p <= 2 * GAP_LEVEL
    reasons = [
        Statement.of(
            ReasonCode.NO_GAP,
            p_size=f.gap_p,
            p_direction=f.direction_p,
            size_significant=significant,
        )
    ]
    none = _none_beside_unknown(f)
    if none < LEAST_NONE:
        reason = Statement.of(ReasonCode.NONE_IMPROBABLE, none=none, favoured=f.favoured)
        return _unresolved(f, *reasons, reason)
    if not f.none_in_set:
        reason = Statement.of(
            ReasonCode.NONE_NOT_IN_SET, none=f.none_probability, favoured=f.favoured
        )
        return _unresolved(f, *reasons, reason)
    if none < 0.5:
        reasons.append(
            Statement.of(
                ReasonCode.NONE_LESS_PROBABLE,
                favoured=f.favoured,
                out_of_library=f.unknown_probability > none,
            )
        )
    return Verdict(VerdictKind.NONE, (), f.none_probability, tuple(reasons))


def _signs(f: Findings) -> list[Statement]:
    """By which tests there is a gap."""
    reasons = []
    if beyond_noise(f.gap_low, f.gap_p, f.direction_p):
        code = ReasonCode.SIGNS_OF_GAP if f.touches_floor else ReasonCode.GAP
        reasons.append(Statement.of(code, p_size=f.gap_p, p_direction=f.direction_p))
    if f.surprise_p <= SURPRISE_LEVEL:
        reasons.append(Statement.of(ReasonCode.SURPRISING_OUTCOMES, p=f.surprise_p))
    return reasons


def _doubt(f: Findings, pair: Pair | None) -> Statement | None:
    """Why the inference itself names nothing."""
    agreement = f.agreement if pair is None else f.pair_agreement
    if agreement is not None:
        return agreement
    named = {*f.leading, *(pair.names if pair else ())}
    if any(named.isdisjoint(half) for half in f.halves):
        return Statement.of(ReasonCode.HALVES_DISAGREE)
    count = len(f.leading)
    if count <= max(2, MOST_NAMED * f.offered):
        return None
    if len(f.alike) == count:
        return Statement.of(ReasonCode.TOO_MANY_EQUIVALENT, count=count, offered=f.offered)
    return Statement.of(
        ReasonCode.TOO_MANY_NEEDED,
        first=f.alike,
        probability=f.alike_probability,
        wanted=LEAST_PROBABILITY,
        count=count,
        offered=f.offered,
    )


def _left(f: Findings, rest: bool) -> Statement | None:
    """Why what one effect leaves is too much; `rest`: it leaves a significant part."""
    left = max(f.left, f.left_of_all)
    if f.after_low > 0 and left > MOST_LEFT:
        return Statement.of(ReasonCode.GAP_LEFT, left=left)
    if rest and f.novelty_p <= DOUBTFUL:
        return Statement.of(ReasonCode.GAP_LEFT_AND_MISFIT, left=f.left, worse_than=1 - f.novelty_p)
    if f.after_low > MOST_REST * f.floor:
        return Statement.of(ReasonCode.FLOOR_EXCEEDED, times=MOST_REST)
    return None


def _short(f: Findings) -> Statement | None:
    """Why the emulator cannot be trusted about what leads."""
    if f.resimulation is None or not f.resimulation.short:
        return None
    return Statement.of(
        ReasonCode.RESIMULATION_SHORT,
        closure=f.resimulation.closure.value,
        predicted=f.resimulation.predicted,
    )


def _none_beside_unknown(f: Findings) -> float:
    return (1 - f.unknown_probability) * f.none_probability


def _unresolved(f: Findings, *reasons: Statement) -> Verdict:
    return Verdict(VerdictKind.UNRESOLVED, f.leading, f.class_probability, reasons)


def _explains(pair: Pair, misfit: bool, novelty_p: float) -> bool:
    """Whether a pair explains the gap, and one effect does not.

    Args:
        pair: found.
        misfit: whether one effect alone would be no explanation.
        novelty_p: of the best single effect's misfit.
    """
    closes = pair.closed > PAIR_CLOSED and novelty_p <= PAIR_MISFIT
    return pair.left < PAIR_UNEXPLAINED and (closes or (misfit and pair.beyond > PAIR_BEYOND))


def _misfit(f: Findings, reasons: list[Statement]) -> Verdict:
    """What is said where neither one effect nor a pair explains the gap."""
    none = _none_beside_unknown(f)
    if f.unknown_probability <= none:
        reason = Statement.of(
            ReasonCode.NONE_BEATS_OUT_OF_LIBRARY,
            none=none,
            out_of_library=f.unknown_probability,
        )
        return _unresolved(f, *reasons, reason)
    reasons = [*reasons, Statement.of(ReasonCode.MISFIT, worse_than=1 - f.novelty_p)]
    if f.pair is not None:
        reason = Statement.of(ReasonCode.PAIR_LEAVES_GAP, effects=f.pair.names, left=f.pair.left)
        return _unresolved(f, *reasons, reason)
    if f.left < 0.5:
        reasons.append(
            Statement.of(ReasonCode.PART_OF_THE_CAUSE, effect=f.leading[0], closed=1 - f.left)
        )
    return Verdict(VerdictKind.UNKNOWN, (), f.unknown_probability, tuple(reasons))


def points_outside(verdict: Verdict, f: Findings) -> bool:
    """Whether an unresolved verdict leaves more than half to a cause outside the library."""
    return verdict.kind is VerdictKind.UNRESOLVED and f.unknown_probability > 0.5


def disagreement(
    leading: tuple[str, ...],
    likelihood_best: str,
    classifier_best: str,
    likelihood_set: tuple[str, ...],
    classifier_set: tuple[str, ...],
) -> Statement | None:
    """Why two routes contradict each other; None: they do not.

    They agree if the leading class has a member in either route's 90 % set, and the best label of
    each route is in the leading class or in the other route's set.
    """
    for route, labels in (("likelihood", likelihood_set), ("classifier", classifier_set)):
        if not set(leading) & set(labels):
            return Statement.of(ReasonCode.ROUTE_SET_EXCLUDES, route=route, effects=leading)
    for route, best, other in (
        ("likelihood", likelihood_best, classifier_set),
        ("classifier", classifier_best, likelihood_set),
    ):
        if best not in leading and best not in other:
            return Statement.of(ReasonCode.ROUTE_FAVOURS_OTHER, route=route, effect=best)
    return None
