"""Losses by simulations alone, of trials simulated again."""

from __future__ import annotations

import numpy as np
import pytest

from vsr2.diagnosis.how_far.resimulation import feature_scores, outcome_loss
from vsr2.diagnosis.likelihood.evidence import Data


def campaigns(overturned, features=None):
    table = np.asarray(overturned, dtype=float)
    none = np.zeros((*table.shape, 0))
    return Data(table, none if features is None else np.asarray(features, dtype=float)[..., None])


def test_outcomes_are_judged_by_the_share_of_simulations() -> None:
    simulated = campaigns([[1, 0, 1], [1, 0, 0], [1, 0, np.nan]])
    found = outcome_loss(simulated, campaigns([[1, 1, np.nan]]))
    # (3 + 1/2) of 4, (0 + 1/2) of 4, and nothing to judge.
    np.testing.assert_allclose(found, [-np.log(3.5 / 4), -np.log(0.5 / 4), 0.0])


def test_the_ensemble_s_score_is_that_of_its_distribution() -> None:
    """CRPS of a standard normal at 0.5 is 0.3314 whatever the number of members, on average."""
    rng = np.random.default_rng(1)
    x = rng.standard_normal((4, 40_000))
    stood = np.zeros_like(x)
    score = feature_scores(campaigns(stood, x), campaigns(stood[:1], np.full((1, 40_000), 0.5)))
    # phi(0.5) = 0.3521, Phi(0.5) = 0.6915: 0.5 (2 Phi - 1) + 2 phi - 1 / sqrt(pi).
    assert score.mean() == pytest.approx(0.3314, abs=4 * score.std() / 200)


def test_a_feature_needs_two_simulations_and_an_observation() -> None:
    x = [[1.0, 1.0, 1.0], [np.nan, 2.0, 2.0], [np.nan, np.nan, 3.0]]
    stood = np.zeros((3, 3))
    score = feature_scores(campaigns(stood, x), campaigns(stood[:1], [[1.0, 1.0, np.nan]]))
    assert np.isnan(score[[0, 2], 0]).all()
    # Members 1 and 2 about 1: a mean distance of 1/2, less half the mean distance of two.
    assert score[1, 0] == pytest.approx(0.5 - 0.5)
