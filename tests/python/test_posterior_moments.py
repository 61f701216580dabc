"""Sums over blocks, copies and folds: those of all campaigns at once."""

from __future__ import annotations

import numpy as np
import pytest

from vsr2.ensemble.simulated import linear_algebra
from vsr2.ensemble.simulated.linear_algebra import ridge, ridge_of_copies
from vsr2.posterior.goodness_of_fit import misfit, misfits_by
from vsr2.posterior.moments import Moments
from vsr2.posterior.summaries import SUMMARY, Standard, Standards

COUNT, TRIALS, FEATURES = 60, 7, 3
fold = np.random.default_rng(1).permutation(COUNT) % SUMMARY.folds
plain = np.random.default_rng(2).random(COUNT) < 0.3


@pytest.fixture(autouse=True)
def _small_blocks(monkeypatch) -> None:
    monkeypatch.setattr(linear_algebra, "BLOCK", 100)


def simulated(precision=np.float64):
    """Three copies of campaigns, in which a third is unknown, and one feature without effect."""
    rng, out = np.random.default_rng(0), []
    for _ in range(3):
        overturned = (rng.random((COUNT, TRIALS)) < 0.4).astype(float)
        features = 50.0 + rng.standard_normal((COUNT, TRIALS, FEATURES))
        features[rng.random(features.shape) < 0.3] = np.nan
        features[plain, :, 2] = np.nan
        out.append((overturned.astype(precision), features.astype(precision)))
    return out


def test_moments_are_those_of_all_values_at_once() -> None:
    values = np.concatenate([features for _, features in simulated()])[..., :2]
    found = Moments.of(values)
    np.testing.assert_array_equal(found.count, np.isfinite(values).sum(axis=0))
    np.testing.assert_allclose(found.mean, np.nanmean(values, axis=0), rtol=1e-13)
    np.testing.assert_allclose(found.variance, np.nanvar(values, axis=0), rtol=1e-12)
    parts = Moments.of(values[:11]) + Moments.of(values[11:])
    np.testing.assert_allclose(parts.variance, found.variance, rtol=1e-12)


def test_what_is_never_known_has_no_moments() -> None:
    found = Moments.of(np.full((4, 2), np.nan)) + Moments.of(np.full((5, 2), np.nan))
    for one in (found.count, found.mean, found.variance):
        assert not one.any()


def test_the_other_folds_standardise_as_their_campaigns_together_do() -> None:
    copies = simulated()
    found = Standards.of(copies, plain, fold)

    def concatenated(rows):
        return Standard.of(
            np.concatenate([o[rows] for o, _ in copies]),
            np.concatenate([f[rows] for _, f in copies]),
            np.tile(plain[rows], len(copies)),
        )

    wanted = [concatenated(np.ones(COUNT, dtype=bool))]
    wanted += [concatenated(fold != k) for k in range(SUMMARY.folds)]
    for own, other in zip((found.by_all, *found.others), wanted, strict=True):
        np.testing.assert_allclose(own.probability, other.probability, rtol=1e-12)
        np.testing.assert_allclose(own.centre, other.centre, rtol=1e-12)
        np.testing.assert_allclose(own.scatter, other.scatter, rtol=1e-10)
    misfits = misfits_by(found, copies[1:], fold)
    for k, standard in enumerate(wanted[1:]):
        for row, (outcome, features) in zip(misfits, copies[1:], strict=True):
            residuals = standard.residuals(outcome[fold == k], features[fold == k])
            np.testing.assert_allclose(row[fold == k], misfit(residuals), rtol=1e-9)


def test_what_differs_by_rounding_does_not_differ() -> None:
    """A travel within what can be distinguished is the same number in every campaign."""
    features = np.full((30, 4, 1), np.log(0.05))
    features[::2] = np.nextafter(features[::2], 0)
    standard = Standard.of(np.zeros((30, 4)), features, np.ones(30, dtype=bool))
    assert np.abs(standard.residuals(np.zeros((30, 4)), features)[:, 4:]).max() < 1e-12


def test_residuals_have_the_precision_of_the_features() -> None:
    double, single = (
        [Standards.of(copies, plain, fold).by_all.residuals(*one) for one in copies]
        for copies in (simulated(), simulated(np.float32))
    )
    for one, other in zip(double, single, strict=True):
        assert (one.dtype, other.dtype) == (np.float64, np.float32)
        # Of features near 50: 50 / 2^24.
        np.testing.assert_allclose(one, other, atol=3e-5)


@pytest.mark.parametrize("columns", [8, 300])
def test_ridge_of_copies_is_that_of_the_rows_together(columns) -> None:
    """By the products of columns, and by those of rows."""
    rng = np.random.default_rng(4)
    copies = [rng.standard_normal((40, columns)) + 2.0 for _ in range(2)]
    rows = np.flatnonzero(np.arange(40) % 5)
    y = rng.standard_normal((rows.size, 3))
    y -= y.mean(axis=0)
    centre, found = ridge_of_copies(copies, rows, y, [0.5, 20.0])
    x = np.concatenate([one[rows] for one in copies])
    np.testing.assert_allclose(centre, x.mean(axis=0), rtol=1e-12)
    for penalty, own in zip([0.5, 20.0], found, strict=True):
        wanted = ridge(x - x.mean(axis=0), np.tile(y, (2, 1)), penalty)
        np.testing.assert_allclose(own, wanted, rtol=1e-9, atol=1e-12)
