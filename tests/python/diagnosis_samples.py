"""A simulator whose answers are known in closed form, and a training of seconds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from planar.planar_library import PLANAR_LIBRARY
from planted import Rehearsal, shaken_campaign
from vsr2.diagnosis.budget import SCHEDULE
from vsr2.diagnosis.how_far.held_out import HELD_OUT
from vsr2.diagnosis.how_far.negative_controls import NEGATIVE_CONTROLS
from vsr2.effects import library
from vsr2.ensemble.noise_floor import NOISE_FLOOR
from vsr2.ensemble.observed.observations import OBSERVED
from vsr2.ensemble.simulated.campaigns import Campaigns
from vsr2.ensemble.simulated.look import LOOK
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
from vsr2.ensemble.simulated.simulator import Effects, Request, Responses, nuisance_normal
from vsr2.posterior.network import NETWORK
from vsr2.trial import Trial

NAMES = ("table_gain", "inertia", "restitution", "wear", "catch")
SCATTER = 0.05
"""Of the logarithm of the largest tilt."""


def made_trials(
    simulator: SceneSimulator,
    effects: Effects,
    nuisance: int,
    replicate: int,
    wanted: Iterable[int],
) -> dict[int, Trial]:
    """The trials that a simulator makes of a draw, by index."""
    requests = [Request(i, effects, nuisance, replicate) for i in wanted]
    asked: list[int] = []
    made = list(simulator._made(requests, asked, []))
    return {requests[k].trial: trial for k, trial in zip(asked, made, strict=True)}


class LinearSimulator:
    """Logarithms of largest tilts that are linear in effects and in one nuisance.

    Args:
        slopes: change of the logarithm under an effect's values, a number or one a trial.
        trials: of the campaign.
        base: logarithm of the largest tilt of the first and the last trial.
        nuisance: change by one nuisance of unit variance.
        scatter: of single trials.
        seed: of nuisance and scatter.
        library: that has the effects.
    """

    variants = ()
    nuisance_names = ("z",)

    def __init__(
        self, slopes, *, trials=40, base=(-3.0, -3.0), nuisance=0.0, scatter=SCATTER, seed=0,
        library=PLANAR_LIBRARY,
    ):  # fmt: skip
        self.slopes = slopes
        self.library = {name: library[name] for name in slopes}
        self.identity = f"linear {seed}"
        self._base = np.linspace(*base, trials)
        self._nuisance, self._scatter, self._seed = nuisance, scatter, seed
        self._noise = np.random.default_rng([seed, 1]).standard_normal((4001, trials))
        self._known: dict = {(): np.zeros(trials)}
        self.runs = 0

    def nuisance_draw(self, index):
        return nuisance_normal(self._seed, 1, index)

    def change(self, effects):
        if effects not in self._known:
            parts = [self.slopes[name](values) for name, values in effects]
            self._known[effects] = np.zeros(self._base.size) + sum(parts)
        return self._known[effects]

    def run(self, requests):
        self.runs += len(requests)
        z = {i: self.nuisance_draw(i)[0] for i in {r.nuisance for r in requests}}
        log = np.array(
            [
                self._base[r.trial]
                + self._nuisance * z[r.nuisance]
                + self._scatter * self._noise[(7 * r.nuisance + r.replicate) % 4001, r.trial]
                + self.change(r.effects)[r.trial]
                for r in requests
            ]
        )
        return Responses((log > 0).astype(float), np.exp(np.minimum(log, 0.4)), None)


def loss(slope):
    """Of wear, from its null to the end of its range."""
    return lambda values: slope * SCATTER * values[0] / 0.15


def slopes(trials=40):
    """Of effects that move trials in directions of their own, by ten scatters at a prior's end."""
    ways = np.random.default_rng(7).standard_normal((len(NAMES), trials))

    def of(k):
        parameter = PLANAR_LIBRARY[NAMES[k]].parameters[0]
        null = parameter.null if np.isfinite(parameter.null) else parameter.upper
        span = max(abs(parameter.upper - null), abs(parameter.lower - null))
        return lambda values: 10 * SCATTER * ways[k] * (min(values[0], 1e3) - null) / span

    own = {name: of(k) for k, name in enumerate(NAMES)}
    # A tether that never holds does nothing.
    catch = own["catch"]
    own["catch"] = lambda values: catch(values) if np.isfinite(values[0]) else 0.0
    return own


def linear(seed=1):
    """Forty trials, of which the last ones overturn."""
    return LinearSimulator(slopes(), base=(-2.5, 0.3), nuisance=0.03, seed=seed)


@contextmanager
def quick_training() -> Iterator[None]:
    """A smaller network, trained less: what it is trained for stays."""
    few = replace(
        NETWORK, hidden=(48, 32), dropout=0.1, passes=40, batch=256, rate=4e-3, least_passes=8
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("vsr2.posterior.network.NETWORK", few)
        yield


def linear_rehearsal(campaigns=600):
    return Rehearsal(linear(), shaken_campaign(8, 5, duration=1.5), campaigns=campaigns)


SMALL = (
    (
        LOOK,
        {
            "plain": 12,
            "fewest_plain": 12,
            "draws": 6,
            "shares": (1.0, 0.125, 0.015625),
            "fewest": 8,
        },
    ),
    (SCHEDULE, {"fewest": 24, "chunk": 12}),
    (HELD_OUT, {"members": 4}),
    (NEGATIVE_CONTROLS, {"dealt": 2}),
    (NOISE_FLOOR, {"replicates": 1, "most_trials": 6}),
    (OBSERVED, {"least_trials": 20}),
    (NETWORK, {"hidden": (24, 16), "passes": 20, "batch": 256, "least_passes": 4}),
)
"""Of a diagnosis of few simulations: the native core makes a hundred a second."""


@contextmanager
def few_effects(*names: str) -> Iterator[None]:
    """Some of the registered effects alone: excluded ones too are simulated."""
    known = library()
    with pytest.MonkeyPatch.context() as patch:
        few = {name: known[name] for name in names}
        patch.setattr("vsr2.ensemble.simulated.hypotheses.known_effects", lambda: few)
        yield


@contextmanager
def few_simulations() -> Iterator[None]:
    """Diagnoses of a thousand simulations; too few to find anything but what is plain to see."""
    kept = [{name: getattr(one, name) for name in changes} for one, changes in SMALL]
    try:
        for one, changes in SMALL:
            _set(one, changes)
        yield
    finally:
        for (one, _), before in zip(SMALL, kept, strict=True):
            _set(one, before)


def _set(constants, values):
    """Constants are frozen, and known to many modules as one object."""
    for name, value in values.items():
        object.__setattr__(constants, name, value)


def campaigns_of(sets, nuisances=None, trials=1):
    """Campaigns of which only what acts in them matters."""
    blank = np.zeros((len(sets), trials))
    drawn = np.zeros((len(sets), 1)) if nuisances is None else nuisances
    return Campaigns(tuple(sets), drawn, blank, blank, None)
