"""Effects put into trials."""

from __future__ import annotations

import warnings
import zlib
from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vsr2.effects import Applied, Circumstances, Effect, EffectWarning, Setup, chosen
from vsr2.errors import ConfigError, SimulationError, Vsr2Error
from vsr2.simulation.scene import Scene, make_scene, scene_sha256
from vsr2.simulation.trial import Trial

SCENE_STAGES = ("geometry", "order", "inertia", "contact", "mechanism")
"""Stages whose hooks see neither motion nor outcome, so that trials share what they make."""


def apply_effects(
    trials: Sequence[Trial],
    effects: Mapping[str, Mapping[str, float | str]],
    *,
    orders: Sequence[float] | None = None,
    sessions: Sequence[str] | None = None,
    seed: int = 0,
) -> list[Trial]:
    """The trials with effects in them.

    Several effects are applied in the order of their stages (geometry, order, inertia, contact,
    mechanism, actuation, start, outcome), then by rank and name (`vsr2 effects list` prints them
    so). Trials whose effects are null in them come back as they are. Trials that end up with equal
    scenes share one native scene.

    Args:
        trials: in order of execution, unless `orders` says otherwise. Effects that are in them
            already stay; the same effect twice acts twice.
        effects: names, each with its parameters as in a study; those not given are null.
        orders: of the trials in the campaign, 0 first and 1 last; by default their places.
        sessions: of the trials; by default one.
        seed: of what effects draw. Draws of a trial depend on the seed, the effect's name and the
            trial's place alone: common random numbers.

    Raises:
        ConfigError: an unknown effect or parameter, a value that cannot be used, or lists of
            another length than the trials.
        GeometryError, MotionError, SimulationError: an effect cannot be applied to a trial.
    """
    wanted = chosen(effects)
    changed = with_effects(trials, wanted, orders=orders, sessions=sessions, seed=seed)
    acting = {applied.effect.name for trial in changed for applied in trial.effects}
    for one, values in wanted:
        if one.stage == "order" and not one.is_null(values) and one.name not in acting:
            many = f"none of the {len(trials)} trials" if len(trials) != 1 else "the only trial"
            warnings.warn(
                f"effects.{one.name}: comes in over a campaign and does not act in {many}; give "
                "more motions, or use an effect that acts from the first trial on",
                EffectWarning,
                stacklevel=2,
            )
    return changed


def with_effects(
    trials: Sequence[Trial],
    effects: Sequence[tuple[Effect, Mapping[str, float]]],
    *,
    orders: Sequence[float] | None = None,
    sessions: Sequence[str] | None = None,
    seed: int = 0,
    only: Collection[int] | None = None,
) -> list[Trial]:
    """As :func:`apply_effects`, with effects at hand, in order, and complete values, unchecked.

    With `only`, trials at other places keep their part in order, sessions and draws, and come back
    as they are.
    """
    count = len(trials)
    for label, given in (("orders", orders), ("sessions", sessions)):
        if given is not None and len(given) != count:
            raise ConfigError(f"{label} has {len(given)} entries for {count} trials")
    places = [i / max(1, count - 1) for i in range(count)] if orders is None else list(orders)
    beyond = [place for place in places if not 0 <= place <= 1]
    if beyond:
        raise ConfigError(f"orders: {beyond[0]:g} is not between 0 (first) and 1 (last)")
    held = ["1"] * count if sessions is None else [str(session) for session in sessions]
    by_order = sorted(range(count), key=lambda i: places[i])
    order_of_sessions = tuple(dict.fromkeys(held[i] for i in by_order))
    workshop = _Workshop()
    out = []
    for i, trial in enumerate(trials):
        applied: list[Applied] = []
        if only is not None and i not in only:
            out.append(trial)
            continue
        for one, values in effects:
            rng = np.random.default_rng(
                np.random.SeedSequence(seed, spawn_key=(i, zlib.crc32(one.name.encode())))
            )
            here = one.at(values, Circumstances(places[i], held[i], order_of_sessions, rng))
            if not one.is_null(here):
                applied.append(
                    Applied(
                        one, tuple(values.items()), tuple((k, float(v)) for k, v in here.items())
                    )
                )
        out.append(workshop.trial(trial, applied))
    return out


def setup_of(trial: Trial) -> Setup:
    """What a trial is built from."""
    scene = trial.scene
    return Setup(
        rock=scene.rock,
        pedestal=scene.pedestal,
        engine=scene.engine,
        contact=scene.contact,
        mechanisms=scene.mechanisms,
        motion=trial.motion,
        drive=trial.drive,
        start=trial.start or scene.rock.start,
        outcome=trial.outcome,
        settling=trial.settling,
    )


class _Workshop:
    """Applies effects to trials; makes nothing twice."""

    def __init__(self) -> None:
        # Keys hold ids, so what they are of is kept alive beside them.
        self._changed: dict[Hashable, tuple[Any, Setup]] = {}
        self._scenes: dict[str, Scene] = {}
        self._digests: dict[tuple[int, ...], tuple[Any, str]] = {}

    def trial(self, trial: Trial, applied: Sequence[Applied]) -> Trial:
        if not applied:
            return trial
        before = setup = setup_of(trial)
        for one in applied:
            setup = self._with(setup, one)
        scene = trial.scene
        if _bodies(setup) != _bodies(before):
            scene = self._scene(setup)
        return replace(
            trial,
            scene=scene,
            motion=setup.motion,
            drive=setup.drive,
            start=trial.start if setup.start is before.start else setup.start,
            outcome=setup.outcome,
            settling=setup.settling,
            effects=trial.effects + tuple(applied),
        )

    def _with(self, setup: Setup, one: Applied) -> Setup:
        values = dict(one.values)
        if one.effect.stage == "outcome":
            return setup
        shared: tuple[Any, ...] = (
            *_bodies(setup), setup.mechanisms, setup.start, setup.outcome.model_dump_json(),
            setup.settling.model_dump_json(),
        )  # fmt: skip
        if one.effect.stage not in SCENE_STAGES:
            shared += (id(setup.motion), setup.drive)
        key = (id(one.effect), repr(one.values), repr(shared))
        if key not in self._changed:
            try:
                changed = one.effect.change(setup, values)
            except Vsr2Error as error:
                if "effects." in str(error):
                    raise
                raise type(error)(f"effects.{one.effect.name}: {error}") from error
            if not isinstance(changed, Setup):
                raise SimulationError(
                    f"effect {one.effect.name!r}: `change` must return a Setup (returned "
                    f"{type(changed).__name__})"
                )
            self._changed[key] = (setup, changed)
        made = self._changed[key][1]
        if one.effect.stage in SCENE_STAGES:
            made = replace(made, motion=setup.motion, drive=setup.drive)
        return made

    def _scene(self, setup: Setup) -> Scene:
        key = _bodies(setup)
        if key not in self._digests:
            digest = scene_sha256(
                setup.rock, setup.pedestal, setup.engine, setup.contact, setup.mechanisms
            )
            self._digests[key] = (setup, digest)
        digest = self._digests[key][1]
        if digest not in self._scenes:
            # The start in the body serves figures; trials have their own.
            self._scenes[digest] = make_scene(
                replace(setup.rock, start=setup.start),
                setup.pedestal,
                setup.engine,
                setup.contact,
                setup.mechanisms,
            )
        return self._scenes[digest]


def _bodies(setup: Setup) -> tuple[int, ...]:
    return (
        id(setup.rock),
        id(setup.pedestal),
        id(setup.engine),
        id(setup.contact),
        hash(repr(setup.mechanisms)),
    )
