"""The logged response of one trial."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsr2 import _native
from vsr2.argument_names import checked_names
from vsr2.config.problems import shown
from vsr2.errors import ResultError
from vsr2.one_line import OneLine
from vsr2.read_only import ReadOnlyArrays, real_argument
from vsr2.scene.rotation import conjugate, quaternion_product, rotate

Array = NDArray[np.float64]

STATE_COLUMNS: tuple[str, ...] = tuple(one.name for one in _native.state_columns())
"""Columns of `TrialLog.state`; their units: `_native.state_columns()`. The orientation is of the
body frame B."""

CONTACT_COLUMNS: tuple[str, ...] = tuple(one.name for one in _native.contact_columns())
"""Columns of `TrialLog.contacts`; their units: `_native.contact_columns()`.

The normal points from the pedestal to the rock, a negative distance is penetration, impulses are
over one solver step."""

EXCURSION_COLUMNS: tuple[str, ...] = tuple(one.name for one in _native.excursion_columns())
"""Columns of `TrialLog.excursions`; their units: `_native.excursion_columns()`."""


class Derived(NamedTuple):
    """What is drawn from a log, row by row, and is no column of it.

    Attributes:
        dimension: of its components; empty: it is a number.
        unit: of them.
        meaning: without the unit.
    """

    dimension: str
    unit: str
    meaning: str


DERIVED: Mapping[str, Derived] = {
    "tilt": Derived("", "rad", "angle from the settled vertical"),
    "turn": Derived("", "rad", "turn about the vertical from the settled pose"),
    "orientation": Derived("quaternion", "1", "orientation of the model frame"),
    "roll_pitch_yaw": Derived("angle", "rad", "angles of the model frame about the fixed x, y, z"),
    "slip": Derived("horizontal", "m", "travel of the foot relative to the pedestal"),
}
"""By the property of :class:`TrialLog` that gives it."""


def _vector(columns: list[_native.Column], name: str) -> slice:
    """Where the components of a vector stand in a row."""
    found = [k for k, one in enumerate(columns) if one.vector == name]
    return slice(found[0], found[-1] + 1)


# Vectors in a row of `TrialLog.state`, then what is read of a row of `TrialLog.contacts`.
POSITION, ORIENTATION, VELOCITY, ANGULAR_VELOCITY = (
    _vector(_native.state_columns(), name)
    for name in ("position", "body_orientation", "velocity", "angular_velocity")
)
CONTACT_TIME = CONTACT_COLUMNS.index("time")
ROCK_POINT = _vector(_native.contact_columns(), "rock_point")
CONTACT_NORMAL = _vector(_native.contact_columns(), "normal")
NORMAL_IMPULSE = CONTACT_COLUMNS.index("normal_impulse")


@checked_names(ResultError)
@dataclass(frozen=True, eq=False, repr=False)
class TrialLog(OneLine, ReadOnlyArrays):
    """The logged response of one trial, measured or simulated.

    Attributes:
        state: shape (n, len(STATE_COLUMNS)); settling rows have negative times.
        contacts: shape (m, len(CONTACT_COLUMNS)); m = 0 when contacts were not logged.
        settled_position: mass centre p_WB of the settled pose, shape (3,) [m].
        settled_orientation: q_WB of the settled pose, x, y, z, w, shape (4,).
        foot: body point (in B) under the mass centre at the support in the settled pose; its
            horizontal travel relative to the pedestal is the slip, shape (3,) [m].
        mass_center: origin of B in the model frame M, shape (3,) [m].
        principal_axes: q_MB, x, y, z, w, shape (4,).
        excursions: of the pedestal beside x, row by row with `state`, columns EXCURSION_COLUMNS,
            shape (n, 3); (0, 3) where it moves along x only.
        pivot: point of the pedestal's pitch axis in the world at the start, shape (3,) [m]; the
            pedestal's place along x, y and z is that of this point. Not used without excursions.

    Tilt, turn and slip are relative to the moving pedestal.

    Arrays are kept without a copy and offered read-only.

    Raises:
        ResultError: an array of another shape, with a mask, or of something else than real numbers.
    """

    state: Array
    contacts: Array
    settled_position: Array
    settled_orientation: Array
    foot: Array
    mass_center: Array
    principal_axes: Array
    excursions: Array = field(default_factory=lambda: np.empty((0, 3)))
    pivot: Array = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        shapes = {
            "excursions": (None, len(EXCURSION_COLUMNS)),
            "pivot": (3,),
            "state": (None, len(STATE_COLUMNS)),
            "contacts": (None, len(CONTACT_COLUMNS)),
            "settled_position": (3,),
            "settled_orientation": (4,),
            "foot": (3,),
            "mass_center": (3,),
            "principal_axes": (4,),
        }
        for name, shape in shapes.items():
            value = real_argument(getattr(self, name), f"trial log: {name}", ResultError).view()
            if value.ndim != len(shape) or any(
                wanted not in (None, got) for wanted, got in zip(shape, value.shape, strict=True)
            ):
                wanted_shape = str(shape).replace("None", "n")
                raise ResultError(
                    f"trial log: {name} must have shape {wanted_shape}, it has {value.shape}"
                )
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        if len(self.excursions) not in (0, len(self.state)):
            raise ResultError(
                f"trial log: {len(self.excursions)} rows of excursions go with {len(self.state)} "
                "rows of state"
            )

    @property
    def facts(self) -> Mapping[str, object]:
        """Rows, the time that they span [s], the largest tilt [rad], rows of contacts."""
        rows = len(self.state)
        return {
            "rows": rows,
            "start": float(self.time[0]) if rows else None,
            "end": float(self.time[-1]) if rows else None,
            "peak_tilt": float(self.tilt.max()) if rows else None,
            "contacts": len(self.contacts),
        }

    def column(self, name: str) -> Array:
        """One column of `state` by its name, shape (n,).

        Raises:
            ResultError: there is no such column.
        """
        if not isinstance(name, str) or name not in STATE_COLUMNS:
            raise ResultError(f"no column {shown(name)}; known: {', '.join(STATE_COLUMNS)}")
        return self.state[:, STATE_COLUMNS.index(name)]

    @property
    def time(self) -> Array:
        """Time from the start of the motion, shape (n,) [s]."""
        return self.column("time")

    @property
    def position(self) -> Array:
        """Mass centre p_WB in the world, shape (n, 3) [m]."""
        return self.state[:, POSITION]

    @property
    def body_orientation(self) -> Array:
        """q_WB, quaternion x, y, z, w of the principal axes, shape (n, 4)."""
        return self.state[:, ORIENTATION]

    @property
    def orientation(self) -> Array:
        """q_WM, quaternion x, y, z, w of the model frame, shape (n, 4)."""
        return quaternion_product(self.body_orientation, conjugate(self.principal_axes))

    @property
    def roll_pitch_yaw(self) -> Array:
        """Roll, pitch, yaw of the model frame about the fixed axes x, y, z (S1.1), (n, 3) [rad].

        R_WM = Rz(yaw) Ry(pitch) Rx(roll). Roll and yaw are unwrapped in time; at a pitch of
        +-pi/2 only their difference or sum is defined and both may jump there.
        """
        q = self.orientation
        x, y, z, w = np.moveaxis(q / np.linalg.norm(q, axis=1, keepdims=True), -1, 0)
        roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        # As arc tangent, because an arc sine loses half the digits near +-pi/2.
        forward = np.hypot(1 - 2 * (y * y + z * z), 2 * (w * z + x * y))
        pitch = np.arctan2(2 * (w * y - z * x), forward)
        yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        return np.stack([np.unwrap(roll), pitch, np.unwrap(yaw)], axis=-1)

    @property
    def _rotation(self) -> Array:
        """From the settled pose, q_WB q_WB0*, shape (n, 4)."""
        turned = quaternion_product(self.body_orientation, conjugate(self.settled_orientation))
        return quaternion_product(self._unpitched, turned) if len(self.excursions) else turned

    @property
    def pedestal_pitch(self) -> Array:
        """Turn of the pedestal about y, shape (n,) [rad]; zeros where it moves along x only."""
        if not len(self.excursions):
            return np.zeros(len(self.state))
        return self.excursions[:, EXCURSION_COLUMNS.index("pitch")]

    @property
    def pedestal_travel(self) -> Array:
        """Of the pedestal along x, y and z, of the point `pivot`, shape (n, 3) [m]."""
        moved = np.zeros((len(self.state), 3))
        moved[:, 0] = self.column("pedestal_position")
        if len(self.excursions):
            moved[:, 1:] = self.excursions[:, : EXCURSION_COLUMNS.index("pitch")]
        return moved

    @property
    def _unpitched(self) -> Array:
        """From the world to the pedestal, q_PW, shape (n, 4)."""
        half = 0.5 * self.pedestal_pitch
        zero = np.zeros_like(half)
        return np.stack([zero, -np.sin(half), zero, np.cos(half)], axis=-1)

    @property
    def tilt(self) -> Array:
        """Angle between the body's settled vertical and the vertical, shape (n,) [rad].

        0 to pi; a turn about the vertical does not count.
        """
        q = self._rotation
        sine = np.hypot(q[:, 0], q[:, 1]) / np.linalg.norm(q, axis=1)
        angle: Array = 2.0 * np.arcsin(np.minimum(1.0, sine))
        return angle

    @property
    def turn(self) -> Array:
        """Turn about the vertical away from the settled pose, shape (n,) [rad].

        Twist of the swing-twist decomposition, unwrapped in time from a first value in
        (-pi, pi]; undefined for a rock upside down.
        """
        q = self._rotation
        # q and -q are one orientation; the half-plane w >= 0 keeps the first value within half a
        # turn whichever of them the engine gave.
        sign = np.where(q[:, 3] < 0, -1.0, 1.0)
        return np.unwrap(2.0 * np.arctan2(sign * q[:, 2], sign * q[:, 3]))

    def from_rest(self, rows: NDArray[np.bool_ | np.intp]) -> tuple[Array, Array]:
        """Pose away from the settled one, both in world axes.

        Args:
            rows: that are wanted, mask of shape (n,) or indices of shape (m,).

        Returns:
            Travel of the mass centre (m, 3) [m], rotation q_WB q_WB0* as x, y, z, w (m, 4).
        """
        inverse = conjugate(self.settled_orientation)
        turned = quaternion_product(self.body_orientation[rows], inverse)
        return self.position[rows] - self.settled_position, turned

    @property
    def slip(self) -> Array:
        """Horizontal travel (x, y) of the foot relative to the pedestal, shape (n, 2) [m]."""
        foot = self.position + rotate(self.body_orientation, self.foot)
        start = self.settled_position + rotate(self.settled_orientation, self.foot)
        if len(self.excursions):
            on_pedestal = rotate(self._unpitched, foot - (self.pivot + self.pedestal_travel))
            return on_pedestal[:, :2] - (start - self.pivot)[:2]
        travel = foot[:, :2] - start[:2]
        travel[:, 0] -= self.column("pedestal_position")
        return travel
