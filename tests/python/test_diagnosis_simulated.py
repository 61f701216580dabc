"""Parts of the diagnosis that simulate: the cache, draws, the library."""

from __future__ import annotations

import base64
import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest

from planar.library import PLANAR_LIBRARY
from planted import shaken_campaign
from vsr2.diagnosis.budget import SCHEDULE, Budget, Schedule
from vsr2.diagnosis.how_far.resimulation import RESIMULATION_RUNS
from vsr2.diagnosis.how_far.screened_out import SCREENED_OUT_RUNS
from vsr2.diagnosis.observed.observations import observe_campaign
from vsr2.diagnosis.pipeline import _settled
from vsr2.diagnosis.simulated.cache import SimulationCache, own_code
from vsr2.diagnosis.simulated.design import screen
from vsr2.diagnosis.simulated.library import basis, free_parameters, null_quantile, values_at
from vsr2.diagnosis.simulated.simulator import Request, Responses, nuisance_normal
from vsr2.effects import library as full_library
from vsr2.errors import ResultError

TWO = {name: PLANAR_LIBRARY[name] for name in ("table_gain", "restitution")}


class Falling:
    """Trial i overturns in the first so many of its simulations."""

    library = TWO
    nuisance_names = ("z",)
    identity = "falling"

    def __init__(self, times):
        self.left = list(times)

    def nuisance_draw(self, index):
        return nuisance_normal(0, 1, index)

    def run(self, requests):
        overturned = np.zeros(len(requests))
        for k, request in enumerate(requests):
            overturned[k] = self.left[request.trial] > 0
            self.left[request.trial] -= 1
        return Responses(overturned, 1.5 * overturned, None)


class Counting:
    """A simulator that counts, and stops on request."""

    library = TWO
    nuisance_names = ("z",)
    identity = "counting"

    def __init__(self, stop_after=None):
        self.runs = 0
        self.stop_after = stop_after

    def nuisance_draw(self, index):
        return nuisance_normal(0, 1, index)

    def run(self, requests):
        self.runs += len(requests)
        if self.stop_after is not None and self.runs > self.stop_after:
            raise KeyboardInterrupt
        value = np.array([hash((r.trial, r.nuisance, r.effects)) % 97 for r in requests]) / 97
        return Responses((value > 0.5).astype(float), value, None)


def test_an_interrupted_cache_goes_on_where_it_stopped(tmp_path) -> None:
    requests = [Request(i % 10, (), i // 10, 1) for i in range(40)]
    reference = SimulationCache(Counting()).run(requests)
    with (
        pytest.raises(KeyboardInterrupt),
        SimulationCache(Counting(25), tmp_path / "b", chunk=10) as cache,
    ):
        cache.run(requests)
    simulator = Counting()
    with SimulationCache(simulator, tmp_path / "b", chunk=10) as cache:
        found = cache.run([*requests, requests[3]])
        assert (cache.simulated, cache.reused, cache.size) == (20, 20, 40)
    assert simulator.runs == 20
    np.testing.assert_array_equal(found.peak_tilt[:40], reference.peak_tilt)
    assert found.peak_tilt[40] == reference.peak_tilt[3]


def test_a_cache_keeps_effects_nuisances_replicates_and_scenes_apart(tmp_path) -> None:
    keys = [
        Request(0, (), 0, 0),
        Request(0, (), 1, 0),
        Request(0, (), 0, 1),
        Request(0, (("table_gain", (0.1,)),), 0, 0),
        Request(1, (), 0, 0),
    ]
    with SimulationCache(Counting(), tmp_path / "b") as cache:
        cache.run(keys)
        assert cache.simulated == 5
    other = Counting()
    other.identity = "another scene"
    with SimulationCache(other, tmp_path / "b") as cache:
        cache.run(keys)
        assert cache.simulated == 5


TYPED_IN = """
class Gain(library_s):
    def change(self, setup, values):
        return setup, {slope} * values["change"]
"""


def test_a_cache_keeps_the_versions_of_an_effect_of_one_s_own_apart(tmp_path) -> None:
    library_s = type(full_library()["table_gain"])

    class Gain(library_s):
        """An effect of the user's, under the name of one of the library's."""

        def change(self, setup, values):
            return setup

    kinds = [library_s, Gain]
    # Of a class without a word of its own the base tells.
    kinds.append(type("Gain", (Gain,), {}))
    for slope in (1.0, 2.0):
        # As at a prompt, where no source is kept.
        names = {"library_s": library_s, "__name__": "prompt"}
        exec(TYPED_IN.format(slope=slope), names)
        kinds.append(names["Gain"])
    assert own_code(kinds[0]) == ""
    with_it, without = Request(0, (("table_gain", (0.1,)),), 0, 0), Request(0, (), 0, 0)
    simulated = []
    for kind in (*kinds, *kinds):
        simulator = Counting()
        simulator.library = TWO | {"table_gain": kind()}
        with SimulationCache(simulator, tmp_path / "b") as cache:
            cache.run([with_it, without])
            simulated.append(cache.simulated)
    # What no effect acts on is simulated once for all of them.
    assert simulated == [2, 1, 0, 1, 1, 0, 0, 0, 0, 0]


def test_only_effects_in_the_race_get_twice_the_draws() -> None:
    schedule = Schedule(Budget(simulations=100_000), SimulationCache(Counting()), 50, TWO)
    stated = {"table_gain": 0.9, "restitution": 0.001}
    first = dict.fromkeys(TWO, 24)
    more = schedule.next_draws(first, stated)
    assert more == {"table_gain": 48, "restitution": 24}
    # Who fell behind once stays behind.
    assert schedule.next_draws(more, dict.fromkeys(TWO, 0.5)) == {
        "table_gain": 96,
        "restitution": 24,
    }
    assert (
        schedule.next_draws({"table_gain": SCHEDULE.most_draws, "restitution": 24}, stated) is None
    )


def test_what_screened_out_trials_cost_is_kept_back() -> None:
    cache = SimulationCache(Counting())
    schedule = Schedule(Budget(simulations=10_000), cache, 50, TWO)
    schedule.fit(20)
    rest = 10_000 - SCREENED_OUT_RUNS * 30 - RESIMULATION_RUNS * 20
    assert schedule.affords(rest, cache)
    assert not schedule.limited
    assert not schedule.affords(rest + 1, cache)
    assert schedule.limited
    cache.run([Request(0, (), i, 1) for i in range(10)])
    assert not schedule.affords(rest - 9, cache)
    assert schedule.affords(rest - 10, cache)


def test_an_answer_stands_on_three_rounds_with_one_class_and_one_test() -> None:
    def one(group: list[str], p: float) -> SimpleNamespace:
        return SimpleNamespace(leading=group, inference=SimpleNamespace(gap_p=0.5, direction_p=p))

    same = [one(["catch", "table_gain"], 0.01), one(["catch"], 0.02), one(["catch"], 0.001)]
    assert _settled(same)
    assert not _settled(same[1:])
    assert _settled([one(["wear"], 0.5), *same]), "of the last three"
    assert not _settled([*same[:2], one(["wear"], 0.01)])
    assert not _settled([*same[:2], one(["catch"], 0.03)]), "a gap, and then none"


def test_a_cache_of_an_older_form_or_with_damaged_records_is_refused(tmp_path) -> None:
    (tmp_path / "b.sqlite").write_bytes(b"SQLite format 3")
    with pytest.raises(ResultError, match=r"b\.sqlite: is a simulation cache of an older VSR2; r"):
        SimulationCache(Counting(), tmp_path / "b.jsonl")
    requests = [Request(0, (), 0, 1), Request(1, (), 0, 1)]
    path = tmp_path / "c.jsonl"
    with SimulationCache(Counting(), path) as cache:
        cache.run(requests)
    header, first, second = path.read_bytes().splitlines(keepends=True)
    longer = json.loads(second)
    longer["response"] = base64.b64encode(bytes(24)).decode()
    path.write_bytes(header + first + json.dumps(longer).encode() + b"\n")
    with (
        SimulationCache(Counting(), path) as cache,
        pytest.raises(ResultError, match=r"different lengths.*remove it"),
    ):
        cache.run(requests)


@pytest.mark.parametrize("name", sorted(full_library()))
def test_the_basis_vanishes_where_an_effect_is_absent(name: str) -> None:
    entry = full_library()[name]
    free = free_parameters(entry)
    nulls = [null_quantile(p) for p in free]
    primary = [null for p, null in zip(free, nulls, strict=True) if not p.secondary]
    if any(null is None or not 1e-6 < null < 1 - 1e-6 for null in primary):
        # Presence itself is one of the functions of an effect with one side.
        assert basis(entry, np.full((1, len(free)), 0.5)).shape[1] >= len(free)
        return
    u = np.array([[0.3 if null is None else null for null in nulls]])
    np.testing.assert_allclose(basis(entry, u), 0.0, atol=1e-9)
    assert len(values_at(entry, u[0])) == len(entry.parameters)


def test_trials_near_the_boundary_are_kept_first() -> None:
    """Of 12 simulations, 8 without effect: certain are those with none or all overturned."""
    campaign = shaken_campaign(10, 4)
    rows = tuple(dataclasses.replace(trial, overturned=False) for trial in campaign.trials)
    seen = observe_campaign(dataclasses.replace(campaign, trials=rows), "B")
    times = np.zeros(40, dtype=int)
    times[:6] = 12, 1, 11, 5, 7, 2

    def kept(most):
        with SimulationCache(Falling(times)) as cache:
            return screen(cache, seen, runs=16, most=most)

    every = kept(40)
    assert set(every.kept) - set(every.guard) == {1, 2, 3, 4, 5}
    assert every.guard.size == 4, "a tenth of 35"
    np.testing.assert_array_equal(every.alike, np.isin(times, (0, 12)))
    np.testing.assert_array_equal(every.uncertain_at_first, [1, 2, 3, 4, 5])
    np.testing.assert_allclose(every.probability, (times + 0.5) / 13)
    few = kept(4)
    assert few.guard.size == 1
    assert set(few.kept) - set(few.guard) == {3, 4, 5}, "nearest to one in two"
    assert few.left_out == 2
