"""Packs and diagnoses of others: written from docs/reference/blind.md alone."""

import copy
import csv
import hashlib
import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from blind_check import pool_packs
from blind_samples import hand_made, stand_in
from vsr2.blind import diagnose_pack, score_pack
from vsr2.blind.form.diagnosis_form import verdict_of
from vsr2.blind.form.events import EventCode
from vsr2.blind.form.pack_form import Listed
from vsr2.blind.form.seal import key_slips, open_key, read_pack
from vsr2.blind.pack_diagnoses import _excluded, pack_nuisances
from vsr2.blind.scoring.cases import groups, read_cases
from vsr2.blind.scoring.score import (
    ScoreCode,
    in_set,
    log_loss,
    magnitude,
    right,
    where_gain,
    wrong,
)
from vsr2.cli.main import main
from vsr2.codes import Statement
from vsr2.errors import BlindError, ConfigError
from vsr2.report.messages.blind_packs import event_text

SALT = "5a17"
TRIALS = ("run-b", "run-a", "extra.1")
SCENE = """\
name: hall
rock: {shape: mesh, file: boulder.obj, density: 2600}
motion: {mode: single_cosine, amplitude: 0.05, frequency: 1.0}
"""
SCENE_CONTENT = {
    "name": "hall",
    "rock": {"shape": "mesh", "file": "boulder.obj", "density": 2600},
    "motion": {"mode": "single_cosine", "amplitude": 0.05, "frequency": 1.0},
}
KEY = {
    "settings": {
        "classes": [["rope", "chain"]],
        "tiers": ["B", "M"],
        "tolerances": {"width": 0.03, "height": 0.04, "input_gain": [0.004, 0.004]},
    },
    "campaigns": {
        "Hall.1": {
            "kind": "single",
            "engine": "chrono",
            "protocol": 2,
            "effects": [
                {
                    "name": "rope",
                    "values": {"slack": 8.0},
                    "strength": "slack",
                    "null": None,
                    "relative": 2.5,
                }
            ],
            "exclude": ["wind"],
            "where": {"axis": "conditions", "weights": [1.0, 3.0, 0.5]},
        },
        "Hall.2": {
            "kind": "none",
            "engine": "shake table",
            "effects": [],
            "where": {"axis": "none", "weights": []},
        },
        "hall-3": {
            "kind": "unknown",
            "engine": "shake table",
            "effects": [{"name": "wind", "values": {"v": 2.0}, "strength": "v", "null": 0.0}],
            "exclude": ["wind"],
            "where": {"axis": "order", "weights": []},
        },
    },
}
VERDICTS = {
    # The true class by its other member, and 9 for a slack of 8 and none at infinity.
    "Hall.1": {
        "schema": "vsr2.diagnosis/5",
        "verdict": {"kind": "effect", "effects": ["chain"], "probability": 0.8},
        "effects": [
            {"name": "chain", "probability": 0.6},
            {
                "name": "rope",
                "probability": 0.2,
                "parameters": {"slack": {"mean": 9.0, "ci90": [7.0, 11.0]}},
            },
        ],
        "none_probability": 0.1,
        "unknown": {"probability": 0.05},
        "gap": {
            "closure": {"value": 0.4, "ci95": [0.1, 0.6]},
            "headline": {"value": 0.3, "ci95": [0.1, 0.5]},
            "gain": {"value": 0.2, "ci95": [0.1, 0.3]},
        },
        "conformal_set_90": ["chain", "rope"],
        "where": [{"axis": "conditions", "p_familywise": 0.01, "trials": ["run-a", "extra.1"]}],
    },
    "Hall.2": {
        "schema": "vsr2.diagnosis/5",
        "verdict": {"kind": "none", "effects": [], "probability": 0.9},
    },
    "hall-3": {
        "schema": "vsr2.diagnosis/5",
        "verdict": {"kind": "unknown", "probability": 0.7},
        "effects": [{"name": "chain", "probability": 0.2}],
        "unknown": {"probability": 0.7},
        "conformal_set_90": ["unknown"],
    },
}


def sha256(content):
    return hashlib.sha256(content).hexdigest()


def plain(content):
    return json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True).encode()


def folder_hash(folder):
    lines = [
        f"{path.relative_to(folder).as_posix()}\0{sha256(path.read_bytes())}\n"
        for path in sorted(p for p in folder.rglob("*") if p.is_file())
    ]
    return sha256("".join(lines).encode())


def write_campaign(folder):
    (folder / "motions").mkdir(parents=True)
    np.savez(
        folder / "motions" / "pulse.npz",
        sample_interval_s=0.01,
        displacement_m=0.05 * np.sin(np.linspace(0.0, math.pi, 32)) ** 2,
    )
    (folder / "campaign.yaml").write_text(
        f"schema: vsr2.campaign/1\nname: {folder.name}\nspecimens: {{boulder: {{}}}}\n"
    )
    with (folder / "trials.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(
            ["order", "trial", "motion", "motion_file", "session", "specimen", "overturned",
             "peak_tilt_rad"]
        )  # fmt: skip
        for order, trial in enumerate(TRIALS):
            rows.writerow([10 * order, trial, "pulse", "pulse", "May", "boulder", order % 2, 0.3])


def write_pack(folder, key=KEY, pack=None):
    """Data and key folder; `pack` replaces keys of pack.json."""
    data, kept = folder / "data", folder / "kept"
    data.mkdir(parents=True)
    kept.mkdir()
    (data / "scene.yaml").write_text(SCENE)
    corners = [(x, y, z) for x in (-0.2, 0.2) for y in (-0.3, 0.3) for z in (0.0, 1.0)]
    faces = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"]
    model = "".join(f"v {x} {y} {z}\n" for x, y, z in corners)
    (data / "boulder.obj").write_text(model + "".join(f"f {face}\n" for face in faces))
    key = copy.deepcopy(key)
    for name, entry in key["campaigns"].items():
        write_campaign(data / name)
        entry.setdefault("data_sha256", folder_hash(data / name))
    key.setdefault("scene_sha256", sha256(plain(SCENE_CONTENT)))
    key.setdefault("model_sha256", sha256((data / "boulder.obj").read_bytes()))
    seal(data, kept, key)
    content = {
        "schema": "vsr2.blind-pack/1",
        "scene": "scene.yaml",
        "tiers": ["B", "M"],
        "classes": [["chain", "rope"]],
        "tolerances": KEY["settings"]["tolerances"],
        "campaigns": [
            {"id": "Hall.1", "protocol": 2, "exclude": ["wind"]},
            {"id": "Hall.2"},
            {"id": "hall-3", "exclude": ["wind"]},
        ],
        "commitment": json.loads((data / "pack.json").read_text())["commitment"],
    }
    (data / "pack.json").write_text(json.dumps(content | (pack or {})))
    return data, kept


def seal(data, kept, key):
    """Write the key, and its hash into pack.json."""
    (kept / "key.json").write_text(
        json.dumps({"schema": "vsr2.blind-key/1", "salt": SALT, "key": key})
    )
    path = data / "pack.json"
    content = json.loads(path.read_text()) if path.exists() else {}
    hashed = sha256(bytes.fromhex(SALT) + plain(key))
    content["commitment"] = {"algorithm": "sha256(salt + canonical key)", "sha256": hashed}
    path.write_text(json.dumps(content))


def change_pack(data, **changes):
    path = data / "pack.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def write_diagnoses(data, out, verdicts=VERDICTS, tiers=("B", "M")):
    for name, content in verdicts.items():
        for tier in tiers:
            (out / name / tier).mkdir(parents=True, exist_ok=True)
            (out / name / tier / "diagnosis.json").write_text(json.dumps(content))
    hashed = json.loads((data / "pack.json").read_text())["commitment"]["sha256"]
    (out / "submission.json").write_text(json.dumps({"pack": hashed}))
    return out


@pytest.fixture(autouse=True)
def _reported(monkeypatch):
    stand_in(monkeypatch, Reported)


@pytest.fixture
def pack(tmp_path):
    data, key = write_pack(tmp_path)
    return data, key, write_diagnoses(data, tmp_path / "out")


class Reported:
    """A diagnosis that says what is written above."""

    calls: list = []  # noqa: RUF012

    def __init__(self, campaign, scene, **how):
        Reported.calls.append((campaign, Path(scene).name, how))
        self.content = VERDICTS[campaign.name]

    def save(self, folder):
        (folder / "diagnosis.json").write_text(json.dumps(self.content))


# --- from end to end ----------------------------------------------------------------------------


def test_a_pack_of_others_is_diagnosed_and_scored(tmp_path) -> None:
    data, key = write_pack(tmp_path)
    Reported.calls = []
    shutil.move(key, tmp_path / "away")
    progress = diagnose_pack(data, tmp_path / "out")
    assert (progress.done, progress.failed) == (6, ())
    by_name = {campaign.name: (campaign, scene, how) for campaign, scene, how in Reported.calls}
    campaign, scene, how = by_name["Hall.1"]
    assert [trial.trial for trial in campaign.trials] == list(TRIALS)
    # The library has no wind that it could leave out.
    assert (scene, how["hypotheses"].exclude) == ("scene.yaml", ())
    deviations = {one.name: one.prior.sd for one in how["hypotheses"].nuisances}
    assert deviations["slenderness"] == pytest.approx(0.05)
    assert deviations["trial_gain"] == pytest.approx(0.004)
    assert by_name["Hall.2"][2]["hypotheses"].exclude == ()

    scored = score_pack(data, tmp_path / "away", tmp_path / "out", tmp_path / "scores")
    scores = scored.scores["M", "all"]
    assert scores[ScoreCode.NAMED].value == 1.0
    assert scores[ScoreCode.NONE_NAMED].value == 0.0
    assert scores[ScoreCode.UNKNOWN_SAID].value == 1.0
    # |9 - 8| / 8, as the null is infinite; two trials of three hold 3.5 of the weights' 4.5.
    assert scores[ScoreCode.ERROR].value == pytest.approx(1 / 8)
    assert scores[ScoreCode.INTERVAL].value == 1.0
    assert scores[ScoreCode.WHERE_GAIN].value == pytest.approx(3.5 / 3)
    assert scores[ScoreCode.CLOSURE].value == pytest.approx(0.4)
    assert scores[ScoreCode.HEADLINE].value == pytest.approx(0.3)
    assert scores[ScoreCode.LOSS_FALLS].value == 1.0
    assert scores[ScoreCode.LOG_SCORE].value == pytest.approx(-np.log([0.8, 0.9, 0.7]).mean())
    assert scored.scores["M", "engine chrono"][ScoreCode.NAMED].count == 1
    assert scored.scores["M", "engine chrono, limits 2-4"][ScoreCode.NAMED].count == 1
    # No floor was measured for the unknown: it is in no group of magnitudes.
    assert not any(
        case.id == "hall-3"
        for (_, group), members in groups(scored.cases).items()
        for case in members
        if "limits" in group
    )


def test_trial_ids_are_those_of_the_campaign(pack) -> None:
    data, key, out = pack
    cases = read_cases(data, open_key(data, key), out)
    assert {case.trials for case in cases} == {TRIALS}
    gains = [gain for gain in map(where_gain, cases) if gain is not None]
    assert gains == 2 * [pytest.approx(3.5 / 3)]


def test_a_key_may_seal_less(tmp_path) -> None:
    key = copy.deepcopy(KEY)
    key["settings"] = {"classes": [["rope", "chain"]]}
    key |= {"scene_sha256": None, "model_sha256": None}
    del key["campaigns"]["Hall.1"]["protocol"]
    data, kept = write_pack(tmp_path, key, {"tiers": ["M"], "tolerances": {"friction": 0.1}})
    (data / "scene.yaml").write_text(SCENE.replace("2600", "2700"))
    out = write_diagnoses(data, tmp_path / "out")
    assert score_pack(data, kept, out, tmp_path / "scores").scores["M", "all"]


# --- what a laboratory knows --------------------------------------------------------------------


def nuisance(**content):
    return {"effect": "slenderness", "parameter": "change", "distribution": "normal"} | content


NUISANCES = [
    nuisance(distribution="uniform", low=-0.02, high=0.02, group="mould"),
    nuisance(effect="inertia", sd=0.02, group="mould", correlation=0.9),
    nuisance(effect="contact_stiffness", parameter="decades", sd=0.3),
    nuisance(effect="com_offset", parameter="distance", sd=0.002, scope="campaign"),
    nuisance(effect="restitution", parameter="energy_ratio", distribution="lognormal", sd=0.03),
    nuisance(effect="motion_noise", parameter="displacement", distribution="loguniform",
             low=1e-5, high=1e-4),
    nuisance(effect="table_gain", sd=0.01, scope="motion"),
]  # fmt: skip
PRIORS = {"table_gain.change": {"distribution": "normal", "mean": 0.0, "sd": 0.03}}


def test_a_pack_states_distributions_by_name(tmp_path) -> None:
    key = copy.deepcopy(KEY)
    key["settings"] |= {"nuisances": NUISANCES, "priors": PRIORS}
    data, kept = write_pack(tmp_path, key, {"nuisances": NUISANCES, "priors": PRIORS})
    open_key(data, kept)
    Reported.calls = []
    diagnose_pack(data, tmp_path / "out", tiers=["M"])
    given = Reported.calls[0][2]["hypotheses"]
    found = {(one.acting.name, str(one.scope)): one for one in given.nuisances}
    # Width and height of the tolerances give way to what is stated; the gain of trials stays.
    assert found["slenderness", "campaign"].prior.high == 0.02
    assert found["inertia", "campaign"].correlation == 0.9
    assert found["restitution", "campaign"].relative
    assert found["com_offset", "campaign"].direction == "azimuth"
    assert found["table_gain", "motion"].prior.sd == 0.01
    assert found["table_gain", "trial"].prior.sd == pytest.approx(0.004)
    assert found["motion_noise", "campaign"].prior.low == 1e-5
    gain = given.offered["table_gain"].parameter("change")
    assert (gain.prior, gain.lower, gain.upper) == ("normal", -0.06, 0.06)
    change_pack(data, nuisances=NUISANCES[1:])
    with pytest.raises(BlindError, match=r"nuisances is .* and differs from the sealed"):
        open_key(data, kept)
    change_pack(data, nuisances=NUISANCES, priors={})
    with pytest.raises(BlindError, match=r"priors is .* and differs from the sealed"):
        open_key(data, kept)


def with_reference(**changes):
    """A key with an open campaign in place of the one without effect, and its entry."""
    key = copy.deepcopy(KEY)
    key["campaigns"]["Hall.2"]["kind"] = "reference"
    listed = [{"id": "Hall.1", "protocol": 2, "exclude": ["wind"]},
              {"id": "Hall.2", "kind": "reference"} | changes,
              {"id": "hall-3", "exclude": ["wind"]}]  # fmt: skip
    return key, {"campaigns": listed}


def test_references_are_open_and_scored_apart(tmp_path) -> None:
    data, kept = write_pack(tmp_path, *with_reference())
    out = write_diagnoses(data, tmp_path / "out")
    scores = score_pack(data, kept, out, tmp_path / "scores").scores
    assert scores["M", "all"][ScoreCode.REFERENCE_NONE].value == 1.0
    assert not {ScoreCode.NONE_NAMED, ScoreCode.REFERENCE_EFFECTS} & scores["M", "all"].keys()
    assert scores["M", "kind reference"][ScoreCode.REFERENCE_NONE].count == 1
    known = [{"name": "rope", "values": {"slack": 8.0}}]
    for changes, message in (
        ({"effects": known}, "effects of Hall.2 is .* differs from the sealed"),
        ({"kind": None}, "reference Hall.2 is False and differs from the sealed, True"),
    ):
        change_pack(data, **with_reference(**changes)[1])
        with pytest.raises(BlindError, match=message):
            open_key(data, kept)
    change_pack(data, **with_reference(effects=known, kind=None)[1])
    with pytest.raises(BlindError, match=r"campaigns\[1\]\.effects is .*only references are open"):
        open_key(data, kept)


def test_shared_motions_are_sealed_once(tmp_path) -> None:
    data, kept = write_pack(tmp_path)
    sealed = json.loads((kept / "key.json").read_text())["key"]
    shutil.move(data / "Hall.1" / "motions", data / "motions")
    for name in KEY["campaigns"]:
        shutil.rmtree(data / name / "motions", ignore_errors=True)
        file = data / name / "campaign.yaml"
        file.write_text(file.read_text() + "motions: ../motions\n")
        sealed["campaigns"][name]["data_sha256"] = folder_hash(data / name)
    seal(data, kept, sealed)
    with pytest.raises(BlindError, match=r"holds motions, and motions_sha256 of .* does not seal"):
        open_key(data, kept)
    seal(data, kept, sealed | {"motions_sha256": {"motions": folder_hash(data / "motions")}})
    open_key(data, kept)
    assert diagnose_pack(data, tmp_path / "out").done == 6
    (data / "motions" / "pulse.npz").write_bytes(b"")
    with pytest.raises(BlindError, match="motions: its files differ from the sealed ones"):
        open_key(data, kept)


def test_without_detection_limits_campaigns_go_by_the_outcomes_that_flip(tmp_path) -> None:
    key = copy.deepcopy(KEY)
    for name, flips in (("Hall.1", 0.2), ("hall-3", 0.03)):
        key["campaigns"][name]["flips"] = flips
    data, kept = write_pack(tmp_path, key)
    out = write_diagnoses(data, tmp_path / "out")
    found = groups(read_cases(data, open_key(data, kept), out))
    # The other has a limit.
    assert [name for tier, name in found if tier == "M" and "flips" in name] == ["flips 0.02-0.05"]
    del key["campaigns"]["Hall.1"]["effects"][0]["relative"]
    data, kept = write_pack(tmp_path / "two", key)
    found = groups(read_cases(data, open_key(data, kept), write_diagnoses(data, tmp_path / "o")))
    assert [case.id for case in found["M", "flips 0.1+"]] == ["Hall.1"]


def test_unresolved_without_a_gap_counts_apart(pack, tmp_path) -> None:
    data, key, out = pack
    unsure = VERDICTS["Hall.2"] | {"verdict": {"kind": "unresolved", "effects": []}}
    write_diagnoses(data, out, VERDICTS | {"Hall.2": unsure})
    scores = score_pack(data, key, out, tmp_path / "scores").scores["M", "all"]
    assert scores[ScoreCode.NONE_NAMED].value == 0.0
    assert scores[ScoreCode.NONE_SAID].value == 0.0


def test_misspelt_names_of_a_key_are_said_with_the_nearest(tmp_path) -> None:
    key = copy.deepcopy(KEY)
    effects = key["campaigns"]["Hall.1"]["effects"]
    effects[0] |= {"name": "table_gian", "values": {"change": 0.1}, "strength": "change", "null": 0}
    other = {"name": "friction", "values": {"facter": 0.8}, "strength": "facter", "null": 1.0}
    key["campaigns"]["hall-3"] |= {"effects": [other], "exclude": ["friction"]}
    listed = [{"id": "Hall.1", "protocol": 2, "exclude": ["wind"]}, {"id": "Hall.2"},
              {"id": "hall-3", "exclude": ["friction"]}]  # fmt: skip
    data, kept = write_pack(tmp_path, key, {"campaigns": listed})
    slips = key_slips(open_key(data, kept))
    assert [event_text(slip) for slip in slips] == [
        "Hall.1: the library has no effect 'table_gian'; table_gain may be meant",
        "hall-3: the library has no parameter of friction 'facter'; factor may be meant",
    ]
    other["values"] = {"speed": 0.8}
    (_, slip) = key_slips(key)
    of = {"campaign": "hall-3", "effect": "friction", "parameter": "speed"}
    assert slip == Statement.of(EventCode.UNKNOWN_PARAMETER, **of, known=("factor",))
    assert key_slips(KEY) == []


def test_a_name_without_quotes_is_no_number(tmp_path) -> None:
    data, _ = write_pack(tmp_path)
    path = data / "pack.json"
    path.write_text(path.read_text().replace('"Hall.1"', "12e345678"))
    with pytest.raises(BlindError, match=r"pack\.json: .*12e345678 is a number too great.*quotes"):
        read_pack(data)


# --- what was sealed -----------------------------------------------------------------------------


def scene_changed(data):
    (data / "scene.yaml").write_text(SCENE.replace("2600", "2700"))


def model_changed(data):
    path = data / "boulder.obj"
    path.write_text(path.read_text().replace("1.0", "1.1"))


def campaigns_changed(data, **changes):
    campaigns = json.loads((data / "pack.json").read_text())["campaigns"]
    campaigns[0] |= changes
    change_pack(data, campaigns=campaigns)


CHANGES = {
    "development": lambda data: change_pack(data, development=True),
    "tiers": lambda data: change_pack(data, tiers=["M"]),
    "classes": lambda data: change_pack(data, classes=[["chain", "rope", "wind"]]),
    "no classes": lambda data: change_pack(data, classes=None),
    "tolerances": lambda data: change_pack(data, tolerances={"width": 0.3, "height": 0.04}),
    "protocol": lambda data: campaigns_changed(data, protocol=1),
    "exclude": lambda data: campaigns_changed(data, exclude=["rope"]),
    "scene": scene_changed,
    "no scene": lambda data: (data / "scene.yaml").unlink(),
    "broken scene": lambda data: (data / "scene.yaml").write_text("rock: [1"),
    "model": model_changed,
}
MESSAGES = {
    "no classes": r"classes is missing, sealed is .*; publish it",
    "scene": "differs from the sealed scene",
    "tolerances": r"tolerances\.input_gain is missing, sealed is \[0\.004, 0\.004\]; publish it",
    "no scene": r"scene\.yaml: cannot be read",
    "broken scene": r"scene\.yaml: is no scene",
    "model": r"boulder\.obj: differs from the sealed model",
}


@pytest.mark.parametrize("what", CHANGES)
def test_what_is_sealed_cannot_be_changed(what, pack, tmp_path) -> None:
    CHANGES[what](pack[0])
    with pytest.raises(BlindError, match=MESSAGES.get(what, f"{what} .*differs from the sealed")):
        score_pack(*pack, tmp_path / "scores")
    assert not (pack[1] / "receipt.json").exists()
    assert not (tmp_path / "scores").exists()


def test_one_word_does_not_open_a_scored_pack(pack, tmp_path) -> None:
    score_pack(*pack, tmp_path / "scores")
    change_pack(pack[0], development=True)
    with pytest.raises(BlindError, match="development is True and differs from the sealed, False"):
        score_pack(*pack, tmp_path / "again")
    assert not (tmp_path / "again").exists()
    change_pack(pack[0], development=False)
    write_diagnoses(pack[0], pack[2], VERDICTS | {"Hall.2": a_verdict()})
    with pytest.raises(BlindError, match="scored once"):
        score_pack(*pack, tmp_path / "again")


def test_an_open_pack_says_so(tmp_path) -> None:
    key = copy.deepcopy(KEY)
    key["settings"]["development"] = True
    data, kept = write_pack(tmp_path, key)
    out = write_diagnoses(data, tmp_path / "out")
    with pytest.raises(BlindError, match="development is False and differs from the sealed, True"):
        score_pack(data, kept, out, tmp_path / "scores")
    change_pack(data, development=True)
    for _ in range(2):
        assert score_pack(data, kept, out, tmp_path / "scores").development


def test_the_series_interval_of_our_own_packs_seals_the_tiers(tmp_path) -> None:
    verdict = VERDICTS["Hall.2"]
    data, key, out = hand_made(tmp_path, {"a": ("none", [])}, {"a": verdict}, tiers=("B", "M", "T"))
    assert "tiers" not in open_key(data, key)["settings"]
    change_pack(data, tiers=["B", "M"])
    with pytest.raises(BlindError, match=r"tiers is .*differs from the sealed"):
        score_pack(data, key, out, tmp_path / "scores")


# --- what cannot be read -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"development": "no"}, "development is 'no'; it should be true or false"),
        ({"scene": None}, "scene is missing"),
        ({"scene": "../scene.yaml"}, "scene is '../scene.yaml'"),
        ({"tiers": None}, "tiers is missing"),
        ({"tiers": ["B", "X"]}, r"tiers\[1\] is 'X'"),
        ({"tiers": "BM"}, "tiers is 'BM'; it should be a list"),
        ({"classes": [["a"], ["a", "b"]]}, "classes is .* each name should stand once"),
        ({"tolerances": [0.1]}, "tolerances is .* a mapping"),
        ({"tolerances": {"frictoin": 0.1}}, r"tolerances\.frictoin is 0\.1; it is no key here"),
        ({"tolerances": {"friction": "5 %"}}, r"tolerances\.friction is '5 %'"),
        (
            {"tolerances": {"friction": -0.1}},
            r"tolerances\.friction is -0\.1; it should be greater than or equal to 0",
        ),
        ({"tolerances": {"friction": math.nan}}, r"tolerances\.friction is nan"),
        (
            {"tolerances": {"input_gain": 0.1}},
            r"tolerances\.input_gain is 0\.1; it should be a list",
        ),
        ({"tolerances": {"input_gain": [2, 1]}}, r"tolerances\.input_gain is \[2, 1\]"),
        ({"tolerances": {"width": 0.1}}, r"tolerances\.height is missing; .* both, or neither"),
        ({"campaigns": None}, "campaigns is missing"),
        ({"campaigns": {}}, "campaigns is {}; it should be a list"),
        ({"campaigns": ["c1"]}, r"campaigns\[0\] is 'c1'; it should be a mapping"),
        ({"campaigns": [{}]}, r"campaigns\[0\]\.id is missing"),
        ({"campaigns": [{"id": "../c"}]}, r"campaigns\[0\]\.id is '../c'; .* is no id"),
        ({"campaigns": [{"id": "c"}] * 2}, r"campaigns: id c is \['c', 'c'\]; give each id once"),
        ({"campaigns": [{"id": "c", "protocol": "one"}]}, r"campaigns\[0\]\.protocol is 'one'"),
        ({"campaigns": [{"id": "c", "exclude": "wear"}]}, r"campaigns\[0\]\.exclude is 'wear'"),
        ({"nuisances": [{"effect": "friction"}]}, r"nuisances\[0\]\.parameter is missing"),
        (
            {
                "nuisances": [
                    {"effect": "frction", "parameter": "factor", "distribution": "normal", "sd": 1}
                ]
            },
            r"nuisances\[0\]\..*no effect 'frction'; did you mean",
        ),
        (
            {"priors": {"friction.factor": {"distribution": "norml"}}},
            r"priors\.friction\.factor\.distribution is 'norml'; did you mean `normal`",
        ),
        (
            {"priors": {"friction.fctor": {"distribution": "normal", "sd": 1}}},
            r"priors\..*no parameter 'fctor'; did you mean `factor`",
        ),
        ({"commitment": {}}, r"commitment\.sha256 is missing; give it"),
        ({"commitment": "abc"}, "commitment is 'abc'; it should be a mapping"),
    ],
)
def test_a_pack_that_cannot_be_used_is_named(changes, message, tmp_path) -> None:
    data, _ = write_pack(tmp_path)
    change_pack(data, **changes)
    with pytest.raises(BlindError, match=rf"pack\.json: {message}"):
        diagnose_pack(data, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (("settings",), None, "settings is missing"),
        (("settings", "classes"), None, "settings.classes is missing"),
        (("settings", "tolerances"), {"width": 1}, "settings.tolerances.height is missing"),
        (("scene_sha256",), "abc", "scene_sha256 is 'abc'"),
        (("campaigns", "Hall.1"), 3, "campaigns.Hall.1 is 3; it should be a mapping"),
        (("campaigns", "Hall.1", "kind"), "other", "kind is 'other'; it should be 'single'"),
        (("campaigns", "Hall.1", "engine"), None, "engine is missing"),
        (("campaigns", "Hall.1", "data_sha256"), None, "data_sha256 is missing"),
        (("campaigns", "Hall.1", "exclude"), "wind", "exclude is 'wind'; it should be a list"),
        (
            ("campaigns", "Hall.1", "exclude"),
            ["rope", "chain"],
            "it should not hold rope, the effect",
        ),
        (("campaigns", "Hall.1", "exclude"), ["chain"], "complete equivalence classes: rope too"),
        (("campaigns", "hall-3", "exclude"), ["chain"], "complete equivalence classes: rope too"),
        (("campaigns", "hall-3", "effects", 0, "name"), "wear", "it should hold wear, as the ki"),
        (("campaigns", "Hall.1", "effects"), [], "effects is .*a list of 1, as the kind is single"),
        (("campaigns", "hall-3", "effects"), [], "effects is .*1 or more, as the kind is unknown"),
        (("campaigns", "Hall.1", "effects", 0, "relative"), -1, r"effects\[0\].relative is -1"),
        (("campaigns", "Hall.1", "effects", 0, "strength"), "x", r"effects\[0\].values.x is miss"),
        (("campaigns", "hall-3", "effects", 0, "null"), 2.0, r"effects\[0\].values.v is 2"),
        (("campaigns", "hall-3", "effects", 0, "values"), {"v": "2"}, "values.v is '2'"),
        (("campaigns", "Hall.1", "where"), None, "where is missing"),
        (("campaigns", "Hall.1", "effects", 0, "name"), "none", "name is 'none'; it is a verdict"),
        (("settings", "classes"), [["none", "rope"]], "none and unknown in no class"),
        (
            ("campaigns", "Hall.1", "where", "axis"),
            "none",
            "it should be none where the kind is none",
        ),
        (
            ("campaigns", "Hall.2", "where", "axis"),
            "order",
            "it should be none where the kind is none",
        ),
        (("campaigns", "Hall.1", "where", "axis"), "x", "where.axis is 'x'; it should be 'cond"),
        (("campaigns", "Hall.1", "where", "weights"), [1, -1, 0], r"where.weights\[1\] is -1"),
    ],
)
def test_a_key_that_cannot_be_used_is_named(place, value, message, tmp_path) -> None:
    key = copy.deepcopy(KEY)
    data, kept = write_pack(tmp_path, key)
    key = json.loads((kept / "key.json").read_text())["key"]
    inner = key
    for step in place[:-1]:
        inner = inner[step]
    inner[place[-1]] = value
    seal(data, kept, key)
    with pytest.raises(BlindError, match=rf"key\.json: key.*{message}"):
        open_key(data, kept)


@pytest.mark.parametrize(("second", "right"), [("chain", False), ("rope", False), ("sand", True)])
def test_a_pair_is_of_two_classes(second, right, tmp_path) -> None:
    key = copy.deepcopy(KEY)
    entry = key["campaigns"]["Hall.1"]
    entry["effects"].append(entry["effects"][0] | {"name": second})
    entry["kind"] = "pair"
    data, kept = write_pack(tmp_path, key)
    if right:
        open_key(data, kept)
        return
    with pytest.raises(BlindError, match=r"effects is .* two effects of different classes"):
        open_key(data, kept)


@pytest.mark.parametrize("place", ["data", "data/deeper", "kept", "out/scores"])
def test_scores_do_not_go_among_sealed_files(place, tmp_path) -> None:
    data, kept = write_pack(tmp_path)
    out = write_diagnoses(data, tmp_path / "out")
    before = folder_hash(tmp_path)
    folder = tmp_path / place
    with pytest.raises(BlindError, match="must stay as they are; choose another --out"):
        score_pack(data, kept, out, folder)
    assert folder_hash(tmp_path) == before
    score_pack(data, kept, out, tmp_path / "scores")
    with pytest.raises(BlindError, match="must stay as they are; choose another --out"):
        pool_packs([(data, kept, out)], folder)


def test_no_classes_need_not_be_published(tmp_path) -> None:
    key = copy.deepcopy(KEY)
    key["settings"]["classes"] = []
    data, kept = write_pack(tmp_path, key, {"classes": None})
    assert open_key(data, kept)["settings"]["classes"] == []
    change_pack(data, classes=[["rope", "chain"]])
    with pytest.raises(BlindError, match=r"classes is .* and differs from the sealed"):
        open_key(data, kept)


def test_a_salt_is_not_empty(tmp_path) -> None:
    data, kept = write_pack(tmp_path)
    path = kept / "key.json"
    sealed = json.loads(path.read_text())
    path.write_text(json.dumps(sealed | {"salt": ""}))
    hashed = sha256(plain(sealed["key"]))
    change_pack(data, commitment={"algorithm": "sha256(salt + canonical key)", "sha256": hashed})
    with pytest.raises(BlindError, match=r"key\.json: salt is empty"):
        open_key(data, kept)


@pytest.mark.parametrize(
    ("name", "fault"), [("wind", None), ("table_gian", "table_gain"), ("wears", "wear")]
)
def test_what_is_withheld_may_lie_outside_the_library(name, fault, tmp_path) -> None:
    said = []
    if fault is not None:
        with pytest.raises(BlindError, match=rf"exclude of c names '{name}'.*if {fault} is meant"):
            _excluded(tmp_path, Listed(id="c", exclude=(name,)), said.append)
        return
    kept = _excluded(tmp_path, Listed(id="c", exclude=(name, "catch")), said.append)
    assert kept == ("catch",)
    (event,) = said
    assert event.code is EventCode.EXCLUDED_ANYWAY
    assert event.values == {"campaign": "c", "effect": "wind"}


@pytest.mark.parametrize("place", ["data", "data/deeper", "kept"])
def test_diagnoses_do_not_go_into_the_pack(place, tmp_path) -> None:
    data, _ = write_pack(tmp_path)
    before = folder_hash(tmp_path)
    with pytest.raises(BlindError, match="choose another --out"):
        diagnose_pack(data, tmp_path / place)
    assert folder_hash(tmp_path) == before


def test_the_null_is_said_and_not_left_out(tmp_path) -> None:
    key = copy.deepcopy(KEY)
    del key["campaigns"]["hall-3"]["effects"][0]["null"]
    with pytest.raises(BlindError, match=r"effects\[0\]\.null is missing; .* null for infinity"):
        open_key(*write_pack(tmp_path, key))


def test_weights_are_one_a_trial(tmp_path) -> None:
    key = copy.deepcopy(KEY)
    key["campaigns"]["Hall.1"]["where"]["weights"] = [1.0, 2.0]
    data, kept = write_pack(tmp_path, key)
    out = write_diagnoses(data, tmp_path / "out")
    with pytest.raises(BlindError, match=r"trials\.csv: has 3 trials, but the key has 2 weights"):
        score_pack(data, kept, out, tmp_path / "scores")
    assert not (kept / "receipt.json").exists()


def a_verdict(**changes):
    return VERDICTS["Hall.1"] | changes


def one_effect(**changes):
    return a_verdict(effects=[{"name": "chain", "probability": 0.2} | changes])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (a_verdict(verdict="none"), "verdict is 'none'; it should be a mapping"),
        (a_verdict(verdict={"kind": ["none"]}), "verdict.kind is"),
        (
            a_verdict(verdict={"kind": "effect", "effects": []}),
            "effects is .* kind is effect",
        ),
        (
            a_verdict(verdict={"kind": "effect", "effects": ["chain", "rope"]}),
            "verdict.effects is .* a list of 1, as the kind is effect",
        ),
        (
            a_verdict(verdict={"kind": "pair", "effects": ["chain"]}),
            "verdict.effects is .* a list of 2 or more, as the kind is pair",
        ),
        (
            a_verdict(verdict={"kind": "class"}),
            r"verdict.effects is \(\); it should be a list of 1 or more",
        ),
        (
            a_verdict(verdict={"kind": "effect", "effects": ["chian"]}),
            "verdict.effects is .* names in effects, where 'chian' is not",
        ),
        (a_verdict(effects=["chain"]), r"effects\[0\] is 'chain'; it should be a mapping"),
        (a_verdict(effects={"chain": 0.2}), "effects is .* a list"),
        (one_effect(probability=math.nan), r"effects\[0\].probability is nan"),
        (one_effect(probability=True), r"effects\[0\].probability is True"),
        (one_effect(probability=10**400), r"effects\[0\].probability is 1000"),
        (one_effect(parameters=[1]), r"effects\[0\].parameters is"),
        (one_effect(parameters={"slack": 8}), r"parameters.slack is 8; it should be a mapping"),
        (
            one_effect(parameters={"slack": {"mean": math.nan, "ci90": [1, 2]}}),
            "parameters.slack.mean is nan; it should be a finite number",
        ),
        (
            one_effect(parameters={"slack": {"mean": 1.5, "ci90": [2, 1]}}),
            r"parameters.slack.ci90 is \[2, 1\]; .* the lower one first",
        ),
        (
            one_effect(parameters={"slack": {"mean": 1.5, "ci90": [1, math.inf]}}),
            r"parameters.slack.ci90 is .*a finite number, or null for infinity",
        ),
        (a_verdict(gap={"gain": "all"}), "gap.gain is 'all'; it should be a mapping"),
        (a_verdict(gap=0.4), "gap is 0.4; it should be a mapping"),
        (a_verdict(gap={"closure": {"value": math.nan}}), "gap.closure.value is nan"),
        (a_verdict(gap={"closure": {"value": 1, "ci95": [2, 1]}}), "gap.closure.ci95 is"),
        (a_verdict(unknown=0.05), "unknown is 0.05; it should be a mapping"),
        (a_verdict(unknown={"probability": 0.6}), "unknown.probability sum to 1.5"),
        (a_verdict(conformal_set_90=[1]), r"conformal_set_90\[0\] is 1"),
        (a_verdict(where=[["order"]]), r"where\[0\] is"),
        (a_verdict(where=[{"axis": 2}]), r"where\[0\].axis is 2"),
        (
            a_verdict(where=[{"axis": "order", "p_familywise": 0.1, "trials": "run-a"}]),
            r"where\[0\].trials is 'run-a'",
        ),
    ],
)
def test_a_diagnosis_that_cannot_be_used_is_named(content, message) -> None:
    with pytest.raises(BlindError, match=f"file: .*{message}"):
        verdict_of(content, "file")


@pytest.mark.parametrize(
    "changes",
    [
        {"verdict": {"kind": "unresolved", "effects": ["wind"]}, "effects": []},
        {"effects": [{"name": "chain", "probability": 0.5}, {"name": "wind", "probability": 0.1}]},
        {"conformal_set_90": ["chain", "wind"]},
    ],
)
def test_what_was_withheld_may_not_be_used(changes, pack, tmp_path) -> None:
    data, key, out = pack
    write_diagnoses(data, out, VERDICTS | {"Hall.1": a_verdict(**changes)})
    with pytest.raises(BlindError, match=r"Hall\.1/B/diagnosis\.json: names wind, which exclude"):
        score_pack(data, key, out, tmp_path / "scores")
    assert not (key / "receipt.json").exists()


def test_trials_that_are_not_there_are_named(pack, tmp_path) -> None:
    data, key, out = pack
    where = [{"axis": "order", "p_familywise": 0.5, "trials": ["T1"]}]
    write_diagnoses(data, out, VERDICTS | {"Hall.2": VERDICTS["Hall.2"] | {"where": where}})
    with pytest.raises(BlindError, match=r"Hall\.2/B/diagnosis\.json: where names the trial 'T1'"):
        score_pack(data, key, out, tmp_path / "scores")
    assert not (key / "receipt.json").exists()


JUNK = (None, True, 3, -0.5, math.nan, "x", "", [], [1], ["x"], [None, 1], {}, {"x": 1}, [{}])


def damaged(content):
    """The content with each of its values, in turn, replaced by each piece of junk, or gone."""

    def steps_to_numbers(inner, path):
        items = inner.items() if isinstance(inner, dict) else enumerate(inner)
        for step, value in items:
            yield (*path, step)
            if isinstance(value, dict | list):
                yield from steps_to_numbers(value, (*path, step))

    for path in list(steps_to_numbers(content, ())):
        for junk in (*JUNK, "gone"):
            out = copy.deepcopy(content)
            inner = out
            for step in path[:-1]:
                inner = inner[step]
            if junk == "gone":
                del inner[path[-1]]
            else:
                inner[path[-1]] = junk
            yield out


def judge(case):
    for score in (right, wrong, in_set, log_loss, where_gain):
        score(case)
    if case.kind == "single":
        magnitude(case)


def test_junk_in_a_pack_is_refused_or_does_no_harm(tmp_path) -> None:
    data, _ = write_pack(tmp_path)
    refused = 0
    for content in damaged(json.loads((data / "pack.json").read_text())):
        (data / "pack.json").write_text(json.dumps(content))
        try:
            pack_nuisances(read_pack(data))
        except BlindError:
            refused += 1
    assert refused > 100


def test_junk_in_a_key_is_refused_or_does_no_harm(pack) -> None:
    data, kept, out = pack
    refused = 0
    for key in damaged(json.loads((kept / "key.json").read_text())["key"]):
        try:
            seal(data, kept, key)
            write_diagnoses(data, out, {})
            cases = read_cases(data, open_key(data, kept), out)
        except BlindError:
            refused += 1
            continue
        groups(cases)
        for case in cases:
            judge(case)
    assert refused > 100


def test_junk_in_a_diagnosis_is_refused_or_does_no_harm(pack) -> None:
    data, kept, out = pack
    key = open_key(data, kept)
    refused = 0
    for content in damaged(VERDICTS["Hall.1"]):
        (out / "Hall.1" / "M" / "diagnosis.json").write_text(json.dumps(content))
        try:
            cases = read_cases(data, key, out)
        except BlindError:
            refused += 1
            continue
        for case in cases:
            judge(case)
    assert refused > 100


# --- before anything is written ------------------------------------------------------------------


def test_a_seed_is_refused_before_the_submission_is_begun(tmp_path) -> None:
    data, _ = write_pack(tmp_path)
    with pytest.raises(BlindError, match="seed is -1"):
        diagnose_pack(data, tmp_path / "out", seed=-1)
    assert not (tmp_path / "out").exists()
    assert diagnose_pack(data, tmp_path / "out").done == 6


def test_a_file_in_the_place_of_the_diagnoses_is_refused(tmp_path, capsys) -> None:
    data, _ = write_pack(tmp_path)
    (tmp_path / "out").write_text("")
    assert main(["blind", "diagnose", str(data), "--out", str(tmp_path / "out")]) == 2
    assert "out: no folder can be made there" in capsys.readouterr().err


def test_the_command_refuses_few_campaigns_and_begins_nothing(tmp_path, capsys) -> None:
    data, _ = write_pack(tmp_path)
    command = ["blind", "diagnose", str(data), "--out", str(tmp_path / "out"), "--campaigns", "4"]
    assert main(command) == 2
    assert "give at least 150" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_an_infinite_end_of_an_interval_is_null() -> None:
    content = one_effect(parameters={"slack": {"mean": 1.5, "ci90": [1, None]}})
    assert verdict_of(content, "here").parameters["chain"]["slack"].ci90 == (1, math.inf)


def test_a_scene_that_cannot_be_used_begins_nothing(tmp_path) -> None:
    data, _ = write_pack(tmp_path)
    (data / "boulder.obj").unlink()
    with pytest.raises(ConfigError, match=r"boulder\.obj"):
        diagnose_pack(data, tmp_path / "out")
    assert not (tmp_path / "out").exists()
