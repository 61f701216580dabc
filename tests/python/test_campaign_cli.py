"""`vsr2 campaign`: its verbs, exit codes and what they print."""

import json
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import command_line
from campaign_samples import assert_equal, campaign, grid
from vsr2.campaign import load_campaign, save_campaign
from vsr2.errors import CampaignError

STUDY = """
name: block
rock: {shape: box, size: [0.25, 0.5, 1.0], density: 2700.0}
motion:
  mode: grid_cosine
  pga_g: {min: 0.2, max: 0.6, step: 0.4}
  pgv_pga_s: {min: 0.1, max: 0.1, step: 0.1}
"""


run = partial(command_line.run, "campaign")


def test_check_names_problems_and_tells_by_its_exit_code(tmp_path, capsys):
    save_campaign(campaign(), tmp_path / "c")
    assert run("check", tmp_path / "c") == 0
    assert "no problems" in capsys.readouterr().out
    table = tmp_path / "c" / "trials.csv"
    table.write_text(table.read_text().replace("A2,", "A1,"))
    assert run("check", tmp_path / "c") == 2
    out = capsys.readouterr().out
    assert "trials.csv: row 3, column trial: 'A1' is there twice" in out
    assert "1 problem\n" in out


def test_info_prints_words_or_json(tmp_path, capsys):
    save_campaign(grid(), tmp_path / "c")
    assert run("info", tmp_path / "c") == 0
    assert "12 ground motions" in capsys.readouterr().out
    assert run("info", tmp_path / "c", "--baselines", "--folds", "4") == 0
    assert "out of fold" in capsys.readouterr().out
    assert run("info", tmp_path / "c", "--baselines", "--folds", "4", "--json") == 0
    data = json.loads(capsys.readouterr().out)
    assert data["trials"] == 108
    assert data["baselines"][0]["scores"]["accuracy"]["value"] > 0.8
    with pytest.raises(CampaignError, match="no such folder"):
        run("info", tmp_path / "nowhere")


def test_simulate_checks_before_it_runs_and_resumes(tmp_path, capsys):
    study = tmp_path / "study.yaml"
    study.write_text(STUDY)
    options = ["--threads", "1", "--noise-tilt", "0.001", "--series-every", "20"]
    options += ["--session-size", "1", "--name", "made"]
    assert run("simulate", study, "--out", tmp_path / "c", *options) == 0
    assert "2: 1 overturned, 1 not, 0 unknown" in capsys.readouterr().out
    made = load_campaign(tmp_path / "c")
    assert made.name == "made"
    assert made.tier == "T"
    assert [t.session for t in made.trials] == ["1", "2"]
    assert made.trials[0].series.noise_tilt == 0.001
    np.testing.assert_allclose(np.diff(made.trials[0].series.time), 0.02, atol=1e-9)
    assert run("check", tmp_path / "c") == 0
    with pytest.raises(CampaignError, match="already holds a campaign"):
        run("simulate", study, "--out", tmp_path / "c", *options)
    capsys.readouterr()
    assert run("simulate", study, "--out", tmp_path / "c", *options, "--resume", "--quiet") == 0
    assert capsys.readouterr().out == ""
    with pytest.raises(CampaignError, match="from another study"):
        run("simulate", study, "--out", tmp_path / "c", *options, "--resume", "--seed", "1")
    assert run("simulate", study, "--out", tmp_path / "c", "--overwrite", "--quiet") == 0
    assert load_campaign(tmp_path / "c").tier == "M"


def test_a_killed_simulation_resumes_to_the_same_campaign(tmp_path):
    (tmp_path / "study.yaml").write_text(
        STUDY.replace("max: 0.6, step: 0.4", "max: 0.6, step: 0.05")
        .replace("max: 0.1, step: 0.1", "max: 0.2, step: 0.05")
        .replace("name: block", "name: block\nengine: {mode: exact}")
    )
    options = ["--threads", "2", "--noise-tilt", "0.001", "--series-every", "20", "--quiet"]
    study = tmp_path / "study.yaml"
    assert run("simulate", study, "--out", tmp_path / "calm", *options) == 0
    assert not (tmp_path / "calm.checkpoint").exists()

    command = [sys.executable, "-m", "vsr2.cli.main", "campaign", "simulate", str(study)]
    command += ["--out", str(tmp_path / "wild"), *options]
    journal = tmp_path / "wild.checkpoint" / "journal.jsonl"
    child = subprocess.Popen(command)
    while child.poll() is None:
        if journal.is_file() and journal.read_bytes().count(b"\n") > 5:
            child.send_signal(signal.SIGKILL)
            break
        time.sleep(0.001)
    assert child.wait() == -signal.SIGKILL
    assert not (tmp_path / "wild").exists()
    logs = {path: path.stat().st_mtime_ns for path in logs_of_finished(journal)}
    assert len(logs) > 4
    with pytest.raises(CampaignError, match="--resume"):
        run("simulate", study, "--out", tmp_path / "wild", *options)
    # Killed again, after the last trial: the journal is whole, the campaign not there yet.
    script = (
        "import os, sys, vsr2.campaign\n"
        "vsr2.campaign.save_campaign = lambda *a, **k: os._exit(9)\n"
        "from vsr2.cli.main import main\n"
        "main(sys.argv[1:])\n"
    )
    ended = subprocess.run([sys.executable, "-c", script, *command[3:], "--resume"], check=False)
    assert ended.returncode == 9
    assert {path: path.stat().st_mtime_ns for path in logs} == logs
    assert run("simulate", study, "--out", tmp_path / "wild", *options, "--resume") == 0
    calm, wild = load_campaign(tmp_path / "calm"), load_campaign(tmp_path / "wild")
    assert_equal(replace(calm, provenance={}), replace(wild, provenance={}))
    assert not (tmp_path / "wild.checkpoint").exists()


def logs_of_finished(journal):
    lines = journal.read_bytes().splitlines()[1:]
    finished = [json.loads(line)["trial"] for line in lines if line.endswith(b"}")]
    return [journal.parent / "logs" / f"{i:06d}.npz" for i in finished]


def test_import_lab_reports_what_it_wrote(tmp_path, capsys):
    source = tmp_path / "lab"
    source.mkdir()
    (source / "trials.csv").write_text(
        "test,sp1_overturned,date,motion\n7,1,20210621,RSN1\n8,0,20210621,RSN2\n"
    )
    assert run("import-lab", source, "--out", tmp_path / "c") == 0
    assert "0 files for 0 trials" in capsys.readouterr().out
    assert len(load_campaign(tmp_path / "c")) == 2
    with pytest.raises(CampaignError, match="already holds"):
        run("import-lab", source, "--out", tmp_path / "c")


def test_bad_options_and_folders_are_named(tmp_path, capsys):
    study = tmp_path / "study.yaml"
    study.write_text(STUDY)
    for arguments, match in {
        ("--noise-tilt", "-1"): "--noise-tilt -1: give a standard error from 0 to 100000",
        ("--noise-peak-tilt", "nan"): "--noise-peak-tilt nan: give a standard error",
        ("--session-size", "0"): "--session-size 0: give 1 or more trials a session",
    }.items():
        with pytest.raises(CampaignError, match=f"^{match}"):
            run("simulate", study, "--out", tmp_path / "c", *arguments)
    assert not (tmp_path / "c").exists()
    assert run("check", tmp_path / "nothere") == 2
    assert f"{tmp_path / 'nothere'}: no such folder; check the path" in capsys.readouterr().out
