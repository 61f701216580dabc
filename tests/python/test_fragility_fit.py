"""Fragility fits: known curves, separated outcomes, dependence within motions."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr

from vsr2.errors import ResultError
from vsr2.fragility import FitNote, fit_fragility
from vsr2.report.messages.runs import fit_note


def lognormal_trials(motions, per, *, between, within, seed, median=0.4):
    rng = np.random.default_rng(seed)
    group = np.repeat(np.arange(motions), per)
    x = rng.uniform(0.1, 1.2, group.size)
    capacity = (
        np.log(median)
        + between * rng.standard_normal(motions)[group]
        + within * rng.standard_normal(group.size)
    )
    return x, np.log(x) > capacity, group


def test_a_known_lognormal_is_found():
    x, hit, group = lognormal_trials(4000, 1, between=0.0, within=0.35, seed=0)
    fit = fit_fragility(x, hit, group)
    found = fit.lognormal
    # Standard errors at 4000 trials are about 0.01 for the median and 0.014 for beta.
    assert found.median == pytest.approx(0.4, abs=0.025)
    assert found.beta == pytest.approx(0.35, abs=0.04)
    assert found.fits
    assert not fit.separated
    at = np.array([0.2, 0.4, 0.8])
    probability, lower, upper = fit.probability(at)
    np.testing.assert_allclose(probability, ndtr(np.log(at / 0.4) / 0.35), atol=0.03)
    assert (lower < probability).all()
    assert (probability < upper).all()
    assert (upper - lower < 0.08).all()


def test_the_curve_is_the_exported_lognormal():
    x, hit, group = lognormal_trials(60, 5, between=0.2, within=0.2, seed=1)
    fit = fit_fragility(x, hit, group)
    at = np.geomspace(0.1, 1.0, 7)
    one = fit.lognormal
    np.testing.assert_allclose(
        fit.probability(at)[0], ndtr(np.log(at / one.median) / one.beta), atol=1e-9
    )


def test_intervals_cover_where_trials_of_a_motion_resemble_each_other():
    covered, naive = [], []
    for seed in range(120):
        x, hit, group = lognormal_trials(25, 12, between=0.35, within=0.1, seed=seed)
        one = fit_fragility(x, hit, group).lognormal
        covered.append(one.median_lower < 0.4 < one.median_upper)
        alone = fit_fragility(x, hit, np.arange(x.size)).lognormal
        naive.append(alone.median_lower < 0.4 < alone.median_upper)
    # 95 % nominal; by chance 0.95 of 120 varies by 0.02. Taking trials as independent falls short.
    assert np.mean(covered) > 0.88
    assert np.mean(naive) < np.mean(covered) - 0.1


def test_the_band_is_wider_where_motions_differ():
    x, hit, group = lognormal_trials(20, 15, between=0.5, within=0.05, seed=3)
    _, low, high = fit_fragility(x, hit, group).probability([0.4])
    _, naive_low, naive_high = fit_fragility(x, hit, np.arange(x.size)).probability([0.4])
    assert high - low > 1.5 * (naive_high - naive_low)


@given(st.floats(0.15, 0.95), st.integers(6, 60))
@settings(max_examples=25)
def test_separated_outcomes_end_in_a_steep_curve_between_them(threshold, count):
    x = np.linspace(0.1, 1.0, count)
    hit = x > threshold
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fit = fit_fragility(x, hit, np.arange(count))
    assert fit.separated
    one = fit.lognormal
    below, above = x[~hit].max(), x[hit].min()
    # The prior may push the middle out of the gap by a little, where one side is short.
    assert 0.9 * below < one.median < 1.1 * above
    assert 0 < one.beta_lower < one.beta < one.beta_upper < np.inf


def test_the_band_of_separated_outcomes_is_open_in_the_gap_and_closed_far_from_it():
    x = np.linspace(0.1, 1.0, 40)
    fit = fit_fragility(x, x > 0.5, np.arange(40))
    _, lower, upper = fit.probability([0.1, 0.5, 1.0])
    assert upper[0] < 0.01
    assert lower[2] > 0.9
    assert lower[1] < 0.2
    assert upper[1] > 0.8


def test_outcomes_that_are_all_alike_give_a_constant():
    x = np.linspace(0.1, 1.0, 40)
    for hit, probability, note in (
        (np.zeros(40, bool), 0.5 / 41, FitNote.ALL_STOOD),
        (np.ones(40, bool), 40.5 / 41, FitNote.ALL_OVERTURNED),
    ):
        fit = fit_fragility(x, hit, np.arange(40))
        assert fit.lognormal is None
        assert fit.note is note
        assert "no curve" in fit_note(fit)
        middle, lower, upper = fit.probability([0.2, 0.9])
        np.testing.assert_allclose(middle, probability)
        assert (lower <= middle).all()
        assert (middle <= upper).all()
        assert 0.03 < (upper - lower)[0] < 0.1  # about 3 / n


def test_a_falling_or_flat_probability_has_no_lognormal():
    x = np.linspace(0.1, 1.0, 40)
    fit = fit_fragility(x, x < 0.5, np.arange(40))
    assert fit.lognormal is None
    assert fit.note is FitNote.NOT_RISING
    assert "does not rise" in fit_note(fit)
    same = fit_fragility(np.full(40, 0.3), x > 0.5, np.arange(40))
    assert same.lognormal is None
    assert same.probability([0.3])[0] == pytest.approx(0.55, abs=0.02)


def test_a_curve_that_is_no_lognormal_is_reported():
    rng = np.random.default_rng(0)
    x = np.geomspace(0.1, 1.0, 600)
    hit = rng.random(600) < np.where(x < 0.3, 0.02, 0.5)
    assert not fit_fragility(x, hit, np.arange(600)).lognormal.fits


def surface(threshold, jitter=0.0, seed=0):
    rng = np.random.default_rng(seed)
    grid = np.stack(
        np.meshgrid(np.linspace(0.2, 1.0, 9), np.linspace(0.05, 0.3, 9)), axis=-1
    ).reshape(-1, 2)
    margin = np.log(grid[:, 0]) + 0.5 * np.log(grid[:, 1]) - np.log(threshold)
    return grid, margin + jitter * rng.standard_normal(len(grid)) > 0


def test_a_surface_in_two_measures_follows_both():
    grid, hit = surface(0.2, jitter=0.15)
    names = ("pga_g", "pgv_pga_s")
    for terms in ("quadratic", "linear"):
        fit = fit_fragility(grid, hit, np.arange(81), names=names, surface=terms)
        wanted = ndtr((np.log(grid[:, 0]) + 0.5 * np.log(grid[:, 1]) - np.log(0.2)) / 0.15)
        probability, lower, upper = fit.probability(grid)
        assert np.abs(probability - wanted).mean() < 0.06
        assert (lower <= probability).all()
        assert (probability <= upper).all()
        assert ((lower <= wanted) & (wanted <= upper)).mean() > 0.85
    assert fit.lognormal is None
    inside = fit.inside([[0.5, 0.1], [1.1, 0.1], [0.5, 0.31], [0.2, 0.05]])
    assert inside.tolist() == [True, False, False, True]
    assert fit.grid(5).shape == (25, 2)


def test_a_separated_surface_is_certain_away_from_its_line():
    grid, hit = surface(0.2)
    fit = fit_fragility(grid, hit, np.arange(81), names=("pga_g", "pgv_pga_s"))
    probability, lower, upper = fit.probability([[1.0, 0.3], [0.2, 0.05], [0.5, 0.16]])
    assert probability[0] > 0.99
    assert lower[0] > 0.9
    assert upper[1] < 0.05
    assert upper[2] - lower[2] > 0.3
    assert fit_note(fit) == ""


def test_a_surface_that_falls_is_reported():
    grid, _ = surface(0.2)
    hit = (grid[:, 0] > 0.3) & (grid[:, 0] < 0.7)
    fit = fit_fragility(grid, hit, np.arange(81), names=("pga_g", "pgv_pga_s"))
    assert fit.falling == ("pga_g",)
    assert "falls with pga_g in part" in fit_note(fit)


def test_a_fit_is_the_same_again_and_in_any_order():
    x, hit, group = lognormal_trials(30, 6, between=0.3, within=0.1, seed=5)
    first = fit_fragility(x, hit, group)
    order = np.random.default_rng(0).permutation(x.size)
    second = fit_fragility(x[order], hit[order], group[order])
    for one, other in zip(first.probability([0.3]), second.probability([0.3]), strict=True):
        assert one == pytest.approx(other, abs=0.01)
    again = fit_fragility(x, hit, group).probability([0.3])
    np.testing.assert_array_equal(first.probability([0.3]), again)


def test_what_cannot_be_fitted_is_refused():
    with pytest.raises(ResultError, match="above 0"):
        fit_fragility([0.0, 1.0], np.array([False, True]), [0, 1])
    with pytest.raises(ResultError, match="2 intensities, 1 outcome "):
        fit_fragility([0.5, 1.0], np.array([False]), [0, 1])
    with pytest.raises(ResultError, match="must be boolean"):
        fit_fragility([0.5, 1.0], np.array([0, 1]), [0, 1])
    with pytest.raises(ResultError, match=r"wanted is \(n, 2\)"):
        fit_fragility([0.5, 1.0], np.array([False, True]), [0, 1], names=("a", "b"))
    with pytest.raises(ResultError, match="level"):
        fit_fragility([0.5, 1.0], np.array([False, True]), [0, 1], level=95)
