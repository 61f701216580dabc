"""Closed forms, conservation laws and independent computations that the library's effects meet.

One function an effect, of its name and marked by `closed_form`: it takes the effect and a bench and
gives the checks. `tests/python/test_effects_library.py` holds each effect to them;
`studies/effect_checks.py` counts them. They stand outside the package, because an installed VSR2
never runs them. An effect of one's own has its checks in its own `verify`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from vsr2.config.study import Contact
from vsr2.effects import Bench, Check, Circumstances, Effect, Response, library, with_effects
from vsr2.effects.actuation import FILTER_ORDER
from vsr2.effects.geometry import bump_positions
from vsr2.effects.standing import mass_height, support_of
from vsr2.motion import STANDARD_GRAVITY
from vsr2.motion.processing import differentiate
from vsr2.trial import Observation, Trial

Form = Callable[[Effect, Bench], list[Check]]
FORMS: dict[str, Form] = {}
"""By the name of the effect."""


def closed_form(form: Form) -> Form:
    """Take a function for the checks of the effect of its name."""
    FORMS[form.__name__] = form
    return form


def closed_forms(effect: Effect, bench: Bench) -> list[Check]:
    """The checks of an effect of the library.

    Raises:
        LookupError: there are none; says where to write them.
    """
    if effect.name not in FORMS:
        raise LookupError(
            f"effect {effect.name!r} has no closed form; write the function "
            f"`{effect.name}(effect, bench)`, marked @closed_form, in studies/{Path(__file__).name}"
        )
    return FORMS[effect.name](effect, bench)


def half_widths(trial: Trial) -> tuple[float, float]:
    """Distances along x from the mass centre to the ends of the support, towards -x and +x [m].

    Along the top where it slopes.
    """
    polygon = support_of(trial).polygon
    return float(-polygon[:, 0].min()), float(polygon[:, 0].max())


def uplift_acceleration(
    bench: Bench, trial: Trial, effect: Effect | None, values: Mapping[str, float], guess: float
) -> float:
    """Least constant acceleration of the pedestal that tips a block, by bisection [m/s^2].

    Tipped: the tilt passes 1e-3 rad while the push lasts. The bracket shrinks to 1 % of the guess;
    its middle is returned. Just above the threshold a tilt grows by about g alpha p^2 t^2 / 2 times
    the relative excess, so a push of 0.6 s tells an excess of 0.3 %.
    """
    low, high = 0.75 * guess, 1.25 * guess
    while high - low > 0.01 * guess:
        middle = 0.5 * (low + high)
        response = bench.run(replace(trial, motion=bench.push(middle)), effect, values)
        if float(response.tilt.max()) > 1e-3:
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)


def _rocking(trial: Trial) -> tuple[float, float, float]:
    """R [m], alpha [rad] and p [rad/s] of the bench's block (Housner 1963)."""
    _, b = half_widths(trial)
    h = mass_height(trial)
    radius = math.hypot(b, h)
    mass = trial.scene.rock.mass
    about_edge = float(mass.principal_inertia[1]) + mass.mass * radius**2
    p = math.sqrt(mass.mass * trial.scene.engine.gravity * radius / about_edge)
    return radius, math.atan2(b, h), p


def _rate(response: Response) -> float:
    return float(np.linalg.norm(response.angular_velocity[-1]))


def _at(effect: Effect, trial: Trial, values: Mapping[str, float], order: float) -> Trial:
    """The trial with the effect at an order in a campaign of the five sessions a to e."""
    execution = [0.0, 0.25, 0.5, 0.75, 1.0]
    given = [(effect, effect.complete(values))]
    made = with_effects([trial] * 5, given, relative_order=execution, sessions="abcde")
    return made[execution.index(order)]


def _sine_check(
    effect: Effect, bench: Bench, values: Mapping[str, float], frequency: float, expected: float
) -> Check:
    """Steady gain for a sine against the transfer function's."""
    trial = bench.block()
    step = trial.scene.engine.time_step
    time = np.arange(round(4.0 / step)) * step
    omega = 2 * math.pi * frequency
    blend = np.clip(time, 0, 1) ** 2 * (3 - 2 * np.clip(time, 0, 1))
    x = 0.01 * blend * np.sin(omega * time)
    found = differentiate(x, step)
    motion = replace(
        trial.motion, displacement=x, velocity=found.velocity, acceleration=found.acceleration
    )
    driven = effect.change(replace(trial, motion=motion), values).motion
    steady = slice(round(2.5 / step), round(3.9 / step))
    return Check(
        f"gain of a sine of {frequency:g} Hz, from the transfer function [1]",
        float(np.abs(driven.displacement[steady]).max() / 0.01),
        expected,
        0.01 * expected,
    )


@closed_form
def time_scale(effect: Effect, bench: Bench) -> list[Check]:
    trial = replace(bench.block(), motion=bench.pulse(2.0, 2.0))
    slow = effect.change(trial, {"change": 0.03}).motion
    return [
        Check("PGV of a pulse, over 1.03 [m/s]", slow.pgv, trial.motion.pgv / 1.03, 1e-4),
        Check(
            "PGA inside the pulse, over 1.03^2 [m/s^2]",
            float(np.abs(slow.acceleration[100:-100]).max()), 2.0 / 1.03**2, 2e-3,
        ),
        Check("duration, times 1.03 [s]", slow.duration, 0.5 * 1.03, 2e-3),
    ]  # fmt: skip


@closed_form
def input_filter(effect: Effect, bench: Bench) -> list[Check]:
    corner = 5.0
    trial = bench.block()
    step = trial.scene.engine.time_step
    checks = []
    for frequency in (2.0, 5.0, 8.0):
        time = np.arange(round(6.0 / step)) * step
        envelope = np.sin(np.pi * time / time[-1]) ** 2
        x = 0.01 * envelope * np.sin(2 * np.pi * frequency * time)
        found = differentiate(x, step)
        motion = replace(
            trial.motion, displacement=x - x[0], velocity=found.velocity,
            acceleration=found.acceleration,
        )  # fmt: skip
        passed = effect.change(
            replace(trial, motion=motion), {"corner": corner, "input": 0.0}
        ).motion
        expected = 1 / (1 + (frequency / corner) ** (2 * FILTER_ORDER))
        checks.append(
            Check(
                f"gain at {frequency:g} Hz, 1 / (1 + (f / fc)^6) [1]",
                float(np.abs(passed.displacement).max() / np.abs(x).max()),
                expected,
                0.02,
            )
        )
    return checks


@closed_form
def table_gain(effect: Effect, bench: Bench) -> list[Check]:
    trial, change = bench.block(), 0.15
    _, b = half_widths(trial)
    expected = trial.scene.engine.gravity * b / mass_height(trial) / (1 + change)
    return [
        Check(
            "uplift at a commanded a = g b / h / (1 + change) [m/s^2]",
            uplift_acceleration(bench, trial, effect, {"change": change}, expected),
            expected,
            0.01 * expected,
        )
    ]


@closed_form
def table_bandwidth(effect: Effect, bench: Bench) -> list[Check]:
    corner = 3.0
    gain = 1 / math.sqrt(2)
    return [
        _sine_check(effect, bench, {"corner": corner, "delay": 0.0}, corner, gain),
        _sine_check(
            effect, bench, {"corner": corner, "delay": 0.0}, 6.0, 1 / math.sqrt(1 + 2.0**4)
        ),
        _late(effect, bench),
    ]


def _late(effect: Effect, bench: Bench) -> Check:
    trial = replace(bench.block(), motion=bench.pulse(2.0, 2.0))
    late = effect.change(trial, {"corner": math.inf, "delay": 0.02}).motion
    off = np.abs(late.displacement[20 : 20 + 400] - trial.motion.displacement[:400]).max()
    return Check("delay of 20 ms at 1 kHz, difference after 20 samples [m]", float(off), 0, 0)


@closed_form
def table_saturation(effect: Effect, bench: Bench) -> list[Check]:
    trial = replace(bench.block(), motion=bench.pulse(3.0, 1.0))
    cap, most = 0.3, 2.0
    driven = effect.change(trial, {"velocity": cap, "acceleration": most}).motion
    v, step = driven.velocity, driven.time_step
    return [
        Check("greatest speed [m/s]", float(np.abs(v).max()), cap, 1e-9),
        Check("greatest acceleration [m/s^2]", driven.pga, most, 1e-9),
        Check(
            "where it ends, against the command [m]",
            float(driven.displacement[-1]), float(trial.motion.displacement[-1]), 1e-4,
        ),
        Check(
            "displacement against the integral of the speed [m]",
            float(np.abs(
                np.cumsum(0.5 * (v[1:] + v[:-1])) * step - driven.displacement[1:]
            ).max()), 0.0, 1e-4,
        ),
    ]  # fmt: skip


@closed_form
def table_resonance(effect: Effect, bench: Bench) -> list[Check]:
    values = {"frequency": 12.0, "amplification": 2.0}
    zeta = 0.5 / math.sqrt(3.0)

    def gain(r: float) -> float:
        a = (2 * zeta * r) ** 2
        return math.sqrt((1 + a) / ((1 - r**2) ** 2 + a))

    return [
        _sine_check(effect, bench, values, frequency, gain(frequency / 12.0))
        for frequency in (4.0, 12.0, 24.0)
    ]


@closed_form
def off_axis_motion(effect: Effect, bench: Bench) -> list[Check]:
    trial, share = bench.block(), 0.75
    _, b = half_widths(trial)
    # Stiff friction and no slip: the mass centre is carried along y as along x.
    held = replace(
        trial, motion=bench.push(0.5 * trial.scene.engine.gravity * b / mass_height(trial))
    )
    response = bench.run(held, effect, {"share": share})
    moved = response.position[-1] - response.position[0]
    expected = share * float(response.pedestal[-1])
    return [Check("travel of a rock that stands, across [m]", float(moved[1]), expected, 1e-3)]


@closed_form
def vertical_motion(effect: Effect, bench: Bench) -> list[Check]:
    trial, share = bench.block(), 0.5
    _, b = half_widths(trial)
    slope = b / mass_height(trial)
    # a h = (g + share a) b at uplift.
    expected = trial.scene.engine.gravity * slope / (1 - share * slope)
    return [
        Check(
            "uplift at a = g (b / h) / (1 - share b / h) [m/s^2]",
            uplift_acceleration(bench, trial, effect, {"share": share}, expected),
            expected,
            0.01 * expected,
        )
    ]


@closed_form
def table_pitch(effect: Effect, bench: Bench) -> list[Check]:
    compliance, zeta, frequency, depth = 0.02, 0.1, 10.0, 0.5
    light = {
        "compliance": compliance, "frequency": frequency, "damping": zeta, "depth": depth,
        "moment": 1e12,
    }  # fmt: skip
    heavy = light | {"moment": 1000.0}
    trial = bench.block()
    rock, gravity = trial.scene.rock.mass, trial.scene.engine.gravity
    pushed = bench.run(replace(trial, motion=bench.push(1.0, duration=2.0)), effect, light)
    steady = (pushed.time > 1.5) & (pushed.time < 2.0)
    stiffness = heavy["moment"] * STANDARD_GRAVITY / compliance
    inertia = stiffness / (2 * math.pi * frequency) ** 2
    height = mass_height(trial) + depth
    swinging = inertia + rock.principal_inertia[1] + rock.mass * height**2
    loaded = math.sqrt((stiffness - rock.mass * gravity * height) / swinging)
    share = zeta * 2 * math.pi * frequency * inertia / (swinging * loaded)
    slow = loaded * math.sqrt(1 - share**2) / (2 * math.pi)
    own = frequency * math.sqrt(1 - zeta**2)
    return [
        Check(
            "pitch under a constant acceleration, -compliance a / g [rad]",
            float(pushed.pitch[steady].mean()), -compliance / STANDARD_GRAVITY, 1e-5,
        ),
        Check(
            "frequency of free pitching of a table far heavier than the rock [Hz]",
            _ringing(effect, bench, light), own, 0.01 * own,
        ),
        Check(
            "the same with a block that stands, sqrt((k - m g h) / (I + I_O)) / 2 pi [Hz]",
            _ringing(effect, bench, heavy), slow, 0.01 * slow,
        ),
        _carried(effect, bench, heavy),
    ]  # fmt: skip


def _ringing(effect: Effect, bench: Bench, values: Mapping[str, float]) -> float:
    trial = replace(bench.block(), motion=bench.pulse(0.3, 4.0))
    outcome = trial.outcome.model_copy(update={"stop_early": False})
    response = bench.run(replace(trial, outcome=outcome), effect, values, tail=1.5)
    free = response.pitch[response.time > trial.motion.times[-1]]
    before = np.flatnonzero(np.diff(np.sign(free)) != 0)[:9]
    crossings = before + free[before] / (free[before] - free[before + 1])
    return 1 / (2 * float(np.diff(crossings).mean()) * trial.motion.time_step)


def _carried(effect: Effect, bench: Bench, values: Mapping[str, float]) -> Check:
    # A rock that stands turns with the pedestal: its turn is the integral of its rate.
    motion = bench.push(1.0, duration=2.0)
    response = bench.run(replace(bench.block(), motion=motion), effect, values)
    pushed = response.time < motion.times[-1] - 0.3
    turn = float(response.angular_velocity[pushed, 1].sum()) * motion.time_step
    lean = float(response.pitch[pushed][-1] - response.pitch[0])
    return Check(
        "turn about y of a rock that stands on the pitched pedestal [rad]", turn, lean, 1e-4
    )


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
    return [
        Check(
            "uplift at a = g (1 + change) b / h [m/s^2]",
            uplift_acceleration(bench, trial, effect, {"change": change}, expected),
            expected,
            0.01 * expected,
        )
    ]


@closed_form
def com_offset(effect: Effect, bench: Bench) -> list[Check]:
    trial, distance = bench.block(), 0.015
    b, _ = half_widths(trial)
    expected = trial.scene.engine.gravity * (b - distance) / mass_height(trial)
    return [
        Check(
            "uplift towards the shift at a = g (b - d) / h [m/s^2]",
            uplift_acceleration(
                bench, trial, effect, {"distance": distance, "azimuth": 180.0}, expected
            ),
            expected,
            0.01 * expected,
        )
    ]


@closed_form
def edge_rounding(effect: Effect, bench: Bench) -> list[Check]:
    trial, radius = bench.block(), 0.015
    _, b = half_widths(trial)
    expected = trial.scene.engine.gravity * (b - radius) / mass_height(trial)
    return [
        Check(
            "uplift at a = g (b - r) / h [m/s^2]",
            uplift_acceleration(bench, trial, effect, {"radius": radius}, expected),
            expected,
            0.01 * expected,
        ),
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
def base_asperity(effect: Effect, bench: Bench) -> list[Check]:
    trial, values = bench.block(), {"height": 0.002, "reach": 0.7}
    support = support_of(trial)
    reach = 0.7 * float(bump_positions(support.polygon)[:, 0].max())
    expected = trial.scene.engine.gravity * reach / (support.height + 0.002)
    return [
        Check(
            "uplift about the bumps at a = g x / (h + height) [m/s^2]",
            uplift_acceleration(bench, trial, effect, values, expected),
            expected,
            0.03 * expected,
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
    return [
        Check(
            "uplift downhill at a = g tan(alpha - slope) [m/s^2]",
            uplift_acceleration(bench, trial, effect, {"angle": angle, "azimuth": 180.0}, expected),
            expected,
            0.01 * expected,
        )
    ]


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


@closed_form
def restitution(effect: Effect, bench: Bench) -> list[Check]:
    checks = []
    trial = bench.block()
    _, alpha, _ = _rocking(trial)
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
    _, _, p = _rocking(trial)
    free = _rate(bench.release(trial, tilt, duration))
    damped = _rate(bench.release(effect.change(trial, {"ratio": zeta}), tilt, duration))
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
    radius, alpha, p = _rocking(trial)
    free = _rate(bench.release(trial, tilt, duration))
    slowed = _rate(bench.release(effect.change(trial, {"arm": arm}), tilt, duration))
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
    return [
        Check(
            "uplift at a = g b / h (1 + sigma A / (m g)) [m/s^2]",
            uplift_acceleration(bench, trial, effect, {"strength": strength}, expected),
            expected,
            0.02 * expected,
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
        worn = _at(effect, trial, {"loss": 0.15}, order)
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
        then = _at(effect, trial, values, "abcde".index(session) / 4)
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
