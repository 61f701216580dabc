"""What reading and placing a body found, as codes with values."""

from __future__ import annotations

from collections.abc import Mapping

from vsr2.codes import NUMBERS, Code


class SceneWarning(UserWarning):
    """Something about a scene that its maker should look at before it is run."""


class SceneNote(Code):
    """What was changed of a body, or should be known; `vsr2.report.messages.data` words it.

    Lengths, heights and positions are in [m], volumes in [m^3], masses in [kg], moments in
    [kg m^2].
    """

    MERGED_VERTICES = "merged_vertices", {"file": str, "count": int, "tolerance": float}
    REMOVED_FACES = "removed_faces", {"file": str, "count": int}
    REMOVED_PARTS = "removed_parts", {"file": str, "count": int, "share": float}
    FILLED_HOLES = "filled_holes", {"file": str, "holes": int, "faces": int, "widest": float}
    FLIPPED_FACES = "flipped_faces", {"file": str, "count": int}
    REPAIRED_VOLUME = "repaired_volume", {"file": str, "before": float, "after": float}
    NOTHING_TO_REPAIR = "nothing_to_repair", {"file": str}
    SEVERAL_OBJECTS = "several_objects", {"file": str, "count": int}
    CYLINDER_AS_PRISM = "cylinder_as_prism", {"file": str, "sides": int}
    UNUSUAL_INERTIA = (
        "unusual_inertia",
        {"file": str, "moments": NUMBERS, "ratios": NUMBERS, "solid": NUMBERS},
    )
    DISTANT_MASS_CENTER = "distant_mass_center", {"file": str, "distance": float}
    UNUSUAL_SIZE = "unusual_size", {"file": str, "length": float}
    BESIDE_PEDESTAL = "beside_pedestal", {"x": float, "y": float}
    ABOVE_PEDESTAL = "above_pedestal", {"height": float}
    INSIDE_PEDESTAL = "inside_pedestal", {"depth": float}
    SOFT_CONTACT = "soft_contact", {"mass": float, "depth": float, "stiffness": float}
    LIVELY_CONTACT = "lively_contact", {"restitution": float, "undone": float, "step": float}


WARNINGS: Mapping[str, str] = {
    SceneNote.UNUSUAL_SIZE: (
        "{file}: {length:.4g} m long; if its unit is not the metre, scale it: `scale` of a file, "
        "such as 0.001, `size` of a box, `apply_scale` of a Trimesh"
    ),
    SceneNote.SOFT_CONTACT: (
        "contact: the rock of {mass:.4g} kg presses itself at least {depth:.3g} m into the "
        "pedestal, whose contact points have {stiffness:.3g} N/m. If it is lighter, mend its "
        "density or its unit: a mesh in millimetres needs `scale: 0.001`. If not, raise "
        "contact.rock.stiffness and contact.pedestal.stiffness"
    ),
    SceneNote.LIVELY_CONTACT: (
        "contact: impacts may gain energy, because the pair's restitution of {restitution:.3g} and "
        "the share of a penetration that a step undoes, {undone:.3g}, sum to more than 1; raise "
        "contact.rock.damping, lower a restitution, or set engine.time_step to {step:.3g} s or less"
    ),
}
"""Templates of the notes that are also warnings, for callers in Python."""
