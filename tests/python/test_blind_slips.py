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
        *(
            (
                {"campaigns": [{"id": "a", "exclude": [slip]}]},
                rf"campaigns\[0\]\.exclude.*there is no effect '{slip}'; do you mean '{meant}'",
            )
            for slip, meant in (
                ("Wear", "wear"),
                ("WEAR", "wear"),
                ("waer", "wear"),
                ("com-offset", "com_offset"),
                ("frictoin", "friction"),
                ("placment", "placement"),
                ("catxh", "catch"),
            )
        ),
        (
            {"campaigns": [reference(name="friction", values={"factr": 0.8})]},
            r"campaigns\[0\]\.effects\[0\]\.values\.factr is 0\.8; .* did you mean `factor`",
        ),
        (
            {"campaigns": [reference(name="friction", values={"speed": 0.8})]},
            r"campaigns\[0\]\..*speed is 0\.8; friction has no parameter 'speed'; known are",
        ),
        (
            {"campaigns": [reference(name="friction", values={"factor": -8})]},
            r"campaigns\[0\]\.effects\[0\]\.values\.factor is -8\.0; -8 is outside 0 to 20; check",
        ),
        (
            {"campaigns": [{"id": "a"}, {"id": "b", "exclude": ["chain", "wind"]}]},
            r"campaigns\[1\]\.exclude is .*; it should hold complete equivalence classes: rope too",
        ),
        (
            {"campaigns": [{"id": 12}]},
            r"campaigns\[0\]\.id is 12; 12 is no id, as it is no text; put it in quotes",
        ),
        (
            {"campaigns": [{"id": 12e34}]},
            r"campaigns\[0\]\.id is 1\.2e\+35; .* put it in quotes, as it is written",
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
        (
            {"name": "friction", "values": {"factor": -8.0}, "strength": "factor"},
            r"values\.factor is -8\.0; -8 is outside 0 to 20; check unit and sign",
        ),
        (
            {"name": "friction", "values": {"factor": 0.8}, "strength": "factor"},
            r"null is 0\.0; it should be 1\.0: the value of friction\.factor without effect",
        ),
        (
            {"name": "restitution", "values": {"energy_ratio": 0.8}, "strength": "energy_ratio"},
            r"null is 0\.0; it should be from 0\.01 to 1\.5: the value of restitution",
        ),
        (
            {"name": "table_bandwidth", "values": {"corner": 8.0}, "strength": "corner"},
            r"null is 0\.0; it should be null, for infinity: the value of table_bandwidth\.corner",
        ),
        (
            {
                "name": "base_slope",
                "values": {"angle": 1.0, "azimuth": 90.0},
                "strength": "azimuth",
            },
            "strength is 'azimuth'; it does nothing on its own; give one of base_slope that does: "
            "angle",
        ),
        (
            {"name": "inertia", "values": {"rule": 0.5}, "strength": "rule"},
            r"values\.rule is 0\.5; must be one of model, aabb",
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


@pytest.mark.parametrize(
    ("name", "strength", "value", "null"),
    [
        ("friction", "factor", 0.8, 1.0),
        ("restitution", "energy_ratio", 0.8, 1.0),
        ("table_bandwidth", "corner", 8.0, None),
        # Where no slack is beyond 180 degrees, infinity says the same.
        ("catch", "slack", 20.0, 180.0),
        ("catch", "slack", 20.0, None),
        ("gust", "speed", 0.0, None),
    ],
)
def test_a_key_may_name_parameters_of_the_library(name, strength, value, null, tmp_path) -> None:
    key = copy.deepcopy(KEY)
    own = {"name": name, "values": {strength: value}, "strength": strength, "null": null}
    key["campaigns"]["Hall.1"]["effects"] = [own]
    assert open_key(*write_pack(tmp_path, key))["campaigns"]["Hall.1"]["effects"] == [own]


def test_a_slip_in_what_a_key_withholds_is_refused(tmp_path) -> None:
    key = copy.deepcopy(KEY)
    key["campaigns"]["Hall.2"]["exclude"] = ["rope", "chain", "table_gian"]
    message = r"key\.campaigns\.Hall\.2\.exclude\[2\] is 'table_gian'; .* mean 'table_gain'"
    with pytest.raises(BlindError, match=message):
        open_key(*write_pack(tmp_path, key))


def test_sealed_weights_are_counted_before_anything_is_scored(tmp_path) -> None:
    key = copy.deepcopy(KEY)
    key["campaigns"]["Hall.1"]["where"]["weights"] = [1.0, 2.0]
    data, kept = write_pack(tmp_path, key)
    message = r"trials\.csv: has 3 trials, but the key has 2 weights in campaigns\.Hall\.1\.where"
    with pytest.raises(BlindError, match=message):
        open_key(data, kept)


@pytest.mark.parametrize("file", ["pack.json", "key.json", "diagnosis.json"])
def test_a_key_that_stands_twice_is_refused(file, tmp_path) -> None:
    """JSON takes the last."""
    data, kept = write_pack(tmp_path)
    out = write_diagnoses(data, tmp_path / "out")
    (path,) = [p for p in tmp_path.rglob(file) if "Hall.2/M" in str(p) or "out" not in str(p)]
    path.write_text(path.read_text().replace('"schema":', '"schema": "x", "schema":', 1))
    with pytest.raises(BlindError, match=rf"{file}: schema stands twice in one mapping; leave one"):
        score_pack(data, kept, out, tmp_path / "scores")
    assert not (kept / "receipt.json").exists()
