"""What the data, or the budget, cannot support: the limits that stand in a diagnosis."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.codes import Statement
from vsr2.diagnosis.how_far.held_out import HowFar
from vsr2.diagnosis.verdict.rules import Verdict
from vsr2.diagnosis.verdict.statements import BudgetState, LimitCode
from vsr2.diagnosis.where.scan import SCAN, interleaved
from vsr2.effects import effect as effect_of
from vsr2.ensemble.observed.observations import Observations
from vsr2.ensemble.simulated.library import Library, free_parameters
from vsr2.errors import Fault
from vsr2.posterior.calibration import Levels
from vsr2.posterior.sets import are_alike
from vsr2.posterior.training import Found, Posterior
from vsr2.posterior.truth import PRIOR


@dataclass(frozen=True)
class LimitConstants:
    """From where on a limit is stated; chosen by hand.

    Attributes:
        few_trials: fewer are called few; about what an experiment of one day has.
        few_motions: fewer are called few.
        few_responding: trials that lift off; fewer are called few.
        few_campaigns: simulated ones for each effect; fewer are called few.
        often_wrong: share of wrong names.
        low_detection_rate: of causes outside the library.
        all_of_prior: share of a prior's range beyond which an interval determines no size.
        scatter: standard deviations by which repeats must differ more than expected.
        locations: the most significant that are written down, beside those of all trials.
        sets: the most probable that are written down.
    """

    few_trials: int = 100
    few_motions: int = 10
    few_responding: int = 20
    few_campaigns: int = 60
    often_wrong: float = 0.1
    low_detection_rate: float = 0.5
    all_of_prior: float = 0.85
    scatter: float = 3.0
    locations: int = 20
    sets: int = 10


LIMITS = LimitConstants()


def limits_of_the_verdict(
    verdict: Verdict,
    how_far: HowFar,
    found: Found,
    posterior: Posterior,
    effects: Sequence[Mapping[str, Any]],
    provenance: Mapping[str, Any],
) -> list[Statement]:
    """What limits what is named.

    Args:
        verdict: what is said.
        how_far: before and after.
        found: inference on the campaign.
        posterior: trained.
        effects: of the document.
        provenance: of the document.
    """
    library = posterior.parameters.library
    return [
        *_doubts(verdict, how_far, float(found.probability[-1])),
        *equivalents_of_several(verdict, library),
        *excluded_equivalents(verdict, provenance.get("excluded", ())),
        *beyond_tolerance(verdict, provenance.get("nuisances", ())),
        *open_sizes(library, verdict, effects),
    ]


def limits_of_the_data(
    seen: Observations,
    trials: NDArray[np.int64],
    posterior: Posterior,
    insensitive: Sequence[str],
    layers: Mapping[str, Any],
    provenance: Mapping[str, Any],
) -> list[Statement]:
    """What limits any statement about this campaign.

    Args:
        seen: the observed campaign.
        trials: indices of those that lift off in simulations.
        posterior: trained.
        insensitive: effects to which the campaign does not respond.
        layers: of the noise floor.
        provenance: of the document.
    """
    return [
        *_left_out(seen, provenance),
        *_scarce(seen),
        *_unused(seen),
        *_one_outcome(seen),
        *limits_of_names(posterior.levels),
        *few_sessions(seen.session[trials], seen.motion[trials]),
        *_sensitivity(trials, insensitive),
        *_budget(provenance["budget"], posterior),
        *_part(seen, trials, provenance),
        *_references(provenance["references"], posterior.levels.none_limit),
        *([] if provenance["held_out"] else [Statement.of(LimitCode.NOT_HELD_OUT)]),
        *repeats_scatter(layers),
        *(
            [Statement.of(LimitCode.MEASURES_LACKING)]
            if not np.isfinite(seen.log_pga_g).all()
            else ()
        ),
    ]


def _doubts(verdict: Verdict, how_far: HowFar, outside: float) -> Iterator[Statement]:
    if not verdict.named:
        return
    if outside > PRIOR.outside:
        yield Statement.of(
            LimitCode.POSSIBLY_OUT_OF_LIBRARY, probability=outside, prior=PRIOR.outside
        )
    if how_far.gain().low <= 0:
        yield Statement.of(LimitCode.NO_GAIN, effects=how_far.names)
    elif how_far.headline().low <= 0:
        yield Statement.of(LimitCode.CONTROL_CLOSES_AS_MUCH)


def equivalents_of_several(verdict: Verdict, library: Library) -> Iterator[Statement]:
    """Effects that theory takes for about the same as one of those that act together."""
    if not verdict.kind.names_several:
        return
    for name in verdict.effects:
        own = library[name]
        others = tuple(
            o for o in library if o not in verdict.effects and are_alike(own, library[o])
        )
        if others:
            yield Statement.of(LimitCode.EQUIVALENT_TO_MEMBER, effect=name, others=others)


def excluded_equivalents(verdict: Verdict, excluded: Sequence[str]) -> Iterator[Statement]:
    """What was excluded and theory takes for about the same as what is named."""
    for name in verdict.named:
        others = tuple(o for o in excluded if are_alike(effect_of(name), effect_of(o)))
        if others:
            yield Statement.of(LimitCode.EQUIVALENT_EXCLUDED, effect=name, others=others)


def beyond_tolerance(verdict: Verdict, nuisances: Sequence[str]) -> Iterator[Statement]:
    """Nuisances, by their effect, that would look like what is named.

    They are integrated over within their tolerances. A set-up that lies further off than these say
    is a gap, and effects that act alike are all that can be named for it.
    """
    named = [effect_of(name) for name in verdict.named]
    same = tuple(
        n for n in nuisances if any(n == one.name or n in one.confounded_with for one in named)
    )
    if same:
        yield Statement.of(LimitCode.BEYOND_TOLERANCE, nuisances=same)


def open_sizes(
    library: Library, verdict: Verdict, effects: Sequence[Mapping[str, Any]]
) -> Iterator[Statement]:
    """Parameters of what is named whose size the campaign does not determine."""
    for row in effects:
        if row["name"] not in verdict.named:
            continue
        for parameter in free_parameters(library[row["name"]]):
            if parameter.secondary:
                continue
            low, high = row["parameters"][parameter.name]["ci95"]
            size = {
                "effect": row["name"],
                "parameter": parameter.name,
                "low": low,
                "high": high,
                "unit": parameter.unit,
            }
            if low <= parameter.null <= high:
                yield Statement.of(LimitCode.SIZE_MAY_BE_NULL, null=parameter.null, **size)
            elif high - low > LIMITS.all_of_prior * (parameter.upper - parameter.lower):
                yield Statement.of(LimitCode.SIZE_AS_WIDE_AS_PRIOR, **size)


def _left_out(seen: Observations, provenance: Mapping[str, Any]) -> Iterator[Statement]:
    if provenance.get("left_out"):
        yield Statement.of(LimitCode.TRIALS_INCOMPLETE, count=provenance["left_out"])
    if provenance.get("excluded"):
        yield Statement.of(LimitCode.EFFECTS_EXCLUDED, effects=tuple(provenance["excluded"]))
    for name, fault in provenance.get("unavailable", {}).items():
        yield Statement.of(LimitCode.EFFECT_UNAVAILABLE, effect=name, fault=Fault(fault))
    if seen.specimen.max() > 0:
        names = tuple(sorted({trial.specimen for trial in seen.campaign.trials}))
        yield Statement.of(LimitCode.SPECIMENS, specimens=names)


def _scarce(seen: Observations) -> Iterator[Statement]:
    motions = int(seen.motion.max() + 1)
    if len(seen) < LIMITS.few_trials:
        yield Statement.of(LimitCode.FEW_TRIALS, count=len(seen))
    if motions < LIMITS.few_motions:
        yield Statement.of(LimitCode.FEW_MOTIONS, count=motions)
    if seen.tier == "B":
        yield Statement.of(LimitCode.OUTCOMES_ALONE)
        return
    lacking = int((np.isnan(seen.features[:, 0]) & (seen.overturned < 0.5)).sum())
    if lacking:
        yield Statement.of(LimitCode.TILTS_LACKING, count=lacking)


def _unused(seen: Observations) -> Iterator[Statement]:
    """What some trials have and the tier leaves out."""
    trials = seen.campaign.trials
    standing = [t for t in trials if not t.overturned]
    tilts = sum(t.peak_tilt is not None for t in standing)
    series = sum(t.series is not None for t in trials)
    if seen.tier == "B" and tilts:
        yield Statement.of(LimitCode.TILTS_UNUSED, count=tilts, of=len(standing))
    if seen.tier == "M" and series:
        yield Statement.of(LimitCode.SERIES_UNUSED, count=series, of=len(trials))


def _one_outcome(seen: Observations) -> Iterator[Statement]:
    alike = set(seen.overturned[np.isfinite(seen.overturned)])
    if len(alike) == 1:
        yield Statement.of(LimitCode.ALL_OVERTURNED if alike == {1.0} else LimitCode.ALL_STOOD)


def limits_of_names(levels: Levels) -> Iterator[Statement]:
    """What limits any name, causes outside the library counted."""
    rate = levels.detection_rate
    if not levels.named:
        yield Statement.of(LimitCode.NO_NAMES)
        return
    if levels.wrong > LIMITS.often_wrong:
        yield Statement.of(LimitCode.OFTEN_WRONG, share=levels.wrong)
    if rate <= 0:
        yield Statement.of(LimitCode.NO_DETECTION_RATE)
    elif rate < LIMITS.low_detection_rate:
        yield Statement.of(LimitCode.LOW_DETECTION_RATE, rate=rate)


def few_sessions(session: NDArray[np.int64], motion: NDArray[np.int64]) -> Iterator[Statement]:
    """What sessions and motions of these trials, in their order, cannot tell."""
    alone = session.max() == 0
    permutations = factorial(1 + np.count_nonzero(np.diff(session)))
    if interleaved(motion if alone else session):
        yield Statement.of(
            LimitCode.INTERLEAVED_IN_ONE_SESSION if alone else LimitCode.INTERLEAVED_SESSIONS
        )
    elif alone:
        yield Statement.of(LimitCode.ONE_SESSION)
    elif 1 / permutations > SCAN.significant:
        yield Statement.of(LimitCode.FEW_SESSIONS, permutations=permutations, p=1 / permutations)
    if not alone and interleaved(motion):
        yield Statement.of(LimitCode.INTERLEAVED_MOTIONS)


def _sensitivity(trials: NDArray[np.int64], insensitive: Sequence[str]) -> Iterator[Statement]:
    if trials.size < LIMITS.few_responding:
        yield Statement.of(LimitCode.FEW_UNCERTAIN, count=int(trials.size))
    if insensitive:
        yield Statement.of(LimitCode.INSENSITIVE, effects=tuple(insensitive))


def _budget(budget: Mapping[str, Any], posterior: Posterior) -> Iterator[Statement]:
    if budget["state"] == BudgetState.EXCEEDED:
        yield Statement.of(
            LimitCode.BUDGET_EXCEEDED,
            simulations=budget["simulations"],
            allowed=budget["allowed"],
        )
    if posterior.trained_on < LIMITS.few_campaigns * len(posterior.sets.names):
        yield Statement.of(LimitCode.FEW_CAMPAIGNS, count=posterior.campaigns)


def _part(
    seen: Observations, responding: NDArray[np.int64], provenance: Mapping[str, Any]
) -> Iterator[Statement]:
    """That the budget afforded campaigns of some trials alone."""
    count = provenance["budget"]["trials"]
    if count < responding.size or provenance["look"]["among"] < len(seen):
        yield Statement.of(LimitCode.PART_OF_TRIALS, count=count, of=len(seen))


def _references(references: Sequence[Mapping[str, Any]], limit: float) -> Iterator[Statement]:
    """Which campaign that has no effect made the limit of none what it is."""
    lowest = min(references, key=lambda one: one["none"], default=None)
    if lowest is not None and lowest["none"] <= limit:
        yield Statement.of(
            LimitCode.REFERENCE_DIFFERS, reference=lowest["campaign"], probability=lowest["none"]
        )


def repeats_scatter(layers: Mapping[str, Any]) -> Iterator[Statement]:
    """What repeats in the campaign say of the floor."""
    if layers.get("physical") is None:
        yield Statement.of(LimitCode.NO_REPEATS)
        return
    share, expected, pairs = layers["physical"], layers["physical_expected"], layers["repeats"]
    margin = LIMITS.scatter * np.sqrt(max(expected * pairs, 1.0))
    if share * pairs > expected * pairs + margin:
        yield Statement.of(LimitCode.REPEATS_SCATTER, pairs=pairs, share=share, expected=expected)
