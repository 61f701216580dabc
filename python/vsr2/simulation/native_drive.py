"""How a motion drives the pedestal, as the core names it."""

from __future__ import annotations

from vsr2 import _native
from vsr2.config.motion_source import DriveMode


def native_drive(drive: DriveMode, *, beside_x: bool, cosine: bool) -> _native.Drive:
    """The core's drive for a motion (supplement S1.3).

    Args:
        drive: as a study has it.
        beside_x: whether the pedestal moves along y or z or pitches; only "prescribed" does.
        cosine: whether the motion is a cosine, whose velocity a motor follows too.
    """
    if beside_x:
        return _native.Drive.prescribed_spatial
    if drive == "prescribed":
        return _native.Drive.prescribed
    return _native.Drive.motor_position_velocity if cosine else _native.Drive.motor_position
