"""Figures of results, made without a screen and without matplotlib's global state."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis import Tracking, tracking
from vsr2.errors import ResultError
from vsr2.report.messages.figure_titles import (
    EQUAL_MOTION,
    SHOWN_AS_NONE,
    tracking_title,
    trials_title,
)
from vsr2.report.panels import legend_below, scale_where_wide, sheet
from vsr2.report.text import printable
from vsr2.results import OUTCOMES, BatchResult, Outcome, TrialLog

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's palette, distinguished by colour-blind readers.
BLACK, ORANGE, SKY, GREEN, BLUE, VERMILION, PURPLE, GREY = (
    "#000000", "#E69F00", "#56B4E9", "#009E73", "#0072B2", "#D55E00", "#CC79A7", "#999999",
)  # fmt: skip

OUTCOME_STYLE: dict[str, dict[str, Any]] = {
    Outcome.stable: {"marker": "o", "facecolor": "none", "edgecolor": GREY},
    Outcome.rocked: {"marker": "o", "facecolor": SKY, "edgecolor": BLUE},
    Outcome.slid: {"marker": "s", "facecolor": GREEN, "edgecolor": "white"},
    Outcome.rotated: {"marker": "D", "facecolor": ORANGE, "edgecolor": "white"},
    Outcome.overturned: {"marker": "^", "facecolor": VERMILION, "edgecolor": "white"},
    Outcome.failed: {"marker": "x", "facecolor": BLACK},
}
"""Marker and colour of each outcome; the shape alone tells it in print without colour."""

MAX_FREQUENCY = 50.0
"""Upper end of the frequency axis of `tracking_figure` [Hz]; ground motion has little beyond."""


def time_histories(log: TrialLog, title: str = "") -> Figure:
    """Response of one trial against time: pedestal, tilt, slip, orientation.

    Panels, from above: commanded and actual pedestal position [m]; tilt away from the settled pose
    [deg]; slip of the foot relative to the pedestal [mm]; roll, pitch and yaw of the model frame
    about the fixed axes, away from their first values [deg]. Settling, where logged, is shaded.

    Raises:
        ResultError: the log has no rows.
    """
    if len(log.time) == 0:
        raise ResultError("time histories: the log has no rows")
    figure, axes = sheet(4, 1, (7.0, 8.0))
    time = log.time
    pedestal, tilt, slip, angles = axes[:, 0]
    pedestal.plot(time, log.column("commanded_position"), color=BLACK, label="commanded")
    pedestal.plot(
        time, log.column("pedestal_position"), color=VERMILION, linestyle="--", label="actual"
    )
    pedestal.set_ylabel("pedestal position [m]")
    tilt.plot(time, np.degrees(log.tilt), color=BLUE, label="away from the settled pose")
    tilt.set_ylabel("tilt [deg]")
    travel = 1e3 * log.slip
    slip.plot(time, travel[:, 0], color=BLUE, label="along x (shaking)")
    slip.plot(time, travel[:, 1], color=ORANGE, linestyle="--", label="along y")
    slip.set_ylabel("slip [mm]")
    turned = np.degrees(log.roll_pitch_yaw - log.roll_pitch_yaw[0])
    styles = ((BLUE, "-"), (ORANGE, "--"), (GREEN, "-."))
    for values, (color, style), name in zip(
        turned.T, styles, ("roll", "pitch", "yaw"), strict=True
    ):
        angles.plot(time, values, color=color, linestyle=style, label=name)
    angles.set_ylabel("change of angle [deg]")
    angles.set_xlabel("time [s]")
    for panel in axes[:, 0]:
        panel.sharex(angles)
        if time[0] < 0:
            settling = "settling" if panel is pedestal else None
            panel.axvspan(time[0], 0.0, color=GREY, alpha=0.2, linewidth=0, label=settling)
        if panel is not angles:
            panel.tick_params(labelbottom=False)
        panel.legend(loc="best", fontsize="small")
    angles.set_xlim(time[0], max(time[-1], time[0] + 1e-9))
    if title:
        figure.suptitle(printable(title), parse_math=False)
    return figure


def overturning_diagram(result: BatchResult) -> Figure:
    """Outcome of each trial in PGA [g] against PGV/PGA [s], of the motions as driven.

    An axis is logarithmic where its values span a factor of more than 8. Trials without an outcome
    are crosses; those without intensity, or not run, are left out and counted in the title.
    """
    figure, axes = sheet(1, 1, (6.5, 5.0))
    panel = axes[0, 0]
    pga = np.asarray(result["pga_g"], dtype=np.float64)
    ratio = np.asarray(result["pgv_pga_s"], dtype=np.float64)
    shown = result.finished & np.isfinite(pga) & np.isfinite(ratio)
    # Many trials hide one another: the gravest outcome is drawn last, all are smaller.
    size = float(np.clip(4000.0 / max(1, shown.sum()), 14.0, 50.0))
    for outcome in OUTCOMES:
        chosen = shown & (result["outcome"] == outcome)
        if chosen.any():
            panel.scatter(
                ratio[chosen],
                pga[chosen],
                s=size,
                linewidth=1.2 if outcome in (Outcome.stable, Outcome.failed) else 0.5,
                label=f"{outcome} ({chosen.sum()})",
                zorder=2.0 + 0.1 * OUTCOMES.index(outcome),
                **OUTCOME_STYLE[outcome],
            )
    scale_where_wide(panel, "x", ratio[shown])
    scale_where_wide(panel, "y", pga[shown])
    panel.set_xlabel("PGV/PGA [s]")
    panel.set_ylabel("PGA [g]")
    left_out = len(result) - int(shown.sum())
    panel.set_title(trials_title(int(shown.sum()), left_out))
    if shown.any():
        legend_below(figure, 3)
    return figure


def tracking_figure(logs: Mapping[str, TrialLog]) -> Figure:
    """Commanded against actual pedestal motion with spectrum (supplement Fig. S1).

    Args:
        logs: one column each, titled by its key, such as one cosine and one recording.

    Panels, from above: positions [m]; actual minus commanded [mm]; power spectral density of both
    accelerations; gain; phase [deg]. The last two show the lines that the command excites, see
    :func:`vsr2.analysis.tracking`. Where no log has an error above rounding, as under the
    prescribed drive, error, gain and phase would be flat and are left out.

    Raises:
        ResultError: no logs, or one that cannot be analysed.
    """
    if not logs:
        raise ResultError("tracking figure: give at least one log")
    found = {name: tracking(log) for name, log in logs.items()}
    exact = all(one.peak_error < SHOWN_AS_NONE for one in found.values())
    rows = 2 if exact else 5
    figure, axes = sheet(rows, len(logs), (1.0 + 4.5 * len(logs), 0.5 + 2.1 * rows))
    for column, (name, log) in enumerate(logs.items()):
        _tracking_column(axes[:, column], log, found[name], printable(name))
    power = "power density\n[(m/s$^2$)$^2$/Hz]"
    labels = ["position [m]", power]
    if not exact:
        labels = ["position [m]", "error [mm]", power, "gain [1]", "phase [deg]"]
    for row, label in enumerate(labels):
        axes[row, 0].set_ylabel(label)
    figure.align_ylabels(axes[:, 0])
    return figure


def _tracking_column(panels: NDArray[Any], log: TrialLog, found: Tracking, title: str) -> None:
    during = log.time >= 0
    time = log.time[during]
    command = log.column("commanded_position")[during]
    actual = log.column("pedestal_position")[during]
    # The rest after the motion shows nothing.
    changes = np.flatnonzero(np.diff(command))
    end = time[changes[-1] + 1] if changes.size else time[-1]
    shown = time <= end + 0.1 * (end - time[0])
    commanded_style = {"color": BLACK, "label": "commanded"}
    actual_style = {"color": VERMILION, "linestyle": "--", "label": "actual"}
    position = panels[0]
    position.plot(time[shown], command[shown], **commanded_style)
    position.plot(time[shown], actual[shown], **actual_style)
    position.legend(loc="best", fontsize="small")
    position.set_title(title, parse_math=False)
    if len(panels) == 2:
        position.set_xlabel("time [s]")
        power = panels[1]
        power.set_title(EQUAL_MOTION, fontsize="small")
    else:
        _error_panel(panels[1], time[shown], (actual - command)[shown], found)
        power = panels[2]
        _transfer_panels(panels[3:], found)
    _power_panel(power, found, commanded_style, actual_style)
    for panel in panels[1:] if len(panels) == 2 else panels[2:]:
        panel.set_xlim(0.0, min(MAX_FREQUENCY, float(found.frequency[-1])))
    panels[-1].set_xlabel("frequency [Hz]")


def _error_panel(
    panel: Axes, time: NDArray[np.float64], error: NDArray[np.float64], found: Tracking
) -> None:
    panel.plot(time, 1e3 * error, color=BLUE, linewidth=0.9)
    panel.set_title(tracking_title(found), fontsize="small")
    panel.set_xlabel("time [s]")
    if found.peak_error < SHOWN_AS_NONE:
        panel.set_ylim(-1e-3, 1e-3)


def _transfer_panels(panels: NDArray[Any], found: Tracking) -> None:
    """Gain and phase."""
    for panel, values, neutral, least in zip(
        panels, (found.gain, np.degrees(found.phase)), (1.0, 0.0), (0.05, 5.0), strict=True
    ):
        panel.axhline(neutral, color=GREY, linewidth=0.8, label="exact")
        panel.plot(
            found.frequency, values, color=BLUE, marker=".", markersize=2, linewidth=0.9,
            label="actual over commanded",
        )  # fmt: skip
        panel.legend(loc="best", fontsize="small")
        # At least this range: an exact drive would otherwise be shown as noise of rounding.
        known = values[(found.frequency <= MAX_FREQUENCY) & np.isfinite(values)]
        low = min(float(known.min(initial=neutral)), neutral - least)
        high = max(float(known.max(initial=neutral)), neutral + least)
        margin = 0.05 * (high - low)
        panel.set_ylim(low - margin, high + margin)


def _power_panel(
    panel: Axes, found: Tracking, commanded: Mapping[str, Any], actual: Mapping[str, Any]
) -> None:
    shown = (found.frequency > 0) & (found.frequency <= MAX_FREQUENCY)
    peak = float(found.commanded_power[shown].max(initial=0.0))
    if peak == 0:
        return
    panel.semilogy(found.frequency[shown], found.commanded_power[shown], **commanded)
    panel.semilogy(found.frequency[shown], found.achieved_power[shown], **actual)
    panel.legend(loc="best", fontsize="small")
    # Below this the command is leakage and rounding, and gain and phase are not shown either.
    panel.set_ylim(1e-6 * peak, 10 * peak)
