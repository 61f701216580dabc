"""The gap of the scene as it is, and what causes take off it on motions that were not seen."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis import logistic_baseline
from vsr2.analysis.intervals import INTERVALS
from vsr2.analysis.metrics import classification_metrics
from vsr2.analysis.probability import RELIABILITY, outcome_loss, probability_intervals
from vsr2.campaign import Campaign, intensity_measures
from vsr2.causes.margins.held_out_causes import HELD_OUT_CAUSES, HeldOutCauses
from vsr2.diagnosis.how_far.ensemble_losses import (
    Ensemble,
    LossInterval,
    floor_loss,
    interval,
    resampled_means,
    share_of_gap,
)
from vsr2.diagnosis.how_far.held_out import CONTROLS, HELD_OUT, HowFar, Loss
from vsr2.diagnosis.how_far.negative_controls import (
    recalibrated,
    with_change_of,
    wrong_partners,
)
from vsr2.ensemble.simulated.cache import Progress, SimulationCache
from vsr2.ensemble.simulated.simulator import Request
from vsr2.errors import CampaignError, MotionError, ResultError

Array = NDArray[np.float64]
_CLASSIFIED = ("accuracy", "precision", "recall", "objective")
"""Scores of predicted outcomes."""
_LIKELY = "likely"


def simulate_as_it_is(
    cache: SimulationCache, trials: int, *, progress: Progress | None = None
) -> Ensemble:
    """Each trial in the scene as it is, under several draws of the nuisances.

    The first of a diagnosis (`HeldOutConstants.members`), which a cache shares with it.
    """
    members = HELD_OUT.members
    requests = [
        Request(trial, (), draw, 1) for draw in range(1, members + 1) for trial in range(trials)
    ]
    found = cache.run(requests, progress=progress)
    return Ensemble(found.overturned.reshape(members, trials), np.zeros((members, trials, 0)))


def explained_gap(
    judged: HeldOutCauses, as_it_is: Ensemble, used: Campaign, seed: int
) -> dict[str, Any]:
    """Losses of motions that were not seen: the waterfall, shares, controls, and scores.

    Causes are added by their shares, the greatest first.

    Where nothing may act, scatter of margins is fitted all the same: it closes a part of the gap,
    and is no cause. All intervals are of the same resamples of motions.

    Args:
        judged: with causes.
        as_it_is: the scene without them.
        used: the campaign, all outcomes known.
        seed: of draws.
    """
    curve = _logistic(used, seed)
    gains = {cause: judged.gains(cause) for cause in judged.causes}
    order = sorted(gains, key=lambda cause: -float(gains[cause]["share"].mean()))
    steps = [tuple(order[:k]) for k in range(len(order) + 1)]
    losses: dict[str, Array] = _losses(judged, as_it_is, used, seed)
    losses[_LIKELY] = judged.likely_loss()
    losses |= {_label(step): judged.loss(frozenset(step)) for step in steps}
    for cause, own_gains in gains.items():
        losses |= {f"{name} {cause}": gain for name, gain in own_gains.items()}
    if curve is not None:
        losses["logistic"] = outcome_loss(curve, used.overturned)
    values = np.stack(list(losses.values()))
    motion = np.unique(np.asarray(used.motion_ids), return_inverse=True)[1]
    drawn = resampled_means(values, motion, replicates=INTERVALS.replicates)
    means = dict(zip(losses, np.vstack([values.mean(axis=1), drawn]).T, strict=True))
    before, after = means[Loss.BEFORE], means[Loss.AFTER]
    scatter = means[_label(())]
    gap = before - means[Loss.FLOOR]
    own = {name: losses[name] for name in Loss}
    every = np.arange(motion.size)
    judged_gap = HowFar(own, as_it_is.probability, judged.everything, every, motion, judged.causes)

    def closes(model: Array) -> dict[str, Any]:
        return {
            "loss": interval(model).to_json(),
            "closure": share_of_gap(before - model, gap).to_json(),
        }

    return {
        "as_it_is": {"loss": interval(before).to_json()},
        "waterfall": [{"causes": list(step)} | closes(means[_label(step)]) for step in steps],
        "all": closes(after),
        "likely": closes(means[_LIKELY]) | _likely(judged, used, seed),
        "floor": {
            "loss": interval(means[Loss.FLOOR]).to_json(),
            "scores": _floor_scores(as_it_is),
        },
        "scatter_alone": closes(scatter),
        "beyond_scatter": share_of_gap(scatter - after, gap).to_json(),
        "controls": {one.value: closes(means[one]) for one in CONTROLS},
        "beyond_controls": judged_gap.headline().to_json(),
        "beyond_logistic": None
        if curve is None
        else share_of_gap(means["logistic"] - after, gap).to_json(),
        "shares": {
            cause: {"loss": interval(means[f"share {cause}"]).to_json()}
            | {"of_gap": share_of_gap(means[f"share {cause}"], gap).to_json()}
            | {name: interval(means[f"{name} {cause}"]).to_json() for name in ("first", "last")}
            for cause in order
        },
        "scores": _scores(judged.everything, used, seed),
        "logistic": None if curve is None else {
            "scores": _scores(curve, used, seed),
            **closes(means["logistic"]),
            "loss_above_all": interval(means["logistic"] - after).to_json(),
        },
    }  # fmt: skip


def _likely(judged: HeldOutCauses, used: Campaign, seed: int) -> dict[str, Any]:
    """In how many folds each cause is likely, the most frequent first, and how these predict."""
    counts = Counter(name for names in judged.likely_in.values() for name in sorted(names))
    folds, scores = dict(counts.most_common()), _scores(judged.likely, used, seed)
    return {"folds": folds, "of": len(judged.likely_in), "scores": scores}


def _floor_scores(as_it_is: Ensemble) -> dict[str, Any]:
    """What a campaign without a gap would score, by simulations predicted by the others.

    Means, and where 95 % of the simulations lie.
    """
    found: dict[str, list[float]] = {name: [] for name in _CLASSIFIED}
    everyone = np.arange(len(as_it_is))
    for i in everyone:
        truth = as_it_is.overturned[i]
        known = np.isfinite(truth)
        others = as_it_is.take(np.delete(everyone, i)).probability
        scores = classification_metrics(truth[known] > 0, others[known] > RELIABILITY.threshold)
        for name, values in found.items():
            values.append(getattr(scores, name))
    return {name: _spread(np.array(values)) for name, values in found.items()}


def _spread(values: Array) -> dict[str, Any]:
    kept = values[np.isfinite(values)]
    if not kept.size:
        return LossInterval(np.nan, np.nan, np.nan).to_json()
    low, high = np.quantile(kept, INTERVALS.ends)
    return LossInterval(float(kept.mean()), float(low), float(high)).to_json()


def _label(step: Sequence[str]) -> str:
    return "with " + " ".join(step)


def _losses(
    judged: HeldOutCauses, as_it_is: Ensemble, used: Campaign, seed: int
) -> dict[str, Array]:
    """Of each trial, by whose they are, shapes (trials,)."""
    before, outcome = as_it_is.probability, np.asarray(used.overturned)
    log_pga_g = np.log(intensity_measures(used).pga_g)
    dealt = [
        outcome_loss(with_change_of(before, judged.everything, partner), outcome)
        for partner in wrong_partners(log_pga_g, seed)
    ]
    return {
        Loss.BEFORE: outcome_loss(before, outcome),
        Loss.AFTER: judged.everything_loss(),
        Loss.RECALIBRATED: outcome_loss(recalibrated(before, outcome, judged.fold), outcome),
        Loss.DEALT: np.mean(dealt, axis=0),
        Loss.FLOOR: floor_loss(as_it_is),
    }


def _scores(probability: Array, used: Campaign, seed: int) -> dict[str, Any]:
    found = probability_intervals(used.overturned > 0, probability, used.motion_ids, seed=seed)
    return {
        name: LossInterval(one.value, one.low, one.high).to_json() for name, one in found.items()
    }


def _logistic(used: Campaign, seed: int) -> Array | None:
    """Probability by the curve without physics, out of fold; None where there is none."""
    folds = min(HELD_OUT_CAUSES.folds, len(set(used.motion_ids)))
    try:
        curve = logistic_baseline(used, folds=folds, seed=seed)
    except (CampaignError, MotionError, ResultError):
        return None
    return np.asarray(curve.out_of_fold) if curve.used.all() else None
