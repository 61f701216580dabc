"""Importing ROS 2 parameter files of the original's form (values of our own)."""

import tempfile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsr2 import _native
from vsr2.codes import NUMBERS, Statement
from vsr2.config import dump_study, import_ros2, load_study
from vsr2.config.ros2_notes import KINDS, Assumed, Ignored, Kept, NotKept
from vsr2.errors import ConfigError
from vsr2.report.messages.ros2_import import IMPORT_NOTES, import_note, import_text

ENGINE = """\
/**:
  ros__parameters:
    engineSettings:
      gravity: [0.0, 0.0, -9.8]
      timeStep: 0.0005
      numSolverIterations: 80
      useSplitImpulse: true
      splitImpulsePenetrationThreshold: -0.02
      enableConeFriction: false
      deterministicOverlappingPairs: 0
      numSubSteps: 4
      loading_wait_time: 3.0
"""
TABLE = """\
/**:
  ros__parameters:
    dynamics:
      world_box: {restitution: 0.1, lateralFriction: 0.9}
      pedestal:
        restitution: 0.15
        lateralFriction: 0.45
        spinningFriction: 0.05
        rollingFriction: 0.9
        contactDamping: 300.0
        contactStiffness: 40000.0
    structure:
      world_box: {dimensions: [40.0, 12.0, 2.0], mass: 0.0, inertia: [0.0, 0.0, 0.0]}
      pedestal: {dimensions: [8.0, 6.0, 0.4], mass: 150000.0, inertia: [1.0, 2.0, 3.0]}
"""
BOX = """\
/**:
  ros__parameters:
    rock_structure_box:
      dimensions: [0.6, 0.8, 1.4]
      mass: 1200.0
      restitution: 0.3
      lateralFriction: 0.55
      spinningFriction: 0.2
      contactDamping: 5000.0
      contactStiffness: 700000.0
      localInertiaDiagonal: [260.0, 232.0, 100.0]
      rock_position: [0.0, 0.0, 3.2]
"""
MESH = """\
/**:
  ros__parameters:
    rock_structure_mesh:
      mesh: models/boulder.urdf
      meshScale: [2.0, 2.0, 2.0]
      mass: 410.0
      restitution: 0.25
      lateralFriction: 0.65
      spinningFriction: 0.35
      rollingFriction: 0.1
      contactDamping: 2.0e+4
      contactStiffness: 3e+6
      rock_position: [0.01, -0.02, 2.9]
      rock_orientation: [0.0, 0.0, 0.70711, 0.70711]
"""


@pytest.fixture
def package(tmp_path):
    """A tree as the original's: `config/` beside `models/`."""
    (tmp_path / "config").mkdir()
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "boulder.urdf").write_text("<robot/>")
    return tmp_path


def write(package, *texts):
    paths = [package / "config" / f"{i}.yaml" for i in range(len(texts))]
    for path, text in zip(paths, texts, strict=True):
        path.write_text(text)
    return paths


def values_of(imported):
    """Of the notes by code."""
    return {note.code: note.values for note in imported.notes}


def ignored(imported):
    return [import_note(note) for note in imported.notes if isinstance(note.code, Ignored)]


def test_the_original_physics_is_kept(package):
    study = import_ros2(write(package, ENGINE, TABLE, BOX, MESH)).study
    engine = study.engine
    assert (engine.gravity, engine.time_step, engine.solver_iterations) == (9.8, 0.0005, 80)
    assert (engine.cone_friction, engine.deterministic_overlapping_pairs) == (False, False)
    assert (engine.residual_threshold, engine.substeps) == (0.0, 1)
    assert study.pedestal.shape == "prism"
    assert (study.pedestal.size, study.pedestal.mass) == ((8.0, 6.0, 0.4), 150000.0)
    assert study.pedestal.base.size == (40.0, 12.0, 2.0)
    assert (study.rock.shape, study.rock.inertia, study.rock.scale) == ("urdf", "aabb", 1.0)
    assert study.rock.file == package / "models" / "boulder.urdf"
    assert study.rock.start.position == (0.01, -0.02, 2.9)
    assert study.rock.start.orientation == (0.0, 0.0, 0.70711, 0.70711)
    given = {
        "restitution": 0.25,
        "lateral_friction": 0.65,
        "spinning_friction": 0.35,
        "damping": 2.0e4,
        "stiffness": 3.0e6,
    }
    original = {one.name: one.original for one in _native.contact_parameters()}
    assert study.contact.rock.model_dump() == original | given
    assert study.contact.pedestal == study.contact.rock
    assert study.motion.drive == "motor"
    # Never in the files: PyBullet's own.
    assert (engine.linear_damping, engine.angular_damping) == (0.04, 0.04)


def test_contact_that_no_file_gives_is_the_originals(package):
    rock = MESH.replace("    spinningFriction", "    elsewhere")
    material = import_ros2(write(package, rock)).study.contact.rock
    assert material.spinning_friction == 0.5


@pytest.mark.parametrize(
    ("word", "flag"), [("yes", True), ("On", True), ("no", False), ("OFF", False), ("1", True)]
)
def test_flags_are_read_in_the_words_that_ros_2_takes(package, word, flag):
    engine = ENGINE.replace("enableConeFriction: false", f"enableConeFriction: {word}")
    assert import_ros2(write(package, engine, TABLE, MESH)).study.engine.cone_friction is flag


def test_what_the_original_ignored_is_reported(package):
    reported = "\n".join(ignored(import_ros2(write(package, ENGINE, TABLE, BOX, MESH))))
    for words in (
        "dynamics.pedestal.* (restitution, lateralFriction, spinningFriction, contactStiffness, "
        "contactDamping): overwritten by the rock's",
        "rock_structure_mesh.mass: read, but never handed to PyBullet; the URDF's mass counts",
        "rock_structure_mesh.meshScale: read, but never handed to PyBullet",
        "dynamics.pedestal.rollingFriction, rock_structure_mesh.rollingFriction: never handed",
        "useSplitImpulse, engineSettings.splitImpulsePenetrationThreshold: handed to PyBullet, but",
        "engineSettings.numSubSteps: no node declares",
        "dynamics.world_box.restitution, dynamics.world_box.lateralFriction, structure.world_box."
        "inertia: read, but never handed",
        "structure.pedestal.inertia: read, but never handed",
        "rock_structure_box.dimensions",
    ):
        assert words in reported, words


def test_nothing_is_called_ignored_that_counts(package):
    values = values_of(import_ros2(write(package, ENGINE, TABLE, MESH)))
    names = {
        name.split(".")[-1]
        for code, found in values.items()
        if isinstance(code, Ignored)
        for name in (*found.get("names", ()), found.get("name", ""))
    }
    assert "meshScale" in names
    assert not names & {
        "gravity",
        "timeStep",
        "numSolverIterations",
        "enableConeFriction",
        "deterministicOverlappingPairs",
        "loading_wait_time",
        "dimensions",
        "rock_position",
        "rock_orientation",
    }


def test_keys_the_original_never_knew_are_reported(package):
    extra = "/**:\n  ros__parameters:\n    surprise: 1\n    rock_structure: {mass: 2.0}\n"
    values = values_of(import_ros2(write(package, TABLE, MESH, extra)))
    assert values[Ignored.UNKNOWN] == {"names": ("surprise",)}
    assert values[Ignored.OLDER_NAME] == {"names": ("rock_structure.mass",)}


def test_a_mesh_pedestal_cannot_be_reached(package):
    mesh = "/**:\n  ros__parameters:\n    structure: {pedestal: {mesh: p.obj, meshScale: [1.0]}}\n"
    imported = import_ros2(write(package, TABLE, MESH, mesh))
    assert imported.study.pedestal.shape == "prism"
    names = ("structure.pedestal.mesh", "structure.pedestal.meshScale")
    assert values_of(imported)[Ignored.PEDESTAL_MESH] == {"names": names}


def test_a_box_rock_keeps_the_pedestals_contact(package):
    study = import_ros2(write(package, TABLE, BOX)).study
    assert (study.rock.shape, study.rock.size, study.rock.mass) == ("box", (0.6, 0.8, 1.4), 1200.0)
    assert study.rock.start.position == (0.0, 0.0, 3.2)
    assert study.contact.rock.lateral_friction == 0.55
    assert study.contact.pedestal.lateral_friction == 0.45


def test_the_box_may_be_asked_for_where_both_rocks_are_given(package):
    paths = write(package, TABLE, BOX, MESH)
    assert import_ros2(paths).study.rock.shape == "urdf"
    assert import_ros2(paths, rock="box").study.rock.shape == "box"


def test_a_box_inertia_is_reported_only_where_it_differs_from_the_solids(package):
    # 1200/12 (0.8^2 + 1.4^2) = 260, 1200/12 (0.6^2 + 1.4^2) = 232, 1200/12 (0.6^2 + 0.8^2) = 100.
    solid = import_ros2(write(package, BOX))
    assert NotKept.BOX_INERTIA not in values_of(solid)
    other = import_ros2(write(package, BOX.replace("232.0", "300.0")))
    found = values_of(other)[NotKept.BOX_INERTIA]
    assert found["stated"] == (260.0, 300.0, 100.0)
    assert found["solid"] == pytest.approx((260.0, 232.0, 100.0))


def test_the_base_ends_where_the_original_has_its_top(package):
    # The original centres the block at z = 1 m whatever its height.
    paths = write(package, TABLE.replace("12.0, 2.0]", "12.0, 3.0]"), MESH)
    imported = import_ros2(paths)
    assert imported.study.pedestal.base.size == (40.0, 12.0, 2.5)
    assert values_of(imported)[Kept.BASE_CENTER] == {"height": 3.0, "top": 2.5}


@pytest.mark.parametrize(
    ("time_step", "code", "values"),
    [
        (0.001, NotKept.RECORDINGS_RETIMED, {"steps": 1, "speed": 1.25, "acceleration": 1.5625}),
        (0.00125, NotKept.RECORDINGS_RETIMED, {"steps": 1, "speed": 1.0, "acceleration": 1.0}),
        (0.0005, NotKept.RECORDINGS_RETIMED, {"steps": 2, "speed": 1.25, "acceleration": 1.5625}),
        (0.002, NotKept.RECORDINGS_UNPLAYED, {}),
    ],
)
def test_the_time_base_of_recordings_is_reported(package, time_step, code, values):
    mode = "/**:\n  ros__parameters: {motion_mode: all_recordings}\n"
    engine = ENGINE.replace("0.0005", str(time_step))
    imported = import_ros2(write(package, engine, MESH, mode))
    assert values_of(imported)[code] == pytest.approx({"time_step": time_step, **values})


def test_recordings_use_the_originals_filter_and_folder(package):
    (package / "records").mkdir()
    mode = (
        "/**:\n  ros__parameters: {motion_mode: single_recording, test_no: 12}\n"
        "file_paths: {folder_path: src/virtual_shake_robot_pybullet/records}\n"
    )
    motion = import_ros2(write(package, MESH, mode)).study.motion
    assert motion.mode == "single_recording"
    assert motion.file == package / "records" / "Test012.txt"
    assert (motion.channel, motion.drive) == ("displacement", "motor")
    assert (motion.filter.low, motion.filter.high, motion.filter.order) == (0.1, 25.0, 3)


@pytest.mark.parametrize(
    ("mode", "kind", "code"),
    [
        ("grid_cosine", "grid_cosine", Kept.COSINE_GRID),
        ("single_cosine", "single_cosine", Assumed.COSINE_GOAL),
        ("earthquake_batch", "grid_cosine", NotKept.VELOCITY_RECORDS),
        ("single_recording_range", "all_recordings", NotKept.NO_TEST_RANGE),
        ("nonsense", "grid_cosine", Assumed.UNKNOWN_MODE),
    ],
)
def test_motion_modes(package, mode, kind, code):
    text = f"control_node:\n  ros__parameters: {{motion_mode: {mode}}}\n"
    imported = import_ros2(write(package, MESH, text))
    assert imported.study.motion.mode == kind
    assert code in values_of(imported)


def test_a_missing_motion_mode_is_assumed_and_reported(package):
    imported = import_ros2(write(package, MESH))
    assert imported.study.motion.mode == "grid_cosine"
    assert imported.study.motion.pga_g.count * imported.study.motion.pgv_pga_s.count == 9
    values = values_of(imported)
    assert Assumed.NO_MODE in values
    assert "engineSettings.timeStep" in values[Assumed.DEFAULTS]["names"]


def test_later_files_count(package):
    later = "/**:\n  ros__parameters:\n    rock_structure_mesh.restitution: 0.05\n"
    study = import_ros2(write(package, MESH, later)).study
    assert study.contact.rock.restitution == 0.05


def test_names_of_nodes(package):
    named = "sim_1:\n  simulation_node:\n    " + "\n  ".join(MESH.splitlines()[1:]).strip() + "\n"
    foreign = "camera:\n  ros__parameters: {rate: 3}\n"
    plain = ENGINE.replace("/**", "simulation_node")
    imported = import_ros2(write(package, named, foreign, plain))
    assert imported.study.contact.rock.restitution == 0.25
    values = values_of(imported)
    assert values[Ignored.FOREIGN_NODE] == {"node": "'camera'"}
    assert values[Ignored.NAMED_NODES] == {"names": ("simulation_node",)}
    assert Ignored.UNKNOWN not in values


def test_the_study_is_complete_and_loads_once_its_files_exist(package):
    imported = import_ros2(write(package, ENGINE, TABLE, MESH))
    out = package / "study.yaml"
    out.write_text(dump_study(imported.study, relative_to=package))
    assert "file: models/boulder.urdf" in out.read_text()
    assert load_study(out) == imported.study


def test_placeholders_of_the_workspace_are_understood(package):
    text = MESH.replace("models/b", "'{{ROS2_WS}}/virtual_shake_robot_pybullet/models/b")
    text = text.replace(".urdf", ".urdf'")
    assert import_ros2(write(package, text)).study.rock.file == package / "models" / "boulder.urdf"


def test_a_missing_mesh_is_reported_not_refused(package):
    imported = import_ros2(write(package, MESH.replace("boulder", "gone")))
    assert values_of(imported)[Assumed.PATH_NOT_FOUND]["path"] == "models/gone.urdf"


def test_a_mesh_that_is_no_urdf_takes_the_mass_of_the_file(package):
    rock = import_ros2(write(package, MESH.replace(".urdf", ".obj"))).study.rock
    assert (rock.shape, rock.mass, rock.inertia) == ("mesh", 410.0, "aabb")


def test_the_description_has_all_notes_under_their_headings(package):
    imported = import_ros2(write(package, ENGINE, TABLE, MESH))
    text = import_text(imported)
    assert "0.yaml" in text
    headings = [line for line in text.splitlines() if line.endswith(":")]
    assert headings[0] == "The original ignored in these files:"
    assert len(headings) == 4
    for note in imported.notes:
        assert f"  - {import_note(note)}\n" in f"{text}\n"


def test_every_note_has_a_sentence_with_its_values():
    assert set(IMPORT_NOTES) == {code for kind in KINDS for code in kind}
    samples = {str: ("wear", "wear"), int: (77, "77"), float: (0.0123, "0123"),
               NUMBERS: ((1.5, 2.25), "1.5, 2.25")}  # fmt: skip
    for code in IMPORT_NOTES:
        values = {name: samples[kind][0] for name, kind in code.types.items()}
        text = import_note(Statement.of(code, **values))
        for kind, (_, said) in samples.items():
            wanted = sum(one is kind for one in code.types.values())
            assert text.count(said) == wanted, code


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (ENGINE, "no rock; add the file"),
        ("dynamics: {pedestal: {restitution: 0.1}}\n", "holds no ROS 2 parameters"),
        ("/**: {ros__parameters: 5}\n", "ros__parameters must hold keys (is 5)"),
        (
            MESH.replace("0.25", "lively"),
            "rock_structure_mesh.restitution: must be a number (is 'l",
        ),
        (MESH.replace("0.25", "true"), "rock_structure_mesh.restitution: must be a number (is Tr"),
        (MESH.replace("0.25", ".nan"), "rock_structure_mesh.restitution: must be finite"),
        (MESH.replace("0.25", "1.5"), "contact.rock.restitution: must be at most 1 (is 1.5)"),
        (MESH.replace("2.0e+4", "-1.0"), "contact.rock.damping: must be at least 0 (is -1.0)"),
        (MESH.replace(", 2.9]", "]"), "rock_position: must be a list of 3 numbers"),
        (MESH.replace("models/boulder.urdf", "3"), "rock_structure_mesh.mesh: must be text (is 3)"),
        (MESH.replace("0.0, 0.70711", "0.9, 0.70711"), "rock.start.orientation: is no rotation"),
        (BOX.replace("1200.0", "-1.0"), "rock.mass: must be greater than 0 (is -1.0)"),
        (BOX.replace("mass: 1200.0", ""), "needs rock_structure_box.dimensions and"),
        (MESH + "    engineSettings: {gravity: [1.0, 0.0, -9.8]}\n", "must point down the z axis"),
        (MESH + "    engineSettings: {gravity: [0.0, 0.0, 9.8]}\n", "must point down the z axis"),
        (MESH + "    engineSettings: {numSolverIterations: 1.5}\n", "must be a whole number"),
        (MESH + "    engineSettings: {enableConeFriction: maybe}\n", "must be true or false"),
    ],
)
def test_refusals_name_file_and_parameter(package, text, words):
    with pytest.raises(ConfigError) as caught:
        import_ros2(write(package, text))
    assert words in str(caught.value)
    assert "0.yaml" in str(caught.value)


def test_errors_of_the_study_point_at_the_line_in_the_parameter_file(package):
    (path,) = write(package, MESH.replace("0.65", "-0.65"))
    with pytest.raises(ConfigError) as caught:
        import_ros2(path)
    assert f"{path}:8: contact.rock.lateral_friction: must be at least 0" in str(caught.value)


def test_no_file_is_refused():
    with pytest.raises(ConfigError, match="no ROS 2 parameter file"):
        import_ros2([])


SEED = (
    MESH + ENGINE.split("ros__parameters:\n")[1] + TABLE.split("ros__parameters:\n")[1]
).encode()
PIECES = [b"true", b".nan", b"-1", b"[]", b"{}", b"~", b"3", b"x", b"1e400", b": ", b"- ", b"\0"]


@given(st.data())
def test_any_bytes_give_an_import_or_a_config_error(data):
    content = SEED
    for _ in range(data.draw(st.integers(0, 5))):
        start = data.draw(st.integers(0, len(content)))
        end = min(len(content), start + data.draw(st.integers(0, 20)))
        piece = data.draw(st.one_of(st.sampled_from(PIECES), st.binary(max_size=4)))
        content = content[:start] + piece + content[end:]
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "p.yaml"
        path.write_bytes(content)
        try:
            imported = import_ros2(path)
        except ConfigError:
            return
        assert import_text(imported).startswith("Read ")
        path.write_text(dump_study(imported.study))
        assert load_study(path, check_files=False) == imported.study
