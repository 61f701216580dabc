"""`vsr2 inertia`: mass properties and stability of a mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Group, Parameter

from vsr2.cli.exclusive_options import one_of
from vsr2.cli.options import Json, print_json

HEAVINESS = Group("How heavy (one of)", validator=one_of)


def inertia(
    mesh: Path,
    /,
    *,
    density: Annotated[float | None, Parameter(group=HEAVINESS)] = None,
    mass: Annotated[float | None, Parameter(group=HEAVINESS)] = None,
    scale: float = 1.0,
    repair: bool = False,
    json: Json = False,
) -> int:
    """Mass properties, stable poses and slenderness of a mesh.

    Mass properties of the homogeneous solid, its stable poses, and its slenderness angle by
    azimuth.

    Args:
        mesh: OBJ, STL, PLY or URDF [m]
        density: [kg/m^3] (default: 2700)
        mass: [kg]
        scale: factor on the mesh's lengths
        repair: close a mesh that is open
    """
    import numpy as np

    from vsr2.report.messages.data import inertia_text, scene_note
    from vsr2.scene import inertia_summary
    from vsr2.scene.build import size_notes

    summary = inertia_summary(mesh, scale=scale, density=density, mass=mass, repair=repair)
    unusual = size_notes(mesh.name, np.asarray(summary["extents_m"]))
    summary["notes"] += [note.to_json() for note in unusual]
    if json:
        notes = [{**note, "text": scene_note(note)} for note in summary["notes"]]
        print_json({**summary, "notes": notes})
    else:
        print(inertia_text(summary))
    return 0
