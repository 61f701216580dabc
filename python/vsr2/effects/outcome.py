"""Effects on what is written down of a trial."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from vsr2._native import Outcome
from vsr2.effects.effect import Circumstances, Effect
from vsr2.effects.parameter import Parameter
from vsr2.trial import Observation


class OutcomeRule(Effect):
    """Another rule of what has overturned, and slips of the pen.

    Largest tilts and series stay as they are; only what is written down as the outcome changes. A
    trial that is noted as not overturned is noted as rocked.
    """

    name = "outcome_rule"
    meaning = (
        "A trial counts as overturned where its largest tilt reached a threshold; some trials are "
        "noted wrongly"
    )
    parameters = (
        Parameter(
            "tilt", "rad", math.pi, 0.1, 1.0, "uniform",
            "largest tilt from which a trial counts as overturned; none given: the study's rule",
            limits=(1e-3, math.pi),
        ),
        Parameter(
            "flips", "1", 0.0, 0.0, 0.03, "uniform", "share of trials noted wrongly",
            limits=(0.0, 1.0),
        ),
    )  # fmt: skip
    channels = ("label",)
    confounded_with = ("catch",)
    source = "rules of overturning differ between laboratories (0.1 rad to resting on another face)"
    stage = "outcome"
    jump = "any threshold of the largest tilt replaces the study's rule, which looks at the end"

    def at(self, values: Mapping[str, float], circumstances: Circumstances) -> Mapping[str, float]:
        # Drawn even where none flips, so that the draw of a trial does not depend on the share.
        flipped = float(circumstances.rng.uniform() < values["flips"])
        return {"tilt": values["tilt"], "flips": flipped}

    def observe(self, observation: Observation, values: Mapping[str, float]) -> Observation:
        overturned = observation.overturned
        if values["tilt"] < math.pi:
            overturned = observation.peak_tilt >= values["tilt"]
        if values["flips"]:
            overturned = not overturned
        if overturned == observation.overturned:
            return observation
        noted = Outcome.overturned if overturned else Outcome.rocked
        return replace(observation, outcome=noted.name)

    def _joined(self, first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
        # A threshold takes the place of whatever was noted.
        if second["tilt"] < math.pi:
            return dict(second)
        one, other = first["flips"], second["flips"]
        return {"tilt": first["tilt"], "flips": one + other - 2 * one * other}
