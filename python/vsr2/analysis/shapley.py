"""Shares of causes in a loss: what each takes off, over all orders in which they can be added."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def mean_gain(losses: Mapping[frozenset[str], Array], name: str, before: int) -> Array:
    """What a cause takes off when so many others act already, the mean over which they are.

    Args:
        losses: by which causes act, of every set of them, all of one shape and unit.
        name: of the cause.
        before: number of the others that act.

    Returns:
        Of the shape and unit of the losses.
    """
    others = sorted(frozenset().union(*losses) - {name})
    sets = map(frozenset, combinations(others, before))
    return np.asarray(np.mean([losses[one] - losses[one | {name}] for one in sets], axis=0))


def shapley_share(losses: Mapping[frozenset[str], Array], name: str) -> Array:
    """The mean over all orders (L. S. Shapley, "A value for n-person games", 1953).

    Shares of all causes sum to what all of them together take off.

    Args:
        losses: as of :func:`mean_gain`.
        name: of the cause.
    """
    count = len(frozenset().union(*losses))
    return np.asarray(np.mean([mean_gain(losses, name, n) for n in range(count)], axis=0))
