"""Effects put into trials."""

from __future__ import annotations

import warnings
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from operator import itemgetter
from typing import TypeAlias

import numpy as np

from vsr2.argument_names import checked_names
from vsr2.config.seeds import checked_seed
from vsr2.effects.effect import Circumstances, Effect, acts_already
from vsr2.effects.hooks import Hook, InForce, changed_by, hooks_of, with_key
from vsr2.effects.parameter import EffectWarning
from vsr2.effects.registry import chosen
from vsr2.errors import ConfigError, Fault, SimulationError
from vsr2.trial import Applied, Trial

Parts: TypeAlias = tuple[Trial, Trial]
"""Trials that have the scene, start and rules of one, and its motion."""
_BEFORE_MOTION = ("geometry", "order", "inertia", "contact", "mechanism")
"""Stages whose hooks see no motion, so that trials under any motion share what they make."""


def sees_motion(one: Effect) -> bool:
    """Whether an effect acts on the motion, or under it, alone.

    Whatever its values, trials share what other effects make of rock, pedestal and contact.
    """
    return not one.parts and one.stage not in _BEFORE_MOTION


class ByTrial(dict[int, Mapping[str, float]]):
    """Complete values of an effect by the trial's index; it does not act in the other trials."""


class Sought(ByTrial):
    """Values that differ from one call to the next, as where a margin is sought."""


Values = Mapping[str, float] | ByTrial
Seed = int | Mapping[int, int]
"""Of what an effect draws: one for all trials, or one for each by its index."""


class MadeEarlier:
    """What effects made of the trials of one scene, for later calls that ask for it again.

    Between calls nothing may differ but the trials that are wanted and values that are sought. What
    was made of scene and start stays; so does what was made of a motion before the first effect
    with such values, for the trials asked for last.

    Args:
        most: trials whose motions are kept.
    """

    def __init__(self, most: int = 0) -> None:
        self._most = most
        self._standing: dict[tuple[object, ...], Parts] = {}
        self._moving: dict[tuple[object, ...], Parts] = {}

    def standing(self, trial: Trial, hook: Hook, values: dict[str, float]) -> Trial:
        """The trial changed; its motion is that of the first that was asked for.

        Trials that hold the same objects are recognised, and stay with them.
        """
        parts = [id(getattr(trial, name)) for name in _ALL_ELSE]
        key = (hook.effect.name, hook.key, *values.items(), *parts)
        if key not in self._standing:
            self._standing[key] = trial, changed_by(trial, hook, values)
        return self._standing[key][1]

    def moving(self, index: int, hooks: Sequence[Hook], change: Callable[[], Parts]) -> Parts:
        """What hooks whose values are those of all calls make of a trial."""
        key = (index, *[hook.key for hook in hooks])
        found = self._moving.pop(key, None) or change()
        if hooks:
            self._moving[key] = found
            if len(self._moving) > self._most:
                del self._moving[next(iter(self._moving))]
        return found


@checked_names(ConfigError)
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
            are in them already stay; the same effect twice acts twice, or is refused where it says
            so (`Effect.once`).
        effects: names, each with its parameters as in a study; those not given are null.
        relative_order: of the trials in the campaign, 0 first and 1 last; by default as they come.
        sessions: of the trials; by default one.
        seed: of what effects draw. Draws of a trial depend on the seed, the effect's name and the
            trial's index alone: common random numbers.

    Raises:
        ConfigError: an unknown effect or parameter, a value or a seed that cannot be used, or
            lists of another length than the trials.
        GeometryError, MotionError, SimulationError: an effect cannot be applied to a trial.
    """
    if isinstance(trials, Trial):
        raise SimulationError("apply_effects: got one Trial; give a list, `[trial]`")
    wanted, seed = chosen(effects), checked_seed(seed, ConfigError)
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
    seed: int | Sequence[Seed] = 0,
) -> list[Trial]:
    """As :func:`apply_effects`, with effects at hand, in order, and complete values, unchecked.

    Args:
        trials: as there.
        effects: in order, with complete values.
        relative_order: as there.
        sessions: as there.
        seed: as there, or of each effect its own.
    """
    made = each_with_effects(
        trials, effects, relative_order=relative_order, sessions=sessions, seed=seed
    )
    return [trial for _, trial in sorted(made, key=itemgetter(0))]


def each_with_effects(
    trials: Sequence[Trial],
    effects: Sequence[tuple[Effect, Values]],
    *,
    relative_order: Sequence[float] | None = None,
    sessions: Sequence[str] | None = None,
    seed: int | Sequence[Seed] = 0,
    only: Collection[int] | None = None,
    made: MadeEarlier | None = None,
) -> Iterator[tuple[int, Trial]]:
    """As :func:`with_effects`, index and trial one after another, those of one motion together.

    What several trials share is made first. What a single one has, above all its motion, is made
    when its turn comes and is not kept, so that memory does not grow with the trials.

    Args:
        trials: of a campaign.
        effects: in order, with complete values, those of all trials or those of each.
        relative_order: as of :func:`apply_effects`.
        sessions: likewise.
        seed: likewise, or of each effect its own.
        only: indices of those that are made; the others have their part in order, sessions and
            draws. None: all.
        made: by earlier calls; None: nothing.
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
    wanted = range(count) if only is None else sorted(only)
    seeds = seed if isinstance(seed, Sequence) else [seed] * len(effects)

    def applied(one: Effect, values: Values, seed: Seed) -> dict[int, Applied]:
        """The effect where it acts, by the trial's index; equal ones are one object."""
        plain = type(one).at is Effect.at
        if plain and not isinstance(values, ByTrial):
            same = _in_force(one, values, values)
            return {} if same is None else dict.fromkeys(wanted, same)
        given = values if isinstance(values, ByTrial) else dict.fromkeys(wanted, values)
        known, found = dict[tuple[object, bytes], Applied](), {}
        for i in (i for i in wanted if i in given):
            here = given[i]
            if not plain:
                rng = _drawing(one, seed, i)
                here = one.at(here, Circumstances(order[i], held[i], order_of_sessions, rng))
            own = _in_force(one, given[i], here)
            if own is not None:
                found[i] = known.setdefault((own.given, own.bits), own)
        return found

    acting = [
        InForce(one, applied(one, values, own), isinstance(values, Sought))
        for (one, values), own in zip(effects, seeds, strict=True)
    ]
    if any(one.once or any(part.once for part in one.parts) for one, *_ in acting):
        for i in wanted:
            _assert_once(trials[i], [where[i] for _, where, _ in acting if i in where])
    yield from _changed(trials, acting, wanted, made or MadeEarlier())


def _drawing(one: Effect, seed: Seed, index: int) -> np.random.Generator:
    """For what an effect draws in the trial of an index."""
    if isinstance(seed, Mapping):
        seed, index = seed[index], 0
    key = (index, zlib.crc32(one.name.encode()))
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def _assert_once(trial: Trial, added: Sequence[Applied]) -> None:
    """Refuse what cannot act twice where it would, by itself or as a part of another effect."""
    there = {one.name for applied in trial.effects for one in _acting_once(applied)}
    for applied in added:
        for one in _acting_once(applied):
            if one.name in there:
                raise SimulationError(
                    acts_already(one),
                    key=f"effects.{applied.effect.name}",
                    fault=Fault.acts_already,
                )
            there.add(one.name)


def _acting_once(applied: Applied) -> list[Effect]:
    one = applied.effect
    return one.acting_once(dict(applied.values)) if isinstance(one, Effect) else []


def _in_force(one: Effect, given: Mapping[str, float], here: Mapping[str, float]) -> Applied | None:
    """The effect with the values of `at`; None where they are null."""
    if one.is_null(here):
        return None
    in_force = tuple((name, float(value)) for name, value in here.items())
    return Applied(one, tuple(given.items()), in_force)


class _Alike:
    """One trial for all that hold the same objects in some fields."""

    def __init__(self, *fields: str) -> None:
        self._fields = fields
        self._known: dict[tuple[int, ...], Trial] = {}

    def of(self, trial: Trial) -> Trial:
        """The first that was asked for; it stays, and with it its objects' identity."""
        return self._known.setdefault(
            tuple([id(getattr(trial, name)) for name in self._fields]), trial
        )


_MOTION = ("motion", "drive")
_ALL_ELSE = ("scene", "start", "outcome", "settling")


def _changed(
    trials: Sequence[Trial],
    effects: Sequence[InForce],
    wanted: Sequence[int],
    made: MadeEarlier,
) -> Iterator[tuple[int, Trial]]:
    """The wanted trials with effects in them; what equal trials share is made once.

    What has a trial's motion, and what has all else, are trials that stand for many. What is made
    of a motion goes with the last trial that has the motion.
    """
    standing, moving = _Alike(*_ALL_ELSE), _Alike(*_MOTION)
    rest = {i: standing.of(trials[i]) for i in wanted}
    moved = {i: moving.of(trials[i]) for i in wanted}
    acting: dict[int, list[Applied]] = {i: [] for i in wanted}
    for _, where, _ in effects:
        for i, applied in where.items():
            acting[i].append(applied)
    hooks = hooks_of(effects)
    for hook in hooks:
        if hook.effect.stage in _BEFORE_MOTION:
            _change_standing(rest, hook, made, standing)
    seeing = [hook for hook in hooks if hook.effect.stage not in _BEFORE_MOTION]
    alike = next((k for k, hook in enumerate(seeing) if hook.sought), 0)
    together: dict[int, list[int]] = {}
    for i in wanted:
        together.setdefault(id(moved[i]), []).append(i)
    each = _Each(rest)
    for members in together.values():
        under = _UnderMotion(each)
        for i in members:
            if not acting[i]:
                yield i, trials[i]
                continue
            change = partial(under.changed, trials[i], index=i, acting=acting[i])
            before = partial(change, rest[i], moved[i], hooks=seeing[:alike])
            parts = change(*made.moving(i, seeing[:alike], before), hooks=seeing[alike:])
            yield i, trials[i].with_parts(*parts, (*trials[i].effects, *acting[i]))


def _change_standing(
    rest: dict[int, Trial], hook: Hook, made: MadeEarlier, standing: _Alike
) -> None:
    """Put what sees no motion into trials, in place; those that hold the same objects are one."""
    known: dict[tuple[int, int], tuple[Trial, Trial]] = {}
    for i, values in hook.values.items():
        before, key = rest[i], (id(rest[i]), id(values))
        if key not in known:
            known[key] = before, standing.of(made.standing(before, hook, values))
        rest[i] = known[key][1]


class _Each:
    """What effects with values of each trial's own make of one scene and start, all at once.

    Args:
        rest: has scene and start of each trial, by its index; of equal ones it is one object.
    """

    def __init__(self, rest: Mapping[int, Trial]) -> None:
        self._rest = rest
        self._members: dict[int, list[int]] = {}
        for i, standing in rest.items():
            self._members.setdefault(id(standing), []).append(i)
        self._known: dict[tuple[int, int], tuple[Trial, dict[int, Trial]]] = {}

    def made(self, hook: Hook, trial: Trial, index: int) -> Trial:
        """A trial changed, its motion aside, which is that of the first trial asked for.

        Args:
            hook: whose effect has a `change_each` of its own.
            trial: of the index.
            index: of the trial.
        """
        group = id(self._rest[index])
        known = self._known.get((id(hook), group))
        if known is None:
            made = self._together(
                hook, trial, [i for i in self._members[group] if i in hook.values]
            )
            self._known[id(hook), group] = trial, made
        elif all(getattr(trial, name) is getattr(known[0], name) for name in _ALL_ELSE):
            made = known[1]
        else:  # Another effect gave each a scene or start of its own.
            made = self._together(hook, trial, [index])
        return made[index]

    @staticmethod
    def _together(hook: Hook, trial: Trial, indices: Sequence[int]) -> dict[int, Trial]:
        values = [hook.values[i] for i in indices]
        changed = with_key(hook, lambda: hook.effect.change_each(trial, values))
        return dict(zip(indices, changed, strict=True))


class _UnderMotion:
    """Trials that had one motion before the effects that see it; equal ones are made once."""

    def __init__(self, each: _Each) -> None:
        self._each = each
        self._standing, self._moving = _Alike(*_ALL_ELSE), _Alike(*_MOTION)
        self._made: dict[tuple[int, ...], tuple[Parts, Parts]] = {}

    def changed(
        self,
        trial: Trial,
        rest: Trial,
        moved: Trial,
        *,
        index: int,
        hooks: Sequence[Hook],
        acting: Sequence[Applied],
    ) -> Parts:
        """Trials that have the scene, start and rules, and the motion, of one with effects in it.

        Args:
            trial: without.
            rest: has its scene, start and rules, with the effects before the hooks.
            moved: has its motion, likewise.
            index: of the trial.
            hooks: that see the motion, in order.
            acting: all effects in the trial.
        """

        def joined() -> Trial:
            return trial.with_parts(rest, moved, (*trial.effects, *acting))

        alone = False
        for hook in hooks:
            values = hook.values.get(index)
            if values is None:
                continue
            if hook.each:
                # Under the motion that it had, which is in memory anyway.
                rest = self._each.made(hook, trial.with_parts(rest, trial, trial.effects), index)
                continue
            alone = alone or hook.holders[id(values)] == 1
            if alone:  # No other trial will ask for it, so it is not kept.
                rest = moved = changed_by(joined(), hook, values)
                continue
            key = id(values), id(rest), id(moved)
            if key not in self._made:
                found = changed_by(joined(), hook, values)
                made = self._standing.of(found), self._moving.of(found)
                self._made[key] = (rest, moved), made  # Both, so that no identity is used again.
            rest, moved = self._made[key][1]
        return rest, moved
