"""Replays: poses in the world, contacts at a time, models kept with a result."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from synthetic_results import CENTER_HEIGHT, falling_log, make_log, make_result
from vsr2.errors import ResultError, Vsr2Error
from vsr2.results import CONTACT_COLUMNS, TrialLog, save_models, save_result
from vsr2.scene import Box
from vsr2.scene.shapes import box_surface
from vsr2.view import Replay, ReplayServer, load_replay, write_page

ROCK = box_surface(Box((0.5, 0.5, 1.0)))
PEDESTAL = box_surface(Box((4.0, 4.0, 0.5), center=(0.0, 0.0, 2.25)))


def replay_of(log: TrialLog) -> Replay:
    return Replay("trial", log, ROCK, PEDESTAL)


def saved(folder: Path, *logs: TrialLog | None, models: bool = True) -> Path:
    save_result(make_result(logs), folder)
    if models:
        save_models(folder, ROCK, PEDESTAL)
    return folder


def test_the_model_is_drawn_where_the_body_is() -> None:
    # X_WB = X_WM X_MB, whatever the principal axes and the mass centre are.
    rng = np.random.default_rng(2)
    axes = Rotation.from_quat(rng.normal(size=4))
    model = Rotation.from_quat(rng.normal(size=(5, 4)))
    origin, center = rng.normal(size=(5, 3)), rng.normal(size=3)
    log = make_log(
        np.linspace(0.0, 1.0, 5),
        rotations=model * axes,
        position=origin + model.apply(center),
        axes=axes,
        mass_center=center,
    )
    replay = replay_of(log)
    np.testing.assert_allclose(replay.rock_position, origin, atol=1e-12)
    turned = Rotation.from_quat(replay.rock_orientation)
    assert (turned.inv() * model).magnitude().max() < 1e-7


@pytest.mark.parametrize(
    ("time", "row"), [(-1.0, 0), (0.0, 0), (0.049, 0), (0.051, 1), (0.1, 1), (0.26, 3), (9.0, 3)]
)
def test_the_nearest_row_is_shown(time: float, row: int) -> None:
    assert replay_of(make_log(np.array([0.0, 0.1, 0.2, 0.3]))).row(time) == row


def test_contacts_stand_until_the_next_are_logged() -> None:
    # Logged each 0.1 s: two points, then one, then none at 0.2 s, then one.
    rows = np.zeros((4, len(CONTACT_COLUMNS)))
    rows[:, 0] = [0.0, 0.0, 0.1, 0.3]
    rows[:, 1] = [1.0, 2.0, 3.0, 4.0]
    replay = replay_of(replace(make_log(np.linspace(0.0, 0.4, 41)), contacts=rows))

    def x_at(time: float) -> list[float]:
        return replay.contacts(time)[:, 0].tolist()

    assert x_at(-0.05) == []
    assert x_at(0.0) == [1.0, 2.0]
    assert x_at(0.09) == [1.0, 2.0]
    assert x_at(0.1) == [3.0]
    assert x_at(0.19) == [3.0]
    assert x_at(0.2) == []
    assert x_at(0.29) == []
    assert x_at(0.3) == [4.0]
    assert replay_of(make_log(np.array([0.0, 1.0]))).contacts(0.0).shape == (0, 3)


def test_contact_forces_are_impulses_over_the_solver_step() -> None:
    # A block of 100 N on two points at 1 kHz, then an impact of thrice that on one.
    rows = np.zeros((3, len(CONTACT_COLUMNS)))
    rows[:, 0] = [0.0, 0.0, 0.1]
    rows[:, CONTACT_COLUMNS.index("normal_z")] = 1.0
    rows[:, CONTACT_COLUMNS.index("normal_impulse")] = [0.04, 0.06, 0.3]
    log = replace(make_log(np.linspace(0.0, 0.2, 21)), contacts=rows)
    replay = Replay("trial", log, ROCK, PEDESTAL, solver_step=1e-3)
    np.testing.assert_allclose(replay.contact_forces(0.0), [[0, 0, 40.0], [0, 0, 60.0]])
    np.testing.assert_allclose(replay.contact_forces(0.1), [[0, 0, 300.0]])
    assert replay.usual_force == pytest.approx(200.0)  # the median of 100 and 300
    # Without the step of the solver the force is not known, and none is drawn.
    assert replay_of(log).usual_force == 0.0


def test_the_cursor_stands_at_the_time_shown(tmp_path: Path) -> None:
    with ReplayServer(saved(tmp_path, falling_log(seed=1))) as server:
        server.show(1.0)
        time, tilt, table, cursor = server._plot.data
        assert time[np.flatnonzero(cursor)] == pytest.approx([1.0], abs=0.011)
        assert cursor.max() == pytest.approx(tilt.max())
        assert np.ptp(table) > 0.1  # the pedestal's cosine of 0.2 m
        assert all(np.isfinite(curve).all() for curve in (tilt, table, cursor))


def log_in_space() -> TrialLog:
    """A rock that stands still on a pedestal which goes along x, y, z and pitches."""
    time = np.linspace(0.0, 1.0, 6)
    achieved, pitch = 0.1 * time, 0.2 * time
    side = np.column_stack([-0.05 * time, 0.03 * time, pitch])
    pivot = np.array([0.2, 0.0, 1.5])
    turned = Rotation.from_rotvec(np.outer(pitch, [0.0, 1.0, 0.0]))
    settled = np.array([0.0, 0.0, CENTER_HEIGHT])
    moved = np.column_stack([achieved, side[:, :2]])
    log = make_log(
        time,
        achieved=achieved,
        rotations=turned,
        position=pivot + moved + turned.apply(settled - pivot),
    )
    return replace(log, excursions=side, pivot=pivot)


def test_a_pedestal_that_moves_in_space_carries_its_rock(tmp_path: Path) -> None:
    log = log_in_space()
    assert np.abs(log.slip).max() < 1e-12
    replay = replay_of(log)
    turned = Rotation.from_quat(replay.pedestal_orientation)
    carried = replay.pedestal_position + turned.apply([0.0, 0.0, CENTER_HEIGHT])
    np.testing.assert_allclose(carried, log.position, atol=1e-12)
    np.testing.assert_allclose(turned.as_quat(), replay.rock_orientation, atol=1e-12)
    with ReplayServer(saved(tmp_path, log)) as server:
        server.show(1.0)
        pedestal = server._drawing._pedestal
        np.testing.assert_allclose(pedestal.position, replay.pedestal_position[-1])
        w, x, y, z = pedestal.wxyz
        np.testing.assert_allclose((x, y, z, w), replay.pedestal_orientation[-1])


def test_load_replay(tmp_path: Path) -> None:
    folder = saved(tmp_path, None, falling_log(), falling_log(rows=11))
    replay = load_replay(folder)
    assert replay.title == "trial 1: trial 1, stable"
    assert len(replay.time) == 201
    np.testing.assert_array_equal(replay.rock.vertices, ROCK.vertices)
    np.testing.assert_array_equal(replay.pedestal.vertices, PEDESTAL.vertices)
    assert len(load_replay(folder, 2).time) == 11
    with pytest.raises(ResultError, match=r"trial 0 cannot be shown.*trials with one: 1, 2"):
        load_replay(folder, 0)
    with pytest.raises(ResultError, match="the result has 3 trials, counted from 0"):
        load_replay(folder, 3)


def test_a_diverged_trial_is_shown_up_to_there(tmp_path: Path) -> None:
    log = falling_log(seed=1)
    state = log.state.copy()
    state[50:, 5:] = np.nan
    rest = (log.settled_position, log.settled_orientation, log.foot)
    frame = (log.mass_center, log.principal_axes)
    replay = load_replay(saved(tmp_path, TrialLog(state, log.contacts, *rest, *frame)))
    assert len(replay.time) == 50
    assert replay.log.contacts[:, 0].max() <= replay.time[-1]
    state[0, 5] = np.nan
    save_result(
        make_result([TrialLog(state, log.contacts, *rest, *frame)]), tmp_path, overwrite=True
    )
    with pytest.raises(ResultError, match="no finite state"):
        load_replay(tmp_path)


def test_results_without_logs_or_models_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match=r"no trial has a log; set output\.log_every"):
        load_replay(saved(tmp_path / "a", None))
    with pytest.raises(ResultError, match="names no study; keep them with save_models"):
        load_replay(saved(tmp_path / "b", falling_log(), models=False))


def test_models_are_built_from_the_study_where_none_are_kept(tmp_path: Path) -> None:
    study: dict[str, object] = {
        "name": "block",
        "rock": {"shape": "box", "size": [0.5, 0.5, 1.0], "density": 2500.0},
        "motion": {"mode": "single_cosine", "amplitude": 0.1, "frequency": 1.0},
    }
    folder = save_result(make_result([falling_log()], provenance={"study": study}), tmp_path)
    replay = load_replay(folder)
    np.testing.assert_allclose(np.ptp(replay.rock.vertices, axis=0), [0.5, 0.5, 1.0])
    # The default prism stands on a base 2 m high.
    np.testing.assert_allclose(np.unique(replay.pedestal.vertices[:, 2]), [2.0, 2.5])
    study["rock"] = {"shape": "mesh", "file": "gone.obj", "density": 2500.0}
    result = make_result([falling_log()], provenance={"study": study})
    save_result(result, tmp_path, overwrite=True)
    with pytest.raises(Vsr2Error, match=r"holds no models.*gone\.obj"):
        load_replay(tmp_path)


def test_what_is_drawn_stands_where_the_log_says(tmp_path: Path) -> None:
    pytest.importorskip("viser")
    rng = np.random.default_rng(4)
    rotations = Rotation.from_quat(rng.normal(size=(3, 4)))
    time, command = np.array([0.0, 0.5, 1.0]), np.array([0.0, 0.1, -0.2])
    log = make_log(time, command=command, rotations=rotations, mass_center=(0.1, 0.2, 0.3))
    with ReplayServer(saved(tmp_path, log)) as server:
        server.show(0.5)
        rock, pedestal = server._drawing._rock, server._drawing._pedestal
        w, x, y, z = rock.wxyz  # viser's order
        drawn = Rotation.from_quat([x, y, z, w])
        assert (drawn.inv() * rotations[1]).magnitude() < 1e-6
        center = drawn.apply([0.1, 0.2, 0.3]) + rock.position
        np.testing.assert_allclose(center, log.position[1], atol=1e-6)
        np.testing.assert_allclose(pedestal.position, [0.1, 0.0, 0.0], atol=1e-6)
        assert server._pedestal.value == "0.1000"
        server.show(1.0)
        np.testing.assert_allclose(pedestal.position, [-0.2, 0.0, 0.0], atol=1e-6)


def test_missing_viser_names_the_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = saved(tmp_path, falling_log())
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(ResultError, match=r"pip install vsr2\[view\]"):
        ReplayServer(folder)
    with pytest.raises(ResultError, match=r"pip install vsr2\[view\]"):
        write_page(folder, tmp_path / "page.html")
    assert not (tmp_path / "page.html").exists()


def test_addresses_that_cannot_be_listened_on_are_refused(tmp_path: Path) -> None:
    pytest.importorskip("viser")
    folder = saved(tmp_path, falling_log())
    with pytest.raises(ResultError, match="port 70000 does not exist"):
        ReplayServer(folder, port=70000)
    # An address kept for documentation, so no machine's own; and no name at all.
    with pytest.raises(ResultError, match="can be listened on"):
        ReplayServer(folder, host="203.0.113.1")
    with pytest.raises(ResultError, match="is no address of this machine"):
        ReplayServer(folder, host="no such host")
