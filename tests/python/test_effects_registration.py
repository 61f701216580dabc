"""How the specimen stands (`registration`), and what steps between sessions (`session`)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vsr2 import apply_effects, run_batch
from vsr2.config.study import Output
from vsr2.effects import Effect, check_study_effects, effect, library, with_effects
from vsr2.effects.standing import mass_height, support_of
from vsr2.errors import ConfigError, GeometryError, SimulationError
from vsr2.motion import Record, build_recorded_motion
from vsr2.scene.rotation import matrix_from_quaternion
from vsr2.simulation.bench import EffectBench
from vsr2.trial import Trial

ROOT = Path(__file__).resolve().parents[2]
Array = np.ndarray
Values = Mapping[str, float]


@pytest.fixture(scope="module")
def bench() -> EffectBench:
    return EffectBench("auto", ROOT / "models" / "pbr_scan.obj")


def centre(trial: Trial) -> Array:
    """Of the mass, in the world at the start."""
    start = trial.start_pose
    turned = matrix_from_quaternion(start.orientation) @ trial.scene.rock.mass.mass_center
    return np.asarray(turned + np.asarray(start.position))


def changed(trial: Trial, **given: Values) -> Trial:
    return apply_effects([trial], given)[0]


def yaw_of(trial: Trial) -> float:
    x, y, z, w = trial.start_pose.orientation
    return math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


# --- registration --------------------------------------------------------------------------------


def test_a_specimen_stands_alike_in_every_trial(bench: EffectBench) -> None:
    trials = [replace(bench.scan(), motion=bench.pulse(a, 2.0), seed=i) for i, a in
              enumerate((2.0, 3.0, 4.0))]  # fmt: skip
    made = apply_effects(trials, {"registration": {"yaw": 70.0, "lean": 1.0}})
    assert len({id(trial.scene) for trial in made}) == 1
    assert len({trial.start_pose for trial in made}) == 1
    assert yaw_of(made[0]) == pytest.approx(yaw_of(trials[0]) + 70.0)


def test_half_a_turn_mirrors_the_motion(bench: EffectBench) -> None:
    pulse = bench.pulse(4.0, 2.0)
    scan = replace(bench.scan(), output=Output(log_every=1))
    turned = changed(replace(scan, motion=pulse), registration={"yaw": 180.0})
    logs = run_batch([turned, replace(scan, motion=pulse.scaled(-1.0))], threads=1).logs
    ways = []
    for log in logs:
        assert log is not None
        shaken = log.tilt[(log.time >= 0) & (log.time < 0.4)]
        ways.append(shaken)
    assert ways[0].max() > 1e-3
    np.testing.assert_allclose(ways[0], ways[1], atol=0.02 * ways[0].max())


@pytest.mark.parametrize("slope", [0.0, 1.0])
def test_the_rock_leans_about_its_foot(slope: float, bench: EffectBench) -> None:
    block = bench.block()
    if slope:
        block = changed(block, base_slope={"angle": slope, "azimuth": 200.0})
    made = changed(block, registration={"lean": 2.0, "lean_azimuth": 30.0})
    top = matrix_from_quaternion(block.scene.pedestal.slope)
    h, lean, azimuth = mass_height(block), math.radians(2.0), math.radians(30.0)
    along = h * math.sin(lean)
    expected = [along * math.cos(azimuth), along * math.sin(azimuth), h * math.cos(lean) - h]
    np.testing.assert_allclose(top.T @ (centre(made) - centre(block)), expected, atol=1e-12)
    # What bears stays: only where the mass lies over it changes.
    assert made.start_pose == block.start_pose
    assert made.scene.rock.parts == block.scene.rock.parts
    before, after = (support_of(one).polygon for one in (block, made))
    np.testing.assert_allclose(before - after, [expected[:2]] * len(before), atol=1e-12)


def test_a_box_inertia_keeps_its_axes(bench: EffectBench) -> None:
    block = bench.block()
    aabb = block.with_scene(rock=replace(block.scene.rock, inertia_from_aabb=True))
    made = changed(aabb, registration={"lean": 2.0})
    assert np.array_equal(made.scene.rock.mass.principal_axes, aabb.scene.rock.mass.principal_axes)
    np.testing.assert_allclose(
        centre(made), centre(changed(block, registration={"lean": 2.0})), atol=1e-12
    )


def test_an_offset_is_given_in_the_world_in_which_the_specimen_stands(bench: EffectBench) -> None:
    turn, offset = {"yaw": 90.0}, {"distance": 0.01, "azimuth": 0.0}
    both = changed(bench.scan(), com_offset=offset, registration=turn)
    moved = centre(both) - centre(changed(bench.scan(), registration=turn))
    np.testing.assert_allclose(moved, [0.01, 0.0, 0.0], atol=1e-12)


@pytest.mark.filterwarnings("ignore::vsr2.effects.EffectRangeWarning")
@pytest.mark.parametrize(
    ("given", "key"),
    [
        ({"registration": {"lean": 20.0}}, r"effects\.registration\.lean: 20 degree"),
        (
            {"session": {"registration_lean": 20.0}},
            r"effects\.session\.registration_lean: 20 degree",
        ),
    ],
)
def test_a_rock_that_leans_beyond_its_base_is_refused(
    given: dict[str, dict[str, float]], key: str, bench: EffectBench
) -> None:
    with pytest.raises(GeometryError, match=f"{key} takes the mass centre beyond"):
        apply_effects([bench.block()] * 2, given)


# --- session -------------------------------------------------------------------------------------


def test_a_step_is_its_parts_in_the_trials_after_it(bench: EffectBench) -> None:
    trials = [replace(bench.block(), motion=bench.pulse(3.0 + i, 2.0)) for i in range(6)]
    parts = {
        "registration": {"yaw": 20.0, "lean": 1.0, "lean_azimuth": 50.0},
        "com_offset": {"distance": 0.01, "azimuth": 80.0},
        "slenderness": {"change": -0.03},
        "friction": {"factor": 0.7},
        "table_gain": {"change": 0.05},
    }
    step = {f"{name}_{key}": value for name, own in parts.items() for key, value in own.items()}
    made = apply_effects(trials, {"session": step | {"at": 0.5}}, sessions="aabbcc")
    static = apply_effects(trials, parts)
    for before, after in zip(trials[:4], made[:4], strict=True):
        assert after is before
    for i in (4, 5):
        one, other = made[i], static[i]
        assert one.scene.sha256 == other.scene.sha256
        assert (one.start_pose, one.motion.sha256) == (other.start_pose, other.motion.sha256)
        assert [applied.effect.name for applied in one.effects] == ["session"]
    assert made[4].scene is made[5].scene, "what no motion touches is made once"


def test_what_adds_to_itself_can_step() -> None:
    """What acts over a campaign, differs by trial or changes what is noted is not static."""
    other = {name for name, one in library().items() if one.stage in ("start", "order", "outcome")}
    once = {name for name, one in library().items() if one.once}
    later = {"restitution", "friction_rate", "input_channel"}
    parts = {part.name for part in effect("session").parts}
    assert parts == set(library()) - other - once - later
    assert len(parts) == 20


@pytest.mark.parametrize("part", effect("session").parts, ids=lambda part: part.name)
def test_each_effect_steps_as_it_acts_throughout(part: Effect, bench: EffectBench) -> None:
    trials = [replace(bench.block(), motion=bench.pulse(3.0 + i, 2.0)) for i in range(2)]
    values = part.extreme()
    step = {f"{part.name}_{key}": value for key, value in values.items()}
    given = [(effect("session"), effect("session").complete(step))]
    before, after = with_effects(trials, given, sessions="ab")
    assert before is trials[0]
    (throughout,) = with_effects(trials[1:], [(part, values)])

    def made(trial: Trial) -> tuple[object, ...]:
        return trial.scene.sha256, trial.start_pose, trial.motion.sha256

    assert made(after) == made(throughout) != made(trials[1])


@pytest.mark.parametrize("part", effect("session").parts, ids=lambda part: part.name)
def test_a_step_acts_on_top_of_what_acts_in_all_trials(part: Effect, bench: EffectBench) -> None:
    """In one go, as `vsr2 run` has it, and after the scene's own, as a diagnosis has it."""
    trials = [replace(bench.block(), motion=bench.pulse(3.0 + i, 2.0)) for i in range(2)]
    values = part.extreme()
    own = effect("session")
    step = own.complete({f"{part.name}_{key}": value for key, value in values.items()})
    both = with_effects(trials, [(own, step), (part, values)], sessions="ab")
    scene = with_effects(trials, [(part, values)], sessions="ab")
    on_top = with_effects(scene, [(own, step)], sessions="ab")

    def made(trial: Trial) -> tuple[object, ...]:
        return trial.scene.sha256, trial.start_pose, trial.motion.sha256

    assert [made(one) for one in both] == [made(one) for one in on_top]
    assert made(both[0]) == made(scene[0])
    if part.name not in ("catch", "table_saturation"):  # Of two caps the least holds.
        assert made(both[1]) != made(scene[1])


def test_what_cannot_act_twice_is_refused_as_a_part_too(bench: EffectBench) -> None:
    trial = bench.block()
    rounded = {"radius": 0.004}
    step = {"edge_rounding_radius": 0.002, "at": 0.1}
    given = {"edge_rounding": rounded, "change_point": step}
    with pytest.raises(SimulationError, match="edge_rounding acts already"):
        apply_effects([trial, trial], given)
    (first,) = apply_effects([trial], {"edge_rounding": rounded})
    with pytest.raises(SimulationError, match=r"change_point.*edge_rounding acts already"):
        apply_effects([first, first], {"change_point": step})
    with pytest.raises(ConfigError, match=r"effects.change_point: edge_rounding acts already"):
        check_study_effects(given, "mine")
    # What is null does not act.
    check_study_effects({"edge_rounding": {"radius": 0.0}, "change_point": step}, "mine")
    narrower = {"edge_rounding_radius": 0.0, "slenderness_change": 0.05}
    check_study_effects({"edge_rounding": rounded, "change_point": narrower}, "mine")


@pytest.mark.parametrize("sessions", [2, 3, 5, 11])
def test_a_step_may_come_at_every_bound_of_sessions(sessions: int, bench: EffectBench) -> None:
    trials = [bench.block()] * sessions
    names = [f"202103{i + 1:02d}" for i in range(sessions)]
    found = set()
    for at in np.linspace(0.0, 1.0, 101):
        given = {"session": {"table_gain_change": 0.1, "at": float(at)}}
        made = apply_effects(trials, given, sessions=names)
        acts = [bool(trial.effects) for trial in made]
        assert acts == sorted(acts)
        found.add(acts.index(True))
    assert found == set(range(1, sessions))


def test_a_table_steps_after_the_channel_is_chosen(bench: EffectBench) -> None:
    time = np.arange(800) * 0.005
    x = 0.03 * np.sin(np.pi * time / time[-1]) ** 4 * np.sin(4 * np.pi * time)
    a = 1.2 * np.gradient(np.gradient(x, 0.005), 0.005)
    motion = build_recorded_motion(Record("r", 0.005, displacement=x, acceleration=a), 0.001)
    trials = [replace(bench.block(), motion=motion)] * 2
    given = {"input_channel": {"channel": "acceleration"}, "session": {"table_gain_change": 0.1}}
    first, last = apply_effects(trials, given, sessions="ab")
    assert first.motion.peak_acceleration == pytest.approx(1.2 * motion.peak_acceleration, rel=0.05)
    assert last.motion.peak_acceleration == pytest.approx(1.1 * first.motion.peak_acceleration)


def test_steps_of_two_effects_go_with_the_effects_of_the_same_stage(bench: EffectBench) -> None:
    # An offset after the step, of a rock that was turned before it.
    given = [
        (effect(name), effect(name).complete(values))
        for name, values in (
            ("registration", {"yaw": 90.0}),
            ("session", {"com_offset_distance": 0.01, "friction_factor": 0.5}),
        )
    ]
    before, after = with_effects([bench.block()] * 2, given, sessions="ab")
    np.testing.assert_allclose(centre(after) - centre(before), [0.01, 0.0, 0.0], atol=1e-12)
    rough = [one.scene.contact.pair.lateral_friction for one in (before, after)]
    assert rough[1] == pytest.approx(0.5 * rough[0])


def test_what_is_put_back_by_marks_has_a_narrower_prior() -> None:
    turned, put_back = library()["registration"], library()["session"]
    assert turned.parameter("yaw").full_range
    own = put_back.parameter("registration_yaw")
    assert (own.lower, own.upper, own.full_range) == (-30.0, 30.0, False)
    drawn = {p.name for p in put_back.parameters if p.prior != "fixed"}
    assert drawn == {
        "at", "registration_yaw", "registration_lean", "registration_lean_azimuth",
        "friction_factor", "table_gain_change",
    }  # fmt: skip


def test_a_fixed_parameter_that_gets_ends_is_drawn() -> None:
    own = effect("session").with_prior("rolling_resistance_arm", 0.0, 0.001)
    found = own.parameter("rolling_resistance_arm")
    assert (found.prior, found.ppf(0.5)) == ("uniform", 0.0005)
    assert (
        effect("friction").with_prior("factor", 0.5, 2.0).parameter("factor").prior == "loguniform"
    )
