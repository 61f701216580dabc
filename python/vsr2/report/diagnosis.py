"""A diagnosis for people: a few lines of text, and one self-contained page."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsr2.diagnosis import Diagnosis
from vsr2.diagnosis.verdict.document import PAGE_FILE, PAGE_TITLE, finite
from vsr2.report.diagnosis_figures import (
    channels_figure,
    effects_figure,
    losses_figure,
    map_figure,
    order_figure,
    reliability_figure,
    sets_figure,
)
from vsr2.report.messages.verdicts import (
    channels_note,
    closure_note,
    instrument,
    interval,
    location,
    next_measurement,
    sentence,
    standing_out,
    verdict_sentence,
    with_sentences,
)
from vsr2.report.pages import render
from vsr2.report.panels import svg
from vsr2.results.atomic import write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def format_diagnosis(found: Diagnosis) -> str:
    """The verdict, the gap and the leading effects, for a terminal."""
    content = found.content
    gap, control = content["gap"], content["negative_control"]
    lines = [
        f"{content['campaign']['name']}: {content['campaign']['trials']} trials, "
        f"tier {content['campaign']['tier']}",
        verdict_sentence(content),
        f"loss a trial: before {interval(gap['before'])}, after {interval(gap['after'])}, "
        f"floor {interval(gap['floor'])}",
    ]
    if gap["effects"]:
        lines.append(
            f"closure {interval(gap['closure'])}, of a recalibration "
            f"{interval(control['recalibrated']['closure'])}, dealt to wrong trials "
            f"{interval(control['dealt']['closure'])}, headline {interval(gap['headline'])}"
        )
    if content["next_measurement"]:
        lines.append(f"next: {next_measurement(content['next_measurement'])}")
    lines.append("probability that it acts, effect, its parameters: median [90 %]")
    for row in _by_acts(content)[:6]:
        values = ", ".join(_parameter(p, name) for name, p in row["parameters"].items())
        lines.append(f"  {row['acts']:5.2f}  {row['name']:<20} {values}")
    lines += [f"limit: {sentence(limit)}" for limit in content["limits"]]
    return "\n".join(lines)


def _by_acts(content: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return sorted(content["effects"], key=lambda row: -row["acts"])


def _parameter(found: Mapping[str, Any], name: str) -> str:
    """Median and 90 % interval, given that its effect acts."""
    low, high = found["ci90"]
    unit = "" if found["unit"] == "1" else f" {found['unit']}"
    return f"{name} {found['median']:.3g} [{low:.3g}, {high:.3g}]{unit}"


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
    layers, measure = content["gap"]["layers"], content["next_measurement"]
    return render(
        "diagnosis.html",
        {
            "instrument": instrument,
            "interval": interval,
            "location": location,
            "parameter": _parameter,
            "sentence": sentence,
        },
        **{
            **content,
            "effects": _by_acts(content),
            "title": f"{PAGE_TITLE} {content['campaign']['name']}",
            "verdict_sentence": verdict_sentence(content),
            "measure_sentence": measure and next_measurement(measure),
            "drawings": {
                name: Markup(svg(*figure)) for name, figure in diagnosis_figures(found).items()
            },
            "closure_note": closure_note(content),
            "channels_note": channels_note(content),
            "found": standing_out(content),
            "noise_floor": [
                f"{words}: {layers[name]:.1%}"
                for name, words in _LAYERS.items()
                if layers.get(name) is not None
            ],
            "provenance": json.dumps(finite(dict(content["provenance"])), indent=1),
        },
    )


def diagnosis_figures(found: Diagnosis) -> dict[str, tuple[Figure, str]]:
    """All figures of the page by name, each with what it shows."""
    content = found.content
    return {
        "sets": (sets_figure(content), "probability of each set of effects"),
        "effects": (effects_figure(content), "probability that each effect acts"),
        "losses": (losses_figure(content), "mean loss before, after, and of controls"),
        "map": (map_figure(found.trials), "gap over conditions"),
        "order": (order_figure(found.trials), "residuals over the order of execution"),
        "channels": (channels_figure(content), "gap over channels and phases"),
        "reliability": (reliability_figure(found.trials), "predicted against observed"),
    }


_LAYERS = {
    "numerical": "starts moved by 1e-6 to 1e-4 m and rad",
    "time_step": "half the time step",
    "solver": "twice the solver's iterations",
    "input": "fresh placement and motion noise",
    "nuisance": "fresh geometry, contact and the like",
    "physical": "repeats in the campaign",
}
