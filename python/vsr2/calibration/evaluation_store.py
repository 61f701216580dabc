"""Evaluated parameter sets on disk: one record each, appended once it is finished.

Nothing of a search is kept but its evaluations: a resumed search takes the same steps again from
the same seed, and finds them here.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis import overturning_probability
from vsr2.config.extended import Plain
from vsr2.results.store import Store, StoreKind, is_number, odd_value

EVALUATIONS_FILE = "evaluations.jsonl"
_KIND = StoreKind(
    format="vsr2 evaluations",
    version=1,
    foreign="holds evaluations on another campaign; choose another folder, or start again with "
    "overwrite",
    unsummed=True,
)
_CODES = "01x."
"""Stood, overturned, failed, not simulated."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """One parameter set and what it predicts.

    Attributes:
        values: by parameter.
        predicted: probability that each trial overturns, 1 or 0 of a single run, NaN (failed),
            shape (trials,).
        known: whether it was simulated, shape (trials,); None: all were. Where it was not,
            `predicted` is NaN in the store, and an assumption in a screened search.
        plan: hash of all that the predictions depend on (:func:`vsr2.simulation.plan_sha256`
            over the trials).
        seconds: wall time of its simulation [s].
        runs: of each replicate; empty: there is one run.
    """

    values: Mapping[str, Plain]
    predicted: NDArray[np.float64]
    plan: str = ""
    seconds: float = 0.0
    known: NDArray[np.bool_] | None = None
    runs: tuple[Evaluation, ...] = ()

    @property
    def failed(self) -> int:
        """Number of trials without an outcome in some run."""
        if not self.runs:
            return int(np.isnan(self.predicted).sum())
        failed = [
            np.isnan(one.predicted) & (True if one.known is None else one.known)
            for one in self.runs
        ]
        return int(np.any(failed, axis=0).sum())

    @property
    def unanimous(self) -> NDArray[np.bool_]:
        """Whether all runs of a trial have an outcome, and the same, shape (trials,)."""
        ends = np.array([one.predicted for one in self.runs or (self,)])
        return np.asarray((ends == ends[0]).all(axis=0))

    def lacking(self, among: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which trials of `among` were not simulated, shape (trials,)."""
        return np.zeros_like(among) if self.known is None else among & ~self.known


def joined(runs: Sequence[Evaluation], observed: NDArray[np.bool_]) -> Evaluation:
    """Replicates of one parameter set as one evaluation.

    A run without an outcome counts as wrong, so that settings which make trials fail gain nothing.

    Args:
        runs: of equal values.
        observed: outcomes, shape (trials,).
    """
    every = np.ones(observed.size, dtype=np.bool_)
    known = np.all([every if one.known is None else one.known for one in runs], axis=0)
    ends = np.array([np.where(np.isnan(one.predicted), ~observed, one.predicted) for one in runs])
    plan = hashlib.sha256("".join(one.plan for one in runs).encode()).hexdigest()
    return Evaluation(
        runs[0].values,
        np.where(known, overturning_probability(ends), np.nan),
        plan,
        sum(one.seconds for one in runs),
        known,
        tuple(runs),
    )


def _check_types(entry: dict[str, Any]) -> None:
    """Refuse a record that no search wrote.

    Raises:
        ValueError: a value of another type.
        KeyError: one is missing.
    """
    kinds = {"key": str, "plan": str, "predicted": str, "values": dict}
    words = {str: "text", dict: "a mapping"}
    for name, kind in kinds.items():
        if type(entry[name]) is not kind:
            raise odd_value(name, entry[name], words[kind])
    if not (is_number(entry["seconds"]) and entry["seconds"] >= 0):
        raise odd_value("seconds", entry["seconds"], "a time")
    for name, value in entry["values"].items():
        if not _is_plain(value):
            raise odd_value(f"values.{name}", value, "a value of a study")


def _is_plain(value: object) -> bool:
    """Whether it may be the value of a parameter."""
    return isinstance(value, bool | str) or is_number(value, whole=True)


class EvaluationStore(Store):
    """The file of evaluations of one campaign, found again by what went into them.

    Args:
        folder: of the calibration; it exists.
        campaign: hash of trials, outcomes and motions; a file of another campaign is refused.
        trials: number of trials.

    Raises:
        ResultError: as of :class:`vsr2.results.store.Store`.
    """

    def __init__(self, folder: str | os.PathLike[str], campaign: str, trials: int) -> None:
        self._trials = trials
        self._plan_of: dict[str, str] = {}
        self._by_plan: dict[str, Evaluation] = {}
        identity = {"campaign": campaign, "trials": trials}
        super().__init__(Path(folder) / EVALUATIONS_FILE, _KIND, identity, self._take)

    def _take(self, entry: dict[str, Any]) -> None:
        _check_types(entry)
        codes = entry["predicted"]
        if len(codes) != self._trials or set(codes) - set(_CODES):
            wanted = f"{self._trials} of the signs {_CODES}"
            raise odd_value("predicted", codes, wanted)
        predicted = np.array([(0.0, 1.0, np.nan, np.nan)[_CODES.index(code)] for code in codes])
        known = np.array([code != "." for code in codes])
        plan, seconds = entry["plan"], entry["seconds"]
        old = self._by_plan.get(plan)
        if old is not None and old.known is not None:
            predicted = np.where(known, predicted, old.predicted)
            known |= old.known
            seconds += old.seconds
        self._plan_of[entry["key"]] = plan
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

    def keep(self, key: str, evaluation: Evaluation) -> None:
        """Append an evaluation; of further trials of the same set, to what is there.

        Raises:
            ResultError: it cannot be written.
        """
        codes = [2 if np.isnan(value) else int(value) for value in evaluation.predicted]
        if evaluation.known is not None:
            codes = [c if k else 3 for c, k in zip(codes, evaluation.known, strict=True)]
        record = {
            "key": key,
            "plan": evaluation.plan,
            "values": dict(evaluation.values),
            "predicted": "".join(_CODES[code] for code in codes),
            "seconds": round(evaluation.seconds, 3),
        }
        self.add(record)
        self._take(record)
