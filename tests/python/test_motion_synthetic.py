"""The generator hits what is asked of it, and a seed gives one motion."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsr2.errors import MotionError
from vsr2.motion import (
    intensity_measures,
    shaped_noise,
    synthetic_motion,
)
from vsr2.motion.synthetic import SYNTHETIC


@settings(max_examples=12, deadline=None)
@given(
    pga_g=st.floats(0.02, 2.0),
    pgv_pga_s=st.floats(0.02, 0.35),
    cycles=st.floats(1.5 * SYNTHETIC.least_cycles, 40.0),
    seed=st.integers(0, 2**63 - 1),
    time_step=st.sampled_from([0.001, 0.00125, 0.004, 1 / 240]),
)
def test_the_measures_are_those_asked_for(pga_g, pgv_pga_s, cycles, seed, time_step):
    duration = min(max(3.0, cycles * 2 * math.pi * pgv_pga_s), 60.0)
    motion = synthetic_motion(pga_g, pgv_pga_s, duration, seed, time_step)
    measures = intensity_measures(motion)
    assert measures.pga_g == pytest.approx(pga_g, rel=1e-12)
    assert measures.pgv_pga_s == pytest.approx(pgv_pga_s, rel=SYNTHETIC.pgv_pga_tolerance)
    assert measures.duration_5_95 == pytest.approx(duration, rel=SYNTHETIC.duration_tolerance)
    assert motion.time_step == time_step
    assert motion.kind == "recording"
    # a motion of the ground ends where it began
    assert abs(motion.displacement[-1]) < 1e-9 * measures.pgd + 1e-12
    assert motion.velocity[-1] == motion.acceleration[-1] == 0.0


def test_a_seed_gives_one_motion_and_another_seed_another():
    one, again = (synthetic_motion(0.3, 0.08, 8.0, 7, 0.001) for _ in range(2))
    np.testing.assert_array_equal(one.displacement, again.displacement)
    other = synthetic_motion(0.3, 0.08, 8.0, 8, 0.001)
    count = min(one.displacement.size, other.displacement.size)
    assert abs(np.corrcoef(one.acceleration[:count], other.acceleration[:count])[0, 1]) < 0.5


def test_pga_only_scales():
    one, two = (synthetic_motion(pga, 0.08, 8.0, 7, 0.001) for pga in (0.3, 0.6))
    np.testing.assert_allclose(two.displacement, 2 * one.displacement, rtol=1e-9, atol=1e-15)


def test_names_and_sources_tell_the_recipe():
    motion = synthetic_motion(0.3, 0.08, 8.0, 7, 0.001)
    assert motion.name == "synthetic_pga0.3g_pgv_pga0.08s_d8s_seed7"
    assert "seed 7" in motion.source
    assert synthetic_motion(0.3, 0.08, 8.0, 7, 0.001, name="quake").name == "quake"


def test_shaped_noise_rests_at_both_ends():
    moved = shaped_noise(10.0, 2.0, 1)
    assert moved.size == round(10 / SYNTHETIC.interval) + 1
    scale = np.abs(moved).max()
    assert moved[0] == moved[-1] == 0.0
    assert np.abs(np.diff(moved)[[0, -1]]).max() < 1e-6 * scale


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"pga_g": 0.0}, "pga_g is 0.0 g"),
        ({"pga_g": float("nan")}, "pga_g is nan"),
        ({"pgv_pga_s": 0.001}, "0.012 to 0.4 s"),
        ({"pgv_pga_s": 0.5}, "0.012 to 0.4 s"),
        ({"duration": 1.0}, "from 2 to 300 s"),
        ({"duration": 2.0, "pgv_pga_s": 0.3}, "from 3.77 to 300 s"),
        ({"duration": 1000.0}, "duration is 1000.0 s"),
        ({"seed": -1}, "seed is -1; give 0 or more"),
        ({"time_step": 0.05}, "Nyquist|lower the time step"),
    ],
)
def test_impossible_wishes_are_refused(changes, message):
    wish = {"pga_g": 0.3, "pgv_pga_s": 0.08, "duration": 8.0, "seed": 1, "time_step": 0.001}
    with pytest.raises(MotionError, match=message):
        synthetic_motion(**(wish | changes))
