"""`vsr2 blind make`: what it takes, what it says, where the key goes."""

from collections import Counter
from pathlib import Path

import pytest

import vsr2.blind
from blind_samples import SCENE
from vsr2.blind.custodian.pack_making import Made
from vsr2.blind.form.pack_settings import KINDS
from vsr2.blind.form.seal import open_key
from vsr2.cli.main import main


def test_the_command_makes_open_packs_from_a_seed_and_no_others(quick, tmp_path, capsys) -> None:
    sizes = ["--trials", "40", "--motions", "4", "--catalogue", "5", "--sessions", "3"]
    sizes += ["--replicates", "4", "--signal-trials", "8"]
    counts = ["--single", "2", "1", "--none", "1", "--pair", "0", "--unknown", "0", "--hidden", "3"]
    pack = tmp_path / "pack"
    command = ["blind", "make", str(SCENE), "--out", str(pack), "--seed", "4", *sizes, *counts]
    command += ["--engine", "mujoco", "--engine", "bullet"]
    assert main(command) == 2
    assert "--development" in capsys.readouterr().err
    assert main([*command, "--development"]) == 0
    assert "5 campaigns, sealed as" in capsys.readouterr().out
    # The key lies beside the pack, so that who publishes the pack keeps it.
    key = open_key(pack / "data", tmp_path / "pack-key")
    found = Counter((e["engine"], e["kind"]) for e in key["campaigns"].values())
    assert found["mujoco", "single"] == 2
    assert found["bullet", "single"] == found["mujoco", "none"] == found["bullet", "none"] == 1
    # A finished pack is not made again, but for --resume, which changes nothing.
    assert main([*command, "--development"]) == 2
    assert "holds the key of a pack; go on with it by --resume" in capsys.readouterr().err
    assert main([*command, "--development", "--resume", "--quiet"]) == 0
    assert capsys.readouterr().out == ""


def test_a_pack_needs_a_name_or_a_key(quick, tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setattr(vsr2.blind, "make_pack", lambda study, pack, key, *a, **k: made(pack, key))
    asked = []

    def made(pack, key):
        asked.append((pack, key))
        return Made(commitment="0", campaigns=0, not_drawn={}, refused={})

    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    assert main(["blind", "make", str(SCENE), "--out", "."]) == 0
    assert asked == [(Path("."), tmp_path / "here-key")]
    capsys.readouterr()
    assert main(["blind", "make", str(SCENE), "--out", "/"]) == 2
    assert "/: has no name that the key's folder could have; add --key" in capsys.readouterr().err


def test_the_command_refuses_sizes_that_no_diagnosis_takes(quick, tmp_path, capsys) -> None:
    command = ["blind", "make", str(SCENE), "--out", str(tmp_path / "pack")]
    for size, message in (
        (["--trials", "39"], "--trials is 39; `vsr2 blind diagnose` takes campaigns of 40"),
        (["--motions", "3"], "--motions is 3; `vsr2 blind diagnose` takes campaigns of 4"),
    ):
        assert main([*command, *size]) == 2
        assert message in capsys.readouterr().err
    assert not (tmp_path / "pack").exists()


@pytest.mark.parametrize(
    ("asked", "expected"),
    [([], {}), (["--none", "3"], {"none": 3}), (["--single", "2", "--none", "0"], {"single": 2})],
)
def test_leaving_out_in_turn_keeps_what_is_asked_for(
    study, tmp_path, monkeypatch, asked, expected
) -> None:
    seen = []

    def made(study, pack, key, settings, **how):
        seen.append(settings)
        return Made(0, "", {"mujoco": ["wear below 0"]}, {"mujoco": {"friction": 2}})

    monkeypatch.setattr(vsr2.blind, "make_pack", made)
    command = ["blind", "make", str(SCENE), "--out", str(tmp_path), "--leave-one-out", "2", *asked]
    assert main(command) == 0
    assert seen[0].leave_one_out == 2
    counts = dict.fromkeys(KINDS, 0) | expected
    assert seen[0].counts("mujoco") == counts


def test_the_command_says_what_was_not_drawn(tmp_path, monkeypatch, capsys) -> None:
    found = Made(3, "ff", {"bullet": ["base_asperity", "wear below 0"]}, {"bullet": {"inertia": 2}})
    monkeypatch.setattr(vsr2.blind, "make_pack", lambda *args, **how: found)
    assert main(["blind", "make", str(SCENE), "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "bullet: no magnitudes from 0.5 to 6 detection limits, not drawn: base_asperity" in said
    assert "wear below 0" in said
    assert "not drawn for so many campaigns: inertia (2)" in said
