"""Effects on where the rock stands before the motion."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vsr2.effects.effect import Circumstances, Effect
from vsr2.effects.parameter import Parameter
from vsr2.effects.standing import restand
from vsr2.scene import Pose
from vsr2.scene.rotation import IDENTITY, matrix_from_quaternion, multiply, yaw_quaternion
from vsr2.trial import Trial


class Placement(Effect):
    """The rock set down again before each trial.

    A shift alone does not change the response on an even top.
    """

    name = "placement"
    meaning = "Before each trial the rock is put back only about where it was"
    parameters = (
        Parameter(
            "yaw", "degree", 0.0, 0.0, 10.0, "uniform",
            "greatest turn about the vertical; drawn uniformly for each trial between minus and "
            "plus this", limits=(0.0, 180.0), twice="spread",
        ),
        Parameter(
            "offset", "m", 0.0, 0.0, 0.020, "uniform",
            "greatest shift in plan; drawn uniformly over a disc for each trial", limits=(0.0, 2.0),
            twice="spread",
        ),
    )  # fmt: skip
    channels = ("yaw", "tilt", "slip")
    confounded_with = ("off_axis_motion",)
    source = "repeated placement by hand"
    stage = "start"

    def at(self, values: Mapping[str, float], circumstances: Circumstances) -> Mapping[str, float]:
        turn, radius, azimuth = circumstances.rng.uniform(size=3)
        return {
            "yaw": values["yaw"] * (2 * turn - 1),
            "offset": values["offset"] * math.sqrt(radius),
            "azimuth": 360.0 * azimuth,
        }

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        rotation = matrix_from_quaternion(trial.start_pose.orientation)
        position = np.asarray(trial.start_pose.position)
        center = position + rotation @ trial.scene.rock.mass.mass_center
        turn = yaw_quaternion(math.radians(values["yaw"]))
        # About the normal of the top and along it, where it slopes.
        x, y, z, w = slope = trial.scene.pedestal.slope
        if slope != IDENTITY:
            turn = multiply(multiply(slope, turn), (-x, -y, -z, w))
        azimuth = math.radians(values["azimuth"])
        shift = values["offset"] * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        moved = center + matrix_from_quaternion(turn) @ (position - center)
        moved += matrix_from_quaternion(slope) @ shift
        start = Pose(
            (float(moved[0]), float(moved[1]), float(moved[2])),
            multiply(turn, trial.start_pose.orientation),
        )
        return replace(trial, start=restand(trial, trial.scene.rock.parts, start))
