"""Effects on what is written down of a trial."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from vsr2.effects.effect import Bench, Check, Effect
from vsr2.effects.parameter import Parameter
from vsr2.effects.setup import Circumstances, Observation


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
    jump = "any threshold of the largest tilt takes the place of the study's rule, told at the end"

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
        return replace(observation, outcome="overturned" if overturned else "rocked")

    def verify(self, bench: Bench) -> Sequence[Check]:
        setup = replace(bench.block(), motion=bench.pulse(4.5, 2.0))
        plain = bench.run(setup, tail=2.0)
        peak = plain.observation.peak_tilt
        flipped = 0
        trial = Observation("rocked", 0.05, 0.0, 0.0, 0.0)
        for i in range(2000):
            rng = np.random.default_rng(np.random.SeedSequence(1, spawn_key=(i,)))
            there = Circumstances(0.0, "1", ("1",), rng)
            here = self.at({"tilt": math.pi, "flips": 0.03}, there)
            flipped += self.observe(trial, here).overturned
        return [
            Check(
                "overturned with the threshold just below the largest tilt [1]",
                bench.run(setup, self, {"tilt": 0.99 * peak}, tail=2.0).observation.overturned,
                1.0, 0.0,
            ),
            Check(
                "overturned with the threshold just above it [1]",
                bench.run(setup, self, {"tilt": 1.01 * peak}, tail=2.0).observation.overturned,
                0.0, 0.0,
            ),
            Check(
                "share of 2000 trials flipped, within 3 standard errors [1]",
                flipped / 2000, 0.03, 3 * math.sqrt(0.03 * 0.97 / 2000),
            ),
        ]  # fmt: skip


OUTCOME: tuple[Effect, ...] = (OutcomeRule(),)
