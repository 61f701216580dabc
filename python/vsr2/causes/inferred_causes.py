"""What the posterior over what acts says of causes, as it stands in `causes.json`."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.causes.margins.acting_posterior import ActingPosterior
from vsr2.causes.margins.outcome_model import OutcomeModel, Particles
from vsr2.diagnosis.verdict.compose import unrolled
from vsr2.effects import Parameter
from vsr2.ensemble.simulated.library import GAIN, free_parameters, is_angle

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FoundCausesConstants:
    """What is said of causes; chosen by hand.

    Attributes:
        likely: probability from which a cause goes into the corrected scene.
        together: sets of causes that are listed.
        interval: quantiles at the ends of a parameter's interval.
    """

    likely: float = 0.5
    together: int = 8
    interval: tuple[float, float] = (0.05, 0.95)


FOUND_CAUSES = FoundCausesConstants()


def _summary(values: Array) -> dict[str, Any]:
    low, high = np.quantile(values, FOUND_CAUSES.interval)
    return {"mean": float(values.mean()), "interval": [float(low), float(high)]}


def _stronger(model: OutcomeModel, particles: Particles) -> dict[str, Any]:
    """Factor on the motion, less 1, over all that may act."""
    return _summary(np.expm1(model.log_strength(particles)))


def inferred_causes(
    model: OutcomeModel, posterior: ActingPosterior, rows: list[dict[str, Any]]
) -> dict[str, Any]:
    """What the outcomes of all trials tell."""
    particles = posterior.particles
    scatter = zip(("motion", "trial"), model.scatter(particles), strict=True)
    return {
        "causes": rows,
        "together": _together(particles, model.names),
        "log_evidence": posterior.log_evidence,
        "motion_stronger_by": _stronger(model, particles),
        "scatter": {name: _summary(values) for name, values in scatter},
    }


def cause_row(model: OutcomeModel, particles: Particles, name: str, acts: float) -> dict[str, Any]:
    """An effect: probability, and parameters where it acts."""
    own = particles.taken(particles.acts[:, model.names.index(name)])
    parameters: dict[str, Any] = {}
    if len(own):
        for one, values in drawn_values(model, own, name):
            parameters[one.name] = {"unit": one.unit} | parameter_sizes(one, values)
    return {"name": name, "acts": acts, "parameters": parameters}


def drawn_values(model: OutcomeModel, own: Particles, name: str) -> list[tuple[Parameter, Array]]:
    """Free parameters of an effect, each with its values, shape (n,)."""
    effect = model.space.library[name]
    if name == GAIN:
        return [(effect.parameters[0], np.expm1(model.log_strength(own)))]
    rows = np.array([model.space.values(name, point) for point in own.points])
    names = [p.name for p in effect.parameters]
    return [(p, rows[:, names.index(p.name)]) for p in free_parameters(effect)]


def parameter_sizes(parameter: Parameter, values: Array) -> dict[str, Any]:
    """Mean and interval, of an angle about its direction; an infinite null is taken as its inverse.

    None for what is infinite, such as the corner of a filter that is off.
    """
    if is_angle(parameter):
        return _summary(unrolled(values, parameter.lower, parameter.upper))
    if not math.isinf(parameter.null):
        return _summary(values)
    inverse = float((1 / values).mean())
    low, high = np.quantile(values, FOUND_CAUSES.interval, method="nearest")
    return {
        "mean": 1 / inverse if inverse > 0 else None,
        "interval": [float(end) if math.isfinite(end) else None for end in (low, high)],
    }


def _together(particles: Particles, names: Sequence[str]) -> list[dict[str, Any]]:
    """The most probable sets of causes."""
    sets = Counter(
        tuple(name for name, on in zip(names, row, strict=True) if on) for row in particles.acts
    )
    return [
        {"names": list(chosen), "probability": count / len(particles)}
        for chosen, count in sorted(sets.items(), key=lambda one: (-one[1], one[0]))[
            : FOUND_CAUSES.together
        ]
    ]
