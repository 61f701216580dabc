"""Three checks of an effect: neutral, alive, right.

- Neutral: at its null value a trial is the same as without it, to the last bit.
- Alive: at the far end of its prior it changes responses by more than the noise floor, on a block
  and on a rock with the hull of a scan. The floor is what perturbing the start by some micrometres
  does; effect and no effect are compared at equal starts.
- Right: it meets the closed forms of its own `verify`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vsr2.config.study import Output
from vsr2.effects import Check, Effect, Setup
from vsr2.results import BatchResult
from vsr2.scene import Pose
from vsr2.scene.rotation import multiply, yaw_quaternion
from vsr2.simulation.batch import Trial, run_batch
from vsr2.simulation.bench import EffectBench, fast_violation, trial_of
from vsr2.simulation.effects import with_effects

Array = NDArray[np.float64]

PULSES = ((6.0, 2.0), (6.5, 1.6), (9.0, 3.0), (12.0, 4.0))
"""PGA [m/s^2] and frequency [Hz] of the motions under which effects must be alive."""
DRAWS = 2
"""Starts."""
TAIL = 1.5
"""Of these trials [s]."""
ALIVE = 3.0
"""Times the floor by which responses must change."""
FEATURES = {"log10 of the largest tilt": 0.004, "yaw": 5e-4, "slip": 1e-4, "overturned": 0.03}
"""What is compared, with the least floor: [1], [rad], [m], [1]."""
TURN = 30.0
"""Of the block, so that its response is not plane [degree]."""


@dataclass(frozen=True)
class EffectReport:
    """What the checks of one effect gave.

    Attributes:
        effect: that was checked.
        neutral: the trial at its null value is the same to the last bit.
        alive: change over noise floor, by rock.
        right: its closed forms.
        fast: why the engine `fast` does not take it on the block; empty: it does.
    """

    effect: Effect
    neutral: bool
    alive: dict[str, float]
    right: tuple[Check, ...]
    fast: str

    @property
    def is_alive(self) -> bool:
        """Alive on all rocks."""
        return all(ratio > ALIVE for ratio in self.alive.values())

    @property
    def is_right(self) -> bool:
        """There are closed forms, and it meets all."""
        return bool(self.right) and all(check.good for check in self.right)

    @property
    def good(self) -> bool:
        """Passes all three."""
        return self.neutral and self.is_alive and self.is_right


class EffectChecker:
    """Checks effects; what they share is simulated once."""

    def __init__(self, bench: EffectBench | None = None) -> None:
        self.bench = EffectBench() if bench is None else bench
        self._plain: dict[str, tuple[list[Trial], Array]] = {}

    def check(self, effect: Effect) -> EffectReport:
        """All three checks of an effect."""
        return EffectReport(
            effect=effect,
            neutral=self.neutral(effect),
            alive={rock: self.alive(effect, rock) for rock in ("block", "scan")},
            right=tuple(effect.verify(self.bench)),
            fast=self.fast(effect),
        )

    def neutral(self, effect: Effect) -> bool:
        """Whether a trial with the null values is the same to the last bit."""
        setup = replace(self.bench.block(), motion=self.bench.pulse(4.0, 2.0))
        # Two trials, so that the order has an end.
        plain = [trial_of(setup, tail=0.5)] * 2
        null = with_effects(plain, [(effect, effect.null())], orders=[0.0, 1.0])
        first, second = run_batch(plain, threads=1), run_batch(null, threads=1)
        same = [
            a is not None and b is not None and a.state.tobytes() == b.state.tobytes()
            for a, b in zip(first.logs, second.logs, strict=True)
        ]
        return all(same) and list(first["outcome"]) == list(second["outcome"])

    def alive(self, effect: Effect, rock: str) -> float:
        """Greatest change of a feature at the prior's far end, over its noise floor."""
        trials, plain = self._without(rock)
        orders = [1.0] * len(trials)
        changed = with_effects(trials, [(effect, effect.extreme())], orders=orders)
        moved = np.abs(_features(run_batch(changed, threads=1)) - plain.reshape(len(trials), -1))
        floor = np.array(list(FEATURES.values()))
        spread = np.abs(plain[:, :, None] - plain[:, None, :])
        pairs = DRAWS * (DRAWS - 1)
        floor = np.maximum(floor, spread.sum(axis=(0, 1, 2)) / (len(PULSES) * pairs))
        return float((moved.mean(axis=0) / floor).max())

    def fast(self, effect: Effect) -> str:
        """Why `fast` does not take the block with the effect at its prior's far end."""
        trial = trial_of(replace(self.bench.block(), motion=self.bench.pulse(4.0, 2.0)))
        changed = with_effects([trial], [(effect, effect.extreme())], orders=[1.0])[0]
        return fast_violation(changed.scene)

    def _without(self, rock: str) -> tuple[list[Trial], Array]:
        if rock not in self._plain:
            setup = self.bench.block() if rock == "block" else self.bench.scan()
            trials = ensemble(setup, TURN if rock == "block" else 0.0, self.bench)
            features = _features(run_batch(trials, threads=1))
            self._plain[rock] = (trials, features.reshape(len(PULSES), DRAWS, -1))
        return self._plain[rock]


def ensemble(setup: Setup, turn: float, bench: EffectBench) -> list[Trial]:
    """Trials of all pulses with perturbed starts, pulse by pulse, on one scene."""
    first = trial_of(setup, tail=TAIL, log_every=0)
    first = replace(first, output=Output(log_every=0))
    return [
        replace(first, motion=bench.pulse(pga, frequency), start=_start(setup.start, turn, draw))
        for pga, frequency in PULSES
        for draw in range(DRAWS)
    ]


def _start(start: Pose, turn: float, draw: int) -> Pose:
    rng = np.random.default_rng(draw)
    x, y, z = start.position
    dx, dy, yaw = (1e-5 * rng.standard_normal(3)) if draw else np.zeros(3)
    rotation = yaw_quaternion(float(np.radians(turn) + yaw))
    return Pose((float(x + dx), float(y + dy), z), multiply(rotation, start.orientation))


def _features(result: BatchResult) -> Array:
    bad = [str(s) for s in result["status"] if s not in ("ok", "tail_timeout")]
    if bad:
        raise RuntimeError(f"effect check: a trial ended with status {bad[0]}")
    tilt = np.clip(result["peak_tilt"].astype(float), 1e-5, 1.4)
    overturned = result["outcome"] == "overturned"
    # Where the rock lies after overturning tells nothing.
    return np.column_stack(
        [
            np.log10(tilt),
            np.where(overturned, 0.0, result["final_yaw"].astype(float)),
            np.where(overturned, 0.0, result["final_slip"].astype(float)),
            overturned.astype(float),
        ]
    )


def check_effects(effects: Sequence[Effect]) -> list[EffectReport]:
    """Reports of several effects."""
    checker = EffectChecker()
    return [checker.check(effect) for effect in effects]
