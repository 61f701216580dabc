"""What a batch gave: one row a trial, state and contact logs, and where it all came from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from numbers import Integral
from os import PathLike
from typing import TYPE_CHECKING, Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from vsr2 import _native
from vsr2._native import Column
from vsr2._native import EngineKind as EngineKind
from vsr2._native import HandOver as HandOver
from vsr2._native import Outcome as Outcome
from vsr2._native import Status as Status
from vsr2.argument_names import checked_names
from vsr2.config.problems import shown
from vsr2.config.seeds import checked_seed
from vsr2.errors import ResultError
from vsr2.near_words import nearest
from vsr2.one_line import OneLine
from vsr2.read_only import ReadOnlyDict, read_only, real_argument, refuse_mask
from vsr2.results.chosen_rows import chosen_rows
from vsr2.results.trial_log import CONTACT_COLUMNS, DERIVED, STATE_COLUMNS, Array, TrialLog

if TYPE_CHECKING:
    import pandas
    import xarray

STATUSES: tuple[str, ...] = tuple(Status.__members__)
"""How a trial ended; only `ok` and `tail_timeout` have an outcome other than `failed`."""

JUDGED = (Status.ok, Status.tail_timeout)
"""Statuses with which a trial's outcome is known."""

UNFINISHED = (Status.cancelled, Status.not_run)
"""Statuses of trials that did not run to an end."""

OUTCOMES: tuple[str, ...] = tuple(Outcome.__members__)
"""What the rock did, the gravest that applies; `failed`: there is no outcome, see the status."""

ENGINES: tuple[str, ...] = tuple(
    name for name, kind in EngineKind.__members__.items() if kind is not EngineKind.auto
)
"""What can run a trial; `auto` is the choice among them."""

WORDS: Mapping[str, type[StrEnum]] = {
    "status": Status,
    "outcome": Outcome,
    "engine": EngineKind,
    "hand_over": HandOver,
}
"""Columns of `BatchResult.trials` whose values are members of an enumeration, equal to their text;
`engine` is empty where none ran."""

_RESULTS = {column.name: column for column in _native.result_columns()}

FLOAT_COLUMNS: tuple[str, ...] = tuple(
    name for name, column in _RESULTS.items() if column.dtype == "float64"
)
"""Numbers that the core gives for a trial; NaN where a trial has no such value."""

OPEN_COLUMNS: frozenset[str] = frozenset(name for name, one in _RESULTS.items() if one.missing)
"""Of these and of texts, those that a trial which ended may lack."""

RESULT_COLUMNS: tuple[str, ...] = tuple(_RESULTS)
"""Columns of `BatchResult.trials` that running a trial fills."""


def _columns() -> Iterator[Column]:
    """The columns of `BatchResult.trials`: of what a trial was given, and of what became of it."""

    def given(name: str, unit: str, dtype: str, description: str) -> Column:
        return Column(name=name, unit=unit, description=description, missing="", dtype=dtype)

    yield given("trial", "", "int64", "index of the trial")
    yield given("name", "", "object", "name of the trial")
    yield given("motion", "", "object", "name of the motion")
    yield given("motion_sha256", "", "object", "hash of what was driven")
    yield given("seed", "", "int64", "seed of the trial's perturbation")
    results = dict(_RESULTS)
    yield results.pop("status")
    yield results.pop("outcome")
    yield given("pga_g", "g", "float64", "PGA of the driven motion")
    yield given("pgv_m_s", "m/s", "float64", "PGV of the driven motion")
    yield given("pgv_pga_s", "s", "float64", "PGV/PGA of the driven motion")
    yield from results.values()


_TRIAL_COLUMNS = tuple(_columns())

TEXT_COLUMNS: tuple[str, ...] = tuple(one.name for one in _TRIAL_COLUMNS if one.dtype == "object")
"""Columns of `BatchResult.trials` that hold text."""

INTEGER_COLUMNS: tuple[str, ...] = tuple(one.name for one in _TRIAL_COLUMNS if one.dtype == "int64")
"""Columns of `BatchResult.trials` that hold whole numbers; those left are floats, NaN where a
trial has no such value."""


class TrialColumn(NamedTuple):
    """What a column of `BatchResult.trials` holds.

    Attributes:
        unit: empty: the column has none.
        meaning: what it is called in full, without the unit.
    """

    unit: str
    meaning: str


TRIAL_COLUMNS: dict[str, TrialColumn] = {
    one.name: TrialColumn(
        one.unit, one.description + (f"; empty: {one.missing}" if one.missing else "")
    )
    for one in _TRIAL_COLUMNS
}
"""Columns of `BatchResult.trials`, with their unit and meaning."""

COLUMNS = {
    "trial_columns": tuple(TRIAL_COLUMNS),
    "state_columns": STATE_COLUMNS,
    "contact_columns": CONTACT_COLUMNS,
}
"""What files of a batch hold; with other columns they are refused."""


def _kept_column(name: str, given: Any, count: int) -> NDArray[Any]:
    """A column as it is kept."""
    if np.shape(given) != (count,):
        raise ResultError(
            f"batch result: column {name} has shape {np.shape(given)} for {count} trials"
        )
    if name in TEXT_COLUMNS:
        return _kept_text(name, given)
    numbers = real_argument(given, f"batch result: column {name}", ResultError)
    if name in INTEGER_COLUMNS:
        integers = np.asarray(given)
        if integers.dtype.kind not in "iu":
            raise ResultError(
                f"batch result: column {name} is not an array of integers (but of {integers.dtype})"
            )
        if name == "seed" and count:
            for end in (integers.min(), integers.max()):
                checked_seed(int(end), ResultError, "batch result: column seed")
        return integers
    return numbers


def _kept_text(name: str, given: Any) -> NDArray[Any]:
    """A column of text, or of words as members of their enumeration."""
    try:
        refuse_mask(given)
    except TypeError as error:
        raise ResultError(f"batch result: column {name} {error}") from None
    column = np.asarray(given)
    if name in WORDS:
        return _as_members(name, column, WORDS[name])
    odd = [one for one in column if not isinstance(one, str)]
    if odd:
        raise ResultError(
            f"batch result: column {name} holds {shown(odd[0])} of type "
            f"{type(odd[0]).__name__}; give text"
        )
    return column.astype(object)


def _as_members(name: str, column: NDArray[Any], words: type[StrEnum]) -> NDArray[Any]:
    """A column of words as members of an enumeration; an empty text stays where it may stand."""
    members = {**words.__members__, **({"": ""} if _RESULTS[name].missing else {})}
    out = np.empty(len(column), dtype=object)
    try:
        out[:] = [members[word] for word in column]
    except (KeyError, TypeError):
        odd = next(word for word in column if not isinstance(word, str) or word not in members)
        raise ResultError(
            f"batch result: column {name} holds {odd!r}; known are {', '.join(words)}"
        ) from None
    return out


_LOGGED = ("state", "position", *DERIVED, *STATE_COLUMNS)
"""What :meth:`BatchResult.stack` gives."""


@checked_names(ResultError)
@dataclass(frozen=True, eq=False, repr=False)
class BatchResult(OneLine):
    """Outcomes, logs and provenance of a batch.

    Attributes:
        trials: columns TRIAL_COLUMNS, each of shape (trials,), read-only; strings as object
            arrays, those of `WORDS` as members of their enumerations.
        logs: one per trial; None where nothing was logged.
        provenance: study, versions, build facts, hashes, seeds, wall time (JSON-serialisable),
            read-only.

    Raises:
        ResultError: a column is missing, unknown, or not as long as there are trials, of another
            type or masked, one of `WORDS` holds another word, a seed is out of range, or a log is
            none.
    """

    trials: Mapping[str, NDArray[Any]]
    logs: tuple[TrialLog | None, ...]
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        odd = set(TRIAL_COLUMNS).symmetric_difference(self.trials)
        if odd:
            raise ResultError(
                f"batch result: missing or unknown columns {', '.join(sorted(odd))}; "
                f"wanted are {', '.join(TRIAL_COLUMNS)}"
            )
        logs = tuple(self.logs)
        for i, log in enumerate(logs):
            if log is not None and not isinstance(log, TrialLog):
                raise ResultError(
                    f"batch result: logs[{i}] is {shown(log)}; give a TrialLog or None"
                )
        columns = {
            name: _kept_column(name, column, len(logs)) for name, column in self.trials.items()
        }
        provenance = ReadOnlyDict(self.provenance)
        self.__setstate__({"trials": columns, "logs": logs, "provenance": provenance})

    def __setstate__(self, state: dict[str, Any]) -> None:
        # numpy forgets in pickles and copies that an array is read-only.
        columns = {name: read_only(column) for name, column in state["trials"].items()}
        self.__dict__.update(state, trials=ReadOnlyDict(columns))

    def __len__(self) -> int:
        return len(self.logs)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        for i in range(len(self)):
            yield {name: column[i] for name, column in self.trials.items()}

    @property
    def facts(self) -> Mapping[str, object]:
        """Trials, how many have each outcome, the status `ok`, a log."""
        outcomes = {name: int((self["outcome"] == name).sum()) for name in OUTCOMES}
        return {
            "trials": len(self),
            **{name: count or None for name, count in outcomes.items()},
            "ok": int((self["status"] == Status.ok).sum()),
            "logs": sum(log is not None for log in self.logs),
        }

    @overload
    def __getitem__(self, wanted: str) -> NDArray[Any]: ...
    @overload
    def __getitem__(
        self, wanted: slice | Sequence[int] | NDArray[np.bool_ | np.intp]
    ) -> BatchResult: ...
    def __getitem__(
        self, wanted: str | slice | Sequence[int] | NDArray[np.bool_ | np.intp]
    ) -> NDArray[Any] | BatchResult:
        """A column by its name, or some of the trials: a slice, indices, or a mask.

        The column `trial` of some trials holds their numbers in the whole batch.

        Raises:
            ResultError: no such column or trial, or a single number: `result[3:4]` is one trial.
        """
        return self._column(wanted) if isinstance(wanted, str) else self._some(wanted)

    def _some(self, wanted: slice | Sequence[int] | NDArray[np.bool_ | np.intp]) -> BatchResult:
        rows = chosen_rows(wanted, len(self))
        return BatchResult(
            trials={name: column[rows] for name, column in self.trials.items()},
            logs=tuple(self.logs[i] for i in rows),
            provenance=self.provenance,
        )

    def _column(self, column: str) -> NDArray[Any]:
        if column not in self.trials:
            near = nearest(str(column), TRIAL_COLUMNS)
            meant = f"did you mean {near}? " if near else ""
            if column in _LOGGED:
                meant = f"it is logged in time, see stack({column!r}); "
            raise ResultError(f"no column {column!r}; {meant}known: {', '.join(TRIAL_COLUMNS)}")
        return self.trials[column]

    @property
    def judged(self) -> NDArray[np.bool_]:
        """Which trials have an outcome, shape (trials,)."""
        found: NDArray[np.bool_] = self["outcome"] != Outcome.failed
        return found & np.isin(self["status"], JUDGED)

    @property
    def overturned(self) -> NDArray[np.bool_]:
        """Which trials ended with the rock overturned, shape (trials,)."""
        found: NDArray[np.bool_] = self["outcome"] == Outcome.overturned
        return found

    @property
    def finished(self) -> NDArray[np.bool_]:
        """Which trials ran to an end, that of a failure included, shape (trials,)."""
        return ~np.isin(self["status"], UNFINISHED)

    def log(self, trial: int) -> TrialLog:
        """The log of one trial.

        Raises:
            ResultError: no such trial, or nothing was logged for it.
        """
        if isinstance(trial, bool) or not isinstance(trial, Integral):
            raise ResultError(
                f"log: trial is {shown(trial)}; give its index, counted from 0 (names are in "
                'result["name"])'
            )
        if not 0 <= trial < len(self):
            raise ResultError(f"no trial {trial}; there are {len(self)}, counted from 0")
        log = self.logs[trial]
        if log is None:
            raise ResultError(
                f"trial {trial} ({self.trials['name'][trial]}) has no log; set output.log_every "
                "to 1 or more and run again"
            )
        return log

    def stack(self, quantity: str) -> Array:
        """A logged quantity over all trials, shape (trials, steps) or (trials, steps, k).

        Rows after a trial's end, and trials without a log, are NaN. `quantity` is a name in
        STATE_COLUMNS or DERIVED, or "state" or "position".

        Raises:
            ResultError: unknown quantity, or no trial has a log.
        """
        if not isinstance(quantity, str) or quantity not in _LOGGED:
            near = nearest(str(quantity), _LOGGED)
            meant = f"did you mean {near}? " if near else ""
            raise ResultError(
                f"unknown quantity {shown(quantity)}; {meant}known: {', '.join(_LOGGED)}"
            )
        series = [
            None
            if log is None
            else (log.column(quantity) if quantity in STATE_COLUMNS else getattr(log, quantity))
            for log in self.logs
        ]
        present = [s for s in series if s is not None]
        if not present:
            raise ResultError("no trial has a log; set output.log_every to 1 or more and run again")
        steps = max(len(s) for s in present)
        out = np.full((len(series), steps, *present[0].shape[1:]), np.nan)
        for i, s in enumerate(series):
            if s is not None:
                out[i, : len(s)] = s
        return out

    def to_xarray(self) -> xarray.Dataset:
        """The result as a dataset; see :func:`vsr2.results.dataset.to_xarray`."""
        from vsr2.results.dataset import to_xarray

        return to_xarray(self)

    def to_dataframe(self) -> pandas.DataFrame:
        """The table of trials; see :func:`vsr2.results.dataset.to_dataframe`."""
        from vsr2.results.dataset import to_dataframe

        return to_dataframe(self)

    def to_netcdf(self, path: str | PathLike[str]) -> None:
        """Write table and logs as netCDF; see :func:`vsr2.results.dataset.write_netcdf`."""
        from vsr2.results.dataset import write_netcdf

        write_netcdf(self, path)

    def to_parquet(self, path: str | PathLike[str]) -> None:
        """Write the table as Parquet; see :func:`vsr2.results.dataset.write_parquet`."""
        from vsr2.results.dataset import write_parquet

        write_parquet(self, path)
