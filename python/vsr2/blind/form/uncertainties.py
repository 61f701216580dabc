"""Standard deviations of the diagnosis' nuisances from the tolerances of a pack."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from vsr2.blind.form.pack_settings import Tolerances
from vsr2.blind.form.reader import misfit
from vsr2.ensemble import with_deviations
from vsr2.errors import DiagnosisError

_STATED_AS = {
    "restitution": "energy_ratio",
    "slenderness": "width",
    "inertia": "height",
    "trial_gain": "input_gain",
}
"""Tolerances that nuisances come from, where their names differ."""


def uncertainties(tolerances: Mapping[str, Any]) -> dict[str, float]:
    """Standard deviations for the diagnosis from those that a pack publishes.

    What it does not publish keeps the diagnosis' own. Edges that are off by s change the frequency
    parameter p^2 by s, as a moment of inertia does that is off by 4 s: of the moment about an edge,
    4/3 m R^2, a quarter is about the centre.
    """
    tolerances = {name: value for name, value in tolerances.items() if value is not None}
    units = {"friction": 1.0, "yaw": math.degrees(1), "offset": 1.0, "energy_ratio": 1.0}
    out = {name: unit * tolerances[name] for name, unit in units.items() if name in tolerances}
    if "energy_ratio" in out:
        out["restitution"] = out.pop("energy_ratio")
    if {"width", "height"} <= set(tolerances):
        out["slenderness"] = math.hypot(tolerances["width"], tolerances["height"])
        out["inertia"] = 4 * tolerances["height"]
    if "input_gain" in tolerances:
        # Root mean square of a log-uniform draw.
        low, high = tolerances["input_gain"]
        spread = 2 * math.log(high / low) if high > low > 0 else 0.0
        out["trial_gain"] = math.sqrt((high**2 - low**2) / spread) if spread else high
    return out


def check_tolerances(tolerances: Tolerances) -> Tolerances:
    """The same tolerances, with which a diagnosis can simulate.

    Raises:
        ValueError: it cannot; names key, value and what is wanted.
    """
    for name, deviation in uncertainties(tolerances.model_dump(exclude_unset=True)).items():
        try:
            with_deviations({name: deviation})
        except DiagnosisError as error:
            key = _STATED_AS.get(name, name)
            raise misfit(key, getattr(tolerances, key), error.message) from None
    return tolerances
