"""`vsr2 diagnose`: where a campaign's sim-to-real gap lies, its cause, and how far it shrinks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cyclopts import Parameter

from vsr2.cli import options as opt

if TYPE_CHECKING:
    from vsr2.diagnosis import Nuisance


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
    simulations there (simulations.jsonl), so that an interrupted or later run reuses them.
    docs/explanation/diagnosis.md says what each number means.

    Args:
        scene: study of the nominal scene
        out: folder for the results
    """
    from vsr2.diagnosis import Budget, Execution, Hypotheses
    from vsr2.diagnosis import diagnose as find
    from vsr2.report.diagnosis import format_diagnosis, write_diagnosis_page

    with opt.cluster(effort.client) as client:
        found = find(
            campaign,
            scene,
            tier=question.tier,
            out=out,
            budget=Budget(effort.budget_minutes, effort.simulations),
            hypotheses=Hypotheses(
                exclude=question.exclude,
                priors=dict(_prior(text) for text in question.prior),
                nuisances=_nuisances(question.nuisance),
            ),
            execution=Execution(effort.threads, client, progress=not effort.quiet),
            seed=question.seed,
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


def _nuisances(texts: tuple[str, ...]) -> tuple[Nuisance, ...]:
    from vsr2.diagnosis import DEFAULT_NUISANCES, with_deviations
    from vsr2.errors import ConfigError, DiagnosisError

    given: dict[str, float] = {}
    for text in texts:
        name, _, number = text.partition("=")
        try:
            given[name] = float(number)
            with_deviations({name: given[name]})
        except (ValueError, DiagnosisError):
            names = ", ".join(one.name for one in DEFAULT_NUISANCES)
            raise ConfigError(
                f"--nuisance {text}: give NAME=SD with a number of 0 or more; names are {names}"
            ) from None
    return with_deviations(given)
