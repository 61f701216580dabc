"""How long a batch would take and how large its result would be, without running it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

from vsr2.simulation.batch import run_trials, usable_threads
from vsr2.simulation.planning import ROW_BYTES, check_trials, log_bytes
from vsr2.trial import Trial
from vsr2.trial.trial import rows_only


@dataclass(frozen=True)
class BatchEstimate:
    """What a batch would take.

    Attributes:
        trials: number of them.
        motion_time: duration of all motions together [s].
        threads: that would run them.
        wall_time: on the clock, if every trial ran as fast as the one that was timed [s].
        log_bytes: of all logs, as long as they can get, before compression [byte].
        table_bytes: of the table, about [byte].
    """

    trials: int
    motion_time: float
    threads: int
    wall_time: float
    log_bytes: float
    table_bytes: float


def estimate_batch(trials: Sequence[Trial], *, threads: int | None = None) -> BatchEstimate:
    """Time the trial whose motion has the median duration, and reckon with it for all.

    Args:
        trials: at least one.
        threads: as of :func:`vsr2.simulation.run_batch`.

    Raises:
        SimulationError: the trials cannot be run.
    """
    check_trials(trials)
    count = usable_threads(threads)
    durations = [trial.motion.duration for trial in trials]
    median = sorted(range(len(trials)), key=lambda i: durations[i])[len(trials) // 2]
    sample = replace(trials[median], output=rows_only(trials[median].output))
    began = time.process_time()
    run_trials([sample], threads=1, take=lambda i, row, log: None)
    spent = time.process_time() - began
    total = spent * sum(durations) / max(durations[median], 1e-9)
    return BatchEstimate(
        trials=len(trials),
        motion_time=sum(durations),
        threads=min(count, len(trials)),
        wall_time=total / min(count, len(trials)),
        log_bytes=sum(map(log_bytes, trials)),
        table_bytes=float(len(trials) * ROW_BYTES),
    )
