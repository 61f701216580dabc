"""Whether what the files say beside the response reveals engine, kind or class, within a pack."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.blind.form.pack_settings import Kind
from vsr2.blind.form.seal import sealed_classes
from vsr2.blind.scoring.cases import class_label
from vsr2.blind.scoring.metadata import CAMPAIGN_FILE, metadata
from vsr2.campaign import load_campaign

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LeakRules:
    """How leaks are sought; all are choices, none is fitted.

    Attributes:
        permutations: of the labels.
        least: campaigns; fewer tell nothing at a level of 0.01.
    """

    permutations: int = 999
    least: int = 8


LEAKS = LeakRules()
TOGETHER = "all_together"
ALIKE = "campaigns_that_lack_the_same_effects"
EQUAL = "nothing"
"""Codes of what predicts best, beside those of the metadata; of the last all are equal."""


@dataclass(frozen=True)
class Leak:
    """How well metadata answer one question.

    Attributes:
        question: `engine`, `kind` or `class`.
        p: chance that labels dealt at random are predicted as well, over all metadata.
        best: code of what predicts best, over what it does by chance.
        rate: share of campaigns whose nearest neighbour in it has the same label.
        chance: the same with labels dealt at random, on average.
        count: campaigns.
    """

    question: str
    p: float
    best: str
    rate: float
    chance: float
    count: int


def find_leaks(data: Path, key: Mapping[str, Any]) -> list[Leak]:
    """Ask the metadata of a pack's campaigns for their engine, kind and class.

    A campaign's answer is predicted by its nearest neighbour among the others: in one number of the
    metadata, in each of them, and in all together, each over its standard deviation; of neighbours
    at one distance each counts in part. The labels are permuted 999 times. Numbers are compared by
    how many standard deviations of the permutations they predict better than chance. The best of
    them has its p value from the best of each permutation, so that many numbers do not raise it
    (Westfall and Young 1993). For engine and kind, how many campaigns lack the same effects is one
    of the numbers. The class is asked of campaigns with one effect whose class another
    one has. What has one answer alone, or fewer than 8 campaigns, is not asked.

    Args:
        data: the pack's data folder.
        key: opened.
    """
    entries = sorted((n, e) for n, e in key["campaigns"].items() if e["kind"] != Kind.REFERENCE)
    if not all((data / name / CAMPAIGN_FILE).exists() for name, _ in entries):
        return []
    found = [metadata(load_campaign(data / name), data / name) for name, _ in entries]
    numbers = {name: np.array([row[name] for row in found]) for name in found[0]}
    lacking = [sorted(entry.get("exclude") or ()) for _, entry in entries]
    alike = {ALIKE: np.array([float(lacking.count(one)) for one in lacking])}
    classes = sealed_classes(key)
    questions: dict[str, list[str | None]] = {
        "engine": [str(entry["engine"]) for _, entry in entries],
        "kind": [str(entry["kind"]) for _, entry in entries],
        "class": [_class(entry, classes) for _, entry in entries],
    }
    out = []
    for question, labels in questions.items():
        kept = [i for i, one in enumerate(labels) if one is not None and labels.count(one) > 1]
        known = sorted({str(labels[i]) for i in kept})
        codes = np.array([known.index(str(labels[i])) for i in kept], dtype=np.int64)
        if len(kept) >= LEAKS.least and len(known) > 1:
            # What an unknown campaign lacks is its class.
            asked = numbers if question == "class" else numbers | alike
            mine = {name: values[kept] for name, values in asked.items()}
            out.append(_leak(question, mine, codes))
    return out


def _class(entry: Mapping[str, Any], classes: Sequence[Sequence[str]]) -> str | None:
    effects = list(entry.get("effects") or [])
    return class_label(effects[0]["name"], classes) if len(effects) == 1 else None


def _leak(question: str, numbers: Mapping[str, Array], codes: NDArray[np.int64]) -> Leak:
    spread = {name: float(values.std()) for name, values in numbers.items()}
    scaled = {
        name: (values - values.mean()) / spread[name]
        for name, values in numbers.items()
        # Beyond rounding.
        if spread[name] > 1e-9 * (1 + np.abs(values).max())
    }
    if not scaled:
        # Every other campaign is nearest.
        alike = np.bincount(codes)
        rate = float((alike * (alike - 1)).sum() / (len(codes) * (len(codes) - 1)))
        return Leak(question, 1.0, EQUAL, rate, rate, len(codes))
    columns = {name: values[:, None] for name, values in scaled.items()}
    columns[TOGETHER] = np.stack(list(scaled.values()), axis=1)
    weights = np.stack([_neighbours(values).ravel() for values in columns.values()])
    rng = np.random.default_rng(0)
    dealt = [codes, *(rng.permutation(codes) for _ in range(LEAKS.permutations))]
    rates: Array = np.stack([weights @ np.equal.outer(c, c).ravel() for c in dealt]) / len(codes)
    center, deviation = rates.mean(axis=0), rates.std(axis=0)
    excess = (rates - center) / np.where(deviation > 1e-12, deviation, np.inf)
    best = excess.max(axis=1)
    p = float((best >= best[0] - 1e-9).mean())
    most = int(excess[0].argmax())
    return Leak(
        question, p, list(columns)[most], float(rates[0, most]), float(center[most]), len(codes)
    )


def _neighbours(points: Array) -> Array:
    """Each point's nearest others, at equal parts, shape (n, n); points have shape (n, k)."""
    distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
    np.fill_diagonal(distance, np.inf)
    near = distance <= distance.min(axis=1, keepdims=True) + 1e-9
    out: Array = near / near.sum(axis=1, keepdims=True)
    return out
