"""The diagnosis of packs from the data alone, and a small pack from end to end."""

import dataclasses
import json
import os
import shutil
import subprocess
import sys
from base64 import b64decode
from pathlib import Path

import numpy as np
import pytest

import vsr2.blind.custodian.pack_making as make_module
from blind_samples import ALTERED_SUBMISSIONS, SCENE, diagnosis, make, pulses, stand_in
from vsr2.blind import (
    PackSettings,
    diagnose_pack,
    make_pack,
    score_pack,
)
from vsr2.blind.form.diagnosis_form import DIAGNOSIS_FILE
from vsr2.blind.form.events import EventCode
from vsr2.blind.form.seal import read_json
from vsr2.blind.pack_diagnoses import at_tier
from vsr2.campaign import load_campaign, save_campaign
from vsr2.cli.main import main
from vsr2.config import load_study
from vsr2.diagnosis import Budget
from vsr2.effects import library
from vsr2.ensemble import Execution
from vsr2.ensemble.execution import Progress, Stage, Turn
from vsr2.ensemble.simulated.cache import KEY
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
from vsr2.errors import BlindError, CampaignError


class Stub:
    """A diagnosis that guesses by the overturn rate."""

    calls: list = []  # noqa: RUF012

    def __init__(self, campaign, scene, **how):
        assert Path(scene).exists()
        Stub.calls.append((campaign, how))
        rate = float(np.nanmean(campaign.overturned))
        kind = "none" if rate < 0.5 else "effect"
        self.content = diagnosis(kind, {"none": 1 - rate, "table_gain": rate}, ["table_gain"])

    def save(self, folder):
        (folder / DIAGNOSIS_FILE).write_text(json.dumps(self.content))


@pytest.fixture
def small(quick, study, tmp_path, monkeypatch):
    stand_in(monkeypatch, Stub)
    # The stub names table_gain, whose class is withheld from no campaign so.
    effects = ("wear", "restitution", "friction", "inertia")
    make(study, tmp_path, single=1, none=1, pair=0, unknown=2, effects=effects)
    Stub.calls = []
    return tmp_path / "data"


def test_a_tier_hides_what_lies_beyond_it(small, tmp_path) -> None:
    heard, budget = [], Budget(campaigns=200)
    execution = Execution(report=heard.append)
    progress = diagnose_pack(small, tmp_path / "out", budget=budget, execution=execution, seed=7)
    assert progress.done == 12
    assert progress.failed == ()
    excluded = {e["id"]: e["exclude"] for e in read_json(small / "pack.json")["campaigns"]}
    for number, (campaign, how) in enumerate(Stub.calls, 1):
        how["execution"].report(Progress(Stage.LOOK, 0.5))
        assert heard[-1].turn == Turn(number, 12, campaign.name, how["tier"])
        assert campaign.tier == how["tier"]
        assert list(how["hypotheses"].exclude) == excluded[campaign.name]
        assert (how["seed"], how["budget"].campaigns) == (7, 200)
        if how["tier"] == "B":
            assert all(t.peak_tilt is None and t.series is None for t in campaign.trials)
            assert campaign.noise.peak_tilt is None
        assert how["tier"] == "T" or campaign.noise.tilt is None
    complete = load_campaign(small / Stub.calls[0][0].name)
    assert at_tier(complete, "T") is complete
    # All tiers share one cache of simulations.
    cache = Stub.calls[0][1]["execution"].cache
    scene = load_study(small / "scene.yaml")
    simulators = [
        SceneSimulator(at_tier(complete, tier), scene, series=cache.sampling or True)
        for tier in ("B", "M", "T")
    ]
    assert len({simulator.identity for simulator in simulators}) == 1


def test_references_without_effect_serve_campaigns_of_equal_trials(small, tmp_path) -> None:
    names = [entry["id"] for entry in read_json(small / "pack.json")["campaigns"]]
    pack = read_json(small / "pack.json")
    # Open ones: without effect, of a known effect, and of another PGA.
    for entry in pack["campaigns"][1:]:
        entry["kind"] = "reference"
    pack["campaigns"][2]["effects"] = [{"name": "friction", "values": {"factor": 0.8}}]
    (small / "pack.json").write_text(json.dumps(pack))
    stronger = load_campaign(small / names[3])
    last = dataclasses.replace(stronger.trials[-1], pga_g=1.05 * stronger.trials[-1].pga_g)
    stronger = dataclasses.replace(stronger, trials=(*stronger.trials[:-1], last))
    shutil.rmtree(small / names[3])
    save_campaign(stronger, small / names[3], motions="../motions")
    assert not diagnose_pack(small, tmp_path / "out", tiers=["M"]).failed
    used = {c.name: [r.name for r in how["hypotheses"].references] for c, how in Stub.calls}
    assert used == {names[0]: [names[1]], names[1]: [], names[2]: [names[1]], names[3]: []}
    Stub.calls = []
    (small / names[1] / "trials.csv").write_text("not a table")
    diagnose_pack(small, tmp_path / "again", tiers=["M"])
    assert [how["hypotheses"].references for _, how in Stub.calls] == [[], [], []]


def test_campaigns_of_one_name_go_by_their_ids(small, tmp_path) -> None:
    pack = read_json(small / "pack.json")
    names = [entry["id"] for entry in pack["campaigns"]]
    pack["campaigns"][1]["kind"] = "reference"
    (small / "pack.json").write_text(json.dumps(pack))
    for name in names:
        file = small / name / "campaign.yaml"
        file.write_text(file.read_text().replace(f"name: {name}", "name: campaign"))
    assert not diagnose_pack(small, tmp_path / "out", tiers=["B"]).failed
    used = {c.name: [r.name for r in how["hypotheses"].references] for c, how in Stub.calls}
    assert used == {name: [] if name == names[1] else [names[1]] for name in names}


def test_a_campaign_that_excludes_every_effect_is_said_first(small, tmp_path) -> None:
    pack = read_json(small / "pack.json")
    pack["campaigns"][2]["exclude"] = sorted(library())
    (small / "pack.json").write_text(json.dumps(pack))
    said, name = [], pack["campaigns"][2]["id"]
    assert diagnose_pack(small, tmp_path / "out", tiers=["M"], say=said.append).failed == (
        f"{name} M",
    )
    assert [event.code for event in said[:2]] == [EventCode.CHECKING, EventCode.FAILED]
    assert "excludes every effect" in said[1].values["message"]
    assert len(Stub.calls) == 3


def test_a_damaged_campaign_fails_alone(small, tmp_path) -> None:
    first = read_json(small / "pack.json")["campaigns"][0]["id"]
    (small / first / "trials.csv").write_text("not a table")
    progress = diagnose_pack(small, tmp_path / "out", tiers=["M"])
    assert progress.failed == (f"{first} M",)
    assert len(Stub.calls) == 3


def test_diagnosing_continues_where_it_stopped(small, tmp_path, monkeypatch) -> None:
    def failing(campaign, scene, **how):
        if len(Stub.calls) == 2:
            Stub.calls.append(None)
            raise CampaignError("no motion")
        return Stub(campaign, scene, **how)

    stand_in(monkeypatch, failing)
    progress = diagnose_pack(small, tmp_path / "out", tiers=["M"])
    assert (progress.done, len(progress.failed)) == (3, 1)
    name, tier = progress.failed[0].split()
    failed = tmp_path / "out" / name / tier / "failed.json"
    assert read_json(failed) == {
        "code": "diagnosis_ended", "error": "CampaignError", "message": "no motion",
    }  # fmt: skip
    stand_in(monkeypatch, Stub)
    progress = diagnose_pack(small, tmp_path / "out", tiers=["M"])
    assert (progress.done, len(Stub.calls)) == (4, 5)
    assert not failed.exists()
    with pytest.raises(BlindError, match="seed 0, not 1"):
        diagnose_pack(small, tmp_path / "out", seed=1)


def test_a_diagnosis_that_cannot_be_scored_has_failed(small, tmp_path, monkeypatch) -> None:
    class Nameless(Stub):
        def __init__(self, campaign, scene, **how):
            super().__init__(campaign, scene, **how)
            self.content["verdict"] |= {"kind": "effect", "effects": []}

    stand_in(monkeypatch, Nameless)
    progress = diagnose_pack(small, tmp_path / "out", tiers=["M"])
    assert len(progress.failed) == 4
    folder = tmp_path / "out" / progress.failed[0].split()[0] / "M"
    failed = read_json(folder / "failed.json")
    assert failed["code"] == "diagnosis_unreadable"
    assert "verdict.effects" in failed["message"]
    assert not (folder / DIAGNOSIS_FILE).exists()


def test_campaigns_may_rise_and_then_all_is_diagnosed_again(small, tmp_path) -> None:
    def diagnosed(campaigns):
        budget = Budget(campaigns=campaigns)
        return diagnose_pack(small, tmp_path / "out", tiers=["M"], budget=budget).done

    assert (diagnosed(200), diagnosed(200), len(Stub.calls)) == (4, 4, 4)
    assert (diagnosed(300), len(Stub.calls)) == (4, 8)
    assert {how["budget"].campaigns for _, how in Stub.calls[4:]} == {300}
    assert len(list((tmp_path / "out").glob("*/M/diagnosis-200-campaigns.json"))) == 4
    assert read_json(tmp_path / "out" / "submission.json")["campaigns"] == 300
    with pytest.raises(BlindError, match="campaigns 300, not 200; continue with the same"):
        diagnosed(200)


def test_older_diagnoses_are_set_aside_before_the_folder_says_otherwise(
    small, tmp_path, monkeypatch
) -> None:
    out = tmp_path / "out"
    diagnose_pack(small, out, tiers=["M"], budget=Budget(campaigns=200))

    def killed(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr("vsr2.blind.pack_diagnoses.write_json", killed)
    with pytest.raises(KeyboardInterrupt):
        diagnose_pack(small, out, tiers=["M"], budget=Budget(campaigns=300))
    assert read_json(out / "submission.json")["campaigns"] == 200
    assert not list(out.glob(f"*/*/{DIAGNOSIS_FILE}"))


@pytest.mark.parametrize("message", ALTERED_SUBMISSIONS)
def test_a_submission_altered_by_hand_is_refused(message, small, tmp_path) -> None:
    budget, path = Budget(campaigns=200), tmp_path / "out" / "submission.json"
    diagnose_pack(small, tmp_path / "out", tiers=["M"], budget=budget)
    changed, sound = ALTERED_SUBMISSIONS[message], read_json(path)
    path.write_text(json.dumps(sound | changed) if changed else json.dumps(sound)[:20])
    before = path.read_bytes()
    with pytest.raises(BlindError, match=rf"submission\.json: {message}"):
        diagnose_pack(small, tmp_path / "out", tiers=["M"], budget=budget)
    assert path.read_bytes() == before


def test_what_cannot_be_used_is_found_before_the_first_simulation(small, tmp_path) -> None:
    names = [entry["id"] for entry in read_json(small / "pack.json")["campaigns"]]
    damaged = small / names[-1] / "campaign.yaml"
    sound = damaged.read_text()
    damaged.write_text(sound.replace(f"name: {names[-1]}", "name: 12e345678"))
    said = []
    progress = diagnose_pack(small, tmp_path / "out", tiers=["B", "M"], say=said.append)
    assert progress.failed == (f"{names[-1]} B", f"{names[-1]} M")
    # Said first, and nothing was diagnosed yet.
    assert [event.code for event in said[:2]] == [EventCode.CHECKING, EventCode.FAILED]
    assert said[1].values["campaign"] == names[-1]
    assert said[1].values["cause"] == "campaign_unusable"
    assert said[1].values["tier"] == "B"
    wanted = "campaign.yaml: row 2, key name: must be text; put it in quotes"
    assert wanted in said[1].values["message"]
    for name in names[:-1]:
        (small / name / "trials.csv").write_text("none")
    with pytest.raises(BlindError, match=r"(?s)no campaign can be diagnosed at tier M: .*--tier"):
        diagnose_pack(small, tmp_path / "other", tiers=["M"])
    assert not (tmp_path / "other").exists()


def test_nothing_is_written_beside_a_key(small, tmp_path) -> None:
    for out in (tmp_path / "key", tmp_path / "key" / "deep" / "out"):
        with pytest.raises(BlindError, match=r"lies in a key folder, .*key; choose another --out"):
            diagnose_pack(small, out)
        assert not (out / "submission.json").exists()


def test_what_is_not_there_is_refused(small, tmp_path) -> None:
    with pytest.raises(BlindError, match="no campaign 'c0'"):
        diagnose_pack(small, tmp_path / "out", campaigns=["c0"])
    with pytest.raises(BlindError, match="finished pack"):
        diagnose_pack(tmp_path, tmp_path / "out")
    gone = read_json(small / "pack.json")["campaigns"][0]["id"]
    shutil.rmtree(small / gone)
    with pytest.raises(BlindError, match=f"lists '{gone}', but there is no such folder"):
        diagnose_pack(small, tmp_path / "out")
    assert not (tmp_path / "out").exists()


# --- from end to end ----------------------------------------------------------------------------


WATCHED = """
import json, sys
from pathlib import Path
# Libraries ask what the machine is.
HARMLESS = [("uname", ["uname", "-p"]), ("lscpu", ["lscpu", "--parse=core"])]
STARTING = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.fork", "os.forkpty")
looked = []
def watch(event, arguments):
    if event in STARTING and arguments[:2] not in HARMLESS:
        looked.append(event + " " + str(arguments[:2]))
    if event.startswith(("open", "os.", "shutil.", "glob.", "sqlite3.")):
        looked.extend(event for argument in arguments if {key!r} in str(argument))
sys.addaudithook(watch)
try:
    open({key!r} + "/key.json")
except (FileNotFoundError, PermissionError):
    assert looked.pop() == "open"
else:
    sys.exit("the key can be read")
from dataclasses import replace
import vsr2.diagnosis
from vsr2.blind import diagnose_pack
from vsr2.diagnosis import Budget, diagnose
from vsr2.diagnosis.budget import SCHEDULE
from vsr2.diagnosis.how_far.held_out import HELD_OUT
from vsr2.ensemble.noise_floor import NOISE_FLOOR
from vsr2.posterior.network import NETWORK
from vsr2.ensemble.simulated.look import LOOK
# A rough diagnosis will do.
for constants, changes in (
    (SCHEDULE, {{"fewest": 40}}), (LOOK, {{"plain": 16, "trials": 12}}),
    (NETWORK, {{"hidden": (24, 16), "passes": 20, "batch": 256}}), (HELD_OUT, {{"members": 6}}),
    (NOISE_FLOOR, {{"most_trials": 4}}),
):
    for name, value in changes.items():
        object.__setattr__(constants, name, value)
def rough(*given, hypotheses, **how):
    offered = {{name: vsr2.effects.library()[name] for name in {names!r}}}
    out = tuple({{*hypotheses.exclude}} & {{*offered}})
    return diagnose(*given, hypotheses=replace(hypotheses, library=offered, exclude=out), **how)
vsr2.diagnosis.diagnose = rough
made = diagnose_pack(Path({data!r}), Path({out!r}), tiers=["M", "T"], budget=Budget(campaigns=40))
print(json.dumps({{"done": made.done, "failed": made.failed, "looked": looked}}))
"""

EFFECTS = ("edge_rounding", "com_offset", "vertical_motion")  # No effect goes with two of them.


def watched(key, pack, out, *prefix):
    """Diagnose a pack in a process of its own that reports whether it looked for the key."""
    code = WATCHED.format(key=str(key), data=str(pack / "data"), out=str(out), names=EFFECTS)
    done = subprocess.run([*prefix, sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    """A small pack, its key and its diagnoses, made while the key was on no disk."""
    pytest.importorskip("mujoco", reason="the blind extra installs mujoco")
    folder = tmp_path_factory.mktemp("small")
    pack, key, out = folder / "pack", folder / "key", folder / "out"
    settings = PackSettings(
        engines=("bullet", "mujoco"),
        single=(5, 1),
        none=(2, 1),
        pair=(1, 0),
        unknown=(2, 0),
        trials=40,
        motions=4,
        catalogue=4,
        sessions=2,
        effects=EFFECTS,
        replicates=4,
        signal_trials=4,
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(make_module, "catalogue", pulses)
        assert make_pack(load_study(SCENE), pack, key, settings, seed=4).campaigns == 12
    # Nothing can read what is on no disk. The diagnosis, in a process of its own, does not look for
    # it either, nor starts a process that would.
    held = {path.relative_to(key): path.read_bytes() for path in key.rglob("*.json")}
    shutil.rmtree(key)
    assert watched(key, pack, out) == {"done": 24, "failed": [], "looked": []}
    assert not key.exists()
    for path, content in held.items():
        (key / path).parent.mkdir(parents=True, exist_ok=True)
        (key / path).write_bytes(content)
    return pack, key, out


def test_a_key_that_cannot_be_read_is_not_missed(diagnosed, tmp_path) -> None:
    pack, key, out = diagnosed
    as_anybody = []
    if os.getuid() == 0:
        # Root without the right to read what is forbidden.
        as_anybody = ["setpriv", "--bounding-set", "-dac_override,-dac_read_search"]
        if subprocess.run([*as_anybody, "true"], capture_output=True).returncode:
            pytest.skip("root may not give up its rights here, and reads everything")
    again = tmp_path / "out"
    shutil.copytree(out, again)
    name = read_json(pack / "data" / "pack.json")["campaigns"][0]["id"]
    shutil.rmtree(again / name)
    key.chmod(0o000)
    try:
        found = watched(key, pack, again, *as_anybody)
    finally:
        key.chmod(0o700)
    assert found == {"done": 24, "failed": [], "looked": []}
    same = [read_json(place / name / "M" / DIAGNOSIS_FILE)["effects"] for place in (out, again)]
    assert same[0] == same[1]


def test_a_small_pack_from_end_to_end(diagnosed, tmp_path, capsys) -> None:
    pack, key, out = diagnosed
    names = [c["id"] for c in read_json(pack / "data" / "pack.json")["campaigns"]]
    found = {
        (name, tier): json.loads((out / name / tier / DIAGNOSIS_FILE).read_text())
        for name in names
        for tier in "MT"
    }
    simulated = {key: one["provenance"]["budget"]["simulated"] for key, one in found.items()}
    # Campaigns of one protocol share their simulations, but for what is named of each.
    _, *records = (out / "simulations.jsonl").read_text().splitlines()
    kept = sum(len(b64decode(json.loads(record)["keys"])) // KEY for record in records)
    assert sum(simulated.values()) == kept
    on_its_own = [name for name in names if simulated[name, "M"]]
    assert len(on_its_own) < len(names)
    # The first one simulates for all.
    assert sum(found[name, "M"]["verdict"]["kind"] == "none" for name in on_its_own) <= 1
    score = ["blind", "score", str(pack / "data"), str(key), str(out), "--out", str(tmp_path / "s")]
    assert main(score) == 2
    assert "no diagnosis at tier B" in capsys.readouterr().err
    score += ["--tier", "M", "--tier", "T"]
    assert main(score) == 0
    reported = capsys.readouterr().out
    assert "| score | M | T |" in reported
    for group in ("all", "engine bullet", "engine mujoco", "kind single", "kind none"):
        assert f"### {group}\n" in reported
    assert ", limits " in reported
    # What a diagnosis calls its estimates and intervals is what scoring reads.
    assert "| magnitude: 90 % interval holds the truth (single) |" in reported
    for name in ("scores.json", "scores.md", "reliability.png"):
        assert (tmp_path / "s" / name).exists()


def test_baselines_are_trained_on_another_pack_that_is_open(small, study, tmp_path) -> None:
    diagnose_pack(small, tmp_path / "out")
    key = tmp_path / "key"
    copied = tmp_path / "copied"
    shutil.copytree(small, copied / "data")
    shutil.copytree(key, copied / "key")
    make(study, tmp_path / "sealed", seed=2, single=2, none=1, pair=0, unknown=2)

    def scored(folder):
        training = (folder / "data", folder / "key")
        score_pack(small, key, tmp_path / "out", tmp_path / "scores", training=training)

    for folder, match in (
        (tmp_path, "another pack"), (copied, "another pack"), (tmp_path / "sealed", "a sealed pack")
    ):  # fmt: skip
        with pytest.raises(BlindError, match=match):
            scored(folder)
        assert not (key / "receipt.json").exists()
    development = tmp_path / "open"
    make(study, development, 3, single=6, none=2, pair=0, unknown=2, development=True)
    scored(development)
    assert (key / "receipt.json").exists()
