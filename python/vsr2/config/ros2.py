"""Importing the parameter files of the original system (VSR2 on ROS 2 and PyBullet).

The files hold ROS 2 parameters: a node's name (or `/**`), `ros__parameters`, and below it groups
with keys in camelCase. What the original does with each key is known from its published sources
(https://github.com/ZhiangChen/virtual_shake_robot_pybullet). The import keeps its physics where
VSR2 can, and says in notes what the original ignored in the files, what is kept, what is not, and
what had to be assumed.

This is about the latest published version, the one that reads `rock_orientation`. Earlier ones
leave the pedestal its own contact values and the rock unturned.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from vsr2.codes import Code, Statement
from vsr2.config.bounded import from_here
from vsr2.config.load import build_study
from vsr2.config.problems import shown
from vsr2.config.ros2_notes import (
    KINDS,
    Assumed,
    Ignored,
    Kept,
    NotKept,
    difference_notes,
    ignored_notes,
)
from vsr2.config.ros2_parameters import Ros2Parameters
from vsr2.config.study import Study
from vsr2.config.yaml_file import KeyPath, nearest_above
from vsr2.errors import ConfigError

_PACKAGE = "virtual_shake_robot_pybullet/"

Keys = dict[str, tuple[str, Callable[[Ros2Parameters, str], Any]]]
"""Parameters of the original: the study's key (dotted) and how the value is read."""

_ENGINE_AND_PEDESTAL: Keys = {
    "engineSettings.gravity": ("engine.gravity", Ros2Parameters.gravity),
    "engineSettings.timeStep": ("engine.time_step", Ros2Parameters.number),
    "engineSettings.numSolverIterations": ("engine.solver_iterations", Ros2Parameters.integer),
    "engineSettings.enableConeFriction": ("engine.cone_friction", Ros2Parameters.flag),
    "engineSettings.deterministicOverlappingPairs": (
        "engine.deterministic_overlapping_pairs",
        Ros2Parameters.flag,
    ),
    "structure.pedestal.dimensions": ("pedestal.size", Ros2Parameters.vector),
    "structure.pedestal.mass": ("pedestal.mass", Ros2Parameters.number),
    "structure.world_box.dimensions": ("pedestal.base.size", Ros2Parameters.vector),
}
_BOX: Keys = {
    "rock_structure_box.dimensions": ("rock.size", Ros2Parameters.vector),
    "rock_structure_box.mass": ("rock.mass", Ros2Parameters.number),
}


@dataclass(frozen=True)
class OriginalsValues:
    """What the original's files do not hold, as its code has it.

    Attributes:
        grid: of cosines, over PGA [g] and over PGV/PGA [s]: least, greatest and step.
        band: of recordings: corners [Hz] and order of the filter.
        pga_g: of a single cosine, whose goal stands in no file [g]; a value to begin with.
        pgv_pga_s: likewise [s].
        inertia: relative error of a box's stated inertia that is rounding and no other body.
    """

    grid: tuple[float, float, float] = (0.1, 0.5, 0.2)
    band: tuple[float, float, int] = (0.1, 25.0, 3)
    pga_g: float = 0.3
    pgv_pga_s: float = 0.3
    inertia: float = 0.01


NOT_STATED = OriginalsValues()
_MATERIAL = {
    "restitution": "restitution",
    "lateralFriction": "lateral_friction",
    "spinningFriction": "spinning_friction",
    "contactStiffness": "stiffness",
    "contactDamping": "damping",
}


def _material_keys(group: str, body: str) -> Keys:
    return {
        f"{group}.{original}": (f"contact.{body}.{key}", Ros2Parameters.number)
        for original, key in _MATERIAL.items()
    }


@dataclass(frozen=True)
class Ros2Import:
    """A study made from parameter files of the original.

    Attributes:
        study: reproduces the original's physics where VSR2 can; the files it names may be missing.
        notes: what the original ignored, what is kept, what is not, what was assumed, by kind:
            codes of `vsr2.config.ros2_notes`, which `vsr2.report.messages.ros2_import` words.
        files: the files read, in order.
    """

    study: Study
    notes: tuple[Statement, ...]
    files: tuple[Path, ...]


def import_ros2(
    paths: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    *,
    rock: Literal["mesh", "box"] | None = None,
) -> Ros2Import:
    """Read parameter files of the original as one study.

    Args:
        paths: one file, or several as they stand in a launch file: where two give the same
            parameter, the later one counts.
        rock: which rock to take where the files describe both; none given: the mesh, as the
            original's motion modes do.

    Raises:
        ConfigError: a file cannot be read, holds no ROS 2 parameters, or values that no study can
            hold; no file describes a rock.
    """
    if isinstance(paths, str | os.PathLike):
        paths = [paths]
    if not paths:
        raise ConfigError("no ROS 2 parameter file given; name at least one")
    parameters = Ros2Parameters()
    for path in paths:
        parameters.read(path)
    return _Importer(parameters, tuple(Path(path) for path in paths), rock).result()


class _Importer:
    """Builds the study section by section, and collects the notes."""

    def __init__(
        self,
        parameters: Ros2Parameters,
        files: tuple[Path, ...],
        rock: Literal["mesh", "box"] | None,
    ) -> None:
        self._parameters = parameters
        self._files = files
        self._label = ", ".join(map(str, files))
        self._notes: list[Statement] = []
        self._data: dict[str, Any] = {
            "name": "imported",
            "preset": "original",
            "pedestal": {"shape": "prism"},
        }
        self._standing: dict[KeyPath, str] = {}
        self._missing: list[str] = []
        self._rock = rock or self._rock_found()

    def result(self) -> Ros2Import:
        self._set_all(_ENGINE_AND_PEDESTAL)
        self._base()
        if self._rock == "mesh":
            self._mesh_rock()
        else:
            self._box_rock()
        self._contact()
        self._data["motion"] = {"drive": "motor", **self._motion()}
        self._notes += ignored_notes(self._parameters, self._rock, self._missing)
        # The notes reckon with values that the study has accepted.
        study = build_study(
            self._data,
            from_here(self._files[0]).parent,
            label=self._label,
            place=lambda path: nearest_above(self._standing, path) or self._label,
            check_files=False,
        )
        step, mode = study.engine.time_step, study.motion.mode
        self._notes += difference_notes(self._parameters, step, mode)
        notes = sorted(self._notes, key=lambda note: KINDS.index(type(note.code)))
        return Ros2Import(study, tuple(notes), self._files)

    def _note(self, code: Code, **values: Any) -> None:
        self._notes.append(Statement.of(code, **values))

    def _set(self, name: str, key: str, read: Callable[[Ros2Parameters, str], Any]) -> None:
        """Set the study's `key` from the parameter `name`, where the files give it."""
        if not self._parameters.has(name):
            self._missing.append(name)
            return
        *above, last = path = tuple(key.split("."))
        self._standing[path] = self._parameters.given[name].place
        section = self._data
        for part in above:
            section = section.setdefault(part, {})
        section[last] = read(self._parameters, name)

    def _set_all(self, keys: Keys) -> None:
        for name, (key, read) in keys.items():
            self._set(name, key, read)

    def _rock_found(self) -> Literal["mesh", "box"]:
        if self._parameters.has("rock_structure_mesh.mesh"):
            return "mesh"
        if self._parameters.has("rock_structure_box.dimensions"):
            return "box"
        raise ConfigError(
            f"{self._label}: no rock; add the file that gives rock_structure_mesh.mesh or "
            "rock_structure_box.dimensions"
        )

    def _base(self) -> None:
        p = self._parameters
        size = self._data["pedestal"].get("base", {}).get("size")
        if size is not None and size[2] != 2.0:
            # The original centres the block at z = 1 whatever its height, and stacks on its top.
            height = size[2]
            size[2] = 1.0 + height / 2
            self._note(Kept.BASE_CENTER, height=height, top=size[2])
        if p.has("structure.world_box.mass") and p.number("structure.world_box.mass") != 0:
            self._note(NotKept.HEAVY_BASE)

    def _mesh_rock(self) -> None:
        p = self._parameters
        file, mass = "rock_structure_mesh.mesh", "rock_structure_mesh.mass"
        if not p.has(file):
            raise ConfigError(f"{self._label}: no {file}; add the file that gives it")
        self._data["rock"] = {}
        self._set(file, "rock.file", lambda _, name: self._file(name))
        self._start("rock_structure_mesh", turned=True)
        rock = self._data["rock"]
        urdf = rock["file"].suffix.lower() == ".urdf"
        rock |= {"shape": "urdf" if urdf else "mesh", "inertia": "aabb"}
        if not urdf:
            self._set(mass, "rock.mass", Ros2Parameters.number)
            self._note(Assumed.MESH_FILE, file=file, mass=mass)
        elif p.has(mass):
            p.used.add(mass)
            self._note(Ignored.URDF_MASS, name=mass)
        self._note(Kept.BOUNDING_BOX_INERTIA)
        if urdf:
            self._note(NotKept.URDF_FRAME)

    def _box_rock(self) -> None:
        p = self._parameters
        if not all(map(p.has, _BOX)):
            raise ConfigError(
                f"{self._label}: a box rock needs {' and '.join(_BOX)}; add the file that gives "
                "them"
            )
        self._data["rock"] = {"shape": "box"}
        self._set_all(_BOX)
        self._note(Kept.BOX_CONTACT)
        inertia = "rock_structure_box.localInertiaDiagonal"
        if p.has(inertia):
            stated = p.vector(inertia)
            square = [edge**2 for edge in self._data["rock"]["size"]]
            mass = self._data["rock"]["mass"]
            solid = [mass / 12 * (sum(square) - square[axis]) for axis in range(3)]
            if any(
                abs(a - b) > NOT_STATED.inertia * abs(b) for a, b in zip(stated, solid, strict=True)
            ):
                self._note(
                    NotKept.BOX_INERTIA, name=inertia, stated=tuple(stated), solid=tuple(solid)
                )
        self._start("rock_structure_box", turned=False)

    def _start(self, group: str, *, turned: bool) -> None:
        p = self._parameters
        lowered = not p.has(f"{group}.rock_position")
        self._data["rock"]["start"] = {"mode": "yaw" if lowered else "pose"}
        if turned and p.has(f"{group}.rock_orientation"):
            key = "base_orientation" if lowered else "orientation"
            self._set(f"{group}.rock_orientation", f"rock.start.{key}", Ros2Parameters.quaternion)
        elif turned:
            self._note(Assumed.UNTURNED, name=f"{group}.rock_orientation")
        if lowered:
            self._note(Assumed.LOWERED, name=f"{group}.rock_position")
        else:
            self._set(f"{group}.rock_position", "rock.start.position", Ros2Parameters.vector)

    def _contact(self) -> None:
        p = self._parameters
        rock = _material_keys(f"rock_structure_{self._rock}", "rock")
        pedestal = _material_keys("dynamics.pedestal", "pedestal")
        self._set_all(rock)
        if self._rock == "box":
            self._set_all(pedestal)
            return
        for name, (key, read) in rock.items():
            if p.has(name):
                self._set(name, key.replace("rock", "pedestal"), read)
        p.used.update(pedestal)
        overwritten = [original for original in _MATERIAL if p.has(f"dynamics.pedestal.{original}")]
        if overwritten:
            self._note(Ignored.OVERWRITTEN_CONTACT, names=tuple(overwritten))
        self._note(Kept.ROCK_CONTACT)

    def _motion(self) -> dict[str, Any]:
        p = self._parameters
        mode = p.text("motion_mode") if p.has("motion_mode") else ""
        if mode in ("single_recording", "all_recordings", "single_recording_range"):
            return self._recordings(mode)
        if mode == "single_cosine":
            self._note(Assumed.COSINE_GOAL)
            return {
                "mode": "single_cosine",
                "pga_g": NOT_STATED.pga_g,
                "pgv_pga_s": NOT_STATED.pgv_pga_s,
            }
        if mode == "earthquake_batch":
            self._note(NotKept.VELOCITY_RECORDS)
        elif not mode:
            self._note(Assumed.NO_MODE)
        elif mode != "grid_cosine":
            self._note(Assumed.UNKNOWN_MODE, mode=shown(mode))
        self._note(Kept.COSINE_GRID)
        grid = dict(zip(("min", "max", "step"), NOT_STATED.grid, strict=True))
        return {"mode": "grid_cosine", "pga_g": grid, "pgv_pga_s": dict(grid)}

    def _recordings(self, mode: str) -> dict[str, Any]:
        p = self._parameters
        if p.has("file_paths.folder_path"):
            folder = self._file("file_paths.folder_path")
        else:
            folder = Path("recordings")
            self._note(Assumed.NO_FOLDER)
        self._note(Kept.BAND_PASS)
        recorded = {
            "channel": "displacement",
            "filter": dict(zip(("low", "high", "order"), NOT_STATED.band, strict=True)),
        }
        if mode == "single_recording":
            number = 0
            if p.has("test_no"):
                number = p.integer("test_no")
            else:
                self._note(Assumed.NO_TEST_NUMBER)
            return {"mode": mode, "file": folder / f"Test{number:03d}.txt", **recorded}
        if mode == "single_recording_range":
            if p.has("test_number_range"):
                self._note(NotKept.TEST_RANGE, chosen=shown(p.text("test_number_range")))
            else:
                self._note(NotKept.NO_TEST_RANGE)
        return {"mode": "all_recordings", "folder": folder, "pattern": "Test*.txt", **recorded}

    def _file(self, name: str) -> Path:
        """The path that parameter `name` gives, found where the original's tree has it."""
        given = self._parameters.given[name]
        text = self._parameters.text(name)
        tail = text.rpartition(_PACKAGE)[2].replace("{{ROS2_WS}}/", "")
        folder = from_here(given.file).parent
        for candidate in (folder / text, folder / tail, folder.parent / tail):
            if os.path.exists(candidate):
                return candidate
        self._note(Assumed.PATH_NOT_FOUND, name=name, path=text, file=str(given.file))
        return Path(text)
