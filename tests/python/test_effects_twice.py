"""Effects on top of themselves: a scene that has one, and the same once more."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

from vsr2.effects import Effect, library, with_effects
from vsr2.effects.registry import BUILT_IN
from vsr2.errors import ConfigError, Fault, SimulationError
from vsr2.simulation.bench import EffectBench
from vsr2.trial import Trial

TWICE = [one for one in BUILT_IN if not one.once and one.stage != "outcome"]
ONCE = [one for one in BUILT_IN if one.once]


@pytest.fixture(scope="module")
def block() -> Trial:
    return EffectBench().block()


def by_name(one: Effect) -> str:
    return one.name


def acted(trial: Trial, one: Effect, *times: Mapping[str, float]) -> Trial:
    for values in times:
        given = [(one, one.complete(values))]
        (trial,) = with_effects([trial], given, relative_order=[1.0], sessions=["1"])
    return trial


def numbers(trial: Trial) -> np.ndarray:
    """What a trial is made of; of the motion the peaks that drive it, which a delay leaves."""
    scene, motion = trial.scene, trial.motion
    mass, mechanics, contact = scene.rock.mass, scene.mechanisms, scene.contact.pair
    values = [
        mass.mass, *mass.mass_center, *mass.principal_inertia,
        *trial.start_pose.position, *trial.start_pose.orientation, *scene.pedestal.slope,
        contact.lateral_friction, contact.spinning_friction, contact.stiffness, contact.damping,
        mechanics.impact_energy_ratio, mechanics.rocking_damping, mechanics.rolling_resistance,
        mechanics.friction_ratio, mechanics.friction_speed, mechanics.adhesion / 1e5,
        mechanics.catch_slack, trial.outcome.toppled_tilt,
        np.abs(motion.displacement).max(), motion.pgv_m_s,
        *(np.abs(s.displacement).max() for s in motion.sides.values() if s is not None),
    ]  # fmt: skip
    return np.array(values, dtype=np.float64)


def hardly(one: Effect, trial: Trial) -> dict[str, float]:
    """Values beside those that leave a trial as it is."""
    values = one.nominal(trial)
    for parameter in one.parameters:
        if parameter.secondary or parameter.prior == "fixed":
            continue
        null = values[parameter.name]
        low, high = parameter.limits or (parameter.lower, parameter.upper)
        end = parameter.extreme if not math.isclose(parameter.extreme, null) else parameter.lower
        values[parameter.name] = high if math.isinf(null) else null + 1e-6 * (end - null)
        assert low <= values[parameter.name] <= high
    return values


@pytest.mark.parametrize("one", TWICE, ids=by_name)
def test_on_top_of_itself_an_effect_begins_at_nothing(one: Effect, block: Trial) -> None:
    strong = acted(block, one, one.extreme())
    on_top = acted(strong, one, hardly(one, strong))
    assert len(on_top.effects) == 2
    found, expected = numbers(on_top), numbers(strong)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize(
    ("name", "one", "other", "both"),
    [
        ("friction", {"factor": 0.5}, {"factor": 0.6}, {"factor": 0.3}),
        ("slenderness", {"change": 0.1}, {"change": -0.2}, {"change": -0.12}),
        ("com_offset", {"distance": 0.02}, {"distance": 0.03}, {"distance": 0.05}),
        ("inertia", {"change": 0.1}, {"change": 0.2}, {"change": 0.32}),
        ("contact_stiffness", {"decades": 0.3}, {"decades": 0.2}, {"decades": 0.5}),
        ("spin_friction", {"coefficient": 0.1}, {"coefficient": 0.2}, {"coefficient": 0.3}),
        ("restitution", {"energy_ratio": 0.8}, {"energy_ratio": 0.9}, {"energy_ratio": 0.9}),
        ("rocking_damping", {"ratio": 0.02}, {"ratio": 0.03}, {"ratio": 0.05}),
        ("rolling_resistance", {"arm": 0.002}, {"arm": 0.003}, {"arm": 0.005}),
        ("friction_rate", {"ratio": 1.2}, {"ratio": 1.5}, {"ratio": 1.8}),
        ("adhesion", {"strength": 2.0}, {"strength": 3.0}, {"strength": 5.0}),
        ("catch", {"slack": 10.0}, {"slack": 20.0}, {"slack": 10.0}),
        ("catch", {"slack": 20.0}, {"slack": 10.0}, {"slack": 10.0}),
        ("base_slope", {"angle": 0.5}, {"angle": 0.4}, {"angle": 0.9}),
        ("table_gain", {"change": 0.1}, {"change": -0.2}, {"change": -0.12}),
        ("off_axis_motion", {"share": 0.1}, {"share": 0.05}, {"share": 0.15}),
        ("vertical_motion", {"share": 0.1}, {"share": 0.05}, {"share": 0.15}),
        ("wear", {"loss": 0.1}, {"loss": 0.2}, {"loss": 0.28}),
    ],
)
def test_two_make_one_of_the_same_name(
    name: str,
    one: dict[str, float],
    other: dict[str, float],
    both: dict[str, float],
    block: Trial,
) -> None:
    own = library()[name]
    found, expected = acted(block, own, one, other), acted(block, own, both)
    np.testing.assert_allclose(numbers(found), numbers(expected), rtol=1e-6, atol=1e-9)
    joined = own.twice(own.complete(one), own.complete(other))
    assert joined == pytest.approx(own.complete(both), nan_ok=True)


@pytest.mark.parametrize(
    ("name", "one", "other"),
    [
        ("com_offset", {"distance": 0.02, "azimuth": 30.0}, {"distance": 0.03, "azimuth": 250.0}),
        ("base_slope", {"angle": 0.5, "azimuth": 350.0}, {"angle": 0.4, "azimuth": 80.0}),
        ("time_scale", {"change": 0.1}, {"change": -0.2}),
        ("input_filter", {"corner": 2.0}, {"corner": 2.5}),
        ("table_bandwidth", {"corner": 8.0, "delay": 0.01}, {"corner": 6.0}),
        ("table_saturation", {"velocity": 0.2}, {"velocity": 0.15}),
        ("inertia", {"rule": 1.0, "change": 0.1}, {"change": 0.2}),
        ("inertia", {"change": 0.2}, {"rule": 1.0, "change": 0.1}),
    ],
)
def test_values_of_two_act_as_the_two(
    name: str, one: dict[str, float], other: dict[str, float], block: Trial
) -> None:
    """Filters and caps in a row only about; vectors and scales to rounding or second order."""
    own = library()[name]
    both = own.twice(own.complete(one), own.complete(other))
    found, expected = acted(block, own, both), acted(block, own, one, other)
    about = 0.02 if own.name in ("input_filter", "table_bandwidth", "table_saturation") else 1e-4
    np.testing.assert_allclose(numbers(found), numbers(expected), rtol=about, atol=1e-4)
    assert np.nanmax(np.abs(numbers(found) - numbers(acted(block, own, one)))) > 1e-4


@pytest.mark.parametrize(
    ("higher", "lower"),
    [({"acceleration": 1.5}, {"acceleration": 1.0}), ({"velocity": 0.4}, {"velocity": 0.15})],
)
def test_the_table_comes_back_as_the_one_with_the_lower_cap(
    higher: dict[str, float], lower: dict[str, float], block: Trial
) -> None:
    own = library()["table_saturation"]
    lower = lower | {"return_frequency": 0.3}
    first = own.complete(lower)
    assert own.twice(first, own.complete(higher | {"return_frequency": 4.5})) == first
    assert own.twice(own.complete(higher), first) == first
    # What keeps to a cap is left as it is by the same cap and by a higher one.
    once = acted(block, own, lower).motion
    assert once != block.motion
    assert acted(block, own, lower, lower).motion == once
    assert acted(block, own, lower, higher).motion == once


def test_two_tables_with_a_lower_cap_each_come_back_as_the_later() -> None:
    own = library()["table_saturation"]
    slow = own.complete({"velocity": 0.2, "return_frequency": 0.1})
    fast = own.complete({"acceleration": 3.0, "return_frequency": 4.5})
    assert own.twice(fast, slow) == own.twice(slow, fast)
    assert own.twice(slow, fast) == {
        "velocity": 0.2, "acceleration": 3.0, "return_frequency": 0.1
    }  # fmt: skip


def test_values_of_draws_add_by_their_squares() -> None:
    own = library()["placement"]
    found = own.twice({"yaw": 3.0, "offset": 0.0}, {"yaw": 4.0, "offset": 0.01})
    assert found == {"yaw": 5.0, "offset": 0.01}


def test_a_rule_of_the_outcome_takes_the_place_of_what_was_noted() -> None:
    own = library()["outcome_rule"]
    flips, rule = {"tilt": math.pi, "flips": 0.1}, {"tilt": 0.4, "flips": 0.0}
    assert own.twice(flips, {"tilt": math.pi, "flips": 0.2})["flips"] == pytest.approx(0.26)
    assert own.twice(flips, rule) == rule
    assert own.twice(rule, flips) == {"tilt": 0.4, "flips": 0.1}


def test_steps_at_one_place_make_one_and_others_are_refused() -> None:
    own = library()["change_point"]
    one = own.complete({"at": 0.4, "slenderness_change": 0.1, "com_offset_distance": 0.002})
    other = own.complete({"at": 0.4, "slenderness_change": -0.2, "com_offset_distance": 0.003})
    both = own.complete({"at": 0.4, "slenderness_change": -0.12, "com_offset_distance": 0.005})
    assert own.twice(one, other) == pytest.approx(both)
    # The place that is taken where none is given, 0.5, is a place as any other.
    for first, at in ((0.4, 0.7), (0.5, 0.3), (0.3, 0.5)):
        with pytest.raises(ConfigError, match=rf"effects.change_point.at: no step .* {first} and"):
            own.twice(one | {"at": first}, other | {"at": at})


def test_steps_of_different_effects_at_one_place_make_one() -> None:
    own = library()["session"]
    soft, cleaned = {"rolling_resistance_arm": 0.002}, {"friction_factor": 0.7}
    steps = [own.complete({"at": 0.4} | step) for step in (soft, cleaned)]
    both = own.complete({"at": 0.4} | soft | cleaned)
    assert own.twice(*steps) == own.twice(*reversed(steps)) == both
    more = own.twice(own.twice(*steps), own.complete({"at": 0.4} | soft))
    assert more == both | {"rolling_resistance_arm": 0.004}


@pytest.mark.parametrize("one", BUILT_IN, ids=by_name)
def test_values_on_top_of_nothing_are_themselves(one: Effect) -> None:
    values = one.extreme()
    assert one.twice(one.null(), values) == one.twice(values, one.null()) == values


def test_resonances_in_a_row_are_no_one_resonance() -> None:
    own = library()["table_resonance"]
    one, other = ({"amplification": 1.5, "frequency": f} for f in (9.0, 12.0))
    with pytest.raises(ConfigError, match=r"effects.table_resonance.amplification: no value does"):
        own.twice(one, other)


def test_a_speed_of_slip_stays_where_the_ratio_alone_is_raised(block: Trial) -> None:
    own = library()["friction_rate"]
    first = acted(block, own, {"ratio": 1.2, "speed": 0.05})
    assert own.nominal(first) == {"ratio": 1.0, "speed": 0.05}


@pytest.mark.parametrize("one", ONCE, ids=by_name)
def test_what_cannot_act_twice_is_refused(one: Effect, block: Trial) -> None:
    first = acted(block, one, one.extreme())
    assert acted(first, one, one.null()) is first, "null is no second time"
    with pytest.raises(SimulationError, match=f"effects.{one.name}: .*{one.once}") as raised:
        acted(first, one, one.extreme())
    with pytest.raises(ConfigError, match=f"effects.{one.name}: .*{one.once}"):
        one.twice(one.extreme(), one.extreme())
    assert raised.value.fault is Fault.acts_already
    assert {one.name for one in ONCE} == {
        "base_asperity", "edge_rounding", "support", "table_pitch",
    }  # fmt: skip
