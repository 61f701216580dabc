"""Four checks of an effect: neutral, continuous, alive, right.

- Neutral: at its null value a trial is the same as without it, to the last bit.
- Continuous: 1e-8 of its prior beside null responses change by no more than chance does, unless it
  declares a jump.
- Alive: at the far end of its prior it changes the distribution of responses by more than the noise
  floor, on a block and on a rock with the hull of a scan. The floor is what perturbing the start,
  and the points of a hull, by some micrometres does: a hull's contacts depend on the order of its
  points, which any change of them may turn. Effect and no effect are compared under
  equal perturbations, once the rock is at rest again.
- Right: it meets the closed forms of its own `verify`; those of the library are outside the package
  (`studies/effect_closed_forms`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsr2._native import FastRefusal
from vsr2.config.study import Output
from vsr2.effects import Check, Effect, with_effects
from vsr2.effects.registry import BUILT_IN
from vsr2.effects.standing import STANDING, settle_at
from vsr2.errors import SimulationError, Vsr2Error
from vsr2.motion import Motion
from vsr2.results import JUDGED, BatchResult
from vsr2.scene import Hull, Pose, start_support
from vsr2.scene.rotation import multiply, normalized, yaw_quaternion
from vsr2.simulation.batch import run_batch
from vsr2.simulation.bench import EffectBench, Rock, with_tail
from vsr2.simulation.native_scenes import native_scene
from vsr2.trial import Trial

Array = NDArray[np.float64]
ROCKS: tuple[Rock, ...] = ("block", "scan")


@dataclass(frozen=True)
class CheckConstants:
    """How effects are checked; chosen by hand, `studies/check_effects.py` shows the margins.

    Attributes:
        lifting: PGA over that of uplift of pulses that just lift the rock: they tell edges and
            slenderness.
        near_overturning: PGA over the least that overturns, of pulses near it: they tell what is
            small elsewhere.
        frequencies: of these pulses [Hz].
        sliding_pulse: peak acceleration [m/s^2] and frequency [Hz] of one more, under which the
            rock slides.
        pulse: likewise of one that rocks both rocks.
        hardest: PGA over that of uplift up to which the least that overturns is looked for.
        halvings: of the logarithm of its PGA.
        jury: draws of which most must overturn.
        fewest: draws that must come to rest, and of a feature that must be known, to be compared.
        tail: of these trials [s]; rocks are at rest before, so that no trial ends at another phase.
        alive: times the floor by which responses must change under one of the motions; a test holds
            rocks whose hulls alone are perturbed again below it.
        continuous: times the floor that a small step from null may reach.
        step: of the way from null to the far end of the prior.
        perturbation: standard deviation of each component of the place [m] and the turn [rad] of a
            start.
        jitter: standard deviation of each coordinate of a hull's points [m].
        resamples: pairs of samples behind each floor.
        tilts: least and greatest that are distinguished [rad].
        draws: perturbed starts, and hulls, under each motion, by rock; the block's response is
            hardly chaotic.
        turns: of the rock about the vertical, by rock; the block's so that its response is not
            plane [degree].
        floors: least floor of each feature that is compared: log10 [1], [rad], [m], [1].
        quantiles: at which two samples are compared.
    """

    lifting: float = 1.3
    near_overturning: tuple[float, ...] = (0.95, 1.05)
    frequencies: tuple[float, ...] = (2.0, 3.0)
    sliding_pulse: tuple[float, float] = (25.0, 6.0)
    pulse: tuple[float, float] = (4.0, 2.0)
    hardest: float = 12.0
    halvings: int = 8
    jury: int = 5
    fewest: int = 3
    tail: float = 30.0
    alive: float = 3.0
    continuous: float = 2.0
    step: float = 1e-8
    perturbation: float = 1e-5
    jitter: float = 1e-5
    resamples: int = 60
    tilts: tuple[float, float] = (1e-5, 1.4)
    draws: Mapping[Rock, int] = field(default_factory=lambda: {"block": 3, "scan": 64})
    turns: Mapping[Rock, float] = field(default_factory=lambda: {"block": 30.0, "scan": 0.0})
    floors: Mapping[str, float] = field(
        default_factory=lambda: {
            "largest tilt": 0.01, "yaw": 2e-3, "slip": 3e-4, "overturned": 0.1,
        }
    )  # fmt: skip
    quantiles: int = 20


CHECK = CheckConstants()
_HULL = 1
"""Stream of a hull's perturbation, beside that of its start."""


@dataclass(frozen=True)
class Liveness:
    """How much an effect changes responses.

    Attributes:
        ratio: greatest change of a feature's distribution over its noise floor, over motions.
        feature: which that is.
    """

    ratio: float
    feature: str

    @property
    def good(self) -> bool:
        """Alive."""
        return self.ratio > CHECK.alive

    @property
    def is_continuous(self) -> bool:
        """Of a small step: no more than chance."""
        return self.ratio <= CHECK.continuous


@dataclass(frozen=True)
class EffectReport:
    """What the checks of one effect gave.

    Attributes:
        effect: that was checked.
        neutral: the trial at its null value is the same to the last bit.
        step: change of responses a small step from null, by rock; empty where null stands alone, or
            a jump is declared.
        alive: by rock.
        right: its closed forms; None: it is of the library, whose closed forms are outside the
            package.
        fast_refusal: why the engine `fast` does not take it on the block; `none`: it does.
    """

    effect: Effect
    neutral: bool
    step: dict[Rock, Liveness]
    alive: dict[Rock, Liveness]
    right: tuple[Check, ...] | None
    fast_refusal: FastRefusal

    @property
    def fast(self) -> bool:
        """Whether the engine `fast` takes it on the block."""
        return self.fast_refusal is FastRefusal.none

    @property
    def is_continuous(self) -> bool:
        """No jump at null, but for a declared one."""
        return all(found.is_continuous for found in self.step.values())

    @property
    def is_alive(self) -> bool:
        """Alive on all rocks."""
        return all(found.good for found in self.alive.values())

    @property
    def is_right(self) -> bool:
        """There are closed forms, and it meets all."""
        if self.right is None:
            return True
        return bool(self.right) and all(check.good for check in self.right)

    @property
    def good(self) -> bool:
        """Passes all four."""
        return self.neutral and self.is_continuous and self.is_alive and self.is_right


class EffectChecker:
    """Checks effects; what they share is simulated once.

    Args:
        mesh: file of the rock that stands for a scan; by default a made one.
    """

    def __init__(self, mesh: Path | None = None) -> None:
        self.bench = EffectBench(mesh=mesh)
        # The engine that studies get, which is the fast one where it takes the scene.
        self._quick = EffectBench("auto", mesh)
        self._motions: dict[Rock, list[Motion]] = {}
        self._plain: dict[Rock, tuple[list[Trial], Array, Array]] = {}

    def check(self, effect: Effect) -> EffectReport:
        """All four checks of an effect.

        Raises:
            SimulationError: a hook of the effect fails; names it.
        """
        with _naming(effect, "at its null value"):
            neutral = self.neutral(effect)
        with _naming(effect, "a small step from its null value"):
            step = {} if effect.jump else self.step(effect)
        with _naming(effect, "at the far end of its prior"):
            alive = {rock: self.alive(effect, rock) for rock in ROCKS}
            refusal = self.fast_refusal(effect)
        built_in = any(type(effect) is type(one) for one in BUILT_IN)
        with _naming(effect, "in `verify`"):
            right = None if built_in else tuple(effect.verify(self.bench))
        return EffectReport(effect, neutral, step, alive, right, refusal)

    def neutral(self, effect: Effect) -> bool:
        """Whether trials with the null values are the same to the last bit, on both rocks."""
        pulse = self._quick.pulse(*CHECK.pulse)
        shaken = [with_tail(replace(self.standing(rock), motion=pulse), 0.5) for rock in ROCKS]
        # Each twice, so that the order has an end.
        plain = [trial for trial in shaken for _ in range(2)]
        null = with_effects(
            plain, [(effect, effect.null())], relative_order=[0.0, 1.0] * len(shaken)
        )
        first, second = run_batch(plain, threads=1), run_batch(null, threads=1)
        same = [
            a is not None and b is not None and a.state.tobytes() == b.state.tobytes()
            for a, b in zip(first.logs, second.logs, strict=True)
        ]
        return all(same) and list(first["outcome"]) == list(second["outcome"])

    def step(self, effect: Effect) -> dict[Rock, Liveness]:
        """Change of responses over the floor a small step from null, by rock; see `beside_null`."""
        values = beside_null(effect)
        if values is None:
            return {}
        return {rock: self.alive(effect, rock, values) for rock in ROCKS}

    def alive(
        self, effect: Effect, rock: Rock, values: Mapping[str, float] | None = None
    ) -> Liveness:
        """Greatest change of a feature over its noise floor; by default at the prior's far end."""
        trials, plain, floor = self.without(rock)
        wanted = effect.extreme() if values is None else effect.complete(values)
        changed = with_effects(trials, [(effect, wanted)], relative_order=[1.0] * len(trials))
        after = _features(run_batch(changed, threads=1)).reshape(plain.shape)
        ratios = np.nan_to_num(distances(after, plain) / floor)
        most = int(np.argmax(ratios.max(axis=0)))
        return Liveness(float(ratios.max()), list(CHECK.floors)[most])

    def fast_refusal(self, effect: Effect) -> FastRefusal:
        """Why `fast` does not take the block with the effect at its prior's far end."""
        trial = replace(self.bench.block(), motion=self.bench.pulse(*CHECK.pulse))
        changed = with_effects([trial], [(effect, effect.extreme())], relative_order=[1.0])[0]
        return native_scene(changed.scene).fast_refusal

    def standing(self, rock: Rock) -> Trial:
        """The block or the scan on the engine that studies get."""
        return self._quick.standing(rock)

    def motions(self, rock: Rock) -> list[Motion]:
        """Motions under which effects must be alive: lifting, nearly overturning, sliding."""
        if rock not in self._motions:
            self._motions[rock] = shaking(self._shaken(rock), CHECK.turns[rock])
        return self._motions[rock]

    def _shaken(self, rock: Rock) -> Trial:
        trial = self.standing(rock)
        return settle_at(trial, STANDING.scan_settling) if rock == "scan" else trial

    def without(self, rock: Rock) -> tuple[list[Trial], Array, Array]:
        """Trials, their features (motions, draws, 4) and the floor (motions, 4)."""
        if rock not in self._plain:
            trials = ensemble(
                self._shaken(rock), self.motions(rock), CHECK.turns[rock], CHECK.draws[rock]
            )
            found = _features(run_batch(trials, threads=1))
            plain = found.reshape(-1, CHECK.draws[rock], len(CHECK.floors))
            self._plain[rock] = (trials, plain, _floor(plain))
        return self._plain[rock]


def distances(first: Array, second: Array) -> Array:
    """Distance of two samples (draws), by motion and feature: of one distribution from another.

    The mean difference of their quantiles (Wasserstein's distance); NaN where fewer than
    `CHECK.fewest` values are known.

    Args:
        first: features, shape (motions, draws, 4).
        second: the same.

    Returns:
        Shape (motions, 4).
    """
    out = np.full((len(first), first.shape[2]), np.nan)
    levels = (np.arange(CHECK.quantiles) + 0.5) / CHECK.quantiles
    for motion, feature in np.ndindex(*out.shape):
        a, b = (sample[motion, :, feature] for sample in (first, second))
        a, b = a[np.isfinite(a)], b[np.isfinite(b)]
        if min(a.size, b.size) >= CHECK.fewest:
            gap = np.quantile(a, levels) - np.quantile(b, levels)
            out[motion, feature] = np.abs(gap).mean()
    return out


def _floor(plain: Array) -> Array:
    """Mean distance of two samples drawn from those without effect, shape (motions, 4)."""
    rng = np.random.default_rng(0)
    draws = plain.shape[1]
    pairs = [
        distances(*(plain[:, rng.integers(draws, size=draws)] for _ in range(2)))
        for _ in range(CHECK.resamples)
    ]
    known = np.isfinite(pairs)
    mean = np.where(known, pairs, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    return np.asarray(np.maximum(mean, list(CHECK.floors.values())), dtype=np.float64)


def beside_null(effect: Effect) -> dict[str, float] | None:
    """Values a small step from null; None where null has none beside it.

    A null value of infinity has, in its stead, one far beyond the prior; NaN and words have none.
    """
    values = effect.null()
    for parameter in effect.parameters:
        if parameter.secondary or parameter.prior == "fixed" or math.isnan(parameter.null):
            continue
        if math.isinf(parameter.null):
            values[parameter.name] = parameter.upper / CHECK.step
        else:
            way = parameter.extreme - parameter.null
            values[parameter.name] = parameter.null + CHECK.step * way
    return None if effect.is_null(values) else values


@contextmanager
def _naming(effect: Effect, where: str) -> Iterator[None]:
    """Errors of a hook name the effect and the place."""
    try:
        yield
    except Vsr2Error as error:
        raise type(error)(f"effect {effect.name!r} fails {where}: {error}") from error
    except Exception as error:
        raise SimulationError(
            f"effect {effect.name!r} fails {where}: {type(error).__name__}: {error}"
        ) from error


def shaking(trial: Trial, turn: float) -> list[Motion]:
    """Motions under which the rock of a trial just lifts, nearly overturns, and slides.

    Args:
        trial: of the bench.
        turn: of the rock about the vertical [degree].
    """
    bench = EffectBench()
    support = start_support(trial.body)
    ends = support.polygon[:, 0]
    slope = min(-float(ends.min()), float(ends.max())) / support.height
    lifting = slope * trial.scene.engine.gravity
    motions = []
    for frequency in CHECK.frequencies:
        least = _least_overturning(trial, turn, lifting, frequency)
        near = (share * least for share in CHECK.near_overturning)
        accelerations = [CHECK.lifting * lifting, *near]
        motions += [bench.pulse(peak, frequency) for peak in accelerations]
    return [*motions, bench.pulse(*CHECK.sliding_pulse)]


def _least_overturning(trial: Trial, turn: float, lifting: float, frequency: float) -> float:
    """Peak acceleration [m/s^2] beside which pulses of a frequency overturn most draws or not.

    Found by halving, up to `CHECK.hardest` times uplift, which it is where none overturns.
    """
    bench = EffectBench()
    firsts = _draws(trial, turn, CHECK.jury)
    low, high = math.log(lifting), math.log(CHECK.hardest * lifting)
    for _ in range(CHECK.halvings):
        middle = 0.5 * (low + high)
        motion = bench.pulse(math.exp(middle), frequency)
        found = run_batch([replace(first, motion=motion) for first in firsts], threads=1)
        fell = 2 * int(found.overturned.sum()) > CHECK.jury
        low, high = (low, middle) if fell else (middle, high)
    return math.exp(0.5 * (low + high))


def _draws(trial: Trial, turn: float, count: int) -> list[Trial]:
    """Trials with perturbed hull and start that come to rest before the motion.

    Raises:
        SimulationError: too few do.
    """
    found: list[Trial] = []
    for seed in range(3 * count):
        drawn = replace(
            with_tail(_jittered(trial, seed), CHECK.tail),
            start=perturbed_start(trial.start_pose, turn, seed),
            output=Output(log_every=0),
        )
        if str(run_batch([drawn], threads=1)["status"][0]) in JUDGED:
            found.append(drawn)
        if len(found) == count:
            return found
    raise SimulationError(
        f"effect check: only {len(found)} of {3 * count} perturbed rocks come to rest; choose a "
        "rock that stands more firmly"
    )


def _jittered(trial: Trial, seed: int) -> Trial:
    """The trial with the points of its hulls perturbed; seed 0 is the trial itself."""
    if not seed:
        return trial
    rng = np.random.default_rng([seed, _HULL])
    parts = [
        Hull(part.points + CHECK.jitter * rng.standard_normal(part.points.shape))
        if isinstance(part, Hull)
        else part
        for part in trial.scene.rock.parts
    ]
    return trial.with_scene(rock=replace(trial.scene.rock, parts=tuple(parts)))


def ensemble(trial: Trial, motions: list[Motion], turn: float, draws: int) -> list[Trial]:
    """Trials of all motions with perturbed hulls and starts, motion by motion.

    Args:
        trial: of the bench.
        motions: of :func:`shaking`.
        turn: of the rock about the vertical [degree].
        draws: under each motion; the first is the trial itself, where it comes to rest.
    """
    firsts = _draws(trial, turn, draws)
    return [replace(first, motion=motion) for motion in motions for first in firsts]


def perturbed_start(start: Pose, turn: float, draw: int) -> Pose:
    """A start turned about the vertical [degree] and, in draws above 0, perturbed by chance."""
    rng = np.random.default_rng(draw)
    x, y, z = start.position
    moved = (CHECK.perturbation * rng.standard_normal(6)) if draw else np.zeros(6)
    dx, dy, dz, *about = (float(value) for value in moved)
    small = normalized((0.5 * about[0], 0.5 * about[1], 0.5 * about[2], 1.0))
    rotation = multiply(small, yaw_quaternion(math.radians(turn)))
    # Let down from higher, never from within the pedestal.
    return Pose((x + dx, y + dy, z + abs(dz)), multiply(rotation, start.orientation))


def _features(result: BatchResult) -> Array:
    """Shape (trials, 4), as `CHECK.floors`; NaN of trials not at rest before the motion.

    A scan in one of its draws may tremble on: that draw is left out.

    Raises:
        SimulationError: most did not.
    """
    settled = np.isin(result["status"], JUDGED)
    if 2 * int(settled.sum()) < settled.size:
        bad = str(result["status"][int(np.argmin(settled))])
        raise SimulationError(
            f"effect check: most trials ended with status {bad}; make the prior milder, so that "
            "the rock comes to rest before the motion"
        )
    peak, yaw, slip = (result[name] for name in ("peak_tilt", "final_yaw", "final_slip"))
    overturned = result.overturned
    found = np.column_stack([np.log10(np.clip(peak, *CHECK.tilts)), yaw, slip, overturned])
    # Where a rock lies after overturning tells nothing.
    found[overturned, 1:3] = np.nan
    found[~settled] = np.nan
    return found
