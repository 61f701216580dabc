"""Figures of a result as files."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from vsr2.errors import ResultError
from vsr2.report.figures import overturning_diagram, time_histories, tracking_figure
from vsr2.report.messages.runs import (
    diagram_caption,
    history_caption,
    tracking_caption,
    trial_name,
    trial_result,
)
from vsr2.report.panels import save_figure
from vsr2.report.text import printable
from vsr2.results import (
    OUTCOMES,
    BatchResult,
    Outcome,
    TrialLog,
    load_trial_log,
    logged_trials,
)
from vsr2.results.atomic import write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_TRIALS = 6
"""Trials whose time histories are drawn by default."""
DIAGRAM_FILE, TRACKING_FILE = "overturning_diagram", "tracking"
NOTE_FILE = "README.md"
_OWN_FILES = (f"{DIAGRAM_FILE}.png", f"{TRACKING_FILE}.png", NOTE_FILE, "time_history_*.png")


def representative_trials(
    result: BatchResult, limit: int = MAX_TRIALS, *, among: Sequence[int] | None = None
) -> list[int]:
    """Trials worth looking at, as many kinds of outcome as there are.

    The outcomes take turns, the gravest first. Among the overturned the one under the smallest PGA
    comes first, among the others the one with the largest peak tilt: the nearest to overturning.

    Args:
        result: the result.
        limit: number of trials at most.
        among: candidates; by default those that have a log in `result`.

    Returns:
        Indices in rising order.
    """
    if among is None:
        among = [i for i, log in enumerate(result.logs) if log is not None]

    def nearness(i: int) -> tuple[bool, float]:
        overturned = result["outcome"][i] == Outcome.overturned
        value = float(result["pga_g"][i] if overturned else -result["peak_tilt"][i])
        return bool(np.isnan(value)), value

    kinds = [
        sorted((i for i in among if result["outcome"][i] == outcome), key=nearness)
        for outcome in (*reversed(OUTCOMES[:-1]), Outcome.failed)
    ]
    chosen: list[int] = []
    while len(chosen) < limit and any(kinds):
        for kind in kinds:
            if kind and len(chosen) < limit:
                chosen.append(kind.pop(0))
    return sorted(chosen)


def remove_figures(folder: str | os.PathLike[str]) -> None:
    """Remove the figures that :func:`write_figures` left in a folder; other files stay.

    Raises:
        ResultError: a file cannot be removed.
    """
    path = Path(folder)
    try:
        for pattern in _OWN_FILES:
            for old in path.glob(pattern):
                old.unlink()
    except OSError as error:
        raise ResultError(f"{path}: cannot be used for figures ({error.strerror})") from error


def write_figures(
    result: BatchResult,
    folder: str | os.PathLike[str],
    *,
    max_trials: int = MAX_TRIALS,
    logs_from: str | os.PathLike[str] | None = None,
) -> list[Path]:
    """Draw a result: overturning diagram, time histories, tracking of the drive, and a note.

    Figures that an earlier call left in `folder` are replaced; other files stay.

    Args:
        result: what to draw.
        folder: for the files; created where it does not exist.
        max_trials: trials with time histories, see :func:`representative_trials`.
        logs_from: result folder whose logs are read one by one; by default the logs in `result`.

    Returns:
        The files written, the note `README.md` last.

    Raises:
        ResultError: a file cannot be written, or a log cannot be read.
    """
    path = Path(folder)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResultError(f"{path}: cannot be used for figures ({error.strerror})") from error
    remove_figures(path)
    shown: dict[str, str] = {}

    def draw(name: str, figure: Figure, caption: str) -> None:
        [file] = save_figure(figure, path / name, ("png",), dpi=150)
        shown[file.name] = caption

    draw(
        DIAGRAM_FILE,
        overturning_diagram(result),
        diagram_caption(len(result)),
    )
    among = None if logs_from is None else logged_trials(logs_from)
    logs: dict[int, TrialLog] = {}
    for i in representative_trials(result, max_trials, among=among):
        log = result.log(i) if logs_from is None else load_trial_log(logs_from, i)
        if len(log.time):
            logs[i] = log
    for i, log in logs.items():
        what = trial_result(
            i, printable(result["name"][i]), result["outcome"][i], result["status"][i]
        )
        draw(f"time_history_{i:06d}", time_histories(log, what), history_caption(what))
    if tracked := _tracked(result, logs):
        draw(
            TRACKING_FILE,
            tracking_figure(tracked),
            tracking_caption(tracked),
        )
    note = "".join(f"- `{name}`: {text}.\n" for name, text in shown.items())
    write_text(path / NOTE_FILE, f"# Figures\n\n{note}")
    return [path / name for name in (*shown, NOTE_FILE)]


def _tracked(result: BatchResult, logs: Mapping[int, TrialLog]) -> dict[str, TrialLog]:
    """The two longest motions drawn whose tracking can be analysed."""
    from vsr2.analysis import tracking

    usable = {}
    for i in sorted(logs, key=lambda i: -logs[i].time[-1]):
        try:
            tracking(logs[i])
        except ResultError:  # too short, or diverged: nothing to show
            continue
        usable[trial_name(i, printable(result["name"][i]))] = logs[i]
        if len(usable) == 2:
            break
    return usable
