"""Losses of all trials of a campaign: those kept, as judged, and those screened out, as simulated.

Gap, closure and headline are of these. Of a screened-out trial only the outcome counts.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.how_far.held_out import HeldOutLosses, interval, resampled_means, rescaled
from vsr2.diagnosis.how_far.screened_out import ScreenedOut
from vsr2.diagnosis.observed.observations import Observations

Array = NDArray[np.float64]

NOT_GIVEN: dict[str, Any] = {"value": None, "ci95": None}
"""An estimate that does not exist."""


class CampaignLoss:
    """Losses and predictions of every trial, with intervals over resampled motions.

    Args:
        seen: the observed campaign.
        kept: indices of the kept trials.
        floor: of the kept trials.
        held_out: their held-out losses.
        screened_out: probabilities of the others.
        gap_low: lower end of the gap's interval of the kept trials by simulated campaigns.

    Attributes:
        negative_controls: the negative control of each group.
        changed: number of screened-out trials that do otherwise with the chosen effect alone.
    """

    def __init__(
        self,
        seen: Observations,
        kept: NDArray[np.int64],
        floor: Array,
        held_out: HeldOutLosses,
        screened_out: ScreenedOut,
        gap_low: float,
    ) -> None:
        self._seen = seen
        self._kept = kept
        self.negative_controls = held_out.chosen["negative_control"]
        self.changed = int(
            (screened_out.certain & (screened_out.after != screened_out.before)).sum()
        )
        self._gap_low = gap_low * kept.size / len(seen)
        y = seen.overturned[screened_out.trials]
        group = np.searchsorted(np.unique(held_out.group), screened_out.group)
        own = {
            "before": screened_out.before,
            "after": screened_out.after,
            "negative_control": screened_out.negative_control,
            "recalibrated": rescaled(screened_out.before, held_out.scaling[group].T),
        }
        rest = {name: _loss(p, y) for name, p in own.items()}
        for name in held_out.each:
            # As without effect where it was not chosen, and so not simulated.
            rest[name] = rest["before"].copy()
            for role in ("negative_control", "after"):
                chosen = np.array(held_out.chosen[role])[group] == name
                rest[name][chosen] = rest[role][chosen]
        p = screened_out.before
        # What always ends alike does so again where there is no gap.
        alike = -np.log(np.maximum(p, 1 - p))
        entropy = -p * np.log(p) - (1 - p) * np.log1p(-p)
        rest["floor"] = np.where(screened_out.certain, alike, entropy)
        parts = {
            "before": held_out.before,
            "after": held_out.after,
            "negative_control": held_out.negative_control,
            "recalibrated": held_out.recalibrated,
            "floor": floor,
            **held_out.each,
        }
        self._losses = {
            name: self._joined(values, rest[name], screened_out) for name, values in parts.items()
        }
        self._before = self._joined(held_out.predicted_before, screened_out.before, screened_out)
        self._after = self._joined(held_out.predicted_after, screened_out.after, screened_out)
        self._names = list(self._losses)
        values = np.stack([self._losses[name] for name in self._names])
        self._means = values.mean(axis=1)
        self._draws = resampled_means(values, seen.motion)

    def _joined(self, kept: Array, rest: Array, screened_out: ScreenedOut) -> Array:
        out = np.zeros(len(self._seen))
        out[self._kept], out[screened_out.trials] = kept, rest
        return out

    def _column(self, name: str) -> tuple[float, Array]:
        k = self._names.index(name)
        return float(self._means[k]), self._draws[:, k]

    def mean(self, name: str) -> dict[str, Any]:
        """Mean loss."""
        return interval(*self._column(name)).to_json()

    def excess(self, name: str) -> dict[str, Any]:
        """Mean loss over the floor; the gap's interval is the wider of two, see `_gap_low`."""
        value, draws = self._column(name)
        floor, floors = self._column("floor")
        out = interval(value - floor, draws - floors).to_json()
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
            return dict(NOT_GIVEN)
        before, befores = self._column("before")
        floor, floors = self._column("floor")
        value, draws = self._column(name)
        ratio = (befores - draws) / np.maximum(befores - floors, 1e-9)
        return interval((before - value) / (before - floor), ratio).to_json()

    def headline(self) -> dict[str, Any]:
        """Closure minus the better control's, or minus 0 where both controls make it worse."""
        if self.touches_floor:
            return dict(NOT_GIVEN)
        before, befores = self._column("before")
        floor, floors = self._column("floor")
        after, afters = self._column("after")
        options = [self._column(name) for name in ("negative_control", "recalibrated")]
        best, bests = min(options, key=lambda option: option[0])
        best, bests = min(best, before), np.minimum(bests, befores)
        ratio = (bests - afters) / np.maximum(befores - floors, 1e-9)
        return interval((best - after) / (before - floor), ratio).to_json()

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


def _loss(probability: Array, outcome: Array) -> Array:
    return np.asarray(-np.where(outcome > 0.5, np.log(probability), np.log1p(-probability)))
