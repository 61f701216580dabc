"""From the study's motion section to motions: the four modes, names, order, refusals."""

import pickle
import warnings
from dataclasses import replace

import numpy as np
import pytest
from pydantic import TypeAdapter

from vsr2.config.motion_source import Filter, MotionSource
from vsr2.errors import MotionError
from vsr2.motion import (
    STANDARD_GRAVITY,
    MotionWarning,
    Record,
    build_motions,
    build_recorded_motion,
    cosine_motion,
)

STEP = 0.001
RATE = 800
T = np.arange(8 * RATE + 1) / RATE
ENVELOPE = np.exp(-(((T - 4) / 1.0) ** 2))
X = 0.05 * ENVELOPE * np.sin(2 * np.pi * 2 * (T - 4))
A = np.gradient(np.gradient(X, T), T)


def source(**fields):
    return TypeAdapter(MotionSource).validate_python(fields)


def save(path, displacement=X, **arrays):
    np.savez(path, sample_interval_s=1 / RATE, displacement_m=displacement, **arrays)


def test_a_single_cosine_by_amplitude_and_frequency():
    (motion,) = build_motions(source(mode="single_cosine", amplitude=0.1, frequency=2.0), STEP)
    assert motion.kind == "cosine"
    assert motion.displacement.max() == pytest.approx(0.2)
    assert motion.duration == pytest.approx(0.5)
    assert "A = 0.1 m" in motion.source


def test_a_single_cosine_by_intensity_is_the_grid_of_one():
    (single,) = build_motions(source(mode="single_cosine", pga_g=0.3, pgv_pga_s=0.1), STEP)
    one = {"min": 0.3, "max": 0.3, "step": 1}
    (grid,) = build_motions(
        source(mode="grid_cosine", pga_g=one, pgv_pga_s={"min": 0.1, "max": 0.1, "step": 1}), STEP
    )
    assert single.name == grid.name
    assert single.sha256 == grid.sha256


def test_a_grid_has_every_pair_once_in_order():
    pga = {"min": 0.1, "max": 0.5, "step": 0.1}
    ratio = {"min": 0.05, "max": 0.2, "step": 0.05}
    motions = build_motions(source(mode="grid_cosine", pga_g=pga, pgv_pga_s=ratio), STEP)
    wanted = [(p, r) for p in (0.1, 0.2, 0.3, 0.4, 0.5) for r in (0.05, 0.1, 0.15, 0.2)]
    assert [m.name for m in motions] == [f"cosine_pga{p}g_pgv_pga{r}s" for p, r in wanted]
    for motion, (p, r) in zip(motions, wanted, strict=True):
        assert motion.pga_g == pytest.approx(p)
        # PGV falls between samples by at most 1 - cos(0.5 step / ratio)
        assert motion.pgv_pga_s == pytest.approx(r, rel=1e-4)


@pytest.mark.parametrize(
    ("pga", "ratio", "message"),
    [
        ((0.001, 1.0, 0.001), (0.001, 1.0, 0.001), "1000 values of pga_g times 1000"),
        ((0.01, 1.0, 0.01), (50.0, 99.0, 1.0), "samples in all motions"),
        ((0.1, 0.2, 0.1), (1e-4, 1e-4, 1.0), "raise PGV/PGA"),
    ],
)
def test_absurd_grids_are_refused(pga, ratio, message):
    keys = ("min", "max", "step")
    grid = source(
        mode="grid_cosine",
        pga_g=dict(zip(keys, pga, strict=True)),
        pgv_pga_s=dict(zip(keys, ratio, strict=True)),
    )
    with pytest.raises(MotionError, match=message):
        build_motions(grid, STEP)


def test_a_single_recording(tmp_path):
    path = tmp_path / "quake.npz"
    save(path)
    (motion,) = build_motions(source(mode="single_recording", file=path), STEP)
    assert motion.name == "quake"
    assert motion.kind == "recording"
    assert str(path) in motion.source
    assert "displacement channel, no filter, scale 1" in motion.source
    t = motion.times
    exact = 0.05 * np.exp(-((t - 4) ** 2)) * np.sin(2 * np.pi * 2 * (t - 4))
    # the record ends at 0.05 exp(-16), 6e-9 m; splines of 2 Hz at 800 Hz do not show
    np.testing.assert_allclose(motion.displacement[:-1], exact[:-1], rtol=0, atol=1e-8)
    assert motion.resampling_error < 1e-10
    assert motion.duration == pytest.approx(8.001)


def test_the_acceleration_channel_drives_the_same_motion():
    record = Record("r", 1 / RATE, displacement=X, acceleration=A)
    by_x = build_recorded_motion(record, STEP, channel="displacement")
    by_a = build_recorded_motion(record, STEP, channel="acceleration")
    # A is a finite difference of X, 1e-4 off at 2 Hz and 800 Hz: (w h)^2 / 6 and twice that
    np.testing.assert_allclose(by_a.displacement, by_x.displacement, rtol=0, atol=2e-4 * 0.05)
    assert "acceleration channel" in by_a.source
    assert build_recorded_motion(record, STEP).sha256 == by_x.sha256


def test_auto_takes_what_there_is():
    record = Record("r", 1 / RATE, acceleration=A)
    assert "acceleration channel" in build_recorded_motion(record, STEP).source


def test_the_velocity_channel_drives_the_same_motion():
    record = Record("r", 1 / RATE, displacement=X, velocity=np.gradient(X, T))
    by_x = build_recorded_motion(record, STEP)
    by_v = build_recorded_motion(record, STEP, channel="velocity")
    # a finite difference of 2 Hz at 800 Hz, (w h)^2 / 6
    np.testing.assert_allclose(by_v.displacement, by_x.displacement, rtol=0, atol=1e-4 * 0.05)
    assert "velocity channel" in by_v.source
    assert "displacement channel" in by_x.source
    alone = Record("r", 1 / RATE, velocity=record.velocity, acceleration=A)
    assert "velocity channel" in build_recorded_motion(alone, STEP).source


def test_a_target_pga_replaces_the_scale_but_its_sign():
    record = Record("r", 1 / RATE, displacement=X)
    plain = build_recorded_motion(record, STEP)
    for scale in (1.0, 5.0, -5.0):
        motion = build_recorded_motion(record, STEP, scale=scale)
        motion = motion.scaled_to_pga_g(4.0 / STANDARD_GRAVITY, name=motion.name)
        assert motion.peak_acceleration == pytest.approx(4.0, rel=1e-12)
        assert motion.name == "r"
        np.testing.assert_allclose(
            motion.displacement,
            np.sign(scale) * 4.0 / plain.peak_acceleration * plain.displacement,
            rtol=0,
            atol=1e-12,
        )


@pytest.mark.parametrize(("pga_g", "warned"), [(3.0, False), (3.1, True)])
def test_a_pga_that_no_earthquake_has_is_a_warning(pga_g, warned):
    asked = source(mode="single_cosine", pga_g=pga_g * (1 - 1e-9), pgv_pga_s=0.01)
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        build_motions(asked, STEP)
    assert [one.category for one in seen] == [MotionWarning] * warned
    assert all("PGA 3.1 g; 1 of 1 motion above 3 g" in str(one.message) for one in seen)


def test_a_baseline_is_part_of_the_chain():
    drift = 0.05 * (T / 8) ** 2
    drifting = Record("r", 1 / RATE, displacement=X + drift)
    motion = build_recorded_motion(drifting, STEP, baseline=2)
    assert "baseline of degree 2, no filter" in motion.source
    clean = build_recorded_motion(Record("r", 1 / RATE, displacement=X), STEP)
    # a wave of a second in eight is no parabola
    inside = slice(1000, -1000)
    difference = (motion.displacement - clean.displacement)[inside]
    assert np.ptp(difference) < 0.002


def test_a_study_gives_units_to_files_without(tmp_path):
    rows = "".join(f"{v:.10f}\n" for v in X[::4])
    (tmp_path / "a.tab").write_text(f"TITLE\n{X[::4].size},0.005\n{rows}")
    chosen = source(mode="all_recordings", folder=tmp_path, units="m")
    (motion,) = build_motions(chosen, STEP)
    assert motion.displacement.max() == pytest.approx(X.max(), rel=1e-3)
    with pytest.raises(MotionError, match=r"motion\.units"):
        build_motions(source(mode="single_recording", file=tmp_path / "a.tab"), STEP)


def test_a_study_can_ask_for_the_fused_channel(tmp_path):
    chance = np.random.default_rng(1)
    save(
        tmp_path / "table.npz",
        displacement=X + 5e-5 * chance.standard_normal(X.size),
        acceleration_m_s2=A + 0.04 * chance.standard_normal(X.size),
    )
    chosen = source(mode="single_recording", file=tmp_path / "table.npz", channel="fused")
    (motion,) = build_motions(chosen, STEP)
    assert "displacement and acceleration fused" in motion.source
    exact = np.interp(motion.times, T, X)
    error = motion.displacement - exact
    assert np.std(error) < 2.5e-5  # half the transducer's noise


@pytest.mark.parametrize("channel", ["displacement", "acceleration"])
def test_a_missing_channel_is_refused(channel):
    fields = {"acceleration": A} if channel == "displacement" else {"displacement": X}
    with pytest.raises(MotionError, match=f"has no {channel} channel; choose the channel"):
        build_recorded_motion(Record("r", 1 / RATE, **fields), STEP, channel=channel)


@pytest.mark.parametrize("channel", ["displacement", "acceleration"])
@pytest.mark.parametrize("chosen", [None, Filter()])
def test_building_is_linear_and_mirrors(channel, chosen):
    record = Record("r", 1 / RATE, displacement=X + 0.01, acceleration=A + 0.02)
    plain = build_recorded_motion(record, STEP, channel=channel, filter=chosen)
    scaled = build_recorded_motion(record, STEP, channel=channel, filter=chosen, scale=-2.0)
    # a factor of two is exact in every step
    np.testing.assert_allclose(scaled.displacement, -2 * plain.displacement, rtol=0, atol=1e-15)
    assert scaled.pgv_pga_s == pytest.approx(plain.pgv_pga_s)
    assert plain.displacement[0] == 0.0
    assert plain.velocity[-1] == plain.acceleration[-1] == 0.0


@pytest.mark.parametrize("step", [STEP, 0.003, 1 / RATE])
def test_the_peak_needs_no_acceleration(step):
    record = Record("r", 1 / RATE, displacement=X)
    for scaled in (lambda one: one, lambda one: one.scaled(-1.1).scaled(0.7)):
        found = scaled(build_recorded_motion(record, step, filter=Filter()))
        peak = found.peak_acceleration
        assert "acceleration" not in vars(found)
        assert peak == np.abs(found.acceleration).max() > 0


def test_the_filter_acts_at_the_records_own_sampling():
    noisy = X + 5e-5 * np.random.default_rng(2).standard_normal(X.size)
    record = Record("r", 1 / RATE, displacement=noisy)
    raw = build_recorded_motion(record, STEP)
    filtered = build_recorded_motion(record, STEP, filter=Filter())
    clean = build_recorded_motion(Record("r", 1 / RATE, displacement=X), STEP, filter=Filter())
    assert raw.peak_acceleration > 5 * clean.peak_acceleration
    assert filtered.peak_acceleration == pytest.approx(clean.peak_acceleration, rel=0.1)
    assert "band-pass 0.1-25 Hz order 3" in filtered.source
    with pytest.raises(MotionError, match="Nyquist frequency 400 Hz"):
        build_recorded_motion(record, STEP, filter=Filter(high=450.0))


def test_a_coarser_time_step_needs_the_filter():
    noisy = X + 5e-5 * np.random.default_rng(2).standard_normal(X.size)
    record = Record("r", 1 / RATE, displacement=noisy)
    with pytest.raises(MotionError, match=r"above 100 Hz.*motion.filter"):
        build_recorded_motion(record, 0.005)
    filtered = build_recorded_motion(record, 0.005, filter=Filter())
    assert filtered.peak_acceleration == pytest.approx(
        build_recorded_motion(record, STEP, filter=Filter()).peak_acceleration, rel=0.02
    )


@pytest.mark.parametrize("scale", [0.0, float("nan"), float("inf")])
def test_a_scale_that_makes_no_motion_is_refused(scale):
    with pytest.raises(MotionError, match="scale"):
        build_recorded_motion(Record("r", 1 / RATE, displacement=X), STEP, scale=scale)


def test_all_recordings_come_in_the_order_of_their_names(tmp_path):
    for name in ("b.npz", "a.npz", "C.npz", ".hidden.npz"):
        save(tmp_path / name)
    (tmp_path / "notes.md").write_text("x")
    (tmp_path / "folder.npz").mkdir()
    chosen = source(mode="all_recordings", folder=tmp_path, pattern="*.npz", scale=2.0)
    motions = build_motions(chosen, STEP)
    assert [m.name for m in motions] == ["C", "a", "b"]
    assert all("scale 2" in m.source for m in motions)


@pytest.mark.filterwarnings("ignore::vsr2.motion.MotionWarning")  # a motion of 1 m
def test_equal_stems_get_full_names(tmp_path):
    save(tmp_path / "a.npz")
    rows = "".join(f"{i / 100:.2f},{np.sin(i / 10) ** 3:.6f}\n" for i in range(100))
    (tmp_path / "a.csv").write_text("time_s,displacement_m\n" + rows)
    save(tmp_path / "b.npz")
    motions = build_motions(source(mode="all_recordings", folder=tmp_path), STEP)
    assert [m.name for m in motions] == ["a.csv", "a.npz", "b"]


def test_a_foreign_file_in_the_folder_is_named_with_the_remedy(tmp_path):
    save(tmp_path / "a.npz")
    (tmp_path / "README.md").write_text("x")
    with pytest.raises(MotionError, match=r"README\.md: unknown kind.*motion.pattern"):
        build_motions(source(mode="all_recordings", folder=tmp_path), STEP)


def test_no_match_names_folder_and_pattern(tmp_path):
    with pytest.raises(MotionError, match=r"no file matches the pattern '\*\.csv'") as caught:
        build_motions(source(mode="all_recordings", folder=tmp_path, pattern="*.csv"), STEP)
    assert str(tmp_path) in str(caught.value)
    with pytest.raises(MotionError, match="no such folder"):
        build_motions(source(mode="all_recordings", folder=tmp_path / "none"), STEP)
    with pytest.raises(MotionError, match="no such file"):
        build_motions(source(mode="single_recording", file=tmp_path / "none.csv"), STEP)


@pytest.mark.parametrize("chosen", [None, Filter()])
def test_an_offset_of_the_displacement_has_no_effect(chosen):
    here = Record("r", 1 / RATE, displacement=X)
    there = Record("r", 1 / RATE, displacement=X - 0.7)
    # the filter's poles near 0.1 Hz amplify the rounding of 0.7 by some ten thousands
    np.testing.assert_allclose(
        build_recorded_motion(there, STEP, filter=chosen).displacement,
        build_recorded_motion(here, STEP, filter=chosen).displacement,
        rtol=0,
        atol=1e-11,
    )


@pytest.mark.parametrize("factor", [1.0, -0.7])
def test_an_acceleration_that_is_not_kept_is_made_again(factor):
    record = Record("r", 1 / RATE, displacement=0.01 * np.sin(np.arange(4000) * 0.02) ** 4)
    motion = build_recorded_motion(record, 0.001, filter=Filter())
    short = motion.without_acceleration()
    assert "acceleration" not in vars(short)
    assert short.without_acceleration() is short
    assert short == motion
    both = [one.scaled(factor) for one in (motion, short)] if factor != 1 else [motion, short]
    for one in (both[1], pickle.loads(pickle.dumps(both[1])), replace(both[1], name=both[1].name)):
        np.testing.assert_array_equal(one.acceleration, both[0].acceleration)
        assert one.peak_acceleration == both[0].peak_acceleration
        assert one.source == both[0].source
    cosine = cosine_motion(0.01, 2.0, 0.001)
    assert cosine.without_acceleration() is cosine
