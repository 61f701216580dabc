"""The budget: how many simulations are run, and for which effects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from vsr2.diagnosis.floor import FLOOR_RUNS, MAX_TRIALS
from vsr2.diagnosis.how_far.anew import ANEW_RUNS
from vsr2.diagnosis.how_far.dropped import DROPPED_RUNS
from vsr2.diagnosis.simulated.bank import Bank
from vsr2.diagnosis.simulated.design import SCREENING_NONE, none_draws
from vsr2.diagnosis.simulated.library import Library
from vsr2.diagnosis.simulated.reach import TRIALS, tries

FIRST_DRAWS = 24
"""Of every effect, before trials beyond `ENOUGH_TRIALS` are kept: the emulator's Monte Carlo error
hides a weak effect in any number of trials."""
ENOUGH_TRIALS = 100
FEWEST_DRAWS = 6
MAX_DRAWS = 192
HALVING = 0.002
"""Effects whose probability by both routes is below this get no further draws."""
SCREENING_SHARE = 0.25
"""Of the simulations that may go into screening."""
FEWEST_TRIALS = 12
REACH_SHARE = 0.05
"""Of the simulations that may go into trying how far effects reach."""
FEWEST_REACH = 6
_TIME_SHARE = 0.85
"""Of the time that goes into simulations."""


@dataclass(frozen=True)
class Budget:
    """What may be spent.

    Attributes:
        minutes: of wall time; turned into simulations by their measured cost.
        simulations: their greatest number, however long they take; None: from `minutes`.
        draws: of every effect, in one round and whatever it costs, so that equal trials under
            equal effects share all simulations; None: rounds within the above.
    """

    minutes: float = 10.0
    simulations: int | None = None
    draws: int | None = None


class Schedule:
    """Turns a budget into screening, trials, and rounds of draws.

    Args:
        budget: what may be spent.
        bank: that has run a first simulation of every trial.
        trials: of the campaign.
        library: of effects.

    Attributes:
        allowed: simulations, those that the bank had before included.
        screening_runs: simulations a trial for screening.
        floor_trials: whose noise floor is measured.
        reach_trials: on which effects are tried.
        most_trials: that may be kept.
        first_draws: of every effect in the first round.
        limited: whether the budget stopped the rounds.
        exceeded: whether the trials kept need more than the budget for the fewest draws.
    """

    def __init__(self, budget: Budget, bank: Bank, trials: int, library: Library) -> None:
        effects = len(library)
        full = SCREENING_NONE + 2 * effects
        self._fixed = budget.draws
        if budget.draws is not None:
            per_trial = full + FLOOR_RUNS + effects * budget.draws + none_draws(budget.draws)
            self.allowed = per_trial * trials
        elif budget.simulations is not None:
            self.allowed = budget.simulations
        else:
            left = int(_TIME_SHARE * 60 * budget.minutes / max(bank.cost, 1e-6))
            self.allowed = bank.size + max(left - bank.simulated, 0)
        share = 1.0 if self._fixed else SCREENING_SHARE
        self.screening_runs = max(4, min(full, int(share * self.allowed / trials)))
        self.floor_trials = max(2, min(MAX_TRIALS, self.allowed // (20 * FLOOR_RUNS)))
        tried = tries(library)
        self.reach_trials = max(FEWEST_REACH, min(TRIALS, int(REACH_SHARE * self.allowed / tried)))
        rest = self.allowed - self.screening_runs * trials - FLOOR_RUNS * self.floor_trials
        rest -= tried * self.reach_trials
        fewest = FEWEST_DRAWS * effects + none_draws(FEWEST_DRAWS)
        wanted = FIRST_DRAWS * effects + none_draws(FIRST_DRAWS)
        enough = min(ENOUGH_TRIALS, rest // fewest)
        self.most_trials = max(FEWEST_TRIALS, enough, rest // wanted)
        if self._fixed is not None:
            self.most_trials = trials
        self.first_draws = FIRST_DRAWS
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
        self._reserve = DROPPED_RUNS * (self._trials - kept) + ANEW_RUNS * kept
        self._rest -= self._reserve
        for draws in range(FIRST_DRAWS, FEWEST_DRAWS - 1, -1):
            self.first_draws = draws
            if (draws * self._effects + none_draws(draws)) * kept <= self._rest:
                return
        self.exceeded = True

    def affords(self, more: int, bank: Bank) -> bool:
        """Whether so many more simulations fit, beside those of the dropped trials."""
        fits = bank.asked + more + self._reserve <= self.allowed
        self.limited = not fits
        return fits

    def next_draws(
        self, draws: Mapping[str, int], probability: Mapping[str, float]
    ) -> dict[str, int] | None:
        """Twice as many draws for the effects still in the race; None: there are enough."""
        most = max(draws.values())
        if self._fixed is not None or most >= MAX_DRAWS:
            return None
        return {
            name: 2 * count if count == most and probability[name] >= HALVING else count
            for name, count in draws.items()
        }
