"""`vsr2 config`: check, explain and import configuration files; choose a time step."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, Parameter

from vsr2.cli.options import (
    Json,
    Overwrite,
    Quiet,
    Settings,
    Study,
    Threads,
    print_json,
    scene,
    target_file,
)

if TYPE_CHECKING:
    from vsr2.config import Study as StudyFile

Kind = Literal["study", "fragility", "calibration", "campaign"]
"""Kinds of YAML files."""

verbs = App(name="config", help="Check, explain and import configuration files.")


@verbs.command
def check(study: Study, /, *, set: Settings = ()) -> int:
    """Read a study and all files that it names, and print it with all defaults.

    Reads meshes, records and campaigns, places the rock and applies the effects, as a run does
    before its first trial, and names all that is wrong with these. Takes studies of
    `vsr2 fragility` and `vsr2 calibrate`, too.
    """
    from vsr2.config import dump_study, load_study
    from vsr2.config.yaml_file import dump_yaml, read_yaml

    keys = read_yaml(study).data.keys()
    own: dict[str, Any] = {}
    if keys & {"campaign", "parameters", "method"}:
        from vsr2.calibration import load_calibration
        from vsr2.calibration.calibration_study import campaign_folder
        from vsr2.campaign import load_campaign
        from vsr2.scene import build_scene

        calibration = load_calibration(study, overrides=set)
        load_campaign(campaign_folder(calibration))
        build_scene(calibration.study)
        loaded, own = calibration.study, calibration.own.model_dump(mode="json", exclude_none=True)
    elif "fragility" in keys:
        from vsr2.fragility import load_fragility

        fragility = load_fragility(study, overrides=set)
        loaded, own = fragility.study, fragility.own.model_dump(mode="json", exclude_none=True)
        _check_trials(loaded)
    else:
        # Missing files are refused with whatever else is wrong.
        loaded = load_study(study, overrides=set, check_files=False)
        _check_trials(loaded, lambda: scene(study, set))
    print(dump_study(loaded), end="")
    if own:
        print(dump_yaml(own, flow_lists=True), end="")
    return 0


def _check_trials(study: StudyFile, first: Callable[[], object] | None = None) -> None:
    """Refuse a study that cannot be run, with all that is wrong with the files that it names.

    Args:
        study: whose files may be missing.
        first: refuses it for what comes before its trials, such as missing files; None: nothing.

    Raises:
        Vsr2Error: what stops it.
        ConfigError: that and what is wrong with its other files, one a line.
    """
    from vsr2.errors import ConfigError, Vsr2Error
    from vsr2.simulation import check_trials, study_trials

    # Where a tolerance chooses the time step, the default stands for it.
    study = study.at_time_step(study.engine.time_step)
    try:
        if first is not None:
            first()
        check_trials(study_trials(study))
    except Vsr2Error as error:
        said = [str(error)]
        for other in _damaged(study):
            if not any(other in one for one in said):
                said.append(other)
        if len(said) == 1:
            raise
        raise ConfigError("\n".join(said)) from None


def _damaged(study: StudyFile) -> Iterator[str]:
    """What is wrong with the motions, the pedestal and the rock, each on its own.

    Files that are missing are passed over, and so is all that does not name the body's own file.
    """
    from vsr2.errors import Vsr2Error
    from vsr2.motion import build_motions
    from vsr2.scene import build_scene

    usual = type(study).model_fields["pedestal"].get_default(call_default_factory=True)
    alone = study.model_copy(update={"pedestal": usual})
    parts: tuple[tuple[object, Callable[[], object]], ...] = (
        (study.motion, lambda: build_motions(study.motion, study.engine.time_step)),
        (study.pedestal, lambda: build_scene(study)),
        (study.rock, lambda: build_scene(alone)),
    )
    for part, build in parts:
        path = getattr(part, "file", None) or getattr(part, "folder", None)
        if path is None or not Path(path).exists():
            continue
        try:
            build()
        except Vsr2Error as error:
            if Path(path).name in str(error):
                yield str(error)


@verbs.command
def import_ros2(
    files: Annotated[tuple[Path, ...], Parameter(consume_multiple=1)],
    /,
    *,
    out: Path | None = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> int:
    """Turn the original's ROS 2 parameter files into a study.

    Reads parameter files of the original ROS 2 system, writes a study, and says what the original
    ignored in them.

    Args:
        files: ROS 2 parameter files
        out: write the study here (default: print it)
    """
    import sys

    from vsr2.config import dump_study
    from vsr2.config import import_ros2 as read
    from vsr2.report.messages.ros2_import import import_text
    from vsr2.report.messages.written import wrote
    from vsr2.results.atomic import write_text

    imported = read(files)
    text = dump_study(imported.study)
    if out is None:
        print(text, end="")
    else:
        write_text(target_file(out, overwrite=overwrite), text)
        if not quiet:
            print(wrote(out))
    if not quiet:
        print(import_text(imported), file=sys.stderr)
    return 0


@verbs.command
def time_step(
    study: Study,
    /,
    *,
    tolerance: float | None = None,
    replicates: int | None = None,
    set: Settings = (),
    threads: Threads = None,
    json: Json = False,
) -> int:
    """Say which time step a study can do with.

    Seeks the strength at which each motion overturns the rock, at five time steps. Prints by how
    much that strength changes, and the longest step that keeps a tolerance.

    Args:
        tolerance: greatest change of the mean logarithm of that strength; by default the study's
            `engine.time_step_tolerance`, or 0.02 (2 %)
        replicates: slightly different starts of each motion; 2 by default
    """
    from dataclasses import asdict

    from vsr2.analysis import compare_time_steps, longest_time_step
    from vsr2.analysis.time_steps import TIME_STEPS, time_step_constants
    from vsr2.ensemble.execution import Progress, Stage
    from vsr2.errors import ConfigError
    from vsr2.report.messages.commands import time_step_table
    from vsr2.report.messages.progress_lines import ProgressLines

    asked = scene(study, set)
    if tolerance is None:
        tolerance = asked.engine.time_step_tolerance or TIME_STEPS.tolerance
    replicates = TIME_STEPS.replicates if replicates is None else replicates
    if not 0 < tolerance <= 1:
        raise ConfigError(
            f"--tolerance is {tolerance:g}; give a number above 0 and at most 1, as 0.02 for 2 %"
        )
    lines = ProgressLines("config time-step")

    def progress(done: int, every: int) -> None:
        lines(Progress(Stage.MARGINS, done / every))

    found = compare_time_steps(
        asked,
        replicates=replicates,
        threads=threads,
        progress=progress,
    )
    longest = longest_time_step(found, tolerance)
    if json:
        rows = [asdict(one) for one in found]
        print_json(
            {
                "tolerance": tolerance,
                "longest_time_step": longest,
                "time_steps": rows,
                "constants": time_step_constants(),
            }
        )
    else:
        print(time_step_table(found, longest, tolerance))
    return 0


@verbs.command
def reference() -> int:
    """Print all keys with units and defaults."""
    from vsr2.config import reference_markdown

    print(reference_markdown(), end="")
    return 0


@verbs.command
def schema(kind: Kind = "study", /) -> int:
    """Print the JSON Schema of a kind of file, for editors that check and complete YAML.

    Args:
        kind: of file
    """
    print_json(json_schema(kind))
    return 0


def json_schema(kind: Kind) -> dict[str, Any]:
    """The JSON Schema of a kind of file."""
    match kind:
        case "study":
            from vsr2.config import study_schema

            return study_schema()
        case "fragility":
            from vsr2.fragility import fragility_schema

            return fragility_schema()
        case "calibration":
            from vsr2.calibration import calibration_schema

            return calibration_schema()
        case "campaign":
            from vsr2.campaign import campaign_schema

            return campaign_schema()
