"""What is kept of a scored pack gives its scores again."""

import gzip
import json
import subprocess
import sys
from pathlib import Path

import pytest

import vsr2.blind.scoring.intervals as intervals
from blind_samples import hand_made
from test_blind_score import CAMPAIGNS, VERDICTS
from vsr2.blind.form.seal import open_key, read_json
from vsr2.blind.scoring.cases import read_cases
from vsr2.blind.scoring.kept import keep_diagnoses, kept_cases, what_is_read
from vsr2.blind.scoring.packs import Scored
from vsr2.blind.scoring.score import CALIBRATION_NOISE, score_cases
from vsr2.errors import BlindError

RESULTS = Path(__file__).resolve().parents[2] / "docs" / "results"


@pytest.fixture
def pack(tmp_path):
    verdicts = dict(VERDICTS)
    extra = {"unknown": {"probability": 0.1, "novelty_p": 0.4, "why": "long"}}
    extra |= {"provenance": {}, "campaign": {"trials": 3}}
    verdicts["d"] = verdicts["d"] | extra | {"none_probability": 0.8}
    data, key, out = hand_made(tmp_path, CAMPAIGNS, verdicts)
    (out / "e" / "M" / "diagnosis.json").unlink()
    (out / "e" / "M" / "failed.json").write_text('{"error": "no memory"}')
    return data, open_key(data, key), out


def test_cases_from_what_is_kept_are_those_of_the_folders(pack) -> None:
    data, key, out = pack
    kept = json.loads(json.dumps(keep_diagnoses(data, key, out)))
    cases = kept_cases(kept, key, "kept")
    found = read_cases(data, key, out)
    assert [vars(case) for case in cases] == [vars(case) for case in found]
    assert next(c for c in cases if c.id == "e").verdict.failed == "no memory"
    # Nothing else is kept.
    content = kept["diagnoses"]["d"]["M"]
    assert content["unknown"] == {"probability": 0.1, "novelty_p": 0.4}
    assert not {"provenance", "campaign"} & set(content)


def test_what_is_kept_is_of_its_key(pack) -> None:
    data, key, out = pack
    kept = keep_diagnoses(data, key, out)
    with pytest.raises(BlindError, match="not those of the key"):
        kept_cases(kept, key | {"campaigns": {"a": key["campaigns"]["a"]}}, "kept")
    with pytest.raises(BlindError, match="schema"):
        kept_cases(kept | {"schema": "x"}, key, "kept")
    changed = json.loads(json.dumps(kept))
    changed["diagnoses"]["a"]["M"]["conformal_set_90"] = 3
    with pytest.raises(BlindError, match="kept: a, M"):
        kept_cases(changed, key, "kept")


def test_what_scoring_does_not_read_is_left_out() -> None:
    full = VERDICTS["b"] | {"effects": [VERDICTS["b"]["effects"][0] | {"class": "x", "unit": "1"}]}
    assert set(what_is_read(full)["effects"][0]) == {"name", "probability", "parameters"}


def test_the_published_scores_follow_from_what_is_published(monkeypatch) -> None:
    # Values; intervals, and means over draws, which take the time, are compared by the study's
    # --recompute.
    monkeypatch.setattr(intervals, "REPLICATES", 2)
    folder = RESULTS / "blind_validation_5"
    cases = []
    for number in (1, 2):
        key = json.loads(gzip.decompress((folder / f"key{number}.json.gz").read_bytes()))["key"]
        path = folder / f"diagnoses{number}.json.gz"
        kept = json.loads(gzip.decompress(path.read_bytes()))
        assert len(kept["diagnoses"]) == 86
        cases += kept_cases(kept, key, str(path))
    found = {
        (row["tier"], row["group"], row["score"]): (row["value"], row["campaigns"])
        for row in Scored(score_cases(cases), [], cases, False).to_json()["scores"]
        if row["score"] != CALIBRATION_NOISE
    }
    told = {
        (row["tier"], row["group"], row["score"]): (row["value"], row["campaigns"])
        for row in read_json(folder / "scores.json")["scores"]
        if row["tier"] in ("B", "M", "T") and row["score"] != CALIBRATION_NOISE
    }
    assert len(told) > 800
    assert found == told


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
