"""The budget: how many campaigns are simulated, and how many trials of each."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any

from vsr2.argument_names import checked_names
from vsr2.diagnosis.how_far.held_out import HELD_OUT
from vsr2.diagnosis.how_far.held_out import simulations as judging
from vsr2.diagnosis.how_far.waterfall import simulations as waterfall_simulations
from vsr2.diagnosis.verdict.limits import LIMITS
from vsr2.ensemble.noise_floor import NOISE_FLOOR
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.library import Library
from vsr2.ensemble.simulated.look import LOOK, most_tried, tries
from vsr2.errors import DiagnosisError
from vsr2.one_line import OnlyGiven


@dataclass(frozen=True)
class ScheduleConstants:
    """How a budget is spent; chosen by hand, and judged by `python studies/diagnosis_budget.py`.

    Attributes:
        look_share: of the simulations that may go into the look at effects.
        plain_share: of the simulations that may go into its draws without effect.
        chunk: campaigns simulated between two looks at the clock.
        fewest: campaigns that are simulated, whatever the budget.
        wanted: campaigns for each effect that are simulated before they get more trials: so many
            that a verdict does not call them few.
        least_trials: of a campaign, however small the budget.
        most: campaigns that are simulated where the budget allows more.
        first: share of the budget after which there is a first answer.
        training_s: of a campaign, until a first training has been timed [s].
        least_training_s: of a campaign, however short a training was [s].
        leading: hypotheses that are reported while a diagnosis runs.
        least_clock_s: least time that two readings of clocks are compared over [s].
        rounds: diagnoses of corrected scenes at most, where no number is asked for.
    """

    look_share: float = 0.15
    plain_share: float = 0.1
    chunk: int = 50
    fewest: int = 150
    wanted: int = LIMITS.few_campaigns
    least_trials: int = 40
    most: int = 8000
    first: float = 0.1
    training_s: float = 0.1
    least_training_s: float = 1e-4
    leading: int = 3
    least_clock_s: float = 1e-3
    rounds: int = 4


SCHEDULE = ScheduleConstants()


class BudgetWarning(UserWarning):
    """A budget is less than the least that a diagnosis does; the least is done all the same."""


@checked_names(DiagnosisError)
@dataclass(frozen=True, repr=False)
class Budget(OnlyGiven):
    """What may be spent, but for a least that no budget cuts: the look and 150 campaigns.

    Attributes:
        minutes: of wall time, training and judging included.
        simulations: their greatest number, however long they take; None: from `minutes`.
        campaigns: number of simulated campaigns, whatever they cost, so that all campaigns of one
            set-up share them; None: from the above. At least 150. The look's draws without effect
            are used besides.
        held_out: simulate again what is named, on motions that were not seen; without it a
            diagnosis does not say how far the gap shrinks.
        waterfall: judge each of the likeliest causes on motions that neither fit nor choice saw,
            which takes five more trainings.
        cpu_minutes: of processor time of this process, all threads together, in place of `minutes`,
            so that other work on the machine takes nothing from it; None: wall time.
        trials: of each simulated campaign; None: all where `campaigns` is given, else as many as
            leave time for 60 campaigns of each effect, but 40 at least.
        look: numbers of trials that are run, of trials on which effects are tried, and of draws
            without effect; None: as the budget affords.
        simulator: identity of that which the budget is for; empty: any.

    Raises:
        DiagnosisError: a number out of range.
    """

    minutes: float = 10.0
    simulations: int | None = None
    campaigns: int | None = None
    held_out: bool = True
    waterfall: bool = False
    cpu_minutes: float | None = None
    trials: int | None = None
    look: tuple[int, int, int] | None = None
    simulator: str = ""

    def __post_init__(self) -> None:
        for name, minutes in (("minutes", self.minutes), ("cpu_minutes", self.cpu_minutes)):
            if minutes is not None and not (isinstance(minutes, Real) and 0 < minutes < math.inf):
                raise DiagnosisError(
                    f"budget_{name} is {minutes}; give a finite number of minutes above 0"
                )
        if self.simulations is not None and self.simulations < 1:
            raise DiagnosisError(
                f"simulations is {self.simulations}; give at least 1, or a time instead"
            )
        if self.campaigns is not None and self.campaigns < SCHEDULE.fewest:
            raise DiagnosisError(f"campaigns is {self.campaigns}; give at least {SCHEDULE.fewest}")
        if self.trials is not None and not (
            isinstance(self.trials, Integral) and self.trials >= SCHEDULE.least_trials
        ):
            raise DiagnosisError(
                f"campaign_trials is {self.trials}; give at least {SCHEDULE.least_trials}"
            )
        if self.look is not None and not (len(self.look) == 3 and min(self.look) >= 1):
            raise DiagnosisError(f"look is {self.look}; give three numbers of 1 or more")

    @classmethod
    def repeating(cls, provenance: Mapping[str, Any], **options: Any) -> Budget:
        """What a diagnosis did, whatever it costs: for other campaigns of its scene and trials.

        With its simulations and its posterior in one cache, each takes seconds.

        Args:
            provenance: of the diagnosis, as `finished_diagnosis` reads it.
            options: `held_out` and `waterfall`.
        """
        looked, spent = provenance["look"], provenance["budget"]
        return cls(
            campaigns=spent["campaigns"] - looked["plain"],
            trials=max(spent["trials"], SCHEDULE.least_trials),
            look=(looked["among"], looked["trials"], looked["plain"]),
            simulator=provenance["simulator"],
            **options,
        )


def _warn(budget: str, least: float, judging: float, unit: str) -> None:
    remedy = f"give {least} {unit} or more"
    if judging:
        remedy += (
            f", or leave out how far the gap shrinks (--no-how-far, held_out=False), which takes "
            f"about {judging} of them"
        )
    speed = "" if unit == "simulations" else ", at the speed so far"
    warnings.warn(
        f"a budget of {budget} {unit} is too little: the least that a diagnosis of these trials "
        f"does takes about {least}{speed}, and is done all the same; {remedy}",
        BudgetWarning,
        stacklevel=4,
    )


class Stopwatch:
    """Time that passed, and processor time of this process, since it was made."""

    def __init__(self) -> None:
        self._wall, self._cpu = time.monotonic(), time.process_time()

    @property
    def wall_s(self) -> float:
        """On the clock [s]."""
        return time.monotonic() - self._wall

    @property
    def cpu_s(self) -> float:
        """Of all threads together [s]."""
        return time.process_time() - self._cpu


class Schedule:
    """Turns a budget into a look at effects and campaigns.

    Args:
        budget: what may be spent.
        cache: that has run a first simulation of every trial.
        trials: of the campaign.
        library: of effects.
        watch: made at the start of the diagnosis.

    Attributes:
        among: trials of the campaign that are run; fewer than all where the budget has too little
            for the look's draws without effect.
        look_trials: on which effects are tried.
        plain: campaigns without effect that the look simulates.
    """

    def __init__(
        self,
        budget: Budget,
        cache: SimulationCache,
        trials: int,
        library: Library,
        watch: Stopwatch,
    ) -> None:
        self._budget = budget
        self._cache = cache
        self._watch = watch
        self._training = SCHEDULE.training_s
        self._library, self._trials = library, trials
        self._wanted = SCHEDULE.wanted * len(library)
        allowed = self.allowed()
        self.among, self.plain = trials, LOOK.plain
        if budget.campaigns is None:
            afforded = int(SCHEDULE.plain_share * allowed)
            least = max(afforded // LOOK.fewest_plain, SCHEDULE.least_trials)
            self.among = min(trials, least)
            self.plain = max(LOOK.fewest_plain, min(LOOK.plain, afforded // self.among))
        self.look_trials, self._judged = most_tried(self.among), self.among
        if budget.campaigns is None:
            share = int(SCHEDULE.look_share * allowed / max(tries(library), 1))
            self.look_trials = max(LOOK.fewest, min(self.look_trials, share))
        if budget.look is not None:
            self.among, self.look_trials, self.plain = budget.look
            self._judged = self.among

    @property
    def look(self) -> tuple[int, int, int]:
        """As :attr:`Budget.look`."""
        return self.among, self.look_trials, self.plain

    @property
    def campaigns(self) -> int | None:
        """Number of simulated campaigns, where the budget states it."""
        return self._budget.campaigns

    def campaign_trials(self, responding: int) -> int:
        """How many trials of a campaign to simulate.

        While campaigns are few, more of them tell more than more trials do
        (docs/validation/diagnosis.md).

        Args:
            responding: trials of the campaign that lift off; all of them are judged.
        """
        self._judged = responding
        if self._budget.trials is not None or self._budget.campaigns is not None:
            return min(self._budget.trials or responding, responding)
        if self._budget.simulations is not None:
            left = float(self._budget.simulations - self._cache.asked - self._judging())
        else:
            left_s = (self._total_s - self.spent_s) / self._rate - self.judging_s
            left_s -= self._retraining_s(self._wanted)
            left = left_s / max(self._cache.cost, 1e-9)
        return int(min(max(left // self._wanted, SCHEDULE.least_trials), responding))

    @property
    def least(self) -> int:
        """Simulations that are asked for, however small the budget.

        Trials that lift off are not known before the look, so all count.
        """
        among, tried, plain = self._budget.look or (
            min(self._trials, SCHEDULE.least_trials), LOOK.fewest, LOOK.fewest_plain
        )  # fmt: skip
        look = plain * among + tries(self._library) * tried
        campaigns = SCHEDULE.fewest * min(SCHEDULE.least_trials, among)
        return look + campaigns + self._judging(among)

    def warn_of_too_little(self) -> None:
        """Say, before the work, that the budget is less than the least.

        Simulations that earlier runs left cost nothing.
        """
        among = min(self._trials, SCHEDULE.least_trials)
        judged = judging(among) if self._budget.held_out else 0
        if self._budget.campaigns is not None:
            return
        if self._budget.simulations is not None:
            if self.least > self._budget.simulations:
                _warn(f"{self._budget.simulations}", self.least, judged, "simulations")
            return
        cost = self._rate * self._cache.cost / 60
        training = self._rate * self._retraining_s(SCHEDULE.fewest) / 60
        left = max(self.least - self._cache.size, 0) * cost + training
        if self.spent_s / 60 + left > self._total_s / 60:
            least = math.ceil(self.spent_s / 6 + 10 * left) / 10
            unit = "min" if self._budget.cpu_minutes is None else "min of processor time"
            _warn(f"{self._total_s / 60:.3g}", least, round(judged * cost, 1), unit)

    @property
    def spent_s(self) -> float:
        """Time since the start, as the budget counts it [s]."""
        return self._watch.wall_s if self._budget.cpu_minutes is None else self._watch.cpu_s

    @property
    def _total_s(self) -> float:
        """Time that may be spent, as the budget counts it [s]."""
        minutes = self._budget.cpu_minutes
        return 60 * (self._budget.minutes if minutes is None else minutes)

    @property
    def _rate(self) -> float:
        """Seconds of the budget that a second on the clock takes; all costs are on the clock."""
        if self._budget.cpu_minutes is None:
            return 1.0
        least = SCHEDULE.least_clock_s
        return max(self._watch.cpu_s, least) / max(self._watch.wall_s, least)

    @property
    def judging_s(self) -> float:
        """What judging will take [s]."""
        return self._judging() * self._cache.cost

    def _retraining_s(self, campaigns: int) -> float:
        """What training of the posterior and for each group of motions will take [s]."""
        times = 1 + (HELD_OUT.groups if self._budget.waterfall else 0)
        return times * self._training * campaigns

    def _judging(self, trials: int | None = None) -> int:
        """Simulations that judging asks for; `trials`: that are judged."""
        trials = self._judged if trials is None else trials
        again = judging(trials) if self._budget.held_out else 0
        again += waterfall_simulations(trials) if self._budget.waterfall else 0
        return again + NOISE_FLOOR.runs * min(trials, NOISE_FLOOR.most_trials)

    def trained(self, campaigns: int, seconds: float) -> None:
        """Note what a training took."""
        self._training = max(seconds / campaigns, SCHEDULE.least_training_s)

    def next_campaigns(self, done: int, trials: int) -> int:
        """How many campaigns to simulate next; 0: there are enough.

        Args:
            done: simulated ones.
            trials: of a campaign that are simulated.
        """
        if self._budget.campaigns is not None:
            return min(SCHEDULE.chunk, self._budget.campaigns - done)
        most = min(SCHEDULE.chunk, SCHEDULE.most - done)
        if done < SCHEDULE.fewest:
            return min(most, SCHEDULE.fewest - done)
        if self._budget.simulations is not None:
            left = self._budget.simulations - self._cache.asked - self._judging()
            return max(0, min(most, left // max(trials, 1)))
        per_campaign = trials * self._cache.cost + self._retraining_s(1)
        left_s = (self._total_s - self.spent_s) / self._rate
        left_s -= self.judging_s + self._retraining_s(done)
        return max(0, min(most, int(left_s / max(per_campaign, 1e-6))))

    def progress(self, done: int, trials: int) -> tuple[float, float]:
        """Share of the campaigns that are simulated, and time left to the end [s].

        Args:
            done: simulated ones.
            trials: of a campaign that are simulated.
        """
        if self._budget.campaigns is not None:
            left = self._budget.campaigns - done
        elif self._budget.simulations is not None:
            asked = self._cache.asked + self._judging()
            left = max(self._budget.simulations - asked, 0) // max(trials, 1)
        else:
            left_s = max(self._total_s - self.spent_s, 0.0) / self._rate
            return min(self.spent_s / self._total_s, 1.0), left_s
        left_s = left * trials * self._cache.cost + self._retraining_s(done + left)
        return done / max(done + left, 1), left_s + self.judging_s

    def first_answer(self, done: int) -> bool:
        """Whether it is time for a first answer."""
        if done < SCHEDULE.fewest:
            return False
        if self._budget.campaigns is not None:
            return done >= SCHEDULE.first * self._budget.campaigns
        if self._budget.simulations is not None:
            return self._cache.asked >= SCHEDULE.first * self._budget.simulations
        return self.spent_s >= SCHEDULE.first * self._total_s

    def exceeded(self) -> bool:
        """Whether the least that is simulated is more than the budget allows."""
        if self._budget.campaigns is not None:
            return False
        if self._budget.simulations is not None:
            return self._cache.asked > self._budget.simulations
        return self.spent_s > self._total_s

    def allowed(self) -> int:
        """Simulations that the budget allows, at what one costs."""
        if self._budget.simulations is not None:
            return self._budget.simulations
        return int(self._total_s / self._rate / max(self._cache.cost, 1e-6))
