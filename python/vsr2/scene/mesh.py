"""Meshes for collision, mass properties and figures, out of OBJ, STL and PLY files.

The vertices of a collision hull keep the order, duplicates and single precision of the original's
OBJ reader, because Bullet's hull reduction depends on all three; mass properties and figures use
the merged mesh in double precision.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vsr2.codes import Statement
from vsr2.errors import GeometryError
from vsr2.read_only import real_argument, real_array
from vsr2.scene.body import Array, Triangles
from vsr2.scene.mesh_files import MAX_FILE_BYTES, IntArray, MeshFile, bytes_of, read_mesh_file
from vsr2.scene.mesh_repair import (
    MIN_EXTENT,
    check_faces_left,
    check_solid,
    compact,
    repair_mesh,
)
from vsr2.scene.notes import SceneNote

if TYPE_CHECKING:
    import trimesh

Scale = float | tuple[float, float, float]
Mesh = Any
"""A `trimesh.Trimesh`, or vertices of shape (n, 3) [m] and triangles of shape (m, 3)."""

MAX_EXTENT = 1.0e4
"""Greatest edge of the bounding box [m]; beyond it the unit of length is surely wrong."""


@dataclass(frozen=True, eq=False)
class LoadedMesh:
    """A mesh that passed the checks.

    Attributes:
        mesh: trimesh mesh in the model frame [m], duplicates merged, scaled.
        hull_points: of each object of the file, the corners of its faces in file order, with
            duplicates, shape (3 faces, 3) [m]: rounded to single precision before they are
            multiplied by the scale in double precision, as PyBullet reads OBJ files.
        notes: what was changed or should be known.
        source: the file.
        sha256: of the file's bytes.
        scale: factor that was applied.
    """

    mesh: trimesh.Trimesh
    hull_points: tuple[Array, ...]
    notes: tuple[Statement, ...]
    source: str
    sha256: str
    scale: Scale = 1.0

    @property
    def surface(self) -> Triangles:
        """Vertices and faces of the merged mesh, in the model frame."""
        return Triangles(
            vertices=np.array(self.mesh.vertices, dtype=np.float64),
            faces=np.array(self.mesh.faces, dtype=np.int32),
        )


def load_mesh(
    path: str | Path, *, scale: Scale = 1.0, repair: bool = False, closed: bool = True
) -> LoadedMesh:
    """Read an OBJ, STL or PLY file and check that it can be used.

    Exact duplicates of vertices are merged and faces without area between equal vertices removed
    before anything is judged; neither changes the surface, so neither counts as a repair.

    Args:
        path: the file; the suffix names the format.
        scale: factor on the coordinates, or one per axis; they are metres afterwards.
        repair: merge near vertices, drop repeated faces and loose fragments, orient faces, close
            holes; the notes say what was changed.
        closed: ask for one closed, outward-oriented body (a rock). `False` serves open surfaces
            (topography) and collision-only meshes.

    Raises:
        GeometryError: the file is missing, empty, too large, not of its format, holds NaN or
            infinite or absurd coordinates; or (`closed`) it is not watertight, not oriented, has
            no volume or several bodies. Names file and remedy.
    """
    source = Path(path)
    data = bytes_of(source, MAX_FILE_BYTES)
    raw = read_mesh_file(source, data)
    sha256 = hashlib.sha256(data).hexdigest()
    return _checked_mesh(source, raw, sha256, scale=scale, repair=repair, closed=closed)


def mesh_from_arrays(
    mesh: Mesh, *, scale: Scale = 1.0, repair: bool = False, closed: bool = True, name: str = "mesh"
) -> LoadedMesh:
    """Check a mesh in memory as :func:`load_mesh` checks a file.

    Args:
        mesh: a trimesh.Trimesh, or vertices of shape (n, 3) and triangles of vertex indices of
            shape (m, 3).
        scale: as in :func:`load_mesh`.
        repair: likewise.
        closed: likewise.
        name: stands for the file's in errors.

    Raises:
        GeometryError: arrays of another shape or type, an index outside the vertices, or as
            :func:`load_mesh`.
    """
    vertices, faces = _arrays(mesh, name)
    digest = hashlib.sha256(vertices.tobytes() + faces.tobytes()).hexdigest()
    raw = MeshFile(vertices, faces, ((0, len(faces)),))
    return _checked_mesh(Path(name), raw, digest, scale=scale, repair=repair, closed=closed)


def _arrays(mesh: Mesh, name: str) -> tuple[Array, IntArray]:
    """Vertices and faces in memory of their own."""
    if hasattr(mesh, "vertices") and hasattr(mesh, "faces"):
        mesh = mesh.vertices, mesh.faces
    try:
        given_vertices, given_faces = mesh
        vertices = np.array(real_array(np.asarray(given_vertices)), order="C")
        faces = np.asarray(given_faces)
    except (TypeError, ValueError):
        raise GeometryError(
            f"{name}: must be a trimesh.Trimesh, or vertices (n, 3) and triangles (m, 3), and is "
            f"of type {type(mesh).__name__}; for a mesh in a file, name it in the study, or give "
            "`trimesh.load(path)`"
        ) from None
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise GeometryError(
            f"{name}: vertices have shape {vertices.shape} and faces {faces.shape}; they need "
            "(n, 3) and (m, 3)"
        )
    if faces.dtype.kind not in "iu" or not len(faces):
        raise GeometryError(f"{name}: faces must be whole numbers, at least one triangle")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise GeometryError(
            f"{name}: faces name vertices {faces.min()} to {faces.max()}; there are "
            f"{len(vertices)}, counted from 0"
        )
    if not np.isfinite(vertices).all():
        raise GeometryError(f"{name}: a vertex is not finite; repair the mesh")
    return vertices, np.array(faces, dtype=np.int64, order="C")


def _checked_mesh(
    source: Path, raw: MeshFile, sha256: str, *, scale: Scale, repair: bool, closed: bool
) -> LoadedMesh:
    import trimesh

    factors = _check_scale(source, scale)
    vertices = raw.vertices * factors
    _check_vertices(source, vertices)
    notes: list[Statement] = []
    merged, faces = _merge_exact(vertices, raw.faces)
    check_faces_left(source, faces)
    hull_points = _hull_points(raw, factors)
    if repair:
        merged, faces, removed, changes = repair_mesh(source, merged, faces)
        notes.extend(changes)
        if removed:
            # Loose fragments left the body, so they must leave the collision hull as well.
            hull_points = (_single_precision(merged)[faces.ravel()],)
    if closed:
        check_solid(source, merged, faces, repaired=repair)
    if len(hull_points) > 1:
        notes.append(
            Statement.of(SceneNote.SEVERAL_OBJECTS, file=source.name, count=len(hull_points))
        )
    return LoadedMesh(
        mesh=trimesh.Trimesh(merged, faces, process=False, validate=False),
        hull_points=hull_points,
        notes=tuple(notes),
        source=str(source),
        sha256=sha256,
        scale=scale,
    )


def _check_scale(path: Path, scale: Scale) -> Array:
    factors = np.broadcast_to(real_argument(scale, f"{path}: scale", GeometryError), (3,))
    if not (np.isfinite(factors).all() and (factors > 0).all()):
        raise GeometryError(f"scale {scale} must be positive and finite", file=path)
    return factors


def _check_vertices(path: Path, vertices: Array) -> None:
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    extent = float((high - low).max())
    if not extent <= MAX_EXTENT or not max(-low.min(), high.max()) <= 1e3 * MAX_EXTENT:
        raise GeometryError(
            f"the mesh spans {extent:.6g} m between {low.tolist()} and {high.tolist()}; "
            f"more than {MAX_EXTENT:g} m is a mistake in the unit (millimetres: `scale: 0.001`) or "
            "in the origin (move map coordinates close to 0)",
            file=path,
        )
    if extent < MIN_EXTENT:
        raise GeometryError(
            f"the mesh spans {extent:.6g} m; less than {MIN_EXTENT:g} m is a mistake in "
            "the unit; set `scale`",
            file=path,
        )


def _single_precision(vertices: Array) -> Array:
    return vertices.astype(np.float32).astype(np.float64)


def _hull_points(raw: MeshFile, factors: Array) -> tuple[Array, ...]:
    rounded = _single_precision(raw.vertices)
    return tuple(
        np.ascontiguousarray(rounded[raw.faces[start:stop].ravel()] * factors)
        for start, stop in raw.objects
    )


def _merge_exact(vertices: Array, faces: IntArray) -> tuple[Array, IntArray]:
    """Merge equal vertices, drop unused ones and faces between fewer than three different ones."""
    # Adding 0 turns -0.0 into 0.0, which is the same point.
    unique, inverse = np.unique(vertices + 0.0, axis=0, return_inverse=True)
    return compact(unique, inverse.reshape(-1)[faces])
