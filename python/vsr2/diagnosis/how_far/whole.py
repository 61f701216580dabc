"""Losses of all trials of a campaign: those kept, as judged, and those dropped, as simulated.

Gap, closure and headline are of these. Of a dropped trial only the outcome counts.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.how_far.dropped import Dropped
from vsr2.diagnosis.how_far.shrinkage import Shrinkage, resampled_means, rescaled
from vsr2.diagnosis.observed.observations import Observations

Array = NDArray[np.float64]


class Whole:
    """Losses and predictions of every trial, with intervals over resampled motions.

    Args:
        seen: the observed campaign.
        kept: indices of the kept trials.
        floor: of the kept trials.
        shrinkage: their held-out losses.
        dropped: probabilities of the others.
        gap_low: lower end of the gap's interval of the kept trials by simulated campaigns.

    Attributes:
        placebos: the placebo of each group.
        turned: number of dropped trials that do otherwise with the chosen effect, and only with it.
    """

    def __init__(
        self,
        seen: Observations,
        kept: NDArray[np.int64],
        floor: Array,
        shrinkage: Shrinkage,
        dropped: Dropped,
        gap_low: float,
    ) -> None:
        self._seen = seen
        self._kept = kept
        self.placebos = shrinkage.chosen["placebo"]
        self.turned = int((dropped.certain & (dropped.after != dropped.before)).sum())
        self._gap_low = gap_low * kept.size / len(seen)
        y = seen.overturned[dropped.trials]
        places = np.searchsorted(np.unique(shrinkage.group), dropped.group)
        own = {
            "before": dropped.before,
            "after": dropped.after,
            "placebo": dropped.placebo,
            "recalibrated": rescaled(dropped.before, shrinkage.scaling[places].T),
        }
        rest = {name: _loss(p, y) for name, p in own.items()}
        for name in shrinkage.each:
            # As without effect where it was not chosen, and so not simulated.
            rest[name] = rest["before"].copy()
            for role in ("placebo", "after"):
                chosen = np.array(shrinkage.chosen[role])[places] == name
                rest[name][chosen] = rest[role][chosen]
        p = dropped.before
        # What always ends alike does so again where there is no gap.
        alike = -np.log(np.maximum(p, 1 - p))
        entropy = -p * np.log(p) - (1 - p) * np.log1p(-p)
        rest["floor"] = np.where(dropped.certain, alike, entropy)
        parts = {
            "before": shrinkage.before,
            "after": shrinkage.after,
            "placebo": shrinkage.placebo,
            "recalibrated": shrinkage.recalibrated,
            "floor": floor,
            **shrinkage.each,
        }
        self._losses = {
            name: self._joined(values, rest[name], dropped) for name, values in parts.items()
        }
        self._before = self._joined(shrinkage.predicted_before, dropped.before, dropped)
        self._after = self._joined(shrinkage.predicted_after, dropped.after, dropped)
        self._names = list(self._losses)
        values = np.stack([self._losses[name] for name in self._names])
        self._means = values.mean(axis=1)
        self._draws = resampled_means(values, seen.motion)

    def _joined(self, kept: Array, rest: Array, dropped: Dropped) -> Array:
        out = np.zeros(len(self._seen))
        out[self._kept], out[dropped.trials] = kept, rest
        return out

    def _column(self, name: str) -> tuple[float, Array]:
        k = self._names.index(name)
        return float(self._means[k]), self._draws[:, k]

    def mean(self, name: str) -> dict[str, Any]:
        """Mean loss."""
        return _estimate(*self._column(name))

    def excess(self, name: str) -> dict[str, Any]:
        """Mean loss over the floor; the gap's interval is the wider of two, see `_gap_low`."""
        value, draws = self._column(name)
        floor, floors = self._column("floor")
        out = _estimate(value - floor, draws - floors)
        if name == "before":
            out["ci95"][0] = min(out["ci95"][0], self._gap_low)
        return out

    @property
    def touches_floor(self) -> bool:
        """Whether the gap's interval reaches down to zero."""
        gap = self.excess("before")
        return bool(gap["ci95"][0] <= 0 or gap["value"] <= 0)

    def closure(self, name: str) -> dict[str, Any]:
        """(before - model) / (before - floor); nothing where the gap's interval touches zero."""
        if self.touches_floor:
            return {"value": None, "ci95": None}
        before, befores = self._column("before")
        floor, floors = self._column("floor")
        value, draws = self._column(name)
        ratio = (befores - draws) / np.maximum(befores - floors, 1e-9)
        return _estimate((before - value) / (before - floor), ratio)

    def headline(self) -> dict[str, Any]:
        """Closure minus the better placebo's, or nothing's where both placebos make it worse."""
        if self.touches_floor:
            return {"value": None, "ci95": None}
        before, befores = self._column("before")
        floor, floors = self._column("floor")
        after, afters = self._column("after")
        options = [self._column(name) for name in ("placebo", "recalibrated")]
        best, bests = min(options, key=lambda option: option[0])
        best, bests = min(best, before), np.minimum(bests, befores)
        ratio = (bests - afters) / np.maximum(befores - floors, 1e-9)
        return _estimate((best - after) / (before - floor), ratio)

    @property
    def left(self) -> float:
        """Share of the gap that the chosen effect leaves."""
        before, after, floor = (self._column(n)[0] for n in ("before", "after", "floor"))
        return (after - floor) / max(before - floor, 1e-9)

    def rows(self) -> list[dict[str, Any]]:
        """One row a trial."""
        seen = self._seen
        kept = np.isin(np.arange(len(seen)), self._kept)
        return [
            {
                "trial": trial.trial,
                "motion": trial.motion,
                "session": trial.session,
                "order": trial.order,
                "log_pga": float(seen.log_pga[i]),
                "log_ratio": float(seen.log_ratio[i]),
                "overturned": int(seen.overturned[i]),
                "uncertain": int(kept[i]),
                "before": float(self._before[i]),
                "after": float(self._after[i]),
                "loss_before": float(self._losses["before"][i]),
                "loss_after": float(self._losses["after"][i]),
                "floor": float(self._losses["floor"][i]),
            }
            for i, trial in enumerate(seen.campaign.trials)
        ]


def _estimate(value: float, draws: Array) -> dict[str, Any]:
    low, high = np.quantile(draws, [0.025, 0.975])
    return {"value": value, "ci95": [float(low), float(high)]}


def _loss(probability: Array, outcome: Array) -> Array:
    return np.asarray(-np.where(outcome > 0.5, np.log(probability), np.log1p(-probability)))
