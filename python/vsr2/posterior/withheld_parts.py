"""Parts of the library that are withheld in turn, as if nobody had simulated them.

No network can learn a cause that was never simulated. So parts of the library are withheld, each
with all that is declared alike to it, and regressions, network and curves are learned from the
campaigns that are left. What does not depend on the effects stays: by what campaigns are
standardised, the temperature, and the judges of a second cause.
Then campaigns of a part are what campaigns of an unknown cause are: leave-one-class-out, with which
outliers are exposed (D. Hendrycks, M. Mazeika and T. Dietterich, "Deep anomaly detection with
outlier exposure", ICLR 2019).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vsr2.ensemble.observed.random_streams import Stream, generator
from vsr2.ensemble.simulated.campaigns import Campaigns
from vsr2.ensemble.simulated.library import Library
from vsr2.ensemble.simulated.linear_algebra import blocks
from vsr2.posterior.outside import Outside
from vsr2.posterior.sets import Sets
from vsr2.posterior.summaries import SUMMARY, Floats
from vsr2.posterior.truth import Truth
from vsr2.posterior.within_library import WithinLibrary, held_out_left, learned_of_part

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Rows = NDArray[np.int64]


@dataclass(frozen=True)
class WithheldConstants:
    """What is withheld; chosen by hand.

    Attributes:
        share: of the library that is withheld at once, at most, unless the effects that are
            declared alike to one are more.
    """

    share: float = 0.2


WITHHELD = WithheldConstants()


@dataclass(frozen=True)
class LibraryPart:
    """A part of the library that is withheld.

    Attributes:
        effects: that it holds, indices.
        unknown: those of them that nothing is declared alike to which is left.
    """

    effects: tuple[int, ...]
    unknown: tuple[int, ...]


def parts_of(alike: Bools) -> Iterator[LibraryPart]:
    """Parts of a library, so that each effect is once without anything alike; never all of it.

    Args:
        alike: effects declared alike, shape (effects, effects).
    """
    count = len(alike)
    classes = [frozenset(np.flatnonzero(row).tolist()) | {k} for k, row in enumerate(alike)]
    # What is alike to all others cannot be withheld with all that is.
    left = {k for k in range(count) if len(classes[k]) < count}
    most = max([int(np.ceil(WITHHELD.share * count)), *(len(classes[k]) for k in left)])
    while left:
        part: frozenset[int] = frozenset()
        while fitting := [k for k in sorted(left) if len(part | classes[k]) <= most]:
            # The fewest that are added for each that becomes unknown.
            costs = [
                (len(part | classes[k]) - len(part))
                / sum(classes[other] <= part | classes[k] for other in left)
                for k in fitting
            ]
            part |= classes[fitting[int(np.argmin(costs))]]
            left -= {k for k in left if classes[k] <= part}
        unknown = tuple(k for k in sorted(part) if classes[k] <= part)
        yield LibraryPart(tuple(sorted(part)), unknown)


@dataclass(frozen=True, eq=False)
class WithheldPart:
    """What a library that lacks a part makes of the last copy of campaigns.

    Attributes:
        within: what is learned of the part that is left, without the regressions of summaries.
        rows: indices of campaigns whose cause is withheld.
        fold: group of each of these.
        summaries: of these, shape (withheld, summaries).
        left: what is left over of these, shape (withheld, most + 1).
        weight: of these.
        known: what is left over of campaigns in which nothing that is withheld acts, shape (n, most
            + 1).
        known_weight: of these.
    """

    within: WithinLibrary
    rows: Rows
    fold: Rows
    summaries: Array
    left: Array
    weight: Array
    known: Array
    known_weight: Array

    @property
    def samples(self) -> tuple[tuple[Array, Array, bool], ...]:
        """Of which the probability of a cause outside is learned: see :meth:`Outside.of`."""
        return (self.left, self.weight, True), (self.known, self.known_weight, False)

    def judged(self, sets: Sets, outside: Outside) -> Iterator[tuple[Rows, Array]]:
        """Campaigns whose cause is withheld, some at a time, and the probability of every set.

        Args:
            sets: of the library that has the part.
            outside: that has not learned that these are unknown.
        """
        place = self.within.sets.within(sets)
        for k in range(SUMMARY.folds):
            own, held = self.within.of_fold(k, self.within.networks), np.flatnonzero(self.fold == k)
            for block in blocks(held.size, len(sets)):
                some = held[block]
                summaries = self.summaries[some]
                probability = np.zeros((some.size, len(sets)))
                probability[:, place] = own.refined(own.pooled(summaries), summaries)
                yield self.rows[some], outside.beside(probability, self.left[some])


def withheld(
    residuals: Sequence[Floats],
    campaigns: Campaigns,
    library: Library,
    truth: Truth,
    fold: Rows,
    of_all: WithinLibrary,
    seed: int,
) -> list[WithheldPart]:
    """What is made of campaigns while each part of the library is withheld: see :func:`parts_of`.

    Campaigns in which an effect acts that is withheld beside one that is not, or beside which
    something alike is left, count as neither known nor unknown.

    Args:
        residuals: of each copy of the campaigns, shape (n, columns).
        campaigns: simulated.
        library: effects.
        truth: of the campaigns.
        fold: group of each campaign.
        of_all: what is learned of all of the library.
        seed: of the training.
    """
    out: list[WithheldPart] = []
    if not of_all.curves:
        return out
    for number, part in enumerate(parts_of(truth.alike)):
        acts = truth.acting[:, list(part.effects)].any(axis=1)
        unknown = np.isin(np.arange(len(library)), part.unknown)
        rows = np.flatnonzero(acts & ~truth.acting[:, ~unknown].any(axis=1))
        among = np.flatnonzero(~acts)
        rest = {name: one for k, (name, one) in enumerate(library.items()) if k not in part.effects}
        known = campaigns.chosen(among)
        own_truth = Truth.of(known, Sets(tuple(rest), truth.sets.most), rest)
        if not rows.size or known.gap_free.all():
            continue
        within, found = learned_of_part(
            residuals, known, rest, own_truth, fold[among], of_all, among,
            generator(seed, Stream.PARTS, number),
        )  # fmt: skip
        summaries = within.summaries.by_folds(residuals[-1][rows], fold[rows])
        left = held_out_left(within, summaries, fold[rows])
        known_left = held_out_left(within, found, fold[among])
        within = replace(within, summaries=within.summaries.without_regressions())
        out.append(
            WithheldPart(
                within, rows, fold[rows], summaries, left, truth.weight[rows], known_left,
                own_truth.weight,
            )
        )  # fmt: skip
    return out
