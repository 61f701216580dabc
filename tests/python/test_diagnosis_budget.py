"""The budget: how many campaigns are simulated, whatever it is counted in."""

from __future__ import annotations

import re
import warnings
from types import SimpleNamespace

import numpy as np
import pytest

from planar.planar_library import PLANAR_LIBRARY
from vsr2.diagnosis import Budget, BudgetWarning
from vsr2.diagnosis import budget as module
from vsr2.diagnosis import diagnose as api
from vsr2.diagnosis.budget import SCHEDULE, Schedule, Stopwatch
from vsr2.diagnosis.how_far.held_out import simulations as judging
from vsr2.ensemble import Execution
from vsr2.ensemble.noise_floor import NOISE_FLOOR
from vsr2.ensemble.simulated.look import LOOK, tries
from vsr2.errors import DiagnosisError

COST = 0.01
"""Of a simulation [s]."""
TRIALS = 60


class Clock:
    """Time passes by simulating and by training; nothing else takes any."""

    def __init__(self, budget, monkeypatch, training=0.0, trials=TRIALS, processors=1.0):
        self.now, self.trials, self.training = 1000.0, trials, training
        self.cache = SimpleNamespace(cost=COST, asked=0)
        monkeypatch.setattr(module.time, "monotonic", lambda: self.now)
        monkeypatch.setattr(module.time, "process_time", lambda: processors * self.now)
        watch = Stopwatch()
        # One simulation of every trial, which tells what they cost.
        self.now += COST * trials
        self.schedule = Schedule(budget, self.cache, trials, PLANAR_LIBRARY, watch)
        self.done = 0
        self.first = None

    def simulate(self, count):
        self.cache.asked += count
        self.now += COST * count

    def train(self, campaigns):
        self.now += self.training * campaigns
        self.schedule.trained(campaigns, self.training * campaigns)

    def run(self):
        """A diagnosis from look to judgement."""
        self.simulate(self.schedule.plain * self.trials)
        self.simulate(tries(PLANAR_LIBRARY) * self.schedule.look_trials)
        trials = self.schedule.campaign_trials(self.trials)
        while count := self.schedule.next_campaigns(self.done, trials):
            assert count > 0
            self.simulate(count * trials)
            self.done += count
            if self.first is None and self.schedule.first_answer(self.done):
                self.train(self.done)
                self.first = self.now - 1000.0
        self.train(self.done)
        runs = NOISE_FLOOR.runs * min(self.trials, NOISE_FLOOR.most_trials)
        self.simulate(judging(self.trials) + runs)
        return self.now - 1000.0


@pytest.mark.parametrize("minutes", [10.0, 30.0])
@pytest.mark.parametrize("training", [0.0, 0.02, 0.3])
def test_minutes_bound_everything_judging_included(monkeypatch, minutes, training) -> None:
    clock = Clock(Budget(minutes=minutes), monkeypatch, training)
    spent = clock.run()
    assert spent <= 60 * minutes
    assert not clock.schedule.exceeded()
    # And most of it is used.
    assert spent > 0.9 * 60 * minutes
    # A first answer after a tenth of it, and what a training of so many takes.
    first = clock.first - 0.1 * 60 * minutes
    least = COST * TRIALS * (SCHEDULE.fewest + LOOK.plain)
    least += COST * tries(PLANAR_LIBRARY) * LOOK.fewest
    assert clock.first <= 60 * minutes
    assert first <= max(0.05 * 60 * minutes, least) + training * SCHEDULE.most


@pytest.mark.parametrize("processors", [0.4, 1.0, 8.0])
def test_processor_minutes_bound_processor_time(monkeypatch, processors) -> None:
    # Ten minutes on the clock; the wall time of the budget does not count.
    minutes = 10.0 * processors
    clock = Clock(Budget(0.001, cpu_minutes=minutes), monkeypatch, 0.02, processors=processors)
    spent = processors * clock.run()
    assert 0.9 * 60 * minutes < spent <= 60 * minutes
    assert not clock.schedule.exceeded()
    _, left_s = clock.schedule.progress(clock.done, TRIALS)
    assert left_s == pytest.approx((60 * minutes - spent) / processors)


def test_simulations_bound_what_is_asked_for(monkeypatch) -> None:
    clock = Clock(Budget(simulations=50_000), monkeypatch)
    clock.run()
    assert 50_000 - SCHEDULE.chunk * TRIALS < clock.cache.asked <= 50_000
    assert clock.first is not None
    assert clock.schedule.allowed() == 50_000
    assert not clock.schedule.exceeded()


def test_campaigns_are_counted_whatever_they_cost(monkeypatch) -> None:
    clock = Clock(Budget(minutes=0.001, campaigns=320), monkeypatch)
    clock.run()
    assert clock.done == 320
    assert (clock.schedule.look_trials, clock.schedule.plain) == (LOOK.trials, LOOK.plain)
    assert not clock.schedule.exceeded()


def test_the_least_is_simulated_whatever_the_budget_and_no_more_than_the_most(monkeypatch) -> None:
    clock = Clock(Budget(simulations=10), monkeypatch)
    clock.run()
    assert clock.done == SCHEDULE.fewest
    assert (clock.schedule.look_trials, clock.schedule.plain) == (LOOK.fewest, LOOK.fewest_plain)
    assert clock.schedule.exceeded()
    ample = Clock(Budget(simulations=10**8), monkeypatch)
    ample.run()
    assert ample.done == SCHEDULE.most
    assert ample.schedule.look_trials == LOOK.trials


@pytest.mark.parametrize("simulations", [20_000, 60_000, 150_000, 400_000])
def test_campaigns_come_before_trials(monkeypatch, simulations) -> None:
    clock = Clock(Budget(simulations=simulations), monkeypatch, trials=300)
    clock.simulate(clock.schedule.plain * 300)
    wanted = SCHEDULE.wanted * len(PLANAR_LIBRARY)
    found = clock.schedule.campaign_trials(250)
    assert SCHEDULE.least_trials <= found <= 250
    asked = judging(250) + NOISE_FLOOR.runs * NOISE_FLOOR.most_trials
    left = simulations - clock.cache.asked - asked
    if found > SCHEDULE.least_trials:
        assert found * wanted <= left
    if found < 250:
        assert (found + 1) * wanted > left


@pytest.mark.parametrize(
    ("simulations", "among", "plain"),
    [(10_000, 41, 24), (9_000, 40, 24), (60_000, 250, 24), (90_000, 300, 30), (10**6, 300, 48)],
)
def test_a_small_budget_runs_a_part_of_the_trials(monkeypatch, simulations, among, plain) -> None:
    """A tenth of it goes into draws without effect, 24 at least."""
    schedule = Clock(Budget(simulations=simulations), monkeypatch, trials=300).schedule
    assert (schedule.among, schedule.plain) == (among, plain)


def warned(options, monkeypatch, known=SCHEDULE.least_trials, processors=1.0):
    """What is said of a budget before the work on so few trials that all are run."""
    trials = SCHEDULE.least_trials
    clock = Clock(Budget(**options), monkeypatch, trials=trials, processors=processors)
    clock.cache.size = known
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        clock.schedule.warn_of_too_little()
    assert all(one.category is BudgetWarning for one in seen)
    return clock, [str(one.message) for one in seen]


def test_a_budget_below_the_least_is_said_before_the_work(monkeypatch) -> None:
    clock, (said,) = warned({"minutes": 0.2}, monkeypatch)
    least_s = COST * clock.schedule.least
    assert said.startswith("a budget of 0.2 min is too little")
    minutes = float(re.search(r"takes about ([0-9.]+), at the speed so far", said)[1])
    # Up to tenths of a minute, and with a guess at training.
    spare_s = 6.0 + SCHEDULE.training_s * SCHEDULE.fewest
    assert least_s <= 60 * minutes <= least_s + spare_s
    assert f"give {minutes} min or more" in said
    assert "--no-how-far" in said
    # And it is what such a diagnosis takes.
    assert clock.run() == pytest.approx(least_s, abs=1.0)


def test_a_budget_that_suffices_is_not_said_to_be_too_little(monkeypatch) -> None:
    clock, _ = warned({"minutes": 0.2}, monkeypatch)
    least_s, least = COST * clock.schedule.least, clock.schedule.least
    enough = (least_s + SCHEDULE.training_s * SCHEDULE.fewest + 1.0) / 60
    assert warned({"minutes": enough}, monkeypatch)[1] == []
    assert warned({"simulations": 10**6}, monkeypatch)[1] == []
    assert warned({"minutes": 0.001, "campaigns": 320}, monkeypatch)[1] == []
    # What is kept costs nothing but its training.
    training = (SCHEDULE.training_s * SCHEDULE.fewest + 1.0) / 60
    assert warned({"minutes": training}, monkeypatch, known=least)[1] == []
    (said,) = warned({"simulations": 10, "held_out": False}, monkeypatch)[1]
    assert "a budget of 10 simulations is too little" in said
    assert "--no-how-far" not in said
    (said,) = warned({"cpu_minutes": enough}, monkeypatch, processors=8.0)[1]
    assert "min of processor time" in said


def test_a_diagnosis_is_repeated_with_the_numbers_that_it_notes(monkeypatch) -> None:
    noted = {
        "simulator": "scene",
        "look": {"among": 55, "trials": 20, "plain": 30},
        "budget": {"campaigns": 480, "trials": 45},
    }
    budget = Budget.repeating(noted, held_out=False)
    assert (budget.campaigns, budget.held_out, budget.simulator) == (450, False, "scene")
    schedule = Clock(budget, monkeypatch).schedule
    assert schedule.look == (55, 20, 30)
    assert schedule.campaign_trials(50) == 45


def test_a_number_of_campaigns_or_trials_is_kept(monkeypatch) -> None:
    def trials(**options: int) -> int:
        return Clock(Budget(**options), monkeypatch).schedule.campaign_trials(55)

    assert trials(campaigns=150) == 55
    assert trials(campaigns=150, trials=48) == trials(simulations=10**7, trials=48) == 48
    assert trials(simulations=10, trials=90) == 55


@pytest.mark.parametrize(
    "budget", [Budget(minutes=5.0), Budget(simulations=40_000), Budget(campaigns=400)]
)
def test_progress_rises_to_all_and_what_is_left_falls(monkeypatch, budget) -> None:
    clock = Clock(budget, monkeypatch)
    shares, left = [], []
    while count := clock.schedule.next_campaigns(clock.done, TRIALS):
        clock.simulate(count * TRIALS)
        clock.done += count
        share, seconds = clock.schedule.progress(clock.done, TRIALS)
        shares.append(share)
        left.append(seconds)
    assert (np.diff(shares) > 0).all()
    assert 0 < shares[0] < 0.6
    assert 0.75 < shares[-1] <= 1
    assert (np.diff(left) < 0).all()
    # What is left at the end is judging, and what time there is beside it.
    assert left[-1] >= clock.schedule.judging_s - 1e-9


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"minutes": 0.0}, "budget_minutes is 0.0; give a finite number of minutes above 0"),
        ({"minutes": float("nan")}, "budget_minutes is nan"),
        ({"cpu_minutes": 0.0}, "budget_cpu_minutes is 0.0; give a finite number of minutes above"),
        ({"simulations": 0}, "simulations is 0; give at least 1"),
        ({"campaigns": 149}, "campaigns is 149; give at least 150"),
        ({"trials": 39}, "campaign_trials is 39; give at least 40"),
        ({"trials": 40.5}, "campaign_trials is 40.5; give at least 40"),
        ({"look": (40, 0, 24)}, "give three numbers of 1 or more"),
    ],
)
def test_a_budget_that_cannot_be_is_refused(options, message) -> None:
    with pytest.raises(DiagnosisError, match=message):
        Budget(**options)


@pytest.mark.parametrize("threads", [0, -3])
def test_no_threads_are_refused(threads) -> None:
    with pytest.raises(DiagnosisError, match=f"threads is {threads}; give at least 1"):
        Execution(threads=threads)


def test_a_seed_below_zero_is_refused() -> None:
    with pytest.raises(DiagnosisError, match="seed is -1; give 0 or more"):
        api("nowhere", "nothing", seed=-1)
