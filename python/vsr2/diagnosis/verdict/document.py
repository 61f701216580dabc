"""What a diagnosis returns: `diagnosis.json` and tables."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from vsr2.codes import TIERS, Tier
from vsr2.errors import DiagnosisError, ResultError
from vsr2.one_line import OneLine
from vsr2.results.atomic import csv_text, write_text

if TYPE_CHECKING:
    import arviz

Schema = Literal["vsr2.diagnosis/16"]
SCHEMA: Schema = get_args(Schema)[0]
FILE = "diagnosis.json"
PAGE_FILE = "index.html"
_NOT_A_COLUMN = ("location", "trials", "concentration_ci90")
_CONCENTRATION_ENDS = ("concentration_ci90_low", "concentration_ci90_high")
TABLES = EFFECTS, WHERE, TRIALS = "effects.csv", "where.csv", "trials.csv"
CHECK_FILE = "posterior_check.json"
CHECK_FIGURE = "posterior_check.png"
CHECK_TABLES = (
    "posterior_check.csv", "posterior_check_campaigns.csv", "posterior_check_ranks.csv",
)  # fmt: skip
CHECK_FILES = (CHECK_FILE, CHECK_FIGURE, *CHECK_TABLES)


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(OneLine):
    """A finished diagnosis.

    Attributes:
        content: of `diagnosis.json`, JSON-serialisable.
        trials: one row a trial, for tables and figures: id, motion, session, order, ln PGA [g],
            ln PGV/PGA, outcome, probabilities before and after, losses and floor.
        samples: of the posterior of each effect that is named, given that it acts: values of its
            parameters, one row a sample. They are not written.
    """

    content: Mapping[str, Any]
    trials: tuple[Mapping[str, Any], ...] = field(default=())
    samples: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    @property
    def facts(self) -> Mapping[str, object]:
        """The verdict's kind and the effects that it names."""
        return {"kind": self.kind, "effects": list(self.effects)}

    @property
    def kind(self) -> str:
        """Of the verdict."""
        return str(self.content["verdict"]["kind"])

    @property
    def effects(self) -> tuple[str, ...]:
        """That the verdict names."""
        return tuple(self.content["verdict"]["effects"])

    def to_inference_data(self) -> arviz.InferenceData:
        """As :func:`vsr2.diagnosis.verdict.inference_data.inference_data`, for ArviZ."""
        from vsr2.diagnosis.verdict.inference_data import inference_data

        return inference_data(self.samples)

    def to_json(self) -> str:
        """`diagnosis.json`, numbers that do not exist as null."""
        return json.dumps(finite(self.content), indent=2, allow_nan=False) + "\n"

    def tables(self) -> dict[str, str]:
        """CSV files by name: effects.csv, where.csv, trials.csv."""
        blank = {"mean": None, "median": None, "ci90": [None] * 2, "ci95": [None] * 2, "unit": ""}
        effects = [
            {
                "effect": row["name"],
                "probability": row["probability"],
                "acts": row["acts"],
                "parameter": name,
                "mean": p["mean"],
                "median": p["median"],
                **{
                    f"{ends}_{side}": end
                    for ends in ("ci90", "ci95")
                    for side, end in zip(("low", "high"), p[ends], strict=True)
                },
                "unit": p["unit"],
            }
            for row in self.content["effects"]
            for name, p in (row["parameters"] or {"": blank}).items()
        ]
        return {
            EFFECTS: csv_text(effects, ".6g"),
            WHERE: csv_text(
                [
                    {
                        "location": row["location"]["kind"],
                        "values": " ".join(row["location"]["values"].values()),
                        **{k: row[k] for k in row if k not in _NOT_A_COLUMN},
                        **dict(zip(_CONCENTRATION_ENDS, row["concentration_ci90"], strict=True)),
                    }
                    for row in self.content["where"]
                ],
                ".6g",
            ),
            TRIALS: csv_text(self.trials, ".6g"),
        }

    def save(self, folder: str | Path) -> Path:
        """Write `diagnosis.json` and the tables; returns the path of the former.

        Beside an earlier `diagnosis.json` its page and the check of its posterior are removed: they
        are of what it said.

        Raises:
            ResultError: a file cannot be written.
        """
        path = Path(folder)
        path.mkdir(parents=True, exist_ok=True)
        if (path / FILE).is_file():
            for name in (PAGE_FILE, *CHECK_FILES):
                (path / name).unlink(missing_ok=True)
        contents = {**self.tables(), FILE: self.to_json()}
        for name, text in contents.items():
            write_text(path / name, text, errors="strict")
        return path / FILE


class FinishedDiagnosis(NamedTuple):
    """What a diagnosis in a folder was of, and how much it simulated.

    Attributes:
        tier: that it used.
        provenance: of `diagnosis.json`.
    """

    tier: Tier
    provenance: Mapping[str, Any]


def finished_diagnosis(folder: Path) -> FinishedDiagnosis:
    """What the diagnosis in a folder says of itself.

    Raises:
        DiagnosisError: the folder holds none that is finished, or one of an older VSR2.
        ResultError: its file is damaged.
    """
    path = folder / FILE
    if not path.is_file():
        raise DiagnosisError(f"{folder}: holds no finished diagnosis ({FILE}); diagnose first")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        tier, known = content["campaign"]["tier"], content["provenance"]
        budget, looked = known["budget"], known.get("look", {})
        numbers = (known["seed"], budget["campaigns"], budget.get("trials", 0), *looked.values())
        if not all(type(one) is int for one in numbers):
            raise ValueError("numbers of the provenance")
        text = (known["simulator"], *known["excluded"])
        if not all(isinstance(one, str) for one in text):
            raise ValueError("texts of the provenance")
        if tier not in TIERS:
            raise ValueError("tier of the campaign")
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ResultError(f"{path}: damaged ({error}); diagnose again") from error
    if set(looked) != {"among", "trials", "plain"} or "trials" not in budget:
        raise DiagnosisError(
            f"{path}: is of an older VSR2, which did not note all that it looked at; diagnose "
            "again, which reuses the simulations"
        )
    return FinishedDiagnosis(tier, known)


def finite(value: Any) -> Any:
    """The same with None for numbers that JSON does not know."""
    if isinstance(value, Mapping):
        return {str(key): finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [finite(inner) for inner in value]
    if isinstance(value, bool) or value is None or isinstance(value, str | int):
        return value
    number = float(value)
    return number if math.isfinite(number) else None
