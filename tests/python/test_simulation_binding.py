"""What the core takes from Python, and what it refuses."""

from __future__ import annotations

import ast
import copy
import gc
import math
import mmap
import pickle
import re
import struct
import weakref
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vsr2 import _native
from vsr2.config.study import Engine, Material, Outcome
from vsr2.errors import ConfigError, Fault, SimulationError
from vsr2.motion import Motion, cosine_motion
from vsr2.read_only import read_only
from vsr2.scene import build_scene
from vsr2.scene.mechanisms import Mechanisms
from vsr2.simulation import native_scene
from vsr2.simulation.native_scenes import refusals
from world_samples import study


def test_the_core_refuses_what_it_would_have_to_convert() -> None:
    corners = np.eye(3)
    with pytest.raises(TypeError, match="float64"):
        _native.TrianglesPart(vertices=corners, faces=np.array([[0.0, 1.0, 2.0]]))
    for wrong in (np.float32, np.longdouble, np.int64, np.uint64, ">f8", str):
        with pytest.raises(TypeError, match="points must be an array of float64"):
            _native.HullPart(points=corners.astype(wrong))
        with pytest.raises(TypeError, match="vertices must be an array of float64"):
            _native.TrianglesPart(vertices=corners.astype(wrong), faces=np.array([[0, 1, 2]]))
    with pytest.raises(TypeError):
        _native.PitchSpring(frequency="8", damping=0.1, compliance=0.0, inertia=1.0)
    with pytest.raises(TypeError):
        _native.PitchSpring(8.0, 0.1, 0.0, 1.0)
    with pytest.raises(TypeError, match="float64"):
        _native.Samples(values=np.zeros(3, dtype=np.float32))
    with pytest.raises(_native.InvalidInput, match=r"faces must be below 2\^63"):
        _native.TrianglesPart(
            vertices=corners, faces=np.array([[0, 1, 2**63 + 1]], dtype=np.uint64)
        )
    for right in (np.uint64, np.int64, np.int32, np.uint8):
        _native.TrianglesPart(vertices=corners, faces=np.array([[0, 1, 2]], dtype=right))


@pytest.mark.parametrize("value", [True, np.True_])
@pytest.mark.parametrize("field", ["gravity", "substeps"])
def test_the_core_takes_no_truth_value_for_a_number(field: str, value: Any) -> None:
    numbers = Engine().model_dump(
        exclude={"mode", "skip", "split_impulse", "split_impulse_penetration_threshold"}
    )
    numbers["skip_quiet"] = True
    _native.EngineSettings(kind=_native.EngineKind.auto, **numbers)
    with pytest.raises(TypeError):
        _native.EngineSettings(kind=_native.EngineKind.auto, **{**numbers, field: value})


@pytest.mark.parametrize("value", [2**53 + 1, -(2**53) - 1, 10**400])
def test_the_core_takes_no_integer_that_a_float_cannot_hold(value: int) -> None:
    spring = {"frequency": 8.0, "damping": 0.1, "compliance": 0.0, "inertia": 1.0}
    for right in (3, 2**53, 2**53 + 2, 2**900):
        _native.PitchSpring(**{**spring, "frequency": right})
    with pytest.raises(TypeError):
        _native.PitchSpring(**{**spring, "frequency": value})
    with pytest.raises(TypeError):
        _native.Batch(threads=1).wait(timeout=value)


@pytest.mark.parametrize("value", [True, np.True_])
def test_no_function_of_the_core_takes_a_truth_value_for_a_number(value: Any) -> None:
    drive, scene = _native.Drive.prescribed_spatial, native_scene(build_scene(study()))
    world, batch = _native.World(scene=scene, drive=drive), _native.Batch(threads=1)
    position, orientation = np.array([0.0, 0.0, 3.0]), np.array([0.0, 0.0, 0.0, 1.0])
    world.spawn_rock(position=position, orientation=orientation)
    rest = {"linear_speed": 1e-3, "angular_speed": 2e-3, "window": 0.25, "timeout": 0.01}
    pose = {"scene": scene, "drive": drive, "position": position, "orientation": orientation}
    target = dict.fromkeys(("position", "velocity", "transverse", "vertical", "pitch"), 0.0)
    taken: list[tuple[Callable[..., Any], dict[str, Any], set[str]]] = [
        (world.step, target, set(target)),
        (world.settle, rest, set(rest)),
        (_native.SettledStart, pose | rest | {"log_every": 0}, {*rest, "log_every"}),
        (_native.Batch, {"threads": 1}, {"threads"}),
        (batch.wait, {"timeout": 0.0}, {"timeout"}),
    ]
    for function, given, numbers in taken:
        function(**given)
        for name in numbers:
            with pytest.raises(TypeError, match=f"{name} must be an? .*, not .*bool"):
                function(**{**given, name: value})
    with pytest.raises(TypeError, match="index must be an integer"):
        batch.take(index=value)
    for name in ("position", "orientation"):
        with pytest.raises(TypeError, match=f"{name} must be an array .* not a value of type list"):
            _native.SettledStart(**pose | rest | {"log_every": 0, name: list(pose[name])})


def arguments() -> list[tuple[Callable[..., Any], dict[str, Any]]]:
    """Everything of the core that takes numbers or arrays, with arguments that it takes."""
    n, three = _native, np.array([0.1, 0.2, 3.0])
    upright, corners = np.array([0.0, 0.0, 0.0, 1.0]), np.eye(3)
    scene, drive = native_scene(build_scene(study())), n.Drive.prescribed_spatial
    world, batch = n.World(scene=scene, drive=drive), n.Batch(threads=1)
    pose = {"position": three, "orientation": upright}
    world.spawn_rock(**pose)
    rest = {"linear_speed": 1e-3, "angular_speed": 2e-3, "window": 0.25, "timeout": 0.01}
    samples = read_only(np.zeros(5))
    material = n.ContactValues(**Material().model_dump())
    spring = {"frequency": 8.0, "damping": 0.1, "compliance": 0.0, "inertia": 1.0}
    engine = Engine().model_dump(
        exclude={"mode", "skip", "split_impulse", "split_impulse_penetration_threshold"}
    )
    start = pose | rest | {"scene": scene, "drive": drive, "log_every": 0}
    body = {"parts": [n.HullPart(points=corners)], "mass": 1.0, "material": material}
    channels = ("motion_position", "motion_velocity", "transverse", "vertical", "pitch")
    return [
        (n.ContactValues, Material().model_dump()),
        (n.EngineSettings, engine | {"kind": n.EngineKind.auto, "skip_quiet": True}),
        (n.HullPart, {"points": corners}),
        (n.BoxPart, pose | {"size": three}),
        (n.TrianglesPart, {"vertices": corners, "faces": np.array([[0, 1, 2]])}),
        (n.PitchSpring, spring),
        (
            n.PedestalSpec,
            body | {"origin": three, "base_size": three, "top": 0.0, "pitch_pivot": 0.0}
            | {"pitch_spring": None},
        ),
        (
            n.RockSpec,
            body | {"principal_inertia": three, "inertia_from_aabb": False}
            | {"mass_center": three, "principal_axes": upright},
        ),
        (n.Mechanisms, asdict(Mechanisms())),
        (n.Samples, {"values": samples}),
        (n.SettledStart, start),
        (
            n.TrialSpec,
            dict.fromkeys(channels) | Outcome().model_dump()
            | {"motion_position": n.Samples(values=samples)}
            | {"start": n.SettledStart(**start), "log_every": 1, "contacts_every": 0},
        ),
        (n.Batch, {"threads": 1}),
        (batch.wait, {"timeout": 0.0}),
        (world.settle, rest),
        (world.set_rock_velocity, {"linear": three, "angular": three}),
        (world.step, dict.fromkeys(("position", "velocity", *channels[2:]), 0.0)),
    ]  # fmt: skip


@pytest.mark.parametrize("known", arguments(), ids=lambda one: one[0].__name__)
def test_neither_masks_nor_shapes_are_lost_on_the_way_to_the_core(
    known: tuple[Callable[..., Any], dict[str, Any]],
) -> None:
    function, given = known
    function(**given)
    for name, value in given.items():
        if isinstance(value, np.ndarray):
            wanted = f"{name} must be an array of .* of shape \\((3|4|n), ?3?\\), not "
            wrong = [value[..., None], value[None], np.array(value.flat[0]), np.ma.array(value)]
        elif isinstance(value, int | float) and not isinstance(value, bool):
            wanted = f"{name} must be an? (float|integer).*, not "
            wrong = [np.array(value), np.array([value]), np.ma.array(value), np.ma.masked]
        else:
            continue
        for one in wrong:
            masked = "a masked" if isinstance(one, np.ma.MaskedArray) else "an"
            got = f"{masked} array of {one.dtype} of shape {re.escape(str(one.shape))}"
            with pytest.raises((TypeError, ValueError), match=wanted + got):
                function(**{**given, name: one})


@pytest.mark.parametrize("known", arguments(), ids=lambda one: one[0].__name__)
def test_the_core_refuses_arguments_by_position(
    known: tuple[Callable[..., Any], dict[str, Any]],
) -> None:
    function, given = known
    if len(given) == 1 and not isinstance(function, type):
        return
    for count in range(1, len(given) + 1):
        names = list(given)
        with pytest.raises(TypeError, match=r"incompatible (function|constructor) arguments"):
            function(*map(given.get, names[:count]), **{k: given[k] for k in names[count:]})


def test_nothing_of_the_core_takes_two_arguments_by_position() -> None:
    tree = ast.parse(Path(_native.__file__).with_name("_native.pyi").read_text())
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    assert len(functions) > 50
    for function in functions:
        given = [arg.arg for arg in function.args.args if arg.arg not in ("self", "cls")]
        if function.name == "__init__":
            assert not given, ast.unparse(function)
        elif function.name != "combine":  # of a pair, in either order
            assert len(given) <= 1, ast.unparse(function)


def test_no_type_of_the_core_that_takes_numbers_or_arrays_is_left_out() -> None:
    known = {function for function, _ in arguments()}
    for name, kind in vars(_native).items():
        taken = str(getattr(kind, "__init__", None).__doc__) if isinstance(kind, type) else ""
        if any(word in taken for word in ("SupportsFloat", "SupportsIndex", "numpy.")):
            assert kind in known, name


def test_a_state_has_a_greatest_number_of_steps() -> None:
    state, drive = _native.WorldState.__new__(_native.WorldState), _native.Drive.prescribed
    most = 10_000_000
    for content in (
        entry(3, most + 1),
        entry(3, 2**62) + entry(3, 2**62),
        entry(3, most) + entry(3, 1),
    ):
        with pytest.raises(_native.InvalidInput, match="more than 10000000 time steps"):
            state.__setstate__((drive, content))
    state.__setstate__((drive, entry(3, most)))


@pytest.mark.parametrize("convert", [list, np.float32])
def test_the_world_takes_arrays_of_float64_alone(convert: Callable[[Any], Any]) -> None:
    world = _native.World(scene=native_scene(build_scene(study())), drive=_native.Drive.prescribed)
    position, orientation = np.array([0.0, 0.0, 3.0]), np.array([0.0, 0.0, 0.0, 1.0])
    pose = {"position": position, "orientation": orientation}
    velocities = {"linear": position, "angular": position}
    for function, given in ((world.spawn_rock, pose), (world.set_rock_velocity, velocities)):
        for name, value in given.items():
            with pytest.raises(TypeError, match=f"{name} must be an array of float64"):
                function(**{**given, name: convert(value)})
        function(**given)


def entry(kind: int, times: int, *values: float) -> bytes:
    """An action as the bytes of a state have it."""
    return struct.pack("2q7d", kind, times, *values, *[0.0] * (7 - len(values)))


@pytest.mark.parametrize(
    "content",
    [
        b"\xff" * 72,
        b"\xff" * 71,
        entry(4, 1),
        entry(-1, 1),
        entry(3, 0),
        entry(3, -1),
        entry(0, 2, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 1.0),
        entry(3, 1, math.nan),
        entry(3, 1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, math.inf),
        "text",
    ],
)
def test_a_state_that_is_none_of_a_world_is_refused(content: Any) -> None:
    drive = _native.Drive.prescribed
    state = _native.WorldState.__new__(_native.WorldState)
    with pytest.raises(_native.InvalidInput, match="not one of a world"):
        state.__setstate__((drive, content))
    with pytest.raises(_native.InvalidInput, match="not one of a world"):
        state.__setstate__((drive,))
    state.__setstate__((drive, entry(3, 2, 0.001)))
    assert state.__getstate__() == (drive, entry(3, 2, 0.001))


def test_errors_of_the_core_carry_a_code() -> None:
    world = _native.World(scene=native_scene(build_scene(study())), drive=_native.Drive.prescribed)
    with pytest.raises(_native.InvalidInput) as caught:
        world.delete_rock()
    assert vars(caught.value) == {"fault": Fault.no_rock}
    with pytest.raises(SimulationError) as reported, refusals("rock"):
        world.delete_rock()
    assert reported.value.fault is Fault.no_rock


def test_samples_are_borrowed_and_given_back() -> None:
    class Lent(np.ndarray):
        """An array that can be referred to weakly."""

    owner = np.zeros(1000)
    owner.setflags(write=False)
    values = owner.view(Lent)
    gone = weakref.ref(values)
    samples = _native.Samples(values=values)
    del values
    assert gone() is not None
    del samples
    gc.collect()
    assert gone() is None


def test_samples_are_lent_only_where_nobody_can_write_to_them() -> None:
    owner, buffer = np.zeros(10), np.frombuffer(bytearray(80))
    view, shown = owner[2:], np.frombuffer(memoryview(bytearray(80)).toreadonly())
    mapped = np.frombuffer(mmap.mmap(-1, 80))
    for array in (view, buffer, mapped):
        array.setflags(write=False)
    for array in (owner, view, buffer, mapped, shown, shown[2:], np.asarray(shown.data)):
        with pytest.raises(_native.InvalidInput, match="must be read-only"):
            _native.Samples(values=array)
        kept = read_only(array)
        assert not np.shares_memory(kept, array)
        _native.Samples(values=kept)
    owner.setflags(write=False)
    lent = np.frombuffer(bytes(80))
    for array in (owner, view, lent, lent[2:], np.asarray(lent.data), np.asarray(owner.data)):
        kept = read_only(array)
        assert np.shares_memory(kept, array)
        _native.Samples(values=kept)
        with pytest.raises(ValueError, match="WRITEABLE"):
            kept.setflags(write=True)


def through_pickle(motion: Motion) -> Motion:
    """As a motion travels to a worker."""
    again = pickle.loads(pickle.dumps(motion, protocol=5))
    assert isinstance(again, Motion)
    return again


def test_a_motion_copies_memory_that_others_can_write_to() -> None:
    given = cosine_motion(0.1, 2.0, 1e-3)
    memory = bytearray(given.displacement.tobytes())
    made = replace(given, displacement=np.frombuffer(memoryview(memory).toreadonly()))
    buffers: list[pickle.PickleBuffer] = []
    pickled = pickle.dumps(made, protocol=5, buffer_callback=buffers.append)
    rebuilt = [bytearray(buffer) for buffer in buffers]
    again = pickle.loads(pickled, buffers=rebuilt)
    kept, digest = given.displacement, given.sha256
    assert rebuilt
    for written in (memory, *rebuilt):
        written[:] = bytes(len(written))
    for motion in (made, again):
        assert np.array_equal(motion.displacement, kept)
        assert motion.sha256 == digest


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, through_pickle])
def test_a_motion_is_lent_without_a_copy(copied: Callable[[Motion], Motion]) -> None:
    motion = copied(cosine_motion(0.1, 2.0, 1e-3))
    for array in (motion.displacement, motion.velocity):
        assert read_only(array) is array
        _native.Samples(values=array)


@pytest.mark.parametrize(
    "table", ["state_columns", "excursion_columns", "contact_columns", "result_columns"]
)
def test_every_column_has_a_unit_a_description_and_a_type(table: str) -> None:
    columns: list[_native.Column] = getattr(_native, table)()
    assert len({column.name for column in columns}) == len(columns)
    for column in columns:
        assert column.description
        assert column.unit not in column.description.split()
        assert not re.search(r"[\[\];]", column.description)
        assert column.dtype in ("float64", "int64", "object")
        assert bool(column.unit) == (column.dtype != "object"), column.name
        if table == "result_columns":
            assert hasattr(_native.TrialResult, column.name)
        else:
            assert column.dtype == "float64"


def test_study_and_core_name_the_same_contact_parameters_in_the_same_units() -> None:
    assert {one.name: one.unit for one in _native.contact_parameters()} == {
        name: "".join(re.findall(r"\[(.+?)\]", field.description or "")[:1])
        for name, field in Material.model_fields.items()
    }


def out_of_range(one: _native.ContactParameter) -> Iterator[float]:
    yield one.least if one.above else math.nextafter(one.least, -math.inf)
    if math.isfinite(one.greatest):
        yield math.nextafter(one.greatest, math.inf)


@pytest.mark.parametrize("one", _native.contact_parameters(), ids=lambda one: one.name)
def test_study_and_core_take_the_same_contact_values(one: _native.ContactParameter) -> None:
    scene = build_scene(study())
    assert getattr(Material(), one.name) == one.usual
    for value in out_of_range(one):
        with pytest.raises(ConfigError, match=one.name):
            Material(**{one.name: value})
        rock = scene.contact.rock.model_copy(update={one.name: value})
        contact = scene.contact.model_copy(update={"rock": rock})
        with pytest.raises(SimulationError, match=f"rock.*{one.name} must be"):
            native_scene(replace(scene, contact=contact))


def test_a_world_needs_a_scene() -> None:
    with pytest.raises(TypeError, match="incompatible"):
        _native.World(scene=None, drive=_native.Drive.prescribed)
