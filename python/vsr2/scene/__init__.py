"""Bodies and the scene they make: meshes, mass properties, URDF, start poses, pedestals."""

from vsr2.scene.body import (
    Box,
    Hull,
    MassProperties,
    PedestalBody,
    PitchSpring,
    Pose,
    RockBody,
    Triangles,
)
from vsr2.scene.build import build_pedestal, build_rock
from vsr2.scene.mass import (
    aabb_mass_properties,
    box_mass_properties,
    mesh_mass_properties,
    principal_mass_properties,
)
from vsr2.scene.mechanisms import Mechanisms
from vsr2.scene.mesh import LoadedMesh, load_mesh
from vsr2.scene.notes import SceneNote, SceneWarning
from vsr2.scene.placement import drop_height, height_above, heights_above, start_pose
from vsr2.scene.scene import Scene, build_scene
from vsr2.scene.stability import (
    Slenderness,
    StablePose,
    Support,
    inertia_summary,
    slenderness,
    stable_poses,
    start_support,
    support_polygon,
)
from vsr2.scene.urdf import UrdfModel, load_urdf

__all__ = [
    "Box",
    "Hull",
    "LoadedMesh",
    "MassProperties",
    "Mechanisms",
    "PedestalBody",
    "PitchSpring",
    "Pose",
    "RockBody",
    "Scene",
    "SceneNote",
    "SceneWarning",
    "Slenderness",
    "StablePose",
    "Support",
    "Triangles",
    "UrdfModel",
    "aabb_mass_properties",
    "box_mass_properties",
    "build_pedestal",
    "build_rock",
    "build_scene",
    "drop_height",
    "height_above",
    "heights_above",
    "inertia_summary",
    "load_mesh",
    "load_urdf",
    "mesh_mass_properties",
    "principal_mass_properties",
    "slenderness",
    "stable_poses",
    "start_pose",
    "start_support",
    "support_polygon",
]
