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
from vsr2.results.result import TEXT_COLUMNS, TRIAL_COLUMNS, BatchResult
from vsr2.results.trial_log import DERIVED

if TYPE_CHECKING:
    import pandas
    import xarray

_SERIES = {one.name: one for one in _native.state_columns() if not one.vector}
"""Columns of the log that are no vector's; `time` is a coordinate."""
_VECTORS = {
    name: [one for one in _native.state_columns() if one.vector == name]
    for name in dict.fromkeys(one.vector for one in _native.state_columns())
    if name and name != "body_orientation"
}
"""Columns of vectors along x, y, z. The orientation is derived, as that of the model frame."""
_COMPONENTS = {
    "axis": ["x", "y", "z"],
    "quaternion": ["x", "y", "z", "w"],
    "angle": ["roll", "pitch", "yaw"],
    "horizontal": ["x", "y"],
}
"""Coordinates of the dimensions beside trial and step."""


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
        series = _series(result)
        coordinates |= {"time": series.pop("time"), **_COMPONENTS}
        variables |= series
    return xarray.Dataset(
        variables,
        coords=coordinates,
        attrs={"provenance": json.dumps(dict(result.provenance), default=str)},
    )


def _series(result: BatchResult) -> dict[str, Any]:
    """Variables of the logs, by name: dimensions, values, attributes."""
    steps = ("trial", "step")
    series: dict[str, Any] = {}
    for name, column in _SERIES.items():
        about = {"units": column.unit, "long_name": column.description}
        series[name] = (steps, result.stack(name), about)
    for name, columns in _VECTORS.items():
        about = {"units": columns[0].unit, "long_name": columns[0].quantity}
        parts = [result.stack(column.name) for column in columns]
        series[name] = ((*steps, "axis"), np.stack(parts, axis=-1), about)
    for name, (dimension, unit, meaning) in DERIVED.items():
        about = {"units": unit, "long_name": meaning}
        dimensions = (*steps, dimension) if dimension else steps
        series[name] = (dimensions, result.stack(name), about)
    return series


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
    about = {name: _attributes(name) for name in TRIAL_COLUMNS}
    frame.attrs = {
        key: {name: one[key] for name, one in about.items() if key in one}
        for key in ("units", "long_name")
    }
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
        raise _unwritable(path, error) from error


def write_parquet(result: BatchResult, path: str | os.PathLike[str]) -> None:
    """Write :func:`to_dataframe` as a Parquet file; a file that is there is replaced.

    Raises:
        ResultError: pandas or pyarrow is not installed, or the file cannot be written.
    """
    _require("pyarrow", "to_parquet", "dataframe")
    try:
        to_dataframe(result).to_parquet(path, engine="pyarrow")
    except OSError as error:
        raise _unwritable(path, error) from error


def _unwritable(path: str | os.PathLike[str], error: OSError) -> ResultError:
    # The libraries' own texts name calls and flags of theirs.
    reason = os.strerror(error.errno) if error.errno else error
    return ResultError(
        f"cannot be written ({reason}); make its folder, or choose another", file=path
    )


def _plain_text(column: NDArray[Any]) -> NDArray[Any]:
    """Names of files may hold bytes that are no text; other libraries refuse these."""
    plain = [str(text).encode("utf-8", "replace").decode() for text in column]
    return np.array(plain, dtype=np.str_)


def _attributes(column: str) -> dict[str, str]:
    unit, meaning = TRIAL_COLUMNS[column]
    return {"long_name": meaning} | ({"units": unit} if unit else {})


def _require(package: str, what: str, extra: str) -> None:
    try:
        import_module(package)
    except ImportError as error:
        raise ResultError(
            f"{what} needs the package {package}; install it with: pip install vsr2[{extra}]"
        ) from error
