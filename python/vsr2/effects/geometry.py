"""Effects on the shape of rock and pedestal, and on where the mass centre lies."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vsr2.effects.effect import Effect
from vsr2.effects.parameter import Parameter
from vsr2.effects.rounding import ROUNDING, rounded_hull
from vsr2.effects.standing import (
    STANDING,
    assert_stands,
    downwards,
    mass_height,
    restand,
    settle_at,
    support_of,
)
from vsr2.scene import Box, Hull, PedestalBody, Pose, Triangles
from vsr2.scene.rotation import (
    axis_aside,
    matrix_from_quaternion,
    multiply,
    quaternion_from_matrix,
    yaw_quaternion,
)
from vsr2.scene.shapes import box_corners, part_points
from vsr2.trial import Trial

Array = NDArray[np.float64]

AZIMUTH = Parameter(
    "azimuth", "degree", 0.0, 0.0, 360.0, "uniform",
    "direction in plan, anticlockwise from x", limits=(-360.0, 360.0), secondary=True,
)  # fmt: skip


def direction(azimuth: float) -> Array:
    """Unit vector in plan at `azimuth` [degree], shape (3,)."""
    return np.array([math.cos(math.radians(azimuth)), math.sin(math.radians(azimuth)), 0.0])


def with_mass_center(trial: Trial, shift: Array) -> Trial:
    """The trial with the rock's mass centre moved by `shift`, in the world at the start [m]."""
    rock = trial.scene.rock
    rotation = matrix_from_quaternion(trial.start_pose.orientation)
    moved = rotation.T @ shift
    if not rock.inertia_from_aabb:
        mass = replace(rock.mass, mass_center=rock.mass.mass_center + moved)
        return trial.with_scene(rock=replace(rock, mass=mass))
    # Here the mass centre is the model's origin, so the shape moves the other way.
    parts = tuple(
        Hull(part.points - moved)
        if isinstance(part, Hull)
        else replace(part, center=_triple(np.asarray(part.center) - moved))
        for part in rock.parts
    )
    old = trial.start_pose
    start = Pose(_triple(np.asarray(old.position) + shift), old.orientation)
    surface = rock.surface
    if surface is not None:
        surface = Triangles(surface.vertices - moved, surface.faces)
    moved_rock = replace(rock, parts=parts, surface=surface)
    return replace(trial.with_scene(rock=moved_rock), start=start)


def with_parts(trial: Trial, parts: tuple[Hull | Box, ...]) -> Trial:
    """The trial with other collision parts of the rock, as high above the pedestal as before."""
    rock = replace(trial.scene.rock, parts=parts)
    return replace(trial.with_scene(rock=rock), start=restand(trial, parts))


def _triple(vector: Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in vector)
    return (x, y, z)


class SlendernessEffect(Effect):
    """The mass centre raised or lowered.

    The mass centre moves along the normal of the pedestal's top; shape and inertia about it stay.
    The frequency parameter p changes with it, by about a quarter of the change for a slender block.
    Uplift begins at a = g (1 + change) b / h.
    """

    name = "slenderness"
    meaning = (
        "The mass centre lies lower (change > 0) or higher than in the model: tan(alpha) = b / h "
        "is multiplied by 1 + change"
    )
    parameters = (
        Parameter(
            "change", "1", 0.0, -0.06, 0.06, "uniform",
            "relative change of the tangent of the slenderness angle", limits=(-0.5, 1.0),
            twice="growth",
        ),
    )  # fmt: skip
    channels = ("tilt",)
    confounded_with = ("table_gain", "edge_rounding")
    source = "Housner (1963), Bull. Seismol. Soc. Am. 53(2)"
    stage = "geometry"

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        height = mass_height(trial)
        lift = height / (1.0 + values["change"]) - height
        up = matrix_from_quaternion(trial.scene.pedestal.slope) @ np.array([0.0, 0.0, 1.0])
        return with_mass_center(trial, lift * up)


class ComOffset(Effect):
    """The mass centre beside the middle.

    The mass centre moves in plan; shape and inertia about it stay. Uplift towards the shift begins
    at a = g (b - distance) / h.
    """

    name = "com_offset"
    meaning = "The mass centre lies beside that of the model (density not uniform, hollows)"
    parameters = (
        Parameter(
            "distance", "m", 0.0, 0.0, 0.015, "uniform", "of the shift in plan", limits=(0.0, 0.2)
        ),
        AZIMUTH,
    )
    channels = ("tilt", "yaw")
    confounded_with = ("base_slope",)
    source = "statics of a block; Purvance, Anooshehpoor & Brune (2008), EESD 37(7)"
    stage = "geometry"

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        shift = values["distance"] * direction(values["azimuth"])
        slope = matrix_from_quaternion(trial.scene.pedestal.slope)
        assert_stands(
            trial,
            shift[:2],
            slope,
            key="effects.com_offset.distance",
            what=f"{values['distance']:g} m",
        )
        return with_mass_center(trial, slope @ shift)

    def _joined(self, first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
        return in_plan("distance", first, second)


class EdgeRounding(Effect):
    """Round contact edges.

    The underside of every collision part is opened by a ball (erosion, then dilation): plane faces
    stay, every edge and corner becomes round with the radius. A box becomes a hull for it. The mass
    that a rounding takes off is left out. Uplift begins at a = g (b - r) / h, and the rock then
    rolls over the arc, here a polygon of facets 4 degrees apart. The engine's collision margin
    (1 mm) is the least radius of an arc: below it the base of a box still widens to b - r, but it
    rolls over 1 mm. The contacts of a hull are found one by one, those of a box at once: the hull
    of a sharp block rocks up to 9 % higher or lower than the box. So on a box a radius means
    something from about 2 mm. The rounded hull of a scan may tremble on its contacts, so it counts
    as at rest before the motion below 4 times the default speeds at least. Below 0.1 mm a hull is
    left as it is: facets that small would only upset the engine's choice of contact points. From
    there on its points are others, which a scan that is chaotic tells by as much as a start some
    micrometres away.
    """

    name = "edge_rounding"
    meaning = "The contact edges are round: the base is narrower and the rock rolls over its edge"
    parameters = (
        Parameter(
            "radius", "m", 0.0, 0.0, 0.015, "uniform",
            "of the rounding; on a box below about 2 mm the contacts of a hull matter more, on a "
            "hull below 0.1 mm it does nothing",
            limits=(0.0, 0.5),
        ),
    )  # fmt: skip
    channels = ("tilt",)
    confounded_with = ("table_gain", "slenderness")
    source = "opening of a convex body by a ball (Serra 1982, Image Analysis and Math. Morphology)"
    stage = "geometry"
    rank = 1
    jump = "a box becomes a hull, whose contacts are found one by one, however small the radius"
    once = "of two roundings the larger one alone would show"

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        radius, rock, down = values["radius"], trial.scene.rock, downwards(trial)
        parts = tuple(rounded_part(part, radius, down, trial) for part in rock.parts)
        if radius >= ROUNDING.least_radius and any(isinstance(part, Hull) for part in rock.parts):
            trial = settle_at(trial, STANDING.scan_settling)
        return with_parts(trial, parts)


def rounded_part(part: Hull | Box, radius: float, down: Array, trial: Trial) -> Hull:
    """A collision part with its underside opened by a ball.

    Args:
        part: of the rock.
        radius: of the ball [m].
        down: unit vector towards the pedestal in M, shape (3,).
        trial: with the engine, and the start that tells which faces are base and top.

    Raises:
        GeometryError: no ball of this radius fits into the part.
    """
    margin = trial.scene.engine.collision_margin
    # The engine's margin lies inside a box and around a hull.
    if isinstance(part, Box) and radius < margin:
        return Hull(box_with_margin(part, trial, radius))
    if isinstance(part, Box):
        return Hull(rounded_hull(box_corners(part), radius, down, ball=radius - margin))
    sharp = radius < ROUNDING.least_radius
    return Hull(part.points if sharp else rounded_hull(part.points, radius, down))


class BaseAsperity(Effect):
    """Bumps under the base.

    The tips lie below the base by `height`, at `reach` of the way from the mass centre's projection
    to the edge of the support along its diagonals. On an even top a body touches with its convex
    hull only, so a rock of one part gets the tips as corners; one of several parts gets four small
    cones. It first rocks about the tips, from a = g x / (h + height), and about its edges once they
    meet the pedestal.

    At an impact the tips strike first, so that its blow comes in three parts (edge to tip, tip to
    tip, tip to edge) and leaves more energy than one from edge to edge. Of rigid bodies that holds
    for bumps however low: as the height goes to 0 the effect does not, as it does when the reach
    goes to 1. Bullet tells heights apart from about 0.1 mm; lower bumps act like that.
    """

    name = "base_asperity"
    meaning = (
        "Four equal bumps under the base: the rock stands and first rocks on them, and on its "
        "edges from a small tilt on"
    )
    parameters = (
        Parameter(
            "height", "m", 0.0, 0.0, 0.002, "uniform",
            "of the bumps; below 0.1 mm they act at impacts as if of 0.1 mm", limits=(0.0, 0.05),
        ),
        Parameter(
            "reach", "1", 0.7, 0.4, 0.9, "uniform",
            "distance of the bumps from the mass centre's projection, relative to the edge's",
            limits=(0.1, 0.99), secondary=True,
        ),
    )  # fmt: skip
    channels = ("tilt", "yaw", "slip", "rest pose")
    confounded_with = ("restitution", "edge_rounding")
    source = "statics; ElGawady et al. (2011), EESD 40, on the role of the interface"
    stage = "geometry"
    rank = 2
    jump = "an impact on bumps has three parts however low they are; and a box becomes a hull"
    once = "bumps on the tips of bumps would be another base"

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        # In the frame of the pedestal's top.
        slope = matrix_from_quaternion(trial.scene.pedestal.slope)
        rotation = slope.T @ matrix_from_quaternion(trial.start_pose.orientation)
        support, rock = support_of(trial), trial.scene.rock
        tips = np.column_stack(
            [
                values["reach"] * bump_positions(support.polygon),
                np.full(4, -support.height - values["height"]),
            ]
        )
        in_model = tips @ rotation + rock.mass.mass_center
        points = part_points(rock.parts)
        parts: tuple[Hull | Box, ...]
        if len(rock.parts) == 1:
            # On an even top a body touches with its convex hull only.
            old = rock.parts[0]
            if isinstance(old, Hull):
                parts = (Hull(np.vstack([points[0], in_model])),)
            else:
                lift = trial.scene.engine.collision_margin * rotation[2]
                parts = (Hull(np.vstack([box_with_margin(old, trial), in_model + lift])),)
        else:
            up = rotation[2]
            parts = rock.parts + tuple(_bump(tip, up, values["height"]) for tip in in_model)
        return with_parts(trial, parts)


def bump_positions(polygon: Array) -> Array:
    """Where diagonals in plan leave a polygon around the origin, shape (4, 2) [m]."""
    half = np.ptp(polygon, axis=0)
    following = np.roll(polygon, -1, axis=0) - polygon
    normal = np.column_stack([following[:, 1], -following[:, 0]])
    found = []
    for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
        along = np.array([x * half[0], y * half[1]]) / float(np.hypot(*half))
        offset, slope = (normal * polygon).sum(axis=1), normal @ along
        ahead = slope > 1e-12
        found.append(along * float((offset[ahead] / slope[ahead]).min()))
    return np.asarray(found)


def box_with_margin(box: Box, trial: Trial, radius: float = 0.0) -> Array:
    """Corners of a hull that stands, with the engine's margin around it, on a box's base.

    Args:
        box: part of the rock.
        trial: with the start that tells which faces are base and top.
        radius: by which the base is narrower on each side, up to the margin [m].
    """
    margin = trial.scene.engine.collision_margin
    start = matrix_from_quaternion(trial.start_pose.orientation)
    slope = matrix_from_quaternion(trial.scene.pedestal.slope)
    axes = slope.T @ start @ matrix_from_quaternion(box.orientation)
    inwards = [radius, radius, radius]
    inwards[int(np.argmax(np.abs(axes[2])))] = margin
    x, y, z = (edge - 2 * inward for edge, inward in zip(box.size, inwards, strict=True))
    return box_corners(replace(box, size=(x, y, z)))


def _bump(tip: Array, up: Array, height: float) -> Hull:
    """A cone on its tip, twice as wide as high, whose rim lies inside the rock."""
    side = np.cross(up, axis_aside(up))
    side /= np.linalg.norm(side)
    other = np.cross(up, side)
    rim = tip + 2 * height * up
    return Hull(
        np.vstack([tip, *(rim + 2 * height * (c * side + s * other) for c, s in _QUARTERS)])
    )


_QUARTERS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
"""Directions in plan."""


class BaseSlope(Effect):
    """A pedestal that is not level.

    The pedestal is turned about the point under the mass centre, and the rock with it; the motion
    stays horizontal. Uplift downhill begins at a = g tan(alpha - angle).
    """

    name = "base_slope"
    meaning = "The pedestal's top is not level; it falls towards the azimuth"
    parameters = (
        Parameter("angle", "degree", 0.0, 0.0, 1.5, "uniform", "of the slope", limits=(0.0, 20.0)),
        AZIMUTH,
    )
    channels = ("tilt", "slip", "rest pose")
    confounded_with = ("com_offset",)
    source = "statics of a block on an incline"
    stage = "geometry"
    rank = 3

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        turn = slope_rotation(values["angle"], values["azimuth"])
        before = matrix_from_quaternion(trial.scene.pedestal.slope)
        assert_stands(
            trial,
            np.zeros(2),
            turn @ before,
            key="effects.base_slope.angle",
            what=f"{values['angle']:g} degree",
        )
        rotation = matrix_from_quaternion(trial.start_pose.orientation)
        position = np.asarray(trial.start_pose.position)
        foot = rotation @ trial.scene.rock.mass.mass_center + position
        foot = foot - mass_height(trial) * before[:, 2]
        start = Pose(
            _triple(turn @ (position - foot) + foot),
            multiply(quaternion_from_matrix(turn), trial.start_pose.orientation),
        )
        pedestal = _turned(trial.scene.pedestal, turn, foot)
        return replace(trial.with_scene(pedestal=pedestal), start=start)

    def _joined(self, first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
        # Turns about horizontal axes add up but for a turn about the vertical of second order.
        return in_plan("angle", first, second)


def in_plan(size: str, first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
    """Sum of two vectors in plan, each with a size of this name and an `azimuth` [degree]."""
    both = sum(one[size] * direction(one["azimuth"]) for one in (first, second))
    x, y, _ = _triple(np.asarray(both))
    return {size: math.hypot(x, y), "azimuth": math.degrees(math.atan2(y, x)) % 360.0}


def slope_rotation(angle: float, azimuth: float) -> Array:
    """Rotation that tilts a level top so that it falls towards `azimuth`, both [degree]."""
    t = math.radians(angle)
    about_y = np.array(
        [[math.cos(t), 0.0, math.sin(t)], [0.0, 1.0, 0.0], [-math.sin(t), 0.0, math.cos(t)]]
    )
    heading = matrix_from_quaternion(yaw_quaternion(math.radians(azimuth)))
    turn: Array = heading @ about_y @ heading.T
    return turn


def _turned(pedestal: PedestalBody, turn: Array, about: Array) -> PedestalBody:
    """The pedestal turned about a point of the world; its frame keeps the world's axes."""
    origin = np.asarray(pedestal.origin)
    quaternion = quaternion_from_matrix(turn)

    def moved(points: Array) -> Array:
        placed: Array = (points + origin - about) @ turn.T + about - origin
        return placed

    parts: list[Hull | Box | Triangles] = []
    highest = []
    for part in pedestal.parts:
        if isinstance(part, Box):
            center = _triple(moved(np.asarray([part.center]))[0])
            box = replace(part, center=center, orientation=multiply(quaternion, part.orientation))
            parts.append(box)
            points = box_corners(box)
        elif isinstance(part, Hull):
            points = moved(part.points)
            parts.append(Hull(points))
        else:
            points = moved(part.vertices)
            parts.append(Triangles(points, part.faces))
        highest.append(float(points[:, 2].max()))
    surface = pedestal.surface
    return replace(
        pedestal,
        parts=tuple(parts),
        top=float(origin[2]) + max(highest),
        surface=None if surface is None else Triangles(moved(surface.vertices), surface.faces),
        pitch_pivot=pedestal.top if pedestal.pitch_pivot is None else pedestal.pitch_pivot,
        slope=multiply(quaternion, pedestal.slope),
    )
