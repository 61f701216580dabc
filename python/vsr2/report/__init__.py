"""Figures and tables for people."""

from vsr2.report.batch_figures import remove_figures, representative_trials, write_figures
from vsr2.report.figures import overturning_diagram, time_histories, tracking_figure
from vsr2.report.text import printable, summary_table

__all__ = [
    "overturning_diagram",
    "printable",
    "remove_figures",
    "representative_trials",
    "summary_table",
    "time_histories",
    "tracking_figure",
    "write_figures",
]
