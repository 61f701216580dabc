"""The synthetic records in `configs/motions`: their promises, and that they can be made again."""

import importlib.util
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from vsr2.config.motion_source import AllRecordings
from vsr2.motion import build_motions, read_record

FOLDER = Path(__file__).parents[2] / "configs" / "motions"


@pytest.fixture(scope="module")
def make():
    spec = importlib.util.spec_from_file_location("make_motions", FOLDER / "make_motions.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


@pytest.fixture(scope="module")
def motions():
    chosen = AllRecordings(mode="all_recordings", folder=FOLDER, pattern="*.csv")
    return {motion.name: motion for motion in build_motions(chosen, 0.001)}


def test_every_recipe_has_its_file_and_the_reverse(make, motions):
    assert [recipe.name for recipe in make.RECIPES] == list(motions)


def test_the_driven_motions_have_the_promised_measures(make, motions):
    for recipe in make.RECIPES:
        motion = motions[recipe.name]
        assert motion.pga_g == pytest.approx(recipe.pga, rel=0.01)
        assert motion.pgv_pga_s == pytest.approx(recipe.pgv_pga_s, rel=0.01)
        assert motion.duration == pytest.approx(recipe.duration + 0.001)
        assert abs(motion.velocity[0]) < 1e-3
        assert motion.displacement[-1] == 0.0
        # a step of the file is 1e-7 m; at twice the interval 20 Hz, the low-pass, shows 1e-6 m
        assert motion.resampling_error < 2e-6


def test_the_readme_lists_them(make):
    rows = re.findall(
        r"`(\w+)\.csv` \| ([\d.]+) \| ([\d.]+) \| (\d+) \|", (FOLDER / "README.md").read_text()
    )
    listed = [(name, float(pga), float(ratio), float(time)) for name, pga, ratio, time in rows]
    assert listed == [(r.name, r.pga, r.pgv_pga_s, r.duration) for r in make.RECIPES]


def test_they_can_be_made_again(make):
    for recipe in make.RECIPES[::4]:
        record = read_record(FOLDER / f"{recipe.name}.csv")
        # one unit of the last digit, since another machine's transform may round the other way
        np.testing.assert_allclose(
            make.displacement(recipe), record.displacement, rtol=0, atol=1.01e-7
        )


def test_they_are_small():
    assert all(path.stat().st_size < 120_000 for path in FOLDER.glob("*.csv"))
