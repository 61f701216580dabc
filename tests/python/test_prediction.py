"""Predicted probabilities of overturning, in Python and from the command line."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from command_line import run
from diagnosis_samples import few_simulations
from planted import shaken_campaign
from vsr2 import predict
from vsr2.analysis import overturning_probability
from vsr2.analysis.overturning_margin import MarginModel
from vsr2.campaign import Campaign, save_campaign
from vsr2.config import load_study, study_from_mapping
from vsr2.diagnosis import Budget, diagnose
from vsr2.effects import effect
from vsr2.ensemble import Execution, Hypotheses, ProtocolCache, with_deviations
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
from vsr2.ensemble.simulated.simulator import Request
from vsr2.errors import CampaignError, ConfigError, DiagnosisError, GeometryError, ResultError
from vsr2.prediction.replicates import PREDICTION

BOX = {
    "name": "box",
    "engine": {"mode": "fast"},
    "rock": {"shape": "box", "size": [0.4, 0.55, 0.95], "density": 2700.0},
    "motion": {"mode": "all_recordings", "folder": "."},
    "outcome": {"tail": 1.0},
}
FEW = 6


def scene(**effects: dict[str, float]):
    return study_from_mapping({**BOX, "effects": effects}, base=Path())


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    """Outcomes of the scene itself, under draws that no prediction has."""
    shaken = shaken_campaign(4, 5, duration=1.0, pga_g=(0.5, 1.1), session_size=5)
    truth = SceneSimulator(shaken, scene(), hypotheses=Hypotheses(library={}), seed=77)
    ends = truth.run([Request(i, (), 3, 1) for i in range(len(shaken))]).overturned
    trials = [replace(t, overturned=bool(e)) for t, e in zip(shaken.trials, ends, strict=True)]
    return replace(shaken, trials=tuple(trials))


@pytest.fixture(scope="module")
def found(campaign):
    return predict(campaign, scene(), replicates=FEW, execution=Execution(threads=1))


def test_probabilities_are_of_replicates_as_the_diagnosis_draws_them(campaign, found) -> None:
    same = SceneSimulator(campaign, scene(), seed=0)
    for row in range(FEW):
        ends = same.run([Request(i, (), row + 1, 1) for i in range(len(campaign))]).overturned
        np.testing.assert_array_equal(found.outcomes[row], ends)
    np.testing.assert_array_equal(found.probability, overturning_probability(found.outcomes))
    assert ((found.probability > 0) & (found.probability < 1)).all()
    assert 0 < found.predicted.sum() < len(campaign)
    assert len(np.unique(found.outcomes, axis=0)) > 2, "the draws matter, and more than one"
    assert found.scores[0].intervals["accuracy"].value >= 0.8
    assert found.scores[0].intervals["log_loss"].value < np.log(2)
    assert [one.name for one in found.scores] == ["simulator", "logistic"]


def test_threads_and_interruptions_change_no_bit(campaign, found, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("vsr2.prediction.replicates.PREDICTION", replace(PREDICTION, chunk=16))

    def stop(progress) -> None:
        if progress.share > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        predict(campaign, scene(), out=tmp_path, replicates=FEW,
                execution=Execution(threads=2, report=stop))  # fmt: skip
    assert [one.name for one in tmp_path.iterdir()] == ["simulations.jsonl"]
    kept = (tmp_path / "simulations.jsonl").read_text()
    again = predict(campaign, scene(), out=tmp_path, replicates=FEW, execution=Execution(threads=2))
    np.testing.assert_array_equal(again.outcomes, found.outcomes)
    assert again.tables() == found.tables()
    assert (tmp_path / "simulations.jsonl").read_text().startswith(kept)
    # More replicates keep the earlier ones.
    more = predict(campaign, scene(), out=tmp_path, replicates=FEW + 1)
    np.testing.assert_array_equal(more.outcomes[:FEW], found.outcomes)


def test_a_missing_effect_shows_in_the_scores(campaign, found) -> None:
    weak = predict(campaign, scene(table_gain={"change": -0.15}), replicates=FEW)
    assert weak.probability.sum() < found.probability.sum() - 1
    ours, theirs = (one.scores[0].intervals["log_loss"].value for one in (found, weak))
    assert ours < theirs
    assert weak.provenance["scenes"][0]["effects"] == {"table_gain": {"change": -0.15}}


def test_scenes_take_turns(campaign, found, tmp_path) -> None:
    """As draws of a posterior do: each replicate has one of them and draws of its own."""
    strong = scene(table_gain={"change": 0.15})
    mixed = predict(campaign, [scene(), strong], out=tmp_path, replicates=FEW)
    np.testing.assert_array_equal(mixed.outcomes[::2], found.outcomes[::2])
    alone = predict(campaign, strong, replicates=FEW)
    np.testing.assert_array_equal(mixed.outcomes[1::2], alone.outcomes[1::2])
    assert (mixed.outcomes != found.outcomes).any()
    with pytest.raises(DiagnosisError, match="replicates is 1; give at least one for each scene"):
        predict(campaign, [scene(), strong], replicates=1)


def test_tables_are_written(campaign, found, tmp_path) -> None:
    paths = found.save(tmp_path)
    assert {path.name for path in paths} == {
        "predictions.csv", "scores.csv", "reliability.csv", "provenance.json",
    }  # fmt: skip
    rows = list(csv.DictReader((tmp_path / "predictions.csv").read_text().splitlines()))
    assert [float(row["probability"]) for row in rows] == found.probability.tolist()
    assert [row["observed"] for row in rows] == [str(int(t.overturned)) for t in campaign.trials]
    assert [int(row["predicted"]) for row in rows] == found.predicted.astype(int).tolist()
    scores = list(csv.DictReader((tmp_path / "scores.csv").read_text().splitlines()))
    assert {row["score"] for row in scores} >= {"log_loss", "brier", "objective"}
    curve = list(csv.DictReader((tmp_path / "reliability.csv").read_text().splitlines()))
    assert sum(int(row["trials"]) for row in curve) == len(campaign)
    assert json.loads((tmp_path / "provenance.json").read_text())["replicates"] == FEW


def test_a_finished_prediction_of_another_scene_is_not_replaced(campaign, found, tmp_path) -> None:
    found.save(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    other = scene(table_gain={"change": 0.05})
    with pytest.raises(ResultError, match="a prediction of another scene, campaign, seed"):
        predict(campaign, other, out=tmp_path, replicates=FEW, execution=Execution(threads=1))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    more = predict(campaign, scene(), out=tmp_path, replicates=FEW + 1, execution=Execution(1))
    np.testing.assert_array_equal(more.outcomes[:FEW], found.outcomes)


def test_without_outcomes_there_are_predictions_and_no_scores(campaign, found, tmp_path) -> None:
    found.save(tmp_path)
    blank = replace(campaign, trials=tuple(replace(t, overturned=None) for t in campaign.trials))
    unseen = predict(blank, scene(), out=tmp_path, replicates=FEW)
    np.testing.assert_array_equal(unseen.outcomes, found.outcomes)
    assert (unseen.scores, unseen.curve) == ((), ())
    assert not (tmp_path / "scores.csv").exists(), "those of another campaign are gone"
    rows = list(csv.DictReader((tmp_path / "predictions.csv").read_text().splitlines()))
    assert {row["observed"] for row in rows} == {""}


def test_scores_are_of_the_trials_whose_outcome_is_known(campaign, found) -> None:
    trials = tuple(
        replace(t, overturned=None) if i % 2 else t for i, t in enumerate(campaign.trials)
    )
    half = predict(replace(campaign, trials=trials), scene(), replicates=FEW)
    assert half.scores[0].trials == 10
    lost = replace(trials[0], motion_file=None)
    fewer = replace(campaign, trials=(lost, *trials[1:]))
    assert predict(fewer, scene(), replicates=1).provenance["left_out"] == 1


def test_a_diagnosis_and_a_prediction_share_simulations(campaign, tmp_path) -> None:
    cache = ProtocolCache(tmp_path)
    hypotheses = Hypotheses({"friction": effect("friction")}, nuisances=with_deviations({}))
    with few_simulations():
        diagnose(campaign, scene(), tier="B", budget=Budget(campaigns=24), hypotheses=hypotheses,
                 execution=Execution(cache=cache))  # fmt: skip
    before = (tmp_path / "simulations.jsonl").stat().st_size
    predict(
        campaign, scene(), replicates=2, hypotheses=hypotheses, execution=Execution(cache=cache)
    )
    assert (tmp_path / "simulations.jsonl").stat().st_size == before


def test_what_cannot_be_used_is_refused_before_anything_is_simulated(
    campaign, tmp_path, monkeypatch
) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("simulated")

    monkeypatch.setattr(SceneSimulator, "run", never)
    with pytest.raises(DiagnosisError, match="replicates is 0"):
        predict(campaign, scene(), replicates=0)
    with pytest.raises(DiagnosisError, match="seed is -1"):
        predict(campaign, scene(), seed=-1)
    with pytest.raises(ConfigError, match="holds no"):
        predict(campaign, tmp_path)
    with pytest.raises(ConfigError, match="table_gian"):
        predict(campaign, scene(table_gian={"change": 0.1}))
    far = scene(com_offset={"distance": 0.2})
    with pytest.warns(match="outside the prior"), pytest.raises(GeometryError, match="com_offset"):
        predict(campaign, [scene(), far])
    (tmp_path / "file").write_text("")
    with pytest.raises(DiagnosisError, match="cannot be used"):
        predict(campaign, scene(), out=tmp_path / "file" / "below")
    lost = tuple(replace(t, motion_file=None) for t in campaign.trials)
    with pytest.raises(CampaignError):
        predict(replace(campaign, trials=lost), scene())


def test_the_command_line_takes_a_scene_or_a_folder_of_draws(campaign, tmp_path, capsys) -> None:
    save_campaign(campaign, tmp_path / "campaign")
    motion = {"mode": "single_cosine", "amplitude": 0.05, "frequency": 1}
    text = json.dumps({**BOX, "motion": motion})
    (tmp_path / "draws").mkdir()
    for k in range(2):
        (tmp_path / "draws" / f"{k}.yaml").write_text(text)
    given = ("--replicates", FEW, "--threads", 1)
    one = run("campaign", "predict", tmp_path / "draws" / "0.yaml", tmp_path / "campaign", *given,
              "--out", tmp_path / "out")  # fmt: skip
    assert one == 0
    printed = capsys.readouterr()
    assert "log loss" in printed.out
    assert f"wrote {tmp_path / 'out'}" in printed.out
    assert "vsr2 campaign predict: simulating 100%" in printed.err
    study = load_study(tmp_path / "draws" / "0.yaml")
    expected = predict(tmp_path / "campaign", study, replicates=FEW).tables()
    written = {path.name: path.read_text() for path in (tmp_path / "out").glob("*.csv")}
    assert written == expected
    quiet = ("--json", "--quiet")
    run("campaign", "predict", tmp_path / "draws", tmp_path / "campaign", *given, *quiet)
    content = json.loads(capsys.readouterr().out)
    rows = list(csv.DictReader((tmp_path / "out" / "predictions.csv").read_text().splitlines()))
    assert content["probability"] == [float(row["probability"]) for row in rows], "equal draws"
    assert {one["name"] for one in content["scores"]} == {"simulator", "logistic"}


def test_margins_are_found_by_bisection(campaign, found) -> None:
    def sought(change: float):
        return predict(
            campaign, scene(table_gain={"change": change}), replicates=2, margins=True,
            execution=Execution(threads=1),
        )  # fmt: skip

    plain, weak = sought(0.0), sought(-0.15)
    fell = plain.outcomes > 0.5
    assert (plain.margins[fell] < 0).all()
    assert (plain.margins[~fell] > 0).all()
    # A table that does less has to be driven by as much more, to the width of the last halving; a
    # response that is not monotone near the boundary makes single trials differ.
    width = 2 * PREDICTION.reach / 2**PREDICTION.halvings
    inside = np.maximum(np.abs(weak.margins), np.abs(plain.margins)) < PREDICTION.reach - width
    assert inside.sum() > 15
    shift = np.median((weak.margins - plain.margins)[inside])
    assert shift == pytest.approx(-np.log(0.85), abs=1.5 * width)
    # Bias is learnt from other motions: the weak table predicts about as well as the right one.
    names = [one.name for one in weak.scores]
    assert names == ["simulator", "margins", "logistic"]
    loss = {one.name: one.intervals["log_loss"].value for one in weak.scores}
    assert loss["margins"] < loss["simulator"]
    rows = list(csv.DictReader(weak.tables()["predictions.csv"].splitlines()))
    assert all(row["margin"] and not row["standard_error"] for row in rows)
    np.testing.assert_array_equal(plain.outcomes, found.outcomes[:2])


def test_margins_of_a_campaign_without_outcomes_have_no_bias(campaign) -> None:
    blank = replace(
        campaign, trials=tuple(replace(t, overturned=None) for t in campaign.trials)
    ).select([trial.trial for trial in campaign.trials[:2]])
    found = predict(blank, scene(), replicates=2, margins=True, execution=Execution(threads=1))
    np.testing.assert_allclose(found.probability, MarginModel().probability(found.margins))
    assert not found.scores
