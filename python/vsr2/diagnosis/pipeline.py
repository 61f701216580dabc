"""The diagnosis from end to end, for any simulator."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.campaign import Campaign, Tier
from vsr2.diagnosis.budget import SCHEDULE, Budget, Schedule
from vsr2.diagnosis.conclusion import conclude
from vsr2.diagnosis.how_far.resimulation import RESIMULATION
from vsr2.diagnosis.likelihood.evidence import Data
from vsr2.diagnosis.likelihood.linear_algebra import one_blas_thread
from vsr2.diagnosis.noise_floor import NOISE_FLOOR, noise_floor
from vsr2.diagnosis.observed.features import SERIES
from vsr2.diagnosis.observed.observations import OBSERVED, Observations, observe_campaign
from vsr2.diagnosis.observed.table_motion import TABLE
from vsr2.diagnosis.protocol_cache import ProtocolCache, fingerprint
from vsr2.diagnosis.simulated.cache import SimulationCache
from vsr2.diagnosis.simulated.design import (
    SCREENING,
    Design,
    Screening,
    screen,
    simulate_design,
    simulations,
)
from vsr2.diagnosis.simulated.library import NONE, RANGES, Library, reaches
from vsr2.diagnosis.simulated.reach import REACH, reaching
from vsr2.diagnosis.simulated.simulator import Request, Simulator
from vsr2.diagnosis.verdict.compose import compose
from vsr2.diagnosis.verdict.document import Diagnosis
from vsr2.diagnosis.verdict.limits import LIMITS
from vsr2.diagnosis.verdict.statements import BudgetState
from vsr2.diagnosis.where.discrepancy import DISCREPANCY
from vsr2.diagnosis.where.scan import SCAN
from vsr2.diagnosis.which.amortised import TrialConditions
from vsr2.diagnosis.which.routes import Inference, Prepared, infer, prepare

_logger = logging.getLogger(__name__)

FEWEST_LOOK = 3
"""Draws below which nothing is said of the leading effects."""


class Stage(StrEnum):
    """What a diagnosis is at."""

    SCREENING = "screening"
    REACH = "trying effects"
    SIMULATION = "simulating"
    INFERENCE = "inference"
    JUDGEMENT = "judging"


@dataclass(frozen=True)
class Progress:
    """How far a diagnosis is.

    Attributes:
        stage: what it is at.
        share: done of that.
        leading: probabilities of the leading classes; NaN where only their order is known.
        draws: of an effect, while they are simulated.
    """

    stage: Stage
    share: float
    leading: Mapping[str, float] = field(default_factory=dict)
    draws: int = 0

    @property
    def words(self) -> str:
        """The stage for people."""
        return f"{self.stage}, {self.draws} draws" if self.draws else str(self.stage)


Report = Callable[[Progress], None]


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
    cache: Path | ProtocolCache | None = None,
    budget: Budget | None = None,
    seed: int = 0,
    report: Report | None = None,
    provenance: Mapping[str, Any] | None = None,
) -> Diagnosis:
    """Diagnose a campaign with a simulator of its trials.

    Args:
        simulator: of the campaign's trials with motion and outcome, in order of execution.
        campaign: the same trials.
        tier: information to use; None: all that enough of its trials have.
        cache: file of simulations, made where there is none, or what diagnoses of other campaigns
            of the same trials share; None: in memory.
        budget: of simulations.
        seed: of all draws.
        report: called with progress.
        provenance: of campaign and simulator, to go into the diagnosis.

    Returns:
        The diagnosis; equal campaign, simulator, seed and number of simulations give an equal one.

    Raises:
        DiagnosisError: the campaign holds too little.
        ResultError: the simulation cache cannot be used.
    """
    started = time.monotonic()
    seen = observe_campaign(campaign, tier)
    tell: Report = (lambda progress: None) if report is None else report
    reuse, file = (cache, cache.file) if isinstance(cache, ProtocolCache) else (None, cache)
    with SimulationCache(simulator, file) as store:
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
            progress=lambda n, m: tell(Progress(Stage.SCREENING, n / m)),
        )
        schedule.fit(screening.kept.size)
        _logger.info("screening keeps %d of %d trials", screening.kept.size, len(seen))
        library = reaching(
            store,
            screening,
            most=schedule.reach_trials,
            seed=seed,
            progress=lambda n, m: tell(Progress(Stage.REACH, n / m)),
        )
        _logger.info("%d effects can be the cause: %s", len(library), ", ".join(library))
        layers = noise_floor(store, seen, screening, most=schedule.floor_trials, seed=seed)
        rounds = _Rounds(store, library, seen, screening, reuse, seed, tell)
        last, count = rounds.run(schedule, watched=report is not None)
        _logger.info("leading after the last round: %s", ", ".join(_leading(last)))
        tell(Progress(Stage.JUDGEMENT, 0.0, _leading(last)))
        evidence = conclude(store, seen, screening, last.prepared, last.inference, seed=seed)
        tell(Progress(Stage.JUDGEMENT, 1.0, _leading(last)))
        noted = {
            **({} if provenance is None else provenance),
            **_provenance(store, schedule, library, last, count),
            "seed": seed,
            "wall_time_s": time.monotonic() - started,
        }
    return compose(seen, screening, last.prepared, last.inference, evidence, layers, noted)


def _provenance(
    store: SimulationCache, schedule: Schedule, library: Library, last: _Round, rounds: int
) -> dict[str, Any]:
    """What the diagnosis cost, and what it rests on."""
    return {
        "budget": {
            "state": str(_state(schedule, store)),
            "simulations": store.asked,
            "allowed": schedule.allowed,
            "cost_s": store.cost,
            "simulated": store.simulated,
            "reused": store.reused,
            "draws": dict(last.draws),
            "rounds": rounds,
        },
        "reach": {n: list(ends) for n, ends in reaches(library).items() if min(ends) < 1},
        "simulator": store.simulator.identity,
        "nuisances": list(store.simulator.nuisance_names),
        "constants": _constants(),
    }


def _constants() -> dict[str, dict[str, Any]]:
    """Tuned numbers that a diagnosis rests on, by what they are of."""
    return {
        "observed": asdict(OBSERVED),
        "series": asdict(SERIES),
        "table_motion": asdict(TABLE),
        "schedule": asdict(SCHEDULE),
        "screening": asdict(SCREENING),
        "ranges": asdict(RANGES),
        "reach": asdict(REACH),
        "noise_floor": asdict(NOISE_FLOOR),
        "discrepancy": asdict(DISCREPANCY),
        "scan": asdict(SCAN),
        "resimulation": asdict(RESIMULATION),
        "limits": asdict(LIMITS),
    }


def _state(schedule: Schedule, store: SimulationCache) -> BudgetState:
    if schedule.exceeded and store.asked > schedule.allowed:
        return BudgetState.EXCEEDED
    return BudgetState.ENDED_EARLY if schedule.limited else BudgetState.SUFFICIENT


@dataclass(eq=False)
class _Rounds:
    """Doubles the draws until the answer stands or the budget is spent."""

    store: SimulationCache
    library: Library
    seen: Observations
    screening: Screening
    reuse: ProtocolCache | None
    seed: int
    tell: Report
    leading: Mapping[str, float] = field(default_factory=dict)

    def run(self, schedule: Schedule, *, watched: bool) -> tuple[_Round, int]:
        """The last round and the number of rounds; `watched`: by somebody."""
        draws = dict.fromkeys(self.library, schedule.first_draws)
        for count in _first_looks(schedule.first_draws) if watched else ():
            design, _ = self._simulated(dict.fromkeys(self.library, count))
            self.leading = _provisional(design, self._observed)
        rounds: list[_Round] = []
        while True:
            found = self._judged(draws)
            self.leading = _leading(found)
            rounds.append(found)
            unlimited = zip(found.inference.labels, found.inference.unlimited, strict=True)
            more = schedule.next_draws(draws, dict(unlimited))
            kept = self.screening.kept.size
            spent = simulations(draws, kept)
            if more is None or not schedule.affords(simulations(more, kept) - spent, self.store):
                return found, len(rounds)
            if _settled(rounds):
                return found, len(rounds)
            draws = more

    @property
    def _observed(self) -> Data:
        kept = self.screening.kept
        return Data(self.seen.overturned[None, kept], self.seen.features[None, kept])

    def _simulated(self, draws: Mapping[str, int]) -> tuple[Design, NDArray[np.int64]]:
        leading, most = self.leading, max(draws.values())
        return simulate_design(
            self.store,
            self.seen,
            self.screening,
            self.library,
            draws,
            seed=self.seed,
            progress=lambda done, total: self.tell(
                Progress(Stage.SIMULATION, done / total, leading, most)
            ),
        )

    def _judged(self, draws: Mapping[str, int]) -> _Round:
        design, index = self._simulated(draws)
        seen, kept, leading = self.seen, self.screening.kept, self.leading
        fit = partial(
            prepare,
            self.library,
            design,
            index,
            TrialConditions(seen.order[kept], seen.log_pga[kept], seen.log_ratio[kept]),
            seen.motion[kept],
            seed=self.seed,
            step=lambda share: self.tell(Progress(Stage.INFERENCE, share, leading)),
        )
        if self.reuse is None:
            prepared = fit()
        else:
            reached = reaches(self.library).items()
            key = fingerprint(design, index, kept, seen.motion, *reached, self.seed)
            prepared = self.reuse.prepared(key, fit)
        return _Round(prepared, infer(prepared, self._observed), dict(draws))


def _first_looks(draws: int) -> list[int]:
    """Draws of the first round after which leading effects are shown: a quarter, a half."""
    return [count for count in (draws // 4, draws // 2) if count >= FEWEST_LOOK]


def _provisional(design: Design, observed: Data) -> dict[str, float]:
    """The four effects under which the outcomes are most probable, by frequencies alone.

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
