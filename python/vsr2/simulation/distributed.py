"""Batches on a cluster of Dask distributed.

A chunk of trials is a task of a few kilobytes. Meshes and motions are tasks of their own, whose
keys are the hashes of their content and which return it: the client sends each to the scheduler
once, a worker that needs it fetches it once, and the scheduler can hand it out again whichever
worker dies. Dask's `scatter` would not do: what lies on a worker that dies is lost.

Dask runs the chunk of a lost worker again elsewhere. A chunk that outlives no worker is taken apart
at the end, when nothing else runs, so that only a trial that kills workers all alone is given up.
"""

from __future__ import annotations

import logging
import os
import pickle
import queue
import threading
import time
from collections import Counter, OrderedDict, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from vsr2 import _native
from vsr2.config.bounded import near_path
from vsr2.errors import SimulationError
from vsr2.results import TrialLog
from vsr2.simulation.native_trials import QUEUE, failed_row
from vsr2.simulation.planning import log_bytes
from vsr2.simulation.worker import Finished, Part, pack, packed_part, run_chunk, stop
from vsr2.trial import Trial

if TYPE_CHECKING:
    import distributed

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class ClusterConstants:
    """How trials are dealt to a cluster; chosen by hand.

    Attributes:
        chunk_trials: most trials of a chunk.
        chunk_steps: time steps of a chunk, unless a single trial has more: what a lost worker can
            cost.
        chunk_bytes: size of a chunk's logs, unless a single trial has more [byte]: bounds memory
            everywhere.
        kept_bytes: meshes and motions stay on the cluster up to this size, for the next chunks and
            batches of the same client [byte].
        steps_beside_motion: time steps that a trial is reckoned with beside its motion's.
        chunks_a_thread: least number of chunks that each thread gets, if there are so many trials.
        window: least number of chunks under way.
        fetches: results that are fetched at a time.
        stop_grace: for which results are waited for once workers were asked to stop [s].
        look_every: between two looks for a scheduler's file [s].
        count_every: between two counts of the cluster's threads [s].
    """

    chunk_trials: int = 64
    chunk_steps: int = 100_000
    chunk_bytes: int = 8 * 2**20
    kept_bytes: int = 2**28
    steps_beside_motion: int = 2000
    chunks_a_thread: int = 4
    window: int = 64
    fetches: int = 4
    stop_grace: float = 0.7
    look_every: float = 0.1
    count_every: float = 2.0


CLUSTER = ClusterConstants()


def _await_file(path: str, timeout: float) -> None:
    """Wait for the file of a scheduler that is starting; Dask would wait for ever.

    Raises:
        SimulationError: it is not there in time.
    """
    ends = time.monotonic() + timeout
    while not os.path.isfile(path):
        if time.monotonic() >= ends:
            near = near_path(path)
            remedy = f"did you mean {near}?" if near else "give the one that `dask scheduler` wrote"
            raise SimulationError(f"scheduler {path}: no such file after {timeout:g} s; {remedy}")
        time.sleep(min(CLUSTER.look_every, timeout))


def connect(address: str, *, timeout: float = 10.0) -> distributed.Client:
    """A client of the scheduler at an address such as tcp://10.0.0.1:8786.

    Args:
        address: of the scheduler, or the path of its scheduler file (.json).
        timeout: give up after this long [s].

    Raises:
        SimulationError: Dask distributed is not installed, or no scheduler answers.
    """
    module = _distributed()
    where = {"scheduler_file": address} if address.endswith(".json") else {"address": address}
    if "scheduler_file" in where:
        _await_file(address, timeout)
    try:
        client: distributed.Client = module.Client(
            **where, timeout=timeout, set_as_default=False, name="vsr2"
        )
    except (OSError, ValueError) as error:
        reason = str(error) or type(error).__name__
        raise SimulationError(
            f"scheduler {address}: cannot be reached ({reason}); give the address that `dask "
            "scheduler` printed, such as tcp://10.0.0.1:8786"
        ) from error
    _logger.info("connected to scheduler %s", address)
    return client


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise SimulationError(
            "Dask distributed is not installed; pip install 'vsr2[parallel]', here and on every "
            "worker"
        ) from error
    return distributed


def run_on_cluster(
    trials: Sequence[Trial],
    client: distributed.Client,
    *,
    take: Callable[[int, Mapping[str, Any], TrialLog | None], None],
    stopped: Callable[[], bool],
) -> dict[str, Any]:
    """Run trials on the workers of a cluster; bits are those of :func:`run_native`.

    Where no worker is connected, it waits for one.

    Args:
        trials: what to run; they passed :func:`vsr2.simulation.check_trials`.
        client: of the cluster.
        take: called with index, row and log of each trial as it comes back.
        stopped: asked every `poll`; once true, workers stop, and what they have finished is still
            taken if it comes within a second.

    Returns:
        For the provenance: `scheduler`, the number of `workers` that sent results, and their
        `processors`.

    Raises:
        SimulationError: before any trial starts, where the client cannot be used; later, where the
            workers run another VSR2 or the cluster is lost.
    """
    module = _distributed()
    if not isinstance(client, module.Client):
        raise SimulationError(f"client must be a distributed.Client, it is {client!r}")
    if client.asynchronous:
        raise SimulationError("client is asynchronous; make it by Client(..., asynchronous=False)")
    if client.status != "running":
        raise SimulationError(f"client is {client.status}; connect a new one")
    return _ClusterRun(trials, client, take, stopped).run()


class _Held:
    """Motions and meshes on the cluster by their keys, the latest used last."""

    def __init__(self, client: distributed.Client) -> None:
        self.client = client
        self._futures: OrderedDict[str, tuple[Any, int]] = OrderedDict()
        self._sent: Counter[str] = Counter()
        self._bytes = 0
        self._lock = threading.Lock()

    def future(self, key: str, part: Part) -> Any:
        """The task that gives a part; sent unless it is there."""
        import dask

        with self._lock:
            if key in self._futures:
                future, size = self._futures[key]
                if future.status in ("pending", "finished"):
                    self._futures.move_to_end(key)
                    return future
                self._bytes -= size
            content = packed_part(part)
            # A number, because the scheduler may still remember how it gave up the one before.
            name = f"vsr2-{key}-{self._sent[key]}"
            self._sent[key] += 1
            # Dask warns of large tasks, since most of them are large by mistake.
            with dask.config.set({"distributed.admin.large-graph-warning-threshold": "1 TiB"}):
                future = self.client.submit(pickle.loads, content, key=name)
            self._futures[key] = (future, len(content))
            self._bytes += len(content)
            # Chunks under way keep what they need, though it is let go of here.
            while self._bytes > CLUSTER.kept_bytes and len(self._futures) > 1:
                _, (_, size) = self._futures.popitem(last=False)
                self._bytes -= size
            return future


_held: dict[str, _Held] = {}


def _held_of(client: distributed.Client) -> _Held:
    for name in [name for name, held in _held.items() if held.client.status == "closed"]:
        del _held[name]
    return _held.setdefault(client.id, _Held(client))


def _chunks(trials: Sequence[Trial], threads: int) -> Iterable[range]:
    """Positions of trials that go together, for a cluster of so many threads."""
    most = min(CLUSTER.chunk_trials, -(-len(trials) // (CLUSTER.chunks_a_thread * max(1, threads))))
    start, steps, size = 0, 0, 0.0
    for i, trial in enumerate(trials):
        own_steps = trial.motion.displacement.size + CLUSTER.steps_beside_motion
        own_size = log_bytes(trial)
        full = i - start >= most or steps + own_steps > CLUSTER.chunk_steps
        if i > start and (full or size + own_size > CLUSTER.chunk_bytes):
            yield range(start, i)
            start, steps, size = i, 0, 0.0
        steps += own_steps
        size += own_size
    if len(trials) > start:
        yield range(start, len(trials))


@dataclass(eq=False)
class _Flight:
    """A chunk under way; `alone`: nothing else is."""

    positions: Sequence[int]
    key: str
    alone: bool
    future: Any = None


_Events: TypeAlias = queue.SimpleQueue[tuple[_Flight, bool, Any]]
"""A chunk, whether its result is here, and the result."""


class _ClusterRun:
    """One batch on a cluster."""

    def __init__(
        self,
        trials: Sequence[Trial],
        client: distributed.Client,
        take: Callable[[int, Mapping[str, Any], TrialLog | None], None],
        stopped: Callable[[], bool],
    ) -> None:
        self._trials = trials
        self._client: Any = client
        self._take = take
        self._stopped = stopped
        self._name = f"{client.id}-{time.time_ns():x}"
        self._held = _held_of(client)
        self._events: _Events = queue.SimpleQueue()
        self._flying: set[_Flight] = set()
        self._started = 0
        self._suspects: deque[int] = deque()
        self._tries: Counter[int] = Counter()
        self._workers: set[str] = set()
        self._processors: set[str] = set()

    def run(self) -> dict[str, Any]:
        threads, address = self._threads(), self._client.scheduler_info()["address"]
        chunks = deque(_chunks(self._trials, threads))
        window, counted = max(CLUSTER.window, 2 * threads), time.monotonic()
        landed: deque[_Flight] = deque()
        fetching = 0
        deadline: float | None = None
        try:
            while chunks or self._flying or self._suspects:
                if deadline is None and self._stopped():
                    deadline = time.monotonic() + CLUSTER.stop_grace
                    self._stop_workers()
                    chunks.clear()
                    self._suspects.clear()
                if deadline is not None and time.monotonic() > deadline:
                    break
                if self._suspects and not chunks and not self._flying:
                    self._start([self._suspects.popleft()], alone=True)
                while chunks and len(self._flying) < window:
                    self._start(chunks.popleft())
                if chunks and time.monotonic() > counted + CLUSTER.count_every:
                    window, counted = max(CLUSTER.window, 2 * self._threads()), time.monotonic()
                try:
                    flight, fetched, result = self._events.get(timeout=QUEUE.poll)
                except queue.Empty:
                    continue
                if fetched:
                    fetching -= 1
                    self._flying.discard(flight)
                    flight.future.release()
                    self._land(flight, result)
                else:
                    landed.append(flight)
                # Few at a time: what is not fetched yet stays in the memory of the workers.
                while landed and fetching < CLUSTER.fetches:
                    fetching += 1
                    self._client.loop.add_callback(_fetch, landed.popleft(), self._events)
        finally:
            if self._flying:
                if deadline is None:
                    self._stop_workers()
                for flight in self._flying:
                    flight.future.release()
        return {
            "scheduler": address,
            "workers": len(self._workers),
            "processors": sorted(self._processors),
        }

    def _threads(self) -> int:
        """Threads of all workers that are connected now."""
        try:
            return sum(self._client.nthreads().values())
        except OSError as error:
            raise SimulationError(
                f"the scheduler does not answer ({error}); what was finished is kept where there "
                "is a checkpoint"
            ) from error

    def _start(self, positions: Sequence[int], *, alone: bool = False) -> None:
        content, parts = pack([self._trials[i] for i in positions])
        flight = _Flight(positions, f"vsr2-trials-{self._name}-{self._started}", alone)
        self._started += 1
        flight.future = self._client.submit(
            run_chunk,
            self._name,
            _native.build_facts(),
            content,
            {key: self._held.future(key, part) for key, part in parts.items()},
            key=flight.key,
        )
        self._flying.add(flight)
        flight.future.add_done_callback(lambda _: self._events.put((flight, False, None)))

    def _land(self, flight: _Flight, result: Any) -> None:
        if isinstance(result, Finished):
            self._workers.add(result.worker)
            self._processors.add(result.processor)
            for k, row, log in result.trials:
                self._take(flight.positions[k], row, log)
        elif not isinstance(result, _distributed().KilledWorker):
            raise self._error(flight, result) from result
        elif flight.alone and (result.task == flight.key or self._tries[flight.positions[0]] > 2):
            [i] = flight.positions
            self._take(i, failed_row(self._trials[i], f"every worker died: {result}"), None)
        else:
            self._suspects.extend(flight.positions)
            self._tries.update(flight.positions)

    def _error(self, flight: _Flight, cause: BaseException) -> SimulationError:
        names = [self._trials[i].label for i in flight.positions]
        return SimulationError(
            f"the cluster cannot run trials {names[0]!r} to {names[-1]!r} "
            f"({type(cause).__name__}: {cause}); scheduler and workers need the VSR2 and Dask "
            "that run here. What was finished is kept where there is a checkpoint"
        )

    def _stop_workers(self) -> None:
        """Tell all workers to stop, without waiting for those that do not answer."""

        def tell() -> None:
            # Releasing the tasks stops what has not begun, should this not get through.
            with suppress(Exception):
                self._client.run(stop, self._name, on_error="ignore")

        threading.Thread(target=tell, name="vsr2-stop", daemon=True).start()


async def _fetch(flight: _Flight, events: _Events) -> None:
    """Bring the result of a finished task here, in the client's event loop."""
    import asyncio

    try:
        result = await flight.future.result()
    except (Exception, asyncio.CancelledError) as error:
        result = error
    events.put((flight, True, result))
