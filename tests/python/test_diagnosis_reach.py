"""How far an effect's range reaches, and where its draws lie then."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from planar.library import PLANAR_LIBRARY
from planar.simulator import PlanarSimulator
from planted import observe, shaken_campaign
from vsr2.diagnosis.observed.observations import observe_campaign
from vsr2.diagnosis.simulated.cache import SimulationCache
from vsr2.diagnosis.simulated.design import screen
from vsr2.diagnosis.simulated.library import (
    Reaching,
    at_share,
    basis,
    free_parameters,
    positions,
    reaches,
    values_at,
)
from vsr2.diagnosis.simulated.reach import REACH, reaching
from vsr2.diagnosis.simulated.simulator import Responses, nuisance_normal
from vsr2.effects import library as full_library

SCATTER = 0.05
"""Of the logarithm of the largest tilt, of what nuisances leave."""


class Straight:
    """Largest tilts whose logarithm moves in proportion to an effect, and with a nuisance."""

    identity = "straight"
    variants = ()
    nuisance_names = ("a",)

    def __init__(self, slopes) -> None:
        self.slopes = slopes
        self.library = {name: full_library()[name] for name in slopes}

    def nuisance_draw(self, index):
        return nuisance_normal(5, 1, index)

    def run(self, requests):
        tilt = []
        for r in requests:
            rng = np.random.default_rng([r.trial, r.nuisance])
            log = -3.0 + 0.3 * self.nuisance_draw(r.nuisance)[0] + SCATTER * rng.standard_normal()
            log += sum(self.slopes[name](values) for name, values in r.effects)
            tilt.append(np.exp(log))
        return Responses(np.zeros(len(requests)), np.array(tilt), None)


def reach_of(slopes) -> dict[str, tuple[float, float]]:
    kept = np.arange(40)
    with SimulationCache(Straight(slopes)) as cache:
        return reaches(reaching(cache, SimpleNamespace(kept=kept, uncertain_at_first=kept[3:])))


def test_the_reach_is_where_an_effect_moves_trials_by_so_many_standard_deviations() -> None:
    # At a share s of 0.15 the change is 40 s standard deviations.
    found = reach_of({"wear": lambda values: 40 * SCATTER * values[0] / 0.15})
    assert found["wear"][1] == pytest.approx(REACH.overwhelming / 40, rel=0.15)


def test_each_side_of_the_null_has_a_reach_of_its_own() -> None:
    def squared(values):
        share = values[0] / 0.15
        return SCATTER * (25 * share if share > 0 else 150 * share)

    below, above = reach_of({"table_gain": squared})["table_gain"]
    assert below == pytest.approx(REACH.overwhelming / 150, rel=0.2)
    assert above == pytest.approx(REACH.overwhelming / 25, rel=0.2)


def test_what_is_weak_everywhere_or_leaps_keeps_its_range() -> None:
    found = reach_of(
        {
            "wear": lambda values: SCATTER * values[0] / 0.15,
            "base_asperity": lambda values: 30 * SCATTER if values[0] else 0.0,
            "restitution": lambda values: 30 * SCATTER,
        }
    )
    assert found == dict.fromkeys(found, (1.0, 1.0))


def test_overturning_counts_as_a_tilt_of_one_radian() -> None:
    class Overturning(Straight):
        def run(self, requests):
            found = super().run(requests)
            strong = [bool(r.effects) and r.effects[0][1][0] > 0.01 for r in requests]
            return Responses(np.array(strong, dtype=float), found.peak_tilt, None)

    kept = np.arange(40)
    with SimulationCache(Overturning({"wear": lambda values: 0.0})) as cache:
        found = reaches(reaching(cache, SimpleNamespace(kept=kept, uncertain_at_first=kept[:0])))
    # It sets in between a sixteenth of the range, 0.0094, and a quarter of it.
    assert 1 / 16 < found["wear"][1] < 1 / 4


def test_all_tiers_find_the_same_reach_and_so_share_their_simulations() -> None:
    campaign = shaken_campaign(8, 6, duration=3.0)
    names = ("table_gain", "slenderness", "table_pitch")
    library = {name: PLANAR_LIBRARY[name] for name in names}
    simulator = PlanarSimulator(campaign, library=library, seed=1)
    seen = observe_campaign(observe(campaign, simulator, nuisance=3, tier="M"), "M")
    found, kept = [], []
    for one in (seen, replace(seen, tier="B")):
        with SimulationCache(simulator) as cache:
            screening = screen(cache, one, runs=20, most=48)
            found.append(reaches(reaching(cache, screening)))
            kept.append(screening.kept.size)
    assert kept[0] > kept[1]
    assert found[0] == found[1]
    assert min(found[0]["table_pitch"]) < 1


@pytest.mark.parametrize("name", sorted(full_library()))
def test_draws_keep_their_order_and_reach_both_ends(name: str) -> None:
    entry = Reaching(full_library()[name], 0.02, 0.1)
    free = free_parameters(entry)
    u = np.linspace(0, 1, 4001)
    for j, parameter in enumerate(free):
        given = np.full((u.size, len(free)), 0.4)
        given[:, j] = u
        found = positions(entry, given)[:, j]
        assert np.diff(found).min() >= 0
        # A leap is none of the prior's: the coordinate is continuous.
        assert np.diff(found).max() < 0.01
        assert found[[0, -1]] == pytest.approx([0, 1], abs=1e-9), parameter.name


def test_within_reach_lie_more_draws_than_by_the_square_alone() -> None:
    entry = full_library()["table_pitch"]
    u = np.column_stack([np.linspace(0, 1, 1001), np.full(1001, 0.5)])
    own = positions(Reaching(entry, 0.02, 0.02), u)[:, 0] <= 0.02
    plain = positions(entry, u)[:, 0] <= 0.02
    assert plain.mean() == pytest.approx(np.sqrt(0.02), abs=2e-3)
    assert own.mean() == pytest.approx(1 / np.sqrt(1 - np.log(0.02)), abs=2e-3)


def test_a_range_of_which_a_quarter_keeps_is_used_as_it_is() -> None:
    u = np.linspace(0.01, 0.99, 99)[:, None]
    for name in ("wear", "table_gain"):
        entry = full_library()[name]
        np.testing.assert_allclose(
            positions(Reaching(entry, 0.26, 0.26), u), positions(entry, u), atol=1e-9
        )
        assert np.abs(positions(Reaching(entry, 0.24, 0.24), u) - positions(entry, u)).max() > 0.01


def test_distances_from_a_null_outside_the_prior_are_squared_where_that_keeps_more() -> None:
    entry = full_library()["table_saturation"]
    u = np.column_stack([np.linspace(0.0, 1.0, 101)] * 2)
    np.testing.assert_allclose(positions(Reaching(entry, 0.6, 0.6), u), u, atol=1e-9)
    np.testing.assert_allclose(positions(Reaching(entry, 0.4, 0.4), u), 1 - (1 - u) ** 2, atol=1e-9)


@pytest.mark.parametrize("name", ["table_gain", "table_pitch", "table_saturation", "wear"])
def test_the_basis_is_continuous_and_has_columns_for_what_lies_beyond(name: str) -> None:
    effect = full_library()[name]
    entry = Reaching(effect, 0.1, 0.1)
    free = free_parameters(entry)

    def columns(count):
        u = np.full((count, len(free)), 0.37)
        u[:, [not p.secondary for p in free]] = np.linspace(0.0, 1.0, count)[:, None]
        return basis(entry, u)

    coarse, fine = (np.abs(np.diff(columns(n), axis=0)).max() for n in (1001, 4001))
    # A leap would not shrink with the grid.
    assert fine < 0.3 * coarse
    near = np.full((1, len(free)), 0.5)
    assert basis(effect, near).shape[1] < basis(entry, near).shape[1]


def test_at_a_share_all_primary_parameters_lie_there() -> None:
    saturation = full_library()["table_saturation"]
    half = np.full(2, 0.5)
    velocity, acceleration = at_share(saturation, 0.25, above=True, secondary=half)
    # Three quarters up logarithmic ranges of 0.15 to 1.5 and of 2 to 20.
    assert velocity == pytest.approx(0.15 * 10**0.75)
    assert acceleration == pytest.approx(2 * 10**0.75)
    gain = PLANAR_LIBRARY["table_gain"]
    up, down = (at_share(gain, 0.1, above=a, secondary=half[:1])[0] for a in (True, False))
    assert up == pytest.approx(-down)
    pitch = full_library()["table_pitch"]
    values = at_share(pitch, 0.25, above=True, secondary=np.array([0.5, 0.2]))
    assert values[:2] == pytest.approx((0.005, 8.0))
    assert values[2:] == values_at(pitch, np.array([0.5, 0.2]))[2:]
