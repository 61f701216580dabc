"""Closed forms of mechanisms, of what changes over a campaign, of outcomes and starts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from effect_closed_forms.block import (
    at_order,
    half_widths,
    rocking,
    turning_rate,
    uplift_check,
)
from effect_closed_forms.forms import closed_form
from vsr2.effects import Bench, Check, Circumstances, Effect, library
from vsr2.effects.standing import mass_height, support_of
from vsr2.trial import Observation


@closed_form
def restitution(effect: Effect, bench: Bench) -> list[Check]:
    checks = []
    trial = bench.block()
    _, alpha, _ = rocking(trial)
    housner = (1 - 1.5 * math.sin(alpha) ** 2) ** 2
    for ratio in (0.65, 1.0, 1.1):
        tilt = 0.15
        response = bench.release(effect.change(trial, {"energy_ratio": ratio}), tilt, 1.2)
        landed = int(np.flatnonzero(response.tilt < 0.01)[0])
        peak = float(response.tilt[landed:].max())
        measured = (math.cos(alpha - peak) - math.cos(alpha)) / (
            math.cos(alpha - tilt) - math.cos(alpha)
        )
        checks.append(
            Check(
                f"energy kept over the first impact at ratio {ratio:g}, times Housner's "
                f"{housner:.3f} [1]",
                measured,
                ratio * housner,
                0.03,
            )
        )
    return checks


@closed_form
def rocking_damping(effect: Effect, bench: Bench) -> list[Check]:
    trial, tilt, duration, zeta = bench.block(), 0.1, 0.2, 0.05
    _, _, p = rocking(trial)
    free = turning_rate(bench.release(trial, tilt, duration))
    damped = turning_rate(bench.release(effect.change(trial, {"ratio": zeta}), tilt, duration))
    # phi = alpha - tilt follows phi'' + 2 zeta p phi' - p^2 phi = 0 from rest, so its rate is
    # phi0 p^2 (e^(s1 t) - e^(s2 t)) / (s1 - s2), s = p (-zeta +- sqrt(1 + zeta^2)).
    root = math.sqrt(1 + zeta**2)
    share = math.exp(-zeta * p * duration) * math.sinh(p * root * duration) / root
    expected = 1 - share / math.sinh(p * duration)
    return [
        Check(
            "loss of rate in free rocking for 0.2 s, from phi'' + 2 zeta p phi' = p^2 phi [1]",
            1 - damped / free,
            expected,
            0.1 * expected,
        )
    ]


@closed_form
def rolling_resistance(effect: Effect, bench: Bench) -> list[Check]:
    trial, tilt, duration, arm = bench.block(), 0.05, 0.15, 0.010
    radius, alpha, p = rocking(trial)
    free = turning_rate(bench.release(trial, tilt, duration))
    slowed = turning_rate(bench.release(effect.change(trial, {"arm": arm}), tilt, duration))
    # The normal force is m (g - b p^2 phi) as the mass centre falls.
    b = radius * math.sin(alpha)
    lever = p**2 * (alpha - tilt) * math.cosh(0.5 * p * duration)
    bearing = 1 - b * lever / trial.scene.engine.gravity
    expected = arm * bearing / (radius * math.sin(alpha - tilt))
    return [
        Check(
            "loss of rate in free rocking, N a / (m g R sin(alpha - tilt)) [1]",
            1 - slowed / free,
            expected,
            0.1 * expected,
        )
    ]


@closed_form
def friction_rate(effect: Effect, bench: Bench) -> list[Check]:
    factor, ratio = 0.306, 1.6
    trial = library()["friction"].change(bench.block(), {"factor": factor})
    rock, pedestal = trial.scene.contact.rock, trial.scene.contact.pedestal
    kinetic = rock.lateral_friction * pedestal.lateral_friction * trial.scene.engine.gravity
    values = {"ratio": ratio, "speed": 0.01}
    held = bench.run(replace(trial, motion=bench.push(0.9 * ratio * kinetic)), effect, values)
    sliding = bench.run(replace(trial, motion=bench.push(1.2 * ratio * kinetic)), effect, values)
    kept = sliding.time > sliding.time[-1] - 0.3
    slope = float(np.polyfit(sliding.time[kept], sliding.velocity[kept, 0], 1)[0])
    travel = (held.position[:, 0] - held.pedestal) - held.position[0, 0]
    return [
        Check(
            "slip at 0.9 of the static onset, above the kinetic one [m]",
            float(np.abs(travel[held.time < 0.6]).max()), 0.0, 1e-3,
        ),
        Check(
            "acceleration in sliding, mu_k g [m/s^2]", slope, kinetic, 0.03 * kinetic
        ),
    ]  # fmt: skip


@closed_form
def adhesion(effect: Effect, bench: Bench) -> list[Check]:
    trial, strength = bench.block(), 5.0
    _, b = half_widths(trial)
    polygon = support_of(trial).polygon
    following = np.roll(polygon, -1, axis=0)
    area = 0.5 * float((polygon[:, 0] * following[:, 1] - polygon[:, 1] * following[:, 0]).sum())
    weight = trial.scene.rock.mass.mass * trial.scene.engine.gravity
    own = trial.scene.engine.gravity * b / mass_height(trial)
    expected = own * (1 + 1e3 * strength * area / weight)
    values = {"strength": strength}
    return [
        uplift_check(
            bench, effect, values, expected, "at a = g b / h (1 + sigma A / (m g))", tolerance=0.02
        )
    ]


@closed_form
def catch(effect: Effect, bench: Bench) -> list[Check]:
    slack = 25.0
    trial = replace(bench.block(), motion=bench.pulse(6.0, 1.5))
    response = bench.run(trial, effect, {"slack": slack}, tail=3.0)
    free = bench.run(trial, tail=3.0)
    return [
        Check("without it the block overturns [1]", free.observation.overturned, 1.0, 0.0),
        Check(
            "greatest tilt, the slack and at most 0.05 rad of stretch [rad]",
            float(response.tilt.max()), math.radians(slack) + 0.025, 0.025,
        ),
        Check(
            "tilt in the end, hanging in the tether [rad]",
            float(response.tilt[-1]), math.radians(slack), 0.005,
        ),
    ]  # fmt: skip


@closed_form
def wear(effect: Effect, bench: Bench) -> list[Check]:
    trial = bench.block()
    _, b = half_widths(trial)
    before = b / mass_height(trial)
    checks = []
    for order in (0.0, 0.5, 1.0):
        worn = at_order(effect, trial, {"loss": 0.15}, order)
        checks.append(
            Check(
                f"tan(alpha) at order {order:g}, 1 - loss order of the first [1]",
                b / mass_height(worn) / before,
                1 - 0.15 * order,
                1e-9,
            )
        )
    return checks


@closed_form
def change_point(effect: Effect, bench: Bench) -> list[Check]:
    trial = bench.block()
    _, b = half_widths(trial)
    before = b / mass_height(trial)
    values = {"at": 0.6, "slenderness_change": -0.1}
    checks = []
    for session, expected in (("a", 1.0), ("b", 1.0), ("c", 1.0), ("d", 0.9), ("e", 0.9)):
        then = at_order(effect, trial, values, "abcde".index(session) / 4)
        checks.append(
            Check(
                f"tan(alpha) in session {session} of five, over the first [1]",
                b / mass_height(then) / before,
                expected,
                1e-9,
            )
        )
    return checks


@closed_form
def session(effect: Effect, bench: Bench) -> list[Check]:
    trial = replace(bench.block(), motion=bench.pulse(4.0, 2.0))
    values = {
        "at": 0.4, "registration_yaw": 12.0, "slenderness_change": -0.1, "friction_factor": 0.5,
        "table_gain_change": 0.1,
    }  # fmt: skip
    checks = []
    for order, stepped in zip((0.0, 0.25, 0.5, 1.0), (False, False, True, True), strict=True):
        then = at_order(effect, trial, values, order)
        turned = then.start_pose.orientation
        rough = [
            one.scene.contact.rock.lateral_friction * one.scene.contact.pedestal.lateral_friction
            for one in (then, trial)
        ]
        found = {
            "turn of the start [degree]": (
                math.degrees(2 * math.atan2(turned[2], turned[3])), 12.0 * stepped
            ),
            "tan(alpha) over that before [1]": (
                mass_height(trial) / mass_height(then), 0.9 if stepped else 1.0
            ),
            "friction over that before [1]": (rough[0] / rough[1], 0.5 if stepped else 1.0),
            "PGA over that before [1]": (
                then.motion.pga_g / trial.motion.pga_g, 1.1 if stepped else 1.0
            ),
        }  # fmt: skip
        session = "abcde"[round(4 * order)]
        checks += [
            Check(f"session {session} of five: {what}", measured, expected, 1e-9)
            for what, (measured, expected) in found.items()
        ]
    return checks


@closed_form
def outcome_rule(effect: Effect, bench: Bench) -> list[Check]:
    trial = replace(bench.block(), motion=bench.pulse(4.5, 2.0))
    plain = bench.run(trial, tail=2.0)
    peak = plain.observation.peak_tilt
    flipped = 0
    written = Observation("rocked", 0.05, 0.0, 0.0, 0.0)
    for i in range(2000):
        rng = np.random.default_rng(np.random.SeedSequence(1, spawn_key=(i,)))
        there = Circumstances(0.0, "1", ("1",), rng)
        here = effect.at({"tilt": math.pi, "flips": 0.03}, there)
        flipped += effect.observe(written, here).overturned
    return [
        Check(
            "overturned with the threshold just below the largest tilt [1]",
            bench.run(trial, effect, {"tilt": 0.99 * peak}, tail=2.0).observation.overturned,
            1.0, 0.0,
        ),
        Check(
            "overturned with the threshold just above it [1]",
            bench.run(trial, effect, {"tilt": 1.01 * peak}, tail=2.0).observation.overturned,
            0.0, 0.0,
        ),
        Check(
            "share of 2000 trials flipped, within 3 standard errors [1]",
            flipped / 2000, 0.03, 3 * math.sqrt(0.03 * 0.97 / 2000),
        ),
    ]  # fmt: skip


@closed_form
def placement(effect: Effect, bench: Bench) -> list[Check]:
    trial = bench.block()
    values = {"yaw": 10.0, "offset": 0.02}
    drawn = []
    for i in range(200):
        rng = np.random.default_rng(np.random.SeedSequence(0, spawn_key=(i,)))
        drawn.append(effect.at(values, Circumstances(0.0, "1", ("1",), rng)))
    yaw = np.array([one["yaw"] for one in drawn])
    offset = np.array([one["offset"] for one in drawn])
    turned = effect.change(trial, drawn[0]).start_pose
    half = math.atan2(turned.orientation[2], turned.orientation[3])
    return [
        Check("mean square turn, yaw^2 / 3 [degree^2]", float((yaw**2).mean()), 100 / 3, 5.0),
        Check("mean square shift, offset^2 / 2 [m^2]", float((offset**2).mean()), 2e-4, 2e-5),
        Check("turn of the start pose [degree]", math.degrees(2 * half), yaw[0], 1e-9),
    ]
