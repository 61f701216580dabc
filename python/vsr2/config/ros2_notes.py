"""What an import of the original's parameter files has to say of them, as codes with values."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase

from vsr2.codes import NAMES, NUMBERS, Code, Statement
from vsr2.config.problems import shown
from vsr2.config.ros2_parameters import Ros2Parameters


class Ignored(Code):
    """What the original ignored in the files; `names` are of parameters."""

    SPLIT_IMPULSE = "split_impulse", {"names": NAMES}
    SUBSTEPS = "substeps", {"names": NAMES}
    OTHER_NAME = "other_name", {"names": NAMES}
    NEVER_READ = "never_read", {"names": NAMES}
    ROLLING_FRICTION = "rolling_friction", {"names": NAMES}
    NOT_HANDED_OVER = "not_handed_over", {"names": NAMES}
    PEDESTAL_INERTIA = "pedestal_inertia", {"names": NAMES}
    PEDESTAL_MESH = "pedestal_mesh", {"names": NAMES}
    MESH_SCALE = "mesh_scale", {"names": NAMES}
    BOX_ORIENTATION = "box_orientation", {"names": NAMES}
    OLDER_NAME = "older_name", {"names": NAMES}
    NO_PHYSICS = "no_physics", {"names": NAMES}
    OTHER_FILES = "other_files", {"names": NAMES}
    BOX_NOT_LOADED = "box_not_loaded", {"names": NAMES}
    MESH_NOT_LOADED = "mesh_not_loaded", {"names": NAMES}
    UNKNOWN = "unknown", {"names": NAMES}
    FOREIGN_NODE = "foreign_node", {"node": str}
    NAMED_NODES = "named_nodes", {"names": NAMES}
    URDF_MASS = "urdf_mass", {"name": str}
    OVERWRITTEN_CONTACT = "overwritten_contact", {"names": NAMES}


class Kept(Code):
    """What is kept as in the original; lengths in [m]."""

    BASE_CENTER = "base_center", {"height": float, "top": float}
    BOUNDING_BOX_INERTIA = "bounding_box_inertia"
    BOX_CONTACT = "box_contact"
    ROCK_CONTACT = "rock_contact"
    COSINE_GRID = "cosine_grid"
    BAND_PASS = "band_pass"
    MOTOR = "motor"


class NotKept(Code):
    """What VSR2 does otherwise; times in [s], moments in [kg m^2]."""

    HEAVY_BASE = "heavy_base"
    URDF_FRAME = "urdf_frame"
    BOX_INERTIA = "box_inertia", {"name": str, "stated": NUMBERS, "solid": NUMBERS}
    VELOCITY_RECORDS = "velocity_records"
    TEST_RANGE = "test_range", {"chosen": str}
    NO_TEST_RANGE = "no_test_range"
    INTEGERS = "integers", {"names": NAMES}
    RECORDINGS_RETIMED = (
        "recordings_retimed",
        {"time_step": float, "steps": int, "speed": float, "acceleration": float},
    )
    RECORDINGS_UNPLAYED = "recordings_unplayed", {"time_step": float}
    WALL_TIME = "wall_time", {"name": str, "value": str}
    OUTCOME_RULE = "outcome_rule"
    RESET = "reset"


class Assumed(Code):
    """What the files do not say."""

    MESH_FILE = "mesh_file", {"file": str, "mass": str}
    UNTURNED = "unturned", {"name": str}
    LOWERED = "lowered", {"name": str}
    COSINE_GOAL = "cosine_goal"
    NO_MODE = "no_mode"
    UNKNOWN_MODE = "unknown_mode", {"mode": str}
    NO_FOLDER = "no_folder"
    NO_TEST_NUMBER = "no_test_number"
    PATH_NOT_FOUND = "path_not_found", {"name": str, "path": str, "file": str}
    DEFAULTS = "defaults", {"names": NAMES}


KINDS: tuple[type[Code], ...] = (Ignored, Kept, NotKept, Assumed)
"""Kinds of notes, in the order of an import's."""

_RECORD_INTERVAL = 0.00125
"""Sampling interval of the original's recordings [s]."""

_IGNORED = [
    ("engineSettings.useSplitImpulse", Ignored.SPLIT_IMPULSE),
    ("engineSettings.splitImpulsePenetrationThreshold", Ignored.SPLIT_IMPULSE),
    ("engineSettings.numSubSteps", Ignored.SUBSTEPS),
    ("engineSettings.pedestal_reset_time", Ignored.OTHER_NAME),
    ("engineSettings.reset_time", Ignored.NEVER_READ),
    ("engineSettings.wait_time", Ignored.NEVER_READ),
    ("engineSettings.model_wait_time", Ignored.NEVER_READ),
    ("*.rollingFriction", Ignored.ROLLING_FRICTION),
    ("dynamics.world_box.*", Ignored.NOT_HANDED_OVER),
    ("structure.world_box.inertia", Ignored.NOT_HANDED_OVER),
    ("structure.pedestal.inertia", Ignored.PEDESTAL_INERTIA),
    ("structure.pedestal.mesh*", Ignored.PEDESTAL_MESH),
    ("rock_structure_mesh.meshScale", Ignored.MESH_SCALE),
    ("rock_structure_box.rock_orientation", Ignored.BOX_ORIENTATION),
    ("rock_structure.*", Ignored.OLDER_NAME),
    ("simSettings.*", Ignored.NO_PHYSICS),
    ("realtime_flag", Ignored.NO_PHYSICS),
    ("enable_plotting", Ignored.NO_PHYSICS),
    ("recording_folder_name", Ignored.NO_PHYSICS),
    ("file_paths.*", Ignored.OTHER_FILES),
]
"""Patterns of parameters that the original ignores; the first that fits counts."""


def ignored_notes(p: Ros2Parameters, rock: str, missing: Sequence[str]) -> Iterator[Statement]:
    """What the original ignored, what was read otherwise, and what was not given."""
    why: dict[Ignored, list[str]] = {}
    for name in p.given:
        if name in p.used:
            continue
        if rock == "mesh" and name.startswith("rock_structure_box."):
            reason = Ignored.BOX_NOT_LOADED
        elif rock == "box" and name.startswith("rock_structure_mesh."):
            reason = Ignored.MESH_NOT_LOADED
        elif name in ("engineSettings.loading_wait_time", "engineSettings.response_wait_time"):
            continue
        else:
            reason = next(
                (code for pattern, code in _IGNORED if fnmatchcase(name, pattern)),
                Ignored.UNKNOWN,
            )
        why.setdefault(reason, []).append(name)
    for reason, names in why.items():
        yield Statement.of(reason, names=tuple(names))
    for node in p.foreign:
        yield Statement.of(Ignored.FOREIGN_NODE, node=shown(node))
    named = sorted({node for node in p.nodes if not node.endswith("*") and "/" not in node})
    if named:
        yield Statement.of(Ignored.NAMED_NODES, names=tuple(named))
    if p.integers:
        yield Statement.of(NotKept.INTEGERS, names=tuple(p.integers))
    if missing:
        yield Statement.of(Assumed.DEFAULTS, names=tuple(missing))


def difference_notes(p: Ros2Parameters, time_step: float, mode: str) -> Iterator[Statement]:
    """What a run differs in, whatever the files say."""
    yield Statement.of(Kept.MOTOR)
    if mode in ("single_recording", "all_recordings") and time_step > 0:
        steps = math.floor(_RECORD_INTERVAL / time_step + 1e-9)
        if steps == 0:
            yield Statement.of(NotKept.RECORDINGS_UNPLAYED, time_step=time_step)
        else:
            factor = _RECORD_INTERVAL / (steps * time_step)
            yield Statement.of(
                NotKept.RECORDINGS_RETIMED,
                time_step=time_step, steps=steps, speed=factor, acceleration=factor**2,
            )  # fmt: skip
    for name in ("engineSettings.loading_wait_time", "engineSettings.response_wait_time"):
        if p.has(name):
            yield Statement.of(NotKept.WALL_TIME, name=name, value=shown(p.given[name].value))
    yield Statement.of(NotKept.OUTCOME_RULE)
    yield Statement.of(NotKept.RESET)
