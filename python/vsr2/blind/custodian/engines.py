"""Engines by name."""

from __future__ import annotations

from vsr2.blind.custodian.shake import Engine
from vsr2.config import Study
from vsr2.errors import BlindError


def build_engine(name: str, study: Study) -> Engine:
    """The engine of that name for a study's scene.

    Raises:
        BlindError: it is not known, not installed, or cannot simulate the scene.
    """
    if name == "mujoco":
        from vsr2.blind.custodian.mujoco_engine import MujocoEngine

        return MujocoEngine(study)
    if name == "bullet":
        from vsr2.blind.custodian.bullet_engine import BulletEngine

        return BulletEngine(study)
    raise BlindError(f"engine {name!r} is not known; choose mujoco or bullet")
