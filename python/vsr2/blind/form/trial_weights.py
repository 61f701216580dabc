"""Trials of a pack's campaigns, and the sealed weights of each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from vsr2.campaign.file_problems import Problems
from vsr2.campaign.table import read_table
from vsr2.campaign.trials_table import TRIALS
from vsr2.errors import BlindError
from vsr2.one_line import counted


def trial_ids(path: Path) -> tuple[str, ...]:
    """Ids in a `trials.csv`, in the order of its rows.

    Raises:
        BlindError: it cannot be read, or has no ids.
    """
    problems = Problems()
    table = read_table(path, str(path), problems)
    if table is not None and "trial" not in table.columns:
        raise BlindError(f"{path}: has no column trial; give one with the trials' ids")
    if table is None or problems:
        raise BlindError(str(problems.found[0]))
    return tuple(row.cells["trial"] for row in table.rows)


def check_weights(weights: Sequence[float], trials: Sequence[str], folder: Path, name: str) -> None:
    """Refuse sealed weights that are not one a trial.

    Args:
        weights: of a campaign; empty: they are not known.
        trials: its trials.
        folder: of the campaign.
        name: its id.

    Raises:
        BlindError: there are more or fewer.
    """
    if weights and len(weights) != len(trials):
        raise BlindError(
            f"{folder / TRIALS}: has {counted(len(trials), 'trial')}, but the key has "
            f"{counted(len(weights), 'weight')} in campaigns.{name}.where.weights; give one a "
            "trial, or none"
        )
