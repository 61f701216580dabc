"""Margins of drawn scenes, each sought from where those of other scenes lie."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.library import GAIN
from vsr2.ensemble.simulated.scene_simulator import KEPT_MOTIONS, KEPT_SCENES
from vsr2.ensemble.simulated.simulator import Effects, Request

Array = NDArray[np.float64]
Overturns = Callable[[NDArray[np.int64], Array], Array]
"""Called with positions and logarithms of factors on the motion, gives 1, 0, or NaN where a
simulation failed, one for each position."""


@dataclass(frozen=True)
class SearchConstants:
    """How margins are sought; chosen by hand.

    Attributes:
        reach: of the logarithm of the factor on the motion, both ways.
        width: of the range that is left, by which a margin is good to half of it. It errs by a
            standard deviation of .07 then, where those of the laboratory's rock differ by .14
            between like scenes (`emulator.noise` of docs/results/lab_several_causes.json).
        step: of the first step away from the guess; each further one is twice as long.
        pilot: scenes whose margins are sought first, from the middle; their median is the guess
            for the others.
    """

    reach: float = 1.0
    width: float = 0.25
    step: float = 0.25
    pilot: int = 16


SEARCH = SearchConstants()


class _State(IntEnum):
    OPEN = 0
    FOUND = 1
    FAILED = 2


def search_margins(overturns: Overturns, guess: Array) -> Array:
    """Logarithm of the factor on the motion at which each rock overturns, shape as `guess`.

    The search steps away from the guess until the outcome changes, then halves. Where the rock
    stands at the largest factor, or falls at the least, that end is the margin.

    Args:
        overturns: simulates what is asked.
        guess: where the search begins; NaN: from the motion as it is.

    Returns:
        NaN where a simulation failed.
    """
    reach, width = SEARCH.reach, SEARCH.width
    shape, guesses = guess.shape, guess.ravel()
    # On a grid of widths, so that later scenes ask for factors that earlier ones asked for.
    at = np.clip(np.round(np.nan_to_num(guesses) / width) * width, -reach, reach)
    low, high = np.full(at.size, -np.inf), np.full(at.size, np.inf)
    step = np.full(at.size, SEARCH.step)
    state = np.full(at.size, _State.OPEN)
    out = np.full(at.size, np.nan)
    while (rows := np.flatnonzero(state == _State.OPEN)).size:
        fell = overturns(rows, at[rows])
        state[rows[np.isnan(fell)]] = _State.FAILED
        for end, limit, reached in ((high, -reach, fell > 0.5), (low, reach, fell < 0.5)):
            hit = rows[reached]
            end[hit] = at[hit]
            beyond = hit[at[hit] == limit]
            out[beyond], state[beyond] = limit, _State.FOUND
        both = rows[np.isfinite(low[rows]) & np.isfinite(high[rows])]
        narrow = both[high[both] - low[both] <= width]
        out[narrow], state[narrow] = 0.5 * (low[narrow] + high[narrow]), _State.FOUND
        at[both] = np.round(0.5 * (low[both] + high[both]) / width) * width
        outwards = np.setdiff1d(rows[state[rows] == _State.OPEN], both)
        sign = np.where(np.isfinite(low[outwards]), 1.0, -1.0)
        at[outwards] = np.clip(at[outwards] + sign * step[outwards], -reach, reach)
        step[outwards] *= 2
    return np.where(state == _State.FOUND, out, np.nan).reshape(shape)


def _parts(of_scene: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Margins that are sought together.

    They are so few that the simulator still keeps what it made of their scenes and motions when
    they are asked for again.
    """
    parts: list[NDArray[np.int64]] = []
    held = KEPT_SCENES
    for scene in np.unique(of_scene).tolist():
        rows = np.flatnonzero(of_scene == scene)
        for start in range(0, rows.size, KEPT_MOTIONS):
            own = rows[start : start + KEPT_MOTIONS]
            if held < KEPT_SCENES and parts[-1].size + own.size <= KEPT_MOTIONS:
                parts[-1] = np.concatenate([parts[-1], own])
                held += 1
            else:
                parts.append(own)
                held = 1
    return parts


def scene_margins(
    cache: SimulationCache,
    scenes: Sequence[tuple[int, Effects]],
    guess: Array,
    asked: NDArray[np.bool_],
    *,
    progress: Callable[[float], None] | None = None,
) -> Array:
    """Margins of trials in drawn scenes, NaN of those not asked for, shape (scenes, trials).

    Args:
        cache: of simulations.
        scenes: number of the draw of the nuisances, above 0, and the effects of each.
        guess: of each trial, NaN where nothing is known, shape (scenes, trials).
        asked: which trials of each scene, shape (scenes, trials).
        progress: called with the share that is done.
    """
    of_scene, of_trial = np.nonzero(asked)
    total, done, before = of_scene.size, 0, 0

    def overturns(rows: NDArray[np.int64], logs: Array) -> Array:
        nonlocal done

        def report(finished: int, _: int) -> None:
            if progress is not None:
                # As if each margin that is open needed two more simulations.
                share = (done + finished) / (done + finished + 2 * rows.size)
                progress((before + share * part.size) / total)

        requests = []
        for row, log in zip(part[rows].tolist(), logs.tolist(), strict=True):
            nuisance, effects = scenes[of_scene[row]]
            scaled = (GAIN, (float(np.expm1(log)),))
            requests.append(Request(int(of_trial[row]), (*effects, scaled), nuisance, 1))
        found = cache.run(requests, progress=report)
        done += rows.size
        return np.asarray(found.overturned)

    out, guesses = np.full(total, np.nan), guess[asked]
    for part in _parts(of_scene):
        out[part] = search_margins(overturns, guesses[part])
        done, before = 0, before + part.size
    found = np.full(guess.shape, np.nan)
    found[asked] = out
    return found
