"""The custodian: what it draws, seals and does not leak; the diagnosis from the data alone."""

import contextlib
import csv
import json
import math
import shutil
import signal
import sqlite3
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import vsr2.blind.make as make_module
from blind_samples import QuickEngine, diagnosis
from vsr2.blind import PackSettings, diagnose_pack, make_pack, score_pack
from vsr2.blind.baselines import (
    BASELINES,
    baseline_cases,
    logistic_in_pga,
    overturn_rate,
    rate_alone,
)
from vsr2.blind.cases import Case
from vsr2.blind.design import catalogue, draw_protocol
from vsr2.blind.diagnose import at_tier, uncertainties
from vsr2.blind.engines import build_engine
from vsr2.blind.floor import Floor, FloorMeter
from vsr2.blind.mujoco import GroundMotion
from vsr2.blind.plan import directions, draw_plan
from vsr2.blind.score import top_one
from vsr2.blind.seal import canonical, commitment, folder_sha256, open_key, read_json
from vsr2.blind.settings import KINDS
from vsr2.blind.shake import Drawable, Observed, Shake, Strength
from vsr2.blind.verdict import DIAGNOSIS_FILE, Verdict
from vsr2.blind.write import written_campaign
from vsr2.campaign import (
    Campaign,
    CampaignTrial,
    Specimen,
    check_campaign,
    load_campaign,
    save_campaign,
)
from vsr2.cli.main import main
from vsr2.config import Study, load_study
from vsr2.diagnosis import Nuisances
from vsr2.diagnosis.scene_simulator import SceneSimulator
from vsr2.errors import BlindError, CampaignError, SimulationError

SCENE = Path(__file__).resolve().parents[2] / "configs" / "blind.yaml"
SMALL = {"trials": 12, "motions": 4, "sessions": 3, "catalogue": 5, "floor_trials": 8}


@pytest.fixture(scope="module")
def study():
    return load_study(SCENE)


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(make_module, "build_engine", lambda name, study: QuickEngine())


def make(study, folder, seed=1, **changes):
    settings = PackSettings(**(SMALL | {"single": 6, "none": 3, "pair": 2, "unknown": 3} | changes))
    return make_pack(study, folder, folder / "key", settings, seed=seed)


def protocol(settings):
    rng = np.random.default_rng(3)
    return draw_protocol(rng, catalogue(3, settings.catalogue), [6.0] * 5, settings)


def same_folders(one, two):
    return folder_sha256(one) == folder_sha256(two)


# --- sealing ------------------------------------------------------------------------------------


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


def test_the_key_is_its_owners(quick, study, tmp_path) -> None:
    make(study, tmp_path)
    assert (tmp_path / "key").stat().st_mode & 0o077 == 0
    for path in (tmp_path / "key").rglob("*.json"):
        assert path.stat().st_mode & 0o077 == 0


def test_the_key_may_not_lie_in_the_data(quick, study, tmp_path) -> None:
    with pytest.raises(BlindError, match="keep the key apart"):
        make_pack(study, tmp_path, tmp_path / "data" / "key", PackSettings(**SMALL))


def test_a_killed_pack_is_continued(quick, study, tmp_path, monkeypatch) -> None:
    whole = make(study, tmp_path / "whole")
    write, calls = make_module.save_campaign, []

    def stopped(*args):
        calls.append(args)
        if len(calls) == 5:
            raise KeyboardInterrupt
        return write(*args)

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
    assert continued.commitment == whole.commitment
    assert same_folders(tmp_path / "whole" / "data", tmp_path / "parts" / "data")


KILLED = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, {tests!r})
import vsr2.campaign.folder as folder
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

if {place!r}:
    os.replace = dying(os.replace, {place!r}, 1)
else:
    folder._table = dying(folder._table, "", 5)
tests.make_module.build_engine = lambda name, study: tests.QuickEngine()
tests.make(tests.load_study(tests.SCENE), Path({pack!r}))
"""


@pytest.mark.parametrize("place", ["custodian.json", "", "pack.json"])
def test_a_pack_whose_maker_was_killed_is_continued(quick, study, tmp_path, place) -> None:
    # As it writes its state, the fifth campaign, and the last file of all.
    whole = make(study, tmp_path / "whole")
    parts = tmp_path / "parts"
    code = KILLED.format(tests=str(Path(__file__).parent), place=place, pack=str(parts))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == -signal.SIGKILL, done.stderr
    left = [path.name for path in parts.rglob(".*.tmp")]
    assert len(left) == 1
    assert not (parts / "data" / "pack.json").exists()
    assert make(study, parts).commitment == whole.commitment
    assert same_folders(tmp_path / "whole", parts)
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
    assert all(e["exclude"] == ["slenderness", "table_gain", "table_pitch"] for e in hidden)


def test_each_effect_is_left_out_in_turn(quick, study, tmp_path) -> None:
    make(study, tmp_path, single=0, none=0, pair=0, unknown=0, leave_one_out=2)
    key = open_key(tmp_path / "data", tmp_path / "key")
    names = Counter(entry["effects"][0]["name"] for entry in key["campaigns"].values())
    assert names == dict.fromkeys(QuickEngine.effects, 2)
    assert {entry["kind"] for entry in key["campaigns"].values()} == {"unknown"}


def test_the_floor_is_where_signal_over_noise_is_three(study) -> None:
    settings = PackSettings(**SMALL)
    meter = FloorMeter(QuickEngine(), protocol(settings), settings, 3)
    effect = QuickEngine.effects["table_gain"]
    floor = meter.floor(effect, 1)
    assert meter.signal(effect, floor.magnitude) == pytest.approx(3.0, rel=0.3)
    assert meter.signal(effect, 0.0) == 0.0
    assert meter.signal(effect, 4 * floor.magnitude) > 6.0


class DeafEngine(QuickEngine):
    def run(self, shakes, series_interval):
        for shake in shakes:
            yield from super().run([replace(shake, effects={})], series_interval)


def test_an_effect_that_nobody_can_see_has_no_floor(study) -> None:
    settings = PackSettings(**SMALL)
    meter = FloorMeter(DeafEngine(), protocol(settings), settings, 3)
    assert meter.floor(QuickEngine.effects["wear"], 1).magnitude == math.inf


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
    assert PackSettings.from_json(json.loads(json.dumps(settings.to_json()))) == settings


# --- leaks --------------------------------------------------------------------------------------


class UnevenEngine(QuickEngine):
    """Ends a trial when effects have it, on a step of its own; what overturns falls flat."""

    def run(self, shakes, series_interval):
        for shake in shakes:
            seen = next(iter(super().run([shake], series_interval)))
            length = (shake.displacement.size - 1) * shake.interval
            length += 0.2 * sum(1 + list(self.effects).index(name) for name in shake.effects)
            time = np.arange(0.0, length, 1.03 * series_interval)
            tilt = seen.peak_tilt * np.sin(np.pi * time / length)
            if seen.overturned:
                tilt = 1.5 * (time / length) ** 2
            turned = np.stack([0 * time, np.sin(tilt / 2), 0 * time, np.cos(tilt / 2)], axis=1)
            yield Observed(
                seen.overturned,
                max(seen.peak_tilt, tilt.max()),
                time,
                tilt,
                np.outer(tilt, [0.3, 0.2, 0.1]),
                turned,
            )


@pytest.fixture
def uneven(monkeypatch):
    monkeypatch.setattr(make_module, "build_engine", lambda name, study: UnevenEngine())


def structure(folder):
    """All that a campaign's files say apart from what was measured, and its name."""
    files = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*"))
    stamps = {p.stat().st_mtime for p in [folder, *folder.rglob("*")]}
    lines = (folder / "campaign.yaml").read_text().splitlines()
    with open(folder / "trials.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    arrays = {}
    for path in sorted(folder.rglob("*.npz")):
        with np.load(path) as content:
            arrays[path.parent.name] = sorted((k, v.dtype.str, v.ndim) for k, v in content.items())
    fixed = [
        [value for key, value in row.items() if key not in ("overturned", "peak_tilt_rad")]
        for row in rows
    ]
    return {
        "files": files,
        "stamps": stamps,
        "description": [line for line in lines if not line.startswith("name:")],
        "columns": list(rows[0]),
        "fixed": fixed,
        "arrays": arrays,
    }


def standing_times(campaign):
    """Times of the series, by trial, of rocks that did not fall."""
    return {t.trial: t.series.time for t in campaign.trials if t.peak_tilt < 1.1}


def on_one_clock(campaigns):
    """Whether all series are sampled at the same times, but for rocks that fell."""
    clock = {}
    for campaign in campaigns:
        for trial, time in standing_times(campaign).items():
            clock.setdefault(trial, time)
            np.testing.assert_array_equal(time, clock[trial], err_msg=f"{campaign.name} {trial}")
    return clock


def same_rounded(values, decimals):
    np.testing.assert_array_equal(np.round(values, decimals), values)


def test_campaigns_differ_in_what_was_measured_alone(uneven, study, tmp_path) -> None:
    make(study, tmp_path)
    data = tmp_path / "data"
    key = open_key(data, tmp_path / "key")
    shapes = {name: structure(data / name) for name in key["campaigns"]}
    first = next(iter(shapes.values()))
    assert all(shape == first for shape in shapes.values())
    assert len(first["stamps"]) == 1
    campaigns = [load_campaign(data / name) for name in key["campaigns"]]
    assert len(on_one_clock(campaigns)) > 4
    fallen = []
    for name, campaign in zip(key["campaigns"], campaigns, strict=True):
        assert campaign.name == name
        assert not campaign.provenance
        assert not campaign.description
        assert all(not trial.note and trial.date is None for trial in campaign.trials)
        for trial in campaign.trials:
            record, series = campaign.record(trial), trial.series
            same_rounded([trial.peak_tilt, trial.pgv_pga], 5)
            for values in (series.time, series.tilt, series.position):
                same_rounded(values, 6)
            same_rounded(series.orientation, 7)
            same_rounded(record.displacement, 8)
            same_rounded(record.acceleration, 5)
            # 1.2 rad and five standard errors: whichever engine let it fall, and how far.
            assert max(trial.peak_tilt, series.tilt.max()) < 1.2 + 5 * 0.0005
            if trial.peak_tilt > 1.1:
                fallen.append(float(series.tilt[-1]))
    assert len(fallen) > 10
    assert min(fallen) > 1.1


def test_series_of_either_engine_end_on_one_clock(study, tmp_path) -> None:
    pytest.importorskip("mujoco", reason="the blind extra installs mujoco")
    settings = PackSettings(trials=4, motions=2, sessions=1, catalogue=2)
    motions = pulses(1, 2)
    drawn = draw_protocol(np.random.default_rng(3), motions, [5.5] * 2, settings)
    campaigns = []
    for engine in (build_engine(name, study) for name in ("bullet", "mujoco")):
        for name in (None, "table_bandwidth", "time_scale", "table_saturation", "table_resonance"):
            acting = {}
            if name is not None:
                effect = engine.effects[name]
                sign, (_, most) = next(iter(effect.strength.reach().items()))
                acting = {name: effect.values(sign * most, [0.5] * len(effect.others))}
            shakes = [
                Shake(motion.interval, motion.displacement * row.pga, acting)
                for row, motion in zip(drawn.rows, drawn.motions, strict=True)
            ]
            seen = list(engine.run(shakes, settings.series_interval))
            rng = np.random.default_rng(1)
            campaigns.append(written_campaign(str(name), drawn, seen, settings, rng))
            # The camera runs on until the rock stands still.
            for trial in campaigns[-1].trials:
                assert trial.peak_tilt > 1.1 or abs(trial.series.tilt[-50:]).max() < 0.005
    # 1.195 s of motion and 3 s.
    times = on_one_clock(campaigns)
    assert len(times) == 4
    for time in times.values():
        np.testing.assert_array_equal(time, np.round(0.02 * np.arange(210), 6))
    # The last of these times over 209 is not 0.02.
    save_campaign(campaigns[0], tmp_path / "c")
    assert "series_interval_s: 0.02\n" in (tmp_path / "c" / "campaign.yaml").read_text()


def test_ids_tell_neither_kind_nor_order(quick, study, tmp_path) -> None:
    make(study, tmp_path, single=8, none=8, pair=0, unknown=0)
    key = open_key(tmp_path / "data", tmp_path / "key")
    kinds = [key["campaigns"][name]["kind"] for name in sorted(key["campaigns"])]
    # Sorted by kind is 1 of 6435 arrangements.
    assert kinds not in (sorted(kinds), sorted(kinds, reverse=True))
    text = (tmp_path / "data" / "pack.json").read_text()
    assert "single" not in text
    assert "seed" not in text


def test_what_may_not_be_used_does_not_tell_the_kind() -> None:
    # Kind, exclude, protocol and place in the list of 900 campaigns: independent.
    from scipy.stats import chi2_contingency, kruskal

    settings = PackSettings(single=0, none=450, pair=0, unknown=450, protocols=3, hidden=4)
    floors = {("mujoco", name, 1): Floor(0.05, ()) for name in QuickEngine.effects}
    plan = draw_plan(5, settings, {"mujoco": QuickEngine.effects}, floors)
    assert len({p.exclude for p in plan}) == 4
    for trait in ("exclude", "protocol"):
        cells = Counter((p.kind, getattr(p, trait)) for p in plan)
        kinds, values = zip(*cells, strict=True)
        table = [[cells[k, v] for v in sorted(set(values))] for k in sorted(set(kinds))]
        assert chi2_contingency(table).pvalue > 0.01, trait
    for key in (lambda p: p.id, lambda p: p.index):
        ordered = [p.kind for p in sorted(plan, key=key)]
        places = [[i for i, k in enumerate(ordered) if k == kind] for kind in ("none", "unknown")]
        assert kruskal(*places).pvalue > 0.01


def planned(seed=5, engines=("mujoco",), floors=None, **changes):
    """A plan of many campaigns, and its settings."""
    counts = {"single": 0, "none": 0, "pair": 0, "unknown": 0}
    settings = PackSettings(engines=engines, **(counts | changes))
    known = {name: QuickEngine.effects for name in engines}
    floors = floors or {(e, name, 1): Floor(0.05, ()) for e in engines for name in known[e]}
    return draw_plan(seed, settings, known, floors), settings


def test_each_campaign_lacks_a_class_that_is_not_its_own() -> None:
    plan, settings = planned(single=40, none=40, pair=40, unknown=40, hidden=3)
    for one in plan:
        own = {settings.class_of(effect.name) for effect in one.effects}
        assert one.exclude
        assert (settings.class_of(one.exclude[0]) in own) == (one.kind == "unknown")
    left_out = {kind: {p.exclude for p in plan if p.kind == kind} for kind in KINDS}
    assert all(found == left_out["none"] for found in left_out.values())
    assert len(left_out["none"]) == 3


def test_too_few_classes_to_leave_out_are_refused(quick, study, tmp_path) -> None:
    for change in (
        {"single": 2, "pair": 1, "hidden": 2},
        {"single": 2, "none": 1, "effects": ("friction",)},
        {"none": 1, "unknown": 1, "effects": ("table_gain", "slenderness")},
        {"pair": 1, "effects": ("friction", "wear")},
        {"leave_one_out": 1, "none": 1, "effects": ("friction",)},
    ):
        counts = {"single": 0, "none": 0, "pair": 0, "unknown": 0}
        with pytest.raises(BlindError, match="would tell the kind"):
            make(study, tmp_path, **(counts | change))
        # Before any work.
        assert not (tmp_path / "key").exists()
    floors = {("mujoco", name, 1): Floor(0.05, ()) for name in ("wear", "friction")}
    with pytest.raises(BlindError, match="this pack needs 3"):
        planned(single=2, pair=1, floors=floors)
    assert len(planned(single=2, none=2, unknown=2, floors=floors)[0]) == 6
    assert len(planned(leave_one_out=2, floors=floors)[0]) == 4


def test_where_each_effect_is_left_out_so_is_each_class_as_a_decoy() -> None:
    from scipy.stats import chi2_contingency

    plan, _ = planned(none=600, leave_one_out=100, hidden=2)
    cells = Counter((p.kind, p.exclude) for p in plan)
    values = sorted({p.exclude for p in plan})
    # table_gain and slenderness are one class: it comes twice as often in both.
    assert len(values) == 5
    table = [[cells[kind, value] for value in values] for kind in ("none", "unknown")]
    assert chi2_contingency(table).pvalue > 0.01
    assert cells["unknown", ("slenderness", "table_gain", "table_pitch")] == 200


def test_magnitudes_lie_from_half_a_floor_to_six() -> None:
    # As a tether: strong wherever it acts, here from 2, 5, 7 and 100 floors on.
    engine = {
        name: Drawable(name, Strength("slack", "1", 0.0, low, 0.9))
        for name, low in (("weak", 0.02), ("some", 0.05), ("strong", 0.07), ("tether", 0.5))
    }
    engine["catch"] = Drawable("catch", Strength("slack", "1", math.inf, 5.0, 25.0, True))
    engine["gain"] = Drawable("gain", Strength("change", "1", 0.0, -0.3, 0.3))
    floors = {("mujoco", name, 1): Floor(0.01, ()) for name in engine if name != "tether"}
    floors |= {("mujoco", "tether", 1): Floor(0.005, ()), ("mujoco", "gain", -1): Floor(0.2, ())}
    floors["mujoco", "catch", 1] = Floor(0.006, ())
    assert directions({"mujoco": engine}, floors, "mujoco") == [
        ("gain", -1), ("gain", 1), ("some", 1), ("weak", 1)
    ]  # fmt: skip
    settings = PackSettings(single=400, none=0, pair=0, unknown=0)
    drawn = [p.effects[0] for p in draw_plan(1, settings, {"mujoco": engine}, floors)]
    relative = {name: [e.relative for e in drawn if e.name == name] for name in engine}
    assert max(max(found, default=0.0) for found in relative.values()) <= 6.0
    assert 2.0 <= min(relative["weak"]) < 2.2
    assert 5.0 <= min(relative["some"]) < 5.2
    assert 0.5 <= min(relative["gain"]) < 0.7
    assert not relative["strong"] + relative["tether"] + relative["catch"]


def test_unknown_effects_are_several_and_drawn_as_single_ones_are() -> None:
    settings = PackSettings(single=120, none=0, pair=0, unknown=120, hidden=6)
    floors = {("mujoco", name, 1): Floor(0.02, ()) for name in QuickEngine.effects}
    plan = draw_plan(2, settings, {"mujoco": QuickEngine.effects}, floors)
    unknown = [p.effects[0] for p in plan if p.kind == "unknown"]
    classes = Counter(settings.class_of(e.name) for e in unknown)
    assert len(classes) == 5
    assert set(classes.values()) == {24}
    single = [p.effects[0] for p in plan if p.kind == "single"]
    assert Counter(e.name for e in single) == dict.fromkeys(QuickEngine.effects, 20)
    from scipy.stats import ks_2samp

    assert ks_2samp([e.relative for e in unknown], [e.relative for e in single]).pvalue > 0.01


def test_what_the_files_say_beside_the_response_tells_nothing(uneven, study, tmp_path) -> None:
    effects = ("restitution", "friction")
    counts = {"single": 16, "none": 2, "trials": 16, "pair": 0, "unknown": 0, "effects": effects}
    packs = []
    for seed in (1, 2):
        make(study, tmp_path / str(seed), seed=seed, **counts)
        data = tmp_path / str(seed) / "data"
        packs += [data, open_key(data, tmp_path / str(seed) / "key")]
    cases = [
        Case(
            id=name,
            tier="M",
            kind=entry["kind"],
            engine=entry["engine"],
            truth=(entry["effects"][0]["name"] if entry["effects"] else "none",),
            effects=tuple(entry["effects"]),
            exclude=(),
            relative=1.0,
            where={},
            trials=(),
            verdict=Verdict("none"),
            classes=(),
        )
        for name, entry in packs[3]["campaigns"].items()
    ]
    judged = baseline_cases(cases, packs[2], packs[0], packs[1])
    assert {case.tier for case in judged} == set(BASELINES)
    assert len(judged) == len(BASELINES) * len(cases)
    for case in judged:
        assert sum(case.verdict.probabilities.values()) == pytest.approx(1.0)
    # Chance is 8 of 16; 14 or more happen by chance in 1 of 480 packs.
    told = [case for case in judged if case.tier == "metadata" and case.kind == "single"]
    assert sum(top_one(case) for case in told) < 14
    assert set(rate_alone(packs[2], packs[3])) == {"overturn rate only: AUROC, none or single"}


def test_baselines_know_what_they_are_named_after() -> None:
    """Trials that overturn beyond a PGA, the lower the greater PGV/PGA."""
    rng = np.random.default_rng(0)
    trials = []
    for i in range(400):
        pga, ratio = np.exp(rng.uniform(-1, 1, 2))
        over = rng.random() < 1 / (1 + np.exp(-(4 * np.log(pga) + 2 * np.log(ratio))))
        trials.append(
            CampaignTrial(
                trial=f"T{i}",
                motion=f"m{i}",
                session="1",
                order=i,
                specimen="rock",
                overturned=bool(over),
                pga=float(pga),
                pgv_pga=float(ratio),
            )
        )
    campaign = Campaign("c", tuple(trials), specimens={"rock": Specimen()})
    share = float(np.mean([t.overturned for t in trials]))
    assert overturn_rate(campaign, Path()) == [pytest.approx(share)]
    _, first, second = logistic_in_pga(campaign, Path())
    # The standard error of a slope is about 0.3.
    assert first == pytest.approx(4, abs=1.2)
    assert second == pytest.approx(2, abs=1.0)


# --- diagnosing ---------------------------------------------------------------------------------


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
def small(quick, study, tmp_path):
    make(study, tmp_path, single=2, none=1, pair=0, unknown=1)
    Stub.calls = []
    return tmp_path / "data"


def test_a_rock_that_does_not_rest_is_placed_anew(study, tmp_path, monkeypatch) -> None:
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
    progress = diagnose_pack(small, tmp_path / "out", diagnose=Stub, seed=7, draws=9)
    assert progress.done == 12
    assert progress.failed == ()
    excluded = {e["id"]: e["exclude"] for e in read_json(small / "pack.json")["campaigns"]}
    for campaign, how in Stub.calls:
        assert campaign.tier == how["tier"]
        assert list(how["exclude"]) == excluded[campaign.name]
        assert (how["seed"], how["draws"]) == (7, 9)
        if how["tier"] == "B":
            assert all(t.peak_tilt is None and t.series is None for t in campaign.trials)
            assert campaign.noise.peak_tilt is None
        assert how["tier"] == "T" or campaign.noise.tilt is None
    whole = load_campaign(small / Stub.calls[0][0].name)
    assert at_tier(whole, "T") is whole
    # All tiers share one bank of simulations.
    shared = Stub.calls[0][1]["shared"]
    scene = load_study(small / "scene.yaml")
    simulators = [
        SceneSimulator(at_tier(whole, tier), scene, series=True, sampling=shared.sampling)
        for tier in ("B", "M", "T")
    ]
    assert len({simulator.identity for simulator in simulators}) == 1


def test_a_damaged_campaign_fails_alone(small, tmp_path) -> None:
    first = read_json(small / "pack.json")["campaigns"][0]["id"]
    (small / first / "trials.csv").write_text("not a table")
    progress = diagnose_pack(small, tmp_path / "out", tiers=["M"], diagnose=Stub)
    assert progress.failed == (f"{first} M",)
    assert len(Stub.calls) == 3


def test_diagnosing_continues_where_it_stopped(small, tmp_path) -> None:
    def failing(campaign, scene, **how):
        if len(Stub.calls) == 2:
            Stub.calls.append(None)
            raise CampaignError("no motion")
        return Stub(campaign, scene, **how)

    progress = diagnose_pack(small, tmp_path / "out", tiers=["M"], diagnose=failing)
    assert (progress.done, len(progress.failed)) == (3, 1)
    name, tier = progress.failed[0].split()
    failed = tmp_path / "out" / name / tier / "failed.json"
    assert read_json(failed) == {"error": "no motion"}
    progress = diagnose_pack(small, tmp_path / "out", tiers=["M"], diagnose=Stub)
    assert (progress.done, len(Stub.calls)) == (4, 5)
    assert not failed.exists()
    with pytest.raises(BlindError, match="seed 0, not 1"):
        diagnose_pack(small, tmp_path / "out", diagnose=Stub, seed=1)


def test_what_is_not_there_is_refused(small, tmp_path) -> None:
    with pytest.raises(BlindError, match="no campaign 'c0'"):
        diagnose_pack(small, tmp_path / "out", campaigns=["c0"], diagnose=Stub)
    with pytest.raises(BlindError, match="finished pack"):
        diagnose_pack(tmp_path, tmp_path / "out", diagnose=Stub)


def test_the_command_makes_open_packs_from_a_seed_and_no_others(quick, tmp_path, capsys) -> None:
    sizes = ["--trials", "12", "--motions", "4", "--catalogue", "5", "--sessions", "3"]
    counts = ["--single", "2", "1", "--none", "1", "--pair", "0", "--unknown", "0", "--hidden", "3"]
    command = ["blind", "make", str(SCENE), str(tmp_path), "--seed", "4", *sizes, *counts]
    command += ["--engine", "mujoco", "--engine", "bullet", "--quiet"]
    assert main(command) == 2
    assert "--development" in capsys.readouterr().err
    assert main([*command, "--development"]) == 0
    assert "5 campaigns, sealed as" in capsys.readouterr().out
    key = open_key(tmp_path / "data", tmp_path / "key")
    found = Counter((e["engine"], e["kind"]) for e in key["campaigns"].values())
    assert found["mujoco", "single"] == 2
    assert found["bullet", "single"] == found["mujoco", "none"] == found["bullet", "none"] == 1


# --- from end to end ----------------------------------------------------------------------------


WATCHED = """
import json, sys
from functools import partial
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
except FileNotFoundError:
    assert looked.pop() == "open"
import vsr2.diagnosis.amortised, vsr2.diagnosis.budget, vsr2.diagnosis.design
from vsr2.blind import diagnose_pack
from vsr2.diagnosis import diagnose
from vsr2.effects import library
# A rough diagnosis will do: what is tested is the way from pack to scores.
vsr2.diagnosis.design.LEAST_NONE = 12
vsr2.diagnosis.budget.MAX_TRIALS = 4
vsr2.diagnosis.amortised.TREES = 40
rough = partial(diagnose, library={{name: library()[name] for name in {names!r}}})
made = diagnose_pack(Path({data!r}), Path({out!r}), tiers=["M"], draws=6, diagnose=rough)
print(json.dumps({{"done": made.done, "failed": made.failed, "looked": looked}}))
"""


def test_a_small_pack_from_end_to_end(study, tmp_path, capsys, monkeypatch) -> None:
    pytest.importorskip("mujoco", reason="the blind extra installs mujoco")
    names = ("edge_rounding", "restitution", "vertical_motion")
    pack, key, out = tmp_path / "pack", tmp_path / "key", tmp_path / "out"
    settings = PackSettings(
        engines=("bullet", "mujoco"),
        single=(6, 0),
        none=(2, 1),
        pair=(1, 0),
        unknown=(2, 0),
        trials=40,
        motions=4,
        catalogue=4,
        sessions=2,
        effects=names,
        series_interval=0.0,
        replicates=4,
        floor_trials=4,
    )
    monkeypatch.setattr(make_module, "catalogue", pulses)
    assert make_pack(study, pack, key, settings, seed=4).campaigns == 12
    # Nothing can read what is on no disk. The diagnosis, in a process of its own, does not look for
    # it either, nor starts a process that would.
    held = {path.relative_to(key): path.read_bytes() for path in key.rglob("*.json")}
    shutil.rmtree(key)
    code = WATCHED.format(key=str(key), data=str(pack / "data"), out=str(out), names=names)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert found == {"done": 12, "failed": [], "looked": []}
    assert not key.exists()
    for path, content in held.items():
        (key / path).parent.mkdir(parents=True, exist_ok=True)
        (key / path).write_bytes(content)
    spent = [
        json.loads((out / name / "M" / DIAGNOSIS_FILE).read_text())["provenance"]["budget"]
        for name in sorted(c["id"] for c in read_json(pack / "data" / "pack.json")["campaigns"])
    ]
    # Campaigns of one protocol share their simulations.
    assert sum(one["simulated"] for one in spent) == len(bank_keys(out / "bank.sqlite"))
    assert sorted(one["simulated"] for one in spent)[:9] == [0] * 9
    score = ["blind", "score", str(pack / "data"), str(key), str(out), "--out", str(tmp_path / "s")]
    assert main(score) == 0
    assert "top-1 class (single)" in capsys.readouterr().out
    assert main(score) == 2
    assert "scored once" in capsys.readouterr().err


def pulses(seed, count):
    """Short ground motions."""
    time = np.arange(0.0, 1.2, 0.005)
    out = []
    for i in range(count):
        f = 1.2 + 0.3 * i
        moved = np.sin(np.pi * time / time[-1]) ** 4 * np.cos(2 * np.pi * f * time + seed)
        peak = np.abs(np.diff(moved, 2)).max() / 0.005**2
        out.append(GroundMotion(f"M{i + 1}", 0.005, moved / peak))
    return out


def bank_keys(path):
    with contextlib.closing(sqlite3.connect(path)) as file:
        return file.execute("SELECT key FROM runs").fetchall()


def test_the_scene_rocks_under_all_nuisances(study) -> None:
    # It would slide below a friction of b / h; the diagnosis' prior is exp(N(0, 0.1)).
    friction = study.contact.rock.lateral_friction * study.contact.pedestal.lateral_friction
    width, _, height = study.rock.size
    assert friction * math.exp(-3 * Nuisances().friction) > 1.3 * width / height


def test_rocks_that_an_engine_cannot_simulate_are_refused(study, tmp_path) -> None:
    pytest.importorskip("mujoco", reason="the blind extra installs mujoco")
    turned = study.model_dump(mode="json", exclude_unset=True)
    turned["rock"]["start"] = {"mode": "pose", "position": [0.0, 0.0, 3.0]}
    with pytest.raises(BlindError, match="mode yaw"):
        build_engine("bullet", Study.model_validate(turned))
    with pytest.raises(BlindError, match="not known"):
        build_engine("ode", study)
    assert build_engine("mujoco", study).static_pga == pytest.approx(9.80665 * 0.4 / 0.95)


def test_the_two_engines_agree_on_a_calm_trial(study) -> None:
    # Rocking in a single pulse, before responses diverge: largest tilts within 5 %.
    pytest.importorskip("mujoco", reason="the blind extra installs mujoco")
    time = np.arange(0.0, 2.0, 0.005)
    moved = np.cos(2 * np.pi * 0.8 * (time - 1.0)) * np.sin(np.pi * time / 2.0) ** 4
    peak = np.abs(np.diff(moved, 2)).max() / 0.005**2
    shakes = [Shake(0.005, moved * pga / peak) for pga in (3.5, 5.6)]
    study = study.model_copy(
        update={"engine": study.engine.model_copy(update={"time_step": 0.001})}
    )
    found = {
        name: [seen.peak_tilt for seen in build_engine(name, study).run(shakes, 0.02)]
        for name in ("mujoco", "bullet")
    }
    assert max(found["mujoco"][0], found["bullet"][0]) < 1e-3
    np.testing.assert_allclose(found["mujoco"][1:], found["bullet"][1:], rtol=0.05)


def test_the_library_is_drawn_from(study) -> None:
    effects = build_engine("bullet", study).effects
    assert effects["restitution"].strength.null == 1.0
    assert effects["table_bandwidth"].strength.reciprocal
    assert effects["wear"].drifts
    assert [name for name, _, _ in effects["base_slope"].others] == ["azimuth"]
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


def test_scores_need_another_pack_to_train(small, tmp_path) -> None:
    diagnose_pack(small, tmp_path / "out", diagnose=Stub)
    key = tmp_path / "key"
    with pytest.raises(BlindError, match="another pack"):
        score_pack(small, key, tmp_path / "out", tmp_path / "s", training=(small, key))


def test_a_diagnosis_takes_its_uncertainties_from_the_published_tolerances() -> None:
    found = uncertainties(
        {"width": 0.03, "height": 0.04, "friction": 0.05, "yaw": math.radians(2), "offset": 0.003,
         "input_gain": [0.004, 0.004]}
    )  # fmt: skip
    assert found == pytest.approx(
        {"slenderness": 0.05, "inertia": 0.16, "friction": 0.05, "yaw": 2.0, "offset": 0.003,
         "trial_gain": 0.004}
    )  # fmt: skip
    assert uncertainties({}) == {}
    Nuisances(**found)
