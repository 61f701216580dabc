"""Mechanics of rock and contact beyond rigid bodies with Coulomb friction."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, fields

from vsr2.scene.field_values import keep_number


@dataclass(frozen=True)
class Mechanisms:
    """Mechanics that act in the loop, relative to the moving pedestal; all off by default.

    docs/explanation/mechanisms.md gives the formulas; `cpp/include/vsr2/mechanisms.hpp` defines
    them.

    Attributes:
        impact_energy_ratio: kinetic energy that an impact leaves, relative to Housner's ratio for
            the edges of support before and after it [1]; takes the place of the materials'
            restitution. NaN: Bullet's own impacts.
        rocking_damping: damping ratio zeta of rocking on an edge or a point [1]: a moment
            -2 zeta p I_O w.
        rolling_resistance: lever arm a of a moment N a against rocking [m].
        friction_ratio: static to kinetic friction [1]; the materials' friction is the kinetic one.
        friction_speed: speed of slip over which friction falls from one to the other [m/s].
        adhesion: tensile strength of a bond under the base until its first uplift [Pa].
        catch_slack: tilt from the start beyond which a tether holds the rock [rad]; NaN: none.

    Raises:
        GeometryError: a field is no real number.
    """

    impact_energy_ratio: float = math.nan
    rocking_damping: float = 0.0
    rolling_resistance: float = 0.0
    friction_ratio: float = 1.0
    friction_speed: float = 0.01
    adhesion: float = 0.0
    catch_slack: float = math.nan

    def __post_init__(self) -> None:
        keep_number(self, *_NAMES)

    @property
    def off(self) -> bool:
        """Whether none of them acts."""
        return (
            math.isnan(self.impact_energy_ratio)
            and self.rocking_damping == 0
            and self.rolling_resistance == 0
            and self.friction_ratio == 1
            and self.adhesion == 0
            and math.isnan(self.catch_slack)
        )

    @property
    def key(self) -> str:
        """Text that is equal where the mechanisms are; `==` is false for those that are NaN."""
        return "" if self.off else repr(astuple(self))


_NAMES = tuple(field.name for field in fields(Mechanisms))
