"""Hypotheses: sets of effects that act together, and a cause outside the library."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from vsr2.effects import Effect
from vsr2.ensemble.simulated.hypotheses import HYPOTHESIS
from vsr2.ensemble.simulated.library import Library

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sets:
    """All sets of at most some effects, and the hypothesis `outside`.

    Their order is: none, every effect alone, every pair, every three, ..., outside.

    Attributes:
        names: of the effects.
        most: effects that a set may hold.
    """

    names: tuple[str, ...]
    most: int = HYPOTHESIS.usual_effects

    def __len__(self) -> int:
        return 2 + sum(len(rows) for rows in self.by_size)

    @property
    def outside(self) -> int:
        """Index of a cause outside the library."""
        return len(self) - 1

    @cached_property
    def by_size(self) -> tuple[NDArray[np.int64], ...]:
        """Effects of every set of one, of two, ... effects, each shape (sets, size)."""
        effects = range(len(self.names))
        return tuple(
            np.array(list(combinations(effects, size)), dtype=np.int64).reshape(-1, size)
            for size in range(1, min(self.most, len(self.names)) + 1)
        )

    @cached_property
    def size(self) -> NDArray[np.int64]:
        """Number of effects that each set holds, 0 of none and of outside, shape (sets,)."""
        return np.asarray(self.members.sum(axis=1))

    @cached_property
    def members(self) -> NDArray[np.bool_]:
        """Which effects each set holds, shape (sets, effects)."""
        out = np.zeros((len(self), len(self.names)), dtype=bool)
        first = 1
        for rows in self.by_size:
            out[np.arange(first, first + len(rows))[:, None], rows] = True
            first += len(rows)
        return out

    @cached_property
    def parts(self) -> Array:
        """Outputs of a network of which the logit of each set is the sum, shape (sets, outputs).

        They are of every effect alone, of every effect in a larger set, of none and of each larger
        size. Outside has none.
        """
        count, size = len(self.names), self.size
        out = np.zeros((len(self), 2 * count + len(self.by_size)))
        out[1 : 1 + count, :count] = np.eye(count)
        larger = np.flatnonzero(size > 1)
        out[larger, count : 2 * count] = self.members[larger]
        out[larger, 2 * count + size[larger] - 1] = 1.0
        out[0, 2 * count] = 1.0
        return out

    def within(self, other: Sets) -> NDArray[np.int64]:
        """Index in a larger library's sets of each of these, outside last, shape (sets,).

        Args:
            other: sets of the larger library, of at least as many effects together.
        """
        place = [other.names.index(name) for name in self.names]
        held = np.zeros((len(self), len(other.names)), dtype=bool)
        held[:, place] = self.members
        known = {row.tobytes(): k for k, row in enumerate(other.members[:-1])}
        return np.array([*(known[row.tobytes()] for row in held[:-1]), other.outside])

    def index(self, names: Collection[str]) -> int:
        """Of a set of at most `most` effects."""
        wanted = np.isin(self.names, list(names))
        return int(np.flatnonzero((self.members[:-1] == wanted).all(axis=1))[0])

    def marginal(self, probability: Array) -> Array:
        """Probability that each effect acts, shape (..., effects)."""
        return np.asarray(probability @ self.members)

    def leading(self, probability: Array) -> Array:
        """Probability that each effect acts and leads, shape (n, effects).

        Of effects that act together, the one leads that acts with the greatest probability.

        Args:
            probability: of every set, shape (n, sets).
        """
        acts = self.marginal(probability)
        out = np.zeros(acts.shape)
        for row, (own, all_sets) in enumerate(zip(acts, probability, strict=True)):
            first = 1
            for rows in self.by_size:
                leads = rows[np.arange(len(rows)), own[rows].argmax(axis=1)]
                np.add.at(out[row], leads, all_sets[first : first + len(rows)])
                first += len(rows)
        return out


def are_alike(one: Effect, other: Effect) -> bool:
    """Whether two effects are declared to look alike by one or the other."""
    return other.name in one.confounded_with or one.name in other.confounded_with


def with_alike(names: Collection[str], library: Library) -> set[str]:
    """Effects, and all that the library declares alike to one of them; others stay as they are."""
    known = [library[name] for name in names if name in library]
    return {*names, *(o for o, other in library.items() if any(are_alike(k, other) for k in known))}


def declared_alike(library: Library) -> NDArray[np.bool_]:
    """Which effects are declared alike, shape (effects, effects)."""
    effects = library.values()
    return np.array([[are_alike(a, b) for b in effects] for a in effects], dtype=bool).reshape(
        len(library), len(library)
    )


def classes(effects: Sequence[int], alike: NDArray[np.bool_]) -> int:
    """Number of classes: each an effect, and later ones that are declared alike to it.

    Twins of a twin are another class, or chains of them would make one of half the library.
    """
    leaders: list[int] = []
    for effect in effects:
        if not any(alike[effect, leader] for leader in leaders):
            leaders.append(effect)
    return len(leaders)
