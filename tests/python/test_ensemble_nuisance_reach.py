"""Nuisances reach what can be simulated, and lie about the value without effect."""

from __future__ import annotations

import json
import math

import pytest

from vsr2.ensemble import (
    DrawnByEffect,
    Hypotheses,
    LogNormal,
    Normal,
    Nuisance,
    Scope,
    Uniform,
    with_deviations,
)
from vsr2.ensemble.simulated.contact_family import CONTACT_FAMILY
from vsr2.ensemble.simulated.distributions import LogUniform
from vsr2.ensemble.simulated.nuisances import DEFAULT_NUISANCES
from vsr2.errors import DiagnosisError

FAR = 40.0
"""A draw that no campaign has."""


def stated(effect, parameter, **content):
    return {"effect": effect, "parameter": parameter, "distribution": "normal"} | content


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Nuisance("friction", "factor", Uniform(-100, 800)), "reaches -100 to 800, and"),
        (lambda: Nuisance("friction", "factor", Normal(0.05)), r"reaches -0\.15 to 0\.15 within 3"),
        (lambda: Nuisance("friction", "factor", LogNormal(1e308)), "reaches 0 to inf within 3 sd"),
        (lambda: Nuisance("friction", "factor", LogUniform(1, 1e200)), "sd is|reaches 1 to 1e"),
        (lambda: with_deviations({"friction": 300}), "give a smaller sd or another median"),
        (lambda: Nuisance("inertia", "change", Uniform(-3, 1)), "from -0.9 to 5; give other ends"),
        (
            lambda: Nuisance("restitution", "energy_ratio", Uniform(-1, 3), relative=True),
            r"as a factor, and can be simulated from 0\.01 to 1\.5",
        ),
        (
            lambda: Nuisance("wear", "loss", Normal(0.2, mean=0.4)),
            r"-0\.2 to 1 .* from -0\.5 to 0\.9",
        ),
        (
            lambda: Nuisance("com_offset", "distance", Normal(0.001)),
            "-0.003 to 0.003 m within 3 sd, .* from 0 to 0.2 m; .* least, or azimuth as direction",
        ),
        (
            lambda: Nuisance("com_offset", "distance", Normal(0.1), direction="azimuth"),
            r"from -0\.2 to 0\.2 m",
        ),
        (
            lambda: Nuisance("placement", "yaw", DrawnByEffect(100.0, 2.0), Scope.TRIAL),
            "reaches 200 to 200 degree, .* from 0 to 180 degree; give a smaller sd or reach",
        ),
        (
            lambda: Nuisance("adhesion", "strength", Normal(0.5, mean=1.0), relative=True),
            "reaches -0.5 to 2.5 within 3 sd, as a factor, and can be simulated from 0 to inf",
        ),
    ],
)
def test_what_cannot_be_simulated_is_refused(make, message) -> None:
    with pytest.raises(DiagnosisError, match=message):
        make()


@pytest.mark.parametrize(
    "one",
    [
        *DEFAULT_NUISANCES,
        *CONTACT_FAMILY,
        Nuisance("friction", "factor", Normal(0.333, mean=1.0)),
        Nuisance("edge_rounding", "radius", Normal(0.001, 0.0)),
        Nuisance("slenderness", "change", LogNormal(0.5), relative=True),
        Nuisance("table_gain", "change", Normal(0.5), relative=True),
        Nuisance("com_offset", "distance", Normal(0.05), direction="azimuth"),
        Nuisance("motion_noise", "displacement", Uniform(0.0, 0.1)),
    ],
    ids=lambda one: one.name,
)
def test_no_draw_lies_beyond_what_can_be_simulated(one) -> None:
    low, high = one.bounds
    for z in (-FAR, -3.0, 0.0, 3.0, FAR):
        value = one.values(z)[one.parameter]
        assert (0.0 if one.direction else low) <= value <= high
        if abs(z) <= 3:
            assert value == pytest.approx(abs(one.prior.value(z)) if one.direction else
                                          one.prior.value(z))  # fmt: skip


@pytest.mark.parametrize(
    ("content", "middle"),
    [
        (stated("friction", "factor", sd=0.05), 1.0),
        (stated("friction", "factor", sd=0.05, mean=0.9), 0.9),
        (stated("friction", "factor", sd=0.05, distribution="lognormal"), 1.0),
        (stated("friction", "factor", sd=0.05, distribution="lognormal", median=0.8), 0.8),
        (stated("slenderness", "change", sd=0.05), 0.0),
        (stated("slenderness", "change", sd=0.05, relative=True), 1.0),
        # An impact's energy is relative.
        (stated("restitution", "energy_ratio", sd=0.05), 1.0),
        (stated("table_resonance", "frequency", sd=0.5), 12.0),
    ],
)
def test_the_middle_is_that_without_effect(content, middle) -> None:
    one = Nuisance.from_json(content)
    assert one.prior.value(0.0) == middle
    assert Nuisance.from_json(json.loads(json.dumps(one.to_json()))) == one


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            stated("table_bandwidth", "corner", sd=1),
            "mean is missing; .*corner without .*, inf",
        ),
        (stated("restitution", "energy_ratio", sd=1, relative=False), "mean is missing; give it"),
        (
            stated("com_offset", "distance", sd=1, distribution="lognormal"),
            "median is missing; give it, as the value of distance without effect, 0, cannot be",
        ),
    ],
)
def test_a_middle_that_is_nowhere_is_asked_for(content, message) -> None:
    with pytest.raises(DiagnosisError, match=message):
        Nuisance.from_json(content)


def test_a_correlation_without_a_group_is_refused() -> None:
    message = r"correlation is -0\.5 without a group.*; give the nuisances .* the same group, or"
    with pytest.raises(DiagnosisError, match=message):
        Nuisance("friction", "factor", LogNormal(0.1), correlation=-0.5)
    with pytest.raises(DiagnosisError, match="correlation is 1 without a group"):
        Nuisance.from_json(stated("friction", "factor", sd=0.1, correlation=1))
    with pytest.raises(DiagnosisError, match="group is 'a', and the effect draws yaw itself"):
        Nuisance("placement", "yaw", DrawnByEffect(1.0, math.sqrt(3)), Scope.TRIAL, group="a")


def test_nobody_is_alone_in_a_group() -> None:
    one = Nuisance("friction", "factor", LogNormal(0.1), group="a")
    other = Nuisance("inertia", "change", Normal(0.1), group="a", correlation=0.5)
    assert Hypotheses(nuisances=(one, other)).nuisances == (one, other)
    elsewhere = Nuisance("inertia", "change", Normal(0.1), Scope.TRIAL, group="a")
    for alone in ([one], [one, elsewhere]):
        message = "'friction': is alone in its group 'a' with scope campaign; give another"
        with pytest.raises(DiagnosisError, match=message):
            Hypotheses(nuisances=tuple(alone))
