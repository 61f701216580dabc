"""Searches, folds and profiles on a world without physics, where the answer is known."""

from __future__ import annotations

import warnings
from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration_samples import RANGES, World
from vsr2.calibration import (
    CalibrationParameter,
    Evaluation,
    cross_validate,
    joint_search,
    profiles,
    sequential_search,
)
from vsr2.calibration.calibration_study import Joint, Sequential, at_share, share_of, within
from vsr2.calibration.objective import metrics_of, objective_of, objective_replicates
from vsr2.calibration.search import (
    best_step,
    design_values,
    profile_values,
    spread_points,
)
from vsr2.campaign import motion_resamples
from vsr2.campaign.folds import grouped_folds
from vsr2.config.extended import Plain
from vsr2.report.messages.runs import compatible_values

START = {"p": 0.1, "q": 1.0}


def score_on(world: World):
    return lambda one: objective_of(world.observed, one.predicted)


def joint(
    world: World, *, design: int = 12, refine: int = 12, seed: int = 1, proposals: str = "tpe"
):
    method = Joint(kind="joint", design=design, refine=refine, proposals=proposals)
    sets = [world(v) for v in design_values(RANGES, START, design, seed)]
    return joint_search(RANGES, sets, world, score_on(world), method, seed)


def test_scores_count_what_is_undefined_as_nothing_and_failures_as_wrong():
    observed = np.array([True, True, False, False])
    none = np.zeros(4)
    assert metrics_of(observed, none).accuracy == 0.5
    assert objective_of(observed, none) == pytest.approx(0.5 / 3)  # no precision, recall 0
    failed = np.array([1.0, np.nan, np.nan, 0.0])
    found = metrics_of(observed, failed)
    assert (found.true_positives, found.false_negatives, found.false_positives) == (1, 1, 1)
    assert objective_of(observed, failed) == pytest.approx((0.5 + 0.5 + 0.5) / 3)
    right = np.array([1.0, 1.0, 0.0, 0.0])
    assert objective_of(observed, right) == 1.0
    assert objective_of(observed, failed, np.array([True, False, False, True])) == 1.0


@given(st.integers(0, 2**32 - 1))
def test_replicates_of_the_objective_equal_the_objective_of_the_drawn_trials(seed):
    rng = np.random.default_rng(seed)
    observed, predicted = rng.random(12) < 0.5, (rng.random(12) < 0.5).astype(float)
    predicted[rng.random(12) < 0.1] = np.nan
    counts = rng.integers(0, 3, size=(3, 12))
    found = objective_replicates(observed, predicted, counts)
    for row, value in zip(counts, found, strict=True):
        drawn = np.repeat(np.arange(12), row)
        if drawn.size:
            assert value == pytest.approx(objective_of(observed[drawn], predicted[drawn]))


@settings(deadline=None)  # the first call loads scipy
@given(st.integers(0, 5), st.integers(1, 7), st.integers(0, 1000))
def test_the_points_fill_every_axis_evenly_and_more_begin_with_the_fewer(power, dimensions, seed):
    count = 2**power
    points = spread_points(count, dimensions, seed)
    for axis in points.T:
        # A Sobol sequence has one point in each slice of every axis.
        assert sorted((axis * count).astype(int)) == list(range(count))
    more = spread_points(count + 3, dimensions, seed)
    np.testing.assert_array_equal(more[:count], points)


@given(st.floats(0, 1))
def test_shares_and_values_are_inverse(share):
    for one in RANGES.values():
        value = at_share(one, share)
        assert within(one, value)
        assert share_of(one, value) == pytest.approx(share, abs=2e-5)
    words = CalibrationParameter(keys=("motion.channel",), values=("a", "b", "c"))
    assert at_share(words, share) in words.values
    assert at_share(words, 1.0) == "c"


def test_the_sequential_procedure_carries_the_best_forward_and_stops_without_gain():
    world = World()
    parameters = {
        "q": CalibrationParameter(keys=("engine.linear_damping",), values=(1.0, 2.0)),
        "p": CalibrationParameter(keys=("engine.gravity",), values=(0.3, 0.5, 0.7)),
    }
    method = Sequential(kind="sequential")
    steps = sequential_search(parameters, START, world, score_on(world), method)
    best = best_step(steps)
    # q has no effect, so the start's value stays; the second iteration gains nothing and ends it
    assert best.evaluation.values == {"p": 0.5, "q": 1.0}
    assert best.score == 1.0
    assert [(s.iteration, s.group) for s in steps] == [
        (0, "start"),
        *[(1, "q")] * 2,
        *[(1, "p")] * 3,
        *[(2, "q")] * 2,
        *[(2, "p")] * 3,
    ]
    second = [s.evaluation.values["p"] for s in steps if (s.iteration, s.group) == (2, "q")]
    assert second == [0.5, 0.5]
    short = Sequential(kind="sequential", max_iterations=1)
    assert len(sequential_search(parameters, START, world, score_on(world), short)) == 6


@pytest.mark.parametrize("proposals", ["tpe", "cma"])
def test_the_joint_search_finds_the_optimum_and_takes_the_same_steps_again(proposals):
    world = World()
    steps = joint(world, proposals=proposals)
    assert [s.group for s in steps] == ["design"] * 12 + ["refine"] * 12
    assert abs(best_step(steps).evaluation.values["p"] - 0.5) < 0.05
    refined = [s.score for s in steps[12:]]
    assert np.mean(refined) > np.mean([s.score for s in steps[:12]]) + 0.05
    again = joint(World(), proposals=proposals)
    assert [s.evaluation.values for s in again] == [s.evaluation.values for s in steps]
    other = joint(World(), seed=2, proposals=proposals)
    assert [s.evaluation.values for s in other] != [s.evaluation.values for s in steps]


def test_the_joint_search_chooses_among_words_and_is_quiet(capfd):
    parameters = {
        "p": RANGES["p"],
        "channel": CalibrationParameter(keys=("motion.channel",), values=("good", "bad")),
    }
    world = World()

    def evaluate(values: Mapping[str, Plain]) -> Evaluation:
        off = 0.0 if values["channel"] == "good" else 0.3
        predicted = (world.u > float(values["p"]) + off).astype(float)
        predicted[::5] = 0.0 if values["channel"] == "bad" else predicted[::5]
        return Evaluation(dict(values), predicted)

    start = {"p": 0.9, "channel": "bad"}
    sets = [evaluate(v) for v in design_values(parameters, start, 10, 0)]
    assert sets[0].values == start
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        steps = joint_search(
            parameters, sets, evaluate, score_on(world), Joint(kind="joint", refine=15), 0
        )
    assert best_step(steps).evaluation.values["channel"] == "good"
    assert capfd.readouterr().err == ""


def test_a_start_outside_the_ranges_is_not_in_the_design():
    sets = design_values(RANGES, {"p": 2.0, "q": 1.0}, 6, 0)
    assert len(sets) == 6
    assert all(0 <= one["p"] <= 1 for one in sets)


def fold_search(world: World, observed):
    """A joint search for `cross_validate`, with the trials' outcomes in the score only."""
    sets = [world(v) for v in design_values(RANGES, START, 6, 0)]

    def search(score, part):
        return joint_search(
            RANGES, sets, world, score, Joint(kind="joint", design=6, refine=5), part
        )

    return search


def test_folds_leak_nothing_of_the_held_out_trials():
    world = World(trials=60)
    fold = grouped_folds(world.motions, world.observed.astype(float), 3)
    first = cross_validate(fold_search(world, world.observed), world.observed, fold)
    assert {k for one in first for k in set(fold[one.held_out])} == {0, 1, 2}
    for k, one in enumerate(first):
        assert not set(world.motions[one.held_out]) & set(world.motions[~one.held_out])
        # Whatever happened in the held-out trials, the choice and its training score stay.
        turned = world.observed.copy()
        turned[fold == k] = ~turned[fold == k]
        again = cross_validate(fold_search(world, turned), turned, fold)[k]
        assert again.values == one.values
        assert again.training == one.training
        assert again.judged != one.judged


def test_optimism_shows_where_there_is_nothing_to_learn():
    # Predictions by coin: the best of many looks good in sample, and is worth nothing elsewhere.
    rng = np.random.default_rng(0)
    motions = np.arange(80) // 4
    observed = rng.random(80) < 0.5
    coins = [Evaluation({"k": k}, (rng.random(80) < 0.5).astype(float)) for k in range(200)]
    fold = grouped_folds(motions, observed.astype(float), 5)

    def search(score, part):
        from vsr2.calibration import Step

        return [Step(0, "design", one, score(one)) for one in coins]

    inside = max(objective_of(observed, one.predicted) for one in coins)
    out = np.full(80, np.nan)
    for one in cross_validate(search, observed, fold):
        out[one.held_out] = one.predicted[one.held_out]
        assert one.training > 0.55
    assert inside > 0.6
    assert objective_of(observed, out) < 0.56


def test_profiles_tell_what_is_identified_and_what_is_not():
    world = World(trials=400)
    steps = joint(world, design=60, refine=20)
    best = best_step(steps).evaluation.values
    every = [s.evaluation for s in steps] + [world(v) for v in profile_values(RANGES, best, 10)]
    resamples = motion_resamples(world.motions, 500, 0)
    found = {p.name: p for p in profiles(RANGES, every, world.observed, resamples, best, cells=10)}
    assert found["p"].verdict == "identified"
    kept = [cell for cell in found["p"].cells if cell.compatible]
    assert kept[0].low <= 0.5 <= kept[-1].high
    assert len(kept) <= 3
    assert found["q"].verdict == "not_identified"
    assert compatible_values(found["q"]) == "0.001 to 1000"
    assert all(cell.compatible for cell in found["q"].cells)


def test_profiles_tell_a_bound_on_one_side():
    world = World(trials=400)

    def evaluate(p: float) -> Evaluation:
        # Above 0.5 the parameter has no effect any more.
        return Evaluation({"p": p}, (world.u > min(p, 0.5)).astype(float))

    every = [evaluate(at_share(RANGES["p"], (i + 0.5) / 20)) for i in range(20)]
    resamples = motion_resamples(world.motions, 500, 0)
    (found,) = profiles({"p": RANGES["p"]}, every, world.observed, resamples, {"p": 0.9})
    assert found.verdict == "bounded_below"
    flipped = [Evaluation({"p": 1 - one.values["p"]}, one.predicted) for one in every]
    (found,) = profiles({"p": RANGES["p"]}, flipped, world.observed, resamples, {"p": 0.1})
    assert found.verdict == "bounded_above"


def test_parts_of_a_range_that_no_set_tried_are_counted():
    world = World(trials=400)
    every = [world({"p": 0.5, "q": 1.0}), world({"p": 0.05, "q": 900.0})]
    resamples = motion_resamples(world.motions, 500, 0)
    best = every[0].values
    found = {p.name: p for p in profiles(RANGES, every, world.observed, resamples, best)}
    assert compatible_values(found["p"]).endswith("; 5 of 7 parts untried")
    assert sum(cell.sets > 0 for cell in found["p"].cells) == 2
