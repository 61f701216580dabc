"""VSR2: a virtual shake robot for precariously balanced rocks.

`run_batch` runs a study; `Simulation` is one world to step; the command line is `vsr2`.
"""

from vsr2.config import Study, load_study
from vsr2.diagnosis import Diagnosis, diagnose
from vsr2.effects import apply_effects
from vsr2.motion import Motion
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
    "run_batch",
    "save_result",
]
