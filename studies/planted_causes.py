"""Whether causes act as often as is stated: simulated campaigns of the laboratory's as truth.

    python studies/lab_several_causes.py --seed N --out OUT    # simulates the emulator's scenes
    python studies/planted_causes.py --seed N --cache OUT [--campaigns N] [--threads N]

What acts in a planted campaign is drawn from the prior of the outcome model: about two effects, a
strength of the motion and scatter. All its trials are simulated; the emulator has not seen them.
Writes to OUT, for bins of the stated probability, how often effects acted.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from lab_model import HERE, add_options, lab_model
from vsr2.causes.margins.acting_posterior import sample_posterior
from vsr2.causes.margins.margin_search import scene_margins
from vsr2.results.atomic import csv_text, write_text

BINS = (0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 1.0)


def main() -> None:
    """Judge what is stated."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_options(parser)
    parser.add_argument("--out", type=Path, default=HERE.parent / "out" / "planted_causes.csv")
    parser.add_argument("--campaigns", type=int, default=20)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    stated, true = [], []
    with lab_model(options) as lab:
        model, space, cache = lab.without_steps, lab.space, lab.cache
        drawn = model.draw(options.campaigns, rng)
        guess = model.margins(drawn)[0] + model.log_strength(drawn)[:, None]
        planted = [
            (options.scenes + k + 1, space.effects(drawn.points[k], drawn.acts[k, :-1]))
            for k in range(options.campaigns)
        ]
        margins = scene_margins(cache, planted, guess, np.ones_like(guess, dtype=bool))
    _, motion = np.unique(model.motions, return_inverse=True)
    by_motion, by_trial = model.scatter(drawn)
    for k, own in enumerate(margins):
        own = np.where(np.isnan(own), guess[k], own) - model.log_strength(drawn)[k]
        own = own + by_motion[k] * rng.standard_normal(motion.max() + 1)[motion]
        outcomes = own + by_trial[k] * rng.standard_normal(own.size) < 0
        if outcomes.all() or not outcomes.any():
            continue
        found = sample_posterior(replace(model, overturned=outcomes), np.arange(outcomes.size), rng)
        stated.append(found.particles.acts.mean(axis=0))
        true.append(drawn.acts[k])
        print(f"{len(true)} campaigns", flush=True)
    said, acted = np.array(stated), np.array(true)
    rows = []
    for low, high in pairwise(BINS):
        inside = (said >= low) & ((said < high) | (high == 1.0))
        if inside.any():
            rows.append(
                {"from": low, "to": high, "effects": int(inside.sum()),
                 "stated": said[inside].mean(), "acted": acted[inside].mean()}
            )  # fmt: skip
    write_text(options.out, csv_text(rows, ".3g"))
    print(csv_text(rows, ".3g"))


if __name__ == "__main__":
    main()
