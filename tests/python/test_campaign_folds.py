"""Folds and resamples keep ground motions whole."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from campaign_samples import grid
from vsr2.campaign import grouped_folds, motion_folds, motion_resamples
from vsr2.errors import CampaignError


@settings(max_examples=80, deadline=None)
@given(
    trials=st.lists(
        st.tuples(st.integers(0, 15), st.sampled_from([0.0, 1.0, float("nan")])),
        min_size=2,
        max_size=80,
    ).filter(lambda rows: len({row[0] for row in rows}) >= 2),
    seed=st.integers(0, 5),
    data=st.data(),
)
def test_no_motion_is_on_two_sides_and_no_fold_is_empty(trials, seed, data):
    groups = np.array([f"g{row[0]}" for row in trials])
    outcomes = np.array([row[1] for row in trials])
    folds = data.draw(st.integers(2, len(set(groups))))
    found = grouped_folds(groups, outcomes, folds, seed)
    assert set(found.tolist()) == set(range(folds))
    for group in set(groups):
        assert len(set(found[groups == group].tolist())) == 1
    # The order of the trials does not matter.
    order = np.random.default_rng(0).permutation(len(trials))
    np.testing.assert_array_equal(
        grouped_folds(groups[order], outcomes[order], folds, seed), found[order]
    )


def test_folds_are_stratified_as_far_as_complete_motions_allow():
    # 40 motions of three kinds; each of ten folds can have 8 trials with 4 overturned.
    groups = np.repeat(np.arange(40), [3] * 10 + [3] * 10 + [1] * 20)
    outcomes = np.concatenate([np.ones(30), np.zeros(30), np.tile([1.0, 0.0], 10)])
    found = grouped_folds(groups, outcomes, 10, seed=4)
    sizes = np.bincount(found, minlength=10)
    overturned = np.bincount(found, weights=outcomes, minlength=10)
    assert sizes.tolist() == [8] * 10
    assert overturned.tolist() == [4.0] * 10


def test_seeds_decide_and_repeat():
    campaign = grid()
    one, again = motion_folds(campaign, 4, seed=1), motion_folds(campaign, 4, seed=1)
    np.testing.assert_array_equal(one, again)
    partitions = set()
    for seed in range(5):
        found = motion_folds(campaign, 4, seed)
        partitions.add(
            frozenset(frozenset(campaign.motion_ids[found == k].tolist()) for k in range(4))
        )
    assert len(partitions) > 1


@pytest.mark.parametrize("folds", [1, 0, 13])
def test_a_number_of_folds_that_cannot_be_is_refused(folds):
    with pytest.raises(CampaignError, match="folds of 12 motions"):
        motion_folds(grid(motions=12), folds)


def test_resamples_draw_complete_motions_as_often_as_chance_has_it():
    motions = np.array(["a", "b", "b", "c", "c", "c"])
    drawn = motion_resamples(motions, replicates=4000, seed=2)
    assert drawn.shape == (4000, 6)
    np.testing.assert_array_equal(drawn[:, 1], drawn[:, 2])
    np.testing.assert_array_equal(drawn[:, 3], drawn[:, 5])
    # Three draws of three motions in every replicate.
    np.testing.assert_array_equal(drawn[:, [0, 1, 3]].sum(axis=1), 3)
    # Binomial(3, 1/3): mean 1, variance 2/3; five standard errors of 4000 draws.
    assert drawn.mean(axis=0) == pytest.approx(1.0, abs=5 * np.sqrt(2 / 3 / 4000))
    assert drawn[:, 0].var() == pytest.approx(2 / 3, rel=0.1)
    np.testing.assert_array_equal(drawn, motion_resamples(motions, replicates=4000, seed=2))
    with pytest.raises(CampaignError, match="0 replicates"):
        motion_resamples(motions, replicates=0)
    with pytest.raises(CampaignError, match="no trials"):
        motion_resamples([], 1)
