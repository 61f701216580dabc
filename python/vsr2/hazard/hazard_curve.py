"""The hazard curve of a site: annual rates at which levels of an intensity are exceeded."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsr2.config.bounded import near_path
from vsr2.errors import HazardError, reason
from vsr2.one_line import OneLine, counted
from vsr2.read_only import ReadOnlyArrays, read_only, real_argument

SITE_ROUNDING = 5.1e-6
"""Half of the last digit of a site's longitude and latitude in OpenQuake's files, and a little
more [degree]."""

Array = NDArray[np.float64]

MEASURE_OF = {"PGA": "pga_g"}
"""Intensities of OpenQuake in the unit of our measures. Its PGV is in cm/s, and not read."""


@dataclass(frozen=True, eq=False, repr=False)
class HazardCurve(ReadOnlyArrays, OneLine):
    """Annual rate of exceedance against intensity; a power law between two levels and beyond both.

    Attributes:
        measure: a measure of fragility studies, such as `pga_g`.
        levels: shape (n,), rising, above 0, in the measure's unit.
        rates: shape (n,), falling or level, above 0 [1/year].
        source: file, site and kind of the curve.

    Raises:
        HazardError: fewer than two levels, or they do not rise, or rates are not positive or rise,
            or the first or last two rates are equal, so that no power law goes on beyond them.
    """

    measure: str
    levels: Array
    rates: Array
    source: str = ""

    def __post_init__(self) -> None:
        for name in ("levels", "rates"):
            value = read_only(real_argument(getattr(self, name), name, HazardError))
            object.__setattr__(self, name, value)
        file = self.source or "hazard curve"
        if self.levels.ndim != 1 or self.levels.shape != self.rates.shape or self.levels.size < 2:
            raise HazardError(
                f"levels have shape {self.levels.shape} and rates {self.rates.shape}; give two or "
                "more of both",
                file=file,
            )
        sound = np.isfinite(self.levels) & np.isfinite(self.rates)
        if not (sound & (self.levels > 0) & (self.rates > 0)).all():
            raise HazardError(
                "levels and rates must be finite and above 0; leave out levels that are never "
                "exceeded",
                file=file,
            )
        change = np.diff(self.rates)
        if not (np.diff(self.levels) > 0).all() or (change > 0).any():
            raise HazardError("levels must rise and rates must not; sort them", file=file)
        if not (change[0] < 0 and change[-1] < 0):
            raise HazardError(
                "the first two or last two rates are equal; leave out the outer level", file=file
            )

    @property
    def facts(self) -> Mapping[str, object]:
        """What the notation in one line shows."""
        return {
            "measure": self.measure,
            "levels": self.levels.size,
            "lowest": float(self.levels[0]),
            "highest": float(self.levels[-1]),
            "source": self.source or None,
        }

    @property
    def slopes(self) -> Array:
        """Exponent k of rate = c / level^k between neighbours, shape (n - 1,)."""
        found: Array = -np.diff(np.log(self.rates)) / np.diff(np.log(self.levels))
        return found


def read_hazard_curve(path: Path | str, *, site: tuple[float, float] | None = None) -> HazardCurve:
    """Read a hazard curve as OpenQuake's engine exports it (`hazard_curve-*.csv`).

    The first line is a comment with `investigation_time` [year] and `imt`, the second names the
    columns `lon`, `lat` and `poe-LEVEL`. A probability P within T years is the rate
    -ln(1 - P) / T of a Poisson process. Levels that are never exceeded (P = 0) or always (P = 1)
    have no rate and are left out.

    Args:
        path: the file.
        site: longitude and latitude [degree], where the file has several sites: the row of these
            coordinates, to five decimals, as OpenQuake writes them.

    Raises:
        HazardError: the file cannot be read, is of another form or intensity, or has several sites
            or not the one asked for.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
        lines = list(csv.reader(text.splitlines(), strict=True))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        near = "" if path.exists() else near_path(path)
        meant = f"did you mean {near}?" if near else "give a hazard curve that OpenQuake exported"
        raise HazardError(f"cannot be read ({reason(error)}); {meant}", file=path) from None
    years, measure, kind = _header(path, text.partition("\n")[0])
    columns, rows = lines[1] if len(lines) > 1 else [], [line for line in lines[2:] if line]
    names = [name for name in columns if name.startswith("poe-")]
    if not {"lon", "lat"} <= set(columns) or not names:
        raise HazardError(
            f"line 2 names the columns {', '.join(columns)[:80]!r}; expected lon, lat and "
            "poe-LEVEL, as OpenQuake exports hazard curves",
            file=path,
        )
    try:
        levels = np.array([float(name.removeprefix("poe-")) for name in names])
        table = [dict(zip(columns, map(float, row), strict=True)) for row in rows]
    except ValueError as error:
        raise HazardError(f"a row or level is no row of numbers ({error})", file=path) from None
    row = _site_row(path, table, site)
    probability = np.array([row[name] for name in names])
    if not ((probability >= 0) & (probability <= 1)).all():
        raise HazardError("probabilities must lie between 0 and 1", file=path)
    used = (probability > 0) & (probability < 1)
    return HazardCurve(
        measure,
        levels[used],
        -np.log1p(-probability[used]) / years,
        f"{path}: {kind} at {row['lon']:g}, {row['lat']:g}",
    )


def _header(path: Path, line: str) -> tuple[float, str, str]:
    """Investigation time [year], measure, and kind of curve from the comment."""
    years = re.search(r"investigation_time=([0-9.eE+-]+)", line)
    imt = re.search(r"imt='([^']*)'", line)
    kind = re.search(r"kind='([^']*)'", line)
    try:
        time = float(years[1]) if years else 0.0
    except ValueError:
        time = 0.0
    if imt is None or not (np.isfinite(time) and time > 0):
        raise HazardError(
            "line 1 lacks `investigation_time` above 0 or `imt`; give a hazard curve that "
            "OpenQuake exported, its comment included",
            file=path,
        )
    if imt[1] not in MEASURE_OF:
        raise HazardError(
            f"is of {imt[1]!r}; a rock's fragility has no such measure, so export "
            f"{' or '.join(MEASURE_OF)}",
            file=path,
        )
    return time, MEASURE_OF[imt[1]], kind[1] if kind else "curve"


def _site_row(
    path: Path, table: list[dict[str, float]], site: tuple[float, float] | None
) -> dict[str, float]:
    shown = "; ".join(f"{row['lon']:g} {row['lat']:g}" for row in table[:5])
    if site is None:
        if len(table) != 1:
            raise HazardError(
                f"holds {counted(len(table), 'site')} ({shown}); choose one by `--site LON LAT`",
                file=path,
            )
        return table[0]
    found = [
        row
        for row in table
        if np.allclose((row["lon"], row["lat"]), site, rtol=0, atol=SITE_ROUNDING)
    ]
    if len(found) != 1:
        raise HazardError(
            f"{counted(len(found), 'row')} have the site {site[0]:g} {site[1]:g}; the file begins "
            f"with {shown}",
            file=path,
        )
    return found[0]
