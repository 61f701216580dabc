"""Effects on the shape of rock and pedestal, and on where the mass centre lies."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vsr2.effects.effect import Bench, Check, Effect
from vsr2.effects.parameter import Parameter
from vsr2.effects.rounding import rounded_hull
from vsr2.effects.setup import Setup, restand, settle_at
from vsr2.errors import GeometryError
from vsr2.scene import Box, Hull, PedestalBody, Pose, Support, Triangles, start_support
from vsr2.scene.rotation import (
    matrix_from_quaternion,
    multiply,
    quaternion_from_matrix,
    yaw_quaternion,
)
from vsr2.scene.shapes import box_corners, part_points

Array = NDArray[np.float64]

AZIMUTH = Parameter(
    "azimuth", "degree", 0.0, 0.0, 360.0, "uniform",
    "direction in plan, anticlockwise from x", limits=(-360.0, 360.0), secondary=True,
)  # fmt: skip
LEAST_RADIUS = 1e-4
"""Of the rounding of a hull [m]."""
SETTLING_FACTOR = 4.0
"""Times the default speeds, at which the rounded hull of a scan counts as settled."""


def direction(azimuth: float) -> Array:
    """Unit vector in plan at `azimuth` [degree], shape (3,)."""
    return np.array([math.cos(math.radians(azimuth)), math.sin(math.radians(azimuth)), 0.0])


def with_mass_center(setup: Setup, shift: Array) -> Setup:
    """The setup with the rock's mass centre moved by `shift`, in the world at the start [m]."""
    rock = setup.rock
    rotation = matrix_from_quaternion(setup.start.orientation)
    moved = rotation.T @ shift
    if not rock.inertia_from_aabb:
        mass = replace(rock.mass, mass_center=rock.mass.mass_center + moved)
        return replace(setup, rock=replace(rock, mass=mass))
    # Here the mass centre is the model's origin, so the shape moves the other way.
    parts = tuple(
        Hull(part.points - moved)
        if isinstance(part, Hull)
        else replace(part, center=_triple(np.asarray(part.center) - moved))
        for part in rock.parts
    )
    start = Pose(_triple(np.asarray(setup.start.position) + shift), setup.start.orientation)
    surface = rock.surface
    if surface is not None:
        surface = Triangles(surface.vertices - moved, surface.faces)
    return replace(setup, rock=replace(rock, parts=parts, surface=surface), start=start)


def support_of(setup: Setup) -> Support:
    """What the rock stands on, in the frame of the pedestal's top, which may slope."""
    x, y, z, w = setup.pedestal.slope
    level = multiply((-x, -y, -z, w), setup.start.orientation)
    return start_support(replace(setup.rock, start=Pose(setup.start.position, level)))


def mass_height(setup: Setup) -> float:
    """Height of the mass centre above the support at the start, along the top's normal [m]."""
    return support_of(setup).height


def half_widths(setup: Setup) -> tuple[float, float]:
    """Distances along x from the mass centre to the ends of the support, towards -x and +x [m].

    Along the top where it slopes.
    """
    polygon = support_of(setup).polygon
    return float(-polygon[:, 0].min()), float(polygon[:, 0].max())


def assert_stands(setup: Setup, shift: Array, slope: Array, where: str) -> None:
    """Refuse to take the mass centre beyond a rock's support: it would fall while it settles.

    Starts in which a rock does not stand anyway are left to the settling.

    Args:
        setup: before the change.
        shift: by which the mass centre moves over the base, along the top, shape (2,) [m].
        slope: rotation of the top from level after the change, shape (3, 3).
        where: what does it, in front of the error.

    Raises:
        GeometryError: the vertical through the mass centre leaves the support.
    """
    try:
        support = support_of(setup)
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
            f"{where} takes the mass centre beyond the rock's support, so that it falls before the "
            "motion begins; make it smaller"
        )


def uplift_acceleration(
    bench: Bench, setup: Setup, effect: Effect | None, values: Mapping[str, float], guess: float
) -> float:
    """Least constant acceleration of the pedestal that tips a block, by bisection [m/s^2].

    Tipped: the tilt passes 1e-3 rad while the push lasts. The bracket shrinks to 1 % of the guess;
    its middle is told. Just above the threshold a tilt grows by about g alpha p^2 t^2 / 2 times the
    relative excess, so a push of 0.6 s tells an excess of 0.3 %.
    """
    low, high = 0.75 * guess, 1.25 * guess
    while high - low > 0.01 * guess:
        middle = 0.5 * (low + high)
        response = bench.run(replace(setup, motion=bench.push(middle)), effect, values)
        if float(response.tilt.max()) > 1e-3:
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)


def _triple(vector: Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in vector)
    return (x, y, z)


class Slenderness(Effect):
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
        ),
    )  # fmt: skip
    channels = ("tilt",)
    confounded_with = ("table_gain", "edge_rounding")
    source = "Housner (1963), Bull. Seismol. Soc. Am. 53(2)"
    stage = "geometry"

    def change(self, setup: Setup, values: Mapping[str, float]) -> Setup:
        height = mass_height(setup)
        lift = height / (1.0 + values["change"]) - height
        up = matrix_from_quaternion(setup.pedestal.slope) @ np.array([0.0, 0.0, 1.0])
        return with_mass_center(setup, lift * up)

    def verify(self, bench: Bench) -> Sequence[Check]:
        setup = bench.block()
        change = 0.06
        _, b = half_widths(setup)
        expected = setup.engine.gravity * b / mass_height(setup) * (1 + change)
        return [
            Check(
                "uplift at a = g (1 + change) b / h [m/s^2]",
                uplift_acceleration(bench, setup, self, {"change": change}, expected),
                expected,
                0.01 * expected,
            )
        ]


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

    def change(self, setup: Setup, values: Mapping[str, float]) -> Setup:
        shift = values["distance"] * direction(values["azimuth"])
        slope = matrix_from_quaternion(setup.pedestal.slope)
        where = f"effects.com_offset.distance: {values['distance']:g} m"
        assert_stands(setup, shift[:2], slope, where)
        return with_mass_center(setup, slope @ shift)

    def verify(self, bench: Bench) -> Sequence[Check]:
        setup, distance = bench.block(), 0.015
        b, _ = half_widths(setup)
        expected = setup.engine.gravity * (b - distance) / mass_height(setup)
        return [
            Check(
                "uplift towards the shift at a = g (b - d) / h [m/s^2]",
                uplift_acceleration(
                    bench, setup, self, {"distance": distance, "azimuth": 180.0}, expected
                ),
                expected,
                0.01 * expected,
            )
        ]


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

    def change(self, setup: Setup, values: Mapping[str, float]) -> Setup:
        rotation = matrix_from_quaternion(setup.start.orientation)
        down = -rotation.T @ matrix_from_quaternion(setup.pedestal.slope)[:, 2]
        radius, margin = values["radius"], setup.engine.collision_margin
        parts: list[Hull | Box] = []
        for part, points in zip(setup.rock.parts, part_points(setup.rock.parts), strict=True):
            # The engine's margin lies inside a box and around a hull.
            if isinstance(part, Box) and radius < margin:
                hull = box_with_margin(part, setup, radius)
            elif isinstance(part, Box):
                hull = rounded_hull(points, radius, down, ball=radius - margin)
            elif radius < LEAST_RADIUS:
                hull = part.points
            else:
                hull = rounded_hull(points, radius, down)
            parts.append(Hull(hull))
        kept = tuple(parts)
        if radius >= LEAST_RADIUS and any(isinstance(part, Hull) for part in setup.rock.parts):
            setup = settle_at(setup, SETTLING_FACTOR)
        return replace(setup, rock=replace(setup.rock, parts=kept), start=restand(setup, kept))

    def verify(self, bench: Bench) -> Sequence[Check]:
        setup, radius = bench.block(), 0.015
        _, b = half_widths(setup)
        expected = setup.engine.gravity * (b - radius) / mass_height(setup)
        return [
            Check(
                "uplift at a = g (b - r) / h [m/s^2]",
                uplift_acceleration(bench, setup, self, {"radius": radius}, expected),
                expected,
                0.01 * expected,
            ),
            self._rolling(bench, radius),
        ]

    def _rolling(self, bench: Bench, radius: float) -> Check:
        setup = bench.block()
        _, b = half_widths(setup)
        h = mass_height(setup)
        tilt = 0.15
        started = self.change(setup, {"radius": radius})
        response = bench.release(started, tilt, 0.15)
        mass, inertia = setup.rock.mass.mass, float(setup.rock.mass.principal_inertia[1])
        # Rolling on the arc about its centre, r above the ground and b - r beside the mass
        # centre: potential energy m g (h cos t + (b - r) sin t + r (1 - cos t)).
        g = setup.engine.gravity
        last = int(np.flatnonzero(response.tilt > 0.03)[-1])
        kinetic = 0.5 * mass * float((response.velocity[last] ** 2).sum()) + 0.5 * inertia * float(
            (response.angular_velocity[last] ** 2).sum()
        )

        def potential(t: float) -> float:
            raised = h * math.cos(t) + (b - radius) * math.sin(t) + radius * (1 - math.cos(t))
            return mass * g * raised

        expected = potential(tilt) - potential(float(response.tilt[last]))
        return Check(
            "kinetic energy of free rolling on the round edge from 0.15 rad, by conservation [J]",
            kinetic,
            expected,
            0.03 * expected,
        )


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

    def change(self, setup: Setup, values: Mapping[str, float]) -> Setup:
        # In the frame of the pedestal's top.
        slope = matrix_from_quaternion(setup.pedestal.slope)
        rotation = slope.T @ matrix_from_quaternion(setup.start.orientation)
        support = support_of(setup)
        tips = np.column_stack(
            [
                values["reach"] * bump_places(support.polygon),
                np.full(4, -support.height - values["height"]),
            ]
        )
        in_model = tips @ rotation + setup.rock.mass.mass_center
        points = part_points(setup.rock.parts)
        parts: tuple[Hull | Box, ...]
        if len(setup.rock.parts) == 1:
            # On an even top a body touches with its convex hull only.
            old = setup.rock.parts[0]
            corners = points[0] if isinstance(old, Hull) else box_with_margin(old, setup)
            parts = (Hull(np.vstack([corners, in_model + self._lift(old, setup, rotation)])),)
        else:
            up = rotation[2]
            parts = setup.rock.parts + tuple(_bump(tip, up, values["height"]) for tip in in_model)
        return replace(setup, rock=replace(setup.rock, parts=parts), start=restand(setup, parts))

    @staticmethod
    def _lift(part: Hull | Box, setup: Setup, rotation: Array) -> Array:
        margin = setup.engine.collision_margin if isinstance(part, Box) else 0.0
        lift: Array = margin * rotation[2]
        return lift

    def verify(self, bench: Bench) -> Sequence[Check]:
        setup, values = bench.block(), {"height": 0.002, "reach": 0.7}
        support = support_of(setup)
        reach = 0.7 * float(bump_places(support.polygon)[:, 0].max())
        expected = setup.engine.gravity * reach / (support.height + 0.002)
        return [
            Check(
                "uplift about the bumps at a = g x / (h + height) [m/s^2]",
                uplift_acceleration(bench, setup, self, values, expected),
                expected,
                0.03 * expected,
            ),
            self._impact(bench),
        ]

    def _impact(self, bench: Bench) -> Check:
        setup, tilt, values = bench.block(), 0.1, {"height": 1e-4, "reach": 0.7}
        support = support_of(setup)
        edge, h = half_widths(setup)[1], support.height
        tip = values["reach"] * float(bump_places(support.polygon)[:, 0].max())
        per_mass = float(setup.rock.mass.principal_inertia[1]) / setup.rock.mass.mass + h * h
        # Angular momentum about the new foot is kept: Housner's impact, three times.
        expected = 1.0
        for old, new in ((edge, tip), (tip, -tip), (-tip, -edge)):
            expected *= (per_mass + old * new) ** 2
            expected /= (per_mass + old * old) * (per_mass + new * new)
        response = bench.release(self.change(setup, values), tilt, 0.6)
        landed = int(np.argmin(response.tilt))
        alpha = math.atan2(edge, h)

        def potential(t: float) -> float:
            return math.cos(alpha - t) - math.cos(alpha)

        return Check(
            "energy left by an impact on low bumps, Housner's from edge to tip to tip to edge [1]",
            potential(float(response.tilt[landed:].max())) / potential(tilt),
            expected,
            0.02,
        )


def bump_places(polygon: Array) -> Array:
    """Where diagonals in plan leave a polygon around the origin, shape (4, 2) [m]."""
    half = np.ptp(polygon, axis=0)
    places = []
    for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
        along = np.array([x * half[0], y * half[1]]) / float(np.hypot(*half))
        following = np.roll(polygon, -1, axis=0) - polygon
        normal = np.column_stack([following[:, 1], -following[:, 0]])
        offset, slope = (normal * polygon).sum(axis=1), normal @ along
        ahead = slope > 1e-12
        places.append(along * float((offset[ahead] / slope[ahead]).min()))
    return np.asarray(places)


def box_with_margin(box: Box, setup: Setup, radius: float = 0.0) -> Array:
    """Corners of a hull that stands, with the engine's margin around it, on a box's base.

    Args:
        box: part of the rock.
        setup: with the start that tells which faces are base and top.
        radius: by which the base is narrower on each side, up to the margin [m].
    """
    margin = setup.engine.collision_margin
    start = matrix_from_quaternion(setup.start.orientation)
    slope = matrix_from_quaternion(setup.pedestal.slope)
    axes = slope.T @ start @ matrix_from_quaternion(box.orientation)
    inwards = [radius, radius, radius]
    inwards[int(np.argmax(np.abs(axes[2])))] = margin
    x, y, z = (edge - 2 * inward for edge, inward in zip(box.size, inwards, strict=True))
    return box_corners(replace(box, size=(x, y, z)))


def _bump(tip: Array, up: Array, height: float) -> Hull:
    """A cone on its tip, twice as wide as high, whose rim lies inside the rock."""
    side = np.cross(up, [1.0, 0.0, 0.0] if abs(up[0]) < 0.9 else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    other = np.cross(up, side)
    rim = tip + 2 * height * up
    return Hull(
        np.vstack([tip, *(rim + 2 * height * (c * side + s * other) for c, s in _QUARTERS)])
    )


_QUARTERS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))


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

    def change(self, setup: Setup, values: Mapping[str, float]) -> Setup:
        turn = slope_rotation(values["angle"], values["azimuth"])
        before = matrix_from_quaternion(setup.pedestal.slope)
        where = f"effects.base_slope.angle: {values['angle']:g} degree"
        assert_stands(setup, np.zeros(2), turn @ before, where)
        rotation = matrix_from_quaternion(setup.start.orientation)
        position = np.asarray(setup.start.position)
        foot = rotation @ setup.rock.mass.mass_center + position
        foot = foot - mass_height(setup) * before[:, 2]
        start = Pose(
            _triple(turn @ (position - foot) + foot),
            multiply(quaternion_from_matrix(turn), setup.start.orientation),
        )
        return replace(setup, pedestal=_turned(setup.pedestal, turn, foot), start=start)

    def verify(self, bench: Bench) -> Sequence[Check]:
        setup, angle = bench.block(), 1.5
        b, _ = half_widths(setup)
        alpha = math.atan2(b, mass_height(setup))
        expected = setup.engine.gravity * math.tan(alpha - math.radians(angle))
        return [
            Check(
                "uplift downhill at a = g tan(alpha - slope) [m/s^2]",
                uplift_acceleration(
                    bench, setup, self, {"angle": angle, "azimuth": 180.0}, expected
                ),
                expected,
                0.01 * expected,
            )
        ]


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
            highest.append(float(box_corners(box)[:, 2].max()))
        elif isinstance(part, Hull):
            parts.append(Hull(moved(part.points)))
            highest.append(float(moved(part.points)[:, 2].max()))
        else:
            parts.append(Triangles(moved(part.vertices), part.faces))
            highest.append(float(moved(part.vertices)[:, 2].max()))
    surface = pedestal.surface
    return replace(
        pedestal,
        parts=tuple(parts),
        top=float(origin[2]) + max(highest),
        surface=None if surface is None else Triangles(moved(surface.vertices), surface.faces),
        pitch_pivot=pedestal.top if pedestal.pitch_pivot is None else pedestal.pitch_pivot,
        slope=multiply(quaternion, pedestal.slope),
    )


GEOMETRY: tuple[Effect, ...] = (
    Slenderness(), ComOffset(), EdgeRounding(), BaseAsperity(), BaseSlope()
)  # fmt: skip
