"""The forms of `pack.json` and of the key, as docs/reference/blind.md has them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import StrEnum
from pathlib import PurePosixPath
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field, InstanceOf, model_validator

from vsr2.blind.form.effect_names import (
    EffectNames,
    NamedEffect,
    check_complete,
    check_strength,
)
from vsr2.blind.form.pack_settings import Kind, Tolerances
from vsr2.blind.form.reader import (
    Count,
    Name,
    Part,
    Probability,
    Sha256,
    check_count,
    misfit,
)
from vsr2.blind.form.uncertainties import check_tolerances
from vsr2.campaign import TIERS, Tier
from vsr2.campaign.faults import id_fault
from vsr2.effects import library
from vsr2.ensemble import Hypotheses, Nuisance
from vsr2.ensemble.simulated.distributions import Distribution, distribution, stated
from vsr2.ensemble.simulated.library import NONE, UNKNOWN
from vsr2.ensemble.simulated.nuisances import with_stated
from vsr2.errors import ConfigError, DiagnosisError

ANSWERS = (NONE, UNKNOWN)
"""Answers that no effect may be called."""
_EFFECTS: Mapping[Kind, tuple[int, float]] = {
    Kind.NONE: (0, 0),
    Kind.SINGLE: (1, 1),
    Kind.PAIR: (2, 2),
    Kind.UNKNOWN: (1, float("inf")),
    Kind.REFERENCE: (0, float("inf")),
}
"""Least and greatest number of effects by kind."""


class EffectAxis(StrEnum):
    """Along what an effect acts."""

    CONDITIONS = "conditions"
    ORDER = "order"
    NONE = "none"


def tiers_made(series_interval: float) -> list[Tier]:
    """Tiers of a pack: all, or without series (interval 0) all but the last."""
    return list(TIERS if series_interval else TIERS[:-1])


def _in_folder(name: str) -> str:
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts:
        raise ValueError("it should be the name of a file in the data folder")
    return name


def _identifier(name: object) -> object:
    fault = id_fault(name)
    if fault is not None:
        raise ValueError(fault)
    return name


def _each_once(tiers: list[Tier]) -> list[Tier]:
    if len(set(tiers)) < len(tiers):
        raise ValueError("each tier should stand once")
    return sorted(tiers)


def _distinct(classes: tuple[tuple[str, ...], ...]) -> tuple[tuple[str, ...], ...]:
    names = [name for members in classes for name in members]
    if len(set(names)) < len(names) or set(map(str.casefold, names)) & set(ANSWERS):
        raise ValueError("each name should stand once, none and unknown in no class")
    return tuple(sorted(tuple(sorted(members)) for members in classes))


Tiers = Annotated[list[Tier], Field(min_length=1), AfterValidator(_each_once)]
Classes = Annotated[
    tuple[Annotated[EffectNames, Field(min_length=1)], ...],
    Field(strict=False),
    AfterValidator(_distinct),
]


def _as(read: Callable[[Mapping[str, Any]], object]) -> BeforeValidator:
    """What one of the diagnosis' own readers makes of a mapping."""

    def made(content: object) -> object:
        if not isinstance(content, Mapping):
            raise ValueError("it should be a mapping")
        try:
            return read(content)
        except (DiagnosisError, ConfigError) as error:
            raise ValueError(str(error)) from None

    return BeforeValidator(made)


def _offered(priors: dict[str, Distribution]) -> dict[str, Distribution]:
    for key, prior in priors.items():
        name, _, parameter = key.partition(".")
        if not parameter:
            names = [one.name for one in known.parameters] if (known := library().get(name)) else []
            some = f"such as {name}.{names[0]}" if names else "such as friction.factor"
            raise misfit(key, stated(prior), f"its key should be effect.parameter, {some}")
        try:
            _ = Hypotheses(priors={key: prior}).offered
        except (DiagnosisError, ConfigError) as error:
            raise misfit(key, stated(prior), error.message) from None
    return priors


def _together(nuisances: tuple[Nuisance, ...]) -> tuple[Nuisance, ...]:
    try:
        Hypotheses(nuisances=with_stated(nuisances))
    except DiagnosisError as error:
        raise ValueError(str(error)) from None
    return nuisances


Nuisances = Annotated[
    tuple[Annotated[InstanceOf[Nuisance], _as(Nuisance.from_json)], ...], AfterValidator(_together)
]
Priors = Annotated[
    dict[str, Annotated[Any, _as(distribution)]],
    AfterValidator(_offered),
]
Published = Annotated[Tolerances, AfterValidator(check_tolerances)]


class Listed(Part):
    """A campaign of a `pack.json`."""

    id: Annotated[str, BeforeValidator(_identifier)]
    protocol: Count = 0
    exclude: EffectNames = ()
    kind: Literal["reference"] | None = None
    effects: tuple[NamedEffect, ...] = Field((), strict=False)

    @model_validator(mode="after")
    def _check_open(self) -> Listed:
        if self.effects and self.kind is None:
            raise misfit("effects", [e.name for e in self.effects], "only references are open")
        return self


class _Commitment(Part):
    sha256: Sha256


class Pack(Part):
    """Content of a `pack.json`."""

    development: bool = False
    scene: Annotated[Name, AfterValidator(_in_folder)]
    tiers: Tiers
    classes: Classes = ()
    tolerances: Published | None = None
    nuisances: Nuisances = Field((), strict=False)
    priors: Priors = Field(default_factory=dict)
    campaigns: Annotated[list[Listed], Field(min_length=1)]
    commitment: _Commitment

    @model_validator(mode="after")
    def _check_ids(self) -> Pack:
        ids = [campaign.id for campaign in self.campaigns]
        twice = next((name for i, name in enumerate(ids) if name in ids[:i]), None)
        if twice is not None:
            raise misfit(f"campaigns: id {twice}", ids, "give each id once")
        return self

    @model_validator(mode="after")
    def _check_exclude(self) -> Pack:
        for i, campaign in enumerate(self.campaigns):
            check_complete(f"campaigns[{i}].exclude", campaign.exclude, self.classes)
        return self


class _Effect(NamedEffect):
    nullable: ClassVar[frozenset[str]] = frozenset({"null"})
    strength: Name
    null: float | None
    relative: Annotated[float, Field(gt=0)] | None = None

    @model_validator(mode="after")
    def _check_strength(self) -> _Effect:
        if self.name.casefold() in ANSWERS:
            raise misfit("name", self.name, "it is a verdict; give that of an effect")
        if self.strength not in self.values:
            raise misfit(f"values.{self.strength}", None, "give the strength's value")
        value = self.values[self.strength]
        if value == self.null:
            raise misfit(f"values.{self.strength}", value, "that is the value without effect")
        if self.known is not None:
            check_strength(self.known, self.strength, self.null)
        return self


class _Where(Part):
    axis: EffectAxis = Field(strict=False)
    weights: list[Annotated[float, Field(ge=0)]]


class Entry(Part):
    """A campaign of a key."""

    kind: Kind = Field(strict=False)
    engine: Name
    protocol: Count = 0
    exclude: EffectNames = ()
    data_sha256: Sha256
    effects: tuple[_Effect, ...] = Field((), strict=False)
    flips: Probability | None = None
    where: _Where

    @property
    def names(self) -> list[str]:
        """Of the effects."""
        return [effect.name for effect in self.effects]

    @model_validator(mode="after")
    def _check_kind(self) -> Entry:
        check_count(self.names, self.kind, _EFFECTS[self.kind])
        if (self.where.axis is EffectAxis.NONE) == bool(self.effects):
            wanted = "it should be none where the kind is none, and only where nothing acts"
            raise misfit("where.axis", str(self.where.axis), wanted)
        for name in self.names:
            if name in self.exclude and self.kind is not Kind.UNKNOWN:
                wanted = f"it should not hold {name}, the effect of this campaign"
                raise misfit("exclude", self.exclude, wanted)
            if name not in self.exclude and self.kind is Kind.UNKNOWN and name in library():
                wanted = f"it should hold {name}, as the kind is unknown"
                raise misfit("exclude", self.exclude, wanted)
        return self


class _Sealed(Part):
    development: bool = False
    classes: Classes
    tiers: Tiers | None = None
    series_interval: float | None = None
    tolerances: Published | None = None
    nuisances: Nuisances | None = Field(None, strict=False)
    priors: Priors | None = None

    @property
    def sealed_tiers(self) -> list[Tier] | None:
        """As stated, or as packs of `vsr2 blind make` seal them: by the series' interval."""
        if self.tiers is None and self.series_interval is not None:
            return tiers_made(self.series_interval)
        return self.tiers


class Key(Part):
    """The `key` of a `key.json`: values, and that they make sense together."""

    settings: _Sealed
    campaigns: dict[str, Entry]
    scene_sha256: Sha256 | None = None
    model_sha256: Sha256 | None = None
    motions_sha256: dict[str, Sha256] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check_classes(self) -> Key:
        classes = self.settings.classes
        for name, entry in self.campaigns.items():
            here = f"campaigns.{name}"
            check_complete(f"{here}.exclude", entry.exclude, classes)
            one = any(set(entry.names) <= set(members) for members in classes)
            if entry.kind is Kind.PAIR and (one or len(set(entry.names)) < 2):
                wanted = "it should be two effects of different classes"
                raise misfit(f"{here}.effects", entry.names, wanted)
        return self
