"""Folders in which work goes on that was interrupted: made ready, by one rule for all."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from vsr2.errors import ResultError, reason
from vsr2.results.links import FIGURE_FOLDER, refuse_links


def prepare_work_folder(
    folder: str | Path,
    own: Iterable[str],
    what: str,
    *,
    overwrite: bool = False,
    resume: bool = False,
) -> Path:
    """Make a folder ready, before any work is spent.

    Args:
        folder: created with its parents where it does not exist.
        own: patterns of the files that the work writes, relative to the folder.
        what: such a folder holds, as "a calibration".
        overwrite: remove what is there, only files of these names.
        resume: go on with what is there; of more weight than `overwrite`.

    Returns:
        The folder.

    Raises:
        ResultError: it cannot be used, holds such files and neither is asked for, or one of them
            or the figures lie behind a link, which may lead to files that are not ours.
    """
    path = Path(folder)
    try:
        path.mkdir(parents=True, exist_ok=True)
        present = [file for pattern in own for file in sorted(path.glob(pattern))]
        if present and not (overwrite or resume):
            raise ResultError(
                f"{path}: already holds {what}; go on with `--resume`, replace it with "
                "`--overwrite`, or choose another folder by `--out`"
            )
        below = {
            str(parent)
            for file in present
            for parent in file.relative_to(path).parents
            if parent != Path()
        }
        refuse_links(path, (FIGURE_FOLDER, *sorted(below)))
        if not resume:
            for file in present:
                file.unlink()
    except (OSError, ValueError) as error:
        raise ResultError(
            f"{path}: cannot be used ({reason(error)}); choose another folder"
        ) from error
    return path


def refuse_other_work(file: Path, keys: Sequence[str | int], wanted: Any, what: str) -> None:
    """Refuse to go on where a finished result is of other work, which would replace it.

    Args:
        file: the result, as JSON; where there is none, or none that can be read, nothing is lost.
        keys: that lead to what tells works apart.
        wanted: its value for the work that is asked for, as JSON has it.
        what: such a file holds, as "a search for causes".

    Raises:
        ResultError: the file holds another value.
    """
    try:
        found: Any = json.loads(file.read_text(encoding="utf-8"))
        for key in keys:
            found = found[key]
    except (OSError, ValueError, LookupError, TypeError):
        return
    if found != wanted:
        raise ResultError(
            f"{file}: is {what} of another scene, campaign, seed, tier, prior or version of VSR2; "
            "replace it with `--overwrite`, or choose another folder"
        )
