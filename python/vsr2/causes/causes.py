"""The causes of a campaign's outcomes, several at once, by overturning margins."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2 import _native
from vsr2.argument_names import checked_names
from vsr2.campaign import Campaign, load_campaign
from vsr2.causes.causes_schema import CAUSES_SCHEMA
from vsr2.causes.explained_gap import explained_gap, simulate_as_it_is
from vsr2.causes.inferred_causes import FOUND_CAUSES, cause_row, drawn_values, inferred_causes
from vsr2.causes.margins.acting_posterior import SAMPLER, ActingPosterior, sample_posterior
from vsr2.causes.margins.cause_space import CAUSES, NotJudged, cause_space, not_judged
from vsr2.causes.margins.held_out_causes import HELD_OUT_CAUSES, HeldOutCauses, judge_causes
from vsr2.causes.margins.margin_kernel import KERNEL
from vsr2.causes.margins.margin_search import SEARCH
from vsr2.causes.margins.margin_streams import MarginStream
from vsr2.causes.margins.outcome_model import OUTCOME_MODEL, OutcomeModel, Particles, acting_share
from vsr2.causes.margins.session_steps import STEP_TABLE, session_steps
from vsr2.causes.margins.simulated_scenes import SCENES, simulate_scenes
from vsr2.causes.margins.trial_groups import TRIAL_GROUPS
from vsr2.config import Study, dump_study, load_study
from vsr2.config.seeds import checked_seed
from vsr2.diagnosis.budget import Stopwatch
from vsr2.diagnosis.corrected import (
    CORRECTED_FILE,
    DRAWS,
    DRAWS_FOLDER,
    check_draws,
    scene_head,
    scene_with,
    write_scenes,
)
from vsr2.diagnosis.how_far.ensemble_losses import Ensemble
from vsr2.diagnosis.how_far.negative_controls import NEGATIVE_CONTROLS
from vsr2.ensemble.execution import EXECUTION, Execution, Stage, made_folder, simulator_of
from vsr2.ensemble.observed.observations import outcomes_hash
from vsr2.ensemble.protocol_cache import SIMULATIONS
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.hypotheses import Hypotheses
from vsr2.ensemble.simulated.library import GAIN, sides
from vsr2.ensemble.simulated.linear_algebra import one_blas_thread
from vsr2.ensemble.simulated.scene_simulator import HYPOTHESES, SceneSimulator
from vsr2.errors import ConfigError, DiagnosisError
from vsr2.one_line import OneLine
from vsr2.prediction.prediction import prediction_constants
from vsr2.prediction.replicates import PREDICTION
from vsr2.results import base_provenance, refuse_other_work
from vsr2.results.atomic import csv_text, write_text
from vsr2.simulation.batch import usable_threads

Array = NDArray[np.float64]
CAUSES_FILE = "causes.json"
TABLE_FILE = "causes.csv"
PROBABILITIES_FILE = "held_out.csv"
FOLDS_FILE = "folds.csv"
FIGURE = "causes.png"
FILES = (
    CAUSES_FILE,
    TABLE_FILE,
    PROBABILITIES_FILE,
    FOLDS_FILE,
    CORRECTED_FILE,
    f"{DRAWS_FOLDER}/{DRAWS}",
    FIGURE,
    SIMULATIONS,
)


@dataclass(frozen=True, eq=False, repr=False)
class Causes(OneLine):
    """What the outcomes of a campaign say of the scene's gaps.

    Attributes:
        content: plain data, as in causes.json: see docs/reference/outputs.md.
        trials: of the campaign, in its order.
        held_out: probability of overturning, each motion judged by the others, by name of what may
            act: `none`, the causes that are judged together joined by "+", `all`, and `likely`,
            what acts with 0.5 or more by the other motions; shapes (trials,).
        folds: rows of folds.csv: see docs/reference/outputs.md.
        corrected: the scene with its likely causes at their posterior mean; None: there is none, or
            no study states them.
        drawn: scenes with what acts in a draw of the posterior each.
    """

    content: Mapping[str, Any]
    trials: tuple[str, ...]
    held_out: Mapping[str, Array]
    folds: tuple[Mapping[str, Any], ...]
    corrected: Study | None
    drawn: tuple[Study, ...] = ()

    @property
    def facts(self) -> Mapping[str, object]:
        """What the notation in one line shows."""
        likely = {
            name: round(acts, 2)
            for name, acts in self.acting.items()
            if acts >= FOUND_CAUSES.likely
        }
        return {"trials": len(self.trials), "likely": likely}

    @property
    def acting(self) -> dict[str, float]:
        """Probability that each effect acts, the greatest first."""
        return {row["name"]: row["acts"] for row in self.content["causes"]}

    def to_json(self) -> str:
        """The text of causes.json."""
        return json.dumps(self.content, indent=2, allow_nan=False) + "\n"

    def tables(self) -> dict[str, str]:
        """CSV files by name."""
        rows = [
            {
                "effect": row["name"],
                "acts": row["acts"],
                "parameter": name,
                "unit": one["unit"],
                "mean": one["mean"],
                "low": one["interval"][0],
                "high": one["interval"][1],
            }
            for row in self.content["causes"]
            for name, one in row["parameters"].items()
        ]
        columns = {"trial": list(self.trials)} | {
            name: values.tolist() for name, values in self.held_out.items()
        }
        probabilities = [
            dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)
        ]
        return {
            TABLE_FILE: csv_text(rows),
            PROBABILITIES_FILE: csv_text(probabilities),
            FOLDS_FILE: csv_text(self.folds),
        }

    def save(self, folder: str | PathLike[str]) -> list[Path]:
        """Write causes.json, the tables and corrected.yaml; an earlier scene is removed.

        Raises:
            DiagnosisError: the folder cannot be used.
            ResultError: a file cannot be written.
        """
        path = made_folder(Path(folder))
        texts = {CAUSES_FILE: self.to_json()} | self.tables()
        (path / CORRECTED_FILE).unlink(missing_ok=True)
        if self.corrected is not None:
            facts = {"corrected_for": ", ".join(self.content["corrected"])}
            head = scene_head(facts | {"values": "posterior_mean"})
            texts[CORRECTED_FILE] = head + dump_study(self.corrected, relative_to=path)
        for name, text in texts.items():
            write_text(path / name, text)
        return [*(path / name for name in texts), *write_scenes(self.drawn, path)]


@checked_names(DiagnosisError)
@one_blas_thread()
def find_causes(
    campaign: Campaign | str | PathLike[str],
    scene: Study | str | PathLike[str],
    *,
    out: str | PathLike[str] | None = None,
    scenes: int | None = None,
    hypotheses: Hypotheses = HYPOTHESES,
    posterior_draws: int = 0,
    execution: Execution = EXECUTION,
    seed: int = 0,
) -> Causes:
    """Which effects act together in a campaign, by how strong motions must be to overturn.

    Scenes are drawn in which any of the effects act. In each the factor on the motion is sought at
    which trials overturn, and an emulator learns these margins. Then the outcomes say which
    effects act, and how strongly. Causes are judged on motions that they were not inferred from.
    For campaigns of many outcomes in which several causes act; `diagnose` reads series, too.

    Args:
        campaign: trials, or the folder that holds them; those without motion or outcome are left
            out.
        scene: the study of the scene, its effects included, or its file. Its motions are not used.
        out: folder for tables, the corrected scene and simulations, which later runs reuse; None:
            nothing is written.
        scenes: whose margins are sought, each of a part of the trials; None: as many as usual
            (`SceneConstants`).
        hypotheses: effects, priors and nuisances; at most how many act is not asked.
        posterior_draws: scenes with what acts in a draw of the posterior each, to predict with.
        execution: threads or a cluster, who gets progress, and a cache that a diagnosis shares.
        seed: of all draws.

    Returns:
        The causes.

    Raises:
        DiagnosisError: an option or the folder cannot be used, or the campaign has too few motions
            or outcomes of one kind alone.
        CampaignError, ConfigError, GeometryError, MotionError, SimulationError: campaign or scene
            cannot be used.
        ResultError: a file cannot be written, or is a finished result of other work.
    """
    watch, seed = Stopwatch(), checked_seed(seed, DiagnosisError)
    given = campaign if isinstance(campaign, Campaign) else load_campaign(campaign)
    used = _judged_by(given)
    count = SCENES.usual if scenes is None else scenes
    _check(used, count)
    check_draws(posterior_draws, SAMPLER.final)
    _check_priors(hypotheses)
    study = scene if isinstance(scene, Study) else load_study(scene)
    folder = None if out is None else made_folder(Path(out))
    simulator = simulator_of(used, study, hypotheses, execution, seed)
    model, as_it_is, work = _modelled(used, simulator, folder, count, execution, seed)
    work |= {"seed": seed, "left_out": len(given) - len(used), "search_time_s": watch.wall_s}
    posterior = _inferred(model, execution, seed)
    acting = acting_share(posterior.particles, model.names)
    likeliest = sorted(model.looked_for, key=lambda name: -acting[name])
    judged = _judged_held_out(model, likeliest, execution, seed)
    rows = [cause_row(model, posterior.particles, name, acting[name]) for name in likeliest]
    corrected, stated, not_stated = _corrected(study, rows)
    content = {
        "schema": CAUSES_SCHEMA,
        "campaign": used.name,
        "trials": len(used),
        "motions": len(set(used.motion_ids)),
        **inferred_causes(model, posterior, rows),
        "emulator": {"scenes": count, **model.emulator.quality()},
        "held_out": explained_gap(judged, as_it_is, used, seed),
        "corrected": stated,
        "not_stated": not_stated,
        **_not_looked_for(simulator, model.names),
        "provenance": _rested_on(study, hypotheses, simulator) | {**execution.notes, **work},
    }
    rng = np.random.default_rng([seed, MarginStream.CORRECTED])
    drawn = _drawn(study, model, posterior.particles, posterior_draws, rng)
    content["provenance"]["wall_time_s"] = watch.wall_s
    names, folds = tuple(trial.trial for trial in used.trials), judged.fold_rows(used.motion_ids)
    result = Causes(content, names, _probabilities(judged), folds, corrected, drawn)
    if folder is not None:
        result.save(folder)
    return result


def _inferred(model: OutcomeModel, execution: Execution, seed: int) -> ActingPosterior:
    """What acts, by the outcomes of all trials."""
    rng = np.random.default_rng([seed, MarginStream.ACTING])
    execution.notify(Stage.INFERENCE, 0.0)
    rows = np.arange(model.overturned.size)
    found = sample_posterior(model, rows, rng, particles=SAMPLER.final)
    execution.notify(Stage.INFERENCE, 1.0)
    return found


def _judged_held_out(
    model: OutcomeModel, likeliest: Sequence[str], execution: Execution, seed: int
) -> HeldOutCauses:
    """Losses with choices of the likeliest causes, on motions they were not inferred from."""
    return judge_causes(
        model, likeliest[: HELD_OUT_CAUSES.judged], likely=FOUND_CAUSES.likely, seed=seed,
        threads=usable_threads(execution.threads),
        progress=lambda share: execution.notify(Stage.JUDGEMENT, share),
    )  # fmt: skip


def _not_looked_for(simulator: SceneSimulator, names: Collection[str]) -> dict[str, Any]:
    rest = [
        name
        for name, effect in simulator.library.items()
        if name not in (*names, *simulator.excluded) and sides(effect)
    ]
    why = {name: not_judged(simulator.library[name]) for name in rest}
    return {
        "not_judged": {name: str(code or NotJudged.PART_NOT_JUDGED) for name, code in why.items()},
        "excluded": list(simulator.excluded),
        "unavailable": {name: str(error.fault) for name, error in simulator.unavailable.items()},
    }


def _rested_on(study: Study, hypotheses: Hypotheses, simulator: SceneSimulator) -> dict[str, Any]:
    return base_provenance(_native.build_facts()) | {
        "scene": study.name,
        "scene_effects": study.effects,
        "priors": hypotheses.ends,
        "simulator": simulator.identity,
        "nuisances": [one.to_json() for one in simulator.nuisances],
        "constants": causes_constants(),
    }


def _modelled(
    used: Campaign,
    simulator: SceneSimulator,
    folder: Path | None,
    scenes: int,
    execution: Execution,
    seed: int,
) -> tuple[OutcomeModel, Ensemble, dict[str, Any]]:
    """The model of outcomes, the scene as it is, and what was simulated."""
    if GAIN not in simulator.library:
        raise DiagnosisError(f"hypotheses: margins need the effect {GAIN}; leave it in the library")
    space = cause_space(simulator.library, simulator.excluded)
    if not space.names:
        raise DiagnosisError("no effect is left to look for: exclude fewer")
    if folder is not None:
        known = ("simulator", simulator.identity), ("outcomes", outcomes_hash(used.overturned))
        for key, value in known:
            refuse_other_work(
                folder / CAUSES_FILE, ("provenance", key), value, "a search for causes"
            )
    overturned, motions = used.overturned > 0, np.asarray(used.motion_ids)
    path = execution.simulations(folder)
    sessions = [trial.session for trial in used.trials]
    steps = session_steps(space, used.relative_order, sessions, simulator.excluded)
    allowed = frozenset(steps.together.names) if GAIN in simulator.excluded else None
    with SimulationCache(simulator, path, chunk=PREDICTION.chunk) as cache:
        found = simulate_scenes(
            cache, space, overturned, motions, scenes, allowed=allowed, seed=seed,
            progress=lambda share: execution.notify(Stage.MARGINS, share),
        )  # fmt: skip
        as_it_is = simulate_as_it_is(
            cache, len(used),
            progress=lambda done, of: execution.notify(Stage.SIMULATION, done / of),
        )  # fmt: skip
        work: dict[str, Any] = {
            "scenes": scenes, "simulations": cache.asked, "simulated": cache.simulated,
        }  # fmt: skip
    work["threads"] = usable_threads(execution.threads)
    work["outcomes"] = outcomes_hash(used.overturned)
    emulator = found.known().emulator(space)
    nuisances = len(simulator.nuisance_names)
    model = OutcomeModel(
        steps.together, emulator, overturned, motions, nuisances, allowed, steps=steps
    )
    return model, as_it_is, work


def _check(used: Campaign, scenes: int) -> None:
    if scenes < SCENES.least:
        raise DiagnosisError(f"scenes is {scenes}; give {SCENES.least} or more")
    if len(used) == 0 or used.overturned.min() == used.overturned.max():
        raise DiagnosisError(
            f"campaign {used.name!r}: of the trials with a motion and an outcome none "
            f"{'overturned' if not used.overturned.any() else 'stood'}; causes need both kinds"
        )
    if len(set(used.motion_ids)) < 2:
        raise DiagnosisError(
            f"campaign {used.name!r}: has one ground motion; causes are judged by other motions, "
            "so give two or more"
        )


def _check_priors(hypotheses: Hypotheses) -> None:
    given = [key for key in hypotheses.priors if key.partition(".")[0] == GAIN]
    if given:
        raise DiagnosisError(
            f"prior of {given[0]}: the strength of the motion has a prior of its own here; give "
            f"none, or exclude {GAIN}"
        )


def _judged_by(given: Campaign) -> Campaign:
    """Its trials with motion and outcome."""
    moved = given.with_motion()
    return moved.select(np.isfinite(moved.overturned))


def _probabilities(judged: HeldOutCauses) -> dict[str, Array]:
    """Of overturning, by name of what may act."""
    found = {_label(allowed): p for allowed, p in judged.probability.items()}
    return found | {"all": judged.everything, "likely": judged.likely}


def _label(allowed: frozenset[str]) -> str:
    return "+".join(sorted(allowed)) or "none"


def _corrected(
    study: Study, rows: Sequence[Mapping[str, Any]]
) -> tuple[Study | None, dict[str, dict[str, float]], list[str]]:
    """The scene with its likely causes, what was added, and causes that no study can add to it."""
    scene: Study | None = None
    added: dict[str, dict[str, float]] = {}
    not_stated: list[str] = []
    for row in rows:
        if row["acts"] < FOUND_CAUSES.likely:
            continue
        own = {
            name: one["mean"] for name, one in row["parameters"].items() if one["mean"] is not None
        }
        try:
            scene = scene_with(study, added | {row["name"]: own})
            added[row["name"]] = own
        except ConfigError:
            not_stated.append(row["name"])
    return scene, added, not_stated


def _drawn(
    study: Study,
    model: OutcomeModel,
    particles: Particles,
    draws: int,
    rng: np.random.Generator,
) -> tuple[Study, ...]:
    """The scene with what acts in particles at random, those that a study can state.

    Particles that descend from one lie beside each other, so that the first ones are no sample.
    """
    out: list[Study] = []
    for k in rng.permutation(len(particles)):
        if len(out) == draws:
            break
        own = particles.taken(np.array([k]))
        added = {
            name: {p.name: float(values[0]) for p, values in drawn_values(model, own, name)}
            for name, on in zip(model.names, own.acts[0], strict=True)
            if on
        }
        with contextlib.suppress(ConfigError):
            out.append(scene_with(study, added))
    return tuple(out)


def causes_constants() -> dict[str, dict[str, Any]]:
    """Tuned numbers that causes rest on, by what they are of."""
    return {
        "cause_space": asdict(CAUSES),
        "step_table": asdict(STEP_TABLE),
        "margin_search": asdict(SEARCH),
        "scenes": asdict(SCENES),
        "trial_groups": asdict(TRIAL_GROUPS),
        "kernel": asdict(KERNEL),
        "outcomes": asdict(OUTCOME_MODEL),
        "sampler": asdict(SAMPLER),
        "held_out_causes": asdict(HELD_OUT_CAUSES),
        "negative_controls": asdict(NEGATIVE_CONTROLS),
        "found_causes": asdict(FOUND_CAUSES),
        **prediction_constants(),
    }
