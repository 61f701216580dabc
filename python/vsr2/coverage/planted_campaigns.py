"""Planted campaigns: their cause is drawn from the prior of the posterior that is checked."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np

from vsr2.config.seeds import checked_seed
from vsr2.ensemble.observed.random_streams import Stream, generator
from vsr2.ensemble.simulated.campaigns import Acting, draw_set, insensitive
from vsr2.ensemble.simulated.library import Library
from vsr2.ensemble.simulated.look import Limits
from vsr2.errors import DiagnosisError
from vsr2.posterior.truth import PRIOR

FIRST = 100_000
"""Number of the first planted campaign, far above those of training."""


@dataclass(frozen=True)
class Planted:
    """One planted campaign.

    Attributes:
        row: its number, which says what acts.
        acting: in it.
    """

    row: int
    acting: tuple[Acting, ...]


def draw_planted(
    library: Library,
    limits: Limits,
    count: int,
    *,
    most: int,
    excluded: Collection[str] = (),
    seed: int = 0,
) -> tuple[Planted, ...]:
    """Planted campaigns of the posterior's prior over none, one and more effects of the library.

    Simulated campaigns have these in other shares, by which training weights them; here each is
    taken in the share that the prior gives it, so that campaigns count alike.

    Args:
        library: effects.
        limits: detection limits.
        count: of campaigns.
        most: effects that may act together.
        excluded: effects that are not looked for, and do not act.
        seed: of the diagnosis.

    Raises:
        DiagnosisError: no effect that is looked for shows in the campaign, or what is no seed.
    """
    seed = checked_seed(seed, DiagnosisError)
    shown = set(library) - set(insensitive(library, limits)) - set(excluded)
    if not shown:
        raise DiagnosisError(
            "no effect that is looked for shows in this campaign, so nothing can be planted"
        )
    rng = generator(seed, Stream.PLANTED)
    prior = np.array(PRIOR.sizes(most))
    reached = prior[: len(shown) + 1]
    sizes = rng.choice(reached.size, count, p=reached / reached.sum())
    drawn = {
        size: _of_size(library, limits, size, most, shown, seed) for size in range(reached.size)
    }
    return tuple(Planted(*next(drawn[int(size)])) for size in sizes)


def _of_size(
    library: Library,
    limits: Limits,
    size: int,
    most: int,
    shown: Collection[str],
    seed: int,
) -> Iterator[tuple[int, tuple[Acting, ...]]]:
    """Numbers of campaigns in which so many effects act, of those that are looked for."""
    row = FIRST
    while True:
        acting = draw_set(library, limits, row, seed, most)
        if len(acting) == size and all(one.name in shown for one in acting):
            yield row, acting
        row += 1
