"""The laboratory's campaign on specimen SP1, predicted by margins of scenes drawn from wide priors.

    vsr2 campaign import-lab SOURCE --out out/lab
    python studies/lab_margins.py [--replicates N] [--threads N] [--causes NAME ...]

No value is chosen by hand from the outcomes: how the specimen stands (over the full circle), its
lean, rolling resistance, damping of rocking, size and stiffness of its foot, friction and the
record that drives are drawn from priors, one draw a replicate. Replicates are weighted, and bias
and scatter fitted, by the outcomes of the motions of other folds. A run that was interrupted is
continued. Writes to OUT what `vsr2 campaign predict --out` writes; draws.csv has what each
replicate drew and its weight. What is not among the causes keeps the nominal scene's value.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from vsr2.analysis.overturning_margin import fit_margin_model, out_of_fold_probability
from vsr2.analysis.probability import outcome_loss
from vsr2.campaign import load_campaign
from vsr2.config import load_study
from vsr2.effects import effect
from vsr2.ensemble import Execution, Hypotheses, Nuisance, Uniform, with_deviations
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
from vsr2.prediction import Prediction, predict
from vsr2.prediction.replicates import PREDICTION
from vsr2.report.messages.commands import prediction_table
from vsr2.report.messages.progress_lines import ProgressLines
from vsr2.results.atomic import csv_text, write_text

HERE = Path(__file__).resolve().parent
STANCE = (
    ("registration", "yaw", -180.0, 180.0),
    ("registration", "lean", 0.0, 3.0),
    ("registration", "lean_azimuth", 0.0, 360.0),
)
DISSIPATION = (
    ("rolling_resistance", "arm", 0.0, 0.005),
    ("rocking_damping", "ratio", 0.0, 0.03),
)
FOOT = (
    ("support", "shrink", -0.010, 0.010),
    ("contact_stiffness", "decades", -3.0, 1.0),
)
DRAWN = {"stance": STANCE, "dissipation": DISSIPATION, "foot": FOOT}
"""Causes, with effect, parameter and ends of the uniform prior, as the library has them."""
FRICTION = 0.3
"""Standard deviation of the logarithm of friction."""
CHANNELS = ("displacement", "acceleration")


def margins_of(
    campaign: Path,
    scene: Path,
    out: Path,
    *,
    replicates: int,
    threads: int,
    priors: tuple[tuple[str, str, float, float], ...],
) -> tuple[Prediction, SceneSimulator, tuple[Nuisance, ...]]:
    """Margins of a specimen's trials under the wide priors; records take turns.

    Args:
        campaign: folder of its trials.
        scene: its study.
        out: folder of simulations, which a later run reuses.
        replicates: draws of the priors.
        threads: of the simulations.
        priors: effect, parameter and ends of what is drawn.

    Returns:
        The prediction, a simulator that tells what was drawn, and the wide priors.
    """
    study = load_study(scene)
    scenes = [
        study.model_copy(update={"motion": study.motion.model_copy(update={"channel": channel})})
        for channel in CHANNELS
    ]
    wide = tuple(
        Nuisance(effect(name), parameter, Uniform(low, high), label=f"{name}_{parameter}")
        for name, parameter, low, high in priors
    )
    # Correct contact models differ by less than what is drawn here, and cost twice the time.
    nuisances = (*wide, *with_deviations({"friction": FRICTION}))
    hypotheses = Hypotheses(nuisances=nuisances, contact_family=())
    found = predict(
        load_campaign(campaign), scenes, out=out, replicates=replicates, margins=True,
        hypotheses=hypotheses,
        execution=Execution(threads, report=ProgressLines(study.name)),
    )  # fmt: skip
    return found, SceneSimulator(found.campaign, scenes[0], hypotheses=hypotheses), wide


def main() -> None:
    """Predict."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaign", type=Path, default=HERE.parent / "out" / "lab")
    parser.add_argument("--scene", type=Path, default=HERE / "lab_diagnosis.yaml")
    parser.add_argument("--out", type=Path, default=HERE.parent / "out" / "lab_margins")
    parser.add_argument("--replicates", type=int, default=24)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--causes", nargs="+", choices=DRAWN, default=list(DRAWN))
    options = parser.parse_args()
    found, simulator, wide = margins_of(
        options.campaign, options.scene, options.out,
        replicates=options.replicates, threads=options.threads,
        priors=tuple(row for cause in DRAWN if cause in options.causes for row in DRAWN[cause]),
    )  # fmt: skip
    print(prediction_table(found))
    assert found.margins is not None
    model = fit_margin_model(found.margins, found.campaign.overturned, found.campaign.motion_ids)
    rows = []
    for row, weight in enumerate(model.weights):
        z = dict(zip(simulator.nuisance_names, simulator.nuisance_draw(row + 1), strict=True))
        drawn = {one.label: one.prior.value(float(z[one.label])) for one in wide}
        alone = fit_margin_model(found.margins[[row]], found.campaign.overturned)
        rows.append(
            {"replicate": row, "weight": weight, "channel": CHANNELS[row % len(CHANNELS)],
             **drawn, "bias": alone.bias, "scatter": alone.scatter}
        )  # fmt: skip
    write_text(options.out / "draws.csv", csv_text(rows, ".4g"))
    print(f"bias {model.bias:+.3f}, scatter {model.scatter:.3f}")
    unbiased = out_of_fold_probability(
        found.margins, found.campaign.overturned, found.campaign.motion_ids, PREDICTION.folds,
        biased=False,
    )  # fmt: skip
    loss = outcome_loss(unbiased, found.campaign.overturned).mean()
    print(f"log loss out of fold where motions are as recorded: {loss:.3f}")
    print(f"effective draws {1 / float((np.asarray(model.weights) ** 2).sum()):.1f}")


if __name__ == "__main__":
    main()
