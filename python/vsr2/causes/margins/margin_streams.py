"""Streams of random numbers of a search for causes."""

from __future__ import annotations

from enum import IntEnum, unique


@unique
class MarginStream(IntEnum):
    """What a stream of a search for causes is drawn for; no diagnosis draws beside it."""

    SCENES = 101
    """Scenes of the prior."""
    ROUNDS = 102
    """Scenes of the posterior of the time."""
    FOLDS = 103
    """What acts, by the motions of the other folds."""
    ACTING = 104
    """What acts, by all outcomes."""
    CORRECTED = 105
    """Which particles become corrected scenes."""
