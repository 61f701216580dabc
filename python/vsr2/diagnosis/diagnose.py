"""The diagnosis from end to end, for any simulator."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.campaign import Campaign, Tier
from vsr2.diagnosis.budget import Budget, Schedule
from vsr2.diagnosis.floor import noise_floor
from vsr2.diagnosis.how_far.anew import simulate_anew
from vsr2.diagnosis.how_far.dropped import simulate_dropped, surprise_p
from vsr2.diagnosis.how_far.shrinkage import found_pair, judge, resampled_means
from vsr2.diagnosis.how_far.whole import Whole
from vsr2.diagnosis.likelihood.equivalence import leading_class
from vsr2.diagnosis.likelihood.evidence import Data
from vsr2.diagnosis.likelihood.linear_algebra import one_blas_thread
from vsr2.diagnosis.likelihood.score import blocks
from vsr2.diagnosis.observed.features import Feature
from vsr2.diagnosis.observed.observations import Observations, observe_campaign
from vsr2.diagnosis.observed.table import TABLE_FEATURES, table_residuals
from vsr2.diagnosis.shared import Shared, fingerprint
from vsr2.diagnosis.simulated.bank import Bank
from vsr2.diagnosis.simulated.design import Design, Screening, screen, simulate_design, simulations
from vsr2.diagnosis.simulated.library import NONE, Library, reaches
from vsr2.diagnosis.simulated.reach import reaching
from vsr2.diagnosis.simulated.simulator import Request, Simulator
from vsr2.diagnosis.verdict.next_measurement import (
    measurement_of_a_pair,
    measurement_of_the_unknown,
    next_measurement,
)
from vsr2.diagnosis.verdict.result import Diagnosis
from vsr2.diagnosis.verdict.rules import (
    Findings,
    beyond_noise,
    decide,
    disagreement,
    points_outside,
)
from vsr2.diagnosis.verdict.summary import Evidence, compose
from vsr2.diagnosis.where.places import OUTCOME, Conditions, Place, residuals, scan
from vsr2.diagnosis.which.amortised import Places
from vsr2.diagnosis.which.routes import Inference, Prepared, infer, prepare

_logger = logging.getLogger(__name__)

FEWEST_LOOK = 3
"""Draws below which nothing is told of the leading effects."""
NUISANCE_DRAWS = 2000
"""Among which those nearest to a posterior are sought."""

Array = NDArray[np.float64]
Report = Callable[[str, float, Mapping[str, float]], None]
"""Called with stage, share done of it and the probabilities of the leading classes; NaN where no
more than their order is told."""


@dataclass(frozen=True, eq=False)
class _Round:
    prepared: Prepared
    inference: Inference
    draws: Mapping[str, int]

    @property
    def leading(self) -> list[str]:
        """The leading class."""
        return self.inference.classes[0]


@one_blas_thread()
def diagnose_with(
    simulator: Simulator,
    campaign: Campaign,
    *,
    tier: Tier | None = None,
    bank: Path | None = None,
    budget: Budget | None = None,
    shared: Shared | None = None,
    seed: int = 0,
    report: Report | None = None,
    provenance: Mapping[str, Any] | None = None,
) -> Diagnosis:
    """Diagnose a campaign with a simulator of its trials.

    Args:
        simulator: of the campaign's trials with motion and outcome, in order of execution.
        campaign: the same trials.
        tier: information to use; None: all that enough of its trials have.
        bank: file of simulations, made where there is none; None: in memory.
        budget: of simulations.
        shared: with the diagnoses of other campaigns of the same trials; its bank goes before
            `bank`.
        seed: of all draws.
        report: told of progress.
        provenance: of campaign and simulator, to go into the diagnosis.

    Returns:
        The diagnosis; equal campaign, simulator, seed and number of simulations give an equal one.

    Raises:
        DiagnosisError: the campaign holds too little, or the bank cannot be used.
    """
    started = time.monotonic()
    seen = observe_campaign(campaign, tier)
    tell: Report = (lambda stage, share, leading: None) if report is None else report
    with Bank(simulator, bank if shared is None else shared.bank) as store:
        # One simulation of every trial tells what they cost.
        store.run([Request(i, (), 1, 1) for i in range(len(seen))])
        schedule = Schedule(
            Budget() if budget is None else budget, store, len(seen), simulator.library
        )
        screening = screen(
            store,
            seen,
            runs=schedule.screening_runs,
            most=schedule.most_trials,
            seed=seed,
            progress=lambda n, m: tell("screening", n / m, {}),
        )
        _logger.info("screening keeps %d of %d trials", screening.kept.size, len(seen))
        schedule.fit(screening.kept.size)
        library = reaching(
            store,
            screening,
            most=schedule.reach_trials,
            seed=seed,
            progress=lambda n, m: tell("trying effects", n / m, {}),
        )
        _logger.info("%d effects can be the cause: %s", len(library), ", ".join(library))
        layers = noise_floor(store, seen, screening, most=schedule.floor_trials, seed=seed)
        rounds = _rounds(
            store,
            library,
            seen,
            screening,
            schedule,
            shared,
            seed,
            tell,
            watched=report is not None,
        )
        last = rounds[-1]
        _logger.info("leading after the last round: %s", ", ".join(_leading(last)))
        tell("judging", 0.0, _leading(last))
        evidence = conclude(
            store,
            seen,
            screening,
            last.prepared,
            last.inference,
            seed=seed,
        )
        tell("judging", 1.0, _leading(last))
        noted = {
            **({} if provenance is None else provenance),
            "seed": seed,
            "budget": {
                "simulations": store.asked,
                "allowed": schedule.allowed,
                "cost_s": store.cost,
                "simulated": store.simulated,
                "reused": store.reused,
                "draws": dict(last.draws),
                "rounds": len(rounds),
                "limited": schedule.limited,
                "exceeded": schedule.exceeded and store.asked > schedule.allowed,
            },
            "wall_time_s": time.monotonic() - started,
            "reach": {n: list(ends) for n, ends in reaches(library).items() if min(ends) < 1},
            "simulator": simulator.identity,
            "nuisances": list(simulator.nuisance_names),
        }
    return compose(seen, screening, last.prepared, last.inference, evidence, layers, noted)


def _rounds(
    store: Bank,
    library: Library,
    seen: Observations,
    screening: Screening,
    schedule: Schedule,
    shared: Shared | None,
    seed: int,
    tell: Report,
    *,
    watched: bool,
) -> list[_Round]:
    """Double the draws until the answer stands or the budget is spent; `watched`: by somebody."""
    kept = screening.kept
    observed = Data(seen.overturned[None, kept], seen.features[None, kept])
    places = Places(seen.order[kept], seen.log_pga[kept], seen.log_ratio[kept])
    leading: Mapping[str, float] = {}

    def simulated(draws: Mapping[str, int]) -> tuple[Design, NDArray[np.int64]]:
        stage = _part(tell, f"simulating, {max(draws.values())} draws", leading)
        return simulate_design(store, seen, screening, library, draws, seed=seed, progress=stage)

    def judged(draws: Mapping[str, int]) -> _Round:
        design, index = simulated(draws)
        fit = partial(
            prepare,
            library,
            design,
            index,
            places,
            seen.motion[kept],
            seed=seed,
            step=partial(_tell_inference, tell, leading),
        )
        if shared is None:
            prepared = fit()
        else:
            key = fingerprint(design, index, kept, seen.motion, *reaches(library).items(), seed)
            prepared = shared.prepared(key, fit)
        return _Round(prepared, infer(prepared, observed), dict(draws))

    draws = dict.fromkeys(library, schedule.first_draws)
    for count in _first_looks(schedule.first_draws) if watched else ():
        leading = _provisional(simulated(dict.fromkeys(library, count))[0], observed)
    out: list[_Round] = []
    while True:
        found = judged(draws)
        leading = _leading(found)
        out.append(found)
        told = found.inference.told
        more = schedule.next_draws(draws, dict(zip(found.inference.labels, told, strict=True)))
        spent = simulations(draws, kept.size)
        if more is None or not schedule.affords(simulations(more, kept.size) - spent, store):
            return out
        if _settled(out):
            return out
        draws = more


def _first_looks(draws: int) -> list[int]:
    """Draws of the first round after which leading effects are told: a quarter, a half of them."""
    return [count for count in (draws // 4, draws // 2) if count >= FEWEST_LOOK]


def _provisional(design: Design, observed: Data) -> dict[str, float]:
    """The four effects under which the outcomes are most probable, told by frequencies alone.

    These are no probabilities, and so NaN stands for them.
    """
    names = np.unique(design.effect)
    y = observed.overturned[0]
    logs = np.zeros(names.size)
    for k, name in enumerate(names):
        own = design.overturned[design.effect == name]
        p = (np.nansum(own, axis=0) + 0.5) / (np.isfinite(own).sum(axis=0) + 1)
        known = np.isfinite(y)
        logs[k] = np.where(y > 0.5, np.log(p), np.log1p(-p))[known].sum()
    return {str(names[k]) or NONE: np.nan for k in np.argsort(-logs)[:4]}


def _part(tell: Report, stage: str, leading: Mapping[str, float]) -> Callable[[int, int], None]:
    return lambda done, total: tell(stage, done / total, leading)


def _tell_inference(tell: Report, leading: Mapping[str, float], share: float) -> None:
    tell("inference", share, leading)


def _settled(rounds: list[_Round]) -> bool:
    """The last three rounds lead with overlapping classes and equal tests for a gap."""
    if len(rounds) < 3:
        return False
    last = rounds[-3:]
    common = set(last[0].leading) & set(last[1].leading) & set(last[2].leading)
    tests = {min(r.inference.gap_p, r.inference.direction_p) < 0.025 for r in last}
    return bool(common) and len(tests) == 1


def _brief(group: list[str]) -> str:
    """The first three members of a class, and how many more."""
    return "/".join(group[:3]) + (f" and {len(group) - 3} more" if len(group) > 3 else "")


def _leading(found: _Round) -> dict[str, float]:
    """The four most probable of "none" and the classes, members joined by a stroke."""
    probability = dict(zip(found.inference.labels, found.inference.probability, strict=True))
    sums = {_brief(group): sum(probability[n] for n in group) for group in found.inference.classes}
    sums[NONE] = probability[NONE]
    order = sorted(sums, key=lambda name: -sums[name])[:4]
    return {name: float(sums[name]) for name in order}


def conclude(
    store: Bank,
    seen: Observations,
    screening: Screening,
    prepared: Prepared,
    found: Inference,
    *,
    seed: int = 0,
) -> Evidence:
    """From inference to verdict, places and held-out losses.

    Args:
        store: of simulations.
        seen: the observed campaign.
        screening: which trials were kept.
        prepared: the two routes.
        found: inference on the campaign.
        seed: of resamples and permutations.
    """
    library = prepared.library
    kept = screening.kept
    observed = Data(seen.overturned[None, kept], seen.features[None, kept])
    motion = seen.motion[kept]
    probability = dict(zip(found.labels, found.probability, strict=True))
    groups = found.classes
    leading, within = leading_class(probability, groups)
    alike = tuple(name for name in leading if name in groups[0])
    floor = prepared.calibration.floor
    gap_low = _gap_low(prepared, found, motion, seed)
    shrinkage = judge(
        library,
        prepared.emulator,
        prepared.tables,
        observed,
        blocks(motion, seen.overturned[kept]),
        leading,
        np.stack([store.simulator.nuisance_draw(i) for i in range(1, NUISANCE_DRAWS + 1)]),
        pairs=len(library) > 1 and beyond_noise(gap_low, found.gap_p, found.direction_p),
    )
    after = resampled_means((shrinkage.after - floor)[None], motion, seed=seed)[:, 0]
    pair = found_pair(shrinkage, floor, motion, seed)
    dropped = simulate_dropped(store, screening, shrinkage, seen.motion)
    whole = Whole(seen, kept, floor, shrinkage, dropped, gap_low)
    # Only of trials that all simulations without effect agree on: nuisances move others together.
    outcome = seen.overturned[dropped.trials[dropped.certain]]
    novelty_p = min(found.novelty_p, 2 * surprise_p(outcome, dropped.after[dropped.certain]))
    findings = Findings(
        gap_low=gap_low,
        touches_floor=whole.touches_floor,
        gap_p=found.gap_p,
        direction_p=found.direction_p,
        surprise_p=surprise_p(outcome, dropped.before[dropped.certain]),
        none_probability=float(probability[NONE]),
        none_in_set=NONE in found.conformal["both"],
        leading=leading,
        alike=alike,
        alike_probability=sum(probability[n] for n in groups[0])
        / max(1 - float(probability[NONE]), 1e-9),
        offered=len(library),
        class_probability=within,
        agreement=_disagreement(found, leading),
        pair_agreement=_disagreement(
            found, tuple(dict.fromkeys((*leading, *(pair.names if pair else ()))))
        ),
        novelty_p=novelty_p,
        unknown_probability=float(
            prepared.calibration.strangers.probability(
                np.array(novelty_p), np.array(found.strength)
            )
        ),
        favoured=found.labels[1 + int(np.argmax(found.probability[1:]))],
        after_low=float(np.quantile(after, 0.025)),
        floor=float(floor.mean()),
        left=float((shrinkage.after - floor).mean() / max((shrinkage.before - floor).mean(), 1e-9)),
        left_of_all=whole.left,
        pair=pair,
        halves=tuple(tuple(infer(half, observed).classes[0]) for half in prepared.halves),
    )
    verdict = decide(findings)
    if verdict.named:
        # Nothing is named on the emulator's word alone.
        chosen = shrinkage
        if verdict.kind == "pair":
            chosen = shrinkage.of_pair({*leading, *verdict.effects})
        anew = simulate_anew(store, seen, screening, chosen, floor, seed)
        findings = replace(findings, anew=anew)
        verdict = decide(findings)
    conditions = Conditions(
        seen.log_pga[kept],
        seen.log_ratio[kept],
        seen.order[kept],
        seen.session[kept],
        motion,
        seen.specimen[kept],
        _names(seen.session, [trial.session for trial in seen.campaign.trials]),
        _names(seen.specimen, [trial.specimen for trial in seen.campaign.trials]),
    )
    where = _where(seen, kept, prepared, found, observed, conditions, seed)
    measure = None
    excess = np.zeros(len(seen))
    excess[kept] = shrinkage.after - floor
    if verdict.kind == "unknown":
        measure = measurement_of_the_unknown(seen, excess, where)
    elif verdict.kind == "pair":
        both = shrinkage.of_pair({*leading, *verdict.effects})
        dropped = simulate_dropped(store, screening, both, seen.motion)
        whole = Whole(seen, kept, floor, both, dropped, gap_low)
        measure = measurement_of_a_pair(verdict.effects, library)
    elif verdict.kind != "none":
        members = list(verdict.effects)
        measure = next_measurement(members, prepared, found, seen, kept)
        if points_outside(verdict, findings):
            beyond = measurement_of_the_unknown(seen, excess, where, certain=False)
            measure["what"] = f"{beyond['what']}; otherwise {measure['what']}"
    return Evidence(verdict, findings, where, shrinkage, whole, measure)


def _disagreement(found: Inference, named: tuple[str, ...]) -> str | None:
    """Why the routes contradict each other about some effects."""
    return disagreement(
        named,
        found.labels[1 + int(np.argmax(found.likelihood[1:]))],
        found.labels[1 + int(np.argmax(found.classifier[1:]))],
        found.conformal["likelihood"],
        found.conformal["classifier"],
    )


def _names(index: NDArray[np.int64], names: list[str]) -> tuple[str, ...]:
    """By index."""
    return tuple(names[int(np.argmax(index == i))] for i in range(int(index.max()) + 1))


def _where(
    seen: Observations,
    kept: NDArray[np.int64],
    prepared: Prepared,
    found: Inference,
    observed: Data,
    conditions: Conditions,
    seed: int,
) -> list[Place]:
    """Scan the places of outcomes, features and, where it was recorded twice, the table."""
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


def _gap_low(prepared: Prepared, found: Inference, motion: NDArray[np.int64], seed: int) -> float:
    """Lower end of the gap's interval: from resampled motions or gap-free campaigns, the wider."""
    calibration = prepared.calibration
    excess = found.loss - calibration.floor
    resampled = float(np.quantile(resampled_means(excess[None], motion, seed=seed)[:, 0], 0.025))
    null = calibration.gap[calibration.truth == 0]
    simulated = float(excess.mean() - (np.quantile(null, 0.975) - null.mean()))
    return min(resampled, simulated)
