"""All that decides one trial."""

from __future__ import annotations

from dataclasses import dataclass

from vsr2.blind.mujoco.contact_models import NOMINAL, ContactModel
from vsr2.blind.mujoco.driven_table import TableMotion
from vsr2.blind.mujoco.rigid_body import Body


@dataclass(frozen=True, eq=False)
class Situation:
    """One body on the table, and what the table does.

    Attributes:
        body: what stands there.
        table: its motion.
        friction: coefficient of sliding friction [1].
        friction_ratio: static over kinetic friction [1]; 1: the same.
        friction_speed: slip at which friction has fallen to 1/e of the way to kinetic [m/s].
        spin_friction: largest moment about the normal over the normal force, per contact [m].
        rolling_resistance: the same about horizontal axes [m].
        rounding: radius of the body's edges [m].
        bumps: positions and heights under the base, rows of (x, y, height) [m].
        contact: how contacts and time are solved.
        impact_energy_ratio: energy kept in an impact, relative to what the rigid body keeps [1].
        rocking_damping: damping ratio zeta of the rocking velocity, rate 2 zeta p [1].
        adhesion: tensile strength of a bond on the base that breaks once [Pa].
        catch_slack: tilt from which a tether holds the body [rad]; None: there is none.
        slope: of the table's surface about y and about x [rad]; it tips the body to +x and +y.
        yaw: of the start [rad].
        offset: of the start, x and y [m].
    """

    body: Body
    table: TableMotion
    friction: float = 0.6
    friction_ratio: float = 1.0
    friction_speed: float = 0.05
    spin_friction: float = 0.0
    rolling_resistance: float = 0.0
    rounding: float = 1e-4
    bumps: tuple[tuple[float, float, float], ...] = ()
    contact: ContactModel = NOMINAL
    impact_energy_ratio: float = 1.0
    rocking_damping: float = 0.0
    adhesion: float = 0.0
    catch_slack: float | None = None
    slope: tuple[float, float] = (0.0, 0.0)
    yaw: float = 0.0
    offset: tuple[float, float] = (0.0, 0.0)
