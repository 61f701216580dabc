"""The native core's scenes, one of each content."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any, NamedTuple, assert_never
from weakref import WeakKeyDictionary

import numpy as np

from vsr2 import _native
from vsr2.config.study import Engine
from vsr2.errors import Fault, SimulationError
from vsr2.scene import Box, Hull, Scene, Triangles

MAX_NATIVE_SCENES = 64
"""Native scenes kept by this process; those of one mesh share its points."""
MAX_NATIVE_POINTS = 2**19
"""Points of their hulls together; at least one scene is kept."""
POINT_BYTES = 100
"""Memory that a point of a native scene's hulls takes, about."""

_NOT_FAST = [one.name for one in _native.contact_parameters() if not one.fast]
FAST_REFUSALS: Mapping[_native.FastRefusal, str] = {
    _native.FastRefusal.contact_parameter: f"its contact has {' or '.join(_NOT_FAST)}",
    _native.FastRefusal.no_friction_cone: "its friction is no cone",
    _native.FastRefusal.no_margin: "its shapes have no margin",
    _native.FastRefusal.pedestal_not_a_box: "its pedestal is not a box",
    _native.FastRefusal.several_parts: "its rock has several parts",
}
"""Why `fast` does not take a scene."""


class _Kept(NamedTuple):
    scene: _native.Scene
    points: int
    """Of its hulls."""


_kept: OrderedDict[str, _Kept] = OrderedDict()
_hulls: WeakKeyDictionary[Hull, _native.HullPart] = WeakKeyDictionary()
# A part keeps the hull that Bullet makes of its points. Scenes that differ in mass or contact have
# the same `Hull`, whose points nothing changes.
_lock = threading.Lock()


def native_scene(scene: Scene) -> _native.Scene:
    """The core's scene with its collision shapes; scenes of equal content share one.

    Raises:
        SimulationError: values that no engine can use, or that the engine asked for does not take.
        ConfigError: the engine's time step is still to be chosen.
    """
    scene.engine.check_time_step()
    with _lock:
        if scene.sha256 not in _kept:
            _kept[scene.sha256] = _Kept(_built(scene), hull_points(scene))
            while len(_kept) > 1 and (
                len(_kept) > MAX_NATIVE_SCENES
                or sum(one.points for one in _kept.values()) > MAX_NATIVE_POINTS
            ):
                _kept.popitem(last=False)
        _kept.move_to_end(scene.sha256)
        return _kept[scene.sha256].scene


def hull_points(scene: Scene) -> int:
    """Points of a rock's hulls."""
    return sum(len(part.points) for part in scene.rock.parts if isinstance(part, Hull))


def _built(scene: Scene) -> _native.Scene:
    rock, pedestal, engine, contact = scene.rock, scene.pedestal, scene.engine, scene.contact
    frame, spring = scene.body_frame, pedestal.pitch_spring
    with refusals(rock.source or "scene"):
        native = _native.Scene(
            engine=_native_engine(engine),
            pedestal=_native.PedestalSpec(
                parts=_native_parts(pedestal.parts),
                origin=np.asarray(pedestal.origin, dtype=np.float64),
                mass=pedestal.mass,
                base_size=np.asarray(pedestal.base_size, dtype=np.float64),
                top=pedestal.top,
                material=contact.pedestal.values,
                pitch_pivot=scene.pitch_pivot,
                pitch_spring=None if spring is None else _native.PitchSpring(**asdict(spring)),
            ),
            rock=_native.RockSpec(
                parts=_native_parts(rock.parts),
                mass=rock.mass.mass,
                principal_inertia=rock.mass.principal_inertia,
                inertia_from_aabb=rock.inertia_from_aabb,
                mass_center=np.asarray(frame.position),
                principal_axes=np.asarray(frame.orientation),
                material=contact.rock.values,
            ),
            mechanisms=_native.Mechanisms(**asdict(scene.mechanisms)),
        )
        refusal = native.fast_refusal
        if engine.mode == "fast" and refusal != _native.FastRefusal.none:
            raise SimulationError(
                f"engine.mode: fast does not take this scene: {FAST_REFUSALS[refusal]}; "
                "choose auto or exact",
                fault=Fault.engine_domain,
            )
    return native


@contextmanager
def refusals(what: str) -> Iterator[None]:
    """What the core refuses, as an error that says in what, or in doing what."""
    try:
        yield
    except _native.InvalidInput as error:
        raise SimulationError(f"{what}: {error}", fault=vars(error)["fault"]) from error


def _box(part: Box) -> _native.BoxPart:
    return _native.BoxPart(
        size=np.asarray(part.size, dtype=np.float64),
        position=np.asarray(part.center, dtype=np.float64),
        orientation=np.asarray(part.orientation, dtype=np.float64),
    )


def _native_parts(parts: Sequence[Hull | Box | Triangles]) -> list[Any]:
    out: list[Any] = []
    for part in parts:
        match part:
            case Hull():
                if part not in _hulls:
                    _hulls[part] = _native.HullPart(points=part.points)
                out.append(_hulls[part])
            case Box():
                out.append(_box(part))
            case Triangles():
                out.append(_native.TrianglesPart(vertices=part.vertices, faces=part.faces))
            case _:
                assert_never(part)
    return out


def _native_engine(engine: Engine) -> _native.EngineSettings:
    values = engine.model_dump(
        exclude={"mode", "skip", "split_impulse", "split_impulse_penetration_threshold"}
    )
    values["skip_quiet"] = engine.skip == "quiet"
    # Bullet's own default damping is the single-precision 0.04; parity needs its bits.
    for key in ("linear_damping", "angular_damping"):
        values[key] = float(np.float32(values[key]))
    return _native.EngineSettings(kind=getattr(_native.EngineKind, engine.mode), **values)
