"""The diagnosis as it is run: the command line, threads, far processes, a kill in the middle."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import jsonschema
import pytest

from vsr2.campaign import load_campaign, save_campaign
from vsr2.cli.main import main
from vsr2.config import load_study
from vsr2.diagnosis import diagnose, schema
from vsr2.diagnosis.planted import shaken_campaign
from vsr2.diagnosis.simulated.scene_simulator import SceneSimulator
from vsr2.diagnosis.simulated.simulator import Request
from vsr2.effects import library

SCENE = """
name: box
rock: {shape: box, size: [0.4, 0.55, 0.95], density: 2700.0}
motion: {mode: single_cosine, amplitude: 0.05, frequency: 1.0}
contact: {rock: {lateral_friction: 0.9}, pedestal: {lateral_friction: 0.9}}
outcome: {tail: 2.0}
"""
KEPT = ("table_gain", "catch", "wear")
EXCLUDED = [name for name in library() if name not in KEPT]
SIMULATIONS = 1500


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of a block under a tether at 12 degrees, and its scene."""
    out = tmp_path_factory.mktemp("runs")
    (out / "scene.yaml").write_text(SCENE)
    shaken = shaken_campaign(5, 8, duration=2.0, pga=(0.6, 1.3), session_size=10)
    truth = SceneSimulator(shaken, load_study(out / "scene.yaml"), seed=5)
    found = truth.run([Request(i, (("catch", (12.0,)),), 3, 1) for i in range(len(shaken))])
    trials = tuple(
        replace(trial, overturned=bool(found.overturned[i]), peak_tilt=float(found.peak_tilt[i]))
        for i, trial in enumerate(shaken.trials)
    )
    save_campaign(replace(shaken, trials=trials), out / "campaign")
    return out


def command(folder: Path, out: Path, *more: str) -> list[str]:
    line = ["diagnose", str(folder / "campaign"), "--scene", str(folder / "scene.yaml")]
    line += ["--out", str(out), "--simulations", str(SIMULATIONS), *more]
    line += ["--nuisance", "slenderness=0.019"]
    return line + [part for name in EXCLUDED for part in ("--exclude", name)]


def content(out: Path) -> dict:
    """What a run says, without what may differ between equal runs."""
    found = json.loads((out / "diagnosis.json").read_text())
    for key in ("wall_time_s", "budget"):
        found["provenance"].pop(key)
    return found


@pytest.fixture(scope="module")
def told(folder: Path) -> dict:
    assert main([*command(folder, folder / "one"), "--threads", "1", "--quiet"]) == 0
    return content(folder / "one")


def test_the_command_line_writes_verdict_page_and_progress(folder, told, tmp_path, capsys) -> None:
    assert main([*command(folder, tmp_path / "two"), "--threads", "2", "-v"]) == 0
    shown = capsys.readouterr()
    assert "Of the effects in the library, catch explains the gap" in shown.out
    assert "screening" in shown.err
    assert "effects can be the cause: " in shown.err
    # Before the end, too: after a quarter and a half of the only round's draws.
    first = next(line for line in shown.err.replace("\r", "\n").splitlines() if "leading" in line)
    assert "simulating" in first
    assert "catch" in first
    written = {path.name for path in (tmp_path / "two").iterdir()}
    tables = {"effects.csv", "where.csv", "trials.csv"}
    assert written >= {"diagnosis.json", "index.html", "bank.sqlite", *tables}
    # Threads change nothing.
    assert content(tmp_path / "two") == told
    jsonschema.validate(json.loads((tmp_path / "two" / "diagnosis.json").read_text()), schema())
    assert told["verdict"]["kind"] == "effect"
    assert told["verdict"]["effects"] == ["catch"]


def test_what_was_not_looked_for_is_told(folder, told) -> None:
    assert told["provenance"]["excluded"] == sorted(EXCLUDED)
    assert told["provenance"]["unavailable"] == {}
    assert told["provenance"]["left_out"] == 0
    assert told["provenance"]["nuisance_sd"]["slenderness"] == 0.019
    assert any(text.startswith("left out of the library as asked: ") for text in told["limits"])


def test_trials_specimens_and_effects_that_are_not_used_are_told(
    folder, tmp_path, monkeypatch
) -> None:
    monkeypatch.setattr("vsr2.diagnosis.which.amortised.TREES", 30)
    campaign = load_campaign(folder / "campaign")
    rows = tuple(
        replace(trial, specimen="other" if i % 2 else trial.specimen, session=f"day {i // 10}")
        for i, trial in enumerate(campaign.trials)
    )
    extra = replace(rows[-1], trial="x", order=999, overturned=None)
    mixed = replace(
        campaign,
        trials=(*rows, extra),
        specimens={**campaign.specimens, "other": next(iter(campaign.specimens.values()))},
    )
    scene = tmp_path / "motor.yaml"
    scene.write_text(SCENE.replace("frequency: 1.0}", "frequency: 1.0, drive: motor}"))
    found = diagnose(
        mixed,
        scene,
        tier="B",
        simulations=300,
        exclude=[name for name in EXCLUDED if name != "table_pitch"],
        priors={"table_gain.change": (-0.3, 0.1)},
    )
    limits = "\n".join(found.content["limits"])
    assert "1 trials of the campaign have no motion or no outcome" in limits
    assert "table_pitch was not looked for, this scene cannot have it" in limits
    assert "2 specimens" in limits
    assert re.search("needs at least [0-9]+ simulations, more than the budget of 300", limits)
    assert "other" in limits
    places = {row["place"] for row in found.content["where"]}
    assert any("day 2" in place for place in places)
    assert found.content["provenance"]["priors"] == {"table_gain.change": [-0.3, 0.1]}
    values = next(e for e in found.content["effects"] if e["name"] == "table_gain")["parameters"]
    assert -0.3 <= values["change"]["ci95"][0] < -0.15
    assert values["change"]["ci95"][1] <= 0.1


@pytest.mark.parametrize(
    ("more", "error"),
    [
        (["--prior", "table_gain=1"], "--prior table_gain=1: give EFFECT.PARAMETER=LOW:HIGH"),
        (["--prior", "table_gain.change=a:b"], "give EFFECT.PARAMETER=LOW:HIGH"),
        (["--prior", "table_gian.change=0:1"], "no effect 'table_gian'"),
        (["--prior", "table_gain.chnage=0:1"], "has no parameter 'chnage'"),
        (["--prior", "table_gain.change=-2:1"], "it can be simulated from -0.9 to 5"),
        (["--prior", "table_gain.change=1:0"], "a prior from 1 to 0"),
        (["--exclude", "bogus"], "no effect 'bogus'"),
        (["--prior", "friction.factor=0:1"], "effects.friction.factor: parameter 'factor': a"),
        (["--nuisance", "frction=0.1"], "names are slenderness, inertia,"),
        (["--nuisance", "friction=-1"], "give NAME=SD with a number of 0 or more"),
        (["--nuisance", "friction"], "give NAME=SD"),
        (["--budget-minutes", "inf"], "budget_minutes is inf; give a finite number"),
        (["--budget-minutes", "nan"], "budget_minutes is nan; give a finite number"),
        (["--simulations", "0"], "simulations is 0; give at least 1"),
    ],
)
def test_what_cannot_be_used_is_refused_before_any_work(
    folder, tmp_path, capsys, more, error
) -> None:
    line = ["diagnose", str(folder / "campaign"), "--scene", str(folder / "scene.yaml")]
    assert main([*line, "--out", str(tmp_path / "none"), *more]) != 0
    assert error in capsys.readouterr().err
    assert not (tmp_path / "none").exists()


def test_a_killed_diagnosis_goes_on_to_the_same_verdict(folder, told, tmp_path) -> None:
    out = tmp_path / "killed"
    line = [sys.executable, "-m", "vsr2.cli.main", *command(folder, out, "--threads", "1")]
    child = subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    bank = out / "bank.sqlite"
    ends = time.monotonic() + 60
    while not (bank.exists() and committed(bank)) and time.monotonic() < ends:
        assert child.poll() is None, "it ended before it could be killed"
        time.sleep(0.005)
    child.send_signal(signal.SIGKILL)
    assert child.wait() == -signal.SIGKILL
    assert not (out / "diagnosis.json").exists()
    kept = committed(bank)
    assert main([*command(folder, out, "--threads", "1"), "--quiet"]) == 0
    assert content(out) == told
    budget = json.loads((out / "diagnosis.json").read_text())["provenance"]["budget"]
    assert budget["reused"] >= kept > 0


def committed(bank: Path) -> int:
    """Simulations that a bank holds, read beside whoever writes it."""
    import sqlite3

    try:
        with sqlite3.connect(f"file:{bank}?mode=ro", uri=True) as file:
            return int(file.execute("SELECT COUNT(*) FROM runs").fetchone()[0])
    except sqlite3.OperationalError:
        return 0


def test_far_processes_change_nothing(folder, told, tmp_path) -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        line = command(folder, tmp_path / "far", "--client", cluster.scheduler_address)
        assert main([*line, "--quiet"]) == 0
    assert content(tmp_path / "far") == told
