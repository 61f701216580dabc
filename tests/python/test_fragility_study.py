"""Fragility studies: trials drawn by seed, files, figures, resume, errors."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import asdict
from functools import partial

import numpy as np
import pytest

import command_line
from vsr2.errors import ConfigError
from vsr2.fragility import fragility_trials, load_fragility
from vsr2.fragility.settings import FIT
from vsr2.results import JOURNAL_FILE
from vsr2.scene.rotation import matrix_from_quaternion

STUDY = """
name: fragility
seed: 5
engine: {mode: fast}
rock: {shape: box, size: [0.25, 0.5, 1.0], density: 2700.0, start: {yaw: 10.0}}
motion:
  mode: grid_cosine
  pga_g: {min: 0.25, max: 0.65, step: 0.1}
  pgv_pga_s: {min: 0.1, max: 0.16, step: 0.06}
outcome: {tail: 1.0}
fragility:
  measures: [pga_g, pgv_pga_s]
  azimuths: [0.0, 30.0]
  replicates: 2
  jitter: {yaw: 4.0, offset: 0.01, tilt: 0.05}
  points: 5
"""


@pytest.fixture
def study(tmp_path):
    def load(*changes: tuple[str, str], overrides=()):
        text = STUDY
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "study.yaml"
        path.write_text(text)
        return load_fragility(path, overrides=overrides)

    return load


run = partial(command_line.run, "fragility")


def test_perturbations_are_drawn_by_seed_and_place(study):
    trials, planned = fragility_trials(study())
    assert len(trials) == len(planned) == 10 * 2 * 2
    again, same = fragility_trials(study())
    assert planned == same
    assert [t.start for t in trials] == [t.start for t in again]
    assert [t.seed for t in trials] == [one.seed for one in planned]
    assert len({one.seed for one in planned}) == len(planned)
    _, other = fragility_trials(study(overrides=["seed=6"]))
    assert not {one.yaw for one in other} & {one.yaw for one in planned}

    # More replicates leave the earlier ones as they were.
    _, more = fragility_trials(study(overrides=["fragility.replicates=3"]))
    kept = [one for one in more if one.replicate < 2]
    strip = [(p.motion, p.azimuth, p.replicate, p.seed, p.yaw, p.offset_x) for p in kept]
    assert strip == [(p.motion, p.azimuth, p.replicate, p.seed, p.yaw, p.offset_x) for p in planned]
    # One perturbation does not depend on whether another is on.
    _, still = fragility_trials(study(("tilt: 0.05", "tilt: 0.0")))
    assert [one.yaw for one in still] == [one.yaw for one in planned]
    assert {one.tilt_x for one in still} == {0.0}


def test_perturbations_have_the_deviations_asked_for(study):
    _, planned = fragility_trials(study(overrides=["fragility.replicates=60"]))
    for name, deviation in (("yaw", 4.0), ("offset_x", 0.01), ("offset_y", 0.01),
                            ("tilt_x", 0.05), ("tilt_y", 0.05)):  # fmt: skip
        values = np.array([getattr(one, name) for one in planned])
        # 1200 draws: the deviation is known within 2 %, the mean within 3 % of it.
        assert values.std() == pytest.approx(deviation, rel=0.08)
        assert abs(values.mean()) < 0.12 * deviation


def test_starts_are_turned_moved_and_tilted_as_drawn(study):
    trials, planned = fragility_trials(study())
    for trial, one in zip(trials, planned, strict=True):
        rotation = matrix_from_quaternion(trial.start.orientation)
        up = rotation[:, 2]
        tilt = math.degrees(math.acos(min(1.0, up[2])))
        assert tilt == pytest.approx(math.hypot(one.tilt_x, one.tilt_y), rel=1e-3)
        # A tilt about x leans towards -y, one about y towards +x.
        assert math.degrees(up[0]) == pytest.approx(one.tilt_y, abs=1e-5)
        assert math.degrees(-up[1]) == pytest.approx(one.tilt_x, abs=1e-5)
        heading = math.degrees(math.atan2(rotation[1, 0], rotation[0, 0]))
        assert heading == pytest.approx(one.azimuth + one.yaw, abs=0.01)
        assert trial.start.position[0] == pytest.approx(one.offset_x)
        assert trial.start.position[1] == pytest.approx(one.offset_y)


def test_without_perturbation_the_start_is_the_studys(study):
    plain = study(("  azimuths: [0.0, 30.0]\n  replicates: 2\n", ""),
                  ("  jitter: {yaw: 4.0, offset: 0.01, tilt: 0.05}\n", ""))  # fmt: skip
    trials, planned = fragility_trials(plain)
    assert len(trials) == 10
    assert all(trial.start is None for trial in trials)
    assert {one.azimuth for one in planned} == {10.0}


def test_recordings_are_scaled_and_keep_their_motion(study, tmp_path):
    time = np.arange(200) * 0.01
    text = "time_s,displacement_m\n" + "".join(
        f"{t},{0.02 * (1 - math.cos(2 * math.pi * t))}\n" for t in time[:101]
    )
    (tmp_path / "records").mkdir()
    for name in ("one", "two"):
        (tmp_path / "records" / f"{name}.csv").write_text(text)
    a, b = STUDY.index("  mode: grid"), STUDY.index("outcome:")
    found = study(
        (STUDY[a:b], '  mode: all_recordings\n  folder: records\n  pattern: "*.csv"\n'),
        ("  replicates: 2", "  target_pga_g: [0.1, 0.2, 0.4]\n  replicates: 2"),
    )
    trials, planned = fragility_trials(found)
    assert len(trials) == 2 * 3 * 2 * 2
    assert {one.motion for one in planned} == {"one", "two"}
    peaks = sorted({round(trial.motion.pga_g, 9) for trial in trials})
    assert peaks == [0.1, 0.2, 0.4]


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("  jitter: {yaw: 4.0, offset: 0.01, tilt: 0.05}\n", "",
         "without `jitter` all replicates are one and the same"),
        ("measures: [pga_g, pgv_pga_s]", "measures: [pga]", r"^(?!.*problems).*must be .*pga_g"),
        ("measures: [pga_g, pgv_pga_s]", "measures: []", "measures: must hold at least 1"),
        ("azimuths: [0.0, 30.0]", "target_pga_g: [0.3, -1]", "target_pga_g: -1 is not above 0"),
        ("measures: [pga_g, pgv_pga_s]", "measures: [pga_g, pga_g]", "one is there twice"),
        ("measures: [pga_g, pgv_pga_s]", "surface: linear", "no effect with one measure"),
        ("azimuths: [0.0, 30.0]", "azimuths: [0.0, 0.0]", "azimuths: one is there twice"),
        ("azimuths: [0.0, 30.0]", "target_pga_g: [0.1]", "scales recordings; set motion.pga_g"),
        ("start: {yaw: 10.0}", "start: {mode: pose, position: [0, 0, 3]}", "use `mode: yaw`"),
        ("  points: 5", "  point: 5", r"fragility.point: .*did you mean `points`"),
        ("fragility:", "fragilty:", "did you mean `fragility`"),
        ("outcome:", "effects: {table_gian: {change: 0.1}}\noutcome:", "table_gian.*`table_gain`"),
        ("outcome:", "effects: {wear: {loss: 0.1}}\noutcome:", "effects.wear: acts by the order"),
        (
            "outcome:", "effects: {session: {friction_factor: 0.8}}\noutcome:",
            "effects.session: acts by the order of a campaign's trials, and fragility has none",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_named(study, old, new, match):
    with pytest.raises(ConfigError, match=match):
        study((old, new))


def rows(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def test_a_study_runs_to_tables_figures_and_page_and_resumes(study, tmp_path, capsys):
    study()
    path, out = tmp_path / "study.yaml", tmp_path / "out"
    assert run(path, "--out", out, "--threads", 1) in (0, 1)
    assert "pga_g: 40 trials of 10 motions" in capsys.readouterr().out
    plan = rows(out / "plan.csv")
    assert len(plan) == len(rows(out / "trials.csv")) == 40
    assert {row["azimuth"] for row in plan} == {"0", "30"}
    curve = rows(out / "curve_pga_g.csv")
    assert list(curve[0]) == ["pga_g", "probability", "lower", "upper", "inside"]
    values = np.array([[float(cell) for cell in row.values()] for row in curve])
    assert values[0, 0] == pytest.approx(0.25)
    assert values[-1, 0] == pytest.approx(0.65, rel=1e-3)
    assert (np.diff(values[:, 1]) > 0).all()
    assert ((values[:, 2] <= values[:, 1]) & (values[:, 1] <= values[:, 3])).all()
    assert len(rows(out / "surface.csv")) == 25
    lognormal = rows(out / "lognormal.csv")
    assert [(r["measure"], r["azimuth_deg"]) for r in lognormal] == [
        (name, azimuth) for name in ("pga_g", "pgv_pga_s") for azimuth in ("all", "0", "30")
    ]
    # A block turned away from the shaking is harder to overturn.
    medians = {r["azimuth_deg"]: float(r["median"]) for r in lognormal[:3]}
    assert medians["0"] < medians["30"]
    for name in ("overturning", "curve_pga_g", "curve_pgv_pga_s", "surface", "azimuth"):
        assert (out / "figures" / f"{name}.png").stat().st_size > 10_000
        assert (out / "figures" / f"{name}.pdf").exists()
    assert (
        "40 trials: 10 ground motions, 2 azimuths, 2 replicates" in (out / "report.md").read_text()
    )
    provenance = json.loads((out / "provenance.json").read_text())
    assert provenance["fragility"]["replicates"] == 2
    assert provenance["constants"]["fit"] == asdict(FIT)
    assert not (out / JOURNAL_FILE).exists()

    part = tmp_path / "part"
    from vsr2.fragility import run_fragility
    from vsr2.results import prepare_folder

    prepare_folder(part)
    run_fragility(load_fragility(path), part, threads=2)
    journal = (part / JOURNAL_FILE).read_bytes().splitlines(keepends=True)
    (part / JOURNAL_FILE).write_bytes(b"".join(journal[:20]) + b'{"torn')
    code = run(path, "--out", part, "--resume", "--threads", 2, "--quiet", "--no-figures")
    assert code in (0, 1)
    for name in ("plan.csv", "curve_pga_g.csv", "surface.csv", "lognormal.csv"):
        assert (part / name).read_bytes() == (out / name).read_bytes()


def test_effects_act_and_measures_stay_those_of_the_motion(study):
    from vsr2.fragility import run_fragility

    plain = run_fragility(study(), threads=1)
    gain = ("outcome:", "effects: {table_gain: {change: 0.15}, placement: {yaw: 5.0}}\noutcome:")
    more = run_fragility(study(gain), threads=1)
    np.testing.assert_array_equal(more.measures["pga_g"], plain.measures["pga_g"])
    assert more.overturned.sum() > plain.overturned.sum()
    # Every replicate draws again, and more of them leave the earlier ones as they are.
    third = run_fragility(study(gain, ("replicates: 2", "replicates: 3")), threads=1)
    kept = np.array([one.replicate < 2 for one in third.planned])
    for name in ("peak_tilt", "final_tilt"):
        np.testing.assert_array_equal(third.batch[name][kept], more.batch[name])


def test_killed_while_drawing_it_resumes_without_simulating(study, tmp_path, monkeypatch):
    import vsr2.report.fragility_page as report
    import vsr2.simulation.batch as batch

    study()
    path, out = tmp_path / "study.yaml", tmp_path / "out"

    def killed(*_):
        raise SystemExit(137)

    def none_left(trials, *_, **__):
        assert not trials

    with monkeypatch.context() as patch:
        patch.setattr(report, "write_fragility_report", killed)
        with pytest.raises(SystemExit):
            run(path, "--out", out, "--threads", 1, "--quiet")
    assert (out / "lognormal.csv").exists()
    assert not (out / "report.md").exists()
    with monkeypatch.context() as patch:
        patch.setattr(batch, "run_native", none_left)
        assert run(path, "--out", out, "--resume", "--quiet") in (0, 1)
    assert (out / "figures" / "surface.png").exists()
    assert (out / "report.md").exists()
    assert not (out / JOURNAL_FILE).exists()
