"""Slips of effects and parameters in packs and keys of others are refused by the nearest word."""

import copy

import pytest

from blind_samples import assert_pack_refused, stand_in
from foreign_pack import KEY, Reported, write_diagnoses, write_pack
from vsr2.blind import score_pack
from vsr2.blind.form.seal import open_key
from vsr2.errors import BlindError


@pytest.fixture(autouse=True)
def _reported(monkeypatch):
    stand_in(monkeypatch, Reported)


def reference(**effect):
    """An open campaign with one effect, as pack.json lists it."""
    return {"id": "c", "kind": "reference", "effects": [effect]}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {
                "nuisances": [
                    {"effect": "friction", "parameter": "factr", "distribution": "normal", "sd": 1}
                ]
            },
            r"nuisances\[0\]\.parameter: effect 'friction' has no parameter 'factr'; it has factor",
        ),
        (
            {"campaigns": [reference(name="fricton", values={"factor": 0.8})]},
            r"campaigns\[0\]\.effects\[0\]\.name is 'fricton'; .* do you mean 'friction'",
        ),
        (
            {"campaigns": [reference(name="friction", values={"factr": 0.8})]},
            r"campaigns\[0\]\.effects\[0\]\.values\.factr is 0\.8; .* did you mean `factor`",
        ),
        (
            {"campaigns": [reference(name="friction", values={"speed": 0.8})]},
            r"campaigns\[0\]\..*speed is 0\.8; friction has no parameter 'speed'; known are",
        ),
    ],
)
def test_slips_of_a_pack_are_refused_before_any_simulation(changes, message, tmp_path) -> None:
    assert_pack_refused(changes, message, tmp_path)


@pytest.mark.parametrize(
    ("effect", "message"),
    [
        (
            {"name": "table_gian", "values": {"change": 0.1}, "strength": "change"},
            "name is 'table_gian'; there is no effect 'table_gian'; do you mean 'table_gain'",
        ),
        (
            {"name": "friction", "values": {"facter": 0.8}, "strength": "facter"},
            r"values\.facter is 0\.8; friction has no parameter 'facter'; did you mean `factor`",
        ),
        (
            {"name": "friction", "values": {"factor": 0.8, "v": 1.0}, "strength": "factor"},
            r"values\.v is 1\.0; friction has no parameter 'v'; known are factor",
        ),
    ],
)
def test_slips_of_a_key_are_refused_and_leave_no_receipt(effect, message, tmp_path) -> None:
    key = copy.deepcopy(KEY)
    key["campaigns"]["Hall.1"]["effects"] = [effect | {"null": 0.0}]
    data, kept = write_pack(tmp_path, key)
    out = write_diagnoses(data, tmp_path / "out")
    with pytest.raises(BlindError, match=rf"key\.campaigns\.Hall\.1\.effects\[0\]\.{message}"):
        score_pack(data, kept, out, tmp_path / "scores")
    assert not (kept / "receipt.json").exists()
    assert not (tmp_path / "scores").exists()


def test_a_key_may_name_parameters_of_the_library(tmp_path) -> None:
    key = copy.deepcopy(KEY)
    own = {"name": "friction", "values": {"factor": 0.8}, "strength": "factor", "null": 1.0}
    key["campaigns"]["Hall.1"]["effects"] = [own]
    assert open_key(*write_pack(tmp_path, key))["campaigns"]["Hall.1"]["effects"] == [own]
