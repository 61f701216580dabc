"""Effects put into trials."""

from __future__ import annotations

import warnings
import zlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vsr2.effects.effect import Circumstances, Effect
from vsr2.effects.parameter import EffectWarning
from vsr2.effects.registry import chosen
from vsr2.errors import ConfigError, SimulationError, Vsr2Error
from vsr2.trial import Applied, Trial

_BEFORE_MOTION = ("geometry", "order", "inertia", "contact", "mechanism")
"""Stages whose hooks see no motion, so that trials under any motion share what they make."""


def apply_effects(
    trials: Sequence[Trial],
    effects: Mapping[str, Mapping[str, float | str]],
    *,
    relative_order: Sequence[float] | None = None,
    sessions: Sequence[str] | None = None,
    seed: int = 0,
) -> list[Trial]:
    """The trials with effects in them.

    Several effects are applied in the order of their stages (geometry, order, inertia, contact,
    mechanism, actuation, start, outcome), then by rank and name (`vsr2 effects list` prints them
    so). Trials whose effects are null in them come back as they are.

    Args:
        trials: in order of execution, unless `relative_order` says otherwise. Effects that
            are in them already stay; the same effect twice acts twice.
        effects: names, each with its parameters as in a study; those not given are null.
        relative_order: of the trials in the campaign, 0 first and 1 last; by default as they come.
        sessions: of the trials; by default one.
        seed: of what effects draw. Draws of a trial depend on the seed, the effect's name and the
            trial's index alone: common random numbers.

    Raises:
        ConfigError: an unknown effect or parameter, a value that cannot be used, or lists of
            another length than the trials.
        GeometryError, MotionError, SimulationError: an effect cannot be applied to a trial.
    """
    wanted = chosen(effects)
    changed = with_effects(
        trials, wanted, relative_order=relative_order, sessions=sessions, seed=seed
    )
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
    relative_order: Sequence[float] | None = None,
    sessions: Sequence[str] | None = None,
    seed: int = 0,
    only: Collection[int] | None = None,
) -> list[Trial]:
    """As :func:`apply_effects`, with effects at hand, in order, and complete values, unchecked.

    With `only`, other trials keep their part in order, sessions and draws, and come back as they
    are.
    """
    count = len(trials)
    for label, given in (("relative_order", relative_order), ("sessions", sessions)):
        if given is not None and len(given) != count:
            raise ConfigError(f"{label} has {len(given)} entries for {count} trials")
    order = relative_order
    if order is None:
        order = [i / max(1, count - 1) for i in range(count)]
    beyond = [value for value in order if not 0 <= value <= 1]
    if beyond:
        raise ConfigError(f"relative_order: {beyond[0]:g} is not between 0 (first) and 1 (last)")
    held = ["1"] * count if sessions is None else [str(session) for session in sessions]
    in_time = sorted(range(count), key=lambda i: order[i])
    order_of_sessions = tuple(dict.fromkeys(held[i] for i in in_time))
    made: dict[Any, Trial] = {}
    out = []
    for i, trial in enumerate(trials):
        changed = trial
        for one, values in effects if only is None or i in only else ():
            rng = np.random.default_rng(
                np.random.SeedSequence(seed, spawn_key=(i, zlib.crc32(one.name.encode())))
            )
            here = one.at(values, Circumstances(order[i], held[i], order_of_sessions, rng))
            if not one.is_null(here):
                in_force = {name: float(value) for name, value in here.items()}
                changed = replace(
                    _changed(changed, one, in_force, made),
                    effects=(
                        *changed.effects,
                        Applied(one, tuple(values.items()), tuple(in_force.items())),
                    ),
                )
        out.append(changed)
    return out


def _changed(trial: Trial, one: Effect, values: dict[str, float], made: dict[Any, Trial]) -> Trial:
    """The trial with one effect; what equal trials share is made once and kept in `made`."""
    if one.stage == "outcome":
        return trial
    scene = trial.scene
    # Slope, and mechanisms that are off, matter to effects only, not to the scene's hash.
    seen: tuple[Any, ...] = (
        scene.sha256, scene.pedestal.slope, repr(scene.mechanisms), trial.start_pose,
        trial.outcome, trial.settling,
    )  # fmt: skip
    if one.stage not in _BEFORE_MOTION:
        seen += (trial.motion, trial.drive)
    key = (one, repr(values), seen)
    if key not in made:
        made[key] = _made(trial, one, values)
    found = made[key]
    reused = {name: getattr(found, name) for name in ("scene", "start", "outcome", "settling")}
    if one.stage not in _BEFORE_MOTION:
        reused |= {"motion": found.motion, "drive": found.drive}
    return replace(trial, **reused)


def _made(trial: Trial, one: Effect, values: dict[str, float]) -> Trial:
    try:
        changed = one.change(trial, values)
    except Vsr2Error as error:
        if error.key:
            raise
        raise type(error)(error.message, key=f"effects.{one.name}", fault=error.fault) from error
    if not isinstance(changed, Trial):
        raise SimulationError(
            f"effect {one.name!r}: `change` must return a Trial (returned {type(changed).__name__})"
        )
    return changed
