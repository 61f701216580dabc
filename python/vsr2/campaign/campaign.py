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
from vsr2.campaign.faults import extra_fault, id_fault, number_fault, refuse, text_fault
from vsr2.campaign.series import MAX_NOISE, MAX_POSITION, MAX_YAW, Series
from vsr2.codes import Tier
from vsr2.config.problems import shown
from vsr2.errors import CampaignError, Renamed
from vsr2.motion import Record, on_file
from vsr2.one_line import OneLine, counted

Array = NDArray[np.float64]

MAX_TRIALS = 100_000
"""Most trials of one campaign."""
MAX_ORDER = 1_000_000_000
"""Of a trial's order of execution."""
MAX_NOTE = 1000
"""Of a trial's note [characters]."""
MAX_MEASURE = 1e5
"""Of PGA [g] and PGV/PGA [s]; more is a mistaken unit."""
MAX_MASS = 1e12
"""Of a specimen [kg]."""


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
        refuse("specimen", faults)


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
                refuse("noise", {channel.name: number_fault(value, 0, MAX_NOISE, "")})
                # Files and hashes spell a float as Python does.
                object.__setattr__(self, channel.name, float(value))


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
        refuse(f"trial {shown(self.trial)}", trial_faults(vars(self)))
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
        refuse("campaign", {"name": text_fault(self.name)})
        trials = tuple(self.trials)
        if not 1 <= len(trials) <= MAX_TRIALS:
            raise CampaignError(
                f"campaign {self.name!r}: has {counted(len(trials), 'trial')}; 1 to {MAX_TRIALS} "
                "are allowed"
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
        refuse(
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
                    f"campaign {self.name!r}: the mask has {counted(len(mask), 'value')} for "
                    f"{counted(len(self.trials), 'trial')}"
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
