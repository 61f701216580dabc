"""`vsr2 run`: a study from its file to tables and figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from vsr2.cli import options as opt
from vsr2.cli.chosen_step import with_time_step
from vsr2.errors import ConfigError

if TYPE_CHECKING:
    import distributed

    from vsr2.config import Study
    from vsr2.trial import Trial


def run(
    study: opt.Study,
    /,
    *,
    options: opt.StudyRun = opt.RUN,
    shard: Annotated[str | None, Parameter(group=opt.WHERE)] = None,
    merge: Annotated[bool, Parameter(group=opt.WHERE)] = False,
    dry_run: Annotated[bool, Parameter(group=opt.WHERE)] = False,
) -> int:
    """Run a study.

    Runs all trials of a study and writes outcomes, logs, figures and provenance.

    The output folder holds trials.csv (one row a trial), provenance.json, logs/ (one .npz a
    trial), models/ (for `vsr2 view`) and figures/. Finished trials are on disk at once: after an
    interruption --resume runs only the others. docs/reference/configuration.md lists all keys of a
    study, docs/how-to/cluster.md tells how to use more than one machine.

    Args:
        shard: I/N: run only the I-th of N parts, 1 to N, into OUT/shards; for job arrays
        merge: make one result of all shards in OUT; runs nothing
        dry_run: say what would run, how long and how large; writes nothing, times one trial
    """
    from vsr2.results import prepare_folder
    from vsr2.simulation import study_trials

    loaded = opt.scene(study, options.set)
    chooses = loaded.engine.time_step_tolerance is not None
    if chooses and (shard is not None or merge):
        # On another kind of processor perhaps otherwise.
        raise ConfigError(
            "--shard, --merge: each part would choose a time step by engine.time_step_tolerance; "
            "let `vsr2 config time-step` choose it once, and state engine.time_step"
        )
    if chooses and not (options.overwrite or options.resume or dry_run):
        # Refused before the comparison, which takes a while.
        prepare_folder(options.folder(loaded.name))
    loaded, notes = with_time_step(loaded, study_trials, "run", options)
    trials = study_trials(loaded)
    if dry_run:
        return _say_what_would_run(loaded.name, options, trials)
    if shard is not None:
        return _run_shard(shard, options, trials, options.folder(loaded.name))
    with opt.cluster(options.scheduler, options.threads) as client:
        return _run_all(options, loaded, trials, client, merge=merge, notes=notes)


def _run_all(
    options: opt.StudyRun,
    study: Study,
    trials: Sequence[Trial],
    client: distributed.Client | None,
    *,
    merge: bool,
    notes: Mapping[str, Any],
) -> int:
    from dataclasses import replace

    from vsr2.report import remove_figures, summary_table, write_figures
    from vsr2.report.messages.commands import study_begins
    from vsr2.results import (
        FIGURE_FOLDER,
        finished_plan,
        load_result,
        prepare_folder,
        remove_journal,
        save_models,
        save_result,
    )
    from vsr2.simulation import merge_shards, native_scene, plan_sha256, run_batch

    folder = options.folder(study.name)
    again = (options.resume or merge) and not options.overwrite
    finished = again and finished_plan(folder) == plan_sha256(trials)
    if finished and opt.has_all_logs(folder, npy=study.output.npy, remake=not merge):
        return opt.nothing_to_do(folder, quiet=options.quiet)
    scene = trials[0].scene
    facts: dict[str, Any] = {"study": study.model_dump(mode="json"), **notes}
    if merge:
        facts["shards"] = merge_shards(trials, folder, overwrite=options.overwrite)
    else:
        prepare_folder(folder, overwrite=options.overwrite, resume=options.resume)
    if not options.quiet:
        print(study_begins(study.name, trials, native_scene(scene).engine.name))
    result = run_batch(
        trials,
        threads=options.threads,
        progress=not options.quiet,
        checkpoint=folder,
        client=client,
    )
    if result.provenance["interrupted"]:
        return opt.interrupted(result, folder)
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
            load_result(folder, logs=False), folder / FIGURE_FOLDER, logs_from=folder
        )
    else:
        # Those of a result that was replaced.
        remove_figures(folder / FIGURE_FOLDER)
    remove_journal(folder)
    if not options.quiet:
        print(summary_table(result))
        opt.print_written(written)
    return opt.exit_code(result)


def _say_what_would_run(name: str, options: opt.StudyRun, trials: Sequence[Trial]) -> int:
    from vsr2.report.messages.commands import batch_estimate, study_begins
    from vsr2.simulation import estimate_batch, native_scene

    print(study_begins(name, trials, native_scene(trials[0].scene).engine.name))
    print(batch_estimate(estimate_batch(trials, threads=options.threads), options.folder(name)))
    return 0


def _run_shard(part: str, options: opt.StudyRun, trials: Sequence[Trial], folder: Path) -> int:
    from vsr2.report.messages.commands import shard_done
    from vsr2.simulation import Shard, run_shard

    shard = Shard.parse(part)
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
        return opt.interrupted(result, shard.folder(folder))
    if not options.quiet:
        print(shard_done(shard, result, shard.folder(folder)))
    return opt.exit_code(result)
