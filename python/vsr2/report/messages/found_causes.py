"""What a search for causes found, as text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from vsr2.causes.margins.cause_space import NotJudged
from vsr2.diagnosis.how_far.held_out import Loss
from vsr2.one_line import counted
from vsr2.report.messages.commands import table
from vsr2.report.messages.templates import NO_BOUNDS, check_worded

if TYPE_CHECKING:
    from vsr2.causes import Causes

_LISTED = 0.05
"""Probability from which an effect stands in the table."""
_MINUTE = 60.0
_NOT_JUDGED = {
    NotJudged.DIFFERS_BY_TRIAL: "differs from trial to trial, as scatter does",
    NotJudged.PART_NOT_JUDGED: "brings in an effect that is not looked for",
    NotJudged.NOTED_ALONE: "changes what is noted, not what happens",
}
check_worded(NotJudged, _NOT_JUDGED, __name__)
CONTROL_LABELS = {
    Loss.RECALIBRATED: "control: rescaled",
    Loss.DEALT: "control: dealt",
}
"""Negative controls: probabilities of the scene as it is, rescaled; and what the causes change,
dealt to other trials of like intensity."""
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
    parts = [_causes(content), _together(content), _waterfall(content), _closed(content)]
    parts += [_scores(content), _corrected(content), _left_out(content)]
    parts.append(_cost(content["provenance"]))
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
    leading = content["causes"][0]
    head = (
        f"most probable: {leading['name']}, with {leading['acts']:.2f} by these scenes; other "
        "scenes (--seed) may say otherwise, so believe what two seeds find"
    )
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
    rows.append(["scene as it is", _interval(held_out["as_it_is"]["loss"]), ""])
    for label, cause, loss in waterfall_steps(content):
        share = _interval(held_out["shares"][cause]["of_gap"]) if cause else ""
        rows.append([label, _interval(loss), share])
    rows.append(["with all effects", _interval(held_out["all"]["loss"]), ""])
    rows.append(["with the likely ones", _interval(held_out["likely"]["loss"]), ""])
    rows.append(["floor: a campaign without a gap", _interval(held_out["floor"]["loss"]), ""])
    by_position = [["takes off the loss", "added first", "mean of all orders", "added last"]]
    by_position += [
        [cause, *(_interval(own[name]) for name in ("first", "loss", "last"))]
        for cause, own in held_out["shares"].items()
    ]
    parts = [_likely_in(held_out["likely"]), table(rows, str.ljust), table(by_position, str.ljust)]
    return "\n\n".join(parts)


def _likely_in(likely: Mapping[str, Any]) -> str:
    """In how many folds each cause is likely."""
    counts = ", ".join(f"{name} in {count}" for name, count in likely["folds"].items())
    folds = counted(likely["of"], "fold")
    return f"likely by the motions outside each of {folds}: {counts or 'nothing in any'}"


def _closed(content: Mapping[str, Any]) -> str:
    """What closes the gap, and how much of it is due to causes."""
    held_out = content["held_out"]
    together, scatter = held_out["all"]["closure"], held_out["scatter_alone"]["closure"]
    beyond = held_out["beyond_scatter"]
    said = (
        "no closure is given: the scene as it is loses no more than the floor"
        if together["value"] is None
        else f"of the gap fitted scatter alone, which is no cause, closes {_interval(scatter)}; "
        f"causes close a further {_interval(beyond)}; together {_interval(together)}"
    )
    rows = [
        ["closure of the gap", _interval(together)],
        ["scatter alone", _interval(scatter)],
        ["causes beyond scatter", _interval(beyond)],
    ]
    for name, label in CONTROL_LABELS.items():
        rows.append([label, _interval(held_out["controls"][name]["closure"])])
    rows.append(["causes beyond the better control", _interval(held_out["beyond_controls"])])
    if held_out["logistic"] is not None:
        rows.append(["logistic curve", _interval(held_out["logistic"]["closure"])])
        rows.append(["causes beyond the logistic curve", _interval(held_out["beyond_logistic"])])
    return f"{said}\n\n{table(rows, str.ljust)}"


def _cost(provenance: Mapping[str, Any]) -> str:
    """Of this run; what an earlier one simulated costs nothing again."""
    spent, search = provenance["wall_time_s"] / _MINUTE, provenance["search_time_s"] / _MINUTE
    reused = provenance["simulations"] - provenance["simulated"]
    return (
        f"took {spent:.1f} min with {counted(provenance['threads'], 'thread')}, {search:.1f} of "
        f"them for {counted(provenance['simulated'], 'simulation')} ({reused} reused)"
    )


def waterfall_steps(content: Mapping[str, Any]) -> list[tuple[str, str | None, Mapping[str, Any]]]:
    """Label, cause (None: the first step has none) and loss of each step."""
    steps, before = [], set()
    for step in content["held_out"]["waterfall"]:
        new = next((name for name in step["causes"] if name not in before), None)
        before = set(step["causes"])
        steps.append((f"+ {new}" if new else "scatter fitted", new, step["loss"]))
    return steps


def _scores(content: Mapping[str, Any]) -> str:
    held_out = content["held_out"]
    rows = [["out of fold", *_SCORES.values()]]
    given = [("all effects", held_out["scores"])]
    given.append(("likely ones", held_out["likely"]["scores"]))
    if held_out["logistic"] is not None:
        given.append(("logistic curve", held_out["logistic"]["scores"]))
    given.append(("without a gap", held_out["floor"]["scores"]))
    for label, scores in given:
        cells = (_interval(scores[name]) if name in scores else "" for name in _SCORES)
        rows.append([label, *cells])
    return table(rows, str.ljust)


def _corrected(content: Mapping[str, Any]) -> str:
    """What the corrected scene holds, and what it cannot hold."""
    added, lacking = ", ".join(content["corrected"]), ", ".join(content["not_stated"])
    said = f"the corrected scene adds {added}" if added else "there is no corrected scene"
    if not added and not lacking:
        return f"{said}: no effect is likely"
    return said + (f"; no study can add {lacking} to the scene" if lacking else "")


def _left_out(content: Mapping[str, Any]) -> str:
    """Effects that were not looked for, and why."""
    given = [f"{name} ({_NOT_JUDGED[code]})" for name, code in content["not_judged"].items()]
    given += [f"{name} (left out)" for name in content["excluded"]]
    given += [f"{name} (impossible in this scene)" for name in content["unavailable"]]
    return f"not looked for: {', '.join(given)}"


def _interval(one: Mapping[str, Any]) -> str:
    if one["value"] is None:
        return "-"
    if one["ci95"] is None:
        return f"{one['value']:.3f} {NO_BOUNDS}"
    low, high = one["ci95"]
    return f"{one['value']:.3f} [{low:.3f}, {high:.3f}]"


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:.3g}"


def _unit(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"
