"""A diagnosis for people: a few lines of text, and one self-contained page."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vsr2.diagnosis import Diagnosis
from vsr2.diagnosis.verdict.result import PAGE_FILE, PAGE_TITLE, finite
from vsr2.diagnosis.verdict.rules import NO_GAP
from vsr2.report.diagnosis_figures import (
    bars_figure,
    channels_figure,
    map_figure,
    order_figure,
    posterior_figure,
    reliability_figure,
)
from vsr2.report.pages import listed, render
from vsr2.report.panels import svg
from vsr2.results.atomic import write_text

_LEVEL = 0.05


def verdict_sentence(content: Mapping[str, Any]) -> str:
    """The verdict in one sentence."""
    verdict = content["verdict"]
    names = [str(name).replace("_", " ") for name in verdict["effects"]]
    chance = f"{verdict['probability']:.0%}" if verdict["probability"] < 0.995 else "over 99%"
    match verdict["kind"]:
        case "none":
            found = [row for row in content["where"] if row["p_familywise"] <= _LEVEL]
            if found:
                return (
                    "No gap beyond noise in the loss, but residuals stand out: "
                    f"{found[0]['place'].replace('_', ' ')} (family-wise p "
                    f"{found[0]['p_familywise']:.2g})."
                )
            return (
                "No gap beyond noise: this campaign gives no reason to change the model, and does "
                f"not exclude what is too weak to show (none: {chance})."
            )
        case "effect":
            said = f"Of the effects in the library, {names[0]} explains the gap ({chance})"
        case "class":
            groups = {
                row["class"] for row in content["effects"] if row["name"] in verdict["effects"]
            }
            does = "cannot tell them apart" if len(groups) == 1 else "does not decide between them"
            said = (
                f"Of the effects in the library, {listed(names)} explains the gap ({chance} "
                f"together; this campaign {does})"
            )
        case "pair":
            said = f"{listed(names, 'and').capitalize()} together explain the gap ({chance})"
        case "unknown":
            return (
                f"There is a gap; no effect of the library explains it ({chance}), and no pair of "
                "them was found that does."
            )
        case _:
            if verdict["reasons"][0].startswith(NO_GAP):
                said = "Whether there is a gap is not resolved"
            elif content["gap"]["headline"]["ci95"] is None:
                said = "There are signs of a gap, but its size is not told from zero"
            else:
                said = "There is a gap, but its cause is not resolved"
            if not names:
                return f"{said}."
            outside = content["unknown"]["probability"]
            if outside > 0.5:
                return (
                    f"{said}; most probable is a cause outside the library ({outside:.0%}), before "
                    f"{_candidates(names)}."
                )
            are = "the leading candidate is" if len(names) == 1 else "candidates are"
            return f"{said}; {are} {_candidates(names)}."
    bounds = content["gap"]["headline"]["ci95"]
    if bounds[0] <= 0 or content["gap"]["closure"]["ci95"][0] <= 0:
        return f"{said}, but not surely better than a wrong effect or a plain rescaling does."
    closed = content["gap"]["closure"]["value"]
    return f"{said}: added, it closes {closed:.0%} of the gap on motions that it did not see."


def _candidates(names: Sequence[str]) -> str:
    """The first four, and how many more."""
    if len(names) <= 4:
        return listed(names, "and")
    return f"{', '.join(names[:4])} and {len(names) - 4} more"


def format_diagnosis(found: Diagnosis) -> str:
    """The verdict, the gap and the leading effects, for a terminal."""
    content = found.content
    gap = content["gap"]
    lines = [
        f"{content['campaign']['name']}: {content['campaign']['trials']} trials, "
        f"tier {content['campaign']['tier']}",
        verdict_sentence(content),
        f"loss a trial: before {_interval(gap['before'])}, after {_interval(gap['after'])}, "
        f"floor {_interval(gap['floor'])}",
        f"closure {_interval(gap['closure'])}, of a wrong effect "
        f"{_interval(content['placebo']['closure'])}, headline {_interval(gap['headline'])}; "
        f"simulated anew {_interval(gap['closure_anew'])}",
    ]
    lines.append("probability, effect, its parameters: most probable, mean [95 %]")
    for row in content["effects"][:6]:
        values = ", ".join(_parameter(name, p) for name, p in row["parameters"].items())
        lines.append(f"  {row['probability']:5.2f}  {row['name']:<20} {values}")
    if content["next_measurement"]:
        lines.append(f"next: {content['next_measurement']['what']}")
    lines += [f"limit: {text}" for text in content["limits"]]
    return "\n".join(lines)


def _parameter(name: str, found: Mapping[str, Any]) -> str:
    """Most probable value, mean, interval."""
    low, high = found["ci95"]
    unit = "" if found["unit"] == "1" else f" {found['unit']}"
    return f"{name} {found['mode']:.3g}, {found['mean']:.3g} [{low:.3g}, {high:.3g}]{unit}"


def write_diagnosis_page(found: Diagnosis, folder: str | Path) -> Path:
    """Write the page into a folder.

    Raises:
        ResultError: it cannot be written.
    """
    path = Path(folder) / PAGE_FILE
    write_text(path, diagnosis_page(found))
    return path


def diagnosis_page(found: Diagnosis) -> str:
    """One HTML page that needs no other file and no network."""
    from markupsafe import Markup

    content = found.content
    figures = {
        "posterior": (posterior_figure(content), "probability of each hypothesis"),
        "bars": (bars_figure(content), "mean loss"),
        "map": (map_figure(found.trials), "gap over conditions"),
        "order": (order_figure(found.trials), "residuals over the order of execution"),
        "channels": (channels_figure(content), "gap over channels and phases"),
        "reliability": (reliability_figure(found.trials), "predicted against observed"),
    }
    layers = content["gap"]["layers"]
    return render(
        "diagnosis.html",
        {"interval": _interval, "parameter": lambda found, name: _parameter(name, found)},
        **{
            **content,
            "title": f"{PAGE_TITLE} {content['campaign']['name']}",
            "sentence": verdict_sentence(content),
            "reasons": content["verdict"]["reasons"],
            "drawings": {name: Markup(svg(*figure)) for name, figure in figures.items()},
            "closure_note": _closure_note(content),
            "channels_note": _channels_note(content),
            "found": [row for row in content["where"] if row["p_familywise"] <= _LEVEL],
            "noise_floor": [
                f"{words}: {layers[name]:.1%}"
                for name, words in _LAYERS.items()
                if layers.get(name) is not None
            ],
            "provenance": json.dumps(finite(dict(content["provenance"])), indent=1),
        },
    )


def _closure_note(content: Mapping[str, Any]) -> str:
    gap, placebo = content["gap"], content["placebo"]
    size = f"The gap is {_interval(gap['excess'])} nat a trial over the floor. "
    if gap["closure"]["value"] is None:
        return size + "No closure is given, because the gap's interval touches the floor."
    return (
        f"{size}Closure {_interval(gap['closure'])}; placebo {_interval(placebo['closure'])} "
        f"({str(placebo['effect']).replace('_', ' ')}); recalibration "
        f"{_interval(placebo['recalibration'])}. Headline, closure minus the better of these, or "
        f"0: {_interval(gap['headline'])}.{_anew(gap)}"
    )


def _anew(gap: Mapping[str, Any]) -> str:
    if gap["closure_anew"]["value"] is None:
        return ""
    return (
        " These are the emulator's; the uncertain trials simulated anew with what was chosen on "
        f"other motions, judged by simulations alone: closure {_interval(gap['closure_anew'])}."
    )


def _channels_note(content: Mapping[str, Any]) -> str:
    unseen = {
        "B": "Outcomes alone tell nothing of phases; largest tilts and series would. ",
        "M": "Series would tell uplift, impacts, decay and rest pose apart. ",
    }
    if any(row["channel"] == "table" for row in content["where"]):
        table = "Record gain and phase: the table's acceleration against its displacement."
    else:
        table = (
            "The table's motion was recorded once, so that it cannot be checked: its errors show "
            "in the response alone."
        )
    return unseen.get(content["campaign"]["tier"], "") + table


_LAYERS = {
    "numerical": "starts moved by 1e-6 to 1e-4 m and rad",
    "time_step": "half the time step",
    "solver": "twice the solver's iterations",
    "input": "fresh placement and motion noise",
    "nuisance": "fresh geometry, contact and the like",
    "physical": "repeats in the campaign",
}


def _interval(estimate: Mapping[str, Any]) -> str:
    value, bounds = estimate["value"], estimate["ci95"]
    if value is None or not math.isfinite(value):
        return "not given"
    return f"{value:.2f} [{bounds[0]:.2f}, {bounds[1]:.2f}]"
