"""Which trials a scene is asked for: a part of each motion's, each scene another part.

The trials of a motion differ in scale alone, so a few of them tell most of what a scene changes in
the others. Asking each scene for a part lets as many simulations see more scenes, and it is scenes
that an emulator lacks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.int64]


@dataclass(frozen=True)
class GroupConstants:
    """How trials are dealt to scenes; chosen by hand.

    Attributes:
        asked: trials of a motion that a scene is asked for, of a motion as long as the median one:
            with two, what a trial adds parts from what its motion adds.
        most: groups.
    """

    asked: int = 2
    most: int = 6


TRIAL_GROUPS = GroupConstants()


@dataclass(frozen=True, eq=False)
class TrialGroups:
    """Trials dealt to scenes.

    Attributes:
        motion: number of each trial's ground motion, shape (trials,).
        asked: which trials each group has, shape (groups, trials).
    """

    motion: Rows
    asked: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.asked)

    @property
    def motions(self) -> int:
        """Their number."""
        return int(self.motion.max()) + 1


def trial_groups(motions: NDArray[np.str_]) -> TrialGroups:
    """Groups that each have trials of every motion.

    A motion with fewer trials than there are groups has some of them in several.

    Args:
        motions: ground motion of each trial, shape (trials,).
    """
    _, motion = np.unique(motions, return_inverse=True)
    usual = float(np.median(np.bincount(motion)))
    count = int(np.clip(usual // TRIAL_GROUPS.asked, 1, TRIAL_GROUPS.most))
    asked = np.zeros((count, motion.size), dtype=bool)
    for k in range(int(motion.max()) + 1):
        own = np.flatnonzero(motion == k)
        # Each motion begins with another group, so that groups are equally long.
        for j in range(max(own.size, count)):
            asked[(j + k) % count, own[j % own.size]] = True
    return TrialGroups(motion, asked)
