"""Calibration by replicates: sets are judged by the probability of overturning."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from calibration_samples import KNOWN_YAW, STUDY, write_planted
from vsr2 import predict
from vsr2.calibration import (
    CalibrationStudy,
    Evaluation,
    EvaluationStore,
    Evaluator,
    calibrate,
    load_calibration,
    save_calibration,
)
from vsr2.calibration.evaluation import campaign_sha256
from vsr2.calibration.evaluation_store import joined
from vsr2.calibration.objective import Objective, objective_of, objective_replicates
from vsr2.campaign import Campaign, load_campaign
from vsr2.ensemble import Execution
from vsr2.errors import ConfigError

NAN = np.nan
BY_LOSS = STUDY.replace("replicates: 1", "replicates: 2") + (
    "objective: log_loss\neffects: {placement: {yaw: 4.0}}\n"
)
SMALL = BY_LOSS.replace(
    "design: 8, refine: 3, profile_points: 4", "design: 4, refine: 1, screen: 3"
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("replicates")
    write_planted(out, SMALL)
    return out


@pytest.fixture(scope="module")
def campaign(folder) -> Campaign:
    return load_campaign(folder / "truth")


def study(folder: Path, *overrides: str) -> CalibrationStudy:
    return load_calibration(folder / "study.yaml", overrides=overrides)


def evaluator(of: CalibrationStudy, campaign: Campaign, store: EvaluationStore, folder: Path):
    return Evaluator(of, campaign, store, folder, threads=1)


def test_a_set_is_judged_as_it_would_be_predicted(folder, campaign, tmp_path) -> None:
    """The same draws through the same door, the scene's own ones among them."""
    values = {"yaw": 30.0, "restitution": 0.3}
    few, more = study(folder), study(folder, "replicates=3")
    digest = campaign_sha256(campaign)
    with EvaluationStore(tmp_path, digest, len(campaign)) as store:
        first = evaluator(few, campaign, store, tmp_path)
        two = first(values)
        assert first.simulated == 2
        second = evaluator(more, campaign, store, tmp_path)
        found = second(values)
        assert second.simulated == 1, "replicates that are there are kept"
    assert [one.plan for one in found.runs[:2]] == [one.plan for one in two.runs]
    assert len({one.plan for one in found.runs}) == 3
    keys = {"rock.start.yaw": 30.0, "contact.rock.restitution": 0.3,
            "contact.pedestal.restitution": 0.3}  # fmt: skip
    own = more.with_values(keys)
    predicted = predict(campaign, own, replicates=3, seed=own.seed, execution=Execution(threads=1))
    np.testing.assert_array_equal(found.predicted, predicted.probability)
    np.testing.assert_array_equal([one.predicted for one in found.runs], predicted.outcomes)
    assert len(np.unique(found.predicted)) > 2, "outcomes are not sure"
    with EvaluationStore(tmp_path, digest, len(campaign)) as store:
        again = evaluator(more, campaign, store, tmp_path)
        np.testing.assert_array_equal(again(values).predicted, found.predicted)
        assert again.simulated == 0


def test_one_replicate_is_the_study_s_own_simulation(folder, campaign, tmp_path) -> None:
    single = study(folder, "replicates=1", "objective=mean_of_three")
    with EvaluationStore(tmp_path, campaign_sha256(campaign), len(campaign)) as store:
        found = evaluator(single, campaign, store, tmp_path)({"yaw": 30.0, "restitution": 0.3})
    assert set(found.predicted) == {0.0, 1.0}
    assert found.runs == ()


def test_runs_without_outcome_count_as_wrong() -> None:
    observed = np.array([True, False, True, True])
    ends = ([1, 0, NAN, 0], [1, NAN, NAN, NAN], [1, 0, 1, NAN])
    runs = [
        Evaluation({"p": 1}, np.array(one, dtype=float), f"plan {k}", 1.5,
                   np.array([True, True, True, False]))
        for k, one in enumerate(ends)
    ]  # fmt: skip
    found = joined(runs, observed)
    np.testing.assert_allclose(found.predicted, [3.5 / 4, 1.5 / 4, 1.5 / 4, NAN])
    assert found.unanimous.tolist() == [True, False, False, False]
    assert found.failed == 2, "what was not simulated has not failed"
    assert found.seconds == 4.5
    assert found.known is not None
    assert found.known.tolist() == [True, True, True, False]
    assert found.plan != joined(runs[:2], observed).plan
    assert Evaluation({}, np.array([1.0, NAN])).unanimous.tolist() == [True, False]


def test_the_log_loss_is_that_of_the_probabilities() -> None:
    observed = np.array([True, False, True])
    p = np.array([0.9, 0.3, 0.6])
    losses = -np.log([0.9, 0.7, 0.6])
    loss = Objective.LOG_LOSS
    assert objective_of(observed, p, None, loss) == pytest.approx(-losses.mean())
    among = np.array([True, False, True])
    assert objective_of(observed, p, among, loss) == pytest.approx(-losses[among].mean())
    counts = np.array([[1, 1, 1], [2, 0, 1]], dtype=np.int32)
    found = objective_replicates(observed, p, counts, loss)
    np.testing.assert_allclose(found, [-losses.mean(), -(2 * losses[0] + losses[2]) / 3])
    assert objective_of(observed, np.array([1.0, NAN, 1.0]), None, loss) == -np.inf
    assert objective_of(observed, p) == 1.0, "of outcomes at 0.5"


def test_a_search_by_log_loss_finds_the_planted_azimuth_and_resumes(folder, tmp_path) -> None:
    own = study(folder)
    found = calibrate(own, tmp_path, threads=1)
    assert abs(float(found.searched.evaluation.values["yaw"]) - KNOWN_YAW) < 20
    assert found.searched.score == max(step.score for step in found.steps)
    assert found.searched.score == objective_of(
        found.observed, found.searched.evaluation.predicted, None, Objective.LOG_LOSS
    )
    assert -np.log(2) < found.searched.score < 0
    assert found.screen is not None
    first = [step.evaluation for step in found.steps[:3]]
    settled = np.all([one.unanimous for one in first], axis=0)
    assert (found.screen.certain <= settled).all()
    assert found.screen.certain.any()
    assert all(one.judged + np.inf > 0 for one in found.folds)
    save_calibration(found, own, tmp_path)
    rows = list(csv.DictReader((tmp_path / "predictions.csv").read_text().splitlines()))
    probability = [float(row["in_sample_probability"]) for row in rows]
    assert probability == found.in_sample.tolist()
    assert [row["in_sample"] for row in rows] == [str(int(p > 0.5)) for p in probability]
    again = calibrate(own, tmp_path, threads=2)
    assert again.provenance["simulated_in_this_run"] == 0
    assert [step.score for step in again.steps] == [step.score for step in found.steps]
    np.testing.assert_array_equal(again.out_of_fold, found.out_of_fold)
    assert found.optimism == again.optimism


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("replicates=1", "`log_loss` is of probabilities; give replicates of 2 or more"),
        ("replicates=2000", "replicates: .*99"),
        ("replicates=0", "replicates"),
        ("objective=likelihood", "objective"),
        ("resamples=10", "resamples"),
    ],
)
def test_settings_that_cannot_be_are_refused(folder, override, message) -> None:
    with pytest.raises(ConfigError, match=message):
        study(folder, override)
