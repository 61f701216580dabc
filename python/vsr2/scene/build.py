"""From the study's `rock` and `pedestal` to the bodies that the native core takes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib import import_module

import numpy as np

from vsr2.codes import Statement
from vsr2.config.study import (
    BoxRock,
    Contact,
    Engine,
    FixedStart,
    MeshPedestal,
    MeshRock,
    PrismPedestal,
    UrdfRock,
)
from vsr2.errors import GeometryError
from vsr2.scene.body import (
    Array,
    Box,
    Hull,
    MassProperties,
    PedestalBody,
    RockBody,
    Triangles,
)
from vsr2.scene.mass import (
    aabb_mass_properties,
    box_mass_properties,
    mesh_mass_properties,
    solid_properties,
)
from vsr2.scene.mesh import LoadedMesh, load_mesh
from vsr2.scene.mesh_repair import signed_volume
from vsr2.scene.notes import SceneNote
from vsr2.scene.placement import height_above, stands_over, start_pose
from vsr2.scene.rotation import matrix_from_quaternion
from vsr2.scene.shapes import box_surface, hull_surface, join_surfaces
from vsr2.scene.urdf import load_urdf

CONTACT_POINTS = 4
"""Most points in which Bullet lets two convex shapes touch, MANIFOLD_CACHE_SIZE."""
MAX_HULLS = 64
"""Hulls of a convex decomposition."""


@dataclass(frozen=True)
class NoteConstants:
    """From where on a body or its start gets a note, or is refused; chosen by hand.

    Attributes:
        unusual_size: a rock whose longest edge is outside this range gets a note about the unit
            [m].
        high_start: a fixed start farther above the pedestal than this gets a note [m].
        lost_start: a fixed start deeper inside the pedestal than this is refused [m].
        deep_start: a fixed start, or a rest, deeper inside the pedestal than this gets a note [m].
    """

    unusual_size: tuple[float, float] = (0.01, 50.0)
    high_start: float = 0.005
    lost_start: float = 0.1
    deep_start: float = 0.001


NOTES = NoteConstants()


def build_rock(
    rock: BoxRock | MeshRock | UrdfRock,
    pedestal: PedestalBody,
    *,
    clearance: float,
    mesh: LoadedMesh | None = None,
) -> RockBody:
    """The rock with collision parts, mass properties and start pose.

    Args:
        rock: the study's `rock`, its paths resolved.
        pedestal: what it starts on.
        clearance: gap of a lowered start, the sum of both collision margins [m].
        mesh: in place of the file of a mesh.

    Raises:
        GeometryError: a mesh or URDF that cannot be used, properties no body can have, or no
            pedestal under the rock.
    """
    parts: tuple[Hull | Box, ...]
    if isinstance(rock, BoxRock):
        box = Box(size=rock.size)
        parts, surface, source, sha256 = (box,), box_surface(box), "box", ""
        mass = box_mass_properties(rock.size, density=rock.density, mass=rock.mass)
        notes: tuple[Statement, ...] = ()
        from_aabb = False
    elif isinstance(rock, MeshRock):
        loaded = mesh or load_mesh(rock.file, scale=rock.scale, repair=rock.repair)
        parts = tuple(Hull(points) for points in loaded.hull_points)
        surface, source, sha256 = loaded.surface, loaded.source, loaded.sha256
        mass, notes = _mesh_rock_mass(rock, loaded), loaded.notes
        from_aabb = rock.inertia == "aabb"
    else:
        model = load_urdf(rock.file, rock.scale, inertia=rock.inertia)
        parts, surface, source, sha256 = model.parts, model.surface, model.source, model.sha256
        mass, notes = model.mass, model.notes
        from_aabb = model.inertia_from_aabb
    start = start_pose(rock.start, parts, mass, pedestal, clearance=clearance)
    body = RockBody(
        parts=parts,
        mass=mass,
        start=start,
        inertia_from_aabb=from_aabb,
        surface=surface,
        source=source,
        sha256=sha256,
        notes=(*notes, *size_notes(source, np.ptp(surface.vertices, axis=0))),
    )
    _refuse_larger_than_top(body, pedestal)
    start_notes = _start_notes(body, pedestal, fixed=isinstance(rock.start, FixedStart))
    return replace(body, notes=(*body.notes, *start_notes))


def _refuse_larger_than_top(body: RockBody, pedestal: PedestalBody) -> None:
    """Refuse a rock that no prism's top bears: its plan goes beyond the top's edges."""
    top = pedestal.parts[0]
    if not isinstance(top, Box):
        return  # Topography under a rock may be narrower than the rock.
    assert body.surface is not None
    turned = body.surface.vertices @ matrix_from_quaternion(body.start.orientation).T
    plan = np.ptp(turned, axis=0)[:2]
    if (plan > top.size[:2]).any():
        raise GeometryError(
            f"{body.source}: the rock is {plan[0]:.4g} m x {plan[1]:.4g} m in plan, larger than "
            f"the pedestal's top of {top.size[0]:g} m x {top.size[1]:g} m; enlarge pedestal.size, "
            "or, where the unit is not the metre, set rock.scale of a file, change rock.size of a "
            "box, or use `apply_scale` of a Trimesh"
        )


def contact_notes(body: RockBody, contact: Contact, engine: Engine) -> list[Statement]:
    """Says how deep a soft contact lets the rock sink at rest, and whether impacts may gain energy.

    A pair touches in at most four points, each a spring of the pair's stiffness k: the depth is at
    least m g / (4 k).

    An impact at speed u penetrates by at most u dt before a step notices it. That step rebounds by
    e u and undoes erp of the penetration, erp = dt k / (dt k + c): the rock leaves at (e + erp) u
    at most (docs/explanation/contact_model.md).
    """
    pair = contact.pair
    restitution, stiffness, damping = pair.restitution, pair.stiffness, pair.damping
    out = []
    depth = body.mass.mass * engine.gravity / (CONTACT_POINTS * stiffness)
    if depth > NOTES.deep_start:
        values = {"mass": body.mass.mass, "depth": depth, "stiffness": stiffness}
        out.append(Statement.of(SceneNote.SOFT_CONTACT, **values))
    step = engine.time_step / engine.substeps
    undone = step * stiffness / (step * stiffness + damping)
    if restitution > 0 and restitution + undone > 1:
        # At which both sum to 1.
        longest = engine.substeps * (1 - restitution) * damping / (restitution * stiffness)
        values = {"restitution": restitution, "undone": undone, "step": longest}
        out.append(Statement.of(SceneNote.LIVELY_CONTACT, **values))
    return out


def _mesh_rock_mass(rock: MeshRock, loaded: LoadedMesh) -> MassProperties:
    if rock.inertia == "mesh":
        return mesh_mass_properties(
            loaded.mesh, density=rock.density, mass=rock.mass, source=loaded.source
        )
    mass = rock.mass
    if mass is None:
        assert rock.density is not None
        mass = rock.density * solid_properties(loaded.mesh, loaded.source)[0]
    return aabb_mass_properties(mass, loaded.hull_points, loaded.source)


def size_notes(source: str, extents: Array) -> list[Statement]:
    """Says whether a body is so long or so short that its unit may not be the metre.

    Args:
        source: its file, or what it is.
        extents: of its bounding box, shape (3,) [m].
    """
    longest = float(np.max(extents))
    if NOTES.unusual_size[0] <= longest <= NOTES.unusual_size[1]:
        return []
    return [Statement.of(SceneNote.UNUSUAL_SIZE, file=source, length=longest)]


def _start_notes(body: RockBody, pedestal: PedestalBody, *, fixed: bool) -> list[Statement]:
    notes = []
    rotation = matrix_from_quaternion(body.start.orientation)
    center = rotation @ body.mass.mass_center + np.asarray(body.start.position)
    if not stands_over(pedestal, float(center[0]), float(center[1])):
        x, y = float(center[0]), float(center[1])
        notes.append(Statement.of(SceneNote.BESIDE_PEDESTAL, x=x, y=y))
    height = height_above(body.parts, body.start, pedestal) if fixed else None
    if height is not None and height > NOTES.high_start:
        notes.append(Statement.of(SceneNote.ABOVE_PEDESTAL, height=height))
    if height is not None and height < -NOTES.deep_start:
        if height < -NOTES.lost_start:
            raise GeometryError(
                f"start: {-height:.4g} m inside the pedestal; raise `position`, or use `mode: yaw`"
            )
        notes.append(Statement.of(SceneNote.INSIDE_PEDESTAL, depth=-height))
    return notes


def build_pedestal(
    pedestal: PrismPedestal | MeshPedestal, *, mesh: LoadedMesh | None = None
) -> PedestalBody:
    """The pedestal with collision parts in its frame P.

    A prism's P lies in its centre. A mesh is shifted along z only: its lowest point stands on the
    base, in whose top face P's origin lies, at x = y = 0 of the file.

    Which collision serves when: `triangles` keeps the surface exactly, as an open or closed mesh
    (topography); `hull` is fastest and right for a pedestal without hollows; `decomposition`
    (several hulls, from a closed mesh) keeps larger hollows at the speed of hulls, not fine relief.

    Args:
        pedestal: the study's `pedestal`, its paths resolved.
        mesh: in place of the file of a mesh.

    Raises:
        GeometryError: a mesh that cannot be used, or not over the base; for `decomposition` a mesh
            that is not closed, or the optional package missing.
    """
    base = pedestal.base.size
    if isinstance(pedestal, PrismPedestal):
        box = Box(size=pedestal.size)
        return PedestalBody(
            parts=(box,),
            origin=(0.0, 0.0, base[2] + 0.5 * pedestal.size[2]),
            top=base[2] + pedestal.size[2],
            mass=pedestal.mass,
            base_size=base,
            source="prism",
            surface=box_surface(box),
        )
    closed = pedestal.collision == "decomposition"
    try:
        loaded = mesh or load_mesh(pedestal.file, scale=pedestal.scale, closed=closed)
    except GeometryError as error:
        if not closed:
            raise
        raise GeometryError(f"{error}; or choose `collision: triangles` or `hull`") from error
    surface = loaded.surface
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    half = 0.5 * np.asarray(base)
    if (high < -half)[:2].any() or (low > half)[:2].any():
        raise GeometryError(
            f"{loaded.source}: the mesh spans x {low[0]:g} to {high[0]:g} m and y {low[1]:g} to "
            f"{high[1]:g} m, beside the base of {base[0]:g} m x {base[1]:g} m about 0; "
            "move the mesh to the origin"
        )
    shift = np.array([0.0, 0.0, -low[2]])
    surface = _facing_out(Triangles(surface.vertices + shift, surface.faces))
    parts: tuple[Hull | Box | Triangles, ...]
    if pedestal.collision == "triangles":
        parts, shown = (surface,), surface
    elif pedestal.collision == "hull":
        hull = hull_surface(surface.vertices, loaded.source)
        parts, shown = (Hull(hull.vertices),), hull
    else:
        hulls = _decompose(loaded, shift)
        parts = tuple(Hull(hull.vertices) for hull in hulls)
        shown = join_surfaces(hulls)
    return PedestalBody(
        parts=parts,
        origin=(0.0, 0.0, base[2]),
        # Hulls of a decomposition may rise above the mesh they approximate.
        top=base[2] + float(shown.vertices[:, 2].max()),
        mass=pedestal.mass,
        base_size=base,
        source=loaded.source,
        sha256=loaded.sha256,
        surface=surface,
    )


def _facing_out(surface: Triangles) -> Triangles:
    """Open surfaces face up, closed ones outwards: figures light them by their normals."""
    corners = surface.vertices[surface.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    upward = float(normal[:, 2].sum())
    # The area vectors of a closed surface add up to nothing.
    if abs(upward) > 1e-9 * float(np.abs(normal).sum()):
        outwards = upward > 0
    else:
        outwards = signed_volume(surface.vertices, surface.faces.astype(np.int64)) >= 0
    if outwards:
        return surface
    return Triangles(surface.vertices, np.ascontiguousarray(surface.faces[:, ::-1]))


def _decompose(loaded: LoadedMesh, shift: Array) -> list[Triangles]:
    try:
        import_module("vhacdx")
    except ImportError as error:
        raise GeometryError(
            f"{loaded.source}: `collision: decomposition` needs the package vhacdx; "
            "`pip install vhacdx`, or choose `triangles` or `hull`"
        ) from error
    import trimesh

    # One thread: the order of the hulls must not depend on the machine's load.
    found = trimesh.decomposition.convex_decomposition(
        loaded.mesh, maxConvexHulls=MAX_HULLS, asyncACD=False
    )
    hulls = [
        hull_surface(np.asarray(part["vertices"], dtype=np.float64) + shift, loaded.source)
        for part in found
    ]
    if not hulls:
        raise GeometryError(
            f"{loaded.source}: the convex decomposition is empty; choose `triangles` or `hull`"
        )
    return sorted(hulls, key=lambda hull: tuple(hull.vertices.min(axis=0)))
