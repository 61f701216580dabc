"""What a rock stands on in a trial, and how it is set down again after a change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from vsr2.config.study import Settling
from vsr2.errors import GeometryError
from vsr2.scene import (
    Box,
    Hull,
    Pose,
    RockBody,
    Support,
    height_above,
    heights_above,
    start_support,
)
from vsr2.scene.rotation import (
    IDENTITY,
    Quaternion,
    matrix_from_quaternion,
    multiply,
    yaw_quaternion,
)
from vsr2.trial import Trial

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StandingConstants:
    """When a changed rock counts as standing; chosen by hand.

    Attributes:
        scan_settling: times the default speeds, at which a scan, which may tremble on its points,
            counts as at rest.
    """

    scan_settling: float = 4.0


STANDING = StandingConstants()


def support_of(trial: Trial) -> Support:
    """What the rock stands on, in the frame of the pedestal's top, which may slope."""
    return _support(trial.scene.rock, trial.start_pose, trial.scene.pedestal.slope)


@lru_cache(maxsize=16)  # The same rock stands so under many motions.
def _support(rock: RockBody, start: Pose, slope: Quaternion) -> Support:
    x, y, z, w = slope
    level = multiply((-x, -y, -z, w), start.orientation)
    return start_support(replace(rock, start=Pose(start.position, level)))


def downwards(trial: Trial) -> Array:
    """Unit vector from the rock to the pedestal's top at the start, in M, shape (3,)."""
    rotation = matrix_from_quaternion(trial.start_pose.orientation)
    down: Array = -rotation.T @ matrix_from_quaternion(trial.scene.pedestal.slope)[:, 2]
    return down


def mass_height(trial: Trial) -> float:
    """Height of the mass centre above the support at the start, along the top's normal [m]."""
    return support_of(trial).height


def assert_stands(trial: Trial, shift: Array, slope: Array, *, key: str, what: str) -> None:
    """Refuse to take the mass centre beyond a rock's support: it would fall while it settles.

    Starts in which a rock does not stand anyway are left to the settling.

    Args:
        trial: before the change.
        shift: by which the mass centre moves over the base, along the top, shape (2,) [m].
        slope: rotation of the top from level after the change, shape (3, 3).
        key: of the study that asks for it.
        what: its value, for the error.

    Raises:
        GeometryError: the vertical through the mass centre leaves the support.
    """
    try:
        support = support_of(trial)
    except GeometryError:
        return
    plumb = -slope[2]  # In the frame of the top.
    drop = shift - support.height * plumb[:2] / plumb[2]
    following = np.roll(support.polygon, -1, axis=0) - support.polygon
    normal = np.column_stack([following[:, 1], -following[:, 0]])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    beyond = float((normal @ drop - (normal * support.polygon).sum(axis=1)).max())
    if support.margin > 0 and beyond > -1e-9:
        raise GeometryError(
            f"{what} takes the mass centre beyond the rock's support, so that it falls before the "
            "motion begins; make it smaller",
            key=key,
        )


def restand(trial: Trial, parts: tuple[Hull | Box, ...], start: Pose | None = None) -> Pose:
    """The start raised or lowered so that other parts keep the present gap to the pedestal.

    Args:
        trial: with the present parts and start.
        parts: new collision parts of the rock in M.
        start: new start, whose height is set; by default the present one.

    Raises:
        GeometryError: the pedestal is no longer under the rock.
    """
    scene, moved = trial.scene, start or trial.start_pose
    before = height_above(scene.rock.parts, trial.start_pose, scene.pedestal)
    return _restood(moved, before, height_above(parts, moved, scene.pedestal))


def _restood(moved: Pose, before: float | None, after: float | None) -> Pose:
    """A start whose gap to the pedestal was `before` and is `after` [m], None where it has none."""
    if before is None or after is None:
        raise GeometryError("the effect leaves no pedestal under the rock; make it smaller")
    x, y, z = moved.position
    return Pose((x, y, z + (before - after)), moved.orientation)


def turned_start(trial: Trial, yaw: float, shift: Array) -> Pose:
    """The start turned about the normal of the top through the mass centre, and shifted along it.

    Args:
        trial: with the present start.
        yaw: anticlockwise [rad].
        shift: in plan, shape (3,) with no third component [m].

    Raises:
        GeometryError: the pedestal is no longer under the rock.
    """
    (start,) = turned_starts(trial, [(yaw, shift)])
    return start


def turned_starts(trial: Trial, moves: Sequence[tuple[float, Array]]) -> list[Pose]:
    """As :func:`turned_start`, of one start turned and shifted in many ways."""
    own, rock, pedestal = trial.start_pose, trial.scene.rock, trial.scene.pedestal
    rotation = matrix_from_quaternion(own.orientation)
    position = np.asarray(own.position)
    center = position + rotation @ rock.mass.mass_center
    x, y, z, w = slope = pedestal.slope
    along = matrix_from_quaternion(slope)
    starts = []
    for yaw, shift in moves:
        turn = yaw_quaternion(yaw)
        # About the normal of the top and along it, where it slopes.
        if slope != IDENTITY:
            turn = multiply(multiply(slope, turn), (-x, -y, -z, w))
        moved = center + matrix_from_quaternion(turn) @ (position - center)
        moved += along @ shift
        at_x, at_y, at_z = moved.tolist()
        starts.append(Pose((at_x, at_y, at_z), multiply(turn, own.orientation)))
    before = height_above(rock.parts, own, pedestal)
    afters = heights_above(rock.parts, starts, pedestal)
    return [_restood(start, before, after) for start, after in zip(starts, afters, strict=True)]


def settle_at(trial: Trial, factor: float) -> Trial:
    """The trial at rest below `factor` times the default speeds, or below its own if greater.

    Hulls may tremble on their contacts without end, by micrometres, as the engine's choice of
    contact points changes from step to step; at the default speeds they never count as at rest.
    """
    own, usual = trial.settling, Settling()
    speeds = {
        name: max(getattr(own, name), factor * getattr(usual, name))
        for name in ("linear_speed", "angular_speed")
    }
    return replace(trial, settling=own.model_copy(update=speeds))
