"""From inference on a campaign to verdict, locations and losses."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.how_far.campaign_loss import CampaignLoss
from vsr2.diagnosis.how_far.held_out import (
    HeldOutLosses,
    Pair,
    found_pair,
    judge,
    resampled_means,
)
from vsr2.diagnosis.how_far.resimulation import resimulate
from vsr2.diagnosis.how_far.screened_out import ScreenedOut, simulate_screened_out, surprise_p
from vsr2.diagnosis.likelihood.equivalence import leading_class
from vsr2.diagnosis.likelihood.evidence import Data
from vsr2.diagnosis.likelihood.score import blocks
from vsr2.diagnosis.observed.features import Feature
from vsr2.diagnosis.observed.observations import Observations
from vsr2.diagnosis.observed.table_motion import TABLE_FEATURES, table_residuals
from vsr2.diagnosis.simulated.cache import SimulationCache
from vsr2.diagnosis.simulated.design import Screening
from vsr2.diagnosis.simulated.library import NONE
from vsr2.diagnosis.verdict.compose import Evidence
from vsr2.diagnosis.verdict.next_measurement import (
    Measurement,
    MeasurementKind,
    measurement_of_a_pair,
    measurement_out_of_library,
    next_measurement,
)
from vsr2.diagnosis.verdict.rules import (
    Findings,
    Verdict,
    beyond_noise,
    decide,
    disagreement,
    points_outside,
)
from vsr2.diagnosis.verdict.statements import Statement, VerdictKind
from vsr2.diagnosis.where.scan import OUTCOME, Conditions, Location, residuals, scan
from vsr2.diagnosis.which.routes import Inference, Prepared, infer

NUISANCE_DRAWS = 2000
"""Among which those nearest to a posterior are sought."""

Array = NDArray[np.float64]


def conclude(
    cache: SimulationCache,
    seen: Observations,
    screening: Screening,
    prepared: Prepared,
    found: Inference,
    *,
    seed: int = 0,
) -> Evidence:
    """Verdict, locations and held-out losses.

    Args:
        cache: of simulations.
        seen: the observed campaign.
        screening: which trials were kept.
        prepared: the two routes.
        found: inference on the campaign.
        seed: of resamples and permutations.
    """
    kept = screening.kept
    observed = Data(seen.overturned[None, kept], seen.features[None, kept])
    motion = seen.motion[kept]
    floor = prepared.calibration.floor
    gap_low = gap_interval_low(prepared, found, motion, seed)
    leading, _ = _leading(found)
    held_out = judge(
        prepared.library,
        prepared.emulator,
        prepared.tables,
        observed,
        blocks(motion, seen.overturned[kept]),
        leading,
        np.stack([cache.simulator.nuisance_draw(i) for i in range(1, NUISANCE_DRAWS + 1)]),
        pairs=len(prepared.library) > 1 and beyond_noise(gap_low, found.gap_p, found.direction_p),
    )
    screened_out = simulate_screened_out(cache, screening, held_out, seen.motion)
    losses = CampaignLoss(seen, kept, floor, held_out, screened_out, gap_low)
    surprises: dict[str, Any] = _surprises(seen, screened_out, prepared, found)
    findings = replace(
        _findings(prepared, found, held_out, losses, motion, seed),
        gap_low=gap_low,
        halves=tuple(tuple(infer(half, observed).classes[0]) for half in prepared.halves),
        **surprises,
    )
    verdict = decide(findings)
    outside = {*leading, *verdict.effects}
    if verdict.named:
        # Nothing is named on the emulator's word alone.
        chosen = held_out.of_pair(outside) if verdict.kind is VerdictKind.PAIR else held_out
        resimulation = resimulate(cache, seen, screening, chosen, floor, seed)
        findings = replace(findings, resimulation=resimulation)
        verdict = decide(findings)
    if verdict.kind is VerdictKind.PAIR:
        both = held_out.of_pair(outside)
        screened_out = simulate_screened_out(cache, screening, both, seen.motion)
        losses = CampaignLoss(seen, kept, floor, both, screened_out, gap_low)
    where = _where(seen, kept, prepared, found, observed, seed)
    excess = np.zeros(len(seen))
    excess[kept] = held_out.after - floor
    measure = _measurement(verdict, findings, prepared, found, seen, kept, excess, where)
    return Evidence(verdict, findings, where, held_out, losses, measure)


def _leading(found: Inference) -> tuple[tuple[str, ...], float]:
    """The classes that lead, and their probability if something is missing."""
    probability = dict(zip(found.labels, found.probability, strict=True))
    return leading_class(probability, found.classes)


def _findings(
    prepared: Prepared,
    found: Inference,
    held_out: HeldOutLosses,
    losses: CampaignLoss,
    motion: NDArray[np.int64],
    seed: int,
) -> Findings:
    """What the verdict rests on, but for what `conclude` adds."""
    probability = dict(zip(found.labels, found.probability, strict=True))
    leading, within = _leading(found)
    floor = prepared.calibration.floor
    after = resampled_means((held_out.after - floor)[None], motion, seed=seed)[:, 0]
    pair = found_pair(held_out, floor, motion, seed)
    return Findings(
        gap_low=np.nan,
        touches_floor=losses.touches_floor,
        gap_p=found.gap_p,
        direction_p=found.direction_p,
        surprise_p=1.0,
        none_probability=float(probability[NONE]),
        none_in_set=NONE in found.conformal["both"],
        leading=leading,
        alike=tuple(name for name in leading if name in found.classes[0]),
        alike_probability=sum(probability[n] for n in found.classes[0])
        / max(1 - float(probability[NONE]), 1e-9),
        offered=len(prepared.library),
        class_probability=within,
        agreement=_disagreement(found, leading),
        pair_agreement=_disagreement(found, _with_pair(leading, pair)),
        novelty_p=found.novelty_p,
        unknown_probability=found.unknown,
        favoured=found.labels[1 + int(np.argmax(found.probability[1:]))],
        after_low=float(np.quantile(after, 0.025)),
        floor=float(floor.mean()),
        left=float((held_out.after - floor).mean() / max((held_out.before - floor).mean(), 1e-9)),
        left_of_all=losses.left,
        pair=pair,
        halves=(),
    )


def _with_pair(leading: tuple[str, ...], pair: Pair | None) -> tuple[str, ...]:
    return tuple(dict.fromkeys((*leading, *(pair.names if pair else ()))))


def _surprises(
    seen: Observations, screened_out: ScreenedOut, prepared: Prepared, found: Inference
) -> dict[str, float]:
    """What the outcomes of certain trials say of the gap, and of a cause outside the library.

    Only of trials that all simulations without effect agree on: nuisances move others together.
    """
    certain = screened_out.certain
    outcome = seen.overturned[screened_out.trials[certain]]
    novelty_p = min(found.novelty_p, 2 * surprise_p(outcome, screened_out.after[certain]))
    unknown = prepared.calibration.out_of_library.probability(
        np.array(novelty_p), np.array(found.strength)
    )
    return {
        "surprise_p": surprise_p(outcome, screened_out.before[certain]),
        "novelty_p": novelty_p,
        "unknown_probability": float(unknown),
    }


def _measurement(
    verdict: Verdict,
    findings: Findings,
    prepared: Prepared,
    found: Inference,
    seen: Observations,
    kept: NDArray[np.int64],
    excess: Array,
    where: list[Location],
) -> Measurement | None:
    """What to measure next; None where nothing is to be explained."""
    if verdict.kind is VerdictKind.NONE:
        return None
    if verdict.kind is VerdictKind.PAIR:
        return measurement_of_a_pair(verdict.effects, prepared.library)
    outside = measurement_out_of_library(seen, excess, where)
    if verdict.kind is VerdictKind.UNKNOWN:
        return Measurement(MeasurementKind.OUT_OF_LIBRARY, out_of_library=outside)
    measure = next_measurement(verdict.effects, prepared, found, seen, kept)
    if points_outside(verdict, findings):
        return replace(measure, out_of_library=outside)
    return measure


def _disagreement(found: Inference, named: tuple[str, ...]) -> Statement | None:
    """Why the routes contradict each other about some effects."""
    return disagreement(
        named,
        found.labels[1 + int(np.argmax(found.likelihood[1:]))],
        found.labels[1 + int(np.argmax(found.classifier[1:]))],
        found.conformal["likelihood"],
        found.conformal["classifier"],
    )


def _where(
    seen: Observations,
    kept: NDArray[np.int64],
    prepared: Prepared,
    found: Inference,
    observed: Data,
    seed: int,
) -> list[Location]:
    """Scan outcomes, features and, where it was recorded twice, the table."""
    conditions = Conditions(
        seen.log_pga[kept],
        seen.log_ratio[kept],
        seen.order[kept],
        seen.session[kept],
        seen.motion[kept],
        seen.specimen[kept],
        _names(seen.session, [trial.session for trial in seen.campaign.trials]),
        _names(seen.specimen, [trial.specimen for trial in seen.campaign.trials]),
    )
    own = residuals(found.before, observed)
    null, drawn = prepared.calibration.null, prepared.drawn
    features: tuple[Feature, ...] = (OUTCOME, *seen.measured)
    few, many = len(null[0]), len(drawn[0])
    trials = seen.campaign.select(np.isin(np.arange(len(seen)), kept))
    table = table_residuals(trials, null=few + many, seed=seed)
    if table is not None:
        own = table.beside(own, None)
        null = table.beside(null, slice(few))
        drawn = table.beside(drawn, slice(few, None))
        features += TABLE_FEATURES
    return scan(own, null, conditions, features, drawn=drawn, seed=seed)


def _names(index: NDArray[np.int64], names: list[str]) -> tuple[str, ...]:
    """By index."""
    return tuple(names[int(np.argmax(index == i))] for i in range(int(index.max()) + 1))


def gap_interval_low(
    prepared: Prepared, found: Inference, motion: NDArray[np.int64], seed: int
) -> float:
    """Lower end of the gap's interval: from resampled motions or gap-free campaigns, the wider."""
    calibration = prepared.calibration
    excess = found.loss - calibration.floor
    resampled = float(np.quantile(resampled_means(excess[None], motion, seed=seed)[:, 0], 0.025))
    null = calibration.gap[calibration.truth == 0]
    simulated = float(excess.mean() - (np.quantile(null, 0.975) - null.mean()))
    return min(resampled, simulated)
