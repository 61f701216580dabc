"""Result folders: bit for bit round trips, refusals, damage."""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from synthetic_results import falling_log, make_log, make_result
from vsr2.errors import ResultError
from vsr2.results import (
    TRIAL_COLUMNS,
    BatchResult,
    TrialLog,
    base_provenance,
    load_models,
    load_result,
    load_trial_log,
    logged_trials,
    prepare_folder,
    save_models,
    save_result,
    save_trial_log,
)
from vsr2.results.atomic import write_atomic
from vsr2.results.result import COLUMNS
from vsr2.results.result_folder import FORMAT_VERSION
from vsr2.scene import Box, Triangles
from vsr2.scene.shapes import box_surface

LOG_ARRAYS = (
    "state",
    "contacts",
    "settled_position",
    "settled_orientation",
    "foot",
    "mass_center",
    "principal_axes",
)


def sample() -> BatchResult:
    """Three trials: a log with contacts, none, and one that ends in NaN."""
    first = falling_log(seed=3)
    state = falling_log(rows=21).state.copy()
    state[10:, 1:] = np.nan
    last = TrialLog(state, *(getattr(first, name) for name in LOG_ARRAYS[1:]))
    return make_result(
        [first, None, last],
        provenance={"study": {"name": "ü", "list": [1, 2.5, None, True]}, "vsr2": "0"},
        outcome=np.array(["overturned", "stable", "failed"], dtype=object),
        status=np.array(["ok", "tail_timeout", "diverged"], dtype=object),
        message=np.array(["", 'a "quoted", text\nof two\r\nlines ', "é 漢"], dtype=object),
        name=np.array(["x,y", "", "bad\udcff byte"], dtype=object),
        seed=np.array([0, 2**62 + 1, 7]),
        peak_tilt=np.array([1 / 3, -0.0, np.nan]),
        final_slip=np.array([5e-324, np.inf, 1.7976931348623157e308]),
    )


def assert_same(a: BatchResult, b: BatchResult) -> None:
    """Equal to the last bit, signs of zeros included."""
    assert len(a) == len(b)
    assert list(a.trials) == list(b.trials)
    for name in TRIAL_COLUMNS:
        assert a[name].dtype == b[name].dtype, name
        if a[name].dtype == object:
            assert list(a[name]) == list(b[name])
        else:
            assert a[name].tobytes() == b[name].tobytes(), name
    for x, y in zip(a.logs, b.logs, strict=True):
        assert (x is None) == (y is None)
        if x is not None and y is not None:
            for name in LOG_ARRAYS:
                assert getattr(x, name).shape == getattr(y, name).shape
                assert getattr(x, name).tobytes() == getattr(y, name).tobytes(), name
    assert dict(a.provenance) == dict(b.provenance)


def files_below(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("inner", ["logs", "npy", "models", "figures", "shards"])
def test_overwriting_follows_no_link_out_of_the_folder(inner, tmp_path):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    kept = elsewhere / "000000.npz"
    kept.write_text("not ours")
    folder = prepare_folder(tmp_path / "out")
    (folder / inner).symlink_to(elsewhere)
    with pytest.raises(ResultError, match="is a link, through which no result"):
        prepare_folder(folder, overwrite=True)
    (folder / "journal.jsonl").touch()
    with pytest.raises(ResultError, match="is a link, through which no result"):
        prepare_folder(folder, resume=True)
    assert kept.read_text() == "not ours"


def test_overwriting_removes_only_what_vsr2_writes(tmp_path):
    folder = prepare_folder(tmp_path / "out")
    ours = ["logs/000000.npz", "npy/000001.npy", "models/rock.npz", "trials.csv"]
    others = ["logs/000000.npy", "npy/mine.npy", "models/mine.npz", "notes.csv", "logs/1.npz"]
    for name in [*ours, *others]:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).touch()
    prepare_folder(folder, overwrite=True)
    assert not any((folder / name).exists() for name in ours)
    assert all((folder / name).exists() for name in others)


def test_a_private_file_is_its_owners_from_its_creation_on(tmp_path):
    seen = []

    def write(file):
        seen.append(os.fstat(file.fileno()).st_mode & 0o777)
        file.write(b"secret")

    write_atomic(tmp_path / "key", write, private=True)
    assert seen == [0o600]
    assert (tmp_path / "key").stat().st_mode & 0o777 == 0o600


def test_round_trip_bit_for_bit(tmp_path: Path) -> None:
    result = sample()
    folder = save_result(result, tmp_path / "deep" / "folder")
    assert files_below(folder) == {
        "trials.csv",
        "provenance.json",
        "logs/000000.npz",
        "logs/000002.npz",
    }
    assert_same(load_result(folder), result)
    assert logged_trials(folder) == [0, 2]
    without = load_result(folder, logs=False)
    assert without.logs == (None, None, None)
    assert load_trial_log(folder, 2).state.tobytes() == result.log(2).state.tobytes()
    with pytest.raises(ResultError, match="trial 1 has no log"):
        load_trial_log(folder, 1)


@given(
    values=st.lists(st.floats(allow_subnormal=True), min_size=1, max_size=4),
    text=st.text(max_size=20).filter(lambda text: not any("\ud800" <= c <= "\udfff" for c in text)),
)
@settings(max_examples=40, deadline=None)
def test_any_numbers_and_names_come_back(
    tmp_path_factory: pytest.TempPathFactory, values: list[float], text: str
) -> None:
    count = len(values)
    result = make_result(
        [None] * count,
        pga_g=np.array([np.nan if np.isnan(v) else v for v in values]),
        name=np.array([text] * count, dtype=object),
    )
    folder = save_result(result, tmp_path_factory.mktemp("any"))
    assert_same(load_result(folder), result)


def test_the_table_is_readable_by_others(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    result = sample()
    save_result(result, tmp_path)
    table = pandas.read_csv(tmp_path / "trials.csv", encoding_errors="replace")
    assert list(table.columns) == list(TRIAL_COLUMNS)
    # Its default reader of numbers may be off by a last digit.
    np.testing.assert_allclose(table["pga_g"].to_numpy(), result["pga_g"], rtol=1e-14)
    assert np.isnan(table["peak_tilt"][2])
    facts = json.loads((tmp_path / "provenance.json").read_text())["result_files"]
    assert facts["trial_columns"]["pga_g"] == {"unit": "g", "meaning": "PGA of the driven motion"}


def test_empty_batches_come_back(tmp_path: Path) -> None:
    assert_same(load_result(save_result(make_result([]), tmp_path)), make_result([]))


def test_original_rows(tmp_path: Path) -> None:
    axes = Rotation.from_rotvec([0.3, -0.2, 0.9])
    model = Rotation.from_rotvec([0.0, 0.4, 0.1])
    time = np.array([-0.2, -0.1, 0.0, 0.1])
    log = make_log(
        time,
        command=0.1 * time,
        achieved=0.09 * time,
        rotations=Rotation.concatenate([model * axes] * 4),
        axes=axes,
    )
    folder = save_result(make_result([None, log]), tmp_path, npy=True)
    rows = np.load(folder / "npy" / "000001.npy")
    # The settling is no part of the original's rows.
    assert rows.shape == (2, 10)
    np.testing.assert_array_equal(rows[:, 0], time[2:])
    np.testing.assert_array_equal(rows[:, 1], 0.1 * time[2:])
    np.testing.assert_array_equal(rows[:, 2], 0.09 * time[2:])
    np.testing.assert_array_equal(rows[:, 3:6], log.position[2:])
    assert (Rotation.from_quat(rows[1, 6:]).inv() * model).magnitude() < 1e-7


def test_streamed_logs_belong_to_the_result(tmp_path: Path) -> None:
    result = sample()
    folder = prepare_folder(tmp_path / "run")
    for i in (2, 0):
        log = result.logs[i]
        assert log is not None
        save_trial_log(folder, i, log, npy=i == 0)
    with pytest.raises(ResultError, match=r"provenance\.json: does not exist.*did not finish"):
        load_result(folder)
    bare = BatchResult(result.trials, (None, None, None), result.provenance)
    with pytest.raises(ResultError, match="already holds a result"):
        save_result(bare, folder)  # logs of an unknown run lie there
    save_result(bare, folder, streamed_logs=True)
    assert_same(load_result(folder), result)
    assert (folder / "npy" / "000000.npy").exists()
    with pytest.raises(ResultError, match="already holds a result"):
        save_result(bare, folder, streamed_logs=True)
    with pytest.raises(ResultError, match="is no folder; call prepare_folder"):
        save_result(bare, tmp_path / "nowhere", streamed_logs=True)


def test_a_result_is_overwritten_only_when_asked(tmp_path: Path) -> None:
    folder = save_result(sample(), tmp_path, npy=True)
    box = box_surface(Box((1.0, 1.0, 1.0)))
    save_models(folder, box, box)
    (folder / "notes.txt").write_text("mine")
    (folder / "logs" / "notes.npz").write_text("mine")
    before = files_below(folder)
    with pytest.raises(ResultError, match=r"already holds a result \(provenance.json and 7 more"):
        prepare_folder(folder)
    assert files_below(folder) == before
    prepare_folder(folder, overwrite=True)
    assert files_below(folder) == {"notes.txt", "logs/notes.npz"}
    save_result(make_result([None]), folder)
    save_result(make_result([None, None]), folder, overwrite=True)
    assert len(load_result(folder)) == 2


def test_a_folder_that_cannot_be_used_is_refused_at_once(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    for folder in (tmp_path / "file", tmp_path / "file" / "below", Path("nul\0byte")):
        with pytest.raises(ResultError, match="cannot be used as result folder"):
            prepare_folder(folder)


def test_a_folder_without_write_permission_is_refused() -> None:
    nobody = 65534
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o555)
        root = os.geteuid() == 0
        if root:  # root may write anywhere
            os.seteuid(nobody)
        try:
            with pytest.raises(ResultError, match="Permission denied"):
                prepare_folder(name)
            with pytest.raises(ResultError, match="Permission denied"):
                save_trial_log(name, 0, falling_log())
        finally:
            if root:
                os.seteuid(0)
            Path(name).chmod(0o755)


def test_unwritable_provenance_is_refused_before_writing(tmp_path: Path) -> None:
    for value in (float("nan"), object()):
        with pytest.raises(ResultError, match="cannot be written as JSON"):
            save_result(make_result([], provenance={"x": value}), tmp_path / "new")
    with pytest.raises(ResultError, match="result_files"):
        save_result(make_result([], provenance={"result_files": 1}), tmp_path / "new")
    assert not (tmp_path / "new").exists()


@contextmanager
def files_limited_to(size: int) -> Iterator[None]:
    """Stands for a full disk: no file may grow beyond `size` bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_leaves_no_half_file(tmp_path: Path) -> None:
    result = sample()
    folder = prepare_folder(tmp_path)
    log = result.log(0)
    save_trial_log(folder, 0, log)
    complete = (folder / "logs" / "000000.npz").read_bytes()
    with files_limited_to(10_000), pytest.raises(ResultError, match=r"logs/000000\.npz: cannot be"):
        save_trial_log(folder, 0, log)
    with files_limited_to(100), pytest.raises(ResultError, match=r"trials\.csv: cannot be written"):
        save_result(result.__class__(result.trials, (None,) * 3), folder, streamed_logs=True)
    # The old content is whole, and no temporary file is left behind.
    assert files_below(folder) == {"logs/000000.npz"}
    assert (folder / "logs" / "000000.npz").read_bytes() == complete


def test_a_killed_writer_leaves_no_half_file(tmp_path: Path) -> None:
    program = """
import os, sys
from pathlib import Path
from vsr2.results.atomic import write_atomic
def write(file):
    file.write(b"half")
    file.flush()
    os._exit(9)
write_atomic(Path(sys.argv[1]) / "trials.csv", write)
"""
    done = subprocess.run([sys.executable, "-c", program, str(tmp_path)], check=False)
    assert done.returncode == 9
    assert not (tmp_path / "trials.csv").exists()
    prepare_folder(tmp_path)  # what it left is not taken for a result


def test_an_interrupted_write_removes_its_temporary_file(tmp_path: Path) -> None:
    from vsr2.results.atomic import write_atomic

    def interrupted(file: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_atomic(tmp_path / "trials.csv", interrupted)
    assert files_below(tmp_path) == set()


def test_missing_and_foreign_folders(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="is no folder"):
        load_result(tmp_path / "nowhere")
    with pytest.raises(ResultError, match=r"provenance\.json: does not exist"):
        load_result(tmp_path)
    for text in ("{}", "[]", "3", '{"result_files": {"format": "other"}}'):
        (tmp_path / "provenance.json").write_text(text)
        with pytest.raises(ResultError, match=r"provenance\.json: not written by VSR2"):
            load_result(tmp_path)


def test_newer_formats_are_refused(tmp_path: Path) -> None:
    path = save_result(sample(), tmp_path) / "provenance.json"
    version = f'"format_version": {FORMAT_VERSION}'
    path.write_text(path.read_text().replace(version, '"format_version": 1'))
    with pytest.raises(ResultError, match=f"format version 1, this VSR2 reads {FORMAT_VERSION}"):
        load_result(tmp_path)


@pytest.mark.parametrize("kind", COLUMNS)
def test_a_folder_with_other_columns_is_refused_and_names_them(tmp_path: Path, kind: str) -> None:
    path = save_result(sample(), tmp_path) / "provenance.json"
    content = json.loads(path.read_text())
    names = list(content["result_files"][kind])
    for other, named in (([*names, "snap"], "snap"), (names[:-1], names[-1]), (None, names[0])):
        content["result_files"][kind] = other
        path.write_text(json.dumps(content))
        with pytest.raises(ResultError, match=rf"its {kind} are not those .*{named}.*; use the"):
            load_result(tmp_path)


def test_the_page_names_every_column_with_its_unit() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "reference" / "outputs.md").read_text()
    table = page.partition("### `trials.csv`")[2].partition("\n\n| status |")[0]
    units: dict[str, str] = {}
    for row in re.findall(r"^\| (`.*?) \| (.*?) \|", table, re.MULTILINE):
        names, given = re.findall(r"`(\w+)`", row[0]), row[1].strip().split(", ")
        units |= dict(zip(names, given * len(names) if len(given) == 1 else given, strict=False))
    assert units == {name: one.unit.replace("1", "") for name, one in TRIAL_COLUMNS.items()}


@pytest.mark.parametrize("name", ["provenance.json", "trials.csv", "logs/000000.npz"])
def test_truncated_files_are_named(tmp_path: Path, name: str) -> None:
    path = save_result(sample(), tmp_path) / name
    content = path.read_bytes()
    # The last two bytes of the JSON are a brace and a line end, which nothing depends on.
    cuts = {0, 1, 10, len(content) // 2, len(content) - 2}
    for length in cuts:
        path.write_bytes(content[:length])
        with pytest.raises(ResultError, match=name):
            load_result(tmp_path)
    path.unlink()
    with pytest.raises(ResultError, match=name):
        load_result(tmp_path)


def test_damaged_tables_name_trial_and_column(tmp_path: Path) -> None:
    path = save_result(make_result([None, None]), tmp_path) / "trials.csv"
    good = path.read_text()
    rows = good.splitlines(keepends=True)
    damages = {
        rows[0] + rows[1]: "has 1 row where provenance.json says 2",
        good.replace('"stable"', '"flew"'): "trial 0, column outcome: 'flew'",
        good.replace(",1000,", ",many,"): "column steps: 'many'",
        good.replace(",1000,", ",9223372036854775808,"): "column steps",
        good.replace(",0.1,", ",o.1,"): "column pga_g: 'o.1'",
        good.replace(
            ",1000,", ",1000,,"
        ): f"{len(TRIAL_COLUMNS) + 1} values for {len(TRIAL_COLUMNS)} columns",
        good.replace("pga_g", "PGA"): "first line must name the columns",
        good.replace('"ok"', '"ok"x'): "damaged",
        "\n": "first line",
    }
    for text, message in damages.items():
        path.write_text(text)
        with pytest.raises(ResultError, match=message):
            load_result(tmp_path)


def test_hostile_logs_are_refused(tmp_path: Path) -> None:
    path = save_result(sample(), tmp_path) / "logs" / "000000.npz"
    content = path.read_bytes()

    def arrays() -> dict[str, object]:
        return {name: getattr(falling_log(), name) for name in LOG_ARRAYS}

    np.savez(path, **(arrays() | {"state": np.array([{}], dtype=object)}))
    with pytest.raises(ResultError, match="array state holds object"):
        load_result(tmp_path)
    np.savez(path, **(arrays() | {"state": np.zeros((3, 17))}))
    with pytest.raises(ResultError, match=r"000000\.npz: trial log: state must have shape"):
        load_result(tmp_path)
    # A header that claims more memory than any machine has.
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 18), }\n"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(
            "state.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header
        )
    with pytest.raises(ResultError, match="claims the shape"):
        load_result(tmp_path)
    flipped = bytearray(content)
    flipped[len(content) // 2] ^= 1
    path.write_bytes(flipped)
    with pytest.raises(ResultError, match="damaged"):
        load_result(tmp_path)


@given(position=st.floats(0, 1, exclude_max=True), value=st.integers(0, 255))
@settings(max_examples=60, deadline=None)
def test_a_changed_byte_is_detected_or_harmless(
    tmp_path_factory: pytest.TempPathFactory, position: float, value: int
) -> None:
    folder = tmp_path_factory.mktemp("byte")
    log = falling_log(rows=3)
    save_result(make_result([log]), folder)
    path = folder / "logs" / "000000.npz"
    content = bytearray(path.read_bytes())
    content[int(position * len(content))] = value
    path.write_bytes(content)
    try:
        loaded = load_trial_log(folder, 0)
    except ResultError:  # refused; any other exception fails the test
        return
    assert loaded.state.tobytes() == log.state.tobytes()


def test_provenance_facts() -> None:
    facts = base_provenance({"bullet": "3.24"})
    assert facts["build"] == {"bullet": "3.24"}
    assert facts["python"] == ".".join(map(str, sys.version_info[:3]))
    assert facts["numpy"] == np.__version__
    assert facts["created"].endswith("+00:00")
    assert json.loads(json.dumps(facts)) == facts


def test_models_round_trip(tmp_path: Path) -> None:
    rock, pedestal = box_surface(Box((1.0, 2.0, 3.0))), box_surface(Box((9.0, 9.0, 0.5)))
    save_models(tmp_path, rock, pedestal)
    for got, wanted in zip(load_models(tmp_path), (rock, pedestal), strict=True):
        assert got.vertices.tobytes() == wanted.vertices.tobytes()
        assert got.faces.tobytes() == wanted.faces.tobytes()


def test_damaged_models_are_named(tmp_path: Path) -> None:
    box = box_surface(Box((1.0, 1.0, 1.0)))
    with pytest.raises(ResultError, match=r"rock\.npz: does not exist"):
        load_models(tmp_path)
    far = Triangles(box.vertices, box.faces + 1)
    save_models(tmp_path, box, far)
    with pytest.raises(ResultError, match=r"pedestal\.npz: a triangle names a vertex"):
        load_models(tmp_path)
    save_models(tmp_path, Triangles(box.vertices * np.nan, box.faces), box)
    with pytest.raises(ResultError, match=r"rock\.npz: holds no mesh"):
        load_models(tmp_path)
