"""Effects on the inertia tensor."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from vsr2.effects.effect import Bench, Check, Effect
from vsr2.effects.geometry import half_widths, mass_height
from vsr2.effects.parameter import Parameter
from vsr2.effects.setup import Setup
from vsr2.scene.mass import box_inertia
from vsr2.scene.shapes import rock_points


class Inertia(Effect):
    """Another inertia tensor."""

    name = "inertia"
    meaning = "The moments of inertia about the mass centre differ from those of the model"
    parameters = (
        Parameter(
            "change", "1", 0.0, -0.15, 0.15, "uniform", "relative change of all moments",
            limits=(-0.9, 5.0),
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

    def change(self, setup: Setup, values: Mapping[str, float]) -> Setup:
        rock = setup.rock
        inertia = rock.mass.principal_inertia
        if values["rule"] == 1:
            in_body = (rock_points(rock) - rock.mass.mass_center) @ rock.mass.principal_axes
            inertia = box_inertia(rock.mass.mass, np.ptp(in_body, axis=0))
        mass = replace(rock.mass, principal_inertia=inertia * (1.0 + values["change"]))
        return replace(setup, rock=replace(rock, mass=mass, inertia_from_aabb=False))

    def verify(self, bench: Bench) -> Sequence[Check]:
        setup, change = bench.block(), 0.15
        started = self.change(setup, {"change": change, "rule": 0.0})
        tilt, duration = 0.05, 0.1
        response = bench.release(started, tilt, duration)
        _, b = half_widths(setup)
        h = mass_height(setup)
        radius, alpha = math.hypot(b, h), math.atan2(b, h)
        mass = setup.rock.mass
        about_edge = (1 + change) * float(mass.principal_inertia[1]) + mass.mass * radius**2
        p = math.sqrt(mass.mass * setup.engine.gravity * radius / about_edge)
        # Linearised free rocking (Housner 1963): tilt = alpha - (alpha - tilt0) cosh(p t).
        expected = (alpha - tilt) * p * math.sinh(p * duration)
        return [
            Check(
                "rate of free rocking after 0.1 s, (alpha - tilt0) p sinh(p t) [rad/s]",
                float(np.linalg.norm(response.angular_velocity[-1])),
                expected,
                0.025 * expected,
            )
        ]


INERTIA: tuple[Effect, ...] = (Inertia(),)
