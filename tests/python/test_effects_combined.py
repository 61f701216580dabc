"""Effects together: every pair, slopes beneath others, and the order of those on the motion."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from effect_closed_forms import half_widths
from vsr2 import apply_effects, run_batch
from vsr2.effects import Effect, effect, in_order, library, with_effects
from vsr2.effects.standing import mass_height
from vsr2.errors import GeometryError, MotionError
from vsr2.motion import Motion, Record, build_recorded_motion
from vsr2.scene.rotation import matrix_from_quaternion
from vsr2.simulation.bench import EffectBench, with_tail
from vsr2.trial import Trial

EFFECTS = in_order(library())
SLOPE = {"angle": 1.0, "azimuth": 30.0}


def moderate(one: Effect) -> dict[str, float]:
    """Values in the middle of the prior, or a quarter from its end where the middle is null."""
    return one.null() | {
        parameter.name: parameter.ppf(
            0.75 if parameter.null == 0.5 * (parameter.lower + parameter.upper) else 0.5
        )
        for parameter in one.parameters
        if not parameter.secondary and parameter.prior != "fixed"
    }


def changed(trial: Trial, *given: tuple[str, dict[str, float]]) -> Trial:
    effects = [(effect(name), effect(name).complete(values)) for name, values in given]
    return with_effects([trial] * 2, effects, relative_order=[0.0, 1.0])[1]


def test_every_pair_builds_a_trial_on_the_block() -> None:
    trials = [EffectBench("auto").block()] * 2
    pairs = list(itertools.combinations(EFFECTS, 2))
    assert len(pairs) == math.comb(len(EFFECTS), 2) > 400
    for one, other in pairs:
        both = [(one, moderate(one)), (other, moderate(other))]
        made = with_effects(trials, both, relative_order=[0.0, 1.0], sessions=["a", "b"])[1]
        assert made is not trials[1], (one.name, other.name)


@pytest.mark.parametrize(
    "given",
    [
        ("table_pitch", {"compliance": 0.01}),
        ("wear", {"loss": 0.1}),
        ("change_point", {"slenderness_change": 0.1}),
    ],
)
def test_on_a_slope_trials_run(given: tuple[str, dict[str, float]]) -> None:
    block = replace(EffectBench("auto").block(), motion=EffectBench().pulse(3.6, 2.0))
    names = {"base_slope": SLOPE, given[0]: given[1]}
    result = run_batch(apply_effects([with_tail(block, 0.5)] * 2, names), threads=1)
    assert set(result["status"]) <= {"ok", "tail_timeout"}


def test_a_slope_leaves_the_frame_of_the_top_as_it_was() -> None:
    block = EffectBench().block()
    tilted = changed(block, ("base_slope", SLOPE))
    assert mass_height(tilted) == pytest.approx(mass_height(block), abs=1e-12)
    assert half_widths(tilted) == pytest.approx(half_widths(block), abs=1e-12)
    # Slenderness is given in that frame too: before and after the slope is the same.
    lean = ("slenderness", {"change": 0.05})
    first = changed(changed(block, lean), ("base_slope", SLOPE))
    last = changed(tilted, lean)
    centres = [
        matrix_from_quaternion(s.start_pose.orientation) @ s.scene.rock.mass.mass_center
        + np.asarray(s.start_pose.position)
        for s in (first, last)
    ]
    np.testing.assert_allclose(centres[0], centres[1], atol=1e-12)


def test_slopes_add_up_to_what_a_rock_cannot_stand_on() -> None:
    # tan(alpha) = 1/3, 18.4 degrees: 10 and 10 is too much, 10 uphill after 10 downhill is level.
    block = EffectBench().block()
    ten = {"angle": 10.0, "azimuth": 180.0}
    tilted = changed(block, ("base_slope", ten))
    with pytest.raises(GeometryError, match=r"effects\.base_slope\.angle"):
        changed(tilted, ("base_slope", ten))
    level = changed(tilted, ("base_slope", ten | {"azimuth": 0.0}))
    np.testing.assert_allclose(
        level.start_pose.orientation, block.start_pose.orientation, atol=1e-12
    )
    np.testing.assert_allclose(level.start_pose.position, block.start_pose.position, atol=1e-12)


def test_the_joint_of_a_sloping_pedestal_stays_below_the_rock() -> None:
    block = EffectBench().block()
    pitch = ("table_pitch", {"compliance": 0.005, "depth": 0.4})
    level = changed(block, pitch).scene.pedestal.pitch_pivot
    assert level == pytest.approx(block.scene.pedestal.top - 0.4)
    sloping = changed(block, ("base_slope", SLOPE), pitch).scene.pedestal
    assert sloping.top > block.scene.pedestal.top + 0.1
    assert sloping.pitch_pivot == level


def recorded() -> Motion:
    time = np.arange(800) * 0.005
    x = 0.03 * np.sin(np.pi * time / time[-1]) ** 4 * np.sin(4 * np.pi * time)
    a = 1.2 * np.gradient(np.gradient(x, 0.005), 0.005)
    return build_recorded_motion(Record("r", 0.005, displacement=x, acceleration=a), 0.001)


def shaken(motion: Motion) -> Trial:
    return replace(EffectBench().block(), motion=motion)


@pytest.mark.parametrize("channel", ["displacement", "acceleration"])
def test_time_is_scaled_after_the_channel_is_chosen(channel: str) -> None:
    trial = shaken(recorded())
    chosen = apply_effects([trial], {"input_channel": {"channel": channel}})[0].motion
    both = apply_effects(
        [trial], {"time_scale": {"change": 0.03}, "input_channel": {"channel": channel}}
    )[0].motion
    assert both.duration == pytest.approx(1.03 * chosen.duration, abs=3e-3)
    assert both.pgv_m_s == pytest.approx(chosen.pgv_m_s / 1.03, rel=1e-3)
    gained = apply_effects(
        [trial], {"table_gain": {"change": 0.1}, "input_channel": {"channel": channel}}
    )[0].motion
    assert gained.peak_acceleration == pytest.approx(1.1 * chosen.peak_acceleration)


def test_a_channel_is_refused_where_it_would_undo_an_effect() -> None:
    slow = apply_effects([shaken(recorded())], {"time_scale": {"change": 0.03}})
    with pytest.raises(MotionError, match=r"effects\.input_channel\.channel.* together with"):
        apply_effects(slow, {"input_channel": {"channel": "displacement"}})


def test_a_channel_that_the_record_lacks_is_refused_by_the_effects_key() -> None:
    x = recorded().displacement[::5]
    motion = build_recorded_motion(Record("r", 0.005, displacement=x), 0.001)
    with pytest.raises(MotionError, match=r"effects\.input_channel\.channel: acceleration cannot"):
        apply_effects([shaken(motion)], {"input_channel": {"channel": "acceleration"}})


def test_a_filter_rings_amid_the_record_s_own_time() -> None:
    # The corner is in the record's time: filtered first, then slowed.
    trial = shaken(recorded())
    low = apply_effects([trial], {"input_filter": {"corner": 5.0}})[0].motion
    both = apply_effects(
        [trial], {"time_scale": {"change": 0.03}, "input_filter": {"corner": 5.0}}
    )[0].motion
    assert both.pgv_m_s == pytest.approx(low.pgv_m_s / 1.03, rel=1e-3)
    assert math.isclose(both.duration, 1.03 * low.duration, abs_tol=3e-3)
