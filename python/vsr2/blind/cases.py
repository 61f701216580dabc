"""Verdicts beside the sealed truth, one case a campaign and tier."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vsr2.blind.seal import read_json, read_pack
from vsr2.blind.settings import PackSettings
from vsr2.blind.verdict import NONE, UNKNOWN, Verdict, read_verdict
from vsr2.errors import BlindError

ALL = "all"
BINS = ((0.0, 1.0), (1.0, 2.0), (2.0, 4.0), (4.0, math.inf))
"""Of the magnitude over the floor."""


@dataclass(frozen=True, eq=False)
class Case:
    """One campaign at one tier: truth and verdict.

    Attributes:
        id: of the campaign.
        tier: B, M or T.
        kind, engine: sealed.
        truth: class of each true effect, by its label; `none`, `unknown` for those kinds.
        effects: sealed, as plain data.
        exclude: effects the diagnosis could not use.
        relative: least magnitude over the floor; NaN without effects.
        where: sealed axis and weights by trial.
        verdict: of the diagnosis.
        classes: equivalence classes.
    """

    id: str
    tier: str
    kind: str
    engine: str
    truth: tuple[str, ...]
    effects: tuple[Mapping[str, Any], ...]
    exclude: tuple[str, ...]
    relative: float
    where: Mapping[str, Any]
    verdict: Verdict
    classes: tuple[tuple[str, ...], ...]

    def label(self, effect: str) -> str:
        """The class of an effect, by the names in it."""
        return class_label(effect, self.classes)

    @property
    def class_probabilities(self) -> dict[str, float]:
        """By class label, the greatest first; equal ones by name."""
        out: dict[str, float] = {}
        for name, value in self.verdict.probabilities.items():
            out[self.label(name)] = out.get(self.label(name), 0.0) + value
        return dict(sorted(out.items(), key=lambda item: (-item[1], item[0])))

    @property
    def first(self) -> tuple[str, float]:
        """The most probable class and its probability."""
        return next(iter(self.class_probabilities.items()), ("", 0.0))


def class_label(effect: str, classes: Sequence[Sequence[str]]) -> str:
    """The class of an effect, by the names in it; `none` and `unknown` are their own."""
    return " = ".join(next((c for c in classes if effect in c), (effect,)))


def read_cases(data: Path, key: Mapping[str, Any], diagnoses: Path) -> list[Case]:
    """All campaigns and tiers of a pack that were to be diagnosed.

    Tiers that no campaign was diagnosed at are left out; of the others every campaign is needed.

    Raises:
        BlindError: diagnoses of another pack, or missing, or of a wrong form.
    """
    pack = read_pack(data)
    submission = read_json(diagnoses / "submission.json")
    if submission.get("pack") != pack["commitment"]["sha256"]:
        raise BlindError(
            f"{diagnoses / 'submission.json'}: the diagnoses are of another pack than {data}"
        )
    classes = PackSettings.from_json(key["settings"]).classes
    tiers = [
        t for t in pack["tiers"] if any((diagnoses / c / t).is_dir() for c in key["campaigns"])
    ]
    if not tiers:
        raise BlindError(f"{diagnoses}: holds no diagnosis; run `vsr2 blind diagnose` first")
    out = []
    for name, entry in sorted(key["campaigns"].items()):
        truth = tuple(class_label(effect["name"], classes) for effect in entry["effects"])
        if entry["kind"] in (NONE, UNKNOWN):
            truth = (entry["kind"],)
        for tier in tiers:
            out.append(
                Case(
                    id=name,
                    tier=tier,
                    kind=entry["kind"],
                    engine=entry["engine"],
                    truth=truth,
                    effects=tuple(entry["effects"]),
                    exclude=tuple(entry["exclude"]),
                    relative=min((e["relative"] for e in entry["effects"]), default=math.nan),
                    where=entry["where"],
                    verdict=read_verdict(diagnoses / name / tier),
                    classes=classes,
                )
            )
    return out


def groups(cases: Sequence[Case]) -> dict[tuple[str, str], list[Case]]:
    """Cases by tier and by what they share: all, engine, kind, magnitude over the floor."""
    out: dict[tuple[str, str], list[Case]] = {}
    for case in cases:
        names = [ALL, f"engine {case.engine}"]
        for low, high in BINS:
            if low <= case.relative < high:
                names.append(
                    f"floor x {low:g}-{high:g}" if high < math.inf else f"floor x {low:g}+"
                )
        if case.relative >= 2:
            names += ["floor x 2+", f"engine {case.engine}, floor x 2+"]
        names.append(f"kind {case.kind}")
        # Campaigns without effect belong to every magnitude's table of engines, none of its bins.
        for name in names:
            out.setdefault((case.tier, name), []).append(case)
    return out
