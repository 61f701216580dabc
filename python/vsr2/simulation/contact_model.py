"""Contact parameters of a pair of materials (supplement S2), as the engines use them."""

from __future__ import annotations

from dataclasses import dataclass

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
