"""Trivial baselines: classifiers that know next to nothing, trained on a development pack."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis.intervals import Score, area_under_roc, resampled
from vsr2.blind.form.diagnosis_form import ReportedVerdict
from vsr2.blind.form.pack_settings import Kind
from vsr2.blind.form.seal import sealed_classes
from vsr2.blind.scoring.cases import Case, class_label
from vsr2.blind.scoring.metadata import metadata
from vsr2.campaign import Campaign, load_campaign
from vsr2.diagnosis.verdict.statements import VerdictKind
from vsr2.ensemble.simulated.library import NONE, UNKNOWN

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BaselineRules:
    """How baselines are fitted; all are choices, none is fitted.

    Attributes:
        set_level: probability that the set of a baseline holds.
        inverse_penalty: C of the logistic regression of answers, on standardised numbers.
        iterations: of it, at most.
        curve_inverse_penalty: C of a campaign's logistic curve, weak beside its trials.
        curve_iterations: of it, at most.
    """

    set_level: float = 0.9
    inverse_penalty: float = 1.0
    iterations: int = 5000
    curve_inverse_penalty: float = 10.0
    curve_iterations: int = 2000


BASELINE = BaselineRules()


def overturn_rate(campaign: Campaign, _: Path) -> list[float]:
    """The share of trials that overturned, and nothing else."""
    return [float(np.nanmean(campaign.overturned))]


def campaign_metadata(campaign: Campaign, folder: Path) -> list[float]:
    """What the files say without what happened in them."""
    return list(metadata(campaign, folder).values())


def logistic_in_pga(campaign: Campaign, _: Path) -> list[float]:
    """Intercept and slopes of the outcome's logistic curve in ln PGA and ln PGV/PGA."""
    from sklearn.linear_model import LogisticRegression

    terms = np.log([(t.pga_g or 1.0, t.pgv_pga_s or 1.0) for t in campaign.trials])
    truth = campaign.overturned
    known = np.isfinite(truth)
    if np.unique(truth[known]).size < 2:
        return [float(np.nanmean(truth)), 0.0, 0.0]
    model = LogisticRegression(C=BASELINE.curve_inverse_penalty, max_iter=BASELINE.curve_iterations)
    model.fit(terms[known], truth[known])
    return [float(model.intercept_[0]), *(float(c) for c in model.coef_[0])]


def nothing(campaign: Campaign, _: Path) -> list[float]:
    """No number at all: the commonest answer, with the frequencies of the development pack."""
    return [0.0]


BASELINES: Mapping[str, Callable[[Campaign, Path], list[float]]] = {
    "commonest": nothing,
    "overturn_rate": overturn_rate,
    "metadata": campaign_metadata,
    "logistic_in_pga": logistic_in_pga,
}


def baseline_cases(
    cases: Sequence[Case],
    data: Path,
    trained_data: Path,
    trained_key: Mapping[str, Any],
) -> list[Case]:
    """What each baseline says of every campaign: cases whose tier is the baseline's name.

    A baseline is a multinomial logistic regression on a handful of standardised numbers, of the
    class of single effects, none and unknown. It is trained on a development pack. Its verdict is
    its most probable answer, its 90 % set the fewest answers that hold 0.9 of the probability.

    Args:
        cases: of the pack that is scored.
        data: of that pack.
        trained_data: of the development pack.
        trained_key: opened.
    """
    training = _labelled(trained_data, trained_key)
    if not training:
        return []
    labels = np.array([label for _, label in training])
    asked = {case.id: case for case in cases}
    x = _features([folder for folder, _ in training])
    z = _features([data / name for name in asked])
    out = []
    for name in BASELINES:
        answers, probability = _guess(x[name], labels, z[name])
        out += [
            replace(case, tier=name, verdict=_verdict(answers, row))
            for case, row in zip(asked.values(), probability, strict=True)
        ]
    return out


def _verdict(answers: Sequence[str], probability: Array) -> ReportedVerdict:
    ranked = sorted(zip(answers, probability, strict=True), key=lambda pair: -pair[1])
    total = np.cumsum([p for _, p in ranked])
    chosen = [
        name for name, _ in ranked[: 1 + int(np.searchsorted(total, BASELINE.set_level - 1e-12))]
    ]
    first = ranked[0][0]
    named = first not in (NONE, UNKNOWN)
    return ReportedVerdict(
        kind=VerdictKind.EFFECT if named else VerdictKind(first),
        effects=(first,) if named else (),
        probabilities={name: float(value) for name, value in ranked},
        conformal=tuple(chosen),
    )


def rate_alone(data: Path, key: Mapping[str, Any]) -> dict[str, Score]:
    """How well the overturn rate, in either direction, separates a kind from singles, by kind.

    Area under the ROC, 0.5 by chance or up to 0.5 + 0.57 (1/m + 1/n)^(1/2) in 19 of 20 packs
    of m and n campaigns.
    """
    rates: dict[str, list[float]] = {}
    for name, entry in sorted(key["campaigns"].items()):
        rate = overturn_rate(load_campaign(data / name), data / name)[0]
        rates.setdefault(entry["kind"], []).append(rate)
    single = rates.get(Kind.SINGLE, [])
    out = {}
    for kind in (Kind.NONE, Kind.UNKNOWN):
        if single and kind in rates:
            rows = [(r, 1.0) for r in rates[kind]] + [(r, 0.0) for r in single]
            out[str(kind)] = resampled(rows, _either_way)
    return out


def _either_way(samples: Array) -> Array:
    area = area_under_roc(samples)
    return np.asarray(np.maximum(area, 1 - area), dtype=np.float64)


def _features(folders: Sequence[Path]) -> dict[str, Array]:
    rows: dict[str, list[list[float]]] = {name: [] for name in BASELINES}
    for folder in folders:
        campaign = load_campaign(folder)
        for name, features in BASELINES.items():
            rows[name].append(features(campaign, folder))
    return {name: np.array(values) for name, values in rows.items()}


def _guess(x: Array, labels: NDArray[np.str_], z: Array) -> tuple[list[str], Array]:
    """Answers, and the probability of each, shape (campaigns, answers)."""
    from sklearn.linear_model import LogisticRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    names = [str(name) for name in np.unique(labels)]
    if len(names) == 1:
        return names, np.ones((len(z), 1))
    regression = LogisticRegression(C=BASELINE.inverse_penalty, max_iter=BASELINE.iterations)
    model = make_pipeline(StandardScaler(), regression)
    return names, np.asarray(model.fit(x, labels).predict_proba(z), dtype=np.float64)


def _labelled(data: Path, key: Mapping[str, Any]) -> list[tuple[Path, str]]:
    """Campaigns of single effects, none and unknown, and what a baseline should answer."""
    classes = sealed_classes(key)
    out = []
    for name, entry in sorted(key["campaigns"].items()):
        if entry["kind"] == Kind.SINGLE:
            out.append((data / name, class_label(entry["effects"][0]["name"], classes)))
        elif entry["kind"] in (Kind.NONE, Kind.UNKNOWN):
            out.append((data / name, entry["kind"]))
    return out
