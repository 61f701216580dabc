"""Judging whether a mesh bounds one body, and repairing one that does not."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vsr2.codes import Statement
from vsr2.errors import GeometryError
from vsr2.one_line import counted
from vsr2.scene.body import Array
from vsr2.scene.mesh_files import IntArray
from vsr2.scene.notes import SceneNote

MAX_NEAR_PAIRS = 20
"""Pairs of vertices that are merged, over the number of vertices; their list fills memory."""

MIN_EXTENT = 1.0e-4
"""Smallest longest edge of the bounding box [m]."""
EDITORS = "close it in MeshLab (Filters > Remeshing > Close Holes) or Blender (3D-Print Toolbox)"


@dataclass(frozen=True)
class RepairConstants:
    """What a repair takes away; chosen by hand.

    Attributes:
        merged: vertices closer than this share of the bounding box's diagonal are one: some times
            the rounding of files in single precision.
        fragment: loose parts of less than this share of the surface are dropped.
    """

    merged: float = 1.0e-6
    fragment: float = 0.01


REPAIR = RepairConstants()


def compact(vertices: Array, faces: IntArray) -> tuple[Array, IntArray]:
    """Without vertices that no face uses and faces of fewer than three different vertices."""
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    used, renumbered = np.unique(faces, return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 3).astype(np.int64)


def check_faces_left(path: Path, faces: IntArray) -> None:
    """Refuse a mesh of which no face is left.

    Raises:
        GeometryError: there is none.
    """
    if len(faces) == 0:
        raise GeometryError("all faces are without area; export the mesh again", file=path)


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
        directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        low, high = np.sort(directed, axis=1).T
        order = np.lexsort((high, low))
        repeated = (np.diff(low[order]) == 0) & (np.diff(high[order]) == 0)
        edge = np.concatenate([[0], np.cumsum(~repeated)])
        uses = np.bincount(edge)
        forward = np.bincount(edge, weights=directed[order, 0] < directed[order, 1])
        owner = order // 3
        neighbours = np.column_stack([owner[:-1], owner[1:]])[repeated]
        body = _components(neighbours, len(faces))
        return cls(
            open=directed[order[uses[edge] == 1]],
            crowded=int((uses > 2).sum()),
            twisted=int(((uses == 2) & (forward != 1)).sum()),
            body=body,
            bodies=int(body.max()) + 1,
        )

    @property
    def holes(self) -> int:
        """Number of connected chains of open edges."""
        if len(self.open) == 0:
            return 0
        nodes, ends = np.unique(self.open, return_inverse=True)
        return int(_components(ends.reshape(-1, 2), nodes.size).max()) + 1


def _components(edges: IntArray, nodes: int) -> IntArray:
    """Number of the connected part per node, shape (nodes,)."""
    from trimesh.graph import connected_component_labels

    labels = connected_component_labels(edges, nodes)  # type: ignore[no-untyped-call]
    return np.asarray(labels, dtype=np.int64)


def signed_volume(vertices: Array, faces: IntArray) -> float:
    """Volume [m^3] by the divergence theorem; negative where the faces point inwards.

    Only meaningful for a closed surface; the reference point is the centre of the bounding box,
    so that a distant origin costs no digits.
    """
    centred = vertices - 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    a, b, c = (centred[faces[:, corner]] for corner in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def check_solid(path: Path, vertices: Array, faces: IntArray, *, repaired: bool) -> None:
    """Refuse faces that do not bound one closed body with outward normals.

    Raises:
        GeometryError: says what is wrong, and the remedy.
    """
    edges = _Edges.of(faces)
    remedy = f"{EDITORS}, the repair could not" if repaired else f"set `repair: true`, or {EDITORS}"
    if len(edges.open) or edges.crowded:
        crowded = (
            f" and {counted(edges.crowded, 'edge')} of more than two faces" if edges.crowded else ""
        )
        raise GeometryError(
            f"not watertight: {counted(len(edges.open), 'open edge')} in "
            f"{counted(edges.holes, 'hole')}"
            f"{crowded}; mass centre and inertia need a closed surface; {remedy}",
            file=path,
        )
    if edges.bodies > 1:
        shares = np.sort(np.bincount(edges.body))[::-1]
        raise GeometryError(
            f"{edges.bodies} separate bodies ({', '.join(map(str, shares[:4]))} faces ...);"
            " a rock is one body; keep one in a mesh editor, or export parts joined "
            f"(`repair: true` drops parts under {REPAIR.fragment:.0%} of the surface)",
            file=path,
        )
    if edges.twisted:
        raise GeometryError(
            "neighbouring faces disagree about outside and inside at "
            f"{counted(edges.twisted, 'edge')}; set `repair: true`, or recompute normals "
            "(Blender: Recalculate Outside)",
            file=path,
        )
    volume = signed_volume(vertices, faces)
    # A flat surface folded on itself has a volume of rounding errors of this order.
    smallest = 1e-12 * float(np.prod(np.maximum(np.ptp(vertices, axis=0), MIN_EXTENT)))
    if abs(volume) <= smallest:
        raise GeometryError(
            f"the volume is {volume:g} m^3; a rock needs a solid body, not a sheet", file=path
        )
    if volume < 0:
        raise GeometryError(
            f"the volume is negative ({volume:g} m^3): all faces point inwards; "
            "set `repair: true`, or flip the normals (Blender: Mesh > Normals > Flip)",
            file=path,
        )


def repair_mesh(
    path: Path, vertices: Array, faces: IntArray
) -> tuple[Array, IntArray, bool, list[Statement]]:
    """Close and orient a mesh; returns it, whether parts were dropped, and what was done.

    trimesh orients the faces. Its merging and closing are not used. It merges by rounding to a
    grid, which leaves apart near vertices on two sides of a grid line. It closes holes by cycles of
    a graph, which left some open that ours closes (docs/architecture.md, "Kept libraries").
    """
    notes: list[Statement] = []

    def note(code: SceneNote, **values: float) -> None:
        notes.append(Statement.of(code, file=path.name, **values))

    volume_before = signed_volume(vertices, faces)
    count, face_count = len(vertices), len(faces)
    vertices, faces = _merge_near(path, vertices, faces)
    if len(vertices) < count:
        note(SceneNote.MERGED_VERTICES, count=count - len(vertices), tolerance=REPAIR.merged)
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    vertices, faces = compact(vertices, faces[np.sort(first)])
    check_faces_left(path, faces)
    if len(faces) < face_count:
        note(SceneNote.REMOVED_FACES, count=face_count - len(faces))
    vertices, faces, fragments, share = _drop_fragments(vertices, faces)
    if fragments:
        note(SceneNote.REMOVED_PARTS, count=fragments, share=share)
    flipped = _orient(vertices, faces)
    faces, added, holes, widest, vertices = _close_holes(vertices, faces)
    if added:
        note(SceneNote.FILLED_HOLES, holes=holes, faces=added, widest=widest)
    volume = signed_volume(vertices, faces)
    if volume < 0:
        faces, volume = faces[:, ::-1].copy(), -volume
        flipped = len(faces) - added - flipped
    if flipped:
        note(SceneNote.FLIPPED_FACES, count=flipped)
    if notes:
        note(SceneNote.REPAIRED_VOLUME, before=volume_before, after=volume)
    else:
        note(SceneNote.NOTHING_TO_REPAIR)
    return vertices, faces, fragments > 0, notes


def _merge_near(path: Path, vertices: Array, faces: IntArray) -> tuple[Array, IntArray]:
    from scipy.spatial import cKDTree

    tolerance = REPAIR.merged * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    tree = cKDTree(vertices)
    # Counted before it is listed: a crowd within the tolerance has quadratically many pairs.
    if tree.count_neighbors(tree, tolerance) > MAX_NEAR_PAIRS * len(vertices):
        raise GeometryError(
            f"cannot be repaired: most vertices lie closer together than "
            f"{tolerance:g} m; remove the far-off vertices in a mesh editor",
            file=path,
        )
    pairs = tree.query_pairs(tolerance, output_type="ndarray")
    if len(pairs) == 0:
        return vertices, faces
    label = _components(pairs, len(vertices))
    _, representative = np.unique(label, return_index=True)
    return compact(vertices[representative], label[faces])


def _drop_fragments(vertices: Array, faces: IntArray) -> tuple[Array, IntArray, int, float]:
    """Without small loose parts; how many they are, and their share of the surface."""
    from trimesh import triangles

    edges = _Edges.of(faces)
    if edges.bodies == 1:
        return vertices, faces, 0, 0.0
    area = triangles.area(vertices[faces])  # type: ignore[no-untyped-call]
    share = np.bincount(edges.body, weights=area) / max(float(area.sum()), 1e-300)
    small = share < REPAIR.fragment
    if small.all() or not small.any():
        return vertices, faces, 0, 0.0
    vertices, faces = compact(vertices, faces[~small[edges.body]])
    return vertices, faces, int(small.sum()), float(share[small].sum())


def _orient(vertices: Array, faces: IntArray) -> int:
    """Let neighbours agree about the outside, in place; returns how many faces were flipped."""
    import trimesh

    if _Edges.of(faces).twisted == 0:
        return 0
    mesh = trimesh.Trimesh(vertices, faces.copy(), process=False, validate=False)
    trimesh.repair.fix_winding(mesh)  # type: ignore[no-untyped-call]
    oriented = np.array(mesh.faces, dtype=np.int64)
    flipped = int((oriented != faces).any(axis=1).sum())
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
