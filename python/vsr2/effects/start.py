"""Effects on where the rock stands before the motion."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from vsr2.effects.effect import Circumstances, Effect
from vsr2.effects.geometry import direction
from vsr2.effects.parameter import Parameter
from vsr2.effects.standing import turned_starts
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
        return self.change_each(trial, [values])[0]

    def change_each(self, trial: Trial, values: Sequence[Mapping[str, float]]) -> list[Trial]:
        moves = [
            (math.radians(own["yaw"]), own["offset"] * direction(own["azimuth"])) for own in values
        ]
        return [trial.starting(start) for start in turned_starts(trial, moves)]
