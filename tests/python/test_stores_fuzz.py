"""The fuzz command over stores of finished work: it runs clean, and its files are sound."""

import json
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from vsr2.errors import ResultError

SCRIPT = Path(__file__).parents[1] / "fuzz" / "fuzz_readers.py"
sys.path.insert(0, str(SCRIPT.parent))
import fuzz_stores as fuzz  # noqa: E402


@pytest.fixture(scope="module")
def seeds() -> dict[str, bytes]:
    return dict(fuzz.store_seeds())


def test_stores_run_clean(tmp_path) -> None:
    options = ["--reader", "store", "--engine", "seeded", "--seconds", "4"]
    done = subprocess.run(
        [sys.executable, str(SCRIPT), *options, "--findings", str(tmp_path / "findings")],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    assert "nothing found" in done.stdout


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
