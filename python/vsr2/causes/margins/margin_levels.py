"""Margins of simulated scenes in three levels: of all trials, of a motion, and of one trial.

A scene that is more slender takes the same off all margins, one whose table rings changes those of
some motions, and chaos changes single trials.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from vsr2.causes.margins.trial_groups import Rows, TrialGroups

Array = NDArray[np.float64]


class MarginLevel(IntEnum):
    """What margins have in common."""

    ALL = 0
    MOTION = 1
    TRIAL = 2


@dataclass(frozen=True, eq=False)
class GroupMargins:
    """What single trials add to their motions in the scenes of a group.

    Attributes:
        scenes: their numbers, shape (s,).
        trials: that they were asked for, shape (t,).
        deviations: from the mean of the motion's, shape (s, t).
        free: number of trials less that of their motions.
    """

    scenes: Rows
    trials: Rows
    deviations: Array
    free: int


@dataclass(frozen=True, eq=False)
class MarginLevels:
    """Margins less their mean over scenes, parted.

    Attributes:
        groups: of trials.
        group: which of them each scene was asked for, shape (scenes,).
        centre: mean margin of each trial, NaN where all its simulations failed, shape (trials,).
        deviations: from it, 0 where a margin is missing, shape (scenes, trials).
        common: mean over motions, shape (scenes,).
        by_motion: of each motion, less that, shape (scenes, motions).
        varied: motions whose margins differ between scenes, shape (motions,). The others tell
            nothing of what a scene changes; all of them would call the rest noise.
        by_trial: what single trials add, of each group.
    """

    groups: TrialGroups
    group: Rows
    centre: Array
    deviations: Array
    common: Array
    by_motion: Array
    varied: NDArray[np.bool_]
    by_trial: tuple[GroupMargins, ...]

    def __len__(self) -> int:
        return len(self.common)

    @property
    def asked_of_a_motion(self) -> float:
        """Trials that a scene was asked for of each motion, the harmonic mean."""
        counts = np.array([np.bincount(self.groups.motion[own]) for own in self.groups.asked])
        return float(1 / np.mean(1 / counts))

    @property
    def same_group(self) -> NDArray[np.bool_]:
        """Whether two scenes were asked for the same trials, shape (scenes, scenes)."""
        return np.asarray(self.group[:, None] == self.group)


def margin_levels(margins: Array, group: Rows, groups: TrialGroups) -> MarginLevels:
    """Levels of the margins of scenes.

    A margin that is missing counts as the trial's mean.

    Args:
        margins: NaN where a simulation failed or was not asked for, shape (scenes, trials).
        group: of each scene, shape (scenes,).
        groups: of trials.
    """
    asked, known = groups.asked[group], np.isfinite(margins)
    in_motion = np.equal.outer(groups.motion, np.arange(groups.motions)).astype(np.float64)
    count = known.sum(axis=0)
    centre = np.where(count > 0, np.nansum(margins, axis=0) / np.maximum(count, 1), np.nan)
    deviations = np.where(known, margins - centre, 0.0)
    means = (deviations @ in_motion) / (asked @ in_motion)
    varied = np.ptp(means, axis=0) > 0
    common = means[:, varied].mean(axis=1) if varied.any() else np.zeros(len(margins))
    by_motion = np.where(varied, means - common[:, None], 0.0)
    by_trial = []
    for k, own in enumerate(groups.asked):
        scenes, trials = np.flatnonzero(group == k), np.flatnonzero(own)
        motion = groups.motion[trials]
        rest = deviations[np.ix_(scenes, trials)] - means[np.ix_(scenes, motion)]
        counted = varied[motion]
        free = int(counted.sum() - np.unique(motion[counted]).size)
        by_trial.append(GroupMargins(scenes, trials, np.where(counted, rest, 0.0), free))
    return MarginLevels(
        groups, group, centre, deviations, common, by_motion, varied, tuple(by_trial)
    )
