"""`trials.csv` of a campaign: one row a trial, read cell by cell and written."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vsr2.campaign.campaign import (
    MAX_ORDER,
    Campaign,
    Specimen,
    trial_faults,
)
from vsr2.campaign.columns import NUMBER_COLUMNS
from vsr2.campaign.description import FILE, Description
from vsr2.campaign.faults import extra_fault
from vsr2.campaign.file_problems import Problems
from vsr2.campaign.table import Cells, Row, read_table
from vsr2.config.problems import shown
from vsr2.motion import STANDARD_GRAVITY
from vsr2.near_words import near_words

TRIALS = "trials.csv"
MOTIONS = "motions"
"""Folder of the files that the column `motion_file` names."""

_REQUIRED = ("trial", "motion", "session", "order", "specimen", "overturned")
_COLUMNS = {
    name: NUMBER_COLUMNS.get(name, name)
    for name in (
        *("trial", "motion", "motion_file", "session", "order", "specimen", "overturned"),
        *(*NUMBER_COLUMNS, "date", "note"),
    )
}
"""By the attribute of a trial, in the order in which they are written."""


class TrialsTable:
    """What a table of trials holds, as far as it is sound."""

    def __init__(self) -> None:
        self.values: list[dict[str, Any]] = []
        self.ids: dict[str, int] = {}
        self.motion_files: dict[str, int] = {}
        """Where each is named first: its row."""
        self.ids_known = False
        """Every row has a sound id, so that a series of another name belongs to none."""


def read_trials(folder: Path, description: Description | None, problems: Problems) -> TrialsTable:
    """Read `trials.csv`, as far as it is sound; `problems` gets what is not."""
    trials = TrialsTable()
    table = read_table(folder / TRIALS, TRIALS, problems)
    if table is None or not _known_columns(table.columns, problems):
        return trials
    specimens = None if description is None else description.specimens
    extras = [name for name in table.columns if name.startswith("x_")]
    ids: dict[str, tuple[str, int]] = {}
    row_of_order: dict[int, int] = {}
    trials.ids_known = table.complete and bool(table.rows)
    for row in table.rows:
        values = _trial(row, specimens, extras, problems)
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
        if order is not None and row_of_order.setdefault(order, row.line) != row.line:
            problems.add(
                TRIALS,
                f"{order} is there twice (first in row {row_of_order[order]}); number the trials "
                "in the order they were run in",
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
        if name in _COLUMNS.values():
            continue
        if name.startswith("x_"):
            fault = extra_fault(name)
        else:
            fault = f"is no column of the form; {_advice(name)}"
        if fault is not None:
            problems.add(TRIALS, fault, row=1, column=name[:60])
    return len(problems.found) == before


_MEANT = {
    "tilt": "peak_tilt_rad",
    "yaw": "final_yaw_rad",
    "slip": "final_slip_m",
    "pga": "pga_g",
    "pgv": "pgv_pga_s",
    "theta": "peak_tilt_rad",
    "rocking": "peak_tilt_rad",
    **dict.fromkeys(("fell", "fallen", "toppled", "overturning"), "overturned"),
}
"""Columns by what people put into names of their own for them."""

_REPLACED = {
    "pga_m_s2": f"divide it by {STANDARD_GRAVITY} and call it pga_g [g]",
    **dict.fromkeys(
        ("pgv", "pgv_m_s"), "divide it [m/s] by PGA [m/s^2] and call the ratio pgv_pga_s [s]"
    ),
}
"""What to do with columns of earlier versions, or of other measures."""


def _advice(name: str) -> str:
    if name in _REPLACED:
        return _REPLACED[name]
    known = _COLUMNS.values()
    words = re.split("[^a-z]+", name.lower())
    meant = [column for word, column in reversed(_MEANT.items()) if word in words]
    near = [*meant, *near_words(name.lower(), known)]
    if near:
        return f"did you mean {near[0]}? Call it so, or remove it"
    return f"if it holds numbers call it x_{ascii(name)[1:-1][:60]}, otherwise remove it"


def _trial(
    row: Row, specimens: Mapping[str, Specimen] | None, extras: list[str], problems: Problems
) -> dict[str, Any]:
    """Arguments of a CampaignTrial; None for those that are wrong."""
    cells = row.cells
    read = Cells(row, TRIALS, problems)
    values: dict[str, Any] = {
        **{key: cells[key] for key in ("trial", "motion", "session", "specimen")},
        "order": read.integer(
            "order", MAX_ORDER, f"is no whole number from 0 to {MAX_ORDER}; number the trials"
        ),
        "overturned": read.outcome("overturned"),
        "motion_file": cells.get("motion_file", cells["motion"]) or None,
        **{key: read.number(column) for key, column in NUMBER_COLUMNS.items()},
        "date": read.date("date", "2021-06-30"),
        "note": cells.get("note", ""),
        "extra": {name: value for name in extras if (value := read.number(name)) is not None},
    }
    faults = trial_faults(values)
    own_file = "motion_file" in cells
    if faults.get("motion_file") is not None:
        faults["motion_file"] = f"{faults['motion_file']} " + (
            f"(the file in {MOTIONS}/ without `.npz`)"
            if own_file
            else "(or name the files in a column `motion_file`)"
        )
    columns = NUMBER_COLUMNS | ({} if own_file else {"motion_file": "motion"})
    for key, fault in faults.items():
        if fault is not None:
            read.refuse(columns.get(key, key), fault)
    if specimens is not None and cells["specimen"] not in specimens:
        read.refuse(
            "specimen",
            f"{shown(cells['specimen'])} is no specimen of {FILE} ({', '.join([*specimens][:10])});"
            " correct it, or describe it there",
        )
    return {
        key: None if columns.get(key, key) in read.wrong else value for key, value in values.items()
    }


def trials_table(campaign: Campaign) -> str:
    """The text of `trials.csv`; optional columns that are blank throughout are left out."""

    def cell(value: object) -> str:
        if value is None or (isinstance(value, float) and math.isnan(value)):
            return ""
        if isinstance(value, (bool, np.bool_)):
            return str(int(value))
        if isinstance(value, (float, np.floating)):
            return repr(float(value)).removesuffix(".0")
        return str(value)

    rows = [
        {name: getattr(trial, key) for key, name in _COLUMNS.items()} | dict(trial.extra)
        for trial in campaign.trials
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
