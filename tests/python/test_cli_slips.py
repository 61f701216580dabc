"""What the command line answers to slips: a file of another verb, names and numbers mistyped."""

from __future__ import annotations

from pathlib import Path

import pytest

from vsr2.cli.main import main

STUDY = """\
name: block
rock: {shape: box, size: [0.25, 0.5, 1.0], density: 2700.0}
motion: {mode: single_cosine, pga_g: 0.3, pgv_pga_s: 0.1}
"""


def run(*words: object) -> int:
    return main([str(word) for word in words])


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("calibrate fragility.yaml", "run the file by `vsr2 fragility`"),
        ("fragility calibration.yaml", "run the file by `vsr2 calibrate`"),
        ("run calibration.yaml", "run the file by `vsr2 calibrate`"),
    ],
)
def test_a_file_of_another_verb_is_said_in_one_line(
    line: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    verb, file = line.split()
    configs = Path(__file__).parents[2] / "configs"
    assert run(verb, configs / file) == 2
    refused = capsys.readouterr().err
    assert said in refused
    assert len(refused.splitlines()) == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("hazard", "{}/outt", "{}/curve.csv"), "did you mean {}/out?"),
        (("hazard", "{}/out", "{}/curv.csv"), "did you mean {}/curve.csv?"),
        (("hazard", "{}/out", "{}/curve.csv", "--confidence", "95"), "--confidence 95: must lie"),
        (("run", "{}/study.yaml", "--effects", "{}/min.py"), "did you mean {}/mine.py?"),
        (("run", "{}/study.yaml", "--set", "motion.pattern=*.csv"), "with `*` in quotes"),
        (("run", "{}/study.yaml", "--out", "{}/new", "--threads", "0"), '"0" is not 1 or more'),
        (("config", "time-step", "{}/study.yaml", "--tolerance", "2"), "at most 1"),
        (
            (
                "motion",
                "generate",
                "--out",
                "{}/m.csv",
                "--pga-g",
                "5",
                "--pgv-pga-s",
                "0.1",
                "--duration",
                "4",
            ),
            "PGA 5 g; 1 of 1 motion",
        ),
    ],
)
def test_slips_get_their_remedy(
    words: tuple[str, ...], said: str, tmp_path: Path, capfd, recwarn
) -> None:
    (tmp_path / "study.yaml").write_text(STUDY)
    (tmp_path / "out").mkdir()
    (tmp_path / "mine.py").write_text("")
    (tmp_path / "curve.csv").write_text(
        "#,,\"investigation_time=50.0, imt='PGA', kind='mean'\"\n"
        "lon,lat,poe-0.1,poe-0.5\n0,0,0.1,0.01\n"
    )
    run(*(word.format(tmp_path) for word in words))
    heard = capfd.readouterr().err + "".join(str(one.message) for one in recwarn)
    assert said.format(tmp_path) in heard
    assert not (tmp_path / "new").exists()


def test_a_mesh_in_millimetres_gets_a_note(tmp_path: Path, capsys) -> None:
    import trimesh

    file = tmp_path / "rock.stl"
    trimesh.creation.box((300.0, 400.0, 900.0)).export(file)
    assert run("inertia", file) == 0
    assert "900 m long; if its unit is not the metre, scale it" in capsys.readouterr().out
