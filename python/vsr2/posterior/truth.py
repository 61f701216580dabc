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
    """Prior over what acts; chosen by hand.

    Attributes:
        none, one, two, outside: prior probability of the hypotheses; where more than two effects
            may act, what one and two have is spread evenly over the numbers of effects.
    """

    none: float = 0.2
    one: float = 0.5
    two: float = 0.15
    outside: float = 0.15

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
