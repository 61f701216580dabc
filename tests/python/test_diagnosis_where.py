"""WHERE: locations, and the null campaigns they are judged by."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from vsr2.diagnosis.likelihood.evidence import Change, Data, Layout, Table
from vsr2.diagnosis.observed.features import Feature
from vsr2.diagnosis.simulated.library import NONE
from vsr2.diagnosis.verdict.compose import shown
from vsr2.diagnosis.where.discrepancy import DISCREPANCY, disturbed
from vsr2.diagnosis.where.null_campaigns import null_campaigns
from vsr2.diagnosis.where.scan import OUTCOME, Conditions, Location, interleaved, scan


def schedule(sessions=10, each=12, seed=0):
    rng = np.random.default_rng(seed)
    count = sessions * each
    return Conditions(
        log_pga=rng.normal(size=count),
        log_ratio=rng.normal(size=count),
        order=np.arange(count) / (count - 1),
        session=np.repeat(np.arange(sessions), each),
        motion=np.repeat(np.arange(count // 6), 6),
        specimen=np.zeros(count, dtype=np.int64),
        sessions=tuple(f"day {i + 1}" for i in range(sessions)),
        specimens=("rock",),
    )


def locations(residual, conditions, seed=0):
    count = conditions.order.size
    variance = np.full((1, 1, count), 0.21)
    null = (np.random.default_rng(9).random((150, 1, count)) < 0.3) - 0.3
    return scan(
        (residual[None, None], variance),
        (null, np.broadcast_to(variance, null.shape)),
        conditions,
        (OUTCOME,),
        seed=seed,
    )


def test_two_sessions_cannot_show_a_change_over_the_order() -> None:
    """Half of the permutations leave all as it was; rounding must not tell them from the score."""
    there = schedule(sessions=2, each=42)
    for seed in range(30):
        rng = np.random.default_rng(seed)
        p = np.where(there.session == 1, 0.3 + rng.uniform(0.2, 0.6), 0.3)
        found = locations((rng.random(p.size) < p) - 0.3, there, seed)
        ordered = [location.p_familywise for location in found if location.axis == "order"]
        # 999 draws of one half: four standard deviations are 0.06.
        assert min(ordered) > 0.43


def test_a_session_is_judged_by_complete_motions() -> None:
    """Trials of a motion err together: permuting them singly would make every session stand out."""
    there, found = schedule(), 0
    for seed in range(20):
        rng = np.random.default_rng(100 + seed)
        p = np.repeat(rng.choice([0.0, 0.6], there.motion.max() + 1), 6)
        sessions = [
            location.p_familywise
            for location in locations((rng.random(p.size) < p) - 0.3, there, seed)
            if location.axis == "session"
        ]
        found += min(sessions) <= 0.05
    # One in twenty, of twenty: more than four happen less than one time in 300.
    assert found <= 4


def test_no_session_stands_out_where_motions_are_interleaved() -> None:
    """Trials of a motion err together, wherever in its session they stand."""
    blocked = schedule(sessions=4, each=24)
    rng = np.random.default_rng(6)
    mixed = np.concatenate(
        [rng.permutation(blocked.motion[blocked.session == s]) for s in range(4)]
    )
    loud = np.where(blocked.session == 2, 0.9, 0.1)

    def sessions(motion, p):
        there = dataclasses.replace(blocked, motion=motion)
        found = locations((rng.random(p.size) < p) - 0.3, there)
        return min(location.p_familywise for location in found if location.axis == "session")

    assert sessions(mixed, loud) == 1.0
    # Each motion once, or all of a motion in a row: complete motions are permuted.
    assert sessions(np.arange(96), loud) <= 0.01
    assert interleaved(mixed)
    assert not interleaved(np.arange(96))
    assert not interleaved(blocked.motion)


def test_trials_are_permuted_with_their_own_noise() -> None:
    """A quiet session is off by two of its standard deviations; the last three are loud."""
    there = schedule(sessions=6, each=24)
    deviation = np.where(there.session < 3, 0.1, 0.5)
    rng = np.random.default_rng(5)
    residual = deviation * (rng.standard_normal(144) + 2.0 * (there.session == 1))
    null = deviation * rng.standard_normal((150, 1, 144))
    variance = np.broadcast_to(deviation**2, null.shape)
    found = scan((residual[None, None], variance[:1]), (null, variance), there, (OUTCOME,))
    assert next(p for p in found if p.name == "session day 2").p_familywise < 0.01


def test_the_order_of_one_session_is_judged_by_complete_motions() -> None:
    there = dataclasses.replace(
        schedule(),
        session=np.zeros(120, dtype=np.int64),
        sessions=("day 1",),
        motion=np.repeat(np.arange(5), 24),
    )
    found = 0
    for seed in range(40):
        rng = np.random.default_rng(200 + seed)
        p = np.repeat(rng.choice([0.0, 0.6], 5), 24)
        stated = locations((rng.random(p.size) < p) - 0.3, there, seed)
        found += (
            min(location.p_familywise for location in stated if location.axis == "order") <= 0.05
        )
    # One in twenty, of forty: more than six happen less than one time in 300.
    assert found <= 6
    # A trend that motions do not carry is found, and none is sought where they are interleaved.
    rising = np.random.default_rng(3).random(120) < 0.1 + 0.8 * there.order
    short = dataclasses.replace(there, motion=np.repeat(np.arange(20), 6))
    mixed = dataclasses.replace(there, motion=np.arange(120) % 20)
    first, second = (
        next(location for location in locations(rising - 0.3, one) if location.axis == "order")
        for one in (short, mixed)
    )
    assert first.p_familywise <= 0.05
    assert second.p_familywise == 1.0


def test_a_trend_over_sessions_is_found() -> None:
    there = schedule()
    rng = np.random.default_rng(4)
    p = 0.3 + 0.65 * there.order
    found = locations((rng.random(p.size) < p) - 0.3, there)
    ordered = [location for location in found if location.axis == "order"]
    assert ordered[0].p_familywise <= 0.05
    assert ordered[0].effect_size > 0


def test_sessions_that_merely_differ_are_no_trend() -> None:
    there = schedule(sessions=18, each=8)
    shuffled = np.random.default_rng(0).permutation(there.motion)
    there = dataclasses.replace(there, motion=shuffled)
    fired = 0
    for seed in range(80):
        rng = np.random.default_rng(seed)
        p = np.clip(0.3 + 0.25 * rng.standard_normal(18), 0.02, 0.98)[there.session]
        found = locations((rng.random(p.size) < p) - 0.3, there, seed)
        fired += min(q.p_familywise for q in found if q.axis == "order") <= 0.05
    # 5 % of 80 is 4. With permutations within sessions among the others it is 8.
    assert fired <= 6


def test_nothing_is_found_where_nothing_is() -> None:
    there = schedule()
    fired = 0
    for seed in range(12):
        y = np.random.default_rng(100 + seed).random(there.order.size) < 0.3
        fired += locations(y - 0.3, there, seed)[0].p_familywise <= 0.05
    assert fired <= 3


def straight(linear) -> Change:
    """Of nuisances that do not act by their squares."""
    return Change(linear, np.zeros(0, dtype=np.int64), np.zeros((len(linear), 0)))


def test_drawn_null_campaigns_hang_together_as_the_engine_s_do() -> None:
    """One nuisance moves all trials: the drawn deviation of sums must show it."""
    trials, q = 60, 1
    at = Layout(
        np.zeros((1, 0)),
        np.zeros((1, trials)),
        np.ones((1, trials)),
        (np.zeros((1, trials)),),
        (np.full((1, trials), 0.25),),
    )
    table = Table(
        NONE,
        at,
        at,
        np.ones((1, 1)),
        straight(np.full((trials, q), 2.0)),
        (straight(np.full((trials, q), 0.5)),),
        (np.full(trials, 1e-3),),
    )
    rng = np.random.default_rng(1)
    half = (rng.random((50, trials)) < 0.5).astype(float)
    features = np.where(half > 0.5, np.nan, 0.0)[..., None]
    drawn = null_campaigns(table, Data(half, features), count=4000)
    # Overturned: sigma(2 z) has mean 1/2 and standard deviation 0.323 over z ~ N(0, 1).
    share = drawn.overturned.mean(axis=1)
    assert share.mean() == pytest.approx(0.5, abs=0.02)
    assert share.std() == pytest.approx(np.hypot(0.323, 0.38 / np.sqrt(trials)), abs=0.01)
    # A feature is known where the rock stood, as in the engine's campaigns.
    assert np.array_equal(np.isfinite(drawn.features[..., 0]), drawn.overturned < 0.5)
    # 0.5 z plus Student's noise of scale 0.5 and 4 degrees of freedom (variance 2 x 0.25); of
    # those that stood z has mean -E[z tanh z] and second moment 1.
    z = np.linspace(-8, 8, 4001)
    normal = np.exp(-0.5 * z**2) / np.exp(-0.5 * z**2).sum()
    mean = float(normal @ (z * np.tanh(z)))
    expected = np.sqrt(0.25 * (1 - mean**2) + 0.5)
    assert np.nanstd(drawn.features) == pytest.approx(expected, abs=0.02)


def test_drawn_nulls_resolve_what_few_simulated_ones_cannot() -> None:
    there = schedule()
    count = there.order.size
    rng = np.random.default_rng(3)
    variance = np.ones((1, 1, count))
    null, drawn = rng.normal(size=(40, 1, count)), rng.normal(size=(999, 1, count))
    wide = [np.broadcast_to(variance, part.shape) for part in (null, drawn)]
    residual = rng.normal(size=(1, 1, count)) + np.where(there.log_pga > 0.5, 2.0, 0.0)

    def smallest(drawn_null):
        found = scan((residual, variance), (null, wide[0]), there, (OUTCOME,), drawn=drawn_null)
        return found[0].p_familywise

    assert smallest(None) == pytest.approx(1 / 41)
    assert smallest((drawn, wide[1])) == pytest.approx(1 / 1000)
    # What simulated campaigns reach is no more significant than among them, however rarely drawn.
    loud = null.copy()
    loud[:4] = 1.5 * residual[0]
    calm = (0.1 * drawn, wide[1])
    reached = scan((residual, variance), (loud, wide[0]), there, (OUTCOME,), drawn=calm)
    assert reached[0].p_familywise >= 5 / 41
    # Deviations are the simulated ones': drawn campaigns of twice the size say the same.
    assert smallest((2 * drawn, wide[1])) == pytest.approx(1 / 1000)


def test_no_axis_and_no_channel_is_left_out_of_the_locations_shown() -> None:
    table, tilt = Feature("gain", "table", "whole motion"), OUTCOME
    many = [Location(f"condition {i}", "conditions", table, 1.0, 0.01) for i in range(40)]
    late = [
        Location("second half", "order", tilt, 0.5, 0.2),
        Location("last third", "order", tilt, 0.4, 0.3),
        Location("all trials", "conditions", tilt, 0.1, 0.9),
    ]
    names = [location.name for location in shown(many + late)]
    assert names == [*(f"condition {i}" for i in range(20)), "second half", "all trials"]


def test_another_simulator_s_features_differ_alike_within_a_motion() -> None:
    motion = np.repeat(np.arange(40), 5)
    scatter = np.full((200, 2), [0.04, 9.0])
    plain = np.zeros((30, 200, 2))
    plain[0, 3] = np.nan
    found = disturbed(plain, scatter, motion, np.random.default_rng(0))
    assert np.isnan(found[0, 3]).all()
    z = found[1:] / np.sqrt(scatter)
    # 29 x 40 motions of 5 trials: the standard error of the variance is about 0.02.
    assert z.var() == pytest.approx(DISCREPANCY.variance, abs=0.08)
    means = z.reshape(29, 40, 5, 2).mean(axis=2)
    # A motion's mean has the common part and a fifth of the other.
    share = DISCREPANCY.common + (1 - DISCREPANCY.common) / 5
    assert means.var() == pytest.approx(DISCREPANCY.variance * share, abs=0.06)
