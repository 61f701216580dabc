"""A campaign is no reference of itself."""

from __future__ import annotations

from dataclasses import replace

import pytest

from planar.planar_simulator import PlanarSimulator
from planted import observe, shaken_campaign
from vsr2.diagnosis.pipeline import _is_copy
from vsr2.ensemble.observed.observations import observe_campaign


@pytest.fixture(scope="module")
def measured():
    campaign = shaken_campaign(10, 5, duration=2.5, pga_g=(0.55, 1.15), session_size=10)
    return observe(campaign, PlanarSimulator(campaign, seed=99), nuisance=11, tier="M")


def changed(campaign, tilt, **more):
    trials = tuple(replace(one, peak_tilt=tilt(one.peak_tilt)) for one in campaign.trials)
    return replace(campaign, trials=trials, **more)


def is_copy(one, other, tier):
    return _is_copy(observe_campaign(one, tier), observe_campaign(other, tier))


@pytest.mark.parametrize("tier", ["B", "M"])
def test_a_copy_of_another_name_is_recognised_by_its_tilts(measured, tier) -> None:
    assert is_copy(measured, replace(measured, name="other"), tier)
    assert not is_copy(measured, changed(measured, lambda tilt: 1.01 * tilt), tier)


def test_outcomes_that_agree_by_chance_make_no_copy(measured) -> None:
    bare = changed(measured, lambda tilt: None)
    assert is_copy(bare, bare, "B")
    assert not is_copy(bare, replace(bare, name="other"), "B")
    assert not is_copy(measured, replace(bare, name="other"), "B")


def test_other_outcomes_are_of_another_campaign(measured) -> None:
    first, *rest = measured.trials
    other = replace(measured, trials=(replace(first, overturned=not first.overturned), *rest))
    assert not is_copy(measured, other, "B")
