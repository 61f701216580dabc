"""The posterior's parameters: intervals of values, given that an effect acts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from diagnosis_samples import campaigns_of
from planar.planar_library import PLANAR_LIBRARY
from vsr2.effects import library as full_library
from vsr2.ensemble.simulated.campaigns import Acting
from vsr2.posterior.parameters import Parameters, fit_parameters, nearest_of_prior

GAIN, OFFSET = (full_library()[name] for name in ("table_gain", "com_offset"))

CATCH = PLANAR_LIBRARY["catch"]
"""Its null is infinite."""


def draws(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def fitted(effect, values, residuals):
    sets = tuple((Acting(effect.name, 1, 1.0, tuple(row)),) for row in values)
    # Campaigns without effect have no part in it.
    rows = np.concatenate([residuals, 1e6 * np.ones((5, residuals.shape[1]))])
    return fit_parameters({effect.name: effect}, campaigns_of([*sets, *[()] * 5]), rows)


@pytest.mark.parametrize(("noise", "most"), [(0.03, 1.0), (0.15, 0.97)])
def test_intervals_hold_what_they_state(noise, most) -> None:
    """A value is seen through forty residuals, with an error that is known."""
    rng = np.random.default_rng(0)
    low, high = GAIN.parameters[0].lower, GAIN.parameters[0].upper
    way = rng.standard_normal(40)
    way /= np.linalg.norm(way)

    def seen(values):
        unit = values[:, None] / (high - low) / noise
        return unit * way + rng.standard_normal((values.size, 40))

    values, truth = rng.uniform(low, high, 300), rng.uniform(low, high, 250)
    parameters = fitted(GAIN, values[:, None], seen(values))
    covered, width = [], []
    for one, residuals in zip(truth, seen(truth), strict=True):
        samples = parameters.sample("table_gain", residuals, draws())[:, 0]
        assert samples.shape == (400,)
        ends = np.quantile(samples, [0.05, 0.95])
        covered.append(ends[0] <= one <= ends[1])
        width.append(np.ptp(ends))
    # Binomial, with a standard error of 0.02.
    assert 0.85 <= np.mean(covered) <= most
    # No wider than twice the exact ones, or the nearest fifth of the range.
    least = 2 * 1.645 * noise * (high - low)
    assert np.mean(width) < max(1.7 * least, 0.3 * (high - low))


@pytest.mark.parametrize("count", [6, 12])
def test_intervals_of_few_campaigns_are_as_wide_as_these_are_few(count) -> None:
    """The scatter of a few misses is not known well; their extremes hold (n - 1) / (n + 1)."""
    rng = np.random.default_rng(1)
    low, high = GAIN.parameters[0].lower, GAIN.parameters[0].upper
    way = np.ones(40) / math.sqrt(40)

    def seen(values):
        return 20 * values[:, None] / (high - low) * way + rng.standard_normal((values.size, 40))

    covered = []
    for _ in range(150):
        values, truth = rng.uniform(low, high, count), rng.uniform(low, high, 1)
        own = fitted(GAIN, values[:, None], seen(values))
        samples = own.sample("table_gain", seen(truth)[0], draws())[:, 0]
        ends = np.quantile(samples, [0.05, 0.95])
        covered.append(bool(ends[0] <= truth[0] <= ends[1]))
    # Binomial, with a standard error of 0.03; the extremes of six hold 0.71.
    assert np.mean(covered) >= 0.8


def test_sizes_beyond_the_simulated_ones_are_reached() -> None:
    """The look's detection limit may be too low, and with it the largest size simulated."""
    rng = np.random.default_rng(7)
    way = rng.standard_normal(40)
    values = rng.uniform(-0.05, 0.05, 300)
    parameters = fitted(
        GAIN, values[:, None], 40 * values[:, None] * way + rng.standard_normal((300, 40))
    )
    for value, wanted in ((0.09, 0.09), (0.5, GAIN.parameters[0].upper)):
        samples = parameters.sample("table_gain", 40 * value * way, draws())[:, 0]
        assert np.median(samples) == pytest.approx(wanted, rel=0.1)
        assert samples.max() <= GAIN.parameters[0].upper


def test_samples_keep_to_a_prior_that_lacks_the_null() -> None:
    """A tilt that catches the rock is 5 to 25 degrees; no catch, 180, is no value of it."""
    rng = np.random.default_rng(8)
    catch = full_library()["catch"]
    slack = catch.parameters[0]
    values = rng.uniform(slack.lower, slack.upper, 300)
    way = np.ones(40)
    seen = 0.1 * values[:, None] * way + rng.standard_normal((300, 40))
    parameters = fitted(catch, values[:, None], seen)
    for given, wanted in ((24.0, None), (60.0, slack.upper), (-30.0, slack.lower)):
        samples = parameters.sample("catch", 0.1 * given * way, draws())[:, 0]
        assert slack.lower <= samples.min() <= samples.max() <= slack.upper
        if wanted is not None:
            assert np.median(samples) == pytest.approx(wanted)


def test_a_parameter_beside_another_is_at_its_null_or_within_its_prior() -> None:
    gap, ends = np.array([-0.2, 0.01, 0.04, 0.1, 0.5]), np.array([0.3, 0.05])
    for null, least in ((False, 0.05), (True, 0.0)):
        held = nearest_of_prior(gap, ends, null=null)
        np.testing.assert_allclose(held, [least, least, 0.05, 0.1, 0.3])


def test_residuals_that_are_not_known_have_no_part() -> None:
    rng = np.random.default_rng(2)
    values = rng.uniform(-0.15, 0.15, 200)
    residuals = 20 * values[:, None] * np.ones(12) + rng.standard_normal((200, 12))
    parameters = fitted(GAIN, values[:, None], residuals)
    known = np.arange(12) < 8
    own = 20 * 0.1 + rng.standard_normal(12)
    other = np.where(known, own, 1e3)
    plain = parameters.sample("table_gain", own, draws(3), columns=known)
    np.testing.assert_array_equal(
        plain, parameters.sample("table_gain", other, draws(3), columns=known)
    )
    less = Parameters(
        parameters.library, parameters.residuals[:, known], parameters.rows, parameters.values
    )
    # Sums over other strides differ in their last bits.
    np.testing.assert_allclose(plain, less.sample("table_gain", own[known], draws(3)), rtol=1e-9)
    assert (plain != parameters.sample("table_gain", own, draws(3))).any()
    assert (plain != parameters.sample("table_gain", own, draws(4), columns=known)).any()


def test_expected_residuals_are_those_of_campaigns_alike() -> None:
    rng = np.random.default_rng(4)
    values = rng.uniform(-0.15, 0.15, 500)
    way = rng.standard_normal(30)
    residuals = 30 * values[:, None] * way + rng.standard_normal((500, 30))
    parameters = fitted(GAIN, values[:, None], residuals)
    found = np.mean(
        [
            parameters.expected("table_gain", 30 * 0.08 * way + rng.standard_normal(30))
            for _ in range(12)
        ],
        axis=0,
    )
    # The nearest fifth of a range of 0.3, about 0.08; one campaign is placed to 1 / |way|.
    slope = found @ way / (way @ way)
    assert slope == pytest.approx(30 * 0.08, rel=0.1)
    assert np.std(found - slope * way) < 0.2


def test_angles_are_regressed_on_a_circle() -> None:
    rng = np.random.default_rng(5)
    azimuth = rng.uniform(0, 360, 400)
    turn = np.radians(azimuth)
    ways = rng.standard_normal((2, 20))
    residuals = np.stack([np.cos(turn), np.sin(turn)], axis=1) @ ways
    residuals += 0.2 * rng.standard_normal(residuals.shape)
    names = [p.name for p in OFFSET.parameters]
    values = np.zeros((400, len(names)))
    values[:, names.index("azimuth")] = azimuth
    values[:, names.index("distance")] = 0.01
    parameters = fitted(OFFSET, values, residuals)
    # Due east: samples lie on both sides of 0, none opposite.
    found = parameters.sample("com_offset", ways[0], draws())[:, names.index("azimuth")]
    apart = np.abs((found + 180) % 360 - 180)
    assert apart.max() < 60
    assert (found < 90).any()
    assert (found > 270).any()


def test_an_angle_about_zero_keeps_its_sign() -> None:
    rng = np.random.default_rng(7)
    effect = full_library()["registration"]
    yaw = rng.uniform(-180, 180, 400)
    turn = np.radians(yaw)
    ways = rng.standard_normal((2, 20))
    residuals = np.stack([np.cos(turn), np.sin(turn)], axis=1) @ ways
    residuals += 0.1 * rng.standard_normal(residuals.shape)
    names = [p.name for p in effect.parameters]
    values = np.zeros((400, len(names)))
    values[:, names.index("yaw")] = yaw
    parameters = fitted(effect, values, residuals)
    for true in (-140.0, -10.0, 25.0, 170.0):
        seen = np.array([math.cos(math.radians(true)), math.sin(math.radians(true))]) @ ways
        found = parameters.sample("registration", seen, draws())[:, names.index("yaw")]
        assert np.abs(found).max() <= 180
        apart = (found - true + 180) % 360 - 180
        assert abs(np.median(apart)) < 5, true


def test_what_has_an_infinite_null_is_regressed_by_its_inverse() -> None:
    rng = np.random.default_rng(6)
    slack = np.where(rng.random(300) < 0.3, np.inf, rng.uniform(0.09, 0.44, 300))
    way = rng.standard_normal(20)
    residuals = 1 / slack[:, None] * way + 0.5 * rng.standard_normal((300, 20))
    parameters = fitted(CATCH, slack[:, None], residuals)
    strong = parameters.sample("catch", 1 / 0.14 * way, draws())[:, 0]
    assert np.median(strong) == pytest.approx(0.14, rel=0.15)
    # As good as none: 1 / slack scatters by 0.5 / |way| about 0, a ninth; the prior begins at 2.3.
    assert (parameters.sample("catch", 0.0 * way, draws())[:, 0] > 1.0).mean() > 0.95
