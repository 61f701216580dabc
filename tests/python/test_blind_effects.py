"""Every effect of the independent engine: neutral at its null, alive at its end, right."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the blind extra installs mujoco")

from test_blind_mujoco import (
    BLOCK,
    INTERVAL,
    G,
    burst,
    energy,
    free_rocking,
    peaks,
    situation,
)
from threshold_samples import assert_threshold, middle, strongest, under
from vsr2.blind.mujoco import (
    EFFECTS,
    TableMotion,
    TrialContext,
    block,
    drive,
    observe,
    run_trial,
    with_effects,
)
from vsr2.blind.mujoco.ground import acceleration_of
from vsr2.blind.mujoco.model import build_model
from vsr2.blind.mujoco.step_actions import (
    MECHANISMS,
    RelativeMotion,
    catch,
    friction,
    step_actions,
)
from vsr2.effects import Circumstances
from vsr2.effects.order import ChangePoint


def test_there_are_the_canonical_names_but_friction() -> None:
    canonical = {
        "table_gain", "edge_rounding", "table_pitch", "table_bandwidth", "table_resonance",
        "table_saturation", "base_slope", "com_offset", "slenderness", "inertia", "restitution",
        "rocking_damping", "base_asperity", "contact_stiffness", "rolling_resistance",
        "friction_rate", "spin_friction", "off_axis_motion", "vertical_motion", "time_scale",
        "placement", "registration", "wear", "change_point", "catch", "outcome_rule", "adhesion",
        "support", "input_channel",
    }  # fmt: skip
    assert set(EFFECTS) == canonical


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_at_its_null_changes_nothing(name: str) -> None:
    base = situation(6.0)
    null = EFFECTS[name].strength.null
    assert with_effects(base, {name: middle(name, null)}, TrialContext(0.7, 2, 3, 3, 4)) is base


@pytest.mark.parametrize("name", sorted(set(EFFECTS) - {"spin_friction", "outcome_rule"}))
def test_an_effect_at_its_end_changes_the_response(name: str) -> None:
    # A motion that slides and rocks about a corner, so that each mechanism has its part. Its start
    # moved by a micrometre changes the largest tilt by less than 1e-3 of itself.
    table = TableMotion(INTERVAL, burst(0.8) * 6.0)
    base = situation(yaw=0.2, friction=0.4, table=table)
    context = TrialContext(order=1.0, campaign_seed=1, trial_seed=2)
    plain = run_trial(base)
    moved = run_trial(replace(base, offset=(1e-6, 0.0)))
    scatter = abs(moved.peak_tilt - plain.peak_tilt)
    values = {name: middle(name, strongest(name))}
    changed = observe(run_trial(with_effects(base, values, context)), values, context)
    assert scatter < 1e-3 * plain.peak_tilt
    assert abs(changed.peak_tilt - plain.peak_tilt) > 5 * scatter + 1e-3 * plain.peak_tilt


def test_effects_have_one_order() -> None:
    base = situation(6.0)
    both = {"table_gain": {"change": 0.1}, "slenderness": {"change": 0.05}}
    one, two = (with_effects(base, dict(order)) for order in (both.items(), [*both.items()][::-1]))
    np.testing.assert_array_equal(one.table.x, two.table.x)
    np.testing.assert_array_equal(one.body.center, two.body.center)


def test_an_unknown_effect_is_refused() -> None:
    with pytest.raises(KeyError, match="gravity"):
        with_effects(situation(), {"gravity": {"change": 1.0}})


# --- body ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("change", [-0.06, 0.06])
def test_slenderness_scales_the_threshold(change: float) -> None:
    assert_threshold(1 + change, "slenderness", change=change)


@pytest.mark.parametrize("order", [0.0, 0.5, 1.0])
def test_wear_takes_slenderness_in_proportion_to_the_order(order: float) -> None:
    assert_threshold(1 - 0.15 * order, "wear", TrialContext(order=order), loss=0.15)


@pytest.mark.parametrize(("session", "expected"), [(3, 1.0), (4, 0.9)])
def test_a_change_point_is_a_step(session: int, expected: float) -> None:
    context = TrialContext(session=session, sessions=8)
    assert_threshold(expected, "change_point", context, slenderness_change=-0.1, at=0.5)


@pytest.mark.parametrize("sessions", [1, 2, 3, 4, 8])
def test_a_change_point_acts_from_the_nearest_bound_of_sessions_on(sessions: int) -> None:
    base = situation()
    for at in np.linspace(0.1, 0.9, 33):
        values = {"change_point": {"slenderness_change": -0.1, "at": float(at)}}
        contexts = [TrialContext(i / 15, i * sessions // 16, sessions) for i in range(16)]
        acts = [with_effects(base, values, context) is not base for context in contexts]
        # As the library has it; before and after there is a trial at least.
        names = tuple(f"S{i}" for i in range(sessions))
        expected = [
            ChangePoint().at(
                values["change_point"],
                Circumstances(p.order, names[p.session], names, np.random.default_rng(0)),
            )["slenderness_change"]
            != 0
            for p in contexts
        ]
        assert acts == expected, at
        assert acts == sorted(acts)
        assert any(acts)
        assert not all(acts)


@pytest.mark.parametrize("azimuth", [0.0, 60.0])
def test_an_offset_of_the_mass_centre_lowers_the_threshold(azimuth: float) -> None:
    along = 0.015 * math.cos(math.radians(azimuth))
    assert_threshold(1 - along / 0.2, "com_offset", distance=0.015, azimuth=azimuth)


def test_azimuths_turn_from_x_to_y() -> None:
    moved = under("com_offset", situation(), distance=0.01, azimuth=90.0).body.center
    np.testing.assert_allclose(moved[:2] - BLOCK.center[:2], [0, 0.01], atol=1e-12)
    sloping = under("base_slope", situation(), angle=1.0, azimuth=90.0).slope
    np.testing.assert_allclose(sloping, [0, math.radians(1.0)], atol=1e-12)


def test_a_slope_lowers_the_threshold() -> None:
    alpha, slope = BLOCK.slenderness_angle, math.radians(1.5)
    # Moments about the lower edge: a h = g (b cos s - h sin s).
    expected = math.cos(slope) * math.tan(alpha) - math.sin(slope)
    assert_threshold(expected / math.tan(alpha), "base_slope", angle=1.5, azimuth=0.0)


def test_a_rounded_edge_lowers_the_threshold() -> None:
    assert_threshold((0.2 - 0.015) / 0.2, "edge_rounding", radius=0.015)


@pytest.mark.parametrize(
    ("shrink", "rim"), [(0.01, 0.0), (-0.01, 0.0), (0.01, 0.01), (-0.005, 0.01)]
)
def test_another_support_moves_the_threshold(shrink: float, rim: float) -> None:
    assert_threshold((0.2 - shrink - rim) / 0.2, "support", shrink=shrink, rim=rim)


def test_inertia_changes_the_energy_of_an_impact() -> None:
    base = situation()
    changed = under("inertia", base, change=0.15)
    expected = changed.body.housner_ratio
    assert expected > BLOCK.housner_ratio
    response = free_rocking(body=changed.body)
    kept = energy(response.tilt[peaks(response)][:3])
    np.testing.assert_allclose(kept[1:] / kept[:-1], expected, rtol=0.04)


def test_asperities_lift_the_block_and_stand_under_it() -> None:
    base = under("base_asperity", situation(), TrialContext(campaign_seed=5), height=0.002)
    contexts = np.array(base.bumps)
    assert np.all(np.abs(contexts[:, :2]) <= [0.2, 0.275])
    assert np.all((contexts[:, 2] >= 0.0006) & (contexts[:, 2] <= 0.002))
    again = under(
        "base_asperity", situation(), TrialContext(campaign_seed=5, trial_seed=9), height=0.002
    )
    assert again.bumps == base.bumps
    other = under("base_asperity", situation(), TrialContext(campaign_seed=6), height=0.002)
    assert other.bumps != base.bumps


# --- contact ------------------------------------------------------------------------------------


STOUT = block(1.0, 1.0, 0.4, 2700.0)


def slid(pga, name, **values):
    base = under(name, situation(pga, body=STOUT, friction=0.3), **values)
    return abs(run_trial(base).position[-1, 0] - base.table.x[-1]) > 1e-3


def test_static_friction_moves_the_onset_of_sliding() -> None:
    assert not slid(0.95 * 0.45 * G, "friction_rate", ratio=1.5, speed=0.02)
    assert slid(1.4 * 0.45 * G, "friction_rate", ratio=1.5, speed=0.02)


def test_friction_falls_to_a_part_in_e_at_its_speed() -> None:
    base = under("friction_rate", situation(1.0), ratio=1.5, speed=0.02)
    model = SimpleNamespace(geom_friction=np.zeros((2, 3)))
    for slip in (0.0, 0.02, 0.04):
        moving = SimpleNamespace(
            speed=np.array([slip + 0.7, 0, 0, 0, 0, 0]),
            table=lambda: np.array([0.7, 0, 0, 0, 0, 0]),
            pose=np.array([0, 0, 1, 1.0, 0, 0, 0]),
        )
        friction(base, model, moving)(0)
        expected = base.friction * (1 + 0.5 * math.exp(-slip / 0.02))
        np.testing.assert_allclose(model.geom_friction[:, 0], expected)


def test_spin_friction_brakes_a_turning_block() -> None:
    import mujoco

    base = under("spin_friction", situation(friction=1e-4), coefficient=0.02)
    model = build_model(base)
    data = mujoco.MjData(model)
    data.qpos[3] = BLOCK.center[2]
    mujoco.mj_step(model, data, nstep=300)
    data.qvel[6] = 2.0
    mujoco.mj_step(model, data, nstep=100)
    # The moment c N over all contacts, N the weight.
    expected = 2.0 - 0.1 * 0.02 * BLOCK.mass * G / BLOCK.inertia[2, 2]
    assert data.qvel[6] == pytest.approx(expected, rel=0.02)


def planar_peak(start, damping=0.0, arm=0.0):
    """Next largest tilt of a block let go at `start`, by its own equation of motion."""
    from scipy.integrate import solve_ivp

    alpha = BLOCK.slenderness_angle
    p2 = BLOCK.mass * G * BLOCK.radius / BLOCK.pivot_inertia

    def rate(_, y):
        braked = 2 * damping * math.sqrt(p2) * y[1] + p2 * arm / BLOCK.radius * np.sign(y[1])
        return [y[1], -p2 * math.sin(alpha - y[0]) - braked]

    def down(_, y):
        return y[0]

    def turned(_, y):
        return y[1]

    down.terminal = turned.terminal = True
    turned.direction = -1
    fall = solve_ivp(rate, (0, 9), [start, -1e-9], events=down, rtol=1e-9, atol=1e-12)
    speed = -fall.y[1, -1] * math.sqrt(BLOCK.housner_ratio)
    rise = solve_ivp(rate, (0, 9), [0.0, speed], events=turned, rtol=1e-9, atol=1e-12)
    return rise.y[0, -1]


def next_peaks(strength=6.0, **changes):
    response = free_rocking(strength, **changes)
    return response.tilt[peaks(response)][:2]


def test_the_equation_of_motion_is_the_engines() -> None:
    first, second = next_peaks()
    assert planar_peak(first) == pytest.approx(second, rel=0.04)


def test_rocking_damping_is_that_of_the_equation_of_motion() -> None:
    first, second = next_peaks(rocking_damping=0.05)
    assert planar_peak(first, damping=0.05) == pytest.approx(second, rel=0.04)
    assert planar_peak(first) > 1.05 * second


def test_rocking_damping_takes_its_share_of_the_velocity() -> None:
    # A tilted block in the air, without a contact: v = v_0 exp(-2 zeta p t), p^2 = m g R / I_O.
    import mujoco

    base = under("rocking_damping", situation(), ratio=0.05)
    model = build_model(base)
    data = mujoco.MjData(model)
    data.qpos[3:8] = [10.0, math.cos(0.05), 0.0, math.sin(0.05), 0.0]
    data.qvel[1] = 2.0
    (damp,) = step_actions(base, model, data, RelativeMotion(data, ["x"], 0.5))
    for _ in range(300):
        mujoco.mj_step(model, data)
        damp(-1)
    p = math.sqrt(BLOCK.mass * G * BLOCK.radius / BLOCK.pivot_inertia)
    assert data.qvel[1] == pytest.approx(2.0 * math.exp(-2 * 0.05 * p * 0.3), rel=1e-6)


def test_rolling_resistance_is_that_of_the_equation_of_motion() -> None:
    first, second = next_peaks(rolling_resistance=0.005)
    assert planar_peak(first, arm=0.005) == pytest.approx(second, rel=0.06)
    assert planar_peak(first) > 1.05 * second


def test_rolling_resistance_is_that_of_the_equation_of_motion_on_average() -> None:
    model = build_model(under("rolling_resistance", situation(), arm=0.01))
    assert model.geom_friction[:, 2].max() == 0.01
    # Impacts scatter by some 3 % of the next peak, so over 13 of them: the logarithm of what
    # resistance takes, a tenth, within a fifth.
    taken, predicted = [], []
    for strength in np.linspace(5.8, 7.0, 13):
        first, second = next_peaks(strength, rolling_resistance=0.01)
        taken.append(math.log(second / planar_peak(first)))
        predicted.append(math.log(planar_peak(first, arm=0.01) / planar_peak(first)))
    assert np.mean(predicted) == pytest.approx(-0.1, abs=0.01)
    assert np.mean(taken) == pytest.approx(np.mean(predicted), rel=0.2)


def test_restitution_multiplies_the_ratio_that_is_there() -> None:
    base = situation(impact_energy_ratio=0.98)
    assert under("restitution", base, energy_ratio=0.8).impact_energy_ratio == pytest.approx(0.784)


def test_a_softer_contact_sinks_further() -> None:
    import mujoco

    depths = []
    for decades in (0.0, -1.0):
        model = build_model(under("contact_stiffness", situation(), decades=decades))
        data = mujoco.MjData(model)
        data.qpos[3] = BLOCK.center[2]
        mujoco.mj_step(model, data, nstep=500)
        depths.append(BLOCK.center[2] - data.qpos[3])
    assert depths[1] == pytest.approx(10 * depths[0], rel=0.15)


BONDED_G = G + 5000.0 * BLOCK.base_area / BLOCK.mass
"""Weight, and a bond of 5 kPa, over the mass."""


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        # (m g + strength A) b = m a h
        ("adhesion", {}, BONDED_G * 0.4 / 0.95),
        ("com_offset", {"distance": 0.015, "azimuth": 0.0}, BONDED_G * (0.2 - 0.015) / 0.475),
        ("edge_rounding", {"radius": 0.015}, BONDED_G * (0.2 - 0.015) / 0.475),
        # a h = (g + strength A / m - s a) b
        ("vertical_motion", {"share": 0.5}, BONDED_G * 0.4 / (0.95 + 0.5 * 0.4)),
        # a h = (g cos s + strength A / m) b - g sin s h, cos s = 0.9997
        ("base_slope", {"angle": 1.5, "azimuth": 0.0}, BONDED_G * 0.4 / 0.95 - G * 0.0262),
    ],
)
def test_a_bond_holds_until_its_strength(name, values, expected) -> None:
    bond = {"adhesion": {"strength": 5.0}}
    for factor, free in ((0.997, False), (1.003, True)):
        effects = bond | ({name: values} if values else {})
        response = run_trial(with_effects(situation(factor * expected), effects))
        assert (response.peak_tilt > 1e-3) == free
        assert free or response.peak_tilt < 1e-9


def test_a_bond_breaks_earlier_on_a_pitching_table() -> None:
    # As the threshold of test_pitch_joins_the_acceleration, with the weight that is held.
    base = under("table_pitch", situation(1.0), compliance=0.02, frequency=20.0)
    pitch = base.table.others["pitch"]
    arm = base.table.pivot + BLOCK.center[2] + BLOCK.inertia[1, 1] / (BLOCK.mass * BLOCK.center[2])
    felt = base.table.acceleration + arm * acceleration_of(pitch, INTERVAL) - G * pitch
    expected = BONDED_G * 0.4 / 0.95 / np.abs(felt).max()
    assert expected < 0.95 * BONDED_G * 0.4 / 0.95
    for factor, free in ((0.98, False), (1.02, True)):
        shaken = under("table_pitch", situation(factor * expected), compliance=0.02, frequency=20.0)
        response = run_trial(under("adhesion", shaken, strength=5.0), series_interval=0.001)
        lean = np.abs(drive(shaken.table.others["pitch"], INTERVAL, 0.001)[0])
        rows = min(len(lean), len(response.tilt))
        assert (np.abs(response.tilt[:rows] - lean[:rows]).max() > 1e-3) == free


BESIDE_A_BOND = {
    "table_pitch": {"compliance": 0.005, "frequency": 10.0},
    "vertical_motion": {"share": 0.3},
    "base_slope": {"angle": 1.0, "azimuth": 0.0},
    "com_offset": {"distance": 0.01, "azimuth": 180.0},
    "edge_rounding": {"radius": 0.01},
}


@pytest.mark.parametrize("name", BESIDE_A_BOND)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_bond_of_no_strength_leaves_the_response_as_it_is(name: str, sign: float) -> None:
    # Either way the body rests, and lifts at the same moment; contacts give a little before.
    table = TableMotion(INTERVAL, sign * burst(1.2, cycles=1) * 6.2)
    other = {name: BESIDE_A_BOND[name]}
    both = other | {"adhesion": {"strength": 1e-9}}
    plain, bonded = (
        run_trial(with_effects(situation(table=table), values)) for values in (other, both)
    )
    assert 0.01 < plain.peak_tilt < 0.3
    assert bonded.peak_tilt == pytest.approx(plain.peak_tilt, rel=0.035)


def test_a_bond_carries_the_body_with_a_pitching_table() -> None:
    shaken = situation(3.0)
    shaken = under("table_pitch", shaken, compliance=0.01, frequency=10.0)
    held = run_trial(under("adhesion", shaken, strength=50.0), series_interval=0.001)
    lean = drive(shaken.table.others["pitch"], INTERVAL, 0.001)[0]
    moved = drive(shaken.table.x, INTERVAL, 0.001)[0]
    rows = len(lean)
    np.testing.assert_allclose(held.tilt[:rows], np.abs(lean), atol=1e-7)
    arm = shaken.table.pivot + BLOCK.center[2]
    np.testing.assert_allclose(held.position[:rows, 0], moved + arm * np.sin(lean), atol=1e-5)
    np.testing.assert_allclose(held.orientation[:rows, 1], np.sin(lean / 2), atol=1e-7)


def test_a_tether_catches_the_block() -> None:
    base = situation(table=TableMotion(INTERVAL, burst(0.8) * 8.0))
    assert run_trial(base).overturned
    for slack in (10.0, 25.0):
        response = run_trial(under("catch", base, slack=slack))
        assert math.radians(slack) < response.peak_tilt < math.radians(slack) + 0.1
        # It brakes on the way out alone: what it took as a spring it gives back, faster than in a
        # quarter of its period, because weight helps.
        response = run_trial(under("catch", base, slack=slack), series_interval=0.001)
        out = int(np.argmax(response.tilt > math.radians(slack)))
        turned = out + int(np.argmax(np.diff(response.tilt[out:]) < 0))
        back = int(np.argmax(response.tilt[turned:] < math.radians(slack)))
        stiffness = MECHANISMS.catch_stiffness * BLOCK.mass * G * BLOCK.radius
        assert 0 < 0.001 * back < math.pi / 2 * math.sqrt(BLOCK.pivot_inertia / stiffness)
    # Critically damped: c = 2 (k I_O)^(1/2), on the way out alone.
    lean = math.radians(12.0)
    half = 0.5 * lean
    damping = 2 * math.sqrt(stiffness * BLOCK.pivot_inertia)
    for rate, resisted in ((0.0, 0.0), (0.3, 0.3), (-0.3, 0.0)):
        data = SimpleNamespace(xfrc_applied=np.zeros((3, 6)))
        moving = SimpleNamespace(
            tilt=lambda: lean,
            pose=np.array([0, 0, 1, math.cos(half), 0, math.sin(half), 0]),
            speed=np.array([0, 0, 0, 0, rate, 0]),
        )
        catch(base, data, moving, math.radians(10.0))(0)
        expected = stiffness * math.radians(2.0) + damping * resisted
        np.testing.assert_allclose(data.xfrc_applied[2, 3:], [0, -expected, 0], rtol=1e-9)
    # Tilts within the slack are free.
    small = situation(5.0)
    plain = run_trial(small)
    held = run_trial(under("catch", small, slack=25.0))
    np.testing.assert_array_equal(plain.tilt, held.tilt)
