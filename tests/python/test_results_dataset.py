"""Results as xarray datasets."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from synthetic_results import falling_log, make_result
from vsr2.errors import ResultError
from vsr2.results import TRIAL_COLUMNS


def test_dataset_has_table_series_units_and_provenance() -> None:
    pytest.importorskip("xarray")
    long, short = falling_log(rows=21), falling_log(rows=11)
    result = make_result([long, None, short], provenance={"seed": 3})
    data = result.to_xarray()
    assert dict(data.sizes) == {
        "trial": 3,
        "step": 21,
        "axis": 3,
        "quaternion": 4,
        "angle": 3,
        "horizontal": 2,
    }
    assert set(TRIAL_COLUMNS) - {"trial"} <= set(data.variables)
    np.testing.assert_array_equal(data["tilt"][0], long.tilt)
    np.testing.assert_array_equal(data["time"][2, :11], short.time)
    assert np.isnan(data["position"][1]).all()
    np.testing.assert_array_equal(data["position"].sel(axis="z")[0], long.position[:, 2])
    np.testing.assert_array_equal(
        data["roll_pitch_yaw"].sel(angle="pitch")[0], long.roll_pitch_yaw[:, 1]
    )
    np.testing.assert_array_equal(data["angular_velocity"][0], long.state[:, 15:18])
    np.testing.assert_array_equal(data["velocity"][0], long.state[:, 12:15])
    units = {name: data[name].attrs["units"] for name in ("pga_g", "slip", "velocity", "time")}
    assert units == {"pga_g": "g", "slip": "m", "velocity": "m/s", "time": "s"}
    assert json.loads(data.attrs["provenance"]) == {"seed": 3}


def test_dataset_without_logs_is_the_table() -> None:
    pytest.importorskip("xarray")
    data = make_result([None, None]).to_xarray()
    assert dict(data.sizes) == {"trial": 2}
    assert list(data["outcome"].values) == ["stable", "stable"]


def test_every_variable_says_what_it_is() -> None:
    pytest.importorskip("xarray")
    data = make_result([falling_log(rows=5)]).to_xarray()
    for name, variable in data.variables.items():
        if name not in ("axis", "quaternion", "angle", "horizontal"):
            assert variable.attrs["long_name"], name
            assert "[" not in variable.attrs["long_name"], name  # the unit has its own attribute
    assert data["tilt"].attrs == {"units": "rad", "long_name": "angle from the settled vertical"}
    assert data["pga_g"].sel(trial=0) == make_result([None])["pga_g"][0]


def test_netcdf_holds_what_the_dataset_holds(tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    result = make_result([falling_log(rows=5), None], provenance={"seed": 3})
    result.to_netcdf(tmp_path / "result.nc")
    with xarray.open_dataset(tmp_path / "result.nc", engine="h5netcdf") as read:
        written = result.to_xarray()
        assert set(read.variables) == set(written.variables)
        for name in ("tilt", "position", "pga_g", "seed", "outcome"):
            np.testing.assert_array_equal(read[name], written[name])
            assert read[name].attrs == written[name].attrs
        assert read.attrs == written.attrs
    with pytest.raises(ResultError, match="cannot be written"):
        result.to_netcdf(tmp_path / "none" / "result.nc")


def test_the_table_as_a_dataframe_and_as_parquet(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    # a file's name may hold bytes that are no text
    names = np.array(["a", "b\udcff", ""], dtype=object)
    result = make_result([None] * 3, name=names)
    frame = result.to_dataframe()
    assert list(frame["name"]) == ["a", "b?", ""]
    assert [frame.index.name, *frame.columns] == list(TRIAL_COLUMNS)
    np.testing.assert_array_equal(frame["peak_tilt"], result["peak_tilt"])
    assert frame.attrs["units"]["pga_g"] == "g"
    result.to_parquet(tmp_path / "result.parquet")
    read = pandas.read_parquet(tmp_path / "result.parquet")
    pandas.testing.assert_frame_equal(read, frame)
    assert read.attrs == frame.attrs


@pytest.mark.parametrize(
    ("package", "method", "extra"),
    [("pandas", "to_dataframe", "dataframe"), ("pyarrow", "to_parquet", "dataframe"),
     ("h5netcdf", "to_netcdf", "xarray")],
)  # fmt: skip
def test_a_missing_package_names_its_extra(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, package: str, method: str, extra: str
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    paths = () if method == "to_dataframe" else (tmp_path / "file",)
    with pytest.raises(ResultError, match=rf"{method} needs .*{package}.*vsr2\[{extra}\]"):
        getattr(make_result([None]), method)(*paths)


def test_some_of_the_trials_are_a_result() -> None:
    logs = [falling_log(rows=5), None, falling_log(rows=7), None]
    result = make_result(logs, provenance={"seed": 3})
    mask = np.array([False, False, True, True])
    for wanted in (slice(2, None), [2, 3], mask):
        part = result[wanted]
        np.testing.assert_array_equal(part["trial"], result["trial"][2:])
        np.testing.assert_array_equal(part["pga_g"], result["pga_g"][2:])
        assert part.logs == (logs[2], None)
        assert part.provenance == {"seed": 3}
    assert len(result[4:]) == 0


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "wanted",
    [
        3, np.int64(3), [4], [-5], np.array([True]), {"a": 1}, {1, 2}, None, ...,
        True, 1.5, [1.5], [True, 2], ["status"], [[0], [1, 2]], (0, 1), np.array(3),
        np.array([[0]]), np.zeros((4, 4), bool), np.ma.array([0, 1], mask=[0, 1]),
        slice(None, None, 0), slice("a"), slice(1.5), 2j, b"status", -1, 4, -5,
        np.array([2**64 - 1], np.uint64), [0, np.ma.masked],
    ],
    ids=str,
)  # fmt: skip
def test_trials_that_are_not_there_are_refused(wanted: Any) -> None:
    with pytest.raises(ResultError, match=r"result\[.*give a slice"):
        make_result([None] * 4)[wanted]


@pytest.mark.parametrize(
    ("wanted", "trial", "part", "log"),
    [
        (0, 0, slice(0, 1), "result[0:1], or use result.log(0)"),
        (-1, 3, slice(-1, None), "result[-1:], or use result.log(3)"),
        (-2, 2, slice(-2, -1), "result[-2:-1], or use result.log(2)"),
    ],
)
def test_what_is_advised_for_one_trial_gives_it(
    wanted: int, trial: int, part: slice, log: str
) -> None:
    result = make_result([None] * 4)
    with pytest.raises(ResultError, match=re.escape(log)):
        result[wanted]
    assert result[part]["trial"].tolist() == [trial]


def test_rows_are_taken_as_numpy_takes_them() -> None:
    result = make_result([None] * 4)
    asked: dict[str, Any] = {
        "backwards": slice(None, None, -2), "beyond": slice(2, 99), "from the end": [-1, 0],
        "twice": (np.array([1, 1], np.uint8)), "none": [], "mask": [True, False, False, True],
    }  # fmt: skip
    found = {name: result[wanted]["trial"].tolist() for name, wanted in asked.items()}
    assert found == {
        "backwards": [3, 1], "beyond": [2, 3], "from the end": [3, 0], "twice": [1, 1], "none": [],
        "mask": [0, 3],
    }  # fmt: skip


def test_missing_xarray_names_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(ResultError, match=r"pip install vsr2\[xarray\]"):
        make_result([None]).to_xarray()
