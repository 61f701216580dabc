"""`vsr2 inertia`: mass properties and stability of a mesh."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def add_verbs(verbs: Any) -> None:
    """Add `inertia`."""
    inertia = verbs.add_parser(
        "inertia",
        help="mass properties, stable poses and slenderness of a mesh",
        description="Mass properties of the homogeneous solid, its stable poses, and its "
        "slenderness angle by azimuth.",
    )
    inertia.add_argument("mesh", metavar="MESH", type=Path, help="OBJ, STL, PLY or URDF [m]")
    group = inertia.add_mutually_exclusive_group()
    group.add_argument("--density", type=float, help="[kg/m^3] (default 2700)")
    group.add_argument("--mass", type=float, help="[kg]")
    inertia.add_argument("--scale", type=float, default=1.0, help="factor on the mesh's lengths")
    inertia.add_argument("--repair", action="store_true", help="close a mesh that is open")
    inertia.add_argument("--json", action="store_true", help="print JSON")
    inertia.set_defaults(run=_inertia)


def _inertia(options: argparse.Namespace) -> int:
    import json

    from vsr2.scene import format_inertia, inertia_summary

    summary = inertia_summary(
        options.mesh,
        scale=options.scale,
        density=options.density,
        mass=options.mass,
        repair=options.repair,
    )
    print(json.dumps(summary, indent=2) if options.json else format_inertia(summary))
    return 0
