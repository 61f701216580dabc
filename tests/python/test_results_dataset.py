"""Results as xarray datasets."""

from __future__ import annotations

import json
import sys

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


def test_missing_xarray_names_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(ResultError, match=r"pip install vsr2\[xarray\]"):
        make_result([None]).to_xarray()
