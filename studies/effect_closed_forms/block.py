"""What several closed forms need of a block on the bench."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vsr2.effects import Bench, Check, Effect, Response, with_effects
from vsr2.effects.standing import mass_height, support_of
from vsr2.trial import Trial


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


def uplift_check(
    bench: Bench,
    effect: Effect,
    values: Mapping[str, float],
    expected: float,
    formula: str,
    *,
    tolerance: float = 0.01,
) -> Check:
    """Of the bench's block: :func:`uplift_acceleration`, with a relative tolerance."""
    found = uplift_acceleration(bench, bench.block(), effect, values, expected)
    return Check(f"uplift {formula} [m/s^2]", found, expected, tolerance * expected)


def rocking(trial: Trial) -> tuple[float, float, float]:
    """R [m], alpha [rad] and p [rad/s] of the bench's block (Housner 1963)."""
    _, b = half_widths(trial)
    h = mass_height(trial)
    radius = math.hypot(b, h)
    mass = trial.scene.rock.mass
    about_edge = float(mass.principal_inertia[1]) + mass.mass * radius**2
    p = math.sqrt(mass.mass * trial.scene.engine.gravity * radius / about_edge)
    return radius, math.atan2(b, h), p


def turning_rate(response: Response) -> float:
    """Angular speed at the end [rad/s]."""
    return float(np.linalg.norm(response.angular_velocity[-1]))


def at_order(effect: Effect, trial: Trial, values: Mapping[str, float], order: float) -> Trial:
    """The trial with the effect at an order in a campaign of the five sessions a to e."""
    execution = [0.0, 0.25, 0.5, 0.75, 1.0]
    given = [(effect, effect.complete(values))]
    made = with_effects([trial] * 5, given, relative_order=execution, sessions="abcde")
    return made[execution.index(order)]
