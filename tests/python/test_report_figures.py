"""Figures: what they show, units on their axes, and files."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from synthetic_results import about, falling_log, make_log, make_result
from vsr2.errors import ResultError
from vsr2.report import (
    overturning_diagram,
    representative_trials,
    time_histories,
    tracking_figure,
    write_figures,
)
from vsr2.results import OUTCOMES, BatchResult, save_result

pytest.importorskip("PIL")


def many(count: int = 300) -> BatchResult:
    """A grid of trials whose outcome grows graver with intensity."""
    rng = np.random.default_rng(5)
    pga = rng.uniform(0.05, 1.0, count)
    ratio = rng.uniform(0.02, 0.5, count)
    level = np.clip(6 * pga * ratio**0.5, 0, 4).astype(int)
    outcome = np.array([OUTCOMES[i] for i in level], dtype=object)
    outcome[:2] = "failed"
    status = np.array(["ok"] * count, dtype=object)
    status[0], status[1] = "diverged", "not_run"
    return make_result(
        [None] * count,
        pga_g=pga,
        pgv_pga_s=ratio,
        outcome=outcome,
        status=status,
        name=np.array([f"n{i}" for i in range(count)], dtype=object),
    )


def test_overturning_diagram_holds_every_trial_that_ran() -> None:
    result = many()
    figure = overturning_diagram(result)
    [panel] = figure.axes
    assert panel.get_xlabel() == "PGV/PGA [s]"
    assert panel.get_ylabel() == "PGA [g]"
    assert panel.get_title() == "299 trials, 1 more not run"
    drawn = np.vstack([collection.get_offsets() for collection in panel.collections])
    assert len(drawn) == 299
    wanted = np.column_stack([result["pgv_pga_s"], result["pga_g"]])
    kept = np.delete(wanted, 1, axis=0)
    np.testing.assert_allclose(np.sort(drawn, axis=0), np.sort(kept, axis=0), rtol=1e-12)
    labels = {collection.get_label() for collection in panel.collections}
    counts = {o: int(np.sum(np.delete(result["outcome"], 1) == o)) for o in OUTCOMES}
    assert labels == {f"{o} ({n})" for o, n in counts.items() if n}
    # A range of more than 10 gets a logarithmic axis with plain numbers.
    assert (panel.get_xscale(), panel.get_yscale()) == ("log", "log")
    assert panel.xaxis.get_major_formatter()(0.05, 0) == "0.05"


def test_overturning_diagram_puts_each_outcome_where_it_belongs() -> None:
    result = make_result(
        [None] * 3,
        pga_g=np.array([1.0, 2.0, 3.0]),
        pgv_pga_s=np.array([0.1, 0.2, 0.0]),
        outcome=np.array(["stable", "overturned", "slid"], dtype=object),
    )
    [panel] = overturning_diagram(result).axes
    points = {c.get_label(): c.get_offsets().tolist() for c in panel.collections}
    assert points["overturned (1)"] == [[0.2, pytest.approx(2.0)]]
    assert points["stable (1)"] == [[0.1, pytest.approx(1.0)]]
    assert panel.get_xscale() == "linear"  # a motion at rest has no place on a logarithmic axis


def test_overturning_diagram_of_nothing() -> None:
    [panel] = overturning_diagram(make_result([])).axes
    assert panel.get_title() == "0 trials"


def test_time_histories_show_the_log_with_units() -> None:
    time = np.arange(-20, 101) * 0.01
    angle = np.where(time > 0, 0.2 * np.sin(time), 0.0)
    command = np.where(time > 0, 0.1 * np.sin(5 * time) ** 2, 0.0)
    log = make_log(time, command=command, achieved=0.9 * command, rotations=about("y", angle))
    figure = time_histories(log, "trial $3 of $5")
    pedestal, tilt, slip, angles = figure.axes
    labels = [panel.get_ylabel() for panel in figure.axes]
    assert labels == [
        "pedestal position [m]",
        "tilt [deg]",
        "slip [mm]",
        "change of angle [deg]",
    ]
    assert angles.get_xlabel() == "time [s]"
    commanded, actual = pedestal.lines
    np.testing.assert_array_equal(commanded.get_ydata(), command)
    np.testing.assert_array_equal(actual.get_ydata(), 0.9 * command)
    np.testing.assert_allclose(tilt.lines[0].get_ydata(), np.degrees(np.abs(angle)), atol=1e-6)
    np.testing.assert_allclose(slip.lines[0].get_ydata(), 1e3 * log.slip[:, 0], atol=1e-12)
    np.testing.assert_allclose(angles.lines[1].get_ydata(), np.degrees(angle), atol=1e-9)
    assert [line.get_label() for line in angles.lines] == ["roll", "pitch", "yaw"]
    # The settling is shaded.
    assert all(len(panel.patches) == 1 for panel in figure.axes)
    with pytest.raises(ResultError, match="no rows"):
        time_histories(make_log(np.array([0.0, 1.0])).__class__(
            np.empty((0, 18)), log.contacts, log.settled_position, log.settled_orientation,
            log.foot, log.mass_center, log.principal_axes,
        ))  # fmt: skip


def test_tracking_figure_has_one_column_a_kind() -> None:
    time = np.arange(4000) * 1e-3
    cosine = np.where(time < 0.5, 0.05 * (1 - np.cos(4 * np.pi * time)), 0.0)
    logs = {
        "cosine": make_log(time, command=cosine),
        "recording": make_log(time, command=cosine, achieved=lfilter([0.1], [1, -0.9], cosine)),
    }
    figure = tracking_figure(logs)
    axes = np.array(figure.axes).reshape(5, 2)
    assert [panel.get_title() for panel in axes[0]] == ["cosine", "recording"]
    assert [panel.get_ylabel().replace("\n", " ") for panel in axes[:, 0]] == [
        "position [m]",
        "error [mm]",
        "power density [(m/s$^2$)$^2$/Hz]",
        "gain [1]",
        "phase [deg]",
    ]
    assert axes[1, 0].get_title() == "peak 0 mm, rms 0 mm, 0 ms late"
    assert axes[1, 1].get_title().endswith("ms late")
    np.testing.assert_allclose(
        axes[1, 1].lines[0].get_ydata(),
        1e3 * (lfilter([0.1], [1, -0.9], cosine) - cosine)[: len(axes[1, 1].lines[0].get_xdata())],
    )
    low, high = axes[3, 0].get_ylim()
    assert low < 0.96 < 1.04 < high  # the exact drive is a line at 1, not magnified rounding
    with pytest.raises(ResultError, match="at least one log"):
        tracking_figure({})


def test_a_drive_that_is_exact_gets_no_flat_panels() -> None:
    time = np.arange(4000) * 1e-3
    cosine = np.where(time < 0.5, 0.05 * (1 - np.cos(4 * np.pi * time)), 0.0)
    position, power = tracking_figure({"cosine": make_log(time, command=cosine)}).axes
    assert position.get_ylabel() == "position [m]"
    assert power.get_title() == "actual and commanded motion are equal"
    assert [text.get_text() for text in power.get_legend().get_texts()] == ["commanded", "actual"]
    # The first lobe of the spectrum is not flat.
    assert np.ptp(np.log10(power.lines[0].get_ydata()[:20])) > 1


def test_representative_trials_take_turns_between_outcomes() -> None:
    log = falling_log(rows=20)
    outcome = ["overturned"] * 4 + ["stable"] * 4 + ["rocked"] * 2
    result = make_result(
        [log] * 9 + [None],
        outcome=np.array(outcome, dtype=object),
        pga_g=np.array([4.0, 1.0, 2.0, 3.0, 0, 0, 0, 0, 0, 0]),
        peak_tilt=np.array([9, 9, 9, 9, 0.001, 0.003, np.nan, 0.002, 0.1, 0.2]),
    )
    # The weakest that overturned, the largest rocking, the largest tilt among the stable.
    assert representative_trials(result, 3) == [1, 5, 8]
    assert representative_trials(result, 5) == [1, 2, 5, 7, 8]
    assert representative_trials(result, 99) == list(range(9))  # trial 9 has no log
    assert representative_trials(result, 99, among=[9, 2]) == [2, 9]
    assert representative_trials(result, 0) == []


def test_write_figures(tmp_path: Path) -> None:
    from PIL import Image

    result = make_result(
        [falling_log(), None, falling_log(rows=60), falling_log(rows=3)],
        outcome=np.array(["overturned", "stable", "rocked", "slid"], dtype=object),
        name=np.array(["a\x1b[31m$x$", "b", "漢\udcff", "c"], dtype=object),
    )
    folder = tmp_path / "figures"
    folder.mkdir()
    (folder / "time_history_000099.png").write_text("of an earlier run")
    (folder / "mine.png").write_text("not ours")
    written = write_figures(result, folder)
    names = [path.name for path in written]
    assert names == [
        "overturning_diagram.png",
        "time_history_000000.png",
        "time_history_000002.png",
        "time_history_000003.png",
        "tracking.png",
        "README.md",
    ]
    assert {path.name for path in folder.iterdir()} == {*names, "mine.png"}
    for path in written[:-1]:
        pixels = np.asarray(Image.open(path).convert("L"), dtype=float)
        assert min(pixels.shape) > 500
        assert pixels.std() > 5  # not blank
    note = written[-1].read_text()
    assert all(f"`{name}`" in note for name in names[:-1])
    assert "trial 0 (a?[31m$x$): overturned" in note


def test_figures_from_the_logs_of_a_folder(tmp_path: Path) -> None:
    result = make_result([falling_log(rows=30), falling_log(rows=30)])
    save_result(result, tmp_path)
    bare = BatchResult(result.trials, (None, None))
    assert len(write_figures(bare, tmp_path / "none")) == 2
    written = write_figures(bare, tmp_path / "figures", max_trials=1, logs_from=tmp_path)
    assert [path.name for path in written[:2]] == [
        "overturning_diagram.png",
        "time_history_000001.png",
    ]


def test_a_folder_that_cannot_be_used(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(ResultError, match="cannot be used for figures"):
        write_figures(make_result([]), tmp_path / "file" / "figures")


def test_figures_need_no_screen_and_leave_pyplot_alone(tmp_path: Path) -> None:
    program = """
import sys
from synthetic_results import falling_log, make_result
from vsr2.report import write_figures
write_figures(make_result([falling_log()]), sys.argv[1])
sys.exit("matplotlib.pyplot" in sys.modules)
"""
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    environment["PYTHONPATH"] = os.pathsep.join(sys.path)
    subprocess.run([sys.executable, "-c", program, tmp_path], check=True, env=environment)
    assert (tmp_path / "overturning_diagram.png").exists()
