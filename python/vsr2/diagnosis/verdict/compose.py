"""Puts the parts of a diagnosis together as `diagnosis.json`."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis.intervals import INTERVALS
from vsr2.diagnosis.how_far.held_out import CONTROLS, HowFar, Loss, rows
from vsr2.diagnosis.how_far.waterfall import Waterfall
from vsr2.diagnosis.verdict.document import SCHEMA, Diagnosis
from vsr2.diagnosis.verdict.limits import LIMITS, limits_of_the_data, limits_of_the_verdict
from vsr2.diagnosis.verdict.next_measurement import (
    Measurement,
    MeasurementKind,
    measurement_of_several,
    measurement_out_of_library,
    next_measurement,
)
from vsr2.diagnosis.verdict.rules import Verdict
from vsr2.diagnosis.verdict.statements import VerdictKind
from vsr2.diagnosis.where.scan import Location, LocationKind
from vsr2.effects import Parameter
from vsr2.ensemble.observed.observations import Observations
from vsr2.ensemble.observed.random_streams import Stream, generator
from vsr2.ensemble.simulated.library import NONE, UNKNOWN, free_parameters, is_angle
from vsr2.posterior.training import Found, Posterior

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Evidence:
    """All that was concluded.

    Attributes:
        verdict: what is said.
        found: inference on the campaign.
        posterior: trained.
        how_far: before and after, and the controls.
        where: locations, the most significant first.
        responding: indices of the trials that lift off in simulations.
        trials: of these, those that the simulated campaigns have.
        insensitive: effects to which the campaign does not respond.
        layers: of the noise floor.
        waterfall: what each of the likeliest causes adds; None: not judged.
    """

    verdict: Verdict
    found: Found
    posterior: Posterior
    how_far: HowFar
    where: Sequence[Location]
    responding: NDArray[np.int64]
    trials: NDArray[np.int64]
    insensitive: Sequence[str]
    layers: Mapping[str, Any]
    waterfall: Waterfall | None = None


def compose(seen: Observations, evidence: Evidence, provenance: Mapping[str, Any]) -> Diagnosis:
    """The diagnosis as data."""
    verdict, found, posterior = evidence.verdict, evidence.found, evidence.posterior
    how_far, sets = evidence.how_far, posterior.sets
    seed = provenance["seed"]
    effects = _effects(evidence, seed)
    limits = limits_of_the_verdict(verdict, how_far, found, posterior, effects, provenance)
    limits += limits_of_the_data(
        seen, evidence.responding, posterior, evidence.insensitive, evidence.layers, provenance
    )
    labels = (NONE, *sets.names, UNKNOWN)
    falls = evidence.waterfall
    known = [] if falls is None else zip(evidence.trials, falls.probability, strict=True)
    table = rows(how_far, seen, {int(trial): float(p) for trial, p in known})
    measure = _measurement(evidence, seen, table)
    content: dict[str, Any] = {
        "schema": SCHEMA,
        "campaign": {
            "name": seen.campaign.name,
            "trials": len(seen),
            "tier": seen.tier,
            "motions": int(seen.motion.max() + 1),
            "sessions": int(seen.session.max() + 1),
            "responding_trials": int(evidence.responding.size),
        },
        "gap": _gap(evidence),
        "where": [_location(one, seen, evidence.trials) for one in shown(evidence.where)],
        "verdict": {
            "kind": str(verdict.kind),
            "effects": list(verdict.effects),
            "findings": [list(finding) for finding in verdict.findings],
            "probability": verdict.probability,
            "reasons": [reason.to_json() for reason in verdict.reasons],
        },
        "effects": effects,
        "sets": _sets(found, posterior),
        "none_probability": float(found.probability[0]),
        "unknown": {
            "probability": float(found.probability[-1]),
            "detection_rate": posterior.levels.detection_rate,
        },
        "conformal_set_90": [labels[i] for i in found.held],
        "waterfall": None if falls is None else falls.to_json(),
        "negative_control": {
            name: {
                "closure": how_far.closure(name).to_json(),
                "loss": how_far.mean(name).to_json(),
            }
            for name in CONTROLS
        },
        "posterior": {
            "temperature": posterior.within.temperature,
            **asdict(posterior.levels),
            "campaigns": posterior.campaigns,
        },
        "next_measurement": measure and measure.to_json(),
        "limits": [limit.to_json() for limit in limits],
        "corrected": None,
        "provenance": {"versions": _versions(), **provenance},
    }
    samples = {
        name: _samples(evidence, name, seed)
        for name in verdict.named
        if name in posterior.parameters.known
    }
    return Diagnosis(content, tuple(table), samples)


def _gap(evidence: Evidence) -> dict[str, Any]:
    how_far, differs = evidence.how_far, evidence.found.discrepancy
    return {
        "state": str(evidence.verdict.gap),
        "fit": evidence.found.fit,
        "effects": list(how_far.names),
        **{name: how_far.mean(name).to_json() for name in (Loss.BEFORE, Loss.AFTER, Loss.FLOOR)},
        "excess": how_far.excess(Loss.BEFORE).to_json(),
        "excess_after": how_far.excess(Loss.AFTER).to_json(),
        "gain": how_far.gain().to_json(),
        "closure": how_far.closure(Loss.AFTER).to_json(),
        "headline": how_far.headline().to_json(),
        "discrepancy": {"value": differs.median, "ci95": [differs.low, differs.high]},
        "layers": dict(evidence.layers),
    }


def _effects(evidence: Evidence, seed: int) -> list[dict[str, Any]]:
    """One row an effect, the most probable first."""
    found, posterior = evidence.found, evidence.posterior
    leads = posterior.sets.leading(found.probability[None])[0]
    # Both are sums over sets, in another order: the second is not less by rounding.
    acts = np.maximum(posterior.sets.marginal(found.probability), leads)
    out = [
        {
            "name": name,
            "probability": float(leads[k]),
            "acts": float(acts[k]),
            "parameters": _parameters(evidence, name, seed),
        }
        for k, name in enumerate(posterior.sets.names)
    ]
    return sorted(out, key=lambda row: -row["probability"])


def _parameters(evidence: Evidence, name: str, seed: int) -> dict[str, Any]:
    """Mean, mode and central intervals of the posterior given that the effect acts."""
    parameters = evidence.posterior.parameters
    if name not in parameters.known:
        return {}
    samples = _samples(evidence, name, seed)
    return {
        parameter.name: _estimate(parameter, values)
        for parameter, values in zip(
            free_parameters(parameters.library[name]), samples.T, strict=True
        )
    }


def _samples(evidence: Evidence, name: str, seed: int) -> Array:
    """Of an effect's free parameters, the same whenever they are asked for."""
    rng = generator(seed, Stream.PARAMETERS)
    return evidence.posterior.parameters.sample(name, evidence.found.residuals, rng)


def _estimate(parameter: Parameter, values: Array) -> dict[str, Any]:
    """Of samples; an infinite null is taken as its inverse."""
    inverse = bool(np.isinf(parameter.null))
    known = 1 / values if inverse else values
    if is_angle(parameter):
        known = unrolled(known, parameter.lower, parameter.upper)
    quantiles = [INTERVALS.ends[0], INTERVALS.inner[0], 0.5, INTERVALS.inner[1], INTERVALS.ends[1]]
    low, least, middle, most, high = np.quantile(known, quantiles)
    found = {"mean": float(known.mean()), "median": float(middle)}
    ends = {"ci90": [float(least), float(most)], "ci95": [float(low), float(high)]}
    if inverse:
        with np.errstate(divide="ignore"):
            found = {key: float(1 / np.float64(value)) for key, value in found.items()}
            ends = {
                key: [float(1 / np.float64(value)) for value in reversed(pair)]
                for key, pair in ends.items()
            }
    return {**found, **ends, "unit": parameter.unit}


def unrolled(values: Array, lower: float, upper: float) -> Array:
    """Angles as they lie about their mean direction, half a turn to either side of it.

    The direction is that of the mean unit vector (K. V. Mardia and P. E. Jupp, "Directional
    Statistics", 2000), within the ends of the prior, a turn apart.
    """
    turn = upper - lower
    mean = np.angle(np.exp(2j * np.pi * values / turn).mean()) * turn / (2 * np.pi)
    mean = lower + (mean - lower) % turn
    return np.asarray(mean + (values - mean + turn / 2) % turn - turn / 2, dtype=np.float64)


def _sets(found: Found, posterior: Posterior) -> list[dict[str, Any]]:
    """The most probable hypotheses: none, sets of effects, and a cause outside the library."""
    sets = posterior.sets
    out = []
    for k in np.argsort(-found.probability, kind="stable")[: LIMITS.sets]:
        names = [name for name, held in zip(sets.names, sets.members[k], strict=True) if held]
        if k == sets.outside:
            names = [UNKNOWN]
        out.append({"effects": names, "probability": float(found.probability[k])})
    return out


def _location(one: Location, seen: Observations, trials: NDArray[np.int64]) -> dict[str, Any]:
    inside = [seen.campaign.trials[int(trials[i])].trial for i in one.trials]
    return {
        **one.to_json(),
        "effect_size": one.effect_size,
        "p_familywise": one.p_familywise,
        "concentration": one.concentration,
        "concentration_ci90": list(one.concentration_ci90),
        "trials": inside if one.stands_out else None,
    }


def shown(locations: Sequence[Location]) -> list[Location]:
    """The most significant, those of all trials, and the first of each axis and channel."""
    first = {(p.kind.axis, p.feature.channel): k for k, p in reversed(list(enumerate(locations)))}
    return [
        one
        for k, one in enumerate(locations)
        if k < LIMITS.locations or one.kind is LocationKind.ALL_TRIALS or k in first.values()
    ]


def _measurement(
    evidence: Evidence, seen: Observations, table: Sequence[Mapping[str, Any]]
) -> Measurement | None:
    """What to measure next; None where nothing is to be explained."""
    verdict, posterior = evidence.verdict, evidence.posterior
    if verdict.kind is VerdictKind.NONE:
        return None
    library = posterior.parameters.library
    if verdict.kind.names_several:
        return measurement_of_several([one[0] for one in verdict.findings], library)
    if verdict.kind is VerdictKind.UNKNOWN or not verdict.effects:
        excess = np.array([row["loss_before"] - row["floor"] for row in table])
        outside = measurement_out_of_library(seen, np.nan_to_num(excess), evidence.where)
        return Measurement(MeasurementKind.OUT_OF_LIBRARY, out_of_library=outside)
    members = [name for name in verdict.effects if name in posterior.parameters.known]
    return next_measurement(members, posterior, evidence.found, seen, evidence.trials)


def _versions() -> dict[str, str]:
    import scipy

    from vsr2 import _native

    built = _native.build_facts()
    return {
        "vsr2": str(built["version"]),
        "bullet": str(built["bullet"]),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
    }
