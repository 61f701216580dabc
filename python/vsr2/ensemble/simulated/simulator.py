"""The one door through which simulations of a campaign are seen."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vsr2.ensemble.simulated.library import Library

Array = NDArray[np.float64]
Effects = tuple[tuple[str, tuple[float, ...]], ...]

HALF_STEP, FINE_SOLVER = -5, -6
"""Replicates at half the time step, and with twice the solver's iterations."""
PERTURBED = -7
"""This and lower replicates: the start is moved in plan by the shifts of `SIMULATION` in turn and
turned by as many radians."""
RATIO_STEPS = 30
"""Of the fixed-point iteration for the generalised golden ratio (M. Roberts 2018). One takes the
error to a third or less, so that the rounding of numbers near 1 is reached (3^-30 is 5e-15)."""


@dataclass(frozen=True)
class SimulationConstants:
    """How starts are perturbed; chosen by hand, from far below to near what a set-up repeats to.

    Attributes:
        least_shift: the first shift, of which each further one is ten times the one before [m],
            [rad].
        shifts: their number.
    """

    least_shift: float = 1e-6
    shifts: int = 3


SIMULATION = SimulationConstants()


class Request(NamedTuple):
    """One simulation of one trial.

    Attributes:
        trial: index in the campaign.
        effects: name and parameter values of each effect that acts; empty: none.
        nuisance: index of a draw of the nuisances; 0: all at their nominal values.
        replicate: index of the draws that belong to the trial alone (start pose, input noise); 0:
            none of them; below 0: numerical variants, see `HALF_STEP`, `FINE_SOLVER`, `PERTURBED`.
    """

    trial: int
    effects: Effects
    nuisance: int
    replicate: int


@dataclass(frozen=True, eq=False)
class Responses:
    """What the simulations gave, one row a request.

    Attributes:
        overturned: 1 or 0; NaN where a simulation has no trustworthy outcome, shape (n,).
        peak_tilt: largest tilt [rad], shape (n,).
        features: of the series, NaN where one does not apply, shape (n, k), those of
            `features.TILT_FEATURES` and, where the simulator knows them, of `REST_FEATURES`, the
            latter as plain numbers; None: not asked for.
    """

    overturned: Array
    peak_tilt: Array
    features: Array | None

    def __len__(self) -> int:
        return self.overturned.size


class Simulator(Protocol):
    """Simulates the trials of one campaign under any effects and nuisances.

    Equal requests give equal responses, whatever stands beside them in a call.
    """

    @property
    def library(self) -> Library:
        """Effects that it can apply."""
        ...

    @property
    def identity(self) -> str:
        """Hash of all that responses depend on beside the request: scene, trials, seed."""
        ...

    @property
    def variants(self) -> Collection[int]:
        """Which of `HALF_STEP` and `FINE_SOLVER` it knows as replicates."""
        ...

    @property
    def nuisance_names(self) -> tuple[str, ...]:
        """What is uncertain and not to be diagnosed."""
        ...

    def nuisance_draw(self, index: int) -> Array:
        """Standardised nuisances of a draw, shape (nuisances,); zeros for index 0."""
        ...

    def run(self, requests: Sequence[Request]) -> Responses:
        """Simulate."""
        ...


def nuisance_normal(seed: int, count: int, index: int) -> Array:
    """A point of a scrambled sequence of standard normals, zeros for index 0, shape (count,).

    Additive recurrence with the generalised golden ratio (M. Roberts, "The unreasonable
    effectiveness of quasirandom sequences", 2018), shifted at random by `seed`: low discrepancy,
    and any draw can be made alone.
    """
    from scipy.special import ndtri

    if index == 0:
        return np.zeros(count)
    return np.asarray(ndtri(quasi_random(seed, count, index)), dtype=np.float64)


def quasi_random(seed: int, count: int, index: int) -> Array:
    """The same sequence, uniform in (0, 1), shape (count,)."""
    ratio = 2.0
    for _ in range(RATIO_STEPS):
        ratio = (1.0 + ratio) ** (1.0 / (count + 1))
    steps = ratio ** -np.arange(1.0, count + 1)
    shift = np.random.default_rng(seed).random(count)
    return np.asarray(np.clip((shift + index * steps) % 1.0, 1e-6, 1 - 1e-6), dtype=np.float64)
