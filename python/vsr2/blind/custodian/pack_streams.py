"""Streams of random numbers of a pack: what is drawn for one purpose tells nothing of another."""

from __future__ import annotations

from enum import IntEnum, unique

import numpy as np


@unique
class PackStream(IntEnum):
    """What a stream is drawn for."""

    MOTIONS = 101
    """Ground motions, by their place in the catalogue."""
    SIGNAL_TRIALS = 202
    """Trials of the protocol by which detection limits are sought."""
    SIGNAL_REPLICATES = 203
    """Nuisances and starts of these trials, by replicate."""
    SIGNAL_VALUES = 204
    """Further parameters of an effect there."""
    SIGNAL_SEEDS = 205
    """What effects draw in these trials, by replicate."""
    PLAN = 301
    """Which effects act in which campaign."""
    CAMPAIGN = 401
    """Nuisances and starts of a campaign, by its place in the plan."""
    PROTOCOL = 402
    """Trials of a protocol."""
    CONTACT = 403
    """The contact model."""


def pack_generator(seed: int, stream: PackStream, *index: int) -> np.random.Generator:
    """Of a stream; with further numbers, of one of its parts."""
    return np.random.default_rng([seed, stream, *index])
