"""`vsr2 fragility`: a study to overturning diagrams and fragility curves."""

from __future__ import annotations

from vsr2.cli import options as opt
from vsr2.cli.chosen_step import extended_with_time_step


def fragility(study: opt.Study, /, *, options: opt.StudyRun = opt.RUN) -> int:
    """Probability of overturning against ground-motion intensity.

    Runs a study's motions, scaled, over azimuths and in perturbed replicates, and fits fragility
    curves and surfaces with confidence bands.

    The output folder holds report.md, figures/, tables as CSV (curve_NAME.csv, surface.csv and
    lognormal.csv are for hazard codes) and provenance.json. Finished trials are on disk at once:
    after an interruption --resume runs only the others. docs/how-to/fragility.md explains.
    """
    from dataclasses import replace

    from vsr2.fragility import (
        fragility_step_trials,
        is_fragility_finished,
        load_fragility,
        remove_old_tables,
        run_fragility,
        save_fragility,
    )
    from vsr2.report.fragility_page import write_fragility_report
    from vsr2.report.messages.runs import lognormal_text
    from vsr2.results import BatchResult, has_journal, prepare_folder, remove_journal

    loaded = load_fragility(study, overrides=options.set)
    folder = options.folder(loaded.study.name)
    chooses = loaded.study.engine.time_step_tolerance is not None
    if chooses and not (options.overwrite or options.resume):
        # Refused before the comparison, which takes a while.
        prepare_folder(folder)
    steps = fragility_step_trials(loaded)
    loaded, notes = extended_with_time_step(loaded, steps, "fragility", options)
    if options.resume and not options.overwrite and is_fragility_finished(loaded, folder):
        return opt.nothing_to_do(folder, quiet=options.quiet)
    prepare_folder(folder, overwrite=options.overwrite, resume=options.resume)
    if not has_journal(folder):
        remove_old_tables(folder)
    with opt.cluster(options.scheduler, options.threads) as client:
        result = run_fragility(
            loaded, folder, threads=options.threads, progress=not options.quiet, client=client
        )
    if isinstance(result, BatchResult):
        return opt.interrupted(result, folder)
    result = replace(result, provenance={**result.provenance, **notes})
    written = save_fragility(result, folder, keep_journal=True)
    if not options.no_figures:
        written += write_fragility_report(result, folder)
    # Only now: killed while drawing, --resume draws without simulating again.
    remove_journal(folder)
    if not options.quiet:
        print(lognormal_text(result))
        opt.print_written(written)
    return opt.exit_code(result.batch)
