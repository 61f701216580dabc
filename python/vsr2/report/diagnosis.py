"""A diagnosis for people: a few lines of text, and one self-contained page."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from vsr2.diagnosis import Diagnosis
from vsr2.diagnosis.verdict.document import PAGE_FILE, PAGE_TITLE, finite
from vsr2.report.diagnosis_figures import (
    bars_figure,
    channels_figure,
    map_figure,
    order_figure,
    posterior_figure,
    reliability_figure,
)
from vsr2.report.messages.verdicts import (
    channels_note,
    closure_note,
    instrument,
    interval,
    location,
    next_measurement,
    sentence,
    verdict_sentence,
    with_sentences,
)
from vsr2.report.pages import render
from vsr2.report.panels import svg
from vsr2.results.atomic import write_text

_LEVEL = 0.05


def format_diagnosis(found: Diagnosis) -> str:
    """The verdict, the gap and the leading effects, for a terminal."""
    content = found.content
    gap = content["gap"]
    lines = [
        f"{content['campaign']['name']}: {content['campaign']['trials']} trials, "
        f"tier {content['campaign']['tier']}",
        verdict_sentence(content),
        f"loss a trial: before {interval(gap['before'])}, after {interval(gap['after'])}, "
        f"floor {interval(gap['floor'])}",
        f"closure {interval(gap['closure'])}, of a wrong effect "
        f"{interval(content['negative_control']['closure'])}, headline "
        f"{interval(gap['headline'])}; re-simulated {interval(gap['closure_resimulated'])}",
    ]
    lines.append("probability, effect, its parameters: most probable, mean [95 %]")
    for row in content["effects"][:6]:
        values = ", ".join(_parameter(name, p) for name, p in row["parameters"].items())
        lines.append(f"  {row['probability']:5.2f}  {row['name']:<20} {values}")
    if content["next_measurement"]:
        lines.append(f"next: {next_measurement(content['next_measurement'])}")
    lines += [f"limit: {sentence(limit)}" for limit in content["limits"]]
    return "\n".join(lines)


def _parameter(name: str, found: Mapping[str, Any]) -> str:
    """Most probable value, mean, interval."""
    low, high = found["ci95"]
    unit = "" if found["unit"] == "1" else f" {found['unit']}"
    return f"{name} {found['mode']:.3g}, {found['mean']:.3g} [{low:.3g}, {high:.3g}]{unit}"


def write_diagnosis_page(found: Diagnosis, folder: str | Path) -> Path:
    """Write the page, and beside it the tables and `diagnosis.json` with its sentences.

    Raises:
        ResultError: a file cannot be written.
    """
    replace(found, content=with_sentences(found.content)).save(folder)
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
    layers, measure = content["gap"]["layers"], content["next_measurement"]
    return render(
        "diagnosis.html",
        {
            "instrument": instrument,
            "interval": interval,
            "location": location,
            "parameter": lambda found, name: _parameter(name, found),
            "sentence": sentence,
        },
        **{
            **content,
            "title": f"{PAGE_TITLE} {content['campaign']['name']}",
            "verdict_sentence": verdict_sentence(content),
            "measure_sentence": measure and next_measurement(measure),
            "drawings": {name: Markup(svg(*figure)) for name, figure in figures.items()},
            "closure_note": closure_note(content),
            "channels_note": channels_note(content),
            "found": [row for row in content["where"] if row["p_familywise"] <= _LEVEL],
            "noise_floor": [
                f"{words}: {layers[name]:.1%}"
                for name, words in _LAYERS.items()
                if layers.get(name) is not None
            ],
            "provenance": json.dumps(finite(dict(content["provenance"])), indent=1),
        },
    )


_LAYERS = {
    "numerical": "starts moved by 1e-6 to 1e-4 m and rad",
    "time_step": "half the time step",
    "solver": "twice the solver's iterations",
    "input": "fresh placement and motion noise",
    "nuisance": "fresh geometry, contact and the like",
    "physical": "repeats in the campaign",
}
