"""`vsr2 new`: a commented file to begin with."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Literal

from vsr2.cli.options import Overwrite, Quiet, print_written, target_file

Template = Literal["block", "rock", "fragility", "calibration"]


def new(
    template: Template,
    /,
    *,
    out: Path,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> int:
    """Write a commented file to begin with.

    block: a block under cosine pulses, which runs as it is. rock: a scanned rock under the records
    of a folder. fragility: the same, scaled to several PGAs. calibration: values that agree best
    with a campaign. Beside the file goes the JSON Schema by which editors check and complete it.
    `vsr2 config check FILE` tells what is still to be filled in.

    Args:
        template: what it is about
        out: the .yaml file
    """
    from pydantic_core import to_json

    from vsr2.cli.verb_config import json_schema
    from vsr2.errors import ConfigError
    from vsr2.results.atomic import write_text

    if out.suffix not in (".yaml", ".yml"):
        raise ConfigError(f"{out}: is no name of a YAML file; end it in .yaml")
    kind = template if template in ("fragility", "calibration") else "study"
    schema = target_file(out, overwrite=overwrite).with_name(f"vsr2_{kind}.schema.json")
    text = (files("vsr2.cli") / "templates" / f"{template}.yaml").read_text(encoding="utf-8")
    write_text(schema, to_json(json_schema(kind), indent=2).decode() + "\n")
    write_text(out, f"# yaml-language-server: $schema={schema.name}\n{text}")
    if not quiet:
        print_written([out, schema])
    return 0
