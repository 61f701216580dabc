"""The simulation cache: what it keeps, and what it refuses."""

from __future__ import annotations

import base64
import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from planar.planar_library import PLANAR_LIBRARY
from vsr2.effects import library as full_library
from vsr2.effects.own_code import own_code
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.simulator import Request, Responses, nuisance_normal
from vsr2.errors import ResultError

TWO = {name: PLANAR_LIBRARY[name] for name in ("table_gain", "restitution")}


class Counting:
    """A simulator that counts, and stops on request."""

    library = TWO
    nuisance_names = ("z",)
    identity = "counting"

    def __init__(self, stop_after=None):
        self.runs = 0
        self.stop_after = stop_after

    def nuisance_draw(self, index):
        return nuisance_normal(0, 1, index)

    def run(self, requests):
        self.runs += len(requests)
        if self.stop_after is not None and self.runs > self.stop_after:
            raise KeyboardInterrupt
        value = np.array([hash((r.trial, r.nuisance, r.effects)) % 97 for r in requests]) / 97
        return Responses((value > 0.5).astype(float), value, None)


def test_an_interrupted_cache_goes_on_where_it_stopped(tmp_path) -> None:
    requests = [Request(i % 10, (), i // 10, 1) for i in range(40)]
    reference = SimulationCache(Counting()).run(requests)
    with (
        pytest.raises(KeyboardInterrupt),
        SimulationCache(Counting(25), tmp_path / "b", chunk=10) as cache,
    ):
        cache.run(requests)
    simulator = Counting()
    with SimulationCache(simulator, tmp_path / "b", chunk=10) as cache:
        found = cache.run([*requests, requests[3]])
        assert (cache.simulated, cache.reused, cache.size) == (20, 20, 40)
    assert simulator.runs == 20
    np.testing.assert_array_equal(found.peak_tilt[:40], reference.peak_tilt)
    assert found.peak_tilt[40] == reference.peak_tilt[3]


def test_a_cache_keeps_effects_nuisances_replicates_and_scenes_apart(tmp_path) -> None:
    keys = [
        Request(0, (), 0, 0),
        Request(0, (), 1, 0),
        Request(0, (), 0, 1),
        Request(0, (("table_gain", (0.1,)),), 0, 0),
        Request(1, (), 0, 0),
    ]
    with SimulationCache(Counting(), tmp_path / "b") as cache:
        cache.run(keys)
        assert cache.simulated == 5
    other = Counting()
    other.identity = "another scene"
    with SimulationCache(other, tmp_path / "b") as cache:
        cache.run(keys)
        assert cache.simulated == 5


TYPED_IN = """
class Gain(library_s):
    def change(self, setup, values):
        return setup, {slope} * values["change"]
"""


def test_a_cache_keeps_the_versions_of_an_effect_of_one_s_own_apart(tmp_path) -> None:
    library_s = type(full_library()["table_gain"])

    class Gain(library_s):
        """An effect of the user's, under the name of one of the library's."""

        def change(self, setup, values):
            return setup

    kinds = [library_s, Gain]
    # Of a class without a word of its own the base tells.
    kinds.append(type("Gain", (Gain,), {}))
    for slope in (1.0, 2.0):
        # As at a prompt, where no source is kept.
        names = {"library_s": library_s, "__name__": "prompt"}
        exec(TYPED_IN.format(slope=slope), names)
        kinds.append(names["Gain"])
    assert own_code(kinds[0]) == ""
    with_it, without = Request(0, (("table_gain", (0.1,)),), 0, 0), Request(0, (), 0, 0)
    simulated = []
    for kind in (*kinds, *kinds):
        simulator = Counting()
        simulator.library = TWO | {"table_gain": kind()}
        with SimulationCache(simulator, tmp_path / "b") as cache:
            cache.run([with_it, without])
            simulated.append(cache.simulated)
    # What no effect acts on is simulated once for all of them.
    assert simulated == [2, 1, 0, 1, 1, 0, 0, 0, 0, 0]


def test_a_cache_of_an_older_form_or_with_damaged_records_is_refused(tmp_path) -> None:
    (tmp_path / "b.sqlite").write_bytes(b"SQLite format 3")
    with pytest.raises(ResultError, match=r"b\.sqlite: is a simulation cache of an older VSR2; r"):
        SimulationCache(Counting(), tmp_path / "b.jsonl")
    requests = [Request(0, (), 0, 1), Request(1, (), 0, 1)]
    path = tmp_path / "c.jsonl"
    with SimulationCache(Counting(), path, chunk=1) as cache:
        cache.run(requests)
    header, first, second = path.read_bytes().splitlines(keepends=True)
    longer = json.loads(second)
    # As an older VSR2 wrote it, without which it is refused when the file is opened.
    del longer["crc32"]
    longer["responses"] = base64.b64encode(bytes(24)).decode()
    path.write_bytes(header + first + json.dumps(longer).encode() + b"\n")
    with (
        SimulationCache(Counting(), path) as cache,
        pytest.raises(ResultError, match=r"different lengths.*remove it"),
    ):
        cache.run(requests)


WRITER = """
import sys, time
sys.path[:0] = {path!r}
from test_ensemble_cache import Counting, REQUESTS
from vsr2.ensemble.simulated.cache import SimulationCache
class Slow(Counting):
    def run(self, requests):
        time.sleep(0.02)
        return super().run(requests)
SimulationCache(Slow(), __import__("pathlib").Path({file!r}), chunk=4).run(REQUESTS)
"""

REQUESTS = [Request(i % 40, (), i // 40, 1) for i in range(4000)]


def test_a_killed_cache_goes_on_and_a_torn_last_record_is_discarded(tmp_path) -> None:
    path = tmp_path / "c.jsonl"
    code = WRITER.format(path=[p for p in sys.path if p], file=str(path))
    child = subprocess.Popen([sys.executable, "-c", code])
    ends = time.monotonic() + 120
    while not (path.exists() and path.read_bytes().count(b"\n") > 3) and time.monotonic() < ends:
        assert child.poll() is None, "it ended before it could be killed"
        time.sleep(0.005)
    child.send_signal(signal.SIGKILL)
    assert child.wait() == -signal.SIGKILL
    kept = path.read_bytes().count(b"\n") - 1
    # A last record of which only a part reached the disk.
    last = path.read_bytes().splitlines(keepends=True)[-1]
    path.write_bytes(path.read_bytes() + last[:-10])
    simulator = Counting()
    with SimulationCache(simulator, path, chunk=1000) as cache:
        assert cache.size >= 4 * (kept - 1)
        size = cache.size
        found = cache.run(REQUESTS)
        assert cache.simulated == simulator.runs == len(REQUESTS) - size
        assert cache.reused == size
    reference = SimulationCache(Counting()).run(REQUESTS)
    np.testing.assert_array_equal(found.peak_tilt, reference.peak_tilt)
    with SimulationCache(Counting(), path) as cache:
        assert cache.size == len(REQUESTS)


@pytest.mark.parametrize("change", [{"version": 1}, {"responses": "AAAA"}, {"keys": "?"}])
def test_records_of_another_version_or_damaged_are_refused(tmp_path, change) -> None:
    path = tmp_path / "c.jsonl"
    with SimulationCache(Counting(), path, chunk=5) as cache:
        cache.run(REQUESTS[:15])
    lines = path.read_text().splitlines()
    line = 0 if "version" in change else 1
    lines[line] = json.dumps(json.loads(lines[line]) | change)
    path.write_text("\n".join(lines) + "\n")
    said = "version 1, this VSR2 has 2" if "version" in change else "jsonl:2: damaged"
    with pytest.raises(ResultError, match=f"{said}.*remove it, and its simulations are made again"):
        SimulationCache(Counting(), path)
