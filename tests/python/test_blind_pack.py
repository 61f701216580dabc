"""The custodian: what it draws and seals, and how it continues."""

import dataclasses
import json
import math
import shutil
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

import vsr2.blind.custodian.pack_making as make_module
from blind_samples import SCENE, SMALL, QuickEngine, make, protocol, same_folders
from vsr2.blind import PackSettings, make_pack
from vsr2.blind.custodian.bullet_engine import BULLET_ENGINE
from vsr2.blind.custodian.campaign_recording import RECORDING, recorded_campaign
from vsr2.blind.custodian.design import DESIGN, draw_inputs
from vsr2.blind.custodian.plan import Planned
from vsr2.blind.form.seal import canonical, commitment, folder_sha256, open_key, read_json
from vsr2.blind.mujoco import Response, draw_contact
from vsr2.blind.mujoco.contact_models import FAMILY
from vsr2.blind.mujoco.driven_table import DRIVEN_TABLE
from vsr2.blind.mujoco.ground import GROUND, acceleration_of
from vsr2.blind.mujoco.model import MODEL
from vsr2.blind.mujoco.mujoco_effects import ROUGH_BASE
from vsr2.blind.mujoco.mujoco_trial import TRIAL
from vsr2.blind.mujoco.rigid_body import HULL
from vsr2.blind.mujoco.step_actions import MECHANISMS
from vsr2.campaign import (
    check_campaign,
    load_campaign,
)
from vsr2.config import Study, load_study
from vsr2.ensemble.simulated.hypotheses import HYPOTHESIS
from vsr2.ensemble.simulated.motion_noise import MOTION_NOISE
from vsr2.errors import BlindError
from vsr2.simulation.run_constants import run_constants


def test_a_commitment_is_the_hash_of_salt_and_key() -> None:
    import hashlib

    text = b'\x0a\xff{"a":[1,2.5],"b":"c"}'
    assert commitment("0aff", {"b": "c", "a": [1, 2.5]}) == hashlib.sha256(text).hexdigest()
    assert canonical({"b": 1, "a": 2}) == canonical({"a": 2, "b": 1})
    with pytest.raises(BlindError, match="finite"):
        canonical({"a": math.nan})


def test_a_pack_is_what_was_asked(quick, study, tmp_path) -> None:
    made = make(study, tmp_path)
    data = tmp_path / "data"
    key = open_key(data, tmp_path / "key")
    kinds = Counter(entry["kind"] for entry in key["campaigns"].values())
    assert kinds == {"single": 6, "none": 3, "pair": 2, "unknown": 3}
    assert made.campaigns == 14
    assert made.commitment == read_json(data / "pack.json")["commitment"]["sha256"]
    for name, entry in key["campaigns"].items():
        assert check_campaign(data / name) == []
        assert len(entry["effects"]) == {"none": 0, "pair": 2}.get(entry["kind"], 1)
        for effect in entry["effects"]:
            assert 0.499 <= effect["relative"] <= 6.001
    # A load and a diagnosis need the nominal scene, without the folder that it came from.
    assert load_study(data / "scene.yaml").rock == study.rock


def test_a_pack_has_a_contact_model_of_its_own_that_is_sealed(quick, study, tmp_path) -> None:
    found = []
    for development in (False, True):
        folder = tmp_path / str(development)
        make(study, folder, seed=4, single=0, none=1, pair=0, unknown=0, development=development)
        rng = np.random.default_rng([4, 403])
        drawn = dataclasses.asdict(draw_contact(rng, development=development))
        found.append(open_key(folder / "data", folder / "key")["contact"])
        assert found[-1] == json.loads(json.dumps(drawn))
    assert found[0] != found[1]


def test_the_constants_that_a_pack_rests_on_are_sealed(quick, study, tmp_path) -> None:
    make(study, tmp_path, single=0, none=1, pair=0, unknown=0)
    sealed = open_key(tmp_path / "data", tmp_path / "key")["constants"]
    used = {
        "design": DESIGN, "ground_motion": GROUND, "contact_family": FAMILY,
        "mechanisms": MECHANISMS, "mujoco_hull": HULL, "mujoco_model": MODEL,
        "mujoco_rough_base": ROUGH_BASE, "mujoco_table": DRIVEN_TABLE, "mujoco_trial": TRIAL,
        "bullet": BULLET_ENGINE, "recording": RECORDING, "making": make_module.MAKING,
        "hypotheses": HYPOTHESIS, "motion_noise": MOTION_NOISE,
    }  # fmt: skip
    stated = {k: dataclasses.asdict(v) for k, v in used.items()} | run_constants()
    assert sealed == json.loads(json.dumps(stated))


def test_campaigns_of_a_protocol_share_their_motions(quick, study, tmp_path) -> None:
    make(study, tmp_path, protocols=2, reference=1)
    data = tmp_path / "data"
    key = open_key(data, tmp_path / "key")
    assert set(key["motions_sha256"]) == {"motions1", "motions2"}
    for name, entry in key["campaigns"].items():
        assert not (data / name / "motions").exists()
        text = (data / name / "campaign.yaml").read_text()
        assert f"motions: ../motions{entry['protocol'] + 1}\n" in text
        if entry["effects"]:
            assert 0 <= entry["flips"] <= 1
    scene = load_study(data / "scene.yaml")
    assert scene.motion.mode == "all_recordings"
    assert (scene.motion.filter.low, scene.motion.filter.high) == (0.1, 25.0)
    (open_one,) = [e for e in read_json(data / "pack.json")["campaigns"] if "kind" in e]
    assert key["campaigns"][open_one["id"]]["kind"] == open_one["kind"] == "reference"
    assert open_one["exclude"] == []


def test_each_trial_and_campaign_has_its_own_nuisances(quick, study, tmp_path) -> None:
    settings = PackSettings(**SMALL | {"trials": 100})
    rng, drawn = np.random.default_rng(0), protocol(settings)
    campaigns = [draw_inputs(rng, drawn, settings) for _ in range(40)]
    own = [one for _, inputs in campaigns for one in inputs]
    off = []
    for error, inputs in campaigns:
        for one, motion, row in zip(inputs, drawn.motions, drawn.rows, strict=True):
            peak = np.abs(one.displacement).max() / np.abs(motion.displacement).max()
            off.append((peak / row.peak_acceleration - 1) / error)
    tolerances = settings.tolerances
    for values, expected in (
        ([one.yaw for one in own], tolerances.yaw),
        ([one.offset[0] for one in own], tolerances.offset),
        ([one.offset[1] for one in own], tolerances.offset),
        (off, 1.0),
    ):
        # The standard error of a standard deviation of 4000 draws is 1.1 %.
        assert np.std(values) == pytest.approx(expected, rel=0.05)
        assert np.mean(values) == pytest.approx(0, abs=0.07 * expected)
    make(study, tmp_path, trials=24)
    entries = open_key(tmp_path / "data", tmp_path / "key")["campaigns"].values()
    for name, (low, high) in {"input_gain": tolerances.input_gain, "width": (0.97, 1.03)}.items():
        drawn = [entry["nuisances"][name] for entry in entries]
        assert len(set(drawn)) > 10
        assert low <= min(drawn) < 0.6 * low + 0.4 * high < max(drawn) <= high


def test_series_have_the_noise_that_is_published(quick, study, tmp_path) -> None:
    make(study, tmp_path, single=0, none=2, unknown=0, pair=0, trials=24)
    tolerances = PackSettings().tolerances
    for folder in sorted((tmp_path / "data").glob("c*")):
        series = [trial.series for trial in load_campaign(folder).trials]
        # The quick engine's rock neither travels nor turns.
        turned = np.concatenate([2 * one.orientation[1:, :3] for one in series])
        moved = np.concatenate([one.position[1:] for one in series])
        for values, expected in (
            (turned, tolerances.orientation_noise), (moved, tolerances.position_noise)
        ):  # fmt: skip
            np.testing.assert_allclose(values.std(axis=0), expected, rtol=0.1)


def test_trials_are_shaken_off_the_recorded_motion_by_what_is_sealed(tmp_path) -> None:
    settings = PackSettings(**(SMALL | {"trials": 400, "series_interval": 0.0}))
    drawn = protocol(settings)
    gains, reported = [], []

    class Watching(QuickEngine):
        def run(self, shakes, series_interval):
            given = list(shakes)
            peaks = [np.abs(shake.displacement).max() for shake in given]
            recorded = [
                np.abs(motion.displacement).max() * row.peak_acceleration
                for motion, row in zip(drawn.motions, drawn.rows, strict=True)
            ]
            gains.append(np.array(peaks) / recorded - 1)
            return super().run(given, series_interval)

    for index in range(6):
        planned = Planned(index, f"c{index}", "none", "mujoco", 0)
        entry = make_module._campaign(tmp_path, planned, Watching(), drawn, settings, 7)
        reported.append(entry["nuisances"]["input_gain"])
    assert max(reported) > 1.5 * min(reported)
    # The standard error of a standard deviation of 400 draws is 3.5 %.
    np.testing.assert_allclose([gain.std() for gain in gains], reported, rtol=0.15)


def test_records_and_tilts_have_the_noise_that_is_published() -> None:
    settings = PackSettings(**(SMALL | {"trials": 40, "series_interval": 0.0}))
    drawn = protocol(settings)
    off = {"displacement": [], "acceleration": []}
    for row, motion, record in zip(drawn.rows, drawn.motions, drawn.records.values(), strict=True):
        moved = motion.displacement * row.peak_acceleration
        off["displacement"].append(record.displacement - moved)
        off["acceleration"].append(record.acceleration - acceleration_of(moved, motion.interval))
    seen = [Response(False, 0.5, *[np.zeros(0)] * 4)] * len(drawn.rows)
    campaigns = [
        recorded_campaign("c", drawn, seen, settings, np.random.default_rng(i)) for i in range(50)
    ]
    off["peak_tilt"] = [[trial.peak_tilt - 0.5 for trial in c.trials] for c in campaigns]
    for name, errors in off.items():
        # 2000 draws or more: 1.6 % of a standard deviation, and 1e-5 of digits beside 5e-4
        reported = getattr(campaigns[0].noise, name)
        assert np.concatenate(errors).std() == pytest.approx(reported, rel=0.06), name


def test_a_finished_pack_is_not_sealed_again(quick, study, tmp_path, monkeypatch) -> None:
    made = make(study, tmp_path)
    files = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    # Another day, another Python: the hash may long be published.
    monkeypatch.setattr(make_module.platform, "python_version", lambda: "9.9.9")
    assert make(study, tmp_path) == made
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == files
    campaign = next(path for path in files if path.name == "trials.csv")
    campaign.write_bytes(files[campaign] + b"\n")
    with pytest.raises(BlindError, match=campaign.parent.name):
        make(study, tmp_path)
    campaign.write_bytes(files[campaign])
    (tmp_path / "key" / "key.json").unlink()
    with pytest.raises(BlindError, match=r"the pack is finished but key\.json is gone"):
        make(study, tmp_path)


def test_an_effect_acts_where_outcomes_or_tilts_change() -> None:
    def seen(overturned, tilt):
        none = np.zeros(0)
        return Response(overturned, tilt, none, none, none, none)

    change = make_module._change
    assert change(seen(False, 0.1), seen(False, 0.2)) == pytest.approx(math.log(2), abs=1e-4)
    # What fell is seen as far as 1.2 rad, what stood still as 1 mrad.
    assert change(seen(True, 1.5), seen(False, 0.6)) == pytest.approx(1 + math.log(2), abs=1e-4)
    assert change(seen(False, 1e-6), seen(False, 1e-5)) == 0


@pytest.mark.parametrize("where", ["pack", "key"])
def test_folders_that_cannot_be_made_begin_nothing(quick, study, tmp_path, where) -> None:
    (tmp_path / "file").write_text("")
    folders = {"pack": tmp_path / "pack", "key": tmp_path / "key"} | {where: tmp_path / "file"}
    with pytest.raises(BlindError, match="no folder can be made there"):
        make_pack(study, *folders.values(), PackSettings(**SMALL))
    assert not list(tmp_path.rglob("custodian.json"))


def test_a_negative_seed_begins_nothing(quick, study, tmp_path) -> None:
    with pytest.raises(BlindError, match="seed is -4; give 0 or more"):
        make(study, tmp_path / "new", seed=-4)
    assert not (tmp_path / "new").exists()


def test_the_key_is_its_owners(quick, study, tmp_path) -> None:
    make(study, tmp_path)
    assert (tmp_path / "key").stat().st_mode & 0o077 == 0
    for path in (tmp_path / "key").rglob("*.json"):
        assert path.stat().st_mode & 0o077 == 0


def test_the_key_may_not_lie_in_the_data(quick, study, tmp_path) -> None:
    with pytest.raises(BlindError, match="keep the key apart"):
        make_pack(study, tmp_path, tmp_path / "data" / "key", PackSettings(**SMALL))


def test_a_data_folder_is_no_place_for_a_pack(quick, study, tmp_path) -> None:
    make(study, tmp_path)
    with pytest.raises(BlindError, match="it is the data folder of a pack"):
        make_pack(study, tmp_path / "data", tmp_path / "key2", PackSettings(**SMALL))
    before = folder_sha256(tmp_path / "data")
    inside = next((tmp_path / "data").glob("c*")) / "inner"
    for pack, key in (
        (inside, tmp_path / "key2"),
        (tmp_path / "other", tmp_path / "data" / "key2"),
    ):
        with pytest.raises(BlindError, match=r"data holds a pack.json, .* choose a folder outside"):
            make_pack(study, pack, key, PackSettings(**SMALL))
    assert folder_sha256(tmp_path / "data") == before
    assert not (tmp_path / "key2").exists()
    assert not (tmp_path / "other").exists()


def test_a_killed_pack_is_continued(quick, study, tmp_path, monkeypatch) -> None:
    uncut = make(study, tmp_path / "uncut")
    write, calls = make_module.save_campaign, []

    def stopped(*args, **how):
        calls.append(args)
        if len(calls) == 5:
            raise KeyboardInterrupt
        return write(*args, **how)

    monkeypatch.setattr(make_module, "save_campaign", stopped)
    with pytest.raises(KeyboardInterrupt):
        make(study, tmp_path / "parts")
    assert not (tmp_path / "parts" / "data" / "pack.json").exists()
    with pytest.raises(BlindError, match="continue it"):
        make(study, tmp_path / "parts", single=5)
    with pytest.raises(BlindError, match="another seed"):
        make(study, tmp_path / "parts", seed=2)
    continued = make(study, tmp_path / "parts")
    assert len(calls) == 5 + 10
    assert continued.commitment == uncut.commitment
    assert same_folders(tmp_path / "uncut" / "data", tmp_path / "parts" / "data")


KILLED = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, {tests!r})
import vsr2.campaign.save as save
import test_blind_pack as tests

def dying(function, place, count):
    calls = []
    def died(*arguments):
        if place in str(arguments[-1]):
            calls.append(arguments)
            if len(calls) == count:
                os.kill(os.getpid(), signal.SIGKILL)
        return function(*arguments)
    return died

if {place!r} == "rename":
    Path.rename = dying(Path.rename, "", 3)
elif {place!r}:
    os.replace = dying(os.replace, {place!r}, {{"steps.json": 20}}.get({place!r}, 1))
else:
    save.trials_table = dying(save.trials_table, "", 5)
tests.make_module.build_engine = lambda *given: tests.QuickEngine()
tests.make(tests.load_study(tests.SCENE), Path({pack!r}))
"""


@pytest.mark.parametrize("place", ["custodian.json", "steps.json", "", "rename", "pack.json"])
def test_a_pack_whose_maker_was_killed_is_continued(quick, study, tmp_path, place) -> None:
    # As it writes its state, the 20th measurement (limits are 11, draws the rest), the fifth
    # campaign, the third in its last place, and the last file.
    uncut = make(study, tmp_path / "uncut")
    parts = tmp_path / "parts"
    code = KILLED.format(tests=str(Path(__file__).parent), place=place, pack=str(parts))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == -signal.SIGKILL, done.stderr
    left = [path.name for path in parts.rglob(".*.tmp")]
    assert len(left) == 1
    assert not (parts / "data" / "pack.json").exists()
    assert make(study, parts).commitment == uncut.commitment
    assert same_folders(tmp_path / "uncut", parts)
    assert not list(parts.rglob(".*"))


def test_a_model_is_sealed_with_its_scene(quick, study, tmp_path) -> None:
    model = tmp_path / "rock.obj"
    shutil.copyfile(SCENE.parents[1] / "models" / "block.obj", model)
    content = study.model_dump(mode="json", exclude_unset=True)
    content["rock"] = {"shape": "mesh", "file": str(model), "density": 2700.0}
    scanned = Study.model_validate(content)
    make(scanned, tmp_path)
    data = tmp_path / "data"
    assert load_study(data / "scene.yaml").rock.file.read_bytes() == model.read_bytes()
    open_key(data, tmp_path / "key")
    model.write_text(model.read_text() + "# changed\n")
    with pytest.raises(BlindError, match="another model_sha256"):
        make(scanned, tmp_path)
    shutil.copyfile(model, data / "model.obj")
    with pytest.raises(BlindError, match="differs from the sealed model"):
        open_key(data, tmp_path / "key")


def test_packs_of_two_forms_are_not_mixed(quick, study, tmp_path) -> None:
    make(study, tmp_path)
    state = tmp_path / "key" / "custodian.json"
    content = read_json(state)
    assert content.pop("form")
    state.write_text(json.dumps(content))
    with pytest.raises(BlindError, match="another form"):
        make(study, tmp_path)


def test_a_seed_of_the_system_is_kept_and_new_each_time(quick, study, tmp_path) -> None:
    settings = PackSettings(**SMALL, single=1, none=0, pair=0, unknown=0)
    packs = [make_pack(study, tmp_path / n, tmp_path / n / "key", settings) for n in "ab"]
    assert packs[0].commitment != packs[1].commitment
    again = make_pack(study, tmp_path / "a", tmp_path / "a" / "key", settings)
    assert again.commitment == packs[0].commitment


def test_the_unknowns_class_is_excluded_and_so_is_a_decoys(quick, study, tmp_path) -> None:
    make(study, tmp_path, single=10, unknown=8)
    key = open_key(tmp_path / "data", tmp_path / "key")
    for entry in key["campaigns"].values():
        names = {effect["name"] for effect in entry["effects"]}
        assert entry["exclude"]
        assert names <= set(entry["exclude"]) if entry["kind"] == "unknown" else True
        if entry["kind"] != "unknown":
            assert not names & set(entry["exclude"])
    hidden = [e for e in key["campaigns"].values() if "table_gain" in e["exclude"]]
    alike = {"slenderness", "table_gain", "table_pitch", "input_channel", "table_resonance"}
    assert all(alike <= set(e["exclude"]) for e in hidden)


def test_each_effect_is_left_out_in_turn(quick, study, tmp_path) -> None:
    make(study, tmp_path, single=0, none=0, pair=0, unknown=0, leave_one_out=2)
    key = open_key(tmp_path / "data", tmp_path / "key")
    names = Counter(entry["effects"][0]["name"] for entry in key["campaigns"].values())
    assert names == dict.fromkeys(QuickEngine.effects, 2)
    assert {entry["kind"] for entry in key["campaigns"].values()} == {"unknown"}


def test_settings_are_checked() -> None:
    for change, message in (
        ({"engines": ("ode",)}, "engines are ode"),
        ({"single": -1}, "single is -1"),
        ({"motions": 30}, "motions is 30"),
        ({"sessions": 0}, "sessions is 0"),
        ({"single": (3, 4)}, "one number for each of mujoco"),
        ({"protocols": 0}, "protocols is 0"),
        ({"replicates": 1}, "replicates is 1"),
        ({"series_interval": 0.0015}, "series_interval"),
        ({"single": 0, "none": 0, "pair": 0, "unknown": 0}, "no campaign"),
    ):
        with pytest.raises(BlindError, match=message):
            PackSettings(**change)
    settings = PackSettings(effects=("wear",), engines=("bullet",))
    assert (
        TypeAdapter(PackSettings).validate_python(json.loads(json.dumps(settings.to_json())))
        == settings
    )


def test_a_published_seed_draws_the_campaigns_again(quick, study, tmp_path) -> None:
    make(study, tmp_path / "one", seed=None)
    key = read_json(tmp_path / "one" / "key" / "key.json")["key"]
    make(study, tmp_path / "two", seed=int(key["seed"]))
    names = sorted(key["campaigns"])
    data = [tmp_path / folder / "data" for folder in ("one", "two")]
    assert [[folder_sha256(d / name) for name in names] for d in data] == 2 * [
        [key["campaigns"][name]["data_sha256"] for name in names]
    ]
    # The salt of a sealed pack does not follow from its seed, so that its hash gives nothing away.
    sealed = [read_json(d / "pack.json")["commitment"]["sha256"] for d in data]
    assert sealed[0] != sealed[1]
