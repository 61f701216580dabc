"""The budget: how many simulations are run, and for which effects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from vsr2.diagnosis.bank import Bank

FIRST_DRAWS = 12
MAX_DRAWS = 192
HALVING = 0.002
"""Effects whose leading probability is below this get no further draws."""
_SHARE = 0.85
"""Of the time that goes into simulations."""


@dataclass(frozen=True)
class Budget:
    """What may be spent.

    Attributes:
        minutes: of wall time; turned into simulations by the cost measured while screening.
        simulations: their greatest number, however long they take; None: from `minutes`.
    """

    minutes: float = 10.0
    simulations: int | None = None


class Schedule:
    """Turns a budget into rounds of draws.

    Attributes:
        first_draws: of every effect in the first round.
        limited: whether the budget stopped the rounds.
    """

    def __init__(self, budget: Budget) -> None:
        self.first_draws = FIRST_DRAWS
        self.limited = False
        self._budget = budget
        self._allowed = budget.simulations

    def measured(self, simulated: int, reused: int, seconds: float) -> None:
        """Fix the number of simulations by the cost of those that screening needed."""
        if self._allowed is None:
            each = seconds / simulated if simulated else 0.0
            left = max(_SHARE * 60 * self._budget.minutes - seconds, 0.0)
            # What is in the bank already costs next to nothing.
            self._allowed = reused + simulated + (int(left / each) if each > 0 else 10**9)

    def affords(self, simulations: int, bank: Bank) -> bool:
        """Whether so many more simulations fit."""
        assert self._allowed is not None
        fits = bank.simulated + bank.reused + simulations <= self._allowed
        self.limited = not fits
        return fits

    def next_draws(
        self, draws: Mapping[str, int], probability: Mapping[str, float]
    ) -> dict[str, int] | None:
        """Twice as many draws for the effects still in the race; None: there are enough."""
        if max(draws.values()) >= MAX_DRAWS:
            return None
        most = max(draws.values())
        return {
            name: 2 * count if count == most and probability[name] >= HALVING else count
            for name, count in draws.items()
        }
