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

from lab_model import HERE, add_options, lab_model, simulated_probability
from vsr2.analysis.probability import probability_intervals
from vsr2.causes.margins.held_out_causes import HELD_OUT_CAUSES, fold_posteriors, folds_of
from vsr2.causes.margins.margin_search import scene_margins
from vsr2.results.atomic import csv_text, write_text

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
    add_options(parser)
    parser.add_argument("--out", type=Path, default=HERE.parent / "out" / "lab_fold_draws.csv")
    parser.add_argument("--draws", type=int, default=32)
    options = parser.parse_args()
    with lab_model(options) as lab:
        campaign, model, cache = lab.campaign, lab.outcomes, lab.cache
        emulator, overturned, count = model.emulator, model.overturned, model.nuisances
        fold = folds_of(model)
        emulated, simulated = np.full((2, overturned.size), np.nan)
        candidates = np.stack([lab.simulator.nuisance_draw(k + 1) for k in range(CANDIDATES)])
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
            simulated[rows] = simulated_probability(model, drawn, margins)
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
