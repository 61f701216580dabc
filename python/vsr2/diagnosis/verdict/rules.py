"""The verdict: what the numbers allow one to say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from vsr2.diagnosis.how_far.anew import Anew
from vsr2.diagnosis.how_far.shrinkage import Pair
from vsr2.diagnosis.likelihood.equivalence import LEAST_PROBABILITY
from vsr2.diagnosis.which.novelty import LEVEL as NOVELTY_LEVEL
from vsr2.diagnosis.which.novelty import PRIOR as UNKNOWN_PRIOR

Kind = Literal["none", "effect", "class", "pair", "unknown", "unresolved"]

NO_GAP = "no gap beyond noise"
"""How the reasons begin where the tests find no gap."""
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
        reasons: sentences that lead to it.
    """

    kind: Kind
    effects: tuple[str, ...]
    probability: float
    reasons: tuple[str, ...]

    @property
    def named(self) -> tuple[str, ...]:
        """Effects that it says are missing; none where it says something else."""
        return self.effects if self.kind in ("effect", "class", "pair") else ()


@dataclass(frozen=True)
class Findings:
    """What the verdict rests on.

    Attributes:
        gap_low: lower end of the gap's interval, of the kept trials.
        touches_floor: whether that of all trials reaches down to zero.
        gap_p, direction_p: against gap-free campaigns (see `Inference`).
        surprise_p: chance of so many outcomes of the dropped trials that do the same in all
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
        anew: what simulations close under what is named; None: nothing was simulated yet.
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
    agreement: str | None
    pair_agreement: str | None
    novelty_p: float
    unknown_probability: float
    favoured: str
    after_low: float
    floor: float
    left: float
    left_of_all: float
    pair: Pair | None
    halves: tuple[tuple[str, ...], ...]
    anew: Anew | None = None


def beyond_noise(gap_low: float, gap_p: float, direction_p: float, surprise_p: float = 1.0) -> bool:
    """Whether there is a gap.

    Its size is significant and its interval above zero, or its odds are, or too many trials did
    what they never do in simulations.
    """
    large = gap_low > 0 and gap_p <= 2 * GAP_LEVEL
    return large or direction_p <= GAP_LEVEL or surprise_p <= SURPRISE_LEVEL


def _not_beyond(f: Findings) -> str:
    if f.gap_p <= 2 * GAP_LEVEL:
        size = (
            f"the loss is larger than in most campaigns simulated without any effect (p = "
            f"{f.gap_p:.2g}), but over these motions its interval reaches down to the floor"
        )
    else:
        size = (
            "the loss is no larger than in campaigns simulated without any effect (p = "
            f"{f.gap_p:.2g})"
        )
    return (
        f"{NO_GAP}: {size}, and none of the effects is favoured beyond what such "
        f"campaigns show (p = {f.direction_p:.2g})"
    )


def _alike(f: Findings) -> str:
    """The first effect, with those that are not told from it, and their probability."""
    names = f.alike[0] if len(f.alike) == 1 else f"the class of {f.alike[0]}"
    return f"{names} has a probability of {f.alike_probability:.2f} if something is missing"


def _none_beside_unknown(f: Findings) -> float:
    return (1 - f.unknown_probability) * f.none_probability


def _unresolved(f: Findings, *reasons: str) -> Verdict:
    return Verdict("unresolved", f.leading, f.class_probability, reasons)


def _explains(pair: Pair, misfit: bool, novelty_p: float) -> bool:
    """Whether a pair explains the gap, and one effect does not.

    Args:
        pair: found.
        misfit: whether one effect alone would be no explanation.
        novelty_p: of the best single effect's misfit.
    """
    closes = pair.closed > PAIR_CLOSED and novelty_p <= PAIR_MISFIT
    return pair.left < PAIR_UNEXPLAINED and (closes or (misfit and pair.beyond > PAIR_BEYOND))


def decide(f: Findings) -> Verdict:
    """The rules, in their order: none, unresolved, unknown, pair, class, effect."""
    if not beyond_noise(f.gap_low, f.gap_p, f.direction_p, f.surprise_p):
        reasons = [_not_beyond(f)]
        none = _none_beside_unknown(f)
        if none < LEAST_NONE:
            reasons.append(
                f"but weighed by its prior, none has a probability of {none:.1g}: {f.favoured} or "
                "another effect is likely; a larger budget, or more trials, may decide"
            )
            return _unresolved(f, *reasons)
        if not f.none_in_set:
            reasons.append(
                f"but none has a probability of {f.none_probability:.2g} and is not in the 90 % "
                f"set, which {f.favoured} leads: more trials may decide"
            )
            return _unresolved(f, *reasons)
        if none < 0.5:
            outside = "a cause outside the library, " if f.unknown_probability > none else ""
            reasons.append(
                f"weighed by its prior, {outside}{f.favoured} or another effect is more probable "
                "than none, but no more than in gap-free campaigns by chance: too weak to be "
                "called a gap"
            )
        return Verdict("none", (), f.none_probability, tuple(reasons))
    reasons = []
    if beyond_noise(f.gap_low, f.gap_p, f.direction_p):
        signs = "signs of a gap" if f.touches_floor else "a gap beyond noise"
        reasons.append(
            f"{signs}: p = {f.gap_p:.2g} for its size, {f.direction_p:.2g} for its "
            "direction, against campaigns simulated without any effect"
        )
    if f.surprise_p <= SURPRISE_LEVEL:
        reasons.append(
            "trials did what they never do in simulations without effect, more often than chance "
            f"has it (p = {f.surprise_p:.2g})"
        )
    if f.touches_floor:
        reasons.append(
            "but over these motions the interval of its size reaches down to zero: what would "
            f"shrink cannot be told, so that nothing is named; {f.leading[0]} leads"
        )
        return _unresolved(f, *reasons)
    rest = f.after_low > 0 and f.left > UNEXPLAINED
    misfit = rest and f.novelty_p <= NOVELTY_LEVEL and f.unknown_probability > LEAST_UNKNOWN
    pair = f.pair if f.pair and rest and _explains(f.pair, misfit, f.novelty_p) else None
    if misfit and pair is None:
        return _misfit(f, reasons)
    agreement = f.agreement if pair is None else f.pair_agreement
    if agreement is not None:
        return _unresolved(f, *reasons, agreement)
    named = {*f.leading, *(pair.names if pair else ())}
    if any(named.isdisjoint(half) for half in f.halves):
        reasons.append("half of the draws lead to another answer: spend a larger budget")
        return _unresolved(f, *reasons)
    if len(f.leading) > max(2, MOST_NAMED * f.offered):
        if len(f.alike) == len(f.leading):
            reasons.append(
                f"with these trials and simulations {len(f.leading)} of the library's {f.offered} "
                "effects cannot be told apart: the data do not decide"
            )
        else:
            reasons.append(
                f"{_alike(f)}; it takes {len(f.leading)} of the library's {f.offered} effects to "
                f"reach {LEAST_PROBABILITY}: the data do not decide"
            )
        return _unresolved(f, *reasons)
    left = max(f.left, f.left_of_all)
    if pair is None and f.after_low > 0 and left > MOST_LEFT:
        reasons.append(
            f"the best effect leaves {min(left, 1.0):.0%} of the gap on motions that it did not see"
        )
        return _unresolved(f, *reasons)
    if pair is None and rest and f.novelty_p <= DOUBTFUL:
        reasons.append(
            f"the best effect leaves {f.left:.0%} of the gap on motions that it did not see, and "
            f"fits worse than {1 - f.novelty_p:.0%} of the campaigns that the library makes"
        )
        return _unresolved(f, *reasons)
    if pair is None and f.after_low > MOST_REST * f.floor:
        reasons.append(
            f"what the best effect leaves is more than {MOST_REST:g} times the floor's own loss: "
            "it is no explanation, however much of the gap it closes"
        )
        return _unresolved(f, *reasons)
    if f.anew is not None and f.anew.short:
        reasons.append(
            f"simulated anew under what leads, the uncertain trials lose "
            f"{f.anew.closure.value:.0%} of their gap where the emulator foretells "
            f"{f.anew.foretold:.0%}: it cannot be trusted here"
        )
        return _unresolved(f, *reasons)
    if pair is not None:
        reasons.append("a second effect improves the score on motions that the choice did not see")
        probability = f.class_probability * pair.probability
        return Verdict("pair", pair.names, probability, tuple(reasons))
    if len(f.leading) > 1:
        reasons.append(
            "this campaign does not tell these effects apart"
            if len(f.alike) == len(f.leading)
            else f"{_alike(f)}; {LEAST_PROBABILITY} takes the others too, which fit worse"
        )
        return Verdict("class", f.leading, f.class_probability, tuple(reasons))
    return Verdict("effect", f.leading, f.class_probability, tuple(reasons))


def _misfit(f: Findings, reasons: list[str]) -> Verdict:
    """What is said where neither one effect nor a pair explains the gap."""
    none = _none_beside_unknown(f)
    if f.unknown_probability <= none:
        reason = (
            "the best effect leaves a gap above the floor on motions that it did not see, but by "
            f"its prior none, with {none:.2f}, is more probable than a cause outside the library, "
            f"with {f.unknown_probability:.2f}"
        )
        return _unresolved(f, *reasons, reason)
    reasons = [
        *reasons,
        "the best effect leaves a gap above the floor on motions that it did not see, and fits "
        f"worse than {1 - f.novelty_p:.0%} of the campaigns that the library makes",
    ]
    if f.pair is not None:
        first, second = f.pair.names
        reasons.append(
            f"{first} and {second} together do better there than one effect, but leave "
            f"{min(max(f.pair.left, 0.0), 1.0):.0%} of the gap: two effects, or a cause outside "
            "the library"
        )
        return _unresolved(f, *reasons)
    if f.left < 0.5:
        reasons.append(
            f"that best one, {f.leading[0]}, still closes {1 - f.left:.0%} of the gap there: "
            "it may be a part of the cause, beside what the library lacks"
        )
    return Verdict("unknown", (), f.unknown_probability, tuple(reasons))


def points_outside(verdict: Verdict, f: Findings) -> bool:
    """Whether an unresolved verdict leaves more than half to a cause outside the library."""
    return verdict.kind == "unresolved" and f.unknown_probability > 0.5


def disagreement(
    leading: tuple[str, ...],
    likelihood_best: str,
    classifier_best: str,
    likelihood_set: tuple[str, ...],
    classifier_set: tuple[str, ...],
) -> str | None:
    """Why two routes contradict each other; None: they do not.

    They agree if the leading class has a member in either route's 90 % set, and the best label of
    each route is in the leading class or in the other route's set.
    """
    for route, labels in (("likelihood", likelihood_set), ("classifier", classifier_set)):
        if not set(leading) & set(labels):
            return f"the {route}'s 90 % set holds none of {', '.join(leading)}"
    for route, best, other in (
        ("likelihood", likelihood_best, classifier_set),
        ("classifier", classifier_best, likelihood_set),
    ):
        if best not in leading and best not in other:
            return f"the {route} favours {best}, which the other route rules out"
    return None
