"""The benchmarks compare what they say: every engine's rock is shaken by its table, and alike."""

from pathlib import Path

import numpy as np
import pytest

from engine_speed import CARRIED, GENTLE, NativeRock, carried, scene_of, settled
from vsr2.config.study import BoxRock, Engine, MeshRock, PrismPedestal
from vsr2.config.study import Contact as ContactConfig
from vsr2.motion import cosine_motion
from vsr2.scene import Scene, build_pedestal, build_rock

MESH = Path(__file__).resolve().parents[2] / "models" / "pbr_scan.obj"
ROCKING = cosine_motion(0.07, 1.5, 1e-3)
OVERTURNING = cosine_motion(0.21, 1.0, 1e-3)


@pytest.fixture(scope="module")
def block():
    """A block with the values of the blind scene."""
    size = (0.4, 0.55, 0.95)
    pedestal = build_pedestal(PrismPedestal())
    rock = build_rock(BoxRock(shape="box", size=size, density=2700.0), pedestal, clearance=1e-6)
    high = {"rock": {"lateral_friction": 0.9}, "pedestal": {"lateral_friction": 0.9}}
    return Scene(rock, pedestal, Engine(mode="fast"), ContactConfig(**high))


@pytest.fixture(scope="module")
def scan():
    return settled(MeshRock(shape="mesh", file=MESH, mass=446.6))


@pytest.fixture(scope="module")
def in_mujoco(block):
    pytest.importorskip("mujoco", reason="the benchmark extra installs MuJoCo")
    from mujoco_rock import MujocoRock

    return MujocoRock(block)


def test_mujoco_s_rock_is_carried_by_its_contacts(in_mujoco):
    table, rock = carried("MuJoCo", in_mujoco)
    assert table == pytest.approx(0.06)
    assert rock == pytest.approx(table, rel=CARRIED)


def test_a_rock_that_is_not_shaken_stops_the_benchmark(in_mujoco, monkeypatch):
    forces = in_mujoco.forces
    monkeypatch.setattr(in_mujoco, "forces", lambda motion: 0 * forces(motion))
    with pytest.raises(SystemExit, match=r"moved by 60\.0 mm, and its rock .* by 60\.0 mm"):
        carried("MuJoCo", in_mujoco)


def test_the_block_rocks_alike_in_mujoco_and_in_fast(block, in_mujoco):
    ours = NativeRock(block, "prescribed").follow(ROCKING)
    theirs = in_mujoco.follow(ROCKING)
    assert ours[2].max() > 0.2
    # 3 % by another contact model and 1 % by the time step (docs/validation/engines.md)
    assert theirs[2].max() == pytest.approx(ours[2].max(), rel=0.05)


def test_the_rolled_out_rock_goes_where_the_stepped_one_goes(in_mujoco):
    motions = [GENTLE.scaled(0.5), ROCKING, OVERTURNING, GENTLE]
    fallen = [bool(in_mujoco.follow(motion)[2][-1] > 0.35) for motion in motions]
    assert fallen == [False, False, True, False]
    for segment in (170, 10_000):
        assert in_mujoco.overturned(motions, 2, segment=segment) == 1


@pytest.mark.parametrize("drive", ["motor", "prescribed"])
def test_pybullet_s_table_goes_as_parity_s(scan, drive):
    pytest.importorskip("pybullet", reason="the benchmark extra installs PyBullet")
    from pybullet_rock import PyBulletRock

    scene, motion = scene_of(scan, "parity"), GENTLE.scaled(0.5)
    table, rock, _ = PyBulletRock(scene, MESH, drive).follow(motion)
    ours = NativeRock(scene, drive).follow(motion)
    np.testing.assert_allclose(table, ours[0], atol=1e-9)
    np.testing.assert_allclose(rock, ours[1], atol=1e-6)
    assert np.abs(table).max() > 0.02
