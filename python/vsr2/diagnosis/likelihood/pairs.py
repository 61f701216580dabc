"""Two effects that act together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vsr2.diagnosis.likelihood.emulator import Emulator
from vsr2.diagnosis.likelihood.evidence import Data, Posterior, Table, posterior, tabulate_pair
from vsr2.diagnosis.simulated.library import Library, free_parameters, is_angle
from vsr2.diagnosis.simulated.simulator import quasi_random

_NODES = (120, 120, 120)
"""In each round: see `pair_posterior`."""
_RANKED_NODES = (40, 40)
"""Of pairs that are ranked."""
_NEAR = 5.0
"""Log posterior below the best node's at which a node counts as better [nat]."""
_SHORTLIST = 3


def best_pair(
    library: Library, emulator: Emulator, first: str, data: Data
) -> tuple[str, Table, Posterior]:
    """The effect with the greatest evidence beside `first`; effects add up on the logit."""

    def tried(second: str, nodes: Sequence[int]) -> tuple[Table, Posterior]:
        return pair_posterior(library, emulator, (first, second), data, nodes)

    def evidence(second: str) -> float:
        return float(tried(second, _RANKED_NODES)[1].evidence[0])

    ranked = sorted((name for name in library if name != first), key=lambda n: -evidence(n))
    found = [(name, *tried(name, _NODES)) for name in ranked[:_SHORTLIST]]
    return max(found, key=lambda one: float(one[2].evidence[0]))


def pair_posterior(
    library: Library, emulator: Emulator, names: tuple[str, str], data: Data, nodes: Sequence[int]
) -> tuple[Table, Posterior]:
    """A pair on nodes that close in on where its posterior lies.

    Two strong effects leave a posterior that nodes spread over both priors would hardly meet. So
    each further set of nodes is spread over the box that holds the better nodes of the last.

    Args:
        library: effects.
        emulator: fitted.
        names: of both.
        data: one campaign.
        nodes: their number in each round.

    Returns:
        The pair on the last nodes, and its posterior there, with the evidence of the whole prior.
    """
    free = [*free_parameters(library[names[0]]), *free_parameters(library[names[1]])]
    first = len(free_parameters(library[names[0]]))
    turns = np.array([is_angle(p) for p in free])
    low, high = np.zeros(len(free)), np.ones(len(free))
    for count in nodes:
        unit = np.array([quasi_random(1, len(free), i + 1) for i in range(count)])
        spread = low + (high - low) * unit
        table = tabulate_pair(emulator, *names, (spread[:, :first], spread[:, first:]))
        found = posterior(table, data)
        evidence = found.evidence + float(np.log(high - low).sum())
        near = spread[found.nodes[0] > found.nodes[0].max() - _NEAR]
        margin = (high - low) * count ** (-1 / len(free))
        low = np.where(turns, 0.0, np.maximum(near.min(axis=0) - margin, low))
        high = np.where(turns, 1.0, np.minimum(near.max(axis=0) + margin, high))
    return table, replace(found, evidence=evidence)
