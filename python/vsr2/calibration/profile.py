"""Which parameters the data tell, and which they do not.

A parameter's range is cut into cells. The profile of a cell is the best objective of all evaluated
sets that lie in it, whatever the other parameters: where these can make up for a wrong value, the
profile stays high, as a profile likelihood does. A cell is compatible with the data where its best
set is not worse than the best of all beyond the noise of the motions: where the 95 % interval of
the difference, from a bootstrap over motions of both together, includes 0. The best of a
cell that was searched more is higher by chance, and so is the best of all: a few sets in each cell
say little.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis.intervals import INTERVALS
from vsr2.calibration.calibration_study import CALIBRATION, CalibrationParameter, at_share, share_of
from vsr2.calibration.evaluation_store import Evaluation
from vsr2.calibration.objective import Objective, objective_of, objective_replicates
from vsr2.config.extended import Plain

Array = NDArray[np.float64]


class Identifiability(StrEnum):
    """How far the data tell a parameter.

    IDENTIFIED: cells on both sides of the compatible ones are worse (of listed words: some word
    is). BOUNDED_ABOVE, BOUNDED_BELOW: on that side only. NOT_IDENTIFIED: no cell is worse beyond
    noise.
    """

    IDENTIFIED = "identified"
    BOUNDED_ABOVE = "bounded_above"
    BOUNDED_BELOW = "bounded_below"
    NOT_IDENTIFIED = "not_identified"


@dataclass(frozen=True)
class Cell:
    """A part of a parameter's range, or one of its values.

    Attributes:
        low, high: ends of the cell; of a listed value both are it.
        objective: best of the sets in it; NaN: none was evaluated.
        deficit: by how much it falls short of the best of all.
        deficit_low, deficit_high: 95 % interval of that.
        sets: evaluated in it.
        compatible: whether it may be the best but for noise; False without any set.
    """

    low: Plain
    high: Plain
    objective: float
    deficit: float
    deficit_low: float
    deficit_high: float
    sets: int
    compatible: bool


@dataclass(frozen=True, eq=False)
class Profile:
    """How the best objective depends on one parameter.

    Attributes:
        name: of the parameter.
        best: its calibrated value.
        cells: along its range or list.
        verdict: how far the data tell it.
        sampled: (value, objective) of every evaluated set.
    """

    name: str
    best: Plain
    cells: tuple[Cell, ...]
    verdict: Identifiability
    sampled: tuple[tuple[Plain, float], ...]


def profiles(
    parameters: Mapping[str, CalibrationParameter],
    evaluations: Sequence[Evaluation],
    observed: NDArray[np.bool_],
    resamples: NDArray[np.int32],
    calibrated: Mapping[str, Plain],
    *,
    cells: int = CALIBRATION.cells,
    objective: Objective = Objective.MEAN_OF_THREE,
) -> tuple[Profile, ...]:
    """The profile of each parameter over all evaluated sets.

    Args:
        parameters: what was varied.
        evaluations: at least one.
        observed: outcomes, shape (trials,).
        resamples: of the bootstrap over motions, shape (replicates, trials).
        calibrated: values by parameter, for :attr:`Profile.best`.
        cells: into which a range is cut.
        objective: by which sets are judged.
    """
    known = [objective_of(observed, one.predicted, None, objective) for one in evaluations]
    scores = np.array(known)
    best = int(np.argmax(scores))
    reference = objective_replicates(observed, evaluations[best].predicted, resamples, objective)
    found = []
    for name, parameter in parameters.items():
        values = [one.values[name] for one in evaluations]
        edges = _edges(parameter, cells)
        place = [_cell_of(parameter, value, len(edges)) for value in values]
        made = []
        for i, (low, high) in enumerate(edges):
            inside = [k for k, where in enumerate(place) if where == i]
            if not inside:
                made.append(Cell(low, high, np.nan, np.nan, np.nan, np.nan, 0, False))
                continue
            top = inside[int(np.argmax(scores[inside]))]
            drawn = reference - objective_replicates(
                observed, evaluations[top].predicted, resamples, objective
            )
            under, over = (float(q) for q in np.quantile(drawn, INTERVALS.ends))
            made.append(
                Cell(
                    low=low,
                    high=high,
                    objective=float(scores[top]),
                    deficit=float(scores[best] - scores[top]),
                    deficit_low=under,
                    deficit_high=over,
                    sets=len(inside),
                    compatible=under <= 0,
                )
            )
        ordered = parameter.values is None or not any(isinstance(v, str) for v in parameter.values)
        found.append(
            Profile(
                name=name,
                best=calibrated[name],
                cells=tuple(made),
                verdict=_verdict(made, ordered),
                sampled=tuple(zip(values, scores.tolist(), strict=True)),
            )
        )
    return tuple(found)


def _edges(parameter: CalibrationParameter, cells: int) -> list[tuple[Plain, Plain]]:
    if parameter.values is not None:
        return [(value, value) for value in parameter.values]
    return [
        (at_share(parameter, i / cells), at_share(parameter, (i + 1) / cells)) for i in range(cells)
    ]


def _cell_of(parameter: CalibrationParameter, value: Plain, cells: int) -> int | None:
    if parameter.values is not None:
        return parameter.values.index(value) if value in parameter.values else None
    share = share_of(parameter, value)
    return min(cells - 1, max(0, int(share * cells))) if 0 <= share <= 1 else None


def _verdict(cells: Sequence[Cell], ordered: bool) -> Identifiability:
    """Cells without a set say nothing."""
    known = [cell for cell in cells if cell.sets]
    kept = [i for i, cell in enumerate(known) if cell.compatible]
    if not kept or len(kept) == len(known):
        return Identifiability.NOT_IDENTIFIED
    if not ordered:
        return Identifiability.IDENTIFIED
    below, above = kept[0] > 0, kept[-1] < len(known) - 1
    if below and above:
        return Identifiability.IDENTIFIED
    if below:
        return Identifiability.BOUNDED_BELOW
    # Compatible at both ends with a worse stretch between them bounds neither side.
    return Identifiability.BOUNDED_ABOVE if above else Identifiability.NOT_IDENTIFIED
