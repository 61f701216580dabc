"""Closed-form expressions of the contact model (supplement S2), as the engine uses them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vsr2 import _native
from vsr2.config.study import Material


@dataclass(frozen=True)
class ContactPair:
    """Effective values of a contact pair (supplement Eq. 1).

    Attributes:
        lateral_friction: product of both [1].
        restitution: product of both [1].
        spinning_friction: mu_spin^r mu_lat^p + mu_spin^p mu_lat^r [1].
        damping: sum of both [N s/m].
        stiffness: both in series [N/m].
    """

    lateral_friction: float
    restitution: float
    spinning_friction: float
    damping: float
    stiffness: float


def effective_pair(rock: Material, pedestal: Material) -> ContactPair:
    """Pair values of two bodies (supplement Eq. 1; Eq. 2 where both are equal).

    Friction-like values are bounded by 10, as Bullet does.
    """
    pair = _native.combine(
        _native.Material(**rock.model_dump()), _native.Material(**pedestal.model_dump())
    )
    return ContactPair(
        pair.lateral_friction,
        pair.restitution,
        pair.spinning_friction,
        pair.damping,
        pair.stiffness,
    )


def contact_softness(stiffness: float, damping: float, time_step: float) -> tuple[float, float]:
    """Constraint force mixing [s/kg] and error reduction [1] of a contact row (supplement S2.2).

    cfm = 1 / (dt k + c), erp = dt k / (dt k + c).

    Args:
        stiffness: pair value k [N/m].
        damping: pair value c [N s/m].
        time_step: of the solver, the substep [s].

    Raises:
        ValueError: a negative value, or k and c both 0.
    """
    cfm, erp = _native.contact_softness(stiffness, damping, time_step)
    return float(cfm), float(erp)


def restitution_target(
    restitution: float, normal_velocity: float, velocity_threshold: float
) -> float:
    """Target rebound speed [m/s] (supplement S2.2).

    Args:
        restitution: pair value e [1].
        normal_velocity: u_n, negative on approach [m/s].
        velocity_threshold: slower approaches do not bounce [m/s].
    """
    return float(_native.restitution_target(restitution, normal_velocity, velocity_threshold))


def inverse_mass_along(
    normal: ArrayLike,
    inverse_mass_a: float,
    inverse_inertia_a: ArrayLike,
    arm_a: ArrayLike,
    inverse_mass_b: float,
    inverse_inertia_b: ArrayLike,
    arm_b: ArrayLike,
) -> float:
    """Effective inverse mass K_n along the contact normal [1/kg] (supplement S2.2).

    Args:
        normal: unit normal, shape (3,).
        inverse_mass_a: 0 for a body that does not move [1/kg].
        inverse_inertia_a: in the world, shape (3, 3) [1/(kg m^2)].
        arm_a: from the mass centre to the contact point, shape (3,) [m].
        inverse_mass_b: as `inverse_mass_a`, of the other body.
        inverse_inertia_b: as `inverse_inertia_a`.
        arm_b: as `arm_a`.
    """
    return float(
        _native.inverse_mass_along(
            np.asarray(normal, dtype=np.float64),
            inverse_mass_a,
            np.asarray(inverse_inertia_a, dtype=np.float64),
            np.asarray(arm_a, dtype=np.float64),
            inverse_mass_b,
            np.asarray(inverse_inertia_b, dtype=np.float64),
            np.asarray(arm_b, dtype=np.float64),
        )
    )


def normal_impulse(
    rebound_target: float,
    normal_velocity: float,
    penetration: float,
    cfm: float,
    erp: float,
    time_step: float,
    inverse_mass: float,
) -> float:
    """Normal impulse of one isolated contact [N s] (supplement S2.2), never negative.

    lambda = (u_rest - u_n + erp p / dt) / (K_n + cfm / dt), with p the penetration depth (positive
    when the bodies overlap). The supplement prints -p for Bullet's signed distance, and leaves out
    that Bullet divides cfm by dt. The engine leaves the first 1e-5 m of penetration uncorrected, so
    there p is the depth less that slop.
    """
    return float(
        _native.normal_impulse(
            rebound_target, normal_velocity, penetration, cfm, erp, time_step, inverse_mass
        )
    )
