"""Folders in which work goes on that was interrupted: made ready, by one rule for all."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from vsr2.errors import ResultError
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
                "`--overwrite`, or choose another folder"
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
        reason = getattr(error, "strerror", None) or error
        raise ResultError(f"{path}: cannot be used ({reason}); choose another folder") from error
    return path
