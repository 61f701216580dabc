"""What a campaign shakes with: motions, amplitudes, order and sessions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.blind.mujoco import GroundMotion, ground_motion
from vsr2.blind.shake import Engine, Shake

Array = NDArray[np.float64]

SPREAD = (-0.55, 0.4)
"""Of ln PGA about a motion's overturning PGA, within a campaign."""
SHIFT = 0.12
"""Standard deviation of what a campaign adds to it, so that the overturn rate tells nothing."""


@dataclass(frozen=True)
class Row:
    """One trial of a design.

    Attributes:
        motion: position in the catalogue.
        pga: peak acceleration of the table [m/s^2].
        session: 0 to sessions - 1.
    """

    motion: int
    pga: float
    session: int


def catalogue(seed: int, count: int) -> list[GroundMotion]:
    """Ground motions, each from its own seed."""
    return [
        ground_motion(f"M{i + 1:02d}", np.random.default_rng([seed, 101, i])) for i in range(count)
    ]


def overturning_pga(engine: Engine, motion: GroundMotion) -> float:
    """About the PGA at which the nominal body overturns in this motion [m/s^2].

    The outcome is no monotonic function of PGA near there: the first of steps of 12 % from the
    static threshold at which it overturns, at most 3.1 times that.
    """
    low = engine.static_pga
    for step in range(10):
        pga = low * 1.12**step
        shake = Shake(motion.interval, motion.displacement * pga)
        if next(iter(engine.run([shake], 1.0))).overturned:
            return pga
    return low * 1.12**10


def draw_design(
    rng: np.random.Generator,
    thresholds: Sequence[float],
    trials: int,
    motions: int,
    sessions: int,
) -> list[Row]:
    """A campaign in the order of execution.

    A random part of the catalogue is used; each motion is run in two blocks of rising PGA at
    random places, so that neither order nor session goes with the motion.

    Args:
        rng: of the campaign.
        thresholds: overturning PGA of each motion of the catalogue [m/s^2].
        trials: number of them.
        motions: number of ground motions.
        sessions: number of them.
    """
    chosen = rng.permutation(len(thresholds))[:motions]
    shift = SHIFT * rng.standard_normal()
    counts = [trials // motions + (i < trials % motions) for i in range(motions)]
    blocks: list[list[tuple[int, float]]] = []
    for motion, count in zip(chosen, counts, strict=True):
        # Stratified, so that every motion is run below and above its threshold.
        place = (np.arange(count) + rng.random(count)) / count
        level = SPREAD[0] + (SPREAD[1] - SPREAD[0]) * place + shift
        pga = [round(thresholds[motion] * math.exp(value), 3) for value in level]
        half = rng.permutation(count) < count // 2
        for part in (half, ~half):
            block = [(int(motion), value) for value, kept in zip(pga, part, strict=True) if kept]
            if block:
                blocks.append(block)
    order = [entry for i in rng.permutation(len(blocks)) for entry in blocks[i]]
    return [
        Row(motion, pga, min(sessions - 1, i * sessions // len(order)))
        for i, (motion, pga) in enumerate(order)
    ]
