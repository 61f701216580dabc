"""A result as a folder of plain files.

    trials.csv          one row a trial, columns TRIAL_COLUMNS, full precision; an empty number: NaN
    provenance.json     the provenance, and under `result_files` what the folder holds, with the
                        meaning and unit of every column; written last
    logs/000000.npz     the arrays of a TrialLog, one file a trial that has a log
    npy/000000.npy      the same in the original's columns, on request
    models/*.npz        display meshes (:mod:`vsr2.results.models`)

Every file is written under a temporary name and renamed, so none is ever half there under its own
name. A folder without `provenance.json` belongs to a run that did not finish.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import re
import secrets
import shutil
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.argument_names import checked_names
from vsr2.config.bounded import near_path
from vsr2.errors import ResultError, reason
from vsr2.one_line import counted
from vsr2.results.arrays import read_arrays, write_arrays
from vsr2.results.atomic import link_atomic, make_folder, write_atomic, write_text
from vsr2.results.batch_table import read_table, read_text, table_text
from vsr2.results.journal import JOURNAL_FILE, has_journal
from vsr2.results.links import FIGURE_FOLDER, SHARD_FOLDER, refuse_links
from vsr2.results.result import (
    COLUMNS,
    TRIAL_COLUMNS,
    BatchResult,
)
from vsr2.results.store import refuse_written
from vsr2.results.trial_log import TrialLog

TRIALS_FILE = "trials.csv"
PROVENANCE_FILE = "provenance.json"
LOG_FOLDER = "logs"
NPY_FOLDER = "npy"
MODEL_FOLDER = "models"

NPY_COLUMNS = (
    "time",
    "commanded_position",
    "pedestal_position",
    "rock_x",
    "rock_y",
    "rock_z",
    "rock_qx",
    "rock_qy",
    "rock_qz",
    "rock_qw",
)
"""Columns of the original's `.npy` rows [s, m, m, m, -]: the rock's mass centre in the world and
the orientation of its model frame; from the start of the motion on."""

FORMAT = "vsr2 result"
FORMAT_VERSION = 3
"""Of the folder's files; others are refused."""
_RESERVED = "result_files"
_LOG_NAMES = tuple(field.name for field in dataclasses.fields(TrialLog))
_SPATIAL_NAMES = ("excursions", "pivot")
_FOLDERS = {
    LOG_FOLDER: re.compile(r"\d{6,}\.npz"),
    NPY_FOLDER: re.compile(r"\d{6,}\.npy"),
    MODEL_FOLDER: re.compile(r"(rock|pedestal)\.npz"),
}
"""Folders of a result, with the names of the files that VSR2 writes into them."""
_INNER = (*_FOLDERS, FIGURE_FOLDER, SHARD_FOLDER)
_TEMPORARY = re.compile(r"\..+\.[0-9a-f]{12}\.tmp")


def prepare_folder(
    folder: str | os.PathLike[str], *, overwrite: bool = False, resume: bool = False
) -> Path:
    """Make a folder ready to take a result, before any work is spent on one.

    Args:
        folder: created with its parents where it does not exist.
        overwrite: remove a result that is already there (only files that VSR2 wrote).
        resume: leave a folder as it is that holds the journal of an unfinished run.

    Returns:
        The folder.

    Raises:
        ResultError: it cannot be created or written to, holds a result and `overwrite` is off, or
            another process is writing one into it.
    """
    path = Path(folder)
    if resume and has_journal(path):
        refuse_links(path, _INNER)
        return path
    try:
        path.mkdir(parents=True, exist_ok=True)
        _try_to_write(path)
    except (OSError, ValueError) as error:
        raise ResultError(
            f"{path}: cannot be used as result folder ({reason(error)}); choose another folder"
        ) from error
    present = _result_files(path)
    if present and not overwrite:
        remedy = "replace it with `--overwrite`, or choose another folder by `--out`"
        if resume:
            raise ResultError(
                f"{path}: holds the finished result of another study ({_named(present)}), with "
                f"which `--resume` cannot go on; {remedy}"
            )
        raise ResultError(
            f"{path}: already holds a result ({_named(present)}); {remedy}, or, if it is of the "
            "same study, go on with `--resume`"
        )
    refuse_written(path / JOURNAL_FILE)
    _remove(present)
    return path


def _named(files: Sequence[Path]) -> str:
    more = len(files) - 1
    return files[0].name + (f" and {counted(more, 'more file')}" if more else "")


def remove_result(folder: str | os.PathLike[str]) -> None:
    """Remove a result and its folders, but no file that VSR2 did not write.

    Raises:
        ResultError: a file cannot be removed.
    """
    path = Path(folder)
    if not path.is_dir():
        return
    remove_temporaries(path)
    _remove(_result_files(path))
    for parent in (path / LOG_FOLDER, path / NPY_FOLDER, path / MODEL_FOLDER, path):
        with suppress(OSError):  # not there, or not empty
            parent.rmdir()


def _remove(files: list[Path]) -> None:
    for file in files:
        try:
            file.unlink(missing_ok=True)
        except OSError as error:
            raise ResultError(f"{file}: cannot be removed ({error.strerror})") from error


def require_space(folder: str | os.PathLike[str], size: float) -> None:
    """Refuse a file system that cannot take a result, before any work is spent on one.

    Args:
        folder: where the result will be.
        size: that it will have at least [byte].

    Raises:
        ResultError: less than `size` is free.
    """
    try:
        free = shutil.disk_usage(folder).free
    except OSError as error:
        raise ResultError(f"{folder}: cannot be used ({error.strerror})") from error
    if free < size:
        raise ResultError(
            f"{folder}: the result needs at least {size / 1e6:.3g} MB and {free / 1e6:.3g} MB are "
            "free; free space, choose another folder, or raise output.log_every"
        )


def remove_temporaries(folder: str | os.PathLike[str]) -> None:
    """Remove what a killed writer left in a result folder; no other may be at work there.

    Raises:
        ResultError: a file cannot be removed.
    """
    path = Path(folder)
    for parent in (path, *(path / name for name in (*_FOLDERS, FIGURE_FOLDER))):
        _remove([file for file in parent.glob(".*.tmp") if _TEMPORARY.fullmatch(file.name)])


def _try_to_write(path: Path) -> None:
    # Permission bits tell little (root, read-only mounts, quotas): only writing does.
    probe = path / f".probe.{secrets.token_hex(6)}.tmp"
    try:
        with open(probe, "xb") as file:
            file.write(b"0")
    finally:
        probe.unlink(missing_ok=True)


def _result_files(path: Path) -> list[Path]:
    """Files of a result, the one that declares it whole first."""
    names = (PROVENANCE_FILE, TRIALS_FILE, JOURNAL_FILE)
    files = [path / name for name in names if (path / name).exists()]
    refuse_links(path, _INNER)
    for folder, form in _FOLDERS.items():
        if (path / folder).is_dir():
            found = (path / folder).iterdir()
            files += sorted(file for file in found if form.fullmatch(file.name))
    return files


@checked_names(ResultError)
def save_result(
    result: BatchResult,
    folder: str | os.PathLike[str],
    *,
    npy: bool = False,
    overwrite: bool = False,
    streamed_logs: bool = False,
) -> Path:
    """Write a result into a folder.

    Args:
        result: what to write.
        folder: where; see :func:`prepare_folder`.
        npy: also write the original's rows, columns NPY_COLUMNS, shape (n, 10).
        overwrite: replace a result that is there.
        streamed_logs: logs were written before by :func:`save_trial_log` into this folder, which
            was made ready by :func:`prepare_folder`; they are kept and belong to this result.

    Returns:
        The folder.

    Raises:
        ResultError: the folder cannot be used or written to, it holds a result and `overwrite` is
            off, or the provenance is not serialisable. The final names never hold half a file.
    """
    text = _provenance_text(result, [])  # refuse what cannot be written before writing anything
    if streamed_logs:
        path = Path(folder)
        _refuse_finished(path, overwrite)
    else:
        path = prepare_folder(folder, overwrite=overwrite)
    for i, log in enumerate(result.logs):
        if log is not None:
            save_trial_log(path, i, log, npy=npy)
    logged = [i for i in range(len(result)) if _numbered(path, LOG_FOLDER, i, "npz").exists()]
    text = _provenance_text(result, logged)
    table = (part.encode("utf-8", "surrogateescape") for part in table_text(result.trials))
    write_atomic(path / TRIALS_FILE, lambda file: file.writelines(table))
    write_text(path / PROVENANCE_FILE, text)
    return path


def _refuse_finished(path: Path, overwrite: bool) -> None:
    if not path.is_dir():
        raise ResultError(f"{path}: is no folder; call prepare_folder before the run")
    present = (path / PROVENANCE_FILE).exists() or (path / TRIALS_FILE).exists()
    if present and not overwrite:
        raise ResultError(f"{path}: already holds a result; call prepare_folder before the run")


def save_trial_log(
    folder: str | os.PathLike[str], index: int, log: TrialLog, *, npy: bool = False
) -> None:
    """Write the log of one trial, so that a batch can do so as trials finish.

    Args:
        folder: made ready by :func:`prepare_folder`.
        index: of the trial, from 0.
        log: its log.
        npy: also write the original's rows.

    Raises:
        ResultError: a file cannot be written.
    """
    path = Path(folder)
    target = _numbered(path, LOG_FOLDER, index, "npz")
    make_folder(target.parent)
    # Logs of pedestals that move along x only stay as older versions write and read them.
    left_out = () if len(log.excursions) else _SPATIAL_NAMES
    write_arrays(target, {name: getattr(log, name) for name in _LOG_NAMES if name not in left_out})
    if npy:
        rows = original_rows(log)
        target = _numbered(path, NPY_FOLDER, index, "npy")
        make_folder(target.parent)
        write_atomic(target, lambda file: np.save(file, rows, allow_pickle=False))


def log_mark(folder: str | os.PathLike[str], index: int) -> dict[str, Any] | None:
    """Length [byte] and SHA-256 of the log of a trial; None: it has none.

    Raises:
        ResultError: the file cannot be read.
    """
    path = _numbered(Path(folder), LOG_FOLDER, index, "npz")
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise ResultError(f"{path}: cannot be read ({error.strerror})") from error
    return {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}


def adopt_trial_log(
    folder: str | os.PathLike[str],
    index: int,
    source: str | os.PathLike[str],
    source_index: int,
) -> bool:
    """Take over the log of a trial from another result folder, which keeps it.

    Files of one file system are linked, so that they take no more room.

    Args:
        folder: made ready by :func:`prepare_folder`.
        index: of the trial in `folder`, from 0.
        source: the other folder.
        source_index: of the trial there.

    Returns:
        Whether it has a log.

    Raises:
        ResultError: a file cannot be read or written.
    """
    for kind, suffix in ((LOG_FOLDER, "npz"), (NPY_FOLDER, "npy")):
        origin = _numbered(Path(source), kind, source_index, suffix)
        if origin.exists():
            target = _numbered(Path(folder), kind, index, suffix)
            make_folder(target.parent)
            link_atomic(origin, target)
    return _numbered(Path(source), LOG_FOLDER, source_index, "npz").exists()


def original_rows(log: TrialLog) -> NDArray[np.float64]:
    """The log in the original's columns NPY_COLUMNS, from the motion's start on, shape (n, 10)."""
    rows = np.column_stack(
        [
            log.time,
            log.column("commanded_position"),
            log.column("pedestal_position"),
            log.position,
            log.orientation,
        ]
    )
    during: NDArray[np.float64] = rows[log.time >= 0]
    return during


def _numbered(folder: Path, kind: str, index: int, suffix: str) -> Path:
    return folder / kind / f"{index:06d}.{suffix}"


def _provenance_text(result: BatchResult, logged: list[int]) -> str:
    if _RESERVED in result.provenance:
        raise ResultError(f"provenance: the key {_RESERVED!r} is kept for the folder's own facts")
    content = {
        **result.provenance,
        _RESERVED: {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "trials": len(result),
            "logs": logged,
            **COLUMNS,
            "trial_columns": {name: one._asdict() for name, one in TRIAL_COLUMNS.items()},
            "npy_columns": NPY_COLUMNS,
        },
    }
    try:
        return json.dumps(content, indent=2, allow_nan=False) + "\n"
    except (TypeError, ValueError, RecursionError) as error:
        raise ResultError(
            f"provenance: cannot be written as JSON ({error}); use plain numbers, text, lists and "
            "mappings, and None instead of NaN"
        ) from error


@checked_names(ResultError)
def load_result(folder: str | os.PathLike[str], *, logs: bool = True) -> BatchResult:
    """Read a result folder back, bit for bit.

    Args:
        folder: written by :func:`save_result`.
        logs: read the logs; off, all are None and :func:`load_trial_log` reads them singly.

    Raises:
        ResultError: the folder is not of VSR2, of a run that did not finish, damaged or truncated;
            names the file.
    """
    path = Path(folder)
    provenance, logged, count = _read_provenance(path)
    trials = read_table(path / TRIALS_FILE, count)
    loaded: list[TrialLog | None] = [None] * count
    if logs:
        for i in logged:
            loaded[i] = load_trial_log(path, i)
    return BatchResult(trials=trials, logs=tuple(loaded), provenance=provenance)


def load_trial_log(folder: str | os.PathLike[str], index: int) -> TrialLog:
    """Read the log of one trial.

    Raises:
        ResultError: there is none, or the file is damaged.
    """
    path = _numbered(Path(folder), LOG_FOLDER, index, "npz")
    if not path.exists():
        raise ResultError(
            f"{path}: does not exist; trial {index} has no log, or the folder is damaged (set "
            "output.log_every to 1 or more for logs)"
        )
    kinds: dict[str, type[np.generic]] = dict.fromkeys(_LOG_NAMES, np.float64)
    arrays = read_arrays(path, kinds, optional=_SPATIAL_NAMES)
    try:
        return TrialLog(**arrays)
    except ResultError as error:
        raise ResultError(f"{path}: {error}") from error


def logged_trials(folder: str | os.PathLike[str]) -> list[int]:
    """Indices of the trials of a result folder that have a log.

    Raises:
        ResultError: as :func:`load_result`.
    """
    return _read_provenance(Path(folder))[1]


def is_result(folder: str | os.PathLike[str]) -> bool:
    """Whether a folder holds a finished result, of this or of another version."""
    try:
        content = json.loads(read_text(Path(folder) / PROVENANCE_FILE))
    except (OSError, ValueError, RecursionError, ResultError):
        return False
    facts = content.get(_RESERVED) if isinstance(content, dict) else None
    return isinstance(facts, dict) and facts.get("format") == FORMAT


def finished_plan(folder: str | os.PathLike[str]) -> str:
    """Hash of what a finished result depends on, `provenance["plan_sha256"]`; empty: not known.

    A folder with a journal is not finished.

    Raises:
        ResultError: as :func:`load_result`, where there is a provenance.
    """
    path = Path(folder)
    if has_journal(path) or not (path / PROVENANCE_FILE).exists():
        return ""
    return str(_read_provenance(path)[0].get("plan_sha256", ""))


def _read_provenance(folder: Path) -> tuple[dict[str, Any], list[int], int]:
    """The provenance, the logged trials, and the number of trials."""
    path = folder / PROVENANCE_FILE
    if not folder.is_dir():
        near = "" if folder.exists() else near_path(folder)
        remedy = f"did you mean {near}?" if near else "give the folder that `vsr2 run` named"
        raise ResultError(f"{folder}: is no folder; {remedy}")
    if not path.exists():
        raise ResultError(
            f"{path}: does not exist; {folder} is not a result folder, or its run did not finish; "
            "give the folder that `vsr2 run` named, or finish the run by --resume"
        )
    try:
        content = json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise ResultError(f"{path}: damaged ({error}); run the study again") from error
    facts = content.pop(_RESERVED, None) if isinstance(content, dict) else None
    if not isinstance(facts, dict) or facts.get("format") != FORMAT:
        raise ResultError(f"{path}: not written by VSR2 (no {_RESERVED}.format {FORMAT!r})")
    if facts.get("format_version") != FORMAT_VERSION:
        raise ResultError(
            f"{path}: has format version {facts.get('format_version')!r}, this VSR2 reads "
            f"{FORMAT_VERSION}; use the VSR2 that wrote it ({content.get('vsr2', 'unknown')})"
        )
    for kind, columns in COLUMNS.items():
        given = facts.get(kind)
        names = tuple(map(str, given)) if isinstance(given, dict | list) else ()
        if names != columns:
            odd = sorted(set(names).symmetric_difference(columns))
            raise ResultError(
                f"{path}: its {kind} are not those of this VSR2 ({', '.join(odd) or 'order'}); use "
                f"the VSR2 that wrote it ({content.get('vsr2', 'unknown')}), or run the study again"
            )
    count, logged = facts.get("trials"), facts.get("logs")
    if type(count) is not int or count < 0:
        raise ResultError(f"{path}: damaged ({_RESERVED}.trials is {count!r})")
    if not isinstance(logged, list) or any(
        type(i) is not int or not 0 <= i < count for i in logged
    ):
        raise ResultError(f"{path}: damaged ({_RESERVED}.logs names trials that do not exist)")
    return content, logged, count
