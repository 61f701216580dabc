"""Readers: what they read, in which unit and sign, and how they refuse."""

import hashlib
import io
import pickle
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from vsr2.errors import MotionError
from vsr2.motion import STANDARD_GRAVITY, Record, build_recorded_motion, on_file, read_record
from vsr2.motion.recording import MAX_FILE_BYTES, METRES_PER_VOLT

N = 40
X = np.sin(np.arange(N) * 0.3)
A = np.cos(np.arange(N) * 0.3)


def csv_text(interval=0.005, header="time_s,displacement_m", count=N):
    return header + "\n" + "".join(f"{i * interval:.6f},{X[i % N]:.9f}\n" for i in range(count))


def write(folder, name, content):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def with_row(index, row):
    """The neutral file with its `index`-th line replaced (0 is the header)."""
    lines = csv_text().splitlines()
    lines[index] = row
    return "\n".join(lines) + "\n"


def laboratory_text(interval=0.00125, count=N, digits=6, start=0.0):
    rows = ["Time [s] - Plot 0\tAmplitude - Plot 0\t" * 4]
    for i in range(count):
        t = f"{start + i * interval:.{digits}g}"
        rows.append(f"{t}\t{A[i % N]:.6g}\t{t}\t0.1\t{t}\t{100 * X[i % N]:.6g}\t{t}\t0.2\t")
    return "\r\n".join(rows) + "\r\n"


# --- reading ------------------------------------------------------------------------------------


def test_neutral_csv(tmp_path):
    content = "# a comment\n# another\n" + csv_text()
    path = write(tmp_path, "quake.csv", content)
    record = read_record(path)
    assert record.name == "quake"
    assert record.sample_interval == 0.005
    assert record.duration == pytest.approx((N - 1) * 0.005)
    assert record.acceleration is None
    np.testing.assert_allclose(record.displacement, X, atol=1e-9)
    assert record.source == str(path)
    assert record.sha256 == hashlib.sha256(content.encode()).hexdigest()


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda text: "\ufeff" + text, id="byte order mark"),
        pytest.param(lambda text: text.replace("\n", "\r\n"), id="carriage returns"),
        pytest.param(lambda text: text + "\n\n", id="empty lines at the end"),
        pytest.param(lambda text: text.replace(",", " , "), id="spaces"),
    ],
)
def test_harmless_differences_of_text_are_read(tmp_path, change):
    record = read_record(write(tmp_path, "a.csv", change(csv_text())))
    np.testing.assert_allclose(record.displacement, X, atol=1e-9)


def test_csv_columns_go_by_name(tmp_path):
    header = "acceleration_m_s2,time_s,displacement_m\n"
    rows = "".join(f"{A[i]:.9f},{i * 0.01:.2f},{X[i]:.9f}\n" for i in range(N))
    record = read_record(write(tmp_path, "b.csv", header + rows))
    assert record.sample_interval == 0.01
    np.testing.assert_allclose(record.acceleration, A, atol=1e-9)
    np.testing.assert_allclose(record.displacement, X, atol=1e-9)


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_neutral_npz(tmp_path, save):
    path = tmp_path / "c.npz"
    save(path, sample_interval_s=0.005, displacement_m=X, acceleration_m_s2=A.astype(np.float32))
    record = read_record(path)
    np.testing.assert_array_equal(record.displacement, X)
    np.testing.assert_allclose(record.acceleration, A, atol=1e-7)


def test_laboratory_npz_gives_si_units_with_both_channels_along_the_displacement(tmp_path):
    path = tmp_path / "Test001.npz"
    np.savez(path, sample_interval_s=0.00125, displacement_volt=100 * X, acceleration_g=A)
    record = read_record(path)
    np.testing.assert_allclose(record.displacement, 100 * X * 5.9797e-4 * 0.0254)
    np.testing.assert_allclose(record.acceleration, -A * STANDARD_GRAVITY)


def test_laboratory_text(tmp_path):
    record = read_record(write(tmp_path, "Test001.txt", laboratory_text()))
    assert record.sample_interval == 0.00125
    np.testing.assert_allclose(record.displacement, 100 * X * METRES_PER_VOLT, atol=1e-8)
    np.testing.assert_allclose(record.acceleration, -A * STANDARD_GRAVITY, atol=1e-4)


@pytest.mark.parametrize("start", [0.0, 38.0, 120.0])
def test_the_rounding_of_six_digits_does_not_shift_the_interval(tmp_path, start):
    path = write(tmp_path, "long.txt", laboratory_text(count=4000, start=start))
    assert read_record(path).sample_interval == 0.00125


def test_an_interval_that_is_no_integer_rate_is_kept(tmp_path):
    text = "time_s,displacement_m\n" + "".join(f"{i * 0.0123:.9f},{X[i]}\n" for i in range(N))
    assert read_record(write(tmp_path, "d.csv", text)).sample_interval == pytest.approx(
        0.0123, rel=1e-9
    )


# --- refusing -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty"),
        ("\n\n\n", "empty"),
        ("# only a comment\n", "header"),
        (csv_text(header="time,displacement_m"), "row 1: header 'time,displacement_m'"),
        (csv_text(header="time_s,displacement_mm"), "convert"),
        (csv_text(header="time_s,time_s"), "header"),
        (csv_text(header="displacement_m,acceleration_m_s2"), "header"),
        (csv_text(header="time_s"), "header"),
        ("# c\n" + csv_text(header="t,x"), "row 2: header"),
        (with_row(5, "0.020000"), "row 6: 1 column, expected 2"),
        (with_row(5, "0.020000,1,2"), "row 6: 3 columns, expected 2"),
        (with_row(5, ""), "row 6: 1 column"),
        (with_row(5, "0.020000,abc"), "row 6, column 2: 'abc' is not a number"),
        (with_row(5, "0.020000,1_0"), "row 6, column 2: '1_0' is not a number"),
        (with_row(5, "0.020000,nan"), "row 6, column 2: 'nan' is not finite"),
        (with_row(5, "inf,0.1"), "row 6, column 1: 'inf' is not finite"),
        (with_row(5, "0.020000,1e999"), "row 6, column 2: '1e999' is not finite"),
        (with_row(5, "0.020000,2000"), r"2000 m at sample 4.*check the unit"),
        (with_row(5, "0.014000,0.1"), "row 6: time 0.014 s does not come after 0.015 s"),
        (with_row(5, "0.015000,0.1"), "row 6: time 0.015 s does not come after"),
        (with_row(5, "0.018000,0.1"), "row 6: time 0.018 s, expected 0.02 s at a uniform 0.005 s"),
        (with_row(40, "1e300,0.1"), "row 41: time 1e.300 s"),
        (with_row(3, "0.01,1" + "0" * 20_000), "row 4: 20006 characters"),
        (csv_text(count=10), "10 samples; a record needs at least 16"),
        (csv_text(interval=5.0), "sampling interval 5 s lies outside"),
        (csv_text().replace(",", ";"), "header"),
        (b"\xff\xfe" + csv_text().encode("utf-16-le"), "byte 0 is not UTF-8"),
    ],
)
def test_unusable_csv_is_refused_with_file_row_and_value(tmp_path, text, message):
    path = write(tmp_path, "bad.csv", text)
    with pytest.raises(MotionError, match=message) as caught:
        read_record(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("lost", [3, 20, 38])
@pytest.mark.parametrize("maker", [csv_text, laboratory_text])
def test_a_lost_sample_is_found(tmp_path, lost, maker):
    lines = maker().splitlines()
    del lines[lost]
    suffix = "csv" if maker is csv_text else "txt"
    with pytest.raises(MotionError, match="fill the gaps"):
        read_record(write(tmp_path, f"gap.{suffix}", "\n".join(lines)))


@pytest.mark.parametrize("digits", [6, 9])
def test_a_lost_sample_is_found_where_six_digits_hardly_tell(tmp_path, digits):
    lines = laboratory_text(count=4000, start=120.0, digits=digits).splitlines()
    del lines[2000]
    with pytest.raises(MotionError, match="fill the gaps"):
        read_record(write(tmp_path, "gap.txt", "\n".join(lines)))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("hello\n" + laboratory_text(), "not the laboratory's header"),
        (laboratory_text().replace("\t0.2\t", "\t"), "row 2: 7 columns, expected 8"),
        (laboratory_text().replace("0.0025\t0.1", "0.0024\t0.1"), "row 4: the time in column 3"),
        ("Time [s]\n", "0 samples"),
    ],
)
def test_unusable_laboratory_text_is_refused(tmp_path, text, message):
    with pytest.raises(MotionError, match=message):
        read_record(write(tmp_path, "bad.txt", text))


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"displacement_m": X}, "expected sample_interval_s"),
        ({"sample_interval_s": 0.005}, "expected sample_interval_s with"),
        ({"sample_interval_s": 0.005, "displacement_m": X, "acceleration_g": A}, "expected"),
        ({"sample_interval_s": 0.005, "displacement_m": X, "extra": A}, "extra"),
        ({"sample_interval_s": [0.005, 1], "displacement_m": X}, "one number"),
        ({"sample_interval_s": 0.0, "displacement_m": X}, "lies outside"),
        ({"sample_interval_s": np.nan, "displacement_m": X}, "lies outside"),
        ({"sample_interval_s": 0.005, "displacement_m": X[:5]}, "16 to"),
        ({"sample_interval_s": 0.005, "displacement_m": X[:0]}, r"shape \(0,\)"),
        ({"sample_interval_s": 0.005, "displacement_m": X.reshape(2, -1)}, "shape"),
        ({"sample_interval_s": 0.005, "displacement_m": X + 1j}, "complex128"),
        ({"sample_interval_s": 0.005, "displacement_m": X.astype(str)}, "real numbers"),
        ({"sample_interval_s": 0.005, "displacement_m": X.astype(object)}, "object"),
        (
            {"sample_interval_s": 0.005, "displacement_m": X, "acceleration_m_s2": A[:-1]},
            "same number",
        ),
        (
            {"sample_interval_s": 0.005, "displacement_m": np.where(X > 0.9, np.nan, X)},
            "nan m at sample 4",
        ),
        (
            {"sample_interval_s": 0.005, "displacement_volt": np.full(20, 1e308)},
            "check the unit|cut the record",
        ),
    ],
)
def test_unusable_npz_is_refused(tmp_path, arrays, message):
    path = tmp_path / "bad.npz"
    np.savez(path, **arrays)
    with pytest.raises(MotionError, match=message) as caught:
        read_record(path)
    assert str(path) in str(caught.value)


def npz_with_header(header: dict, data: bytes, version=(1, 0)) -> bytes:
    def member(header, data):
        buffer = io.BytesIO()
        write = np.lib.format.write_array_header_1_0
        if version == (2, 0):
            write = np.lib.format.write_array_header_2_0
        write(buffer, header)
        return buffer.getvalue() + data

    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        scalar = {"descr": "<f8", "fortran_order": False, "shape": ()}
        archive.writestr("sample_interval_s.npy", member(scalar, np.float64(0.005).tobytes()))
        archive.writestr("displacement_m.npy", member(header, data))
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ((10**12,), "has shape"),
        ((-5,), "has shape"),
        ((10**6, 10**6), "shape"),
        ((50,), "where its shape needs"),
    ],
)
def test_a_header_that_lies_takes_no_memory(tmp_path, shape, message):
    header = {"descr": "<f8", "fortran_order": False, "shape": shape}
    path = write(tmp_path, "bomb.npz", npz_with_header(header, X.tobytes()))
    with pytest.raises(MotionError, match=message):
        read_record(path)


def test_a_long_header_version_is_read(tmp_path):
    header = {"descr": "<f8", "fortran_order": False, "shape": (N,)}
    path = write(tmp_path, "v2.npz", npz_with_header(header, X.tobytes(), (2, 0)))
    np.testing.assert_array_equal(read_record(path).displacement, X)


def test_pickles_are_never_loaded(tmp_path):
    path = tmp_path / "p.npz"
    np.savez(path, sample_interval_s=0.005, displacement_m=np.array([{"a": 1}] * 20, dtype=object))
    with pytest.raises(MotionError, match="object"):
        read_record(path)


@pytest.mark.parametrize("content", [b"PK\x03\x04 not really", b"\x00" * 100])
def test_damaged_npz_is_refused(tmp_path, content):
    with pytest.raises(MotionError, match=r"no sound \.npz"):
        read_record(write(tmp_path, "x.npz", content))


def test_absurd_sizes_are_refused_unread(tmp_path):
    path = tmp_path / "huge.csv"
    with path.open("wb") as file:
        file.truncate(MAX_FILE_BYTES + 1)
    with pytest.raises(MotionError, match=r"larger than .* bytes; cut or decimate"):
        read_record(path)
    with pytest.raises(MotionError, match="rows"):
        read_record(write(tmp_path, "rows.csv", b"\n" * 2_100_000))


@pytest.mark.parametrize("name", ["missing.csv", "folder.csv", "nul\0.csv", "a.mat", "README"])
def test_what_is_no_recording_is_refused(tmp_path, name):
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(MotionError, match=r"no such file|not a file|cannot be read|unknown kind"):
        read_record(tmp_path / name)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"displacement": None}, "neither displacement nor acceleration"),
        ({"displacement": X, "acceleration": A[:-1]}, "same number"),
        ({"displacement": ["a"] * 20}, "not an array of numbers"),
        ({"displacement": X, "sample_interval": float("inf")}, "lies outside"),
    ],
)
def test_unusable_records_are_refused(changes, message):
    with pytest.raises(MotionError, match=message):
        Record(**({"name": "r", "sample_interval": 0.005} | changes))


def test_a_record_on_file_is_the_record(tmp_path):
    path = tmp_path / "rec.npz"
    np.savez(path, sample_interval_s=0.00125, displacement_m=X, acceleration_m_s2=A)
    record = read_record(path)
    kept = on_file(record)
    assert kept is not record
    assert on_file(kept) is kept
    assert not [one for one in vars(kept).values() if isinstance(one, np.ndarray)]
    for one in (kept, pickle.loads(pickle.dumps(kept))):
        assert list(one.channels) == ["displacement", "acceleration"]
        assert one.velocity is None
        for name, channel in record.channels.items():
            np.testing.assert_array_equal(getattr(one, name), channel)
        assert [one.lacking(name) for name in ("fused", "velocity")] == [None, "velocity"]
        assert (one.label, one.size, one.duration) == (record.label, record.size, record.duration)
    motions = [build_recorded_motion(one, 0.001, channel="acceleration") for one in (record, kept)]
    assert motions[0] == motions[1]


def test_a_record_on_file_whose_file_changes_is_refused(tmp_path):
    path, other = tmp_path / "rec.npz", tmp_path / "other.npz"
    np.savez(path, sample_interval_s=0.00125, displacement_m=X)
    np.savez(other, sample_interval_s=0.00125, displacement_m=X)
    kept, content = on_file(read_record(path)), path.read_bytes()
    np.savez(path, sample_interval_s=0.00125, displacement_m=2 * X)
    with pytest.raises(MotionError, match=r"rec\.npz: was changed after it was read; put it back"):
        _ = kept.displacement
    path.write_bytes(content)
    np.testing.assert_array_equal(kept.displacement, X)
    _ = on_file(read_record(other)).displacement  # One file's samples are remembered.
    path.unlink()
    with pytest.raises(MotionError, match=r"rec\.npz"):
        _ = kept.displacement


def test_a_record_that_is_not_its_file_stays_in_memory(tmp_path):
    path = tmp_path / "rec.npz"
    np.savez(path, sample_interval_s=0.00125, displacement_m=X)
    record = read_record(path)
    for other in (
        Record("drawn", 0.00125, displacement=X),
        replace(record, displacement=2 * X),
        replace(record, sample_interval=0.001),
        replace(record, velocity=X),
        replace(record, source=str(tmp_path / "none.npz")),
    ):
        assert on_file(other) is other
