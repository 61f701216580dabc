"""What a batch gave: one row a trial, state and contact logs, and where it all came from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsr2 import _native
from vsr2._native import EngineKind
from vsr2._native import Outcome as Outcome
from vsr2._native import Status as Status
from vsr2.errors import ResultError
from vsr2.read_only import ReadOnlyArrays
from vsr2.scene.rotation import conjugate, quaternion_product, rotate

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.float64]

STATE_COLUMNS: tuple[str, ...] = tuple(name for name, _ in _native.state_columns())
"""Columns of `TrialLog.state`; their units: `_native.state_columns()`. The orientation is of the
body frame B."""

CONTACT_COLUMNS: tuple[str, ...] = tuple(name for name, _ in _native.contact_columns())
"""Columns of `TrialLog.contacts`; their units: `_native.contact_columns()`.

The normal points from the pedestal to the rock, a negative distance is penetration, impulses are
over one solver step."""


def _columns_between(columns: tuple[str, ...], first: str, last: str) -> slice:
    """Where the columns of a row from `first` to `last` stand."""
    return slice(columns.index(first), columns.index(last) + 1)


# Vectors in a row of `TrialLog.state`, then what is read of a row of `TrialLog.contacts`.
POSITION = _columns_between(STATE_COLUMNS, "rock_x", "rock_z")
ORIENTATION = _columns_between(STATE_COLUMNS, "rock_qx", "rock_qw")
VELOCITY = _columns_between(STATE_COLUMNS, "rock_vx", "rock_vz")
ANGULAR_VELOCITY = _columns_between(STATE_COLUMNS, "rock_wx", "rock_wz")
CONTACT_TIME = CONTACT_COLUMNS.index("time")
ROCK_POINT = _columns_between(CONTACT_COLUMNS, "rock_point_x", "rock_point_z")

STATUSES: tuple[str, ...] = tuple(Status.__members__)
"""How a trial ended; only `ok` and `tail_timeout` have an outcome other than `failed`."""

JUDGED = (Status.ok.name, Status.tail_timeout.name)
"""Statuses with which a trial's outcome is known."""

UNFINISHED = (Status.cancelled.name, Status.not_run.name)
"""Statuses of trials that did not run to an end."""

OUTCOMES: tuple[str, ...] = tuple(Outcome.__members__)
"""What the rock did, the gravest that applies; `failed`: there is no outcome, see the status."""

ENGINES: tuple[str, ...] = tuple(
    name for name, kind in EngineKind.__members__.items() if kind is not EngineKind.auto
)
"""What can run a trial; `auto` is the choice among them."""

NO_HAND_OVER: str = _native.HandOver.none.name
"""The column `hand_over` of a trial that the engine it began with ran to its end."""

FLOAT_COLUMNS: tuple[str, ...] = tuple(name for name, _, _ in _native.result_columns())
"""Numbers that the core gives for a trial; NaN where a trial has no such value."""

_TEXT_RESULTS = ("status", "outcome", "message", "engine", "hand_over")
_INTEGER_RESULTS = ("steps",)

RESULT_COLUMNS = (*FLOAT_COLUMNS, *_TEXT_RESULTS, *_INTEGER_RESULTS)
"""Columns of `BatchResult.trials` that running a trial fills."""

TEXT_COLUMNS = ("name", "motion", "motion_sha256", *_TEXT_RESULTS)
"""Columns of `BatchResult.trials` that hold text."""

INTEGER_COLUMNS = ("trial", "seed", *_INTEGER_RESULTS)
"""Columns of `BatchResult.trials` that hold whole numbers; those left are floats, NaN where a
trial has no such value."""


@dataclass(frozen=True, eq=False)
class TrialLog(ReadOnlyArrays):
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
        excursions: of the pedestal beside x, row by row with `state`: along y and z [m] and in
            pitch [rad], shape (n, 3); (0, 3) where it moves along x only.
        pivot: point of the pedestal's pitch axis in the world at the start, shape (3,) [m]; the
            pedestal's place along x, y and z is that of this point. Not used without excursions.

    Tilt, turn and slip are relative to the moving pedestal.

    Arrays are kept without a copy and offered read-only.

    Raises:
        ResultError: an array of another shape.
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
            "excursions": (None, 3),
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
            value = np.asarray(getattr(self, name), dtype=np.float64).view()
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

    def column(self, name: str) -> Array:
        """One column of `state` by its name, shape (n,).

        Raises:
            ResultError: there is no such column.
        """
        if name not in STATE_COLUMNS:
            raise ResultError(f"no column {name!r}; known: {', '.join(STATE_COLUMNS)}")
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
    def _unpitched(self) -> Array:
        """From the world to the pedestal, q_PW, shape (n, 4)."""
        half = 0.5 * self.excursions[:, 2]
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
            moved = np.column_stack([self.column("pedestal_position"), self.excursions[:, :2]])
            on_pedestal = rotate(self._unpitched, foot - (self.pivot + moved))
            return on_pedestal[:, :2] - (start - self.pivot)[:2]
        travel = foot[:, :2] - start[:2]
        travel[:, 0] -= self.column("pedestal_position")
        return travel


class _TrialColumn(NamedTuple):
    """A column of `BatchResult.trials`.

    Attributes:
        name: of the column.
        unit: empty: the column has none.
        meaning: empty: the name says it.
    """

    name: str
    unit: str
    meaning: str

    @property
    def text(self) -> str:
        """The meaning with the unit in square brackets, before what follows a semicolon."""
        if not self.unit:
            return self.meaning
        what, mark, rest = self.meaning.partition(";")
        return f"{what} [{self.unit}]{mark}{rest}".lstrip()


_TRIAL_COLUMNS = tuple(
    _TrialColumn(*column)
    for column in (
        ("trial", "", "index of the trial"),
        ("name", "", "name of the trial"),
        ("motion", "", "name of the motion"),
        ("motion_sha256", "", "hash of what was driven"),
        ("seed", "", "seed of the trial's perturbation"),
        ("status", "", ", ".join(STATUSES)),
        ("outcome", "", ", ".join(OUTCOMES)),
        ("pga_g", "g", "PGA of the driven motion"),
        ("pgv", "m/s", "PGV of the driven motion"),
        ("pgv_pga", "s", "PGV/PGA of the driven motion"),
        *_native.result_columns(),
        ("steps", "1", "time steps that were taken, the trial's own settling included"),
        ("engine", "", f"engine that it began with: {', '.join(ENGINES)}; empty: none ran"),
        (
            "hand_over",
            "",
            "why `fast` went on with `exact`: " + ", ".join(_native.HandOver.__members__),
        ),
        ("message", "", "of the exception that ended a trial of status `error`; else empty"),
    )
)

TRIAL_COLUMNS: dict[str, str] = {column.name: column.text for column in _TRIAL_COLUMNS}
"""Columns of `BatchResult.trials`, with their meaning and unit."""

TRIAL_UNITS: dict[str, str] = {column.name: column.unit for column in _TRIAL_COLUMNS if column.unit}
"""Units of the columns of `BatchResult.trials` that have one."""

COLUMNS = {
    "trial_columns": tuple(TRIAL_COLUMNS),
    "state_columns": STATE_COLUMNS,
    "contact_columns": CONTACT_COLUMNS,
}
"""What files of a batch hold; with other columns they are refused."""


@dataclass(frozen=True, eq=False)
class BatchResult:
    """Outcomes, logs and provenance of a batch.

    Attributes:
        trials: columns TRIAL_COLUMNS, each of shape (trials,), read-only; strings as object arrays.
        logs: one per trial; None where nothing was logged.
        provenance: study, versions, build facts, hashes, seeds, wall time (JSON-serialisable).

    Raises:
        ResultError: a column is missing, unknown, or not as long as there are trials.
    """

    trials: Mapping[str, NDArray[Any]]
    logs: tuple[TrialLog | None, ...]
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        odd = set(TRIAL_COLUMNS).symmetric_difference(self.trials)
        if odd:
            raise ResultError(
                f"batch result: missing or unknown columns {', '.join(sorted(odd))}; "
                f"wanted are {', '.join(TRIAL_COLUMNS)}"
            )
        for name, column in self.trials.items():
            if np.shape(column) != (len(self.logs),):
                raise ResultError(
                    f"batch result: column {name} has shape {np.shape(column)} for "
                    f"{len(self.logs)} trials"
                )
        columns = {name: np.asarray(column).view() for name, column in self.trials.items()}
        self.__setstate__({"trials": columns})

    def __setstate__(self, state: dict[str, Any]) -> None:
        # numpy forgets in pickles and copies that an array is read-only.
        self.__dict__.update(state)
        for column in self.trials.values():
            column.setflags(write=False)

    def __len__(self) -> int:
        return len(self.logs)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        for i in range(len(self)):
            yield {name: column[i] for name, column in self.trials.items()}

    def __getitem__(self, column: str) -> NDArray[Any]:
        if column not in self.trials:
            near = get_close_matches(str(column), TRIAL_COLUMNS, n=1, cutoff=0.75)
            raise ResultError(
                f"no column {column!r}; "
                + (f"did you mean {near[0]}? " if near else "")
                + f"known: {', '.join(TRIAL_COLUMNS)}"
            )
        return self.trials[column]

    @property
    def judged(self) -> NDArray[np.bool_]:
        """Which trials have an outcome, shape (trials,)."""
        found: NDArray[np.bool_] = self["outcome"] != Outcome.failed.name
        return found & np.isin(self["status"], JUDGED)

    @property
    def overturned(self) -> NDArray[np.bool_]:
        """Which trials ended with the rock overturned, shape (trials,)."""
        found: NDArray[np.bool_] = self["outcome"] == Outcome.overturned.name
        return found

    @property
    def finished(self) -> NDArray[np.bool_]:
        """Which trials ran to an end, that of a failure included, shape (trials,)."""
        return ~np.isin(self["status"], UNFINISHED)

    def log(self, trial: int) -> TrialLog:
        """The log of one trial.

        Raises:
            ResultError: no such trial, or nothing was logged for it.
        """
        if not 0 <= trial < len(self):
            raise ResultError(f"no trial {trial}; there are {len(self)}, counted from 0")
        log = self.logs[trial]
        if log is None:
            raise ResultError(
                f"trial {trial} ({self.trials['name'][trial]}) has no log; set output.log_every "
                "to 1 or more and run again"
            )
        return log

    def stack(self, quantity: str) -> Array:
        """A logged quantity over all trials, shape (trials, steps) or (trials, steps, k).

        Rows after a trial's end, and trials without a log, are NaN. `quantity` is a name in
        STATE_COLUMNS or one of "state", "position", "orientation", "roll_pitch_yaw", "tilt",
        "turn", "slip".

        Raises:
            ResultError: unknown quantity, or no trial has a log.
        """
        derived = ("state", "position", "orientation", "roll_pitch_yaw", "tilt", "turn", "slip")
        if quantity not in STATE_COLUMNS and quantity not in derived:
            raise ResultError(
                f"unknown quantity {quantity!r}; known: {', '.join((*derived, *STATE_COLUMNS))}"
            )
        series = [
            None
            if log is None
            else (log.column(quantity) if quantity in STATE_COLUMNS else getattr(log, quantity))
            for log in self.logs
        ]
        present = [s for s in series if s is not None]
        if not present:
            raise ResultError("no trial has a log; set output.log_every to 1 or more and run again")
        steps = max(len(s) for s in present)
        out = np.full((len(series), steps, *present[0].shape[1:]), np.nan)
        for i, s in enumerate(series):
            if s is not None:
                out[i, : len(s)] = s
        return out

    def to_xarray(self) -> xarray.Dataset:
        """The result as a dataset; see :func:`vsr2.results.dataset.to_xarray`."""
        from vsr2.results.dataset import to_xarray

        return to_xarray(self)
