"""`vsr2 motion`: what it prints and writes."""

import json
from functools import partial

import numpy as np
import pytest

import command_line
from vsr2.errors import ConfigError, MotionError
from vsr2.motion import (
    STANDARD_GRAVITY,
    Record,
    cosine_motion,
    intensity_measures,
    read_record,
    write_record,
)

H = 1 / 800


run = partial(command_line.run, "motion")


@pytest.fixture
def pulse(tmp_path):
    motion = cosine_motion(0.05, 1.0, 0.001)
    record = Record("r", 0.001, displacement=np.pad(motion.displacement, 300))
    write_record(record, tmp_path / "pulse.csv")
    return tmp_path / "pulse.csv"


def test_info_prints_a_table_and_json(pulse, capsys):
    assert run("info", pulse, pulse) == 0
    header, first, second = capsys.readouterr().out.splitlines()
    assert header.split()[:3] == ["file", "pga_g", "pgv_m_s"]
    assert first == second
    assert run("info", pulse, "--json") == 0
    (reported,) = json.loads(capsys.readouterr().out)
    assert reported == {"file": str(pulse), **intensity_measures(read_record(pulse)).as_dict()}
    # x = A (1 - cos w t): the spline overshoots the acceleration's jump at both ends
    assert reported["pgv_m_s"] == pytest.approx(0.05 * 2 * np.pi, rel=1e-3)


def test_info_with_processing_and_units(tmp_path, capsys):
    t = np.arange(0, 20, 0.01)
    a = np.exp(-(((t - 10) / 2) ** 2)) * np.sin(2 * np.pi * 2 * t)
    path = tmp_path / "a.dat"
    path.write_text("".join(f"{x:.2f} {y:.8f}\n" for x, y in zip(t, a, strict=True)))
    with pytest.raises(MotionError, match="--units g"):
        run("info", path)
    arguments = ("--units", "g", "--filter", 0.1, 25, 3, "--baseline", 1, "--json")
    assert run("info", path, *arguments) == 0
    assert json.loads(capsys.readouterr().out)[0]["pga_g"] == pytest.approx(1, rel=0.02)


@pytest.mark.parametrize("values", [(25, 0.1, 3), ("a", 25, 3), (0.1, 25, 3.5), (0.1, 25, 99)])
def test_an_impossible_filter_is_refused(pulse, values):
    with pytest.raises(ConfigError, match=r"--filter .* for example --filter 0.1 25 3"):
        run("info", pulse, "--filter", *values)


def test_convert_without_processing_keeps_the_channels(tmp_path, capsys):
    values = np.sin(np.arange(50) * 0.2)
    source = tmp_path / "a.tab"
    source.write_text("TITLE\n50,0.005\n" + "".join(f"{v:.9f}\n" for v in values))
    assert run("convert", source, "--out", tmp_path / "b.csv", "--units", "cm/s") == 0
    record = read_record(tmp_path / "b.csv")
    np.testing.assert_allclose(record.velocity, values / 100, atol=1e-11)
    assert (record.displacement, record.acceleration) == (None, None)
    assert str(tmp_path / "b.csv") in capsys.readouterr().out


def test_convert_to_a_pga(pulse, tmp_path, capsys):
    target = tmp_path / "b.csv"
    assert (
        run("convert", pulse, "--out", target, "--scale-to-pga-g", 0.5, "--time-step", 0.002) == 0
    )
    record = read_record(target)
    assert record.sample_interval == 0.002
    assert np.abs(record.acceleration).max() == pytest.approx(0.5 * STANDARD_GRAVITY, rel=1e-12)
    assert "PGA 0.5 g" in capsys.readouterr().out
    assert run("convert", pulse, "--out", target, "--scale", -2, "--overwrite") == 0
    assert read_record(target).displacement.min() == pytest.approx(-0.2, rel=1e-6)


def test_convert_refuses_another_suffix(pulse, tmp_path):
    with pytest.raises(MotionError, match=r"written as \.csv"):
        run("convert", pulse, "--out", tmp_path / "b.txt")


def test_generate(tmp_path, capsys):
    target = tmp_path / "g.csv"
    wish = ("--pga-g", 0.3, "--pgv-pga-s", 0.08, "--duration", 6, "--seed", 4)
    assert run("generate", *wish, "--out", target) == 0
    first = target.read_bytes()
    assert "PGA 0.3 g" in capsys.readouterr().out
    assert run("generate", *wish, "--out", target, "--overwrite") == 0
    assert target.read_bytes() == first
    assert np.abs(read_record(target).acceleration).max() == pytest.approx(
        0.3 * STANDARD_GRAVITY, rel=1e-12
    )


def test_fuse_prints_the_agreement_and_writes_the_motion(tmp_path, capsys):
    t = np.arange(0, 12, H)
    w = 2 * np.pi * 3
    gauss = np.exp(-((t - 6) ** 2))
    x = 0.01 * gauss * np.sin(w * (t - 6))
    a = np.gradient(np.gradient(x, H), H)
    chance = np.random.default_rng(3)
    source = tmp_path / "table.csv"
    write_record(
        Record(
            "table",
            H,
            displacement=x + 5e-5 * chance.standard_normal(t.size),
            acceleration=a + 0.04 * chance.standard_normal(t.size),
        ),
        source,
    )
    assert run("fuse", source, "--out", tmp_path / "f.csv", "--json") == 0
    reported = json.loads(capsys.readouterr().out)
    assert reported["displacement_noise_m"] == pytest.approx(5e-5, rel=0.1)
    assert reported["acceleration_noise_m_s2"] == pytest.approx(0.04, rel=0.1)
    band = next(b for b in reported["bands"] if b["low_hz"] == 2)
    assert band["coherence"] > 0.95
    assert band["gain"] == pytest.approx(1, rel=0.05)
    fused = read_record(tmp_path / "f.csv")
    assert np.std(fused.displacement - x) < 2e-5
    assert fused.velocity is not None
    assert run("fuse", source, "--out", tmp_path / "f.csv", "--overwrite") == 0
    shown = capsys.readouterr().out
    assert "consistency: " in shown
    assert "coherence" in shown
    write_record(Record("r", H, displacement=x), source)
    with pytest.raises(MotionError, match="fusing needs both"):
        run("fuse", source, "--out", tmp_path / "f.csv")


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (("--filter", 30, 10, 3), r"^--filter 30 10 3: low \(30.0 Hz\) must be below high"),
        (("--filter", 0.1, 25, 30), r"^--filter 0.1 25 30: order: must be .*\(is 30\); give LOW"),
    ],
)
def test_an_impossible_filter_is_reported_without_words_of_the_library(pulse, arguments, match):
    with pytest.raises(ConfigError, match=match) as raised:
        run("info", pulse, *arguments)
    assert "Value error" not in str(raised.value)


@pytest.mark.parametrize("pga", ["-1", "0", "nan"])
def test_an_impossible_pga_is_reported_as_it_was_given(pulse, tmp_path, pga):
    with pytest.raises(MotionError, match=f"--scale-to-pga-g {pga}: give a PGA above 0, in g"):
        run("convert", pulse, "--out", tmp_path / "x.csv", f"--scale-to-pga-g={pga}")
    assert not (tmp_path / "x.csv").exists()


def test_fusing_names_no_key_of_a_study(pulse, tmp_path):
    with pytest.raises(MotionError, match="give a recording with both") as raised:
        run("fuse", pulse, "--out", tmp_path / "x.csv")
    assert "motion.channel" not in str(raised.value)
