"""The time step that a study leaves to a tolerance."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from vsr2.analysis.time_steps import (
    TIME_STEPS,
    TimeStepError,
    TooFewMarginsError,
    TrialsOf,
    compare_time_steps,
    longest_time_step,
)
from vsr2.config import Study
from vsr2.config.section import DEFAULT_TIME_STEP
from vsr2.simulation import study_trials

if TYPE_CHECKING:
    import distributed


class TimeStepWarning(UserWarning):
    """No time step surely keeps the tolerance that a study states."""


@dataclass(frozen=True)
class TimeStepChoice:
    """How a time step was chosen.

    Attributes:
        tolerance: that the study states, of the mean margin.
        time_step: that is taken [s].
        kept: whether it surely keeps the tolerance; if not, it is the default.
        found: what each step costs, as far as they were compared.
    """

    tolerance: float
    time_step: float
    kept: bool
    found: tuple[TimeStepError, ...]

    def to_json(self) -> dict[str, Any]:
        """For the provenance of results; without processor times, which differ from run to run."""
        compared = [asdict(one) for one in self.found]
        for row in compared:
            del row["cpu_time"]
        return {
            "tolerance": self.tolerance,
            "time_step": self.time_step,
            "kept": self.kept,
            "compared": compared,
            "constants": asdict(TIME_STEPS),
        }


def choose_time_step(
    study: Study,
    trials_of: TrialsOf = study_trials,
    *,
    threads: int | None = None,
    client: distributed.Client | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Study, TimeStepChoice | None]:
    """Put the longest time step into a study that surely keeps its `engine.time_step_tolerance`.

    The steps, motions, starts and halvings of :class:`TimeStepConstants` bound what it takes. The
    choice depends on study, motions and the study's seed alone.

    Args:
        study: where it states no tolerance, it comes back as it is.
        trials_of: makes its trials, each of another motion; by default those of its own motions.
            :func:`vsr2.ensemble.campaign_step_trials` gives it for a campaign's,
            :func:`vsr2.fragility.fragility_step_trials` for those of a fragility study.
        threads: as of :func:`vsr2.run_batch`; no result depends on it.
        client: as there.
        progress: called with batches done and all.

    Returns:
        The study with the step in place of the tolerance, and how it was chosen; None: it was not.
        Where no step surely keeps the tolerance, or too few motions overturn the rock, it is the
        default of 1 ms, and :class:`TimeStepWarning` says so.

    Raises:
        ConfigError, GeometryError, MotionError, SimulationError: the study cannot be run.
        KeyboardInterrupt: Ctrl-C came.
    """
    tolerance = study.engine.time_step_tolerance
    if tolerance is None:
        return study, None
    found: tuple[TimeStepError, ...] = ()
    why = "all that were compared change the mean margin by more, or may do so by chance"
    try:
        with warnings.catch_warnings():
            # Of the scene at a step that may not be taken; whoever runs the study is warned.
            warnings.simplefilter("ignore")
            found = tuple(
                compare_time_steps(
                    study, trials_of=trials_of, threads=threads, client=client, progress=progress
                )
            )
    except TooFewMarginsError as error:
        why = str(error)
    longest = longest_time_step(found, tolerance)
    step = DEFAULT_TIME_STEP if longest is None else longest
    if longest is None:
        warnings.warn(
            f"engine.time_step_tolerance {tolerance:g}: no time step surely keeps it, so the "
            f"default of {1e3 * step:g} ms is taken ({why}); state a larger tolerance, or choose "
            "with more --replicates by `vsr2 config time-step` and state engine.time_step",
            TimeStepWarning,
            stacklevel=2,
        )
    return study.at_time_step(step), TimeStepChoice(tolerance, step, longest is not None, found)
