"""By how much two correct simulators differ beyond their contact models.

A campaign never comes from the diagnosis' own engine: at best from nature, in blind packs from
another engine that solves the same mechanics. Contact models are drawn for each simulated campaign
(:mod:`vsr2.ensemble.simulated.contact_family`). What differs beyond them is a disturbance that a
campaign, the trials of a motion, and single trials have in common; its size is drawn for each
campaign, so that it is a nuisance like others (M. C. Kennedy and A. O'Hagan, "Bayesian calibration
of computer models", J. R. Stat. Soc. B 63, 2001, call it model discrepancy).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from vsr2.posterior.moments import Moments
from vsr2.posterior.summaries import Floats, Standard

Array = NDArray[np.float64]
_Float = TypeVar("_Float", bound=np.floating[Any])


@dataclass(frozen=True)
class DiscrepancyConstants:
    """Size of the disturbance.

    Attributes:
        parts: of the logarithm of the largest tilt, common to a campaign, to the trials of a
            motion, and of single trials: as measured between Bullet and MuJoCo on a block with one
            contact model each.
        least, most: ends of a factor on them, log-uniform. It is below 1, because contact models
            are drawn besides and explain a part of the difference: beyond them and nuisances, the
            gap-free campaigns of a blind round lie at about 0.1 in Bullet and 0.25 in MuJoCo.
        outcome: disturbance of an outcome, in standard deviations of what decides it, over that of
            the logarithm of the tilt; one in fourteen outcomes then differs at a factor of 1.
        series: deviation of other features over their scatter, at a factor of 1, so that it is
            0.6 for those campaigns in MuJoCo.
        common: correlation of a feature's disturbance with that of the tilt.
        least_probability: of either outcome, so that a disturbance may turn it; chosen by hand.
    """

    parts: tuple[float, float, float] = (0.02, 0.05, 0.08)
    least: float = 0.05
    most: float = 0.5
    outcome: float = 5.2
    series: float = 2.5
    common: float = 0.7
    least_probability: float = 1e-4


DISCREPANCY = DiscrepancyConstants()


def disturbed(
    overturned: Array,
    features: NDArray[_Float],
    probability: Array,
    scatter: Array,
    motion: NDArray[np.int64],
    rng: np.random.Generator,
) -> tuple[Array, NDArray[_Float], Array]:
    """Campaigns as another correct simulator would have them.

    An outcome is 1 where a standard normal variable exceeds a threshold that follows from the
    trial's probability; the disturbance shifts that variable. What an outcome that turns had of
    features is not known any more.

    Args:
        overturned: 1, 0, or NaN where unknown, shape (n, trials).
        features: shape (n, trials, k), the first the logarithm of the largest tilt; k may be 0.
        probability: of overturning in campaigns without effect, shape (trials,).
        scatter: standard deviations of features there, shape (trials, k).
        motion: index of each trial's ground motion, shape (trials,).
        rng: of the differences.

    Returns:
        Outcomes; features in the precision of those given; by which factor on
        `DISCREPANCY.parts` each campaign is disturbed, shape (n,).
    """
    from scipy.special import ndtri

    count, trials = overturned.shape
    low, high = np.log(DISCREPANCY.least), np.log(DISCREPANCY.most)
    factor = np.exp(rng.uniform(low, high, (count, 1)))

    def drawn() -> Array:
        campaign, by_motion, single = DISCREPANCY.parts
        out = campaign * rng.standard_normal((count, 1))
        out = out + by_motion * rng.standard_normal((count, int(motion.max()) + 1))[:, motion]
        return np.asarray(factor * (out + single * rng.standard_normal((count, trials))))

    shift = drawn()
    least = DISCREPANCY.least_probability
    p = np.clip(probability, least, 1 - least)
    u = rng.uniform(1e-6, 1 - 1e-6, (count, trials))
    latent = ndtri(np.where(overturned > 0.5, 1 - p * u, (1 - p) * u))
    turned = latent + DISCREPANCY.outcome * shift > ndtri(1 - p)
    outcome = np.where(np.isnan(overturned), np.nan, turned)
    out = np.array(features)
    unit = np.linalg.norm(DISCREPANCY.parts)
    for k in range(features.shape[-1]):
        if k == 0:
            out[..., k] += shift
            continue
        own = np.sqrt(1 - DISCREPANCY.common**2)
        mixed = (DISCREPANCY.common * shift + own * drawn()) / unit
        out[..., k] += DISCREPANCY.series * scatter[:, k] * mixed
    out[(outcome != overturned) & ~np.isnan(overturned)] = np.nan
    return outcome, out, factor[:, 0]


@dataclass(frozen=True, eq=False)
class Disturbance:
    """What campaigns of one protocol are disturbed by: see :func:`disturbed`.

    Attributes:
        probability: of overturning in campaigns without effect, shape (trials,).
        scatter: standard deviations of features there, shape (trials, k).
        motion: index of each trial's ground motion, shape (trials,).
    """

    probability: Array
    scatter: Array
    motion: NDArray[np.int64]

    @classmethod
    def of(cls, overturned: Array, features: Floats, motion: NDArray[np.int64]) -> Disturbance:
        """From campaigns without effect, shapes (n, trials) and (n, trials, k)."""
        plain = np.ones(len(overturned), dtype=bool)
        # What no campaign without an effect varies, as a contradiction, no engine does.
        scatter = np.sqrt(Moments.of(features).variance)
        return cls(Standard.of(overturned, features, plain).probability, scatter, motion)

    def __call__(
        self, overturned: Array, features: NDArray[_Float], rng: np.random.Generator
    ) -> tuple[Array, NDArray[_Float], Array]:
        """Outcomes and features of campaigns, disturbed, and by which factors."""
        return disturbed(overturned, features, self.probability, self.scatter, self.motion, rng)
