"""Closed forms of effects on contact, geometry and inertia."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from effect_closed_forms.block import (
    half_widths,
    uplift_acceleration,
    uplift_check,
)
from effect_closed_forms.forms import closed_form
from vsr2.config.study import Contact
from vsr2.effects import Bench, Check, Effect, library
from vsr2.effects.geometry import bump_positions
from vsr2.effects.standing import mass_height, support_of
from vsr2.motion import SideMotion
from vsr2.scene import Hull
from vsr2.trial import Trial


@closed_form
def contact_stiffness(effect: Effect, bench: Bench) -> list[Check]:
    trial, decades = bench.block(), -4.0
    still = replace(trial, motion=bench.push(0.0))
    before = bench.run(still).position[-1, 2]
    after = bench.run(still, effect, {"decades": decades}).position[-1, 2]
    rock, pedestal = trial.scene.contact.rock, trial.scene.contact.pedestal
    pair = rock.stiffness * pedestal.stiffness / (rock.stiffness + pedestal.stiffness)
    weight = trial.scene.rock.mass.mass * trial.scene.engine.gravity
    expected = weight / (4 * pair) * (10.0**-decades - 1)
    return [
        Check(
            "sinking at rest on four points, m g / (4 k) [m]",
            float(before - after),
            expected,
            0.1 * expected,
        )
    ]


@closed_form
def friction(effect: Effect, bench: Bench) -> list[Check]:
    trial = bench.block()
    factor = 0.306
    mu = (
        factor
        * trial.scene.contact.rock.lateral_friction
        * trial.scene.contact.pedestal.lateral_friction
    )
    g = trial.scene.engine.gravity
    above = bench.run(replace(trial, motion=bench.push(1.5 * mu * g)), effect, {"factor": factor})
    below = bench.run(replace(trial, motion=bench.push(0.9 * mu * g)), effect, {"factor": factor})
    speed = above.velocity[:, 0]
    kept = above.time > above.time[-1] - 0.3
    slope = float(np.polyfit(above.time[kept], speed[kept], 1)[0])
    travel = (below.position[:, 0] - below.pedestal) - below.position[0, 0]
    return [
        Check("acceleration of a sliding block, mu g [m/s^2]", slope, mu * g, 0.02 * mu * g),
        Check(
            "slip below the onset [m]",
            float(np.abs(travel[below.time < 0.6]).max()),
            0.0,
            1e-4,
        ),
    ]


@closed_form
def spin_friction(effect: Effect, bench: Bench) -> list[Check]:
    coefficient, rate, duration = 0.02, 1.0, 0.1
    # Without friction along the base the contact points resist no turn.
    block = bench.block()
    slippery = block.scene.contact.rock.model_copy(update={"lateral_friction": 1e-3})
    slick = block.with_scene(contact=Contact(rock=slippery, pedestal=slippery))
    trial = effect.change(slick, {"coefficient": coefficient})
    response = bench.release(trial, 0.0, duration, spin=rate)
    mass = trial.scene.rock.mass
    gravity = trial.scene.engine.gravity
    slowing = coefficient * mass.mass * gravity / float(mass.principal_inertia[2])
    begun = response.time > 0.03
    fit = np.polyfit(response.time[begun], response.angular_velocity[begun, 2], 1)
    return [
        Check(
            "slowing of a spinning block, coefficient m g / I_z (torque in m N) [rad/s^2]",
            -float(fit[0]),
            slowing,
            0.05 * slowing,
        )
    ]


@closed_form
def slenderness(effect: Effect, bench: Bench) -> list[Check]:
    trial = bench.block()
    change = 0.06
    _, b = half_widths(trial)
    expected = trial.scene.engine.gravity * b / mass_height(trial) * (1 + change)
    values = {"change": change}
    return [uplift_check(bench, effect, values, expected, "at a = g (1 + change) b / h")]


@closed_form
def registration(effect: Effect, bench: Bench) -> list[Check]:
    block, turn, lean, offset = bench.block(), 25.0, 2.0, 0.015
    b, _ = half_widths(block)
    h, g = mass_height(block), block.scene.engine.gravity
    # Turned by the angle, the block feels the motion turned by it backwards.
    pulse = bench.pulse(4.5, 2.0)
    along, across = math.cos(math.radians(turn)), -math.sin(math.radians(turn))
    side = SideMotion(across * pulse.displacement, across * pulse.velocity)
    driven = replace(block, motion=replace(pulse.scaled(along), transverse=side))
    expected = bench.run(driven).observation.peak_tilt
    turned = bench.run(replace(block, motion=pulse), effect, effect.complete({"yaw": turn}))
    uneven = library()["com_offset"].change(block, {"distance": offset, "azimuth": 180.0})
    mirrored = g * (b + offset) / h
    s, c = math.sin(math.radians(lean)), math.cos(math.radians(lean))
    leaning = g * (b - h * s) / (h * c)
    values = effect.complete({"lean": lean, "lean_azimuth": 180.0})
    axes = effect.change(block, values).scene.rock.mass.principal_axes
    return [
        Check(
            "largest tilt of a turned block, as under the motion turned backwards [rad]",
            turned.observation.peak_tilt, expected, 0.01 * expected,
        ),
        Check(
            "uplift of an uneven block after half a turn, at a = g (b + d) / h [m/s^2]",
            uplift_acceleration(bench, uneven, effect, effect.complete({"yaw": 180.0}), mirrored),
            mirrored, 0.01 * mirrored,
        ),
        Check(
            "uplift towards the lean at a = g (b - h sin(lean)) / (h cos(lean)) [m/s^2]",
            uplift_acceleration(bench, block, effect, values, leaning), leaning, 0.01 * leaning,
        ),
        Check(
            "a principal axis lies by the lean off the vertical [degree]",
            math.degrees(math.acos(axes[2, 2])), lean, 1e-9,
        ),
    ]  # fmt: skip


@closed_form
def com_offset(effect: Effect, bench: Bench) -> list[Check]:
    trial, distance = bench.block(), 0.015
    b, _ = half_widths(trial)
    expected = trial.scene.engine.gravity * (b - distance) / mass_height(trial)
    values = {"distance": distance, "azimuth": 180.0}
    return [uplift_check(bench, effect, values, expected, "towards the shift at a = g (b - d) / h")]


@closed_form
def edge_rounding(effect: Effect, bench: Bench) -> list[Check]:
    trial, radius = bench.block(), 0.015
    _, b = half_widths(trial)
    expected = trial.scene.engine.gravity * (b - radius) / mass_height(trial)
    return [
        uplift_check(bench, effect, {"radius": radius}, expected, "at a = g (b - r) / h"),
        _rolling(effect, bench, radius),
    ]


def _rolling(effect: Effect, bench: Bench, radius: float) -> Check:
    trial = bench.block()
    _, b = half_widths(trial)
    h = mass_height(trial)
    tilt = 0.15
    started = effect.change(trial, {"radius": radius})
    response = bench.release(started, tilt, 0.15)
    mass, inertia = trial.scene.rock.mass.mass, float(trial.scene.rock.mass.principal_inertia[1])
    # Rolling on the arc about its centre, r above the ground and b - r beside the mass
    # centre: potential energy m g (h cos t + (b - r) sin t + r (1 - cos t)).
    g = trial.scene.engine.gravity
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


@closed_form
def support(effect: Effect, bench: Bench) -> list[Check]:
    trial = bench.block()
    _, b = half_widths(trial)
    slope = trial.scene.engine.gravity / mass_height(trial)
    checks = []
    for values, width in (
        ({"shrink": 0.01}, b - 0.01),
        ({"shrink": -0.01}, b + 0.01),
        ({"rim": 0.01}, b - 0.01),
        ({"shrink": 0.005, "rim": 0.01}, b - 0.015),
        # What is flat stays as it is.
        ({"flat": 0.003, "smoothing": 0.001}, b),
    ):
        expected = slope * width
        checks.append(
            Check(
                f"uplift with {values} at a = g (b - shrink - rim) / h [m/s^2]",
                uplift_acceleration(bench, trial, effect, values, expected),
                expected,
                0.01 * expected,
            )
        )
    return [*checks, *_bowl(effect, trial)]


def _bowl(effect: Effect, trial: Trial) -> list[Check]:
    """On a body with a round base: its section, and its points brought back to it."""
    curvature, depth, bumps = 1.0, 0.002, 0.0005
    radii, angles = np.meshgrid(
        np.linspace(0.002, 0.12, 60), np.linspace(0, 2 * math.pi, 144, endpoint=False)
    )
    x, y = (radii * np.cos(angles)).ravel(), (radii * np.sin(angles)).ravel()
    even = np.column_stack([x, y, 0.5 * curvature * (x**2 + y**2) - 0.6])
    lid = np.array([[0.3, 0.3, 0.6], [-0.3, 0.3, 0.6], [-0.3, -0.3, 0.6], [0.3, -0.3, 0.6]])

    def changed(base: NDArray[np.float64], values: dict[str, float]) -> NDArray[np.float64]:
        rock = replace(trial.scene.rock, parts=(Hull(np.vstack([base, lid])),))
        made = effect.change(trial.with_scene(rock=rock), effect.complete(values))
        (part,) = made.scene.rock.parts
        assert isinstance(part, Hull)
        return part.points

    flat = changed(even, {"flat": depth})
    lowest = flat[flat[:, 2] < flat[:, 2].min() + 1e-9]
    radius = float(np.hypot(lowest[:, 0], lowest[:, 1]).max())
    rough = even + np.random.default_rng(0).uniform(-bumps, bumps, (len(even), 1)) * [0, 0, 1]
    # The hull's own points, to which the bowl is fitted, lie on its lower side.
    smooth = changed(rough, {"smoothing": 3 * bumps})
    near = smooth[smooth[:, 2] < smooth[:, 2].min() + 0.004]
    height = 0.5 * curvature * (near[:, 0] ** 2 + near[:, 1] ** 2)
    return [
        Check(
            "radius of the flat of a bowl z = c r^2 / 2, sqrt(2 depth / c) [m]",
            radius, math.sqrt(2 * depth / curvature), 5e-4,
        ),
        Check(
            "roughness of a bowl smoothed by more than it is rough [m]",
            float((near[:, 2] - height).std()), 0.0, 0.2 * bumps,
        ),
    ]  # fmt: skip


@closed_form
def base_asperity(effect: Effect, bench: Bench) -> list[Check]:
    trial, values = bench.block(), {"height": 0.002, "reach": 0.7}
    support = support_of(trial)
    reach = 0.7 * float(bump_positions(support.polygon)[:, 0].max())
    expected = trial.scene.engine.gravity * reach / (support.height + 0.002)
    return [
        uplift_check(
            bench,
            effect,
            values,
            expected,
            "about the bumps at a = g x / (h + height)",
            tolerance=0.03,
        ),
        _impact(effect, bench),
    ]


def _impact(effect: Effect, bench: Bench) -> Check:
    trial, tilt, values = bench.block(), 0.1, {"height": 1e-4, "reach": 0.7}
    support = support_of(trial)
    edge, h = half_widths(trial)[1], support.height
    tip = values["reach"] * float(bump_positions(support.polygon)[:, 0].max())
    mass = trial.scene.rock.mass
    per_mass = float(mass.principal_inertia[1]) / mass.mass + h * h
    # Angular momentum about the new foot is kept: Housner's impact, three times.
    expected = 1.0
    for old, new in ((edge, tip), (tip, -tip), (-tip, -edge)):
        expected *= (per_mass + old * new) ** 2
        expected /= (per_mass + old * old) * (per_mass + new * new)
    response = bench.release(effect.change(trial, values), tilt, 0.6)
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


@closed_form
def base_slope(effect: Effect, bench: Bench) -> list[Check]:
    trial, angle = bench.block(), 1.5
    b, _ = half_widths(trial)
    alpha = math.atan2(b, mass_height(trial))
    expected = trial.scene.engine.gravity * math.tan(alpha - math.radians(angle))
    values = {"angle": angle, "azimuth": 180.0}
    return [uplift_check(bench, effect, values, expected, "downhill at a = g tan(alpha - slope)")]


@closed_form
def inertia(effect: Effect, bench: Bench) -> list[Check]:
    trial, change = bench.block(), 0.15
    started = effect.change(trial, {"change": change, "rule": 0.0})
    tilt, duration = 0.05, 0.1
    response = bench.release(started, tilt, duration)
    _, b = half_widths(trial)
    h = mass_height(trial)
    radius, alpha = math.hypot(b, h), math.atan2(b, h)
    mass = trial.scene.rock.mass
    about_edge = (1 + change) * float(mass.principal_inertia[1]) + mass.mass * radius**2
    p = math.sqrt(mass.mass * trial.scene.engine.gravity * radius / about_edge)
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
