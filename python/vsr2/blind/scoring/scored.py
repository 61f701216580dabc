"""Scores of packs as plain data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from vsr2.analysis.intervals import INTERVALS, Score
from vsr2.blind.scoring.baselines import BASELINE, BASELINES
from vsr2.blind.scoring.cases import ALL, GROUPS, Case
from vsr2.blind.scoring.leaks import LEAKS, Leak
from vsr2.blind.scoring.metadata import METADATA
from vsr2.blind.scoring.score import (
    BEST_HIGH,
    BEST_LOW,
    SCORING,
    ScoreCode,
    Scores,
    detected,
    is_named,
    right,
)


@dataclass(frozen=True, eq=False)
class Scored:
    """What scoring a pack gave.

    Attributes:
        scores: by tier, or name of a trivial baseline, and group.
        rates: how well the overturn rate alone predicts kinds, one for each pack.
        cases: one a campaign and tier.
        development: whether the pack is open.
        leaks: how well metadata predict engine, kind and class, one list for each pack.
    """

    scores: Mapping[tuple[str, str], Scores]
    rates: Sequence[Mapping[str, Score]]
    cases: Sequence[Case]
    development: bool
    leaks: Sequence[Sequence[Leak]] = ()

    @property
    def columns(self) -> list[str]:
        """Tiers, then the trivial baselines."""
        known = {column for column, _ in self.scores}
        return [*sorted(known - BASELINES.keys()), *(name for name in BASELINES if name in known)]

    @property
    def groups(self) -> list[str]:
        """Of campaigns: all first, the others by name."""
        return sorted({group for _, group in self.scores}, key=lambda name: (name != ALL, name))

    def margins(self, score: ScoreCode, group: str = ALL) -> dict[str, float]:
        """By tier, how much better a score is than the best baseline's; {} without baselines."""
        sign = -1.0 if score in BEST_LOW else 1.0
        found = {
            column: sign * own[score].value
            for column in self.columns
            if score in (own := self.scores.get((column, group), {}))
        }
        best = max((found.pop(name) for name in BASELINES if name in found), default=None)
        return {} if best is None else {tier: value - best for tier, value in found.items()}

    def to_json(self) -> dict[str, Any]:
        """Plain data; single campaigns of an open pack only."""
        out: dict[str, Any] = {
            "scores": [
                {"tier": tier, "group": group, "score": str(code), **_plain(score)}
                for (tier, group), scores in self.scores.items()
                for code, score in scores.items()
            ],
            "rates": [{kind: _plain(score) for kind, score in one.items()} for one in self.rates],
            "above_baselines": [
                {"group": group, "score": str(score), "tier": tier, "value": round(value, 6)}
                for group in self.groups
                for score in (*BEST_HIGH, *BEST_LOW)
                for tier, value in self.margins(score, group).items()
            ],
            "leaks": [[asdict(leak) for leak in one] for one in self.leaks],
            "constants": {
                "scoring": asdict(SCORING),
                "groups": asdict(GROUPS),
                "intervals": asdict(INTERVALS),
                "baselines": asdict(BASELINE),
                "leaks": asdict(LEAKS),
                "metadata": asdict(METADATA),
            },
        }
        if self.development:
            out["campaigns"] = [
                {
                    "id": case.id,
                    "tier": case.tier,
                    "kind": case.kind,
                    "engine": case.engine,
                    "truth": [dict(effect) for effect in case.effects],
                    "verdict": case.verdict.kind,
                    "effects": list(case.verdict.effects),
                    "failed": failed and failed.model_dump(mode="json"),
                    "named": is_named(case),
                    "right": right(case),
                    "detected": detected(case),
                }
                for case in self.cases
                for failed in (case.verdict.failed,)
            ]
        return out


def _plain(score: Score) -> dict[str, float | int | None]:
    def finite(value: float) -> float | None:
        return round(float(value), 6) if math.isfinite(value) else None

    return {
        "value": finite(score.value),
        "low": finite(score.low),
        "high": finite(score.high),
        "campaigns": score.count,
    }
