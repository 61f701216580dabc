"""Packs, keys and diagnoses of others that cannot be used are refused, and harm nothing."""

import copy
import json
import math

import pytest

from blind_check import pool_packs
from blind_samples import assert_pack_refused, stand_in
from foreign_pack import (
    KEY,
    VERDICTS,
    Reported,
    a_verdict,
    change_pack,
    folder_hash,
    plain,
    seal,
    sha256,
    write_diagnoses,
    write_pack,
)
from vsr2.blind import diagnose_pack, score_pack
from vsr2.blind.form.diagnosis_form import verdict_of
from vsr2.blind.form.events import EventCode
from vsr2.blind.form.pack_form import Listed
from vsr2.blind.form.seal import open_key, read_pack
from vsr2.blind.pack_diagnoses import _excluded, pack_nuisances
from vsr2.blind.scoring.cases import groups, read_cases
from vsr2.blind.scoring.score import (
    in_set,
    log_loss,
    magnitude,
    right,
    where_gain,
    wrong,
)
from vsr2.cli.main import main
from vsr2.errors import BlindError, ConfigError


@pytest.fixture(autouse=True)
def _reported(monkeypatch):
    stand_in(monkeypatch, Reported)


@pytest.fixture
def pack(tmp_path):
    data, key = write_pack(tmp_path)
    return data, key, write_diagnoses(data, tmp_path / "out")


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
        (
            {"tolerances": {"frictoin": 0.1}},
            r"tolerances\.frictoin is 0\.1; there is no such key; do you mean .friction.",
        ),
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
            r"nuisances\[0\]\.effect: there is no effect 'frction'; did you mean",
        ),
        (
            {"priors": {"friction.factor": {"distribution": "norml"}}},
            r"priors\.friction\.factor\.distribution is 'norml'; did you mean `normal`",
        ),
        (
            {"priors": {"friction.fctor": {"distribution": "normal", "sd": 1}}},
            r"priors\.friction\.fctor is .*no parameter 'fctor'; did you mean `factor`",
        ),
        (
            {"priors": {"friction.factor": {"distribution": "normal", "mean": 1, "sd": 0}}},
            r"priors\.friction\.factor is .* from 1 to 1 has no width; widen it, or leave it out",
        ),
        ({"nuisanses": []}, r"nuisanses is \[\]; there is no such key; do you mean 'nuisances'"),
        ({"priros": {}}, "priros is {}; .* do you mean 'priors'"),
        ({"nuisance": [], "nuisances": []}, r"nuisance is \[\]; .* do you mean 'nuisances'"),
        (
            {"campaigns": [{"id": "c", "exlude": ["wear"]}]},
            r"campaigns\[0\]\.exlude is \['wear'\]; .* do you mean 'exclude'",
        ),
        (
            {"classes": [["table_gian", "slenderness"]]},
            r"classes\[0\]\[0\] is 'table_gian'; there is no effect .* do you mean 'table_gain'",
        ),
        (
            {
                "nuisances": [
                    {
                        "effect": "table_saturation",
                        "parameter": "return_frequency",
                        "distribution": "loguniform",
                        "low": 1,
                        "high": 2,
                    }
                ]
            },
            "nuisances is .* return_frequency does nothing on its own; add a nuisance of another",
        ),
        ({"commitment": {}}, r"commitment\.sha256 is missing; give it"),
        ({"commitment": "abc"}, "commitment is 'abc'; it should be a mapping"),
    ],
)
def test_a_pack_that_cannot_be_used_is_named(changes, message, tmp_path) -> None:
    assert_pack_refused(changes, message, tmp_path)


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
        (
            ("campaigns", "hall-3", "effects"),
            [{"name": "wear", "values": {"loss": 0.1}, "strength": "loss", "null": 0.0}],
            "it should hold wear, as the kind is unknown",
        ),
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
    if fault is not None:
        listed = {"campaigns": [{"id": "c", "exclude": [name]}]}
        message = rf"campaigns\[0\]\.exclude\[0\] is '{name}'; .* do you mean '{fault}'"
        assert_pack_refused(listed, message, tmp_path)
        return
    said = []
    kept = _excluded(Listed(id="c", exclude=(name, "catch")), said.append)
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
