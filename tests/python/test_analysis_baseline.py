"""The no-physics baseline: finds a known curve, keeps motions apart, bears separable data."""

from dataclasses import replace

import numpy as np
import pytest

from campaign_samples import grid
from vsr2.analysis.baseline import (
    baseline_scores,
    logistic_baseline,
    logistic_probability,
    peer_columns,
)
from vsr2.errors import CampaignError, ResultError
from vsr2.motion import STANDARD_GRAVITY
from vsr2.report.messages.commands import baseline_table


def changed(campaign, change):
    return replace(campaign, trials=tuple(change(t) for t in campaign.trials))


def test_a_known_curve_is_found_in_any_unit():
    rng = np.random.default_rng(0)
    pga, ratio = np.exp(rng.normal(0, 0.7, 20_000)), np.exp(rng.normal(-2.5, 0.6, 20_000))

    def true(a, b):
        a, b = np.log(a), np.log(b)
        return 1 / (1 + np.exp(-(1.5 + 2.0 * a + 0.8 * b - 0.5 * a * a + 0.4 * a * b)))

    overturned = rng.random(20_000) < true(pga, ratio)
    at = np.exp(rng.normal(0, 0.5, 200)), np.exp(rng.normal(-2.5, 0.4, 200))
    found = logistic_probability(pga, ratio, overturned, *at)
    # Six coefficients from 20 000 trials: an error of p of about sqrt(6 / 20 000) / 2 = 0.01.
    assert np.abs(found - true(*at)).mean() < 0.01
    assert np.abs(found - true(*at)).max() < 0.05
    other = logistic_probability(pga / 9.81, ratio * 1e3, overturned, at[0] / 9.81, at[1] * 1e3)
    np.testing.assert_allclose(other, found, atol=1e-3)


def test_separable_data_have_a_steep_but_finite_curve():
    pga = np.linspace(0.1, 1.0, 40)
    found = logistic_probability(pga, np.full(40, 0.1), pga > 0.5, [0.2, 0.5, 0.9], [0.1] * 3)
    assert np.isfinite(found).all()
    assert found[0] < 0.02
    assert 0.1 < found[1] < 0.9
    assert found[2] > 0.98


def test_one_outcome_alone_gives_its_rate():
    one = logistic_probability([1.0, 2.0], [0.1, 0.1], [True, True], [5.0], [0.1])
    assert one.tolist() == [0.75]
    none = logistic_probability([1.0, 2.0], [0.1, 0.1], [False, False], [5.0], [0.1])
    assert none.tolist() == [0.25]


@pytest.mark.parametrize(
    ("pga", "ratio", "truth", "words"),
    [
        ([0.0], [0.1], [True], "above 0"),
        ([np.nan], [0.1], [True], "above 0"),
        ([1.0], [0.1, 0.1], [True], r"both must be \(n,\)"),
        ([1.0], [0.1], [True, False], "2 outcomes for 1"),
        ([], [], [], "0 outcomes"),
    ],
)
def test_bad_intensities_are_refused(pga, ratio, truth, words):
    with pytest.raises(ResultError, match=words):
        logistic_probability(pga, ratio, truth, [1.0], [0.1])


def test_out_of_fold_never_sees_the_motion():
    campaign = grid(motions=8, scalings=6)
    base = logistic_baseline(campaign, folds=4, seed=2)
    # Turning all outcomes of one fold around changes no prediction within it, and those outside.
    turned = changed(
        campaign,
        lambda t: replace(t, overturned=t.overturned ^ bool(base.fold[t.order] == 0)),
    )
    # The folds of the turned campaign may differ, so each is predicted by hand.
    pga = np.array([t.pga_g for t in campaign.trials]) * STANDARD_GRAVITY
    ratio = np.array([t.pgv_pga_s for t in campaign.trials])
    for k in range(4):
        test = base.fold == k
        by_hand = [
            logistic_probability(
                pga[~test], ratio[~test], (c.overturned == 1)[~test], pga[test], ratio[test]
            )
            for c in (campaign, turned)
        ]
        np.testing.assert_array_equal(by_hand[0], base.out_of_fold[test])
        assert np.array_equal(*by_hand) == (k == 0)


def test_memorable_motions_look_better_in_sample_than_out_of_fold():
    # Outcomes by motion alone: what there is to learn does not carry to other motions.
    campaign = grid(motions=14, scalings=20, seed=3)
    fate = np.random.default_rng(1).random(14) < 0.5
    campaign = changed(campaign, lambda t: replace(t, overturned=bool(fate[int(t.motion[1:])])))
    scores = {s.fitted: s.metrics for s in baseline_scores(campaign, folds=7, replicates=50)}
    assert scores["in_sample"].accuracy > scores["out_of_fold"].accuracy + 0.1


def test_trials_without_outcome_or_intensity_are_left_out():
    campaign = grid()

    def spoil(t):
        if t.order == 0:
            return replace(t, overturned=None)
        if t.order == 1:
            return replace(t, pga_g=None)
        return replace(t, pgv_pga_s=0.0) if t.order == 2 else t

    base = logistic_baseline(changed(campaign, spoil), folds=4)
    assert np.flatnonzero(~base.used).tolist() == [0, 1, 2]
    assert base.out_of_fold.shape == (len(campaign) - 3,)
    assert np.isfinite(base.out_of_fold).all()
    with pytest.raises(ResultError, match="no trial has an outcome, PGA and PGV/PGA"):
        logistic_baseline(changed(campaign, lambda t: replace(t, pga_g=None)))
    with pytest.raises(CampaignError, match="13 folds of 12 motions"):
        logistic_baseline(campaign, folds=13)


def test_peers_are_scored_on_what_they_predict():
    campaign = changed(
        grid(),
        lambda t: replace(
            t,
            extra={"x_copy": float(t.overturned), "x_number": 0.5 + t.order}
            | ({"x_some": 1.0} if t.order < 10 else {}),
        ),
    )
    assert peer_columns(campaign) == ("x_copy", "x_some")
    scores = {s.name: s for s in baseline_scores(campaign, folds=4, replicates=50)}
    assert scores["x_copy"].metrics.accuracy == 1.0
    assert scores["x_copy"].intervals["accuracy"].low == 1.0
    assert scores["x_some"].metrics.trials == 10
    assert scores["x_some"].metrics.recall == 1.0
    assert "x_number" not in scores
    table = baseline_table(list(scores.values()))
    assert "1.000 [1.000, 1.000]" in table
    assert table.splitlines()[0].split()[:3] == ["prediction", "fitted", "trials"]
