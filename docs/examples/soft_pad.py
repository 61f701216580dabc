"""An effect of one's own: the pedestal carries a rubber pad, softer than the rock.

Check it with `vsr2 effects check docs/examples/soft_pad.py`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from vsr2.effects import Bench, Check, Effect, Parameter
from vsr2.trial import Trial


class SoftPad(Effect):
    """A pad on the pedestal."""

    name = "soft_pad"
    meaning = "The pedestal carries a pad in series with the contact"
    parameters = (
        Parameter(
            name="compliance",
            unit="m/N",
            null=0.0,
            lower=0.0,
            upper=5e-8,
            prior="uniform",
            meaning="of the pad under one contact point",
            limits=(0.0, 1e-4),
        ),
    )
    channels = ("tilt",)
    confounded_with = ("contact_stiffness",)
    source = "springs in series"
    stage = "contact"

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        """Soften the pedestal's material; the pair's stiffness is that of springs in series."""
        contact = trial.scene.contact
        old = contact.pedestal
        soft = 1.0 / (1.0 / old.stiffness + values["compliance"])
        factor = soft / old.stiffness
        damping = (contact.rock.damping + old.damping) * factor
        pedestal = old.model_copy(update={"stiffness": soft, "damping": damping})
        rock = contact.rock.model_copy(update={"damping": 0.0})
        return trial.with_scene(
            contact=contact.model_copy(update={"rock": rock, "pedestal": pedestal})
        )

    def verify(self, bench: Bench) -> Sequence[Check]:
        """A block at rest sinks by a quarter of its weight times the compliance."""
        trial = replace(bench.block(), motion=bench.push(0.0))
        compliance = 2e-7
        before = float(bench.run(trial).position[-1, 2])
        after = float(bench.run(trial, self, {"compliance": compliance}).position[-1, 2])
        weight = trial.scene.rock.mass.mass * trial.scene.engine.gravity
        expected = 0.25 * weight * compliance
        return [Check("sinking at rest [m]", before - after, expected, 0.1 * expected)]
