"""Effects that act in the loop, in the native core."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from vsr2.effects.contact import Friction
from vsr2.effects.effect import Bench, Check, Effect, Response
from vsr2.effects.geometry import half_widths, mass_height, support_of, uplift_acceleration
from vsr2.effects.parameter import Parameter
from vsr2.effects.setup import Setup


def _with(setup: Setup, **values: float) -> Setup:
    return replace(setup, mechanisms=replace(setup.mechanisms, **values))


def _rocking(setup: Setup) -> tuple[float, float, float]:
    """R [m], alpha [rad] and p [rad/s] of the bench's block (Housner 1963)."""
    _, b = half_widths(setup)
    h = mass_height(setup)
    radius = math.hypot(b, h)
    mass = setup.rock.mass
    about_edge = float(mass.principal_inertia[1]) + mass.mass * radius**2
    p = math.sqrt(mass.mass * setup.engine.gravity * radius / about_edge)
    return radius, math.atan2(b, h), p


def _rate(response: Response) -> float:
    return float(np.linalg.norm(response.angular_velocity[-1]))


class Restitution(Effect):
    """The energy an impact leaves.

    Takes the place of the contact's restitution. Housner's ratio, computed for the edges in
    question, is (1 - 3/2 sin^2 alpha)^2 for a block. Where the edge meets the ground at less than
    0.04 m/s, and of bodies so slender that the ratio exceeds 0.98, the contact keeps its own loss
    (docs/explanation/mechanisms.md).
    """

    name = "restitution"
    meaning = "An impact leaves this share of the kinetic energy that Housner's impact would leave"
    parameters = (
        Parameter(
            "energy_ratio", "1", math.nan, 0.65, 1.1, "uniform",
            "kinetic energy after an impact, relative to Housner's; none given: the contact's own",
            limits=(0.01, 1.5),
        ),
    )  # fmt: skip
    channels = ("tilt",)
    confounded_with = ("rocking_damping", "base_asperity")
    source = "Housner (1963), Bull. Seismol. Soc. Am. 53(2)"
    stage = "mechanism"

    def change(self, setup: Setup, values: Mapping[str, float]) -> Setup:
        return _with(setup, impact_energy_ratio=values["energy_ratio"])

    def verify(self, bench: Bench) -> Sequence[Check]:
        checks = []
        setup = bench.block()
        _, alpha, _ = _rocking(setup)
        housner = (1 - 1.5 * math.sin(alpha) ** 2) ** 2
        for ratio in (0.65, 1.0, 1.1):
            tilt = 0.15
            response = bench.release(self.change(setup, {"energy_ratio": ratio}), tilt, 1.2)
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


class RockingDamping(Effect):
    """Dissipation while rocking.

    I_O is the moment of inertia about the edge and p the frequency parameter.
    """

    name = "rocking_damping"
    meaning = "A moment -2 zeta p I_O w against the rate w of rocking about an edge"
    parameters = (
        Parameter("ratio", "1", 0.0, 0.0, 0.05, "uniform", "damping ratio zeta", limits=(0.0, 2.0)),
    )
    channels = ("tilt",)
    confounded_with = ("restitution", "rolling_resistance")
    source = "viscous damping of Housner's rocking oscillator; docs/explanation/mechanisms.md"
    stage = "mechanism"

    def change(self, setup: Setup, values: Mapping[str, float]) -> Setup:
        return _with(setup, rocking_damping=values["ratio"])

    def verify(self, bench: Bench) -> Sequence[Check]:
        setup, tilt, duration, zeta = bench.block(), 0.1, 0.2, 0.05
        _, _, p = _rocking(setup)
        free = _rate(bench.release(setup, tilt, duration))
        damped = _rate(bench.release(self.change(setup, {"ratio": zeta}), tilt, duration))
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


class RollingResistance(Effect):
    """A moment against rolling over an edge.

    It takes the energy N a for each radian, and vanishes smoothly at rest.
    """

    name = "rolling_resistance"
    meaning = "A moment N a against rocking, N being the normal force and a a lever arm"
    parameters = (
        Parameter("arm", "m", 0.0, 0.0, 0.010, "uniform", "lever arm a", limits=(0.0, 0.2)),
    )
    channels = ("tilt",)
    confounded_with = ("contact_stiffness", "restitution")
    source = "Coulomb's rolling resistance; Johnson (1985), *Contact Mechanics*, chapter 9"
    stage = "mechanism"

    def change(self, setup: Setup, values: Mapping[str, float]) -> Setup:
        return _with(setup, rolling_resistance=values["arm"])

    def verify(self, bench: Bench) -> Sequence[Check]:
        setup, tilt, duration, arm = bench.block(), 0.05, 0.15, 0.010
        radius, alpha, p = _rocking(setup)
        free = _rate(bench.release(setup, tilt, duration))
        slowed = _rate(bench.release(self.change(setup, {"arm": arm}), tilt, duration))
        # The normal force is m (g - b p^2 phi) as the mass centre falls.
        b = radius * math.sin(alpha)
        lever = p**2 * (alpha - tilt) * math.cosh(0.5 * p * duration)
        bearing = 1 - b * lever / setup.engine.gravity
        expected = arm * bearing / (radius * math.sin(alpha - tilt))
        return [
            Check(
                "loss of rate in free rocking, N a / (m g R sin(alpha - tilt)) [1]",
                1 - slowed / free,
                expected,
                0.1 * expected,
            )
        ]


class FrictionRate(Effect):
    """Static friction above kinetic friction.

    mu = mu_k (1 + (ratio - 1) exp(-v / speed)), v being the speed of slip of each contact.
    """

    name = "friction_rate"
    meaning = "Friction at rest is higher than in sliding, where it is the study's"
    parameters = (
        Parameter(
            "ratio", "1", 1.0, 1.0, 1.6, "uniform", "static to kinetic friction",
            limits=(0.1, 10.0),
        ),
        Parameter(
            "speed", "m/s", 0.01, 0.001, 0.1, "fixed",
            "of slip over which friction falls from one to the other", limits=(1e-5, 10.0),
            secondary=True,
        ),
    )  # fmt: skip
    channels = ("slip", "tilt")
    confounded_with = ("friction",)
    source = "Stribeck-type law; docs/explanation/mechanisms.md"
    stage = "mechanism"

    def change(self, setup: Setup, values: Mapping[str, float]) -> Setup:
        return _with(setup, friction_ratio=values["ratio"], friction_speed=values["speed"])

    def verify(self, bench: Bench) -> Sequence[Check]:
        factor, ratio = 0.306, 1.6
        setup = Friction().change(bench.block(), {"factor": factor})
        rock, pedestal = setup.contact.rock, setup.contact.pedestal
        kinetic = rock.lateral_friction * pedestal.lateral_friction * setup.engine.gravity
        values = {"ratio": ratio, "speed": 0.01}
        held = bench.run(replace(setup, motion=bench.push(0.9 * ratio * kinetic)), self, values)
        sliding = bench.run(replace(setup, motion=bench.push(1.2 * ratio * kinetic)), self, values)
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


class Adhesion(Effect):
    """A bond under the base that breaks at the first uplift.

    Uplift begins at a = g b / h (1 + strength A / (m g)), A being the area of the footprint; after
    that there is no bond.
    """

    name = "adhesion"
    meaning = "Base and pedestal stick together until the first uplift breaks the bond for good"
    parameters = (
        Parameter(
            "strength", "kPa", 0.0, 0.0, 50.0, "uniform", "tensile strength over the footprint",
            limits=(0.0, 1e5),
        ),
    )  # fmt: skip
    channels = ("tilt", "slip")
    confounded_with = ("contact_stiffness",)
    source = "statics of a bonded block"
    stage = "mechanism"

    def change(self, setup: Setup, values: Mapping[str, float]) -> Setup:
        return _with(setup, adhesion=1e3 * values["strength"])

    def verify(self, bench: Bench) -> Sequence[Check]:
        setup, strength = bench.block(), 5.0
        _, b = half_widths(setup)
        polygon = support_of(setup).polygon
        following = np.roll(polygon, -1, axis=0)
        area = 0.5 * float(
            (polygon[:, 0] * following[:, 1] - polygon[:, 1] * following[:, 0]).sum()
        )
        weight = setup.rock.mass.mass * setup.engine.gravity
        own = setup.engine.gravity * b / mass_height(setup)
        expected = own * (1 + 1e3 * strength * area / weight)
        return [
            Check(
                "uplift at a = g b / h (1 + sigma A / (m g)) [m/s^2]",
                uplift_acceleration(bench, setup, self, {"strength": strength}, expected),
                expected,
                0.02 * expected,
            )
        ]


class Catch(Effect):
    """A one-sided tether.

    Beyond the slack a stiff damped couple turns the rock back; it stretches by less than 0.05 rad.
    The tilt from which a rock counts as toppled in the end is lowered to 0.9 of the slack where it
    is higher. A rock caught before its slenderness angle cannot overturn.
    """

    name = "catch"
    meaning = (
        "A tether holds the rock beyond a tilt; a rock that hangs in it in the end has overturned"
    )
    parameters = (
        Parameter(
            "slack", "degree", 180.0, 5.0, 25.0, "uniform", "tilt at which it comes taut",
            limits=(0.5, 180.0),
        ),
    )  # fmt: skip
    channels = ("tilt", "label")
    confounded_with = ("outcome_rule",)
    source = "safety straps of shaking-table tests"
    stage = "mechanism"

    def change(self, setup: Setup, values: Mapping[str, float]) -> Setup:
        slack = math.radians(values["slack"])
        outcome = setup.outcome
        toppled = max(outcome.rocked_tilt, min(outcome.toppled_tilt, 0.9 * slack))
        return replace(
            _with(setup, catch_slack=slack),
            outcome=outcome.model_copy(update={"toppled_tilt": toppled}),
        )

    def verify(self, bench: Bench) -> Sequence[Check]:
        slack = 25.0
        setup = replace(bench.block(), motion=bench.pulse(6.0, 1.5))
        response = bench.run(setup, self, {"slack": slack}, tail=3.0)
        free = bench.run(setup, tail=3.0)
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


MECHANISM: tuple[Effect, ...] = (
    Restitution(), RockingDamping(), RollingResistance(), FrictionRate(), Adhesion(), Catch()
)  # fmt: skip
