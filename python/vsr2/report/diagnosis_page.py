"""A diagnosis for people: a few lines of text, and one self-contained page."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsr2.diagnosis import Diagnosis
from vsr2.diagnosis.verdict.document import PAGE_FILE, finite
from vsr2.report.diagnosis_figures import (
    channels_figure,
    effects_figure,
    losses_figure,
    map_figure,
    order_figure,
    reliability_figure,
    sets_figure,
    waterfall_figure,
)
from vsr2.report.messages.verdicts import (
    channels_note,
    closure_note,
    corrected_note,
    figure_caption,
    instrument,
    interval,
    location,
    next_measurement,
    noise_floor,
    nothing_found_note,
    parameters,
    phase,
    sentence,
    standing_out,
    verdict_sentence,
    waterfall_note,
    with_sentences,
)
from vsr2.report.pages import render
from vsr2.report.panels import svg
from vsr2.results.atomic import write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def format_diagnosis(found: Diagnosis) -> str:
    """The verdict, the gap and the leading effects, for a terminal."""
    return _rendered("diagnosis.txt", found).removesuffix("\n")


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

    return _rendered(
        "diagnosis.html",
        found,
        title=f"Diagnosis of {found.content['campaign']['name']}",
        drawings={name: Markup(svg(*figure)) for name, figure in diagnosis_figures(found).items()},
        provenance=json.dumps(finite(dict(found.content["provenance"])), indent=1),
    )


def _rendered(template: str, found: Diagnosis, **more: Any) -> str:
    """A page of the content of `diagnosis.json`, with what is given besides."""
    content = found.content
    return render(
        template,
        {
            "instrument": instrument,
            "interval": interval,
            "location": location,
            "phase": phase,
            "measurement": next_measurement,
            "number": format,
            "parameters": parameters,
            "sentence": sentence,
        },
        **{
            **content,
            "effects": sorted(content["effects"], key=lambda row: -row["acts"]),
            "verdict_sentence": verdict_sentence(content),
            "nothing_found_note": nothing_found_note(content),
            "closure_note": closure_note(content),
            "corrected_note": corrected_note(content),
            "channels_note": channels_note(content),
            "waterfall_note": waterfall_note(content),
            "found": standing_out(content),
            "noise_floor": noise_floor(content["gap"]["layers"]),
            **more,
        },
    )


def diagnosis_figures(found: Diagnosis) -> dict[str, tuple[Figure, str]]:
    """All figures of the page by name, each with what it shows."""
    content = found.content
    drawn = {
        "sets": sets_figure(content),
        "effects": effects_figure(content),
        "losses": losses_figure(content),
        **({"waterfall": waterfall_figure(content)} if content["waterfall"] else {}),
        "map": map_figure(found.trials),
        "order": order_figure(found.trials),
        "channels": channels_figure(content),
        "reliability": reliability_figure(found.trials),
    }
    return {name: (figure, figure_caption(name)) for name, figure in drawn.items()}
