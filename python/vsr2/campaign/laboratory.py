"""The published shake-table campaign of Saifullah and Wittich (2023), brought into the form.

Two forms are read. Packed: `trials.csv` with `motions/TestNNN.npz`. Raw: `trials.csv` with the
laboratory's own text files `TestNNN.txt`, beside it or in `raw/`. For each trial the packed motion
goes before the raw one.
"""

from __future__ import annotations

import datetime
import os
from dataclasses import replace
from pathlib import Path

from vsr2.campaign.campaign import (
    MAX_MEASURE,
    MAX_ORDER,
    Campaign,
    CampaignTrial,
    Specimen,
    extra_fault,
    number_fault,
    text_fault,
)
from vsr2.campaign.problems import Problems
from vsr2.campaign.save import save_campaign
from vsr2.campaign.table import Row, number, read_table, whole_number
from vsr2.config.problems import shown
from vsr2.errors import CampaignError
from vsr2.motion import STANDARD_GRAVITY, Record, read_record

SPECIMEN = "SP1"
SPECIMEN_MASS = 353.8
"""Of SP1 [kg], as the supplement gives it."""
MODEL = "models/final_sp1.obj"
"""Scanned mesh of SP1, upright."""

_TABLE = "trials.csv"
_REQUIRED = ("test", "sp1_overturned", "date", "motion")
_OWN = (*_REQUIRED, "pga_g", "pgv_pga_s", "has_motion")
_PLACES = ("motions/{}.npz", "{}.npz", "{}.txt", "raw/{}.txt")


def import_lab(
    source: str | os.PathLike[str], dest: str | os.PathLike[str], *, overwrite: bool = False
) -> Campaign:
    """Write the laboratory's campaign in the form of :func:`vsr2.campaign.load_campaign`.

    The day is the session and the test number the order. Displacement comes from volts and
    acceleration from g, along one sign (:mod:`vsr2.motion.recording`); offsets at rest stay. Other
    columns of the table, peers' predictions among them, are kept as `x_` columns. Trials without a
    motion file are kept, for they have outcomes.

    Args:
        source: folder of the laboratory's data.
        dest: folder to write; see :func:`vsr2.campaign.save_campaign`.
        overwrite: replace a campaign that is there.

    Returns:
        What was written.

    Raises:
        CampaignError: a table that cannot be used (names row and column), or `dest` cannot be
            written.
        MotionError: a motion file that cannot be used.
    """
    folder = Path(source)
    problems = Problems()
    table = read_table(folder / _TABLE, _TABLE, problems)
    if table is not None:
        for name in _REQUIRED:
            if name not in table.columns:
                problems.add(_TABLE, "is missing; is this the laboratory's table?", column=name)
    trials: list[CampaignTrial] = []
    if table is not None and not problems:
        extras = [name for name in table.columns if name not in _OWN]
        for name in extras:
            fault = extra_fault(f"x_{name}")
            if fault is not None:
                problems.add(_TABLE, fault, row=1, column=name[:60])
        found = [_trial(row, extras, problems) for row in table.rows]
        trials = [trial for trial in found if trial is not None]
    if problems:
        raise CampaignError(problems.listed(f"{folder}: cannot be imported"))
    motions: dict[str, Record] = {}
    for i, trial in enumerate(trials):
        record = _record(folder, trial.trial)
        if record is not None:
            motions[trial.trial] = record
            trials[i] = replace(trial, motion_file=trial.trial)
    model = folder / MODEL
    campaign = Campaign(
        name="lab",
        description=(
            "Uniaxial shake-table tests of a granite specimen (Saifullah and Wittich 2023), as "
            "republished with the public virtual shake robot."
        ),
        trials=tuple(trials),
        motions=motions,
        specimens={
            SPECIMEN: Specimen(
                description="granite boulder",
                mass=SPECIMEN_MASS,
                model_file=model if model.is_file() else None,
            )
        },
    )
    save_campaign(campaign, dest, overwrite=overwrite)
    return campaign


def _record(folder: Path, trial: str) -> Record | None:
    for place in _PLACES:
        path = folder / place.format(trial)
        if path.is_file():
            return read_record(path)
    return None


def _trial(row: Row, extras: list[str], problems: Problems) -> CampaignTrial | None:
    before = (len(problems.found), problems.left_out)

    def wrong(column: str, what: str) -> None:
        problems.add(_TABLE, what, row=row.line, column=column)

    def measure(column: str, unit: str, factor: float = 1.0) -> float | None:
        cell = row.cells.get(column, "")
        if not cell:
            return None
        value = number(cell)
        fault = "no number" if value is None else number_fault(value, 0, MAX_MEASURE, unit)
        if value is None or fault is not None:
            wrong(column, f"{shown(cell)}: {fault}; correct it, or leave it blank")
            return None
        return value * factor

    test = whole_number(row.cells["test"])
    if test is None or not 0 <= test <= MAX_ORDER:
        wrong("test", f"{shown(row.cells['test'])} is no test number; correct it")
        test = 0
    outcome = row.cells["sp1_overturned"]
    if outcome not in ("", "0", "1"):
        wrong("sp1_overturned", f"{shown(outcome)} is not 0, 1 or blank")
    motion = row.cells["motion"]
    fault = text_fault(motion)
    if fault is not None:
        wrong("motion", fault)
    date = _date(row.cells["date"])
    if date is None:
        wrong("date", f"{shown(row.cells['date'])} is no date; write it as 20210630")
    extra: dict[str, float] = {}
    for name in extras:
        cell = row.cells[name]
        value = number(cell) if cell else None
        if cell and value is None:
            wrong(
                name, f"{shown(cell)} is no number; correct it, leave it blank, or drop the column"
            )
        if value is not None:
            extra[f"x_{name}"] = value
    pga = measure("pga_g", "g", STANDARD_GRAVITY)
    pgv_pga = measure("pgv_pga_s", "s")
    if (len(problems.found), problems.left_out) != before or date is None:
        return None
    return CampaignTrial(
        trial=f"Test{test:03d}",
        motion=motion,
        session=date.isoformat(),
        order=test,
        specimen=SPECIMEN,
        overturned=None if not outcome else outcome == "1",
        pga=pga,
        pgv_pga=pgv_pga,
        date=date,
        extra=extra,
    )


def _date(cell: str) -> datetime.date | None:
    # `fromisoformat` would take weeks and dashes, too.
    if len(cell) != 8 or not (cell.isascii() and cell.isdigit()):
        return None
    try:
        return datetime.date.fromisoformat(cell)
    except ValueError:
        return None
