"""The simulation cache: what was simulated once is never simulated again."""

from __future__ import annotations

import hashlib
import logging
import struct
import time
from base64 import b64decode, b64encode
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from vsr2.effects.own_code import own_code
from vsr2.ensemble.simulated.simulator import Request, Responses, Simulator
from vsr2.errors import ResultError
from vsr2.one_line import counted
from vsr2.results.store import Store, StoreKind, is_number, odd_value

_logger = logging.getLogger(__name__)

Progress = Callable[[int, int], None]
"""Called with simulations done and all."""
CHUNK = 512
"""Simulations between two writes: an interruption loses no more, and a write costs little beside
them (docs/architecture.md, the store of finished work). No result depends on it."""
KEY = 16
"""Length of a key [byte]."""
Table = NDArray[np.float32]
_KIND = StoreKind(
    format="vsr2 simulations",
    version=2,
    foreign="is no simulation cache of this form; remove it, and its simulations are made again",
    damaged="remove it, and its simulations are made again",
    unsummed=True,
)


class SimulationCache:
    """Simulations of one simulator, kept in a store.

    A simulation's key is the hash of the simulator's identity, the trial's index, effects with
    their values (and the code of those that are not this package's), the nuisances' values, and the
    replicate. A record holds a chunk of them, in single precision, so that an interruption loses at
    most the chunk that was running. Several scenes may share a file. All of it is in memory while
    it is open.

    Args:
        simulator: makes what is missing.
        path: of the file; None: in memory.
        chunk: simulations between two writes.

    Attributes:
        simulated: number of simulations run since it was opened.

    Raises:
        ResultError: as of :class:`vsr2.results.store.Store`.
    """

    def __init__(
        self, simulator: Simulator, path: Path | None = None, *, chunk: int = CHUNK
    ) -> None:
        self.simulator = simulator
        self.simulated = 0
        self._asked: set[bytes] = set()
        self._chunk = chunk
        self._codes: dict[str, str] = {}
        self._draws: dict[int, bytes] = {}
        self._path = path
        self._place: dict[bytes, tuple[int, int]] = {}
        self._tables: list[Table] = []
        self._seconds = 0.0
        if path is not None:
            old = path.with_suffix(".sqlite")
            if old.exists():
                raise ResultError(f"{old}: is a simulation cache of an older VSR2; {_KIND.damaged}")
        self._store = None if path is None else Store(path, _KIND, {}, self._take)

    def _take(self, record: dict[str, Any]) -> None:
        keys = _decoded(record, "keys")
        responses = _decoded(record, "responses")
        count = len(keys) // KEY
        if not count or len(keys) % KEY:
            raise odd_value("keys", record["keys"], f"keys of {KEY} bytes")
        if len(responses) % (4 * count) or len(responses) < 8 * count:
            wanted = f"equally many numbers for each of {count} keys"
            raise odd_value("responses", record["responses"], wanted)
        rows = np.frombuffer(responses, dtype="<f4")
        if np.isinf(rows).any():
            raise odd_value("responses", record["responses"], "finite numbers")
        seconds = record["seconds"]
        if not (is_number(seconds) and seconds >= 0):
            raise odd_value("seconds", seconds, "a time")
        self._tables.append(rows.reshape(count, -1))
        self._seconds += seconds
        for i in range(count):
            self._place[keys[KEY * i : KEY * (i + 1)]] = (len(self._tables) - 1, i)

    @property
    def asked(self) -> int:
        """Different simulations asked for since it was opened."""
        return len(self._asked)

    @property
    def size(self) -> int:
        """Simulations in it."""
        return len(self._place)

    @property
    def cost(self) -> float:
        """Mean wall time of a simulation over the file's life [s]; 0 before the first."""
        return self._seconds / self.size if self.size else 0.0

    @property
    def reused(self) -> int:
        """Different simulations answered from what earlier runs left in the file."""
        return len(self._asked) - self.simulated

    def close(self) -> None:
        """Close the file; it stays."""
        if self._store is not None:
            self._store.close()

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
            ResultError: the file is damaged, or can no longer be written.
        """
        keys = [self._key(request) for request in requests]
        missing = [i for i, key in enumerate(keys) if key not in self._place]
        first = {keys[i]: i for i in reversed(missing)}
        pending = sorted(first.values())
        self._asked.update(keys)
        _logger.debug("to be run: %d of %s", len(pending), counted(len(set(keys)), "simulation"))
        for start in range(0, len(pending), self._chunk):
            part = pending[start : start + self._chunk]
            started = time.monotonic()
            found = self.simulator.run([requests[i] for i in part])
            columns = [found.overturned, found.peak_tilt]
            if found.features is not None:
                columns.extend(found.features.T)
            record = {
                "keys": b64encode(b"".join(keys[i] for i in part)).decode(),
                "responses": b64encode(np.column_stack(columns).astype("<f4").tobytes()).decode(),
                "seconds": time.monotonic() - started,
            }
            if self._store is not None:
                self._store.add(record)
            self._take(record)
            self.simulated += len(part)
            if progress is not None:
                progress(len(requests) - len(pending) + start + len(part), len(requests))
        at = [self._place[key] for key in keys]
        if len({self._tables[t].shape[1] for t, _ in at}) > 1:
            raise ResultError(
                f"{self._path}: damaged (simulations of different lengths); {_KIND.damaged}"
            )
        rows = [self._tables[t][i] for t, i in at]
        table = np.array(rows, dtype=np.float64).reshape(len(requests), -1)
        features = table[:, 2:].copy() if table.shape[1] > 2 else None
        return Responses(table[:, 0].copy(), table[:, 1].copy(), features)

    def _key(self, request: Request) -> bytes:
        nuisances = self._draws.get(request.nuisance)
        if nuisances is None:
            nuisances = self.simulator.nuisance_draw(request.nuisance).tobytes()
            self._draws[request.nuisance] = nuisances
        text = f"{self.simulator.identity}|{request.trial}|{request.effects!r}|{request.nuisance}"
        text += "".join(self._code(name) for name, _ in request.effects)
        digest = hashlib.blake2b(text.encode(), digest_size=KEY)
        digest.update(nuisances + struct.pack("<q", request.replicate))
        return digest.digest()

    def _code(self, name: str) -> str:
        if name not in self._codes:
            effect = self.simulator.library.get(name)
            self._codes[name] = "" if effect is None else own_code(type(effect))
        return self._codes[name]


def _decoded(record: dict[str, Any], name: str) -> bytes:
    text = record[name]
    try:
        return b64decode(text, validate=True)
    except (TypeError, ValueError):
        raise odd_value(name, text, "text in base 64") from None
