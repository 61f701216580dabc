"""Which form the learned posterior should have: the package's network, or another one.

    pip install torch
    python studies/posterior_forms.py [--tiers MTB] [--campaigns N] [--planted N] [--seed N]
        [--out FOLDER]

scikit-learn comes with VSR2, torch does not; without it its forms are left out. The campaigns are
those of `diagnosis_planar.py`, simulated and planted alike, and so are their summaries. A folder
that this study made has them already.

The task is what every classifier can do: of campaigns with no effect or one, which of the labels
none and 18 effects is true. All forms are trained on the same of the simulated campaigns, as they
are and in disturbed copies, five times without a fifth of them. By these held-out fifths the best
pass, or number of trees, and the temperature are chosen. The probability of a planted campaign is
the mean over the five. The last row of a tier is what the diagnosis itself says, given that none or
one acts; its network has learned pairs and causes outside the library, too.

Every form is trained on the summaries, and on these with log evidences beside them. The evidence of
an effect is by a linear Gaussian emulator: summaries regressed on sizes, whose prior is the sizes
of the simulated campaigns. It also stands alone, as a form that learns nothing else.

Writes `posterior_forms.csv`, one row a tier, form and inputs, as committed in docs/results. Scores
are minus the log probability of the true label [nat], kinds weighted as in the prior; `above` is
the score less that of the package's network on summaries, with the standard error over campaigns.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.optimize import minimize_scalar
from scipy.special import log_softmax, logsumexp
from threadpoolctl import threadpool_limits

from diagnosis_planar import FIRST, STRONG, Row, write
from planar.planar_simulator import PlanarSimulator
from planted import Rehearsal, shaken_campaign
from posterior_classifiers import FORMS, PACKAGE, TORCH, Labelled, logarithm
from vsr2.ensemble.observed.random_streams import Stream, generator
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.campaigns import Campaigns, simulate_campaigns
from vsr2.ensemble.simulated.linear_algebra import one_blas_thread
from vsr2.posterior.calibration import CALIBRATED, pooled
from vsr2.posterior.discrepancy import Disturbance
from vsr2.posterior.summaries import SUMMARY, Standards, fit_summaries, targets
from vsr2.posterior.training import training_features
from vsr2.posterior.truth import PRIOR
from vsr2.posterior.within_library import TRAINING

Array = NDArray[np.float64]
Rows = NDArray[np.int64]


@dataclass(frozen=True)
class EmulatorConstants:
    """Settings of the emulator; chosen by hand.

    Attributes:
        added: to its variances, over their mean.
        least_evidence: below the greatest log evidence of a campaign that counts.
    """

    added: float = 0.01
    least_evidence: float = 30.0


EMULATOR = EmulatorConstants()


@dataclass(frozen=True, eq=False)
class Summarised:
    """Simulated and planted campaigns with no effect or one, at one tier.

    Attributes:
        simulated, planted: campaigns; the planted ones have one copy.
        fold: group of each simulated campaign.
        sizes: what the emulator knows of them, shape (n, targets).
        discriminants: columns of the inputs that it emulates.
    """

    simulated: Labelled
    planted: Labelled
    fold: Rows
    sizes: Array
    discriminants: int

    def with_evidences(self, k: int) -> tuple[Labelled, Labelled, Array]:
        """Log evidences beside the summaries, by the folds other than one.

        Args:
            k: the fold that the emulator is not made on.

        Returns:
            Simulated campaigns and planted ones with both; the evidences alone, of the last copy of
            the simulated ones and then of the planted ones.
        """
        rows = np.flatnonzero(self.fold != k)
        says = emulator(self, rows)
        found = [
            np.stack([says(copy, own) for copy in one.inputs])
            for one, own in (
                (self.simulated, np.arange(self.fold.size)),
                (self.planted, np.full(self.planted.label.size, -1)),
            )
        ]
        centre, scale = found[0].mean(axis=(0, 1)), found[0].std(axis=(0, 1)) + 1e-6
        beside = [
            Labelled(
                np.concatenate([one.inputs, (own - centre) / scale], axis=2),
                one.label, one.weight, one.labels,
            )
            for one, own in zip((self.simulated, self.planted), found, strict=True)
        ]  # fmt: skip
        return beside[0], beside[1], np.concatenate([found[0][-1], found[1][0]])


def emulator(data: Summarised, rows: Rows) -> Callable[[Array, Rows], Array]:
    """Log evidence of every label, times its prior, from a linear Gaussian emulator.

    Args:
        data: campaigns.
        rows: simulated ones that it is made on.

    Returns:
        From inputs, shape (n, inputs), and each campaign's own row, -1 of no row, which is left out
        of the prior over sizes.
    """
    own, count = data.simulated.of(rows), data.discriminants
    x = np.concatenate([np.ones((rows.size, 1)), data.sizes[rows]], axis=1)
    seen = own.inputs[:, :, :count]
    coefficients = np.linalg.lstsq(x, seen.mean(axis=0), rcond=None)[0]
    missed = (seen - x @ coefficients).reshape(-1, count)
    spread = missed.T @ missed / len(missed)
    spread[np.diag_indices(count)] += EMULATOR.added * np.trace(spread) / count
    root = np.linalg.cholesky(spread)
    means = solve_triangular(root, (x @ coefficients).T, lower=True).T
    share = np.bincount(own.label, own.weight, own.labels) / own.weight.sum()

    def says(inputs: Array, numbers: Rows) -> Array:
        at = solve_triangular(root, inputs[:, :count].T, lower=True).T
        density = at @ means.T - 0.5 * (means**2).sum(axis=1)
        density[numbers[:, None] == rows] = -np.inf
        out = np.full((len(at), own.labels), -np.inf)
        for label in range(own.labels):
            among = own.label == label
            out[:, label] = logsumexp(density[:, among], axis=1) - np.log(among.sum())
        out += np.log(share)
        below = out - out.max(axis=1, keepdims=True)
        return np.asarray(np.maximum(below, -EMULATOR.least_evidence))

    return says


def labelled(campaigns: Campaigns, names: Sequence[str], inputs: Array) -> tuple[Labelled, Rows]:
    """Those with no effect or one, and their rows."""
    rows = np.array([i for i, acting in enumerate(campaigns.sets) if len(acting) < 2])
    acting = [[names.index(one.name) for one in campaigns.sets[i]] for i in rows]
    label = np.array([1 + own[0] if own else 0 for own in acting], dtype=np.int64)
    plain = label == 0
    weight = np.where(plain, PRIOR.none / plain.sum(), PRIOR.one / (~plain).sum())
    # scikit-learn's penalties are beside sums of weights.
    return Labelled(inputs[:, rows], label, weight / weight.mean(), len(names) + 1), rows


def summarise(rehearsal: Rehearsal, planted: Campaigns, tier: Any, seed: int) -> Summarised:
    """Summaries as training makes them, from the same draws."""
    seen, campaigns, trials = rehearsal.at(tier), rehearsal.campaigns, rehearsal.trials
    names = tuple(rehearsal.cache.simulator.library)
    plain, rng = campaigns.gap_free, generator(seed, Stream.COPIES)
    features = training_features(seen, campaigns, seed)
    disturb = Disturbance.of(campaigns.overturned[plain], features[plain], seen.motion[trials])
    copies = [(campaigns.overturned.astype(np.float32), features)]
    for _ in range(TRAINING.copies):
        outcome, noted, _ = disturb(campaigns.overturned, features, rng)
        copies.append((outcome.astype(np.float32), noted.astype(np.float32, copy=False)))
    fold = rng.permutation(len(campaigns)) % SUMMARY.folds
    standard = Standards.of(copies, plain, fold).by_all
    residuals = [standard.residuals(*one) for one in copies]
    summaries, found = fit_summaries(residuals, campaigns, names, fold, len(trials))
    everything = np.concatenate(found)
    centre, scale = everything.mean(axis=0), everything.std(axis=0) + TRAINING.added_scale
    noise = np.random.default_rng(seed)
    observed = seen.noted(planted.overturned, planted.peak_tilt, planted.features, noise)
    own = summaries(standard.residuals(planted.overturned, np.asarray(observed, np.float64)))
    simulated, rows = labelled(campaigns, names, (np.stack(found) - centre) / scale)
    wanted, effect = targets(campaigns, names)
    return Summarised(
        simulated, labelled(planted, names, ((own - centre) / scale)[None])[0], fold[rows],
        wanted[rows][:, effect >= 0], effect.size,
    )  # fmt: skip


def scored(data: Summarised, held: Array, planted: Array, strong: NDArray[np.bool_]) -> Row:
    """Of one form: the score of planted campaigns, at the temperature that held-out ones set.

    Args:
        data: campaigns.
        held: log probabilities of held-out simulated campaigns, shape (n, labels).
        planted: of planted ones by each trained form, shape (forms, planted, labels).
        strong: planted ones whose effect is.
    """

    def score(log_temperature: float) -> float:
        return data.simulated.score(logarithm(pooled(held[None], float(np.exp(log_temperature)))))

    sought = minimize_scalar(score, bounds=CALIBRATED.temperatures, method="bounded")
    temperature = float(np.exp(sought.x))
    found = logarithm(pooled(planted, temperature))
    missed = -found[np.arange(len(found)), data.planted.label]
    return {
        "score": float(np.average(missed, weights=data.planted.weight)),
        "score_strong": float(missed[strong].mean()),
        "right": float(np.average(found.argmax(axis=1) == data.planted.label)),
        "held_out": float(sought.fun),
        "temperature": temperature,
        "missed": missed,
    }


def compare(data: Summarised, strong: NDArray[np.bool_], seed: int) -> list[Row]:
    """Every form on summaries, and with evidences beside them."""
    forms = FORMS | (TORCH if find_spec("torch") else {})
    beside = [data.with_evidences(k) for k in range(SUMMARY.folds)]
    count = data.fold.size
    held = np.zeros((count, data.simulated.labels))
    for k, one in enumerate(beside):
        held[data.fold == k] = one[2][:count][data.fold == k]
    alone = np.stack([log_softmax(one[2][count:], axis=1) for one in beside])
    row = scored(data, log_softmax(held, axis=1), alone, strong)
    rows: list[Row] = [{"form": "the emulator alone", "inputs": "evidences", "seconds": 0.0} | row]
    for inputs in ("summaries", "summaries and evidences"):
        for name, form in forms.items():
            started, planted = process_time(), []
            for k in range(SUMMARY.folds):
                simulated, others = (data.simulated, data.planted), beside[k][:2]
                own, new = simulated if inputs == "summaries" else others
                out = np.flatnonzero(data.fold == k)
                says = form(own.of(np.flatnonzero(data.fold != k)), own.of(out), seed + k)
                held[out] = says(own.inputs[-1, out])
                planted.append(says(new.inputs[0]))
            row = scored(data, held, np.stack(planted), strong)
            cost = process_time() - started
            rows.append(Row({"form": name, "inputs": inputs, "seconds": cost}) | row)
            print(name, inputs, {k: v for k, v in rows[-1].items() if k != "missed"}, flush=True)
    return rows


def diagnosed(rehearsal: Rehearsal, planted: Campaigns, tier: Any, seed: int) -> Array:
    """What the diagnosis says of none and every effect, given one of these, shape (n, labels)."""
    posterior, seen = rehearsal.posterior(tier), rehearsal.at(tier)
    noise = np.random.default_rng(seed)
    noted = seen.noted(planted.overturned, planted.peak_tilt, planted.features, noise)
    residuals = posterior.standard.residuals(planted.overturned, np.asarray(noted, np.float64))
    summaries = posterior.within.summaries(residuals)
    found = posterior.within.pooled(summaries)[:, : 1 + len(posterior.sets.names)]
    return np.asarray(logarithm(found / found.sum(axis=1, keepdims=True)))


def above(rows: list[Row], weight: Array) -> list[Row]:
    """The rows with their difference from the package's network, and its standard error."""
    first = next(row for row in rows if (row["form"], row["inputs"]) == (PACKAGE, "summaries"))
    share = weight / weight.sum()
    out = []
    for row in rows:
        more = row["missed"] - first["missed"]
        mean = float(share @ more)
        error = float(np.sqrt(share**2 @ (more - mean) ** 2))
        own = {key: value for key, value in row.items() if key != "missed"}
        out.append(own | {"above": mean, "standard_error": error})
    return out


@one_blas_thread()
def measure(rehearsal: Rehearsal, planted: Campaigns, tier: Any, seed: int) -> list[Row]:
    """Scores of all forms at one tier."""
    data = summarise(rehearsal, planted, tier, seed)
    sizes = [acting[0].size if acting else 0.0 for acting in planted.sets if len(acting) < 2]
    strong = np.array(sizes) >= STRONG
    with threadpool_limits(1):
        rows = compare(data, strong, seed)
    alone = [i for i, acting in enumerate(planted.sets) if len(acting) < 2]
    found = diagnosed(rehearsal, planted, tier, seed)[alone]
    missed = -found[np.arange(len(alone)), data.planted.label]
    rows.append(
        {
            "form": "the diagnosis, given none or one",
            "inputs": "summaries",
            "score": float(np.average(missed, weights=data.planted.weight)),
            "score_strong": float(missed[strong].mean()),
            "right": float((found.argmax(axis=1) == data.planted.label).mean()),
            "missed": missed,
        }
    )
    return [{"tier": tier} | row for row in above(rows, data.planted.weight)]


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tiers", default="MTB")
    parser.add_argument("--campaigns", type=int, default=2000)
    parser.add_argument("--planted", type=int, default=600)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("out/posterior_forms"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    campaign, seed = shaken_campaign(seed=options.seed), options.seed
    rehearsal = Rehearsal(
        PlanarSimulator(campaign, series=True, seed=1 + seed), campaign,
        campaigns=options.campaigns, cache=options.out / "simulations.jsonl", seed=seed,
    )  # fmt: skip
    truth = PlanarSimulator(campaign, series=True, seed=10_000 + seed)
    numbers = range(FIRST, FIRST + options.planted)
    with SimulationCache(truth, options.out / "planted.jsonl", chunk=8192) as cache:
        planted = simulate_campaigns(
            cache, rehearsal.look, rehearsal.trials, numbers, seed=seed + 5
        )
    rows: list[Row] = []
    for tier in options.tiers:
        rows += measure(rehearsal, planted, tier, seed)
        write(options.out / "posterior_forms.csv", rows)


if __name__ == "__main__":
    main()
