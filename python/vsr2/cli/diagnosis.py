"""`vsr2 diagnose`: where a campaign's sim-to-real gap lies, its cause, and how far it shrinks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cyclopts import Parameter

from vsr2.cli import options as opt

if TYPE_CHECKING:
    from vsr2.diagnosis import Nuisances


@Parameter(name="*")
@dataclass(frozen=True)
class Question:
    """What may be the cause, and what it is judged by.

    Attributes:
        tier: information to use (default: all there is)
        exclude: leave this effect out (may be repeated)
        prior: other ends of a prior, EFFECT.PARAMETER=LOW:HIGH, for example
            time_scale.change=-0.3:0.1 (may be repeated)
        nuisance: standard deviation of what is uncertain of the set-up, NAME=SD, for example
            friction=0.05 (may be repeated; names and defaults: docs/explanation/diagnosis.md)
        seed: of everything random
    """

    tier: opt.Tier | None = None
    exclude: tuple[str, ...] = ()
    prior: tuple[str, ...] = ()
    nuisance: tuple[str, ...] = ()
    seed: opt.Integer = 0


@Parameter(name="*")
@dataclass(frozen=True)
class Effort:
    """How much is simulated, and where.

    Attributes:
        budget_minutes: wall time
        simulations: so many instead of a time; more where the trials need more
        client: address of a Dask scheduler that runs trials
    """

    budget_minutes: float = 10.0
    simulations: opt.Integer | None = None
    threads: opt.Threads = None
    client: str | None = None
    quiet: opt.Quiet = False


QUESTION, EFFORT = Question(), Effort()


def diagnose(
    campaign: opt.Campaign,
    /,
    *,
    scene: Path,
    out: Path,
    question: Question = QUESTION,
    effort: Effort = EFFORT,
) -> int:
    """Find the cause of a campaign's sim-to-real gap.

    Writes diagnosis.json, tables and a page (index.html) to the output folder, and keeps the
    simulations there (bank.sqlite), so that an interrupted or later run reuses them.
    docs/explanation/diagnosis.md says what each number means.

    Args:
        scene: study of the nominal scene
        out: folder for the results
    """
    from vsr2.diagnosis import diagnose as find
    from vsr2.report.diagnosis import format_diagnosis, write_diagnosis_page

    with opt.cluster(effort.client) as client:
        found = find(
            campaign,
            scene,
            tier=question.tier,
            out=out,
            budget_minutes=effort.budget_minutes,
            simulations=effort.simulations,
            threads=effort.threads,
            client=client,
            exclude=question.exclude,
            priors=dict(_prior(text) for text in question.prior),
            nuisances=_nuisances(question.nuisance),
            seed=question.seed,
            progress=not effort.quiet,
        )
    page = write_diagnosis_page(found, out)
    if not effort.quiet:
        print(format_diagnosis(found))
        print(f"wrote {page}")
    return 0


def _prior(text: str) -> tuple[str, tuple[float, float]]:
    from vsr2.errors import ConfigError

    key, _, ends = text.partition("=")
    low, _, high = ends.partition(":")
    try:
        if "." not in key:
            raise ValueError
        return key, (float(low), float(high))
    except ValueError:
        raise ConfigError(
            f"--prior {text}: give EFFECT.PARAMETER=LOW:HIGH, as time_scale.change=-0.3:0.1"
        ) from None


def _nuisances(texts: tuple[str, ...]) -> Nuisances:
    from dataclasses import fields

    from vsr2.diagnosis import Nuisances
    from vsr2.errors import ConfigError

    known = [field.name for field in fields(Nuisances)]
    given: dict[str, float] = {}
    for text in texts:
        name, _, number = text.partition("=")
        try:
            given[name] = float(number)
            usable = name in known and 0 <= given[name] < math.inf
        except ValueError:
            usable = False
        if not usable:
            raise ConfigError(
                f"--nuisance {text}: give NAME=SD with a number of 0 or more; names are "
                f"{', '.join(known)}"
            )
    return Nuisances(**given)
