"""A campaign as a folder of plain files (`docs/reference/campaign.md` describes the form).

    campaign.yaml        schema, name, specimens, measurement noise, provenance
    trials.csv           one row a trial
    motions/<file>.npz   the table's measured motion, of one trial or of several
    series/<trial>.npz   the response in time, where it was measured
    models/              meshes that campaign.yaml names

Whatever the files hold, reading them ends with a campaign or with problems that name file, row,
column and remedy.
"""

from __future__ import annotations

import csv
import datetime
import hashlib
import io
import logging
import math
import os
import re
import secrets
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.campaign.arrays import MAX_ARRAY_FILE_BYTES, parse_arrays
from vsr2.campaign.campaign import (
    MAX_MEASURE,
    MAX_NOTE,
    MAX_ORDER,
    Campaign,
    CampaignTrial,
    Series,
    Specimen,
    extra_fault,
    id_fault,
    number_fault,
    text_fault,
)
from vsr2.campaign.description import (
    FILE,
    MODEL_SUFFIXES,
    Description,
    dump_description,
    read_description,
)
from vsr2.campaign.problems import CampaignProblem, Problems
from vsr2.campaign.table import Row, number, read_bytes, read_table, whole_number
from vsr2.config.problems import shown
from vsr2.errors import CampaignError, GeometryError, MotionError
from vsr2.motion import Record
from vsr2.scene.mesh import load_mesh

Array = NDArray[np.float64]

TRIALS = "trials.csv"
MOTIONS = "motions"
SERIES = "series"
MODELS = "models"
MAX_TOTAL_NUMBERS = 250_000_000
"""Most numbers in all motions and series of a campaign together: 2 GB."""

_REQUIRED = ("trial", "motion", "session", "order", "specimen", "overturned")
_OPTIONAL = ("motion_file", "peak_tilt_rad", "pga_m_s2", "pgv_pga_s", "date", "note")
_MOTION_ARRAYS = ("sample_interval_s", "displacement_m", "acceleration_m_s2")
_SERIES_ARRAYS = (
    "time_s",
    "tilt_rad",
    "position_m",
    "orientation_xyzw",
    "noise_tilt_rad",
    "noise_position_m",
    "noise_orientation_rad",
)
_DATE = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}\Z")
_SHOWN = 20

_logger = logging.getLogger(__name__)


def load_campaign(folder: str | os.PathLike[str]) -> Campaign:
    """Read a campaign.

    Raises:
        CampaignError: lists what is wrong with its files; no other exception leaves this
            function, whatever the files hold.
    """
    campaign, problems = _read(Path(folder))
    if campaign is None:
        lines = [str(problem) for problem in problems[:_SHOWN]]
        if len(problems) > _SHOWN:
            lines.append(f"... and {len(problems) - _SHOWN} more; `vsr2 campaign check` lists them")
        if len(lines) == 1:
            raise CampaignError(f"{os.fspath(folder)}: {lines[0]}")
        heading = f"{os.fspath(folder)}: {len(problems)} problems"
        raise CampaignError("\n  ".join([heading, *lines]))
    _logger.debug("%s: campaign of %d trials read", os.fspath(folder), len(campaign))
    return campaign


def check_campaign(folder: str | os.PathLike[str]) -> list[CampaignProblem]:
    """All that is wrong with a campaign's files; nothing: :func:`load_campaign` reads them.

    Models are read, too, though :func:`load_campaign` does not need them.
    """
    campaign, problems = _read(Path(folder))
    return problems if campaign is None else _model_problems(Path(folder), campaign)


def _model_problems(folder: Path, campaign: Campaign) -> list[CampaignProblem]:
    problems = Problems()
    for path in sorted({s.model_file for s in campaign.specimens.values() if s.model_file}):
        try:
            load_mesh(path, closed=False)
        except GeometryError as error:
            name = os.path.relpath(path, folder).replace(os.sep, "/")
            problems.add(name, str(error).removeprefix(f"{path}: "))
    return problems.result()


def _read(folder: Path) -> tuple[Campaign | None, list[CampaignProblem]]:
    problems = Problems()
    try:
        present = folder.is_dir()
    except (OSError, ValueError):
        present = False
    if not present:
        problems.add("", "no such folder; check the path")
        return None, problems.result()
    # The table is read even where the description is broken, so that one check tells all.
    description = read_description(folder, problems)
    trials = _read_trials(folder, description, problems)
    arrays = _ArrayFiles(folder, problems)
    motions: dict[str, Record] = {}
    for file, row in trials.motion_files.items():
        record = arrays.motion(file, row)
        if record is not None:
            motions[file] = record
    series = {trial: arrays.series(trial) for trial in trials.ids}
    if trials.ids_known:
        arrays.unclaimed_series(trials.ids)
    if description is not None:
        _check_sampling(description, motions, series, problems)
    if problems or description is None:
        return None, problems.result()
    try:
        campaign = Campaign(
            name=description.name,
            trials=tuple(
                CampaignTrial(**values, series=series[values["trial"]]) for values in trials.values
            ),
            motions=motions,
            specimens=description.specimens,
            description=description.description,
            noise=description.noise,
            provenance=description.provenance,
        )
    except CampaignError as error:
        problems.add(TRIALS, str(error))
        return None, problems.result()
    return campaign, []


# --- trials.csv ---------------------------------------------------------------------------------


class _Trials:
    """What a table of trials holds, as far as it is sound."""

    def __init__(self) -> None:
        self.values: list[dict[str, Any]] = []
        self.ids: dict[str, int] = {}
        self.motion_files: dict[str, int] = {}
        """Where each is named first: its row."""
        self.ids_known = False
        """Every row has a sound id, so that a series of another name belongs to none."""


def _read_trials(folder: Path, description: Description | None, problems: Problems) -> _Trials:
    trials = _Trials()
    table = read_table(folder / TRIALS, TRIALS, problems)
    if table is None or not _known_columns(table.columns, problems):
        return trials
    specimens = None if description is None else description.specimens
    extras = [name for name in table.columns if name.startswith("x_")]
    ids: dict[str, tuple[str, int]] = {}
    orders: dict[int, int] = {}
    trials.ids_known = table.whole and bool(table.rows)
    for row in table.rows:
        values = _Cells(row, problems).trial(specimens, extras)
        trial, order = values.get("trial"), values.get("order")
        if trial is None:
            trials.ids_known = False
        else:
            if trial.lower() in ids:
                first, line = ids[trial.lower()]
                problems.add(
                    TRIALS,
                    f"{shown(trial)} is there twice (as {shown(first)} in row {line}); rename one",
                    row=row.line,
                    column="trial",
                )
            else:
                ids[trial.lower()] = (trial, row.line)
                trials.ids[trial] = row.line
        if order is not None and orders.setdefault(order, row.line) != row.line:
            problems.add(
                TRIALS,
                f"{order} is there twice (first in row {orders[order]}); number the trials in the "
                "order they were run in",
                row=row.line,
                column="order",
            )
        if values.get("motion_file") is not None:
            trials.motion_files.setdefault(values["motion_file"], row.line)
        trials.values.append(values)
    return trials


def _known_columns(columns: tuple[str, ...], problems: Problems) -> bool:
    before = len(problems.found)
    for name in _REQUIRED:
        if name not in columns:
            problems.add(TRIALS, "is missing; add it to the header", row=1, column=name)
    for name in columns:
        if name in (*_REQUIRED, *_OPTIONAL):
            continue
        if name.startswith("x_"):
            fault = extra_fault(name)
        else:
            fault = (
                "is no column of the form; if it holds numbers call it "
                f"x_{ascii(name)[1:-1][:60]}, otherwise remove it"
            )
        if fault is not None:
            problems.add(TRIALS, fault, row=1, column=name[:60])
    return len(problems.found) == before


class _Cells:
    """The cells of one row, turned into the values of a trial."""

    def __init__(self, row: Row, problems: Problems) -> None:
        self._cells = row.cells
        self._line = row.line
        self._problems = problems

    def trial(self, specimens: Mapping[str, Specimen] | None, extras: list[str]) -> dict[str, Any]:
        """Arguments of a CampaignTrial; those that are wrong are left out."""
        values: dict[str, Any] = {
            "trial": self._checked("trial", id_fault(self._cells["trial"])),
            "motion": self._checked("motion", text_fault(self._cells["motion"])),
            "session": self._checked("session", text_fault(self._cells["session"])),
            "order": self._order(),
            "specimen": self._specimen(specimens),
            "overturned": self._overturned(),
            "motion_file": self._motion_file(),
            "peak_tilt": self._number("peak_tilt_rad", 0, math.pi + 1e-9, "rad"),
            "pga": self._number("pga_m_s2", 0, MAX_MEASURE, "m/s^2"),
            "pgv_pga": self._number("pgv_pga_s", 0, MAX_MEASURE, "s"),
            "date": self._date(),
            "extra": {},
        }
        note = self._cells.get("note", "")
        values["note"] = self._checked("note", text_fault(note, limit=MAX_NOTE, empty=True))
        for name in extras:
            value = self._number(name, -math.inf, math.inf, "")
            if value is not None:
                values["extra"][name] = value
        return values

    def _add(self, column: str, what: str) -> None:
        self._problems.add(TRIALS, what, row=self._line, column=column)

    def _checked(self, column: str, fault: str | None) -> str | None:
        if fault is None:
            return self._cells.get(column, "")
        self._add(column, fault)
        return None

    def _number(self, column: str, low: float, high: float, unit: str) -> float | None:
        cell = self._cells.get(column, "")
        if not cell:
            return None
        value = number(cell)
        if value is None:
            self._add(
                column, f"{shown(cell)} is no number; leave the cell blank where it is unknown"
            )
            return None
        fault = number_fault(value, low, high, unit)
        if fault is not None:
            self._add(column, fault)
            return None
        return value

    def _order(self) -> int | None:
        cell = self._cells["order"]
        value = whole_number(cell)
        if value is None or not 0 <= value <= MAX_ORDER:
            self._add(
                "order",
                f"{shown(cell)} is no whole number from 0 to {MAX_ORDER}; number the trials",
            )
            return None
        return value

    def _specimen(self, specimens: Mapping[str, Specimen] | None) -> str | None:
        cell = self._checked("specimen", id_fault(self._cells["specimen"]))
        if cell is not None and specimens is not None and cell not in specimens:
            known = ", ".join(list(specimens)[:10])
            self._add(
                "specimen",
                f"{shown(cell)} is no specimen of {FILE} ({known}); correct it, or describe "
                "it there",
            )
            return None
        return cell

    def _overturned(self) -> bool | None:
        cell = self._cells["overturned"]
        if cell in ("0", "1"):
            return cell == "1"
        if cell:
            self._add("overturned", f"{shown(cell)} is not 0, 1 or blank (unknown)")
        return None

    def _motion_file(self) -> str | None:
        if "motion_file" in self._cells:
            cell = self._cells["motion_file"]
            fault = id_fault(cell) if cell else None
            if fault is not None:
                self._add("motion_file", f"{fault} (the file in {MOTIONS}/ without `.npz`)")
            return None if fault is not None or not cell else cell
        cell = self._cells["motion"]
        if id_fault(cell) is not None:
            self._add("motion", f"{id_fault(cell)}, or name the files in a column `motion_file`")
            return None
        return cell

    def _date(self) -> datetime.date | None:
        cell = self._cells.get("date", "")
        if not cell:
            return None
        try:
            if _DATE.match(cell):
                return datetime.date.fromisoformat(cell)
        except ValueError:
            pass
        self._add("date", f"{shown(cell)} is no date; write it as 2021-06-30")
        return None


# --- arrays -------------------------------------------------------------------------------------


class _ArrayFiles:
    """Reads the `.npz` files of a folder and notes what is wrong with them."""

    def __init__(self, folder: Path, problems: Problems) -> None:
        self._folder = folder
        self._problems = problems
        self._numbers = 0

    def motion(self, name: str, row: int) -> Record | None:
        """The record in `motions/`, named first in `row` of the table."""
        file = f"{MOTIONS}/{name}.npz"
        content = read_bytes(self._folder / file, MAX_ARRAY_FILE_BYTES)
        if isinstance(content, str):
            self._problems.add(file, f"named in {TRIALS}, row {row}: {content}")
            return None
        arrays = self._arrays(content, file, _MOTION_ARRAYS)
        if arrays is None:
            return None
        interval = self._one_number(file, arrays, "sample_interval_s", required=True)
        if interval is None:
            return None
        path = self._folder / file
        try:
            return Record(
                name=name,
                sample_interval=interval,
                displacement=arrays.get("displacement_m"),
                acceleration=arrays.get("acceleration_m_s2"),
                source=str(path),
                sha256=hashlib.sha256(content).hexdigest(),
            )
        except MotionError as error:
            self._problems.add(file, str(error).removeprefix(f"{path}: "))
            return None

    def series(self, trial: str) -> Series | None:
        """The series of a trial, where there is one."""
        file = f"{SERIES}/{trial}.npz"
        try:
            if not os.path.lexists(self._folder / file):
                return None
        except ValueError:
            return None
        content = read_bytes(self._folder / file, MAX_ARRAY_FILE_BYTES)
        if isinstance(content, str):
            self._problems.add(file, content)
            return None
        arrays = self._arrays(content, file, _SERIES_ARRAYS)
        if arrays is None:
            return None
        if "time_s" not in arrays:
            self._problems.add(file, "is missing; add it", column="time_s")
            return None
        before = len(self._problems.found)
        noise = {
            f"noise_{name}": self._one_number(file, arrays, key)
            for name, key in (
                ("tilt", "noise_tilt_rad"),
                ("position", "noise_position_m"),
                ("orientation", "noise_orientation_rad"),
            )
        }
        if len(self._problems.found) > before:
            return None
        try:
            return Series(
                time=arrays["time_s"],
                tilt=arrays.get("tilt_rad"),
                position=arrays.get("position_m"),
                orientation=arrays.get("orientation_xyzw"),
                **noise,
            )
        except CampaignError as error:
            self._problems.add(file, str(error).removeprefix("series: "))
            return None

    def unclaimed_series(self, trials: Mapping[str, int]) -> None:
        """Note series that belong to no trial: most often a slip in a name."""
        try:
            files = sorted(os.listdir(self._folder / SERIES))
        except (OSError, ValueError):
            return
        for file in files:
            if file.endswith(".npz") and file.removesuffix(".npz") not in trials:
                self._problems.add(
                    f"{SERIES}/{ascii(file)[1:-1][:100]}",
                    f"belongs to no trial of {TRIALS}; rename or remove it",
                )

    def _arrays(
        self, content: bytes, file: str, allowed: tuple[str, ...]
    ) -> dict[str, Array] | None:
        if self._numbers > MAX_TOTAL_NUMBERS:
            return None
        arrays = parse_arrays(content, file, allowed, self._problems)
        if arrays is not None:
            self._numbers += sum(array.size for array in arrays.values())
            if self._numbers > MAX_TOTAL_NUMBERS:
                self._problems.add(
                    file,
                    f"motions and series up to here hold more than {MAX_TOTAL_NUMBERS} numbers; "
                    "split the campaign",
                )
                return None
        return arrays

    def _one_number(
        self, file: str, arrays: Mapping[str, Array], key: str, *, required: bool = False
    ) -> float | None:
        if key not in arrays:
            if required:
                self._problems.add(file, "is missing; add it", column=key)
            return None
        array = arrays[key]
        if array.size != 1 or not np.isfinite(array).all() or array.reshape(-1)[0] < 0:
            self._problems.add(
                file, "is not one finite number of 0 or more; correct it", column=key
            )
            return None
        return float(array.reshape(-1)[0])


def _check_sampling(
    description: Description,
    motions: Mapping[str, Record],
    series: Mapping[str, Series | None],
    problems: Problems,
) -> None:
    stated = description.sampling.get("motion_interval_s")
    if stated is not None:
        for name, record in motions.items():
            if abs(record.sample_interval - stated) > 1e-6 * stated:
                problems.add(
                    f"{MOTIONS}/{name}.npz",
                    f"is {record.sample_interval:.9g} s, {FILE} states {stated:.9g} s; correct one",
                    column="sample_interval_s",
                )
    stated = description.sampling.get("series_interval_s")
    if stated is not None:
        for trial, one in series.items():
            if one is not None and one.time.size > 1:
                off = np.abs(np.diff(one.time) - stated)
                if off.max() > 0.01 * stated:
                    problems.add(
                        f"{SERIES}/{trial}.npz",
                        f"the rows {int(off.argmax())} and {int(off.argmax()) + 1} are "
                        f"{np.diff(one.time)[off.argmax()]:.9g} s apart, {FILE} states "
                        f"{stated:.9g} s; correct one, or state none",
                        column="time_s",
                    )


# --- writing ------------------------------------------------------------------------------------


def save_campaign(
    campaign: Campaign, folder: str | os.PathLike[str], *, overwrite: bool = False
) -> Path:
    """Write a campaign, whole or not at all.

    It is written beside `folder` under a temporary name and renamed when complete. Models that
    specimens name are copied into it.

    Args:
        campaign: what to write.
        folder: where; may exist if it is empty.
        overwrite: replace a campaign that is there.

    Returns:
        The folder.

    Raises:
        CampaignError: the folder holds something else, or a campaign and `overwrite` is off; a
            model is missing or of an unknown kind; or it cannot be written.
    """
    path = Path(folder)
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(6)}.tmp")
    try:
        replaced = _refuse_folder(path, overwrite)
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.mkdir()
        try:
            _write(campaign, temporary)
            if replaced:
                old = path.with_name(f".{path.name}.{secrets.token_hex(6)}.old")
                os.rename(path, old)
                try:
                    os.rename(temporary, path)
                except OSError:
                    os.rename(old, path)
                    raise
                shutil.rmtree(old)
            else:
                # Takes the place of an empty folder, too.
                os.rename(temporary, path)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise CampaignError(
            f"{path}: cannot be written ({reason}); free space or choose another folder"
        ) from error
    return path


def prepare_destination(folder: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Refuse a folder that :func:`save_campaign` would refuse, before work is spent on it.

    Raises:
        CampaignError: it holds something else, or a campaign and `overwrite` is off; or it cannot
            be read.
    """
    path = Path(folder)
    try:
        _refuse_folder(path, overwrite)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise CampaignError(f"{path}: cannot be used ({reason}); choose another folder") from error


def _refuse_folder(path: Path, overwrite: bool) -> bool:
    """Whether a campaign is to be replaced."""
    if not os.path.lexists(path):
        return False
    if not path.is_dir() or path.is_symlink():
        raise CampaignError(f"{path}: is no folder; choose another name")
    present = sorted(entry.name for entry in path.iterdir())
    if not present:
        return False
    strange = set(present) - {FILE, TRIALS, MOTIONS, SERIES, MODELS}
    if FILE not in present or strange:
        what = min(strange) if strange else present[0]
        raise CampaignError(
            f"{path}: holds {what!r}, which is no part of a campaign; choose another folder"
        )
    if not overwrite:
        raise CampaignError(
            f"{path}: already holds a campaign; choose another folder, or overwrite it"
        )
    return True


def _write(campaign: Campaign, folder: Path) -> None:
    models: dict[str, str] = {}
    for key, specimen in campaign.specimens.items():
        if specimen.model_file is not None:
            models[key] = _copy_model(specimen.model_file, folder, key)
    used = {trial.motion_file for trial in campaign.trials}
    for name, record in campaign.motions.items():
        if name in used:
            arrays: dict[str, Any] = {"sample_interval_s": np.float64(record.sample_interval)}
            if record.displacement is not None:
                arrays["displacement_m"] = record.displacement
            if record.acceleration is not None:
                arrays["acceleration_m_s2"] = record.acceleration
            if len(arrays) == 1:
                raise CampaignError(
                    f"campaign {campaign.name!r}: motion {name!r} has neither displacement nor "
                    "acceleration; differentiate or integrate what it has"
                )
            _write_arrays(folder / MOTIONS / f"{name}.npz", arrays)
    for trial in campaign.trials:
        if trial.series is not None:
            _write_arrays(folder / SERIES / f"{trial.trial}.npz", _series_arrays(trial.series))
    (folder / TRIALS).write_text(_table(campaign), encoding="utf-8", newline="")
    description = Description(
        name=campaign.name,
        description=campaign.description,
        specimens=campaign.specimens,
        noise=campaign.noise,
        sampling=_common_sampling(campaign),
        provenance=campaign.provenance,
    )
    (folder / FILE).write_text(dump_description(description, models), encoding="utf-8")


def _copy_model(source: Path, folder: Path, specimen: str) -> str:
    suffix = source.suffix.lower()
    if suffix not in MODEL_SUFFIXES or not source.is_file():
        raise CampaignError(
            f"specimen {specimen!r}: model {source} is no file of the kinds "
            f"{', '.join(MODEL_SUFFIXES)}; correct the path, or give none"
        )
    (folder / MODELS).mkdir(exist_ok=True)
    name = f"{MODELS}/{specimen}{suffix}"
    shutil.copyfile(source, folder / name)
    return name


def _write_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    path.parent.mkdir(exist_ok=True)
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=False, **arrays)
    path.write_bytes(stream.getvalue())


def _series_arrays(series: Series) -> dict[str, Any]:
    values = (
        series.time,
        series.tilt,
        series.position,
        series.orientation,
        series.noise_tilt,
        series.noise_position,
        series.noise_orientation,
    )
    return {
        key: np.asarray(value, dtype=np.float64)
        for key, value in zip(_SERIES_ARRAYS, values, strict=True)
        if value is not None
    }


def _common_sampling(campaign: Campaign) -> dict[str, float]:
    out: dict[str, float] = {}
    used = {trial.motion_file for trial in campaign.trials}
    motions = {r.sample_interval for name, r in campaign.motions.items() if name in used}
    if len(motions) == 1:
        out["motion_interval_s"] = float(motions.pop())
    intervals = [t.series.interval for t in campaign.trials if t.series is not None]
    known = [interval for interval in intervals if interval is not None]
    if known and len(known) == len(intervals) and max(known) - min(known) <= 1e-6 * min(known):
        # Differences of times that were rounded: the digits that they share.
        out["series_interval_s"] = float(f"{np.median(known):.12g}")
    return out


def _table(campaign: Campaign) -> str:
    def cell(value: object) -> str:
        if value is None or (isinstance(value, float) and math.isnan(value)):
            return ""
        if isinstance(value, (bool, np.bool_)):
            return str(int(value))
        if isinstance(value, (float, np.floating)):
            return repr(float(value)).removesuffix(".0")
        return str(value)

    rows = [
        {
            "trial": t.trial,
            "motion": t.motion,
            "motion_file": t.motion_file,
            "session": t.session,
            "order": t.order,
            "specimen": t.specimen,
            "overturned": t.overturned,
            "peak_tilt_rad": t.peak_tilt,
            "pga_m_s2": t.pga,
            "pgv_pga_s": t.pgv_pga,
            "date": t.date,
            "note": t.note,
            **t.extra,
        }
        for t in campaign.trials
    ]
    cells = [{name: cell(value) for name, value in row.items()} for row in rows]
    always = (*_REQUIRED, "motion_file")
    names = dict.fromkeys(name for row in cells for name in row)
    columns = [n for n in names if n in always or any(row.get(n) for row in cells)]
    stream = io.StringIO()
    writer = csv.DictWriter(stream, columns, restval="", extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(cells)
    return stream.getvalue()
