"""A campaign as a folder of plain files (`docs/reference/campaign.md` describes the form).

    campaign.yaml        schema, name, specimens, measurement noise, provenance
    trials.csv           one row a trial
    motions/<file>.npz   the table's measured motion, of one trial or of several (or beside the
                         campaign, where campaign.yaml says `motions: ../motions`)
    series/<trial>.npz   the response in time, where it was measured
    models/              meshes that campaign.yaml names

Whatever the files hold, reading them ends with a campaign or with problems that name file, row,
column and remedy.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from vsr2.argument_names import checked_names
from vsr2.campaign.array_files import SERIES_FOLDER, ArrayFiles
from vsr2.campaign.campaign import Campaign, CampaignTrial
from vsr2.campaign.description import FILE, Description, read_description
from vsr2.campaign.file_problems import CampaignProblem, Problems
from vsr2.campaign.series import Series
from vsr2.campaign.trials_table import MOTIONS, TRIALS, read_trials
from vsr2.config.bounded import near_path
from vsr2.errors import CampaignError, GeometryError
from vsr2.motion import Record
from vsr2.one_line import counted
from vsr2.results import is_result
from vsr2.scene.mesh import load_mesh

MAX_UNEVENNESS = 0.01
"""Of the rows of a series, over the interval that is stated."""

_logger = logging.getLogger(__name__)


@checked_names(CampaignError)
def load_campaign(folder: str | os.PathLike[str]) -> Campaign:
    """Read a campaign.

    Raises:
        CampaignError: lists what is wrong with its files; no other exception leaves this
            function, whatever the files hold.
    """
    problems = Problems()
    campaign = _read(Path(folder), problems)
    if campaign is None:
        raise CampaignError(problems.listed(os.fspath(folder)))
    _logger.debug("%s: campaign of %s read", os.fspath(folder), counted(len(campaign), "trial"))
    return campaign


def check_campaign(folder: str | os.PathLike[str]) -> list[CampaignProblem]:
    """All that is wrong with a campaign's files; nothing: :func:`load_campaign` reads them.

    Models are read, too, though :func:`load_campaign` does not need them.
    """
    problems = Problems()
    campaign = _read(Path(folder), problems)
    if campaign is not None:
        _check_models(Path(folder), campaign, problems)
    return problems.result()


def _check_models(folder: Path, campaign: Campaign, problems: Problems) -> None:
    for path in sorted({s.model_file for s in campaign.specimens.values() if s.model_file}):
        try:
            load_mesh(path, closed=False)
        except GeometryError as error:
            name = os.path.relpath(path, folder).replace(os.sep, "/")
            problems.add(name, error.message)


def _read(folder: Path, problems: Problems) -> Campaign | None:
    """The campaign; None where `problems` got one."""
    try:
        present = folder.is_dir()
    except (OSError, ValueError):
        present = False
    if not present:
        if folder.exists():
            problems.add("", "is a file; give the folder of a campaign")
            return None
        near = near_path(folder)
        remedy = f"did you mean {near}?" if near else "check the path"
        problems.add("", f"no such folder; {remedy}")
        return None
    if not (folder / FILE).exists() and is_result(folder):
        problems.add(
            "",
            "is a result of `vsr2 run` or `vsr2 fragility`, not a campaign; give a campaign's "
            "folder, or make one of the study by `vsr2 campaign simulate STUDY --out FOLDER`",
        )
        return None
    if not any((folder / name).exists() for name in (FILE, TRIALS)):
        problems.add(
            "",
            f"holds no {FILE} and no {TRIALS}; give a campaign's folder, as `vsr2 campaign "
            "simulate STUDY --out FOLDER` writes",
        )
        return None
    # The table is read even where the description is broken, so that one check tells all.
    description, motions_folder = read_description(folder, problems)
    trials = read_trials(folder, description, problems)
    arrays = ArrayFiles(folder, problems)
    motions: dict[str, Record] = {}
    for file, row in trials.motion_files.items() if motions_folder is not None else ():
        record = arrays.motion(file, row, motions_folder or MOTIONS)
        if record is not None:
            motions[file] = record
    series = {trial: arrays.series(trial) for trial in trials.ids}
    if trials.ids_known:
        arrays.unclaimed_series(trials.ids)
    if description is not None:
        _check_sampling(description, motions, series, problems)
    if problems or description is None:
        return None
    try:
        return Campaign(
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
        return None


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
                    f"{description.motions or MOTIONS}/{name}.npz",
                    f"is {record.sample_interval:.9g} s, {FILE} states {stated:.9g} s; correct one",
                    column="sample_interval_s",
                )
    stated = description.sampling.get("series_interval_s")
    if stated is not None:
        for trial, one in series.items():
            if one is not None and one.time.size > 1:
                off = np.abs(np.diff(one.time) - stated)
                if off.max() > MAX_UNEVENNESS * stated:
                    problems.add(
                        f"{SERIES_FOLDER}/{trial}.npz",
                        f"the rows {int(off.argmax())} and {int(off.argmax()) + 1} are "
                        f"{np.diff(one.time)[off.argmax()]:.9g} s apart, {FILE} states "
                        f"{stated:.9g} s; correct one, or state none",
                        column="time_s",
                    )
