"""VSR2: a virtual shake robot for precariously balanced rocks.

`run_batch` runs a study; `Simulation` is one world to step; the command line is `vsr2`.
"""

# Nothing is imported: what comes before `vsr2.cli.entry` is not guarded against Ctrl-C.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    __version__: str
    from vsr2.config import Study, load_study
    from vsr2.diagnosis import Diagnosis
    from vsr2.diagnosis.api import diagnose
    from vsr2.effects import apply_effects
    from vsr2.motion import Motion
    from vsr2.prediction.prediction import predict
    from vsr2.results import BatchResult, TrialLog, load_result, save_result
    from vsr2.scene import Scene, build_scene
    from vsr2.simulation import Simulation, run_batch
    from vsr2.trial import Trial

__all__ = [
    "BatchResult",
    "Diagnosis",
    "Motion",
    "Scene",
    "Simulation",
    "Study",
    "Trial",
    "TrialLog",
    "apply_effects",
    "build_scene",
    "diagnose",
    "load_result",
    "load_study",
    "predict",
    "run_batch",
    "save_result",
]

_ROOMS = (
    "config",
    "motion",
    "scene",
    "trial",
    "effects",
    "results",
    "simulation",
    "diagnosis",
    "prediction",
)
_OTHER_ROOMS = (
    "analysis",
    "blind",
    "calibration",
    "campaign",
    "causes",
    "coverage",
    "ensemble",
    "fragility",
    "hazard",
    "posterior",
    "view",
)


def __getattr__(name: str) -> "Any":
    # A room is imported with the first name asked of it: `vsr2 --version` needs none.
    from importlib import import_module

    if name in __all__:
        for room in _ROOMS:
            module = import_module(f"vsr2.{room}")
            if hasattr(module, name):
                return getattr(module, name)
    if name == "__version__":
        from importlib.metadata import version

        return version("vsr2")
    if name in _ROOMS or name in _OTHER_ROOMS:
        return import_module(f"vsr2.{name}")
    # Importing a room asks this module for what begins and ends with two underscores.
    if not name.startswith("_"):
        from vsr2.near_words import nearest

        near = nearest(name, (*__all__, *_ROOMS, *_OTHER_ROOMS))
        if near:
            raise AttributeError(f"module 'vsr2' has no attribute {name!r}; did you mean {near!r}?")
    raise AttributeError(f"module 'vsr2' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_ROOMS, *_OTHER_ROOMS})
