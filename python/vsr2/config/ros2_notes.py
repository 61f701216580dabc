"""What an import of the original's parameter files has to say of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Literal

from vsr2.config.problems import shown
from vsr2.config.ros2_parameters import Parameters

NoteKind = Literal["ignored by the original", "kept as in the original", "not kept", "assumed"]


@dataclass(frozen=True)
class Ros2Note:
    """What an import has to say of one thing."""

    kind: NoteKind
    text: str


HEADINGS: dict[NoteKind, str] = {
    "ignored by the original": "The original ignored in these files",
    "kept as in the original": "Kept as in the original",
    "not kept": "Not kept, VSR2 does otherwise",
    "assumed": "Assumed, for these files do not say",
}

_RECORD_INTERVAL = 0.00125
"""Sampling interval of the original's recordings [s]."""

_NEVER_READ = "no node declares or reads it"
_SPLIT = "handed to PyBullet, but Bullet solves multibody contacts without split impulse"
_NO_PHYSICS = "paces, shows or names the run only; it has no counterpart here"
_IGNORED = [
    ("engineSettings.useSplitImpulse", _SPLIT),
    ("engineSettings.splitImpulsePenetrationThreshold", _SPLIT),
    ("engineSettings.numSubSteps", f"{_NEVER_READ}; PyBullet keeps one step per timeStep"),
    ("engineSettings.pedestal_reset_time", "the control node reads it under another name"),
    ("engineSettings.reset_time", _NEVER_READ),
    ("engineSettings.wait_time", _NEVER_READ),
    ("engineSettings.model_wait_time", _NEVER_READ),
    ("*.rollingFriction", "never handed to PyBullet, where it stays 0"),
    ("dynamics.world_box.*", "read, but never handed to PyBullet"),
    ("structure.world_box.inertia", "read, but never handed to PyBullet"),
    (
        "structure.pedestal.inertia",
        "read, but never handed to PyBullet, which takes the inertia of the box",
    ),
    (
        "structure.pedestal.mesh*",
        "the branch for a mesh pedestal cannot be reached: the pedestal is the box of "
        "structure.pedestal.dimensions (VSR2 can: `pedestal: {shape: mesh, file: ...}`)",
    ),
    (
        "rock_structure_mesh.meshScale",
        "read, but never handed to PyBullet (VSR2 can: `rock.scale`)",
    ),
    (
        "rock_structure_box.rock_orientation",
        "no node declares it; the box always stands unturned",
    ),
    ("rock_structure.*", "an older name, which no node declares"),
    ("simSettings.*", _NO_PHYSICS),
    ("realtime_flag", _NO_PHYSICS),
    ("enable_plotting", _NO_PHYSICS),
    ("recording_folder_name", _NO_PHYSICS),
    ("file_paths.*", "names tables and caches of the original, which VSR2 does not read"),
]


def ignored_notes(p: Parameters, rock: str, missing: Sequence[str]) -> Iterator[Ros2Note]:
    """What the original ignored, what was read otherwise, and what was not given."""
    why: dict[str, list[str]] = {}
    for name in p.given:
        if name in p.used:
            continue
        if rock == "mesh" and name.startswith("rock_structure_box."):
            reason = "no motion mode loads the box rock; the mesh is spawned"
        elif rock == "box" and name.startswith("rock_structure_mesh."):
            reason = "not used by the box rock, which was asked for or found alone"
        elif name in ("engineSettings.loading_wait_time", "engineSettings.response_wait_time"):
            continue
        else:
            reason = next(
                (text for pattern, text in _IGNORED if fnmatchcase(name, pattern)),
                "unknown to the original",
            )
        why.setdefault(reason, []).append(name)
    for reason, names in why.items():
        yield Ros2Note("ignored by the original", f"{', '.join(names)}: {reason}")
    for node in p.foreign:
        yield Ros2Note(
            "ignored by the original",
            f"parameters of node {shown(node)}, which is neither simulation_node nor control_node",
        )
    named = sorted({node for node in p.nodes if not node.endswith("*") and "/" not in node})
    if named:
        yield Ros2Note(
            "ignored by the original",
            f"everything under {', '.join(named)} wherever a launch file runs the node in a "
            "namespace (sim_1, ...): such names fit only a node without one; `/**` fits both",
        )
    if p.integers:
        yield Ros2Note(
            "not kept",
            f"{', '.join(p.integers)}: a whole number, where ROS 2 stops the original for its "
            "declaration wants a decimal one (5.0 for 5); read as such",
        )
    if missing:
        yield Ros2Note(
            "assumed",
            f"not given, so the defaults of `preset: original` serve: {', '.join(missing)}",
        )


def difference_notes(p: Parameters, time_step: float, mode: str) -> Iterator[Ros2Note]:
    """What a run differs in, whatever the files say."""
    yield Ros2Note(
        "kept as in the original",
        "the pedestal is driven by the joint motor (`motion.drive: motor`), which lags by "
        "about nine time steps and attenuates on recordings; `prescribed` has no error",
    )
    if mode in ("single_recording", "all_recordings") and time_step > 0:
        steps = math.floor(_RECORD_INTERVAL / time_step + 1e-9)
        if steps == 0:
            played = "not played at all: the pedestal stands still"
        else:
            factor = _RECORD_INTERVAL / (steps * time_step)
            played = (
                f"played {steps} step(s) a sample, {factor:.4g} times too fast, accelerations "
                f"{factor**2:.4g} times too large"
            )
        yield Ros2Note(
            "not kept",
            f"recordings sampled at 1.25 ms are, at a time step of {time_step:g} s, {played}; "
            "VSR2 resamples them in time",
        )
    for name in ("engineSettings.loading_wait_time", "engineSettings.response_wait_time"):
        if p.has(name):
            yield Ros2Note(
                "not kept",
                f"{name} ({shown(p.given[name].value)} s) is wall time in the original; VSR2 "
                "runs until the rock rests (`settling`, `outcome.tail`)",
            )
    yield Ros2Note(
        "not kept",
        "the original's outcome: |roll change| + |pitch change| of 0.1 rad or more counts as "
        "toppled, and after recordings the time that follows is not simulated; VSR2 follows "
        "the tilt until rest (`outcome`)",
    )
    yield Ros2Note(
        "not kept",
        "the original's reset restores the pose before settling, so that its first trial "
        "differs from the rest; every trial of VSR2 starts alike",
    )
