"""Effects that act in the loop, in the native core."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from vsr2.effects.effect import Effect
from vsr2.effects.parameter import Parameter
from vsr2.trial import Trial


class Mechanism(Effect):
    """An effect whose parameters are fields of :class:`vsr2.scene.Mechanisms`.

    Where it acts already, both act: moments and strengths add up.

    Attributes:
        fields: name of the field and factor to its SI unit, by parameter.
    """

    fields: ClassVar[Mapping[str, tuple[str, float]]]
    stage = "mechanism"

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        old = trial.scene.mechanisms
        si = {
            field: self.joined(name, getattr(old, field), factor * values[name])
            for name, (field, factor) in self.fields.items()
        }
        return trial.with_scene(mechanisms=replace(old, **si))

    def joined(self, name: str, old: float, new: float) -> float:
        """The field of a parameter that had a value and gets another on top, in its SI unit."""
        return old + new


class Restitution(Mechanism):
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
            limits=(0.01, 1.5), twice="later",
        ),
    )  # fmt: skip
    channels = ("tilt",)
    confounded_with = ("rocking_damping", "base_asperity")
    source = "Housner (1963), Bull. Seismol. Soc. Am. 53(2)"
    fields: ClassVar = {"energy_ratio": ("impact_energy_ratio", 1.0)}

    def nominal(self, trial: Trial) -> dict[str, float]:
        """The scene's ratio; the contact's own impacts keep within 1 % of Housner's."""
        ratio = trial.scene.mechanisms.impact_energy_ratio
        return {"energy_ratio": 1.0 if math.isnan(ratio) else ratio}

    def joined(self, name: str, old: float, new: float) -> float:
        """The later one, as both are relative to Housner's ratio."""
        return new


class RockingDamping(Mechanism):
    """Dissipation while rocking.

    I_O is the moment of inertia about the edge and p the frequency parameter.
    """

    name = "rocking_damping"
    meaning = "A moment -2 zeta p I_O w against the rate w of rocking about an edge"
    parameters = (
        Parameter(
            "ratio", "1", 0.0, 0.0, 0.05, "uniform", "damping ratio zeta", limits=(0.0, 2.0),
            twice="sum",
        ),
    )  # fmt: skip
    channels = ("tilt",)
    confounded_with = ("restitution", "rolling_resistance")
    source = "viscous damping of Housner's rocking oscillator; docs/explanation/mechanisms.md"
    fields: ClassVar = {"ratio": ("rocking_damping", 1.0)}


class RollingResistance(Mechanism):
    """A moment against rolling over an edge.

    It takes the energy N a for each radian, and vanishes smoothly at rest.
    """

    name = "rolling_resistance"
    meaning = "A moment N a against rocking, N being the normal force and a a lever arm"
    parameters = (
        Parameter(
            "arm", "m", 0.0, 0.0, 0.010, "uniform", "lever arm a", limits=(0.0, 0.2), twice="sum"
        ),
    )
    channels = ("tilt",)
    confounded_with = ("contact_stiffness", "restitution")
    source = "Coulomb's rolling resistance; Johnson (1985), *Contact Mechanics*, chapter 9"
    fields: ClassVar = {"arm": ("rolling_resistance", 1.0)}


class FrictionRate(Mechanism):
    """Static friction above kinetic friction.

    mu = mu_k (1 + (ratio - 1) exp(-v / speed)), v being the speed of slip of each contact.
    """

    name = "friction_rate"
    meaning = "Friction at rest is higher than in sliding, where it is the study's"
    parameters = (
        Parameter(
            "ratio", "1", 1.0, 1.0, 1.6, "uniform", "static to kinetic friction",
            limits=(0.1, 10.0), twice="product",
        ),
        Parameter(
            "speed", "m/s", 0.01, 0.001, 0.1, "fixed",
            "of slip over which friction falls from one to the other", limits=(1e-5, 10.0),
            secondary=True, twice="later",
        ),
    )  # fmt: skip
    channels = ("slip", "tilt")
    confounded_with = ("friction",)
    source = "Stribeck-type law; docs/explanation/mechanisms.md"
    fields: ClassVar = {"ratio": ("friction_ratio", 1.0), "speed": ("friction_speed", 1.0)}

    def nominal(self, trial: Trial) -> dict[str, float]:
        """A ratio of 1 over the scene's speed."""
        return {"ratio": 1.0, "speed": trial.scene.mechanisms.friction_speed}

    def joined(self, name: str, old: float, new: float) -> float:
        """Ratios multiply; of two speeds the later one holds."""
        return old * new if name == "ratio" else new


class Adhesion(Mechanism):
    """A bond under the base that breaks at the first uplift.

    Uplift begins at a = g b / h (1 + strength A / (m g)), A being the area of the footprint; after
    that there is no bond.
    """

    name = "adhesion"
    meaning = "Base and pedestal stick together until the first uplift breaks the bond for good"
    parameters = (
        Parameter(
            "strength", "kPa", 0.0, 0.0, 50.0, "uniform", "tensile strength over the footprint",
            limits=(0.0, 1e5), twice="sum",
        ),
    )  # fmt: skip
    channels = ("tilt", "slip")
    confounded_with = ("contact_stiffness",)
    source = "statics of a bonded block"
    fields: ClassVar = {"strength": ("adhesion", 1e3)}


@dataclass(frozen=True)
class CatchConstants:
    """What a caught rock counts as; chosen by hand.

    Attributes:
        toppled_share: of the slack, from which a rock that hangs in the tether has overturned.
    """

    toppled_share: float = 0.9


CATCH = CatchConstants()


class Catch(Mechanism):
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
            limits=(0.5, 180.0), twice="least",
        ),
    )  # fmt: skip
    channels = ("tilt", "label")
    confounded_with = ("outcome_rule",)
    source = "safety straps of shaking-table tests"
    fields: ClassVar = {"slack": ("catch_slack", math.radians(1.0))}

    def joined(self, name: str, old: float, new: float) -> float:
        """Of two tethers the shorter one holds."""
        return new if math.isnan(old) else min(old, new)

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        caught, outcome = super().change(trial, values), trial.outcome
        most = min(outcome.toppled_tilt, CATCH.toppled_share * caught.scene.mechanisms.catch_slack)
        toppled = max(outcome.rocked_tilt, most)
        return replace(caught, outcome=outcome.model_copy(update={"toppled_tilt": toppled}))
