"""The figure of a search for causes: what acts, and the loss as causes are added."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsr2.causes.causes import FIGURE
from vsr2.report.diagnosis_figures import BLUE, GREY, INK, RED
from vsr2.report.messages.figure_titles import closed_title
from vsr2.report.messages.found_causes import CONTROL_LABELS, waterfall_steps
from vsr2.report.pages import plain
from vsr2.report.panels import legend_below, save_figure, sheet, tooltip

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from vsr2.causes import Causes

_SHOWN = 10
"""Effects in the figure, the most probable ones."""
_DIM = "#5b6675"


def write_causes_figure(found: Causes, folder: str | Path) -> Path:
    """Write the figure as PNG; returns its path.

    Raises:
        ResultError: it cannot be written.
    """
    path = Path(folder) / FIGURE
    return save_figure(causes_figure(found.content), path.with_suffix(""), ("png",), dpi=150)[0]


def causes_figure(content: Mapping[str, Any]) -> Figure:
    """Probability that each effect acts, and the waterfall on motions that were not seen.

    Args:
        content: as in causes.json.
    """
    figure, axes = sheet(1, 2, (10.5, 4.2))
    _acting(axes[0, 0], content)
    _waterfall(axes[0, 1], content["held_out"], waterfall_steps(content))
    legend_below(figure, 4, axes[0, 1].get_legend_handles_labels()[0])
    return figure


def _acting(panel: Axes, content: Mapping[str, Any]) -> None:
    for row in content["causes"][:_SHOWN]:
        name = plain(row["name"])
        [bar] = panel.barh(name, row["acts"], height=0.64, color=BLUE)
        tooltip(bar, f"{name}: {row['acts']:.2f}")
    panel.invert_yaxis()
    panel.set_xlim(0.0, 1.0)
    panel.set_xlabel("probability that it acts [1]")
    panel.grid(axis="y", visible=False)


def _waterfall(panel: Axes, held_out: Mapping[str, Any], steps: list[Any]) -> None:
    rows = [("as it is", held_out["as_it_is"]["loss"], RED)]
    rows += [(plain(label), loss, BLUE if cause else _DIM) for label, cause, loss in steps]
    rows.append(("with all effects", held_out["all"]["loss"], BLUE))
    rows.append(("with the likely ones", held_out["likely"]["loss"], BLUE))
    for control, label in CONTROL_LABELS.items():
        rows.append((label, held_out["controls"][control]["loss"], _DIM))
    if held_out["logistic"] is not None:
        rows.append(("logistic curve", held_out["logistic"]["loss"], _DIM))
    rows.append(("floor", held_out["floor"]["loss"], GREY))
    shown = set()
    kinds = {RED: "scene as it is", BLUE: "with causes", _DIM: "no cause", GREY: "floor"}
    for name, estimate, colour in rows:
        label = "_" if colour in shown else kinds[colour]
        shown.add(colour)
        [bar] = panel.barh(name, estimate["value"], height=0.64, color=colour, label=label)
        low, high = estimate["ci95"]
        tooltip(bar, f"{name}: {estimate['value']:.3f} [{low:.3f}, {high:.3f}] nat")
        [interval] = panel.plot([low, high], [name] * 2, color=INK, linewidth=1.4)
    interval.set_label("95 % interval")
    panel.invert_yaxis()
    panel.set_xlabel("loss a trial [nat]")
    panel.set_title(closed_title(held_out), fontsize="small")
    panel.grid(axis="y", visible=False)
