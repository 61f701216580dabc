"""The reference of keys and the JSON schema follow the models."""

import runpy
from pathlib import Path
from typing import Annotated

import jsonschema
import pytest
import yaml

from vsr2.calibration.calibration_study import CalibrationSettings
from vsr2.config import reference_markdown, study_from_mapping, study_schema
from vsr2.config.reference import key_tables
from vsr2.config.schema import all_sections, variants
from vsr2.config.section import Section
from vsr2.config.sources import Source, source_of
from vsr2.config.study import Study
from vsr2.fragility.settings import FragilitySettings

ROOT = Path(__file__).parents[2]


def sections(section: type[Section] = Study):
    yield section
    for field in section.model_fields.values():
        held = variants(field)
        for inner in held.by_tag.values() if held else ():
            yield from sections(inner)


def test_the_committed_reference_is_the_generated_one():
    pages = runpy.run_path(str(ROOT / "scripts" / "reference_tables.py"))["pages"]()
    assert {"configuration.md", "calibration_fragility.md"} <= {path.name for path in pages}
    for path, text in pages.items():
        assert path.read_text(encoding="utf-8") == text, (
            f"{path.name} is old; write it again: python scripts/reference_tables.py"
        )


def numeric(value) -> bool:
    if isinstance(value, tuple):
        return bool(value) and all(map(numeric, value))
    return isinstance(value, int | float) and not isinstance(value, bool)


@pytest.mark.parametrize("root", [Study, CalibrationSettings, FragilitySettings])
def test_every_numeric_default_states_its_source(root):
    for place, section in all_sections(root):
        for key, field in section.model_fields.items():
            if numeric(field.default):
                assert source_of(field), f"{'.'.join((*place, key))}: name a source"


def test_a_default_without_a_source_has_an_empty_cell():
    class Bare(Section):
        """Nothing."""

        length: float = 1.0
        """Of it [m]."""
        width: Annotated[float, Source("measured")] = 2.0
        """Across [m]."""

    rows = [*key_tables(Bare)][2:4]
    assert [row.split("|")[-2].strip() for row in rows] == ["", "measured"]


def test_every_key_is_in_the_reference_with_its_meaning():
    text = reference_markdown()
    for section in sections():
        assert section.__doc__
        for key, field in section.model_fields.items():
            assert f"| `{key}` |" in text
            assert field.description or key in ("shape", "mode", "file"), (section, key)


def test_units_stand_in_their_column():
    rows = {
        row.split("|")[1].strip(): row for row in reference_markdown().splitlines() if "|" in row
    }
    assert [cell.strip() for cell in rows["`time_step`"].split("|")[2:5]] == [
        "number, ≥ 1e-06, ≤ 0.02",
        "`0.001`",
        "s",
    ]
    assert [cell.strip() for cell in rows["`damping`"].split("|")[3:5]] == ["`1e+07`", "N s/m"]


def test_the_example_in_the_reference_loads():
    example = reference_markdown().split("```yaml\n")[1].split("```")[0]
    study = study_from_mapping(yaml.safe_load(example), ROOT)
    assert study.rock.shape == "box"


@pytest.fixture(scope="module")
def validator():
    schema = study_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


GOOD = {
    "rock": {"shape": "box", "size": [1, 1, 2], "mass": 10, "start": {"yaw": 5}},
    "motion": {"mode": "single_cosine", "pga_g": 0.3, "pgv_pga_s": 0.1},
    "pedestal": {"size": [1, 1, 1]},
}


def test_the_schema_takes_what_the_reader_takes(validator):
    study_from_mapping(GOOD, ".")
    validator.validate(GOOD)


@pytest.mark.parametrize(
    "change",
    [
        {"engine": {"timestep": 1}},
        {"engine": {"time_step": "1"}},
        {"pedestal": {"size": [1, 1]}},
        {"rock": {"shape": "box", "size": [1, 1, -1], "mass": 1}},
        {"motion": {"mode": "nothing"}},
    ],
)
def test_the_schema_refuses_what_the_reader_refuses(validator, change):
    with pytest.raises(jsonschema.ValidationError):
        validator.validate({**GOOD, **change})
