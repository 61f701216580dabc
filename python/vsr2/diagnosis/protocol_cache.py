"""What the diagnoses of several campaigns of one protocol have in common."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.observed.features import Sampling
from vsr2.diagnosis.simulated.design import Design
from vsr2.diagnosis.which.routes import Prepared

KEPT = 2
"""Fitted models that are remembered."""


@dataclass(frozen=True, eq=False)
class ProtocolCache:
    """Simulations and fitted models, for diagnoses one after the other.

    Campaigns of one protocol have the same trials: motions, order, sessions. What is simulated and
    fitted for one serves all.

    Attributes:
        file: of simulations.
        series: simulate series too, also for diagnoses that do not use them, so that those that do
            find their simulations.
        sampling: of series, where a campaign comes without them.
    """

    file: Path
    series: bool = False
    sampling: Sampling | None = None
    _models: OrderedDict[str, Prepared] = field(default_factory=OrderedDict, repr=False)

    def prepared(self, key: str, prepare: Callable[[], Prepared]) -> Prepared:
        """The models of a key, fitted if they are not among the last few."""
        if key not in self._models:
            self._models[key] = prepare()
            while len(self._models) > KEPT:
                self._models.popitem(last=False)
        self._models.move_to_end(key)
        return self._models[key]


def fingerprint(design: Design, *parts: NDArray[np.generic] | tuple[object, ...] | int) -> str:
    """Hash of simulated campaigns and of what else a fit depends on."""
    digest = hashlib.blake2b(digest_size=16)
    arrays = [design.effect, design.nuisances, design.overturned, design.features]
    for array in [*arrays, *design.quantiles]:
        digest.update(f"{array.dtype.str}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    for part in parts:
        digest.update(part.tobytes() if isinstance(part, np.ndarray) else repr(part).encode())
    return digest.hexdigest()
