"""The one rule by which probabilities become a statement."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from vsr2.ensemble.simulated import library
from vsr2.posterior.sets import Sets, classes

Array = NDArray[np.float64]


class VerdictKind(StrEnum):
    """What a verdict says; `PAIR` names two causes that act together, `SEVERAL` more."""

    NONE = library.NONE
    EFFECT = "effect"
    CLASS = "class"
    PAIR = "pair"
    SEVERAL = "several"
    UNKNOWN = library.UNKNOWN
    UNRESOLVED = "unresolved"

    @property
    def names_effects(self) -> bool:
        """Whether it says which effects are missing."""
        return self in (VerdictKind.EFFECT, VerdictKind.CLASS) or self.names_several

    @property
    def names_several(self) -> bool:
        """Whether it says that more than one cause acts."""
        return self in (VerdictKind.PAIR, VerdictKind.SEVERAL)


@dataclass(frozen=True)
class NamingConstants:
    """Limits of the rule that are chosen by hand; `NamingLimits` has those that training chooses.

    Attributes:
        classes: of effects that may be named as one finding.
        outside: probability, given a gap, from which a cause outside the library outweighs.
        second: probability of two effects or more, given a gap, from which a name says that a
            second is likely.
        least_fit: tail probability among simulated campaigns without effect below which there is a
            gap, whatever the posterior says.
    """

    classes: int = 3
    outside: float = 0.5
    second: float = 0.5
    least_fit: float = 0.01


NAMING = NamingConstants()
NEVER = 1.0
"""A probability that no name exceeds."""
Findings = tuple[tuple[int, ...], ...]
"""Causes that act together: of each the effects, one of which acts."""


@dataclass(frozen=True)
class Candidates:
    """What could be named of one campaign, in the order of adding effects.

    Attributes:
        none: probability that nothing is missing.
        outside: probability of a cause outside the library, given a gap.
        together: causes that may act together, the most of them first, each with the probability,
            given a gap, that all act; of equally many the fewest effects first.
        effects: indices, each adding most to the probability that one of them acts.
        covered: that probability with each further effect, given a gap.
        classes: that these make, effects declared alike being one.
    """

    none: float
    outside: float
    together: tuple[tuple[Findings, float], ...]
    effects: tuple[int, ...]
    covered: tuple[float, ...]
    classes: tuple[int, ...]


@dataclass(frozen=True)
class Naming:
    """What is said.

    Attributes:
        kind: of the verdict.
        findings: causes, of each the effects that it may be; of an unresolved verdict one, the
            effects that lead.
        probability: of what is said; of effects, given a gap.
        classes: that the effects make.
        alike: whether all effects named are declared alike.
    """

    kind: VerdictKind
    findings: Findings
    probability: float
    classes: int = 0
    alike: bool = False

    @property
    def effects(self) -> tuple[int, ...]:
        """Of all findings."""
        return tuple(effect for finding in self.findings for effect in finding)


def candidates(probability: Array, sets: Sets, alike: NDArray[np.bool_]) -> Candidates:
    """What could be named.

    Args:
        probability: of every set, shape (sets,).
        sets: the hypotheses.
        alike: effects declared alike, shape (effects, effects).
    """
    none = float(probability[0])
    given = probability / max(1 - none, 1e-12)
    count = len(sets.names)
    left = np.array(given)
    left[0] = left[-1] = 0.0
    together = _together(left, sets, alike)
    chosen: list[int] = []
    covered: list[float] = []
    counts: list[int] = []
    while len(chosen) < count:
        gain = left @ sets.members
        gain[chosen] = 0.0
        # What adds nothing is no candidate.
        if chosen and not gain.max() > 0:
            break
        chosen.append(int(np.argmax(gain)))
        covered.append(min(1.0, (covered[-1] if covered else 0.0) + float(gain[chosen[-1]])))
        left[sets.members[:, chosen[-1]]] = 0.0
        counts.append(classes(chosen, alike))
        if counts[-1] > NAMING.classes:
            break
    return Candidates(
        none, float(given[-1]), together, tuple(chosen), tuple(covered), tuple(counts)
    )


def _together(
    given: Array, sets: Sets, alike: NDArray[np.bool_]
) -> tuple[tuple[Findings, float], ...]:
    """Causes that may act together: see `Candidates`.

    Of each size one set leads, all of whose effects act with the greatest probability: the most
    probable one of that size, or a part of that which leads larger ones. To each of its effects
    those declared alike to it are added, first the one that adds most to the probability that all
    causes act.

    Args:
        given: probability of each set of effects, given a gap, shape (sets,).
        sets: the hypotheses.
        alike: effects declared alike, shape (effects, effects).
    """
    out: list[tuple[Findings, float]] = []
    leaders = np.zeros(0, dtype=np.int64)
    for rows in reversed(sets.by_size[1:]):
        own = np.flatnonzero(sets.size == rows.shape[1])
        # Where most of them stand in larger sets, they are a part of the leaders there.
        options = [rows[int(np.argmax(given[own]))]]
        options += [np.delete(leaders, k) for k in range(leaders.size)]
        acting = [float(given[sets.members[:, one].all(axis=1)].sum()) for one in options]
        leaders = options[int(np.argmax(acting))]
        findings = [[int(effect)] for effect in leaders]
        hit = [np.array(sets.members[:, effect]) for effect in leaders]
        out.append((_frozen(findings), float(given[np.all(hit, axis=0)].sum())))
        more = [
            (k, int(effect))
            for k, leader in enumerate(leaders)
            for effect in np.flatnonzero(alike[leader])
            if effect not in leaders
        ]
        while more:
            gains = []
            for k, effect in more:
                others = [one for j, one in enumerate(hit) if j != k]
                added = np.all(others, axis=0) & sets.members[:, effect] & ~hit[k]
                gains.append(float(given[added].sum()))
            best = int(np.argmax(gains))
            if not gains[best] > 0:
                break
            k, effect = more[best]
            more = [one for one in more if one[1] != effect]
            findings[k].append(effect)
            hit[k] |= sets.members[:, effect]
            out.append((_frozen(findings), out[-1][1] + gains[best]))
    return tuple(out)


def _frozen(findings: list[list[int]]) -> Findings:
    return tuple(tuple(one) for one in findings)


@dataclass(frozen=True)
class NamingLimits:
    """What the rule asks for; training chooses all three.

    Attributes:
        none: probability of none below which there is a gap.
        one: probability, given a gap, that the name of one cause must exceed.
        together: that of the names of causes that act together.
    """

    none: float
    one: float
    together: float


def decide(
    found: Candidates,
    limits: NamingLimits,
    alike: NDArray[np.bool_],
    *,
    fit: float = 1.0,
) -> Naming:
    """What is said.

    None is said unless its probability is below its limit, or the campaign does not fit simulations
    without effect. A cause outside the library is said where it outweighs. Else causes that act
    together are named, else one.

    Args:
        found: of the campaign.
        limits: of probabilities.
        alike: effects declared alike, shape (effects, effects).
        fit: tail probability among simulated campaigns without effect.
    """
    if found.none >= limits.none and fit >= NAMING.least_fit:
        return Naming(VerdictKind.NONE, (), found.none)
    if found.outside > NAMING.outside:
        return Naming(VerdictKind.UNKNOWN, (), found.outside)
    return several_causes(found, limits.together) or one_cause(found, limits.one, alike)


def several_causes(found: Candidates, least: float) -> Naming | None:
    """The most causes that act together with a greater probability, given a gap; None: none do.

    Each is an effect, or effects that are declared alike.
    """
    for findings, probability in found.together:
        probability = min(probability, 1.0)
        if probability > least:
            kind = VerdictKind.PAIR if len(findings) == 2 else VerdictKind.SEVERAL
            return Naming(kind, findings, probability, len(findings))
    return None


def one_cause(found: Candidates, least: float, alike: NDArray[np.bool_]) -> Naming:
    """The smallest set of effects of which one acts with a greater probability, given a gap.

    Where the next effect is declared alike to the first, both are named. Unresolved: it takes more
    than `NAMING.classes` classes.

    Args:
        found: of the campaign.
        least: that probability.
        alike: effects declared alike, shape (effects, effects).
    """
    reached = [k for k, covered in enumerate(found.covered) if covered > least]
    if not reached or found.classes[reached[0]] > NAMING.classes:
        count = sum(c <= NAMING.classes for c in found.classes)
        kind = VerdictKind.UNRESOLVED
    else:
        count = reached[0] + 1
        if count == 1 and len(found.effects) > 1 and alike[found.effects[0], found.effects[1]]:
            count = 2
        kind = VerdictKind.EFFECT if count == 1 else VerdictKind.CLASS
    return Naming(
        kind,
        (found.effects[:count],),
        found.covered[count - 1],
        found.classes[count - 1],
        count > 1 and found.classes[count - 1] == 1,
    )


def is_wrong(said: Naming, acting: tuple[int, ...]) -> bool:
    """Whether a name is wrong; what names nothing is not.

    Args:
        said: of a campaign.
        acting: effects of the library that act in it; empty too where the cause lies outside.
    """
    if said.kind.names_several:
        return any(not set(finding) & set(acting) for finding in said.findings)
    if said.kind in (VerdictKind.EFFECT, VerdictKind.CLASS):
        return not set(said.effects) & set(acting)
    return False
