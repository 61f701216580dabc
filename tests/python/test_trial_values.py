"""Scene, trial and result as values: copied, pickled, hashed; the native scene behind a scene."""

from __future__ import annotations

import copy
import itertools
import json
import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from vsr2.analysis.intervals import resampled
from vsr2.campaign import simulate_campaign
from vsr2.campaign.folds import grouped_folds, motion_resamples
from vsr2.config.study import Output, Study
from vsr2.coverage.planted_campaigns import draw_planted
from vsr2.diagnosis.corrected import drawn_studies
from vsr2.effects import EffectRangeWarning, apply_effects
from vsr2.ensemble.reference_campaign import compare_reference
from vsr2.errors import (
    CampaignError,
    ConfigError,
    DiagnosisError,
    GeometryError,
    MotionError,
    ResultError,
    SimulationError,
)
from vsr2.motion import Motion, Record, SideMotion, build_recorded_motion, shaped_noise
from vsr2.results import BatchResult, Outcome, Status
from vsr2.scene import (
    Box,
    Hull,
    MassProperties,
    Mechanisms,
    PitchSpring,
    Pose,
    Scene,
    Triangles,
    build_scene,
)
from vsr2.simulation import native_scene, plan_sha256, run_batch
from vsr2.simulation import native_scenes as module
from vsr2.simulation.worker import _Unpickler, pack, packed_part
from vsr2.trial import Trial

ROOT = Path(__file__).resolve().parents[2]
BOX = {"shape": "box", "size": [0.3, 0.5, 1.0], "density": 2700.0}
MOTION = {"mode": "single_cosine", "pga_g": 0.5, "pgv_pga_s": 0.1}
SCAN = {"shape": "mesh", "file": str(ROOT / "models" / "pbr_scan.obj"), "density": 2650.0}
EFFECTS = {
    "edge_rounding": {"radius": 0.006},
    "restitution": {"energy_ratio": 0.8},
    "table_pitch": {"compliance": 0.005},
    "off_axis_motion": {"share": 0.1},
    "placement": {"yaw": 5.0},
    "outcome_rule": {"tilt": 0.1},
}

Copy = Callable[[Any], Any]


def pickled(value: Any) -> Any:
    return pickle.loads(pickle.dumps(value))


def through_a_worker(trial: Trial) -> Trial:
    content, parts = pack([trial])
    there = {key: pickle.loads(packed_part(part)) for key, part in parts.items()}
    [back] = _Unpickler(content, there).load()
    assert isinstance(back, Trial)
    return back


def scene_of(rock: dict[str, Any]) -> Scene:
    return build_scene(Study.model_validate({"rock": rock, "motion": MOTION}))


def recorded() -> Motion:
    time = np.arange(400) * 0.002
    x = 0.05 * np.sin(np.pi * time / time[-1]) ** 4 * np.sin(5 * np.pi * time)
    motion = build_recorded_motion(Record("r", 0.002, displacement=x), 0.001)
    side = SideMotion(0.1 * motion.displacement, 0.1 * motion.velocity)
    return replace(motion, vertical=side)


@pytest.fixture(scope="module", params=["box", "scan"])
def trial(request: pytest.FixtureRequest) -> Trial:
    scene = scene_of(BOX if request.param == "box" else SCAN)
    plain = Trial(scene, recorded(), output=Output(log_every=5), seed=7)
    return apply_effects([plain], EFFECTS)[0]


@pytest.mark.parametrize("duplicate", [copy.deepcopy, pickled])
def test_a_copy_is_equal_and_runs_to_the_same_bits(trial: Trial, duplicate: Copy) -> None:
    other = duplicate(trial)
    assert other.scene is not trial.scene
    assert (other.scene, other.motion, other) == (trial.scene, trial.motion, trial)
    assert len({trial, other}) == len({trial.scene, other.scene}) == 1
    assert other.scene.sha256 == trial.scene.sha256
    assert other.motion.sha256 == trial.motion.sha256
    assert other.sha256 == trial.sha256
    assert plan_sha256([other]) == plan_sha256([trial])
    assert not other.motion.acceleration.flags.writeable
    assert not other.motion.vertical.velocity.flags.writeable
    # The hash that was made before is that of the content.
    assert replace(other.scene).sha256 == trial.scene.sha256
    first, second = run_batch([trial], threads=1), run_batch([other], threads=1)
    assert first.log(0).state.tobytes() == second.log(0).state.tobytes()
    assert first.log(0).excursions.tobytes() == second.log(0).excursions.tobytes()
    for name in first.trials:
        np.testing.assert_array_equal(first[name], second[name])


def test_a_trial_that_travels_runs_to_the_same_bits(trial: Trial) -> None:
    there = through_a_worker(trial)
    assert there.scene.sha256 == trial.scene.sha256
    assert there.motion.sha256 == trial.motion.sha256
    assert there.motion.recorded is None
    assert there.start == trial.start_pose
    here, back = run_batch([trial], threads=1), run_batch([there], threads=1)
    assert here.log(0).state.tobytes() == back.log(0).state.tobytes()


@pytest.mark.parametrize("duplicate", [copy.deepcopy, pickled])
def test_a_result_is_copied_with_its_logs(trial: Trial, duplicate: Copy) -> None:
    result = run_batch([trial, replace(trial, output=Output(log_every=0))], threads=1)
    other = duplicate(result)
    assert isinstance(other, BatchResult)
    for name in result.trials:
        np.testing.assert_array_equal(other[name], result[name])
    assert other.log(0).state.tobytes() == result.log(0).state.tobytes()
    assert other.logs[1] is None
    assert other.provenance == result.provenance
    for mapping in (other.provenance, other.provenance["build"]):
        with pytest.raises(TypeError, match="read-only"):
            mapping["version"] = "another"
    assert json.dumps(other.provenance) == json.dumps(result.provenance)
    assert {type(one) for one in other["outcome"]} == {Outcome}
    assert result["status"].tolist() == ["ok", Status.ok]
    with pytest.raises(ValueError, match="read-only"):
        other.log(0).state[0, 0] = 1.0


def arrays_in(value: Any) -> Iterator[NDArray[Any]]:
    """Arrays anywhere in dataclasses and sequences."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, list | tuple):
        for item in value:
            yield from arrays_in(item)
    elif hasattr(value, "__dict__"):
        yield from arrays_in(list(vars(value).values()))


@pytest.mark.parametrize("duplicate", [lambda value: value, copy.deepcopy, pickled])
def test_no_array_of_a_value_can_be_written(trial: Trial, duplicate: Copy) -> None:
    other = duplicate(trial)
    assert len(list(arrays_in(other.scene))) >= 4
    assert len(list(arrays_in(other.motion))) >= 7
    assert [array.flags.writeable for array in arrays_in(other)].count(True) == 0
    before = other.scene.sha256
    with pytest.raises(ValueError, match="read-only"):
        next(arrays_in(other.scene.rock.parts))[:] *= 0.5
    assert replace(other.scene).sha256 == before
    result = duplicate(run_batch([trial], threads=1))
    with pytest.raises(ValueError, match="read-only"):
        result["peak_tilt"][0] = 0.0
    for column in result.trials.values():
        with pytest.raises(ValueError, match="cannot set WRITEABLE"):
            column.setflags(write=True)
    with pytest.raises(TypeError, match="read-only"):
        result.trials["outcome"] = np.zeros(1)


def test_a_column_given_to_a_result_is_not_the_callers(trial: Trial) -> None:
    given = {name: column.copy() for name, column in run_batch([trial], threads=1).trials.items()}
    result = BatchResult(given, [None], {})
    given["pga_g"][0] = 99.0
    assert result["pga_g"][0] < 99.0


def test_an_array_given_to_a_scene_is_not_the_callers() -> None:
    points, origin = np.eye(4)[:, :3].copy(), np.array([0.0, 0.0, 1.0])
    hull = Hull(points)
    view = points.view()
    view.setflags(write=False)
    seen = Hull(view)
    pedestal = replace(scene_of(BOX).pedestal, origin=origin)
    points[:], origin[:] = 9.0, 9.0
    assert hull.points.max() == seen.points.max() == 1.0
    assert pedestal.origin == (0.0, 0.0, 1.0)
    # Nobody can write to the array of a hull, so that another shares it.
    assert Hull(hull.points).points is hull.points


def test_values_differ_by_start_and_name(trial: Trial) -> None:
    moved = Pose((1.0, 0.0, 2.0), (0.0, 0.0, 0.0, 1.0))
    scene = trial.scene
    assert trial.with_scene(rock=replace(scene.rock, start=moved)).scene != scene
    assert replace(trial.motion, name="other") != trial.motion
    assert replace(trial, motion=replace(trial.motion, name="other")) != trial
    assert replace(trial, start=moved) != trial
    assert scene != trial
    assert trial != scene
    assert trial.motion != scene


def test_all_that_acts_is_in_the_hash(trial: Trial) -> None:
    scene = trial.scene
    others = [
        replace(trial, seed=8),
        replace(trial, drive="motor"),
        replace(trial, name="other"),
        replace(trial, motion=trial.motion.scaled(2.0)),
        replace(trial, output=Output(log_every=6)),
        replace(trial, effects=()),
        trial.with_scene(mechanisms=Mechanisms(adhesion=5.0)),
        trial.with_scene(engine=scene.engine.model_copy(update={"gravity": 9.7})),
    ]
    assert len({trial.sha256, *(other.sha256 for other in others)}) == 9


SPELLED = [int, np.int64, np.float32, np.float64]


def integers(spelled: Callable[[int], Any], trial: Trial) -> Trial:
    """A trial whose numbers are integers, spelled with other types."""

    def numbers(*values: int) -> Any:
        return tuple(spelled(value) for value in values)

    turn = (0, 0, 0, 1)
    scene = trial.scene
    triangles = Triangles(
        np.eye(3, dtype=np.asarray(spelled(1)).dtype),
        np.array([[0, 1, 2]], np.int32 if spelled is float else np.int64),
    )
    mass = MassProperties(spelled(8), numbers(0, 0, 0), numbers(1, 1, 1), np.eye(3, dtype=int))
    rock = replace(
        scene.rock,
        parts=[Box(numbers(1, 1, 2), numbers(0, 0, 1), numbers(*turn))],
        mass=mass,
        start=Pose(numbers(0, 0, 2), numbers(*turn)),
    )
    pedestal = replace(
        scene.pedestal,
        parts=[triangles],
        origin=numbers(0, 0, 1),
        top=spelled(1),
        mass=spelled(500),
        base_size=numbers(1, 1, 1),
        pitch_pivot=spelled(1),
        pitch_spring=PitchSpring(*numbers(8, 1, 0, 40)),
        slope=numbers(1, 0, 0, 0),
    )
    mechanisms = Mechanisms(*numbers(1, 2, 3, 4, 5, 6, 7))
    samples = {name: np.zeros(5, int) for name in ("displacement", "velocity", "acceleration")}
    motion = Motion("rest", spelled(1), **samples, kind="recording", resampling_error=spelled(0))
    made = replace(scene, rock=rock, pedestal=pedestal, mechanisms=mechanisms)
    seed = np.int64(7) if spelled is np.int64 else 7
    start = Pose(np.array(numbers(0, 0, 3)), numbers(*turn))
    return Trial(made, motion, start=start, seed=seed)


@pytest.mark.parametrize("spelled", SPELLED)
def test_a_hash_does_not_depend_on_how_numbers_are_spelled(
    trial: Trial, spelled: Callable[[int], Any]
) -> None:
    plain, other = integers(float, trial), integers(spelled, trial)
    assert other.sha256 == plain.sha256
    assert (other, other.scene, other.motion) == (plain, plain.scene, plain.motion)
    assert len({plain, other}) == len({plain.scene, other.scene}) == 1
    assert repr(other.scene.mechanisms) == repr(plain.scene.mechanisms)
    assert repr(other.start_pose) == repr(plain.start_pose)
    kinds = {type(value) for value in plain_values(other)}
    assert not {kind for kind in kinds if issubclass(kind, np.generic)}


def plain_values(value: Any) -> Iterator[Any]:
    """Values anywhere in dataclasses and tuples that are no arrays."""
    if isinstance(value, tuple):
        for item in value:
            yield from plain_values(item)
    elif hasattr(value, "__dict__"):
        yield from plain_values(tuple(vars(value).values()))
    else:
        yield value


def test_the_indices_of_a_surface_are_kept_in_32_bits() -> None:
    faces = np.array([[0, 1, 2]], np.int64)
    assert Triangles(np.eye(3), faces).faces.dtype == np.int32
    with pytest.raises(GeometryError, match=r"Triangles: faces holds 8589934592 .* 32 bits"):
        Triangles(np.eye(3), faces * 2**32)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (lambda s: replace(s, rock=1), r"Scene: rock is 1; it must be RockBody"),
        (lambda s: replace(s, pedestal=None), r"Scene: pedestal is null; it must be PedestalBody"),
        (lambda s: replace(s, contact={}), r"Scene: contact is \{\}; it must be Contact"),
        (lambda s: replace(s.rock, parts=[1]), r"RockBody: parts\[0\] is 1; .* Hull or Box"),
        (lambda s: replace(s.rock, parts=1), r"RockBody: parts is 1; give a tuple of Hull or Box"),
        (lambda s: replace(s.rock, start=(0, 0, 1)), r"start is \(0, 0, 1\); it must be Pose"),
        (lambda s: replace(s.rock, inertia_from_aabb=1), r"inertia_from_aabb is 1; .* be bool"),
        (lambda s: replace(s.rock, surface=2), r"surface is 2; it must be Triangles or None"),
        (lambda s: replace(s.pedestal, parts=["x"]), r"parts\[0\] is 'x'; .* Box or Triangles"),
        (lambda s: replace(s.pedestal, top="high"), r"PedestalBody: top is not an array"),
        (lambda s: replace(s.pedestal, mass=True), r"PedestalBody: mass is not an array"),
        (lambda s: replace(s.mechanisms, adhesion=1j), r"Mechanisms: adhesion is not an array"),
    ],
)
def test_a_scene_of_anything_else_is_refused(changed: Callable[[Scene], Any], message: str) -> None:
    with pytest.raises(GeometryError, match=message):
        changed(scene_of(BOX))


@pytest.mark.parametrize(
    ("seed", "message"),
    [
        (2**63, r"seed is 9223372036854775808; give at most 9223372036854775807"),
        (np.uint64(2**63), "seed is .*; give at most 9223372036854775807"),
        (-1, "seed is -1; give 0 or more"),
        (1.0, r"seed is 1\.0; give a whole number"),
        (True, "seed is True; give a whole number"),
        (None, "seed is null; give a whole number"),
    ],
)
def test_a_seed_beyond_the_range_of_a_study_is_refused(seed: Any, message: str) -> None:
    plain = Trial(scene_of(BOX), recorded())
    with pytest.raises(SimulationError, match=f"Trial: {message}"):
        replace(plain, seed=seed)
    with pytest.raises(ConfigError, match=message):
        apply_effects([plain], {}, seed=seed)
    with pytest.raises(CampaignError, match=message):
        simulate_campaign([plain], seed=seed)
    with pytest.raises(CampaignError, match=message):
        motion_resamples(["a", "b"], 3, seed=seed)
    with pytest.raises(CampaignError, match=message):
        grouped_folds(np.arange(4), np.zeros(4), 2, seed=seed)
    with pytest.raises(MotionError, match=message):
        shaped_noise(10.0, 2.0, seed)
    with pytest.raises(ResultError, match=message):
        resampled([0.0, 1.0], lambda rows: rows.mean(axis=1), seed=seed)
    nothing: Any = None
    for draw in (
        lambda: drawn_studies(nothing, nothing, 1, seed=seed),
        lambda: compare_reference(nothing, nothing, seed=seed),
        lambda: draw_planted({}, {}, 1, most=1, seed=seed),
    ):
        with pytest.raises(DiagnosisError, match=message):
            draw()
    with pytest.raises(ConfigError, match="seed"):
        Study.from_dict({"rock": BOX, "motion": MOTION, "seed": seed})


@pytest.mark.parametrize("effects", [None, 3, ["restitution"], "restitution"])
def test_effects_of_a_trial_are_those_that_were_applied(effects: Any) -> None:
    with pytest.raises(SimulationError, match=r"effects must be those that `vsr2.apply_effects`"):
        replace(Trial(scene_of(BOX), recorded()), effects=effects)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", [True, np.True_, None, np.ma.masked, 1j, "much"], ids=str)
def test_a_parameter_of_an_effect_is_a_number(value: Any) -> None:
    with pytest.raises(ConfigError, match=r"must be a number \(is"):
        apply_effects([Trial(scene_of(BOX), recorded())], {"restitution": {"energy_ratio": value}})


def test_the_greatest_seed_reaches_the_result() -> None:
    trial = Trial(scene_of(BOX), recorded(), seed=np.uint64(2**63 - 1))
    assert run_batch([trial], threads=1)["seed"].tolist() == [2**63 - 1]


def test_equal_scenes_share_a_native_scene_in_every_thread(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "_kept", type(module._kept)())
    scenes = [pickled(scene_of(BOX)) for _ in range(16)]
    with ThreadPoolExecutor(8) as pool:
        native = list(pool.map(native_scene, scenes))
    assert len({id(one) for one in native}) == 1


def test_native_scenes_are_let_go_of_the_longest_unused_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "_kept", type(module._kept)())
    monkeypatch.setattr(module, "MAX_NATIVE_SCENES", 2)
    plain = scene_of(BOX)
    scenes = [replace(plain, mechanisms=Mechanisms(adhesion=float(i))) for i in range(3)]
    first, second = native_scene(scenes[0]), native_scene(scenes[1])
    assert native_scene(scenes[0]) is first
    native_scene(scenes[2])
    assert native_scene(scenes[0]) is first
    assert native_scene(scenes[1]) is not second
    # A batch of more scenes than are kept runs all the same.
    trials = [Trial(scene, recorded(), output=Output(log_every=5)) for scene in scenes]
    alone = [run_batch([one], threads=1).log(0).state for one in trials]
    for one, log in zip(alone, run_batch(trials, threads=2).logs, strict=True):
        assert log is not None
        assert one.tobytes() == log.state.tobytes()


def test_native_scenes_of_many_points_are_few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_kept", type(module._kept)())
    monkeypatch.setattr(module, "MAX_NATIVE_POINTS", 20)
    corners = list(itertools.product((-0.2, 0.2), (-0.2, 0.2), (-0.5, 0.5)))
    block = scene_of(BOX)
    plain = replace(block, rock=replace(block.rock, parts=(Hull(np.array(corners)),)))
    scenes = [replace(plain, mechanisms=Mechanisms(adhesion=float(i))) for i in range(3)]
    native = [native_scene(scene) for scene in scenes]
    assert list(module._kept) == [scene.sha256 for scene in scenes[1:]]
    assert native_scene(scenes[2]) is native[2]
    monkeypatch.setattr(module, "MAX_NATIVE_POINTS", 1)
    native_scene(scenes[0])
    assert list(module._kept) == [scenes[0].sha256]


def test_an_error_knows_the_key_of_the_study() -> None:
    block = Trial(scene_of(BOX), recorded())
    with pytest.warns(EffectRangeWarning), pytest.raises(GeometryError) as raised:
        apply_effects([block], {"edge_rounding": {"radius": 0.4}})
    assert raised.value.key == "effects.edge_rounding"
    assert str(raised.value).startswith("effects.edge_rounding: a ball of radius 0.4 m")
    assert raised.value.message.startswith("a ball of radius")
    again = pickled(raised.value)
    assert (str(again), again.key) == (str(raised.value), raised.value.key)


def test_an_error_has_parts_and_says_those_it_has() -> None:
    error = pickled(ConfigError("is 5; give 4", key="seed", file=Path("a.yaml"), line=3))
    assert str(error) == "a.yaml:3: seed: is 5; give 4"
    assert (error.file, error.line, error.key) == ("a.yaml", 3, "seed")
    assert error.message == "is 5; give 4"
    assert str(ConfigError("is 5", file="a.yaml")) == "a.yaml: is 5"
    assert str(ConfigError("is 5")) == "is 5"
