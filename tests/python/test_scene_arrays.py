"""Rocks and pedestals from arrays or a Trimesh instead of a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from vsr2 import Simulation, Study, build_scene, run_batch
from vsr2.errors import GeometryError
from vsr2.simulation import study_trials

BLOCK = trimesh.creation.box(extents=(0.3, 0.3, 0.8))
PLATE = trimesh.creation.box(extents=(2.0, 2.0, 0.4))
MOTION = {"mode": "single_cosine", "pga_g": 0.2, "pgv_pga_s": 0.03}


def study(rock: dict[str, Any], **more: Any) -> Study:
    return Study.from_dict({"rock": rock, "motion": MOTION, **more})


def test_a_mesh_in_memory_is_the_mesh_of_a_file(tmp_path: Path) -> None:
    for name, mesh in (("rock.stl", BLOCK), ("plate.stl", PLATE)):
        mesh.export(tmp_path / name)
    rock = {"shape": "mesh", "file": str(tmp_path / "rock.stl"), "density": 2500.0}
    under = {"shape": "mesh", "file": str(tmp_path / "plate.stl"), "collision": "hull"}
    written = study(rock, pedestal=under)
    # An STL repeats the corners of each face; the order of hull points is the file's.
    soup = trimesh.load(tmp_path / "rock.stl", process=False)
    plate = trimesh.load(tmp_path / "plate.stl", process=False)
    made = build_scene(written, rock=soup, pedestal=(plate.vertices, plate.faces))
    assert made == build_scene(written)
    assert made.rock.source == "rock"


def test_a_study_of_a_box_takes_another_rock_and_pedestal() -> None:
    own = study({"shape": "box", "size": [0.5, 0.5, 0.5], "mass": 100.0})
    scene = build_scene(own, rock=(BLOCK.vertices, BLOCK.faces), pedestal=PLATE)
    assert scene.rock.mass.mass == 100.0
    # of a homogeneous block about the axis along x
    wanted = 100.0 * (0.3**2 + 0.8**2) / 12
    np.testing.assert_allclose(sorted(scene.rock.mass.principal_inertia)[-1], wanted, rtol=1e-9)
    assert scene.pedestal.source == "pedestal"
    result = run_batch(study_trials(own, scene), threads=1)
    assert result["status"][0] == "ok"
    with Simulation(scene) as simulation:
        simulation.settle()
        assert simulation.state.position[2] > 0.4


@pytest.mark.parametrize(
    ("mesh", "words"),
    [
        ((BLOCK.vertices[:, :2], BLOCK.faces), r"rock: vertices have shape \(8, 2\)"),
        ((BLOCK.vertices, BLOCK.faces + 1), "faces name vertices 1 to 8; there are 8"),
        ((BLOCK.vertices, BLOCK.faces.astype(float)), "faces must be whole numbers"),
        ((BLOCK.vertices, BLOCK.faces[:0]), "at least one triangle"),
        ((BLOCK.vertices * np.nan, BLOCK.faces), "not finite"),
        ((BLOCK.vertices * 1e6, BLOCK.faces), "a mistake in the unit"),
        ((BLOCK.vertices, BLOCK.faces[:-1]), "rock: .*watertight|rock: .*open|rock: .*closed"),
        (BLOCK.vertices, "must be a trimesh.Trimesh, or vertices"),
        ("rock.obj", "must be a trimesh.Trimesh, or vertices"),
    ],
)
def test_meshes_that_cannot_be_used_are_refused(mesh: Any, words: str) -> None:
    own = study({"shape": "box", "size": [0.5, 0.5, 0.5], "mass": 100.0})
    with pytest.raises(GeometryError, match=words):
        build_scene(own, rock=mesh)


def test_a_urdf_keeps_its_own_body(tmp_path: Path) -> None:
    (tmp_path / "rock.urdf").write_text("<robot/>")
    own = study({"shape": "urdf", "file": str(tmp_path / "rock.urdf")})
    with pytest.raises(GeometryError, match="its rock is a URDF"):
        build_scene(own, rock=BLOCK)
