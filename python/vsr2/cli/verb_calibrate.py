"""`vsr2 calibrate`: a study's values against a campaign."""

from __future__ import annotations

from typing import Any

from vsr2.cli import options as opt
from vsr2.cli.chosen_step import extended_with_time_step


def calibrate(study: opt.Study, /, *, options: opt.StudyRun = opt.RUN) -> int:
    """Find the values of a study that agree best with a campaign.

    Seeks the values with which a study predicts a campaign's outcomes best, and judges them on
    ground motions that they were not chosen on.

    The output folder holds report.md, figures/, tables as CSV, best.yaml (the study with the best
    values) and evaluations.jsonl (every parameter set as it is finished: after an interruption
    --resume goes on from there, and it extends a search that is done). docs/how-to/calibrate.md
    explains.
    """
    import logging
    import sys
    from dataclasses import replace

    import numpy as np
    from tqdm import tqdm

    from vsr2.calibration import (
        CalibrationInterrupted,
        Evaluation,
        evaluations_at_most,
        load_calibration,
        prepare_calibration_folder,
        save_calibration,
    )
    from vsr2.calibration import calibrate as search
    from vsr2.calibration.calibration_study import campaign_folder
    from vsr2.campaign import load_campaign
    from vsr2.ensemble import campaign_step_trials
    from vsr2.report.calibration_page import write_calibration_report
    from vsr2.report.messages.commands import (
        baseline_table,
        calibration_search,
        calibration_summary,
        interrupted_calibration,
    )

    loaded = load_calibration(study, overrides=options.set)
    folder = options.folder(loaded.study.name)
    prepare_calibration_folder(folder, overwrite=options.overwrite, resume=options.resume)
    notes: dict[str, Any] = {}
    if loaded.study.engine.time_step_tolerance is not None:
        steps = campaign_step_trials(load_campaign(campaign_folder(loaded)))
        loaded, notes = extended_with_time_step(loaded, steps, "calibrate", options)
    bar = tqdm(
        total=evaluations_at_most(loaded.own),
        unit="set",
        disable=True if options.quiet else None,
        dynamic_ncols=True,
    )

    def show(evaluation: Evaluation) -> None:
        bar.update()

    try:
        with bar, opt.cluster(options.scheduler, options.threads) as client:
            result = search(
                loaded, folder, threads=options.threads, client=client, on_evaluation=show
            )
    except (CalibrationInterrupted, KeyboardInterrupt):
        print(f"vsr2: {interrupted_calibration(folder)}", file=sys.stderr)
        return 130
    result = replace(result, provenance={**result.provenance, **notes})
    logging.getLogger(__name__).info(calibration_search(result))
    written = save_calibration(result, loaded, folder)
    if not options.no_figures:
        written += write_calibration_report(result, folder)
    if not options.quiet:
        print(baseline_table(result.scores))
        print(calibration_summary(result), end="")
        opt.print_written(written)
    return 1 if bool(np.isnan(result.in_sample).any()) else 0
