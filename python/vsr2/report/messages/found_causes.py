"""What a search for causes found, as text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from vsr2.diagnosis.margins.cause_space import NotJudged
from vsr2.report.messages.commands import table
from vsr2.report.messages.templates import check_worded, counted

if TYPE_CHECKING:
    from vsr2.diagnosis import Causes

_LISTED = 0.05
"""Probability from which an effect stands in the table."""
_NOT_JUDGED = {
    NotJudged.DIFFERS_BY_TRIAL: "differs from trial to trial, as scatter does",
    NotJudged.ON_PART_OF_TRIALS: "acts on a part of the trials",
    NotJudged.NOTED_ALONE: "changes what is noted, not what happens",
}
check_worded(NotJudged, _NOT_JUDGED, __name__)
_SCORES = {
    "log_loss": "log loss",
    "brier": "Brier",
    "accuracy": "accuracy",
    "precision": "precision",
    "recall": "recall",
    "objective": "mean of three",
}


def causes_text(found: Causes) -> str:
    """Causes with their sizes, sets of them, the losses step by step, and scores: lines."""
    content = found.content
    parts = [_causes(content), _together(content), _waterfall(content), _scores(content)]
    parts.append(_left_out(content))
    return "\n\n".join(parts) + "\n"


def _causes(content: Mapping[str, Any]) -> str:
    rows = [["effect", "acts", "size where it acts, with 90 % interval"]]
    for row in content["causes"]:
        if row["acts"] < _LISTED:
            continue
        sizes = [
            f"{name} {_number(one['mean'])} [{_number(one['interval'][0])}, "
            f"{_number(one['interval'][1])}]{_unit(one['unit'])}"
            for name, one in row["parameters"].items()
        ]
        rows.append([row["name"], f"{row['acts']:.2f}", "; ".join(sizes)])
    named = ", ".join(content["named"])
    head = f"named: {named}" if named else "no effect is named: none acts with enough certainty"
    quality = content["emulator"]
    knows = f"margins of {counted(quality['used'], 'scene')}; " + (
        "they are equal in all of them, and tell nothing"
        if quality["error"] is None
        else f"those of a scene left out are predicted to {quality['error']:.3f}, "
        f"where they spread by {quality['spread']:.3f}"
    )
    return f"{head}\n{knows}\n\n{table(rows, str.ljust)}"


def _together(content: Mapping[str, Any]) -> str:
    rows = [["probability", "what acts together"]]
    rows += [
        [f"{one['probability']:.2f}", ", ".join(one["names"]) or "nothing"]
        for one in content["together"]
    ]
    return table(rows, str.ljust)


def _waterfall(content: Mapping[str, Any]) -> str:
    held_out = content["held_out"]
    rows = [["loss a trial, motions that were not seen", "", "share of the gap, over all orders"]]
    before: set[str] = set()
    for step in held_out["waterfall"]:
        new = [name for name in step["causes"] if name not in before]
        before = set(step["causes"])
        share = _interval(held_out["shares"][new[0]]["of_gap"]) if new else ""
        label = f"with {new[0]}" if new else "scene as it is, scatter fitted"
        rows.append([label, _interval(step["loss"]), share])
    rows.append(["with all effects", _interval(held_out["all"]["loss"]), ""])
    rows.append(["floor: were the probabilities true", _interval(held_out["floor"]["loss"]), ""])
    return f"{table(rows, str.ljust)}\nclosure: {_interval(held_out['closure'])}"


def _scores(content: Mapping[str, Any]) -> str:
    held_out = content["held_out"]
    rows = [["out of fold", *_SCORES.values()]]
    for label, key in (("these causes", "scores"), ("logistic curve", "logistic")):
        if held_out[key] is not None:
            rows.append([label, *(_interval(held_out[key][name]) for name in _SCORES)])
    return table(rows, str.ljust)


def _left_out(content: Mapping[str, Any]) -> str:
    """Effects that were not looked for, and why."""
    given = [f"{name} ({_NOT_JUDGED[code]})" for name, code in content["not_judged"].items()]
    given += [f"{name} (left out)" for name in content["excluded"]]
    given += [f"{name} (impossible in this scene)" for name in content["unavailable"]]
    return f"not looked for: {', '.join(given)}"


def _interval(one: Mapping[str, Any]) -> str:
    if one["value"] is None:
        return "-"
    low, high = one["ci95"]
    return f"{one['value']:.3f} [{low:.3f}, {high:.3f}]"


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:.3g}"


def _unit(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"
