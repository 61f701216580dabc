"""Readers of formats that others write: PEER, columns, .tab, obspy's; and writing."""

import sys
from importlib.util import find_spec

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsr2.errors import MotionError
from vsr2.motion import (
    STANDARD_GRAVITY,
    Motion,
    Record,
    build_recorded_motion,
    cosine_motion,
    read_record,
    write_record,
)

N = 43
T = np.arange(N) * 0.01
WAVE = np.sin(np.arange(N) * 0.3) * np.exp(-np.arange(N) / 20)

needs_obspy = pytest.mark.skipif(
    find_spec("obspy") is None, reason="obspy is not installed: pip install vsr2[seismology]"
)


def write(folder, name, content):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


# --- PEER ---------------------------------------------------------------------------------------


def fortran(value):
    """`value` as Fortran's E12.4 without the leading zero: twelve wide with a minus sign."""
    mantissa, exponent = f"{abs(value):.3E}".split("E")
    digits = mantissa.replace(".", "")
    sign = "-" if value < 0 else " "
    return f"{sign}.{digits}E{int(exponent) + (value != 0):+03d}"


def peer(
    values=WAVE,
    title="ACCELERATION TIME SERIES IN UNITS OF G",
    header="NPTS= {n:6d}, DT= .01000 SEC",
    width=5,
):
    rows = [
        "".join(fortran(v) for v in values[i : i + width]) for i in range(0, len(values), width)
    ]
    lines = ["PEER NGA STRONG MOTION DATABASE RECORD", "Somewhere, 1/2/2003, Station, 90", title]
    return "\n".join([*lines, header.format(n=len(values)), *rows]) + "\n"


HEADERS = [
    "NPTS= {n:6d}, DT= .01000 SEC",
    "NPTS=  {n}, DT=   .0100 SEC,",
    "{n:5d}    0.0100    NPTS, DT",
    "{n} .01 NPTS, DT",
]


@pytest.mark.parametrize("header", HEADERS)
@pytest.mark.parametrize("width", [1, 5, 8])
def test_peer_headers_of_both_styles_and_run_together_columns(tmp_path, header, width):
    content = peer(header=header, width=width)
    if width > 1:
        assert any("-" in line[1:] and " " not in line[1:13] for line in content.splitlines()[4:])
    record = read_record(write(tmp_path, "RSN1.AT2", content))
    assert record.sample_interval == 0.01
    assert record.displacement is None
    # four printed digits
    np.testing.assert_allclose(record.acceleration, WAVE * STANDARD_GRAVITY, rtol=6e-4, atol=1e-12)


@pytest.mark.parametrize(
    ("suffix", "title", "channel", "size"),
    [
        ("AT2", "ACCELERATION TIME SERIES IN UNITS OF G", "acceleration", STANDARD_GRAVITY),
        ("at2", "ACCELERATION TIME HISTORY IN UNITS OF CM/SEC/SEC", "acceleration", 0.01),
        ("AT2", "ACCELERATION (GAL) IN UNITS OF GAL", "acceleration", 0.01),
        ("VT2", "VELOCITY TIME SERIES IN UNITS OF CM/S", "velocity", 0.01),
        ("VT2", "VELOCITY TIME HISTORY IN UNITS OF CM/SEC.", "velocity", 0.01),
        ("DT2", "DISPLACEMENT TIME SERIES IN UNITS OF CM", "displacement", 0.01),
        ("txt", "DISPLACEMENT TIME SERIES IN UNITS OF CM", "displacement", 0.01),
        ("", "VELOCITY TIME SERIES IN UNITS OF CM/S", "velocity", 0.01),
    ],
)
def test_peer_units_come_from_the_header(tmp_path, suffix, title, channel, size):
    record = read_record(write(tmp_path, f"a.{suffix}".rstrip("."), peer(title=title)))
    np.testing.assert_allclose(getattr(record, channel), WAVE * size, rtol=6e-4, atol=1e-12)
    others = {"displacement", "velocity", "acceleration"} - {channel}
    assert all(getattr(record, other) is None for other in others)


def test_a_peer_header_without_units_needs_them(tmp_path):
    path = write(tmp_path, "a.VT2", peer(title="VELOCITY TIME HISTORY"))
    with pytest.raises(MotionError, match=r"a\.VT2.*carries no units.*motion\.units.*--units"):
        read_record(path)
    np.testing.assert_allclose(
        read_record(path, units="mm/s").velocity, WAVE / 1000, rtol=6e-4, atol=1e-12
    )
    with pytest.raises(MotionError, match=r"\.vt2 file holds velocity, units='g' is acceleration"):
        read_record(path, units="g")


def with_line(index, line):
    lines = peer().splitlines()
    lines[index] = line
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (with_line(3, "43 points every 0.01"), "no line `NPTS="),
        (with_line(3, "NPTS= 44, DT= .01 SEC"), "43 of the 44 samples that NPTS promises"),
        (with_line(3, "NPTS= 42, DT= .01 SEC"), "more than the 42 samples"),
        (with_line(3, "NPTS= 999999999, DT= .01 SEC"), "row 4: NPTS is 999999999, outside 1 to"),
        (with_line(3, "NPTS= 0, DT= .01 SEC"), "NPTS is 0, outside 1 to .*; correct it"),
        (with_line(3, "NPTS= 43, DT= 5. SEC"), "sampling interval 5 s lies outside"),
        (with_line(2, "VELOCITY TIME SERIES IN UNITS OF CM/S"), "row 3: .* does not fit a accel"),
        (with_line(2, "ACCELERATION TIME SERIES IN UNITS OF FURLONG"), "row 3: .*FURLONG"),
        (with_line(6, " .1234E-03 ******"), r"row 7: '\*\*\*\*\*\*' is no finite number"),
        (with_line(6, " .1234E-03.5678E-03"), "row 7: '.1234E-03.5678E-03' is no finite"),
        (with_line(6, " .1234E+999"), "row 7"),
        (with_line(6, " nan 1"), "row 7: 'nan 1' is no finite"),
        (with_line(6, "1" * 20_000), "row 7: 20000 characters"),
    ],
)
def test_unusable_peer_files_are_refused_with_row_and_value(tmp_path, content, message):
    with pytest.raises(MotionError, match=message) as caught:
        read_record(write(tmp_path, "bad.AT2", content))
    assert "bad.AT2" in str(caught.value)


@pytest.mark.parametrize("units", ["g", "m/s"])
def test_units_given_beside_the_headers_must_agree(tmp_path, units):
    path = write(tmp_path, "a.AT2", peer())
    if units == "g":
        assert read_record(path, units=units).size == N
    else:
        with pytest.raises(MotionError, match="the header says g, units='m/s' was given"):
            read_record(path, units=units)


@given(values=st.lists(st.floats(-9, 9), min_size=16, max_size=60))
def test_peer_samples_are_read_back_whatever_their_signs(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("peer") / "a.AT2"
    path.write_text(peer(values=values))
    read = read_record(path).acceleration / STANDARD_GRAVITY
    # numbers below 1e-99 lose their exponent's third digit in the printing, as in Fortran
    wanted = np.where(np.abs(values) < 1e-98, 0, values)
    np.testing.assert_allclose(np.where(np.abs(read) < 1e-98, 0, read), wanted, rtol=6e-4)


# --- two columns --------------------------------------------------------------------------------


@pytest.mark.parametrize("separator", [" ", "   ", "\t", ",", ", ", ";"])
@pytest.mark.parametrize("head", ["", "# time value\n", "Time Acc\n", "% a\n! b\ntime,acc\n"])
def test_two_columns(tmp_path, separator, head):
    rows = "".join(f"{t:.2f}{separator}{v:.8e}\n" for t, v in zip(T, WAVE, strict=True))
    record = read_record(write(tmp_path, "a.dat", head + rows), units="cm/s^2")
    assert record.sample_interval == 0.01
    np.testing.assert_allclose(record.acceleration, WAVE / 100, rtol=1e-7)


@pytest.mark.parametrize(
    ("units", "channel", "size"),
    [
        ("g", "acceleration", STANDARD_GRAVITY),
        ("mm/s^2", "acceleration", 1e-3),
        ("m/s", "velocity", 1.0),
        ("in", "displacement", 0.0254),
        ("mm", "displacement", 1e-3),
    ],
)
def test_units_tell_the_quantity(tmp_path, units, channel, size):
    rows = "".join(f"{t:.2f} {v:.9f}\n" for t, v in zip(T, WAVE, strict=True))
    record = read_record(write(tmp_path, "a.txt", rows), units=units)
    np.testing.assert_allclose(getattr(record, channel), WAVE * size, atol=1e-8)


def test_absent_units_are_an_error_that_names_the_remedy(tmp_path):
    rows = "".join(f"{t:.2f} {v:.9f}\n" for t, v in zip(T, WAVE, strict=True))
    with pytest.raises(MotionError, match=r"carries no units: give them.*units='g'.*--units g"):
        read_record(write(tmp_path, "a.dat", rows))
    with pytest.raises(MotionError, match="units 'furlong' are unknown; known: g, m/s"):
        read_record(write(tmp_path, "a.dat", rows), units="furlong")


def test_units_beside_a_format_with_units_are_refused(tmp_path):
    write_record(Record("r", 0.01, displacement=WAVE), tmp_path / "a.csv")
    with pytest.raises(MotionError, match=r"carries its own units.*remove it"):
        read_record(tmp_path / "a.csv", units="m")


def test_a_forced_format(tmp_path):
    rows = "".join(f"{t:.2f},{v:.9f}\n" for t, v in zip(T, WAVE, strict=True))
    path = write(tmp_path, "a.csv", rows)
    with pytest.raises(MotionError, match="by the format `columns`"):
        read_record(path)
    assert read_record(path, format="columns", units="m").size == N
    with pytest.raises(MotionError, match="format 'xls' is unknown; known: csv"):
        read_record(path, format="xls")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rows: [*rows[:5], "0.05", *rows[6:]], "row 6: 1 column, expected 2"),
        (lambda rows: [*rows[:5], "0.05 x", *rows[6:]], "row 6, column 2: 'x' is not a number"),
        (lambda rows: rows[:5] + rows[6:], "fill the gaps"),
        (lambda rows: rows[:9], "9 samples; a record needs at least 16"),
        (lambda _: ["# only"], "0 samples"),
    ],
)
def test_unusable_columns_are_refused(tmp_path, change, message):
    rows = [f"{t:.2f} {v:.9f}" for t, v in zip(T, WAVE, strict=True)]
    with pytest.raises(MotionError, match=message):
        read_record(write(tmp_path, "a.dat", "\n".join(change(rows)) + "\n"), units="m")


# --- the original's .tab ------------------------------------------------------------------------

VALUES = "".join(f"{v:.10f}\n" for v in WAVE)
TABS = {
    "title": f"SOMEWHERE ST090 Earthquake\n{N},0.01\n{VALUES}",
    "points": f"# number of velocity points: {N}, dt: 0.01\n{VALUES}",
    "table": "ground_motion_id\ttime\tvelocity\n"
    + "".join(f"1\t{t:.6f}\t{v:.10f}\n" for t, v in zip(T, WAVE, strict=True)),
}


@pytest.mark.parametrize("form", TABS)
def test_the_originals_tab_is_read_by_its_header(tmp_path, form):
    path = write(tmp_path, "Earthquake-1g.tab", TABS[form])
    with pytest.raises(MotionError, match=r"velocities in m/s.*carries no units"):
        read_record(path)
    record = read_record(path, units="m/s")
    assert record.sample_interval == pytest.approx(0.01, rel=1e-12)
    np.testing.assert_allclose(record.velocity, WAVE, atol=1e-10)


def test_a_tab_header_holds_against_the_units(tmp_path):
    for form in ("points", "table"):
        path = write(tmp_path, "a.tab", TABS[form])
        with pytest.raises(MotionError, match="row 1: holds velocity, units='m' is displacement"):
            read_record(path, units="m")
    # a title tells no quantity
    path = write(tmp_path, "a.tab", TABS["title"])
    np.testing.assert_allclose(read_record(path, units="m").displacement, WAVE, atol=1e-10)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (TABS["title"].replace(f"{N},0.01", "44,0.01"), "promises 44 samples, the file holds 43"),
        (TABS["points"].replace(str(N), "40"), "promises 40 samples, the file holds 43"),
        (TABS["title"].replace(",0.01", ",0..1"), "row 2, column 2: '0..1' is not a number"),
        (TABS["title"].replace(f"{N},", "999999999,"), "at most"),
        (VALUES, "no header of the original"),
        ("only a title\n", "no header of the original"),
        (TABS["table"].replace("1\t0.4", "2\t0.4"), "a second ground motion, id 2, after id 1"),
        (TABS["points"] + "x\n", "'x' is not a number"),
        (TABS["points"].replace("dt: 0.01", "dt: 7"), "sampling interval 7 s"),
    ],
)
def test_unusable_tabs_are_refused(tmp_path, content, message):
    with pytest.raises(MotionError, match=message):
        read_record(write(tmp_path, "a.tab", content), units="m/s")


def test_a_velocity_record_drives(tmp_path):
    """The pulse x = A (1 - cos w t) from its velocity alone."""
    pulse = cosine_motion(0.05, 1.0, 0.005)
    velocity = np.pad(pulse.velocity, 100)
    rows = "".join(f"{v:.10f}\n" for v in velocity)
    content = f"PULSE\n{velocity.size},0.005\n{rows}"
    record = read_record(write(tmp_path, "a.tab", content), units="m/s")
    motion = build_recorded_motion(record, 0.001)
    assert "velocity channel" in motion.source
    # cubic splines through 200 samples a period, with a kink in velocity's slope at both ends
    assert motion.displacement.max() == pytest.approx(0.1, rel=1e-4)
    assert motion.displacement[-1] == pytest.approx(0.0, abs=1e-6)


# --- obspy --------------------------------------------------------------------------------------


def trace(values):
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import obspy

        return obspy.Trace(
            np.asarray(values, dtype=np.float32), {"delta": 0.01, "station": "A", "channel": "HNX"}
        )


def stream(*traces):
    import obspy

    return obspy.Stream(list(traces))


def save(stream, path, format):
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        stream.write(str(path), format=format)


@needs_obspy
def test_traces_that_overlap_are_no_gap():
    rise = np.arange(100.0)
    one, other = trace(rise), trace(rise)
    other.stats.starttime += 0.9
    with pytest.raises(MotionError, match="traces overlap by 10 and differ there"):
        Motion.from_obspy(stream(one, other), "m/s^2")
    other.stats.starttime += 0.2
    with pytest.raises(MotionError, match=r"10 samples are missing \(a gap\)"):
        Motion.from_obspy(stream(one, other), "m/s^2")
    with pytest.raises(MotionError, match="holds no trace"):
        Motion.from_obspy(stream(), "m/s^2")


KNET = """\
Origin Time       2000/01/01 00:00:00
Lat.              35.0
Long.             135.0
Depth. (km)       10
Mag.              5.0
Station Code      AAA001
Station Lat.      35.0
Station Long.     135.0
Station Height(m) 10
Record Time       2000/01/01 00:00:15
Sampling Freq(Hz) 100Hz
Duration Time(s)  1
Dir.              E-W
Scale Factor      2000(gal)/8388608
Max. Acc. (gal)   10.0
Last Correction   2000/01/01 00:00:15
Memo.
"""


@needs_obspy
@pytest.mark.parametrize(("suffix", "format"), [("mseed", "MSEED"), ("sac", "SAC")])
def test_miniseed_and_sac(tmp_path, suffix, format):
    path = tmp_path / f"a.{suffix}"
    save(trace(WAVE), path, format)
    with pytest.raises(MotionError, match="carries no units"):
        read_record(path)
    record = read_record(path, units="cm/s^2")
    assert record.sample_interval == pytest.approx(0.01, rel=1e-6)
    np.testing.assert_allclose(record.acceleration, WAVE / 100, rtol=1e-6, atol=1e-12)


@needs_obspy
def test_knet_carries_its_scale(tmp_path):
    counts = np.round(1e5 * WAVE).astype(int)
    rows = [" ".join(f"{c:8d}" for c in counts[i : i + 8]) for i in range(0, N, 8)]
    path = write(tmp_path, "AAA0010001010000.EW", KNET + "\n".join(rows) + "\n")
    record = read_record(path)
    # gal = counts times 2000 / 8388608
    np.testing.assert_allclose(record.acceleration, counts * 2000 / 8388608 * 0.01, rtol=1e-9)
    with pytest.raises(MotionError, match="carries its own units"):
        read_record(path, units="g")
    with pytest.raises(MotionError, match="does not start with 'Origin Time'"):
        read_record(write(tmp_path, "b.NS2", "x" + KNET))


@needs_obspy
def test_several_channels_and_gaps_are_refused(tmp_path):
    one, two = trace(WAVE), trace(WAVE)
    two.stats.channel = "HNY"
    save(stream(one, two), tmp_path / "a.mseed", "MSEED")
    with pytest.raises(MotionError, match=r"2 channels \(A\.\.HNX, A\.\.HNY\)"):
        read_record(tmp_path / "a.mseed", units="m")
    late = trace(WAVE)
    late.stats.starttime += 5
    save(stream(one, late), tmp_path / "b.mseed", "MSEED")
    with pytest.raises(MotionError, match="457 samples are missing"):
        read_record(tmp_path / "b.mseed", units="m")


def test_absent_obspy_is_reported_with_the_remedy(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "obspy", None)
    with pytest.raises(MotionError, match=r"pip install vsr2\[seismology\]"):
        read_record(write(tmp_path, "a.mseed", b"000001D "), units="m")


# --- writing ------------------------------------------------------------------------------------

real = st.floats(-900, 900)


@given(
    values=st.lists(st.tuples(real, real), min_size=16, max_size=40),
    interval=st.sampled_from([0.001, 0.00125, 0.005, 1 / 300, 0.02]),
)
def test_what_is_written_is_read_to_the_last_bit(tmp_path_factory, values, interval):
    path = tmp_path_factory.mktemp("write") / "a.csv"
    x, v = np.array(values).T
    write_record(Record("r", interval, displacement=x, velocity=v), path, note="two\nlines")
    record = read_record(path)
    np.testing.assert_array_equal(record.displacement, x)
    np.testing.assert_array_equal(record.velocity, v)
    assert record.acceleration is None
    assert record.sample_interval == pytest.approx(interval, rel=1e-9)


def test_a_written_motion_drives_the_same(tmp_path):
    motion = cosine_motion(0.05, 2.0, 0.001)
    write_record(motion, tmp_path / "a.csv")
    again = build_recorded_motion(read_record(tmp_path / "a.csv"), 0.001)
    np.testing.assert_array_equal(again.displacement[:-1], motion.displacement)


@pytest.mark.parametrize("name", ["a.txt", "missing/a.csv", "nul\0.csv"])
def test_unwritable_targets_are_refused(tmp_path, name):
    with pytest.raises(MotionError, match=r"as \.csv|cannot be written"):
        write_record(Record("r", 0.01, displacement=WAVE), tmp_path / name)
