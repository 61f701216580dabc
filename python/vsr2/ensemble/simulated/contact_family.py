"""The family of correct contact models: by what two correct simulators of one scene differ.

A campaign never comes from the diagnosis' own engine. Each simulated campaign therefore has a
contact model of its own, drawn from those that a careful modeller might have chosen: stiffness and
damping of the contact, collision margin, sweeps and substeps of the solver, velocity damping, the
lever of spinning friction, and the energy that an impact leaves. What these can mimic is not named.

Correct simulators differ by some per cent in the last, above all where excursions are small: there
a time step of 1 ms takes 4 % by itself (docs/validation/engines.md).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from vsr2.config.study import Contact, Material
from vsr2.effects import Effect, Parameter
from vsr2.effects.standing import settle_at
from vsr2.ensemble.simulated.distributions import Uniform
from vsr2.ensemble.simulated.nuisances import Nuisance
from vsr2.trial import Trial


class AlternativeContact(Effect):
    """Another correct model of the same contact."""

    name = "contact_model"
    meaning = "Another contact model of those that a careful modeller might choose"
    parameters = (
        Parameter("stiffness", "1", 0.0, -1.5, 0.5, "uniform", "power of ten"),
        Parameter("damping", "1", 0.0, -0.7, 0.3, "uniform", "power of ten"),
        Parameter("margin", "1", 0.0, -0.7, 0.3, "uniform", "power of ten"),
        Parameter("sweeps", "1", 0.0, -0.5, 0.3, "uniform", "power of ten"),
        Parameter("substeps", "1", 0.0, 0.0, 1.0, "uniform", "two above one half"),
        Parameter("velocity_damping", "1/s", 0.0, 0.0, 0.01, "uniform", "of all velocities"),
        Parameter("spin_lever", "m", 0.0, 0.0, 0.005, "uniform", "of spinning friction"),
        Parameter("impact_energy", "1", 0.0, -0.04, 0.04, "uniform", "change of what is left"),
    )
    # After the restitution of the scene, a nuisance or a cause, which it multiplies.
    stage = "mechanism"
    rank = 9

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        """Contact, impacts, engine and settling of the scene."""
        scene = trial.scene
        left = scene.mechanisms.impact_energy_ratio
        if change := values["impact_energy"]:
            left = (1.0 if math.isnan(left) else left) * (1 + change)
        softer = 10.0 ** values["stiffness"]
        if softer < 1:
            trial = settle_at(trial, softer ** (-1 / 3))
        pair = scene.contact.rock.lateral_friction + scene.contact.pedestal.lateral_friction
        lever = values["spin_lever"] / pair if pair > 0 else 0.0

        def changed(material: Material) -> Material:
            return material.model_copy(
                update={
                    "stiffness": material.stiffness * softer,
                    "damping": material.damping * softer * 10.0 ** values["damping"],
                    "spinning_friction": material.spinning_friction + lever,
                }
            )

        engine = scene.engine
        update: dict[str, Any] = {
            "collision_margin": engine.collision_margin * 10.0 ** values["margin"],
            "solver_iterations": round(engine.solver_iterations * 10.0 ** values["sweeps"]),
            "substeps": engine.substeps * (2 if values["substeps"] > 0.5 else 1),
            "linear_damping": engine.linear_damping + values["velocity_damping"],
            "angular_damping": engine.angular_damping + values["velocity_damping"],
        }
        return trial.with_scene(
            contact=Contact(
                rock=changed(scene.contact.rock), pedestal=changed(scene.contact.pedestal)
            ),
            engine=engine.model_copy(update=update),
            mechanisms=replace(scene.mechanisms, impact_energy_ratio=left),
        )


CONTACT_FAMILY: tuple[Nuisance, ...] = tuple(
    Nuisance(AlternativeContact(), p.name, Uniform(p.lower, p.upper), label=f"contact_{p.name}")
    for p in AlternativeContact.parameters
)
"""A contact model for every campaign; its size is chosen by hand, and judged on another engine."""
