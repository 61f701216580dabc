"""Nuisances of several scopes: what they multiply, and which kept simulations are theirs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis_samples import made_trials
from planted import shaken_campaign
from vsr2.config import load_study, study_from_mapping
from vsr2.diagnosis.iteration import Asked, _digest
from vsr2.effects import library
from vsr2.ensemble import (
    DEFAULT_NUISANCES,
    Hypotheses,
    LogNormal,
    Normal,
    Nuisance,
    Scope,
    Uniform,
)
from vsr2.ensemble.simulated.contact_family import CONTACT_FAMILY
from vsr2.ensemble.simulated.nuisances import with_stated
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator

CONFIGS = Path(__file__).parents[2] / "configs"
SLOW = 0.8
BOX = {
    "name": "box",
    "engine": {"mode": "fast"},
    "rock": {"shape": "box", "size": [0.4, 0.55, 0.95], "density": 2700.0},
    "motion": {"mode": "all_recordings", "folder": "."},
    "effects": {"restitution": {"energy_ratio": SLOW}},
}
NARROW = (Scope.MOTION, Scope.TRIAL)
IMPACT = Nuisance("restitution", "energy_ratio", LogNormal(0.1), relative=True)
GAIN = Nuisance("table_gain", "change", Normal(0.0, mean=0.1))


@pytest.fixture(scope="module")
def shaken():
    return shaken_campaign(4, 3, duration=2.0, pga_g=(0.5, 0.7))


def simulator(shaken, *nuisances: Nuisance, study=None) -> SceneSimulator:
    offered = {name: library()[name] for name in ("restitution", "table_gain", "com_offset")}
    asked = Hypotheses(offered, nuisances=nuisances, contact_family=())
    return SceneSimulator(
        shaken, study or study_from_mapping(BOX, base=CONFIGS), hypotheses=asked, seed=3
    )


def ratios(own: SceneSimulator, effects=(), nuisance: int = 1) -> np.ndarray:
    made = made_trials(own, effects, nuisance, 1, range(len(own._trials)))
    return np.array([made[i].scene.mechanisms.impact_energy_ratio for i in sorted(made)])


@pytest.mark.parametrize("scope", NARROW)
def test_what_is_relative_multiplies_the_scene_s_value_in_each_trial(scope, shaken) -> None:
    """The draws of the same nuisance that is not relative are the factors."""
    own = simulator(shaken, replace(IMPACT, scope=scope))
    plain = simulator(shaken, replace(IMPACT, scope=scope, relative=False))
    factors = ratios(plain)
    np.testing.assert_allclose(ratios(own), SLOW * factors)
    motions = {trial.motion for trial in shaken.trials}
    assert len(set(factors)) == {Scope.MOTION: len(motions), Scope.TRIAL: len(shaken)}[scope]


@pytest.mark.parametrize("scope", NARROW)
def test_what_is_relative_multiplies_the_cause_in_each_trial(scope, shaken) -> None:
    factors = ratios(simulator(shaken, replace(IMPACT, scope=scope, relative=False)))
    own = simulator(shaken, replace(IMPACT, scope=scope))
    np.testing.assert_allclose(ratios(own, (("restitution", (0.7,)),)), 0.7 * factors)
    # Without a draw the cause is as it was asked for.
    made = made_trials(own, (("restitution", (0.7,)),), 0, 0, [0])
    assert made[0].scene.mechanisms.impact_energy_ratio == pytest.approx(0.7)


def test_a_cause_with_values_of_each_trial_is_multiplied(shaken) -> None:
    """Where a margin is sought, the table's gain differs between requests."""
    one = Nuisance("table_gain", "change", LogNormal(0.3), Scope.TRIAL, relative=True)
    own, still = simulator(shaken, one), simulator(shaken)
    moved = made_trials(own, (("table_gain", (0.2,)),), 1, 1, range(3))
    plain = made_trials(still, (), 1, 1, range(3))
    factors = []
    for i in range(3):
        peak, before = (np.ptp(m[i].motion.displacement) for m in (moved, plain))
        factors.append((peak / before - 1) / 0.2)
    expected = np.log(factors) / 0.3
    assert len(set(np.round(expected, 6))) == 3
    assert (np.abs(expected) < 4).all()
    changes = [dict(moved[i].effects[-1].values)["change"] for i in range(3)]
    np.testing.assert_allclose(changes, 0.2 * np.array(factors))


def test_factors_of_all_scopes_multiply(shaken) -> None:
    together = [replace(IMPACT, scope=scope) for scope in Scope]
    found = ratios(simulator(shaken, *together)) / SLOW
    # What each scope draws does not depend on the others.
    alone = [ratios(simulator(shaken, one)) / SLOW for one in together]
    np.testing.assert_allclose(found, np.prod(alone, axis=0))
    caused = ratios(simulator(shaken, *together), (("restitution", (0.7,)),))
    np.testing.assert_allclose(caused, 0.7 * found)


def test_what_is_relative_multiplies_a_wider_nuisance_of_its_parameter(shaken) -> None:
    wide = replace(IMPACT, prior=Normal(0.0, mean=0.9), relative=False)
    factors = ratios(simulator(shaken, replace(IMPACT, scope=Scope.TRIAL))) / SLOW
    found = ratios(simulator(shaken, wide, replace(IMPACT, scope=Scope.TRIAL)))
    np.testing.assert_allclose(found, 0.9 * factors)


def test_a_relative_secondary_parameter_joins_as_its_nominal_value(shaken) -> None:
    noise = Nuisance("motion_noise", "displacement", Normal(0.0, mean=1e-4), Scope.TRIAL)
    corner = Nuisance(
        "motion_noise", "corner", LogNormal(0.0, median=0.5), Scope.TRIAL, relative=True
    )
    made = made_trials(simulator(shaken, corner, noise), (), 1, 1, [0])
    (acting,) = (one for one in made[0].effects if one.effect.name == "motion_noise")
    assert dict(acting.values)["corner"] == pytest.approx(5.0)


def test_scopes_act_one_on_top_of_the_other(shaken) -> None:
    plain = np.ptp(made_trials(simulator(shaken), (), 1, 1, [0])[0].motion.displacement)
    own = simulator(shaken, *[replace(GAIN, scope=scope) for scope in Scope])
    moved = np.ptp(made_trials(own, (), 1, 1, [0])[0].motion.displacement)
    assert moved == pytest.approx(1.1**3 * plain)


def hashed(one: Nuisance) -> tuple[object, ...]:
    """As nuisances entered identities before any joined or multiplied others in each trial."""
    return one.to_json(), repr(one.prior), ""


SLOPE = (
    Nuisance("base_slope", "angle", Uniform(0.5, 1.0)),
    Nuisance("base_slope", "azimuth", Uniform(10.0, 350.0)),
)


@pytest.mark.parametrize("one", [*DEFAULT_NUISANCES, *CONTACT_FAMILY], ids=lambda one: one.name)
def test_what_neither_joins_nor_multiplies_has_the_identity_that_it_had(one) -> None:
    identity = one.identity
    assert identity[:2] == hashed(one)[:2]
    assert len(identity) == 3


def test_what_changed_its_meaning_has_another_identity(shaken, monkeypatch) -> None:
    study = load_study(CONFIGS / "blind.yaml")

    def identities(*stated: Nuisance) -> tuple[str, str]:
        asked = Hypotheses({}, nuisances=with_stated(stated))
        own = SceneSimulator(shaken, study, hypotheses=asked, seed=3)
        return own.identity, _digest(shaken, study, Asked(hypotheses=asked))

    lists = {"plain": (), "wide": SLOPE, "wider": (IMPACT,)}
    for scope in NARROW:
        lists[f"gain {scope}"] = (replace(GAIN, scope=scope),)
        lists[f"joined {scope}"] = tuple(replace(one, scope=scope) for one in SLOPE)
        lists[f"relative {scope}"] = (replace(IMPACT, scope=scope),)
    now = {name: identities(*stated) for name, stated in lists.items()}
    monkeypatch.setattr(Nuisance, "identity", property(hashed))
    for name, stated in lists.items():
        changed = name.startswith(("joined", "relative"))
        for new, old in zip(now[name], identities(*stated), strict=True):
            assert (new != old) is changed, name
