"""Effects on where the rock stands before the motion."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from vsr2.effects.effect import Bench, Check, Effect
from vsr2.effects.parameter import Parameter
from vsr2.effects.setup import Circumstances, Setup, restand
from vsr2.scene import Pose
from vsr2.scene.rotation import IDENTITY, matrix_from_quaternion, multiply, yaw_quaternion


class Placement(Effect):
    """The rock set down anew before each trial.

    A shift alone does not change the response on an even top.
    """

    name = "placement"
    meaning = "Before each trial the rock is put back only about where it was"
    parameters = (
        Parameter(
            "yaw", "degree", 0.0, 0.0, 10.0, "uniform",
            "greatest turn about the vertical; drawn uniformly for each trial between minus and "
            "plus this", limits=(0.0, 180.0),
        ),
        Parameter(
            "offset", "m", 0.0, 0.0, 0.020, "uniform",
            "greatest shift in plan; drawn uniformly over a disc for each trial", limits=(0.0, 2.0),
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

    def change(self, setup: Setup, values: Mapping[str, float]) -> Setup:
        rotation = matrix_from_quaternion(setup.start.orientation)
        position = np.asarray(setup.start.position)
        center = position + rotation @ setup.rock.mass.mass_center
        turn = yaw_quaternion(math.radians(values["yaw"]))
        # About the normal of the top and along it, where it slopes.
        x, y, z, w = slope = setup.pedestal.slope
        if slope != IDENTITY:
            turn = multiply(multiply(slope, turn), (-x, -y, -z, w))
        azimuth = math.radians(values["azimuth"])
        shift = values["offset"] * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        moved = center + matrix_from_quaternion(turn) @ (position - center)
        moved += matrix_from_quaternion(slope) @ shift
        start = Pose(
            (float(moved[0]), float(moved[1]), float(moved[2])),
            multiply(turn, setup.start.orientation),
        )
        return replace(setup, start=restand(setup, setup.rock.parts, start))

    def verify(self, bench: Bench) -> Sequence[Check]:
        setup = bench.block()
        values = {"yaw": 10.0, "offset": 0.02}
        drawn = []
        for trial in range(200):
            rng = np.random.default_rng(np.random.SeedSequence(0, spawn_key=(trial,)))
            drawn.append(self.at(values, Circumstances(0.0, "1", ("1",), rng)))
        yaw = np.array([one["yaw"] for one in drawn])
        offset = np.array([one["offset"] for one in drawn])
        turned = self.change(setup, drawn[0]).start
        half = math.atan2(turned.orientation[2], turned.orientation[3])
        return [
            Check("mean square turn, yaw^2 / 3 [degree^2]", float((yaw**2).mean()), 100 / 3, 5.0),
            Check("mean square shift, offset^2 / 2 [m^2]", float((offset**2).mean()), 2e-4, 2e-5),
            Check("turn of the start pose [degree]", math.degrees(2 * half), yaw[0], 1e-9),
        ]


START: tuple[Effect, ...] = (Placement(),)
