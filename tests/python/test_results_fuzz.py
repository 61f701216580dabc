"""The fuzz command over results, hazard curves and studies: it runs clean, its files are sound."""

import shutil
import sys

import pytest

from fuzz_command import SCRIPT, assert_runs_clean
from vsr2.hazard import read_hazard_curve

sys.path.insert(0, str(SCRIPT.parent))
import fuzz_results as fuzz


@pytest.mark.parametrize("reader", fuzz.READ)
def test_the_reader_runs_clean(reader, tmp_path) -> None:
    assert_runs_clean([reader], tmp_path)


@pytest.mark.parametrize("reader", fuzz.READ)
def test_files_that_are_mutated_are_sound(reader, tmp_path) -> None:
    for file in ("mesh/tetra.obj", "motion/pulse.csv"):
        shutil.copy(SCRIPT.parent / "corpus" / file, tmp_path)
    seeds = fuzz.result_seeds(reader)
    assert {suffix for suffix, _ in seeds} == set(fuzz.READ[reader])
    for suffix, content in seeds:
        path = tmp_path / f"input{suffix}"
        path.write_bytes(content)
        fuzz.READ[reader][suffix](path)


def test_curves_of_one_site_and_of_several_are_read(tmp_path) -> None:
    path = tmp_path / "curve.csv"
    for text, site in ((fuzz.CURVE, None), (fuzz.CURVE + fuzz.OTHER_SITE, fuzz.SITE)):
        path.write_text(text)
        assert read_hazard_curve(path, site=site).levels.size == 3


def test_logs_of_the_result_have_every_array() -> None:
    files = fuzz.sound_result()
    assert set(files) >= set(fuzz.KINDS.values())
    assert b"excursions.npy" in files["logs/000001.npz"]
