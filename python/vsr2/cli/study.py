"""`vsr2 run`: a study from its file to tables and figures."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import distributed

    from vsr2.config import Study
    from vsr2.results import BatchResult
    from vsr2.trial import Trial


def add_verbs(verbs: Any) -> None:
    """Add `run`."""
    run = verbs.add_parser(
        "run",
        help="run a study",
        description="Run all trials of a study and write outcomes, logs, figures and provenance.",
        epilog=(
            "The output folder holds trials.csv (one row a trial), provenance.json, logs/ (one "
            ".npz a trial), models/ (for `vsr2 view`) and figures/. Finished trials are on disk at "
            "once: after an interruption --resume runs only the others. "
            "`docs/reference/configuration.md` lists all keys of a study, `docs/how-to/cluster.md` "
            "tells how to use more than one machine."
        ),
    )
    run.add_argument("study", metavar="STUDY.yaml", type=Path, help="study to run")
    run.add_argument("--out", type=Path, help="output folder (default: out/NAME of the study)")
    run.add_argument("--overwrite", action="store_true", help="replace a result that is there")
    run.add_argument(
        "--resume", action="store_true", help="go on with an unfinished run of the same study"
    )
    where = run.add_mutually_exclusive_group()
    where.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="run on the Dask cluster of this scheduler, e.g. tcp://10.0.0.1:8786; or its "
        "scheduler file (.json)",
    )
    where.add_argument(
        "--shard",
        metavar="I/N",
        help="run only the I-th of N parts, 1 to N, into OUT/shards; for job arrays",
    )
    where.add_argument(
        "--merge", action="store_true", help="make one result of all shards in OUT; runs nothing"
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
    from vsr2.config import load_study
    from vsr2.effects import check_study_effects
    from vsr2.errors import SimulationError
    from vsr2.simulation import connect, study_trials

    study = load_study(options.study, overrides=options.set)
    check_study_effects(study.effects, options.study)
    folder = options.out or Path("out") / study.name
    trials = study_trials(study)
    if options.shard is not None:
        return _run_shard(options, trials, folder)
    if options.scheduler is None:
        return _run_all(options, study, trials, folder, None)
    if options.threads is not None:
        raise SimulationError("--threads does not apply with --scheduler: workers have their own")
    with connect(options.scheduler) as client:
        return _run_all(options, study, trials, folder, client)


def _run_all(
    options: argparse.Namespace,
    study: Study,
    trials: Sequence[Trial],
    folder: Path,
    client: distributed.Client | None,
) -> int:
    from dataclasses import replace

    from vsr2.report import summary_table, write_figures
    from vsr2.results import (
        has_journal,
        load_result,
        prepare_folder,
        remove_journal,
        save_models,
        save_result,
    )
    from vsr2.simulation import merge_shards, native_scene, run_batch

    scene = trials[0].scene
    facts: dict[str, Any] = {"study": study.model_dump(mode="json")}
    if options.merge:
        facts["shards"] = merge_shards(trials, folder, overwrite=options.overwrite)
    elif not (options.resume and has_journal(folder)):
        prepare_folder(folder, overwrite=options.overwrite)
    if not options.quiet:
        print(
            f"{study.name}: {len(trials)} trials, {Path(scene.rock.source).name} "
            f"({scene.rock.mass.mass:.4g} kg) on {Path(scene.pedestal.source).name}, engine "
            f"{native_scene(scene).engine.name}"
        )
        for note in scene.rock.notes:
            print(f"note: {note}")
    result = run_batch(
        trials,
        threads=options.threads,
        progress=not options.quiet,
        checkpoint=folder,
        client=client,
    )
    if result.provenance["interrupted"]:
        return _interrupted(result, folder)
    if scene.rock.surface is not None and scene.pedestal_surface is not None:
        save_models(folder, scene.rock.surface, scene.pedestal_surface)
    result = replace(result, provenance={**result.provenance, **facts})
    # As long as the journal is there, a run that was killed here goes on from it.
    save_result(result, folder, streamed_logs=True, overwrite=True)
    written = [folder / "trials.csv", folder / "provenance.json"]
    if study.output.log_every:
        written.append(folder / "logs")
    if study.output.figures and not options.no_figures:
        written += write_figures(
            load_result(folder, logs=False), folder / "figures", logs_from=folder
        )
    remove_journal(folder)
    if not options.quiet:
        print(summary_table(result))
        print("wrote:")
        for path in written:
            print(f"  {path}")
    return 0 if set(result["status"]) <= {"ok"} else 1


def _run_shard(options: argparse.Namespace, trials: Sequence[Trial], folder: Path) -> int:
    from vsr2.simulation import Shard, run_shard

    shard = Shard.parse(options.shard)
    result = run_shard(
        trials,
        shard,
        folder,
        resume=options.resume,
        overwrite=options.overwrite,
        threads=options.threads,
        progress=not options.quiet,
    )
    if result.provenance["interrupted"]:
        return _interrupted(result, shard.folder(folder))
    if not options.quiet:
        print(
            f"shard {shard}: {len(result)} trials in {shard.folder(folder)}. Once all shards are "
            "run, --merge makes one result of them."
        )
    return 0 if set(result["status"]) <= {"ok"} else 1


def _interrupted(result: BatchResult, folder: Path) -> int:
    import sys

    import numpy as np

    finished = int((~np.isin(result["status"], ("cancelled", "not_run"))).sum())
    print(
        f"vsr2: interrupted; {finished} of {len(result)} trials are finished and kept in {folder}. "
        "`--resume` runs the others.",
        file=sys.stderr,
    )
    return 130
