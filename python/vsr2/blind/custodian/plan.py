"""What the custodian draws: kinds, effects, magnitudes, what the diagnosis may not use."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vsr2.blind.custodian.detection_limit import RULES
from vsr2.blind.custodian.pack_streams import PackStream, pack_generator
from vsr2.blind.form.pack_settings import Kind, PackSettings
from vsr2.blind.mujoco import Drawable
from vsr2.effects import library
from vsr2.errors import BlindError
from vsr2.one_line import counted
from vsr2.posterior.sets import with_alike


@dataclass(frozen=True)
class Drawn:
    """One effect of one campaign.

    Attributes:
        name: canonical.
        values: by parameter.
        strength: name of the parameter that is judged.
        unit: of it.
        null: value of the strength without effect; None: infinity.
        relative: signal over noise as measured at these values, over that at the detection limit.
        drifts: whether it changes over the campaign.
    """

    name: str
    values: dict[str, float]
    strength: str
    unit: str
    null: float | None
    relative: float
    drifts: bool


@dataclass(frozen=True)
class Planned:
    """One campaign.

    Attributes:
        index: from which all its draws are seeded.
        id: random; says nothing.
        kind, engine: drawn.
        protocol: by number.
        effects: none, one or two.
        exclude: effects that the diagnosis may not use (:func:`left_out_with`): for the class of
            the true effect where the kind is `unknown`, for that of a decoy elsewhere.
    """

    index: int
    id: str
    kind: Kind
    engine: str
    protocol: int
    effects: tuple[Drawn, ...] = ()
    exclude: tuple[str, ...] = ()


@dataclass(frozen=True)
class Plan:
    """All campaigns of a pack.

    Attributes:
        campaigns: in the order in which they are simulated.
        refused: by engine and effect, for how many campaigns no draw of it was measured in
            the window, so that they got another.
    """

    campaigns: tuple[Planned, ...]
    refused: Mapping[str, Mapping[str, int]]


Measure = Callable[[str, int, Drawable, Mapping[str, float]], float]
"""Of an engine, the number of a protocol, an effect and the values of all its parameters: signal
over noise over that at the detection limit. The same for the same arguments."""
Limits = Mapping[tuple[str, str, int], float]
"""Detection limits by engine, effect and sign; infinity: there is none."""
Effects = Mapping[str, Mapping[str, Drawable]]
"""By engine and name."""


def directions(effects: Effects, limits: Limits, engine: str) -> list[tuple[str, int]]:
    """Effects and signs of an engine whose range holds magnitudes to draw.

    Not those that do not reach the detection limit, nor those that lie beyond 6 of it wherever they
    act at all, as a tether may, or bumps that are felt however low they are.
    """
    return [
        (name, sign)
        for (on, name, sign), limit in sorted(limits.items())
        if on == engine
        and math.isfinite(limit)
        and effects[engine][name].strength.reach()[sign][0] <= RULES.window[1] * limit
    ]


def not_drawn(effects: Effects, limits: Limits, engine: str) -> list[str]:
    """What of an engine cannot be drawn: effects, or which side of their null."""
    found = directions(effects, limits, engine)
    out = []
    for name, effect in sorted(effects[engine].items()):
        sides = sorted(effect.strength.reach())
        lacking = [sign for sign in sides if (name, sign) not in found]
        if lacking == sides:
            out.append(name)
        else:
            null = f"{effect.strength.null:g}"
            out += [f"{name} {'above' if sign > 0 else 'below'} {null}" for sign in lacking]
    return out


def left_out_with(members: Sequence[str], settings: PackSettings) -> tuple[str, ...]:
    """All that is left out for a class: it, and what the library declares alike to an effect of it.

    What nobody can tell from a cause is as unknown as the cause. Classes are complete.

    Args:
        members: of the class.
        settings: of the pack.
    """
    alike = with_alike(members, library())
    return tuple(sorted({name for one in alike for name in settings.class_of(one)}))


def apart(classes: Iterable[tuple[str, ...]], settings: PackSettings) -> list[tuple[str, ...]]:
    """Classes, in their order, for which no effect is left out that is left out for one before.

    An effect is left out for one of them at most. So of three one is left that can be left out of a
    campaign with two effects, of two one for a campaign with one.

    Args:
        classes: that might be left out.
        settings: of the pack.
    """
    out: list[tuple[str, ...]] = []
    taken: set[str] = set()
    for members in classes:
        own = set(left_out_with(members, settings))
        if not own & taken:
            out.append(members)
            taken |= own
    return out


def check_hidden(settings: PackSettings, found: int) -> None:
    """Refuse a pack in which what is left out of the library would tell the kind.

    A decoy leaves out no effect of the campaign's own, and there must be one for each campaign: it
    takes three classes (:func:`apart`) where there are pairs, else two.

    Args:
        settings: of the pack.
        found: number of classes that may be left out.

    Raises:
        BlindError: they are too few.
    """
    counts = [settings.counts(engine) for engine in settings.engines]
    needed = 3 if any(count[Kind.PAIR] for count in counts) else 2
    open_or_own = (Kind.UNKNOWN, Kind.REFERENCE)
    decoys = any(n for count in counts for kind, n in count.items() if kind not in open_or_own)
    if decoys and any(settings.asks(engine) for engine in settings.engines) and found < needed:
        raise BlindError(
            f"{found} effect classes may be left out of the library, each with all that is "
            f"declared alike to it and none with another; this pack needs {needed}, or `exclude` "
            f"would tell the kind; raise hidden ({settings.hidden}), allow effects of more "
            "classes, or raise trials so that more of them reach their detection limit"
        )


def draw_plan(
    seed: int, settings: PackSettings, effects: Effects, limits: Limits, measure: Measure
) -> Plan:
    """All campaigns of a pack.

    Effects come from a shuffled list that is dealt again when it is used up, so that each is drawn
    about as often. Magnitudes are proposed log-uniform from 0.5 to 6 times the detection limit,
    within the range of the strength; what is kept is measured within these bounds at all its
    values, on the campaign's own protocol. What is not in eight draws gives way to the list's
    next effect; where each effect is left out in turn, its campaign is not made. Decoys are dealt
    to classes in proportion to `unknown` campaigns, so that how often a class is left out does not
    tell the kind.

    Args:
        seed: of everything.
        settings: of the pack.
        effects: that may be drawn, by engine and name.
        limits: detection limits of them.
        measure: the signal of a draw.

    Raises:
        BlindError: no effect of an engine can be drawn, a pair needs a second class, or too few
            classes can be left out.
    """
    rng = pack_generator(seed, PackStream.PLAN)
    found = {e: directions(effects, limits, e) for e in settings.engines if settings.asks(e)}
    classes = [{settings.class_of(name) for name, _ in of} for of in found.values()]
    common = sorted(set.intersection(*classes)) if classes else []
    shuffled = [common[i] for i in rng.permutation(len(common))]
    hidden = apart(shuffled, settings)[: settings.hidden]
    decks = {}
    for engine in settings.engines:
        mine, left_out = found.get(engine, []), hidden
        if settings.leave_one_out:
            # Once an effect, so that decoys are as often of a class as effects that are left out.
            left_out = [settings.class_of(name) for name in sorted({name for name, _ in mine})]
        near = {(name, sign): limits[engine, name, sign] for name, sign in mine}
        known = effects.get(engine, {})
        decks[engine] = _Deck(rng, engine, settings, known, near, left_out, measure)
        check_hidden(settings, len(set(left_out)))
    asked: list[tuple[Kind, _Deck, str | None]] = []
    for engine, deck in decks.items():
        for kind, count in settings.counts(engine).items():
            asked += [(kind, deck, None)] * count
        for _ in range(settings.leave_one_out):
            asked += [(Kind.UNKNOWN, deck, name) for name in deck.names]
    protocols = rng.permutation(np.arange(len(asked)) % settings.protocols)
    made: list[Planned] = []
    for (kind, deck, only), protocol in zip(asked, map(int, protocols), strict=True):
        drawn = deck.campaign(kind, protocol, only)
        if drawn is not None:
            made.append(Planned(-1, "", kind, deck.engine, protocol, drawn))
    excluded = _left_out(rng, settings, made, {e: deck.hidden for e, deck in decks.items()})
    ids: dict[str, None] = {}
    while len(ids) < len(made):
        ids["c" + rng.bytes(6).hex()] = None
    indices = rng.permutation(len(made)).tolist()
    campaigns = [
        replace(planned, index=index, id=list(ids)[index], exclude=names)
        for index, planned, names in zip(indices, made, excluded, strict=True)
    ]
    campaigns.sort(key=lambda planned: planned.index)
    refused = {engine: dict(deck.refused) for engine, deck in decks.items() if deck.refused}
    return Plan(tuple(campaigns), refused)


def _left_out(
    rng: np.random.Generator,
    settings: PackSettings,
    made: Sequence[Planned],
    hidden: Mapping[str, Sequence[tuple[str, ...]]],
) -> list[tuple[str, ...]]:
    """What each campaign's diagnosis may not use; () where nothing is hidden.

    Decoys are dealt so that of each class about the same share is left out of campaigns whose
    effect is of it: who counts how often a class is left out learns nothing of the kind. Without
    `unknown` campaigns all classes are dealt evenly.

    Raises:
        BlindError: there is no decoy for a campaign.
    """
    own = [{settings.class_of(effect.name) for effect in planned.effects} for planned in made]
    unknown = [i for i, planned in enumerate(made) if planned.kind is Kind.UNKNOWN]
    # The kind of a reference is open.
    references = {i for i, planned in enumerate(made) if planned.kind is Kind.REFERENCE}
    others = sorted(set(range(len(made))) - set(unknown) - references, key=lambda i: -len(own[i]))
    counts = Counter(next(iter(own[i])) for i in unknown)
    if not unknown:
        counts = Counter(members for classes in hidden.values() for members in set(classes))
    if unknown and len(counts) == 1 and any(own[i] for i in others):
        (members,) = counts
        raise BlindError(
            f"all unknown effects that could be drawn are of the class {' = '.join(members)}, so "
            "that one that lacks another would have an effect of it; raise unknown, allow effects "
            "of more classes, or take another seed"
        )
    rest = {members: count * len(others) / counts.total() for members, count in counts.items()}
    out = [next(iter(own[i])) if i in unknown else () for i in range(len(made))]
    for i in others:
        acting = {effect.name for effect in made[i].effects}
        classes = sorted(set(hidden[made[i].engine]))
        allowed = [one for one in classes if not acting & set(left_out_with(one, settings))]
        if classes and not allowed:
            raise BlindError(
                f"for a campaign with {' and '.join(sorted(acting))} nothing can be left out of "
                "the library but what is declared alike to it; allow effects of more classes, or "
                "take another seed"
            )
        if allowed:
            left = np.array([max(rest.get(members, 0.0), 0.0) for members in allowed])
            share = left / left.sum() if left.sum() > 0 else np.full(len(left), 1 / len(left))
            out[i] = allowed[int(rng.choice(len(allowed), p=share))]
            rest[out[i]] = rest.get(out[i], 0.0) - 1
    return [left_out_with(members, settings) for members in out]


class _Deck:
    """Deals effects of one engine evenly, at random, and draws their values.

    Args:
        rng: of the plan.
        engine: whose effects they are.
        settings: of the pack.
        effects: of the engine.
        limits: detection limits by effect and sign, of those that can be drawn.
        hidden: classes that may be left out of the library.
        measure: the signal of a draw.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        engine: str,
        settings: PackSettings,
        effects: Mapping[str, Drawable],
        limits: Mapping[tuple[str, int], float],
        hidden: Sequence[tuple[str, ...]],
        measure: Measure,
    ) -> None:
        self._rng = rng
        self._class_of = settings.class_of
        self._effects = effects
        self._limits = limits
        self._measure = measure
        self.engine = engine
        self.hidden = hidden
        self.names = sorted({name for name, _ in limits})
        self.refused: Counter[str] = Counter()
        self._rest: dict[bool, list[tuple[str, ...]]] = {False: [], True: []}
        needed = 1 + (settings.counts(engine)[Kind.PAIR] > 0)
        classes = {settings.class_of(name) for name in self.names}
        if settings.asks(engine) and (len(classes) < needed or not hidden):
            raise BlindError(
                f"engine {engine}: {counted(len(self.names), 'effect')} can be drawn from 0.5 to 6 "
                "times their detection limit, too few for this pack; raise trials "
                f"({settings.trials}), or allow more effects"
            )

    def campaign(self, kind: Kind, protocol: int, only: str | None) -> tuple[Drawn, ...] | None:
        """Effects of different classes for a campaign, as they come from the deck.

        `only`: the one effect that it may have; None where no draw of it was in the window.
        """
        if only is not None:
            one = self._draw(only, protocol)
            return None if one is None else (one,)
        out: list[Drawn] = []
        passed: set[str] = set()
        while len(out) < {Kind.NONE: 0, Kind.REFERENCE: 0, Kind.PAIR: 2}.get(kind, 1):
            name = self._deal(passed, hidden=kind is Kind.UNKNOWN)
            one = self._draw(name, protocol)
            if one is None:
                passed.add(name)
            else:
                out.append(one)
                passed.update(self._class_of(name))
        return tuple(out)

    def _deal(self, passed: Collection[str], *, hidden: bool) -> str:
        """The next effect that is not passed over.

        Of those that may be left out (`hidden`) a class first, and then an effect of it.
        """
        groups = self.hidden if hidden else [(name,) for name in self.names]
        if not {name for group in groups for name in group if name in self.names} - set(passed):
            raise BlindError(
                f"engine {self.engine}: of no effect that may still be drawn for a campaign were "
                "values measured from 0.5 to 6 times their detection limit in "
                f"{RULES.attempts} draws; raise trials, or allow more effects"
            )
        rest = self._rest[hidden]
        while True:
            if not rest:
                rest += [groups[i] for i in self._rng.permutation(len(groups))]
            chosen = rest.pop()
            found = [name for name in self.names if name in chosen and name not in passed]
            if found:
                return found[int(self._rng.integers(len(found)))] if hidden else found[0]

    def _draw(self, name: str, protocol: int) -> Drawn | None:
        """Values of an effect; None: no draw of it was measured in the window.

        What a draw outside was measured at moves the limit that the next ones start from.
        """
        effect, strength = self._effects[name], self._effects[name].strength
        signs = [sign for one, sign in self._limits if one == name]
        sign = signs[int(self._rng.integers(len(signs)))]
        low, high = strength.reach()[sign]
        limit = self._limits[name, sign]
        for _ in range(RULES.attempts):
            least = min(max(RULES.window[0] * limit, low), high)
            most = max(min(RULES.window[1] * limit, high), least)
            magnitude = least * (most / least) ** float(self._rng.random())
            others = [float(q) for q in self._rng.random(len(effect.others))]
            values = {
                key: float(f"{value:.6g}")
                for key, value in effect.values(sign * magnitude, others).items()
            }
            relative = float(f"{self._measure(self.engine, protocol, effect, values):.4g}")
            if RULES.window[0] <= relative <= RULES.window[1]:
                null = strength.null if math.isfinite(strength.null) else None
                return Drawn(
                    name, values, strength.name, strength.unit, null, relative, effect.drifts
                )
            there = magnitude / relative if relative > 0 else math.inf
            limit = min(max(there, limit / RULES.step), limit * RULES.step)
        self.refused[name] += 1
        return None
