"""`diagnosis.json` as scoring reads it (docs/reference/blind.md describes the form)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vsr2.blind.form.reader import Node
from vsr2.blind.form.seal import read_json
from vsr2.config.problems import shown
from vsr2.errors import BlindError

DIAGNOSIS_SCHEMAS = ("vsr2.diagnosis/1", "vsr2.diagnosis/2")
"""What is read here stands alike in both."""
DIAGNOSIS_FILE = "diagnosis.json"
FAILED_FILE = "failed.json"
VERDICTS = ("none", "effect", "class", "pair", "unknown", "unresolved")
NONE, UNKNOWN = "none", "unknown"
_NAMED: Mapping[str, tuple[int, int | None]] = {
    "effect": (1, 1),
    "class": (1, None),
    "pair": (2, 2),
}
"""Least and greatest number of effects that a verdict names, by kind; None: any."""


@dataclass(frozen=True)
class Estimate:
    """A number with its interval."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True)
class Found:
    """One place of a gap.

    Attributes:
        axis: condition, order, session, specimen, channel or phase.
        p: family-wise.
        trials: inside the place; None: not told.
    """

    axis: str
    p: float
    trials: frozenset[str] | None


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
        closure_high: upper end of its 95 % interval; None: not told.
        closures: by effect, where told.
        where: places of the gap.
        novelty: how much the campaign looks like none of the library's, 0 to 1.
        failed: why there is no diagnosis; then all else says `unresolved`.
    """

    kind: str
    effects: tuple[str, ...] = ()
    probability: float = 0.0
    probabilities: Mapping[str, float] = field(default_factory=dict)
    conformal: tuple[str, ...] = ()
    parameters: Mapping[str, Mapping[str, Estimate]] = field(default_factory=dict)
    closure: float | None = None
    closure_high: float | None = None
    closures: Mapping[str, float] = field(default_factory=dict)
    where: tuple[Found, ...] = ()
    novelty: float = 0.0
    failed: str = ""


def read_verdict(folder: Path) -> Verdict:
    """The diagnosis in a folder, or that there is none because it failed.

    Raises:
        BlindError: neither is there, or a value is missing or of a wrong kind.
    """
    path = folder / DIAGNOSIS_FILE
    if not path.exists():
        failed = folder / FAILED_FILE
        if failed.exists():
            return Verdict("unresolved", failed=str(read_json(failed).get("error", "failed")))
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
    whole = Node(content, label)
    if content.get("schema") not in DIAGNOSIS_SCHEMAS:
        raise whole.error("schema", " or ".join(map(repr, DIAGNOSIS_SCHEMAS)))
    verdict = whole.node("verdict")
    kind = verdict.choice("kind", VERDICTS)
    probability = verdict.probability("probability") if verdict.has("probability") else 0.0
    probabilities: dict[str, float] = {}
    parameters: dict[str, dict[str, Estimate]] = {}
    closures: dict[str, float] = {}
    entries = whole.nodes("effects")
    for entry in entries:
        name = entry.text("name")
        if name in probabilities:
            raise entry.error("name", "each name once")
        probabilities[name] = entry.probability("probability")
        parameters[name] = _estimates(entry)
        closure, _ = _closure(entry)
        if closure is not None:
            closures[name] = closure
    named = verdict.names("effects", "names of effects")
    verdict.check_count("effects", _NAMED.get(kind, (0, None)), f"as the kind is {kind}")
    if whole.has("none_probability") and NONE not in probabilities:
        probabilities[NONE] = whole.probability("none_probability")
    unknown = whole.node("unknown") if whole.has("unknown") else Node({}, label)
    told = unknown.has("probability")
    if told and UNKNOWN not in probabilities:
        probabilities[UNKNOWN] = unknown.probability("probability")
    for name in (NONE, UNKNOWN):
        if name not in probabilities and kind == name:
            # What the verdict says of itself is not said twice.
            rest = 1.0 - sum(probabilities.values())
            probabilities[name] = max(0.0, min(probability, rest))
    total = sum(probabilities.values())
    if total > 1.0 + 1e-6:
        raise BlindError(
            f"{label}: effects, none_probability and unknown.probability sum to {total:.4g}; "
            "wanted are probabilities of exclusive causes, whose sum is at most 1"
        )
    strange = [name for name in named if name not in {*probabilities, NONE, UNKNOWN}]
    if entries and strange:
        raise verdict.error("effects", f"names in effects, where {shown(strange[0])} is not")
    novelty = probabilities.get(UNKNOWN, 0.0)
    if unknown.has("novelty_p") and not told:
        novelty = 1.0 - unknown.probability("novelty_p")
    closure, closure_high = None, None
    if whole.has("gap"):
        closure, closure_high = _closure(whole.node("gap"))
    return Verdict(
        kind=kind,
        effects=named,
        probability=probability,
        probabilities=probabilities,
        conformal=whole.names("conformal_set_90", "names of effects"),
        parameters=parameters,
        closure=closure,
        closure_high=closure_high,
        closures=closures,
        where=tuple(_found(place) for place in whole.nodes("where")),
        novelty=novelty,
    )


def _estimates(entry: Node) -> dict[str, Estimate]:
    if not entry.has("parameters"):
        return {}
    parameters = entry.node("parameters")
    out = {}
    for name in parameters.content:
        value = parameters.node(name)
        low, high = value.interval("ci95")
        out[name] = Estimate(value.number("mean"), low, high)
    return out


def _closure(node: Node) -> tuple[float | None, float | None]:
    """The closure, bare or as `value`, and the upper end of its interval; None: not told."""
    if not isinstance(node.content.get("closure"), Mapping):
        return (node.number("closure") if node.has("closure") else None), None
    closure = node.node("closure")
    value = closure.number("value") if closure.has("value") else None
    ends = closure.items("ci95")
    if not ends or None in ends:
        return value, None
    return value, closure.interval("ci95")[1]


def _found(place: Node) -> Found:
    return Found(
        place.text("axis"),
        place.probability("p_familywise"),
        frozenset(place.names("trials", "ids of trials")) if place.has("trials") else None,
    )
