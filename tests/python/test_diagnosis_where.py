"""WHERE: locations, and the gap-free campaigns they are judged by."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from planted import shaken_campaign
from vsr2.diagnosis.where.locations import where_it_lies
from vsr2.diagnosis.where.scan import (
    OUTCOME,
    SCAN,
    Conditions,
    LocationKind,
    interleaved,
    scan,
)
from vsr2.ensemble.observed.features import LARGEST_TILT
from vsr2.ensemble.observed.observations import observe_campaign
from vsr2.motion import Record


@pytest.fixture
def few_permutations(monkeypatch):
    """Enough for a p value of 0.05."""
    few = dataclasses.replace(SCAN, permutations=199)
    monkeypatch.setattr("vsr2.diagnosis.where.scan.SCAN", few)


def schedule(sessions=10, each=12, seed=0):
    rng = np.random.default_rng(seed)
    count = sessions * each
    return Conditions(
        log_pga_g=rng.normal(size=count),
        log_pgv_pga_s=rng.normal(size=count),
        order=np.arange(count) / (count - 1),
        session=np.repeat(np.arange(sessions), each),
        motion=np.repeat(np.arange(count // 6), 6),
        specimen=np.zeros(count, dtype=np.int64),
        sessions=tuple(f"day {i + 1}" for i in range(sessions)),
        specimens=("rock",),
    )


def locations(residual, conditions, seed=0):
    """Of outcomes about a probability of 0.3, standardised."""
    count = conditions.order.size
    null = (np.random.default_rng(9).random((150, 1, count)) < 0.3) - 0.3
    unit = np.sqrt(0.21)
    return scan(residual[None] / unit, null / unit, conditions, (OUTCOME,), seed=seed)


def test_two_sessions_cannot_show_a_change_over_the_order() -> None:
    """Half of the permutations leave all as it was; rounding must not tell them from the score."""
    there = schedule(sessions=2, each=42)
    for seed in range(12):
        rng = np.random.default_rng(seed)
        p = np.where(there.session == 1, 0.3 + rng.uniform(0.2, 0.6), 0.3)
        found = locations((rng.random(p.size) < p) - 0.3, there, seed)
        ordered = [location.p_familywise for location in found if location.kind.axis == "order"]
        # 999 draws of one half: four standard deviations are 0.06.
        assert min(ordered) > 0.43


def test_a_session_is_judged_by_complete_motions(few_permutations) -> None:
    """Trials of a motion err together: permuting them singly would make every session stand out."""
    there, found = schedule(), 0
    for seed in range(20):
        rng = np.random.default_rng(100 + seed)
        p = np.repeat(rng.choice([0.0, 0.6], there.motion.max() + 1), 6)
        sessions = [
            location.p_familywise
            for location in locations((rng.random(p.size) < p) - 0.3, there, seed)
            if location.kind is LocationKind.SESSION
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
        return min(one.p_familywise for one in found if one.kind is LocationKind.SESSION)

    assert sessions(mixed, loud) == 1.0
    # Each motion once, or all of a motion in a row: complete motions are permuted.
    assert sessions(np.arange(96), loud) <= 0.01
    assert interleaved(mixed)
    assert not interleaved(np.arange(96))
    assert not interleaved(blocked.motion)


def test_the_order_of_one_session_is_judged_by_complete_motions(few_permutations) -> None:
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
        found += min(one.p_familywise for one in stated if one.kind is LocationKind.TREND) <= 0.05
    # One in twenty, of forty: more than six happen less than one time in 300.
    assert found <= 6
    # A trend that motions do not carry is found, and none is sought where they are interleaved.
    rising = np.random.default_rng(3).random(120) < 0.1 + 0.8 * there.order
    short = dataclasses.replace(there, motion=np.repeat(np.arange(20), 6))
    mixed = dataclasses.replace(there, motion=np.arange(120) % 20)
    first, second = (
        next(found for found in locations(rising - 0.3, one) if found.kind is LocationKind.TREND)
        for one in (short, mixed)
    )
    assert first.p_familywise <= 0.05
    assert second.p_familywise == 1.0


def test_a_trend_over_sessions_is_found() -> None:
    there = schedule()
    rng = np.random.default_rng(4)
    p = 0.3 + 0.65 * there.order
    found = locations((rng.random(p.size) < p) - 0.3, there)
    ordered = [location for location in found if location.kind.axis == "order"]
    assert ordered[0].p_familywise <= 0.05
    assert ordered[0].effect_size > 0


def test_sessions_that_merely_differ_are_no_trend(few_permutations) -> None:
    there = schedule(sessions=18, each=8)
    shuffled = np.random.default_rng(0).permutation(there.motion)
    there = dataclasses.replace(there, motion=shuffled)
    fired = 0
    for seed in range(80):
        rng = np.random.default_rng(seed)
        p = np.clip(0.3 + 0.25 * rng.standard_normal(18), 0.02, 0.98)[there.session]
        found = locations((rng.random(p.size) < p) - 0.3, there, seed)
        fired += min(q.p_familywise for q in found if q.kind.axis == "order") <= 0.05
    # 5 % of 80 is 4. With permutations within sessions among the others it is 8.
    assert fired <= 6


def test_nothing_is_found_where_nothing_is(few_permutations) -> None:
    there = schedule()
    fired = 0
    for seed in range(12):
        y = np.random.default_rng(100 + seed).random(there.order.size) < 0.3
        fired += locations(y - 0.3, there, seed)[0].p_familywise <= 0.05
    assert fired <= 3


# --- planted locations ---------------------------------------------------------------------------

TWO_CHANNELS = (OUTCOME, LARGEST_TILT)


def named(location):
    """Kind and values."""
    return (location.kind, *location.values.values())


def planted(there, where, size=2.0, seed=0, known=1.0):
    """Of 200 gap-free campaigns whose trials err together by campaign, and one that is off."""
    rng = np.random.default_rng(seed)
    count = there.order.size

    def campaigns(n):
        common = 0.3 * rng.standard_normal((n, 2, 1))
        out = common + rng.standard_normal((n, 2, count))
        return np.where(rng.random((n, 2, count)) < known, out, 0.0)

    one = campaigns(1)[0]
    one[1] += np.where(one[1] != 0, size * where, 0.0)
    return scan(one, campaigns(200), there, TWO_CHANNELS, seed=seed)


def test_a_planted_location_is_found_and_holds_most_of_the_effect() -> None:
    there = schedule()
    low, high = np.quantile(there.log_pga_g, [1 / 3, 2 / 3])
    cases = {
        ("intensity", "high"): there.log_pga_g >= high,
        ("intensity", "low"): there.log_pga_g < low,
        ("session", "day 3"): there.session == 2,
    }
    for name, inside in cases.items():
        found = planted(there, inside.astype(float), size=3.0, known=0.9)
        best = next(one for one in found if named(one) == name and one.feature == LARGEST_TILT)
        assert best.stands_out
        np.testing.assert_array_equal(best.trials, np.flatnonzero(inside))
        # Whatever else stands out lies there too, most of it.
        for one in found:
            if one.stands_out:
                assert one.feature == LARGEST_TILT
                assert inside[list(one.trials)].mean() > 0.5
        assert best.concentration_ci90[0] >= SCAN.concentration
        # All of it lies there, but for noise.
        assert best.concentration == pytest.approx(1 / inside.mean(), rel=0.3)
        assert best.effect_size == pytest.approx(3.0, abs=0.7)
    # What is everywhere stands out nowhere, however significant.
    everywhere = planted(there, np.ones(there.order.size))
    assert everywhere[0].is_significant
    assert not any(one.stands_out for one in everywhere)
    complete = next(
        one for one in everywhere if one.kind == "all_trials" and one.feature == LARGEST_TILT
    )
    assert complete.is_significant
    assert complete.concentration == pytest.approx(1.0)


def test_what_one_motion_holds_does_not_stand_out() -> None:
    """Without that motion its location would hold nothing."""
    there = schedule()
    inside = there.log_pga_g >= np.quantile(there.log_pga_g, 2 / 3)
    one = inside & (there.motion == there.motion[np.argmax(inside)])
    found = planted(there, one.astype(float), size=80.0)
    best = next(q for q in found if named(q) == ("intensity", "high") and q.feature == LARGEST_TILT)
    assert best.is_significant
    assert best.concentration > SCAN.concentration
    assert best.concentration_ci90[0] < 1
    assert not best.stands_out


def test_the_share_is_of_outcomes_and_largest_tilts_whatever_the_feature() -> None:
    there = schedule()
    inside = there.log_pga_g >= np.quantile(there.log_pga_g, 2 / 3)
    aloft = LARGEST_TILT._replace(name="time_aloft")
    rng = np.random.default_rng(8)
    null = rng.standard_normal((200, 3, inside.size))
    observed = rng.standard_normal((3, inside.size))
    observed[1] += 3.0
    observed[2] += 3.0 * inside
    found = scan(observed, null, there, (OUTCOME, LARGEST_TILT, aloft))
    own = next(one for one in found if named(one) == ("intensity", "high") and one.feature == aloft)
    assert own.is_significant
    assert own.concentration == pytest.approx(1.0, abs=0.2)
    assert not own.stands_out


def test_concentration_is_the_share_of_the_excess_over_that_of_trials() -> None:
    there = schedule(sessions=4, each=6)
    rng = np.random.default_rng(1)
    null = rng.standard_normal((50, 1, 24))
    observed = rng.standard_normal((1, 24))
    observed[0, there.session == 1] += 5
    found = scan(observed, null, there, (OUTCOME,))
    excess = observed[0] ** 2 - (null[:, 0] ** 2).mean(axis=0)
    for one in found:
        inside = list(one.trials)
        expected = excess[inside].sum() / excess.sum() / (len(inside) / 24)
        assert one.concentration == pytest.approx(expected)
        assert one.concentration_ci90[0] <= one.concentration <= one.concentration_ci90[1]
    assert next(o for o in found if named(o) == ("session", "day 2")).concentration > 2
    # Of a step the trials from it on, of a trend the later half.
    members = {named(one): set(one.trials) for one in found}
    assert members["step", "day 3"] == set(range(12, 24))
    assert members["trend",] == set(range(12, 24))
    assert members["all_trials",] == set(range(24))


def test_at_most_one_gap_free_campaign_in_twenty_has_a_location(few_permutations) -> None:
    there = schedule(sessions=6, each=12)
    significant = standing_out = 0
    for seed in range(60):
        found = planted(there, np.zeros(72), seed=seed, known=0.8)
        significant += found[0].is_significant
        standing_out += any(one.stands_out for one in found)
    # 5 % of 60 is 3; more than seven happen once in 80, though permutations take a part of it.
    assert significant <= 7
    assert standing_out <= significant


def test_what_is_scanned_are_outcomes_features_and_the_table() -> None:
    plain = shaken_campaign(5, 8, duration=2.0)
    time = np.arange(400) * 0.005
    moved = 0.05 * np.sin(2 * np.pi * 1.5 * time) * np.sin(np.pi * time / 2)

    def campaign(gain):
        acceleration = gain * np.gradient(np.gradient(moved, 0.005), 0.005)
        motions = {
            name: Record(
                name=name, sample_interval=0.005, displacement=moved, acceleration=acceleration
            )
            for name in plain.motions
        }
        trials = tuple(
            dataclasses.replace(t, overturned=i % 3 == 0, peak_tilt=0.1)
            for i, t in enumerate(plain.trials)
        )
        return observe_campaign(dataclasses.replace(plain, trials=trials, motions=motions), "M")

    trials = np.arange(3, 40)
    rng = np.random.default_rng(0)
    null = rng.standard_normal((100, 2 * trials.size))

    def found(gain):
        return where_it_lies(campaign(gain), trials, rng.standard_normal(74), null, 0)

    for gain, off in ((1.0, False), (1.08, True)):
        locations = found(gain)
        channels = {one.feature.channel for one in locations}
        assert channels == {"outcome", "tilt", "table"}
        table = [one for one in locations if one.feature.channel == "table"]
        assert any(one.is_significant for one in table) is off
        assert {named(one) for one in locations if one.kind is LocationKind.SESSION} == {
            ("session", "S00"), ("session", "S01"),
        }  # fmt: skip
    # Trials that were not simulated have no place.
    assert max(max(one.trials) for one in locations) == trials.size - 1
