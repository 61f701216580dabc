"""The MuJoCo model of a situation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from vsr2.blind.mujoco.rigid_body import GRAVITY
from vsr2.blind.mujoco.situation import Situation


@dataclass(frozen=True)
class ModelConstants:
    """Sizes that a trial's result should not depend on; chosen by hand, sealed with a pack.

    Attributes:
        table_mass: so large that contact does not move the table within a step [kg], [kg m^2].
        table_half: half the side of the table [m]: nothing falls off it.
        bump_radius: of the bodies under a rough base [m].
        iterations: of the contact solver, at most.
        tolerance: of its improvement, at which it ends.
    """

    table_mass: float = 1e7
    table_half: float = 3.0
    bump_radius: float = 0.005
    iterations: int = 50
    tolerance: float = 1e-10


MODEL = ModelConstants()
_AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1", "pitch": "0 1 0"}


def build_model(situation: Situation) -> Any:
    """Compile the model.

    The table is a box on one slide a channel and a hinge for the pitch; each step sets their
    positions and velocities. The body touches it with spheres of the radius `rounding` whose
    centres lie that far inside its corners, so that it rolls on a rounded edge. Gravity stands
    for the slope.

    Args:
        situation: the trial.

    Returns:
        A `mujoco.MjModel` with geom 0 the table and body 2 the body.
    """
    import mujoco

    body, contact = situation.body, situation.contact
    about_y, about_x = situation.slope
    gx, gy = GRAVITY * math.sin(about_y), GRAVITY * math.sin(about_x)
    gz = -math.sqrt(GRAVITY**2 - gx**2 - gy**2)
    dimensions = 3
    if situation.spin_friction > 0:
        dimensions = 4
    if situation.rolling_resistance > 0:
        dimensions = 6
    friction = _numbers(situation.friction, situation.spin_friction, situation.rolling_resistance)
    joints = "".join(
        f'<joint type="{"hinge" if c == "pitch" else "slide"}" axis="{_AXES[c]}" '
        f'pos="{_numbers(0, 0, -situation.table.pivot)}"/>'
        for c in situation.table.channels
    )
    centers = body.points.copy()
    centers[:, :2] += situation.rounding * body.inward
    centers[:, 2] += situation.rounding
    spheres = [(center, situation.rounding) for center in centers - body.center]
    for x, y, height in situation.bumps:
        up = MODEL.bump_radius - height
        center = (x - body.center[0], y - body.center[1], up - body.center[2])
        spheres.append((center, MODEL.bump_radius))
    geoms = "".join(
        f'<geom type="sphere" size="{_numbers(radius)}" pos="{_numbers(*center)}" contype="0" '
        'conaffinity="1"/>'
        for center, radius in spheres
    )
    mass, half = MODEL.table_mass, MODEL.table_half
    i = body.inertia
    full = _numbers(i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2])
    model = mujoco.MjModel.from_xml_string(f"""
<mujoco>
<compiler autolimits="true"/>
<option timestep="{_numbers(contact.step)}" cone="{contact.cone}" gravity="{_numbers(gx, gy, gz)}"
 integrator="{contact.integrator}" iterations="{MODEL.iterations}" tolerance="{MODEL.tolerance}"
 impratio="{_numbers(contact.friction_stiffness)}"/>
<default><geom friction="{friction}" condim="{dimensions}"
 solref="{_numbers(contact.time_constant, contact.damping_ratio)}"
 solimp="{_numbers(*contact.impedance, contact.width)}"/></default>
<worldbody>
<body gravcomp="1"><inertial pos="0 0 0" mass="{mass}"
 diaginertia="{mass} {mass} {mass}"/>{joints}
<geom type="box" size="{half} {half} 0.5" pos="0 0 -0.5" contype="1"
 conaffinity="0"/></body>
<body><freejoint/>
<inertial pos="0 0 0" mass="{_numbers(body.mass)}" fullinertia="{full}"/>{geoms}</body>
</worldbody>
</mujoco>""")
    # Of a free joint: three translations, then turns about the body's axes.
    model.dof_damping[-6:] = contact.velocity_damping * np.array([body.mass] * 3 + list(np.diag(i)))
    return model


def _numbers(*values: float) -> str:
    """As MJCF takes them, exact; the `repr` of a numpy scalar is none of them."""
    return " ".join(repr(float(value)) for value in values)
