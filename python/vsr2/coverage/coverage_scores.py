"""Ranks, coverage and reliability over planted campaigns: shares with exact intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis.intervals import (
    INTERVALS,
    Score,
    calibration_error,
    calibration_noise,
    proportion,
)
from vsr2.analysis.ranks import Uniformity, uniformity
from vsr2.coverage.judged import Judged
from vsr2.errors import DiagnosisError

LEVELS = (0.5, 0.8, 0.9, 0.95)
"""Of the central intervals whose coverage is counted."""


@dataclass(frozen=True, eq=False)
class ParameterScore:
    """One parameter of an effect, or all together.

    Attributes:
        effect, parameter: whose; empty: all together.
        ranks: of the true values, shape (n,).
        uniformity: of these.
        p_adjusted: its p value among those of all parameters, by Holm (1979); of all together, as
            it is.
        covered: share of true values in the central intervals of `LEVELS`.
    """

    effect: str
    parameter: str
    ranks: NDArray[np.float64]
    uniformity: Uniformity
    p_adjusted: float
    covered: tuple[Score, ...]


@dataclass(frozen=True)
class ReliabilityGroup:
    """Campaigns whose answer has about one probability.

    Attributes:
        low, high: ends of the stated probability [1].
        stated: its mean [1].
        right: share that is right.
    """

    low: float
    high: float
    stated: float
    right: Score


@dataclass(frozen=True, eq=False)
class CoverageScores:
    """What planted campaigns say of a posterior.

    Attributes:
        parameters: of each effect's parameter that was planted.
        together: all parameters; None: no effect was planted that the library has.
        causes: share of 90 % sets of causes that hold a true one.
        set_size: labels in these sets, the median.
        stated: mean probability of the most probable answer [1].
        right: share of these that are right.
        reliability: the same in groups of the stated probability.
        error: calibration error of these groups, and what true probabilities would get.
    """

    parameters: tuple[ParameterScore, ...]
    together: ParameterScore | None
    causes: Score
    set_size: float
    stated: float
    right: Score
    reliability: tuple[ReliabilityGroup, ...]
    error: tuple[float, Score]

    @property
    def not_uniform(self) -> tuple[ParameterScore, ...]:
        """Parameters whose ranks are not uniform, at 5 % among all."""
        return tuple(one for one in self.parameters if one.p_adjusted < 1 - INTERVALS.level)


def coverage_scores(judged: Sequence[Judged]) -> CoverageScores:
    """Count what the answers hold.

    Args:
        judged: planted campaigns, each drawn by itself from the prior.

    Raises:
        DiagnosisError: there are none.
    """
    if not judged:
        raise DiagnosisError("no campaign was planted; plant at least one")
    groups: dict[tuple[str, str], list[float]] = {}
    for campaign in judged:
        for one in campaign.ranks:
            groups.setdefault((one.effect, one.parameter), []).append(one.rank)
    found = {key: np.array(ranks) for key, ranks in sorted(groups.items())}
    tests = {key: uniformity(ranks) for key, ranks in found.items()}
    adjusted = dict(zip(tests, _adjusted([one.p_value for one in tests.values()]), strict=True))
    everything = np.concatenate(list(found.values())) if found else np.empty(0)
    stated = np.array([one.stated for one in judged])
    right = np.array([one.right for one in judged], dtype=np.float64)
    return CoverageScores(
        parameters=tuple(
            ParameterScore(*key, ranks, tests[key], adjusted[key], covered(ranks))
            for key, ranks in found.items()
        ),
        together=_together(everything) if everything.size else None,
        causes=proportion(sum(one.held for one in judged), len(judged)),
        set_size=float(np.median([one.size for one in judged])),
        stated=float(stated.mean()),
        right=proportion(int(right.sum()), len(judged)),
        reliability=_reliability(stated, right),
        error=(
            float(calibration_error(np.stack([stated, right], axis=-1)[None])[0]),
            calibration_noise(stated),
        ),
    )


def covered(ranks: NDArray[np.float64]) -> tuple[Score, ...]:
    """Share of true values within the central intervals of `LEVELS`, from their ranks."""
    # A truth lies between two opposite quantiles where its rank lies between their levels.
    return tuple(
        proportion(int((np.abs(2 * ranks - 1) <= level).sum()), ranks.size) for level in LEVELS
    )


def _adjusted(p_values: Sequence[float]) -> list[float]:
    """P values adjusted for their number (Holm), so that any below 5 % is one chance in twenty."""
    from statsmodels.stats.multitest import multipletests

    return [float(p) for p in multipletests(p_values, method="holm")[1]] if p_values else []


def _together(ranks: NDArray[np.float64]) -> ParameterScore:
    test = uniformity(ranks)
    return ParameterScore("", "", ranks, test, test.p_value, covered(ranks))


def _reliability(
    stated: NDArray[np.float64], right: NDArray[np.float64]
) -> tuple[ReliabilityGroup, ...]:
    bins = INTERVALS.bins
    place = np.minimum((stated * bins).astype(int), bins - 1)
    return tuple(
        ReliabilityGroup(
            k / bins,
            (k + 1) / bins,
            float(stated[place == k].mean()),
            proportion(int(right[place == k].sum()), int((place == k).sum())),
        )
        for k in sorted(set(place.tolist()))
    )
