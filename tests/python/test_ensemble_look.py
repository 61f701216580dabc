"""The look at effects: detection limits on a few trials."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis_samples import SCATTER, LinearSimulator, loss
from planar.planar_library import PLANAR_LIBRARY
from vsr2.effects import library as full_library
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.campaigns import insensitive
from vsr2.ensemble.simulated.look import (
    LOOK,
    Limit,
    limits_at,
    look,
    most_tried,
    spread,
    tried_parameters,
    tries,
)


def limits_of(slopes, trials=40, **options):
    """Of effects, whose trials all lift off and stand."""
    with SimulationCache(LinearSimulator(slopes, trials=trials, **options)) as cache:
        return look(cache, trials)


def test_the_limit_of_a_linear_effect_is_three_deviations_of_the_campaign() -> None:
    # At a share s each of forty trials moves by 4 s deviations: 3 = 4 s sqrt(40).
    found = limits_of({"wear": loss(4.0)})
    assert found.responding.tolist() == list(range(40))
    limit = found.limits["wear", "loss", 1]
    # Two draws each, of equal noise with and without the effect; scatters of 48 draws.
    assert limit.share == pytest.approx(LOOK.signal / 4 / np.sqrt(40), rel=0.1)
    assert not limit.jumps


def test_what_a_nuisance_does_too_is_seen_the_less() -> None:
    """A nuisance that moves all trials as the effect does, by as much as they scatter."""
    limit = limits_of({"wear": loss(4.0)}, nuisance=SCATTER).limits["wear", "loss", 1]
    # In units of sqrt(2) scatters the nuisance is 1 / sqrt(2) for all, known from 48 draws to a
    # variance of 1 / 2 / 48: by the Sherman-Morrison formula 40 changes c have this signal.
    squared = 40 - (40 / 2) * 40 / (1 + 40 / 2 * (1 + 1 / 48))
    expected = LOOK.signal * np.sqrt(2) / 4 / np.sqrt(squared)
    assert limit.share == pytest.approx(expected, rel=0.1)
    # An effect of a direction of its own is not.
    signs = np.where(np.arange(40) % 2, 1.0, -1.0)
    other = limits_of({"wear": lambda values: signs * loss(4.0)(values)}, nuisance=SCATTER)
    expected = LOOK.signal * np.sqrt(2) / 4 / np.sqrt(40)
    assert other.limits["wear", "loss", 1].share == pytest.approx(expected, rel=0.15)


def test_each_side_has_a_limit_of_its_own() -> None:
    def gain(values):
        share = values[0] / 0.15
        return SCATTER * (25 * share if share > 0 else 5 * share)

    limits = limits_of({"table_gain": gain}).limits
    assert limits["table_gain", "gain", -1].share == pytest.approx(
        5 * limits["table_gain", "gain", 1].share, rel=0.1
    )


def test_effects_jump_or_are_never_seen() -> None:
    found = limits_of(
        {
            "wear": loss(0.01),
            "restitution": lambda values: 30 * SCATTER,
            "rolling_resistance": loss(0.0),
            "edge_rounding": lambda values: SCATTER * 0.3 * values[0] / 0.015,
        }
    )
    limits = found.limits
    for side in (-1, 1):
        assert limits["restitution", "energy_ratio", side] == Limit(LOOK.shares[-1], jumps=True)
    # A hundredth of a deviation at its end: 3 / (0.01 sqrt(40)) times as much is wanted.
    assert limits["wear", "loss", 1].share == pytest.approx(300 / np.sqrt(40), rel=0.1)
    assert limits["edge_rounding", "radius", 1].share == pytest.approx(10 / np.sqrt(40), rel=0.1)
    assert limits["rolling_resistance", "arm", 1].share > 1000
    library = {name: PLANAR_LIBRARY[name] for name in ("wear", "restitution", "edge_rounding",
                                                       "rolling_resistance")}  # fmt: skip
    # An effect of which the end of its range has 0.4 limits or more is simulated.
    assert insensitive(library, limits) == ("wear", "rolling_resistance")


def test_overturning_counts_as_a_tilt_of_one_radian() -> None:
    """Rocks at -1, which all fall beside the null: as a change by 1, clipped at three scatters."""
    found = limits_of({"wear": lambda values: 5.0 if values[0] > 0.01 else 0.0}, base=(-1.0, -1.0))
    # It sets in between a sixteenth of the range, 0.0094, and a quarter of it.
    assert 1 / 16 < found.limits["wear", "loss", 1].share < 1 / 4
    higher = limits_of({"wear": lambda values: 40.0 * (values[0] > 0.01)}, base=(-1.0, -1.0))
    assert higher.limits == found.limits


def test_trials_that_never_lift_off_do_not_respond() -> None:
    found = limits_of({"wear": loss(4.0)}, base=(-8.0, -2.0))
    # ln 0.01 = -4.6, of forty from -8 to -2, and some scatter.
    edge = np.ceil((np.log(LOOK.moved) + 8) / 6 * 39)
    assert abs(found.responding[0] - edge) <= 1
    np.testing.assert_array_equal(np.diff(found.responding), 1)
    assert found.responding[-1] == 39


def test_fewer_trials_look_for_all_of_them() -> None:
    few = LinearSimulator({"wear": loss(4.0)}, trials=40)
    with SimulationCache(few) as cache:
        found = look(cache, 40, most=12)
    assert found.limits["wear", "loss", 1].share == pytest.approx(3 / 4 / np.sqrt(40), rel=0.15)
    # Two draws of twelve trials at six sizes, and those without effect.
    assert few.runs == 2 * 12 * len(LOOK.shares) + 40 * LOOK.plain


def test_trials_that_are_not_run_are_as_if_there_were_none() -> None:
    few = LinearSimulator({"wear": loss(4.0)}, trials=40)
    with SimulationCache(few) as cache:
        found = look(cache, 40, among=20)
    # The signal is of twenty trials in place of forty.
    assert found.limits["wear", "loss", 1].share == pytest.approx(3 / 4 / np.sqrt(20), rel=0.15)
    # A first draw of all, and the rest of the look of twenty.
    assert few.runs == 20 + (2 * len(LOOK.shares) + LOOK.plain) * 20
    np.testing.assert_array_equal(found.spread(500), found.responding)


def test_a_part_of_the_trials_is_of_those_that_lift_off() -> None:
    few = LinearSimulator({"wear": loss(4.0)}, trials=40, base=(-8.0, -2.0))
    with SimulationCache(few) as cache:
        every, part = look(cache, 40), look(cache, 40, among=10)
    assert part.responding.size == 10
    assert set(part.responding) <= set(every.responding)


@pytest.mark.parametrize("period", [2, 3, 5, 8, 10, 20])
def test_a_part_keeps_no_step_with_a_schedule_that_repeats_itself(period: int) -> None:
    trials = np.arange(200)
    counts = np.bincount(spread(trials, 40) % period, minlength=period)
    assert counts.min() >= 0.5 * 40 / period
    for count in (1, 7, 40, 199, 200, 500):
        found = spread(trials, count)
        assert found.size == min(count, 200)
        assert (np.diff(found) > 0).all()
        assert set(found) <= set(spread(trials, count + 1))
        # No part of the schedule is left out.
        if count > 6:
            assert np.diff([0, *found, 199]).max() <= 3 * 200 / count


def test_a_trial_that_flips_by_chance_moves_a_limit_by_one_step_at_most() -> None:
    """Of 240 trials 60 are tried, and one of these moves at one small share, under both draws."""
    first = np.arange(240) == 0

    def lossy(values):
        share = values[0] / 0.15
        return loss(4.0)(values) + 20 * SCATTER * first * (0.01 < share < 0.02)

    steady, flipped = (
        limits_of({"wear": act}, trials=240).limits["wear", "loss", 1] for act in (loss(4.0), lossy)
    )
    assert steady.share == pytest.approx(LOOK.signal / 4 / np.sqrt(240), rel=0.15)
    # Shares are four apart. A largest signal so far would put it at 0.005.
    assert 0.25 * steady.share < flipped.share < 1.2 * steady.share
    assert not flipped.jumps


def test_a_quarter_of_many_trials_is_tried() -> None:
    assert [most_tried(n) for n in (12, 150, 160, 161, 585)] == [40, 40, 40, 41, 147]
    many = LinearSimulator({"wear": loss(4.0)}, trials=240)
    with SimulationCache(many) as cache:
        look(cache, 240)
    assert many.runs == 2 * 60 * len(LOOK.shares) + 240 * LOOK.plain


def test_the_look_tries_each_parameter_alone() -> None:
    """One with one side alone has one limit, which both sides of the effect take."""
    effect = full_library()["registration"]

    def turned(values):
        yaw, lean, _ = values
        return SCATTER * (20 * max(yaw, 0.0) / 180 + 5 * max(-yaw, 0.0) / 180 + 40 * lean / 3)

    simulator = LinearSimulator({"registration": turned}, library=full_library())
    with SimulationCache(simulator) as cache:
        found = look(cache, 40).limits
    assert list(found) == list(tried_parameters(simulator.library))
    one, other = (limits_at(found, effect, side) for side in (-1, 1))
    assert one[0].share == pytest.approx(4 * other[0].share, rel=0.1)
    assert one[1] is other[1]
    assert one[1].share == pytest.approx(0.5 * other[0].share, rel=0.1)
    assert simulator.runs == tries(simulator.library) * 40 + 40 * LOOK.plain


@pytest.mark.parametrize("fold", [1, 2, 4])
def test_a_turn_that_mirrors_the_rock_onto_itself_has_its_limit(fold: int) -> None:
    """A rock of this symmetry responds to a turn as the sine of `fold / 2` times it.

    Half of the trials respond, so that what a turn does is less certain than that half a turn does
    nothing.
    """
    respond = np.where(np.arange(40) % 2, 1.0, 0.0)

    def turned(values):
        return SCATTER * 20 * respond * np.sin(fold * np.radians(values[0]) / 2)

    simulator = LinearSimulator({"registration": turned}, library=full_library())
    with SimulationCache(simulator) as cache:
        found = look(cache, 40).limits
    # Three deviations of the twenty trials; small turns are linear.
    expected = LOOK.signal / np.sqrt(20) / 20 * (2 / fold) / np.pi
    for side in (-1, 1):
        assert found["registration", "yaw", side].share == pytest.approx(expected, rel=0.25)
