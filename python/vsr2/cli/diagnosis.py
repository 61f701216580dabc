"""`vsr2 diagnose`: where a campaign's sim-to-real gap lies, its cause, and how far it shrinks."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vsr2.diagnosis import Nuisance


def add_verbs(verbs: Any) -> None:
    """Add `diagnose`."""
    parser = verbs.add_parser(
        "diagnose",
        help="find the cause of a campaign's sim-to-real gap",
        description="Writes diagnosis.json, tables and a page (index.html) to DIR, and keeps the "
        "simulations there (simulations.sqlite), so that an interrupted or later run reuses them. "
        "docs/explanation/diagnosis.md says what each number means.",
    )
    parser.add_argument("campaign", metavar="CAMPAIGN", type=Path, help="folder of a campaign")
    parser.add_argument(
        "--scene", required=True, type=Path, metavar="SCENE.yaml", help="study of the nominal scene"
    )
    parser.add_argument("--out", required=True, type=Path, metavar="DIR", help="for the results")
    parser.add_argument(
        "--tier", choices=("B", "M", "T"), help="information to use (default: all there is)"
    )
    parser.add_argument("--budget-minutes", type=float, default=10.0, help="wall time (default 10)")
    parser.add_argument(
        "--simulations",
        type=int,
        metavar="N",
        help="so many instead of a time; more where the trials need more",
    )
    parser.add_argument("--threads", type=int, help="default: all this process may use")
    parser.add_argument("--client", metavar="ADDRESS", help="of a Dask scheduler that runs trials")
    parser.add_argument(
        "--exclude", action="append", default=[], metavar="EFFECT", help="leave an effect out"
    )
    parser.add_argument(
        "--prior",
        action="append",
        default=[],
        metavar="EFFECT.PARAMETER=LOW:HIGH",
        help="other ends of a prior, as time_scale.change=-0.3:0.1 (may be repeated)",
    )
    parser.add_argument(
        "--nuisance",
        action="append",
        default=[],
        metavar="NAME=SD",
        help="standard deviation of what is uncertain of the set-up, as friction=0.05 (may be "
        "repeated; names and defaults: docs/explanation/diagnosis.md)",
    )
    parser.add_argument("--seed", type=int, default=0, help="default 0")
    parser.add_argument("--quiet", action="store_true", help="no progress, no summary")
    parser.set_defaults(run=_diagnose)


def _diagnose(options: argparse.Namespace) -> int:
    from contextlib import nullcontext

    from vsr2.diagnosis import diagnose
    from vsr2.report.diagnosis import format_diagnosis, write_diagnosis_page
    from vsr2.simulation import connect

    cluster = nullcontext() if options.client is None else connect(options.client)
    with cluster as client:
        found = diagnose(
            options.campaign,
            options.scene,
            tier=options.tier,
            out=options.out,
            budget_minutes=options.budget_minutes,
            simulations=options.simulations,
            threads=options.threads,
            client=client,
            exclude=options.exclude,
            priors=dict(_prior(text) for text in options.prior),
            nuisances=_nuisances(options.nuisance),
            seed=options.seed,
            progress=not options.quiet,
        )
    page = write_diagnosis_page(found, options.out)
    if not options.quiet:
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


def _nuisances(texts: list[str]) -> tuple[Nuisance, ...]:
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
