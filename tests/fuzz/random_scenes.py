"""Random scenes in both engines: finite, no energy out of nothing, no silent sinking.

    python tests/fuzz/random_scenes.py --scenes 2000 [--seed 0]

A scene is a box or the hull of random points, of random size, density, contact and start, shaken by
one cosine of random strength. Each runs in `fast` and in `exact`. A finding is:

- a trial that ends as `diverged` or `error`, or a value that is not finite;
- after the motion, while the pedestal rests, kinetic and potential energy of the rock that rise
  above their least so far by more than contacts can give back (`returned`);
- a rock that comes to rest deeper in the pedestal than the springs of its contacts explain, or so
  deep without a note (`sinking`).

Findings are listed by the number of their scene, and the exit code is 1. The last lines count
trials, and give the greatest gain and depth over their bounds, scenes with that note aside.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from vsr2.config import study_from_mapping
from vsr2.results import FLOAT_COLUMNS, BatchResult, TrialLog
from vsr2.results.trial_log import ANGULAR_VELOCITY, VELOCITY
from vsr2.scene import Box, Scene, SceneNote, SceneWarning, build_scene
from vsr2.scene.build import CONTACT_POINTS, NOTES
from vsr2.simulation import run_batch, study_trials
from vsr2.trial import Trial

Array = NDArray[np.float64]
ENGINES = ("fast", "exact")
BATCH = 50
"""Scenes whose logs are held in memory at once."""
SOFTEST = 1e6
"""Stiffness of the softest material that is drawn [N/m]; the default is 2.6e9."""
SLOP = 2.5e-4
"""Depth that no spring explains [m], a quarter of the collision margin. Points of contact are kept
over the steps; those of a hull were seen 0.12 mm inside its surface, in `exact`, too."""
STILL = 1e-6
"""Speed of a pedestal at rest: a motor never holds it quite still [m/s]."""
ROUNDING = 1e-9
"""Of energies, over the weight times the height above the ground: thousands of steps' rounding."""


def draw(seed: int, number: int, *, damping: float = 1.0) -> Trial:
    """A trial in a scene of its own, in `fast`; `damping` is a factor on that of its contact."""
    chance = np.random.default_rng([seed, number])
    size = 10 ** chance.uniform(-0.7, 0.3) * np.array(
        [*chance.uniform(0.25, 1.0, 2), chance.uniform(0.4, 2.0)]
    )

    bodies: dict[str, dict[str, float]] = {
        body: {
            "lateral_friction": chance.uniform(0.2, 1.3),
            "restitution": chance.uniform(0.0, 0.9),
            "stiffness": 2.6e9
            if chance.random() < 0.7
            else 10 ** chance.uniform(np.log10(SOFTEST), 9.0),
            "spinning_friction": chance.choice([0.0, 3e-4, 0.5]),
        }
        for body in ("rock", "pedestal")
    }
    # Stiffnesses act in series, and dampings add up: a contact recovers in damping over stiffness,
    # 4 ms by default, here well below the window of a rest.
    pair = 1.0 / sum(1.0 / own["stiffness"] for own in bodies.values())
    recovery = 10 ** chance.uniform(-4.0, -1.5)
    for own in bodies.values():
        own["damping"] = 0.5 * pair * recovery * damping
    content = {
        "name": "random",
        "rock": {
            "shape": "box",
            "size": size.tolist(),
            "density": chance.uniform(1000.0, 5000.0),
            "start": {"mode": "yaw", "yaw": chance.uniform(0.0, 360.0)},
        },
        "motion": {
            "mode": "single_cosine",
            "pga_g": 10 ** chance.uniform(-1.0, 0.3),
            "pgv_pga_s": 10 ** chance.uniform(-1.3, -0.5),
            "drive": str(chance.choice(["prescribed", "motor"])),
        },
        "engine": {
            "mode": "fast",
            "time_step": float(chance.choice([0.001, 0.002, 0.002, 0.004, 0.004])),
            "converged_contacts": bool(chance.random() < 0.7),
        },
        "contact": bodies,
        "settling": {"timeout": 3.0},
        "outcome": {"tail": 1.5, "stop_early": False},
        "output": {"log_every": 1},
    }
    study = study_from_mapping(content, base=Path())
    rock = None
    if chance.random() < 0.5:
        points = chance.standard_normal((int(chance.integers(8, 60)), 3))
        points *= 0.5 * size / np.linalg.norm(points, axis=1)[:, None]
        rock = hull(points)
    return study_trials(study, build_scene(study, rock=rock))[0]


def hull(points: Array) -> tuple[Array, NDArray[np.int64]]:
    """Vertices and outward triangles of the hull of points."""
    found = ConvexHull(points)
    faces = found.simplices.copy()
    corners = points[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = (normal * found.equations[:, :3]).sum(axis=1) < 0
    faces[inward] = faces[inward][:, ::-1]
    used, index = np.unique(faces, return_inverse=True)
    return points[used], index.reshape(faces.shape).astype(np.int64)


def stiffness(scene: Scene) -> float:
    """Of a contact point: both bodies' in series [N/m]."""
    rock, pedestal = scene.contact.rock, scene.contact.pedestal
    return 1.0 / (1.0 / rock.stiffness + 1.0 / pedestal.stiffness)


def weight(scene: Scene) -> float:
    """Of the rock [N]."""
    return scene.rock.mass.mass * scene.engine.gravity


def energy(scene: Scene, log: TrialLog) -> Array:
    """Kinetic and potential energy of the rock, row by row [J]."""
    mass = scene.rock.mass
    turned = Rotation.from_quat(log.body_orientation).as_matrix()
    spin = np.einsum("nji,nj->ni", turned, log.state[:, ANGULAR_VELOCITY])
    kinetic = (
        mass.mass * (log.state[:, VELOCITY] ** 2).sum(axis=1) + spin**2 @ mass.principal_inertia
    )
    return np.asarray(0.5 * kinetic + weight(scene) * log.position[:, 2])


def depth(scene: Scene, log: TrialLog) -> Array:
    """Of the rock's surface of collision below the pedestal's top, row by row, 0 above [m].

    A hull collides by its margin farther out than its vertices, a box by its faces.
    """
    assert scene.rock.surface is not None
    corners = scene.rock.surface.vertices - scene.rock.mass.mass_center
    turned = Rotation.from_quat(log.orientation).as_matrix()
    lowest = log.position[:, 2] + (turned[:, 2] @ corners.T).min(axis=1)
    margin = 0.0 if isinstance(scene.rock.parts[0], Box) else scene.engine.collision_margin
    return np.asarray(np.maximum(scene.pedestal.top - lowest + margin, 0.0))


def returned(scene: Scene, deepest: float) -> float:
    """Energy that contacts can give the rock at most, by its greatest depth [J].

    Springs give back what they hold, and a solver that undoes a penetration within a step lifts the
    rock by it and leaves it at that speed.
    """
    held = 0.5 * CONTACT_POINTS * stiffness(scene) * deepest**2
    speed = deepest / scene.engine.time_step
    undone = weight(scene) * deepest + 0.5 * scene.rock.mass.mass * speed**2
    return min(held, undone)


def gain(scene: Scene, trial: Trial, log: TrialLog) -> tuple[float, float]:
    """Greatest rise of the energy above its least so far while the pedestal rests, and its bound.

    Returns:
        Both over the rock's weight [m].
    """
    rest = log.time > trial.motion.duration
    rest &= np.abs(log.column("pedestal_velocity")) < STILL
    if not rest.any():
        return 0.0, 1.0
    values = energy(scene, log)[rest]
    bound = returned(scene, float(depth(scene, log)[rest].max()))
    bound += ROUNDING * float(np.abs(values).max())
    rise = float((values - np.minimum.accumulate(values)).max())
    return rise / weight(scene), bound / weight(scene)


def rests(trial: Trial, log: TrialLog) -> bool:
    """Whether the rock is at rest at the end: one that has overturned may still roll."""
    speed, spin = (np.linalg.norm(log.state[-1, of]) for of in (VELOCITY, ANGULAR_VELOCITY))
    outcome = trial.outcome
    return bool(speed < outcome.rest_linear_speed and spin < outcome.rest_angular_speed)


def sinking(scene: Scene, log: TrialLog) -> tuple[float, float]:
    """Depth at the end, and its bound: a single spring that bears all of the weight [m]."""
    return float(depth(scene, log)[-1]), weight(scene) / stiffness(scene) + SLOP


def judged(
    number: int, engine: str, scene: Scene, trial: Trial, result: BatchResult, place: int
) -> tuple[list[str], float, float]:
    """What is wrong with a trial, and its gain and depth over their bounds."""
    row = {name: result[name][place] for name in ("status", "outcome", "hand_over")}
    which = f"scene {number} in {engine} ({', '.join(map(str, row.values()))})"
    if row["status"] in ("diverged", "error"):
        return [f"{which}: {result['message'][place]}"], 0.0, 0.0
    log = result.logs[place]
    if log is None:
        return [], 0.0, 0.0
    found = []
    lacking = [
        name
        for name in FLOAT_COLUMNS
        if name != "overturning_time" and not np.isfinite(result[name][place])
    ]
    if lacking or not np.isfinite(log.state).all():
        found.append(f"{which}: not finite: {lacking or 'its log'}")
    rise, most_rise = gain(scene, trial, log)
    lively = SceneNote.LIVELY_CONTACT in {note.code for note in scene.rock.notes}
    if rise > most_rise and not lively:
        found.append(f"{which}: gains {rise:.3g} m of height, bound {most_rise:.3g} m")
    over = 0.0 if lively else rise / most_rise
    if row["status"] != "ok" or not rests(trial, log):
        return found, over, 0.0
    deep, most_deep = sinking(scene, log)
    if deep > most_deep:
        found.append(f"{which}: rests {deep:.3g} m deep, bound {most_deep:.3g} m")
    soft = SceneNote.SOFT_CONTACT in {note.code for note in scene.rock.notes}
    if deep > CONTACT_POINTS * NOTES.deep_start and not soft:
        found.append(f"{which}: rests {deep:.3g} m deep, and no note says so")
    return found, over, deep / most_deep


def main() -> int:
    """All scenes, some at a time."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--scenes", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    warnings.simplefilter("ignore", SceneWarning)
    counts: Counter[str] = Counter()
    found: list[str] = []
    greatest = [0.0, 0.0]
    for first in range(0, asked.scenes, BATCH):
        numbers = range(first, min(first + BATCH, asked.scenes))
        drawn = [draw(asked.seed, number) for number in numbers]
        for engine in ENGINES:
            trials = [in_engine(trial, engine) for trial in drawn]
            result = run_batch(trials, threads=1)
            for place, (number, trial) in enumerate(zip(numbers, trials, strict=True)):
                wrong, *ratios = judged(number, engine, trial.scene, trial, result, place)
                for line in wrong:
                    print(line, flush=True)
                found += wrong
                greatest = [max(pair) for pair in zip(greatest, ratios, strict=True)]
                counts[f"{engine} {result['status'][place]} {result['outcome'][place]}"] += 1
                noted = {str(note.code) for note in trial.scene.rock.notes}
                counts.update(f"{engine} with the note {code}" for code in noted)
                counts[f"{engine} handed over"] += result["hand_over"][place] != "none"
    for name, count in sorted(counts.items()):
        print(f"{name}: {count}")
    print(f"greatest gain over its bound {greatest[0]:.2f}, greatest depth {greatest[1]:.2f}")
    print(f"{asked.scenes} scenes, seed {asked.seed}: {len(found)} findings")
    return 1 if found else 0


def in_engine(trial: Trial, engine: str) -> Trial:
    """The trial in another engine."""
    settings = trial.scene.engine.model_copy(update={"mode": engine})
    return replace(trial, scene=replace(trial.scene, engine=settings))


if __name__ == "__main__":
    sys.exit(main())
