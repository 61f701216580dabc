"""Second-order systems against closed forms, and their limits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vsr2.effects.oscillator import base_excited, braked, limited, low_passed, respond
from vsr2.motion.processing import Kinematics

STEP = 1e-3


@pytest.mark.parametrize("ratio", [0.02, 0.5, 1.0, 3.0])
def test_step_response(ratio: float) -> None:
    omega = 2 * math.pi * 5.0
    count = 600
    force = np.ones(count)
    force[0] = 0.0
    y, rate = respond(0.0, omega**2, 5.0, ratio, force, STEP)
    # The input rises linearly over the first step, like a step half a step late.
    time = (np.arange(count) - 0.5) * STEP
    roots = np.roots([1.0, 2 * ratio * omega, omega**2]) + np.array([0.0, 1e-7j])
    a, b = roots
    exact = 1 + ((b * np.exp(a * time) - a * np.exp(b * time)) / (a - b)).real
    assert np.abs(y - exact)[2:].max() < 3e-4
    # Half a step late is exact to second order; the rest is (w dt)^2 / 24.
    assert np.abs(np.gradient(y, STEP) - rate)[5:-1].max() < 0.02 * np.abs(rate).max()


def test_paths_belong_to_one_function() -> None:
    time = np.arange(2000) * STEP
    x = 0.02 * np.sin(2 * np.pi * 3 * time) * np.sin(np.pi * time / 2) ** 2
    v = np.gradient(x, STEP)
    for driven in (low_passed(x, 6.0, 0.7, STEP), base_excited(x, v, 9.0, 0.2, STEP)):
        scale = np.abs(driven.velocity).max()
        slope = np.gradient(driven.displacement, STEP)
        assert np.abs(slope - driven.velocity)[2:-2].max() < 1e-3 * scale
        slope = np.gradient(driven.velocity, STEP)
        assert np.abs(slope - driven.acceleration)[2:-2].max() < 5e-3 * np.abs(slope).max()


def test_a_stiff_table_follows() -> None:
    time = np.arange(2000) * STEP
    x = 0.01 * np.sin(np.pi * time / 2) ** 4
    v = np.gradient(x, STEP)
    driven = base_excited(x, v, 15.0, 1e4, STEP)
    assert np.abs(driven.displacement - x).max() < 1e-6


def test_a_table_that_still_moves_brakes_evenly() -> None:
    """v^2 / (2 b) further on, and at rest after v / b."""
    speed, brake = 0.02, 0.1
    time = np.arange(100) * STEP
    path = Kinematics(speed * time, np.full(100, speed), np.zeros(100))
    found = braked(path, brake, STEP)
    assert found.displacement.size == 100 + round(speed / brake / STEP)
    way = found.displacement[-1] - path.displacement[-1]
    assert way == pytest.approx(speed**2 / (2 * brake), rel=1e-9)
    assert found.velocity[-1] == 0
    assert np.abs(found.acceleration).max() == pytest.approx(brake)
    assert braked(found, brake, STEP) is found


def test_a_table_within_its_limits_is_left_alone() -> None:
    x = 0.01 * np.sin(np.linspace(0, np.pi, 500)) ** 2
    v = np.gradient(x, STEP)
    path = Kinematics(x, v, np.gradient(v, STEP))
    assert limited(path, 10.0, 100.0, STEP, loop=3.0) is path


def test_a_table_with_limits_follows_the_stated_law_to_the_bit() -> None:
    rng = np.random.default_rng(2)
    acceleration = 4.0 * np.convolve(rng.standard_normal(3000), np.ones(40) / 40, "same")
    acceleration[-400:] = 0.0
    velocity = np.cumsum(acceleration) * STEP
    path = Kinematics(np.cumsum(velocity) * STEP, velocity, acceleration)
    found = limited(path, 0.05, 0.4, STEP, loop=3.0)
    omega = 2 * math.pi * 3.0
    over = (np.abs(velocity) > 0.05) | (np.abs(acceleration) > 0.4)
    begin = int(np.argmax(over))
    assert 0 < begin < 2000
    place, speed = path.displacement[begin - 1], path.velocity[begin - 1]
    for i in range(begin, len(over)):
        x, v, a = path.displacement[i], path.velocity[i], path.acceleration[i]
        push = a + 2 * omega * (v - speed - a * STEP) + omega**2 * (x - place - v * STEP)
        new = np.clip(speed + np.clip(push, -0.4, 0.4) * STEP, -0.05, 0.05)
        place, speed, push = place + 0.5 * (speed + new) * STEP, new, (new - speed) / STEP
        assert (found.displacement[i], found.velocity[i]) == (place, new)
        assert found.acceleration[i] == push
    np.testing.assert_array_equal(found.displacement[:begin], path.displacement[:begin])
