"""The diagnosis of packs from the data alone, and a small pack from end to end."""

import dataclasses
import json
import math
import os
import shutil
import subprocess
import sys
from base64 import b64decode
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import vsr2.blind
import vsr2.blind.custodian.make as make_module
from blind_samples import SCENE, QuickEngine, diagnosis, make, pulses, stand_in
from vsr2.blind import (
    PackSettings,
    diagnose_pack,
    make_pack,
    score_pack,
)
from vsr2.blind.custodian.engine import Nuisances as DrawnNuisances
from vsr2.blind.custodian.engine import TrialInput, build_engine
from vsr2.blind.custodian.make import Made
from vsr2.blind.form.diagnosis_form import DIAGNOSIS_FILE
from vsr2.blind.form.events import EventCode
from vsr2.blind.form.pack_settings import KINDS
from vsr2.blind.form.seal import folder_sha256, open_key, read_json
from vsr2.blind.mujoco import ContactModel
from vsr2.blind.pack_diagnoses import at_tier, uncertainties
from vsr2.campaign import load_campaign, save_campaign
from vsr2.cli.main import main
from vsr2.config import Study, load_study
from vsr2.diagnosis import DEFAULT_NUISANCES, Budget, with_deviations
from vsr2.diagnosis.simulated.cache import KEY
from vsr2.diagnosis.simulated.scene_simulator import SceneSimulator
from vsr2.effects import apply_effects, library
from vsr2.errors import BlindError, CampaignError, SimulationError


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


def test_a_rock_that_does_not_rest_is_placed_again(study, tmp_path, monkeypatch) -> None:
    restless = []

    class Restless(QuickEngine):
        def run(self, shakes, series_interval):
            if series_interval < 1.0 and restless and restless.pop(0):
                raise SimulationError("settling_timeout")
            return super().run(shakes, series_interval)

    monkeypatch.setattr(make_module, "build_engine", lambda *args: Restless())
    settings = PackSettings(single=0, none=2, unknown=0, pair=0, trials=20)

    def made(name, fails):
        restless[:] = fails
        make_pack(study, tmp_path / name, tmp_path / f"{name}-key", settings, seed=3)
        assert not restless
        return [folder_sha256(p) for p in sorted((tmp_path / name / "data").glob("c*"))]

    calm, moved = made("calm", [False, False]), made("moved", [True, True, False, False])
    # One of the two, drawn a third time.
    assert len(set(calm) & set(moved)) == 1
    with pytest.raises(SimulationError, match="settling_timeout"):
        made("never", [True] * 6)


def test_a_tier_hides_what_lies_beyond_it(small, tmp_path) -> None:
    progress = diagnose_pack(small, tmp_path / "out", budget=Budget(campaigns=200), seed=7)
    assert progress.done == 12
    assert progress.failed == ()
    excluded = {e["id"]: e["exclude"] for e in read_json(small / "pack.json")["campaigns"]}
    for campaign, how in Stub.calls:
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
        SceneSimulator(at_tier(complete, tier), scene, series=True, sampling=cache.sampling)
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
    last = dataclasses.replace(stronger.trials[-1], pga=1.05 * stronger.trials[-1].pga)
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
    assert read_json(failed) == {"error": "no motion"}
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
    assert "verdict.effects" in read_json(folder / "failed.json")["error"]
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
    assert said[1].values["tier"] == "B"
    wanted = "campaign.yaml: row 2, key name: must be text; put it in quotes"
    assert wanted in said[1].values["error"]
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


def test_the_command_makes_open_packs_from_a_seed_and_no_others(quick, tmp_path, capsys) -> None:
    sizes = ["--trials", "40", "--motions", "4", "--catalogue", "5", "--sessions", "3"]
    sizes += ["--replicates", "4", "--signal-trials", "8"]
    counts = ["--single", "2", "1", "--none", "1", "--pair", "0", "--unknown", "0", "--hidden", "3"]
    pack = tmp_path / "pack"
    command = ["blind", "make", str(SCENE), str(pack), "--seed", "4", *sizes, *counts]
    command += ["--engine", "mujoco", "--engine", "bullet", "--quiet"]
    assert main(command) == 2
    assert "--development" in capsys.readouterr().err
    assert main([*command, "--development"]) == 0
    assert "5 campaigns, sealed as" in capsys.readouterr().out
    # The key lies beside the pack, so that who publishes the pack keeps it.
    key = open_key(pack / "data", tmp_path / "pack-key")
    found = Counter((e["engine"], e["kind"]) for e in key["campaigns"].values())
    assert found["mujoco", "single"] == 2
    assert found["bullet", "single"] == found["mujoco", "none"] == found["bullet", "none"] == 1


def test_a_pack_needs_a_name_or_a_key(quick, tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setattr(vsr2.blind, "make_pack", lambda study, pack, key, *a, **k: made(pack, key))
    asked = []

    def made(pack, key):
        asked.append((pack, key))
        return Made(commitment="0", campaigns=0, not_drawn={}, refused={})

    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    assert main(["blind", "make", str(SCENE), "."]) == 0
    assert asked == [(Path("."), tmp_path / "here-key")]
    capsys.readouterr()
    assert main(["blind", "make", str(SCENE), "/"]) == 2
    assert "/: has no name that the key's folder could have; add --key" in capsys.readouterr().err


def test_the_command_refuses_sizes_that_no_diagnosis_takes(quick, tmp_path, capsys) -> None:
    command = ["blind", "make", str(SCENE), str(tmp_path / "pack")]
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
    command = ["blind", "make", str(SCENE), str(tmp_path), "--leave-one-out", "2", *asked]
    assert main(command) == 0
    assert seen[0].leave_one_out == 2
    counts = dict.fromkeys(KINDS, 0) | expected
    assert seen[0].counts("mujoco") == counts


def test_the_command_says_what_was_not_drawn(tmp_path, monkeypatch, capsys) -> None:
    found = Made(3, "ff", {"bullet": ["base_asperity", "wear below 0"]}, {"bullet": {"inertia": 2}})
    monkeypatch.setattr(vsr2.blind, "make_pack", lambda *args, **how: found)
    assert main(["blind", "make", str(SCENE), str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "bullet: no magnitudes from 0.5 to 6 detection limits, not drawn: base_asperity" in said
    assert "wear below 0" in said
    assert "not drawn for so many campaigns: inertia (2)" in said


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
from vsr2.diagnosis.noise_floor import NOISE_FLOOR
from vsr2.diagnosis.posterior.network import NETWORK
from vsr2.diagnosis.simulated.look import LOOK
from vsr2.effects import library
# A rough diagnosis will do: what is tested is the way from pack to scores.
for constants, changes in (
    (SCHEDULE, {{"fewest": 40}}), (LOOK, {{"plain": 16, "trials": 12}}),
    (NETWORK, {{"passes": 20}}), (HELD_OUT, {{"members": 6}}), (NOISE_FLOOR, {{"most_trials": 4}}),
):
    for name, value in changes.items():
        object.__setattr__(constants, name, value)
def rough(*given, hypotheses, **how):
    offered = {{name: library()[name] for name in {names!r}}}
    return diagnose(*given, hypotheses=replace(hypotheses, library=offered), **how)
vsr2.diagnosis.diagnose = rough
made = diagnose_pack(Path({data!r}), Path({out!r}), tiers=["M", "T"], budget=Budget(campaigns=40))
print(json.dumps({{"done": made.done, "failed": made.failed, "looked": looked}}))
"""


EFFECTS = ("edge_rounding", "restitution", "vertical_motion")


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


def test_the_scene_rocks_under_all_nuisances(study) -> None:
    # It would slide below a friction of b / h; the diagnosis' prior is exp(N(0, 0.1)).
    friction = study.contact.rock.lateral_friction * study.contact.pedestal.lateral_friction
    width, _, height = study.rock.size
    (deviation,) = (one.prior.sd for one in DEFAULT_NUISANCES if one.name == "friction")
    assert friction * math.exp(-3 * deviation) > 1.3 * width / height


def test_rocks_that_an_engine_cannot_simulate_are_refused(study, tmp_path) -> None:
    pytest.importorskip("mujoco", reason="the blind extra installs mujoco")
    turned = study.model_dump(mode="json", exclude_unset=True)
    turned["rock"]["start"] = {"mode": "pose", "position": [0.0, 0.0, 3.0]}
    with pytest.raises(BlindError, match=r"rock\.start\.mode is 'pose', but .* takes yaw"):
        build_engine("bullet", Study.model_validate(turned))
    meshed = study.model_copy(update={"rock": SimpleNamespace(shape="mesh")})
    with pytest.raises(BlindError, match=r"rock\.shape is 'mesh', but .* takes box"):
        build_engine("bullet", meshed)
    with pytest.raises(BlindError, match="not known"):
        build_engine("ode", study)
    assert build_engine("mujoco", study).static_pga == pytest.approx(9.80665 * 0.4 / 0.95)


@pytest.mark.parametrize("name", ["mujoco", "bullet"])
def test_all_nuisances_reach_the_simulation(name, study) -> None:
    if name == "mujoco":
        pytest.importorskip("mujoco", reason="the blind extra installs mujoco")
    engine = build_engine(name, study)
    time = np.arange(0.0, 2.0, 0.005)
    moved = np.cos(2 * np.pi * 0.8 * (time - 1.0)) * np.sin(np.pi * time / 2.0) ** 4
    base = TrialInput(0.005, moved * 6.0 / (np.abs(np.diff(moved, 2)).max() / 0.005**2), yaw=0.02)

    def seen(**changes):
        own = {key: changes.pop(key) for key in ("yaw", "offset", "effects") if key in changes}
        shake = dataclasses.replace(base, nuisances=DrawnNuisances(**changes), **own)
        return next(iter(engine.run([shake], 0.02)))

    plain = seen()
    assert 0.02 < plain.peak_tilt < 0.3
    assert seen().peak_tilt == plain.peak_tilt
    # Wider and lower blocks are steadier.
    assert seen(width=1.03).peak_tilt < 0.95 * plain.peak_tilt
    assert seen(height=0.97).peak_tilt < 0.95 * plain.peak_tilt
    # Before the first impact its energy does not count, later it does.
    lively, dull = (energy(seen(energy_ratio=ratio)) for ratio in (1.1, 0.8))
    assert dull < 0.9 * energy(plain) < energy(plain) < 0.95 * lively
    # At a quarter of the friction, .2, the block slides.
    slid = seen(friction=0.25)
    assert slid.peak_tilt < 0.5 * plain.peak_tilt
    assert np.abs(slid.position[-1, 0]) > 0.01 > np.abs(plain.position[-1, 0])
    for changed in (seen(depth=1.1), seen(yaw=0.05)):
        assert changed.peak_tilt != plain.peak_tilt
    # A table that does not turn is the same everywhere; this one's edge goes up and down.
    pitching = {"table_pitch": {"compliance": 0.01, "frequency": 10.0}}
    there, here = seen(effects=pitching, offset=(0.02, 0.0)), seen(effects=pitching)
    assert there.peak_tilt != pytest.approx(here.peak_tilt, rel=1e-6)


def energy(seen):
    """Sum over the rows of the squares of tilt: of how high, and how long, the block rocks."""
    return float((seen.tilt**2).sum())


@pytest.mark.parametrize("weight", [{"density": 2700.0}, {"mass": 2700.0 * 0.4 * 0.55 * 0.95}])
def test_an_obj_of_a_box_rocks_as_the_box(study, weight) -> None:
    pytest.importorskip("mujoco", reason="the blind extra installs mujoco")
    given = study.model_dump(mode="json", exclude_unset=True)
    rocks = [
        {"shape": "box", "size": [0.4, 0.55, 0.95], "density": 2700.0},
        {"shape": "mesh", "file": str(SCENE.parents[1] / "models" / "block.obj")} | weight,
    ]
    time = np.arange(0.0, 2.0, 0.005)
    moved = 0.05 * np.cos(2 * np.pi * 0.8 * (time - 1.0)) * np.sin(np.pi * time / 2.0) ** 4
    wider = DrawnNuisances(width=1.01, height=0.99)
    peaks = []
    for rock in rocks:
        engine = build_engine("mujoco", Study.model_validate(given | {"rock": rock}))
        shakes = [TrialInput(0.005, factor * moved, nuisances=wider) for factor in (1.0, 4.4)]
        peaks.append([seen.peak_tilt for seen in engine.run(shakes, 0.02)])
    assert peaks[0][1] > 0.02
    # Corners are written with five decimals of a metre, and stand in another order.
    np.testing.assert_allclose(peaks[1], peaks[0], rtol=1e-3, atol=1e-5)


def test_the_two_engines_agree_on_a_calm_trial(study) -> None:
    # Rocking in a single pulse, before responses diverge: largest tilts within 5 %.
    pytest.importorskip("mujoco", reason="the blind extra installs mujoco")
    time = np.arange(0.0, 2.0, 0.005)
    moved = np.cos(2 * np.pi * 0.8 * (time - 1.0)) * np.sin(np.pi * time / 2.0) ** 4
    peak = np.abs(np.diff(moved, 2)).max() / 0.005**2
    shakes = [TrialInput(0.005, moved * pga / peak) for pga in (3.5, 5.6)]
    study = study.model_copy(
        update={"engine": study.engine.model_copy(update={"time_step": 0.001})}
    )
    found = {
        name: [seen.peak_tilt for seen in build_engine(name, study).run(shakes, 0.02)]
        for name in ("mujoco", "bullet")
    }
    assert max(found["mujoco"][0], found["bullet"][0]) < 1e-3
    np.testing.assert_allclose(found["mujoco"][1:], found["bullet"][1:], rtol=0.05)


def test_the_contact_model_reaches_the_simulation(study) -> None:
    pytest.importorskip("mujoco", reason="the blind extra installs mujoco")
    time = np.arange(0.0, 2.0, 0.005)
    moved = np.cos(2 * np.pi * 0.8 * (time - 1.0)) * np.sin(np.pi * time / 2.0) ** 4
    shake = TrialInput(0.005, moved * 5.6 / (np.abs(np.diff(moved, 2)).max() / 0.005**2))
    engines = [
        build_engine("mujoco", study),
        build_engine("mujoco", study, ContactModel(time_constant=0.004, damping_ratio=1.2)),
    ]
    nominal, other = (next(iter(engine.run([shake], 0.02))).peak_tilt for engine in engines)
    assert other != nominal
    assert other == pytest.approx(nominal, rel=0.05)


def test_the_library_is_drawn_from(study) -> None:
    effects = build_engine("bullet", study).effects
    assert effects["restitution"].strength.null == 1.0
    assert effects["table_bandwidth"].strength.reciprocal
    assert effects["wear"].drifts
    assert [other.name for other in effects["base_slope"].others] == ["azimuth"]
    # What would act at any strength is not drawn beside it.
    strengths = {"registration": "yaw", "session": "registration_yaw"}
    assert {name: effects[name].strength.name for name in strengths} == strengths
    for name in effects:
        drawn = {other.name for other in effects[name].others}
        assert drawn == {
            p.name for p in library()[name].parameters if p.secondary and p.prior != "fixed"
        }
    assert effects["change_point"].strength.name == "slenderness_change"
    # Names and units of strengths are the same on both engines, so that one verdict fits both.
    both = build_engine("mujoco", study).effects
    for name in set(effects) & set(both):
        if name != "table_saturation":
            assert effects[name].strength.name == both[name].strength.name, name
            assert effects[name].strength.unit.replace("1", "") in (
                both[name].strength.unit.replace("1", ""),
                "",
            ), name


def test_effects_of_the_scene_act_before_those_that_are_drawn(study) -> None:
    own = {"table_gain": {"change": 0.1}, "restitution": {"energy_ratio": 0.8}}
    bare = build_engine("bullet", study)
    engine = build_engine("bullet", study.model_copy(update={"effects": own}))
    time = np.arange(0.0, 2.0, 0.005)
    moved = np.cos(2 * np.pi * 0.8 * (time - 1.0)) * np.sin(np.pi * time / 2.0) ** 4
    base = TrialInput(0.005, moved * 5.6 / (np.abs(np.diff(moved, 2)).max() / 0.005**2))

    def seen(of, ratio=1.0, **effects):
        nuisances = DrawnNuisances(energy_ratio=ratio)
        shake = dataclasses.replace(base, nuisances=nuisances, effects=effects)
        return next(iter(of.run([shake], 0.02)))

    assert seen(engine).peak_tilt == seen(bare, **own).peak_tilt != seen(bare).peak_tilt
    # The nuisance is relative to the scene's ratio, and a drawn ratio takes its place.
    assert energy(seen(engine, 0.9)) == pytest.approx(energy(seen(bare, 0.9, **own)))
    assert engine.effects["restitution"].strength.null == 0.8
    drawn = {"table_gain": {"change": 0.05}, "restitution": {"energy_ratio": 0.9}}
    both = {"table_gain": {"change": 1.1 * 1.05 - 1}, "restitution": {"energy_ratio": 0.9}}
    assert seen(engine, **drawn).peak_tilt == pytest.approx(seen(bare, **both).peak_tilt)
    pitching = {"table_pitch": {"compliance": 0.01}}
    engine = build_engine("bullet", study.model_copy(update={"effects": pitching}))
    assert set(bare.effects) - set(engine.effects) == {"table_pitch"}


def test_draws_of_the_scene_are_no_draws_of_the_custodian(study) -> None:
    turned = study.model_copy(update={"effects": {"placement": {"yaw": 5.0}}})
    shake = TrialInput(0.005, np.zeros(100))

    def yaws(number: int) -> list[float]:
        context = dataclasses.replace(shake.context, campaign_seed=number)
        inputs = [dataclasses.replace(shake, context=context)] * 4
        made = build_engine("bullet", turned)._trials(inputs, DrawnNuisances(), 0.02)
        drawn = apply_effects(made, {"placement": {"yaw": 5.0}}, seed=number)
        assert len({one.values for trial in drawn for one in trial.effects}) == 8
        return [dict(one.values)["yaw"] for trial in made for one in trial.effects]

    assert yaws(1) == yaws(1) != yaws(2)


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


def test_a_diagnosis_takes_its_uncertainties_from_the_published_tolerances() -> None:
    found = uncertainties(
        {"width": 0.03, "height": 0.04, "friction": 0.05, "yaw": math.radians(2), "offset": 0.003,
         "input_gain": [0.004, 0.004], "energy_ratio": 0.015}
    )  # fmt: skip
    assert found == pytest.approx(
        {"slenderness": 0.05, "inertia": 0.16, "friction": 0.05, "yaw": 2.0, "offset": 0.003,
         "trial_gain": 0.004, "restitution": 0.015}
    )  # fmt: skip
    assert uncertainties({}) == {}
    with_deviations(found)
