"""What acts in each training campaign, and the prior by which it counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.ensemble.simulated.campaigns import Campaigns
from vsr2.ensemble.simulated.library import Library
from vsr2.posterior.sets import Sets, declared_alike

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class PriorConstants:
    """Prior over what acts, and which effects the library of a campaign lacks; chosen by hand.

    Attributes:
        none, one, two, outside: prior probability of the hypotheses; where more than two effects
            may act, what one and two have is spread evenly over the numbers of effects.
        left_out: share of training campaigns whose own effect the library lacks.
        decoy: share of those that lack a class which does not act.
        together: chance that an effect declared alike to what is left out is left out with it.
    """

    none: float = 0.2
    one: float = 0.5
    two: float = 0.15
    outside: float = 0.15
    left_out: float = 0.15
    decoy: float = 0.4
    together: float = 0.5

    def sizes(self, most: int) -> tuple[float, ...]:
        """Prior probability of none, one, ... effects, where at most so many act."""
        if most == 2:
            return self.none, self.one, self.two
        return self.none, *[(self.one + self.two) / most] * most


PRIOR = PriorConstants()


@dataclass(frozen=True, eq=False)
class Truth:
    """What acts in each training campaign.

    Attributes:
        sets: hypotheses.
        index: of the true set, shape (n,).
        acting: shape (n, effects).
        weight: of each campaign, so that kinds count as the prior has them, shape (n,).
        alike: effects declared alike, shape (effects, effects).
    """

    sets: Sets
    index: NDArray[np.int64]
    acting: Bools
    weight: Array
    alike: Bools

    @classmethod
    def of(cls, campaigns: Campaigns, sets: Sets, library: Library) -> Truth:
        """Of simulated campaigns, by the library's effects."""
        names = [[one.name for one in acting] for acting in campaigns.sets]
        acting = np.array([np.isin(sets.names, own) for own in names]).reshape(len(names), -1)
        index = np.array([sets.index(own) for own in names], dtype=np.int64)
        count = acting.sum(axis=1)
        wanted = np.array(PRIOR.sizes(sets.most))
        shares = np.array([max(float((count == k).mean()), 1e-9) for k in range(len(wanted))])
        return cls(sets, index, acting, (wanted / shares)[count], declared_alike(library))

    @property
    def judged(self) -> NDArray[np.int64]:
        """Index of all campaigns, then of those in which some act, which are judged twice."""
        return np.concatenate([np.arange(len(self.index)), np.flatnonzero(self.acting.any(axis=1))])

    def without(self, rng: np.random.Generator, rows: NDArray[np.int64]) -> tuple[Bools, Bools]:
        """Effects that the library has for each campaign, and whether it lacks the cause.

        What is left out is an effect that acts, or one that does not, and each effect that is
        declared alike with the chance `PRIOR.together`.
        """
        acting = self.acting[rows]
        kind = rng.random(rows.size)
        outside = (kind < PRIOR.left_out) & acting.any(axis=1)
        decoy = (kind > 1 - PRIOR.decoy) & ~outside
        among = np.where(outside[:, None], acting, ~acting)
        left_out = (rng.random(acting.shape) * among).argmax(axis=1)
        lacking = left_out_together(self.alike, left_out, rng)
        lacking &= np.where(outside[:, None], True, ~acting) & (outside | decoy)[:, None]
        return ~lacking, outside


def left_out_together(alike: Bools, left_out: NDArray[np.int64], rng: np.random.Generator) -> Bools:
    """Effects that a library lacks together with one, itself among them, shape (n, effects).

    Each effect declared alike is lacking, too, with the chance `PRIOR.together`.

    Args:
        alike: effects declared alike, shape (effects, effects).
        left_out: index of the effect that is lacking, shape (n,).
        rng: of the chance.
    """
    drawn = rng.random((left_out.size, alike.shape[0])) < PRIOR.together
    together = alike[left_out] & drawn
    together[np.arange(left_out.size), left_out] = True
    return together
