"""The planar rocking block against closed forms, and its effects at their null."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis_planar import not_wrong, scores
from planar.planar_block import (
    DEFAULTS,
    GRAVITY,
    STEP,
    PlanarBlocks,
    simulate_planar,
)
from planar.planar_library import PLANAR_LIBRARY
from planar.planar_simulator import PlanarSimulator
from planted import shaken_campaign
from vsr2.ensemble.observed.features import TILT_FEATURES
from vsr2.ensemble.simulated.simulator import Request

B, H = 0.2, 0.5
COUNTED = (
    *("lead", "answer", "both", "p_top", "p_none", "p_unknown", "covered", "set_size"),
    *("outcome_signal", "error", "inside", "located", "where_gain"),
)
"""Columns of a campaign beside those that a test sets."""
ALPHA = np.arctan2(B, H)


def blocks(count, **changes):
    values = {name: np.full(count, value) for name, value in DEFAULTS.items()}
    values |= {"half_width": np.full(count, B), "half_height": np.full(count, H)}
    values |= {name: np.broadcast_to(v, count).astype(float) for name, v in changes.items()}
    return PlanarBlocks(motion=np.arange(count), **values)


def constant(levels, seconds=3.0):
    return np.tile(np.asarray(levels), (round(seconds / STEP), 1))


def test_lifts_off_where_the_static_moment_turns() -> None:
    onset = GRAVITY * B / H
    over, peak, _ = simulate_planar(blocks(2), constant([0.999 * onset, 1.02 * onset]))
    assert peak[0] == 0
    assert over.tolist() == [0, 1]


def test_a_slope_and_a_gain_act_as_in_the_equation_of_motion() -> None:
    onset = GRAVITY * B / H
    offset = np.array([0.0, 0.05 * onset])
    gain = np.array([1.06, 1.0])
    levels = constant([0.96 * onset, 0.96 * onset])
    assert simulate_planar(blocks(2, offset=offset, gain=gain), levels)[1].min() > 0
    assert simulate_planar(blocks(2), levels)[1].max() == 0


@pytest.mark.parametrize("ratio", [0.7, 1.0])
def test_an_impact_keeps_housners_energy(ratio: float) -> None:
    pulse = np.zeros((round(6.0 / STEP), 1))
    pulse[: round(0.12 / STEP)] = 9.0
    _, _, features = simulate_planar(blocks(1, energy_ratio=ratio), pulse, series=True)
    assert features is not None
    names = [feature.name for feature in TILT_FEATURES]
    columns = [names.index(f"{word}_excursion") for word in ("first", "second")]
    first, second = np.exp(features[0, columns])
    height = np.cos(ALPHA - np.array([first, second])) - np.cos(ALPHA)
    housner = (1 - 1.5 * np.sin(ALPHA) ** 2) ** 2
    # The impact is placed within a step of 5 ms by linear interpolation.
    assert height[1] / height[0] == pytest.approx(ratio * housner, rel=0.02)


def test_an_edge_that_rolls_lifts_off_sooner_and_a_cap_hides_peaks() -> None:
    onset = GRAVITY * B / H
    levels = constant([0.97 * onset])
    assert simulate_planar(blocks(1, radius=0.01), levels)[1][0] > 0
    strong = constant([2 * onset])
    assert simulate_planar(blocks(1, cap=0.95 * onset), strong)[1][0] == 0


@pytest.fixture(scope="module")
def simulator() -> PlanarSimulator:
    return PlanarSimulator(shaken_campaign(4, 6, duration=3.0, pga_g=(0.5, 1.2)), seed=3)


@pytest.mark.parametrize("name", sorted(PLANAR_LIBRARY))
def test_an_effect_is_alive_and_absent_at_its_null(name: str, simulator: PlanarSimulator) -> None:
    effect = PLANAR_LIBRARY[name]
    plain = simulator.run([Request(i, (), 2, 1) for i in range(24)])
    nulls = tuple(p.null for p in effect.parameters)
    if all(np.isfinite(nulls)):
        same = simulator.run([Request(i, ((name, nulls),), 2, 1) for i in range(24)])
        np.testing.assert_array_equal(plain.peak_tilt, same.peak_tilt)
    moved = 0.0
    for u in (0.02, 0.98):
        values = tuple(p.ppf(u) for p in effect.parameters)
        found = simulator.run([Request(i, ((name, values),), 2, 1) for i in range(24)])
        moved = max(moved, np.abs(found.peak_tilt - plain.peak_tilt).max())
        moved = max(moved, np.abs(found.overturned - plain.overturned).max())
    assert moved > 0.01


def test_a_response_does_not_depend_on_its_neighbours(simulator: PlanarSimulator) -> None:
    requests = [Request(i, (("table_gain", (0.05,)),), n, 1) for n in (1, 5) for i in range(24)]
    together = simulator.run(requests)
    order = np.random.default_rng(0).permutation(len(requests))
    mixed = simulator.run([requests[i] for i in order])
    np.testing.assert_array_equal(together.peak_tilt[order], mixed.peak_tilt)
    alone = simulator.run([requests[30]])
    assert alone.peak_tilt[0] == together.peak_tilt[30]


def test_a_pair_of_which_one_cause_acts_is_a_wrong_name() -> None:
    """As the scorer of blind packs counts it."""
    assert not_wrong("effect", {"wear"}, {"wear"})
    assert not_wrong("class", {"wear", "catch"}, {"wear"})
    assert not not_wrong("effect", {"catch"}, {"wear"})
    assert not not_wrong("pair", {"wear", "catch"}, {"wear"})
    assert not_wrong("pair", {"wear", "catch"}, {"wear", "catch"})
    assert not not_wrong("unresolved", set(), {"wear"})


def test_a_wrong_pair_counts_among_wrong_names() -> None:
    rows = [
        dict.fromkeys(COUNTED, 0) | {"kind": "single", "limits": 3.0, "p_true": 0.5}
        | {"verdict": verdict, "right": int(not_wrong(verdict, named, {"wear"}))}
        for verdict, named in (("effect", {"wear"}), ("pair", {"wear", "catch"}))
    ]  # fmt: skip
    found = scores(rows)
    assert (found["named_strong"], found["named_wrongly"]) == (0.5, 0.5)
