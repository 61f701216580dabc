"""By how much two correct simulators of one response differ, beyond noise and nuisances.

A campaign never comes from the diagnosis' own engine: at best from nature, in blind packs from
another engine that solves the same mechanics. Two such engines differ in a trial's largest tilt,
and in what is read off its series, the same way in every campaign and in part alike in all trials
of a motion. A scan that knows one engine alone takes that for a location of the gap. Therefore the
campaigns without effect that it compares with are given differences of that size.

Of outcomes, see `DISCREPANCY` in :mod:`vsr2.diagnosis.likelihood.evidence`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DiscrepancyConstants:
    """Size of the differences, by `python studies/engine_discrepancy.py`.

    Attributes:
        variance: over the square of the emulator's scatter: two engines showed 0.85 at most
            (docs/results/engine_discrepancy.csv).
        common: share of it that the trials of a motion have in common: of largest tilts 0.22 and
            0.45 there.
    """

    variance: float = 1.0
    common: float = 0.3


DISCREPANCY = DiscrepancyConstants()


def disturbed(
    features: Array, scatter: Array, motion: NDArray[np.int64], rng: np.random.Generator
) -> Array:
    """Features as another simulator would have them.

    Args:
        features: shape (campaigns, trials, k).
        scatter: square of the emulator's, shape (trials, k).
        motion: index of each trial's ground motion, shape (trials,).
        rng: of the differences, drawn again for each campaign.
    """
    count, trials, k = features.shape
    own = rng.standard_normal((count, trials, k))
    common = rng.standard_normal((count, int(motion.max()) + 1, k))[:, motion]
    size = np.sqrt(DISCREPANCY.variance * scatter)
    out = features + size * (
        np.sqrt(1 - DISCREPANCY.common) * own + np.sqrt(DISCREPANCY.common) * common
    )
    return np.asarray(out, dtype=np.float64)
