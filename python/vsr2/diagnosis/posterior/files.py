"""The trained posterior as a file, for the next campaign of the same trials."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.posterior.calibration import Levels
from vsr2.diagnosis.posterior.goodness_of_fit import LibraryFit
from vsr2.diagnosis.posterior.network import Network
from vsr2.diagnosis.posterior.parameters import Parameters
from vsr2.diagnosis.posterior.sets import Sets, declared_alike
from vsr2.diagnosis.posterior.summaries import Standard, Summaries
from vsr2.diagnosis.posterior.training import Posterior
from vsr2.diagnosis.simulated.library import Library
from vsr2.errors import ResultError
from vsr2.results.atomic import write_atomic

FORMAT = 8
"""Of the file, and of what features are: a posterior of another form is trained again."""


def save_posterior(posterior: Posterior, path: Path) -> None:
    """Write a posterior, atomically.

    Raises:
        ResultError: it cannot be written.
    """
    arrays: dict[str, NDArray[Any]] = {
        "probability": posterior.standard.probability,
        "standard_centre": posterior.standard.centre,
        "standard_scatter": posterior.standard.scatter,
        "coefficients": posterior.summaries.coefficients,
        "intercepts": posterior.summaries.intercepts,
        "reproduction": posterior.summaries.reproduction,
        "deviation": posterior.summaries.deviation,
        "effect": posterior.summaries.effect,
        "centre": posterior.centre,
        "scale": posterior.scale,
        "gap_free": posterior.gap_free,
        "misfits": posterior.misfits,
        "library_fit_size": posterior.library_fit.size,
        "library_fit_unexplained": posterior.library_fit.unexplained,
        "residuals": posterior.parameters.residuals,
    }
    for k, network in enumerate(posterior.networks):
        for layer, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
            arrays[f"weight {k} {layer}"], arrays[f"bias {k} {layer}"] = weight, bias
    for name in posterior.parameters.rows:
        arrays[f"rows {name}"] = posterior.parameters.rows[name]
        arrays[f"values {name}"] = posterior.parameters.values[name]
    content = {
        "format": FORMAT,
        "names": posterior.sets.names,
        "most": posterior.sets.most,
        "trials": posterior.summaries.trials,
        "networks": len(posterior.networks),
        "layers": len(posterior.networks[0].weights),
        "levels": asdict(posterior.levels),
        "campaigns": posterior.campaigns,
    }
    about = np.array(json.dumps(content))
    write_atomic(path, lambda file: np.savez(file, about=about, **arrays))  # type: ignore[arg-type]


def load_posterior(path: Path, library: Library) -> Posterior | None:
    """Read a posterior; None: there is none.

    Args:
        path: of the file.
        library: the same effects as at its training.

    Raises:
        ResultError: it is damaged.
    """
    if not path.exists():
        return None
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            about = json.loads(str(file["about"]))
            if about["format"] != FORMAT or tuple(about["names"]) != tuple(library):
                return None
            sets = Sets(tuple(about["names"]), about["most"])
            networks = tuple(
                Network(
                    sets,
                    [file[f"weight {k} {layer}"] for layer in range(about["layers"])],
                    [file[f"bias {k} {layer}"] for layer in range(about["layers"])],
                )
                for k in range(about["networks"])
            )
            held = [name for name in sets.names if f"rows {name}" in file]
            return Posterior(
                sets=sets,
                standard=Standard(
                    file["probability"], file["standard_centre"], file["standard_scatter"]
                ),
                summaries=Summaries(
                    file["coefficients"], file["intercepts"], file["reproduction"],
                    file["deviation"], file["effect"], about["trials"],
                ),
                centre=file["centre"],
                scale=file["scale"],
                networks=networks,
                levels=Levels(**about["levels"]),
                parameters=Parameters(
                    library,
                    file["residuals"],
                    {name: file[f"rows {name}"] for name in held},
                    {name: file[f"values {name}"] for name in held},
                ),
                alike=declared_alike(library),
                gap_free=file["gap_free"],
                misfits=file["misfits"],
                library_fit=LibraryFit(
                    file["library_fit_size"], file["library_fit_unexplained"]
                ),
                campaigns=about["campaigns"],
            )  # fmt: skip
    except Exception as error:  # a damaged archive raises what zipfile and numpy happen to raise
        reason = ascii(str(error))[1:-1][:200]
        raise ResultError(
            f"{path}: damaged ({reason}); remove it, and the posterior is trained again"
        ) from None
