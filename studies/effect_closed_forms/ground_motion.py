"""Closed forms of effects on the motion of the table: the stage actuation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from effect_closed_forms.block import (
    half_widths,
    uplift_check,
)
from effect_closed_forms.forms import closed_form
from vsr2.config.motion_source import Filter
from vsr2.effects import Bench, Check, Effect
from vsr2.effects.actuation import ACTUATION
from vsr2.effects.standing import mass_height
from vsr2.motion import STANDARD_GRAVITY, Motion, Record, Recorded
from vsr2.motion.processing import differentiate
from vsr2.trial import Trial


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
        Check("PGV of a pulse, over 1.03 [m/s]", slow.pgv_m_s, trial.motion.pgv_m_s / 1.03, 1e-4),
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
        passed = effect.change(replace(trial, motion=motion), {"corner": corner}).motion
        expected = 1 / (1 + (frequency / corner) ** (2 * ACTUATION.filter_order))
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
def input_channel(effect: Effect, bench: Bench) -> list[Check]:
    trial, low, high = bench.block(), 0.3, -0.2
    step = trial.scene.engine.time_step
    checks = []
    for frequency in (1.0, 2.0, 4.0, 8.0, 16.0):
        motion = _burst(trial.motion, step, frequency)
        gained = effect.change(
            replace(trial, motion=motion), effect.complete({"low_gain": low, "high_gain": high})
        ).motion
        slow, fast = 1 / (1 + (frequency / 2) ** 4), 1 - 1 / (1 + (frequency / 8) ** 4)
        checks.append(
            Check(
                f"gain at {frequency:g} Hz, 1 + low / (1 + (f / 2)^4) + high (1 - ...) [1]",
                float(np.abs(gained.acceleration).max() / np.abs(motion.acceleration).max()),
                1 + low * slow + high * fast,
                0.01,
            )
        )
    return [*checks, *_crossings(effect, trial, step)]


def _crossings(effect: Effect, trial: Trial, step: float) -> list[Check]:
    """Two records of one motion, the accelerometer's twice as great."""
    crossover, checks = 4.0, []
    for frequency in (1.5, 4.0, 10.0):
        both = _burst(trial.motion, step, frequency)
        for factor in (1.0, 2.0):
            record = Record(
                "two", step, displacement=both.displacement,
                acceleration=factor * both.acceleration,
            )  # fmt: skip
            own = replace(trial, motion=Recorded(record, filter=Filter()).motion(step))
            joined = effect.change(own, effect.complete({"crossover": crossover})).motion
            slow = 1 / (1 + (frequency / crossover) ** 4)
            checks.append(
                Check(
                    f"of {frequency:g} Hz joined at 4 Hz, the acceleration {factor:g} times [1]",
                    float(
                        np.abs(joined.displacement).max() / np.abs(own.motion.displacement).max()
                    ),
                    slow + factor * (1 - slow),
                    0.02,
                )
            )
    return checks


def _burst(motion: Motion, step: float, frequency: float) -> Motion:
    """A sine that swells and fades over 8 s, so that it is nearly of one frequency."""
    time = np.arange(round(8.0 / step)) * step
    x = 0.01 * np.sin(np.pi * time / time[-1]) ** 4 * np.sin(2 * np.pi * frequency * time)
    found = differentiate(x, step)
    return replace(
        motion, displacement=found.displacement, velocity=found.velocity,
        acceleration=found.acceleration,
    )  # fmt: skip


@closed_form
def table_gain(effect: Effect, bench: Bench) -> list[Check]:
    trial, change = bench.block(), 0.15
    _, b = half_widths(trial)
    expected = trial.scene.engine.gravity * b / mass_height(trial) / (1 + change)
    values = {"change": change}
    return [
        uplift_check(bench, effect, values, expected, "at a commanded a = g b / h / (1 + change)")
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
    capped = {"velocity": cap, "acceleration": most}
    driven = effect.change(trial, effect.complete(capped)).motion
    v, step = driven.velocity, driven.time_step
    late = effect.change(trial, capped | {"return_frequency": 0.5}).motion
    return [
        Check("greatest speed [m/s]", float(np.abs(v).max()), cap, 1e-9),
        Check("greatest acceleration [m/s^2]", driven.peak_acceleration, most, 1e-9),
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
        _return_check(late, float(trial.motion.displacement[-1]), trial.motion.duration, 0.5),
    ]  # fmt: skip


def _return_check(driven: Motion, command: float, begin: float, frequency: float) -> Check:
    """A critically damped return after `begin` [s]: (e + (e' + w e) t) exp(-w t)."""
    first = round((begin + 0.5) / driven.time_step)
    error, rate = driven.displacement[first] - command, driven.velocity[first]
    omega, time = 2 * math.pi * frequency, 1.0
    expected = (error + (rate + omega * error) * time) * math.exp(-omega * time)
    found = driven.displacement[first + round(time / driven.time_step)] - command
    return Check("what is left of the error after 1 s [m]", float(found), float(expected), 1e-6)


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
    values = {"share": share}
    return [uplift_check(bench, effect, values, expected, "at a = g (b / h) / (1 - share b / h)")]


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
