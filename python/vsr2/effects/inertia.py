"""Effects on the inertia tensor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vsr2.effects.effect import Effect
from vsr2.effects.parameter import Parameter
from vsr2.scene.mass import box_inertia
from vsr2.scene.shapes import rock_points
from vsr2.trial import Trial


class Inertia(Effect):
    """Another inertia tensor.

    The moments change in proportion, or are those of the homogeneous box around the rock in its
    body frame: for the laboratory's specimen SP1 about twice too large.
    """

    name = "inertia"
    meaning = "The moments of inertia about the mass centre differ from those of the model"
    parameters = (
        Parameter(
            "change", "1", 0.0, -0.15, 0.15, "uniform", "relative change of all moments",
            limits=(-0.9, 5.0), twice="growth",
        ),
        Parameter(
            "rule", "1", 0.0, 0.0, 1.0, "fixed",
            "`model`: as the study has it; `aabb`: of the box around the rock in its body frame, "
            "the original's estimate", choices=("model", "aabb"),
        ),
    )  # fmt: skip
    channels = ("tilt",)
    confounded_with = ("time_scale",)
    source = "rigid-body dynamics; the original's rule is Bullet's bounding-box inertia"
    stage = "inertia"

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        rock = trial.scene.rock
        inertia = rock.mass.principal_inertia
        if values["rule"] == 1:
            in_body = (rock_points(rock) - rock.mass.mass_center) @ rock.mass.principal_axes
            inertia = box_inertia(rock.mass.mass, np.ptp(in_body, axis=0))
        mass = replace(rock.mass, principal_inertia=inertia * (1.0 + values["change"]))
        return trial.with_scene(rock=replace(rock, mass=mass, inertia_from_aabb=False))

    def _joined(self, first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
        # The box's moments take the place of whatever was there.
        return dict(second) if second["rule"] == 1 else super()._joined(first, second)
