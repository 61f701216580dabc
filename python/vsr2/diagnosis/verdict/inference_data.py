"""Samples of a diagnosis in the form of ArviZ."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from vsr2.effects import effect
from vsr2.ensemble.simulated.library import free_parameters
from vsr2.errors import DiagnosisError

if TYPE_CHECKING:
    import arviz
    from numpy.typing import NDArray


def inference_data(samples: Mapping[str, NDArray[np.float64]]) -> arviz.InferenceData:
    """Samples of the posterior of each effect, given that it acts.

    The group `posterior` has a variable `effect.parameter` for each parameter that the prior leaves
    open, of one chain of independent draws, with `units` and `long_name`. Draws of several effects
    are of each effect alone: that they stand side by side says nothing about correlations.

    Args:
        samples: of :class:`vsr2.diagnosis.Diagnosis`, by effect, shape (draws, parameters).

    Raises:
        DiagnosisError: there are none, or ArviZ is not installed.
    """
    try:
        import arviz
    except ImportError as error:
        raise DiagnosisError(
            "to_inference_data needs the package arviz; install it with: pip install vsr2[arviz]"
        ) from error
    values: dict[str, Any] = {}
    about: dict[str, dict[str, str]] = {}
    for name, rows in samples.items():
        one = effect(name)
        free = free_parameters(one)
        # Those of one campaign that are completed hold the fixed parameters, too.
        held = one.parameters if rows.shape[1] == len(one.parameters) else free
        for parameter, column in zip(held, rows.T, strict=True):
            if parameter in free:
                key = f"{name}.{parameter.name}"
                values[key] = column[None, :]
                about[key] = {"units": parameter.unit, "long_name": parameter.meaning}
    if not values:
        raise DiagnosisError(
            "the diagnosis names no effect, so there are no samples; or it was read from a file, "
            "which has none: diagnose again"
        )
    made: arviz.InferenceData = arviz.from_dict(posterior=values)
    for key, attributes in about.items():
        made["posterior"][key].attrs.update(attributes)
    return made
