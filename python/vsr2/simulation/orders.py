"""Trials as they travel to the workers of a cluster, and what a worker does with them.

Collision parts and motions travel by the hashes of their bytes, apart from the orders that need
them.
"""

from __future__ import annotations

import hashlib
import pickle
import threading
from collections import Counter, OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from vsr2 import _native
from vsr2.config.study import Contact, Engine, Outcome, Output, Settling
from vsr2.errors import SimulationError
from vsr2.motion import Motion, SideMotion
from vsr2.results import TrialLog, base_provenance
from vsr2.scene import Mechanisms, PedestalBody, Pose, RockBody
from vsr2.simulation.native_trials import run_native
from vsr2.simulation.scene import Scene, make_scene
from vsr2.simulation.trial import Trial

_MAX_SCENES = 32


@dataclass(frozen=True)
class SceneOrder:
    """A scene without its collision parts, which travel by their hashes."""

    sha256: str
    rock: RockBody
    rock_parts: str
    pedestal: PedestalBody
    pedestal_parts: str
    engine: Engine
    contact: Contact
    mechanisms: Mechanisms


@dataclass(frozen=True)
class MotionOrder:
    """A motion without its samples, which travel by their hash."""

    samples: str
    name: str
    time_step: float
    kind: Literal["cosine", "recording"]
    sides: tuple[str, ...]


@dataclass(frozen=True)
class TrialOrder:
    """A trial as it is ordered from a worker."""

    scene: SceneOrder
    motion: MotionOrder
    drive: Literal["prescribed", "motor"]
    start: Pose
    seed: int
    settling: Settling
    outcome: Outcome
    output: Output


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


def _samples(motion: Motion) -> bytes:
    rows = [motion.displacement, motion.velocity, motion.acceleration]
    for side in motion.sides.values():
        if side is not None:
            rows += [side.displacement, side.velocity]
    return np.stack(rows).tobytes()


def _parts(body: RockBody | PedestalBody) -> bytes:
    return pickle.dumps(body.parts, protocol=5)


def _bare(body: Any) -> Any:
    """A body without all that the core does not use."""
    return replace(body, parts=(), surface=None, source="", sha256="")


class Cargo:
    """Orders of trials, and the content that they need: collision parts and samples."""

    def __init__(self, trials: Sequence[Trial]) -> None:
        self._keys: dict[int, str] = {}
        self._sources: dict[str, Callable[[], bytes]] = {}
        self._scenes: dict[int, SceneOrder] = {}
        self._orders = [self._order(trial) for trial in trials]
        self._open = Counter(key for i in range(len(trials)) for key in self.keys(i))

    def orders(self, positions: Sequence[int]) -> bytes:
        """The orders of some trials, for `run_chunk`."""
        return pickle.dumps([self._orders[i] for i in positions], protocol=5)

    def keys(self, i: int) -> tuple[str, str, str]:
        """Of the content that a trial needs."""
        order = self._orders[i]
        return order.motion.samples, order.scene.rock_parts, order.scene.pedestal_parts

    def content(self, key: str) -> bytes:
        """The content of a key."""
        return self._sources[key]()

    def done(self, i: int) -> None:
        """Note that a trial is finished."""
        self._open.subtract(self.keys(i))

    def needed(self, key: str) -> bool:
        """Whether a trial that is not finished needs the content."""
        return self._open[key] > 0

    def _order(self, trial: Trial) -> TrialOrder:
        scene, motion = trial.scene, trial.motion
        if id(scene) not in self._scenes:
            self._scenes[id(scene)] = SceneOrder(
                sha256=scene.sha256,
                rock=replace(_bare(scene.rock), notes=()),
                rock_parts=self._key("mesh", scene.rock, lambda: _parts(scene.rock)),
                pedestal=_bare(scene.pedestal),
                pedestal_parts=self._key("mesh", scene.pedestal, lambda: _parts(scene.pedestal)),
                engine=scene.engine,
                contact=scene.contact,
                mechanisms=scene.mechanisms,
            )
        return TrialOrder(
            scene=self._scenes[id(scene)],
            motion=MotionOrder(
                samples=self._key("motion", motion, lambda: _samples(motion)),
                name=motion.name,
                time_step=motion.time_step,
                kind=motion.kind,
                sides=tuple(name for name, side in motion.sides.items() if side is not None),
            ),
            drive=trial.drive,
            start=trial.start or scene.rock.start,
            seed=trial.seed,
            settling=trial.settling,
            outcome=trial.outcome,
            output=trial.output,
        )

    def _key(self, kind: str, source: object, content: Callable[[], bytes]) -> str:
        if id(source) not in self._keys:
            key = f"{kind}-{hashlib.sha256(content()).hexdigest()}"
            self._keys[id(source)] = key
            self._sources.setdefault(key, content)
        return self._keys[id(source)]


_scenes: OrderedDict[str, Scene] = OrderedDict()
_scenes_lock = threading.Lock()
_stopped: set[str] = set()


def hold(content: bytes) -> bytes:
    """The task that gives content to those that need it."""
    return content


def stop(run: str) -> None:
    """Stop all chunks of a run on this worker, and those that come later."""
    _stopped.add(run)


def run_chunk(
    run: str, build_facts: dict[str, str], orders: bytes, content: Mapping[str, bytes]
) -> Finished:
    """Run trials on one thread of this worker.

    Args:
        run: that the chunk belongs to; :func:`stop` ends it.
        build_facts: of the client's native core, which this worker's must equal.
        orders: from :meth:`Cargo.orders`.
        content: by the keys that the orders name.

    Raises:
        SimulationError: this worker's native core is another.
    """
    if _native.build_facts() != build_facts:
        raise SimulationError(
            f"the worker's native core {_native.build_facts()} is not the client's {build_facts}"
        )
    import distributed

    received: list[TrialOrder] = pickle.loads(orders)
    motions = {
        order.motion: _motion(order.motion, content[order.motion.samples]) for order in received
    }
    trials = [
        Trial(
            scene=_scene(order.scene, content),
            motion=motions[order.motion],
            drive=order.drive,
            start=order.start,
            seed=order.seed,
            settling=order.settling,
            outcome=order.outcome,
            output=order.output,
        )
        for order in received
    ]
    finished: list[tuple[int, dict[str, Any], TrialLog | None]] = []

    def take(k: int, row: dict[str, Any], log: TrialLog | None) -> None:
        if row["status"] != "cancelled":
            finished.append((k, row, log))

    if run not in _stopped:
        run_native(trials, 1, take=take, stopped=lambda: run in _stopped)
    return Finished(finished, distributed.get_worker().address, base_provenance()["processor"])


def _motion(order: MotionOrder, samples: bytes) -> Motion:
    rows = np.frombuffer(samples).reshape(3 + 2 * len(order.sides), -1)
    displacement, velocity, acceleration = rows[:3]
    sides = {
        name: SideMotion(rows[3 + 2 * k], rows[4 + 2 * k]) for k, name in enumerate(order.sides)
    }
    return Motion(
        name=order.name,
        time_step=order.time_step,
        displacement=displacement,
        velocity=velocity,
        acceleration=acceleration,
        kind=order.kind,
        transverse=sides.get("transverse"),
        vertical=sides.get("vertical"),
        pitch=sides.get("pitch"),
    )


def _scene(order: SceneOrder, content: Mapping[str, bytes]) -> Scene:
    """The scene, built once a worker as long as it is in use."""
    with _scenes_lock:
        scene = _scenes.get(order.sha256)
        if scene is None:
            scene = make_scene(
                replace(order.rock, parts=pickle.loads(content[order.rock_parts])),
                replace(order.pedestal, parts=pickle.loads(content[order.pedestal_parts])),
                order.engine,
                order.contact,
                order.mechanisms,
            )
            _scenes[order.sha256] = scene
        _scenes.move_to_end(order.sha256)
        while len(_scenes) > _MAX_SCENES:
            _scenes.popitem(last=False)
        return scene
