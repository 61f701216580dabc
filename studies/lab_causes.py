"""What each suspected cause takes off the loss of the laboratory's campaign, by margins.

    vsr2 campaign import-lab SOURCE --out out/lab
    python studies/lab_causes.py [--replicates N] [--threads N]

Five causes may act: how the specimen stood (turn and lean), its dissipation (rolling resistance and
damping of rocking), its foot (how far in the edges of its base lie, how stiff it is), which record
drives, and how strong the motion was. Each set of them is a family of scenes: what does not act
keeps the nominal scene's value, what acts is drawn from the priors of lab_margins.py. Every family
predicts each motion by what the outcomes of other motions say of it (weights of replicates, scatter
and, where the strength acts, bias). A cause's share is the loss that it takes off, the mean over
all orders in which causes can be added (L. S. Shapley, "A value for n-person games", 1953). Which
causes act is also chosen inside each fold, by the loss on its other motions. Intervals are of a
bootstrap over motions. A run that was interrupted is continued. Writes OUT/causes.csv.
"""

from __future__ import annotations

import argparse
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab_margins import CHANNELS, DRAWN, margins_of
from vsr2.analysis import classification_metrics, logistic_baseline
from vsr2.analysis.intervals import INTERVALS
from vsr2.analysis.overturning_margin import MARGIN, fit_margin_model, out_of_fold_probability
from vsr2.analysis.probability import RELIABILITY, outcome_loss, overturning_probability
from vsr2.analysis.shapley import shapley_share
from vsr2.campaign import Campaign, load_campaign, motion_resamples
from vsr2.campaign.folds import grouped_folds
from vsr2.ensemble import Execution
from vsr2.prediction import predict
from vsr2.prediction.replicates import PREDICTION
from vsr2.report.messages.progress_lines import ProgressLines
from vsr2.results.atomic import csv_text, write_text

Array = NDArray[np.float64]
HERE = Path(__file__).resolve().parent
OUT = HERE.parent / "out"
CAUSES = (*DRAWN, "record", "strength")
Causes = frozenset[str]


def families(options: argparse.Namespace) -> tuple[Campaign, dict[Causes, Array], Array]:
    """Margins of the families of scenes in which some of the drawn causes act.

    Of equally many replicates each; then all that are known of the family in which all act.
    """
    out: dict[Causes, Array] = {}
    for size in range(len(DRAWN) + 1):
        for acting in combinations(DRAWN, size):
            complete = size == len(DRAWN)
            found = margins_of(
                options.campaign, options.scene,
                options.margins if complete else options.out / "-".join(("nominal", *acting)),
                replicates=options.margins_replicates if complete else options.replicates,
                threads=options.threads,
                priors=tuple(row for cause in acting for row in DRAWN[cause]),
            )[0]  # fmt: skip
            assert found.margins is not None
            out[frozenset(acting)] = found.margins[: options.replicates]
    every = found.margins
    assert every is not None
    return found.campaign, out, every


def losses(campaign: Campaign, margins: dict[Causes, Array]) -> dict[Causes, Array]:
    """Loss of each trial, by which causes act, each motion predicted by the others."""
    out = {}
    for acting in every_set():
        p = out_of_fold_probability(
            family_of(acting, margins), campaign.overturned, campaign.motion_ids,
            PREDICTION.folds, biased="strength" in acting,
        )  # fmt: skip
        out[acting] = outcome_loss(p, campaign.overturned)
    return out


def family_of(acting: Causes, margins: dict[Causes, Array]) -> Array:
    """Margins of the replicates in which some causes act; records take turns where theirs does."""
    family = margins[acting & frozenset(DRAWN)]
    return family if "record" in acting else family[:: len(CHANNELS)]


def chosen_inside(campaign: Campaign, margins: dict[Causes, Array]) -> Array:
    """Probability of each trial by the causes that predict the motions of the other folds best."""
    ends, motions = campaign.overturned, np.asarray(campaign.motion_ids)
    fold = grouped_folds(motions, ends, PREDICTION.folds)
    out = np.zeros(ends.size)
    for k in np.unique(fold):
        other = fold != k

        def loss(acting: Causes, other: NDArray[np.bool_] = other) -> float:
            p = out_of_fold_probability(
                family_of(acting, margins)[:, other], ends[other], motions[other], MARGIN.folds,
                biased="strength" in acting,
            )  # fmt: skip
            return float(outcome_loss(p, ends[other]).mean())

        best = min(every_set(), key=loss)
        print(f"fold {k}: {', '.join(sorted(best)) or 'none'}", flush=True)
        family = family_of(best, margins)
        model = fit_margin_model(
            family[:, other], ends[other], motions[other], biased="strength" in best
        )
        out[~other] = model.probability(family[:, ~other])
    return out


def every_set() -> list[Causes]:
    """All sets of causes."""
    sizes = range(len(CAUSES) + 1)
    return [frozenset(acting) for size in sizes for acting in combinations(CAUSES, size)]


def as_simulated(options: argparse.Namespace) -> tuple[Array, Array]:
    """Loss of each trial by the nominal scene, and its floor, by the members of the ensemble."""
    found = predict(
        options.campaign, options.scene, out=options.out / "as_simulated",
        replicates=options.members,
        execution=Execution(options.threads, report=ProgressLines("as simulated")),
    )  # fmt: skip
    floor = [
        outcome_loss(overturning_probability(np.delete(found.outcomes, m, axis=0)), own)
        for m, own in enumerate(found.outcomes)
    ]
    return outcome_loss(found.probability, found.campaign.overturned), np.mean(floor, axis=0)


def main() -> None:
    """Judge the causes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaign", type=Path, default=OUT / "lab")
    parser.add_argument("--scene", type=Path, default=HERE / "lab_diagnosis.yaml")
    parser.add_argument("--margins", type=Path, default=OUT / "lab_margins")
    parser.add_argument("--margins-replicates", type=int, default=24)
    parser.add_argument("--out", type=Path, default=OUT / "lab_causes")
    parser.add_argument("--replicates", type=int, default=16)
    parser.add_argument("--members", type=int, default=24)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    seen, margins, complete = families(options)
    by_causes = losses(seen, margins)
    simulated, floor = as_simulated(options)
    curve = logistic_baseline(load_campaign(options.campaign).with_motion(), folds=PREDICTION.folds)
    assert curve.used.all()
    best = out_of_fold_probability(complete, seen.overturned, seen.motion_ids, PREDICTION.folds)
    inside = chosen_inside(seen, margins)
    scores = classification_metrics(seen.overturned > 0, inside > RELIABILITY.threshold)
    three = np.mean([scores.accuracy, scores.precision, scores.recall])
    print(f"chosen inside the folds: mean of accuracy, precision and recall {three:.3f}")
    none, everything = by_causes[frozenset()], by_causes[frozenset(CAUSES)]
    columns = {
        "as simulated": simulated,
        "rescaled": none,
        **{f"share of {cause}": shapley_share(by_causes, cause) for cause in CAUSES},
        **{f"{cause} alone": none - by_causes[frozenset({cause})] for cause in CAUSES},
        **{
            f"{cause} last": by_causes[frozenset(CAUSES) - {cause}] - everything for cause in CAUSES
        },
        "all causes": everything,
        "all causes, every replicate": outcome_loss(best, seen.overturned),
        "causes chosen inside the folds": outcome_loss(inside, seen.overturned),
        "logistic curve": outcome_loss(curve.out_of_fold, seen.overturned),
        "floor": floor,
    }
    values = np.stack(list(columns.values()))
    counts = motion_resamples(seen.motion_ids, INTERVALS.replicates, seed=0)
    drawn = (counts @ values.T) / counts.sum(axis=1)[:, None]
    means = dict(zip(columns, np.vstack([values.mean(axis=1), drawn]).T, strict=True))
    gap = means["as simulated"] - means["floor"]
    judged = (
        "rescaled", "all causes", "causes chosen inside the folds", "all causes, every replicate",
        "logistic curve",
    )  # fmt: skip
    for name in judged:
        means[f"closure, {name}"] = (means["as simulated"] - means[name]) / gap
    ours, curve_alone = (means[f"closure, {name}"] for name in judged[-2:])
    means["closure beyond the logistic curve"] = ours - curve_alone
    rows = []
    for name, found in means.items():
        low, high = np.quantile(found[1:], INTERVALS.ends)
        rows.append({"quantity": name, "value": found[0], "low": low, "high": high})
        print(f"{name}: {found[0]:.3f} [{low:.3f}, {high:.3f}]")
    write_text(options.out / "causes.csv", csv_text(rows, ".4g"))


if __name__ == "__main__":
    main()
