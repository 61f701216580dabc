"""What the custodian draws: kinds, effects, magnitudes, what the diagnosis may not use."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from vsr2.blind.floor import Floor
from vsr2.blind.settings import Kind, PackSettings
from vsr2.blind.shake import Drawable
from vsr2.errors import BlindError

RELATIVE = (0.5, 6.0)
"""Range of the magnitude over the detection floor, log-uniform."""


@dataclass(frozen=True)
class Drawn:
    """One effect of one campaign.

    Attributes:
        name: canonical.
        values: by parameter.
        strength: name of the parameter that is judged.
        unit: of it.
        null: value of the strength without effect; None: infinity.
        relative: magnitude over the detection floor.
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
        exclude: effects that the diagnosis may not use, a whole class: of the true effect where
            the kind is `unknown`, of a decoy elsewhere.
    """

    index: int
    id: str
    kind: Kind
    engine: str
    protocol: int
    effects: tuple[Drawn, ...] = ()
    exclude: tuple[str, ...] = field(default_factory=tuple)


Floors = Mapping[tuple[str, str, int], Floor]
"""By engine, effect and sign."""
Effects = Mapping[str, Mapping[str, Drawable]]
"""By engine and name."""


def directions(effects: Effects, floors: Floors, engine: str) -> list[tuple[str, int]]:
    """Effects and signs of an engine whose range holds magnitudes to draw.

    Not those that do not reach the floor, nor those that lie beyond 6 floors wherever they act at
    all, as a tether may.
    """
    out = []
    for (on, name, sign), floor in sorted(floors.items()):
        if on == engine and math.isfinite(floor.magnitude):
            weakest = effects[engine][name].strength.reach()[sign][0]
            if weakest <= RELATIVE[1] * floor.magnitude:
                out.append((name, sign))
    return out


def check_hidden(settings: PackSettings, found: int) -> None:
    """Refuse a pack in which what is left out of the library would tell the kind.

    A decoy is of another class than the campaign's own effects, and there must be one for each
    campaign: it takes three classes where there are pairs, else two.

    Args:
        settings: of the pack.
        found: number of classes that may be left out.

    Raises:
        BlindError: they are too few.
    """
    counts = [settings.counts(engine) for engine in settings.engines]
    needed = 3 if any(count["pair"] for count in counts) else 2
    told = any(count["single"] + count["pair"] + count["none"] for count in counts)
    if told and any(settings.asks(engine) for engine in settings.engines) and found < needed:
        raise BlindError(
            f"{found} effect classes may be left out of the library, this pack needs {needed}, or "
            f"`exclude` would tell the kind; raise hidden ({settings.hidden}), allow effects of "
            "more classes, or raise trials so that more of them reach their detection floor"
        )


def draw_plan(
    seed: int,
    settings: PackSettings,
    effects: Effects,
    floors: Floors,
) -> list[Planned]:
    """All campaigns of a pack.

    Effects come from a shuffled list that is dealt again when it is used up, so that each is drawn
    about as often. Magnitudes are log-uniform from 0.5 to 6 times the floor, within the range of
    the strength. Where each effect is left out in turn, so may each class be as a decoy.

    Args:
        seed: of everything.
        settings: of the pack.
        effects: that may be drawn, by engine and name.
        floors: of them.

    Raises:
        BlindError: no effect of an engine can be drawn, a pair needs a second class, or too few
            classes can be left out.
    """
    rng = np.random.default_rng([seed, 301])
    asking = [engine for engine in settings.engines if settings.asks(engine)]
    found = {e: directions(effects, floors, e) for e in asking}
    classes = {e: {settings.class_of(name) for name, _ in found[e]} for e in asking}
    common = sorted(set.intersection(*classes.values())) if classes else []
    hidden = [common[i] for i in rng.permutation(len(common))[: settings.hidden]]
    decks = {}
    for engine in settings.engines:
        mine, left_out = found.get(engine, []), hidden
        if settings.leave_one_out:
            # Once an effect, so that decoys are as often of a class as effects that are left out.
            left_out = [settings.class_of(name) for name in sorted({name for name, _ in mine})]
        decks[engine] = _Deck(rng, engine, settings, mine, left_out)
        check_hidden(settings, len(set(left_out)))
    asked: list[tuple[Kind, str, list[tuple[str, int]]]] = []
    for engine, deck in decks.items():
        for kind, count in settings.counts(engine).items():
            effects_each = {"none": 0, "pair": 2}.get(kind, 1)
            asked += [
                (kind, engine, deck.deal(effects_each, hidden=kind == "unknown"))
                for _ in range(count)
            ]
        for _ in range(settings.leave_one_out):
            asked += [("unknown", engine, [chosen]) for chosen in deck.each()]
    ids = _ids(rng, len(asked))
    places = rng.permutation(len(asked))
    protocols = rng.permutation(np.arange(len(asked)) % settings.protocols)
    out: list[Planned] = []
    for place, (kind, engine, chosen) in zip(places, asked, strict=True):
        drawn = tuple(
            _magnitude(rng, effects[engine][name], sign, floors[engine, name, sign])
            for name, sign in chosen
        )
        names = [name for name, _ in chosen]
        excluded = settings.class_of(names[0]) if kind == "unknown" else decks[engine].decoy(names)
        out.append(
            Planned(
                index=int(place),
                id=ids[place],
                kind=kind,
                engine=engine,
                protocol=int(protocols[place]),
                effects=drawn,
                exclude=tuple(sorted(excluded)),
            )
        )
    return sorted(out, key=lambda planned: planned.index)


def _ids(rng: np.random.Generator, count: int) -> list[str]:
    ids: dict[str, None] = {}
    while len(ids) < count:
        ids["c" + rng.bytes(6).hex()] = None
    return list(ids)


class _Deck:
    """Deals effects evenly, at random."""

    def __init__(
        self,
        rng: np.random.Generator,
        engine: str,
        settings: PackSettings,
        found: Sequence[tuple[str, int]],
        hidden: Sequence[tuple[str, ...]],
    ) -> None:
        self._rng = rng
        self._settings = settings
        self._signs: dict[str, list[int]] = {}
        for name, sign in found:
            self._signs.setdefault(name, []).append(sign)
        needed = 1 + (settings.counts(engine)["pair"] > 0)
        classes = {settings.class_of(name) for name in self._signs}
        if settings.asks(engine) and (len(classes) < needed or not hidden):
            raise BlindError(
                f"engine {engine}: {len(self._signs)} effects can be drawn from 0.5 to 6 times "
                f"their detection floor, too few for this pack; raise trials ({settings.trials}), "
                "or allow more effects"
            )
        self._hidden = list(hidden)
        self._rest: list[str] = []
        self._hidden_rest: list[tuple[str, ...]] = []

    def _next(self, hidden: bool) -> str:
        """An effect; of those that may be left out, a class first and then an effect of it."""
        if hidden:
            if not self._hidden_rest:
                order = self._rng.permutation(len(self._hidden))
                self._hidden_rest = [self._hidden[i] for i in order]
            chosen = self._hidden_rest.pop()
            names = [name for name in sorted(self._signs) if name in chosen]
            return names[int(self._rng.integers(len(names)))]
        if not self._rest:
            names = sorted(self._signs)
            self._rest = [names[i] for i in self._rng.permutation(len(names))]
        return self._rest.pop()

    def deal(self, count: int, *, hidden: bool = False) -> list[tuple[str, int]]:
        """Effects of different classes; `hidden`: of those that may be left out."""
        out: list[tuple[str, int]] = []
        taken: set[tuple[str, ...]] = set()
        while len(out) < count:
            name = self._next(hidden)
            if self._settings.class_of(name) in taken:
                continue
            taken.add(self._settings.class_of(name))
            out.append((name, self._sign(name)))
        return out

    def each(self) -> list[tuple[str, int]]:
        """Every effect once."""
        return [(name, self._sign(name)) for name in sorted(self._signs)]

    def _sign(self, name: str) -> int:
        return self._signs[name][int(self._rng.integers(len(self._signs[name])))]

    def decoy(self, names: list[str]) -> tuple[str, ...]:
        """A class of another effect; drawn whether the campaign has an effect or not."""
        own = {self._settings.class_of(name) for name in names}
        others = [members for members in self._hidden if members not in own]
        return others[int(self._rng.integers(len(others)))] if others else ()


def _magnitude(rng: np.random.Generator, effect: Drawable, sign: int, floor: Floor) -> Drawn:
    low, high = effect.strength.reach()[sign]
    least = max(RELATIVE[0] * floor.magnitude, low)
    most = min(RELATIVE[1] * floor.magnitude, high)
    magnitude = least * (most / least) ** float(rng.random())
    values = effect.values(sign * magnitude, [float(q) for q in rng.random(len(effect.others))])
    return Drawn(
        effect.name,
        {name: float(f"{value:.6g}") for name, value in values.items()},
        effect.strength.name,
        effect.strength.unit,
        effect.strength.null if math.isfinite(effect.strength.null) else None,
        float(f"{magnitude / floor.magnitude:.4g}"),
        effect.drifts,
    )
