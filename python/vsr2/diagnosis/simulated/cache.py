"""The simulation cache: what was simulated once is never simulated again."""

from __future__ import annotations

import hashlib
import inspect
import logging
import marshal
import sqlite3
import struct
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Self

import numpy as np

from vsr2.diagnosis.simulated.simulator import Request, Responses, Simulator
from vsr2.errors import DiagnosisError

_logger = logging.getLogger(__name__)

Progress = Callable[[int, int], None]
"""Called with simulations done and all."""
CHUNK = 512
"""Simulations between two commits."""


class SimulationCache:
    """Simulations of one simulator, kept in an SQLite file.

    A row's key is the hash of the simulator's identity, the trial's index, effects with their
    values (and the code of those that are not this package's), the nuisances' values, and the
    replicate. Rows are committed chunk by chunk, so that an interruption loses at most the chunk
    that was running. Several scenes may share a file.

    Args:
        simulator: makes what is missing.
        path: of the file; None: in memory.
        chunk: simulations between two commits.

    Attributes:
        simulated: number of simulations run since it was opened.

    Raises:
        DiagnosisError: the file is no simulation cache or cannot be used.
    """

    def __init__(
        self, simulator: Simulator, path: Path | None = None, *, chunk: int = CHUNK
    ) -> None:
        self.simulator = simulator
        self.simulated = 0
        self._asked: set[bytes] = set()
        self._chunk = chunk
        self._codes: dict[str, str] = {}
        self._path = path
        with self._usable():
            self._file = sqlite3.connect(":memory:" if path is None else path)
            self._file.execute(
                "CREATE TABLE IF NOT EXISTS runs (key BLOB PRIMARY KEY, response BLOB NOT NULL) "
                "WITHOUT ROWID"
            )
            self._file.execute("CREATE TABLE IF NOT EXISTS spent (seconds REAL, count INTEGER)")
            self._file.execute("SELECT key, response FROM runs LIMIT 1")
            self._file.execute("SELECT seconds, count FROM spent LIMIT 1")

    @contextmanager
    def _usable(self) -> Iterator[None]:
        """Turns what SQLite says of the file into an error with a remedy."""
        try:
            yield
        except sqlite3.Error as error:
            # The primary code; extended ones have more in the higher bits.
            code = getattr(error, "sqlite_errorcode", 0) & 0xFF
            if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
                remedy = "another process writes to it: wait until that ends, or choose another"
            elif isinstance(error, sqlite3.OperationalError):
                remedy = "see that its folder may be written to and has room, or choose another"
            else:
                remedy = "remove it, and its simulations are made again, or choose another"
            raise DiagnosisError(
                f"{self._path}: cannot be used as a simulation cache ({error}); {remedy} folder"
            ) from error

    @property
    def asked(self) -> int:
        """Different simulations asked for since it was opened."""
        return len(self._asked)

    @property
    def size(self) -> int:
        """Simulations in the file."""
        with self._usable():
            return int(self._file.execute("SELECT COUNT(*) FROM runs").fetchone()[0])

    @property
    def cost(self) -> float:
        """Mean wall time of a simulation over the file's life [s]; 0 before the first."""
        with self._usable():
            row = self._file.execute("SELECT SUM(seconds), SUM(count) FROM spent").fetchone()
        return float(row[0]) / float(row[1]) if row[1] else 0.0

    @property
    def reused(self) -> int:
        """Different simulations answered from what earlier runs left in the file."""
        return len(self._asked) - self.simulated

    def close(self) -> None:
        """Close the file; it stays."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def run(self, requests: Sequence[Request], *, progress: Progress | None = None) -> Responses:
        """Answer requests from the file, the rest by simulation.

        Args:
            requests: any, also the same twice.
            progress: called with the number of answered requests, as it grows, and of all.

        Raises:
            DiagnosisError: the file holds damaged simulations, or can no longer be used.
        """
        keys = [self._key(request) for request in requests]
        known = self._known(keys)
        missing = [i for i, key in enumerate(keys) if key not in known]
        first = {keys[i]: i for i in reversed(missing)}
        pending = sorted(first.values())
        self._asked.update(keys)
        _logger.debug("%d of %d simulations are to be run", len(pending), len(set(keys)))
        for start in range(0, len(pending), self._chunk):
            part = pending[start : start + self._chunk]
            started = time.monotonic()
            found = self.simulator.run([requests[i] for i in part])
            seconds = time.monotonic() - started
            rows = []
            for k, i in enumerate(part):
                values = [found.overturned[k], found.peak_tilt[k]]
                if found.features is not None:
                    values.extend(found.features[k])
                packed = struct.pack(f"<{len(values)}d", *values)
                known[keys[i]] = packed
                rows.append((keys[i], packed))
            with self._usable(), self._file:
                self._file.executemany("INSERT OR REPLACE INTO runs VALUES (?, ?)", rows)
                self._file.execute("INSERT INTO spent VALUES (?, ?)", (seconds, len(part)))
            self.simulated += len(part)
            if progress is not None:
                progress(len(requests) - len(pending) + start + len(part), len(requests))
        content = b"".join(known[key] for key in keys)
        sizes = {len(known[key]) for key in keys}
        if len(sizes) > 1 or any(size < 16 or size % 8 for size in sizes):
            raise DiagnosisError(
                f"{self._path}: holds damaged simulations; remove it, and they are made again"
            )
        table = np.frombuffer(content, dtype="<f8").reshape(len(requests), -1)
        features = table[:, 2:].copy() if table.shape[1] > 2 else None
        return Responses(table[:, 0].copy(), table[:, 1].copy(), features)

    def _key(self, request: Request) -> bytes:
        nuisances = self.simulator.nuisance_draw(request.nuisance).tobytes()
        text = f"{self.simulator.identity}|{request.trial}|{request.effects!r}|{request.nuisance}"
        text += "".join(self._code(name) for name, _ in request.effects)
        digest = hashlib.blake2b(text.encode(), digest_size=16)
        digest.update(nuisances + struct.pack("<q", request.replicate))
        return digest.digest()

    def _code(self, name: str) -> str:
        if name not in self._codes:
            effect = self.simulator.library.get(name)
            self._codes[name] = "" if effect is None else own_code(type(effect))
        return self._codes[name]

    def _known(self, keys: Sequence[bytes]) -> dict[bytes, bytes]:
        out: dict[bytes, bytes] = {}
        for start in range(0, len(keys), 500):
            part = keys[start : start + 500]
            marks = ",".join("?" * len(part))
            query = f"SELECT key, response FROM runs WHERE key IN ({marks})"
            with self._usable():
                out.update(self._file.execute(query, part).fetchall())
        return out


def own_code(kind: type) -> str:
    """What tells a user's class from another of its name; empty for classes of this package.

    Its source and that of its bases outside this package; of classes without one (typed in at a
    prompt) the bytecode of their functions. What they call elsewhere is not looked at.
    """
    return "".join(_code(base) for base in kind.__mro__ if base is not object)


def _code(kind: type) -> str:
    if kind.__module__.split(".")[0] == __name__.split(".")[0]:
        return ""
    try:
        return inspect.getsource(kind)
    except (OSError, TypeError):
        codes = [getattr(value, "__code__", None) for _, value in sorted(vars(kind).items())]
        return "".join(marshal.dumps(code).hex() for code in codes if code is not None)
