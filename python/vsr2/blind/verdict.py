"""`diagnosis.json` as scoring reads it (docs/blind.md describes the form)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vsr2.blind.seal import read_json
from vsr2.errors import BlindError

DIAGNOSIS_SCHEMA = "vsr2.diagnosis/1"
DIAGNOSIS_FILE = "diagnosis.json"
FAILED_FILE = "failed.json"
VERDICTS = ("none", "effect", "class", "pair", "unknown", "unresolved")
NONE, UNKNOWN = "none", "unknown"


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
    reader = _Reader(label)
    if content.get("schema") != DIAGNOSIS_SCHEMA:
        raise reader.error("schema", content.get("schema"), repr(DIAGNOSIS_SCHEMA))
    verdict = reader.mapping(content, "verdict")
    kind = verdict.get("kind")
    if kind not in VERDICTS:
        raise reader.error("verdict.kind", kind, f"one of {', '.join(VERDICTS)}")
    probability = reader.probability(verdict.get("probability", 0.0), "verdict.probability")
    probabilities: dict[str, float] = {}
    parameters: dict[str, dict[str, Estimate]] = {}
    closures: dict[str, float] = {}
    for i, entry in enumerate(reader.sequence(content, "effects")):
        place = f"effects[{i}]"
        name = reader.text(entry.get("name"), f"{place}.name")
        if name in probabilities:
            raise reader.error(f"{place}.name", name, "each name once")
        probabilities[name] = reader.probability(entry.get("probability"), f"{place}.probability")
        parameters[name] = {
            key: reader.estimate(value, f"{place}.parameters.{key}")
            for key, value in (entry.get("parameters") or {}).items()
        }
        closure = reader.value(entry.get("closure"), f"{place}.closure")
        if closure is not None:
            closures[name] = closure
    if content.get("none_probability") is not None and NONE not in probabilities:
        probabilities[NONE] = reader.probability(content["none_probability"], "none_probability")
    told = (content.get("unknown") or {}).get("probability")
    if told is not None and UNKNOWN not in probabilities:
        probabilities[UNKNOWN] = reader.probability(told, "unknown.probability")
    for name in (NONE, UNKNOWN):
        if name not in probabilities and kind == name:
            # What the verdict says of itself is not said twice.
            rest = 1.0 - sum(probabilities.values())
            probabilities[name] = max(0.0, min(probability, rest))
    total = sum(probabilities.values())
    if total > 1.0 + 1e-6:
        raise reader.error("effects", f"{total:.4g}", "probabilities that sum to at most 1")
    gap = content.get("gap") or {}
    novelty_p = (content.get("unknown") or {}).get("novelty_p")
    novelty = probabilities.get(UNKNOWN, 0.0)
    if novelty_p is not None and told is None:
        novelty = 1.0 - reader.probability(novelty_p, "unknown.novelty_p")
    return Verdict(
        kind=str(kind),
        effects=tuple(
            reader.text(n, "verdict.effects") for n in reader.sequence(verdict, "effects")
        ),
        probability=probability,
        probabilities=probabilities,
        conformal=tuple(
            reader.text(n, "conformal_set_90") for n in reader.sequence(content, "conformal_set_90")
        ),
        parameters=parameters,
        closure=reader.value(gap.get("closure"), "gap.closure"),
        closure_high=reader.high(gap.get("closure"), "gap.closure"),
        closures=closures,
        where=tuple(
            reader.found(entry, f"where[{i}]")
            for i, entry in enumerate(reader.sequence(content, "where"))
        ),
        novelty=novelty,
    )


class _Reader:
    def __init__(self, label: str) -> None:
        self._label = label

    def error(self, key: str, value: object, wanted: str) -> BlindError:
        return BlindError(f"{self._label}: {key} is {value!r}; wanted is {wanted}")

    def mapping(self, content: Mapping[str, Any], key: str) -> Mapping[str, Any]:
        value = content.get(key)
        if not isinstance(value, Mapping):
            raise self.error(key, value, "a mapping")
        return value

    def sequence(self, content: Mapping[str, Any], key: str) -> Sequence[Any]:
        value = content.get(key)
        if value is None:
            return ()
        if not isinstance(value, list):
            raise self.error(key, value, "a list")
        return value

    def text(self, value: object, key: str) -> str:
        if not isinstance(value, str):
            raise self.error(key, value, "a name")
        return value

    def number(self, value: object, key: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.error(key, value, "a number")
        return float(value)

    def probability(self, value: object, key: str) -> float:
        number = self.number(value, key)
        if not 0 <= number <= 1 + 1e-9:
            raise self.error(key, value, "a probability")
        return number

    def value(self, value: object, key: str) -> float | None:
        """A number, bare or as `value` of a mapping; None where there is none."""
        if isinstance(value, Mapping):
            value = value.get("value")
        if value is None:
            return None
        number = self.number(value, key)
        return number if math.isfinite(number) else None

    def high(self, value: object, key: str) -> float | None:
        """Upper end of the interval of a mapping; None where there is none."""
        interval = value.get("ci95") if isinstance(value, Mapping) else None
        if not isinstance(interval, list) or len(interval) != 2 or interval[1] is None:
            return None
        return self.number(interval[1], f"{key}.ci95")

    def estimate(self, value: object, key: str) -> Estimate:
        if not isinstance(value, Mapping):
            raise self.error(key, value, "a mapping with mean and ci95")
        interval = value.get("ci95")
        if not isinstance(interval, list) or len(interval) != 2:
            raise self.error(f"{key}.ci95", interval, "two numbers")
        low, high = (self.number(v, f"{key}.ci95") for v in interval)
        return Estimate(self.number(value.get("mean"), f"{key}.mean"), low, high)

    def found(self, entry: object, key: str) -> Found:
        if not isinstance(entry, Mapping):
            raise self.error(key, entry, "a mapping")
        trials = entry.get("trials")
        if trials is not None and not isinstance(trials, list):
            raise self.error(f"{key}.trials", trials, "a list of trial ids")
        return Found(
            self.text(entry.get("axis"), f"{key}.axis"),
            self.probability(entry.get("p_familywise"), f"{key}.p_familywise"),
            None if trials is None else frozenset(str(t) for t in trials),
        )
