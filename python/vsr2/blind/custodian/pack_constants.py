"""Chosen numbers that a pack rests on beside its rules, gathered for the seal."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from vsr2.blind.custodian.bullet_engine import BULLET_ENGINE
from vsr2.blind.custodian.campaign_recording import RECORDING
from vsr2.blind.custodian.design import DESIGN
from vsr2.blind.mujoco.contact_models import FAMILY
from vsr2.blind.mujoco.driven_table import DRIVEN_TABLE
from vsr2.blind.mujoco.ground import GROUND
from vsr2.blind.mujoco.model import MODEL
from vsr2.blind.mujoco.mujoco_effects import ROUGH_BASE
from vsr2.blind.mujoco.mujoco_trial import TRIAL
from vsr2.blind.mujoco.rigid_body import HULL
from vsr2.blind.mujoco.step_actions import MECHANISMS
from vsr2.ensemble.simulated.hypotheses import HYPOTHESIS
from vsr2.ensemble.simulated.motion_noise import MOTION_NOISE
from vsr2.simulation.run_constants import run_constants


def pack_constants(making: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """All of them, by what they are of.

    Args:
        making: those of the making itself.
    """
    return {
        "making": making,
        "design": asdict(DESIGN),
        "ground_motion": asdict(GROUND),
        "contact_family": asdict(FAMILY),
        "mechanisms": asdict(MECHANISMS),
        "mujoco_hull": asdict(HULL),
        "mujoco_model": asdict(MODEL),
        "mujoco_rough_base": asdict(ROUGH_BASE),
        "mujoco_table": asdict(DRIVEN_TABLE),
        "mujoco_trial": asdict(TRIAL),
        "bullet": asdict(BULLET_ENGINE),
        "recording": asdict(RECORDING),
        "hypotheses": asdict(HYPOTHESIS),
        "motion_noise": asdict(MOTION_NOISE),
        **run_constants(),
    }
