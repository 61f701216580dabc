"""How alike the margins of two scenes are: the kernel of an emulator, and its fit.

The kernel holds effects, their squares and their products two by two: k(x, y) = s^2 + w.x.y +
c (w.x.y)^2, with the sum over features weighted. Most effects matter little: weights have an
exponential prior. All trials, motions and levels share it (for several outputs with one kernel, S.
Conti, A. O'Hagan, "Bayesian emulation of complex multi-output and dynamic computer models", Journal
of Statistical Planning and Inference 140, 2010). Each level has its share of it and its own noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vsr2.causes.margins.margin_levels import MarginLevel, MarginLevels
from vsr2.causes.margins.trial_groups import Rows

Array = NDArray[np.float64]


@dataclass(frozen=True)
class KernelConstants:
    """How a kernel is fitted; chosen by hand, judged by scenes left out one by one.

    Attributes:
        weight: mean of the prior of a feature's weight, in margin for each unit of it.
        evidence: number of trials that the weights' prior counts as.
        start: weight, constant and noise from which the fit begins; its product begins from 1.
        weights, products, constants, noises: ends of their logarithms.
        shares: ends of the logarithm of a level's share over that of the last one.
        steps: of the fit at most.
    """

    weight: float = 0.1
    evidence: float = 3.0
    start: float = 0.1
    weights: tuple[float, float] = (-9.0, 1.0)
    products: tuple[float, float] = (-4.0, 6.0)
    constants: tuple[float, float] = (-5.0, 1.0)
    noises: tuple[float, float] = (-4.0, 0.0)
    shares: tuple[float, float] = (-4.0, 4.0)
    steps: int = 500


KERNEL = KernelConstants()


@dataclass(frozen=True, eq=False)
class MarginKernel:
    """Of margins.

    Attributes:
        weights: of the features, shape (features,).
        product: c of the kernel.
        constant: s of the kernel.
        shares: of the kernel, by level; 0 where margins do not tell a level, shape (levels,).
        noise: standard deviation of what features do not tell, by level: chaos, and interactions
            of more than two effects, shape (levels,).
    """

    weights: Array
    product: float
    constant: float
    shares: Array
    noise: Array

    def __call__(self, products: Array) -> Array:
        """Of weighted products of features, shape as given."""
        return np.asarray(self.constant**2 + products + self.product * products**2)


@dataclass(frozen=True, eq=False)
class LevelNumbers:
    """Numbers of scenes that have one covariance.

    Attributes:
        level: that they are of.
        rows: of the scenes, shape (s,).
        numbers: of each scene, shape (s, k).
        trials: that they belong to, shape (t,).
        numbers_of: the number of each of these, shape (t,).
        count: of numbers of a scene that are independent.
        kernel: what multiplies the share of a level, a number or of shape (s, s).
        diagonal: what multiplies the squared noise of a level.
        seen: share of the covariance that each trial has: less than all of it where a mean over
            trials is taken off them, shape (t,).
    """

    level: MarginLevel
    rows: Rows
    numbers: Array
    trials: Rows
    numbers_of: Rows
    count: int
    kernel: Mapping[MarginLevel, Array | float]
    diagonal: Mapping[MarginLevel, float]
    seen: Array | float = 1.0

    @cached_property
    def squares(self) -> Array:
        """Y Y' of the numbers Y, shape (s, s)."""
        return np.asarray(self.numbers @ self.numbers.T)

    def covariance(self, kernel: Array, shares: Array, noise: Array) -> Array:
        """Of the numbers, shape (s, s).

        Args:
            kernel: between the scenes, shape (s, s).
            shares: of the levels.
            noise: of the levels.
        """
        weight = sum(shares[level] * mask for level, mask in self.kernel.items())
        noises = sum(factor * noise[level] ** 2 for level, factor in self.diagonal.items())
        return np.asarray(weight * kernel + noises * np.eye(len(kernel)))


def level_numbers(levels: MarginLevels) -> Iterator[LevelNumbers]:
    """Of margins, by level; levels that they do not tell are left out.

    The mean over the trials of a motion holds a part of what its trials add, which is common to
    scenes that were asked for the same trials.
    """
    rows, motions = np.arange(len(levels)), int(levels.varied.sum())
    motion = levels.groups.motion
    trials = np.arange(motion.size)
    by_trial = [one for one in levels.by_trial if one.free and one.scenes.size]
    if motions:
        yield LevelNumbers(
            MarginLevel.ALL, rows, levels.common[:, None], trials, np.zeros_like(trials), count=1,
            kernel={MarginLevel.ALL: 1.0}, diagonal={MarginLevel.ALL: 1.0},
        )  # fmt: skip
    if motions > 1:
        kernel: dict[MarginLevel, Array | float] = {MarginLevel.MOTION: 1.0}
        diagonal = {MarginLevel.MOTION: 1.0}
        if by_trial:
            kernel[MarginLevel.TRIAL] = levels.same_group / levels.asked_of_a_motion
            diagonal[MarginLevel.TRIAL] = 1 / levels.asked_of_a_motion
        yield LevelNumbers(
            MarginLevel.MOTION, rows, levels.by_motion, trials, motion, count=motions - 1,
            kernel=kernel, diagonal=diagonal,
        )  # fmt: skip
    for one in by_trial:
        of_motion = motion[one.trials]
        yield LevelNumbers(
            MarginLevel.TRIAL, one.scenes, one.deviations, one.trials, np.arange(one.trials.size),
            count=one.free, kernel={MarginLevel.TRIAL: 1.0}, diagonal={MarginLevel.TRIAL: 1.0},
            seen=1 - 1 / np.bincount(of_motion)[of_motion],
        )  # fmt: skip


def fit_kernel(features: Array, levels: MarginLevels) -> MarginKernel:
    """The most probable kernel.

    Args:
        features: of the scenes, 0 where nothing acts, shape (scenes, features).
        levels: of their margins.
    """
    from scipy.optimize import minimize

    loss = KernelLoss(features, tuple(level_numbers(levels)))
    found = minimize(
        loss, loss.start(), jac=True, method="L-BFGS-B", bounds=loss.ends(),
        options={"maxiter": KERNEL.steps},
    )  # fmt: skip
    return loss.kernel(found.x)


@dataclass(frozen=True, eq=False)
class KernelLoss:
    """Negative logarithm of the evidence and of the prior.

    Its arguments are logarithms: of weights, product and constant, of the shares of the levels that
    they have over that of the last one, and of the noise of each of these.

    Attributes:
        features: of the scenes, shape (scenes, features).
        parts: of their margins.
    """

    features: Array
    parts: tuple[LevelNumbers, ...]

    @cached_property
    def held(self) -> list[MarginLevel]:
        """Levels that the margins have."""
        return sorted({one.level for one in self.parts})

    def start(self) -> Array:
        """Where the fit begins."""
        log = np.log(KERNEL.start)
        features, levels = self.features.shape[1], len(self.held)
        shares = np.zeros(max(levels - 1, 0))
        return np.concatenate([np.full(features, log), [0.0, log], shares, np.full(levels, log)])

    def ends(self) -> list[tuple[float, float]]:
        """Of the arguments."""
        levels = len(self.held)
        return [
            *[KERNEL.weights] * self.features.shape[1], KERNEL.products, KERNEL.constants,
            *[KERNEL.shares] * max(levels - 1, 0), *[KERNEL.noises] * levels,
        ]  # fmt: skip

    def kernel(self, logs: Array) -> MarginKernel:
        """That arguments stand for."""
        count, levels = self.features.shape[1], len(self.held)
        product, constant = np.exp(logs[count : count + 2])
        shares, noise = np.zeros(len(MarginLevel)), np.zeros(len(MarginLevel))
        if levels:
            over = np.exp(np.r_[logs[count + 2 : count + 1 + levels], 0.0])
            shares[self.held], noise[self.held] = over / over.sum(), np.exp(logs[-levels:])
        return MarginKernel(np.exp(logs[:count]), product, constant, shares, noise)

    def __call__(self, logs: Array) -> tuple[float, Array]:
        """Loss and its gradient."""
        kernel = self.kernel(logs)
        weighted = self.features * kernel.weights
        products = weighted @ weighted.T
        scenes = kernel(products)
        prior = KERNEL.evidence * kernel.weights / KERNEL.weight
        value = float(prior.sum())
        by_scenes = np.zeros_like(scenes)
        by_share, by_noise = np.zeros(len(MarginLevel)), np.zeros(len(MarginLevel))
        for part in self.parts:
            own = np.ix_(part.rows, part.rows)
            covariance = part.covariance(scenes[own], kernel.shares, kernel.noise)
            try:
                factor = np.linalg.cholesky(covariance)
            except np.linalg.LinAlgError:
                return 1e12, np.zeros_like(logs)
            inverse = np.linalg.inv(covariance)
            value += 0.5 * float((inverse * part.squares).sum())
            value += part.count * float(np.log(np.diag(factor)).sum())
            by_covariance = 0.5 * (part.count * inverse - inverse @ part.squares @ inverse)
            for level, mask in part.kernel.items():
                by_kernel = mask * by_covariance
                by_scenes[own] += kernel.shares[level] * by_kernel
                by_share[level] += (by_kernel * scenes[own]).sum()
            for level, factor_of in part.diagonal.items():
                by_noise[level] += factor_of * np.trace(by_covariance)
        by_products = by_scenes * (1 + 2 * kernel.product * products)
        # Shares sum to 1: what one gains, the others lose.
        by_share = kernel.shares * (by_share - kernel.shares @ by_share)
        gradient = np.concatenate(
            [
                2 * ((by_products @ weighted) * weighted).sum(axis=0) + prior,
                [
                    kernel.product * (by_scenes * products**2).sum(),
                    2 * kernel.constant**2 * by_scenes.sum(),
                ],
                by_share[self.held][:-1],
                2 * kernel.noise[self.held] ** 2 * by_noise[self.held],
            ]
        )
        return value, gradient
