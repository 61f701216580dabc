"""`vsr2 fragility`: a study to overturning diagrams and fragility curves."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def add_verbs(verbs: Any) -> None:
    """Add `fragility`."""
    fragility = verbs.add_parser(
        "fragility",
        help="probability of overturning against ground-motion intensity",
        description="Runs a study's motions, scaled, over azimuths and in perturbed replicates, "
        "and fits fragility curves and surfaces with confidence bands.",
        epilog=(
            "The output folder holds report.md, figures/, tables as CSV (curve_*.csv, surface.csv "
            "and lognormal.csv are for hazard codes) and provenance.json. Finished trials are on "
            "disk at once: after an interruption --resume runs only the others. "
            "docs/how-to/fragility.md explains."
        ),
    )
    fragility.add_argument("study", metavar="STUDY.yaml", type=Path, help="study of the fragility")
    fragility.add_argument(
        "--out", type=Path, help="output folder (default: out/NAME of the study)"
    )
    fragility.add_argument("--overwrite", action="store_true", help="replace what is there")
    fragility.add_argument(
        "--resume", action="store_true", help="go on with an unfinished run of the same study"
    )
    fragility.add_argument("--threads", type=int, help="default: all this process may use")
    fragility.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change one setting, e.g. --set fragility.replicates=20 (may be repeated)",
    )
    fragility.add_argument("--no-figures", action="store_true", help="write no figures, no page")
    fragility.add_argument("--quiet", action="store_true", help="no progress bar, no summary")
    fragility.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    import sys

    import numpy as np

    from vsr2.fragility import load_fragility, remove_old_tables, run_fragility, save_fragility
    from vsr2.report.fragility import write_fragility_report
    from vsr2.report.run_messages import lognormal_text
    from vsr2.results import BatchResult, has_journal, prepare_folder, remove_journal

    study = load_fragility(options.study, overrides=options.set)
    folder = options.out or Path("out") / study.study.name
    if not (options.resume and has_journal(folder)):
        prepare_folder(folder, overwrite=options.overwrite)
        remove_old_tables(folder)
    result = run_fragility(study, folder, threads=options.threads, progress=not options.quiet)
    if isinstance(result, BatchResult):
        finished = int((~np.isin(result["status"], ("cancelled", "not_run"))).sum())
        print(
            f"vsr2: interrupted; {finished} of {len(result)} trials are finished and kept in "
            f"{folder}. `--resume` runs the others.",
            file=sys.stderr,
        )
        return 130
    written = save_fragility(result, folder, keep_journal=True)
    if not options.no_figures:
        written += write_fragility_report(result, folder)
    # Only now: killed while drawing, --resume draws without simulating again.
    remove_journal(folder)
    if not options.quiet:
        print(lognormal_text(result))
        print("wrote:")
        for path in written:
            print(f"  {path}")
    return 0 if set(result.batch["status"]) <= {"ok"} else 1
