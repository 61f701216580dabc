"""What draws of the posterior predict of motions that were not seen, once they are simulated.

    python studies/lab_several_causes.py --seed N --out OUT    # simulates the emulator's scenes
    python studies/lab_fold_draws.py --seed N --cache OUT [--draws N] [--threads N]

The search for causes predicts by an emulator of margins. Here the posterior of each fold's other
motions is drawn from, and the margins of the fold's trials are simulated with what acts in each
draw, at the draw of the nuisances that is most alike. A draw's scatter of margins stays, the
emulator's error does not. Writes scores of both predictions; the committed table is
docs/results/lab_fold_draws.csv. Seed 2 took 17,216 simulations, and 24 minutes beside other work.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from vsr2.analysis.overturning_margin import MARGIN
from vsr2.analysis.probability import probability_intervals
from vsr2.campaign import load_campaign
from vsr2.config import load_study
from vsr2.diagnosis import Hypotheses
from vsr2.diagnosis.margins.cause_space import cause_space
from vsr2.diagnosis.margins.held_out_causes import HELD_OUT_CAUSES, fold_posteriors, folds_of
from vsr2.diagnosis.margins.margin_search import scene_margins
from vsr2.diagnosis.margins.outcome_model import OutcomeModel
from vsr2.diagnosis.margins.session_steps import session_steps
from vsr2.diagnosis.margins.simulated_scenes import SCENES, simulate_scenes
from vsr2.diagnosis.protocol_cache import SIMULATIONS
from vsr2.diagnosis.simulated.cache import SimulationCache
from vsr2.diagnosis.simulated.scene_simulator import SceneSimulator
from vsr2.results.atomic import csv_text, write_text

HERE = Path(__file__).resolve().parent
CANDIDATES = 4096
"""Draws of the nuisances, of which the one most alike is taken."""
Array = NDArray[np.float64]


def alike(nuisances: Array, candidates: Array, weights: Array) -> list[int]:
    """Number of the draw of the nuisances that changes margins nearly as each row does."""
    apart = ((candidates[None] - nuisances[:, None]) * weights) ** 2
    return [int(k) + 1 for k in apart.sum(axis=2).argmin(axis=1)]


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaign", type=Path, default=HERE.parent / "out" / "lab")
    parser.add_argument("--scene", type=Path, default=HERE / "lab_diagnosis.yaml")
    parser.add_argument("--cache", type=Path, default=HERE.parent / "out" / "lab_several_causes")
    parser.add_argument("--out", type=Path, default=HERE.parent / "out" / "lab_fold_draws.csv")
    parser.add_argument("--scenes", type=int, default=SCENES.usual)
    parser.add_argument("--draws", type=int, default=32)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    campaign = load_campaign(options.campaign).with_motion()
    asked = Hypotheses(exclude=["base_slope"], contact_family=())
    simulator = SceneSimulator(
        campaign, load_study(options.scene), hypotheses=asked, threads=options.threads,
        seed=options.seed,
    )  # fmt: skip
    space = cause_space(simulator.library, simulator.excluded)
    motions, overturned = np.asarray(campaign.motion_ids), campaign.overturned > 0
    sessions = [trial.session for trial in campaign.trials]
    steps = session_steps(space, campaign.relative_order, sessions, simulator.excluded)
    count = len(simulator.nuisance_names)
    with SimulationCache(simulator, options.cache / SIMULATIONS) as cache:
        scenes = simulate_scenes(
            cache, space, overturned, motions, options.scenes, seed=options.seed
        )
        emulator = scenes.known().emulator(space)
        model = OutcomeModel(steps.together, emulator, overturned, motions, count, steps=steps)
        fold = folds_of(model)
        emulated, simulated = np.full((2, overturned.size), np.nan)
        candidates = np.stack([simulator.nuisance_draw(k + 1) for k in range(CANDIDATES)])
        rng, differences = np.random.default_rng([options.seed, options.draws]), []
        models = dict.fromkeys(np.unique(fold).tolist(), model)
        posteriors = fold_posteriors(
            models, fold, HELD_OUT_CAUSES.everything, options.seed, options.threads
        )
        for k, particles in posteriors.items():
            own = fold == k
            rows = np.flatnonzero(own)
            emulated[rows] = model.probability(particles, rows)
            drawn = particles.taken(rng.choice(len(particles), options.draws, replace=False))
            mean, strength = model.margins(drawn)[0], model.log_strength(drawn)[:, None]
            numbers = alike(drawn.nuisances, candidates, emulator.kernel.weights[-count:])
            given = [
                (number, model.space.effects(point, acts[:-1]))
                for number, point, acts in zip(numbers, drawn.points, drawn.acts, strict=True)
            ]
            guess = mean + strength
            margins = scene_margins(cache, given, guess, np.tile(own, (options.draws, 1)))
            margins = (margins - strength)[:, rows]
            differences.append(margins - mean[:, rows])
            reach = np.hypot(*model.scatter(drawn))[:, None]
            falls = np.nanmean(ndtr(-margins / reach), axis=0)
            simulated[rows] = (1 - MARGIN.lapse) * falls + 0.5 * MARGIN.lapse
            print(f"fold {k + 1}: {cache.simulated} simulations", flush=True)
    apart = np.concatenate([one.ravel() for one in differences])
    print(f"simulated less emulated margins: {np.nanmean(apart):.3f}, sd {np.nanstd(apart):.3f}")
    table: list[dict[str, Any]] = []
    for name, p in (("emulated", emulated), ("simulated", simulated)):
        scores = probability_intervals(overturned, p, campaign.motion_ids, seed=options.seed)
        table += [
            {"prediction": name, "score": score, "value": one.value, "low": one.low,
             "high": one.high}
            for score, one in scores.items()
        ]  # fmt: skip
    write_text(options.out, csv_text(table, ".3g"))
    print(csv_text(table, ".3g"))


if __name__ == "__main__":
    main()
