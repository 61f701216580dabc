"""`vsr2 hazard`: from a fragility and a site's hazard curve to a rate and an age."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from vsr2.analysis.intervals import INTERVALS
from vsr2.cli.options import Json, print_json


def hazard(
    fragility: Annotated[Path, Parameter(help="folder that `vsr2 fragility` wrote")],
    curve: Annotated[Path, Parameter(help="hazard curve of OpenQuake (.csv), of PGA")],
    /,
    *,
    site: tuple[float, float] | None = None,
    age: float | None = None,
    confidence: float = INTERVALS.level,
    json: Json = False,
) -> int:
    """Print the rate of overturning and the excluded age; `main` holds the text of the help.

    Args:
        site: longitude and latitude of one of several sites in the file [degree]
        age: of a rock that stands [year]: print the probability that it would
        confidence: with which an age is excluded
    """
    from dataclasses import asdict

    from vsr2.errors import HazardError
    from vsr2.hazard import (
        excluded_age,
        rate_draws,
        read_hazard_curve,
        read_lognormal,
        survival,
    )
    from vsr2.hazard.overturning_rate import RATE
    from vsr2.report.messages.runs import hazard_text

    if age is not None and not 0 < age < float("inf"):
        raise HazardError(f"--age {age:g}: must be above 0 and finite [year]")
    if not 0 < confidence < 1:
        raise HazardError(f"--confidence {confidence:g}: must lie between 0 and 1, as 0.95 does")
    given = read_hazard_curve(curve, site=site)
    rates = rate_draws(given, read_lognormal(fragility, given.measure))
    low, high = rates.interval()
    found: dict[str, Any] = {
        "curve": given.source,
        "measure": given.measure,
        "rate_per_year": rates.rate,
        "rate_lower_per_year": low,
        "rate_upper_per_year": high,
        "share_below_levels": rates.below,
        "share_above_levels": rates.above,
        "confidence": confidence,
        "excluded_age_years": excluded_age(rates.draws, confidence),
        "excluded_age_lower_years": excluded_age(high, confidence),
        "excluded_age_upper_years": excluded_age(low, confidence),
        "constants": asdict(RATE),
    }
    if age is not None:
        found |= {"age_years": age, "survival": survival(rates.draws, age)}
    if json:
        print_json(found)
    else:
        print(hazard_text(found))
    return 0
