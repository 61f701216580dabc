"""Committed results of a blind check give its scores again."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

import vsr2.blind.scoring.intervals as intervals
from blind_results import (
    SCORES,
    committed_cases,
    committed_verdicts,
    read_gz,
    read_key,
    read_parts,
    recompute,
    write_gz,
)
from blind_samples import hand_made
from test_blind_score import CAMPAIGNS, VERDICTS
from vsr2.blind import score_pack
from vsr2.blind.form.seal import open_key, read_json
from vsr2.blind.scoring.cases import read_cases
from vsr2.blind.scoring.score import CALIBRATION_NOISE, score_cases
from vsr2.blind.scoring.tables import Scored
from vsr2.errors import BlindError

RESULTS = Path(__file__).resolve().parents[2] / "docs" / "results"


@pytest.fixture
def pack(tmp_path):
    verdicts = dict(VERDICTS)
    extra = {"unknown": {"probability": 0.1, "novelty_p": 0.4, "why": "long"}}
    extra |= {"provenance": {}, "campaign": {"trials": 3}}
    verdicts["d"] = verdicts["d"] | extra | {"none_probability": 0.8}
    reasons = {"reasons": [{"code": "gap", "text": "a gap"}, {"code": "size_open", "text": "so"}]}
    verdicts["h"] = verdicts["h"] | {"verdict": verdicts["h"]["verdict"] | reasons}
    data, key, out = hand_made(tmp_path, CAMPAIGNS, verdicts)
    (out / "e" / "M" / "diagnosis.json").unlink()
    (out / "e" / "M" / "failed.json").write_text('{"error": "no memory"}')
    return data, open_key(data, key), out


def test_cases_from_what_is_committed_are_those_of_the_folders(pack) -> None:
    data, key, out = pack
    content = json.loads(json.dumps(committed_verdicts(data, key, out)))
    cases = committed_cases(content, key, "committed")
    found = read_cases(data, key, out)
    assert [vars(case) for case in cases] == [vars(case) for case in found]
    assert next(c for c in cases if c.id == "e").verdict.failed == "no memory"
    # Nothing else is kept but why an unresolved one names nothing.
    assert not {"provenance", "campaign"} & set(content["verdicts"]["d"]["M"])
    assert content["withheld"] == {"h M": "size_open"}


def test_what_is_committed_is_of_its_key(pack) -> None:
    data, key, out = pack
    content = committed_verdicts(data, key, out)
    with pytest.raises(BlindError, match="not those of the key"):
        committed_cases(content, key | {"campaigns": {"a": key["campaigns"]["a"]}}, "committed")
    with pytest.raises(BlindError, match="schema"):
        committed_cases(content | {"schema": "x"}, key, "committed")
    changed = json.loads(json.dumps(content))
    changed["verdicts"]["a"]["M"]["conformal"] = 3
    with pytest.raises(BlindError, match="committed: a, M"):
        committed_cases(changed, key, "committed")


def test_all_tables_follow_from_what_is_committed(pack, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(intervals, "REPLICATES", 2)
    data, key, out = pack
    committed, tables = tmp_path / "committed", tmp_path / "tables"
    committed.mkdir()
    score_pack(data, tmp_path / "key", out, tmp_path / "scores")
    write_gz(committed / SCORES, read_json(tmp_path / "scores" / "scores.json"))
    write_gz(committed / "key1.json.gz", read_json(tmp_path / "key" / "key.json"))
    write_gz(committed / "verdicts1.json.gz", committed_verdicts(data, key, out))
    assert recompute(committed, tables) == 0
    for name in ("scores.md", "part1.md", "scores.json", "reliability.png", "verdicts.csv"):
        assert (tables / name).stat().st_size > 100
    assert "| top-1 class (single) | 0.50 [0.07, 0.93] (4) |" in (tables / "part1.md").read_text()
    record = read_gz(committed / SCORES)
    record["scores"][0]["value"] += 0.01
    write_gz(committed / SCORES, record)
    assert recompute(committed) == 1
    sealed = read_json(tmp_path / "key" / "key.json")
    sealed["key"]["campaigns"]["a"]["engine"] = "bullet"
    write_gz(committed / "key1.json.gz", sealed)
    with pytest.raises(BlindError, match=r"key1\.json\.gz is not that of the scored pack"):
        read_key(committed, 1)


def test_the_published_scores_follow_from_what_is_published(monkeypatch) -> None:
    # Values; intervals, and means over draws, which take the time, are compared by the study's
    # --recompute.
    monkeypatch.setattr(intervals, "REPLICATES", 2)
    folder = RESULTS / "blind_validation_5"
    parts = list(read_parts(folder))
    assert [len({case.id for case in part.cases}) for part in parts] == [86, 86]
    cases = [case for part in parts for case in part.cases]
    found = {
        (row["tier"], row["group"], row["score"]): (row["value"], row["campaigns"])
        for row in Scored(score_cases(cases), [], cases, False).to_json()["scores"]
        if row["score"] != CALIBRATION_NOISE
    }
    recorded = {
        (row["tier"], row["group"], row["score"]): (row["value"], row["campaigns"])
        for row in read_gz(folder / SCORES)["scores"]
        if row["tier"] in ("B", "M", "T") and row["score"] != CALIBRATION_NOISE
    }
    assert len(recorded) > 800
    # Later versions know more scores.
    known = {score for _, _, score in recorded}
    assert {row: value for row, value in found.items() if row[2] in known} == recorded


def test_the_documented_scores_are_those_of_the_last_round() -> None:
    # Both tables in docs/validation/blind.md, as the study prints them.
    root = RESULTS.parents[1]
    study = [sys.executable, str(root / "studies" / "blind_targets.py")]
    command = [*study, str(RESULTS / "blind_validation_5")]
    tables = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    scores, verdicts = tables.strip().split("\n\n")
    assert len(scores.splitlines()) > 20
    assert len(verdicts.splitlines()) > 5
    documented = (root / "docs" / "validation" / "blind.md").read_text()
    assert scores + "\n" in documented
    assert verdicts + "\n" in documented
