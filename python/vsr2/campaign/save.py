"""Writing a campaign as a folder, whole or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
from pathlib import Path
from typing import Any

import numpy as np

from vsr2.campaign.array_files import SERIES_FOLDER, series_arrays, write_arrays
from vsr2.campaign.campaign import Campaign
from vsr2.campaign.description import FILE, MODEL_SUFFIXES, dump_description
from vsr2.campaign.trials_table import MOTIONS, TRIALS, trials_table
from vsr2.errors import CampaignError, reason

MODELS = "models"


def save_campaign(
    campaign: Campaign,
    folder: str | os.PathLike[str],
    *,
    overwrite: bool = False,
    motions: str = "",
) -> Path:
    """Write a campaign, whole or not at all.

    It is written beside `folder` under a temporary name and renamed when complete. Models that
    specimens name are copied into it.

    Args:
        campaign: what to write.
        folder: where; may exist if it is empty.
        overwrite: replace a campaign that is there.
        motions: folder beside it, as `../motions`, whose files several campaigns share: those that
            are there stay as they are, others are added; "": the campaign has its own.

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
            _write(campaign, temporary, motions)
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
        raise CampaignError(
            f"{path}: cannot be written ({reason(error)}); free space or choose another folder"
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
        raise CampaignError(
            f"{path}: cannot be used ({reason(error)}); choose another folder"
        ) from error


def _refuse_folder(path: Path, overwrite: bool) -> bool:
    """Whether a campaign is to be replaced."""
    if not os.path.lexists(path):
        return False
    if not path.is_dir() or path.is_symlink():
        raise CampaignError(f"{path}: is no folder; choose another name")
    present = sorted(entry.name for entry in path.iterdir())
    if not present:
        return False
    strange = set(present) - {FILE, TRIALS, MOTIONS, SERIES_FOLDER, MODELS}
    if FILE not in present or strange:
        what = min(strange) if strange else present[0]
        raise CampaignError(
            f"{path}: holds {what!r}, which is no part of a campaign; choose another folder"
        )
    if not overwrite:
        raise CampaignError(
            f"{path}: already holds a campaign; replace it with `--overwrite`, or choose another "
            "folder by `--out`"
        )
    return True


def _write(campaign: Campaign, folder: Path, motions: str) -> None:
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
            file = folder / (motions or MOTIONS) / f"{name}.npz"
            if not (motions and file.exists()):
                write_arrays(file, arrays, atomic=bool(motions))
    for trial in campaign.trials:
        if trial.series is not None:
            write_arrays(folder / SERIES_FOLDER / f"{trial.trial}.npz", series_arrays(trial.series))
    (folder / TRIALS).write_text(trials_table(campaign), encoding="utf-8", newline="")
    description = dump_description(campaign, _common_sampling(campaign), models, motions)
    (folder / FILE).write_text(description, encoding="utf-8")


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
