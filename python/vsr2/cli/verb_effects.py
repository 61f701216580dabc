"""`vsr2 effects`: the library of effects, and checks of one's own."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cyclopts import App

if TYPE_CHECKING:
    from vsr2.effects import Effect

verbs = App(
    name="effects",
    help="The library of effects that a simulation may lack.\n\n"
    "docs/reference/effects.md describes them. A study adds them with its key `effects`.",
)


@verbs.command(name="list")
def list_effects() -> int:
    """Print all effects in the order of application."""
    from vsr2._native import FastRefusal
    from vsr2.effects import in_order, library
    from vsr2.report.messages.commands import table
    from vsr2.simulation.effect_checks import EffectChecker

    checker = EffectChecker()
    rows = [("NAME", "STAGE", "FAST", "TOUCHES", "PARAMETERS", "CONFOUNDED WITH")]
    for effect in in_order(library()):
        parameters = "; ".join(
            f"{parameter.name}: {parameter.range_text}"
            for parameter in effect.parameters
            if parameter.prior != "fixed" and not parameter.secondary
        )
        fast = "yes" if checker.fast_refusal(effect) is FastRefusal.none else "no"
        touches, confounded = ", ".join(effect.channels), ", ".join(effect.confounded_with)
        rows.append((effect.name, effect.stage, fast, touches, parameters, confounded))
    print(table(rows, str.ljust))
    return 0


@verbs.command
def show(name: str, /) -> int:
    """Print one effect with its parameters.

    Args:
        name: of an effect
    """
    from vsr2.effects import effect
    from vsr2.report.messages.commands import effect_text, engine_fast
    from vsr2.simulation.effect_checks import EffectChecker

    one = effect(name)
    print(effect_text(one))
    print(engine_fast(EffectChecker().fast_refusal(one)))
    return 0


@verbs.command
def check(*what: str, mesh: Path | None = None) -> int:
    """Check effects: neutral, continuous, alive, right.

    Neutral: at the null value a trial is the same to the last bit. Continuous: 1e-8 of the prior
    beside it responses change by no more than chance does, unless the effect declares a `jump`.
    Alive: at the far end of the prior responses change by more than three times the noise floor, on
    a block and on a rock with the hull of a scan. Right: the closed forms of its `verify` are met.

    Args:
        what: modules (path of a .py file, or an importable name) with effects of one's own, or
            names of the library (default: all of the library)
        mesh: rock that stands for a scan (default: a made one)
    """
    from vsr2.errors import GeometryError
    from vsr2.report.messages.commands import effect_report, effects_passed
    from vsr2.simulation.effect_checks import EffectChecker

    if mesh is not None and not mesh.is_file():
        raise GeometryError(f"{mesh}: no such file; correct --mesh")
    effects = _wanted(what)
    checker = EffectChecker(mesh)
    failed = 0
    for one in effects:
        report = checker.check(one)
        failed += not report.good
        print(effect_report(report))
    print(effects_passed(len(effects) - failed, len(effects)))
    return 1 if failed else 0


def _wanted(what: tuple[str, ...]) -> list[Effect]:
    from importlib.util import find_spec

    from vsr2.effects import effect, in_order, library, module_effects

    if not what:
        return in_order(library())
    found: list[Effect] = []
    for name in what:
        module = "." in name or "/" in name or find_spec(name) is not None
        found += module_effects(name) if module and name not in library() else [effect(name)]
    return found
