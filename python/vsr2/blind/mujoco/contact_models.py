"""The family of contact models, all of whose members are the physics of a rigid rock."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np


@dataclass(frozen=True)
class ContactModel:
    """How MuJoCo solves contacts and steps in time.

    Attributes:
        time_constant: of a contact [s], at least twice the step.
        damping_ratio: of a contact [1]; 1: critical.
        impedance: least and greatest share of the force that the constraint takes [1].
        width: penetration over which the impedance rises [m].
        cone: of friction.
        friction_stiffness: of friction over that of the normal direction (`impratio`) [1].
        integrator: in time.
        step: time step [s].
        velocity_damping: of the body's velocity, linear and angular [1/s].
    """

    time_constant: float = 0.002
    damping_ratio: float = 1.0
    impedance: tuple[float, float] = (0.95, 0.999)
    width: float = 0.0005
    cone: Literal["elliptic", "pyramidal"] = "elliptic"
    friction_stiffness: float = 10.0
    integrator: Literal["Euler", "implicitfast", "RK4"] = "Euler"
    step: float = 0.001
    velocity_damping: float = 0.0

    def stiffened(self, decades: float) -> ContactModel:
        """With a stiffness 10^decades times its own; the time constant is (m / k)^(1/2)."""
        return replace(self, time_constant=self.time_constant * 10 ** (-0.5 * decades))


NOMINAL = ContactModel()


@dataclass(frozen=True)
class ContactFamily:
    """From what a contact model is drawn; all are choices, none is fitted; sealed with a pack.

    Attributes:
        cells: of the time constant, evenly in its logarithm; an even number.
        margin: of a cell left free at either end, over its width.
        time_constant: ends of a log-uniform draw [s].
        damping_ratio: ends of a uniform draw [1].
        least_impedance: the same of the least impedance [1].
        most_impedance: the same of the greatest impedance [1].
        width: ends of a log10-uniform draw, log10 of metres.
        friction_stiffness: least [1], and decades above it, log-uniform.
        steps: of time, with equal odds [s].
        velocity_damping: ends of a uniform draw [1/s].
    """

    cells: int = 8
    margin: float = 0.05
    time_constant: tuple[float, float] = (0.002, 0.005)
    damping_ratio: tuple[float, float] = (0.8, 1.3)
    least_impedance: tuple[float, float] = (0.93, 0.97)
    most_impedance: tuple[float, float] = (0.99, 0.999)
    width: tuple[float, float] = (-4.0, -3.0)
    friction_stiffness: tuple[float, float] = (3.0, 1.0)
    steps: tuple[float, float] = (0.0005, 0.001)
    velocity_damping: tuple[float, float] = (0.0, 0.01)


FAMILY = ContactFamily()


def draw_contact(rng: np.random.Generator, *, development: bool) -> ContactModel:
    """A member of the family.

    The first, third, ... cell of the time constant is for packs of development, the others are for
    packs that are scored: no member is of both. Over the ranges a block's impacts leave the energy
    that Housner (1963) says within 4 %.
    """
    cell = 2 * int(rng.integers(FAMILY.cells // 2)) + (not development)
    least, most = np.log(FAMILY.time_constant)
    within = FAMILY.margin + (1 - 2 * FAMILY.margin) * rng.random()
    time_constant = math.exp(least + (most - least) * (cell + within) / FAMILY.cells)
    stiffness, decades = FAMILY.friction_stiffness
    return ContactModel(
        time_constant=_digits(time_constant),
        damping_ratio=_digits(rng.uniform(*FAMILY.damping_ratio)),
        impedance=(
            _digits(rng.uniform(*FAMILY.least_impedance)),
            _digits(rng.uniform(*FAMILY.most_impedance)),
        ),
        width=_digits(10 ** rng.uniform(*FAMILY.width)),
        cone=("elliptic", "pyramidal")[int(rng.integers(2))],
        friction_stiffness=_digits(stiffness * 10 ** (decades * rng.random())),
        integrator=("Euler", "implicitfast")[int(rng.integers(2))],
        step=FAMILY.steps[int(rng.integers(2))],
        velocity_damping=_digits(rng.uniform(*FAMILY.velocity_damping)),
    )


def _digits(value: float) -> float:
    return float(f"{value:.4g}")
