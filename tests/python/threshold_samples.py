"""A block in the independent simulation, and the acceleration at which it lifts off."""

import math

import pytest

pytest.importorskip("mujoco", reason="the blind extra installs mujoco")

from test_blind_mujoco import (
    BLOCK,
    G,
    situation,
)
from vsr2.blind.mujoco import (
    EFFECTS,
    TrialContext,
    run_trial,
    with_effects,
)

FIRST = TrialContext()

THRESHOLD = G * math.tan(BLOCK.slenderness_angle)


def middle(name, strength=None):
    """Values of an effect with its other parameters mid-range."""
    effect = EFFECTS[name]
    values = {p.name: (p.low + p.high) / 2 for p in effect.parameters}
    if strength is not None:
        values[effect.strength.name] = strength
    return values


def under(name, base, context=FIRST, **values):
    return with_effects(base, {name: middle(name) | values}, context)


def lifts_at(factor, name, context=FIRST, **values):
    """Whether the block lifts at a multiple of its own static threshold, under an effect."""
    changed = under(name, situation(factor * THRESHOLD), context, **values)
    return run_trial(changed).peak_tilt > 5e-5


def assert_threshold(expected, name, context=FIRST, **values):
    """The static threshold over the block's own is `expected`, within 2 %."""
    assert not lifts_at(0.98 * expected, name, context, **values)
    assert lifts_at(1.03 * expected, name, context, **values)


def strongest(name):
    strength = EFFECTS[name].strength
    if strength.reciprocal:
        return strength.low
    return max(strength.low, strength.high, key=lambda v: abs(v - strength.null))
