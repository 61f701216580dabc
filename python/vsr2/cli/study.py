"""`vsr2 run`: a study from its file to tables and figures."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def add_verbs(verbs: Any) -> None:
    """Add `run`."""
    run = verbs.add_parser(
        "run",
        help="run a study",
        description="Run all trials of a study and write outcomes, logs, figures and provenance.",
        epilog=(
            "The output folder holds trials.csv (one row a trial), provenance.json, logs/ (one "
            ".npz a trial), models/ (for `vsr2 view`) and figures/. Finished trials are on disk at "
            "once: after an interruption --resume runs only the others. `docs/configuration.md` "
            "lists all keys of a study."
        ),
    )
    run.add_argument("study", metavar="STUDY.yaml", type=Path)
    run.add_argument("--out", type=Path, help="output folder (default: out/NAME of the study)")
    run.add_argument("--overwrite", action="store_true", help="replace a result that is there")
    run.add_argument(
        "--resume", action="store_true", help="go on with an unfinished run of the same study"
    )
    run.add_argument("--threads", type=int, help="default: all processors this process may use")
    run.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change one setting, e.g. --set contact.rock.restitution=0.5 (may be repeated)",
    )
    run.add_argument("--no-figures", action="store_true", help="write no figures")
    run.add_argument("--quiet", action="store_true", help="no progress bar, no summary")
    run.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    import sys
    from dataclasses import replace

    import numpy as np

    from vsr2.config import load_study
    from vsr2.report import summary_table, write_figures
    from vsr2.results import (
        has_journal,
        load_result,
        prepare_folder,
        remove_journal,
        save_models,
        save_result,
    )
    from vsr2.simulation import run_batch, study_trials

    study = load_study(options.study, overrides=options.set)
    folder = options.out or Path("out") / study.name
    trials = study_trials(study)
    scene = trials[0].scene
    if not (options.resume and has_journal(folder)):
        prepare_folder(folder, overwrite=options.overwrite)
    if not options.quiet:
        print(
            f"{study.name}: {len(trials)} trials, {Path(scene.rock.source).name} "
            f"({scene.rock.mass.mass:.4g} kg) on {Path(scene.pedestal.source).name}, engine "
            f"{scene.engine_name}"
        )
        for note in scene.rock.notes:
            print(f"note: {note}")
    if scene.rock.surface is not None and scene.pedestal_surface is not None:
        save_models(folder, scene.rock.surface, scene.pedestal_surface)
    result = run_batch(
        trials, threads=options.threads, progress=not options.quiet, checkpoint=folder
    )
    if result.provenance["interrupted"]:
        finished = int((~np.isin(result["status"], ("cancelled", "not_run"))).sum())
        print(
            f"vsr2: interrupted; {finished} of {len(trials)} trials are finished and kept in "
            f"{folder}. `--resume` runs the others.",
            file=sys.stderr,
        )
        return 130
    result = replace(
        result, provenance={**result.provenance, "study": study.model_dump(mode="json")}
    )
    save_result(result, folder, streamed_logs=True)
    remove_journal(folder)
    written = [folder / "trials.csv", folder / "provenance.json"]
    if study.output.log_every:
        written.append(folder / "logs")
    if study.output.figures and not options.no_figures:
        written += write_figures(
            load_result(folder, logs=False), folder / "figures", logs_from=folder
        )
    if not options.quiet:
        print(summary_table(result))
        print("wrote:")
        for path in written:
            print(f"  {path}")
    return 0 if set(result["status"]) <= {"ok"} else 1
