"""Two components of one record along azimuths, against closed forms."""

import numpy as np
import pytest

from vsr2.cli.main import main
from vsr2.errors import MotionError
from vsr2.motion import (
    Record,
    intensity_measures,
    read_record,
    rotated,
    rotd,
    rotd_pga_g,
    write_record,
)

TIME = np.arange(0, 4, 0.005)


def records(first, second, **other):
    return (
        Record("a", 0.005, acceleration=first),
        Record("b", other.get("interval", 0.005), acceleration=second),
    )


def test_a_motion_on_a_line_has_the_line_s_peaks():
    # a(t) along 0 degrees: |cos| of the azimuth, whose median over 180 azimuths is cos 45 degrees.
    pulse = np.sin(2 * np.pi * TIME)
    half, full = rotd(pulse, 0 * pulse)
    assert full == pytest.approx(np.abs(pulse).max(), rel=1e-12)
    # The 180 azimuths stand one degree apart; amid 45 degrees that is 0.5 degree of cos, 0.9 %.
    assert half == pytest.approx(np.sqrt(0.5), rel=0.009)


def test_a_circle_has_one_peak_at_all_azimuths():
    circle = np.cos(2 * np.pi * TIME), np.sin(2 * np.pi * TIME)
    # 200 samples a turn come within 0.9 degree of every azimuth: 1 - cos(0.9 degree) = 1.3e-4.
    assert rotd(*circle) == pytest.approx([1.0, 1.0], abs=1.3e-4)


def test_rotd_does_not_depend_on_the_sensor():
    rng = np.random.default_rng(2)
    one = rng.standard_normal(400)
    two = rng.standard_normal(400)
    turn = np.radians(37.0)  # whole degrees, so that the same azimuths come back
    turned = one * np.cos(turn) + two * np.sin(turn), two * np.cos(turn) - one * np.sin(turn)
    assert rotd(*turned, [16, 50, 84, 100]) == pytest.approx(rotd(one, two, [16, 50, 84, 100]))


def test_azimuths_0_and_90_are_the_components():
    first, second = records(np.sin(TIME), np.cos(3 * TIME))
    assert np.array_equal(rotated(first, second, 0).acceleration, first.acceleration)
    # cos(90 degrees) is 6e-17 in floating point.
    assert rotated(first, second, 90).acceleration == pytest.approx(second.acceleration, abs=1e-15)
    assert rotated(first, second, 180).acceleration == pytest.approx(-first.acceleration)


def test_rotd_of_the_pga_is_that_of_the_rotated_records():
    first, second = records(np.sin(5 * TIME), np.cos(3 * TIME))
    peaks = [intensity_measures(rotated(first, second, a)).pga_g for a in range(180)]
    expected = [np.median(peaks), np.max(peaks)]
    assert rotd_pga_g(first, second) == pytest.approx(expected)


def test_the_longer_component_is_cut():
    first, second = records(np.sin(TIME), np.cos(TIME)[:500])
    assert rotated(first, second, 45).size == 500


def test_components_that_do_not_go_together_are_refused():
    wave = np.sin(TIME)
    with pytest.raises(MotionError, match=r"every 0.005 s and .* every 0.01 s"):
        rotated(*records(wave, wave, interval=0.01), 30)
    with pytest.raises(MotionError, match="one channel in common"):
        rotated(Record("a", 0.005, acceleration=wave), Record("b", 0.005, velocity=wave), 30)
    with pytest.raises(MotionError, match="azimuth nan"):
        rotated(*records(wave, wave), float("nan"))
    with pytest.raises(MotionError, match="one length"):
        rotd(wave, wave[:-1])


def test_the_verb_writes_a_record_of_each_azimuth(tmp_path, capsys):
    first, second = records(np.sin(TIME), 0.5 * np.cos(3 * TIME))
    for record in (first, second):
        write_record(record, tmp_path / f"{record.name}.csv")
    files = [str(tmp_path / name) for name in ("a.csv", "b.csv")]
    assert (
        main(
            ["motion", "rotate", *files, "--out", str(tmp_path / "turned"), "--azimuths", "0", "45"]
        )
        == 0
    )
    said = capsys.readouterr().out
    assert f"{rotd_pga_g(first, second)[1]:.4g} g" in said
    assert {path.name for path in (tmp_path / "turned").iterdir()} == {
        "a_0deg.csv",
        "a_45deg.csv",
    }
    written = read_record(tmp_path / "turned" / "a_45deg.csv")
    assert np.array_equal(written.acceleration, rotated(first, second, 45).acceleration)
