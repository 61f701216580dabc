"""Reading and judging meshes: OBJ, STL, PLY; what is refused, and what a repair changes.

The vertices of a collision hull keep the order, duplicates and single precision of the original's
OBJ reader, because Bullet's hull reduction depends on all three; mass properties and figures use
the merged mesh in double precision.
"""

from __future__ import annotations

import hashlib
import io
import re
import warnings
from array import array
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vsr2.errors import GeometryError
from vsr2.scene.body import Array, Triangles

if TYPE_CHECKING:
    import trimesh

IntArray = NDArray[np.int64]
Scale = float | tuple[float, float, float]

MAX_FILE_BYTES = 200_000_000
MAX_FACES = 5_000_000
MAX_EXTENT = 1.0e4
"""Greatest edge of the bounding box [m]; beyond it the unit of length is surely wrong."""
MAX_COORDINATE = 1.0e30
"""Before scaling; beyond about 3e38 single precision is infinite."""
MIN_EXTENT = 1.0e-4
"""Smallest longest edge of the bounding box [m]."""
MERGE_TOLERANCE = 1.0e-6
"""A repair merges vertices closer than this share of the bounding box's diagonal."""
FRAGMENT_AREA = 0.01
"""A repair drops loose parts of less than this share of the surface."""
EDITORS = "close it in MeshLab (Filters > Remeshing > Close Holes) or Blender (3D-Print Toolbox)"


@dataclass(frozen=True)
class MeshGroup:
    """Faces `start` to `stop` (exclusive) of the file belong to the OBJ object or group `name`."""

    name: str
    start: int
    stop: int


@dataclass(frozen=True, eq=False)
class LoadedMesh:
    """A mesh that passed the checks.

    Attributes:
        mesh: trimesh mesh in the model frame [m], duplicates merged, scaled.
        groups: objects of the file, in its order (before a repair).
        hull_points: per object, the points for its collision hull, shape (k, 3) [m]; see
            :func:`obj_hull_points`.
        notes: what was changed or should be known.
        source: the file.
        sha256: of the file's bytes.
        scale: factor that was applied.
    """

    mesh: trimesh.Trimesh
    groups: tuple[MeshGroup, ...]
    hull_points: tuple[Array, ...]
    notes: tuple[str, ...]
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


@dataclass(frozen=True, eq=False)
class _RawMesh:
    """A file's content: vertices unscaled (n, 3), triangles (m, 3) in file order, groups."""

    vertices: Array
    faces: IntArray
    groups: tuple[MeshGroup, ...]


def load_mesh(
    path: str | Path, *, scale: Scale = 1.0, repair: bool = False, closed: bool = True
) -> LoadedMesh:
    """Read an OBJ, STL or PLY file and check that it can be used.

    Exact duplicates of vertices are merged and faces without area between equal vertices dropped
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
    factors = _check_scale(source, scale)
    data = read_bounded(source, MAX_FILE_BYTES)
    raw = _parse(source, data)
    vertices = raw.vertices * factors
    _check_vertices(source, vertices)
    notes: list[str] = []
    merged, faces = _merge_exact(vertices, raw.faces)
    _check_faces_left(source, faces)
    hull_points = _hull_points(raw, factors)
    if repair:
        merged, faces, dropped, changes = _repair(source, merged, faces)
        notes.extend(changes)
        if dropped:
            # Loose fragments left the body, so they must leave the collision hull as well.
            hull_points = (_single_precision(merged)[faces.ravel()],)
    if closed:
        _check_solid(source, merged, faces, repaired=repair)
    if len(hull_points) > 1:
        notes.append(
            f"{source.name}: {len(hull_points)} objects; the collision shape is the union of "
            "their convex hulls"
        )
    return LoadedMesh(
        mesh=_as_trimesh(merged, faces),
        groups=raw.groups,
        hull_points=hull_points,
        notes=tuple(notes),
        source=str(source),
        sha256=hashlib.sha256(data).hexdigest(),
        scale=scale,
    )


def obj_hull_points(path: str | Path, scale: Scale = 1.0) -> list[Array]:
    """Points of each object's faces in file order, with duplicates, for the collision hull.

    Coordinates are rounded to single precision before they are multiplied by `scale` in double
    precision, and polygons are split into fans, as PyBullet reads OBJ files. STL and PLY files
    give one array in the same form.

    Returns:
        One array of shape (3 faces, 3) [m] per object or group (`o`, `g`) that has faces.

    Raises:
        GeometryError: as :func:`load_mesh` for an open surface.
    """
    source = Path(path)
    factors = _check_scale(source, scale)
    raw = _parse(source, read_bounded(source, MAX_FILE_BYTES))
    _check_vertices(source, raw.vertices * factors)
    return list(_hull_points(raw, factors))


def read_bounded(path: Path, limit: int) -> bytes:
    """Bytes of a file of at most `limit` bytes.

    Raises:
        GeometryError: missing, not a file, unreadable, empty or larger than `limit`; the size is
            looked at before anything is read.
    """
    try:
        if not path.exists():
            raise GeometryError(
                f"{path}: no such file; paths are relative to the file that names them"
            )
        if not path.is_file():
            raise GeometryError(f"{path}: not a file; give the path of the file itself")
        size = path.stat().st_size
        if size > limit:
            raise GeometryError(
                f"{path}: {size / 1e6:.0f} MB, more than the {limit / 1e6:g} MB that are read; "
                "reduce the mesh (a rock needs a few thousand faces)"
            )
        with path.open("rb") as file:
            data = file.read(limit + 1)
    except (OSError, ValueError) as error:
        raise GeometryError(f"{path}: cannot be read ({error}); check path and rights") from error
    if not data.strip():
        raise GeometryError(f"{path}: the file is empty; export the mesh again")
    return data


def _check_scale(path: Path, scale: Scale) -> Array:
    factors = np.broadcast_to(np.asarray(scale, dtype=np.float64), (3,))
    if not (np.isfinite(factors).all() and (factors > 0).all()):
        raise GeometryError(f"{path}: scale {scale} must be positive and finite")
    return factors


def _parse(path: Path, data: bytes) -> _RawMesh:
    suffix = path.suffix.lower()
    if suffix == ".obj":
        raw = _parse_obj(path, data)
    elif suffix == ".stl":
        raw = _parse_stl(path, data)
    elif suffix == ".ply":
        _check_ply_header(path, data)
        raw = _parse_ply(path, data)
    else:
        raise GeometryError(
            f"{path}: meshes of type {suffix or '(no suffix)'} are not read; "
            "convert to .obj, .stl or .ply"
        )
    if len(raw.faces) == 0:
        raise GeometryError(
            f"{path}: no faces in the file ({len(raw.vertices)} vertices); a point cloud must be "
            "meshed first (MeshLab: Screened Poisson)"
        )
    _check_face_count(path, len(raw.faces))
    low, high = int(raw.faces.min()), int(raw.faces.max())
    if low < 0 or high >= len(raw.vertices):
        row = int(np.flatnonzero((raw.faces < 0) | (raw.faces >= len(raw.vertices)))[0]) // 3
        raise GeometryError(
            f"{path}: triangle {row + 1} refers to a vertex outside the "
            f"{len(raw.vertices)} vertices of the file; the file is damaged, export it again"
        )
    _check_finite(path, raw.vertices)
    return raw


def _check_face_count(path: Path, count: int) -> None:
    if count > MAX_FACES:
        raise GeometryError(
            f"{path}: more than {MAX_FACES / 1e6:g} million faces; reduce the mesh "
            "(MeshLab: Quadric Edge Collapse Decimation)"
        )


def _parse_obj(path: Path, data: bytes) -> _RawMesh:
    """Vertices, fan-triangulated faces and groups of a Wavefront OBJ file."""
    if b"\0" in data:
        raise GeometryError(f"{path}: not a text file, so not an OBJ; export the mesh again")
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if b"\\\n" in data:
        data = data.replace(b"\\\n", b" ")
    vertices = array("d")
    corners = array("q")
    groups: list[MeshGroup] = []
    name, start = "", 0
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
                stop = len(corners) // 3
                if stop > start:
                    groups.append(MeshGroup(name, start, stop))
                name, start = b" ".join(parts[1:]).decode("utf-8", "replace"), stop
    except (ValueError, OverflowError) as error:
        raise GeometryError(
            f"{path}: line {number}: {_shown(line)}: {error}; not a valid OBJ, export it again"
        ) from error
    stop = len(corners) // 3
    if stop > start:
        groups.append(MeshGroup(name, start, stop))
    return _RawMesh(
        vertices=np.array(vertices, dtype=np.float64).reshape(-1, 3),
        faces=np.array(corners, dtype=np.int64).reshape(-1, 3),
        groups=tuple(groups),
    )


def _vertex_index(index: int, count: int) -> int:
    """From the file's 1-based or (negative) relative index to a 0-based one."""
    if index > 0:
        return index - 1
    if index == 0 or index < -count:
        raise ValueError(f"there is no vertex {index}")
    return count + index


def _shown(line: bytes) -> str:
    text = line.strip().decode("utf-8", "replace")
    return repr(text if len(text) <= 60 else text[:57] + "...")


def _parse_stl(path: Path, data: bytes) -> _RawMesh:
    """Three vertices per facet, as the file has them; binary or ASCII."""
    count = int.from_bytes(data[80:84], "little")
    if len(data) >= 84 and len(data) == 84 + 50 * count:
        facet = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        facets = np.frombuffer(data, dtype=facet, offset=84)
        with np.errstate(invalid="ignore"):  # signalling NaNs are refused later, with the rest
            vertices = facets["corners"].astype(np.float64).reshape(-1, 3)
    elif data.lstrip()[:5].lower() == b"solid":
        vertices = _ascii_stl_vertices(path, data)
    else:
        raise GeometryError(
            f"{path}: not a valid STL: it does not begin with 'solid', and a binary file of "
            f"{count} facets has {84 + 50 * count} bytes, not {len(data)}; export it again"
        )
    faces = np.arange(len(vertices), dtype=np.int64).reshape(-1, 3)
    return _RawMesh(vertices, faces, (MeshGroup("", 0, len(faces)),))


def _ascii_stl_vertices(path: Path, data: bytes) -> Array:
    values = array("d")
    corners = 0
    number, line = 0, b""
    try:
        for line in io.BytesIO(data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")):
            number += 1
            parts = line.split()
            key = parts[0].lower() if parts else b""
            if key == b"vertex":
                if len(parts) != 4:
                    raise ValueError("a vertex needs three coordinates")
                values.extend(map(float, parts[1:]))
                corners += 1
            elif key == b"endloop":
                if corners != 3:
                    raise ValueError(f"the facet has {corners} vertices, not three")
                corners = 0
        if corners:
            raise ValueError("the last facet has no end")
    except ValueError as error:
        raise GeometryError(
            f"{path}: line {number}: {_shown(line)}: {error}; not a valid STL, export it again"
        ) from error
    return np.array(values, dtype=np.float64).reshape(-1, 3)


def _check_ply_header(path: Path, data: bytes) -> None:
    """Refuse counts that cannot be true before a reader takes memory for them."""
    header = data[: data.find(b"end_header")] if b"end_header" in data[:100_000] else b""
    if not data.startswith(b"ply") or not header:
        raise GeometryError(f"{path}: no PLY header; not a valid PLY, export it again")
    for kind, count in re.findall(rb"element[ \t]+(\w+)[ \t]+(\d+)", header):
        if len(count) > 12 or int(count) > len(data):
            raise GeometryError(
                f"{path}: the header promises {count[:20].decode()} of {kind.decode()!r}, more "
                f"than a file of {len(data)} bytes can hold; export it again"
            )
        if kind == b"face":
            _check_face_count(path, int(count))


def _parse_ply(path: Path, data: bytes) -> _RawMesh:
    import trimesh

    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            # Without a resolver nothing but these bytes is read (no textures, no includes).
            loaded = trimesh.load_mesh(
                io.BytesIO(data), file_type="ply", process=False, skip_materials=True
            )
            vertices = np.array(loaded.vertices, dtype=np.float64).reshape(-1, 3)
            faces = np.array(getattr(loaded, "faces", ()), dtype=np.int64).reshape(-1, 3)
    except Exception as error:  # a reader of others may raise anything on broken bytes
        reason = str(error).splitlines()[0][:200] if str(error) else type(error).__name__
        raise GeometryError(f"{path}: not a valid PLY ({reason}); export it again") from error
    return _RawMesh(vertices, faces, (MeshGroup("", 0, len(faces)),))


def _check_finite(path: Path, vertices: Array) -> None:
    """Refuse coordinates that are no numbers, or none in single precision."""
    bad = np.flatnonzero(~(np.abs(vertices) < MAX_COORDINATE).all(axis=1))
    if bad.size:
        raise GeometryError(
            f"{path}: vertex {bad[0] + 1} is {vertices[bad[0]].tolist()}; {bad.size} of "
            f"{len(vertices)} vertices are not finite; remove them or export the mesh again"
        )


def _check_vertices(path: Path, vertices: Array) -> None:
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    extent = float((high - low).max())
    if not extent <= MAX_EXTENT or not max(-low.min(), high.max()) <= 1e3 * MAX_EXTENT:
        raise GeometryError(
            f"{path}: the mesh spans {extent:.6g} m between {low.tolist()} and {high.tolist()}; "
            f"more than {MAX_EXTENT:g} m is a mistake in the unit (millimetres: `scale: 0.001`) or "
            "in the origin (move map coordinates close to 0)"
        )
    if extent < MIN_EXTENT:
        raise GeometryError(
            f"{path}: the mesh spans {extent:.6g} m; less than {MIN_EXTENT:g} m is a mistake in "
            "the unit; set `scale`"
        )


def _single_precision(vertices: Array) -> Array:
    return vertices.astype(np.float32).astype(np.float64)


def _hull_points(raw: _RawMesh, factors: Array) -> tuple[Array, ...]:
    rounded = _single_precision(raw.vertices)
    return tuple(
        np.ascontiguousarray(rounded[raw.faces[group.start : group.stop].ravel()] * factors)
        for group in raw.groups
    )


def _merge_exact(vertices: Array, faces: IntArray) -> tuple[Array, IntArray]:
    """Merge equal vertices, drop unused ones and faces between fewer than three different ones."""
    # Adding 0 turns -0.0 into 0.0, which is the same point.
    unique, inverse = np.unique(vertices + 0.0, axis=0, return_inverse=True)
    return _compact(unique, inverse.reshape(-1)[faces])


def _compact(vertices: Array, faces: IntArray) -> tuple[Array, IntArray]:
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    used, renumbered = np.unique(faces, return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 3).astype(np.int64)


def _check_faces_left(path: Path, faces: IntArray) -> None:
    if len(faces) == 0:
        raise GeometryError(f"{path}: all faces are without area; export the mesh again")


@dataclass(frozen=True, eq=False)
class _Edges:
    """Edges of a triangle mesh: how often each is used and which faces meet there."""

    open: IntArray
    """Directed edges (k, 2) that belong to one face only."""
    crowded: int
    """Number of edges that belong to more than two faces."""
    twisted: int
    """Number of edges that two faces run through in the same direction."""
    body: IntArray
    """Number of the edge-connected part per face, shape (faces,)."""
    bodies: int

    @classmethod
    def of(cls, faces: IntArray) -> _Edges:
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import connected_components

        directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        number = int(faces.max()) + 1
        low, high = directed.min(axis=1), directed.max(axis=1)
        key = low * number + high
        order = np.argsort(key, kind="stable")
        _, first, counts = np.unique(key[order], return_index=True, return_counts=True)
        forward = np.add.reduceat((directed[order, 0] < directed[order, 1]).astype(int), first)
        owner = order // 3
        same = np.flatnonzero(key[order][1:] == key[order][:-1])
        graph = coo_matrix(
            (np.ones(same.size, dtype=np.int8), (owner[same], owner[same + 1])),
            shape=(len(faces), len(faces)),
        )
        bodies, body = connected_components(graph, directed=False)
        return cls(
            open=directed[order[first[counts == 1]]],
            crowded=int((counts > 2).sum()),
            twisted=int(((counts == 2) & (forward != 1)).sum()),
            body=body.astype(np.int64),
            bodies=int(bodies),
        )

    @property
    def holes(self) -> int:
        """Number of connected chains of open edges."""
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import connected_components

        if len(self.open) == 0:
            return 0
        nodes, ends = np.unique(self.open, return_inverse=True)
        ends = ends.reshape(-1, 2)
        graph = coo_matrix(
            (np.ones(len(ends), dtype=np.int8), (ends[:, 0], ends[:, 1])),
            shape=(nodes.size, nodes.size),
        )
        return int(connected_components(graph, directed=False, return_labels=False))


def signed_volume(vertices: Array, faces: IntArray) -> float:
    """Volume [m^3] by the divergence theorem; negative where the faces point inwards.

    Only meaningful for a closed surface; the reference point is the centre of the bounding box,
    so that a distant origin costs no digits.
    """
    centred = vertices - 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    a, b, c = (centred[faces[:, corner]] for corner in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def _check_solid(path: Path, vertices: Array, faces: IntArray, *, repaired: bool) -> None:
    """Raise unless the faces bound one closed body with outward normals."""
    edges = _Edges.of(faces)
    remedy = f"{EDITORS}, the repair could not" if repaired else f"set `repair: true`, or {EDITORS}"
    if len(edges.open) or edges.crowded:
        crowded = f" and {edges.crowded} edges of more than two faces" if edges.crowded else ""
        raise GeometryError(
            f"{path}: not watertight: {len(edges.open)} open edges in {edges.holes} holes"
            f"{crowded}; mass centre and inertia need a closed surface; {remedy}"
        )
    if edges.bodies > 1:
        shares = np.sort(np.bincount(edges.body))[::-1]
        raise GeometryError(
            f"{path}: {edges.bodies} separate bodies ({', '.join(map(str, shares[:4]))} faces ...);"
            " a rock is one body; keep one in a mesh editor, or export parts joined "
            f"(`repair: true` drops parts under {FRAGMENT_AREA:.0%} of the surface)"
        )
    if edges.twisted:
        raise GeometryError(
            f"{path}: neighbouring faces disagree about outside and inside at {edges.twisted} "
            "edges; set `repair: true`, or recompute normals (Blender: Recalculate Outside)"
        )
    volume = signed_volume(vertices, faces)
    # A flat surface folded on itself has a volume of rounding errors of this order.
    smallest = 1e-12 * float(np.prod(np.maximum(np.ptp(vertices, axis=0), MIN_EXTENT)))
    if abs(volume) <= smallest:
        raise GeometryError(
            f"{path}: the volume is {volume:g} m^3; a rock needs a solid body, not a sheet"
        )
    if volume < 0:
        raise GeometryError(
            f"{path}: the volume is negative ({volume:g} m^3): all faces point inwards; "
            "set `repair: true`, or flip the normals (Blender: Mesh > Normals > Flip)"
        )


def _repair(
    path: Path, vertices: Array, faces: IntArray
) -> tuple[Array, IntArray, bool, list[str]]:
    """Close and orient a mesh; returns it, whether parts were dropped, and what was done."""
    notes: list[str] = []
    volume_before = signed_volume(vertices, faces)
    count, face_count = len(vertices), len(faces)
    vertices, faces = _merge_near(path, vertices, faces)
    if len(vertices) < count:
        notes.append(
            f"repair: merged {count - len(vertices)} vertices closer than "
            f"{MERGE_TOLERANCE:g} of the diagonal"
        )
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    vertices, faces = _compact(vertices, faces[np.sort(first)])
    _check_faces_left(path, faces)
    if len(faces) < face_count:
        notes.append(f"repair: dropped {face_count - len(faces)} repeated or degenerate faces")
    vertices, faces, dropped = _drop_fragments(vertices, faces, notes)
    flipped = _orient(vertices, faces)
    faces, added, holes, widest, vertices = _close_holes(vertices, faces)
    if added:
        notes.append(
            f"repair: filled {holes} holes with {added} faces (widest hole {widest:.3g} m)"
        )
    volume = signed_volume(vertices, faces)
    if volume < 0:
        faces, volume = faces[:, ::-1].copy(), -volume
        flipped = len(faces) - added - flipped
    if flipped:
        notes.append(f"repair: flipped {flipped} faces")
    notes = [f"{path.name}: {note}" for note in notes]
    if notes:
        notes.append(f"{path.name}: repair: volume {volume_before:.6g} -> {volume:.6g} m^3")
    else:
        notes.append(f"{path.name}: repair: nothing to do")
    return vertices, faces, dropped, notes


def _merge_near(path: Path, vertices: Array, faces: IntArray) -> tuple[Array, IntArray]:
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    tolerance = MERGE_TOLERANCE * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    tree = cKDTree(vertices)
    # Counted before it is listed: a crowd within the tolerance has quadratically many pairs.
    if tree.count_neighbors(tree, tolerance) > 20 * len(vertices):
        raise GeometryError(
            f"{path}: cannot be repaired: most vertices lie closer together than "
            f"{tolerance:g} m; remove the far-off vertices in a mesh editor"
        )
    pairs = tree.query_pairs(tolerance, output_type="ndarray")
    if len(pairs) == 0:
        return vertices, faces
    size = len(vertices)
    graph = coo_matrix(
        (np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(size, size)
    )
    _, label = connected_components(graph, directed=False)
    _, representative = np.unique(label, return_index=True)
    return _compact(vertices[representative], label[faces].astype(np.int64))


def _drop_fragments(
    vertices: Array, faces: IntArray, notes: list[str]
) -> tuple[Array, IntArray, bool]:
    edges = _Edges.of(faces)
    if edges.bodies == 1:
        return vertices, faces, False
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    share = np.bincount(edges.body, weights=area) / max(float(area.sum()), 1e-300)
    small = share < FRAGMENT_AREA
    if small.all() or not small.any():
        return vertices, faces, False
    notes.append(
        f"repair: dropped {int(small.sum())} loose parts, {float(share[small].sum()):.2%} of the "
        "surface"
    )
    vertices, faces = _compact(vertices, faces[~small[edges.body]])
    return vertices, faces, True


def _orient(vertices: Array, faces: IntArray) -> int:
    """Let neighbours agree about the outside, in place; returns how many faces were flipped."""
    import trimesh

    if _Edges.of(faces).twisted == 0:
        return 0
    mesh = _as_trimesh(vertices, faces)
    trimesh.repair.fix_winding(mesh)  # type: ignore[no-untyped-call]
    oriented = np.array(mesh.faces, dtype=np.int64)
    # A flipped face lists its vertices in reverse; the cyclic order tells it from a rotated one.
    start = np.argmin(oriented, axis=1)
    rows = np.arange(len(faces))
    successor = oriented[rows, (start + 1) % 3]
    start_before = np.argmin(faces, axis=1)
    flipped = int((faces[rows, (start_before + 1) % 3] != successor).sum())
    faces[:] = oriented
    return flipped


def _close_holes(vertices: Array, faces: IntArray) -> tuple[IntArray, int, int, float, Array]:
    """Fill each hole: a triangle, two, or a fan about the mean of its rim.

    The new vertex lies within the rim's convex hull, so the collision hull does not change.
    """
    edges = _Edges.of(faces)
    loops = _rims(edges.open)
    new_faces: list[tuple[int, int, int]] = []
    new_vertices: list[Array] = []
    widest = 0.0
    for loop in loops:
        rim = vertices[loop]
        widest = max(widest, float(np.linalg.norm(np.ptp(rim, axis=0))))
        if len(loop) == 3:
            new_faces.append((loop[0], loop[1], loop[2]))
        elif len(loop) == 4:
            new_faces += [(loop[0], loop[1], loop[2]), (loop[0], loop[2], loop[3])]
        else:
            hub = len(vertices) + len(new_vertices)
            new_vertices.append(rim.mean(axis=0))
            following = loop[1:] + loop[:1]
            new_faces += [(a, b, hub) for a, b in zip(loop, following, strict=True)]
    if not new_faces:
        return faces, 0, 0, 0.0, vertices
    if new_vertices:
        vertices = np.vstack([vertices, np.array(new_vertices)])
    faces = np.vstack([faces, np.array(new_faces, dtype=np.int64)])
    return faces, len(new_faces), len(loops), widest, vertices


def _rims(open_edges: IntArray) -> list[list[int]]:
    """Simple closed chains of open edges, run through against the direction of their faces."""
    following: dict[int, list[int]] = {}
    for tail, head in open_edges.tolist():
        following.setdefault(head, []).append(tail)
    loops: list[list[int]] = []
    for begin in sorted(following):
        while following[begin]:
            chain, position = [begin], {begin: 0}
            while following.get(chain[-1]):
                node = following[chain[-1]].pop()
                if node in position:
                    # A rim that touches itself is cut into simple loops at the pinch.
                    loop = chain[position[node] :]
                    if len(loop) >= 3:
                        loops.append(loop)
                    for gone in loop[1:]:
                        del position[gone]
                    del chain[position[node] + 1 :]
                else:
                    position[node] = len(chain)
                    chain.append(node)
    return loops


def _as_trimesh(vertices: Array, faces: IntArray) -> trimesh.Trimesh:
    import trimesh

    return trimesh.Trimesh(vertices=vertices, faces=faces, process=False, validate=False)
