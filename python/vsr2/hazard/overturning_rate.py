"""Rate of overturning from hazard and fragility, and the age that a standing rock excludes.

The rate is the integral of `P(x) |d lambda(x)|`, with P the lognormal fragility and lambda the
hazard curve (Cornell 1968). Between two levels lambda is a power law c / x^k, for which the
integral is closed. With u = ln x, mu = ln(median):

    lambda(a) e^(k ln a) [-Phi((u - mu) / beta) e^(-k u)
                          + e^(-k mu + k^2 beta^2 / 2) Phi((u - mu) / beta + k beta)]

from ln a to ln b. For one power law over all levels it is c median^-k e^(k^2 beta^2 / 2).
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsr2.analysis.intervals import INTERVALS
from vsr2.config.bounded import near_path
from vsr2.errors import HazardError, reason
from vsr2.fragility import Lognormal
from vsr2.hazard.hazard_curve import HazardCurve
from vsr2.read_only import real_argument

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RateConstants:
    """How the uncertainty of a rate is drawn; chosen by hand.

    Attributes:
        draws: of fragility curves: the ends of a 95 % interval are known to 0.3 % of its share.
        seed: of the draws, which are always the same.
    """

    draws: int = 4000
    seed: int = 0


RATE = RateConstants()


def overturning_rate(curve: HazardCurve, median: ArrayLike, beta: ArrayLike) -> Array:
    """Annual rates of overturning [1/year].

    Args:
        curve: of the site; its outermost power laws go on beyond its levels.
        median: of the fragility, above 0, shape (m,) or a number, in the unit of the
            curve's levels.
        beta: of the fragility [1], above 0, likewise.

    Returns:
        The shares of the rate: shape (3, m), from below the first level, amid the levels, and from
        above the last. Their sum is the rate.

    Raises:
        HazardError: a median or beta that is not positive and finite.
    """
    mu, spread = np.broadcast_arrays(
        *map(np.atleast_1d, (np.log(_above_0(median)), _above_0(beta)))
    )
    ends = np.concatenate([[-np.inf], np.log(curve.levels), [np.inf]])
    slopes = curve.slopes[[0, *range(curve.slopes.size), -1]]
    # A level on each segment's own power law: the lower end, for the first segment the upper.
    at = np.log(curve.levels)[[0, *range(curve.levels.size)]]
    log_rate = np.log(curve.rates)[[0, *range(curve.rates.size)]]
    parts = np.stack(
        [
            _segment(low, high, k, log_c + k * u, mu, spread)
            for low, high, k, u, log_c in zip(
                ends[:-1], ends[1:], slopes, at, log_rate, strict=True
            )
        ]
    )
    return np.stack([parts[0], parts[1:-1].sum(axis=0), parts[-1]])


def _segment(low: float, high: float, k: float, log_c: float, mu: Array, beta: Array) -> Array:
    """The integral over one power law e^log_c e^(-k u), by logarithms, which do not overflow."""
    from scipy.special import log_ndtr

    def weight() -> Array:
        """The moment's part, by that tail of the normal distribution in which no digit is lost."""
        moment = log_c - k * mu + 0.5 * (k * beta) ** 2
        ends = np.stack([(u - mu) / beta + k * beta for u in (low, high)])
        ends = np.where(ends[0] > 0, -ends[::-1], ends)
        with_ends = np.exp(moment + log_ndtr(ends))
        found: Array = with_ends[1] - with_ends[0]
        return found

    def survivors(u: float) -> Array:
        """The rate at u times the probability there; it vanishes at both infinities."""
        if not np.isfinite(u):
            return np.zeros_like(mu)
        rates: Array = np.exp(log_c - k * u + log_ndtr((u - mu) / beta))
        return rates

    # Where k is 0 nothing happens between the ends; rounding alone may leave less than nothing.
    return np.maximum(weight() - survivors(high) + survivors(low), 0.0)


def _above_0(values: ArrayLike) -> Array:
    found = real_argument(values, "median or beta of a fragility", HazardError)
    if not (np.isfinite(found) & (found > 0)).all():
        raise HazardError("median and beta of a fragility must be finite and above 0")
    return found


@dataclass(frozen=True, eq=False)
class RateDraws:
    """Rates of overturning as far as the fragility is known.

    Attributes:
        rate: of the fitted curve [1/year].
        draws: of curves that remain plausible, shape (n,) [1/year].
        below, above: shares of `rate` from intensities below and above the hazard curve's levels.
    """

    rate: float
    draws: Array
    below: float
    above: float

    def interval(self, level: float = INTERVALS.level) -> tuple[float, float]:
        """Ends of the middle `level` of the draws [1/year]."""
        low, high = np.quantile(self.draws, [0.5 - 0.5 * level, 0.5 + 0.5 * level])
        return float(low), float(high)


def rate_draws(
    curve: HazardCurve,
    fragility: Lognormal,
    *,
    draws: int = RATE.draws,
    level: float = INTERVALS.level,
) -> RateDraws:
    """Rates of overturning for curves drawn about a fitted one.

    Logarithms of median and beta are drawn from normal distributions, independently of each other,
    whose intervals are those of the fit. The hazard curve is taken as it is.

    Args:
        curve: of the site.
        fragility: fitted, in the measure of the curve.
        draws: their number; always the same ones.
        level: of the fit's intervals.

    Raises:
        HazardError: the fit's numbers are not positive and finite.
    """
    from scipy.special import ndtri

    shares = overturning_rate(curve, fragility.median, fragility.beta)[:, 0]
    rng = np.random.default_rng(RATE.seed)
    drawn = []
    for middle, low, high in (
        (fragility.median, fragility.median_lower, fragility.median_upper),
        (fragility.beta, fragility.beta_lower, fragility.beta_upper),
    ):
        error = np.log(_above_0(high) / _above_0(low)) / (2 * ndtri(0.5 + 0.5 * level))
        drawn.append(middle * np.exp(error * rng.standard_normal(draws)))
    rate = float(shares.sum())
    if not rate > 0:
        raise HazardError("the rate of overturning is 0 within rounding; check the fragility")
    return RateDraws(
        rate,
        overturning_rate(curve, *drawn).sum(axis=0),
        float(shares[0]) / rate,
        float(shares[2]) / rate,
    )


def survival(rates: ArrayLike, age: float) -> float:
    """Probability that a rock stands for `age` [year]: the mean of e^(-rate age) over `rates`.

    One rock has one fragility for all its age, so that what is not known of it does not average out
    from year to year.

    Raises:
        HazardError: rates that are no real numbers.
    """
    return float(np.exp(-real_argument(rates, "rates", HazardError) * age).mean())


def excluded_age(rates: ArrayLike, confidence: float = INTERVALS.level) -> float:
    """Age [year] beyond which a rock would not stand, with this confidence, were the hazard right.

    At this age the probability to stand is 1 - `confidence`. A rock that is known to be older
    contradicts hazard and fragility together. For one rate it is -ln(1 - confidence) / rate.

    Args:
        rates: of overturning, equally likely, shape (n,) or a number [1/year].
        confidence: between 0 and 1.

    Raises:
        HazardError: another confidence, or a rate that is not positive or that excludes no age
            which a double can hold.
    """
    from scipy.optimize import brentq

    if not 0 < confidence < 1:
        raise HazardError(f"confidence {confidence} must lie between 0 and 1")
    given = np.atleast_1d(real_argument(rates, "rates", HazardError))
    if not (np.isfinite(given) & (given > 0)).all():
        raise HazardError("rates of overturning must be finite and above 0")
    with np.errstate(over="ignore"):
        ages = -np.log1p(-confidence) / np.array([given.max(), given.min()])
    if not np.isfinite(ages).all():
        raise HazardError(
            f"a rate of overturning is {given.min():.3g} per year, which excludes no age; check "
            "hazard and fragility"
        )
    if ages[0] == ages[1]:
        return float(ages[0])
    return float(
        np.exp(
            brentq(
                lambda age: survival(given, float(np.exp(age))) - (1 - confidence),
                *np.log(ages * [1 - 1e-9, 1 + 1e-9]),
            )
        )
    )


def read_lognormal(folder: Path | str, measure: str) -> Lognormal:
    """The fitted curve of a folder that `vsr2 fragility` wrote, over all azimuths.

    Raises:
        HazardError: there is no such result, or no curve in this measure.
    """
    path = Path(folder) / "lognormal.csv"
    try:
        rows = list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        near = "" if Path(folder).exists() else near_path(folder)
        meant = f"did you mean {near}?" if near else "give a folder that `vsr2 fragility` wrote"
        raise HazardError(f"cannot be read ({reason(error)}); {meant}", file=path) from None
    found = [
        row for row in rows if row.get("measure") == measure and row.get("azimuth_deg") == "all"
    ]
    if len(found) != 1:
        known = ", ".join(sorted({str(row.get("measure")) for row in rows}))
        raise HazardError(
            f"has no curve in {measure} (has {known}); name it under `fragility.measures`",
            file=path,
        )
    fields = [name for name in Lognormal.__dataclass_fields__ if name != "fits"]
    # A reader of CSV gives None for the columns that a short row lacks.
    lacking = [name for name in fields if found[0].get(name) is None]
    if lacking:
        raise HazardError(
            f"its row in {measure} lacks {', '.join(lacking)}; run `vsr2 fragility` again",
            file=path,
        )
    try:
        numbers = {name: float(found[0][name]) for name in fields}
    except ValueError:
        raise HazardError(
            f"has no median and beta in {measure}: the trials gave no rising curve (note "
            f"{found[0].get('note', '')!r}); see docs/how-to/fragility.md",
            file=path,
        ) from None
    return Lognormal(**numbers, fits=found[0].get("fits") == "1")
