"""The interactive world: lifecycle, contact model in use, engine settings alive."""

from __future__ import annotations

import copy
import math
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vsr2 import _native
from vsr2.config.study import ORIGINAL, Contact, Settling
from vsr2.errors import SimulationError
from vsr2.results import EngineKind, HandOver
from vsr2.scene import build_scene
from vsr2.simulation import Simulation, run_batch, study_trials
from vsr2.simulation.native_trials import _settled_start, _specification
from world_samples import study

RECORD = Path(__file__).resolve().parents[2] / "configs" / "motions" / "synthetic_07.csv"


def test_lifecycle_spawn_reset_delete() -> None:
    simulation = Simulation(study(), spawn=False)
    assert not simulation.has_rock
    assert simulation.step(0.01) is None
    with pytest.raises(SimulationError, match="no rock"):
        simulation.delete()
    simulation.spawn()
    with pytest.raises(SimulationError, match="already"):
        simulation.spawn()
    start = simulation.state.position
    simulation.step(0.0, steps=100)
    assert simulation.time == pytest.approx(0.101)
    simulation.reset()
    assert simulation.time == 0.0
    np.testing.assert_array_equal(simulation.state.position, start)
    np.testing.assert_array_equal(simulation.state.velocity, 0.0)
    simulation.delete()
    assert not simulation.has_rock
    with pytest.raises(SimulationError, match="no rock"):
        _ = simulation.state
    simulation.spawn()
    assert simulation.has_rock


def test_the_engine_in_use_is_reported() -> None:
    assert Simulation(study(engine={"mode": "exact"})).engine == "exact"
    simulation = Simulation(study())
    simulation.settle()
    assert (simulation.engine, simulation.hand_over) == ("fast", "none")
    simulation.set_rock_velocity((20.0, 0.0, 0.0))
    simulation.step(0.0, steps=600)
    assert (simulation.engine, simulation.hand_over) == ("fast", "off_the_top")
    assert simulation.engine is EngineKind.fast
    assert simulation.hand_over is HandOver.off_the_top


def test_a_simulation_settles_by_the_rule_of_its_study() -> None:
    strict = study(settling={"timeout": 0.26, "linear_speed": 1e-9})
    with pytest.raises(SimulationError, match=r"within 0\.26 s"):
        Simulation(strict).settle()
    assert Simulation(strict).settle(Settling()) > 0
    assert Simulation(study()).settle() > 0


@pytest.mark.parametrize("mode", ["parity", "exact", "fast"])
def test_a_restored_simulation_goes_on_with_the_same_bits(mode: str) -> None:
    def shake(simulation: Simulation, first: int, last: int) -> bytes:
        for k in range(first, last):
            simulation.step(0.05 * math.sin(0.02 * k))
        state = simulation.state
        return state.position.tobytes() + state.body_orientation.tobytes()

    with Simulation(study(engine={"mode": mode})) as simulation:
        simulation.settle()
        shake(simulation, 0, 150)
        saved = pickle.loads(pickle.dumps(simulation.save_state()))
        time, command = simulation.time, simulation.state.commanded_position
        end = shake(simulation, 150, 300)
        simulation.restore_state(copy.deepcopy(saved))
        assert (simulation.time, simulation.state.commanded_position) == (time, command)
        assert shake(simulation, 150, 300) == end
        other = Simulation(study(engine={"mode": mode}), spawn=False)
        other.restore_state(saved)
        assert shake(other, 150, 300) == end


@pytest.mark.parametrize(
    "use",
    [
        lambda s: s.step(0.0),
        lambda s: s.settle(),
        lambda s: s.state,
        lambda s: s.save_state(),
        lambda s: s.reset(),
        lambda s: s.spawn(),
        lambda s: s.contacts(),
        lambda s: s.has_rock,
        lambda s: s.restore_state(None),
    ],
)
def test_after_its_block_a_simulation_says_that_it_is_over(use: Callable[[Any], Any]) -> None:
    with Simulation(study()) as simulation:
        simulation.step(0.0)
    with pytest.raises(SimulationError, match=r"is over.*new Simulation|what save_state returned"):
        use(simulation)


def test_values_of_another_type_are_refused_with_a_remedy() -> None:
    simulation: Any = Simulation(study())
    with pytest.raises(SimulationError, match="got a NoneType; give what save_state returned"):
        simulation.restore_state(None)
    for value in ("a", None, [0.0], 1j, True, np.True_):
        with pytest.raises(SimulationError, match="give numbers in m"):
            simulation.step(value)
        with pytest.raises(SimulationError, match="give numbers in m"):
            simulation.step(0.0, transverse=value)
    for steps in ("a", 1.5, 0, True):
        with pytest.raises(SimulationError, match="whole number of 1 or more"):
            simulation.step(0.0, steps=steps)
    with pytest.raises(SimulationError, match="did you mean `vertical`"):
        simulation.step(0.0, vertcal=0.1)
    simulation.step(np.float32(0.001), steps=np.int64(2))
    assert simulation.time == pytest.approx(0.002)
    nothing: Any
    for nothing in (5, None):
        with pytest.raises(SimulationError, match="give a Study, the path of one, or a Scene"):
            Simulation(nothing)
        with pytest.raises(SimulationError, match="list of trials"):
            run_batch(nothing)
        with pytest.raises(SimulationError, match=r"trial 0 of the batch.*vsr2\.trial\.Trial"):
            run_batch([nothing])


def test_a_state_of_another_scene_or_drive_is_refused() -> None:
    saved = Simulation(study()).save_state()
    with pytest.raises(SimulationError, match="of scene"):
        Simulation(study(engine={"gravity": 9.8})).restore_state(saved)
    with pytest.raises(SimulationError, match="another drive"):
        Simulation(study(), drive="motor_position").restore_state(saved)


@pytest.mark.parametrize(
    ("motion", "drive"),
    [
        ({"mode": "single_cosine", "pga_g": 0.5, "pgv_pga_s": 0.1}, "prescribed"),
        ({"mode": "single_cosine", "pga_g": 0.5, "pgv_pga_s": 0.1, "drive": "motor"},
         "motor_position_velocity"),
        ({"mode": "single_recording", "file": RECORD, "drive": "motor"}, "motor_position"),
    ],
)  # fmt: skip
def test_a_study_and_its_trials_have_one_drive(motion: dict[str, Any], drive: str) -> None:
    chosen = study(motion=motion)
    starts = []

    def settled_start(scene: _native.Scene, used: _native.Drive, *more: Any) -> Any:
        starts.append(used)
        return _settled_start(scene, used, *more)

    _specification(study_trials(chosen)[0], settled_start)
    assert [Simulation(chosen).drive] == [used.name for used in starts] == [drive]


@pytest.mark.parametrize("position", [math.nan, math.inf])
def test_set_points_must_be_finite(position: float) -> None:
    with pytest.raises(SimulationError, match="finite"):
        Simulation(study()).step(position)


def test_settling_has_a_timeout() -> None:
    simulation = Simulation(study())
    assert simulation.settle() > 0.2
    from vsr2.config.study import Settling

    with pytest.raises(SimulationError, match=r"settling\.timeout"):
        simulation.settle(Settling(linear_speed=1e-300, angular_speed=1e-300, timeout=0.3))


def test_table_s1_follows_from_the_body_level_inputs() -> None:
    pair = Contact(**ORIGINAL["contact"]).pair
    assert round(pair.restitution, 2) == 0.12
    assert round(pair.lateral_friction, 2) == 0.49
    assert round(pair.spinning_friction, 2) == 0.70
    assert pair.damping == 2.0e7
    assert pair.stiffness == pytest.approx(1.3e9)


def test_running_contact_carries_the_weight_with_the_pair_values() -> None:
    contact = {"rock": {"restitution": 0.2, "stiffness": 4e8}, "pedestal": {"stiffness": 1e9}}
    scene = build_scene(study(contact=contact))
    simulation = Simulation(scene)
    simulation.step(0.0, steps=2000)
    contacts = simulation.contacts()
    assert len(contacts) == 4
    pair = scene.contact.pair
    logged = {one.vector or one.name for one in _native.contact_columns()} - {"time"}
    assert set(contacts[0]) == logged | set(type(scene.contact.rock).model_fields)
    for point in contacts:
        assert point["stiffness"] == pytest.approx(pair.stiffness, rel=1e-12)
        assert point["restitution"] == pytest.approx(pair.restitution)
        assert point["spinning_friction"] == pytest.approx(pair.spinning_friction)
        assert point["normal"][2] == pytest.approx(1.0)
    weight = scene.rock.mass.mass * 9.81 * 1e-3
    assert sum(point["normal_impulse"] for point in contacts) == pytest.approx(weight, rel=1e-5)


def final_state(**engine: object) -> bytes:
    """State after a tilted drop that slides, spins and bounces."""
    simulation = Simulation(study(engine=engine))
    simulation.set_rock_velocity([0.4, 0.3, -1.0], [0.5, -0.8, 1.0])
    for k in range(1, 120):
        simulation.step(0.02 * math.sin(0.05 * k))
    state = simulation.state
    return state.position.tobytes() + state.body_orientation.tobytes()


@pytest.mark.parametrize(
    "engine",
    [
        {"gravity": 9.8},
        {"time_step": 0.0009},
        {"substeps": 2},
        {"solver_iterations": 20},
        {"residual_threshold": 1e-4},
        {"restitution_velocity_threshold": 2.0},
        {"cone_friction": False},
        {"collision_margin": 0.002},
        {"contact_breaking_threshold": 0.001},
        {"linear_damping": 0.04},
        {"angular_damping": 0.04},
    ],
    ids=lambda engine: next(iter(engine)),
)
def test_every_engine_setting_is_alive(engine: dict[str, object]) -> None:
    assert final_state(**engine) != final_state()


def test_deterministic_pairs_are_accepted_either_way() -> None:
    # With one rock on one pedestal there is one pair, and no order to speak of.
    assert final_state(deterministic_overlapping_pairs=False) == final_state()


def test_mesh_pedestal_carries_the_rock() -> None:
    from pathlib import Path

    file = Path(__file__).resolve().parents[2] / "models" / "pedestal_topography.obj"
    for collision in ("triangles", "hull"):
        simulation = Simulation(
            study(pedestal={"shape": "mesh", "file": str(file), "collision": collision})
        )
        before = simulation.state.position[2]
        simulation.step(0.0, steps=1500)
        # It stands on the surface: no fall through, no jump off.
        assert abs(simulation.state.position[2] - before) < 0.05, collision
        assert len(simulation.contacts()) >= 3


@pytest.mark.parametrize("position", [1e300, -1e7])
def test_set_points_beyond_reason_are_refused(position: float) -> None:
    with pytest.raises(SimulationError, match="beyond"):
        Simulation(study()).step(position)


def test_bad_velocities_and_drives_are_refused() -> None:
    simulation = Simulation(study())
    masked = np.ma.array([1.0, 2.0, 3.0], mask=[False, True, False])
    for linear in ([math.nan, 0, 0], [1.0, 2.0], np.ones((3, 1))):
        with pytest.raises(SimulationError, match="three finite"):
            simulation.set_rock_velocity(linear)
    for other in ("fast", ["1", "0", "0"], [True, 0.0, 0.0], [1j, 0, 0], masked):
        with pytest.raises(SimulationError, match=r"velocity is (not an array of numb|a masked)"):
            simulation.set_rock_velocity(other)
        with pytest.raises(SimulationError, match=r"velocity is (not an array of numb|a masked)"):
            simulation.set_rock_velocity([1.0, 0.0, 0.0], other)
    with pytest.raises(SimulationError, match="drive 'hand'"):
        Simulation(study(), drive="hand")  # type: ignore[arg-type]


def test_a_log_that_cannot_fit_is_refused_before_any_work() -> None:
    from vsr2.simulation import run_batch

    endless = study(
        engine={"time_step": 1e-6},
        outcome={"tail": 3600.0},
        output={"log_every": 1},
        motion={"mode": "single_cosine", "pga_g": 0.1, "pgv_pga_s": 0.1},
    )
    with pytest.raises(SimulationError, match="log_every"):
        run_batch(endless)
