"""`diagnosis.json` as scoring reads it (docs/reference/blind.md describes the form)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, ConfigDict, Field, model_validator

from vsr2.blind.form.reader import (
    Interval,
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
from vsr2.diagnosis.verdict.statements import VerdictKind
from vsr2.errors import BlindError

DIAGNOSIS_SCHEMAS = ("vsr2.diagnosis/1", "vsr2.diagnosis/2", "vsr2.diagnosis/3")
"""What is read here stands alike in all."""
DIAGNOSIS_FILE = "diagnosis.json"
FAILED_FILE = "failed.json"
NONE, UNKNOWN = "none", "unknown"


NAMING: Mapping[VerdictKind, tuple[int, float]] = {
    VerdictKind.EFFECT: (1, 1),
    VerdictKind.CLASS: (1, float("inf")),
    VerdictKind.PAIR: (2, 2),
}
"""Kinds that name effects, with the least and greatest number of them."""


def _or_infinite(value: object) -> object:
    """Null is infinity, as a parameter without effect may have it."""
    if isinstance(value, list):
        return [_or_infinite(one) for one in value]
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError("it should be a finite number, or null for infinity")
    return math.inf if value is None else value


class Estimate(Part):
    """A number with its 95 % interval."""

    model_config = ConfigDict(allow_inf_nan=True)
    nullable = frozenset({"mean"})

    mean: Annotated[float, BeforeValidator(_or_infinite)]
    ci95: Annotated[Interval, BeforeValidator(_or_infinite)]


class Location(Part):
    """One location of a gap.

    Attributes:
        axis: condition, order, session, specimen, channel or phase.
        p_familywise: p value.
        trials: inside it; None: not given.
    """

    axis: Name
    p_familywise: Probability
    trials: Annotated[frozenset[Name], Field(strict=False)] | None = None


@dataclass(frozen=True)
class Verdict:
    """What a diagnosis says of one campaign.

    Attributes:
        kind: of the verdict.
        effects: that it names.
        probability: of the verdict.
        probabilities: by effect, with `none` and `unknown`, which sum to at most 1.
        conformal: the 90 % set.
        parameters: estimates by effect and parameter.
        closure: of the verdict; None: no ratio.
        closure_high: upper end of its 95 % interval; None: not given.
        closures: by effect, where given.
        where: locations of the gap.
        novelty: how much the campaign looks like none of the library's, 0 to 1.
        failed: why there is no diagnosis; then all else says `unresolved`.
    """

    kind: VerdictKind
    effects: tuple[str, ...] = ()
    probability: float = 0.0
    probabilities: Mapping[str, float] = field(default_factory=dict)
    conformal: tuple[str, ...] = ()
    parameters: Mapping[str, Mapping[str, Estimate]] = field(default_factory=dict)
    closure: float | None = None
    closure_high: float | None = None
    closures: Mapping[str, float] = field(default_factory=dict)
    where: tuple[Location, ...] = ()
    novelty: float = 0.0
    failed: str = ""


def _bare(closure: object) -> object:
    """A closure is a number, or a mapping whose interval may lack an end."""
    if isinstance(closure, Mapping):
        known = closure.get("ci95")
        gone = isinstance(known, list) and (not known or None in known)
        return {**closure, "ci95": None} if gone else closure
    return {"value": closure}


class _Closure(Part):
    value: float | None = None
    ci95: Interval | None = None


_GivenClosure = Annotated[_Closure, BeforeValidator(_bare)]


class _Effect(Part):
    name: Name
    probability: Probability
    parameters: dict[str, Estimate] = Field(default_factory=dict)
    closure: _GivenClosure = _Closure()


class _Unknown(Part):
    probability: Probability | None = None
    novelty_p: Probability | None = None


class _Gap(Part):
    closure: _GivenClosure = _Closure()


class _Verdict(Part):
    kind: VerdictKind = Field(strict=False)
    effects: Names = ()
    probability: Probability = 0.0

    @model_validator(mode="after")
    def _check_count(self) -> _Verdict:
        check_count(self.effects, self.kind, NAMING.get(self.kind, (0, float("inf"))))
        return self


class _Diagnosis(Part):
    verdict: _Verdict
    effects: tuple[_Effect, ...] = Field((), strict=False)
    none_probability: Probability | None = None
    unknown: _Unknown = _Unknown()
    gap: _Gap = _Gap()
    conformal_set_90: Names = ()
    where: tuple[Location, ...] = Field((), strict=False)

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


def read_verdict(folder: Path) -> Verdict:
    """The diagnosis in a folder, or that there is none because it failed.

    Raises:
        BlindError: neither is there, or a value is missing or of a wrong kind.
    """
    path = folder / DIAGNOSIS_FILE
    if not path.exists():
        failed = folder / FAILED_FILE
        if failed.exists():
            error = str(read_json(failed).get("error", "failed"))
            return Verdict(VerdictKind.UNRESOLVED, failed=error)
        raise BlindError(f"{path}: no such file; run `vsr2 blind diagnose` to the end")
    return verdict_of(read_json(path), str(path))


def verdict_of(content: Mapping[str, Any], label: str) -> Verdict:
    """The verdict in the content of a `diagnosis.json`.

    Args:
        content: of it.
        label: in front of messages.

    Raises:
        BlindError: a value is missing or of a wrong kind.
    """
    if content.get("schema") not in DIAGNOSIS_SCHEMAS:
        raise BlindError(
            f"{label}: schema is {shown(content.get('schema'))}; it should be "
            f"{' or '.join(DIAGNOSIS_SCHEMAS)}"
        )
    read = parsed(_Diagnosis, content, label)
    probabilities = read.probabilities()
    novelty = probabilities.get(UNKNOWN, 0.0)
    if read.unknown.novelty_p is not None and read.unknown.probability is None:
        novelty = 1.0 - read.unknown.novelty_p
    own = read.gap.closure
    return Verdict(
        kind=read.verdict.kind,
        effects=read.verdict.effects,
        probability=read.verdict.probability,
        probabilities=probabilities,
        conformal=read.conformal_set_90,
        parameters={entry.name: entry.parameters for entry in read.effects},
        closure=own.value,
        closure_high=None if own.ci95 is None else own.ci95[1],
        closures={e.name: e.closure.value for e in read.effects if e.closure.value is not None},
        where=read.where,
        novelty=novelty,
    )
