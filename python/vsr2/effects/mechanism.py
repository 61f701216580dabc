"""Effects that act in the loop, in the native core."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from vsr2.effects.effect import Effect
from vsr2.effects.parameter import Parameter
from vsr2.trial import Trial


def _with(trial: Trial, **values: float) -> Trial:
    return trial.with_scene(mechanisms=replace(trial.scene.mechanisms, **values))


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

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        return _with(trial, impact_energy_ratio=values["energy_ratio"])


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

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        return _with(trial, rocking_damping=values["ratio"])


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

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        return _with(trial, rolling_resistance=values["arm"])


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

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        return _with(trial, friction_ratio=values["ratio"], friction_speed=values["speed"])


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

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        return _with(trial, adhesion=1e3 * values["strength"])


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

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        slack = math.radians(values["slack"])
        outcome = trial.outcome
        toppled = max(outcome.rocked_tilt, min(outcome.toppled_tilt, 0.9 * slack))
        return replace(
            _with(trial, catch_slack=slack),
            outcome=outcome.model_copy(update={"toppled_tilt": toppled}),
        )


MECHANISM: tuple[Effect, ...] = (
    Restitution(), RockingDamping(), RollingResistance(), FrictionRate(), Adhesion(), Catch()
)  # fmt: skip
