"""The campaign: trials of a rock on a shaking table, measured or simulated, in one type."""

from __future__ import annotations

import datetime
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.argument_names import checked_names
from vsr2.campaign.faults import extra_fault, id_fault, number_fault, text_fault
from vsr2.codes import Tier
from vsr2.config.problems import shown
from vsr2.errors import CampaignError, Renamed
from vsr2.motion import Record, on_file
from vsr2.one_line import OneLine
from vsr2.read_only import real_array

Array = NDArray[np.float64]

MAX_TRIALS = 100_000
"""Most trials of one campaign."""
MAX_SERIES_ROWS = 2_000_000
"""Most rows of one series."""
MAX_ORDER = 1_000_000_000
"""Of a trial's order of execution."""
MAX_NOTE = 1000
"""Of a trial's note [characters]."""
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
MAX_MEASURE = 1e5
"""Of PGA [g] and PGV/PGA [s]; more is a mistaken unit."""
MAX_NOISE = 1e5
"""Of a standard error, in the unit of its channel; more is a mistaken unit."""
NORM_TOLERANCE = 1e-3
"""Of a quaternion's norm, relative: three decimals are enough."""
MAX_MASS = 1e12
"""Of a specimen [kg]."""


def _refuse(owner: str, faults: Mapping[str, str | None]) -> None:
    for key, fault in faults.items():
        if fault is not None:
            raise CampaignError(f"{key}: {fault}", key=owner)


@dataclass(frozen=True)
class Specimen:
    """What stood on the table.

    Attributes:
        description: for people.
        mass: [kg]; None: unknown.
        model_file: mesh in metres (OBJ, STL or PLY); None: there is none.
    """

    description: str = ""
    mass: float | None = None
    model_file: Path | None = None

    def __post_init__(self) -> None:
        faults = {"description": text_fault(self.description, limit=MAX_NOTE, empty=True)}
        if self.mass is not None:
            faults["mass"] = number_fault(self.mass, 0, MAX_MASS, "kg", above=True)
        _refuse("specimen", faults)


@checked_names(CampaignError)
@dataclass(frozen=True)
class MeasurementNoise:
    """Standard errors of what was measured, one number a channel; None: not stated.

    Attributes:
        displacement: of the table's displacement channel [m].
        acceleration: of the table's acceleration channel [m/s^2].
        peak_tilt: of the largest tilt [rad].
        peak_tilt_relative: of its logarithm, beside `peak_tilt` [1].
        tilt: of the tilt in series [rad].
        position: of each component of the position in series [m].
        orientation: of the orientation in series, about each axis [rad].
        yaw: of the yaw in series [rad].
        slip: of the foot's slip in series [m].
    """

    displacement: float | None = None
    acceleration: float | None = None
    peak_tilt: float | None = None
    peak_tilt_relative: float | None = None
    tilt: float | None = None
    position: float | None = None
    orientation: float | None = None
    yaw: float | None = None
    slip: float | None = None

    def __post_init__(self) -> None:
        for channel in fields(self):
            value = getattr(self, channel.name)
            if value is not None:
                _refuse("noise", {channel.name: number_fault(value, 0, MAX_NOISE, "")})
                # Files and hashes spell a float as Python does.
                object.__setattr__(self, channel.name, float(value))


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
                _refuse("series", {name: number_fault(value, 0, MAX_NOISE, "")})

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
                f"{name} has {len(value)} rows; 1 to {MAX_SERIES_ROWS} are allowed", key="series"
            )
        if name != "time" and len(value) != self.time.size:
            raise CampaignError(
                f"{name} has {len(value)} rows, time has {self.time.size}", key="series"
            )
        bad = np.argwhere(~(np.abs(value) <= limit))
        if bad.size:
            place = tuple(int(i) for i in bad[0])
            raise CampaignError(
                f"{name} is {value[place]:g} {unit} at row {place[0]}, beyond {limit:g} "
                f"{unit}; {len(bad)} such values; leave such rows out, or check the unit",
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


def trial_faults(values: Mapping[str, Any]) -> dict[str, str | None]:
    """What is wrong with the values of a :class:`CampaignTrial`, by attribute or extra column."""
    order, overturned = values["order"], values["overturned"]
    integral = isinstance(order, int) and not isinstance(order, bool)
    faults = {
        "trial": id_fault(values["trial"]),
        "motion": text_fault(values["motion"]),
        "session": text_fault(values["session"]),
        "specimen": id_fault(values["specimen"]),
        "note": text_fault(values["note"], limit=MAX_NOTE, empty=True),
        "order": number_fault(order, 0, MAX_ORDER, "")
        if integral
        else f"{shown(order)} is no whole number",
    }
    if overturned not in (None, True, False):
        faults["overturned"] = f"{shown(overturned)} is not True, False or None"
    if values["motion_file"] is not None:
        faults["motion_file"] = id_fault(values["motion_file"])
    for name, low, limit, unit in (
        ("peak_tilt", 0, math.pi + 1e-9, "rad"),
        ("final_yaw", -MAX_YAW, MAX_YAW, "rad"),
        ("final_slip", -MAX_POSITION, MAX_POSITION, "m"),
        ("pga_g", 0, MAX_MEASURE, "g"),
        ("pgv_pga_s", 0, MAX_MEASURE, "s"),
    ):
        if values[name] is not None:
            faults[name] = number_fault(values[name], low, limit, unit)
    for name, value in values["extra"].items():
        faults[str(name)] = extra_fault(name) or number_fault(value, -math.inf, math.inf, "")
    return faults


@checked_names(CampaignError)
@dataclass(frozen=True, eq=False)
class CampaignTrial:
    """One shaking of one specimen, measured or simulated.

    Attributes:
        trial: id, unique within the campaign; letters, digits, `.`, `_`, `-`.
        motion: id of the ground motion; every scaling of one ground motion has the same.
        session: what was done without rebuilding the set-up, a day for example.
        order: of execution, unique within the campaign.
        specimen: id of the specimen.
        overturned: None: unknown.
        motion_file: name of the table's measured motion in `Campaign.motions`; None: there is none.
        peak_tilt: largest tilt measured [rad], 0 to pi; of a trial that overturned or was caught a
            lower bound. None: unknown.
        final_yaw: turn about the vertical that is left after the trial [rad]; None: unknown.
        final_slip: travel of the foot on the table along the shaking, likewise [m].
        pga_g: peak acceleration of the table as published with the data [g]; None: not given.
        pgv_pga_s: PGV/PGA of the table as published with the data [s]; None: not given.
        date: of execution.
        note: for people.
        extra: numbers under names that start with `x_`, peers' predictions for example.
        series: response in time.

    Raises:
        CampaignError: a value that cannot be used.
    """

    trial: str
    motion: str
    session: str
    order: int
    specimen: str
    overturned: bool | None = None
    motion_file: str | None = None
    peak_tilt: float | None = None
    final_yaw: float | None = None
    final_slip: float | None = None
    pga_g: float | None = None
    pgv_pga_s: float | None = None
    date: datetime.date | None = None
    note: str = ""
    extra: Mapping[str, float] = field(default_factory=dict)
    series: Series | None = None

    pga = Renamed("pga_g", " [g]")
    pgv_pga = Renamed("pgv_pga_s", " [s]")

    def __post_init__(self) -> None:
        _refuse(f"trial {shown(self.trial)}", trial_faults(vars(self)))
        object.__setattr__(self, "extra", MappingProxyType(dict(self.extra)))

    @property
    def tier(self) -> Tier | None:
        """Information on the response: None (not even an outcome), B, M or T."""
        if self.overturned is None:
            return None
        if self.series is not None and self.series.tilt_angle is not None:
            return "T"
        return "B" if self.peak_tilt is None else "M"


@checked_names(CampaignError)
@dataclass(frozen=True, eq=False, repr=False)
class Campaign(OneLine):
    """Trials, with the motions and specimens they name.

    Attributes:
        name: of the campaign.
        trials: at least one; ids and order unique.
        motions: measured motions of the table by file name; a file may serve several trials.
        specimens: by id; every trial's is among them.
        description: for people.
        noise: standard errors of the measurements, where they are known.
        provenance: where it came from (JSON-serialisable); a simulated campaign's holds
            everything that went into it, so leave it out of data whose making is to be guessed.

    Raises:
        CampaignError: ids or order twice, or something named that is not there.
    """

    name: str
    trials: tuple[CampaignTrial, ...]
    motions: Mapping[str, Record] = field(default_factory=dict)
    specimens: Mapping[str, Specimen] = field(default_factory=dict)
    description: str = ""
    noise: MeasurementNoise = field(default_factory=MeasurementNoise)
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _refuse("campaign", {"name": text_fault(self.name)})
        trials = tuple(self.trials)
        if not 1 <= len(trials) <= MAX_TRIALS:
            raise CampaignError(
                f"campaign {self.name!r}: has {len(trials)} trials; 1 to {MAX_TRIALS} are allowed"
            )
        ids: dict[str, str] = {}
        trial_of_order: dict[int, str] = {}
        for trial in trials:
            # Files of ids that differ in case only are one file on some file systems.
            if trial.trial.lower() in ids:
                first = ids[trial.trial.lower()]
                raise CampaignError(
                    f"campaign {self.name!r}: trial {trial.trial!r} is there twice "
                    f"(first as {first!r}); rename one"
                )
            ids[trial.trial.lower()] = trial.trial
            if trial_of_order.setdefault(trial.order, trial.trial) != trial.trial:
                raise CampaignError(
                    f"campaign {self.name!r}: order {trial.order} is both {trial.trial!r}'s and "
                    f"{trial_of_order[trial.order]!r}'s; number the trials as they were run"
                )
            if trial.specimen not in self.specimens:
                raise CampaignError(
                    f"campaign {self.name!r}: trial {trial.trial!r} names the unknown specimen "
                    f"{trial.specimen!r}; describe it in `specimens`"
                )
            if trial.motion_file is not None and trial.motion_file not in self.motions:
                raise CampaignError(
                    f"campaign {self.name!r}: trial {trial.trial!r} names the motion file "
                    f"{trial.motion_file!r}, which is not among `motions`"
                )
        _refuse(
            f"campaign {self.name!r}",
            {f"specimen {key}": id_fault(key) for key in self.specimens}
            | {f"motion file {key}": id_fault(key) for key in self.motions},
        )
        object.__setattr__(self, "trials", trials)
        for name in ("motions", "specimens"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def __len__(self) -> int:
        return len(self.trials)

    @property
    def facts(self) -> Mapping[str, object]:
        """Its name, information, trials, ground motions and how many overturned."""
        return {
            "name": self.name,
            "tier": self.tier,
            "trials": len(self),
            "motions": len(set(self.motion_ids)),
            "overturned": int(np.nansum(self.overturned)),
        }

    @property
    def tier(self) -> Tier:
        """The information that all trials with an outcome share.

        B: outcomes; M: the largest tilt, too; T: series, too (a series holds its largest tilt).
        """
        tiers = [trial.tier for trial in self.trials if trial.tier is not None]
        # The letters happen to be in the order of what they say: B < M < T.
        return min(tiers, default="B")

    @property
    def overturned(self) -> Array:
        """Outcomes, 1 or 0, NaN where unknown, shape (trials,)."""
        return np.array([np.nan if t.overturned is None else t.overturned for t in self.trials])

    @property
    def motion_ids(self) -> NDArray[np.str_]:
        """Ground motion of each trial, shape (trials,): what folds and bootstraps go by."""
        return np.array([trial.motion for trial in self.trials], dtype=np.str_)

    @property
    def relative_order(self) -> Array:
        """Order of each trial, 0 the first and 1 the last, shape (trials,); of one trial 0."""
        order = np.array([trial.order for trial in self.trials], dtype=np.float64)
        found: Array = (order - order.min()) / max(float(np.ptp(order)), 1.0)
        return found

    @property
    def extra_columns(self) -> tuple[str, ...]:
        """Names of the extra columns, in the order of their first appearance."""
        return tuple(dict.fromkeys(name for trial in self.trials for name in trial.extra))

    def extra(self, column: str) -> Array:
        """An extra column, NaN where blank, shape (trials,).

        Raises:
            CampaignError: there is no such column.
        """
        if column not in self.extra_columns:
            raise CampaignError(
                f"campaign {self.name!r}: no extra column {column!r}; there are "
                f"{', '.join(self.extra_columns) or 'none'}"
            )
        return np.array([trial.extra.get(column, np.nan) for trial in self.trials])

    def record(self, trial: CampaignTrial) -> Record | None:
        """The table's measured motion in a trial; None: there is none."""
        return None if trial.motion_file is None else self.motions[trial.motion_file]

    def select(self, kept: Sequence[bool] | NDArray[np.bool_] | Collection[str]) -> Campaign:
        """The campaign of some of the trials, with the motions they name; its order is kept.

        Args:
            kept: a mask of shape (trials,), or ids of trials.

        Raises:
            CampaignError: a mask of another shape, an id that is not there, or nothing is kept.
        """
        chosen = list(kept)
        if all(isinstance(item, str) for item in chosen):
            unknown = set(chosen) - {trial.trial for trial in self.trials}
            if unknown:
                raise CampaignError(
                    f"campaign {self.name!r}: has no trial {shown(min(unknown, key=str))}"
                )
            mask = [trial.trial in set(chosen) for trial in self.trials]
        else:
            mask = [bool(item) for item in chosen]
            if len(mask) != len(self.trials):
                raise CampaignError(
                    f"campaign {self.name!r}: the mask has {len(mask)} values for "
                    f"{len(self.trials)} trials"
                )
        trials = tuple(t for t, keep in zip(self.trials, mask, strict=True) if keep)
        named = {trial.motion_file for trial in trials}
        motions = {name: record for name, record in self.motions.items() if name in named}
        return replace(self, trials=trials, motions=motions)

    def on_file(self) -> Campaign:
        """The same campaign with records that stay in their files (:func:`vsr2.motion.on_file`)."""
        return replace(self, motions={key: on_file(one) for key, one in self.motions.items()})

    def with_motion(self) -> Campaign:
        """The trials whose table motion was measured.

        Raises:
            CampaignError: there is none.
        """
        return self.select([trial.motion_file is not None for trial in self.trials])
