"""What titles and captions of figures say about results."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from vsr2.one_line import counted
from vsr2.report.messages.runs import fit_note

if TYPE_CHECKING:
    from vsr2.analysis import Tracking
    from vsr2.fragility import FragilityFit

SHOWN_AS_NONE = 1e-9
"""Errors below this are shown as none: they are rounding [m]."""
SHOWN_AS_ON_TIME = 1e-9
"""A lag below this is shown as 0 ms [s]: :func:`vsr2.analysis.tracking` seeks it to a millionth of
the interval between rows, 1e-9 s of one of 1 ms."""

EQUAL_MOTION = "actual and commanded motion are equal"
NO_MEASURES = "no trial has intensity measures"
CALIBRATION_CAPTIONS: Mapping[str, str] = {
    "profiles": "Profiles of the parameters.",
    "search": "The search and the comparison.",
    "predictions": "Predicted and observed outcomes.",
}
FRAGILITY_CAPTIONS: Mapping[str, str] = {
    "overturning": "Overturning diagram",
    "surface": "Fragility surface",
    "azimuth": "Fragility against azimuth",
}
"""Captions by the names of figures."""


def curve_caption(measure: str) -> str:
    """What a fragility curve is drawn against."""
    return f"Fragility in {measure}"


def ranks_title(parameters: int) -> str:
    """Of how many parameters a posterior check ranks true values."""
    return f"ranks of true values ({counted(parameters, 'parameter')})"


def answers_title(level: float) -> str:
    """What a posterior check judges of causes; `level` is that of the set."""
    return f"most probable answer, and {100 * level:g} % set"


def trials_title(shown: int, left_out: int) -> str:
    """How many trials a figure shows, and how many it cannot."""
    return counted(shown, "trial") + (f", {left_out} more not run" if left_out else "")


def tracking_title(found: Tracking) -> str:
    """How well the pedestal followed its command."""
    peak, rms = _millimetres(found.peak_error), _millimetres(found.rms_error)
    return f"peak {peak}, rms {rms}, {_lag(found.lag)}"


def closed_title(held_out: Mapping[str, Any]) -> str:
    """Shares of the gap that scatter and causes close; empty where there is no gap."""
    scatter, beyond = held_out["scatter_alone"]["closure"], held_out["beyond_scatter"]
    if scatter["value"] is None:
        return ""
    further = f"by causes a further {beyond['value']:.2f}"
    if beyond["ci95"] is not None:
        further += " [{:.2f}, {:.2f}]".format(*beyond["ci95"])
    return f"closed of the gap: by scatter alone {scatter['value']:.2f},\n{further}"


def _millimetres(length: float) -> str:
    return f"{0.0 if length < SHOWN_AS_NONE else 1e3 * length:.3g} mm"


def _lag(lag: float) -> str:
    if math.isnan(lag):
        return "no lag"
    milliseconds = 0.0 if abs(lag) < SHOWN_AS_ON_TIME else 1e3 * lag
    return f"{abs(milliseconds):.3g} ms {'early' if milliseconds < 0 else 'late'}"


def curve_title(fit: FragilityFit) -> str:
    """The lognormal curve of a fit, and whether it may be believed."""
    from vsr2.fragility.settings import MEASURES

    if fit.lognormal is None:
        return fit_note(fit)
    found = fit.lognormal
    unit = MEASURES[fit.names[0]][1]
    text = f"median {found.median:.3g} {unit} ({found.median_lower:.3g} to "
    text += f"{found.median_upper:.3g}), $\\beta$ {found.beta:.2g}"
    if fit.separated:
        text += "; outcomes separated"
    return text if found.fits else text + "; not lognormal"
