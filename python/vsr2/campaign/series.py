"""The response of one trial in time, as it was measured."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.campaign.faults import number_fault, refuse
from vsr2.errors import CampaignError
from vsr2.one_line import counted
from vsr2.read_only import real_array

Array = NDArray[np.float64]

MAX_SERIES_ROWS = 2_000_000
"""Most rows of one series."""
MAX_TIME = 1e5
"""Of a series [s]; more is a mistaken unit."""
MAX_YAW, MAX_POSITION = 100.0, 1000.0
"""[rad], [m]; more is a mistaken unit."""
_CHANNELS: Mapping[str, tuple[tuple[int, ...], float, str]] = {
    "tilt": ((), 2 * math.pi, "rad"),
    "position": ((3,), MAX_POSITION, "m"),
    "orientation": ((4,), 2.0, ""),
    "yaw": ((), MAX_YAW, "rad"),
    "slip": ((), MAX_POSITION, "m"),
}
"""Of a series: shape beyond the rows, greatest value and its unit."""
MAX_NOISE = 1e5
"""Of a standard error, in the unit of its channel; more is a mistaken unit."""
NORM_TOLERANCE = 1e-3
"""Of a quaternion's norm, relative: three decimals are enough."""


@dataclass(frozen=True, eq=False)
class Series:
    """The response of one trial in time.

    Pose is relative to the rest before the motion, so that it can be measured without knowing the
    model's frame: `position` is the travel of the mass centre, `orientation` the rotation away
    from the rest pose, q_WB q_WB0* (both in world axes: x along the shaking, z up).

    Attributes:
        time: increasing, shape (n,) [s]; 0 at the first sample of the trial's motion.
        tilt: angle between the body's vertical at rest and the vertical, shape (n,) [rad]; noise
            may make it negative. None: not measured.
        position: shape (n, 3) [m], or None.
        orientation: quaternions x, y, z, w of norm 1, shape (n, 4), or None.
        yaw: turn about the vertical, shape (n,) [rad], or None; what `orientation` holds too.
        slip: travel of the foot on the table along the shaking, shape (n,) [m], or None.
        noise_tilt, noise_position, noise_orientation, noise_yaw, noise_slip: standard errors, of a
            component or about an axis, in the channels' units; None: see the campaign's noise.

    The arrays are copies and read-only.

    Raises:
        CampaignError: no channel; shapes that do not fit; no row, or more than `MAX_SERIES_ROWS`;
            NaN, infinity or an absurd value; time that does not increase; a quaternion whose norm
            is off 1 by more than 1e-3.
    """

    time: Array
    tilt: Array | None = None
    position: Array | None = None
    orientation: Array | None = None
    yaw: Array | None = None
    slip: Array | None = None
    noise_tilt: float | None = None
    noise_position: float | None = None
    noise_orientation: float | None = None
    noise_yaw: float | None = None
    noise_slip: float | None = None

    def __post_init__(self) -> None:
        time = self._checked("time", (), MAX_TIME, "s")
        if time is None:
            raise CampaignError("time is missing", key="series")
        backwards = np.flatnonzero(np.diff(time) <= 0)
        if backwards.size:
            row = int(backwards[0]) + 1
            raise CampaignError(
                f"time is {time[row]:.9g} s at row {row} after {time[row - 1]:.9g} s; it "
                "must increase: sort the rows or remove the doubled ones",
                key="series",
            )
        found = {name: self._checked(name, *of) for name, of in _CHANNELS.items()}
        if all(one is None for one in found.values()):
            raise CampaignError(
                "has neither tilt nor position, orientation, yaw or slip; remove it, or add one",
                key="series",
            )
        if (orientation := found["orientation"]) is not None:
            norm = np.linalg.norm(orientation, axis=1)
            bad = np.flatnonzero(np.abs(norm - 1) > NORM_TOLERANCE)
            if bad.size:
                raise CampaignError(
                    f"orientation at row {bad[0]} has the norm {norm[bad[0]]:.6g}; scale "
                    "quaternions to 1",
                    key="series",
                )
        for name in (name for name in vars(self) if name.startswith("noise_")):
            value = getattr(self, name)
            if value is not None:
                refuse("series", {name: number_fault(value, 0, MAX_NOISE, "")})

    @property
    def tilt_angle(self) -> Array | None:
        """The tilt, or else that of the orientation, shape (n,) [rad]; None: neither is there."""
        if self.tilt is not None or self.orientation is None:
            return self.tilt
        x, y = self.orientation[:, 0], self.orientation[:, 1]
        return np.asarray(2 * np.arcsin(np.minimum(np.hypot(x, y), 1.0)))

    def _checked(self, name: str, last: tuple[int, ...], limit: float, unit: str) -> Array | None:
        given = getattr(self, name)
        if given is None:
            return None
        try:
            value = np.array(real_array(given))
        except TypeError as error:
            raise CampaignError(f"{name} {error}", key="series") from None
        rows = "n" if name == "time" else f"{self.time.size}"
        if value.ndim != 1 + len(last) or value.shape[1:] != last:
            wanted = ", ".join([rows, *map(str, last)])
            raise CampaignError(
                f"{name} has shape {value.shape}, wanted is ({wanted})", key="series"
            )
        if not 1 <= len(value) <= MAX_SERIES_ROWS:
            raise CampaignError(
                f"{name} has {counted(len(value), 'row')}; 1 to {MAX_SERIES_ROWS} are allowed",
                key="series",
            )
        if name != "time" and len(value) != self.time.size:
            raise CampaignError(
                f"{name} has {counted(len(value), 'row')}, time has {self.time.size}", key="series"
            )
        bad = np.argwhere(~(np.abs(value) <= limit))
        if bad.size:
            place = tuple(int(i) for i in bad[0])
            raise CampaignError(
                f"{name} is {value[place]:g} {unit} at row {place[0]}, beyond {limit:g} {unit}; "
                f"{counted(len(bad), 'such value')}; leave such rows out, or check the unit",
                key="series",
            )
        value.setflags(write=False)
        object.__setattr__(self, name, value)
        return value

    @property
    def interval(self) -> float | None:
        """Sampling interval [s] where it is uniform within 1e-6 of itself; None: it is not."""
        if self.time.size < 2:
            return None
        interval = float(self.time[-1] - self.time[0]) / (self.time.size - 1)
        off = np.abs(np.diff(self.time) - interval).max()
        return interval if off <= 1e-6 * interval + 1e-12 * MAX_TIME else None
