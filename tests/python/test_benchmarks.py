"""The benchmarks compare what they say: every engine's rock is shaken by its table, and alike."""

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lanes
import throughput
import throughput_work
import vsr2
from engine_speed import CARRIED, GENTLE, NativeRock, carried, scene_of, settled
from throughput import Drawn, Measured
from vsr2.config.study import BoxRock, Engine, MeshRock, PrismPedestal
from vsr2.config.study import Contact as ContactConfig
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
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
    forces = [in_mujoco.forces(motion) for motion in motions]
    for segment in (170, 10_000):
        assert in_mujoco.overturned(forces, 2, segment=segment) == 1


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


def options(**changes):
    given = {"against": None, "trials": 2, "draws": 1, "threads": 1, "works": ["batch-block"]}
    return argparse.Namespace(**{**given, "rounds": 1, "time_step": None, **changes})


def measured(options):
    """By work and engine, and what campaigns are drawn from."""
    works = [work for work in options.works if work.startswith("campaign")]
    campaigns = {work: throughput.drawn_once(work, options) for work in works}
    return throughput.measured(options, campaigns), campaigns


def test_another_version_does_the_same_work(monkeypatch, capsys):
    own = Path(vsr2.__file__).resolve().parents[1]
    monkeypatch.setattr(throughput, "installed", lambda module: False)
    found, _ = measured(options(against=own, works=["batch-block", "campaign-block"]))
    assert len(capsys.readouterr().out.splitlines()) == 5
    for work in ("batch-block", "campaign-block"):
        ours, theirs = found[work, "vsr2"], found[work, "against"]
        assert [one.trials for one in ours] == [one.trials for one in theirs] == [2]
        assert [one.overturned for one in ours] == [one.overturned for one in theirs]
        assert all(0 < one.making <= one.cpu for one in ours + theirs)


OTHER_LIBRARY = """
import vsr2.effects.registry as registry
import vsr2.ensemble.simulated.contact_family as family
import vsr2.ensemble.simulated.nuisances as nuisances
from vsr2.effects import Parameter

more = Parameter("more", "1", 0.0, 0.0, 1.0, "uniform", "")
kept = [e for e in registry.BUILT_IN if e.name not in ("base_asperity", "friction_rate", "wear")]
for effect in kept:
    if effect.name == "edge_rounding":
        effect.parameters = (*effect.parameters, more)
registry.BUILT_IN = tuple(kept)
family.CONTACT_FAMILY = tuple(
    nuisances.replace(one, prior=nuisances.Uniform(one.prior.low, one.prior.high / 4))
    for one in family.CONTACT_FAMILY[1:]
)
"""
"""A version that lacks effects and a nuisance, has one effect with a parameter more, and draws
nuisances from other ranges."""


def test_a_version_with_another_library_gets_the_same_draws(monkeypatch, tmp_path, capsys):
    (tmp_path / "vsr2").symlink_to(Path(vsr2.__file__).resolve().parent)
    (tmp_path / "sitecustomize.py").write_text(OTHER_LIBRARY)
    found, campaigns = measured(
        options(against=tmp_path, works=["campaign-block"], trials=15, draws=3, rounds=2)
    )
    drawn = campaigns["campaign-block"]
    has = {name: int(of.split(" of ")[1]) for name, of in drawn.effects.items()}
    assert has["vsr2"] - has["against"] == 3
    assert {int(of.split(" of ")[0]) for of in drawn.effects.values()} == {has["against"] - 1}
    assert [of.split(" of ")[0] for of in drawn.nuisances.values()] == [
        drawn.nuisances["against"].split(" of ")[1]
    ] * 2
    ours, theirs = (found["campaign-block", engine] for engine in ("vsr2", "against"))
    assert sum(bool(draw["effects"]) for draw in drawn.draws) > 2
    assert [one.overturned for one in ours] == [one.overturned for one in theirs]
    assert 0 < ours[0].overturned < 1


def test_one_draw_gives_the_same_trials_whatever_else_a_version_knows(monkeypatch):
    campaign, study = throughput_work.campaign_and_study("campaign-block", 6)
    pools = throughput_work.library_of(campaign, study), throughput_work.usual_nuisances()
    common = throughput_work.known(*pools)
    del common["nuisances"]["contact_model.sweeps of a campaign"]
    draws = throughput_work.drawn(*pools, common, range(3))
    assert json.loads(json.dumps(draws)) == draws

    def peaks():
        kept = []
        run = SceneSimulator.run
        with monkeypatch.context() as patched:
            patched.setattr(
                SceneSimulator, "run", lambda *args: kept.append(run(*args)) or kept[-1]
            )
            throughput_work.simulated(campaign, study, draws, 1)()
        return [responses.peak_tilt.tolist() for responses in kept]

    first = peaks()
    usual = {
        name: replace(one, prior=throughput_work.Given(one.prior.value(0.0)))
        if throughput_work.holds_for_campaign(one)
        else one
        for name, one in pools[1].items()
    }
    monkeypatch.setattr(throughput_work, "usual_nuisances", lambda: usual)
    assert peaks() == first


def test_a_version_refuses_what_it_does_not_know():
    campaign, study = throughput_work.campaign_and_study("campaign-block", 1)
    given = throughput_work.GivenCampaigns(campaign, study, ["inertia.change of a campaign"], 1)
    draw = {"index": 1, "nuisances": {"inertia.change of a campaign": 0.01}, "effects": {}}
    assert given.overturned(draw).shape == (1,)
    with pytest.raises(ValueError, match="table_gain has no parameter more"):
        given.overturned({**draw, "effects": {"table_gain": {"more": 1.0}}})
    with pytest.raises(ValueError, match="nuisances are"):
        given.overturned({**draw, "nuisances": {}})


def test_a_time_step_is_that_of_the_scene():
    _, study = throughput_work.campaign_and_study("campaign-block", 1, 0.002)
    assert study.engine.time_step == 0.002
    assert throughput_work.study_of("block").engine.time_step == 0.001


def test_mujoco_does_the_work_of_a_batch():
    pytest.importorskip("mujoco", reason="the benchmark extra installs MuJoCo")
    both = [options(work="batch-block", engine=name, round=0) for name in ("vsr2", "mujoco")]
    # The weakest and the strongest trial.
    assert [throughput_work.prepared(one)() for one in both] == [(2, 0.5, 0), (2, 0.5, 0)]


def test_no_draw_is_simulated_in_two_rounds(monkeypatch):
    asked = []

    def done(work, engine, round_, options, *, draws):
        asked.append(draws)
        took = Measured(2, 1.0, 1.0, 0.5, 0.5, 0)
        return json.dumps(took._asdict())

    drawn = throughput.drawn_once("campaign-block", options(rounds=3, draws=20))
    monkeypatch.setattr(throughput, "done", done)
    throughput.measured(
        options(works=["campaign-block"], rounds=3, draws=20), {"campaign-block": drawn}
    )
    timed = [draw for draws in asked for draw in draws]
    assert timed == drawn.draws
    assert len({draw["index"] for draw in timed}) == 3 * 20
    assert {len(draw["effects"]) for draw in timed} == {0, 1, 2}
    acting = [json.dumps(draw["effects"]) for draw in timed if draw["effects"]]
    assert len(set(acting)) == len(acting)


def test_the_table_has_totals_and_the_scatter_of_rounds():
    found = {
        ("campaign-block", "vsr2"): [
            Measured(10, 1.0, 2.0, 0.1, 0.5, 0),
            Measured(10, 2.0, 2.0, 0.3, 0.5, 0),
        ],
        ("campaign-block", "against"): [
            Measured(10, 3.0, 8.0, 0.2, 0.4, 0),
            Measured(5, 3.0, 6.0, 0.4, 0.5, 3),
        ],
    }
    counts = {"vsr2": "27 of 32", "against": "27 of 28"}
    drawn = Drawn([], counts, {"vsr2": "17 of 18", "against": "17 of 17"})
    ours, theirs = throughput.table(found, {"campaign-block": drawn}, {"campaign-block": 0.002})
    assert ours[-6:] == ["1.00"] * 6
    assert theirs == [
        "campaign-block", "against", "2", "2", "15", "27 of 28", "17 of 17",
        "2.5", "933.33", "40.000", "0.043", "0.417", "3",
        "2.67", "3.00", "3.00", "4.67", "4.00", "6.00",
    ]  # fmt: skip


def test_rows_of_other_works_and_time_steps_stay_in_the_file(tmp_path):
    path = tmp_path / "table.csv"

    def row(work, step, rate):
        return [work, "vsr2", step, *[rate] * (len(throughput.HEADER) - 3)]

    throughput.write([row("campaign-block", "1", "3"), row("batch-block", "1", "4")], path)
    throughput.write([row("campaign-block", "2", "5")], path)
    throughput.write([row("campaign-block", "1", "6")], path)
    lines = path.read_text().splitlines()[1:]
    assert [line.split(",")[0:4] for line in lines] == [
        ["batch-block", "vsr2", "1", "4"],
        ["campaign-block", "vsr2", "2", "5"],
        ["campaign-block", "vsr2", "1", "6"],
    ]


def test_works_without_their_data_are_skipped_with_the_reason(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(throughput, "LAB", tmp_path)
    assert throughput.possible(options(works=["campaign-SP1"])) == []
    assert f"campaign-SP1 is skipped: {tmp_path} holds no trials.csv" in capsys.readouterr().out


def test_a_folder_without_vsr2_is_refused(monkeypatch, tmp_path):
    monkeypatch.setattr("sys.argv", ["throughput.py", "--against", str(tmp_path)])
    with pytest.raises(SystemExit, match="holds no package vsr2"):
        throughput.main()


def test_lanes_are_compared_with_the_core_and_the_scalar_kernel_round_by_round():
    speeds, agreement = lanes.tables(
        "check,velocity [m/s],4.4e-16\n"
        "step,portable,the core,double,1,no,0.000000,0.2000,400,800\n"
        "step,portable,trials,double,1,yes,0.002000,0.2000,300,600\n"
        "step,avx512,trials,double,8,yes,0.002000,0.2000,50,100\n"
        "sweep,portable,the core,double,1,yes,0.000000,0.0000,60,60\n"
        "sweep,portable,trials,double,1,yes,0.000000,0.0000,60,60\n"
    )
    assert agreement == [{"what": "velocity [m/s]", "value": "4.4e-16"}]
    assert list(speeds[0]) == lanes.HEADER
    assert [row["times_core"] for row in speeds] == ["1.00", "1.33", "8.00", "1.00", "1.00"]
    assert [row["times_scalar"] for row in speeds] == ["0.75", "1.00", "6.00", "1.00", "1.00"]
    # 1 / (.24 + .76 (.23 + .77 / 8)) and 1 / (.17 + .83 (.47 + .53 / 8))
    assert (speeds[2]["plain_batch"], speeds[2]["campaign"]) == ("2.05", "1.63")
    assert speeds[3]["campaign"] == ""


def test_the_program_of_lanes_is_given_the_batch_s_block():
    time_step, *size, density, restitution, friction = lanes.work(2)[:7]
    study = throughput_work.study_of("block")
    assert (time_step, tuple(size), density) == (0.001, study.rock.size, study.rock.density)
    assert (restitution, friction) == (0.35, 0.9)
    count, *lengths = (int(value) for value in lanes.work(2)[11:14])
    assert count == len(lengths) == 2
    assert len(lanes.work(2)) == 14 + sum(lengths)
