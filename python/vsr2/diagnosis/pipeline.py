"""The diagnosis from end to end, for any simulator."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.campaign import Campaign, Tier
from vsr2.diagnosis.budget import SCHEDULE, Budget, Schedule, Stopwatch
from vsr2.diagnosis.diagnosis_constants import diagnosis_constants
from vsr2.diagnosis.how_far.held_out import HowFar, Inferred, Loss, judge
from vsr2.diagnosis.how_far.waterfall import FullInference, Waterfall, waterfall
from vsr2.diagnosis.verdict.compose import Evidence, compose
from vsr2.diagnosis.verdict.document import Diagnosis
from vsr2.diagnosis.verdict.rules import Verdict, verdict_of
from vsr2.diagnosis.verdict.statements import BudgetState
from vsr2.diagnosis.where.locations import where_it_lies
from vsr2.ensemble.execution import Progress, Report, Stage
from vsr2.ensemble.noise_floor import noise_floor
from vsr2.ensemble.observed.observations import (
    Observations,
    observe_campaign,
    outcomes_hash,
    same_trials,
)
from vsr2.ensemble.protocol_cache import ProtocolCache
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.campaigns import (
    Campaigns,
    insensitive,
    plain_campaigns,
    simulate_campaigns,
)
from vsr2.ensemble.simulated.hypotheses import HYPOTHESIS
from vsr2.ensemble.simulated.library import NONE, UNKNOWN, Library
from vsr2.ensemble.simulated.linear_algebra import one_blas_thread
from vsr2.ensemble.simulated.look import Look, look
from vsr2.ensemble.simulated.simulator import Request, Simulator
from vsr2.errors import DiagnosisError
from vsr2.one_line import counted
from vsr2.posterior.calibration import label_probability
from vsr2.posterior.files import load_posterior, posterior_file, save_posterior
from vsr2.posterior.training import Found, Posterior, train

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Question:
    """What is asked of a campaign.

    Attributes:
        tier: information to use; None: all that enough of its trials have.
        excluded: effects that are not looked for.
        references: campaigns of the same trials that are known to have no effect.
        seed: of all draws.
        most_effects: that may act together.
        waterfall: judge each of the likeliest causes on motions that neither fit nor choice saw.
    """

    tier: Tier | None = None
    excluded: tuple[str, ...] = ()
    references: tuple[Campaign, ...] = ()
    seed: int = 0
    most_effects: int = HYPOTHESIS.usual_effects
    waterfall: bool = False


QUESTION = Question()


@one_blas_thread()
def diagnose_with(
    simulator: Simulator,
    campaign: Campaign,
    question: Question = QUESTION,
    *,
    cache: Path | ProtocolCache | None = None,
    budget: Budget | None = None,
    report: Report | None = None,
    provenance: Mapping[str, Any] | None = None,
    watch: Stopwatch | None = None,
) -> Diagnosis:
    """Diagnose a campaign with a simulator of its trials.

    Args:
        simulator: of the campaign's trials with motion and outcome, in order of execution.
        campaign: the same trials.
        question: what is asked of it.
        cache: folder of simulations and posteriors; None: in memory.
        budget: of simulated campaigns.
        report: called with progress.
        provenance: of campaign and simulator, to go into the diagnosis.
        watch: started where the budget's time begins; None: here.

    Returns:
        The diagnosis; equal campaign, simulator, seed and number of campaigns give an equal one.

    Raises:
        DiagnosisError: the campaign holds too little, none of its trials lifts off in the scene, or
            a reference has other trials.
        ResultError: the cache cannot be used.
    """
    watch = Stopwatch() if watch is None else watch
    seed = question.seed
    seen = observe_campaign(campaign, question.tier)
    references = [_reference(one, seen) for one in question.references]
    kept = ProtocolCache(cache) if isinstance(cache, Path) else cache
    budget = Budget() if budget is None else budget
    with SimulationCache(simulator, None if kept is None else kept.simulations) as store:
        # One simulation of every trial tells what they cost.
        store.run([Request(i, (), 1, 1) for i in range(len(seen))])
        schedule = Schedule(budget, store, len(seen), simulator.library, watch)
        schedule.warn_of_too_little()
        work = _Work(store, seen, schedule, kept, question, report)
        seen_look = work.look()
        responding = _responding(seen_look, campaign.name, (schedule.among, len(seen)))
        trials = seen_look.spread(schedule.campaign_trials(responding.size))
        posterior = work.posterior(seen_look, trials)
        alike = [
            posterior.infer(one.overturned[trials], one.features[trials]) for one in references
        ]
        none = [float(one.probability[0]) for one in alike]
        posterior = posterior.with_references(alike)
        found = posterior.infer(seen.overturned[trials], seen.features[trials])
        work.notify(Stage.JUDGEMENT, 0.0, found, posterior)
        verdict = verdict_of(found, posterior)
        how_far = judge(
            store, seen, responding, Inferred(posterior, found.residuals, trials),
            _judged(verdict, posterior) if budget.held_out else (), seed=seed,
            progress=lambda n, m: work.notify(Stage.JUDGEMENT, n / m, found, posterior),
        )  # fmt: skip
        falls = work.waterfall(posterior, found, trials, how_far) if question.waterfall else None
        layers = noise_floor(store, seen, responding, how_far.before)
        where = where_it_lies(seen, trials, found.residuals, posterior.gap_free, seed)
        spent = work.budget_of(posterior, trials.size)
        work.notify(Stage.JUDGEMENT, 1.0, found, posterior)
    noted = {
        **({} if provenance is None else provenance),
        **_noted(question, none, budget.held_out, spent, simulator, seen_look),
        "look": {
            "among": schedule.among,
            "trials": schedule.look_trials,
            "plain": schedule.plain,
        },
        "wall_time_s": watch.wall_s,
    }
    evidence = Evidence(
        verdict, found, posterior, how_far, where, responding, trials,
        insensitive(simulator.library, seen_look.limits), layers, falls,
    )  # fmt: skip
    return compose(seen, evidence, noted)


def _noted(
    question: Question,
    none: Sequence[float],
    held_out: bool,
    spent: Mapping[str, Any],
    simulator: Simulator,
    found: Look,
) -> dict[str, Any]:
    """What was asked, of what it was judged, and what that cost.

    Args:
        question: with its references.
        none: probability of none in each reference.
        held_out: whether it was judged how far the gap shrinks.
        spent: of the budget.
        simulator: of the trials.
        found: detection limits.
    """
    return {
        "excluded": sorted(question.excluded),
        "references": [
            {"campaign": one.name, "none": p}
            for one, p in zip(question.references, none, strict=True)
        ],
        "held_out": held_out,
        "budget": spent,
        "detection_limits": {
            f"{name}.{parameter} {'+' if side > 0 else '-'}": limit.share
            for (name, parameter, side), limit in found.limits.items()
        },
        "simulator": simulator.identity,
        "nuisances": list(simulator.nuisance_names),
        "constants": diagnosis_constants(),
        "seed": question.seed,
    }


def _responding(found: Look, name: str, run: tuple[int, int]) -> NDArray[np.int64]:
    """Trials that lift off in some draw of nuisances; there are some.

    Args:
        found: detection limits.
        name: of the campaign.
        run: how many of its trials were run, and how many it has.

    Raises:
        DiagnosisError: there are none, so that simulated campaigns would all be alike.
    """
    if not found.responding.size:
        among, trials = run
        part = f"the {among} that the budget runs of its" if among < trials else "its"
        raise DiagnosisError(
            f"campaign {name!r}: none of {part} {trials} trials lifts off in the scene, so that no "
            "cause can be distinguished from another; drive the trials more strongly, or correct "
            "the scene (size of the rock, motions and their units)"
        )
    return found.responding


def _reference(campaign: Campaign, seen: Observations) -> Observations:
    """A reference as the observed campaign is seen.

    Raises:
        DiagnosisError: it has other trials, the observed campaign's results, or does not reach the
            tier.
    """
    out = observe_campaign(campaign, seen.tier)
    if not same_trials(out, seen):
        raise DiagnosisError(
            f"reference {campaign.name!r}: its trials differ from those of campaign "
            f"{seen.campaign.name!r} in number, motion, PGA or PGV; give references of the same "
            "trials in the same order"
        )
    if _is_copy(out, seen):
        raise DiagnosisError(
            f"reference {campaign.name!r}: its results are those of campaign "
            f"{seen.campaign.name!r}, which would be `none` by itself; give another campaign, one "
            "that is known to have no effect"
        )
    return out


def _is_copy(one: Observations, other: Observations) -> bool:
    """Whether two campaigns are one and the same.

    Outcomes alone may agree by chance, as most trials overturn always or never. Largest tilts do
    not; where there are none, the campaign's name decides.
    """
    results, others = (outcomes_hash(seen.overturned, seen.features) for seen in (one, other))
    if results != others or one.tier != "B":
        return results == others
    tilts, theirs = ([t.peak_tilt for t in seen.campaign.trials] for seen in (one, other))
    if any(tilt is not None for tilt in (*tilts, *theirs)):
        return tilts == theirs
    return one.campaign.name == other.campaign.name


def _judged(verdict: Verdict, posterior: Posterior) -> list[str]:
    """What is simulated again: of each cause the first effect that is named or leads."""
    names = [finding[0] for finding in verdict.findings]
    return [name for name in names if name in posterior.parameters.known]


@dataclass(eq=False)
class _Work:
    """Simulating and training within a budget."""

    store: SimulationCache
    seen: Observations
    schedule: Schedule
    cache: ProtocolCache | None
    question: Question
    report: Report | None
    campaigns: Campaigns | None = None

    def notify(
        self,
        stage: Stage,
        share: float,
        found: Found | None = None,
        posterior: Posterior | None = None,
        left_s: float = np.nan,
    ) -> None:
        """Report progress."""
        if self.report is not None:
            leading = {} if found is None or posterior is None else _leading(found, posterior)
            self.report(Progress(stage, share, left_s, leading))

    def look(self) -> Look:
        """Detection limits, and the trials that respond."""
        return look(
            self.store, len(self.seen), among=self.schedule.among,
            most=self.schedule.look_trials, plain=self.schedule.plain, seed=self.question.seed,
            progress=lambda n, m: self.notify(Stage.LOOK, n / m),
        )  # fmt: skip

    def waterfall(
        self, posterior: Posterior, found: Found, trials: NDArray[np.int64], how_far: HowFar
    ) -> Waterfall:
        """What each of the likeliest causes adds, judged with the campaigns of the posterior."""
        campaigns = self.campaigns
        floor = how_far.losses[Loss.FLOOR][np.isin(how_far.trials, trials)]
        if campaigns is None:
            asked, count = self.question, posterior.campaigns - self.schedule.plain
            looked = self.look()
            campaigns = plain_campaigns(self.store, trials, self.schedule.plain).joined(
                simulate_campaigns(
                    self.store, looked, trials, range(count),
                    most=asked.most_effects, seed=asked.seed,
                )
            )  # fmt: skip
        return waterfall(
            self.store, self.seen, trials, campaigns,
            FullInference(posterior, found), floor, seed=self.question.seed,
            progress=lambda n, m: self.notify(Stage.WATERFALL, n / m, found, posterior),
        )  # fmt: skip

    def posterior(self, found: Look, trials: NDArray[np.int64]) -> Posterior:
        """Simulated campaigns until the budget is spent, and what is learnt from them.

        Args:
            found: detection limits.
            trials: indices of those simulated.
        """
        known = self._known(self.schedule.campaigns, trials.size)
        if known is not None:
            return known
        campaigns = plain_campaigns(self.store, trials, self.schedule.plain)
        done = 0
        leading: tuple[Found, Posterior] | None = None
        while count := self.schedule.next_campaigns(done, trials.size):
            more = simulate_campaigns(
                self.store, found, trials, range(done, done + count),
                most=self.question.most_effects, seed=self.question.seed,
            )  # fmt: skip
            campaigns = campaigns.joined(more)
            done += count
            self._simulated(done, trials.size, leading)
            if leading is None and self._first_answer_is_due(done, trials.size):
                self._training(done, trials.size)
                first = self._trained(campaigns, trials, done)
                leading = (
                    first.infer(self.seen.overturned[trials], self.seen.features[trials]),
                    first,
                )
        self._training(done, trials.size)
        self.campaigns = campaigns
        return self._trained(campaigns, trials, done)

    def _first_answer_is_due(self, done: int, trials: int) -> bool:
        """Whether somebody gets it, and it is not the answer itself that is next."""
        if self.report is None or not self.schedule.first_answer(done):
            return False
        return self.schedule.next_campaigns(done, trials) > 0

    def _training(self, done: int, trials: int) -> None:
        """Report that a training begins, and the time left to the end."""
        self.notify(Stage.TRAINING, 0.0, left_s=self.schedule.progress(done, trials)[1])

    def _simulated(self, done: int, trials: int, leading: tuple[Found, Posterior] | None) -> None:
        budget = self.schedule.spent_s
        share, left_s = self.schedule.progress(done, trials)
        found, posterior = (None, None) if leading is None else leading
        self.notify(Stage.SIMULATION, share, found, posterior, left_s)
        _logger.debug("%s after %.0f s", counted(done, "campaign"), budget)

    def _known(self, campaigns: int | None, trials: int) -> Posterior | None:
        """What an earlier diagnosis learnt from so many campaigns of so many trials."""
        if self.cache is None or campaigns is None:
            return None
        path, library = self._path(self.cache, campaigns, trials), self._library
        return load_posterior(path, library, (trials, self.seen.features.shape[-1]))

    @property
    def _library(self) -> Library:
        """Effects that are looked for."""
        excluded = self.question.excluded
        return {n: one for n, one in self.store.simulator.library.items() if n not in excluded}

    def _path(self, cache: ProtocolCache, campaigns: int, trials: int) -> Path:
        asked = self.question
        simulated = (campaigns, trials, *self.schedule.look)
        simulator = self.store.simulator
        return posterior_file(
            cache.folder, simulator, self.seen, simulated, asked.seed, asked.most_effects,
            set(asked.excluded) & set(simulator.library),
        )  # fmt: skip

    def _trained(self, campaigns: Campaigns, trials: NDArray[np.int64], done: int) -> Posterior:
        known = self._known(done, trials.size)
        if known is not None:
            return known
        started = time.monotonic()
        made = train(
            self.seen, campaigns, self._library, trials,
            most=self.question.most_effects, seed=self.question.seed,
        )  # fmt: skip
        self.schedule.trained(len(campaigns), time.monotonic() - started)
        if self.cache is not None:
            save_posterior(made, self._path(self.cache, done, trials.size))
        return made

    def budget_of(self, posterior: Posterior, trials: int) -> dict[str, Any]:
        """What the diagnosis cost; `trials`: of each simulated campaign."""
        exceeded = self.schedule.exceeded()
        return {
            "state": str(BudgetState.EXCEEDED if exceeded else BudgetState.SUFFICIENT),
            "simulations": self.store.asked,
            "allowed": self.schedule.allowed(),
            "cost_s": self.store.cost,
            "simulated": self.store.simulated,
            "reused": self.store.reused,
            "campaigns": posterior.campaigns,
            "trials": trials,
        }


def _leading(found: Found, posterior: Posterior) -> dict[str, float]:
    names = (NONE, *posterior.sets.names, UNKNOWN)
    labels = label_probability(found.probability[None], posterior.sets)[0]
    return {names[i]: float(labels[i]) for i in np.argsort(-labels)[: SCHEDULE.leading]}
