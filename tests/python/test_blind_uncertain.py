"""What a pack says is uncertain can be simulated, or is refused before any simulation."""

import copy
import math

import pytest

from blind_samples import assert_pack_refused
from foreign_pack import KEY, write_pack
from vsr2.blind.form.seal import open_key, read_pack
from vsr2.blind.form.uncertainties import uncertainties
from vsr2.blind.pack_diagnoses import pack_nuisances
from vsr2.ensemble import Normal, with_deviations
from vsr2.errors import BlindError


def friction(**content):
    return {"effect": "friction", "parameter": "factor", "distribution": "normal"} | content


def restitution(**content):
    return friction(effect="restitution", parameter="energy_ratio") | content


@pytest.mark.parametrize(
    ("nuisance", "message"),
    [
        (
            friction(distribution="uniform", low=-100, high=800),
            r"distribution: nuisance 'friction': friction\.factor reaches -100 to 800, and can be "
            "simulated from 0 to 20; give other ends",
        ),
        (
            friction(sd=0.4),
            r"distribution: .* -0\.2 to 2\.2 within 3 sd, .* from 0 to 20; give a smaller sd",
        ),
        (
            friction(effect="inertia", parameter="change", distribution="uniform", low=-3, high=1),
            r"distribution: .*inertia\.change reaches -3 to 1, and .* from -0\.9 to 5",
        ),
        (
            restitution(distribution="uniform", low=-1, high=3),
            r"distribution: .* reaches -1 to 3, as a factor, .* from 0\.01 to 1\.5",
        ),
        (friction(sd=-0.1), r"sd is -0\.1; give 0 or more"),
        (
            friction(sd=0.1, correlation=0.5),
            r"correlation is 0\.5 without a group.* the same group, or leave correlation out",
        ),
    ],
)
def test_a_nuisance_that_cannot_be_is_refused(nuisance, message, tmp_path) -> None:
    assert_pack_refused({"nuisances": [nuisance]}, rf"nuisances\[0\]\.{message}", tmp_path)
    key = copy.deepcopy(KEY)
    key["settings"]["nuisances"] = [nuisance]
    with pytest.raises(BlindError, match=rf"key\.settings\.nuisances\[0\]\.{message}"):
        open_key(*write_pack(tmp_path / "sealed", key))


def test_a_nuisance_alone_in_its_group_is_refused(tmp_path) -> None:
    group = [friction(sd=0.1, group="wet"), restitution(sd=0.1, group="weet", correlation=0.5)]
    message = "nuisances is .*'friction': is alone in its group 'wet' with scope campaign; give an"
    assert_pack_refused({"nuisances": group}, message, tmp_path)
    group[1]["group"] = "wet"
    data, _ = write_pack(tmp_path / "two", pack={"nuisances": group})
    assert len(read_pack(data).nuisances) == 2


def test_a_nuisance_lies_about_the_value_without_effect(tmp_path) -> None:
    """As one with a deviation of 0 takes it out, of whichever parameter."""
    stated = [friction(sd=0.05), restitution(sd=0)]
    read = read_pack(write_pack(tmp_path, pack={"nuisances": stated})[0])
    found = {one.name: one.prior for one in pack_nuisances(read)}
    assert found["friction"] == Normal(0.05, mean=1.0)
    assert found["restitution"] == Normal(0, mean=1.0)


@pytest.mark.parametrize(
    ("tolerances", "message"),
    [
        ({"friction": 300}, r"friction is 300\.0; .* reaches 0 to inf within 3 sd, and can be sim"),
        ({"width": 0.01, "height": 2}, r"width is 0\.01; nuisance 'slenderness': .* from -0\.5 to"),
        ({"energy_ratio": 3}, r"energy_ratio is 3\.0; nuisance 'restitution': .* as a factor"),
    ],
)
def test_tolerances_that_cannot_be_are_refused(tolerances, message, tmp_path) -> None:
    assert_pack_refused({"tolerances": tolerances}, rf"tolerances\.{message}", tmp_path)


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("table_gain", r"its key should be effect\.parameter, such as table_gain\.change"),
        ("session.", r"its key should be effect\.parameter, such as session\.at"),
        ("gain", r"its key should be effect\.parameter, such as friction\.factor"),
    ],
)
def test_a_prior_without_a_parameter_is_refused(key, message, tmp_path) -> None:
    priors = {key: {"distribution": "normal", "sd": 0.03}}
    assert_pack_refused({"priors": priors}, rf"priors\.{key} is .*; {message}", tmp_path)


def test_a_diagnosis_takes_its_uncertainties_from_the_published_tolerances() -> None:
    found = uncertainties(
        {"width": 0.03, "height": 0.04, "friction": 0.05, "yaw": math.radians(2), "offset": 0.003,
         "input_gain": [0.004, 0.004], "energy_ratio": 0.015}
    )  # fmt: skip
    assert found == pytest.approx(
        {"slenderness": 0.05, "inertia": 0.16, "friction": 0.05, "yaw": 2.0, "offset": 0.003,
         "trial_gain": 0.004, "restitution": 0.015}
    )  # fmt: skip
    assert uncertainties({}) == {}
    with_deviations(found)
