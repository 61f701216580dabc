"""The effect on what a rock really stands on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from vsr2.effects.effect import Effect
from vsr2.effects.geometry import rounded_part, with_parts
from vsr2.effects.parameter import Parameter
from vsr2.effects.standing import STANDING, downwards, settle_at
from vsr2.effects.underside import Array, flattened, narrowed, settled_down, smoothed
from vsr2.errors import GeometryError
from vsr2.scene import Box, Hull
from vsr2.scene.rotation import matrix_from_quaternion
from vsr2.scene.shapes import box_corners, rock_points
from vsr2.trial import Trial


@dataclass(frozen=True)
class SupportConstants:
    """What of a rock is its base; chosen by hand.

    Attributes:
        base_zone: height of the base zone over that of the mass centre. A quadric follows the hull
            of the laboratory's SP1 within 0.2 mm (rms) up to here, and within 2 mm at twice this
            height.
    """

    base_zone: float = 0.015


SUPPORT = SupportConstants()
_UPRIGHT = 1e-6
"""Guard against rounding."""


class SupportRegion(Effect):
    """The real region of contact.

    The convex hull of a scan stands on three of its points. All heights count from the face of the
    hull on which the rock comes to rest. Mass properties stay, and the mass centre keeps its height
    above the base. Four changes follow each other:

    `smoothing`: points of the base zone, lower than 1.5 % of the mass centre's height, move
    vertically by this much at most towards the quadric that fits them best. `flat`: the rock stands
    on the hull's section at this height instead of three points. `shrink`: the sides and the
    underside are eroded by a level disc of this radius. So every edge of the base moves in by it,
    or out where it is negative. Uplift begins at a = g (b - shrink) / h. `rim`: what is left is
    opened by a ball, as in `edge_rounding`, which rounds the scan and not its flat. Uplift begins
    at a = g (b - shrink - rim) / h. A box stands on a face already: `smoothing` and `flat` do not
    change it, with `shrink` it stays a box, with `rim` it becomes a hull. A rock whose mass centre
    is no longer above its base falls before the motion.
    """

    name = "support"
    meaning = (
        "The rock stands on another region than the hull of its scan: worn flat, fitted, round"
    )
    parameters = (
        Parameter(
            "shrink", "m", 0.0, -0.010, 0.010, "uniform",
            "by which the edges of the base lie farther in, negative: farther out",
            limits=(-0.2, 0.2),
        ),
        Parameter(
            "flat", "m", 0.0, 0.0, 0.003, "uniform",
            "height of the section of the hull on which the rock stands", limits=(0.0, 0.1),
        ),
        Parameter(
            "rim", "m", 0.0, 0.0, 0.010, "uniform",
            "radius of the base's rim; below about 2 mm on a box and 0.1 mm on a hull as in "
            "`edge_rounding`", limits=(0.0, 0.5),
        ),
        Parameter(
            "smoothing", "m", 0.0, 0.0, 0.001, "uniform",
            "greatest move of a point near the base: the scan's accuracy", limits=(0.0, 0.05),
        ),
    )  # fmt: skip
    channels = ("tilt", "yaw", "slip", "rest pose")
    confounded_with = ("edge_rounding", "base_asperity", "slenderness")
    source = (
        "statics of a block; erosion by a disc and opening by a ball (Serra 1982, Image Analysis "
        "and Math. Morphology)"
    )
    stage = "geometry"
    jump = "with a rim a box becomes a hull, whose contacts are found one by one, however small"
    once = "of two flats or rims the larger one alone would show"

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        rock, every = trial.scene.rock, rock_points(trial.scene.rock)
        center = rock.mass.mass_center
        down = settled_down(every, center, downwards(trial))
        level = float((every @ down).max())
        zone = SUPPORT.base_zone * (level - float(center @ down))
        parts: list[Hull | Box] = []
        for part in rock.parts:
            points = part.points if isinstance(part, Hull) else box_corners(part)
            if (points @ down).max() < level - max(zone, values["flat"]):
                parts.append(part)
                continue
            made: Hull | Box
            if isinstance(part, Box):
                made = _narrowed_box(part, down, values["shrink"])
            else:
                made = Hull(_region(points, down, level, zone, values))
            if values["rim"]:
                made = rounded_part(made, values["rim"], down, trial)
            parts.append(made)
        if any(isinstance(part, Hull) for part in rock.parts):
            trial = settle_at(trial, STANDING.scan_settling)
        return with_parts(trial, tuple(parts))


def _region(
    points: Array, down: Array, level: float, zone: float, values: Mapping[str, float]
) -> Array:
    """Points of a hull with another underside, before its rim is rounded."""
    if values["smoothing"]:
        points = smoothed(points, down, level, zone, values["smoothing"])
    if values["flat"]:
        points = flattened(points, down, float((points @ down).max()), values["flat"])
    if values["shrink"]:
        points = narrowed(points, down, values["shrink"])
    return points


def _narrowed_box(box: Box, down: Array, inward: float) -> Box:
    """A box narrower by `inward` on each side [m]; one that stands on no face stays as it is.

    Raises:
        GeometryError: nothing is left.
    """
    upright = np.abs(matrix_from_quaternion(box.orientation).T @ down)
    if upright.max() < 1 - _UPRIGHT:
        return box
    height = int(np.argmax(upright))
    x, y, z = (edge - 2 * inward * (axis != height) for axis, edge in enumerate(box.size))
    if min(x, y, z) <= 0:
        raise GeometryError(f"{inward:g} m inwards leaves nothing of the box; make it smaller")
    return replace(box, size=(x, y, z))
