"""`vsr2 new`: its files are read, run, and checked by their schema."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import get_args

import jsonschema
import pytest

from vsr2.cli.main import main
from vsr2.cli.verb_new import Template
from vsr2.config.yaml_file import read_yaml

ROOT = Path(__file__).parents[2]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with what the templates name: a mesh, records, a campaign."""
    shutil.copy(ROOT / "models" / "pbr_scan.obj", tmp_path / "rock.obj")
    (tmp_path / "records").mkdir()
    for number in ("02", "08"):
        shutil.copy(ROOT / "configs" / "motions" / f"synthetic_{number}.csv", tmp_path / "records")
    block = [str(ROOT / "configs" / "block_grid.yaml"), "--out", str(tmp_path / "campaign")]
    few = ["--set", "motion.pga_g.max=0.25", "--set", "motion.pgv_pga_s.max=0.08", "--quiet"]
    assert main(["campaign", "simulate", *block, *few]) == 0
    return tmp_path


@pytest.mark.parametrize("template", get_args(Template))
def test_a_template_is_a_file_that_checks(
    template: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = folder / "mine.yaml"
    assert main(["new", template, "--out", str(path)]) == 0
    assert str(path) in capsys.readouterr().out
    assert main(["config", "check", str(path)]) == 0, capsys.readouterr().err
    modeline = re.match(r"# yaml-language-server: \$schema=(\S+)\n", path.read_text())
    assert modeline is not None
    schema = json.loads((folder / modeline[1]).read_text())
    jsonschema.Draft202012Validator(schema).validate(read_yaml(path).data)


def test_what_is_to_be_filled_in_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "deep" / "mine.yaml"
    assert main(["new", "rock", "--out", str(path)]) == 0
    assert main(["config", "check", str(path)]) == 2
    assert "rock.obj" in capsys.readouterr().err


def test_the_block_runs_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "block.yaml"
    assert main(["new", "block", "--out", str(path)]) == 0
    out = tmp_path / "out"
    assert main(["run", str(path), "--out", str(out), "--quiet", "--no-figures"]) == 0
    assert len((out / "trials.csv").read_text().splitlines()) == 1 + 6 * 8


def test_no_file_is_lost_and_a_mistyped_template_gets_its_neighbour(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("name: mine\n")
    assert main(["new", "block", "--out", str(path)]) == 2
    assert "add --overwrite" in capsys.readouterr().err
    assert path.read_text() == "name: mine\n"
    assert main(["new", "block", "--out", str(path), "--overwrite"]) == 0
    assert "cosine" in path.read_text()
    assert main(["new", "blok", "--out", str(path)]) == 2
    assert 'Did you mean "block"' in capsys.readouterr().err
    assert main(["new", "block", "--out", str(tmp_path / "mine.txt")]) == 2
    assert "end it in .yaml" in capsys.readouterr().err
