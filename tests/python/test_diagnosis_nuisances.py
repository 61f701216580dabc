"""Nuisances are a list of effects with priors, which a caller may change and extend."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from planted import shaken_campaign
from vsr2.config import study_from_mapping
from vsr2.diagnosis import (
    DEFAULT_NUISANCES,
    DrawnByEffect,
    Hypotheses,
    LogNormal,
    Normal,
    Nuisance,
    Scope,
    with_deviations,
)
from vsr2.diagnosis.simulated.scene_simulator import SceneSimulator
from vsr2.diagnosis.simulated.simulator import Request
from vsr2.effects import Effect, Parameter, library
from vsr2.errors import DiagnosisError

BOX = {
    "name": "box",
    "engine": {"mode": "fast"},
    "rock": {"shape": "box", "size": [0.4, 0.55, 0.95], "density": 2700.0},
    "motion": {"mode": "all_recordings", "folder": "."},
    "outcome": {"tail": 3.0},
}


class Louder(Effect):
    """A user's effect: the table moves by another factor."""

    name = "louder"
    meaning = "The table moves by 1 + change times what was recorded"
    parameters = (Parameter("change", "1", 0.0, -0.5, 0.5, "uniform", "relative"),)
    stage = "actuation"

    def change(self, setup, values):
        motion = setup.motion
        return replace(setup, motion=motion.scaled(1.0 + values["change"], name=motion.name))


def test_priors_give_values_at_normal_draws() -> None:
    assert Normal(0.02, least=-0.5).value(-2.0) == -0.04
    assert Normal(1.0, least=-0.5).value(-2.0) == -0.5
    assert LogNormal(0.1).value(2.0) == pytest.approx(math.exp(0.2))
    assert DrawnByEffect(2.0, math.sqrt(3)).value(-5.0) == pytest.approx(2 * math.sqrt(3))
    offset = Nuisance("com_offset", "distance", Normal(0.001), direction="azimuth")
    assert offset.values(2.0) == {"distance": 0.002, "azimuth": 0.0}
    assert offset.values(-2.0) == {"distance": 0.002, "azimuth": 180.0}


def test_deviations_are_changed_by_name() -> None:
    changed = with_deviations({"friction": 0.05, "yaw": 0.0})
    by_name = {one.name: one for one in changed}
    assert by_name["friction"].prior == LogNormal(0.05)
    assert by_name["yaw"].prior == DrawnByEffect(0.0, math.sqrt(3))
    assert [one.name for one in changed] == [one.name for one in DEFAULT_NUISANCES]
    assert with_deviations({}) == DEFAULT_NUISANCES


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: with_deviations({"frction": 0.1}), "no 'frction'; names are slenderness, inertia"),
        (lambda: with_deviations({"friction": -1.0}), "sd is -1.0; give a number of 0 or more"),
        (lambda: with_deviations({"friction": math.nan}), "sd is nan"),
        (lambda: Nuisance("frction", "factor", Normal(1.0)), "no effect 'frction'"),
        (lambda: Nuisance("friction", "size", Normal(1.0)), "no parameter 'size'; it has factor"),
    ],
)
def test_what_is_no_nuisance_is_refused(make, message) -> None:
    with pytest.raises(DiagnosisError, match=message):
        make()


@pytest.fixture(scope="module")
def shaken():
    return shaken_campaign(4, 3, duration=2.0, pga=(0.5, 0.7))


def simulator(shaken, tmp_path, nuisances):
    study = study_from_mapping(BOX, base=tmp_path)
    offered = {name: library()[name] for name in ("restitution", "table_gain")}
    return SceneSimulator(
        shaken,
        study,
        hypotheses=Hypotheses(offered, nuisances=nuisances, contact_family=()),
        seed=3,
    )


def test_a_user_s_effect_may_be_a_nuisance(shaken, tmp_path) -> None:
    own = simulator(shaken, tmp_path, [Nuisance(Louder(), "change", Normal(0.1))])
    gain = simulator(shaken, tmp_path, [Nuisance("table_gain", "change", Normal(0.1))])
    assert own.nuisance_names == ("louder",)
    assert own.identity != gain.identity
    requests = [Request(i, (), draw, 0) for i in range(3) for draw in (0, 1, 2)]
    found = own.run(requests).peak_tilt.reshape(3, 3)
    assert (found[:, 1] != found[:, 0]).all()
    assert (found[:, 1] != found[:, 2]).all()
    # The same motion under another name.
    np.testing.assert_array_equal(found.ravel(), gain.run(requests).peak_tilt)


def test_a_nuisance_of_trials_is_fresh_in_each(shaken, tmp_path) -> None:
    one = Nuisance(Louder(), "change", Normal(0.1), scope=Scope.TRIAL)
    own = simulator(shaken, tmp_path, [one])
    assert own.nuisance_names == ()
    made = own._built((), 0, 1, {0, 1})
    acting = [made[i].effects[0].values for i in (0, 1)]
    assert acting[0] != acting[1]
    assert made[0].effects[0].effect.name == "louder"
    assert own._built((), 0, 0, {0})[0].effects == ()


def test_an_impact_s_energy_is_relative_to_the_cause(shaken, tmp_path) -> None:
    nuisance = Nuisance("restitution", "energy_ratio", LogNormal(0.1), relative=True)
    own = simulator(shaken, tmp_path, [nuisance])
    factor = nuisance.prior.value(float(own.nuisance_draw(2)[0]))
    assert factor != 1.0

    def ratio(effects):
        return own._built(effects, 2, 0, {0})[0].scene.mechanisms.impact_energy_ratio

    assert ratio(()) == pytest.approx(factor)
    assert ratio((("restitution", (0.8,)),)) == pytest.approx(0.8 * factor)
