"""Predictions for the laboratory's second specimen, written before its outcomes are looked at.

    vsr2 campaign import-lab SOURCE --out out/lab
    vsr2 campaign import-lab SOURCE --out out/lab_sp2 --specimen SP2
    python studies/lab_second_specimen.py [--replicates N] [--threads N]

Both specimens stood on the table in every test. What belongs to the table comes from the outcomes
of SP1: how far each record is to be believed, by how much the real motion is stronger, and the
scatter about that. What belongs to a specimen (turn, lean, dissipation, friction) keeps its prior:
margins are averaged over its draws, evenly, for SP1 as for SP2. The same rule predicts SP1 out of
fold, which tells what to expect. Writes OUT/predictions.csv, one row a trial of SP2 with a motion,
and OUT/expected.csv, the rule's scores on SP1.
"""

from __future__ import annotations

import argparse
import hashlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab_margins import CHANNELS, DISSIPATION, STANCE, margins_of
from vsr2.analysis.overturning_margin import fit_margin_model, out_of_fold_probability
from vsr2.analysis.probability import PROBABILITY_SCORES, probability_intervals
from vsr2.diagnosis.prediction import PREDICTION, Prediction
from vsr2.results.atomic import csv_text, write_text

PRIORS = (*STANCE, *DISSIPATION)
"""Those of the rule when its predictions were written down."""
HERE = Path(__file__).resolve().parent
OUT = HERE.parent / "out"


def by_record(found: Prediction) -> NDArray[np.float64]:
    """Mean margin under each record, NaN where every simulation failed, shape (records, trials)."""
    assert found.margins is not None
    count = len(CHANNELS)
    return np.stack([np.nanmean(found.margins[k::count], axis=0) for k in range(count)])


def main() -> None:
    """Predict."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=Path, default=OUT / "lab")
    parser.add_argument("--second", type=Path, default=OUT / "lab_sp2")
    parser.add_argument("--first-simulations", type=Path, default=OUT / "lab_first_specimen")
    parser.add_argument("--out", type=Path, default=OUT / "lab_second_specimen")
    parser.add_argument("--replicates", type=int, default=24)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    drawn = {"replicates": options.replicates, "threads": options.threads, "priors": PRIORS}
    first = margins_of(
        options.first, HERE / "lab_diagnosis.yaml", options.first_simulations, **drawn
    )[0]
    second = margins_of(
        options.second, HERE / "lab_second_specimen.yaml", options.out / "simulations", **drawn
    )[0]
    seen = first.campaign
    model = fit_margin_model(by_record(first), seen.overturned, seen.motion_ids)
    shares = model.weights or (1 / len(CHANNELS),) * len(CHANNELS)
    for channel, share in zip(CHANNELS, shares, strict=True):
        print(f"weight of {channel}: {share:.2f}")
    print(f"bias {model.bias:+.3f}, scatter {model.scatter:.3f}")
    p = model.probability(by_record(second))
    rows = [
        {"trial": trial.trial, "probability": f"{q:.4f}", "overturns": int(q > 0.5)}
        for trial, q in zip(second.campaign.trials, p, strict=True)
    ]
    text = csv_text(rows)
    write_text(options.out / "predictions.csv", text)
    print(f"{int((p > 0.5).sum())} of {len(p)} trials of SP2 overturn; {p.sum():.1f} expected")
    print(f"SHA-256 of predictions.csv: {hashlib.sha256(text.encode()).hexdigest()}")
    out_of_fold = out_of_fold_probability(
        by_record(first), seen.overturned, seen.motion_ids, PREDICTION.folds
    )
    scores = probability_intervals(seen.overturned == 1, out_of_fold, seen.motion_ids)
    expected: list[dict[str, Any]] = [
        {"score": name, "value": scores[name].value, "low": scores[name].low,
         "high": scores[name].high}
        for name in PROBABILITY_SCORES
    ]  # fmt: skip
    write_text(options.out / "expected.csv", csv_text(expected, ".4g"))
    for row in expected:
        print("SP1, out of fold, {score}: {value:.3f} [{low:.3f}, {high:.3f}]".format(**row))


if __name__ == "__main__":
    main()
