"""A world without physics for searches, and a small simulated campaign with known values."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from vsr2.calibration import CalibrationParameter, Evaluation
from vsr2.campaign import RunOptions, save_campaign, simulate_campaign
from vsr2.config import Study, study_from_mapping
from vsr2.config.extended import Plain

ROCK = {"shape": "box", "size": [0.25, 0.5, 1.0], "density": 2700.0}
KNOWN_YAW = 35.0

STUDY = """
name: planted
engine: {mode: fast}
seed: 3
campaign: truth
rock: {shape: box, size: [0.25, 0.5, 1.0], density: 2700.0}
outcome: {tail: 2.0}
parameters:
  yaw: {keys: [rock.start.yaw], range: [0.0, 60.0], unit: deg}
  restitution:
    keys: [contact.rock.restitution, contact.pedestal.restitution]
    range: [0.0, 0.9]
method: {kind: joint, design: 8, refine: 3, profile_points: 4}
folds: 3
resamples: 200
replicates: 1
"""


class World:
    """Trials of intensity u overturn above `threshold`; a parameter set predicts u > p.

    Parameter `q` does nothing. Trials come in motions of four.
    """

    def __init__(self, trials: int = 120, threshold: float = 0.5, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        self.u = rng.random(trials)
        self.observed = self.u > threshold
        self.motions = np.arange(trials) // 4
        self.calls: list[dict[str, Plain]] = []

    def __call__(self, values: Mapping[str, Plain]) -> Evaluation:
        self.calls.append(dict(values))
        p = float(values["p"])
        return Evaluation(dict(values), (self.u > p).astype(float))


RANGES = {
    "p": CalibrationParameter(keys=("engine.gravity",), range=(0.0, 1.0)),
    "q": CalibrationParameter(keys=("engine.linear_damping",), range=(1e-3, 1e3), scale="log"),
}


def planted_study(folder: Path) -> Study:
    """24 trials of a block at a known yaw."""
    return study_from_mapping(
        {
            "name": "truth",
            "engine": {"mode": "fast"},
            "rock": {**ROCK, "start": {"mode": "yaw", "yaw": KNOWN_YAW}},
            "motion": {
                "mode": "grid_cosine",
                "pga_g": {"min": 0.25, "max": 0.6, "step": 0.05},
                "pgv_pga_s": {"min": 0.1, "max": 0.2, "step": 0.05},
                "drive": "prescribed",
            },
            "outcome": {"tail": 2.0},
            "output": {"log_every": 0},
        },
        base=folder,
    )


def write_planted(folder: Path, text: str = STUDY) -> Path:
    """The campaign of :func:`planted_study`, and a study to calibrate on it."""
    save_campaign(
        simulate_campaign(planted_study(folder), run=RunOptions(threads=1)), folder / "truth"
    )
    path = folder / "study.yaml"
    path.write_text(text)
    return path
