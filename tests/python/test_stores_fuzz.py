"""The fuzz command over stores of finished work: it runs clean, and its files are sound."""

import io
import json
import sys
import zipfile

import numpy as np
import pytest

from fuzz_command import SCRIPT, assert_runs_clean
from vsr2.errors import ResultError

sys.path.insert(0, str(SCRIPT.parent))
import fuzz_stores as fuzz


@pytest.fixture(scope="module")
def seeds() -> dict[str, bytes]:
    return dict(fuzz.store_seeds())


def test_stores_run_clean(tmp_path) -> None:
    assert_runs_clean(["store"], tmp_path, seconds=4)


@pytest.mark.parametrize("suffix", fuzz.READ)
def test_files_that_are_mutated_are_sound(suffix, seeds, tmp_path) -> None:
    path = tmp_path / f"input{suffix}"
    path.write_bytes(seeds[suffix])
    fuzz.READ[suffix](path)


def test_a_posterior_of_a_torn_header_is_damaged(seeds, tmp_path) -> None:
    sound, path = tmp_path / "sound.npz", tmp_path / "input.posterior"
    sound.write_bytes(seeds[".posterior"])
    # A right checksum around a header that ends amid a bracket, of which numpy tells by its
    # tokenizer's error.
    with zipfile.ZipFile(sound) as source, zipfile.ZipFile(path, "w") as target:
        for name in source.namelist():
            member = source.read(name)
            if name == "standard_centre.npy":
                member = member.replace(b"'descr': '<f8'", b"'descr':(  <f8'")
                assert member != source.read(name)
            target.writestr(name, member)
    with pytest.raises(ResultError, match=r"input\.posterior: damaged \(.+\); remove it"):
        fuzz.read_posterior(path)


def test_a_posterior_that_was_read_answers(seeds, tmp_path) -> None:
    path = tmp_path / "input.posterior"
    path.write_bytes(seeds[".posterior"])
    posterior = fuzz.read_posterior(path)
    found = posterior.infer(np.array([0.0, 1.0]), np.zeros((2, 1)))
    assert found.probability.sum() == pytest.approx(1.0)
    for name in fuzz.NAMES:
        assert np.isfinite(
            posterior.parameters.sample(name, found.residuals, np.random.default_rng(0))
        ).all()


def altered_posterior(sound: bytes, changes: dict, about: dict | None = None) -> bytes:
    """A posterior's file with other arrays, None for none, and other keys of `about`."""
    with np.load(io.BytesIO(sound)) as file:
        arrays = dict(file.items())
    arrays["about"] = np.array(json.dumps(json.loads(str(arrays["about"])) | (about or {})))
    arrays = {k: v for k, v in (arrays | changes).items() if v is not None}
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


NAN = np.array([1.0, np.nan, 1.0])
ARRAYS = {
    "probability": (np.array([0.5, 0.0]), r"array probability holds 0\.0 at \(1,\), .* above 0"),
    "standard_scatter": (np.ones((2, 2, 1)), r"has the shape \(2, 2, 1\), wanted is \(2, 1\)"),
    "coefficients": (np.ones((2, 3, 3)), r"has the shape \(2, 3, 3\), wanted is \(2, 4, 3\)"),
    "intercepts": (np.ones((0, 3)), r"array intercepts is empty"),
    "reproduction": (np.array(["a"]), "array reproduction is of type <U1"),
    "deviation": (NAN, r"array deviation holds nan at \(1,\)"),
    "effect": (np.array([0, 2, -1]), r"array effect holds 2 at \(1,\), wanted is from -1 to 1"),
    "centre": (np.ones(8), r"has the shape \(8,\), wanted is \(9\)"),
    "scale": (np.zeros(9), "array scale holds 0.0"),
    "weight 0 0": (np.ones((8, 6)), r"weight 0 0 has the shape \(8, 6\), wanted is \(9, 6\)"),
    "bias 0 0": (None, "array bias 0 0 is missing"),
    "gap_free": (np.full((3, 4), np.inf), "array gap_free holds inf"),
    "misfits": (np.array([1, None], dtype=object), "allow_pickle=False"),
    "outside": (np.ones(3), r"array outside has the shape \(3,\), wanted is \(4\)"),
    "judge 0 weights": (np.ones(21), r"has the shape \(21,\), wanted is \(22\)"),
    "residuals": (None, "array residuals is missing"),
    "rows friction": (np.array([0, 3]), r"rows friction holds 3 at \(1,\), wanted is from 0 to 2"),
    "values wear": (np.ones((1, 1)), r"array values wear has the shape"),
}  # fmt: skip
KEYS = {
    "networks": (0, "key networks is 0, wanted is a whole number"),
    "layers": (2, "array weight 0 0 has the shape|array weight 0 1 is missing"),
    "trials": (0, "key trials is 0, wanted is a whole number"),
    "campaigns": (True, "key campaigns is True"),
    "most": ("two", "key most is 'two'"),
    "levels": ({"wrong": 1.0}, r"key levels has \['wrong'\]"),
    "judges": (2, "key judges is 2, wanted is 0 or 1"),
}


@pytest.mark.parametrize("name", [*ARRAYS, *KEYS])
def test_a_posterior_with_another_array_or_key_is_damaged(name, seeds, tmp_path) -> None:
    path = tmp_path / "input.posterior"
    value, message = (ARRAYS | KEYS)[name]
    changes, about = ({name: value}, {}) if name in ARRAYS else ({}, {name: value})
    path.write_bytes(altered_posterior(seeds[".posterior"], changes, about))
    with pytest.raises(ResultError, match=rf"input\.posterior: damaged \(.*({message}).*remove it"):
        fuzz.read_posterior(path)


@pytest.mark.parametrize("value", [0.0, -1.0, "1", True, float("nan")])
def test_a_posterior_s_temperature_is_a_number_above_0(value, seeds, tmp_path) -> None:
    path = tmp_path / "input.posterior"
    path.write_bytes(altered_posterior(seeds[".posterior"], {}, {"temperature": value}))
    with pytest.raises(ResultError, match=r"key temperature is .*, wanted is"):
        fuzz.read_posterior(path)


@pytest.mark.parametrize("left", [0.3, 0.9])
def test_a_posterior_that_is_cut_short_is_damaged(left, seeds, tmp_path) -> None:
    path = tmp_path / "input.posterior"
    path.write_bytes(seeds[".posterior"][: int(left * len(seeds[".posterior"]))])
    with pytest.raises(ResultError, match=r"input\.posterior: damaged \(.*\); remove it"):
        fuzz.read_posterior(path)


@pytest.mark.parametrize("key", ["gap", "verdict", "none_probability", "corrected", "provenance"])
def test_a_round_that_lacks_what_is_read_of_it_is_diagnosed_again(key, seeds, tmp_path) -> None:
    content = json.loads(seeds[".round"])
    path = tmp_path / "input.round"
    path.write_text(json.dumps(content))
    assert fuzz.read_round(path) is not None
    for odd in (True, "text", [1.0]):
        path.write_text(json.dumps({**content, key: odd}).replace("text", "1e400"))
        fuzz.read_round(path)
    del content[key]
    path.write_text(json.dumps(content))
    assert fuzz.read_round(path) is None
