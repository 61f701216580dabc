"""Writes the models of this folder: `python models/make.py [FOLDER]`.

Everything is drawn from one seed, so that a run reproduces the committed files (coordinates are
rounded to 10 micrometres, which hides the rounding of different maths libraries but for rare ties).
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from vsr2.scene.mass import principal_axes, solid_properties

Array = NDArray[np.float64]
Faces = NDArray[np.int64]

SEED = 20260126
DENSITY = 2650.0
"""Of the boulder, typical of granite [kg/m^3]."""


def relief(directions: Array, rng: np.random.Generator) -> Array:
    """Relative height of a rough boulder over unit directions (n, 3): waves of five octaves.

    Amplitudes fall with the wave number as on fractured rock, whose relief is nearly self-affine.
    """
    height = np.zeros(len(directions))
    for octave in range(5):
        wave_number = 2.0 * 2.0**octave
        for _ in range(12):
            wave = rng.normal(size=3)
            wave *= wave_number / np.linalg.norm(wave)
            phase = rng.uniform(0.0, 2.0 * np.pi)
            height += 0.016 * 0.8**octave * np.cos(directions @ wave + phase)
    return height


def boulder(rng: np.random.Generator) -> tuple[Array, Faces]:
    """A slender boulder, about 1 m tall, on a small flat base [m]."""
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=1.0)
    directions = np.array(sphere.vertices, dtype=np.float64)
    faces = np.array(sphere.faces, dtype=np.int64)
    radius = 1.0 + relief(directions, rng)
    vertices = directions * radius[:, None] * np.array([0.275, 0.305, 0.545])
    # Rock splits along joints: a few oblique planes cut the rounded shape.
    for _ in range(6):
        normal = rng.normal(size=3) * np.array([1.0, 1.0, 0.6])
        normal /= np.linalg.norm(normal)
        reach = (vertices @ normal).max() * rng.uniform(0.86, 0.95)
        excess = np.maximum(vertices @ normal - reach, 0.0)
        # A little of the relief stays on the cut, so that it is no mathematical plane.
        vertices -= 0.93 * excess[:, None] * normal
    # The lower part narrows towards the base, as weathering at ground level leaves it.
    depth = np.clip((-0.05 - vertices[:, 2]) / 0.45, 0.0, 1.0)
    vertices[:, :2] *= (1.0 - 0.22 * depth**1.5)[:, None]
    vertices[:, 2] = np.maximum(vertices[:, 2], -0.435)
    solid = trimesh.Trimesh(vertices, faces, process=False)
    vertices -= np.round(solid_properties(solid)[1], 5)
    return np.round(vertices, 5), faces


def block() -> tuple[Array, Faces]:
    """A plain box of 0.4 x 0.55 x 0.95 m about its centre [m]."""
    box = trimesh.creation.box(extents=(0.4, 0.55, 0.95))
    return np.array(box.vertices, dtype=np.float64), np.array(box.faces, dtype=np.int64)


def topography(rng: np.random.Generator) -> tuple[Array, Faces]:
    """A closed block of 3 x 3 x 0.4 m with a slightly undulating, rough top [m]."""
    cells, length, thickness = 30, 3.0, 0.4
    line = np.linspace(-0.5 * length, 0.5 * length, cells + 1)
    x, y = np.meshgrid(line, line, indexing="ij")
    z = np.full_like(x, thickness)
    for wavelength, amplitude in ((1.6, 0.006), (0.8, 0.0025), (0.35, 0.001)):
        for _ in range(5):
            angle, phase = rng.uniform(0.0, 2.0 * np.pi, size=2)
            along = np.cos(angle) * x + np.sin(angle) * y
            z += amplitude * np.cos(2.0 * np.pi * along / wavelength + phase) / np.sqrt(2.5)
    top = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    number = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b = number[:-1, :-1].ravel(), number[1:, :-1].ravel()
    c, d = number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    faces = [np.column_stack([a, b, c]), np.column_stack([a, c, d])]
    # The rim of the top, anticlockwise seen from above, goes down to the bottom and to its centre.
    rim = np.concatenate([number[:-1, 0], number[-1, :-1], number[:0:-1, -1], number[0, :0:-1]])
    foot = len(top) + np.arange(len(rim))
    hub = len(top) + len(rim)
    following, foot_following = np.roll(rim, -1), np.roll(foot, -1)
    faces += [
        np.column_stack([rim, foot, foot_following]),
        np.column_stack([rim, foot_following, following]),
        np.column_stack([np.full(len(rim), hub), foot_following, foot]),
    ]
    bottom = top[rim] * np.array([1.0, 1.0, 0.0])
    vertices = np.vstack([top, bottom, np.zeros((1, 3))])
    return np.round(vertices, 5), np.vstack(faces)


def write_obj(path: Path, name: str, vertices: Array, faces: Faces) -> None:
    """Write a Wavefront OBJ with five decimals."""
    lines = [f"# Made by models/make.py, seed {SEED}; lengths in metres", f"o {name}"]
    lines += ["v " + " ".join(f"{value + 0.0:.5f}" for value in row) for row in vertices]
    lines += ["f " + " ".join(str(index + 1) for index in row) for row in faces]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def write_urdf(path: Path, mesh_name: str, vertices: Array, faces: Faces) -> None:
    """Write a one-link URDF with the mass properties of the homogeneous boulder."""
    volume, center, unit_tensor = solid_properties(trimesh.Trimesh(vertices, faces, process=False))
    tensor = DENSITY * unit_tensor
    principal_axes(tensor)
    path.write_text(
        f"""<?xml version="1.0" encoding="utf-8"?>
<!-- Made by models/make.py: homogeneous, {DENSITY:g} kg/m^3. -->
<robot name="{path.stem}">
  <link name="rock">
    <inertial>
      <origin xyz="{" ".join(f"{value:.9f}" for value in center)}" rpy="0 0 0"/>
      <mass value="{DENSITY * volume:.9g}"/>
      <inertia ixx="{tensor[0, 0]:.9g}" ixy="{tensor[0, 1]:.9g}" ixz="{tensor[0, 2]:.9g}"
               iyy="{tensor[1, 1]:.9g}" iyz="{tensor[1, 2]:.9g}" izz="{tensor[2, 2]:.9g}"/>
    </inertial>
    <collision>
      <geometry><mesh filename="{mesh_name}" scale="1 1 1"/></geometry>
    </collision>
  </link>
</robot>
""",
        encoding="ascii",
    )


def main(folder: Path) -> None:
    """Write all models into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    boulder_rng, topography_rng = (
        np.random.default_rng(child) for child in np.random.SeedSequence(SEED).spawn(2)
    )
    vertices, faces = boulder(boulder_rng)
    write_obj(folder / "pbr_scan.obj", "pbr_scan", vertices, faces)
    write_urdf(folder / "pbr_scan.urdf", "pbr_scan.obj", vertices, faces)
    write_obj(folder / "block.obj", "block", *block())
    write_obj(
        folder / "pedestal_topography.obj", "pedestal_topography", *topography(topography_rng)
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parent)
