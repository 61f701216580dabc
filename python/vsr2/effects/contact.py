"""Effects on the materials in contact."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from vsr2.config.study import Contact, Material
from vsr2.effects.effect import Effect
from vsr2.effects.parameter import Parameter
from vsr2.effects.standing import settle_at
from vsr2.trial import Trial


def _both(trial: Trial, change: Any) -> Trial:
    """The trial with both materials changed by `change(material) -> update`."""

    def changed(material: Material) -> Material:
        return material.model_copy(update=change(material))

    old = trial.scene.contact
    contact = Contact(rock=changed(old.rock), pedestal=changed(old.pedestal))
    return trial.with_scene(contact=contact)


class ContactStiffness(Effect):
    """Softer or harder contact.

    Sinking at rest is m g / (n k) on n points; at three decades below the supplement's values some
    0.1 to 0.7 mm. On so soft a contact a hull trembles at rest, as Bullet's choice of contact
    points changes: at 80 Hz by some mrad/s and micrometres, at a time step of 1 ms. So the speeds
    below which a rock counts as at rest before the motion are at least 10^(-decades / 3) times the
    default ones.
    """

    name = "contact_stiffness"
    meaning = (
        "Contact stiffness and damping are both multiplied by 10^decades, so that the time of "
        "relaxation stays"
    )
    parameters = (
        Parameter(
            "decades", "1", 0.0, -3.0, 1.0, "uniform", "power of ten", limits=(-5.0, 3.0),
            twice="sum",
        ),
    )  # fmt: skip
    channels = ("tilt", "rest pose")
    confounded_with = ("edge_rounding",)
    source = "spring and dashpot at each contact point (supplement S2.1)"
    stage = "contact"

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        factor = 10.0 ** values["decades"]
        if factor < 1:
            trial = settle_at(trial, factor ** (-1 / 3))
        return _both(
            trial,
            lambda material: {
                "stiffness": material.stiffness * factor,
                "damping": material.damping * factor,
            },
        )


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
            limits=(0.0, 20.0), twice="product",
        ),
    )  # fmt: skip
    channels = ("slip", "tilt")
    confounded_with = ("friction_rate",)
    source = "Coulomb; the pair's coefficient is the product of both bodies' (supplement Eq. 1)"
    stage = "contact"

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        root = math.sqrt(values["factor"])
        return _both(
            trial,
            lambda material: {
                "lateral_friction": material.lateral_friction * root,
                # The pair's torsional friction is a product with it, and must stay.
                "spinning_friction": material.spinning_friction / root if root > 0 else 0.0,
                "rolling_friction": material.rolling_friction / root if root > 0 else 0.0,
            },
        )


class SpinFriction(Effect):
    """More torsional friction.

    A moment of at most coefficient times normal force, in metres, at each contact point against
    turning about its normal, beside that of the study (none by default).
    """

    name = "spin_friction"
    meaning = "Torsional resistance of the contacts against turning about the vertical"
    parameters = (
        Parameter(
            "coefficient", "m", 0.0, 0.0, 0.3, "uniform",
            "lever arm of the pair beyond the study's", limits=(0.0, 10.0), twice="sum",
        ),
    )  # fmt: skip
    channels = ("yaw", "tilt", "slip")
    confounded_with = ("off_axis_motion",)
    source = "Bullet: the pair's is spin_a mu_b + spin_b mu_a (supplement Table S1)"
    stage = "contact"

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        rock, pedestal = trial.scene.contact.rock, trial.scene.contact.pedestal
        friction = rock.lateral_friction + pedestal.lateral_friction
        each = values["coefficient"] / friction if friction > 0 else 0.0
        return _both(
            trial, lambda material: {"spinning_friction": material.spinning_friction + each}
        )
