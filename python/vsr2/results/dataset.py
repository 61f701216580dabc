"""A result as an xarray dataset or a pandas table, in memory and in files."""

from __future__ import annotations

import json
import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vsr2 import _native
from vsr2.errors import ResultError
from vsr2.results.result import (
    TEXT_COLUMNS,
    TRIAL_COLUMNS,
    TRIAL_NAMES,
    TRIAL_UNITS,
    BatchResult,
)
from vsr2.results.trial_log import ANGULAR_VELOCITY, VELOCITY

if TYPE_CHECKING:
    import pandas
    import xarray

_STATE_UNITS = dict(_native.state_columns())
_SERIES: dict[str, tuple[str, str]] = {
    "commanded_position": ("m", "set-point of the pedestal's position along x"),
    "commanded_velocity": ("m/s", "set-point of the pedestal's velocity along x"),
    "pedestal_position": ("m", "position of the pedestal along x"),
    "pedestal_velocity": ("m/s", "velocity of the pedestal along x"),
    "tilt": ("rad", "angle from the settled vertical"),
    "turn": ("rad", "turn about the vertical from the settled pose"),
}
"""Unit and meaning of what has one number a step."""
_VECTORS: dict[str, tuple[str, str, str]] = {
    "position": ("axis", "m", "mass centre in the world"),
    "orientation": ("quaternion", "1", "orientation of the model frame"),
    "roll_pitch_yaw": ("angle", "rad", "angles of the model frame about the fixed axes x, y, z"),
    "slip": ("horizontal", "m", "travel of the foot relative to the pedestal"),
    "velocity": ("axis", "m/s", "velocity of the mass centre"),
    "angular_velocity": ("axis", "rad/s", "angular velocity in the world"),
}
"""Dimension, unit and meaning of what has several."""


def to_xarray(result: BatchResult) -> xarray.Dataset:
    """The table and the state logs of a result as one dataset.

    Dimensions: `trial`; `step` (rows of the log; NaN after a trial's end and without a log);
    `axis` (x, y, z); `quaternion` (x, y, z, w); `angle` (roll, pitch, yaw); `horizontal` (x, y).
    `time(trial, step)` is a coordinate. Each variable has `long_name`, and `units` where it has
    any; the provenance stands in the attribute `provenance` as JSON. Contact logs are not part of
    it: they have no common step.

    Raises:
        ResultError: xarray is not installed.
    """
    _require("xarray", "to_xarray", "xarray")
    import xarray

    variables: dict[str, Any] = {
        name: ("trial", result[name], _attributes(name))
        for name in TRIAL_COLUMNS
        if name != "trial"
    }
    coordinates: dict[str, Any] = {"trial": ("trial", result["trial"], _attributes("trial"))}
    if any(log is not None for log in result.logs):
        steps = ("trial", "step")
        about = {"units": _STATE_UNITS["time"], "long_name": "time from the start of the motion"}
        coordinates["time"] = (steps, result.stack("time"), about)
        coordinates["axis"] = ["x", "y", "z"]
        coordinates["quaternion"] = ["x", "y", "z", "w"]
        coordinates["angle"] = ["roll", "pitch", "yaw"]
        coordinates["horizontal"] = ["x", "y"]
        for name, (unit, meaning) in _SERIES.items():
            about = {"units": unit, "long_name": meaning}
            variables[name] = (steps, result.stack(name), about)
        for name, (dimension, unit, meaning) in _VECTORS.items():
            about = {"units": unit, "long_name": meaning}
            variables[name] = ((*steps, dimension), _vector(result, name), about)
    return xarray.Dataset(
        variables,
        coords=coordinates,
        attrs={"provenance": json.dumps(dict(result.provenance), default=str)},
    )


def _vector(result: BatchResult, name: str) -> NDArray[np.float64]:
    """Of each trial and step, shape (trials, steps, k)."""
    part = {"velocity": VELOCITY, "angular_velocity": ANGULAR_VELOCITY}.get(name)
    return result.stack(name) if part is None else result.stack("state")[:, :, part]


def to_dataframe(result: BatchResult) -> pandas.DataFrame:
    """The table of trials, one row a trial, indexed by the column `trial`.

    Units and full names of the columns stand in `attrs["units"]` and `attrs["long_name"]`.

    Raises:
        ResultError: pandas is not installed.
    """
    _require("pandas", "to_dataframe", "dataframe")
    import pandas

    columns = {
        name: _plain_text(result[name]) if name in TEXT_COLUMNS else result[name]
        for name in TRIAL_COLUMNS
    }
    frame = pandas.DataFrame(columns).set_index("trial")
    frame.attrs = {"units": dict(TRIAL_UNITS), "long_name": dict(TRIAL_NAMES)}
    return frame


def write_netcdf(result: BatchResult, path: str | os.PathLike[str]) -> None:
    """Write :func:`to_xarray` as a netCDF-4 file; a file that is there is replaced.

    Raises:
        ResultError: xarray or h5netcdf is not installed, or the file cannot be written.
    """
    _require("h5netcdf", "to_netcdf", "xarray")
    dataset = to_xarray(result)
    for name in TEXT_COLUMNS:
        dataset[name] = ("trial", _plain_text(result[name]), dataset[name].attrs)
    try:
        dataset.to_netcdf(path, engine="h5netcdf")
    except OSError as error:
        raise ResultError(f"cannot be written ({error})", file=path) from error


def write_parquet(result: BatchResult, path: str | os.PathLike[str]) -> None:
    """Write :func:`to_dataframe` as a Parquet file; a file that is there is replaced.

    Raises:
        ResultError: pandas or pyarrow is not installed, or the file cannot be written.
    """
    _require("pyarrow", "to_parquet", "dataframe")
    try:
        to_dataframe(result).to_parquet(path, engine="pyarrow")
    except OSError as error:
        raise ResultError(f"cannot be written ({error})", file=path) from error


def _plain_text(column: NDArray[Any]) -> NDArray[Any]:
    """Names of files may hold bytes that are no text; other libraries refuse these."""
    plain = [str(text).encode("utf-8", "replace").decode() for text in column]
    return np.array(plain, dtype=np.str_)


def _attributes(column: str) -> dict[str, str]:
    about = {"long_name": TRIAL_NAMES[column]}
    return about | ({"units": TRIAL_UNITS[column]} if column in TRIAL_UNITS else {})


def _require(package: str, what: str, extra: str) -> None:
    try:
        import_module(package)
    except ImportError as error:
        raise ResultError(
            f"{what} needs the package {package}; install it with: pip install vsr2[{extra}]"
        ) from error
