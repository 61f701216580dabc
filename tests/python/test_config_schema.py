"""JSON schemas of all kinds of YAML files: committed, named by the files, and true."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from pydantic_core import to_json

from vsr2.calibration import calibration_schema
from vsr2.campaign import campaign_schema
from vsr2.config import study_schema
from vsr2.config.yaml_file import read_yaml
from vsr2.fragility import fragility_schema

ROOT = Path(__file__).parents[2]
SCHEMAS = {
    "study": study_schema,
    "fragility": fragility_schema,
    "calibration": calibration_schema,
    "campaign": campaign_schema,
}
FILES = sorted([*(ROOT / "configs").glob("*.yaml"), *(ROOT / "studies").glob("*.yaml")])


def validator(kind: str) -> jsonschema.Draft202012Validator:
    schema = json.loads(to_json(SCHEMAS[kind]()))
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.mark.parametrize("kind", SCHEMAS)
def test_the_committed_schema_is_the_generated_one(kind: str) -> None:
    committed = json.loads((ROOT / "configs" / "schemas" / f"{kind}.json").read_text())
    assert committed == json.loads(to_json(SCHEMAS[kind]())), (
        f"write it again: vsr2 config schema {kind} > configs/schemas/{kind}.json"
    )


@pytest.mark.parametrize("path", FILES, ids=lambda p: f"{p.parent.name}/{p.name}")
def test_every_yaml_file_names_the_schema_that_takes_it(path: Path) -> None:
    modeline = re.match(r"# yaml-language-server: \$schema=(\S+)\n", path.read_text())
    assert modeline is not None, "the first line names no schema"
    schema = json.loads((path.parent / modeline[1]).read_text())
    jsonschema.Draft202012Validator(schema).validate(read_yaml(path).data)


@pytest.mark.parametrize(
    ("kind", "path", "change"),
    [
        ("fragility", "configs/fragility.yaml", {"fragility": {"replicate": 2}}),
        ("fragility", "configs/fragility.yaml", {"fragility": {"target_pga": [0.1]}}),
        ("fragility", "configs/fragility.yaml", {"parameters": {}}),
        ("calibration", "configs/calibration.yaml", {"motion": {"mode": "all_recordings"}}),
        ("calibration", "configs/calibration.yaml", {"method": {"kind": "joined"}}),
        ("calibration", "configs/calibration.yaml", {"fold": 3}),
        ("campaign", "tests/fuzz/corpus/campaign/campaign.yaml", {"schema": "vsr2.campaign/0"}),
        ("campaign", "tests/fuzz/corpus/campaign/campaign.yaml", {"units": "g"}),
        ("study", "configs/block.yaml", {"fragility": {}}),
    ],
)
def test_a_schema_refuses_what_the_reader_refuses(
    kind: str, path: str, change: dict[str, Any]
) -> None:
    good: dict[str, Any] = read_yaml(ROOT / path).data
    checked = validator(kind)
    checked.validate(good)
    with pytest.raises(jsonschema.ValidationError):
        checked.validate({**good, **change})
