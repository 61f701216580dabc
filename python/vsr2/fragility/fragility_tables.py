"""A fragility study's result as tables, for people and for hazard codes.

    trials.csv           one row a trial (vsr2.results)
    plan.csv             one row a trial: motion, azimuth, replicate, seed, perturbation, outcome,
                         every intensity measure of the motion as driven
    curve_<measure>.csv  levels of the measure with probability, lower, upper
    surface.csv          levels of both measures with the same
    lognormal.csv        median and beta, of all azimuths together and of each
    provenance.json      versions, hashes, seeds, settings

In curves and surfaces `inside` is 1 where a level lies amid the simulated ones, and 0 where the fit
extrapolates.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, get_args

from vsr2.errors import ResultError
from vsr2.fragility.fit import FragilityFit, Lognormal
from vsr2.fragility.run import FragilityResult
from vsr2.fragility.settings import Measure
from vsr2.results import has_journal, remove_journal, save_result
from vsr2.results.atomic import csv_text, write_text

OWN_FILES = ("plan.csv", "surface.csv", "lognormal.csv", "report.md")


def remove_old_tables(folder: str | Path) -> None:
    """Remove tables and page of an earlier result, so that none outlives it.

    Raises:
        ResultError: one cannot be removed.
    """
    path = Path(folder)
    try:
        for name in (*OWN_FILES, *(f"curve_{measure}.csv" for measure in get_args(Measure))):
            (path / name).unlink(missing_ok=True)
    except OSError as error:
        raise ResultError(f"{path}: cannot be used ({error.strerror})") from error


def save_fragility(
    result: FragilityResult, folder: str | Path, *, keep_journal: bool = False
) -> list[Path]:
    """Write trials, tables and provenance.

    Args:
        result: what to write.
        folder: that its batch kept its journal in, or a new one.
        keep_journal: whether the journal of the trials stays, for what is still to be made of them.

    Returns:
        The files written.

    Raises:
        ResultError: one cannot be written.
    """
    path = Path(folder)
    points = result.settings.points
    tables = {
        "plan.csv": plan_rows(result),
        "lognormal.csv": lognormal_rows(result),
        **{f"curve_{name}.csv": curve_rows(fit, points) for name, fit in result.curves.items()},
    }
    if result.surface is not None:
        tables["surface.csv"] = curve_rows(result.surface, points)
    batch = replace(result.batch, provenance=result.provenance)
    # With a journal, what is there is an earlier try at this same result.
    save_result(batch, path, streamed_logs=True, overwrite=has_journal(path))
    for name, rows in tables.items():
        write_text(path / name, csv_text(rows, ".9g"))
    if not keep_journal:
        remove_journal(path)
    return [path / "trials.csv", path / "provenance.json", *(path / name for name in tables)]


def plan_rows(result: FragilityResult) -> list[dict[str, Any]]:
    """One row a trial."""
    return [
        {
            **asdict(one),
            "outcome": str(result.batch["outcome"][i]),
            "overturned": int(result.overturned[i]) if result.used[i] else "",
            **{name: float(values[i]) for name, values in result.measures.items()},
        }
        for i, one in enumerate(result.planned)
    ]


def curve_rows(fit: FragilityFit, points: int) -> list[dict[str, Any]]:
    """Levels with probability, lower and upper end of the band, and whether they lie inside."""
    levels = fit.grid(points)
    columns = (*fit.probability(levels), fit.inside(levels))
    return [
        {
            **{name: float(x) for name, x in zip(fit.names, level, strict=True)},
            "probability": float(p),
            "lower": float(low),
            "upper": float(high),
            "inside": int(inside),
        }
        for level, p, low, high, inside in zip(levels, *columns, strict=True)
    ]


def lognormal_rows(result: FragilityResult) -> list[dict[str, Any]]:
    """Median and beta of each curve; blank where there is none."""
    curves: list[tuple[str, str, FragilityFit]] = []
    for name, fit in result.curves.items():
        curves.append((name, "all", fit))
        curves += [
            (name, f"{turn:g}", one)
            for (other, turn), one in result.azimuth_curves.items()
            if other == name
        ]
    blank = {key: "" for key in Lognormal.__dataclass_fields__}
    return [
        {
            "measure": name,
            "azimuth_deg": azimuth,
            **(
                blank
                if (found := fit.lognormal) is None
                else vars(found) | {"fits": int(found.fits)}
            ),
            "trials": fit.trials,
            "overturned": fit.overturned,
            "motions": fit.groups,
            "separated": int(fit.separated),
            "note": fit.note or "",
        }
        for name, azimuth, fit in curves
    ]
