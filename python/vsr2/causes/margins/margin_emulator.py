"""An emulator of margins: what they would be in a scene that was not simulated.

A Gaussian process over what acts in a scene (C. E. Rasmussen, C. K. I. Williams, "Gaussian
Processes for Machine Learning", 2006), in three levels: of all trials, of those of a motion, and of
single ones. So its error has a part that all trials share, and no number of trials tells that from
a stronger motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.causes.margins.margin_kernel import MarginKernel, fit_kernel, level_numbers
from vsr2.causes.margins.margin_levels import MarginLevel, MarginLevels, margin_levels
from vsr2.causes.margins.trial_groups import Rows, TrialGroups

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LevelProcess:
    """What an emulator knows at a level.

    Attributes:
        kernel: of margins.
        share: of the kernel.
        noise: variance of what features do not tell.
        scenes: weighted features of those it has seen, shape (s, features).
        inverse: of their covariance, shape (s, s).
        stretch: of its variance. The kernel of what all trials share is fitted to hundreds of other
            numbers beside these, so scenes left out say by how much more they err (F. Bachoc,
            "Cross validation and maximum likelihood estimations of hyper-parameters of Gaussian
            processes with model misspecification", Computational Statistics and Data Analysis 66,
            2013).
    """

    kernel: MarginKernel
    share: float
    noise: float
    scenes: Array
    inverse: Array
    stretch: float = 1.0

    def variance(self, weighted: Array) -> Array:
        """Of scenes, shape (n,).

        Args:
            weighted: features, shape (n, features).
        """
        crossed = self.share * self.kernel(weighted @ self.scenes.T)
        own = self.share * self.kernel((weighted**2).sum(axis=1))
        left = np.maximum(own - ((crossed @ self.inverse) * crossed).sum(axis=1), 0.0)
        return np.asarray(self.stretch * (left + self.noise))


@dataclass(frozen=True, eq=False)
class MarginEmulator:
    """Of all trials.

    Attributes:
        kernel: of margins.
        levels: of the margins that it rests on.
        features: of their scenes, shape (scenes, features).
        processes: by level; those that margins tell.
        coefficients: of the kernel between a scene and those seen, shape (scenes, trials).
        errors: of each scene's margins without it, NaN where it was not asked for them, shape
            (scenes, trials).
        expected: standard deviations of these, shape as theirs.
    """

    kernel: MarginKernel
    levels: MarginLevels
    features: Array
    processes: dict[MarginLevel, LevelProcess]
    coefficients: Array
    errors: Array
    expected: Array

    def __call__(self, features: Array, error: Array) -> tuple[Array, Array, Array]:
        """Mean of margins, and what they scatter by.

        Args:
            features: of scenes, shape (n, features).
            error: of the emulator that all trials share, in its standard deviations, shape (n,).

        Returns:
            Means, NaN of trials without a margin in any scene, shape (n, trials), and variances of
            what the trials of a motion share and of what each has alone, shapes (n,).
        """
        weighted = features * self.kernel.weights
        crossed = self.kernel(weighted @ (self.features * self.kernel.weights).T)
        common, by_motion, by_trial = (self._variance(level, weighted) for level in MarginLevel)
        mean = self.levels.centre + crossed @ self.coefficients
        return mean + (np.sqrt(common) * error)[:, None], by_motion, by_trial

    def quality(self) -> dict[str, float | None]:
        """How well it knows a scene that it did not see, over margins that differ between scenes.

        None where none do.
        """
        found: dict[str, float | None] = {"used": len(self.features)}
        found |= dict.fromkeys(("spread", "error", "error_over_expected"))
        asked = np.isfinite(self.errors)
        if asked.any():
            over = (self.errors / self.expected)[asked]
            found["spread"] = float(np.sqrt((self.levels.deviations[asked] ** 2).mean()))
            found["error"] = float(np.sqrt((self.errors[asked] ** 2).mean()))
            found["error_over_expected"] = float(np.sqrt((over**2).mean()))
        return found | {"noise": float(np.sqrt((self.kernel.noise**2).sum()))}

    def _variance(self, level: MarginLevel, weighted: Array) -> Array:
        if level not in self.processes:
            return np.zeros(len(weighted))
        return self.processes[level].variance(weighted)


def fit_emulator(
    features: Array, margins: Array, group: Rows, groups: TrialGroups
) -> MarginEmulator:
    """The most probable emulator of simulated scenes.

    Args:
        features: of the scenes, 0 where nothing acts, shape (scenes, features).
        margins: NaN where a simulation failed or was not asked for, shape (scenes, trials).
        group: of trials that each scene was asked for, shape (scenes,).
        groups: of trials.
    """
    levels = margin_levels(margins, group, groups)
    return emulator_of(fit_kernel(features, levels), features, levels)


def emulator_of(kernel: MarginKernel, features: Array, levels: MarginLevels) -> MarginEmulator:
    """With a given kernel.

    Errors of scenes left out are in closed form (Rasmussen and Williams, section 5.4.2).

    Args:
        kernel: of margins.
        features: of the scenes, shape (scenes, features).
        levels: of their margins.
    """
    weighted = features * kernel.weights
    scenes = kernel(weighted @ weighted.T)
    asked = levels.groups.asked[levels.group]
    coefficients, errors, variances = np.zeros((3, *asked.shape))
    processes: dict[MarginLevel, LevelProcess] = {}
    for part in level_numbers(levels):
        rows, level = part.rows, part.level
        covariance = part.covariance(scenes[np.ix_(rows, rows)], kernel.shares, kernel.noise)
        inverse = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
        solved, left = inverse @ part.numbers, np.diag(inverse)[:, None]
        share, noise = float(kernel.shares[level]), float(kernel.noise[level] ** 2)
        stretch = max(1.0, float((solved**2 / left).mean())) if level == MarginLevel.ALL else 1.0
        process = LevelProcess(kernel, share, noise, weighted[rows], inverse, stretch)
        processes.setdefault(level, process)
        own = np.ix_(rows, part.trials)
        solved = solved[:, part.numbers_of]
        coefficients[own] += share * solved
        if level == MarginLevel.MOTION and MarginLevel.TRIAL in part.kernel:
            share = float(kernel.shares[MarginLevel.TRIAL])
            coefficients[own] += share / levels.asked_of_a_motion * asked[own] * solved
        errors[own] += solved / left
        variances[own] += part.seen * stretch / left
    differ = asked & levels.varied[levels.groups.motion]
    errors = np.where(differ, errors, np.nan)
    return MarginEmulator(
        kernel, levels, features, processes, coefficients, errors, np.sqrt(variances)
    )
