"""What is scored, once, with which diagnoses; packs pooled."""

import dataclasses
import json
import shutil

import pytest

from blind_check import pool_packs
from blind_samples import hand_made, same_folders
from diagnosis_content import CONTENT
from scored_campaigns import CAMPAIGNS, VERDICTS
from vsr2.analysis.intervals import (
    INTERVALS,
)
from vsr2.blind import score_pack
from vsr2.blind.form.diagnosis_form import read_verdict, verdict_of
from vsr2.blind.scoring.baselines import BASELINE
from vsr2.blind.scoring.cases import GROUPS
from vsr2.blind.scoring.leaks import LEAKS
from vsr2.blind.scoring.metadata import METADATA
from vsr2.blind.scoring.score import (
    SCORING,
    ScoreCode,
)
from vsr2.diagnosis.verdict.document import SCHEMA
from vsr2.diagnosis.verdict.statements import VerdictKind
from vsr2.errors import BlindError


@pytest.fixture
def pack(tmp_path):
    return hand_made(tmp_path, CAMPAIGNS, VERDICTS)


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"tier": "T"}, r"a/M/diagnosis.json: campaign.tier is 'T', and lies in the folder of 'M'"),
        ({"name": "b"}, r"a/M/diagnosis.json: campaign.name is 'b', and lies in .* 'a'"),
    ],
)
def test_a_diagnosis_in_another_s_place_is_refused(said, message, tmp_path) -> None:
    verdicts = VERDICTS | {"a": VERDICTS["a"] | {"campaign": said}}
    pack = hand_made(tmp_path, CAMPAIGNS, verdicts)
    with pytest.raises(BlindError, match=message):
        score_pack(*pack, tmp_path / "scores")
    assert not (pack[1] / "receipt.json").exists()


def test_a_damaged_receipt_is_not_written_over(pack, tmp_path) -> None:
    score_pack(*pack, tmp_path / "scores")
    (pack[1] / "receipt.json").write_text("{")
    with pytest.raises(BlindError, match=r"receipt.json: cannot be read; .* get it back"):
        score_pack(*pack, tmp_path / "scores")
    assert (pack[1] / "receipt.json").read_text() == "{"


def test_diagnoses_behind_links_are_refused(pack, tmp_path) -> None:
    # They could be changed after the pack was scored, and the folder's hash be the same.
    linked = tmp_path / "linked"
    linked.mkdir()
    for path in pack[2].iterdir():
        (linked / path.name).symlink_to(path)
    with pytest.raises(BlindError, match=r"linked/.: is a link to a folder"):
        score_pack(*pack[:2], linked, tmp_path / "scores")
    assert not (pack[1] / "receipt.json").exists()


def test_a_pack_is_scored_once(pack, tmp_path) -> None:
    score_pack(*pack, tmp_path / "scores")
    receipt = json.loads((pack[1] / "receipt.json").read_text())
    assert receipt["scores"]
    assert "campaigns" not in receipt
    # The same diagnoses again, as after a run that was killed while it wrote its files.
    score_pack(*pack, tmp_path / "again")
    assert json.loads((pack[1] / "receipt.json").read_text()) == receipt
    assert same_folders(tmp_path / "scores", tmp_path / "again")
    changed = next(pack[2].glob("*/M/diagnosis.json"))
    changed.write_text(changed.read_text().replace("0.8", "0.9") + " ")
    with pytest.raises(BlindError, match="nowhere: no such folder"):
        score_pack(*pack[:2], tmp_path / "nowhere", tmp_path / "more")
    with pytest.raises(BlindError, match=r"with other diagnoses than .*scored once"):
        score_pack(*pack, tmp_path / "third")
    assert not (tmp_path / "third").exists()


def test_what_was_not_diagnosed_uses_no_pack_up(tmp_path) -> None:
    data, key, out = hand_made(tmp_path, CAMPAIGNS, VERDICTS, tiers=("M", "T"))
    for folder in out.glob("*/T"):
        shutil.rmtree(folder)
    with pytest.raises(BlindError, match=r"no diagnosis at tier T .*--tier"):
        score_pack(data, key, out, tmp_path / "scores")
    with pytest.raises(BlindError, match="has no tier B; it has M, T"):
        score_pack(data, key, out, tmp_path / "scores", tiers=["B"])
    assert not (key / "receipt.json").exists()
    scored = score_pack(data, key, out, tmp_path / "scores", tiers=["M"])
    assert {tier for tier, _ in scored.scores} == {"M"}


def test_an_open_pack_shows_its_campaigns_and_is_scored_again(tmp_path) -> None:
    pack = hand_made(tmp_path, CAMPAIGNS, VERDICTS, development=True)
    score_pack(*pack, tmp_path / "scores")
    score_pack(*pack, tmp_path / "again")
    content = json.loads((tmp_path / "again" / "scores.json").read_text())
    assert {c["id"] for c in content["campaigns"] if c["right"]} == {"a", "b", "e", "g", "i"}


def test_scores_state_the_constants_that_they_rest_on(pack, tmp_path) -> None:
    score_pack(*pack, tmp_path / "scores")
    used = {
        "scoring": SCORING, "groups": GROUPS, "intervals": INTERVALS, "baselines": BASELINE,
        "leaks": LEAKS, "metadata": METADATA,
    }  # fmt: skip
    wanted = json.loads(json.dumps({name: dataclasses.asdict(one) for name, one in used.items()}))
    for path in (tmp_path / "scores" / "scores.json", pack[1] / "receipt.json"):
        assert json.loads(path.read_text())["constants"] == wanted


def test_a_changed_key_is_refused(pack, tmp_path) -> None:
    path = pack[1] / "key.json"
    path.write_text(path.read_text().replace('"friction"', '"restitution"', 1))
    with pytest.raises(BlindError, match="was changed"):
        score_pack(*pack, tmp_path / "scores")
    assert not (pack[1] / "receipt.json").exists()


def test_changed_data_are_refused(pack, tmp_path) -> None:
    (pack[0] / "c" / "trials.csv").write_text("other")
    with pytest.raises(BlindError, match="differ from the sealed ones"):
        score_pack(*pack, tmp_path / "scores")


@pytest.mark.parametrize("changed", [["change_point", "wear"], [], ["catch", "inertia"]])
def test_a_changed_exclusion_is_refused(changed, pack, tmp_path) -> None:
    path = pack[0] / "pack.json"
    content = json.loads(path.read_text())
    assert content["campaigns"][6]["exclude"] == ["catch"]
    content["campaigns"][6]["exclude"] = changed
    path.write_text(json.dumps(content))
    with pytest.raises(BlindError, match="exclude of g"):
        score_pack(*pack, tmp_path / "scores")


def test_scores_that_cannot_be_written_leave_the_pack_unscored(pack, tmp_path) -> None:
    (tmp_path / "file").write_text("")
    for out in (tmp_path / "file", tmp_path / "file" / "scores"):
        with pytest.raises(BlindError, match="no folder can be made there"):
            score_pack(*pack, out)
        assert not (pack[1] / "receipt.json").exists()
    score_pack(*pack, tmp_path / "new" / "scores")
    assert (tmp_path / "new" / "scores" / "scores.json").exists()


def test_a_missing_diagnosis_is_refused_before_the_receipt(pack, tmp_path) -> None:
    (pack[2] / "d" / "M" / "diagnosis.json").unlink()
    with pytest.raises(BlindError, match=r"diagnosis\.json: no such file"):
        score_pack(*pack, tmp_path / "scores")
    assert not (pack[1] / "receipt.json").exists()
    failed = pack[2] / "d" / "M" / "failed.json"
    failed.write_text('{"error": "no motion"}')
    with pytest.raises(BlindError, match=r"failed\.json.*code"):
        score_pack(*pack, tmp_path / "scores")
    failed.write_text(
        '{"code": "diagnosis_ended", "error": "CampaignError", "message": "no motion"}'
    )
    scores = score_pack(*pack, tmp_path / "scores").scores["M", "all"]
    assert scores[ScoreCode.UNRESOLVED].value == pytest.approx(2 / 9)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('{"pack": "abc"}', "pack is 'abc': the diagnoses are of another pack"),
        ('{"pack": null}', "pack is null: the diagnoses are of another pack"),
        ('{"pack": 1e400}', "is no JSON"),
        ("[]", "holds no mapping"),
        ("{", "is no JSON"),
    ],
)
def test_diagnoses_of_another_pack_are_refused(content, message, pack, tmp_path) -> None:
    (pack[2] / "submission.json").write_text(content)
    with pytest.raises(BlindError, match=rf"submission\.json: {message}.*; "):
        score_pack(*pack, tmp_path / "scores")
    assert not (tmp_path / "scores").exists()


@pytest.mark.parametrize("left", [{}, {"submission": 7}, {"submission": "0" * 64}])
def test_a_receipt_altered_by_hand_scores_nothing(left, pack, tmp_path) -> None:
    score_pack(*pack, tmp_path / "scores")
    receipt = pack[1] / "receipt.json"
    receipt.write_text(json.dumps(left))
    with pytest.raises(BlindError, match=r"receipt\.json: the pack was scored on .* a new one"):
        score_pack(*pack, tmp_path / "again")
    assert json.loads(receipt.read_text()) == left
    assert not (tmp_path / "again").exists()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": "other"}, "schema is 'other'"),
        ({"verdict": {"kind": "maybe"}}, r"verdict\.kind is 'maybe'"),
        ({"effects": [{"name": "a", "probability": 1.5}]}, "a probability"),
        (
            {"effects": [{"name": "a", "probability": 0.7}, {"name": "b", "probability": 0.7}]},
            "sum",
        ),
        ({"effects": [{"name": "a", "probability": 0.1}] * 2}, "once"),
        ({"effects": [{"probability": 0.1}]}, r"effects\[0\]\.name"),
        ({"conformal_set_90": "a"}, "a list"),
        ({"where": [{"trials": ["T1"]}]}, r"where\[0\]\.axis"),
        (
            {"effects": [{"name": "a", "probability": 0.1, "parameters": {"x": {"ci90": [0, 1]}}}]},
            r"parameters\.x\.mean",
        ),
    ],
)
def test_a_wrong_diagnosis_is_named(change, message, tmp_path) -> None:
    with pytest.raises(BlindError, match=message):
        verdict_of(VERDICTS["a"] | change, "diagnosis.json")


def test_scoring_reads_what_a_diagnosis_writes() -> None:
    verdict = verdict_of(CONTENT, "diagnosis.json")
    assert (verdict.kind, verdict.effects) == (VerdictKind.EFFECT, ("wear",))
    assert verdict.probabilities == {"wear": 0.76, "catch": 0.09, "none": 0.05, "unknown": 0.1}
    assert verdict.conformal == ("wear",)
    assert verdict.parameters["catch"]["size"].mean == 0.11
    assert verdict.parameters["catch"]["size"].ci90 == (0.06, 0.16)
    assert (verdict.closure, verdict.headline, verdict.gain) == (0.83, 0.5, (0.49, 0.51))
    # Others are significant, and do not stand out.
    assert [one.trials for one in verdict.where] == [{"A", "B"}]
    nothing = {"value": None, "ci95": None}
    gap = CONTENT["gap"] | {"closure": nothing, "headline": nothing, "gain": nothing}
    none = verdict_of(CONTENT | {"gap": gap, "where": []}, "diagnosis.json")
    assert (none.closure, none.headline, none.gain, none.where) == (None, None, None, ())


def test_a_bare_verdict_is_enough() -> None:
    verdict = verdict_of({"schema": SCHEMA, "verdict": {"kind": "none", "probability": 0.7}}, "x")
    assert verdict.probabilities == {"none": 0.7}
    assert verdict.closure is None


def test_none_and_unknown_may_be_distinguished_from_the_effects() -> None:
    reported = {"none_probability": 0.0, "unknown": {"probability": 0.05}}
    content = VERDICTS["c"] | reported
    content["effects"] = content["effects"][:2]
    probabilities = verdict_of(content, "x").probabilities
    assert (probabilities["none"], probabilities["unknown"]) == (0.0, 0.05)
    # Among the effects they count first.
    assert verdict_of(VERDICTS["c"] | reported, "x").probabilities["unknown"] == 0.1


def test_broken_json_is_named(tmp_path) -> None:
    (tmp_path / "diagnosis.json").write_text("{")
    with pytest.raises(BlindError, match="is no JSON"):
        read_verdict(tmp_path)


def test_scored_packs_are_pooled(tmp_path) -> None:
    parts = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        parts.append(hand_made(tmp_path / name, CAMPAIGNS, VERDICTS))
    with pytest.raises(BlindError, match="not scored yet"):
        pool_packs(parts, tmp_path / "pooled")
    alone = [score_pack(*part, tmp_path / f"s{i}") for i, part in enumerate(parts)]
    pooled = pool_packs(parts, tmp_path / "pooled").scores["M", "all"]
    for name, score in alone[0].scores["M", "all"].items():
        assert pooled[name].count == 2 * score.count
        if name not in (ScoreCode.UNKNOWN_RATE, ScoreCode.CALIBRATION_NOISE):
            assert pooled[name].value == pytest.approx(score.value), name
    assert (tmp_path / "pooled" / "scores.md").exists()
    verdict = parts[1][2] / "a" / "M" / "diagnosis.json"
    verdict.write_text(verdict.read_text().replace("0.6", "0.7"))
    with pytest.raises(BlindError, match="changed after they were scored"):
        pool_packs(parts, tmp_path / "pooled")


def test_tiers_are_scored_and_pooled_alone(tmp_path) -> None:
    part = hand_made(tmp_path, CAMPAIGNS, VERDICTS, tiers=("B", "M"))
    shutil.rmtree(part[2] / "a" / "B")
    with pytest.raises(BlindError, match=r"a/B/diagnosis.json: no such file"):
        score_pack(*part, tmp_path / "s")
    alone = score_pack(*part, tmp_path / "s", tiers=["M"])
    pooled = pool_packs([part], tmp_path / "pooled", tiers=["M"])
    assert {tier for tier, _ in pooled.scores} == {"M"}
    assert pooled.scores == alone.scores
