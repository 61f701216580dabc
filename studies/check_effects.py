"""The three checks of every effect, and how the engines agree: docs/results/effects/checks.csv.

Step: change of the response over the noise floor, 1e-8 of the prior beside null (jump: one
is declared; none: null has no value beside it). Alive: that at the prior's end far from null and at
the other, on the block and on models/pbr_scan.obj. Engines: greatest difference of the tilt between
`exact` and `fast` over the first 0.3 s of shaking; and, over 42 trials whose starts lie some tenths
of a millimetre and of a milliradian apart, the mean of log10(largest tilt) of `fast` less that of
`exact`, with its standard error (paired). Run from the repository's root (about 6 minutes on
one core); docs/validation/effects.md shows the table, `studies/effects_page.py` writes it:

    python studies/check_effects.py [NAME ...]

With names, only the rows of those effects are written again.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from effect_closed_forms import closed_forms
from vsr2 import run_batch
from vsr2.config.study import Output
from vsr2.effects import Effect, in_order, library, with_effects
from vsr2.motion import Motion
from vsr2.scene import Pose
from vsr2.scene.rotation import multiply, yaw_quaternion
from vsr2.simulation.bench import EffectBench, Rock, with_tail
from vsr2.simulation.effect_checks import CHECK, ROCKS, EffectChecker, perturbed_start

MESH = Path("models/pbr_scan.obj")
OUT = Path("docs/results/effects/checks.csv")
EARLY = 0.3
DRAWS = 6
SPREAD = 3e-4
"""Of these starts [m], [rad]."""


def other_end(effect: Effect) -> dict[str, float] | None:
    """The values at the prior's end near null; None where that is null itself."""
    far = effect.extreme()
    near = dict(far)
    for parameter in effect.parameters:
        if not parameter.secondary and parameter.prior != "fixed":
            ends = (parameter.lower, parameter.upper)
            near[parameter.name] = ends[0] if far[parameter.name] == ends[1] else ends[1]
    return None if effect.is_null(near) else near


def shift(effect: Effect, rock: Rock, motions: list[Motion]) -> tuple[float, float]:
    """Mean difference of log10(largest tilt), `fast` less `exact`, and its standard error."""
    logs = []
    for mode in ("exact", "fast"):
        bench = EffectBench("exact" if mode == "exact" else "fast", MESH)
        first = replace(with_tail(bench.standing(rock), 1.5), output=Output(log_every=0))
        trials = []
        for draw in range(DRAWS):
            dx, dy, yaw = SPREAD * np.random.default_rng(draw).standard_normal(3)
            x, y, z = first.start_pose.position
            turn = yaw_quaternion(float(yaw) + math.radians(CHECK.turns[rock]))
            orientation = multiply(turn, first.start_pose.orientation)
            start = Pose((float(x + dx), float(y + dy), z), orientation)
            trials += [replace(first, motion=m, start=start) for m in motions]
        trials = with_effects(
            trials, [(effect, effect.extreme())], relative_order=[1.0] * len(trials)
        )
        peaks = run_batch(trials, threads=1)["peak_tilt"].astype(float)
        logs.append(np.log10(np.clip(peaks, 1e-5, 1.4)))
    differences = logs[1] - logs[0]
    return float(differences.mean()), float(differences.std(ddof=1) / math.sqrt(len(differences)))


def engines_differ(checker: EffectChecker, effect: Effect, rock: Rock, seconds: float) -> float:
    """Greatest difference between the engines `exact` and `fast` with the effect [rad].

    Of the tilt over the first seconds of shaking, under all motions, at the prior's far end. Both
    take every step and sweep it: what `fast` solves at once parts from 150 sweeps on a level base.

    Raises:
        SimulationError: the engine `fast` does not take the rock with the effect.
    """
    tilts = []
    for mode in ("exact", "fast"):
        trial = checker.standing(rock)
        as_bullet = {"mode": mode, "converged_contacts": False, "skip": "none"}
        engine = trial.scene.engine.model_copy(update=as_bullet)
        first = replace(
            trial.with_scene(engine=engine),
            start=perturbed_start(trial.start_pose, CHECK.turns[rock], 0),
        )
        trials = [replace(first, motion=motion) for motion in checker.motions(rock)]
        trials = with_effects(
            trials, [(effect, effect.extreme())], relative_order=[1.0] * len(trials)
        )
        early = []
        for log in run_batch(trials, threads=1).logs:
            assert log is not None
            shaken = log.tilt[log.time >= 0]
            early.append(shaken[: round(seconds / engine.time_step)])
        tilts.append(early)
    return max(float(np.abs(a - b).max()) for a, b in zip(*tilts, strict=True))


def main() -> None:
    """Write the table, or the rows of the effects named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    names = parser.parse_args().names
    kept = {line.split(",")[0]: line for line in OUT.read_text().splitlines()} if names else {}
    checker = EffectChecker(MESH)
    columns = ["effect", "neutral", "step_block", "step_scan"]
    for rock in ROCKS:
        columns += [f"alive_{rock}", f"feature_{rock}", f"other_end_{rock}"]
    columns += ["right", "fast"]
    for rock in ROCKS:
        columns += [f"early_{rock}_rad", f"shift_{rock}", f"shift_error_{rock}"]
    rows = [",".join(columns)]
    floors = {
        rock: ", ".join(f"{v:.1e}" for v in checker.without(rock)[2].max(axis=0)) for rock in ROCKS
    }
    for effect in in_order(library()):
        if effect.name in kept and effect.name not in names:
            rows.append(kept[effect.name])
            continue
        report = checker.check(effect)
        near = other_end(effect)
        cells = [effect.name, str(report.neutral).lower()]
        beside = "jump" if effect.jump else "none"
        cells += [f"{report.step[rock].ratio:.2g}" if report.step else beside for rock in ROCKS]
        for rock in ROCKS:
            found = report.alive[rock]
            end = "" if near is None else f"{checker.alive(effect, rock, near).ratio:.3g}"
            cells += [f"{found.ratio:.3g}", found.feature, end]
        right = closed_forms(effect, checker.bench)
        met = sum(check.good for check in right)
        cells += [f"{met} of {len(right)}", "yes" if report.fast else "no"]
        for rock in ROCKS:
            if not report.fast:
                cells += [""] * 3
                continue
            mean, error = shift(effect, rock, checker.motions(rock))
            early = engines_differ(checker, effect, rock, EARLY)
            cells += [f"{early:.1e}", f"{mean:.4f}", f"{error:.4f}"]
        rows.append(",".join(cells))
        print(rows[-1], flush=True)
    head = "# " + "; ".join(
        f"greatest floors over motions of log10(largest tilt), yaw [rad], slip [m], overturned on "
        f"the {rock}: {floor}"
        for rock, floor in floors.items()
    )
    OUT.write_text("\n".join([head, *rows]) + "\n")


if __name__ == "__main__":
    main()
