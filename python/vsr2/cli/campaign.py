"""`vsr2 campaign`: import, check, describe and simulate campaigns of trials."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any


def add_verbs(verbs: Any) -> None:
    """Add `campaign` with its own verbs."""
    campaign = verbs.add_parser(
        "campaign",
        help="import, check, describe and simulate campaigns of trials",
        description="A campaign is a folder with campaign.yaml, trials.csv, motions/ and series/; "
        "docs/reference/campaign.md describes the form.",
    )
    own = campaign.add_subparsers(dest="campaign_verb", metavar="VERB", required=True)
    _add_import(own)
    _add_check(own)
    _add_info(own)
    _add_simulate(own)


def _add_import(verbs: Any) -> None:
    lab = verbs.add_parser(
        "import-lab",
        help="bring the published laboratory campaign into the form",
        description="SOURCE holds trials.csv and the table's motions, packed (motions/TestNNN.npz) "
        "or as the laboratory's text files (TestNNN.txt, beside it or in raw/).",
    )
    lab.add_argument("source", metavar="SOURCE", type=Path, help="folder of the laboratory's files")
    lab.add_argument("dest", metavar="DEST", type=Path, help="folder for the campaign")
    lab.add_argument("--overwrite", action="store_true", help="replace a campaign that is there")
    lab.set_defaults(run=_import_lab)


def _add_check(verbs: Any) -> None:
    check = verbs.add_parser(
        "check",
        help="list all that is wrong with a campaign's files",
        description="Names file, row, column and remedy of each problem. "
        "Exit code 0: none; 2: some.",
    )
    check.add_argument("folder", metavar="FOLDER", type=Path, help="of a campaign")
    check.set_defaults(run=_check)


def _add_info(verbs: Any) -> None:
    info = verbs.add_parser("info", help="what a campaign holds")
    info.add_argument("folder", metavar="FOLDER", type=Path, help="of a campaign")
    info.add_argument(
        "--baselines",
        action="store_true",
        help="also score the no-physics logistic curve and the campaign's own predictions",
    )
    info.add_argument("--folds", type=int, default=10, help="of the logistic curve (default 10)")
    info.add_argument("--seed", type=int, default=0, help="of folds and bootstrap (default 0)")
    info.add_argument("--json", action="store_true", help="print JSON")
    info.set_defaults(run=_info)


def _add_simulate(verbs: Any) -> None:
    simulate = verbs.add_parser(
        "simulate",
        help="make a campaign out of a study",
        description="Runs the study's trials and writes what an experimenter would have measured: "
        "outcomes, largest tilts, the table's motions, and series on request, each with noise on "
        "request.",
    )
    simulate.add_argument("study", metavar="STUDY.yaml", type=Path, help="study to run")
    simulate.add_argument("dest", metavar="DEST", type=Path, help="folder for the campaign")
    simulate.add_argument("--name", help="of the campaign (default: the study's)")
    simulate.add_argument(
        "--series-every",
        type=int,
        default=0,
        metavar="N",
        help="keep a row of the series every N time steps (default 0: no series)",
    )
    simulate.add_argument(
        "--session-size", type=int, metavar="N", help="trials a session (default: one session)"
    )
    for channel, unit in (
        ("displacement", "m"),
        ("acceleration", "m/s^2"),
        ("peak-tilt", "rad"),
        ("tilt", "rad"),
        ("position", "m"),
        ("orientation", "rad"),
    ):
        simulate.add_argument(
            f"--noise-{channel}",
            type=float,
            metavar="SE",
            help=f"standard error of the measured {channel.replace('-', ' ')} [{unit}] "
            "(default: none)",
        )
    simulate.add_argument("--seed", type=int, default=0, help="of the noise (default 0)")
    simulate.add_argument("--threads", type=int, help="default: all this process may use")
    simulate.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change one setting of the study (may be repeated)",
    )
    simulate.add_argument("--overwrite", action="store_true", help="replace a campaign in DEST")
    simulate.add_argument(
        "--resume",
        action="store_true",
        help="go on where the same command was interrupted or killed; until it ends, what is "
        "finished is kept in DEST.checkpoint",
    )
    simulate.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="run on the Dask cluster of this scheduler, as `vsr2 run` does",
    )
    simulate.add_argument("--quiet", action="store_true", help="no progress bar, no summary")
    simulate.set_defaults(run=_simulate)


def _import_lab(options: argparse.Namespace) -> int:
    from vsr2.campaign import format_campaign, import_lab

    campaign = import_lab(options.source, options.dest, overwrite=options.overwrite)
    print(format_campaign(campaign))
    print(f"wrote {options.dest}")
    return 0


def _check(options: argparse.Namespace) -> int:
    from vsr2.campaign import check_campaign

    problems = check_campaign(options.folder)
    for problem in problems:
        print(problem)
    print(f"{options.folder}: {len(problems) or 'no'} problem{'s' * (len(problems) != 1)}")
    return 2 if problems else 0


def _info(options: argparse.Namespace) -> int:
    import json
    from dataclasses import asdict

    from vsr2.campaign import campaign_summary, format_campaign, load_campaign

    campaign = load_campaign(options.folder)
    scores = []
    if options.baselines:
        from vsr2.analysis.baseline import baseline_scores

        scores = baseline_scores(campaign, folds=options.folds, seed=options.seed)
    if options.json:
        summary = campaign_summary(campaign)
        if options.baselines:
            summary["baselines"] = [
                {
                    "name": score.name,
                    "fitted": score.fitted,
                    "trials": score.metrics.trials,
                    "scores": {name: asdict(found) for name, found in score.intervals.items()},
                }
                for score in scores
            ]
        print(json.dumps(_without_nan(summary), indent=2))
        return 0
    print(format_campaign(campaign))
    if options.baselines:
        from vsr2.analysis.baseline import format_baselines

        print()
        print(format_baselines(scores))
    return 0


def _without_nan(value: Any) -> Any:
    """The same data with null for NaN, which JSON does not know."""
    if isinstance(value, dict):
        return {key: _without_nan(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_without_nan(inner) for inner in value]
    return None if isinstance(value, float) and value != value else value


def _simulate(options: argparse.Namespace) -> int:
    from contextlib import ExitStack

    from vsr2.campaign import (
        MeasurementNoise,
        format_campaign,
        load_campaign,
        save_campaign,
        simulate_campaign,
    )
    from vsr2.campaign.save import prepare_destination
    from vsr2.config import load_study
    from vsr2.effects import check_study_effects
    from vsr2.errors import CampaignError, SimulationError
    from vsr2.results import has_journal, prepare_folder, remove_result
    from vsr2.simulation import connect

    study = load_study(options.study, overrides=options.set)
    check_study_effects(study.effects, options.study)
    noise = MeasurementNoise(
        displacement=options.noise_displacement,
        acceleration=options.noise_acceleration,
        peak_tilt=options.noise_peak_tilt,
        tilt=options.noise_tilt,
        position=options.noise_position,
        orientation=options.noise_orientation,
    )
    prepare_destination(options.dest, overwrite=options.overwrite or options.resume)
    checkpoint = options.dest.with_name(f"{options.dest.name}.checkpoint")
    present = (options.dest / "campaign.yaml").exists()
    unfinished = options.resume and has_journal(checkpoint)
    resume = load_campaign(options.dest) if options.resume and present and not unfinished else None
    if has_journal(checkpoint) and not (options.resume or options.overwrite):
        raise CampaignError(
            f"{checkpoint}: keeps an unfinished simulation; go on with --resume, or begin anew "
            "with --overwrite"
        )
    if resume is None and not unfinished:
        prepare_folder(checkpoint, overwrite=options.overwrite)
    with ExitStack() as stack:
        client = None
        if options.scheduler is not None:
            if options.threads is not None:
                raise SimulationError(
                    "--threads does not apply with --scheduler: workers have their own"
                )
            client = stack.enter_context(connect(options.scheduler))
        campaign = simulate_campaign(
            study,
            sessions=options.session_size,
            noise=noise,
            seed=options.seed,
            series_every=options.series_every,
            threads=options.threads,
            progress=not options.quiet,
            resume=resume,
            checkpoint=checkpoint if resume is None else None,
            client=client,
        )
    campaign = replace(campaign, name=options.name or campaign.name)
    save_campaign(campaign, options.dest, overwrite=options.overwrite or options.resume)
    if not campaign.provenance.get("interrupted"):
        remove_result(checkpoint)
    if not options.quiet:
        print(format_campaign(campaign))
        print(f"wrote {options.dest}")
    if campaign.provenance.get("interrupted"):
        return 130
    return 0 if all(not trial.note for trial in campaign.trials) else 1
