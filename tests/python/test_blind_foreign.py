"""Packs and diagnoses of others: written from docs/reference/blind.md alone."""

import copy
import json
import shutil

import numpy as np
import pytest

from blind_samples import hand_made, stand_in
from foreign_pack import (
    KEY,
    SCENE,
    TRIALS,
    VERDICTS,
    Reported,
    a_verdict,
    change_pack,
    folder_hash,
    seal,
    write_diagnoses,
    write_pack,
)
from vsr2.blind import diagnose_pack, score_pack
from vsr2.blind.form.seal import open_key, read_pack
from vsr2.blind.scoring.cases import groups, read_cases
from vsr2.blind.scoring.score import (
    ScoreCode,
    where_gain,
)
from vsr2.errors import BlindError


@pytest.fixture(autouse=True)
def _reported(monkeypatch):
    stand_in(monkeypatch, Reported)


@pytest.fixture
def pack(tmp_path):
    data, key = write_pack(tmp_path)
    return data, key, write_diagnoses(data, tmp_path / "out")


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
    change_pack(data, nuisances=NUISANCES[:-1])
    with pytest.raises(BlindError, match=r"nuisances is .* and differs from the sealed"):
        open_key(data, kept)
    change_pack(data, nuisances=NUISANCES, priors={})
    with pytest.raises(BlindError, match=r"priors is .* and differs from the sealed"):
        open_key(data, kept)


def test_a_nuisance_that_stands_twice_is_refused(tmp_path) -> None:
    """The last one held, or both acted."""
    twice = [*NUISANCES, nuisance(effect="table_gain", sd=0.02, scope="motion")]
    refused = r"nuisances is .* both are of table_gain\.change with scope motion; leave one"
    data, _ = write_pack(tmp_path / "open", KEY, {"nuisances": twice})
    with pytest.raises(BlindError, match=rf"pack\.json: {refused}"):
        diagnose_pack(data, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    key = copy.deepcopy(KEY)
    key["settings"] |= {"nuisances": twice}
    sealed, kept = write_pack(tmp_path / "sealed", key)
    with pytest.raises(BlindError, match=rf"key\.json: .*{refused}"):
        open_key(sealed, kept)


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


def test_motions_of_several_campaigns_are_sealed_once(tmp_path) -> None:
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
    # Hall.2 has no effect, and its flips are in no group.
    for name, flips in (("Hall.1", 0.2), ("Hall.2", 0.0), ("hall-3", 0.03)):
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
    "classes": lambda data: change_pack(data, classes=[["chain", "rope"], ["sand"]]),
    "no classes": lambda data: change_pack(data, classes=None),
    "tolerances": lambda data: change_pack(data, tolerances={"width": 0.1, "height": 0.04}),
    "protocol": lambda data: campaigns_changed(data, protocol=1),
    "exclude": lambda data: campaigns_changed(data, exclude=["chain", "rope"]),
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
