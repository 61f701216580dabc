"""A second, independent simulation of a rock on a shaking table, on MuJoCo.

It shares nothing with the rest of VSR2: own bodies, own ground motions, own resampling in time, own
implementation of every effect. A diagnosis that was built on VSR2's core is examined on its data
without meeting its own equations again.
"""

from vsr2.blind.mujoco.contact_models import NOMINAL, ContactModel, draw_contact
from vsr2.blind.mujoco.driven_table import TableMotion, drive
from vsr2.blind.mujoco.ground import GroundMotion, ground_motion
from vsr2.blind.mujoco.mujoco_effects import (
    EFFECTS,
    Drawable,
    Parameter,
    TrialContext,
    observe,
    with_effects,
)
from vsr2.blind.mujoco.mujoco_trial import Response, run_trial
from vsr2.blind.mujoco.rigid_body import Body, block, read_hull
from vsr2.blind.mujoco.situation import Situation

__all__ = [
    "EFFECTS",
    "NOMINAL",
    "Body",
    "ContactModel",
    "Drawable",
    "GroundMotion",
    "Parameter",
    "Response",
    "Situation",
    "TableMotion",
    "TrialContext",
    "block",
    "draw_contact",
    "drive",
    "ground_motion",
    "observe",
    "read_hull",
    "run_trial",
    "with_effects",
]
