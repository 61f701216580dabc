"""The diagnosis of the laboratory's campaign on specimen SP1.

    vsr2 campaign import-lab SOURCE --out out/lab
    python studies/lab_diagnosis.py [--budget-minutes N | --campaigns N] [--most-effects N] \
        [--threads N]

Runs `vsr2 diagnose --waterfall` on the trials that have a motion, in the scene of
lab_diagnosis.yaml, with all effects but `base_slope` (in one class with `com_offset`, and ten times
as dear as the others when the committed figures were made; it no longer is). A run that was
interrupted is continued. Writes to OUT what `vsr2 diagnose` writes and, to OUT/committed, what may
be committed (no table of trials): diagnosis.json, effects.csv, where.csv, the page's figures, and
metrics.csv: agreement with the observed outcomes of the model before and after the diagnosed
effects are added, and with all effects of the posterior (`predicted`), each motion judged by what
comes from other motions. Trials that never lift off stand in all of these.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np

from vsr2.analysis import classification_metrics
from vsr2.diagnosis import Budget, diagnose
from vsr2.ensemble import Execution, Hypotheses
from vsr2.report.diagnosis_page import diagnosis_figures, format_diagnosis, write_diagnosis_page
from vsr2.report.messages.progress_lines import ProgressLines
from vsr2.report.panels import svg

HERE = Path(__file__).resolve().parent


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaign", type=Path, default=HERE.parent / "out" / "lab")
    parser.add_argument("--scene", type=Path, default=HERE / "lab_diagnosis.yaml")
    parser.add_argument("--out", type=Path, default=HERE.parent / "out" / "diagnosis_lab")
    parser.add_argument("--budget-minutes", type=float, default=10.0)
    parser.add_argument("--campaigns", type=int)
    parser.add_argument("--most-effects", type=int, default=3)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    found = diagnose(
        options.campaign,
        options.scene,
        out=options.out,
        budget=Budget(options.budget_minutes, campaigns=options.campaigns, waterfall=True),
        hypotheses=Hypotheses(exclude=["base_slope"], most_effects=options.most_effects),
        execution=Execution(options.threads, report=ProgressLines()),
    )
    write_diagnosis_page(found, options.out)
    print(format_diagnosis(found))
    folder = options.out / "committed"
    folder.mkdir(exist_ok=True)
    (folder / "diagnosis.json").write_text(found.to_json())
    for name in ("effects.csv", "where.csv"):
        (folder / name).write_text(found.tables()[name])
    for name, (figure, meaning) in diagnosis_figures(found).items():
        (folder / f"{name}.svg").write_text(svg(figure, meaning) + "\n")
    observed = np.array([row["overturned"] for row in found.trials]) > 0
    with (folder / "metrics.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["model", "trials", "accuracy", "precision", "recall", "mean"])
        for model in ("before", "after", "predicted"):
            # A trial that never lifts off has no probability: it stands.
            predicted = np.nan_to_num([row[model] for row in found.trials]) > 0.5
            scores = classification_metrics(observed, predicted)
            three = [scores.accuracy, scores.precision, scores.recall]
            writer.writerow(
                [model, len(observed), *(f"{v:.4f}" for v in three), f"{np.mean(three):.4f}"]
            )


if __name__ == "__main__":
    main()
