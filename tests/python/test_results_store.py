"""The one store of finished work, as journal, as evaluations, and as simulation cache."""

from __future__ import annotations

import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from dataclasses import dataclass

import numpy as np
import pytest

from vsr2 import _native
from vsr2.calibration import Evaluation, EvaluationStore
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.simulator import Request, Responses
from vsr2.errors import ResultError
from vsr2.results import (
    FLOAT_COLUMNS,
    INTEGER_COLUMNS,
    TEXT_COLUMNS,
    TRIAL_COLUMNS,
    Journal,
    batch_table,
    prepare_folder,
    read_journal,
)
from vsr2.results import store as store_module


def journal_row(tilt):
    """What a batch records of a trial."""
    row = dict.fromkeys(FLOAT_COLUMNS, 0.0) | {"overturning_time": float("nan")}
    words = {"status": "ok", "outcome": "rocked", "message": "", "engine": "fast"}
    return {**row, "peak_tilt": tilt, **words, "hand_over": "none", "steps": 7}


class Journalled:
    precision = float
    file = "journal.jsonl"
    owner = ("plan", "other trials or settings")
    odd = b'{"trial":3}\n'

    def __init__(self, folder, owner="plan"):
        self.open = Journal(folder, owner, 3)

    def add(self, i):
        self.open.record(i, journal_row(i / 3))

    def held(self):
        return {i: row["peak_tilt"] for i, row in self.open.finished.items()}


@pytest.mark.parametrize("name", FLOAT_COLUMNS)
def test_a_trial_that_ended_lacks_numbers_that_the_core_may_leave_out_alone(name, tmp_path) -> None:
    with Journal(tmp_path, "plan", 1) as journal:
        journal.record(0, journal_row(0.1) | {name: float("nan")})
    [column] = [one for one in _native.result_columns() if one.name == name]
    if column.missing:
        assert np.isnan(read_journal(tmp_path, "plan", 1)[0][name])
    else:
        with pytest.raises(ResultError, match=f"{name} is nan, not a number"):
            read_journal(tmp_path, "plan", 1)


class Evaluated:
    precision = float
    file = "evaluations.jsonl"
    owner = ("campaign", "another campaign")
    odd = b'{"key":"k","plan":"p","values":{},"predicted":"1?x","seconds":1}\n'

    def __init__(self, folder, owner="campaign"):
        self.open = EvaluationStore(folder, owner, 3)

    def add(self, i):
        one = Evaluation({"p": i / 3}, np.array([1.0, 0.0, np.nan]), f"plan {i}", 1.5)
        self.open.keep(str(i), one)

    def held(self):
        found = {i: self.open.by_key(str(i)) for i in range(3)}
        return {i: one.values["p"] for i, one in found.items() if one is not None}


class Simulated:
    precision = np.float32
    file = "simulations.jsonl"
    owner = None
    odd = b'{"key":"00","response":"","seconds":1}\n'
    identity = "simulated"
    library: dict[str, object] = {}  # noqa: RUF012

    def __init__(self, folder):
        self.open = SimulationCache(self, folder / self.file)
        self.runs = 0

    def nuisance_draw(self, index):
        return np.zeros(1)

    def run(self, requests):
        self.runs += len(requests)
        tilt = np.array([one.trial / 3 for one in requests])
        return Responses(np.zeros(len(tilt)), tilt, np.full((len(tilt), 1), np.nan))

    def add(self, i):
        found = self.open.run([Request(i, (), 0, 1)])
        assert np.isnan(found.features).all()

    def held(self):
        size, before = self.open.size, self.runs
        if not size:
            return {}
        tilts = self.open.run([Request(i, (), 0, 1) for i in range(size)]).peak_tilt
        assert self.runs == before
        return dict(enumerate(tilts.tolist()))


KINDS = [Journalled, Evaluated, Simulated]


@dataclass
class Kept:
    """A store that holds records 0 and 1, closed."""

    kind: type
    folder: object
    path: object


@pytest.fixture(params=KINDS)
def kept(request, tmp_path):
    one = request.param(tmp_path)
    one.add(0)
    one.add(1)
    one.open.close()
    return Kept(request.param, tmp_path, tmp_path / request.param.file)


def held(kept):
    one = kept.kind(kept.folder)
    with one.open:
        return one.held()


def thirds(kept, count):
    """What was added, to the last bit of the precision that the store keeps."""
    return {i: float(kept.kind.precision(i / 3)) for i in range(count)}


def test_what_was_kept_is_found_to_the_last_bit(kept) -> None:
    assert held(kept) == thirds(kept, 2)


def test_a_torn_last_line_is_discarded_wherever_it_was_torn(kept) -> None:
    lines = kept.path.read_bytes().splitlines(keepends=True)
    for cut in (0, 1, len(lines[2]) // 2, len(lines[2]) - 1):
        kept.path.write_bytes(b"".join(lines[:2]) + lines[2][:cut])
        assert held(kept) == {0: 0.0}
        one = kept.kind(kept.folder)
        with one.open:
            one.add(1)
        assert held(kept) == thirds(kept, 2)
    # Of a torn header nothing is left: the store is empty.
    kept.path.write_bytes(lines[0][:-1])
    assert held(kept) == {}


def test_a_damaged_record_is_stated_with_its_line_and_a_remedy(kept) -> None:
    content = kept.path.read_bytes()
    for bad in (
        kept.kind.odd,
        b"no json\n",
        b"\xff\xfe\n",
        b"[1]\n",
        b"{}\n",
        b"[" * 10**5 + b"\n",
    ):
        kept.path.write_bytes(content + bad + content.splitlines(keepends=True)[1])
        with pytest.raises(ResultError, match=rf"{kept.path.name}:4: damaged .*; (start|remove)"):
            kept.kind(kept.folder)
        # It is left as it was.
        assert kept.path.read_bytes().startswith(content + bad)


def test_what_is_no_store_or_of_another_version_is_refused(kept) -> None:
    first, rest = kept.path.read_bytes().split(b"\n", 1)
    for bad in (b"{}", b"no json", b"\xff\xfe", b"[1]", b'"text"'):
        kept.path.write_bytes(bad + b"\n" + rest)
        with pytest.raises(ResultError, match=rf"{kept.path.name}:1: damaged"):
            kept.kind(kept.folder)
    header = json.loads(first)
    kept.path.write_bytes(json.dumps(header | {"version": 99}).encode() + b"\n" + rest)
    with pytest.raises(ResultError, match=r"of version 99, this VSR2 has .*; use the VSR2 that"):
        kept.kind(kept.folder)
    kept.path.unlink()
    os.symlink("/dev/full", kept.path)
    with pytest.raises(ResultError, match="no regular file"):
        kept.kind(kept.folder)


def test_a_store_of_something_else_or_too_large_is_refused(kept, monkeypatch) -> None:
    if kept.kind.owner is not None:
        name, error = kept.kind.owner
        with pytest.raises(ResultError, match=error):
            kept.kind(kept.folder, f"other {name}")
    monkeypatch.setattr(store_module, "MAX_BYTES", 100)
    with pytest.raises(ResultError, match="over 100 bytes"):
        kept.kind(kept.folder)


def test_a_second_writer_is_refused_until_the_first_ends(kept) -> None:
    with kept.kind(kept.folder).open, pytest.raises(ResultError, match="another process is wri"):
        kept.kind(kept.folder)
    assert held(kept) == thirds(kept, 2)


def test_a_full_disk_leaves_complete_records(kept) -> None:
    one = kept.kind(kept.folder)
    before = kept.path.read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    with one.open:
        # A limit on file sizes stands for the full disk: the write ends amid a record.
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) + 9, limits[1]))
        try:
            with pytest.raises(ResultError, match=r"cannot be written \(No space left on device"):
                one.add(2)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        assert kept.path.read_bytes() == before
        one.add(2)
    assert held(kept) == thirds(kept, 3)


def test_a_missing_folder_is_stated_with_its_remedy(kept) -> None:
    remedy = re.escape(f"make {kept.folder / 'none'} first, in Python with vsr2.results.prepare_f")
    with pytest.raises(ResultError, match=rf"cannot be used \(No such file .*{remedy}"):
        kept.kind(kept.folder / "none")


def test_a_journal_is_read_beside_its_writer_and_not_overwritten(tmp_path) -> None:
    with Journal(tmp_path, "plan", 3) as journal:
        journal.record(0, journal_row(1.0))
        (row,) = read_journal(tmp_path, "plan", 3).values()
        assert (row["peak_tilt"], row["trial"], row["log"]) == (1.0, 0, None)
        with pytest.raises(ResultError, match="another process"):
            prepare_folder(tmp_path, overwrite=True)
    with pytest.raises(ResultError, match="other trials"):
        read_journal(tmp_path, "plan", 4)


def test_rows_of_a_journal_are_given_away_where_they_are_asked_for(tmp_path) -> None:
    with Journal(tmp_path, "plan", 3) as journal:
        for tilt in (1.0, 2.0):
            journal.record(1, journal_row(tilt))
    noted = []
    with Journal(
        tmp_path, "plan", 3, lambda i, row: noted.append((i, row["peak_tilt"]))
    ) as journal:
        assert noted == [(1, 1.0), (1, 2.0)]
        assert journal.finished == {}


@pytest.mark.parametrize("block", [1, 2, 5, 7])
def test_a_table_is_the_same_in_parts_of_any_size(block, monkeypatch) -> None:
    columns = {name: np.arange(5) / 3 for name in TRIAL_COLUMNS}
    columns |= {name: np.arange(5) for name in INTEGER_COLUMNS}
    columns |= {name: np.array(list('a,"\ne'), dtype=object) for name in TEXT_COLUMNS}
    complete = list(batch_table.table_text(columns))
    monkeypatch.setattr(batch_table, "_BLOCK", block)
    parts = list(batch_table.table_text(columns))
    assert "".join(parts) == "".join(complete)
    assert (len(complete), len(parts)) == (2, 1 - (-5 // block))


ODD = {
    Journalled: {
        "trial": (True, 3, -1, 1.0, "1", None, 10**400, "1e400"),
        "peak_tilt": (1, True, "0.1", None, [0.1], 10**400, "1e400", "NaN", "-Infinity"),
        "overturning_time": ("Infinity", "1e400", "soon", 1),
        "steps": (1.5, True, -1, 10**400, "1e400", "NaN"),
        "outcome": ("bogus", "", 1),
        "status": ("fine", None, True),
        "engine": ("slow", ["fast"]),
        "hand_over": ("bogus", {}),
        "message": (1, None),
        "log": (7, {}, {"bytes": "1", "sha256": ""}, {"bytes": True, "sha256": ""}),
    },
    Evaluated: {
        "key": (1, None, True),
        "plan": (1, ["p"]),
        "predicted": ("1?x", "1", 1, True, None),
        "seconds": (10**400, "1e400", "NaN", -1.0, 1, True, "1.5"),
        "values": (1, None, [1.0]),
        "values.p": (10**400, "1e400", "NaN", None, [1.0], {}),
    },
    Simulated: {
        "keys": ("", "00", "no base 64", 1, None, True),
        "responses": ("", "AAAA", 1, [], "AACAfwAAgH8AAIB/"),
        "seconds": (10**400, "1e400", "NaN", -1.0, 1, True, "1.5"),
    },
}
"""Values that no writer wrote, by key; words of numbers stand for what JSON reads as these."""
BARE = ("1e400", "NaN", "Infinity", "-Infinity")


def with_value(line, key, value):
    """A record with another value; of `a.b` that of b within a."""
    record = json.loads(line)
    *outer, name = key.split(".")
    inner = record[outer[0]] if outer else record
    inner[name] = "BARE" if value in BARE else value
    return json.dumps(record).replace('"BARE"', str(value)).encode() + b"\n"


@pytest.mark.parametrize(
    ("kind", "key", "value"),
    [
        pytest.param(kind, key, value, id=f"{kind.__name__} {key} {value!r:.20}")
        for kind, by_key in ODD.items()
        for key, values in by_key.items()
        for value in values
    ],
)
def test_a_value_that_nothing_wrote_is_refused_by_its_name(kind, key, value, tmp_path) -> None:
    one = kind(tmp_path)
    with one.open:
        one.add(0)
    path = tmp_path / kind.file
    header, line = path.read_bytes().splitlines()
    path.write_bytes(header + b"\n" + with_value(line, key, value))
    left = path.read_bytes()
    with pytest.raises(ResultError) as refused:
        kind(tmp_path)
    said = str(refused.value)
    assert re.match(rf"{re.escape(str(path))}:2: damaged \({re.escape(key)}", said), said
    # What stands there, cut if it is long, what should, and what to do about it.
    assert re.search(r" is .+, not .+\); (start again|remove it)", said) or "missing" in said, said
    assert len(said) < len(str(path)) + 300
    assert path.read_bytes() == left


@pytest.mark.parametrize("kind", KINDS)
def test_a_record_without_a_key_is_refused_by_its_name(kind, tmp_path) -> None:
    one = kind(tmp_path)
    with one.open:
        one.add(0)
    path = tmp_path / kind.file
    header, line = path.read_bytes().splitlines()
    complete = json.loads(line)
    assert list(complete)[-1] == "crc32"
    if kind is not Journalled:
        # Evaluations and caches that an older VSR2 wrote have none.
        complete.pop("crc32")
    for key in complete:
        left = {name: value for name, value in complete.items() if name != key}
        path.write_bytes(header + b"\n" + json.dumps(left).encode() + b"\n")
        with pytest.raises(ResultError, match=rf":2: damaged \({key} is missing\); (start|remove)"):
            kind(tmp_path)


CHANGED = {
    Journalled: [
        (b'"status":"ok"', b'"status":"diverged"'),
        (b'"status":"ok"', b'"status":"tail_timeout"'),
        (b'"outcome":"rocked"', b'"outcome":"overturned"'),
        (b'"peak_tilt":0.0', b'"peak_tilt":0.5'),
        (b'"trial":0', b'"trial":2'),
        (b'"log":null', b'"log":{"bytes":1,"sha256":""}'),
        (b'{"', b'{"more":1,"'),
        (b'","', b'" ,"'),
    ],
    Evaluated: [(b"10x", b"00x"), (b'"seconds":1.5', b'"seconds":2.5'), (b'"p":0.0', b'"p":1.0')],
    Simulated: [(b'"seconds":', b'"seconds":1'), (b'"responses":"AAAA', b'"responses":"AACA')],
}
"""What a hand puts in the place of what was written, each of the type that is wanted."""


@pytest.mark.parametrize(
    ("kind", "old", "new"),
    [
        pytest.param(kind, *change, id=f"{kind.__name__} {change[1].decode()}")
        for kind, changes in CHANGED.items()
        for change in changes
    ],
)
def test_a_record_that_was_changed_by_hand_is_refused(kind, old, new, tmp_path) -> None:
    one = kind(tmp_path)
    with one.open:
        one.add(0)
        one.add(1)
    path = tmp_path / kind.file
    header, line, other = path.read_bytes().splitlines(keepends=True)
    assert old in line
    path.write_bytes(header + line.replace(old, new) + other)
    with pytest.raises(ResultError) as refused:
        kind(tmp_path)
    assert str(refused.value) == (
        f"{path}:2: was changed after it was written (its checksum differs); remove this line, and "
        "what it holds is done again"
    )
    # What it says to do is enough.
    path.write_bytes(header + other)
    with kind(tmp_path).open:
        pass
    path.write_bytes(header + line + other)
    assert held(Kept(kind, tmp_path, path)) == thirds(Kept(kind, tmp_path, path), 2)


@pytest.mark.parametrize("wrong", ['"00000000"', "0", "null", "[]", '"no sum"', '{"crc32":"0"}'])
@pytest.mark.parametrize("kind", KINDS)
def test_a_checksum_of_any_type_that_differs_is_refused(kind, wrong, tmp_path) -> None:
    one = kind(tmp_path)
    with one.open:
        one.add(0)
    path = tmp_path / kind.file
    head, mark, _ = path.read_text().rpartition('"crc32":')
    path.write_text(f"{head}{mark}{wrong}}}\n")
    with pytest.raises(ResultError, match=r":2: was changed after .*; remove this line, and"):
        kind(tmp_path)


@pytest.mark.parametrize("kind", [Evaluated, Simulated])
def test_records_of_an_older_vsr2_without_checksum_are_taken(kind, tmp_path) -> None:
    one = kind(tmp_path)
    with one.open:
        one.add(0)
    path = tmp_path / kind.file
    path.write_text(re.sub(r',"crc32":"\w{8}"', "", path.read_text()))
    one = kind(tmp_path)
    with one.open:
        assert one.held() == {0: 0.0}
        one.add(1)
    assert held(Kept(kind, tmp_path, path)) == thirds(Kept(kind, tmp_path, path), 2)


def test_a_trial_without_an_outcome_may_lack_numbers(tmp_path) -> None:
    failed = journal_row(float("nan")) | {"status": "diverged", "outcome": "failed"}
    with Journal(tmp_path, "plan", 3) as journal:
        journal.record(0, failed)
    with Journal(tmp_path, "plan", 3) as journal:
        assert np.isnan(journal.finished[0]["peak_tilt"])


WRITER = """
import sys
from pathlib import Path
from vsr2.results.store import Store, StoreKind
store = Store(Path(sys.argv[1]), StoreKind("endless", 1, ""), {}, lambda record: None)
for i in range(10**9):
    store.add(*({"i": i, "k": k, "filler": "x" * (i % 3000)} for k in range(1 + i % 5)))
"""


def test_kill_9_leaves_what_was_added_in_order(tmp_path) -> None:
    path = tmp_path / "endless"
    kind = store_module.StoreKind("endless", 1, "")
    found: list[tuple[int, int]] = []
    for _ in range(3):
        path.unlink(missing_ok=True)
        child = subprocess.Popen([sys.executable, "-c", WRITER, str(path)])
        ends = time.monotonic() + 60
        while not (path.exists() and path.stat().st_size > 10**6) and time.monotonic() < ends:
            assert child.poll() is None
            time.sleep(0.001)
        child.send_signal(signal.SIGKILL)
        assert child.wait() == -signal.SIGKILL
        found.clear()
        store_module.Store(path, kind, {}, lambda one: found.append((one["i"], one["k"]))).close()
        assert len(found) > 100
        assert (
            found
            == [(i, k) for i in range(found[-1][0] + 1) for k in range(1 + i % 5)][: len(found)]
        )
