"""Nuisances are a list of effects with priors, which a caller may change and extend."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from diagnosis_samples import made_trials
from planted import shaken_campaign
from vsr2.campaign import MeasurementNoise
from vsr2.cli.options import priors
from vsr2.config import study_from_mapping
from vsr2.effects import Effect, Parameter, library
from vsr2.ensemble import (
    DEFAULT_NUISANCES,
    DrawnByEffect,
    Hypotheses,
    LogNormal,
    Normal,
    Nuisance,
    Scope,
    with_deviations,
)
from vsr2.ensemble.simulated import nuisances
from vsr2.ensemble.simulated.distributions import LogUniform, Uniform, distribution
from vsr2.ensemble.simulated.nuisance_draws import correlated
from vsr2.ensemble.simulated.nuisances import with_stated
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
from vsr2.ensemble.simulated.simulator import Request
from vsr2.errors import ConfigError, DiagnosisError
from vsr2.motion import Record

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
    return shaken_campaign(4, 3, duration=2.0, pga_g=(0.5, 0.7))


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
    made = made_trials(own, (), 0, 1, {0, 1})
    acting = [made[i].effects[0].values for i in (0, 1)]
    assert acting[0] != acting[1]
    assert made[0].effects[0].effect.name == "louder"
    assert made_trials(own, (), 0, 0, {0})[0].effects == ()


def test_an_impact_s_energy_is_relative_to_the_cause(shaken, tmp_path) -> None:
    nuisance = Nuisance("restitution", "energy_ratio", LogNormal(0.1), relative=True)
    own = simulator(shaken, tmp_path, [nuisance])
    factor = nuisance.prior.value(float(own.nuisance_draw(2)[0]))
    assert factor != 1.0

    def ratio(effects):
        return made_trials(own, effects, 2, 0, {0})[0].scene.mechanisms.impact_energy_ratio

    assert ratio(()) == pytest.approx(factor)
    assert ratio((("restitution", (0.8,)),)) == pytest.approx(0.8 * factor)


def stated(**content):
    return {"effect": "slenderness", "parameter": "change"} | content


@pytest.mark.parametrize(
    ("numbers", "at_zero", "spread"),
    [
        ({"distribution": "normal", "sd": 0.02, "mean": 0.01}, 0.01, 0.02),
        ({"distribution": "lognormal", "sd": 0.02, "median": 2.0}, 2.0, 0.02),
        ({"distribution": "uniform", "low": -1.0, "high": 2.0}, 0.5, math.sqrt(0.75)),
        ({"distribution": "loguniform", "low": 0.01, "high": 1.0}, 0.1, 0.2497),
    ],
)
def test_distributions_have_names(numbers, at_zero, spread) -> None:
    made = distribution(numbers)
    assert made.value(0.0) == pytest.approx(at_zero)
    assert made.sd == pytest.approx(spread, rel=1e-3)
    if "low" in numbers:
        assert made.value(-9.0) == pytest.approx(numbers["low"])
        assert made.value(9.0) == pytest.approx(numbers["high"])
        drawn = [made.value(z) for z in np.random.default_rng(0).standard_normal(4000)]
        assert np.std(drawn) == pytest.approx(spread, rel=0.05)


MORE_NUISANCES = (
    Nuisance("slenderness", "change", Uniform(-0.1, 0.1), scope=Scope.MOTION, label="wide"),
    Nuisance("com_offset", "distance", LogUniform(1e-4, 1e-2)),
    Nuisance("base_slope", "angle", Normal(0.1, mean=0.05), direction="azimuth"),
    Nuisance("restitution", "energy_ratio", LogNormal(0.02, median=0.9)),
    Nuisance("friction", "factor", LogNormal(0.1), relative=True, group="a", correlation=-0.5),
    Nuisance("placement", "yaw", DrawnByEffect(0.5, 1.0), scope=Scope.TRIAL),
)


@pytest.mark.parametrize("one", [*DEFAULT_NUISANCES, *MORE_NUISANCES], ids=lambda one: one.name)
def test_a_nuisance_is_read_from_a_file_as_it_was_written(one) -> None:
    assert distribution(nuisances.stated(one.prior)) == one.prior
    assert Nuisance.from_json(json.loads(json.dumps(one.to_json(), allow_nan=False))) == one


@pytest.mark.parametrize("one", DEFAULT_NUISANCES, ids=lambda one: one.name)
def test_a_file_may_leave_out_what_is_usual(one) -> None:
    content = {"effect": one.effect, "parameter": one.parameter, "scope": str(one.scope),
               "name": one.name, "distribution": "normal", "sd": one.prior.sd}  # fmt: skip
    again = Nuisance.from_json(content)
    assert replace(again, prior=one.prior) == one
    assert again.prior.sd == one.prior.sd
    assert isinstance(again.prior, DrawnByEffect) == isinstance(one.prior, DrawnByEffect)


def test_a_file_may_make_a_user_s_effect_relative(monkeypatch) -> None:
    monkeypatch.setattr(nuisances, "known_effects", lambda: {"louder": Louder()})
    one = Nuisance.from_json(stated(effect="louder", distribution="normal", sd=1, relative=True))
    assert one.relative
    assert one.acting.name == "louder"


def test_what_is_relative_without_a_cause_multiplies_the_nominal_value(shaken, tmp_path) -> None:
    class Twice(Louder):
        def nominal(self, trial):
            return {"change": 0.25}

    one = Nuisance(Twice(), "change", Normal(0.0, mean=2.0), relative=True)
    own = simulator(shaken, tmp_path, [one])
    (acting,) = made_trials(own, (), 1, 0, {0})[0].effects
    assert dict(acting.values) == {"change": 0.5}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"effect": "friction"}, "parameter is missing; give it"),
        (stated(distribution="normel", sd=1), "distribution is 'normel'; did you mean `normal`"),
        (stated(distribution="normal"), "sd is missing; normal has sd, least, mean"),
        (stated(distribution="normal", sd=1, hihg=2), "hihg: no number of normal"),
        (stated(distribution="normal", sd="1"), "sd is '1'; give a finite number"),
        (stated(distribution="normal", sd=math.nan), "sd is nan; give a finite number"),
        (stated(distribution="normal", sd=-1), "^sd is -1; give 0 or more"),
        (stated(distribution="lognormal", sd=1, median=0), "^median is 0; give a number above 0"),
        (stated(distribution="normal", sd=10**400), "sd is 1000.*; give a finite number"),
        (stated(distribution="uniform", low=2, high=1), "low is 2 and high 1; give the lower"),
        (stated(distribution="loguniform", low=0, high=1), "above 0"),
        (stated(distribution="normal", sd=1, scope="trail"), "scope is 'trail'; did you mean"),
        (stated(distribution="normal", sd=1, effect="slendernes"), "did you mean `slenderness`"),
        (stated(distribution="normal", sd=1, relative=1), "relative is 1; give true or false"),
        (
            stated(distribution="normal", sd=1, correlation="x"),
            "correlation is 'x'; give a finite number",
        ),
        (stated(distribution="normal", sd=1, direction=1), "direction is 1; give text"),
        (stated(distribution="normal", sd=1, direction="azimth"), "no parameter 'azimth'"),
        (stated(distribution="by_effect", sd=1, reach=-1), "reach is -1; give 0 or more"),
        *(
            (
                {"effect": "placement", "parameter": "yaw", **beside_null},
                "placement draws yaw about 0 in each trial, .* its middle at",
            )
            for beside_null in (
                {"distribution": "normal", "sd": 1, "mean": 3},
                {"distribution": "uniform", "low": 0, "high": 5},
            )
        ),
        (
            stated(distribution="normal", sd=1, group="a", correlation=2),
            "correlation is 2; give -1 to 1",
        ),
    ],
)
def test_a_nuisance_that_a_file_misstates_is_named(content, message) -> None:
    with pytest.raises(DiagnosisError, match=message):
        Nuisance.from_json(content)


def test_what_is_stated_takes_the_place_of_what_is_usual() -> None:
    one = Nuisance.from_json(stated(distribution="uniform", low=-0.1, high=0.1))
    new = Nuisance.from_json(
        {"effect": "motion_noise", "parameter": "displacement", "distribution": "uniform",
         "low": 0.0, "high": 1e-4}
    )  # fmt: skip
    made = with_stated([one, new])
    assert made[-2:] == (one, new)
    assert len(made) == len(DEFAULT_NUISANCES) + 1
    assert [n.name for n in made].count("slenderness") == 1


def test_nuisances_of_a_group_are_drawn_together() -> None:
    group = [
        Nuisance("slenderness", "change", Normal(0.1), group="edges"),
        Nuisance("friction", "factor", LogNormal(0.1)),
        Nuisance("inertia", "change", Normal(0.1), group="edges", correlation=-0.8),
        Nuisance("table_gain", "change", Normal(0.1), group="edges", correlation=0.5),
    ]
    draws = correlated(group, np.random.default_rng(0).standard_normal((20000, 4)))
    np.testing.assert_allclose(
        np.corrcoef(draws.T),
        [[1, 0, -0.8, 0.5], [0, 1, 0, 0], [-0.8, 0, 1, -0.4], [0.5, 0, -0.4, 1]],
        atol=0.03,
    )
    np.testing.assert_allclose(draws.std(axis=0), 1.0, atol=0.03)


def test_a_nuisance_of_motions_is_common_to_their_trials(shaken, tmp_path) -> None:
    own = simulator(shaken, tmp_path, [Nuisance(Louder(), "change", Normal(0.1), Scope.MOTION)])
    made = made_trials(own, (), 2, 1, set(range(len(shaken))))
    values = {}
    for i, trial in enumerate(shaken.trials):
        values.setdefault(trial.motion, set()).add(made[i].effects[0].values)
    assert all(len(found) == 1 for found in values.values())
    assert len(set.union(*values.values())) == len(values) > 1
    assert made_trials(own, (), 0, 1, {0})[0].effects == ()


def test_noise_of_the_motion_is_fresh_in_each_trial(shaken, tmp_path) -> None:
    noise = Nuisance("motion_noise", "displacement", Uniform(1e-3, 1e-3))
    own = simulator(shaken, tmp_path, [noise])
    made, plain = made_trials(own, (), 2, 1, {0, 1}), made_trials(own, (), 0, 0, {0, 1})
    added = [made[i].motion.displacement - plain[i].motion.displacement for i in (0, 1)]
    for one, trial in zip(added, made.values(), strict=True):
        assert 0.7e-3 < one.std() < 1e-3
        assert one[0] == one[-1] == 0
        step = trial.motion.time_step
        moved = np.gradient(trial.motion.displacement, step)
        np.testing.assert_allclose(moved, trial.motion.velocity, atol=0.05)
        assert abs(trial.motion.velocity[0]) < 1e-4
    assert not np.allclose(*(one[:200] for one in added))
    assert made_trials(own, (), 3, 1, {0})[0].motion.sha256 != made[0].motion.sha256


def test_priors_are_distributions() -> None:
    offered = Hypotheses(
        priors={
            "table_gain.change": Normal(0.02),
            "friction.factor": Uniform(0.5, 1.0),
            "time_scale.change": (-0.01, 0.02),
        }
    ).offered
    ends = {n: (p.prior, p.lower, p.upper) for n in offered for p in offered[n].parameters}
    assert ends["table_gain"] == ("normal", -0.04, 0.04)
    assert ends["friction"] == ("uniform", 0.5, 1.0)
    assert ends["time_scale"] == ("uniform", -0.01, 0.02)
    with pytest.raises(DiagnosisError, match=r"prior of friction\.factor: .*give uniform"):
        _ = Hypotheses(priors={"friction.factor": LogNormal(0.1)}).offered
    for text in ("1:1", "uniform:1:1", "loguniform:1:1", "normal:1:0"):
        given = priors((f"friction.factor={text}",))
        with pytest.raises(ConfigError, match=r"friction\.factor: .* from 1 to 1 has no width"):
            _ = Hypotheses(priors=given).offered


def test_a_filter_that_nobody_asked_for_is_said(shaken, tmp_path, caplog) -> None:
    moved = 0.01 * np.sin(np.linspace(0.0, np.pi, 200)) ** 4
    motions = {name: Record(name, 0.005, displacement=moved) for name in shaken.motions}
    clean = replace(shaken, motions=motions)
    noisy = replace(clean, noise=MeasurementNoise(displacement=1e-5))

    def source(campaign, **motion):
        study = study_from_mapping(BOX | ({"motion": motion} if motion else {}), base=tmp_path)
        caplog.clear()
        made = SceneSimulator(campaign, study, hypotheses=Hypotheses({}))
        return made._trials[0].motion.source, [record.message for record in caplog.records]

    cosine = {"mode": "single_cosine", "amplitude": 0.05, "frequency": 1.0}
    driven, said = source(noisy, **cosine)
    assert "band-pass 0.1-25 Hz" in driven
    assert len(said) == 1
    assert "recorded displacements are band-passed" in said[0]
    # Without noise, or where the scene says how recordings drive, they do so.
    for campaign, motion in ((clean, cosine), (noisy, {})):
        driven, said = source(campaign, **motion)
        assert "no filter" in driven
        assert said == []


def test_a_nuisance_that_does_nothing_on_its_own_is_refused() -> None:
    """What the effect of a cause is multiplied by acts with the cause."""
    azimuth = Nuisance("com_offset", "azimuth", Uniform(0.0, 360.0))
    with pytest.raises(DiagnosisError, match="azimuth does nothing on its own; add a nuisance of"):
        Hypotheses(nuisances=[azimuth])
    assert Hypotheses(nuisances=[azimuth, Nuisance("com_offset", "distance", Uniform(0, 1e-3))])
    assert Hypotheses(nuisances=with_stated([azimuth]))
    assert Hypotheses(nuisances=[replace(azimuth, relative=True)])
    for scope in (Scope.TRIAL, Scope.MOTION):
        with pytest.raises(DiagnosisError, match=f"another parameter .* with its scope, {scope}"):
            Hypotheses(nuisances=with_stated([replace(azimuth, scope=scope)]))


@pytest.mark.parametrize("scope", list(Scope))
def test_a_secondary_parameter_joins_the_others_of_its_scope(scope, shaken, tmp_path) -> None:
    angle = Nuisance("base_slope", "angle", Uniform(0.5, 1.0), scope=scope)
    azimuth = Nuisance("base_slope", "azimuth", Uniform(10.0, 350.0), scope=scope)
    own = simulator(shaken, tmp_path, [azimuth, angle])
    made = made_trials(own, (), 1, 1, set(range(len(shaken))))
    acting = [made[i].effects for i in range(len(shaken))]
    assert all(len(effects) == 1 for effects in acting)
    values = [tuple(dict(effects[0].values).values()) for effects in acting]
    assert all(0.5 < one < 1.0 and 10.0 < other < 350.0 for one, other in values)
    motions = {trial.motion for trial in shaken.trials}
    distinct = {Scope.CAMPAIGN: 1, Scope.MOTION: len(motions), Scope.TRIAL: len(shaken)}
    assert len(set(values)) == distinct[scope]
