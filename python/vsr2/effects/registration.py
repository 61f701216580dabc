"""How the specimen really stands on the table, as against how the scene has it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vsr2.effects.effect import Effect
from vsr2.effects.geometry import in_plan, slope_rotation, with_mass_center
from vsr2.effects.parameter import Parameter
from vsr2.effects.standing import assert_stands, mass_height, turned_start
from vsr2.scene.rotation import matrix_from_quaternion
from vsr2.trial import Trial


class Registration(Effect):
    """Scan and specimen stand differently, alike in every trial.

    First the rock is turned about the vertical through its mass centre, over the full circle: half
    a turn mirrors the motion. On an even top a turn is the same as the motion turned backwards, so
    a small one acts like a motion across the shaking. Then the rock leans: its mass centre and
    principal axes turn about the foot, the point of the base under the mass centre. The contact
    shape stays. A wrong vertical of a scan that is whole would change nothing, for the rock settles
    on the same facet. But nobody scans the underside of a rock that stands, and what closes the
    mesh there is made after the scan's vertical. So the lean is that of the rock upon its real
    base. It settles on the facet that then lies under its mass centre. Uplift towards the lean
    begins at a = g (b - h sin(lean)) / (h cos(lean)). Where the inertia is that of the box around
    the rock, its axes stay.
    """

    name = "registration"
    meaning = "The specimen stands turned and leaning against the scene, the same in every trial"
    parameters = (
        Parameter(
            "yaw", "degree", 0.0, -180.0, 180.0, "uniform",
            "turn about the vertical, anticlockwise", limits=(-360.0, 360.0), full_range=True,
        ),
        Parameter(
            "lean", "degree", 0.0, 0.0, 3.0, "uniform", "of the rock upon its base",
            limits=(0.0, 30.0),
        ),
        Parameter(
            "lean_azimuth", "degree", 0.0, 0.0, 360.0, "uniform",
            "direction of the lean in plan after the turn, anticlockwise from x",
            limits=(-360.0, 360.0), secondary=True,
        ),
    )  # fmt: skip
    channels = ("tilt", "yaw", "slip", "rest pose")
    confounded_with = ("com_offset", "off_axis_motion")
    source = "statics and kinematics of a rigid body; this library"
    stage = "geometry"
    rank = -1

    def _joined(self, first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
        # The second turn turns the first lean with the rock; leans add up as slopes do.
        turned = {"lean": first["lean"], "azimuth": first["lean_azimuth"] + second["yaw"]}
        later = {"lean": second["lean"], "azimuth": second["lean_azimuth"]}
        both = in_plan("lean", turned, later)
        yaw = (first["yaw"] + second["yaw"] + 180.0) % 360.0 - 180.0
        return {"yaw": yaw, "lean": both["lean"], "lean_azimuth": both["azimuth"]}

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        if values["yaw"]:
            turned = turned_start(trial, math.radians(values["yaw"]), np.zeros(3))
            trial = replace(trial, start=turned)
        return _leaning(trial, values) if values["lean"] else trial


def _leaning(trial: Trial, values: Mapping[str, float]) -> Trial:
    """The trial with mass centre and principal axes turned about the foot."""
    slope = matrix_from_quaternion(trial.scene.pedestal.slope)
    turn = slope_rotation(values["lean"], values["lean_azimuth"])
    upright = np.array([0.0, 0.0, mass_height(trial)])
    shift = turn @ upright - upright
    assert_stands(
        trial,
        shift[:2],
        slope,
        key="effects.registration.lean",
        what=f"{values['lean']:g} degree",
    )
    if not trial.scene.rock.inertia_from_aabb:
        # The turn in M.
        rotation = slope.T @ matrix_from_quaternion(trial.start_pose.orientation)
        rock = trial.scene.rock
        axes = rotation.T @ turn @ rotation @ rock.mass.principal_axes
        trial = trial.with_scene(rock=replace(rock, mass=replace(rock.mass, principal_axes=axes)))
    return with_mass_center(trial, slope @ shift)
