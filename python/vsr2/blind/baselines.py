"""Trivial baselines: classifiers that know next to nothing, trained on a development pack."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.blind.cases import class_label
from vsr2.blind.intervals import Score, area_under_roc, proportion, resampled
from vsr2.blind.settings import PackSettings
from vsr2.campaign import Campaign, load_campaign

Array = NDArray[np.float64]


def overturn_rate(campaign: Campaign, _: Path) -> list[float]:
    """The share of trials that overturned, and nothing else."""
    return [float(np.nanmean(campaign.overturned))]


def metadata(campaign: Campaign, folder: Path) -> list[float]:
    """What the files say without what happened in them: sizes, counts, noise, amplitudes, ends.

    Of the series, how long after the motion they end in trials that did not overturn.
    """
    noise = campaign.noise
    pga = np.log([trial.pga or 1.0 for trial in campaign.trials])
    files = sorted((folder / "motions").glob("*.npz"))
    return [
        float(len(campaign)),
        float(len(set(campaign.motion_ids))),
        float(len({trial.session for trial in campaign.trials})),
        float(np.log(noise.displacement or 1.0)),
        float(np.log(noise.acceleration or 1.0)),
        float(pga.mean()),
        float(pga.std()),
        float(np.mean([file.stat().st_size for file in files])) if files else 0.0,
        float((folder / "campaign.yaml").stat().st_size),
        float(len((folder / "trials.csv").read_text().splitlines()[0])),
        _end(campaign),
    ]


def _end(campaign: Campaign) -> float:
    """Mean time from the motion's end to the series' end [s]; 0 where no series tells it."""
    ends = []
    for trial in campaign.trials:
        record = campaign.record(trial)
        if trial.series is not None and record is not None and not trial.overturned:
            ends.append(trial.series.time[-1] - record.duration)
    return float(np.mean(ends)) if ends else 0.0


def logistic_in_pga(campaign: Campaign, _: Path) -> list[float]:
    """Intercept and slopes of the outcome's logistic curve in ln PGA and ln PGV/PGA."""
    from sklearn.linear_model import LogisticRegression

    terms = np.log([(t.pga or 1.0, t.pgv_pga or 1.0) for t in campaign.trials])
    truth = campaign.overturned
    known = np.isfinite(truth)
    if np.unique(truth[known]).size < 2:
        return [float(np.nanmean(truth)), 0.0, 0.0]
    model = LogisticRegression(C=10.0, max_iter=2000).fit(terms[known], truth[known])
    return [float(model.intercept_[0]), *(float(c) for c in model.coef_[0])]


BASELINES: Mapping[str, Callable[[Campaign, Path], list[float]]] = {
    "overturn rate only": overturn_rate,
    "metadata only": metadata,
    "logistic in PGA": logistic_in_pga,
}


def baseline_scores(
    data: Path,
    key: Mapping[str, Any],
    trained_data: Path,
    trained_key: Mapping[str, Any],
) -> dict[str, Score]:
    """Top-1 class on single effects of each baseline, and what guessing the commonest class gives.

    Also how well the overturn rate tells campaigns without effect, and unknown ones, from single
    effects.

    A baseline is a multinomial logistic regression on a handful of standardised numbers. It is
    trained on the single effects of a development pack and judged on those of another.

    Args:
        data: of the pack that is scored.
        key: opened.
        trained_data: of the development pack.
        trained_key: opened.
    """
    out = _rate_alone(data, key)
    training = _singles(trained_data, trained_key)
    judged = _singles(data, key)
    if not training or not judged:
        return out
    labels = np.array([label for _, label in training])
    truth = np.array([label for _, label in judged])
    names, counts = np.unique(labels, return_counts=True)
    common = names[counts.argmax()]
    out["commonest class: top-1"] = proportion(int((truth == common).sum()), len(truth))
    x, z = _features(training), _features(judged)
    for name in BASELINES:
        guess = np.full(len(truth), common)
        if names.size > 1:
            guess = _guess(x[name], labels, z[name])
        out[f"{name}: top-1"] = proportion(int((guess == truth).sum()), len(truth))
    return out


def _rate_alone(data: Path, key: Mapping[str, Any]) -> dict[str, Score]:
    """How well the overturn rate, in either direction, tells one kind of campaign from singles.

    Area under the ROC, 0.5 by chance or up to 0.5 + 0.57 (1/m + 1/n)^(1/2) in 19 of 20 packs
    of m and n campaigns.
    """
    rates: dict[str, list[float]] = {}
    for name, entry in sorted(key["campaigns"].items()):
        rate = overturn_rate(load_campaign(data / name), data / name)[0]
        rates.setdefault(entry["kind"], []).append(rate)
    single = rates.get("single", [])
    out = {}
    for kind in ("none", "unknown"):
        if single and kind in rates:
            rows = [(r, 1.0) for r in rates[kind]] + [(r, 0.0) for r in single]
            out[f"overturn rate only: AUROC, {kind} or single"] = resampled(rows, _either_way)
    return out


def _either_way(samples: Array) -> Array:
    area = area_under_roc(samples)
    return np.asarray(np.maximum(area, 1 - area), dtype=np.float64)


def _features(campaigns: Sequence[tuple[Path, str]]) -> dict[str, Array]:
    rows: dict[str, list[list[float]]] = {name: [] for name in BASELINES}
    for folder, _ in campaigns:
        campaign = load_campaign(folder)
        for name, features in BASELINES.items():
            rows[name].append(features(campaign, folder))
    return {name: np.array(values) for name, values in rows.items()}


def _guess(x: Array, labels: NDArray[np.str_], z: Array) -> NDArray[np.str_]:
    from sklearn.linear_model import LogisticRegression

    center, spread = x.mean(axis=0), x.std(axis=0)
    spread[spread < 1e-12] = 1.0
    model = LogisticRegression(C=1.0, max_iter=5000).fit((x - center) / spread, labels)
    found: NDArray[np.str_] = model.predict((z - center) / spread)
    return found


def _singles(data: Path, key: Mapping[str, Any]) -> list[tuple[Path, str]]:
    classes = PackSettings.from_json(key["settings"]).classes
    return [
        (data / name, class_label(entry["effects"][0]["name"], classes))
        for name, entry in sorted(key["campaigns"].items())
        if entry["kind"] == "single"
    ]
