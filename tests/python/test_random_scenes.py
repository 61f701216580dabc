"""Random scenes in both engines: some run clean, and planted faults are found."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vsr2.results import STATE_COLUMNS
from vsr2.simulation import run_batch

SCRIPT = Path(__file__).parents[1] / "fuzz" / "random_scenes.py"
sys.path.insert(0, str(SCRIPT.parent))
import random_scenes as scenes  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore::vsr2.scene.SceneWarning")
NUMBER = 4
"""A block that rocks and comes to rest."""


@pytest.fixture(scope="module")
def shaken():
    trial = scenes.draw(0, NUMBER)
    return trial, run_batch([trial], threads=1)


def judged(trial, result, log=None):
    if log is not None:
        result = replace(result, logs=(log,))
    return scenes.judged(NUMBER, "fast", trial.scene, trial, result, 0)[0]


def test_some_scenes_run_clean(monkeypatch, capsys) -> None:
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), "--scenes", "6"])
    assert scenes.main() == 0
    assert "6 scenes, seed 0: 0 findings" in capsys.readouterr().out


def changed(log, column, rows, by):
    state = log.state.copy()
    state[rows, STATE_COLUMNS.index(column)] += by
    return replace(log, state=state)


def test_a_gain_of_energy_is_found(shaken) -> None:
    trial, result = shaken
    log = result.logs[0]
    assert judged(trial, result) == []
    # At rest in the end: as high as a fall from 5 mm is quick.
    quick = changed(log, "rock_vx", slice(-20, None), np.sqrt(2 * 9.81 * 0.005))
    [found] = judged(trial, result, quick)
    assert "gains 0.005" in found
    [found] = judged(trial, result, changed(log, "rock_z", slice(-20, None), 0.005))
    assert "gains 0.005" in found


@pytest.mark.parametrize("engine", scenes.ENGINES)
def test_a_gain_that_a_note_tells_of_is_one(engine: str) -> None:
    """A block that bounces higher than it fell, and one whose contacts are damped more."""
    for raised, gains in ((1.0, True), (30.0, False)):
        trial = scenes.draw(0, 313, damping=raised)
        assert bool(trial.scene.rock.notes) == gains
        trial = scenes.in_engine(trial, engine)
        result = run_batch([trial], threads=1)
        rise, bound = scenes.gain(trial.scene, trial, result.logs[0])
        assert (rise > bound) == gains
        assert judged(trial, result) == []


def test_a_rock_that_sinks_is_found(shaken) -> None:
    trial, result = shaken
    sunk = changed(result.logs[0], "rock_z", slice(None), -0.006)
    found = judged(trial, result, sunk)
    assert len(found) == 2
    assert all("rests 0.006" in line for line in found)
    assert "no note says so" in found[1]


def test_what_is_not_finite_is_found(shaken) -> None:
    trial, result = shaken
    [found] = judged(trial, result, changed(result.logs[0], "rock_wz", slice(3, 4), np.nan))
    assert "not finite: its log" in found


def test_both_engines_lift_and_turn_a_block_by_its_energy(shaken) -> None:
    """Of a block in free fall the energy is kept; Bullet's step loses (g dt)^2 / 2 a step."""
    trial, result = shaken
    log = result.logs[0]
    fall = np.arange(50) * trial.scene.engine.time_step
    state = np.repeat(log.state[-1:], 50, axis=0)
    state[:, STATE_COLUMNS.index("rock_vz")] = -9.81 * fall
    state[:, STATE_COLUMNS.index("rock_z")] -= 0.5 * 9.81 * fall**2
    values = scenes.energy(trial.scene, replace(log, state=state))
    np.testing.assert_allclose(values, values[0], rtol=1e-5)
