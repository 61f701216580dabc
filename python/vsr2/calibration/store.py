"""Evaluated parameter sets on disk: one line each, appended once it is finished.

However the process ends, the file holds whole lines and at most one torn last line, which the next
run drops. Nothing of a search is kept but its evaluations: a resumed search takes the same steps
again from the same seed, and finds them here.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from vsr2.config.extended import Plain
from vsr2.errors import ResultError
from vsr2.results.lines import append_line, lock_file

EVALUATIONS_FILE = "evaluations.jsonl"
_FORMAT = "vsr2 evaluations"
_VERSION = 1
_MAX_BYTES = 2**32
_CODES = "01x."
"""Stood, overturned, failed, not simulated."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """One parameter set and what it predicts.

    Attributes:
        values: by parameter.
        predicted: of each trial 1 (overturned), 0, or NaN (failed), shape (trials,).
        known: whether it was simulated, shape (trials,); None: all were. Where it was not,
            `predicted` is NaN in the store, and an assumption in a screened search.
        plan: hash of all that the predictions depend on (:func:`vsr2.simulation.plan_sha256`
            over the trials).
        seconds: wall time of its simulation [s].
    """

    values: Mapping[str, Plain]
    predicted: NDArray[np.float64]
    plan: str = ""
    seconds: float = 0.0
    known: NDArray[np.bool_] | None = None

    @property
    def failed(self) -> int:
        """Number of trials without an outcome."""
        return int(np.isnan(self.predicted).sum())

    def lacking(self, among: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which trials of `among` were not simulated, shape (trials,)."""
        return np.zeros_like(among) if self.known is None else among & ~self.known


class EvaluationStore:
    """The file of evaluations of one campaign, found again by what went into them.

    Args:
        folder: of the calibration; it exists.
        campaign: hash of trials, outcomes and motions; a file of another campaign is refused.
        trials: number of trials.

    Raises:
        ResultError: the file there is of another campaign, is damaged before its last line, is used
            by another process, or the folder cannot be written to.
    """

    def __init__(self, folder: str | os.PathLike[str], campaign: str, trials: int) -> None:
        self._path = Path(folder) / EVALUATIONS_FILE
        self._trials = trials
        self._header = {
            "format": _FORMAT,
            "version": _VERSION,
            "campaign": campaign,
            "trials": trials,
        }
        self._plan_of: dict[str, str] = {}
        self._by_plan: dict[str, Evaluation] = {}
        try:
            self._file = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as error:
            raise self._unusable(error) from error
        try:
            lock_file(self._file, self._path)
            end = self._read()
            os.ftruncate(self._file, end)
            os.lseek(self._file, 0, os.SEEK_END)
            if end == 0:
                append_line(self._file, self._header)
        except OSError as error:
            os.close(self._file)
            raise self._unusable(error) from error
        except BaseException:
            os.close(self._file)
            raise

    def _unusable(self, error: OSError) -> ResultError:
        return ResultError(
            f"{self._path}: cannot be used ({error.strerror}); free space or choose another folder"
        )

    def _read(self) -> int:
        size = os.fstat(self._file).st_size
        if size > _MAX_BYTES:
            raise ResultError(f"{self._path}: over {_MAX_BYTES} bytes; no file of ours")
        content = self._path.read_bytes()
        end = content.rfind(b"\n") + 1
        for number, line in enumerate(content[:end].splitlines()):
            try:
                entry = json.loads(line)
                if number == 0:
                    self._check_header(entry)
                else:
                    self._take(entry)
            except (ValueError, KeyError, TypeError, RecursionError) as error:
                raise ResultError(
                    f"{self._path}:{number + 1}: damaged ({error}); start anew with overwrite"
                ) from None
        return end

    def _check_header(self, entry: Any) -> None:
        if entry == self._header:
            return
        if not isinstance(entry, dict) or entry.get("format") != _FORMAT:
            raise ValueError("not a file of ours")
        raise ResultError(
            f"{self._path}: holds evaluations on another campaign; choose another folder, or "
            "start anew with overwrite"
        )

    def _take(self, entry: dict[str, Any]) -> None:
        codes = entry["predicted"]
        if len(codes) != self._trials or set(codes) - set(_CODES):
            raise ValueError("predicted")
        predicted = np.array([(0.0, 1.0, np.nan, np.nan)[_CODES.index(code)] for code in codes])
        known = np.array([code != "." for code in codes])
        plan, seconds = str(entry["plan"]), float(entry["seconds"])
        old = self._by_plan.get(plan)
        if old is not None and old.known is not None:
            predicted = np.where(known, predicted, old.predicted)
            known |= old.known
            seconds += old.seconds
        self._plan_of[str(entry["key"])] = plan
        self._by_plan[plan] = Evaluation(dict(entry["values"]), predicted, plan, seconds, known)

    def __len__(self) -> int:
        return len(self._plan_of)

    def by_key(self, key: str) -> Evaluation | None:
        """What was evaluated under a key; None: nothing."""
        plan = self._plan_of.get(key)
        return None if plan is None else self._by_plan[plan]

    def by_plan(self, plan: str) -> Evaluation | None:
        """What was evaluated with the same trials to the last bit; None: nothing."""
        return self._by_plan.get(plan)

    def add(self, key: str, evaluation: Evaluation) -> None:
        """Append an evaluation; of further trials of the same set, to what is there.

        Raises:
            ResultError: it cannot be written.
        """
        codes = [2 if np.isnan(value) else int(value) for value in evaluation.predicted]
        if evaluation.known is not None:
            codes = [c if k else 3 for c, k in zip(codes, evaluation.known, strict=True)]
        entry = {
            "key": key,
            "plan": evaluation.plan,
            "values": dict(evaluation.values),
            "predicted": "".join(_CODES[code] for code in codes),
            "seconds": round(evaluation.seconds, 3),
        }
        try:
            append_line(self._file, entry)
        except OSError as error:
            raise ResultError(
                f"{self._path}: cannot be written ({error.strerror}); free space and resume"
            ) from error
        self._take(entry)

    def close(self) -> None:
        """Close the file; it stays."""
        os.close(self._file)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
