"""A pedestal that pitches on a spring, through Python: trials, effect, refusals."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from vsr2.effects import apply_effects, effect
from vsr2.effects.oscillator import respond
from vsr2.errors import ConfigError, MotionError, SimulationError
from vsr2.motion import (
    STANDARD_GRAVITY,
    Motion,
    SideMotion,
    build_recorded_motion,
    cosine_motion,
    read_record,
)
from vsr2.scene import PitchSpring
from vsr2.simulation import Simulation, native_scene, run_batch
from vsr2.simulation.bench import EffectBench
from vsr2.trial import Trial

ROOT = Path(__file__).resolve().parents[2]
HEAVY = 1e12
"""Moment of a table that does not feel a rock [kg m]."""
SPRING = PitchSpring(frequency=8.0, damping=0.1, compliance=5e-4, inertia=400.0)


def still(motion: Motion, mode: Literal["exact", "fast"] = "fast") -> Trial:
    """The bench's block under a motion."""
    return replace(EffectBench(mode).block(), motion=motion)


def pitch_of(trial: Trial) -> NDArray[np.float64]:
    """Pitch of the pedestal from the start of the motion [rad]."""
    log = run_batch([trial], threads=1).log(0)
    found: NDArray[np.float64] = log.excursions[log.time >= 0, 2]
    return found


@pytest.mark.parametrize("mode", ["exact", "fast"])
@pytest.mark.parametrize(("frequency", "damping"), [(8.0, 0.1), (20.0, 0.7), (5.0, 2.0)])
def test_a_heavy_table_follows_the_oscillator(
    mode: Literal["exact", "fast"], frequency: float, damping: float
) -> None:
    # Solved beforehand for an acceleration that is linear between samples; in the loop it comes as
    # blows at the samples, which is (w dt)^2 / 12 off: 0.13 % at 20 Hz.
    record = read_record(ROOT / "configs" / "motions" / "synthetic_07.csv")
    motion = build_recorded_motion(record, 1e-3).scaled(0.5, name="half")
    values = {"compliance": 0.01, "frequency": frequency, "damping": damping, "moment": HEAVY}
    found = pitch_of(apply_effects([still(motion, mode)], {"table_pitch": values})[0])
    omega = 2 * math.pi * frequency
    expected, _ = respond(
        0.0, -0.01 / STANDARD_GRAVITY * omega**2, frequency, damping, motion.acceleration, 1e-3
    )
    greatest = float(np.abs(expected).max())
    assert greatest > 5e-4
    np.testing.assert_allclose(found[: expected.size], expected, atol=0.005 * greatest)


def test_a_stiff_joint_is_a_rigid_table() -> None:
    # With a given inertia it would not be: a table free to turn gives way to every impact.
    shaken = still(cosine_motion(0.03, 2.0, 1e-3))
    changed = [
        apply_effects([shaken], {"table_pitch": {"compliance": compliance}})[0]
        for compliance in (1e-9, 1e-3)
    ]
    given = replace(SPRING, frequency=10.0, compliance=0.0, inertia=500.0)
    scene = shaken.scene
    pedestal = replace(scene.pedestal, pitch_spring=given, pitch_pivot=scene.pedestal.top - 0.5)
    free = shaken.with_scene(pedestal=pedestal)
    peaks = run_batch([shaken, *changed, free], threads=1)["peak_tilt"].astype(float)
    plain, stiff, soft, turning = (float(peak) for peak in peaks)
    assert plain > 0.02
    assert turning != pytest.approx(plain, abs=1e-3)
    assert stiff == pytest.approx(plain, abs=1e-5)
    assert soft != pytest.approx(plain, abs=1e-3)


def test_the_rock_pushes_back() -> None:
    motion = EffectBench().pulse(1.0, 2.0)
    moments = (1000.0, HEAVY)
    light, heavy = (
        float(
            np.abs(
                pitch_of(
                    apply_effects(
                        [still(motion)], {"table_pitch": {"compliance": 0.01, "moment": moment}}
                    )[0]
                )
            ).max()
        )
        for moment in moments
    )
    # The block's own m h a, 778 kg at 1.1 m, joins the table's 1000 kg m, or more: it swings.
    assert light > 1.5 * heavy


def test_equal_springs_share_a_scene() -> None:
    trials = [still(EffectBench().pulse(1.0, frequency)) for frequency in (2.0, 3.0)]
    one, two = apply_effects(trials, {"table_pitch": {"compliance": 0.01}})
    assert one.scene.sha256 == two.scene.sha256
    assert native_scene(one.scene) is native_scene(two.scene)
    assert one.scene.pitches
    assert not trials[0].scene.pitches
    other = apply_effects(trials[:1], {"table_pitch": {"compliance": 0.011}})[0]
    plain = trials[0].scene
    assert len({plain.sha256, one.scene.sha256, other.scene.sha256}) == 3


def test_a_simulation_pitches_by_itself() -> None:
    block = EffectBench().block().scene
    pedestal = replace(block.pedestal, pitch_spring=SPRING, pitch_pivot=block.pedestal.top - 0.5)
    scene = replace(block, pedestal=pedestal)
    simulation = Simulation(scene)
    assert simulation.drive == "prescribed_spatial"
    simulation.settle()
    for i in range(200):
        simulation.step(0.5 * 1.0 * (1e-3 * i) ** 2, transverse=1e-4)
    assert -0.01 < simulation.excursion[2] < -1e-4
    assert simulation.excursion[0] == 1e-4
    with pytest.raises(SimulationError, match="no set-points of pitch"):
        simulation.step(0.0, pitch=0.01)
    with pytest.raises(SimulationError, match="prescribed_spatial"):
        Simulation(scene, drive="prescribed")


def test_what_cannot_be_is_refused() -> None:
    shaken = still(cosine_motion(0.01, 2.0, 1e-3))
    motion = shaken.motion
    turning = SideMotion(0.1 * motion.displacement, 0.1 * motion.velocity)
    pitching = replace(shaken, motion=replace(motion, pitch=turning))
    given = {"table_pitch": {"compliance": 0.01}}
    with pytest.raises(MotionError, match=r"effects\.table_pitch: .* pitches already"):
        apply_effects([pitching], given)
    changed = apply_effects([shaken], given)[0]
    with pytest.raises(SimulationError, match="leave one of them out"):
        run_batch([replace(changed, motion=pitching.motion)], threads=1)
    with pytest.raises(SimulationError, match="drive: prescribed"):
        run_batch([replace(changed, drive="motor")], threads=1)
    # 778 kg, 1.1 m over the joint: 8.4 kN m against 100 kg m g / 0.2.
    one = effect("table_pitch")
    block = EffectBench().block()
    weak = one.complete({"compliance": 0.2, "moment": 100.0})
    with pytest.raises(ConfigError, match=r"effects\.table_pitch\.moment: .* raise it"):
        one.change(block, weak)
    coarse = block.with_scene(engine=block.scene.engine.model_copy(update={"time_step": 0.002}))
    with pytest.raises(ConfigError, match=r"effects\.table_pitch\.frequency: .* lower it"):
        one.change(coarse, one.complete({"compliance": 0.01, "frequency": 125.0}))
    bad = replace(shaken.scene.pedestal, pitch_spring=replace(SPRING, inertia=-1.0))
    with pytest.raises(SimulationError, match="pitch_spring: inertia must be positive"):
        native_scene(shaken.with_scene(pedestal=bad).scene)
