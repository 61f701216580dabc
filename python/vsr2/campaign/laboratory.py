"""The published shake-table campaign of Saifullah and Wittich (2023), brought into the form.

Two forms are read. Packed: `trials.csv` with `motions/TestNNN.npz`. Raw: `trials.csv` with the
laboratory's own text files `TestNNN.txt`, beside it or in `raw/`. For each trial the packed motion
goes before the raw one.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from vsr2.campaign.campaign import (
    MAX_ORDER,
    Campaign,
    CampaignTrial,
    Specimen,
    trial_faults,
)
from vsr2.campaign.columns import NUMBER_COLUMNS
from vsr2.campaign.faults import extra_fault
from vsr2.campaign.file_problems import Problems
from vsr2.campaign.save import save_campaign
from vsr2.campaign.table import Cells, Row, read_table
from vsr2.config.problems import shown
from vsr2.errors import CampaignError
from vsr2.motion import Record, read_record

_TABLE = "trials.csv"
_REQUIRED = ("test", "date", "motion")
_MEASURES = {key: NUMBER_COLUMNS[key] for key in ("pga_g", "pgv_pga_s")}
_OWN = (*_REQUIRED, *_MEASURES.values(), "has_motion")


@dataclass(frozen=True)
class LaboratorySpecimen:
    """What the laboratory's files say of a specimen.

    Attributes:
        model: scanned mesh, upright.
        outcome: column of the table.
        peers: columns of predictions of its outcomes begin so.
        measured: whether the outcome must be there; a specimen whose outcomes are kept aside has
            trials without.
        mass: [kg]; None: not stated.
    """

    model: str
    outcome: str
    peers: str
    measured: bool = True
    mass: float | None = None


SPECIMENS = {
    # The mass is the supplement's.
    "SP1": LaboratorySpecimen("models/final_sp1.obj", "sp1_overturned", "dem_s1_", mass=353.8),
    "SP2": LaboratorySpecimen(
        "models/final_sp2_1.obj", "sp2_overturned", "dem_s2_", measured=False
    ),
}
"""Both stood on the table in every test."""
_OF_A_SPECIMEN = re.compile(r"sp\d_overturned$|dem_s\d_")
_MOTION_FILES = ("motions/{}.npz", "{}.npz", "{}.txt", "raw/{}.txt")


def import_lab(
    source: str | os.PathLike[str],
    dest: str | os.PathLike[str],
    *,
    specimen: str = "SP1",
    overwrite: bool = False,
) -> Campaign:
    """Write the laboratory's campaign in the form of :func:`vsr2.campaign.load_campaign`.

    The day is the session and the test number the order. Displacement comes from volts and
    acceleration from g, along one sign (:mod:`vsr2.motion.recording`); offsets at rest stay. Other
    columns of the table, peers' predictions among them, are kept as `x_` columns, but for those of
    another specimen. Trials without a motion file are kept, for they have outcomes.

    Args:
        source: folder of the laboratory's data.
        dest: folder to write; see :func:`vsr2.campaign.save_campaign`.
        specimen: `SP1` or `SP2`; without a column of its outcomes those of SP2 are unknown.
        overwrite: replace a campaign that is there.

    Returns:
        What was written.

    Raises:
        CampaignError: no such specimen, a table that cannot be used (names row and column), or
            `dest` cannot be written.
        MotionError: a motion file that cannot be used.
    """
    if specimen not in SPECIMENS:
        raise CampaignError(f"specimen is {shown(specimen)}; give one of {', '.join(SPECIMENS)}")
    known = SPECIMENS[specimen]
    folder = Path(source)
    problems = Problems()
    table = read_table(folder / _TABLE, _TABLE, problems)
    if table is not None:
        for name in (*_REQUIRED, *([known.outcome] if known.measured else [])):
            if name not in table.columns:
                problems.add(_TABLE, "is missing; is this the laboratory's table?", column=name)
    trials: list[CampaignTrial] = []
    if table is not None and not problems:
        extras = _extras(table.columns, known)
        for name in extras:
            fault = extra_fault(f"x_{name}")
            if fault is not None:
                problems.add(_TABLE, fault, row=1, column=name[:60])
        found = [_trial(row, specimen, extras, problems) for row in table.rows]
        trials = [trial for trial in found if trial is not None]
    if problems:
        raise CampaignError(problems.listed(f"{folder}: cannot be imported"))
    motions: dict[str, Record] = {}
    for i, trial in enumerate(trials):
        record = _record(folder, trial.trial)
        if record is not None:
            motions[trial.trial] = record
            trials[i] = replace(trial, motion_file=trial.trial)
    model = folder / known.model
    campaign = Campaign(
        name="lab",
        description=(
            "Uniaxial shake-table tests of a granite specimen (Saifullah and Wittich 2023), as "
            "republished with the public virtual shake robot."
        ),
        trials=tuple(trials),
        motions=motions,
        specimens={
            specimen: Specimen(
                description="granite boulder",
                mass=known.mass,
                model_file=model if model.is_file() else None,
            )
        },
    )
    save_campaign(campaign, dest, overwrite=overwrite)
    return campaign


def _record(folder: Path, trial: str) -> Record | None:
    for place in _MOTION_FILES:
        path = folder / place.format(trial)
        if path.is_file():
            return read_record(path)
    return None


def _extras(columns: Sequence[str], known: LaboratorySpecimen) -> list[str]:
    """Further columns of the table, but for those of another specimen."""
    return [
        name
        for name in columns
        if name not in (*_OWN, known.outcome)
        and (name.startswith(known.peers) or not _OF_A_SPECIMEN.match(name))
    ]


def _trial(row: Row, specimen: str, extras: list[str], problems: Problems) -> CampaignTrial | None:
    outcome = SPECIMENS[specimen].outcome
    cells = Cells(row, _TABLE, problems)
    test = cells.integer("test", MAX_ORDER, "is no test number; correct it")
    date = cells.date("date", "20210630")
    if not row.cells["date"]:
        cells.refuse("date", "is blank; write it as 20210630")
    measures = {key: cells.number(column) for key, column in _MEASURES.items()}
    values: dict[str, Any] = {
        "trial": f"Test{test:03d}",
        "motion": row.cells["motion"],
        "session": str(date),
        "order": test,
        "specimen": specimen,
        "overturned": cells.outcome(outcome) if outcome in row.cells else None,
        "motion_file": None,
        **dict.fromkeys(("peak_tilt", "final_yaw", "final_slip")),
        **measures,
        "date": date,
        "note": "",
        "extra": {
            f"x_{name}": value for name in extras if (value := cells.number(name)) is not None
        },
    }
    for key, fault in trial_faults(values).items():
        if fault is not None:
            column = _MEASURES.get(key, key)
            if key in _MEASURES:
                fault = f"{shown(row.cells[column])}: {fault}; or leave it blank"
            cells.refuse(column, fault)
    return None if cells.wrong else CampaignTrial(**values)
