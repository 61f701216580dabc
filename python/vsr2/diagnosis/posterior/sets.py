"""Hypotheses: sets of effects that act together, and a cause outside the library."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.simulated.library import Library
from vsr2.effects import Effect

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sets:
    """All sets of at most two effects, and the hypothesis `outside`.

    Their order is: none, every effect alone, every pair, outside.

    Attributes:
        names: of the effects.
    """

    names: tuple[str, ...]

    def __len__(self) -> int:
        count = len(self.names)
        return 2 + count + count * (count - 1) // 2

    @property
    def outside(self) -> int:
        """Index of a cause outside the library."""
        return len(self) - 1

    @cached_property
    def pairs(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """First and second effect of every pair."""
        first, second = np.triu_indices(len(self.names), 1)
        return first, second

    @cached_property
    def members(self) -> NDArray[np.bool_]:
        """Which effects each set holds, shape (sets, effects)."""
        count = len(self.names)
        out = np.zeros((len(self), count), dtype=bool)
        out[1 + np.arange(count), np.arange(count)] = True
        first, second = self.pairs
        rows = 1 + count + np.arange(first.size)
        out[rows, first] = out[rows, second] = True
        return out

    def index(self, names: Collection[str]) -> int:
        """Of a set of at most two effects."""
        wanted = np.isin(self.names, list(names))
        return int(np.flatnonzero((self.members[:-1] == wanted).all(axis=1))[0])

    def allowed(self, effects: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which sets hold nothing but some effects, shape (..., sets).

        Args:
            effects: shape (..., effects).
        """
        return np.asarray(~((~effects).astype(np.float64) @ self.members.T > 0))

    def marginal(self, probability: Array) -> Array:
        """Probability that each effect acts, shape (..., effects)."""
        return np.asarray(probability @ self.members)

    def leading(self, probability: Array) -> Array:
        """Probability that each effect acts and leads, shape (n, effects).

        Of two effects that act together, the one leads that acts with the greater probability.

        Args:
            probability: of every set, shape (n, sets).
        """
        count, (first, second) = len(self.names), self.pairs
        acts = self.marginal(probability)
        leads = np.where(acts[:, first] >= acts[:, second], first, second)
        out = np.array(probability[:, 1 : 1 + count])
        np.add.at(out, (np.arange(len(out))[:, None], leads), probability[:, 1 + count : -1])
        return out


def are_alike(one: Effect, other: Effect) -> bool:
    """Whether two effects are declared to look alike by one or the other."""
    return other.name in one.confounded_with or one.name in other.confounded_with


def declared_alike(library: Library) -> NDArray[np.bool_]:
    """Which effects are declared alike, shape (effects, effects)."""
    effects = library.values()
    return np.array([[are_alike(a, b) for b in effects] for a in effects], dtype=bool).reshape(
        len(library), len(library)
    )


def classes(effects: Sequence[int], alike: NDArray[np.bool_]) -> int:
    """Number of classes that some effects make, alike ones among them being one class."""
    count, left = 0, set(effects)
    while left:
        count += 1
        reached = {left.pop()}
        while reached:
            found = {e for e in left if any(alike[e, r] for r in reached)}
            left -= found
            reached = found
    return count
