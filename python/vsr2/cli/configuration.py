"""`vsr2 config`: check, explain and import configuration files."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any


def add_verbs(verbs: Any) -> None:
    """Add `config` with its own verbs."""
    config = verbs.add_parser(
        "config",
        help="check, explain and import configuration files",
        description="Check, explain and import configuration files.",
    )
    actions = config.add_subparsers(dest="action", metavar="ACTION", required=True)

    check = actions.add_parser("check", help="read a study and print it with all defaults")
    check.add_argument("study", metavar="STUDY.yaml", type=Path, help="study to check")
    check.set_defaults(run=_check)

    imported = actions.add_parser(
        "import-ros2",
        help="turn the original's ROS 2 parameter files into a study",
        description="Read parameter files of the original ROS 2 system, write a study, and "
        "say what the original ignored in them.",
    )
    imported.add_argument(
        "files", metavar="FILE", nargs="+", type=Path, help="ROS 2 parameter file"
    )
    imported.add_argument("--out", type=Path, help="write the study here (default: print it)")
    imported.set_defaults(run=_import_ros2)

    reference = actions.add_parser("reference", help="print all keys with units and defaults")
    reference.set_defaults(run=_reference)

    schema = actions.add_parser("schema", help="print the JSON Schema of a study, for editors")
    schema.set_defaults(run=_schema)


def _check(options: argparse.Namespace) -> int:
    from vsr2.config import dump_study, load_study
    from vsr2.effects import check_study_effects

    study = load_study(options.study)
    check_study_effects(study.effects, options.study)
    print(dump_study(study), end="")
    return 0


def _reference(options: argparse.Namespace) -> int:
    from vsr2.config import reference_markdown

    print(reference_markdown(), end="")
    return 0


def _schema(options: argparse.Namespace) -> int:
    from vsr2.config import study_schema

    print(json.dumps(study_schema(), indent=2))
    return 0


def _import_ros2(options: argparse.Namespace) -> int:
    import sys

    from vsr2.config import describe, dump_study, import_ros2

    imported = import_ros2(options.files)
    text = dump_study(imported.study)
    if options.out is None:
        print(text, end="")
    else:
        options.out.write_text(text, encoding="utf-8")
        print(f"wrote {options.out}")
    print(describe(imported), file=sys.stderr)
    return 0
