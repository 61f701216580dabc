"""What a campaign shakes with: motions, amplitudes, order and sessions, starts and nuisances."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.blind.custodian.engine import Nuisances, PackEngine, TrialInput
from vsr2.blind.custodian.pack_streams import PackStream, pack_generator
from vsr2.blind.form.pack_settings import PackSettings
from vsr2.blind.mujoco import GroundMotion, TrialContext, ground_motion
from vsr2.blind.mujoco.ground import acceleration_of
from vsr2.motion import Record

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DesignRules:
    """How amplitudes lie about a motion's overturning PGA; all are choices, none is fitted.

    Attributes:
        spread: ends of ln PGA over the overturning PGA, within a campaign.
        shift: standard deviation of what a protocol adds to it.
        step: factor between amplitudes tried for the overturning PGA.
        steps: tried at most, from the static threshold.
        cut: standard deviations at which nuisances are cut.
    """

    spread: tuple[float, float] = (-0.55, 0.4)
    shift: float = 0.12
    step: float = 1.12
    steps: int = 10
    cut: float = 3.0


DESIGN = DesignRules()
NUISANCES = ("width", "depth", "height", "energy_ratio", "friction")


@dataclass(frozen=True)
class DesignTrial:
    """One trial of a design.

    Attributes:
        motion: index in the catalogue.
        peak_acceleration: of the table [m/s^2].
        session: 0 to sessions - 1.
    """

    motion: int
    peak_acceleration: float
    session: int


@dataclass(frozen=True, eq=False)
class Protocol:
    """What campaigns of a pack have in common, and what varies between their trials.

    Attributes:
        rows: trials in the order of execution.
        motions: of the rows.
        records: recorded motion of each row, by the trial's name.
        displacement_noise, acceleration_noise: of the records [m], [m/s^2].
    """

    rows: tuple[DesignTrial, ...]
    motions: tuple[GroundMotion, ...]
    records: dict[str, Record]
    displacement_noise: float
    acceleration_noise: float


def draw_protocol(
    rng: np.random.Generator,
    motions: Sequence[GroundMotion],
    thresholds: Sequence[float],
    settings: PackSettings,
) -> Protocol:
    """A protocol: its trials, and their motions as recorded, with noise, digits fixed.

    Args:
        rng: of the protocol.
        motions: the catalogue.
        thresholds: overturning PGA of each of them [m/s^2].
        settings: of the pack.
    """
    rows = draw_design(rng, thresholds, settings.trials, settings.motions, settings.sessions)
    tolerances = settings.tolerances
    moved_noise = log_uniform(rng, *tolerances.displacement_noise)
    felt_noise = log_uniform(rng, *tolerances.acceleration_noise)
    records = {}
    for i, row in enumerate(rows):
        motion = motions[row.motion]
        moved = motion.displacement * row.peak_acceleration
        felt = acceleration_of(moved, motion.interval)
        draws = rng.standard_normal((2, moved.size))
        label = trial_name(i, len(rows))
        records[label] = Record(
            name=label,
            sample_interval=motion.interval,
            displacement=np.round(moved + moved_noise * draws[0], 8),
            acceleration=np.round(felt + felt_noise * draws[1], 5),
        )
    return Protocol(
        tuple(rows),
        tuple(motions[row.motion] for row in rows),
        records,
        moved_noise,
        felt_noise,
    )


def trial_name(index: int, trials: int) -> str:
    """Name of a trial by its index in the order, from 0."""
    return f"T{index + 1:0{len(str(trials))}d}"


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A draw with three digits."""
    return float(f"{low * (high / low) ** float(rng.random()):.3g}")


def draw_nuisances(rng: np.random.Generator, settings: PackSettings) -> Nuisances:
    """Of one campaign: normal, cut at `DESIGN.cut` standard deviations."""
    draws = np.clip(rng.standard_normal(len(NUISANCES)), -DESIGN.cut, DESIGN.cut)
    deviations = [getattr(settings.tolerances, name) for name in NUISANCES]
    return Nuisances(*(float(1 + s * d) for s, d in zip(deviations, draws, strict=True)))


def draw_inputs(
    rng: np.random.Generator,
    protocol: Protocol,
    settings: PackSettings,
    trials: Iterable[int] | None = None,
) -> tuple[float, list[TrialInput]]:
    """Trials of one campaign without effect: its nuisances, and each trial's start and motion.

    Args:
        rng: of the campaign.
        protocol: of it.
        settings: of the pack.
        trials: indices in the protocol; None: all.

    Returns:
        The standard error of the campaign's motions about the recorded ones, relative, and trials
        without seeds of what effects draw.
    """
    nuisances, tolerances = draw_nuisances(rng, settings), settings.tolerances
    error = log_uniform(rng, *tolerances.input_gain)
    count = len(protocol.rows)
    out = []
    for i in range(count) if trials is None else trials:
        row, motion = protocol.rows[i], protocol.motions[i]
        yaw, x, y, gain = (float(draw) for draw in rng.standard_normal(4))
        out.append(
            TrialInput(
                interval=motion.interval,
                displacement=motion.displacement * (row.peak_acceleration * (1 + error * gain)),
                nuisances=nuisances,
                yaw=tolerances.yaw * yaw,
                offset=(tolerances.offset * x, tolerances.offset * y),
                context=TrialContext(i / max(1, count - 1), row.session, settings.sessions),
            )
        )
    return error, out


def catalogue(seed: int, count: int) -> list[GroundMotion]:
    """Ground motions, each from its own seed."""
    return [
        ground_motion(f"M{i + 1:02d}", pack_generator(seed, PackStream.MOTIONS, i))
        for i in range(count)
    ]


def overturning_acceleration(engine: PackEngine, motion: GroundMotion) -> float:
    """About the peak acceleration at which the nominal body overturns in this motion [m/s^2].

    The outcome is no monotonic function of PGA near there: the first of steps of 12 % from the
    static threshold at which it overturns, at most 3.1 times that.
    """
    low = engine.static_acceleration
    for step in range(DESIGN.steps):
        pga = low * DESIGN.step**step
        trial = TrialInput(motion.interval, motion.displacement * pga)
        if next(iter(engine.run([trial], 1.0))).overturned:
            return pga
    return low * DESIGN.step**DESIGN.steps


def draw_design(
    rng: np.random.Generator,
    thresholds: Sequence[float],
    trials: int,
    motions: int,
    sessions: int,
) -> list[DesignTrial]:
    """A campaign in the order of execution.

    A random part of the catalogue is used; each motion is run in two blocks of rising PGA in a
    random order, so that neither order nor session goes with the motion.

    Args:
        rng: of the campaign.
        thresholds: overturning PGA of each motion of the catalogue [m/s^2].
        trials: number of them.
        motions: number of ground motions.
        sessions: number of them.
    """
    chosen = rng.permutation(len(thresholds))[:motions]
    shift = DESIGN.shift * rng.standard_normal()
    low, high = DESIGN.spread
    counts = [trials // motions + (i < trials % motions) for i in range(motions)]
    blocks: list[list[tuple[int, float]]] = []
    for motion, count in zip(chosen, counts, strict=True):
        # Stratified, so that every motion is run below and above its threshold.
        quantile = (np.arange(count) + rng.random(count)) / count
        level = low + (high - low) * quantile + shift
        pga = [round(thresholds[motion] * math.exp(value), 3) for value in level]
        half = rng.permutation(count) < count // 2
        for part in (half, ~half):
            block = [(int(motion), value) for value, kept in zip(pga, part, strict=True) if kept]
            if block:
                blocks.append(block)
    order = [entry for i in rng.permutation(len(blocks)) for entry in blocks[i]]
    return [
        DesignTrial(motion, pga, min(sessions - 1, i * sessions // len(order)))
        for i, (motion, pga) in enumerate(order)
    ]
