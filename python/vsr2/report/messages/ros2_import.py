"""Sentences about the import of the original's ROS 2 parameter files."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain
from typing import TYPE_CHECKING

from vsr2.codes import Code
from vsr2.config.ros2_notes import KINDS, Assumed, Ignored, Kept, NotKept
from vsr2.report.messages.templates import check_worded, filled_in

if TYPE_CHECKING:
    from vsr2.codes import Statement
    from vsr2.config import Ros2Import

HEADINGS: Mapping[type[Code], str] = {
    Ignored: "The original ignored in these files",
    Kept: "Kept as in the original",
    NotKept: "Not kept, VSR2 does otherwise",
    Assumed: "Assumed, for these files do not say",
}
check_worded(KINDS, HEADINGS, __name__)

IMPORT_NOTES: Mapping[Code, str] = {
    Ignored.SPLIT_IMPULSE: (
        "{names}: handed to PyBullet, but Bullet solves multibody contacts without split impulse"
    ),
    Ignored.SUBSTEPS: (
        "{names}: no node declares or reads it; PyBullet keeps one step per timeStep"
    ),
    Ignored.OTHER_NAME: "{names}: the control node reads it under another name",
    Ignored.NEVER_READ: "{names}: no node declares or reads it",
    Ignored.ROLLING_FRICTION: "{names}: never handed to PyBullet, where it stays 0",
    Ignored.NOT_HANDED_OVER: "{names}: read, but never handed to PyBullet",
    Ignored.PEDESTAL_INERTIA: (
        "{names}: read, but never handed to PyBullet, which takes the inertia of the box"
    ),
    Ignored.PEDESTAL_MESH: (
        "{names}: the branch for a mesh pedestal cannot be reached: the pedestal is the box of "
        "structure.pedestal.dimensions (VSR2 can: `pedestal: {{shape: mesh, file: ...}}`)"
    ),
    Ignored.MESH_SCALE: "{names}: read, but never handed to PyBullet (VSR2 can: `rock.scale`)",
    Ignored.BOX_ORIENTATION: "{names}: no node declares it; the box always stands unturned",
    Ignored.OLDER_NAME: "{names}: an older name, which no node declares",
    Ignored.NO_PHYSICS: ("{names}: paces, shows or names the run only; it has no counterpart here"),
    Ignored.OTHER_FILES: (
        "{names}: names tables and caches of the original, which VSR2 does not read"
    ),
    Ignored.BOX_NOT_LOADED: "{names}: no motion mode loads the box rock; the mesh is spawned",
    Ignored.MESH_NOT_LOADED: (
        "{names}: not used by the box rock, which was asked for or found alone"
    ),
    Ignored.UNKNOWN: "{names}: unknown to the original",
    Ignored.FOREIGN_NODE: (
        "parameters of node {node}, which is neither simulation_node nor control_node"
    ),
    Ignored.NAMED_NODES: (
        "everything under {names} wherever a launch file runs the node in a namespace (sim_1, "
        "...): such names fit only a node without one; `/**` fits both"
    ),
    Ignored.URDF_MASS: "{name}: read, but never handed to PyBullet; the URDF's mass counts",
    Ignored.OVERWRITTEN_CONTACT: (
        "dynamics.pedestal.* ({names}): overwritten by the rock's when the rock is spawned"
    ),
    Kept.BASE_CENTER: (
        "the base is centred at z = 1 m whatever its height ({height:g} m), so its top is at "
        "{top:g} m; VSR2's base stands on z = 0 and ends there, too"
    ),
    Kept.BOUNDING_BOX_INERTIA: (
        "the rock's inertia is that of its bounding box, for the original loads URDFs without "
        "their inertia (`rock.inertia: aabb`; `mesh` is the right one)"
    ),
    Kept.BOX_CONTACT: (
        "the box rock is loaded by the action load_pbr_action, which leaves the pedestal its own "
        "contact values; no motion mode of the original uses it"
    ),
    Kept.ROCK_CONTACT: "rock and pedestal have the rock's contact values",
    Kept.COSINE_GRID: (
        "the grid of cosines is fixed in its code: PGA 0.1, 0.3, 0.5 g by PGV/PGA 0.1, 0.3, 0.5 "
        "s, with g = 9.807 m/s^2"
    ),
    Kept.BAND_PASS: "recordings drive by displacement after a band-pass of order 3, 0.1-25 Hz",
    Kept.MOTOR: (
        "the pedestal is driven by the joint motor (`motion.drive: motor`), which lags by about "
        "nine time steps and attenuates on recordings; `prescribed` has no error"
    ),
    NotKept.HEAVY_BASE: (
        "a base with mass (structure.world_box.mass) is not fixed in the original; VSR2's always is"
    ),
    NotKept.URDF_FRAME: (
        "rock_position and rock_orientation place the URDF's inertial frame in the original, its "
        "link frame here: the same where its <inertial> has no <origin>"
    ),
    NotKept.BOX_INERTIA: "{name} ({stated} kg m^2): VSR2's box is homogeneous ({solid} kg m^2)",
    NotKept.VELOCITY_RECORDS: (
        "motion_mode earthquake_batch drives velocity records from a pickle, at whole steps a "
        "sample; the original's grid of cosines stands in: set motion"
    ),
    NotKept.TEST_RANGE: (
        "the range of tests ({chosen}): all recordings are taken; narrow motion.pattern"
    ),
    NotKept.NO_TEST_RANGE: (
        "the range of tests (none given): all recordings are taken; narrow motion.pattern"
    ),
    NotKept.INTEGERS: (
        "{names}: a whole number, where ROS 2 stops the original for its declaration wants a "
        "decimal one (5.0 for 5); read as such"
    ),
    NotKept.RECORDINGS_RETIMED: (
        "recordings sampled at 1.25 ms are, at a time step of {time_step:g} s, played {steps} "
        "step(s) a sample, {speed:.4g} times too fast, accelerations {acceleration:.4g} times too "
        "large; VSR2 resamples them in time"
    ),
    NotKept.RECORDINGS_UNPLAYED: (
        "recordings sampled at 1.25 ms are, at a time step of {time_step:g} s, not played at all: "
        "the pedestal stands still; VSR2 resamples them in time"
    ),
    NotKept.WALL_TIME: (
        "{name} ({value} s) is wall time in the original; VSR2 runs until the rock rests "
        "(`settling`, `outcome.tail`)"
    ),
    NotKept.OUTCOME_RULE: (
        "the original's outcome: |roll change| + |pitch change| of 0.1 rad or more counts as "
        "toppled, and after recordings the time that follows is not simulated; VSR2 follows the "
        "tilt until rest (`outcome`)"
    ),
    NotKept.RESET: (
        "the original's reset restores the pose before settling, so that its first trial differs "
        "from the rest; every trial of VSR2 starts alike"
    ),
    Assumed.MESH_FILE: (
        "{file} names no URDF, which is all that the original loads; read as a mesh of {mass}"
    ),
    Assumed.UNTURNED: "no {name}: the model stands unturned",
    Assumed.LOWERED: "no {name}: the rock is lowered onto the pedestal",
    Assumed.COSINE_GOAL: (
        "the original takes amplitude and frequency of a single cosine from an action's goal, not "
        "from a file: set motion.amplitude and motion.frequency instead of these values"
    ),
    Assumed.NO_MODE: (
        "motion_mode is not given (the original takes it at launch): its grid_cosine stands in; "
        "set motion"
    ),
    Assumed.UNKNOWN_MODE: (
        "motion_mode {mode} is none of the original's: its grid_cosine stands in; set motion"
    ),
    Assumed.NO_FOLDER: "no file_paths.folder_path: set the folder of the recordings",
    Assumed.NO_TEST_NUMBER: "no test_no: set motion.file",
    Assumed.PATH_NOT_FOUND: "{name}: {path} is not found from {file}; correct the path",
    Assumed.DEFAULTS: "not given, so the defaults of `preset: original` serve: {names}",
}
"""Templates of the values."""
check_worded(chain(*KINDS), IMPORT_NOTES, __name__)


def import_note(note: Statement) -> str:
    """What an import has to say of one thing."""
    return filled_in(IMPORT_NOTES[note.code], note.values)


def import_text(imported: Ros2Import) -> str:
    """What an import found: the files, then the notes by kind."""
    lines = ["Read " + ", ".join(str(path) for path in imported.files)]
    for kind in KINDS:
        of_kind = [import_note(note) for note in imported.notes if isinstance(note.code, kind)]
        if of_kind:
            lines += ["", f"{HEADINGS[kind]}:", *(f"  - {text}" for text in of_kind)]
    return "\n".join(lines)
