"""Histories of a motion as a figure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vsr2.motion.motion import Motion
from vsr2.motion.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def history_figure(motion: Motion) -> Figure:
    """Displacement [m], velocity [m/s] and acceleration [g] of a motion, over time [s]."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 5.0), layout="constrained")
    panels = figure.subplots(3, sharex=True)
    histories = {
        "displacement [m]": motion.displacement,
        "velocity [m/s]": motion.velocity,
        "acceleration [g]": motion.acceleration / STANDARD_GRAVITY,
    }
    for panel, (label, values) in zip(panels, histories.items(), strict=True):
        panel.plot(motion.times, values, linewidth=0.8)
        panel.axhline(0.0, color="0.8", linewidth=0.6, zorder=0)
        panel.set_ylabel(label)
    panels[0].set_title(f"{motion.name}: PGA {motion.pga_g:.3g} g, PGV {motion.pgv_m_s:.3g} m/s")
    panels[-1].set_xlabel("time [s]")
    return figure
