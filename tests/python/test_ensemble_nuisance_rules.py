"""Nuisances that cannot stand together are refused."""

from __future__ import annotations

from dataclasses import replace

import pytest

from vsr2.ensemble import DrawnByEffect, Hypotheses, LogNormal, Normal, Nuisance, Scope, Uniform
from vsr2.ensemble.simulated.contact_family import CONTACT_FAMILY
from vsr2.ensemble.simulated.nuisances import with_stated
from vsr2.errors import DiagnosisError

IMPACT = Nuisance("restitution", "energy_ratio", LogNormal(0.1), relative=True)
GAIN = Nuisance("table_gain", "change", Normal(0.01))


@pytest.mark.parametrize("scope", list(Scope))
def test_two_of_one_effect_parameter_and_scope_are_refused(scope) -> None:
    first = Nuisance("friction", "factor", LogNormal(0.1), scope, label="worn")
    message = rf"'worn' and 'friction': both are of friction\.factor with scope {scope}; leave one"
    second = replace(first, label="", prior=LogNormal(0.2))
    with pytest.raises(DiagnosisError, match=message):
        Hypotheses(nuisances=[first, GAIN, second])
    with pytest.raises(DiagnosisError, match="'worn' and 'worn': both are of"):
        Hypotheses(nuisances=[first, first])
    with pytest.raises(DiagnosisError, match="both are of"):
        Hypotheses(nuisances=with_stated([first, second]))
    with pytest.raises(DiagnosisError, match="both are of"):
        Hypotheses(nuisances=[first, replace(second, relative=True)])
    # What is stated takes the place of what is usual, and other scopes are others.
    Hypotheses(nuisances=with_stated([first]))
    Hypotheses(nuisances=[replace(first, scope=one) for one in Scope])


def test_two_of_the_contact_family_are_refused() -> None:
    with pytest.raises(DiagnosisError, match=r"contact_model\.margin with scope campaign"):
        Hypotheses(nuisances=[CONTACT_FAMILY[2]])


def test_what_an_effect_draws_has_no_other_beside_it() -> None:
    """It acts with what is drawn for a campaign."""
    drawn = Nuisance("placement", "yaw", DrawnByEffect(1.0, 2.0), Scope.TRIAL)
    for scope in (Scope.CAMPAIGN, Scope.TRIAL):
        one = Nuisance("placement", "yaw", Normal(1.0, 0.0), scope, label="own")
        with pytest.raises(
            DiagnosisError, match=rf"both are of placement\.yaw with scope .*{scope}"
        ):
            Hypotheses(nuisances=[one, drawn])


def test_a_value_that_another_scope_would_replace_is_refused() -> None:
    """Of two values of an impact's energy the later holds."""
    absolute = replace(IMPACT, scope=Scope.TRIAL, relative=False)
    message = "its energy_ratio of scope trial would take the place of that of scope campaign; make"
    for stated in ([IMPACT, absolute], [absolute, IMPACT]):
        with pytest.raises(DiagnosisError, match=message):
            Hypotheses(nuisances=stated)
    # One that is taken out by a deviation of 0 replaces nothing, and nothing replaces it.
    out = replace(IMPACT, prior=LogNormal(0.0))
    Hypotheses(nuisances=[out, absolute])
    Hypotheses(nuisances=[IMPACT, replace(absolute, relative=True)])


def test_what_cannot_act_twice_is_refused_in_two_scopes() -> None:
    wide = Nuisance("edge_rounding", "radius", Uniform(0.001, 0.002))
    narrow = replace(wide, scope=Scope.TRIAL)
    message = "its radius of scope trial would act beside the radius of scope campaign, and edge_"
    with pytest.raises(DiagnosisError, match=message):
        Hypotheses(nuisances=[narrow, wide])
    Hypotheses(nuisances=[wide])
    Hypotheses(nuisances=[replace(narrow, relative=True), wide])
    shapes = [Nuisance("support", name, Uniform(0.0, 0.001)) for name in ("shrink", "flat")]
    Hypotheses(nuisances=shapes)
    with pytest.raises(DiagnosisError, match="support cannot act twice"):
        Hypotheses(nuisances=[replace(one, scope=Scope.MOTION) for one in shapes])
