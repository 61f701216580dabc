"""Puts the parts of a diagnosis together as `diagnosis.json`."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.how_far.shrinkage import Interval, Shrinkage
from vsr2.diagnosis.how_far.whole import Whole
from vsr2.diagnosis.likelihood.equivalence import takes_for_alike
from vsr2.diagnosis.observed.observations import Observations
from vsr2.diagnosis.simulated.design import Screening
from vsr2.diagnosis.simulated.library import (
    NONE,
    Library,
    free_parameters,
    is_angle,
    positions,
)
from vsr2.diagnosis.verdict.result import SCHEMA, Diagnosis
from vsr2.diagnosis.verdict.rules import LEAST_UNKNOWN, Findings, Verdict
from vsr2.diagnosis.where.places import SIGNIFICANT, Place, interleaved
from vsr2.diagnosis.which.novelty import PRIOR
from vsr2.diagnosis.which.routes import Inference, Prepared

Array = NDArray[np.float64]

FEW_TRIALS = 100
FEW_MOTIONS = 10
FEW_NOTICED = 0.5
ALL_OF_PRIOR = 0.85
"""Share of a prior's range beyond which an interval tells no size."""
SCATTER = 3.0
"""Standard deviations by which repeats must differ more than expected."""
_PLACES = 20
"""The most significant, beside those that hold all trials."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """All that was concluded.

    Attributes:
        verdict: what is said.
        findings: what it rests on.
        where: places, the most significant first.
        shrinkage: held-out losses of the kept trials.
        whole: losses of all trials, with what the verdict says.
        next_measurement: what would decide what is left open.
    """

    verdict: Verdict
    findings: Findings
    where: list[Place]
    shrinkage: Shrinkage
    whole: Whole
    next_measurement: dict[str, Any] | None


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
    whole = evidence.whole
    closure = whole.closure("after")
    placebo = whole.closure("placebo")
    recalibration = whole.closure("recalibrated")
    probability = dict(zip(found.labels, found.probability, strict=True))
    unknown = evidence.findings.unknown_probability
    probability = {name: float(p) * (1 - unknown) for name, p in probability.items()}
    class_of = {name: group[0] for group in found.classes for name in group}
    effects = [
        {
            "name": name,
            "probability": float(probability[name]),
            "class": class_of[name],
            "parameters": _parameters(prepared, found, name),
            "closure": whole.closure(name),
        }
        for name in sorted(class_of, key=lambda name: -probability[name])
    ]
    verdict = evidence.verdict
    findings = evidence.findings
    pick = whole.placebos
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
        "gap": {
            "before": whole.mean("before"),
            "floor": whole.mean("floor"),
            "after": whole.mean("after"),
            "closure": closure,
            "excess": whole.excess("before"),
            "excess_after": whole.excess("after"),
            "headline": whole.headline(),
            "closure_anew": _interval(findings.anew.closure if findings.anew else None),
            "p_size": findings.gap_p,
            "p_direction": findings.direction_p,
            "layers": dict(layers),
        },
        "where": [
            {
                "place": place.place,
                "axis": place.axis,
                "channel": place.feature.channel,
                "phase": place.feature.phase,
                "effect_size": place.effect_size,
                "p_familywise": place.p_familywise,
                "trials": [seen.campaign.trials[int(screening.kept[i])].trial for i in place.trials]
                if place.p_familywise <= SIGNIFICANT
                else None,
            }
            for place in _shown(evidence.where)
        ],
        "verdict": {
            "kind": verdict.kind,
            "effects": list(verdict.effects),
            "probability": float(verdict.probability)
            # A pair lies outside the library of single effects, as the unknown does.
            * (1 if verdict.kind in ("unknown", "pair") else 1 - unknown),
            "reasons": list(verdict.reasons),
        },
        "effects": effects,
        "none_probability": float(probability[NONE]),
        "conformal_set_90": list(found.conformal["both"]),
        "placebo": {
            "effect": max(set(pick), key=pick.count) if pick else None,
            "closure": placebo,
            "recalibration": recalibration,
            "loss": whole.mean("placebo"),
            "recalibration_loss": whole.mean("recalibrated"),
        },
        "unknown": {
            "novelty_p": findings.novelty_p,
            "excess_after_low": findings.after_low * screening.kept.size / len(seen),
            "probability": unknown,
            "noticed": prepared.calibration.strangers.noticed,
        },
        "routes": {
            "likelihood": _top(found.labels, np.exp(found.likelihood)),
            "classifier": _top(found.labels, np.exp(found.classifier)),
            "combination": {
                **asdict(prepared.calibration.combination),
                "pairwise": prepared.calibration.pairwise,
            },
        },
        "next_measurement": evidence.next_measurement,
        "limits": [
            *_doubts(verdict, whole.headline(), findings),
            *_outside(verdict, found.conformal["both"]),
            *mates(verdict, prepared.library),
            *withheld_mates(verdict, provenance.get("excluded", ())),
            *beyond_tolerance(verdict, provenance.get("nuisances", ())),
            *_sizes(prepared, verdict, effects),
            *_limits(seen, screening, prepared, whole, layers, provenance),
        ],
        "provenance": {
            "versions": _versions(),
            **provenance,
            "calibration_campaigns": int(prepared.calibration.truth.size),
        },
    }
    return Diagnosis(content, tuple(whole.rows()))


def _interval(found: Interval | None) -> dict[str, Any]:
    if found is None:
        return {"value": None, "ci95": None}
    return {"value": found.value, "ci95": [found.low, found.high]}


def _shown(places: Sequence[Place]) -> list[Place]:
    """The most significant places, those of all trials, and the first of each axis and channel."""
    first = {(p.axis, p.feature.channel): k for k, p in reversed(list(enumerate(places)))}
    return [
        place
        for k, place in enumerate(places)
        if k < _PLACES or place.is_whole or k in first.values()
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


def _doubts(verdict: Verdict, headline: Mapping[str, Any], findings: Findings) -> list[str]:
    if not verdict.named:
        return []
    out = []
    if findings.unknown_probability > LEAST_UNKNOWN:
        out.append(
            f"the best effect fits worse than {1 - findings.novelty_p:.0%} of the library's own "
            f"campaigns: the chance that the cause lies outside the library is "
            f"{findings.unknown_probability:.0%}, from {PRIOR:.0%} before"
        )
    if not findings.halves:
        out.append(
            "too few draws for half of them to tell anything: repeat with another seed, or a "
            "larger budget, before you rely on what is named"
        )
    if headline["ci95"] is None or headline["ci95"][0] > 0:
        return out
    return [
        *out,
        "a wrong effect, or a plain rescaling of the probabilities, closes about as much of the "
        "gap on motions not seen: that the gap shrinks does not speak for what is named",
    ]


def _outside(verdict: Verdict, inside: Sequence[str]) -> list[str]:
    """Members of a class that the 90 % set does not hold."""
    outside = [name for name in verdict.effects if name not in inside]
    if verdict.kind != "class" or not outside:
        return []
    return [
        f"{', '.join(outside)} named beside {verdict.effects[0]} without a place in the 90 % set: "
        "what theory takes for about the same is told apart by strong evidence alone"
    ]


def mates(verdict: Verdict, library: Library) -> list[str]:
    """Sentences on effects that stand behind the two of a pair."""
    if verdict.kind != "pair":
        return []
    alike = takes_for_alike()
    behind = {
        name: [other for other in library if other not in verdict.effects and alike(name, other)]
        for name in verdict.effects
    }
    return [
        f"in place of {name} it may be {' or '.join(others)}, which theory takes for about the same"
        for name, others in behind.items()
        if others
    ]


def withheld_mates(verdict: Verdict, excluded: Sequence[str]) -> list[str]:
    """Sentences on what was left out and would look like what is named."""
    alike = takes_for_alike()
    return [
        f"{' or '.join(others)}, which theory takes for about the same as {name}, was left out of "
        f"the library: {name} may stand for it"
        for name in verdict.named
        if (others := [other for other in excluded if alike(name, other)])
    ]


def beyond_tolerance(verdict: Verdict, nuisances: Sequence[str]) -> list[str]:
    """A sentence on nuisances that would look like what is named.

    They are integrated over within their tolerances. A set-up that lies further off than these say
    is a gap, and effects that act alike are all that can be named for it.
    """
    alike = takes_for_alike()
    same = [n for n in nuisances if any(n == name or alike(n, name) for name in verdict.named)]
    if not same:
        return []
    return [
        f"a set-up whose {' or '.join(same)} lies further off the scene than the tolerance that "
        "was reckoned with would look the same: check what was measured of it"
    ]


def _sizes(prepared: Prepared, verdict: Verdict, effects: Sequence[Mapping[str, Any]]) -> list[str]:
    """Parameters of what is named whose size the campaign does not tell."""
    out = []
    for row in effects:
        if row["name"] not in verdict.named:
            continue
        for parameter in free_parameters(prepared.library[row["name"]]):
            low, high = row["parameters"][parameter.name]["ci95"]
            if parameter.secondary:
                continue
            lies = (
                f"the size of {row['name']} is not determined: its {parameter.name} lies from "
                f"{low:.3g} to {high:.3g}{'' if parameter.unit == '1' else f' {parameter.unit}'}"
            )
            if low <= parameter.null <= high:
                out.append(f"{lies}, {parameter.null:g} being no effect")
            elif high - low > ALL_OF_PRIOR * (parameter.upper - parameter.lower):
                out.append(f"{lies}, nearly all that its prior allows")
    return out


def _limits(
    seen: Observations,
    screening: Screening,
    prepared: Prepared,
    whole: Whole,
    layers: Mapping[str, Any],
    provenance: Mapping[str, Any],
) -> list[str]:
    """What these data, and this budget, cannot support."""
    out = []
    if provenance.get("left_out"):
        out.append(
            f"{provenance['left_out']} trials of the campaign have no motion or no outcome and "
            "were not used"
        )
    if provenance.get("excluded"):
        out.append(f"left out of the library as asked: {', '.join(provenance['excluded'])}")
    out += [
        f"{name} was not looked for, this scene cannot have it: {reason}"
        for name, reason in provenance.get("unavailable", {}).items()
    ]
    if seen.specimen.max() > 0:
        names = sorted({trial.specimen for trial in seen.campaign.trials})
        out.append(
            f"{len(names)} specimens ({', '.join(names)}) were all simulated as the one of the "
            "scene: a difference between them may pass for an effect; diagnose each alone"
        )
    motions = int(seen.motion.max() + 1)
    if len(seen) < FEW_TRIALS:
        out.append(
            f"{len(seen)} trials: effects near the noise floor stay undetected, and classes are "
            "wide; single effects need some hundred trials"
        )
    if motions < FEW_MOTIONS:
        out.append(
            f"{motions} ground motions: intervals over motions are rough, and held-out motions few"
        )
    if seen.tier == "B":
        out.append(
            "outcomes alone: what changes the response without changing who overturns cannot be "
            "seen; the largest tilt of each trial would say much more"
        )
    else:
        lacking = int((np.isnan(seen.features[:, 0]) & (seen.overturned < 0.5)).sum())
        if lacking:
            out.append(f"{lacking} trials that stood have no largest tilt: their outcomes are used")
    out += _unused(seen)
    alike = set(seen.overturned[np.isfinite(seen.overturned)])
    if len(alike) == 1:
        out.append(
            f"every trial {'overturned' if alike == {1.0} else 'stood'}: outcomes tell only that "
            "the verge of overturning lies elsewhere; add motions on its other side"
        )
    noticed = prepared.calibration.strangers.noticed
    if noticed is None or noticed < FEW_NOTICED:
        share = "none" if noticed is None else f"{noticed:.0%}"
        out.append(
            f"of gaps from a cause outside the library, {share} would be noticed as unknown (each "
            "effect left out in turn): a named effect may stand for one that the library lacks"
        )
    out += _few_sessions(seen.session[screening.kept], seen.motion[screening.kept])
    uncertain = int(screening.kept.size - screening.guard.size)
    if uncertain < 20 and not screening.left_out:
        out.append(
            f"only {uncertain} trials are uncertain under the library's effects: choose motions "
            "nearer to the verge of overturning"
        )
    blind = [
        name for name, table in prepared.tables.items() if name != NONE and _unseen(prepared, name)
    ]
    if blind:
        out.append(
            "this campaign hardly responds to " + ", ".join(blind) + ": nothing is said about them"
        )
    if screening.left_out:
        out.append(
            f"{screening.left_out} uncertain trials were not used: the budget does not reach them"
        )
    if whole.turned:
        out.append(
            f"{whole.turned} of the trials that did the same in all simulations do otherwise with "
            "the effect added: that counts in the gap and its closure, but neither parameters nor "
            "probabilities rest on it"
        )
    budget = provenance["budget"]
    if budget.get("exceeded"):
        out.append(
            f"a diagnosis of these trials needs at least {budget['simulations']} simulations, more "
            f"than the budget of {budget['allowed']}"
        )
    if budget["limited"]:
        out.append("the budget ended before the answer stood on two doublings of the simulations")
    out += _repeated(layers)
    if not np.isfinite(seen.log_pga).all():
        out.append("some trials have no intensity measures and are left out of the conditions")
    return out


def _few_sessions(session: NDArray[np.int64], motion: NDArray[np.int64]) -> list[str]:
    """What sessions and motions of these trials, in their order, cannot tell."""
    out = []
    alone = session.max() == 0
    ways = factorial(1 + np.count_nonzero(np.diff(session)))
    if interleaved(motion if alone else session):
        what = "motions of one session" if alone else "sessions"
        out.append(
            f"{what} are interleaved: no change over the order can be told, because nothing but "
            "parts of them could be permuted"
        )
    elif alone:
        out.append("one session: a change between sessions cannot be told from a trend")
    elif 1 / ways > SIGNIFICANT:
        out.append(
            f"few sessions: their order can be changed in {ways} ways, so that no change over the "
            f"order is significant (p of {1 / ways:.2f} at least)"
        )
    if not alone and interleaved(motion):
        out.append(
            "motions are interleaved over the sessions: whether one session stands out cannot be "
            "told, because trials of a motion err together and could not be permuted as a whole"
        )
    return out


def _repeated(layers: Mapping[str, Any]) -> list[str]:
    """What repeats in the campaign say of the floor."""
    if layers.get("physical") is None:
        return ["no repeats: the physical noise floor is unknown"]
    differ, expected = layers["physical"], layers["physical_expected"]
    count = layers["repeats"]
    if differ * count <= expected * count + SCATTER * np.sqrt(max(expected * count, 1.0)):
        return []
    return [
        f"of {count} pairs of repeats {differ:.0%} end otherwise, where the simulations have "
        f"{expected:.0%}: the laboratory scatters more than the tolerances say, and what scatters "
        "is no effect; state wider ones (--nuisance), or find what differs between repeats"
    ]


def _unused(seen: Observations) -> list[str]:
    """What some trials have and the tier leaves out."""
    trials = seen.campaign.trials
    standing = [t for t in trials if not t.overturned]
    parts = {
        "B": ("largest tilt", sum(t.peak_tilt is not None for t in standing), len(standing)),
        "M": ("series", sum(t.series is not None for t in trials), len(trials)),
    }
    name, there, of = parts.get(seen.tier, ("", 0, 0))
    if not there:
        return []
    which = "trials that stood" if seen.tier == "B" else "trials"
    return [
        f"{there} of {of} {which} have a {name} that tier {seen.tier} does not use; the next tier "
        "needs it of nine in ten"
    ]


def _unseen(prepared: Prepared, name: str) -> bool:
    """Whether even large values of an effect move no more than two outcomes."""
    table, plain = prepared.tables[name], prepared.tables[NONE]
    p = 1 / (1 + np.exp(-table.coarse.logit))
    q = 1 / (1 + np.exp(-plain.coarse.logit))
    moved = np.abs(p - q).sum(axis=1).max()
    tilts = [
        np.abs(centre - own) / np.sqrt(variance)
        for centre, own, variance in zip(
            table.coarse.centre, plain.coarse.centre, table.coarse.variance, strict=True
        )
    ]
    shifted = max((float((t**2).sum(axis=1).max()) for t in tilts), default=0.0)
    return bool(moved < 2.0 and shifted < 4.0)


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
