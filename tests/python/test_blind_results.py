"""Committed results of a blind check give its scores again."""

import json
import math
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import vsr2.analysis.intervals as intervals
from blind_check import score
from blind_results import (
    RECORD,
    committed_cases,
    committed_verdicts,
    read_gz,
    read_key,
    read_parts,
    recompute,
    record_of,
    write_gz,
)
from blind_samples import hand_made
from blind_targets import outcomes_table, targets_table
from scored_campaigns import CAMPAIGNS, VERDICTS
from vsr2.blind import score_pack
from vsr2.blind.form.diagnosis_form import ReportedEstimate
from vsr2.blind.form.pack_form import Key
from vsr2.blind.form.reader import parsed
from vsr2.blind.form.seal import open_key, read_json, read_pack
from vsr2.blind.scoring.cases import read_cases
from vsr2.errors import BlindError

RESULTS = Path(__file__).resolve().parents[2] / "docs" / "results"


@pytest.fixture
def pack(tmp_path):
    verdicts = dict(VERDICTS)
    verdicts["d"] = verdicts["d"] | {"provenance": {}, "campaign": {"trials": 3}}
    data, key, out = hand_made(tmp_path, CAMPAIGNS, verdicts)
    (out / "e" / "M" / "diagnosis.json").unlink()
    (out / "e" / "M" / "failed.json").write_text(
        '{"code": "diagnosis_ended", "error": "SimulationError", "message": "no memory"}'
    )
    opened = open_key(data, key)
    cases = read_cases(data, opened, out)
    return data, opened, out, cases, committed_verdicts(read_pack(data).commitment.sha256, cases)


def test_an_interval_without_an_upper_end_is_committed_as_null() -> None:
    estimate = ReportedEstimate(mean=8.0, ci90=(6.5, math.inf))
    plain = json.loads(json.dumps(estimate.model_dump(mode="json"), allow_nan=False))
    assert plain["ci90"] == [6.5, None]
    assert ReportedEstimate.model_validate(plain) == estimate


def test_cases_from_what_is_committed_are_those_of_the_folders(pack) -> None:
    _, key, _, found, content = pack
    content = json.loads(json.dumps(content))
    cases = committed_cases(content, key, "committed")
    # Of parameters those of the true effect's strength alone are kept, as scoring reads no others.
    strengths = {c.id: {e["name"]: e["strength"] for e in c.effects} for c in found}
    wanted = [
        replace(
            case,
            verdict=replace(
                case.verdict,
                parameters={
                    name: own
                    for name, own in case.verdict.parameters.items()
                    if strengths[case.id].get(name) in own
                },
            ),
        )
        for case in found
    ]
    assert [vars(case) for case in cases] == [vars(case) for case in wanted]
    assert cases[0].verdict.parameters == {}
    assert set(cases[2].verdict.parameters) == {"friction"}
    assert next(c for c in cases if c.id == "e").verdict.failed.message == "no memory"
    assert not {"provenance", "campaign"} & set(content["verdicts"]["d"]["M"])


def test_what_is_committed_is_of_its_key(pack) -> None:
    _, key, _, _, content = pack
    with pytest.raises(BlindError, match="not those of the key"):
        committed_cases(content, key | {"campaigns": {"a": key["campaigns"]["a"]}}, "committed")
    with pytest.raises(BlindError, match="schema"):
        committed_cases(content | {"schema": "x"}, key, "committed")
    changed = json.loads(json.dumps(content))
    changed["verdicts"]["a"]["M"]["conformal"] = 3
    with pytest.raises(BlindError, match="committed: a, M"):
        committed_cases(changed, key, "committed")


def test_all_tables_follow_from_what_is_committed(pack, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(intervals, "INTERVALS", replace(intervals.INTERVALS, replicates=2))
    data, _, out, _, content = pack
    committed, tables = tmp_path / "committed", tmp_path / "tables"
    committed.mkdir()
    score_pack(data, tmp_path / "key", out, tmp_path / "scores")
    scores = read_json(tmp_path / "scores" / "scores.json")
    # As if there were a baseline and a leak.
    beside = scores["scores"][0] | {"tier": "commonest"}
    leak = {"question": "kind", "p": 0.5, "best": "trials", "rate": 0.4, "chance": 0.3, "count": 9}
    scores |= {"scores": [*scores["scores"], beside], "leaks": [[leak]], "packs": [1]}
    record = record_of(scores | {"submissions": [2]}, {"M"})
    assert record["scores"] == [beside]
    write_gz(committed / RECORD, record)
    write_gz(committed / "key1.json.gz", read_json(tmp_path / "key" / "key.json"))
    write_gz(committed / "verdicts1.json.gz", content)
    recompute(committed, tables)
    for name in ("scores.md", "reliability.png", "verdicts.csv"):
        assert (tables / name).stat().st_size > 100
    again = read_json(tables / "scores.json")
    assert (again["scores"], again["leaks"]) == (scores["scores"], [[leak]])
    assert len((tables / "verdicts.csv").read_text().splitlines()) == 1 + len(CAMPAIGNS)
    sealed = read_json(tmp_path / "key" / "key.json")
    sealed["key"]["campaigns"]["a"]["engine"] = "bullet"
    write_gz(committed / "key1.json.gz", sealed)
    with pytest.raises(BlindError, match=r"key1\.json\.gz is not that of the scored pack"):
        read_key(committed, 1)


def test_a_check_is_scored_and_its_targets_follow(tmp_path, capsys) -> None:
    part, results = tmp_path / "validation" / "part1", tmp_path / "results"
    assert score("validation", [part], tmp_path, results, None) == 1
    hand_made(part, CAMPAIGNS, VERDICTS)
    assert score("validation", [part], tmp_path, results, None) == 0
    assert sorted(path.name for path in results.iterdir()) == [
        "README.md", "key1.json.gz", "record.json.gz", "verdicts1.json.gz",
    ]  # fmt: skip
    assert "| 1 | mujoco none 2, mujoco pair 1, " in (results / "README.md").read_text()
    (cases,) = read_parts(results)
    rows = [row.split(" | ") for row in targets_table(cases).splitlines()]
    shown = {(row[0], row[1]): (row[2], *row[4:]) for row in rows}
    # a and b of a, b and c; a name of the gap-free f and of c is wrong, of a, b, c and f.
    named = "named rightly (an effect, or at most 3 classes with it)"
    assert shown[f"| {named}", "2+"] == (
        "-",
        "- / .67 [.09, .99] / - (0, 3, 0)",
        ".35 / .65 / .75 |",
    )
    wrong = "| wrong among all named, unknown ones counted"
    assert shown[wrong, "all"][1] == "- / .50 [.07, .93] / - (0, 4, 0)"
    assert shown["| pairs, both names right", "2+"][1] == "- / 1 [.03, 1] / - (0, 1, 0)"
    outcomes = outcomes_table(cases).splitlines()
    assert outcomes[0] == "| verdict | single, 2+ | single, below 2 | pair | unknown | none |"
    assert outcomes[2] == (
        "| named rightly | 0 / 2 / 0 | 0 / 0 / 0 | 0 / 1 / 0 | 0 / 0 / 0 | 0 / 0 / 0 |"
    )


@pytest.mark.parametrize("folder", sorted(p.parent for p in RESULTS.glob("blind_*/key1.json.gz")))
def test_what_was_published_can_be_read(folder) -> None:
    keys = sorted(folder.glob("key*.json.gz"))
    opened = [read_key(folder, number) for number in range(1, 1 + len(keys))]
    campaigns = [key["campaigns"] for key in opened]
    assert all(parsed(Key, key, str(folder), "key") for key in opened)
    for sealed, cases in zip(campaigns, read_parts(folder), strict=True):
        assert {case.id for case in cases} == set(sealed)
    assert set(read_gz(folder / RECORD)) == {"scores", "rates", "leaks", "packs", "submissions"}


@pytest.mark.parametrize("folder", sorted(p.parent for p in RESULTS.glob("blind_*/key1.json.gz")))
def test_of_a_round_no_more_is_kept_than_what_it_is_computed_from(folder) -> None:
    kept = {re.sub(r"\d+", "N", path.name) for path in folder.iterdir()}
    assert kept == {"README.md", "keyN.json.gz", "verdictsN.json.gz", RECORD}


@pytest.mark.parametrize("page", ["blind", "earlier_blind_rounds"])
def test_the_documented_tables_are_those_of_the_study(page) -> None:
    # Both tables of each folder that the page names, as the study prints them.
    root = RESULTS.parents[1]
    documented = (root / "docs" / "validation" / f"{page}.md").read_text()
    commands = re.findall(r"^python studies/blind_targets\.py (.+)$", documented, re.MULTILINE)
    assert commands
    for folders in map(str.split, commands):
        cases = [case for one in folders for part in read_parts(root / one) for case in part]
        scores, verdicts = targets_table(cases), outcomes_table(cases)
        assert len(scores.splitlines()) > 20
        assert len(verdicts.splitlines()) > 5
        assert scores + "\n" in documented
        # Of several rounds the scores alone are shown.
        assert len(folders) > 1 or verdicts + "\n" in documented


def test_the_study_prints_both_tables() -> None:
    root, folder = RESULTS.parents[1], RESULTS / "blind_validation_5"
    command = [sys.executable, str(root / "studies" / "blind_targets.py"), str(folder)]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    cases = [case for part in read_parts(folder) for case in part]
    assert printed == f"{targets_table(cases)}\n\n{outcomes_table(cases)}\n"
