"""The scene with what a diagnosis names: to be run, to predict with, to be diagnosed again."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.config import Study, dump_study
from vsr2.config.seeds import checked_seed
from vsr2.diagnosis.verdict.document import Diagnosis
from vsr2.diagnosis.verdict.statements import VerdictKind
from vsr2.effects import Effect, EffectRangeWarning, check_study_effects, effect
from vsr2.ensemble.observed.random_streams import Stream, generator
from vsr2.ensemble.simulated.library import Library, free_parameters, is_angle, turn_of
from vsr2.errors import ConfigError, DiagnosisError, ResultError
from vsr2.posterior.parameters import PARAMETERS
from vsr2.results.atomic import make_folder, write_text

CORRECTED_FILE = "corrected.yaml"
DRAWS_FOLDER = "corrected_draws"
DRAWS = "draw_*.yaml"
"""Files in it."""
DIGITS = 6
"""Of the values that are written."""
Values = dict[str, dict[str, float]]


def with_correction(found: Diagnosis, study: Study, library: Library) -> Diagnosis:
    """The diagnosis with `corrected`: what it names, at the posterior mean, in its scene.

    Of each cause the first effect is taken. Values come on top of the scene's own
    (:meth:`vsr2.effects.Effect.twice`).

    Args:
        found: of a campaign.
        study: of the scene that was diagnosed.
        library: effects with their null values, as they were simulated.
    """
    return Diagnosis(
        {**found.content, "corrected": _correction(found, study, library)},
        found.trials,
        {name: _complete(library[name], rows) for name, rows in found.samples.items()},
    )


def _correction(found: Diagnosis, study: Study, library: Library) -> dict[str, Any] | None:
    names = named_together(found)
    if not names:
        return None
    rows = {row["name"]: row["parameters"] for row in found.content["effects"]}
    added = {
        name: {key: one["mean"] for key, one in rows[name].items() if one["mean"] is not None}
        for name in names
    }
    values = {name: _within(library[name], given) for name, given in added.items()}
    try:
        scene: Values | None = with_effects_on_top(study, values)
    except ConfigError:
        scene = None
    stated = {name: _stated(library[name], own) for name, own in values.items()}
    return {"effects": stated, "among": list(found.effects), "scene": scene}


def findings_of(found: Diagnosis) -> list[list[str]]:
    """Causes that a diagnosis names, of each the effects of which one acts; none: it names none."""
    named = VerdictKind(found.kind).names_effects
    return [list(one) for one in found.content["verdict"]["findings"]] if named else []


def named_together(found: Diagnosis) -> tuple[str, ...]:
    """Effects that a diagnosis says to act: of each cause the first."""
    return tuple(finding[0] for finding in findings_of(found))


def with_effects_on_top(study: Study, added: Mapping[str, Mapping[str, float]]) -> Values:
    """Effects of a study with others on top, as a study writes them.

    Args:
        study: of a scene.
        added: complete values by effect.

    Raises:
        ConfigError: an effect that a study cannot name, or that cannot act on top of the study's
            own, or a value that cannot be used.
    """
    out: dict[str, dict[str, Any]] = {name: dict(own) for name, own in study.effects.items()}
    with warnings.catch_warnings():
        # Whoever simulates the scene is warned.
        warnings.simplefilter("ignore", EffectRangeWarning)
        for name, values in added.items():
            one = effect(name)
            own = one.accept(out[name]) if name in out else one.null()
            out[name] = _stated(one, one.twice(own, values))
        out = {name: own for name, own in out.items() if own}
        check_study_effects(out, study.name)
    return out


def scene_with(study: Study, added: Mapping[str, Mapping[str, float]]) -> Study:
    """A scene with effects on top of its own, each at given values, the others at their null.

    Args:
        study: of the scene.
        added: values of some parameters, by effect.

    Raises:
        ConfigError: as :func:`with_effects_on_top`.
    """
    complete = {name: _within(effect(name), values) for name, values in added.items()}
    return _with_effects(study, with_effects_on_top(study, complete))


def corrected_study(found: Diagnosis, study: Study) -> Study | None:
    """The scene with what a diagnosis names; None where it names nothing that a study can state.

    Args:
        found: of a campaign, by :func:`vsr2.diagnose`.
        study: of the scene that was diagnosed.
    """
    corrected = found.content["corrected"]
    if corrected is None or corrected["scene"] is None:
        return None
    return _with_effects(study, corrected["scene"])


def drawn_studies(found: Diagnosis, study: Study, draws: int, *, seed: int = 0) -> list[Study]:
    """The scene with draws of the posterior of what a diagnosis names.

    Of each cause a draw takes one effect, with the chance that the diagnosis gives it.

    Args:
        found: of a campaign, by :func:`vsr2.diagnose` in this process.
        study: of the scene that was diagnosed.
        draws: their number; none come of a diagnosis that names nothing a study can state.
        seed: of the draws.

    Raises:
        DiagnosisError: more draws than the posterior has, or what is no seed.
    """
    seed = checked_seed(seed, DiagnosisError)
    if corrected_study(found, study) is None:
        return []
    check_draws(draws, min(len(rows) for rows in found.samples.values()))
    rng = generator(seed, Stream.CORRECTED)
    acts = {row["name"]: row["acts"] for row in found.content["effects"]}
    candidates = [
        names
        for names in product(*findings_of(found))
        if _drawn(found, study, names, 0) is not None
    ]
    chance = np.array([math.prod(acts[name] for name in names) for names in candidates])
    chosen = rng.choice(len(candidates), draws, p=chance / chance.sum())
    made = [_drawn(found, study, candidates[i], k) for k, i in enumerate(chosen)]
    return [one for one in made if one is not None]


def check_draws(draws: int, most: int = PARAMETERS.samples) -> None:
    """Refuse a number of draws that no posterior has.

    Raises:
        DiagnosisError: below 0, or more than there are samples.
    """
    if not 0 <= draws <= most:
        raise DiagnosisError(f"posterior draws: {draws}; give 0 to {most}")


def _drawn(found: Diagnosis, study: Study, names: Sequence[str], k: int) -> Study | None:
    """The scene with a sample of some effects; None: no study states it."""
    added = {}
    for name in names:
        row = zip(effect(name).parameters, found.samples[name][k].tolist(), strict=True)
        added[name] = _within(effect(name), {p.name: value for p, value in row})
    try:
        return _with_effects(study, with_effects_on_top(study, added))
    except ConfigError:
        return None


def _with_effects(study: Study, effects: Mapping[str, Mapping[str, Any]]) -> Study:
    return study.model_copy(update={"effects": {name: dict(own) for name, own in effects.items()}})


def _within(one: Effect, given: Mapping[str, float]) -> dict[str, float]:
    """All parameters, those given to the digits that are written and within their limits."""
    out = one.null()
    for parameter in one.parameters:
        value = given.get(parameter.name, math.inf)
        if math.isfinite(value):
            low, high = parameter.limits or (parameter.lower, parameter.upper)
            if is_angle(parameter):
                value = parameter.lower + (value - parameter.lower) % turn_of(parameter)
            out[parameter.name] = min(max(float(f"{value:.{DIGITS}g}"), low), high)
    return out


def _stated(one: Effect, values: Mapping[str, float]) -> dict[str, Any]:
    """Values as a study writes them: those at their null are left out, choices are words."""
    out: dict[str, Any] = {}
    for parameter in one.parameters:
        value = values[parameter.name]
        if parameter.is_null(value) or not math.isfinite(value):
            continue
        number = float(f"{value:.{DIGITS}g}")
        out[parameter.name] = parameter.choices[int(number)] if parameter.choices else number
    return out


def _complete(one: Effect, rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Samples of the free parameters with all others at their null, shape (samples, parameters)."""
    free = [parameter.name for parameter in free_parameters(one)]
    out = np.tile([parameter.null for parameter in one.parameters], (len(rows), 1))
    for k, parameter in enumerate(one.parameters):
        if parameter.name in free:
            out[:, k] = rows[:, free.index(parameter.name)]
    return out


def write_corrected(found: Diagnosis, study: Study, folder: Path) -> Path | None:
    """Write `corrected.yaml`; remove an earlier one where there is none to write.

    Returns:
        The file; None: nothing is named that a study can state.

    Raises:
        ResultError: it cannot be written.
    """
    path, corrected = folder / CORRECTED_FILE, corrected_study(found, study)
    if corrected is None:
        path.unlink(missing_ok=True)
        return None
    write_text(path, f"{_comment(found)}{dump_study(corrected, relative_to=folder)}")
    return path


def write_draws(found: Diagnosis, study: Study, folder: Path, draws: int) -> list[Path]:
    """Write scenes with draws of the posterior into `corrected_draws`; earlier ones are removed.

    Args:
        found: of a campaign, by :func:`vsr2.diagnose` in this process.
        study: of the scene that was diagnosed.
        folder: of the diagnosis.
        draws: their number.

    Raises:
        DiagnosisError: more draws than the posterior has.
        ResultError: a file cannot be written.
    """
    seed = found.content["provenance"]["seed"]
    return write_scenes(drawn_studies(found, study, draws, seed=seed), folder)


def write_scenes(scenes: Sequence[Study], folder: Path) -> list[Path]:
    """Write scenes into `corrected_draws` of a folder; earlier ones are removed.

    Raises:
        ResultError: a file cannot be written.
    """
    below = folder / DRAWS_FOLDER
    try:
        for old in below.glob(DRAWS):
            old.unlink()
    except OSError as error:
        raise ResultError(f"{below}: cannot be used ({error.strerror})") from error
    if scenes:
        make_folder(below)
    paths = []
    for k, scene in enumerate(scenes):
        paths.append(below / f"draw_{k:03d}.yaml")
        head = scene_head({"posterior_draw": k + 1, "posterior_draws": len(scenes)})
        write_text(paths[-1], head + dump_study(scene, relative_to=below))
    return paths


def scene_head(facts: Mapping[str, object]) -> str:
    """What a written scene is, as a comment: one name with its value a line."""
    return "".join(f"# {name}: {value}\n" for name, value in facts.items())


def _comment(found: Diagnosis) -> str:
    equivalent = [" or ".join(finding) for finding in findings_of(found) if len(finding) > 1]
    facts = {"corrected_for": ", ".join(found.content["corrected"]["effects"])}
    facts["values"] = "posterior_mean"
    return scene_head(facts | ({"equivalent": ", ".join(equivalent)} if equivalent else {}))
