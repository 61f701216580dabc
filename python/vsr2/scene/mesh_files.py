"""Reading mesh files: OBJ by our own reader, STL and PLY by trimesh, all behind bounds.

The OBJ reader is ours because Bullet's hull reduction depends on the order of the file's vertices
and on their duplicates, which trimesh's reader does not keep.
"""

from __future__ import annotations

import io
import re
import warnings
from array import array
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.config.bounded import UnreadableError, read_bounded
from vsr2.config.problems import shown
from vsr2.errors import GeometryError
from vsr2.one_line import counted
from vsr2.scene.body import Array

IntArray = NDArray[np.int64]

MAX_FILE_BYTES = 200_000_000
"""Greater files are refused unread."""
MAX_FACES = 5_000_000
"""Of one mesh; bounds memory and time."""
MAX_COORDINATE = 1.0e30
"""Before scaling; beyond about 3e38 single precision is infinite."""

_STL_VERTEX = re.compile(rb"^[ \t]*vertex\b", re.MULTILINE)


@dataclass(frozen=True, eq=False)
class MeshFile:
    """A file's content.

    Attributes:
        vertices: unscaled, in file order, shape (n, 3).
        faces: triangles of vertex indices in file order, shape (m, 3).
        objects: of an OBJ's objects and groups that have faces, the first face and the one after
            the last.
    """

    vertices: Array
    faces: IntArray
    objects: tuple[tuple[int, int], ...]


def read_mesh_file(path: Path, data: bytes) -> MeshFile:
    """Vertices and triangles of an OBJ, STL or PLY file; polygons of an OBJ are split into fans.

    Args:
        path: names the format by its suffix, and the file in errors.
        data: the file's bytes.

    Raises:
        GeometryError: another suffix, not of the format, no faces, too many, an index outside the
            vertices, or coordinates that are not finite in single precision.
    """
    suffix = path.suffix.lower()
    if suffix == ".obj":
        raw = _read_obj(path, data)
    elif suffix == ".stl":
        _check_stl(path, data)
        raw = _read_by_trimesh(path, data)
    elif suffix == ".ply":
        _check_ply_header(path, data)
        raw = _read_by_trimesh(path, data)
    else:
        raise GeometryError(
            f"meshes of type {suffix or '(no suffix)'} are not read; convert to .obj, .stl or .ply",
            file=path,
        )
    if len(raw.faces) == 0:
        raise GeometryError(
            f"no faces in the file ({len(raw.vertices)} vertices); a point cloud must be "
            "meshed first (MeshLab: Screened Poisson)",
            file=path,
        )
    _check_face_count(path, len(raw.faces))
    low, high = int(raw.faces.min()), int(raw.faces.max())
    if low < 0 or high >= len(raw.vertices):
        row = int(np.flatnonzero((raw.faces < 0) | (raw.faces >= len(raw.vertices)))[0]) // 3
        raise GeometryError(
            f"triangle {row + 1} refers to a vertex outside the "
            f"{len(raw.vertices)} vertices of the file; the file is damaged, export it again",
            file=path,
        )
    _check_finite(path, raw.vertices)
    return raw


def bytes_of(path: Path, limit: int) -> bytes:
    """Bytes of a mesh or URDF file of at most `limit` bytes.

    Raises:
        GeometryError: missing, not a file, unreadable, empty or larger.
    """
    try:
        data = read_bounded(path, limit, remedy="reduce it (a rock needs a few thousand faces)")
    except UnreadableError as error:
        raise GeometryError(str(error), file=path) from None
    if not data.strip():
        raise GeometryError("the file is empty; export the mesh again", file=path)
    return data


def _check_face_count(path: Path, count: int) -> None:
    if count > MAX_FACES:
        raise GeometryError(
            f"more than {MAX_FACES / 1e6:g} million faces; reduce the mesh "
            "(MeshLab: Quadric Edge Collapse Decimation)",
            file=path,
        )


def _read_obj(path: Path, data: bytes) -> MeshFile:
    if b"\0" in data:
        raise GeometryError("not a text file, so not an OBJ; export the mesh again", file=path)
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if b"\\\n" in data:
        data = data.replace(b"\\\n", b" ")
    vertices = array("d")
    corners = array("q")
    starts = [0]
    count = 0
    number, line = 0, b""
    try:
        for line in io.BytesIO(data):
            number += 1
            parts = line.split()
            if not parts:
                continue
            key = parts[0]
            if key == b"v":
                if len(parts) < 4:
                    raise ValueError("a vertex needs three coordinates")
                vertices.extend(map(float, parts[1:4]))
                count += 1
            elif key == b"f":
                if b"/" in line:
                    parts = [part.partition(b"/")[0] for part in parts]
                if len(parts) < 4:
                    raise ValueError("a face needs three vertices")
                polygon = [_vertex_index(int(part), count) for part in parts[1:]]
                if len(polygon) == 3:
                    corners.extend(polygon)
                else:
                    for second, third in pairwise(polygon[1:]):
                        corners.extend((polygon[0], second, third))
                _check_face_count(path, len(corners) // 3)
            elif key in (b"o", b"g"):
                starts.append(len(corners) // 3)
    except (ValueError, OverflowError) as error:
        text = shown(line.strip().decode("utf-8", "replace"))
        raise GeometryError(
            f"line {number}: {text}: {error}; not a valid OBJ, export it again",
            file=path,
        ) from error
    spans = pairwise([*starts, len(corners) // 3])
    return MeshFile(
        vertices=np.array(vertices, dtype=np.float64).reshape(-1, 3),
        faces=np.array(corners, dtype=np.int64).reshape(-1, 3),
        objects=tuple(span for span in spans if span[1] > span[0]),
    )


def _vertex_index(index: int, count: int) -> int:
    """From the file's 1-based or (negative) relative index to a 0-based one."""
    if index > 0:
        return index - 1
    if index == 0 or index < -count:
        raise ValueError(f"there is no vertex {index}")
    return count + index


def _check_stl(path: Path, data: bytes) -> None:
    """Refuse what trimesh would read in part, or as nothing."""
    count = int.from_bytes(data[80:84], "little")
    if len(data) >= 84 and len(data) == 84 + 50 * count:
        return
    text = data.lower()
    if not text.lstrip().startswith(b"solid"):
        raise GeometryError(
            f"not a valid STL: it does not begin with 'solid', and a binary file of "
            f"{count} facets has {84 + 50 * count} bytes, not {len(data)}; export it again",
            file=path,
        )
    *facets, rest = (len(_STL_VERTEX.findall(facet)) for facet in text.split(b"endloop"))
    wrong = next((i for i, corners in enumerate(facets, 1) if corners != 3), None)
    if wrong is not None or rest:
        fault = (
            "the last facet has no end"
            if wrong is None
            else (f"facet {wrong} has {facets[wrong - 1]} vertices, not three")
        )
        raise GeometryError(f"{fault}; not a valid STL, export it again", file=path)


def _check_ply_header(path: Path, data: bytes) -> None:
    """Refuse counts that cannot be true before a reader takes memory for them."""
    header = data[: data.find(b"end_header")] if b"end_header" in data[:100_000] else b""
    if not data.startswith(b"ply") or not header:
        raise GeometryError("no PLY header; not a valid PLY, export it again", file=path)
    for kind, count in re.findall(rb"element[ \t]+(\w+)[ \t]+(\d+)", header):
        if len(count) > 12 or int(count) > len(data):
            raise GeometryError(
                f"the header promises {count[:20].decode()} of {kind.decode()!r}, more than a "
                f"file of {counted(len(data), 'byte')} can hold; export it again",
                file=path,
            )
        if kind == b"face":
            _check_face_count(path, int(count))


def _read_by_trimesh(path: Path, data: bytes) -> MeshFile:
    import trimesh

    kind = path.suffix[1:].lower()
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            # numpy before 2.4 only warns of text that is no number, and leaves the rest of the file
            # unread. The class alone tells that warning, so others of it refuse a file, too.
            warnings.simplefilter("error", DeprecationWarning)
            # Without a resolver nothing but these bytes is read (no textures, no includes).
            loaded: Any = trimesh.load_mesh(
                io.BytesIO(data), file_type=kind, process=False, skip_materials=True
            )
            vertices = np.array(loaded.vertices, dtype=np.float64).reshape(-1, 3)
            faces = np.array(getattr(loaded, "faces", ()), dtype=np.int64).reshape(-1, 3)
    except Exception as error:  # a reader of others may raise anything on broken bytes
        reason = str(error).splitlines()[0][:200] if str(error) else type(error).__name__
        raise GeometryError(
            f"not a valid {kind.upper()} ({reason}); export it again", file=path
        ) from error
    return MeshFile(vertices, faces, ((0, len(faces)),))


def _check_finite(path: Path, vertices: Array) -> None:
    """Refuse coordinates that are no numbers, or none in single precision."""
    bad = np.flatnonzero(~(np.abs(vertices) < MAX_COORDINATE).all(axis=1))
    if bad.size:
        raise GeometryError(
            f"vertex {bad[0] + 1} is {vertices[bad[0]].tolist()}; {bad.size} of "
            f"{len(vertices)} vertices are not finite; remove them or export the mesh again",
            file=path,
        )
