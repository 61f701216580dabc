"""The `.npz` files of a campaign: motions of the table, and responses in time."""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Collection, Mapping
from operator import methodcaller
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.campaign.file_problems import Problems
from vsr2.campaign.series import Series
from vsr2.campaign.trials_table import TRIALS
from vsr2.config.bounded import UnreadableError, read_bounded
from vsr2.errors import CampaignError, MotionError
from vsr2.motion import Record
from vsr2.motion.npz import NpzError, npz_arrays
from vsr2.motion.samples import MAX_SAMPLES
from vsr2.results.atomic import write_atomic

Array = NDArray[np.float64]

SERIES_FOLDER = "series"
MAX_ARRAY_FILE_BYTES = 512 * 1024**2
"""Greater files are refused unread."""
MAX_TOTAL_NUMBERS = 250_000_000
"""Most numbers in all motions and series of a campaign together: 2 GB."""

_MOTION_ARRAYS = ("sample_interval_s", "displacement_m", "acceleration_m_s2")
_SERIES_ARRAYS = {
    "time_s": "time",
    "tilt_rad": "tilt",
    "position_m": "position",
    "orientation_xyzw": "orientation",
    "yaw_rad": "yaw",
    "slip_m": "slip",
    "noise_tilt_rad": "noise_tilt",
    "noise_position_m": "noise_position",
    "noise_orientation_rad": "noise_orientation",
    "noise_yaw_rad": "noise_yaw",
    "noise_slip_m": "noise_slip",
}
"""Attribute of a series by the name of its array."""


class ArrayFiles:
    """Reads the `.npz` files of a folder and notes what is wrong with them."""

    def __init__(self, folder: Path, problems: Problems) -> None:
        self._folder = folder
        self._problems = problems
        self._numbers = 0

    def motion(self, name: str, row: int, folder: str) -> Record | None:
        """The record in the folder of motions, named first in `row` of the table."""
        file = f"{folder}/{name}.npz"
        content = self._content(file, f"named in {TRIALS}, row {row}: ")
        arrays = self._arrays(content, file, _MOTION_ARRAYS)
        if content is None or arrays is None:
            return None
        interval = self._one_number(file, arrays, "sample_interval_s")
        if interval is None:
            return None
        try:
            return Record(
                name=name,
                sample_interval=interval,
                displacement=arrays.get("displacement_m"),
                acceleration=arrays.get("acceleration_m_s2"),
                source=str(self._folder / file),
                sha256=hashlib.sha256(content).hexdigest(),
            )
        except MotionError as error:
            self._problems.add(file, error.message)
            return None

    def series(self, trial: str) -> Series | None:
        """The series of a trial, where there is one."""
        file = f"{SERIES_FOLDER}/{trial}.npz"
        try:
            if not os.path.lexists(self._folder / file):
                return None
        except ValueError:
            return None
        arrays = self._arrays(self._content(file), file, _SERIES_ARRAYS)
        if arrays is None:
            return None
        if "time_s" not in arrays:
            self._problems.add(file, "is missing; add it", column="time_s")
            return None
        before = len(self._problems.found)
        values: dict[str, Any] = {
            name: self._one_number(file, arrays, key) if name.startswith("noise") else arrays[key]
            for key, name in _SERIES_ARRAYS.items()
            if key in arrays
        }
        if len(self._problems.found) > before:
            return None
        try:
            return Series(**values)
        except CampaignError as error:
            self._problems.add(file, error.message)
            return None

    def unclaimed_series(self, trials: Mapping[str, int]) -> None:
        """Note series that belong to no trial: most often a slip in a name."""
        try:
            files = sorted(os.listdir(self._folder / SERIES_FOLDER))
        except (OSError, ValueError):
            return
        for file in files:
            if file.endswith(".npz") and file.removesuffix(".npz") not in trials:
                self._problems.add(
                    f"{SERIES_FOLDER}/{ascii(file)[1:-1][:100]}",
                    f"belongs to no trial of {TRIALS}; rename or remove it",
                )

    def _content(self, file: str, before: str = "") -> bytes | None:
        path = self._folder / file
        try:
            return read_bounded(path, MAX_ARRAY_FILE_BYTES, remedy="split the campaign")
        except UnreadableError as error:
            self._problems.add(file, f"{before}{error}")
            return None

    def _arrays(
        self, content: bytes | None, file: str, allowed: Collection[str]
    ) -> dict[str, Array] | None:
        if content is None or self._numbers > MAX_TOTAL_NUMBERS:
            return None

        def check_names(names: Collection[str]) -> None:
            unknown = sorted(set(names) - set(allowed))
            if unknown:
                raise NpzError(
                    "",
                    f"holds {ascii(unknown[0])[:60]}, which no reader knows; allowed are "
                    f"{', '.join(allowed)}",
                )

        try:
            arrays = npz_arrays(content, check_names, max_dimensions=2, max_numbers=4 * MAX_SAMPLES)
        except NpzError as error:
            self._problems.add(file, error.what, column=error.array)
            return None
        self._numbers += sum(array.size for array in arrays.values())
        if self._numbers > MAX_TOTAL_NUMBERS:
            self._problems.add(
                file,
                f"motions and series up to here hold more than {MAX_TOTAL_NUMBERS} numbers; "
                "split the campaign",
            )
            return None
        return arrays

    def _one_number(self, file: str, arrays: Mapping[str, Array], key: str) -> float | None:
        if key not in arrays:
            self._problems.add(file, "is missing; add it", column=key)
            return None
        array = arrays[key]
        if array.size != 1 or not np.isfinite(array).all() or array.reshape(-1)[0] < 0:
            self._problems.add(
                file, "is not one finite number of 0 or more; correct it", column=key
            )
            return None
        return float(array.reshape(-1)[0])


def write_arrays(path: Path, arrays: Mapping[str, Any], *, atomic: bool = False) -> None:
    """Write an `.npz` file; its folder is made where it is missing."""
    path.parent.mkdir(exist_ok=True)
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=False, **arrays)
    if atomic:
        write_atomic(path, methodcaller("write", stream.getvalue()))
    else:
        path.write_bytes(stream.getvalue())


def series_arrays(series: Series) -> dict[str, Any]:
    """The arrays of a series by their names in its file."""
    values = {key: getattr(series, name) for key, name in _SERIES_ARRAYS.items()}
    return {
        key: np.asarray(value, np.float64) for key, value in values.items() if value is not None
    }
