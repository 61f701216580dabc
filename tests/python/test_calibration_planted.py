"""Calibration on a simulated campaign whose values are known: found, resumed, reported."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import command_line
from calibration_samples import KNOWN_YAW, STUDY, planted_study, write_planted
from vsr2.calibration import (
    CalibrationInterrupted,
    Evaluation,
    EvaluationStore,
    Evaluator,
    calibrate,
    evaluations_at_most,
    load_calibration,
    prepare_calibration_folder,
    usable_trials,
)
from vsr2.calibration.calibration_study import CALIBRATION
from vsr2.calibration.evaluation import campaign_sha256
from vsr2.calibration.objective import metrics_of
from vsr2.campaign import Campaign, RunOptions, load_campaign, simulate_campaign
from vsr2.config import load_study
from vsr2.errors import CampaignError, ConfigError, ResultError


@pytest.fixture(scope="module")
def planted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("planted")
    path = write_planted(folder)
    run(path, "--out", folder / "complete", "--threads", 1, "--quiet")
    return folder


run = partial(command_line.run, "calibrate")


def rows(path: Path) -> list[dict[str, str]]:
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def test_the_planted_azimuth_is_found_and_the_dead_knob_is_reported(planted):
    complete = planted / "complete"
    study = load_study(complete / "best.yaml", check_files=False)
    assert abs(study.rock.start.yaw - KNOWN_YAW) < 8
    verdicts = {row["parameter"]: row["verdict"] for row in rows(complete / "profiles.csv")}
    # Impacts of this block are too slow for restitution to bounce.
    assert verdicts == {"yaw": "identified", "restitution": "not_identified"}
    scores = {(r["prediction"], r["fitted"]): r for r in rows(complete / "scores.csv")}
    inside = float(scores["simulator", "in_sample"]["objective"])
    outside = float(scores["simulator", "out_of_fold"]["objective"])
    assert inside > 0.95
    assert 0.8 < outside <= inside
    assert ("logistic", "out_of_fold") in scores


def test_the_files_hold_together(planted):
    complete = planted / "complete"
    predictions = rows(complete / "predictions.csv")
    truth = load_campaign(planted / "truth")
    assert [row["trial"] for row in predictions] == [trial.trial for trial in truth.trials]
    assert all(int(r["observed"]) == t.overturned
               for r, t in zip(predictions, truth.trials, strict=True))  # fmt: skip
    observed = np.array([int(row["observed"]) for row in predictions])
    outside = np.array([int(row["out_of_fold"]) for row in predictions])
    scores = {(r["prediction"], r["fitted"]): r for r in rows(complete / "scores.csv")}
    accuracy = float(scores["simulator", "out_of_fold"]["accuracy"])
    assert accuracy == pytest.approx((observed == outside).mean())
    folds = rows(complete / "folds.csv")
    assert sum(int(row["trials"]) for row in folds) == 24
    evaluations = rows(complete / "evaluations.csv")
    lines = (complete / "evaluations.jsonl").read_text().splitlines()
    assert len(evaluations) == len(lines) - 1
    assert len({row["plan_sha256"] for row in evaluations}) == len(evaluations)
    provenance = json.loads((complete / "provenance.json").read_text())
    assert provenance["evaluations"] == provenance["simulated_in_this_run"] == len(evaluations)
    assert provenance["seed"] == 3
    assert provenance["constants"]["calibration"] == asdict(CALIBRATION)
    page = (complete / "report.md").read_text()
    for word in ("Optimism", "logistic", "Not identified by this campaign: restitution", "yaw"):
        assert word in page
    for name in ("profiles", "search", "predictions"):
        assert (complete / "figures" / f"{name}.png").stat().st_size > 10_000
        assert (complete / "figures" / f"{name}.pdf").exists()
    assert not (complete / "running").exists()


def same_result(one: Path, other: Path) -> None:
    for name in ("predictions.csv", "folds.csv", "scores.csv", "profiles.csv", "best.yaml"):
        assert (one / name).read_bytes() == (other / name).read_bytes(), name
    left, right = (
        [{k: v for k, v in row.items() if k != "seconds"} for row in rows(f / "evaluations.csv")]
        for f in (one, other)
    )
    assert left == right


def test_a_killed_calibration_goes_on_to_the_same_result(planted, caplog):
    folder = planted / "killed"
    code = (
        "from vsr2.calibration import *\n"
        f"calibrate(load_calibration({str(planted / 'study.yaml')!r}), "
        f"prepare_calibration_folder({str(folder)!r}), threads=1)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code])
    file = folder / "evaluations.jsonl"
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and process.poll() is None:
        if file.exists() and file.read_bytes().count(b"\n") >= 4:
            break
        time.sleep(0.005)
    assert process.poll() is None
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    done = file.read_bytes().count(b"\n") - 1
    with pytest.raises(ResultError, match="--resume"):
        run(planted / "study.yaml", "--out", folder, "--quiet")
    # With another number of threads, on which nothing depends.
    with caplog.at_level("INFO", "vsr2.cli.verb_calibrate"):
        assert run(planted / "study.yaml", "--out", folder, "--resume", "--quiet", "--no-figures",
                   "--threads", 2) == 0  # fmt: skip
    provenance = json.loads((folder / "provenance.json").read_text())
    assert 3 <= done < provenance["evaluations"]
    assert provenance["simulated_in_this_run"] == provenance["evaluations"] - done
    said = f"{provenance['evaluations']} sets in all, {provenance['simulated_in_this_run']} of them"
    assert f"; {said} simulated now" in caplog.text
    same_result(folder, planted / "complete")


def test_an_interrupt_within_an_evaluation_keeps_the_trials_that_are_finished(
    planted, tmp_path, monkeypatch
):
    import vsr2.calibration.evaluation as room

    study = load_calibration(planted / "study.yaml")
    campaign = usable_trials(load_campaign(planted / "truth"))
    folder = prepare_calibration_folder(tmp_path)
    original = room.run_batch
    ran: list[int] = []

    def interrupted(trials, **options):
        def stop(i, log):
            ran.append(i)
            if len(ran) == 5:
                signal.raise_signal(signal.SIGINT)

        return original(trials, **{**options, "threads": 1, "on_trial": stop})

    values = {"yaw": 10.0, "restitution": 0.1}
    with EvaluationStore(folder, campaign_sha256(campaign), len(campaign)) as store:
        evaluate = Evaluator(study, campaign, store, folder, threads=1)
        monkeypatch.setattr(room, "run_batch", interrupted)
        with pytest.raises(CalibrationInterrupted):
            evaluate(values)
        assert len(store) == 0
        assert list((folder / "running").glob("*/journal.jsonl"))
        first = list(ran)
        ran[:] = range(100, 200)  # counts on, so that nothing is interrupted again
        found = evaluate(values)
        again = [i for i in ran if i < 100]
        assert not found.failed
        assert len(first) + len(again) in (24, 25)  # one was cancelled at most
        assert evaluate.simulated == 1
        assert evaluate(values) is not None
        assert evaluate.simulated == 1
        # Other values that come to the same trials are not simulated again.
        monkeypatch.setattr(room, "run_batch", None)
        same = evaluate({"yaw": 10, "restitution": 0.1})
        np.testing.assert_array_equal(same.predicted, found.predicted)
    assert not (folder / "running").exists()


def test_the_sequential_table_has_the_supplements_columns(planted, capsys):
    text = STUDY.replace("range: [0.0, 60.0]", "values: [0, 35, 60]").replace(
        "range: [0.0, 0.9]", "values: [0.35, 0.6]"
    )
    text = text.replace("method: {kind: joint, design: 8, refine: 3, profile_points: 4}",
                        "method: {kind: sequential}").replace("folds: 3", "folds: 0")  # fmt: skip
    path = planted / "sequential.yaml"
    path.write_text(text)
    out = planted / "sequential"
    assert run(path, "--out", out, "--threads", 1) == 0
    table = rows(out / "table.csv")
    assert list(table[0]) == [
        "iteration", "group", "yaw", "restitution",
        "accuracy", "precision", "recall", "f1", "objective",
    ]  # fmt: skip
    assert [(r["iteration"], r["group"], r["yaw"]) for r in table[:3]] == [
        ("1", "yaw", "0"),
        ("1", "yaw", "35"),
        ("1", "yaw", "60"),
    ]
    assert table[1]["objective"] == "1.000"
    # Carried forward; the second iteration brings nothing and is the last.
    assert {row["yaw"] for row in table if row["group"] == "restitution"} == {"35"}
    assert {row["iteration"] for row in table} == {"1", "2"}
    assert not (out / "folds.csv").exists()
    assert "in sample" in capsys.readouterr().out
    assert "Set `folds`" in (out / "report.md").read_text()


def test_a_campaign_that_tells_nothing_is_refused(planted, tmp_path):
    truth = load_campaign(planted / "truth")
    standing = truth.select(truth.overturned == 0)
    from vsr2.campaign import save_campaign

    save_campaign(standing, tmp_path / "truth")
    (tmp_path / "study.yaml").write_text(STUDY)
    study = load_calibration(tmp_path / "study.yaml")
    with pytest.raises(CampaignError, match="ended alike"):
        calibrate(study, prepare_calibration_folder(tmp_path / "out"))
    nothing = Campaign(
        name="n", trials=tuple(type(t)(**{**vars(t), "motion_file": None}) for t in truth.trials),
        specimens=truth.specimens,
    )  # fmt: skip
    with pytest.raises(CampaignError, match="both a motion and an outcome"):
        usable_trials(nothing)


def test_a_screened_search_is_judged_on_all_trials_by_the_engine_asked_for(planted, tmp_path):
    method = f"refine: 1, profile_points: 0, screen: 4, sets: [{{yaw: {KNOWN_YAW}}}]"
    text = STUDY.replace("refine: 3, profile_points: 4", method)
    text = text.replace("folds: 3", "folds: 2").replace("resamples: 200", "resamples: 100")
    path = planted / "screened.yaml"
    path.write_text(text + "judged_with: {engine.mode: exact}\n")
    study = load_calibration(path)
    # What an earlier run without the screen knows must not change what a search with it sees.
    shutil.copy(planted / "complete" / "evaluations.jsonl", tmp_path)
    ran: list[Evaluation] = []
    known = calibrate(study, tmp_path, threads=1, on_evaluation=ran.append)
    fresh = calibrate(study, prepare_calibration_folder(tmp_path / "new"), threads=1)
    assert len(known.steps) < len(ran) <= evaluations_at_most(study.own) + 1
    for result in (known, fresh):
        screen = result.screen
        assert screen is not None
        first = np.stack([step.evaluation.predicted for step in result.steps[:4]])
        np.testing.assert_array_equal(screen.certain, (first == first[0]).all(axis=0))
        assert 0 < screen.certain.sum() < 24
        for step in result.steps:
            assert (step.evaluation.predicted == first[0])[screen.certain].all()
    # A set of one's own comes after the design, before what is proposed.
    assert [step.group for step in fresh.steps] == ["design"] * 9 + ["refine"]
    assert fresh.steps[8].evaluation.values == {"yaw": KNOWN_YAW, "restitution": 0.35}
    later = fresh.steps[-1].evaluation
    np.testing.assert_array_equal(later.known, ~fresh.screen.certain)
    assert [s.evaluation.values for s in known.steps] == [s.evaluation.values for s in fresh.steps]
    np.testing.assert_array_equal(known.out_of_fold, fresh.out_of_fold)
    # Judged with the engine asked for, on every trial.
    campaign = usable_trials(load_campaign(planted / "truth"))
    with EvaluationStore(tmp_path / "new", campaign_sha256(campaign), 24) as store:
        evaluate = Evaluator(study, campaign, store, tmp_path, threads=1)
        exact = evaluate(fresh.searched.evaluation.values, keys={"engine.mode": "exact"})
        assert evaluate.simulated == 0
    best = {score.fitted: score for score in fresh.scores if score.name == "simulator"}
    assert best["in_sample"].metrics == metrics_of(fresh.observed, exact.predicted)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("method: {kind: joint, design: 8, screen: 9}", "more than design"),
        ("judged_with: {rock.start.yaw: 3.0}", "is a parameter"),
        ("judged_with: {engine.speed: 3.0}", "no key of the study"),
        ("judged_with: {engine.mode: quick}", "judged_with"),
    ],
)
def test_a_screen_or_judge_that_cannot_be_is_refused(planted, change, message):
    key = change.split(":")[0]
    kept = [line for line in STUDY.splitlines() if not line.startswith(key)]
    path = planted / "refused.yaml"
    path.write_text("\n".join([*kept, change]) + "\n")
    with pytest.raises(ConfigError, match=message):
        load_calibration(path)


def test_effects_act_as_in_the_campaign_they_were_simulated_with(tmp_path):
    effects = "effects: {wear: {loss: 0.14}, placement: {yaw: 9.0}}"
    path = write_planted(tmp_path, f"{STUDY}{effects}\n")
    study = load_calibration(path)
    plain = load_campaign(tmp_path / "truth")
    seed = study.study.seed
    worn = simulate_campaign(
        planted_study(tmp_path), effects=study.study.effects, seed=seed, run=RunOptions(threads=1)
    )
    assert (worn.overturned != plain.overturned).any()
    values = {"yaw": KNOWN_YAW, "restitution": 0.35}
    half = np.arange(len(plain)) % 2 == 0
    for among in (half, None):
        # What a trial draws does not depend on which others are run.
        digest = campaign_sha256(plain)
        with EvaluationStore(tmp_path, digest, len(plain)) as store:
            evaluator = Evaluator(study, plain, store, tmp_path, threads=1)
            found = evaluator(values, among=among)
        chosen = half if among is not None else ~half
        np.testing.assert_array_equal(found.predicted[chosen], worn.overturned[chosen])
    other = load_calibration(path, overrides=["seed=9", "effects.wear.loss=0.0"])
    with EvaluationStore(tmp_path, digest, len(plain)) as store:
        evaluator = Evaluator(other, plain, store, tmp_path, threads=1)
        assert evaluator(values).plan != found.plan
