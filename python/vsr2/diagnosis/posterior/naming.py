"""The one rule by which probabilities become a statement."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.posterior.sets import Sets, classes
from vsr2.diagnosis.simulated import library

Array = NDArray[np.float64]


class VerdictKind(StrEnum):
    """What a verdict says; `PAIR` names two effects that act together."""

    NONE = library.NONE
    EFFECT = "effect"
    CLASS = "class"
    PAIR = "pair"
    UNKNOWN = library.UNKNOWN
    UNRESOLVED = "unresolved"

    @property
    def names_effects(self) -> bool:
        """Whether it says which effects are missing."""
        return self in (VerdictKind.EFFECT, VerdictKind.CLASS, VerdictKind.PAIR)


@dataclass(frozen=True)
class NamingConstants:
    """Limits of the rule; chosen by hand, but for the two that training sets.

    Attributes:
        classes: of effects that may be named as one finding.
        outside: probability, given a gap, from which a cause outside the library outweighs.
        second: probability of two effects, given a gap, from which a name says that a second is
            likely.
    """

    classes: int = 3
    outside: float = 0.5
    second: float = 0.5


NAMING = NamingConstants()


@dataclass(frozen=True)
class Candidates:
    """What could be named of one campaign, in the order of adding effects.

    Attributes:
        none: probability that nothing is missing.
        outside: probability of a cause outside the library, given a gap.
        pair: the most probable pair, indices of effects.
        pair_probability: of it, given a gap.
        effects: indices, each adding most to the probability that one of them acts.
        covered: that probability with each further effect, given a gap.
        classes: that these make, effects declared alike being one.
    """

    none: float
    outside: float
    pair: tuple[int, int]
    pair_probability: float
    effects: tuple[int, ...]
    covered: tuple[float, ...]
    classes: tuple[int, ...]


@dataclass(frozen=True)
class Naming:
    """What is said.

    Attributes:
        kind: of the verdict.
        effects: indices; of an unresolved verdict those that lead.
        probability: of what is said; of effects, given a gap.
        classes: that the effects make.
        alike: whether all effects named are declared alike.
    """

    kind: VerdictKind
    effects: tuple[int, ...]
    probability: float
    classes: int = 0
    alike: bool = False


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
    best = 0
    if count > 1:
        best = int(np.argmax(given[1 + count : -1]))
    first, second = sets.pairs
    left = np.array(given)
    left[0] = left[-1] = 0.0
    chosen: list[int] = []
    covered: list[float] = []
    counts: list[int] = []
    while len(chosen) < count:
        gain = left @ sets.members
        gain[chosen] = 0.0
        # What adds nothing, as what the library lacks, is no candidate.
        if chosen and not gain.max() > 0:
            break
        chosen.append(int(np.argmax(gain)))
        covered.append(min(1.0, (covered[-1] if covered else 0.0) + float(gain[chosen[-1]])))
        left[sets.members[:, chosen[-1]]] = 0.0
        counts.append(classes(chosen, alike))
        if counts[-1] > NAMING.classes:
            break
    return Candidates(
        none,
        float(given[-1]),
        (int(first[best]), int(second[best])) if count > 1 else (0, 0),
        float(given[1 + count + best]) if count > 1 else 0.0,
        tuple(chosen),
        tuple(covered),
        tuple(counts),
    )


def decide(
    found: Candidates, *, none_limit: float, least: float, alike: NDArray[np.bool_]
) -> Naming:
    """What is said.

    None is said unless its probability is below what one gap-free campaign in twenty has. A cause
    outside the library is said where it outweighs. Else the smallest set of effects is named of
    which one acts with the probability `least`, given a gap, or the pair that reaches it. Where the
    next effect is declared alike to the first, both are named.

    Args:
        found: of the campaign.
        none_limit: 5 % point of the probability of none over gap-free campaigns.
        least: probability that a name must have, given a gap.
        alike: effects declared alike, shape (effects, effects).
    """
    if found.none >= none_limit:
        return Naming(VerdictKind.NONE, (), found.none)
    if found.outside > NAMING.outside:
        return Naming(VerdictKind.UNKNOWN, (), found.outside)
    if found.pair_probability >= least:
        return Naming(VerdictKind.PAIR, found.pair, found.pair_probability)
    reached = [k for k, covered in enumerate(found.covered) if covered >= least]
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
        found.effects[:count],
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
    if said.kind is VerdictKind.PAIR:
        return not set(said.effects) <= set(acting)
    if said.kind in (VerdictKind.EFFECT, VerdictKind.CLASS):
        return not set(said.effects) & set(acting)
    return False
