"""Verdicts beside the sealed truth, one case a campaign and tier."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from vsr2.blind.form.diagnosis_form import DIAGNOSIS_FILE, ReportedVerdict, read_verdict
from vsr2.blind.form.pack_settings import Kind
from vsr2.blind.form.seal import read_json, read_pack, sealed_classes
from vsr2.blind.form.trial_weights import check_weights, trial_ids
from vsr2.campaign.trials_table import TRIALS
from vsr2.config.problems import shown
from vsr2.errors import BlindError

ALL = "all"


@dataclass(frozen=True)
class GroupRules:
    """By what campaigns are grouped; all are choices, none is fitted.

    Attributes:
        limits: edges between groups of the magnitude over the detection limit, lower ends included;
            the last group is open.
        least_limits: lower ends of further groups, which hold all that lies above.
        flips: edges between groups of the share of outcomes that the effects flip; the last group
            is open.
    """

    limits: tuple[float, ...] = (0.0, 1.0, 2.0, 4.0)
    least_limits: tuple[float, ...] = (1.0, 2.0)
    flips: tuple[float, ...] = (0.0, 0.02, 0.05, 0.1)


GROUPS = GroupRules()


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
        relative: least magnitude over the detection limit; NaN without effects, or where none is
            sealed.
        flips: share of outcomes that the effects flip; NaN where it is not sealed.
        where: sealed axis and weights, one a trial in the order of `trials`.
        trials: ids, in the order of the rows of `trials.csv`.
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
    flips: float
    where: Mapping[str, Any]
    trials: tuple[str, ...]
    verdict: ReportedVerdict
    classes: tuple[tuple[str, ...], ...]

    def label(self, effect: str) -> str:
        """The class of an effect, by the names in it."""
        return class_label(effect, self.classes)

    def labels(self, effects: Iterable[str]) -> list[str]:
        """The class of each effect."""
        return [self.label(effect) for effect in effects]

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


def read_cases(
    data: Path, key: Mapping[str, Any], diagnoses: Path, tiers: Sequence[str] | None = None
) -> list[Case]:
    """All campaigns of a pack at each tier that is to be scored.

    Args:
        data: the pack's data folder.
        key: opened by :func:`vsr2.blind.form.seal.open_key`.
        diagnoses: folder of them.
        tiers: to be scored; None: all of the pack.

    Raises:
        BlindError: diagnoses of another pack, or missing, or of a wrong form; one names an effect
            that it was to leave out, or trials that the campaign does not have; the sealed weights
            are not one a trial.
    """
    pack = read_pack(data)
    submission = read_json(diagnoses / "submission.json")
    if submission.get("pack") != pack.commitment.sha256:
        raise BlindError(
            f"{diagnoses / 'submission.json'}: pack is {shown(submission.get('pack'))}: the "
            f"diagnoses are of another pack than {data}, whose hash is "
            f"{pack.commitment.sha256}; name the pack that they are of"
        )
    if tiers is None:
        tiers = pack.tiers
        begun = {t for t in tiers if any((diagnoses / c / t).is_dir() for c in key["campaigns"])}
        missing = [t for t in tiers if t not in begun]
        if missing:
            raise BlindError(
                f"{diagnoses}: holds no diagnosis at tier {', '.join(missing)} of the pack's "
                f"{', '.join(tiers)}; run `vsr2 blind diagnose` to the end, or give the tiers that "
                "are to be scored (--tier): a pack is scored once"
            )
    elif set(tiers) - set(pack.tiers):
        raise BlindError(
            f"{data}: has no tier {', '.join(sorted(set(tiers) - set(pack.tiers)))}; it has "
            f"{', '.join(pack.tiers)}"
        )
    out = []
    for name in sorted(key["campaigns"]):
        trials = trial_ids(data / name / TRIALS)
        for tier in tiers:
            folder = diagnoses / name / tier
            verdict, path = read_verdict(folder), folder / DIAGNOSIS_FILE
            own = {} if verdict.failed else read_json(path).get("campaign")
            for what, here, known in (
                ("tier", tier, None),
                ("name", name, key["campaigns"]),
            ):
                said = own.get(what, here) if isinstance(own, Mapping) else here
                if said != here and (known is None or said in known):
                    raise BlindError(
                        f"{path}: campaign.{what} is {said!r}, and lies in the folder of "
                        f"{here!r}; each campaign and tier has a diagnosis of its own"
                    )
            out.append(case_of(key, name, tier, verdict, trials, (data / name, path)))
    return out


def case_of(
    key: Mapping[str, Any],
    name: str,
    tier: str,
    verdict: ReportedVerdict,
    trials: tuple[str, ...],
    paths: tuple[Path, Path],
) -> Case:
    """The truth of a campaign beside a verdict on it.

    Args:
        key: opened.
        name: id of the campaign.
        tier: of the verdict.
        verdict: read.
        trials: ids, in the order of the rows of `trials.csv`.
        paths: of the campaign and of the verdict, in front of messages.

    Raises:
        BlindError: the sealed weights are not one a trial, or the verdict does not keep to what its
            campaign allows and has.
    """
    entry, classes = key["campaigns"][name], sealed_classes(key)
    effects = tuple(entry.get("effects") or ())
    truth = tuple(class_label(effect["name"], classes) for effect in effects)
    if entry["kind"] in (Kind.NONE, Kind.UNKNOWN):
        truth = (entry["kind"],)
    if entry["kind"] == Kind.REFERENCE and not effects:
        truth = (str(Kind.NONE),)
    check_weights(entry["where"]["weights"], trials, paths[0], name)
    exclude = tuple(entry.get("exclude") or ())
    _check_verdict(verdict, str(paths[1]), exclude, trials)
    return Case(
        id=name,
        tier=tier,
        kind=entry["kind"],
        engine=entry["engine"],
        truth=truth,
        effects=effects,
        exclude=exclude,
        relative=_relative(effects),
        flips=math.nan if (flips := entry.get("flips")) is None else float(flips),
        where=entry["where"],
        trials=trials,
        verdict=verdict,
        classes=classes,
    )


def _relative(effects: Sequence[Mapping[str, Any]]) -> float:
    sealed = [float(e["relative"]) for e in effects if e.get("relative") is not None]
    return min(sealed) if sealed and len(sealed) == len(effects) else math.nan


def _check_verdict(
    verdict: ReportedVerdict, label: str, exclude: tuple[str, ...], trials: tuple[str, ...]
) -> None:
    """That a verdict keeps to what its campaign allows and has."""
    held = [name for name, value in verdict.probabilities.items() if value > 0]
    used = [name for name in (*verdict.effects, *held, *verdict.conformal) if name in exclude]
    if used:
        raise BlindError(
            f"{label}: names {used[0]}, which exclude in pack.json withholds from this campaign; "
            "diagnose it without"
        )
    outside = [t for one in verdict.where for t in one.trials or () if t not in trials]
    if outside:
        raise BlindError(
            f"{label}: where names the trial {shown(min(outside))}, which is not in the "
            f"campaign's {TRIALS}; give the ids of its column trial"
        )


def groups(cases: Sequence[Case]) -> dict[tuple[str, str], list[Case]]:
    """Cases by tier and by what they have in common: engine, kind, magnitude over the limit.

    Campaigns without effect have no magnitude and are in none of its groups. Where no magnitude
    over the limit is sealed, campaigns go by the share of outcomes that the effects flip.
    """
    out: dict[tuple[str, str], list[Case]] = {}
    further = [(low, math.inf) for low in GROUPS.least_limits]
    for case in cases:
        engine = engine_group(case.engine)
        names = [ALL, engine, f"kind {case.kind}"]
        names += [
            engine_group(case.engine, low, high)
            for low, high in (*_spans(GROUPS.limits), *further)
            if low <= case.relative < high
        ]
        names += [
            f"flips {_span(low, high)}"
            for low, high in _spans(GROUPS.flips)
            if case.kind != "none" and math.isnan(case.relative) and low <= case.flips < high
        ]
        for name in names:
            out.setdefault((case.tier, name), []).append(case)
    return out


def engine_group(engine: str, low: float | None = None, high: float = math.inf) -> str:
    """Name of the group of an engine's campaigns: all, or those of magnitudes over the limit."""
    return f"engine {engine}" + ("" if low is None else f", limits {_span(low, high)}")


def _spans(edges: Sequence[float]) -> Iterable[tuple[float, float]]:
    return pairwise((*edges, math.inf))


def _span(low: float, high: float) -> str:
    return f"{low:g}+" if high == math.inf else f"{low:g}-{high:g}"
