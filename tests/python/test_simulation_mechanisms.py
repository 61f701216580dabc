"""Mechanisms and side motions through Python: scenes, batches, logs, hashes, a scanned rock."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from vsr2.config.study import Outcome, Output, Study
from vsr2.errors import ResultError, SimulationError
from vsr2.motion import Motion, SideMotion
from vsr2.results import load_trial_log, save_trial_log
from vsr2.scene import Mechanisms, PedestalBody, RockBody, Scene, build_pedestal, build_rock
from vsr2.scene.rotation import rotate
from vsr2.simulation import Simulation, native_scene, plan_sha256, run_batch
from vsr2.simulation.bench import EffectBench
from vsr2.trial import Trial

ROOT = Path(__file__).resolve().parents[2]
SCAN = ROOT / "models" / "pbr_scan.obj"
BOX = {"shape": "box", "size": [0.3, 0.5, 1.0], "density": 2700.0}
EACH = {
    "impact_energy_ratio": Mechanisms(impact_energy_ratio=0.65),
    "rocking_damping": Mechanisms(rocking_damping=0.05),
    "rolling_resistance": Mechanisms(rolling_resistance=0.01),
    "friction_ratio": Mechanisms(friction_ratio=1.6),
    "adhesion": Mechanisms(adhesion=5e4),
    "catch_slack": Mechanisms(catch_slack=math.radians(5)),
}


def study(rock: dict[str, Any], mode: str = "exact", **sections: Any) -> Study:
    return Study.model_validate(
        {
            "rock": rock,
            "motion": {"mode": "single_cosine", "pga_g": 0.5, "pgv_pga_s": 0.1},
            "engine": {"mode": mode},
            **sections,
        }
    )


def bodies(of: Study) -> tuple[RockBody, PedestalBody]:
    pedestal = build_pedestal(of.pedestal)
    return build_rock(of.rock, pedestal, clearance=0.002), pedestal


def scene(of: Study, mechanisms: Mechanisms | None = None) -> Scene:
    return Scene(*bodies(of), of.engine, of.contact, mechanisms or Mechanisms())


def pulse(size: float = 0.12, frequency: float = 1.2, sides: tuple[str, ...] = ()) -> Motion:
    t = np.arange(0, 1 / frequency, 1e-3)
    phase = 2 * np.pi * frequency * t
    shape = np.array([1 - np.cos(phase), np.sin(phase), np.cos(phase)])
    rate = 2 * np.pi * frequency
    x, v, a = size * shape * np.array([[1], [rate], [rate**2]])
    scales = {"transverse": 0.5, "vertical": 0.2, "pitch": 0.1}
    return Motion(
        "pulse", 1e-3, x, v, a, "recording",
        **{name: SideMotion(scales[name] * x, scales[name] * v) for name in sides},
    )  # fmt: skip


def response(of: Scene, motion: Motion) -> NDArray[np.float64]:
    trial = Trial(scene=of, motion=motion, output=Output(log_every=5), outcome=Outcome(tail=2.0))
    return np.asarray(run_batch([trial], threads=1).log(0).state)


@pytest.mark.parametrize("rock", [BOX, {"shape": "mesh", "file": str(SCAN), "density": 2700.0}])
@pytest.mark.parametrize("mode", ["exact", "fast"])
def test_each_is_alive(rock: dict[str, Any], mode: str) -> None:
    given = study(rock, mode)
    # Wide enough to overturn or nearly so, so that the tether comes taut.
    motion = pulse(0.25, 1.3)
    plain = response(scene(given), motion)
    np.testing.assert_array_equal(plain, response(scene(given, Mechanisms()), motion))
    for name, mechanisms in EACH.items():
        changed = response(scene(given, mechanisms), motion)
        rows = min(len(plain), len(changed))
        assert np.abs(plain[:rows, 5:8] - changed[:rows, 5:8]).max() > 2e-3, name


def test_values_without_meaning_are_refused() -> None:
    with pytest.raises(SimulationError, match="friction_ratio must be finite and at least 1"):
        native_scene(scene(study(BOX), Mechanisms(friction_ratio=0.9)))


def test_hashes_know_what_acts_and_only_that() -> None:
    given = study(BOX)
    rock, pedestal = bodies(given)
    plain = scene(given).sha256
    assert scene(given, Mechanisms(friction_speed=0.5)).sha256 == plain
    hashes = {scene(given, mechanisms).sha256 for mechanisms in EACH.values()}
    assert len(hashes | {plain}) == len(EACH) + 1
    pivoted = Scene(rock, replace(pedestal, pitch_pivot=0.0), given.engine, given.contact)
    assert pivoted.sha256 != plain
    plans = {
        plan_sha256([Trial(scene(given, m), pulse(sides=sides))])
        for m in (None, EACH["adhesion"])
        for sides in ((), ("pitch",), ("vertical",))
    }
    assert len(plans) == 6


def test_side_motions_need_the_prescribed_drive() -> None:
    trial = Trial(scene(study(BOX)), pulse(sides=("vertical",)), drive="motor")
    with pytest.raises(SimulationError, match="only drive: prescribed"):
        run_batch([trial], threads=1)


@pytest.mark.parametrize("mode", ["exact", "fast"])
def test_threads_and_order_change_no_bit(mode: str) -> None:
    given = study(BOX, mode)
    scenes = [scene(given, m) for m in (EACH["impact_energy_ratio"], EACH["rolling_resistance"])]
    motions = [pulse(0.25, 1.3, sides) for sides in ((), ("transverse", "vertical", "pitch"))]
    trials = [
        Trial(s, m, output=Output(log_every=20), outcome=Outcome(tail=1.0))
        for s in scenes
        for m in motions
    ]
    one = run_batch(trials, threads=1)
    two = run_batch(trials[::-1], threads=2)
    for i in range(len(trials)):
        np.testing.assert_array_equal(one.log(i).state, two.log(len(trials) - 1 - i).state)
        np.testing.assert_array_equal(
            one.log(i).excursions, two.log(len(trials) - 1 - i).excursions
        )


def test_logs_are_relative_to_the_pedestal(tmp_path: Path) -> None:
    """A wide block goes along with a pedestal that pitches about an axis far below it."""
    given = study({"shape": "box", "size": [0.8, 0.8, 0.3], "density": 2700.0})
    rock, pedestal = bodies(given)
    of = Scene(rock, replace(pedestal, pitch_pivot=0.5), given.engine, given.contact)
    motion = pulse(0.1, 0.5, ("transverse", "vertical", "pitch"))
    half = motion.displacement.size // 2  # ends away from its start
    motion = replace(
        motion,
        displacement=motion.displacement[:half],
        velocity=motion.velocity[:half],
        acceleration=motion.acceleration[:half],
        **{
            name: SideMotion(side.displacement[:half], side.velocity[:half])
            for name, side in motion.sides.items()
            if side is not None
        },
    )
    result = run_batch([Trial(of, motion, output=Output(log_every=10))], threads=1)
    log = result.log(0)
    assert result["outcome"][0] == "stable"
    assert log.excursions[-1] == pytest.approx([0.1, 0.04, 0.02], rel=1e-3)
    assert log.tilt.max() < 2e-3
    assert np.abs(log.slip).max() < 2e-3
    assert result["final_slip"][0] == pytest.approx(np.hypot(*log.slip[-1]), abs=1e-9)
    assert result["final_tilt"][0] == pytest.approx(log.tilt[-1], abs=1e-9)
    save_trial_log(tmp_path, 0, log)
    back = load_trial_log(tmp_path, 0)
    np.testing.assert_array_equal(back.excursions, log.excursions)
    np.testing.assert_array_equal(back.slip, log.slip)
    with pytest.raises(ResultError, match="rows of excursions"):
        replace(log, excursions=log.excursions[:-1])


def test_world_steps_in_space() -> None:
    simulation = Simulation(scene(study(BOX)), drive="prescribed_spatial")
    simulation.settle()
    state = simulation.step(0.0, vertical=1e-4, pitch=1e-4)
    assert state is not None
    with pytest.raises(SimulationError, match="prescribed_spatial"):
        Simulation(study(BOX)).step(0.0, pitch=1e-3)
    with pytest.raises(SimulationError, match="not of finite numbers"):
        simulation.step(0.0, vertical=math.nan)


def energies(ratio: float, azimuth: float) -> NDArray[np.float64]:
    """Energy of the scanned rock over rest, by weight [m], after a push about its support."""
    given = study(
        {"shape": "mesh", "file": str(SCAN), "density": 2700.0},
        engine={"mode": "exact", "linear_damping": 0.0, "angular_damping": 0.0},
        contact={
            body: {"restitution": 0.0, "lateral_friction": 1.2, "spinning_friction": 0.5}
            for body in ("rock", "pedestal")
        },
    )
    of = scene(given, Mechanisms(impact_energy_ratio=ratio))
    simulation = Simulation(of)
    simulation.settle()
    rest = simulation.state.position[2]
    spin = 0.9 * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    arm = np.array([0.0, 0.0, rest - of.pedestal.top])
    simulation.set_rock_velocity(np.cross(spin, arm), spin)
    out = []
    for _ in range(1300):
        state = simulation.step(0.0)
        assert state is not None
        conjugate = state.body_orientation * np.array([-1.0, -1.0, -1.0, 1.0])
        w = rotate(conjugate, state.angular_velocity)
        kinetic = 0.5 * state.velocity @ state.velocity
        kinetic += 0.5 * w @ (native_scene(of).rock_inertia * w) / of.rock.mass.mass
        out.append(kinetic / 9.81 + state.position[2] - rest)
    return np.array(out)


@pytest.mark.parametrize("azimuth", [0.0, 1.0])
def test_impacts_of_a_scanned_rock(azimuth: float) -> None:
    """Between two of its points of support: the first impact leaves `ratio` times what 1 leaves."""
    plain = energies(1.0, azimuth)
    # The pushed rock rises, falls back, and lands on another point after more than 0.3 s.
    after = 300 + int(np.argmax(plain[300:] < 0.95 * plain[300])) + 40
    for ratio in (0.7, 1.1):
        assert energies(ratio, azimuth)[after] / plain[after] == pytest.approx(ratio, rel=0.02)


def peaks(tilt: NDArray[np.float64], least: float) -> NDArray[np.float64]:
    """Largest tilts of free rocking between its impacts, down to `least` [rad]."""
    inner = tilt[1:-1]
    found = inner[(inner >= tilt[:-2]) & (inner > tilt[2:]) & (inner > least)]
    return np.concatenate([tilt[:1], found])


@pytest.mark.parametrize("mode", ["exact", "fast"])
@pytest.mark.parametrize("ratio", [0.65, 1.0, 1.1])
def test_low_swings_keep_their_energy_too(ratio: float, mode: Literal["exact", "fast"]) -> None:
    bench = EffectBench(mode)
    trial = bench.block().with_scene(mechanisms=Mechanisms(impact_energy_ratio=ratio))
    alpha = math.atan2(0.2, 0.6)
    share = ratio * (1 - 1.5 * math.sin(alpha) ** 2) ** 2
    tilts = peaks(bench.release(trial, 0.7 * alpha, 3.0).tilt, 0.01)
    energy = np.cos(alpha - tilts) - math.cos(alpha)
    assert len(energy) >= 4
    # A step of 1 ms leaves open when an impact is, by up to 1 % of the speed at 0.01 rad.
    np.testing.assert_allclose(energy[1:] / energy[:-1], share, rtol=0.02)


def test_each_contact_has_the_friction_of_its_own_slip() -> None:
    # Turning about one corner's neighbourhood, its contacts slip at 0 to 0.35 m/s.
    states = []
    for mode in ("exact", "fast"):
        given = study(BOX, engine={"mode": mode, "converged_contacts": False})
        simulation = Simulation(
            scene(given, Mechanisms(friction_ratio=1.6, friction_speed=0.05)), spawn=True
        )
        simulation.settle()
        simulation.set_rock_velocity((0.06, 0.1, 0.0), (0.0, 0.0, 0.5))
        for _ in range(60):
            state = simulation.step(0.0)
            assert state is not None
        states.append(np.concatenate([state.position, state.velocity, state.angular_velocity]))
    np.testing.assert_allclose(states[0], states[1], atol=1e-9)
