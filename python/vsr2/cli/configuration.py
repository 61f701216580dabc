"""`vsr2 config`: check, explain and import configuration files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from vsr2.cli.options import Study, print_json, with_folder

verbs = App(name="config", help="Check, explain and import configuration files.")


@verbs.command
def check(study: Study, /) -> int:
    """Read a study and print it with all defaults."""
    from vsr2.config import dump_study, load_study
    from vsr2.effects import check_study_effects

    loaded = load_study(study)
    check_study_effects(loaded.effects, study)
    print(dump_study(loaded), end="")
    return 0


@verbs.command
def import_ros2(
    files: Annotated[tuple[Path, ...], Parameter(consume_multiple=1)], /, *, out: Path | None = None
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
    from vsr2.results.atomic import write_text

    imported = read(files)
    text = dump_study(imported.study)
    if out is None:
        print(text, end="")
    else:
        write_text(with_folder(out), text)
        print(f"wrote {out}")
    print(import_text(imported), file=sys.stderr)
    return 0


@verbs.command
def reference() -> int:
    """Print all keys with units and defaults."""
    from vsr2.config import reference_markdown

    print(reference_markdown(), end="")
    return 0


@verbs.command
def schema() -> int:
    """Print the JSON Schema of a study, for editors."""
    from vsr2.config import study_schema

    print_json(study_schema())
    return 0
