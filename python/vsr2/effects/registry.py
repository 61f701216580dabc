"""The library: the effects that come with VSR2 and those of other packages."""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import get_args

from vsr2.config.bounded import near_path
from vsr2.config.load import file_locator
from vsr2.config.problems import Problem, config_error
from vsr2.effects import order, outcome, start
from vsr2.effects.effect import STAGES, Channel, Effect, acts_already, effects_in
from vsr2.effects.parameter import Parameter
from vsr2.effects.static import STATIC
from vsr2.errors import ConfigError
from vsr2.near_words import offer

GROUP = "vsr2.effects"
"""Entry-point group of other packages: each entry names a class derived from `Effect`."""
BUILT_IN: tuple[Effect, ...] = (
    *STATIC,
    *(effect for module in (start, order, outcome) for effect in effects_in(module)),
)
"""A class with a `name` in one of these modules is an effect, and is entered nowhere else."""
_registered: dict[str, Effect] = {}


def library() -> Mapping[str, Effect]:
    """All effects by name: built in, from entry points, registered."""
    return MappingProxyType({effect.name: effect for effect in BUILT_IN} | _found() | _registered)


def effect(name: str) -> Effect:
    """One effect.

    Raises:
        ConfigError: there is none of this name; names the nearest.
    """
    known = library()
    if name not in known:
        remedy = offer(name, list(known))
        if not remedy.endswith("?"):
            remedy += ", and those of a file that --effects names"
        raise ConfigError(f"there is no effect {name!r}; {remedy}", key="effects")
    return known[name]


def register(own: Effect | type[Effect]) -> Effect:
    """Add an effect to the library of this process.

    Raises:
        ConfigError: it lacks an attribute, or its name is taken by another class.
    """
    made = _checked(own, "register")
    present = library().get(made.name)
    if present is not None and type(present).__qualname__ != type(made).__qualname__:
        raise ConfigError(f"effect {made.name!r}: the name is taken; choose another")
    _registered[made.name] = made
    return made


def module_effects(module: str) -> list[Effect]:
    """The effects that a module defines, registered.

    Args:
        module: importable name, or path of a `.py` file.

    Raises:
        ConfigError: it cannot be imported, or defines none.
    """
    loaded = _load(module)
    own = effects_in(loaded)
    if not own:
        raise ConfigError(
            f"{module}: defines no class derived from vsr2.effects.Effect that has a `name`; "
            "write one, or give yours a `name`"
        )
    return [register(found) for found in own]


def chosen(given: Mapping[str, Mapping[str, float | str]]) -> list[tuple[Effect, dict[str, float]]]:
    """Effects with their values as a study writes them, in the order of application.

    Raises:
        ConfigError: an unknown effect or parameter, or a value that cannot be used.
    """
    picked = [(effect(name), values) for name, values in given.items()]
    picked.sort(key=lambda pair: place(pair[0]))
    return [(one, one.accept(values)) for one, values in picked]


def check_study_effects(
    given: Mapping[str, Mapping[str, float | str]], label: str | os.PathLike[str]
) -> None:
    """Refuse effects of a study that :func:`chosen` refuses, all at once and by their lines.

    Args:
        given: `effects` of the study.
        label: its file, or what stands for it.

    Raises:
        ConfigError: lists every problem as `file:line: key.path: what is wrong, remedy`.
    """
    problems, there = [], set[str]()
    for name, values in given.items():
        try:
            one = effect(name)
        except ConfigError as error:
            problems.append(Problem(("effects", name), error.message))
            continue
        found = len(problems)
        for key, value in values.items():
            try:
                one.parameter(key).accept(value, f"effects.{name}.{key}", warn=False)
            except ConfigError as error:
                problems.append(Problem(("effects", name, key), error.message))
        if len(problems) == found:
            try:
                once = [own.name for own in one.acting_once(one.accept(values))]
            except ConfigError as error:
                problems.append(Problem(("effects", name, *list(values)[:1]), error.message))
                continue
            if twice := sorted(there & set(once)):
                problems.append(Problem(("effects", name), acts_already(effect(twice[0]))))
            there |= set(once)
    if problems:
        raise config_error(problems, os.fspath(label), file_locator(label))


def in_order(effects: Mapping[str, Effect]) -> list[Effect]:
    """Effects in the order of application: by stage, rank, name."""
    return sorted(effects.values(), key=place)


def place(one: Effect) -> tuple[int, int, str]:
    """What sorts effects in the order of application: stage, rank, name."""
    return STAGES.index(one.stage), one.rank, one.name


@cache
def _found() -> dict[str, Effect]:
    found: dict[str, Effect] = {}
    built_in = {effect.name for effect in BUILT_IN}
    for entry in entry_points(group=GROUP):
        try:
            own = _checked(entry.load(), f"entry point {entry.value}")
        except ConfigError:
            raise
        # Any code of another package runs here.
        except Exception as error:
            raise ConfigError(
                f"entry point {entry.value} of the group {GROUP}: cannot be loaded "
                f"({type(error).__name__}: {error}); correct or remove the package"
            ) from error
        if own.name in built_in or own.name in found:
            raise ConfigError(
                f"entry point {entry.value}: the name {own.name!r} is taken; choose another"
            )
        found[own.name] = own
    return found


def _checked(own: object, where: str) -> Effect:
    if isinstance(own, type) and issubclass(own, Effect):
        own = own()
    if not isinstance(own, Effect):
        raise ConfigError(f"{where}: {own!r} is no class derived from vsr2.effects.Effect")
    for fault in _faults(own):
        raise ConfigError(f"{where}: {type(own).__name__}: {fault}")
    return own


def _faults(own: Effect) -> Iterator[str]:
    """What keeps an effect out of the library; those after the first may follow from it."""
    for key in ("name", "meaning", "parameters", "stage"):
        if not hasattr(own, key):
            yield f"lacks the attribute `{key}`"
    if not (isinstance(own.name, str) and own.name.isidentifier()):
        yield f"{own.name!r} is no name: letters, digits and _"
    if own.stage not in STAGES:
        yield f"stage {own.stage!r} is not one of {', '.join(STAGES)}"
    for parameter in own.parameters:
        if not isinstance(parameter, Parameter):
            yield f"`parameters` holds {parameter!r}, which is no Parameter"
    names = [parameter.name for parameter in own.parameters]
    if len(set(names)) < len(names):
        yield f"two parameters have the same name: {', '.join(names)}"
    if all(parameter.secondary for parameter in own.parameters):
        yield "needs a parameter that is not secondary"
    for channel in sorted(set(own.channels) - set(get_args(Channel))):
        yield f"{channel!r} is no channel; known are {', '.join(get_args(Channel))}"


def _load(module: str) -> ModuleType:
    path = Path(module)
    if path.suffix != ".py" and (path.exists() or "/" in module):
        raise ConfigError(f"{module}: is no Python file; give a .py file or an importable name")
    try:
        if path.suffix != ".py":
            return importlib.import_module(module)
        spec = importlib.util.spec_from_file_location(f"vsr2_own_{path.stem}", path)
        if spec is None or spec.loader is None or not path.is_file():
            near = near_path(path)
            meant = f"did you mean {near}?" if near else "check the path"
            raise ConfigError(f"{module}: no such file; {meant}")
        loaded = importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = loaded
        spec.loader.exec_module(loaded)
    except ConfigError:
        raise
    except Exception as error:
        raise ConfigError(
            f"{module}: cannot be imported ({type(error).__name__}: {error})"
        ) from error
    return loaded
