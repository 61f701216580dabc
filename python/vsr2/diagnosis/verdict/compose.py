"""Puts the parts of a diagnosis together as `diagnosis.json`."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.how_far.campaign_loss import NOT_GIVEN, CampaignLoss
from vsr2.diagnosis.how_far.held_out import HeldOutLosses
from vsr2.diagnosis.observed.observations import Observations
from vsr2.diagnosis.simulated.design import Screening
from vsr2.diagnosis.simulated.library import (
    NONE,
    free_parameters,
    is_angle,
    positions,
)
from vsr2.diagnosis.verdict.document import SCHEMA, Diagnosis
from vsr2.diagnosis.verdict.limits import LIMITS, limits_of_the_data, limits_of_the_verdict
from vsr2.diagnosis.verdict.next_measurement import Measurement
from vsr2.diagnosis.verdict.rules import Findings, Verdict
from vsr2.diagnosis.verdict.statements import VerdictKind
from vsr2.diagnosis.where.scan import Location
from vsr2.diagnosis.which.routes import Inference, Prepared

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Evidence:
    """All that was concluded.

    Attributes:
        verdict: what is said.
        findings: what it rests on.
        where: locations, the most significant first.
        held_out: held-out losses of the kept trials.
        losses: of all trials, with what the verdict says.
        next_measurement: what would decide what is left open.
    """

    verdict: Verdict
    findings: Findings
    where: list[Location]
    held_out: HeldOutLosses
    losses: CampaignLoss
    next_measurement: Measurement | None


def compose(
    seen: Observations,
    screening: Screening,
    prepared: Prepared,
    found: Inference,
    evidence: Evidence,
    layers: Mapping[str, Any],
    provenance: Mapping[str, Any],
) -> Diagnosis:
    """The diagnosis as data."""
    losses, verdict, findings = evidence.losses, evidence.verdict, evidence.findings
    unknown = findings.unknown_probability
    probability = {
        name: float(p) * (1 - unknown)
        for name, p in zip(found.labels, found.probability, strict=True)
    }
    class_of = {name: group[0] for group in found.classes for name in group}
    effects = [
        {
            "name": name,
            "probability": probability[name],
            "class": class_of[name],
            "parameters": _parameters(prepared, found, name),
            "closure": losses.closure(name),
        }
        for name in sorted(class_of, key=lambda name: -probability[name])
    ]
    conformal = found.conformal["both"]
    # A pair lies outside the library of single effects, as the unknown does.
    outside = verdict.kind in (VerdictKind.UNKNOWN, VerdictKind.PAIR)
    limits = limits_of_the_verdict(
        verdict, findings, losses.headline(), conformal, prepared, effects, provenance
    )
    limits += limits_of_the_data(seen, screening, prepared, losses.changed, layers, provenance)
    content: dict[str, Any] = {
        "schema": SCHEMA,
        "campaign": {
            "name": seen.campaign.name,
            "trials": len(seen),
            "tier": seen.tier,
            "motions": int(seen.motion.max() + 1),
            "sessions": int(seen.session.max() + 1),
            "uncertain_trials": int(screening.kept.size - screening.guard.size),
            "guard_trials": int(screening.guard.size),
        },
        "gap": _gap(losses, findings) | {"layers": dict(layers)},
        "where": [_location(one, seen, screening.kept) for one in shown(evidence.where)],
        "verdict": {
            "kind": str(verdict.kind),
            "effects": list(verdict.effects),
            "probability": float(verdict.probability) * (1 if outside else 1 - unknown),
            "reasons": [reason.to_json() for reason in verdict.reasons],
        },
        "effects": effects,
        "none_probability": probability[NONE],
        "conformal_set_90": list(conformal),
        "negative_control": _negative_control(losses),
        "unknown": {
            "novelty_p": findings.novelty_p,
            "excess_after_low": findings.after_low * screening.kept.size / len(seen),
            "probability": unknown,
            "detection_rate": prepared.calibration.out_of_library.detection_rate,
        },
        "routes": {
            "likelihood": _top(found.labels, np.exp(found.likelihood)),
            "classifier": _top(found.labels, np.exp(found.classifier)),
            "combination": {
                **asdict(prepared.calibration.combination),
                "pairwise": prepared.calibration.pairwise,
            },
        },
        "next_measurement": evidence.next_measurement and evidence.next_measurement.to_json(),
        "limits": [limit.to_json() for limit in limits],
        "provenance": {
            "versions": _versions(),
            **provenance,
            "calibration_campaigns": int(prepared.calibration.truth.size),
        },
    }
    return Diagnosis(content, tuple(losses.rows()))


def _gap(losses: CampaignLoss, findings: Findings) -> dict[str, Any]:
    return {
        "state": str(findings.gap_state),
        "before": losses.mean("before"),
        "floor": losses.mean("floor"),
        "after": losses.mean("after"),
        "closure": losses.closure("after"),
        "excess": losses.excess("before"),
        "excess_after": losses.excess("after"),
        "headline": losses.headline(),
        "closure_resimulated": findings.resimulation.closure.to_json()
        if findings.resimulation
        else dict(NOT_GIVEN),
        "p_size": findings.gap_p,
        "p_direction": findings.direction_p,
    }


def _location(one: Location, seen: Observations, kept: NDArray[np.int64]) -> dict[str, Any]:
    trials = [seen.campaign.trials[int(kept[i])].trial for i in one.trials]
    return {
        "location": one.name,
        "axis": one.axis,
        "feature": one.feature.name,
        "channel": one.feature.channel,
        "phase": one.feature.phase,
        "effect_size": one.effect_size,
        "p_familywise": one.p_familywise,
        "trials": trials if one.is_significant else None,
    }


def _negative_control(losses: CampaignLoss) -> dict[str, Any]:
    chosen = losses.negative_controls
    return {
        "effect": max(set(chosen), key=chosen.count) if chosen else None,
        "closure": losses.closure("negative_control"),
        "recalibration": losses.closure("recalibrated"),
        "loss": losses.mean("negative_control"),
        "recalibration_loss": losses.mean("recalibrated"),
    }


def shown(locations: Sequence[Location]) -> list[Location]:
    """The most significant, those of all trials, and the first of each axis and channel."""
    first = {(p.axis, p.feature.channel): k for k, p in reversed(list(enumerate(locations)))}
    return [
        one
        for k, one in enumerate(locations)
        if k < LIMITS.locations or one.is_everywhere or k in first.values()
    ]


def _parameters(prepared: Prepared, found: Inference, name: str) -> dict[str, Any]:
    """Posterior means, modes and central 95 % intervals.

    The mode is that of all parameters together, as the likelihood has it: closures are about it.
    The mean is of the tempered posterior. The interval is of both temperings, because the wider
    one lies nearer to the prior's middle, and reaches to the mode.
    """
    entry = prepared.library[name]
    nodes = positions(entry, prepared.tables[name].fine.quantiles)
    own = found.posteriors[name].nodes[0]
    weights = []
    for tempering in prepared.calibration.sharpness:
        log = float(tempering.weight(found.likelihood)) * own
        weight = np.exp(log - log.max())
        weights.append(weight / weight.sum())
    out = {}
    for j, parameter in enumerate(free_parameters(entry)):
        values = np.array([parameter.ppf(float(u)) for u in nodes[:, j]])
        if is_angle(parameter):
            values = _unrolled(values, weights[0], parameter.upper - parameter.lower)
        order = np.argsort(values)
        # The middle of each node's own weight, so that the median of one node is the node.
        totals = [np.cumsum(weight[order]) - 0.5 * weight[order] for weight in weights]
        lows, highs = (
            [float(np.interp(q, total, values[order])) for total in totals] for q in (0.025, 0.975)
        )
        # A node at a null of zero is off it by rounding.
        values[np.abs(values) < 1e-12 * (parameter.upper - parameter.lower)] = 0.0
        peak = float(values[np.argmax(own)])
        out[parameter.name] = {
            "mean": float(weights[0] @ values),
            "mode": peak,
            "ci95": [min(*lows, peak), max(*highs, peak)],
            "unit": parameter.unit,
        }
    return out


def _unrolled(values: Array, weight: Array, turn: float) -> Array:
    """Angles as they lie about their mean direction, half a turn to either side of it.

    The direction is that of the mean unit vector (K. V. Mardia and P. E. Jupp, "Directional
    Statistics", 2000), within 0 and a turn.
    """
    mean = np.angle(weight @ np.exp(2j * np.pi * values / turn)) * turn / (2 * np.pi) % turn
    return np.asarray(mean + (values - mean + turn / 2) % turn - turn / 2, dtype=np.float64)


def _top(labels: tuple[str, ...], probability: Array) -> dict[str, float]:
    order = np.argsort(-probability)[:5]
    return {labels[i]: float(probability[i]) for i in order}


def _versions() -> dict[str, str]:
    import scipy
    import sklearn

    from vsr2 import _native

    built = _native.build_facts()
    return {
        "vsr2": str(built["version"]),
        "bullet": str(built["bullet"]),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "scikit-learn": sklearn.__version__,
    }
