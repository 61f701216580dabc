"""The trials of a fragility study: motions, scalings, azimuths, perturbed replicates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vsr2.config.motion_source import AllRecordings, SingleRecording
from vsr2.config.study import YawStart
from vsr2.errors import SimulationError
from vsr2.fragility.settings import FragilityStudy, Jitter
from vsr2.motion import Motion, build_motions, warn_of_unusual_pga
from vsr2.one_line import counted
from vsr2.scene import build_scene, start_pose
from vsr2.scene.rotation import multiply, normalized
from vsr2.trial import Trial, rows_only

MAX_TRIALS = 1_000_000
"""Of one fragility study."""


@dataclass(frozen=True)
class PlannedTrial:
    """What sets a trial apart from the others.

    Attributes:
        trial: index.
        motion: ground motion; every scaling of one recording has the same.
        azimuth: turn of the rock before its perturbation [degree].
        replicate: counted from 0.
        seed: of the perturbation.
        yaw: perturbation of the turn [degree].
        offset_x, offset_y: of the place on the pedestal [m].
        tilt_x, tilt_y: of the tilt about x and y [degree].
    """

    trial: int
    motion: str
    azimuth: float
    replicate: int
    seed: int
    yaw: float
    offset_x: float
    offset_y: float
    tilt_x: float
    tilt_y: float


def fragility_trials(study: FragilityStudy) -> tuple[list[Trial], list[PlannedTrial]]:
    """All trials of a fragility study, without its effects, and what sets each apart.

    Everything random is drawn here, from `seed` of the study and the place of motion, azimuth and
    replicate: results depend neither on threads nor on the order of running, and more replicates
    leave the earlier ones as they were.

    Raises:
        GeometryError, MotionError, SimulationError: something of the study cannot be used, or
            there are more than `MAX_TRIALS` trials.
    """
    base, own = study.study, study.own.fragility
    motions = _motions(study)
    start = base.rock.start
    turn = start.yaw if isinstance(start, YawStart) else 0.0
    azimuths = (turn,) if own.azimuths is None else own.azimuths
    count = len(motions) * len(azimuths) * own.replicates
    if count > MAX_TRIALS:
        raise SimulationError(
            f"{counted(len(motions), 'motion')}, {counted(len(azimuths), 'azimuth')} and "
            f"{own.replicates} replicates make {count} trials; at most {MAX_TRIALS}"
        )
    scene = build_scene(base)
    clearance = 2.0 * base.engine.collision_margin
    trials: list[Trial] = []
    planned: list[PlannedTrial] = []
    perturbed = own.azimuths is not None or own.jitter.any
    for m, (group, motion) in enumerate(motions):
        for a, azimuth in enumerate(azimuths):
            for r in range(own.replicates):
                one = _draw(len(trials), group, azimuth, r, _seed(base.seed, (m, a, r)), own.jitter)
                name = motion.name
                if own.azimuths is not None:
                    name += f", azimuth {azimuth:g}"
                if own.replicates > 1:
                    name += f", replicate {r}"
                pose = None
                if perturbed:
                    assert isinstance(start, YawStart)
                    pose = start_pose(
                        _moved(start, one),
                        scene.rock.parts,
                        scene.rock.mass,
                        scene.pedestal,
                        clearance=clearance,
                    )
                trials.append(
                    Trial(
                        scene=scene,
                        motion=motion,
                        drive=base.motion.drive,
                        start=pose,
                        name=name,
                        seed=one.seed,
                        settling=base.settling,
                        outcome=base.outcome,
                        output=rows_only(base.output),
                    )
                )
                planned.append(one)
    return trials, planned


def _motions(study: FragilityStudy) -> list[tuple[str, Motion]]:
    """Ground motion and scaled motion."""
    source, targets = study.study.motion, study.own.fragility.target_pga_g
    motions = build_motions(source, study.study.engine.time_step)
    if targets is None or not isinstance(source, (SingleRecording, AllRecordings)):
        return [(motion.name, motion) for motion in motions]
    scaled = [
        (
            motion.name,
            motion.scaled_to_pga_g(pga_g, name=f"{motion.name} at {pga_g:g} g"),
        )
        for motion in motions
        for pga_g in targets
    ]
    warn_of_unusual_pga([(motion.name, motion.pga_g) for _, motion in scaled])
    return scaled


def _seed(seed: int, place: Sequence[int]) -> int:
    sequence = np.random.SeedSequence(seed, spawn_key=tuple(place))
    return int(sequence.generate_state(1, np.uint32)[0])


def effect_seed(seed: int, replicate: int) -> int:
    """Seed of what the study's effects draw in a replicate."""
    return _seed(seed, (replicate,))


def _draw(
    trial: int, motion: str, azimuth: float, replicate: int, seed: int, jitter: Jitter
) -> PlannedTrial:
    # All five are drawn whether used or not, so that one's do not depend on another's.
    draws = np.random.default_rng(seed).standard_normal(5)
    scales = (jitter.yaw, jitter.offset, jitter.offset, jitter.tilt, jitter.tilt)
    yaw, x, y, tilt_x, tilt_y = (
        float(s * d) if s else 0.0 for s, d in zip(scales, draws, strict=True)
    )
    return PlannedTrial(trial, motion, azimuth, replicate, seed, yaw, x, y, tilt_x, tilt_y)


def _moved(start: YawStart, one: PlannedTrial) -> YawStart:
    """The start with azimuth and perturbations; the tilt is about axes of the world."""
    orientation = start.base_orientation
    angle = math.radians(math.hypot(one.tilt_x, one.tilt_y))
    yaw = one.azimuth + one.yaw
    if angle > 0:
        # The turn comes after the tilt; turned back, its axis is where it was drawn.
        direction = math.atan2(one.tilt_y, one.tilt_x) - math.radians(yaw)
        sine = math.sin(0.5 * angle)
        tilt = (
            sine * math.cos(direction),
            sine * math.sin(direction),
            0.0,
            math.cos(0.5 * angle),
        )
        orientation = multiply(tilt, normalized(orientation, "rock.start.base_orientation"))
    x, y = start.position_xy
    return start.model_copy(
        update={
            "yaw": yaw,
            "base_orientation": orientation,
            "position_xy": (x + one.offset_x, y + one.offset_y),
        }
    )
