"""Streams of random numbers of a diagnosis: what is drawn for one purpose tells nothing of another.

What is simulated, and so what a cache of simulations holds, follows from most of them: another
number is another diagnosis. Nuisances (`simulator.quasi_random`) are the seed's own stream: a cache
of simulations knows them by their index alone, so that it holds what was drawn with the bare seed.
"""

from __future__ import annotations

from enum import IntEnum, unique

import numpy as np


@unique
class Stream(IntEnum):
    """What a stream is drawn for."""

    LOCATIONS = 5
    """Outcomes dealt again over trials, against which conditions are judged."""
    TABLE_MOTION = 8
    """Noise of the table's motion where nothing is wrong with it."""
    LOOK = 21
    """Values of effects by which detection limits are sought."""
    CAUSES = 22
    """What acts in a simulated campaign."""
    DECK = 23
    """Order in which effects take their turn to act."""
    WEIGHTS = 31
    """First weights of a network, and passes of its training."""
    COPIES = 32
    """Disturbed copies of simulated campaigns."""
    PARTS = 33
    """Networks of parts of the library."""
    PARAMETERS = 41
    """Samples of parameters of which estimates are made."""
    HELD_OUT_PARAMETERS = 42
    """Samples of parameters by the trials of other motions, a part for each group of motions."""
    DEALT = 51
    """Changes of probabilities dealt over trials of like intensity."""
    WATERFALL = 61
    """Sets of effects from the posterior of some trials."""
    RANKS = 62
    """Parts equal samples."""
    PLANTED_COPIES = 63
    """Disturbance of planted campaigns."""
    PLANTED = 64
    """Which campaigns are planted."""
    SCENE_EFFECTS = 71
    """Draws of the effects that the scene itself has."""
    REFERENCE = 72
    """Noise of tilts beside a reference campaign."""
    TRAINING_NOISE = 81
    """Noise of simulated measurements on which is trained."""
    BEFORE_NOISE = 82
    """The same of the model as it is."""
    HELD_OUT_NOISE = 83
    """The same of trials that neither fit nor choice saw."""
    WATERFALL_NOISE = 84
    """The same with some of the causes; equal for each choice of them."""
    PLANTED_NOISE = 85
    """The same of planted campaigns."""
    CORRECTED = 91
    """Corrected scenes."""


def generator(seed: int, stream: Stream, *index: int) -> np.random.Generator:
    """Of a stream; with further numbers, of one of its parts."""
    return np.random.default_rng([seed, stream, *index])
