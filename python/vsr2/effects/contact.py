"""Effects on the materials in contact."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vsr2.config.study import Contact, Material
from vsr2.effects.effect import Bench, Check, Effect
from vsr2.effects.parameter import Parameter
from vsr2.effects.setup import Setup, settle_at


def _both(setup: Setup, change: Any) -> Setup:
    """The setup with both materials changed by `change(material) -> update`."""

    def changed(material: Material) -> Material:
        return material.model_copy(update=change(material))

    contact = Contact(rock=changed(setup.contact.rock), pedestal=changed(setup.contact.pedestal))
    return replace(setup, contact=contact)


class ContactStiffness(Effect):
    """Softer or harder contact.

    Sinking at rest is m g / (n k) on n points; at three decades below the supplement's values some
    0.1 to 0.7 mm. On so soft a contact a hull trembles at rest (at 80 Hz by some mrad/s and
    micrometres, at a time step of 1 ms), as Bullet's choice of contact points changes; so the
    speeds below which a rock counts as at rest before the motion are at least 10^(-decades / 3)
    times the default ones.
    """

    name = "contact_stiffness"
    meaning = (
        "Contact stiffness and damping are both multiplied by 10^decades, so that the time of "
        "relaxation stays"
    )
    parameters = (
        Parameter("decades", "1", 0.0, -3.0, 1.0, "uniform", "power of ten", limits=(-5.0, 3.0)),
    )
    channels = ("tilt", "rest pose")
    confounded_with = ("edge_rounding",)
    source = "spring and dashpot at each contact point (supplement S2.1)"
    stage = "contact"

    def change(self, setup: Setup, values: Mapping[str, float]) -> Setup:
        factor = 10.0 ** values["decades"]
        if factor < 1:
            setup = settle_at(setup, factor ** (-1 / 3))
        return _both(
            setup,
            lambda material: {
                "stiffness": material.stiffness * factor,
                "damping": material.damping * factor,
            },
        )

    def verify(self, bench: Bench) -> Sequence[Check]:
        setup, decades = bench.block(), -4.0
        still = replace(setup, motion=bench.push(0.0))
        before = bench.run(still).position[-1, 2]
        after = bench.run(still, self, {"decades": decades}).position[-1, 2]
        rock, pedestal = setup.contact.rock, setup.contact.pedestal
        pair = rock.stiffness * pedestal.stiffness / (rock.stiffness + pedestal.stiffness)
        weight = setup.rock.mass.mass * setup.engine.gravity
        expected = weight / (4 * pair) * (10.0**-decades - 1)
        return [
            Check(
                "sinking at rest on four points, m g / (4 k) [m]",
                float(before - after),
                expected,
                0.1 * expected,
            )
        ]


class Friction(Effect):
    """Another coefficient of friction.

    Both materials change by the root of the factor; the pair's torsional friction stays.
    """

    name = "friction"
    meaning = (
        "The pair's coefficient of friction is multiplied by a factor; with the supplement's 0.49 "
        "the prior spans 0.15 to 0.8"
    )
    parameters = (
        Parameter(
            "factor", "1", 1.0, 0.306, 1.633, "loguniform", "on the pair's coefficient",
            limits=(0.0, 20.0),
        ),
    )  # fmt: skip
    channels = ("slip", "tilt")
    confounded_with = ("friction_rate",)
    source = "Coulomb; the pair's coefficient is the product of both bodies' (supplement Eq. 1)"
    stage = "contact"

    def change(self, setup: Setup, values: Mapping[str, float]) -> Setup:
        root = math.sqrt(values["factor"])
        return _both(
            setup,
            lambda material: {
                "lateral_friction": material.lateral_friction * root,
                # The pair's torsional friction is a product with it, and must stay.
                "spinning_friction": material.spinning_friction / root if root > 0 else 0.0,
                "rolling_friction": material.rolling_friction / root if root > 0 else 0.0,
            },
        )

    def verify(self, bench: Bench) -> Sequence[Check]:
        setup = bench.block()
        factor = 0.306
        mu = factor * setup.contact.rock.lateral_friction * setup.contact.pedestal.lateral_friction
        g = setup.engine.gravity
        above = bench.run(replace(setup, motion=bench.push(1.5 * mu * g)), self, {"factor": factor})
        below = bench.run(replace(setup, motion=bench.push(0.9 * mu * g)), self, {"factor": factor})
        speed = above.velocity[:, 0]
        kept = above.time > above.time[-1] - 0.3
        slope = float(np.polyfit(above.time[kept], speed[kept], 1)[0])
        travel = (below.position[:, 0] - below.pedestal) - below.position[0, 0]
        return [
            Check("acceleration of a sliding block, mu g [m/s^2]", slope, mu * g, 0.02 * mu * g),
            Check(
                "slip below the onset [m]",
                float(np.abs(travel[below.time < 0.6]).max()),
                0.0,
                1e-4,
            ),
        ]


class SpinFriction(Effect):
    """Another torsional friction.

    A moment of at most coefficient times normal force, in metres, at each contact point against
    turning about its normal.
    """

    name = "spin_friction"
    meaning = "Torsional resistance of the contacts against turning about the vertical"
    parameters = (
        Parameter(
            "coefficient", "m", math.nan, 0.0, 0.3, "uniform",
            "lever arm of the pair; none given: the study's (0.7 m with the supplement's values)",
            limits=(0.0, 10.0),
        ),
    )  # fmt: skip
    channels = ("yaw", "tilt", "slip")
    confounded_with = ("off_axis_motion",)
    source = "Bullet: the pair's is spin_a mu_b + spin_b mu_a (supplement Table S1)"
    stage = "contact"

    def change(self, setup: Setup, values: Mapping[str, float]) -> Setup:
        rock, pedestal = setup.contact.rock, setup.contact.pedestal
        friction = rock.lateral_friction + pedestal.lateral_friction
        each = values["coefficient"] / friction if friction > 0 else 0.0
        return _both(setup, lambda material: {"spinning_friction": each})

    def verify(self, bench: Bench) -> Sequence[Check]:
        coefficient, rate, duration = 0.02, 1.0, 0.1
        # Without friction along the base the contact points resist no turn.
        slick = _both(bench.block(), lambda _: {"lateral_friction": 1e-3})
        setup = self.change(slick, {"coefficient": coefficient})
        response = bench.release(setup, 0.0, duration, spin=rate)
        mass = setup.rock.mass
        slowing = coefficient * mass.mass * setup.engine.gravity / float(mass.principal_inertia[2])
        begun = response.time > 0.03
        fit = np.polyfit(response.time[begun], response.angular_velocity[begun, 2], 1)
        return [
            Check(
                "slowing of a spinning block, coefficient m g / I_z (torque in m N) [rad/s^2]",
                -float(fit[0]),
                slowing,
                0.05 * slowing,
            )
        ]


CONTACT: tuple[Effect, ...] = (ContactStiffness(), Friction(), SpinFriction())
