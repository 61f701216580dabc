"""The time step that a study leaves to a tolerance, chosen before a verb simulates."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from vsr2.cli.options import cluster

if TYPE_CHECKING:
    from vsr2.analysis.time_steps import TrialsOf
    from vsr2.config import Study
    from vsr2.config.extended import ExtendedStudy
    from vsr2.config.section import Section

    Own = TypeVar("Own", bound=Section)


class Running(Protocol):
    """Options of a verb that runs trials."""

    @property
    def threads(self) -> int | None:
        """None: all processors."""

    @property
    def scheduler(self) -> str | None:
        """Of a Dask cluster; None: threads of this process."""

    @property
    def quiet(self) -> bool:
        """No progress."""


def with_time_step(
    study: Study, trials_of: TrialsOf, verb: str, options: Running
) -> tuple[Study, dict[str, Any]]:
    """A study with the time step that its tolerance chooses, and what provenance says of that.

    Says on standard error how far it is and what was chosen. A study that states no tolerance comes
    back as it is.

    Args:
        study: of a verb.
        trials_of: as of :func:`vsr2.analysis.choose_time_step`.
        verb: of the command line, for lines of progress.
        options: of the verb.

    Raises:
        Vsr2Error: the study cannot be run.
    """
    if study.engine.time_step_tolerance is None:
        return study, {}
    import sys

    from vsr2.analysis import choose_time_step
    from vsr2.ensemble.execution import Progress, Stage
    from vsr2.report.messages.commands import chosen_time_step
    from vsr2.report.messages.progress_lines import ProgressLines

    lines = ProgressLines(verb)

    def progress(done: int, every: int) -> None:
        lines(Progress(Stage.TIME_STEP, done / every))

    with cluster(options.scheduler, options.threads) as client:
        made, choice = choose_time_step(
            study,
            trials_of,
            threads=options.threads,
            client=client,
            progress=None if options.quiet else progress,
        )
    if choice is None:
        return made, {}
    if not options.quiet:
        print(f"vsr2 {verb}: {chosen_time_step(choice)}", file=sys.stderr)
    return made, {"time_step": choice.to_json()}


def extended_with_time_step(
    study: ExtendedStudy[Own], trials_of: TrialsOf, verb: str, options: Running
) -> tuple[ExtendedStudy[Own], dict[str, Any]]:
    """As :func:`with_time_step`, of a study with sections of its own."""
    chosen, notes = with_time_step(study.study, trials_of, verb, options)
    return (study.at_time_step(chosen.engine.time_step) if notes else study), notes
