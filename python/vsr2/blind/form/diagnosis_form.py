"""`diagnosis.json` as scoring reads it (docs/reference/blind.md describes the form)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, ConfigDict, Field, PlainSerializer, model_validator

from vsr2.blind.form.reader import (
    Ends,
    Name,
    Names,
    Part,
    Probability,
    check_count,
    misfit,
    parsed,
)
from vsr2.blind.form.seal import read_json
from vsr2.config.problems import shown
from vsr2.diagnosis.verdict.document import SCHEMA
from vsr2.diagnosis.verdict.statements import VerdictKind
from vsr2.diagnosis.where.scan import LocationAxis
from vsr2.ensemble.simulated.library import NONE, UNKNOWN
from vsr2.errors import BlindError

DIAGNOSIS_FILE = "diagnosis.json"
FAILED_FILE = "failed.json"
NAMED_COUNTS: Mapping[VerdictKind, tuple[int, float]] = {
    VerdictKind.EFFECT: (1, 1),
    VerdictKind.CLASS: (1, float("inf")),
    VerdictKind.PAIR: (2, float("inf")),
    VerdictKind.SEVERAL: (3, float("inf")),
}
"""Kinds that name effects, with the least and greatest number of them."""


def _or_infinite(value: object) -> object:
    """Null is infinity, as a parameter without effect may have it."""
    if isinstance(value, list):
        return [_or_infinite(one) for one in value]
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError("it should be a finite number, or null for infinity")
    return math.inf if value is None else value


def _or_null(value: object) -> object:
    """As the file says it."""
    if isinstance(value, (list, tuple)):
        return [_or_null(one) for one in value]
    return None if value == math.inf else value


class ReportedEstimate(Part):
    """A number with its 90 % interval, where one is given; its median may stand beside it."""

    model_config = ConfigDict(allow_inf_nan=True)
    nullable = frozenset({"mean"})

    mean: Annotated[float, BeforeValidator(_or_infinite), PlainSerializer(_or_null)]
    ci90: Annotated[Ends | None, BeforeValidator(_or_infinite), PlainSerializer(_or_null)] = None
    median: Any = None


class ReportedLocation(Part):
    """One location of a gap.

    Attributes:
        axis: along which its trials differ from the others.
        trials: inside it, of a location that stands out; None: of another one.
    """

    axis: LocationAxis = Field(strict=False)
    trials: Annotated[frozenset[Name], Field(strict=False)] | None = None


class FailureCode(StrEnum):
    """At what a diagnosis ended; `vsr2.report.messages.blind_packs` words it."""

    CAMPAIGN_UNUSABLE = "campaign_unusable"
    DIAGNOSIS_ENDED = "diagnosis_ended"
    DIAGNOSIS_UNREADABLE = "diagnosis_unreadable"


class Failure(Part):
    """Why there is no diagnosis: content of a `failed.json`.

    Attributes:
        code: at what it ended.
        error: class of the error.
        message: of the error, with file, key, value and remedy.
    """

    code: FailureCode = Field(strict=False)
    error: Name
    message: str


@dataclass(frozen=True)
class ReportedVerdict:
    """What a diagnosis says of one campaign.

    Attributes:
        kind: of the verdict.
        effects: that it names.
        probabilities: by effect, with `none` and `unknown`, which sum to at most 1.
        conformal: the 90 % set.
        parameters: estimates by effect and parameter.
        closure: share of the excess loss that is gone on motions not seen; None: no ratio.
        headline: the same, less that of the better negative control.
        gain: 95 % interval of the loss before minus after there; None: there is none.
        where: locations that stand out.
        failed: why there is no diagnosis; then all else says `unresolved`. None: there is one.
    """

    kind: VerdictKind
    effects: tuple[str, ...] = ()
    probabilities: Mapping[str, float] = field(default_factory=dict)
    conformal: tuple[str, ...] = ()
    parameters: Mapping[str, Mapping[str, ReportedEstimate]] = field(default_factory=dict)
    closure: float | None = None
    headline: float | None = None
    gain: Ends | None = None
    where: tuple[ReportedLocation, ...] = ()
    failed: Failure | None = None


def _complete(ends: object) -> object:
    """An interval that lacks an end is none."""
    return None if isinstance(ends, list) and None in ends else ends


class _Figure(Part):
    value: float | None = None
    ci95: Annotated[Ends | None, BeforeValidator(_complete)] = None


class _Gap(Part):
    closure: _Figure = _Figure()
    headline: _Figure = _Figure()
    gain: _Figure = _Figure()


class _Effect(Part):
    name: Name
    probability: Probability
    parameters: dict[str, ReportedEstimate] = Field(default_factory=dict)


class _Unknown(Part):
    probability: Probability | None = None


class _Verdict(Part):
    kind: VerdictKind = Field(strict=False)
    effects: Names = ()
    probability: Probability = 0.0

    @model_validator(mode="after")
    def _check_count(self) -> _Verdict:
        check_count(self.effects, self.kind, NAMED_COUNTS.get(self.kind, (0, float("inf"))))
        return self


class _Diagnosis(Part):
    verdict: _Verdict
    effects: tuple[_Effect, ...] = Field((), strict=False)
    none_probability: Probability | None = None
    unknown: _Unknown = _Unknown()
    gap: _Gap = _Gap()
    conformal_set_90: Names = ()
    where: tuple[ReportedLocation, ...] = Field((), strict=False)

    def probabilities(self) -> dict[str, float]:
        """By effect and answer; what the verdict says of itself alone counts where it is left."""
        out = {entry.name: entry.probability for entry in self.effects}
        if len(out) < len(self.effects):
            raise misfit("effects", [e.name for e in self.effects], "it should hold each name once")
        for name, value in ((NONE, self.none_probability), (UNKNOWN, self.unknown.probability)):
            if value is not None:
                out.setdefault(name, value)
        for name in (NONE, UNKNOWN):
            if name not in out and self.verdict.kind == name:
                out[name] = max(0.0, min(self.verdict.probability, 1.0 - sum(out.values())))
        total = sum(out.values())
        if total > 1.0 + 1e-6:
            raise ValueError(
                f"effects, none_probability and unknown.probability sum to {total:.4g}; "
                "exclusive causes have probabilities that sum to at most 1"
            )
        return out

    @model_validator(mode="after")
    def _check_names(self) -> _Diagnosis:
        known = {*self.probabilities(), NONE, UNKNOWN}
        outside = [name for name in self.verdict.effects if name not in known]
        if self.effects and outside:
            wanted = f"it should be names in effects, where {shown(outside[0])} is not"
            raise misfit("verdict.effects", self.verdict.effects, wanted)
        return self


def read_verdict(folder: Path) -> ReportedVerdict:
    """The diagnosis in a folder, or that there is none because it failed.

    Raises:
        BlindError: neither is there, or a value is missing or of a wrong kind.
    """
    path = folder / DIAGNOSIS_FILE
    if not path.exists():
        failed = folder / FAILED_FILE
        if failed.exists():
            failure = parsed(Failure, read_json(failed), str(failed))
            return ReportedVerdict(VerdictKind.UNRESOLVED, failed=failure)
        raise BlindError(f"{path}: no such file; run `vsr2 blind diagnose` to the end")
    return verdict_of(read_json(path), str(path))


def verdict_of(content: Mapping[str, Any], label: str) -> ReportedVerdict:
    """The verdict in the content of a `diagnosis.json`.

    Args:
        content: of it.
        label: in front of messages.

    Raises:
        BlindError: a value is missing or of a wrong kind.
    """
    if content.get("schema") != SCHEMA:
        raise BlindError(
            f"{label}: schema is {shown(content.get('schema'))}; it should be {SCHEMA!r}"
        )
    read = parsed(_Diagnosis, content, label)
    return ReportedVerdict(
        kind=read.verdict.kind,
        effects=read.verdict.effects,
        probabilities=read.probabilities(),
        conformal=read.conformal_set_90,
        parameters={entry.name: entry.parameters for entry in read.effects},
        closure=read.gap.closure.value,
        headline=read.gap.headline.value,
        gain=read.gap.gain.ci95,
        where=tuple(one for one in read.where if one.trials),
    )
