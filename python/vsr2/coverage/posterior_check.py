"""Whether a finished diagnosis' posterior holds what it states: `vsr2.check_posterior`."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis.intervals import Score
from vsr2.analysis.ranks import RANKS
from vsr2.argument_names import checked_names
from vsr2.campaign import Campaign, Tier, load_campaign
from vsr2.config import Study, load_study
from vsr2.coverage.coverage_scores import LEVELS, CoverageScores, ParameterScore, coverage_scores
from vsr2.coverage.judged import Judged, judge_planted
from vsr2.coverage.planted_campaigns import Planted, draw_planted
from vsr2.diagnosis.api import scene_simulator
from vsr2.diagnosis.diagnosis_constants import diagnosis_constants
from vsr2.diagnosis.verdict.document import (
    CHECK_FILE,
    CHECK_TABLES,
    FILE,
    finished_diagnosis,
    finite,
)
from vsr2.ensemble.execution import EXECUTION, Execution, Progress, Report, Stage
from vsr2.ensemble.observed.observations import Observations, observe_campaign
from vsr2.ensemble.observed.random_streams import Stream, generator
from vsr2.ensemble.protocol_cache import ProtocolCache
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.campaigns import (
    Campaigns,
    draw_set,
    plain_campaigns,
    simulate_campaigns,
)
from vsr2.ensemble.simulated.hypotheses import HYPOTHESIS, Hypotheses
from vsr2.ensemble.simulated.linear_algebra import one_blas_thread
from vsr2.ensemble.simulated.look import Look, look
from vsr2.ensemble.simulated.scene_simulator import HYPOTHESES
from vsr2.ensemble.simulated.simulator import Simulator
from vsr2.errors import DiagnosisError
from vsr2.one_line import OneLine
from vsr2.posterior.discrepancy import Disturbance
from vsr2.posterior.files import load_posterior, posterior_file
from vsr2.posterior.training import training_features
from vsr2.results.atomic import csv_text, write_text

SCHEMA = "vsr2.posterior_check/1"
CHUNK = 25
"""Planted campaigns that are simulated between two reports of progress; no result depends on it."""
Trials = NDArray[np.int64]
"""Indices of those of each campaign."""


@dataclass(frozen=True, eq=False, repr=False)
class PosteriorCheck(OneLine):
    """What planted campaigns say of a posterior.

    Attributes:
        scores: ranks, coverage, reliability.
        judged: one a planted campaign.
        stated: share of the 90 % sets that are to hold a true cause, by the calibration.
        provenance: of the posterior and of what was planted.
    """

    scores: CoverageScores
    judged: tuple[Judged, ...]
    stated: float
    provenance: Mapping[str, Any]

    @property
    def facts(self) -> Mapping[str, object]:
        """How many were planted, and the share of true causes that the 90 % sets hold."""
        return {"planted": len(self.judged), "causes_held": self.scores.causes.value}

    def to_json(self) -> str:
        """`posterior_check.json`; numbers that do not exist are null."""
        scores = self.scores
        together = [] if scores.together is None else [scores.together]
        content = {
            "schema": SCHEMA,
            "planted": len(self.judged),
            "ranks": [
                _row(one)
                | {
                    name: getattr(one.uniformity, name).tolist()
                    for name in ("points", "share", "low", "high")
                }
                for one in (*together, *scores.parameters)
            ],
            "causes": {
                "level": self.stated,
                **_score("held", scores.causes),
                "size": scores.set_size,
            },
            "answer": {
                "stated": scores.stated,
                **_score("right", scores.right),
                "calibration_error": scores.error[0],
                **_score("calibration_error_of_true", scores.error[1]),
                "groups": [
                    {"low": g.low, "high": g.high, "stated": g.stated, **_score("right", g.right)}
                    for g in scores.reliability
                ],
            },
            "provenance": dict(self.provenance),
        }
        return json.dumps(finite(content), indent=2, allow_nan=False) + "\n"

    def tables(self) -> dict[str, str]:
        """CSV files by name: scores, planted campaigns, ranks."""
        scores = self.scores
        together = [] if scores.together is None else [scores.together]
        campaigns = [
            {
                "campaign": one.row, "truth": one.truth, "answer": one.answer,
                "stated": one.stated, "right": int(one.right), "held": int(one.held),
                "set_size": one.size,
            }
            for one in self.judged
        ]  # fmt: skip
        ranks = [
            {
                "campaign": one.row, "effect": r.effect, "parameter": r.parameter,
                "unit": r.unit, "truth": r.truth, "rank": r.rank,
            }
            for one in self.judged for r in one.ranks
        ]  # fmt: skip
        rows = [_row(one) for one in (*together, *scores.parameters)]
        return {
            name: csv_text(table, ".6g")
            for name, table in zip(CHECK_TABLES, (rows, campaigns, ranks), strict=True)
        }

    def save(self, folder: str | PathLike[str]) -> Path:
        """Write the JSON file and the tables; returns the path of the former.

        Raises:
            ResultError: a file cannot be written.
        """
        path = Path(folder)
        for name, text in {**self.tables(), CHECK_FILE: self.to_json()}.items():
            write_text(path / name, text, errors="strict")
        return path / CHECK_FILE


def _score(name: str, score: Score) -> dict[str, float]:
    return {name: score.value, f"{name}_low": score.low, f"{name}_high": score.high}


def _row(one: ParameterScore) -> dict[str, Any]:
    row: dict[str, Any] = {
        "effect": one.effect or "all", "parameter": one.parameter, "planted": one.ranks.size,
        "p_uniform": one.uniformity.p_value, "p_adjusted": one.p_adjusted,
    }  # fmt: skip
    for level, score in zip(LEVELS, one.covered, strict=True):
        row |= _score(f"covered_{round(100 * level)}", score)
    return row


@checked_names(DiagnosisError)
def check_posterior(
    campaign: Campaign | str | PathLike[str],
    scene: Study | str | PathLike[str],
    *,
    out: str | PathLike[str],
    planted: int = 200,
    tier: Tier | None = None,
    hypotheses: Hypotheses = HYPOTHESES,
    execution: Execution = EXECUTION,
) -> PosteriorCheck:
    """Plant campaigns whose truth is known, and ask the posterior of a finished diagnosis.

    Causes are drawn from the posterior's prior over the library. The posterior did not see the
    campaigns. They are simulated and disturbed as those of its training are, so the check says
    whether the inference holds what it states, and nothing of whether the simulations resemble the
    measured rock.

    Args:
        campaign: as it was given to :func:`vsr2.diagnose`; its outcomes have no part in it.
        scene: as given there.
        out: folder of the finished diagnosis; the result is written there.
        planted: number of campaigns.
        tier: of the diagnosis; None: as it says.
        hypotheses: as given there.
        execution: threads or cluster, cache, progress.

    Raises:
        DiagnosisError: the folder holds no finished diagnosis of this campaign and scene.
        CampaignError, ConfigError, GeometryError, MotionError, SimulationError: campaign or scene
            cannot be used.
    """
    if planted < 1:
        raise DiagnosisError(f"check is {planted}; plant at least 1 campaign, better 200")
    its_tier, known = finished_diagnosis(Path(out))
    given = (campaign if isinstance(campaign, Campaign) else load_campaign(campaign)).on_file()
    study = scene if isinstance(scene, Study) else load_study(scene)
    seen = observe_campaign(given, tier or its_tier)
    simulator = scene_simulator(seen, study, hypotheses, execution, known["seed"])
    if simulator.identity != known["simulator"]:
        raise DiagnosisError(
            f"{Path(out) / FILE}: is of another campaign, scene, prior or nuisance; check it with "
            "the arguments of its diagnosis"
        )
    cache = ProtocolCache(Path(out)) if execution.cache is None else execution.cache
    found = check_with(
        simulator, seen, known,
        cache=cache, planted=planted, most=hypotheses.most_effects, report=execution.report,
    )  # fmt: skip
    found.save(out)
    return found


@one_blas_thread()
def check_with(
    simulator: Simulator,
    seen: Observations,
    known: Mapping[str, Any],
    *,
    cache: ProtocolCache,
    planted: int,
    most: int = HYPOTHESIS.usual_effects,
    report: Report | None = None,
) -> PosteriorCheck:
    """Check a posterior with any simulator of the trials.

    Args:
        simulator: that the diagnosis used.
        seen: the observed campaign, whose outcomes have no part in it.
        known: provenance of the diagnosis.
        cache: folder of its simulations and its posterior.
        planted: number of campaigns.
        most: effects that may act together, as in the diagnosis.
        report: called with progress.

    Raises:
        DiagnosisError: the folder holds no such posterior.
    """
    seed, looked_at = known["seed"], known["look"]
    count = known["budget"]["campaigns"] - looked_at["plain"]
    sizes = (
        count, known["budget"]["trials"], *(looked_at[one] for one in ("among", "trials", "plain"))
    )  # fmt: skip
    excluded = set(known["excluded"]) & set(simulator.library)
    posterior = load_posterior(
        posterior_file(cache.folder, simulator, seen, sizes, seed, most, excluded),
        {name: one for name, one in simulator.library.items() if name not in excluded},
    )
    if posterior is None:
        raise DiagnosisError(
            f"{cache.folder}: holds no posterior of this diagnosis; give its cache and its "
            "most_effects, or diagnose again"
        )
    with SimulationCache(simulator, cache.simulations) as store:
        found = look(
            store, len(seen), among=looked_at["among"], most=looked_at["trials"],
            plain=looked_at["plain"], seed=seed,
        )  # fmt: skip
        trials = found.spread(known["budget"]["trials"])
        disturbed = _disturbance(
            store, seen, (found, trials), count, (looked_at["plain"], most, seed)
        )
        chosen = draw_planted(
            simulator.library, found.limits, planted,
            most=most, excluded=excluded, seed=seed,
        )  # fmt: skip
        campaigns = _simulated(store, (found, trials), chosen, (most, seed), report)
        simulated = store.simulated
    features = seen.noted(
        campaigns.overturned, campaigns.peak_tilt, campaigns.features,
        generator(seed, Stream.PLANTED_NOISE),
    ).astype(np.float64)  # fmt: skip
    outcomes, noted, _ = disturbed(
        campaigns.overturned, features, generator(seed, Stream.PLANTED_COPIES)
    )
    judged = tuple(judge_planted(posterior, chosen, outcomes, noted, seed=seed))
    return PosteriorCheck(
        coverage_scores(judged),
        judged,
        posterior.levels.known_held,
        {
            "simulator": simulator.identity,
            "tier": seen.tier,
            "seed": seed,
            "campaigns": posterior.campaigns,
            "excluded": sorted(excluded),
            "constants": check_constants(),
            "simulated_in_this_run": simulated,
        },
    )


def check_constants() -> dict[str, dict[str, Any]]:
    """Tuned numbers that a check rests on, by what they are of."""
    return {"ranks": asdict(RANKS), **diagnosis_constants()}


def _disturbance(
    store: SimulationCache,
    seen: Observations,
    looked: tuple[Look, Trials],
    count: int,
    settings: tuple[int, int, int],
) -> Disturbance:
    """As the training had it, from the same campaigns without effect."""
    (found, trials), (plain, most, seed) = looked, settings
    library = store.simulator.library
    rows = [c for c in range(count) if not draw_set(library, found.limits, c, seed, most)]
    campaigns = plain_campaigns(store, trials, plain)
    if rows:
        campaigns = campaigns.joined(
            simulate_campaigns(store, found, trials, rows, most=most, seed=seed)
        )
    noted = training_features(seen, campaigns, seed)
    return Disturbance.of(campaigns.overturned, noted, seen.motion[trials])


def _simulated(
    store: SimulationCache,
    looked: tuple[Look, Trials],
    planted: Sequence[Planted],
    settings: tuple[int, int],
    report: Report | None,
) -> Campaigns:
    (found, trials), (most, seed) = looked, settings
    parts = []
    for start in range(0, len(planted), CHUNK):
        rows = [one.row for one in planted[start : start + CHUNK]]
        parts.append(simulate_campaigns(store, found, trials, rows, most=most, seed=seed))
        if report is not None:
            report(Progress(Stage.PLANTED, min(1.0, (start + CHUNK) / len(planted))))
    campaigns = parts[0]
    for part in parts[1:]:
        campaigns = campaigns.joined(part)
    return campaigns
