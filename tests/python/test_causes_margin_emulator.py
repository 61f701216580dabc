"""Trials that scenes are asked for, levels of their margins, and the emulator of these."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from margin_samples import fitted
from vsr2.causes.margins.margin_emulator import emulator_of, fit_emulator
from vsr2.causes.margins.margin_kernel import KernelLoss, fit_kernel, level_numbers
from vsr2.causes.margins.margin_levels import MarginLevel, margin_levels
from vsr2.causes.margins.trial_groups import TRIAL_GROUPS, trial_groups

# --- groups and levels ----------------------------------------------------------------------------


def test_each_group_has_trials_of_every_motion() -> None:
    motions = np.repeat(["a", "b", "c", "d"], [9, 8, 10, 2])
    groups = trial_groups(motions)
    assert len(groups) == 8.5 // TRIAL_GROUPS.asked
    assert groups.asked.any(axis=0).all(), "each trial is asked for"
    for k in range(groups.motions):
        counts = groups.asked[:, groups.motion == k].sum(axis=1)
        assert counts.min() >= 1
        assert np.ptp(counts) <= 1
    assert np.ptp(groups.asked.sum(axis=1)) <= groups.motions


def test_trials_of_motions_of_their_own_are_asked_for_in_every_scene() -> None:
    groups = trial_groups(np.array(["a", "b", "c"]))
    assert len(groups) == 1
    assert groups.asked.all()


def three_levels(scenes, rng):
    """Margins that are sums of a scene's, a motion's and a trial's, and those asked for."""
    groups = trial_groups(np.repeat([f"m{i}" for i in range(5)], 6))
    group = np.arange(scenes) % len(groups)
    common = rng.normal(0, 0.3, scenes)
    by_motion = rng.normal(0, 0.2, (scenes, 5))
    by_trial = rng.normal(0, 0.05, (scenes, 30))
    centre = rng.normal(0, 1, 30)
    margins = centre + common[:, None] + by_motion[:, groups.motion] + by_trial
    return np.where(groups.asked[group], margins, np.nan), group, groups


def test_levels_sum_to_the_margins_that_were_found() -> None:
    asked, group, groups = three_levels(40, np.random.default_rng(3))
    levels = margin_levels(asked, group, groups)
    assert np.abs(levels.by_motion.sum(axis=1)).max() < 1e-12
    for one in levels.by_trial:
        rows = np.ix_(one.scenes, one.trials)
        motion = groups.motion[one.trials]
        total = levels.centre[one.trials] + levels.common[one.scenes, None]
        total = total + levels.by_motion[one.scenes][:, motion] + one.deviations
        np.testing.assert_allclose(total, asked[rows], atol=1e-12)
        assert one.free == one.trials.size - groups.motions


def test_a_motion_whose_margins_never_differ_is_left_out() -> None:
    asked, group, groups = three_levels(30, np.random.default_rng(5))
    asked[:, groups.motion == 2] = np.where(np.isfinite(asked[:, groups.motion == 2]), 1.0, np.nan)
    levels = margin_levels(asked, group, groups)
    assert levels.varied.tolist() == [True, True, False, True, True]
    assert not levels.by_motion[:, 2].any()
    assert {one.count for one in level_numbers(levels)} == {1, 3, 4}


# --- emulator -------------------------------------------------------------------------------------


def quadratic(features):
    """Margins of three trials, with a square and a product."""
    x, y = features[:, 0], features[:, 1]
    return np.stack([0.3 * x + 0.1 * y, 0.2 - 0.4 * x * y, 0.2 * y**2 - 0.3 * x], axis=1)


def plain_margins(emulator, features):
    return emulator(features, np.zeros(len(features)))


@pytest.fixture(scope="module")
def emulator():
    features = np.random.default_rng(5).uniform(-1, 1, (80, 6))
    return fitted(features, quadratic(features))


def test_an_emulator_learns_squares_and_products(emulator) -> None:
    features = np.random.default_rng(6).uniform(-1, 1, (200, 6))
    mean, by_motion, by_trial = plain_margins(emulator, features)
    errors = mean - quadratic(features)
    # The least noise of a level is exp(-4) = 0.018; its mean error is a part of that.
    assert np.sqrt((errors**2).mean()) < 0.01
    assert (by_motion >= emulator.kernel.noise[MarginLevel.MOTION] ** 2).all()
    assert not by_trial.any(), "each trial is the only one of its motion"
    used, idle = emulator.kernel.weights[:2], emulator.kernel.weights[2:]
    assert idle.max() < 0.05 * used.min()


def grouped(rng, scenes=60):
    """Effects of all trials, of motions and of single trials, of which a part is asked for."""
    groups = trial_groups(np.repeat([f"m{i}" for i in range(6)], 6))
    features = rng.uniform(-1, 1, (scenes, 5))
    slopes = np.tile(np.array([0.4, -0.2, 0.0, 0.0, 0.0])[:, None], 36)
    slopes[2:4] += rng.normal(0, 0.2, (2, 6))[:, groups.motion]
    slopes[:2] += rng.normal(0, 0.05, (2, 36))
    margins = features @ slopes + rng.normal(0, 0.03, (scenes, 36))
    group = np.arange(scenes) % len(groups)
    return features, margins, np.where(groups.asked[group], margins, np.nan), group, groups


def test_trials_that_were_not_asked_for_follow_those_of_their_motion() -> None:
    """A third of the margins serves nearly as all, and better than a third of the scenes."""
    rng = np.random.default_rng(7)
    features, margins, asked, group, groups = grouped(rng, 90)
    train, rest = slice(0, 60), slice(60, 90)
    third = fit_emulator(features[train], asked[train], group[train], groups)
    few = fitted(features[:20], margins[:20], groups.motion)
    every = fitted(features[train], margins[train], groups.motion)
    error = {
        name: np.sqrt(((plain_margins(one, features[rest])[0] - margins[rest]) ** 2).mean())
        for name, one in (("third", third), ("few", few), ("every", every))
    }
    assert error["every"] <= error["third"] < error["few"]
    # The noise of a margin is 0.03; twenty scenes tell slopes of single trials to some 0.02.
    assert error["third"] < 0.05


def test_errors_of_scenes_left_out_are_those_of_an_emulator_without_them() -> None:
    rng = np.random.default_rng(8)
    features, _, asked, group, groups = grouped(rng)
    levels = margin_levels(asked, group, groups)
    full = emulator_of(fit_kernel(features, levels), features, levels)
    for row in (0, 7):
        rest = np.arange(len(features)) != row
        others = replace(margin_levels(asked[rest], group[rest], groups), centre=levels.centre)
        without = emulator_of(full.kernel, features[rest], others)
        mean, by_motion, by_trial = plain_margins(without, features[[row]])
        own = groups.asked[group[row]]
        # The mean of a trial has moved a little, and numbers of trials are typical ones.
        np.testing.assert_allclose(full.errors[row, own], (asked[row] - mean[0])[own], atol=0.03)
        common = without.processes[MarginLevel.ALL].variance(features[[row]] * full.kernel.weights)
        spread = np.sqrt(by_motion[0] + by_trial[0] + common[0])
        np.testing.assert_allclose(full.expected[row, own], spread, rtol=0.15)
    assert np.isnan(full.errors[0][~groups.asked[group[0]]]).all()


def test_an_error_that_all_trials_share_moves_all_of_them(emulator) -> None:
    features = np.random.default_rng(6).uniform(-2, 2, (5, 6))
    plain, moved = (emulator(features, np.full(5, error))[0] for error in (0.0, 1.0))
    shift = moved - plain
    variance = emulator.processes[MarginLevel.ALL].variance(features * emulator.kernel.weights)
    np.testing.assert_allclose(shift, np.tile(np.sqrt(variance)[:, None], 3), rtol=1e-9)


def test_the_gradient_of_the_loss_of_a_kernel() -> None:
    rng = np.random.default_rng(8)
    features, _, asked, group, groups = grouped(rng, 24)
    loss = KernelLoss(features, tuple(level_numbers(margin_levels(asked, group, groups))))
    logs = loss.start() + rng.normal(0, 0.3, loss.start().size)
    assert logs.size == len(loss.ends()) == 5 + 2 + 2 + 3
    gradient = loss(logs)[1]
    for k in range(logs.size):
        step = 1e-6 * np.eye(logs.size)[k]
        ends = [loss(logs + sign * step)[0] for sign in (1, -1)]
        assert gradient[k] == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-4, abs=1e-3)


def test_a_failed_margin_counts_as_the_mean(emulator) -> None:
    features = np.random.default_rng(5).uniform(-1, 1, (80, 6))
    margins = quadratic(features)
    margins[4, 1] = np.nan
    assert np.isfinite(plain_margins(fitted(features, margins), features)[0]).all()


def test_margins_that_are_equal_everywhere_have_no_error() -> None:
    features = np.random.default_rng(5).uniform(-1, 1, (30, 2))
    same = fitted(features, np.ones((30, 3))).quality()
    assert same["used"] == 30
    assert same["spread"] is same["error"] is same["error_over_expected"] is None
    varied = fitted(features, quadratic(np.tile(features, 3))).quality()
    assert 0 < varied["error"] < varied["spread"]
