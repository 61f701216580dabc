"""Trials on a worker of a cluster: how they travel there, and how they are run.

Trials are pickled, but for what is large and what many of them share: motions and collision hulls.
These stand in the pickle as the hash of their content and travel apart from it.
"""

from __future__ import annotations

import hashlib
import io
import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

from vsr2 import _native
from vsr2.errors import SimulationError
from vsr2.motion import Motion
from vsr2.results import Status, TrialLog, base_provenance
from vsr2.scene import Hull, Scene, Triangles
from vsr2.simulation.native_trials import run_native
from vsr2.trial import Trial

_stopped: set[str] = set()


@dataclass(frozen=True)
class Finished:
    """What a chunk gave.

    Attributes:
        trials: of each that finished: position in the chunk, row, log.
        worker: address of the worker.
        processor: model of its processor.
    """

    trials: list[tuple[int, dict[str, Any], TrialLog | None]]
    worker: str
    processor: str


Part: TypeAlias = Motion | Hull | Triangles
"""What travels apart."""


class _Pickler(pickle.Pickler):
    def __init__(self, buffer: io.BytesIO) -> None:
        super().__init__(buffer, protocol=5)
        self.parts: dict[str, Part] = {}
        self._keys: dict[int, str] = {}

    def persistent_id(self, value: Any) -> str | None:
        if not isinstance(value, Part):
            return None
        key = self._keys.get(id(value))
        if key is None:
            key = self._keys[id(value)] = _key(value)
            self.parts[key] = value
        return key


class _Unpickler(pickle.Unpickler):
    def __init__(self, content: bytes, parts: Mapping[str, Part]) -> None:
        super().__init__(io.BytesIO(content))
        self._parts = parts

    def persistent_load(self, key: Any) -> Part:
        return self._parts[key]


def _key(part: Part) -> str:
    """Of all that a worker uses of a part."""
    if isinstance(part, Motion):
        return f"motion-{part.kind}-{part.sha256}"
    arrays = (part.points,) if isinstance(part, Hull) else (part.vertices, part.faces)
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(f"{array.dtype}{array.shape}".encode() + array.tobytes())
    return f"mesh-{digest.hexdigest()}"


def pack(trials: Sequence[Trial]) -> tuple[bytes, dict[str, Part]]:
    """Trials for :func:`run_chunk`, and the parts that travel apart by their keys."""
    scenes: dict[str, Scene] = {}
    bare = []
    for trial in trials:
        scene = trial.scene
        if scene.sha256 not in scenes:
            scenes[scene.sha256] = replace(
                scene,
                rock=replace(scene.rock, surface=None, source="", sha256="", notes=()),
                pedestal=replace(scene.pedestal, surface=None, source="", sha256=""),
            )
        bare.append(
            replace(trial, scene=scenes[scene.sha256], start=trial.start_pose, name="", effects=())
        )
    buffer = io.BytesIO()
    pickler = _Pickler(buffer)
    pickler.dump(bare)
    return buffer.getvalue(), pickler.parts


def packed_part(part: Part) -> bytes:
    """A part as it travels, without what workers do not use; `pickle.loads` gives it back."""
    if isinstance(part, Motion):
        part = replace(part, name="", source="", recorded=None)
    return pickle.dumps(part, protocol=5)


def stop(run: str) -> None:
    """Stop all chunks of a run on this worker, and those that come later."""
    _stopped.add(run)


def run_chunk(
    run: str, build_facts: dict[str, str], content: bytes, parts: Mapping[str, Part]
) -> Finished:
    """Run trials on one thread of this worker.

    Args:
        run: that the chunk belongs to; :func:`stop` ends it.
        build_facts: of the client's native core, which this worker's must equal.
        content: from :func:`pack`.
        parts: by the keys that `content` names.

    Raises:
        SimulationError: this worker's native core is another.
    """
    if _native.build_facts() != build_facts:
        raise SimulationError(
            f"the worker's native core {_native.build_facts()} is not the client's {build_facts}"
        )
    import distributed

    trials = _Unpickler(content, parts).load()
    finished: list[tuple[int, dict[str, Any], TrialLog | None]] = []

    def take(k: int, _: Trial, row: dict[str, Any], log: TrialLog | None) -> None:
        if row["status"] != Status.cancelled:
            finished.append((k, row, log))

    if run not in _stopped:
        run_native(trials, 1, take=take, stopped=lambda: run in _stopped)
    return Finished(finished, distributed.get_worker().address, base_provenance()["processor"])
