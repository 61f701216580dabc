"""The budget: how many simulations are run, and for which effects."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from vsr2.diagnosis.how_far.resimulation import RESIMULATION_RUNS
from vsr2.diagnosis.how_far.screened_out import SCREENED_OUT_RUNS
from vsr2.diagnosis.noise_floor import NOISE_FLOOR
from vsr2.diagnosis.simulated.cache import SimulationCache
from vsr2.diagnosis.simulated.design import SCREENING, none_draws
from vsr2.diagnosis.simulated.library import Library
from vsr2.diagnosis.simulated.reach import REACH, tries
from vsr2.errors import DiagnosisError


@dataclass(frozen=True)
class ScheduleConstants:
    """How a budget is spent; chosen by hand, and judged by `python studies/diagnosis_budget.py`.

    Attributes:
        first_draws: of every effect, before trials beyond `enough_trials` are kept: the emulator's
            Monte Carlo error hides a weak effect in any number of trials.
        enough_trials: see there.
        fewest_draws: of every effect.
        most_draws: of every effect.
        halving: effects whose probability by both routes is below this get no further draws.
        screening_share: of the simulations that may go into screening.
        fewest_trials: that are kept.
        reach_share: of the simulations that may go into trying how far effects reach.
        fewest_reach: trials on which they are tried.
        time_share: of the time that goes into simulations.
    """

    first_draws: int = 24
    enough_trials: int = 100
    fewest_draws: int = 6
    most_draws: int = 192
    halving: float = 0.002
    screening_share: float = 0.25
    fewest_trials: int = 12
    reach_share: float = 0.05
    fewest_reach: int = 6
    time_share: float = 0.85


SCHEDULE = ScheduleConstants()


@dataclass(frozen=True)
class Budget:
    """What may be spent.

    Attributes:
        minutes: of wall time; turned into simulations by their measured cost.
        simulations: their greatest number, however long they take; None: from `minutes`.
        draws: of every effect, in one round and whatever it costs, so that equal trials under
            equal effects share all simulations; None: rounds within the above. At least 6.

    Raises:
        DiagnosisError: a number out of range.
    """

    minutes: float = 10.0
    simulations: int | None = None
    draws: int | None = None

    def __post_init__(self) -> None:
        if not 0 < self.minutes < math.inf:
            raise DiagnosisError(
                f"budget_minutes is {self.minutes}; give a finite number of minutes above 0"
            )
        if self.simulations is not None and self.simulations < 1:
            raise DiagnosisError(
                f"simulations is {self.simulations}; give at least 1, or a time instead"
            )
        if self.draws is not None and self.draws < SCHEDULE.fewest_draws:
            raise DiagnosisError(f"draws is {self.draws}; give at least {SCHEDULE.fewest_draws}")


class Schedule:
    """Turns a budget into screening, trials, and rounds of draws.

    Args:
        budget: what may be spent.
        cache: that has run a first simulation of every trial.
        trials: of the campaign.
        library: of effects.

    Attributes:
        allowed: simulations, those that the cache had before included.
        screening_runs: simulations a trial for screening.
        floor_trials: whose noise floor is measured.
        reach_trials: on which effects are tried.
        most_trials: that may be kept.
        first_draws: of every effect in the first round.
        limited: whether the budget stopped the rounds.
        exceeded: whether the trials kept need more than the budget for the fewest draws.
    """

    def __init__(
        self, budget: Budget, cache: SimulationCache, trials: int, library: Library
    ) -> None:
        effects = len(library)
        full = SCREENING.plain + 2 * effects
        self._fixed = budget.draws
        if budget.draws is not None:
            per_trial = full + NOISE_FLOOR.runs + effects * budget.draws + none_draws(budget.draws)
            self.allowed = per_trial * trials
        elif budget.simulations is not None:
            self.allowed = budget.simulations
        else:
            left = int(SCHEDULE.time_share * 60 * budget.minutes / max(cache.cost, 1e-6))
            self.allowed = cache.size + max(left - cache.simulated, 0)
        share = 1.0 if self._fixed else SCHEDULE.screening_share
        self.screening_runs = max(4, min(full, int(share * self.allowed / trials)))
        self.floor_trials = max(
            2, min(NOISE_FLOOR.most_trials, self.allowed // (20 * NOISE_FLOOR.runs))
        )
        tried = tries(library)
        self.reach_trials = max(
            SCHEDULE.fewest_reach,
            min(REACH.trials, int(SCHEDULE.reach_share * self.allowed / tried)),
        )
        rest = self.allowed - self.screening_runs * trials - NOISE_FLOOR.runs * self.floor_trials
        rest -= tried * self.reach_trials
        fewest = SCHEDULE.fewest_draws * effects + none_draws(SCHEDULE.fewest_draws)
        wanted = SCHEDULE.first_draws * effects + none_draws(SCHEDULE.first_draws)
        enough = min(SCHEDULE.enough_trials, rest // fewest)
        self.most_trials = max(SCHEDULE.fewest_trials, enough, rest // wanted)
        if self._fixed is not None:
            self.most_trials = trials
        self.first_draws = SCHEDULE.first_draws
        self.limited = False
        self.exceeded = False
        self._reserve = 0
        self._rest = rest
        self._trials = trials
        self._effects = effects

    def fit(self, kept: int) -> None:
        """Lower the first round's draws to what the budget allows for the trials kept."""
        if self._fixed is not None:
            self.first_draws = self._fixed
            return
        # All are simulated once more, under what is found.
        self._reserve = SCREENED_OUT_RUNS * (self._trials - kept) + RESIMULATION_RUNS * kept
        self._rest -= self._reserve
        for draws in range(SCHEDULE.first_draws, SCHEDULE.fewest_draws - 1, -1):
            self.first_draws = draws
            if (draws * self._effects + none_draws(draws)) * kept <= self._rest:
                return
        self.exceeded = True

    def affords(self, more: int, cache: SimulationCache) -> bool:
        """Whether so many more simulations fit, beside those of the screened-out trials."""
        fits = cache.asked + more + self._reserve <= self.allowed
        self.limited = not fits
        return fits

    def next_draws(
        self, draws: Mapping[str, int], probability: Mapping[str, float]
    ) -> dict[str, int] | None:
        """Twice as many draws for the effects still in the race; None: there are enough."""
        most = max(draws.values())
        if self._fixed is not None or most >= SCHEDULE.most_draws:
            return None
        return {
            name: 2 * count if count == most and probability[name] >= SCHEDULE.halving else count
            for name, count in draws.items()
        }
