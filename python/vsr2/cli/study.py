"""`vsr2 run`: a study from its file to tables and figures."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vsr2.results import TrialLog


def add_verbs(verbs: Any) -> None:
    """Add `run`."""
    run = verbs.add_parser(
        "run",
        help="run a study",
        description="Run all trials of a study and write outcomes, logs, figures and provenance.",
        epilog=(
            "The output folder holds trials.csv (one row a trial), provenance.json, logs/ (one "
            ".npz a trial), models/ (for `vsr2 view`) and figures/. `docs/configuration.md` lists "
            "all keys of a study."
        ),
    )
    run.add_argument("study", metavar="STUDY.yaml", type=Path)
    run.add_argument("--out", type=Path, help="output folder (default: out/NAME of the study)")
    run.add_argument("--overwrite", action="store_true", help="replace a result that is there")
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
    from dataclasses import replace

    from vsr2.config import load_study
    from vsr2.report import summary_table, write_figures
    from vsr2.results import (
        load_result,
        prepare_folder,
        save_models,
        save_result,
        save_trial_log,
    )
    from vsr2.simulation import run_batch, study_trials

    study = load_study(options.study, overrides=options.set)
    folder = options.out or Path("out") / study.name
    trials = study_trials(study)
    scene = trials[0].scene
    prepare_folder(folder, overwrite=options.overwrite)
    if not options.quiet:
        print(
            f"{study.name}: {len(trials)} trials, {Path(scene.rock.source).name} "
            f"({scene.rock.mass.mass:.4g} kg) on {Path(scene.pedestal.source).name}, engine "
            f"{study.engine.mode}"
        )
        for note in scene.rock.notes:
            print(f"note: {note}")
    if scene.rock.surface is not None and scene.pedestal_surface is not None:
        save_models(folder, scene.rock.surface, scene.pedestal_surface)

    # Logs go to disk as trials finish, so that memory stays bounded and an interruption loses none.
    def keep(index: int, log: TrialLog | None) -> None:
        if log is not None:
            save_trial_log(folder, index, log, npy=study.output.npy)

    result = run_batch(
        trials,
        threads=options.threads,
        progress=not options.quiet,
        keep_logs=False,
        on_trial=keep,
    )
    result = replace(
        result, provenance={**result.provenance, "study": study.model_dump(mode="json")}
    )
    save_result(result, folder, streamed_logs=True)
    written = [folder / "trials.csv", folder / "provenance.json"]
    if study.output.log_every:
        written.append(folder / "logs")
    if study.output.figures and not options.no_figures:
        written += write_figures(load_result(folder), folder / "figures")
    if not options.quiet:
        print(summary_table(result))
        print("wrote:")
        for path in written:
            print(f"  {path}")
    if result.provenance["interrupted"]:
        return 130
    return 0 if set(result["status"]) <= {"ok"} else 1
