"""The trained posterior as a file, for the next campaign of the same trials."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, astuple, fields
from math import isfinite, isinf
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.ensemble.observed.observations import Observations
from vsr2.ensemble.simulated.campaigns import SET_PRIOR
from vsr2.ensemble.simulated.hypotheses import HYPOTHESIS
from vsr2.ensemble.simulated.library import Library, content_of, free_parameters
from vsr2.ensemble.simulated.simulator import Simulator
from vsr2.errors import ResultError
from vsr2.posterior.calibration import CALIBRATED, Levels
from vsr2.posterior.discrepancy import DISCREPANCY
from vsr2.posterior.discrepancy_size import DISCREPANCY_SIZE, DiscrepancySize
from vsr2.posterior.effect_curves import EFFECT_CURVE, Curves
from vsr2.posterior.file_arrays import FileArrays
from vsr2.posterior.naming import NAMING
from vsr2.posterior.network import NETWORK, Floats, Network
from vsr2.posterior.outside import OUTSIDE, Outside
from vsr2.posterior.parameters import PARAMETERS, Parameters
from vsr2.posterior.second_cause import SECOND_CAUSE, SecondCause
from vsr2.posterior.sets import Sets, declared_alike
from vsr2.posterior.summaries import SUMMARY, Standard, Summaries
from vsr2.posterior.training import Posterior
from vsr2.posterior.truth import PRIOR
from vsr2.posterior.withheld_parts import WITHHELD
from vsr2.posterior.within_library import TRAINING, WithinLibrary
from vsr2.results.atomic import write_atomic

POSTERIORS = "posterior-*.npz"
FORMAT = 17
"""Of the file, and of features and their noise: a posterior of another form is trained again."""


def posterior_file(
    folder: Path,
    simulator: Simulator,
    seen: Observations,
    simulated: Sequence[int],
    seed: int,
    most: int = HYPOTHESIS.usual_effects,
    excluded: Collection[str] = (),
) -> Path:
    """File of the posterior trained for a simulator and what a campaign measures.

    Args:
        folder: of it.
        simulator: its identity, and its library with the priors.
        seen: the observed campaign, whose outcomes have no part in it.
        simulated: number of campaigns, of trials of each, and what the look was at.
        seed: of the training.
        most: effects that may act together.
        excluded: effects of the simulator's library that are not looked for.
    """
    digest = hashlib.blake2b(digest_size=8)
    constants = (
        SUMMARY, DISCREPANCY, NETWORK, PRIOR, TRAINING, OUTSIDE, WITHHELD, NAMING, CALIBRATED,
        PARAMETERS, SET_PRIOR, EFFECT_CURVE, SECOND_CAUSE, DISCREPANCY_SIZE,
    )  # fmt: skip
    parts = (
        simulator.identity, content_of(simulator.library), seen.tier,
        [feature.name for feature in seen.measured], seen.tilt_offset,
        seen.tilt_noise, seen.relative_tilt_noise, seen.from_series.tolist(), seen.rest_noise,
        seen.motion.tolist(), list(simulated), seed, most, sorted(excluded),
        [astuple(one) for one in constants],
    )  # fmt: skip
    digest.update(repr(parts).encode())
    return folder / POSTERIORS.replace("*", digest.hexdigest())


def save_posterior(posterior: Posterior, path: Path) -> None:
    """Write a posterior, atomically.

    Raises:
        ResultError: it cannot be written.
    """
    within = posterior.within
    arrays: dict[str, NDArray[Any]] = {
        "probability": posterior.standard.probability,
        "standard_centre": posterior.standard.centre,
        "standard_scatter": posterior.standard.scatter,
        "coefficients": within.summaries.coefficients,
        "intercepts": within.summaries.intercepts,
        "reproduction": within.summaries.reproduction,
        "deviation": within.summaries.deviation,
        "effect": within.summaries.effect,
        "centre": within.centre,
        "scale": within.scale,
        "outside": np.array([posterior.outside.constant, *posterior.outside.coefficients]),
        "discrepancy": np.array(
            [posterior.discrepancy.constant, *posterior.discrepancy.coefficients]
        ),
        "discrepancy_missed": posterior.discrepancy.missed,
        "gap_free": posterior.gap_free,
        "misfits": posterior.misfits,
        "residuals": posterior.parameters.residuals,
    }
    for k, network in enumerate(within.networks):
        for layer, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
            arrays[f"weight {k} {layer}"], arrays[f"bias {k} {layer}"] = weight, bias
    for k, curves in enumerate(within.curves):
        arrays |= {f"curves {k} {one.name}": getattr(curves, one.name) for one in fields(Curves)}
    for k, judge in enumerate(within.judges):
        arrays |= {f"judge {k} scale": judge.scale, f"judge {k} weights": judge.weights}
    for name in posterior.parameters.rows:
        arrays[f"rows {name}"] = posterior.parameters.rows[name]
        arrays[f"values {name}"] = posterior.parameters.values[name]
    content = {
        "format": FORMAT,
        "names": posterior.sets.names,
        "most": posterior.sets.most,
        "trials": within.summaries.trials,
        "networks": len(within.networks),
        "layers": len(within.networks[0].weights),
        "curves": len(within.curves),
        "judges": len(within.judges),
        "temperature": within.temperature,
        "levels": asdict(posterior.levels),
        "campaigns": posterior.campaigns,
        "trained_on": posterior.trained_on,
    }
    about = np.array(json.dumps(content))
    write_atomic(path, lambda file: np.savez(file, about=about, **arrays))  # type: ignore[arg-type]


def load_posterior(
    path: Path, library: Library, campaign: tuple[int, int] | None = None
) -> Posterior | None:
    """Read a posterior; None: there is none of these effects and so many trials.

    Args:
        path: of the file.
        library: the same effects as at its training.
        campaign: numbers of trials and of features that it is asked about; None: any.

    Raises:
        ResultError: it is damaged, or has other features; names array, value and remedy.
    """
    if not path.exists():
        return None
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            about = json.loads(str(file["about"]))
            if about["format"] != FORMAT or tuple(about["names"]) != tuple(library):
                return None
            trials = _count(about, "trials")
            if campaign is not None and trials != campaign[0]:
                return None  # Of a look with another budget, in which other trials respond.
            return _checked(file, about, library, None if campaign is None else campaign[1])
    except Exception as error:  # a damaged archive raises what zipfile and numpy happen to raise
        reason = ascii(str(error))[1:-1][:200]
        raise ResultError(
            f"{path}: damaged ({reason}); remove it, and the posterior is trained again"
        ) from None


def _checked(
    file: Mapping[str, Any],
    about: Mapping[str, Any],
    library: Library,
    features: int | None,
) -> Posterior:
    """The posterior in a file; `features`: their number, None: any.

    Raises:
        ValueError: names array or key, value and what is wanted.
    """
    sets = Sets(tuple(library), _count(about, "most"))
    known = {"trials": _count(about, "trials"), "effects": len(library)}
    if features is not None:
        known["features"] = features
    # A campaign of outcomes alone has no features.
    arrays = FileArrays(file, known, may_be_zero=("features",))
    standard = Standard(
        arrays.numbers("probability", "trials", above=0.0),
        arrays.numbers("standard_centre", "trials", "features"),
        arrays.numbers("standard_scatter", "trials", "features", above=0.0),
    )
    channels = 1 + arrays.size("features")
    columns = channels * arrays.size("trials")
    summaries = Summaries(
        arrays.numbers("coefficients", "folds", columns, "targets"),
        arrays.numbers("intercepts", "folds", "targets"),
        arrays.numbers("reproduction", "targets", columns),
        arrays.numbers("deviation", "targets", above=0.0),
        arrays.indices("effect", "targets", least=-1, below=len(library)),
        known["trials"],
    )
    # Discriminants, two sizes of residuals and a mean for each channel: see `Summaries.complete`.
    count = arrays.size("targets") + 3 * channels
    curves = tuple(_curves(arrays, k) for k in range(_count(about, "curves", least=0)))
    judges = _count(about, "judges", least=0)
    if judges not in (0, len(curves)):
        raise ValueError(f"key judges is {judges}, wanted is 0 or {len(curves)}")
    within = WithinLibrary(
        sets=sets,
        alike=declared_alike(library),
        summaries=summaries,
        centre=arrays.numbers("centre", count),
        scale=arrays.numbers("scale", count, above=0.0),
        networks=tuple(
            _network(arrays, sets, k, _count(about, "layers"), count)
            for k in range(_count(about, "networks"))
        ),
        curves=curves,
        judges=tuple(
            SecondCause(
                curves[k],
                arrays.numbers(f"judge {k} scale", "judged", above=0.0),
                arrays.numbers(f"judge {k} weights", arrays.size("judged") + 1),
            )
            for k in range(judges)
        ),
        temperature=_positive(about, "temperature"),
    )
    outside = arrays.numbers("outside", sets.most + 2)
    size = arrays.numbers("discrepancy", count + 1)
    return Posterior(
        standard=standard,
        within=within,
        outside=Outside(float(outside[0]), outside[1:]),
        levels=_levels(about["levels"]),
        parameters=_parameters(arrays, library, columns),
        discrepancy=DiscrepancySize(
            float(size[0]), size[1:], arrays.numbers("discrepancy_missed", "missed")
        ),
        gap_free=arrays.numbers("gap_free", "plain", columns).astype(np.float32, copy=False),
        misfits=arrays.numbers("misfits", "misfits"),
        campaigns=_count(about, "campaigns"),
        trained_on=_count(about, "trained_on"),
    )


def _network(arrays: FileArrays, sets: Sets, k: int, layers: int, summaries: int) -> Network:
    """One network, from summaries to what the sets are made of."""
    inputs = summaries
    weights: list[Floats] = []
    biases: list[Floats] = []
    for layer in range(layers):
        outputs: str | int = f"units {k} {layer}"
        if layer == layers - 1:
            outputs = sets.parts.shape[1]
        weight = arrays.numbers(f"weight {k} {layer}", inputs, outputs)
        bias = arrays.numbers(f"bias {k} {layer}", outputs)
        weights.append(weight.astype(np.float32, copy=False))
        biases.append(bias.astype(np.float32, copy=False))
        inputs = weights[-1].shape[1]
    return Network(sets, weights, biases)


def _curves(arrays: FileArrays, k: int) -> Curves:
    """Those of one fold."""
    place = f"curves {k}"
    return Curves(
        white=arrays.numbers(f"{place} white", "targets", "targets"),
        origin=arrays.numbers(f"{place} origin", "targets"),
        means=arrays.numbers(f"{place} means", "effects", "points", "targets"),
        sizes=arrays.numbers(f"{place} sizes", "effects", "points"),
    )


def _parameters(arrays: FileArrays, library: Library, columns: int) -> Parameters:
    """Campaigns in which effects act, and the values of these."""
    residuals = arrays.numbers("residuals", "acting", columns)
    rows, values = {}, {}
    for name, effect in library.items():
        if f"rows {name}" in arrays:
            rows[name] = arrays.indices(f"rows {name}", f"of {name}", least=0, below=len(residuals))
            free = free_parameters(effect)
            endless = [isinf(parameter.null) for parameter in free]
            values[name] = arrays.numbers(
                f"values {name}", f"of {name}", len(free), endless=endless
            )
    return Parameters(library, residuals.astype(np.float32, copy=False), rows, values)


def _levels(content: Mapping[str, Any]) -> Levels:
    """Calibrated levels, all of them numbers."""
    names = [one.name for one in fields(Levels)]
    if sorted(content) != sorted(names):
        raise ValueError(f"key levels has {sorted(content)}, wanted is {sorted(names)}")
    for name, value in content.items():
        if not _is_finite(value):
            raise ValueError(f"key levels.{name} is {value!r}, wanted is a finite number")
    return Levels(**content)


def _is_finite(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and isfinite(value)


def _positive(about: Mapping[str, Any], key: str) -> float:
    """A finite number above 0."""
    value = about[key]
    if not _is_finite(value) or value <= 0:
        raise ValueError(f"key {key} is {value!r}, wanted is a finite number above 0")
    return float(value)


def _count(about: Mapping[str, Any], key: str, least: int = 1) -> int:
    """A whole number of at least `least`."""
    value = about[key]
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise ValueError(f"key {key} is {value!r}, wanted is a whole number of at least {least}")
    return value
