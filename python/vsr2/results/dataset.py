"""A result as an xarray dataset."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vsr2 import _native
from vsr2.errors import ResultError
from vsr2.results.result import (
    ANGULAR_VELOCITY,
    TRIAL_COLUMNS,
    TRIAL_UNITS,
    VELOCITY,
    BatchResult,
)

if TYPE_CHECKING:
    import xarray

_STATE_UNITS = dict(_native.state_columns())
_STEP_UNITS = {
    name: _STATE_UNITS.get(name, "rad")
    for name in (
        "commanded_position", "commanded_velocity", "pedestal_position", "pedestal_velocity",
        "tilt", "turn",
    )
}  # fmt: skip


def to_xarray(result: BatchResult) -> xarray.Dataset:
    """The table and the state logs of a result as one dataset.

    Dimensions: `trial`; `step` (rows of the log; NaN after a trial's end and without a log);
    `axis` (x, y, z); `quaternion` (x, y, z, w); `angle` (roll, pitch, yaw); `horizontal` (x, y).
    `time(trial, step)` is a coordinate. Each variable has `units` and `long_name`; the provenance
    stands in the attribute `provenance` as JSON. Contact logs are not part of it: they have no
    common step.

    Raises:
        ResultError: xarray is not installed.
    """
    try:
        import xarray
    except ImportError as error:
        raise ResultError(
            "to_xarray needs the package xarray; install it with: pip install vsr2[xarray]"
        ) from error
    variables: dict[str, Any] = {}
    for name, meaning in TRIAL_COLUMNS.items():
        if name != "trial":
            attributes = {"long_name": meaning}
            if name in TRIAL_UNITS:
                attributes["units"] = TRIAL_UNITS[name]
            variables[name] = ("trial", result[name], attributes)
    coordinates: dict[str, Any] = {"trial": result["trial"]}
    if any(log is not None for log in result.logs):
        steps = ("trial", "step")
        coordinates["time"] = (steps, result.stack("time"), {"units": _STATE_UNITS["time"]})
        coordinates["axis"] = ["x", "y", "z"]
        coordinates["quaternion"] = ["x", "y", "z", "w"]
        coordinates["angle"] = ["roll", "pitch", "yaw"]
        coordinates["horizontal"] = ["x", "y"]
        for name, unit in _STEP_UNITS.items():
            variables[name] = (steps, result.stack(name), {"units": unit})
        vectors: dict[str, tuple[str, str, NDArray[np.float64], str]] = {
            "position": (
                "axis",
                _STATE_UNITS["rock_x"],
                result.stack("position"),
                "mass centre in the world",
            ),
            "orientation": (
                "quaternion",
                _STATE_UNITS["rock_qx"],
                result.stack("orientation"),
                "of the model frame",
            ),
            "roll_pitch_yaw": (
                "angle",
                "rad",
                result.stack("roll_pitch_yaw"),
                "of the model frame about the fixed axes x, y, z",
            ),
            "slip": ("horizontal", "m", result.stack("slip"), "relative to the pedestal"),
        }
        state = result.stack("state")
        vectors["velocity"] = (
            "axis",
            _STATE_UNITS["rock_vx"],
            state[:, :, VELOCITY],
            "of the mass centre",
        )
        vectors["angular_velocity"] = (
            "axis",
            _STATE_UNITS["rock_wx"],
            state[:, :, ANGULAR_VELOCITY],
            "in the world",
        )
        for name, (dimension, unit, values, meaning) in vectors.items():
            attributes = {"units": unit, "long_name": meaning}
            variables[name] = ((*steps, dimension), values, attributes)
    return xarray.Dataset(
        variables,
        coords=coordinates,
        attrs={"provenance": json.dumps(dict(result.provenance), default=str)},
    )
