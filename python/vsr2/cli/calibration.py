"""`vsr2 calibrate`: a study's values against a campaign."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def add_verbs(verbs: Any) -> None:
    """Add `calibrate`."""
    calibrate = verbs.add_parser(
        "calibrate",
        help="find the values of a study that agree best with a campaign",
        description="Seeks the values with which a study predicts a campaign's outcomes best, and "
        "judges them on ground motions that they were not chosen on.",
        epilog=(
            "The output folder holds report.md, figures/, tables as CSV, best.yaml (the study with "
            "the best values) and evaluations.jsonl (every parameter set as it is finished: after "
            "an interruption --resume goes on from there). docs/how-to/calibrate.md explains."
        ),
    )
    calibrate.add_argument(
        "study", metavar="STUDY.yaml", type=Path, help="study of the calibration"
    )
    calibrate.add_argument(
        "--out", type=Path, help="output folder (default: out/NAME of the study)"
    )
    calibrate.add_argument("--overwrite", action="store_true", help="replace what is there")
    calibrate.add_argument(
        "--resume", action="store_true", help="go on with, or extend, what is there"
    )
    calibrate.add_argument("--threads", type=int, help="default: all this process may use")
    calibrate.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change one setting, e.g. --set method.refine=50 (may be repeated)",
    )
    calibrate.add_argument("--no-figures", action="store_true", help="write no figures, no page")
    calibrate.add_argument("--quiet", action="store_true", help="no progress bar, no summary")
    calibrate.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    import sys

    import numpy as np
    from tqdm import tqdm

    from vsr2.analysis import format_baselines
    from vsr2.calibration import (
        CalibrationInterrupted,
        Evaluation,
        calibrate,
        evaluations_at_most,
        load_calibration,
        prepare_calibration_folder,
        save_calibration,
    )
    from vsr2.report.calibration import write_calibration_report
    from vsr2.report.run_messages import compatible_values

    study = load_calibration(options.study, overrides=options.set)
    folder = options.out or Path("out") / study.study.name
    prepare_calibration_folder(folder, overwrite=options.overwrite, resume=options.resume)
    bar = tqdm(
        total=evaluations_at_most(study.own),
        unit="set",
        disable=True if options.quiet else None,
        dynamic_ncols=True,
    )

    def show(evaluation: Evaluation) -> None:
        bar.update()

    try:
        with bar:
            result = calibrate(study, folder, threads=options.threads, on_evaluation=show)
    except (CalibrationInterrupted, KeyboardInterrupt):
        print(
            f"vsr2: interrupted; what is finished is kept in {folder}. `--resume` goes on.",
            file=sys.stderr,
        )
        return 130
    written = save_calibration(result, study, folder)
    if not options.no_figures:
        written += write_calibration_report(result, folder)
    if not options.quiet:
        print(format_baselines(result.scores))
        if result.folds:
            print(f"optimism: {result.optimism:+.3f}")
        for profile in result.profiles:
            print(
                f"{profile.name}: {profile.best} ({profile.verdict}; {compatible_values(profile)})"
            )
        print("wrote:")
        for path in written:
            print(f"  {path}")
    return 1 if bool(np.isnan(result.in_sample).any()) else 0
