"""`vsr2 effects`: the library of effects, and checks of one's own."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsr2.errors import GeometryError

if TYPE_CHECKING:
    from vsr2.effects import Effect, Parameter
    from vsr2.simulation.effect_checks import EffectReport, Liveness, Rock


def add_verbs(verbs: Any) -> None:
    """Add `effects` with its own verbs."""
    effects = verbs.add_parser(
        "effects",
        help="the library of effects that a simulation may lack",
        description="The library of effects that a simulation may lack "
        "(docs/reference/effects.md). A study adds them with its key `effects`.",
    )
    actions = effects.add_subparsers(dest="action", metavar="ACTION", required=True)

    listed = actions.add_parser("list", help="print all effects in the order of application")
    listed.set_defaults(run=_list)

    show = actions.add_parser("show", help="print one effect with its parameters")
    show.add_argument("name", metavar="NAME", help="of an effect")
    show.set_defaults(run=_show)

    check = actions.add_parser(
        "check",
        help="check effects: neutral, alive, right",
        description="Check effects. Neutral: at the null value a trial is the same to the last "
        "bit, and 1e-8 of the prior beside it responses change by no more than chance "
        "does, unless the effect declares a `jump`. Alive: at the far end of the prior responses "
        "change by more than three times the noise floor, on a block and on a rock "
        "with the hull of a scan. Right: the closed forms of its `verify` are met.",
    )
    check.add_argument(
        "what",
        nargs="*",
        metavar="MODULE|NAME",
        help="a module (path of a .py file, or an importable name) with effects of one's own, or "
        "names of the library; by default all of the library",
    )
    check.add_argument(
        "--mesh",
        type=Path,
        metavar="FILE",
        help="rock that stands for a scan (default: a made one)",
    )
    check.set_defaults(run=_check)


def _list(options: argparse.Namespace) -> int:
    from vsr2.effects import in_order, library
    from vsr2.simulation.effect_checks import EffectChecker

    checker = EffectChecker()
    rows = [("NAME", "STAGE", "FAST", "TOUCHES", "PARAMETERS", "CONFOUNDED WITH")]
    for effect in in_order(library()):
        parameters = "; ".join(
            f"{parameter.name}: {parameter.range_text}"
            for parameter in effect.parameters
            if parameter.prior != "fixed" and not parameter.secondary
        )
        fast = "no" if checker.fast(effect) else "yes"
        rows.append(
            (
                effect.name,
                effect.stage,
                fast,
                ", ".join(effect.channels),
                parameters,
                ", ".join(effect.confounded_with),
            )
        )
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    for row in rows:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        print("  ".join(cells).rstrip())
    return 0


def _show(options: argparse.Namespace) -> int:
    from vsr2.effects import effect
    from vsr2.simulation.effect_checks import EffectChecker

    one = effect(options.name)
    print(f"{one.name}: {one.meaning}.")
    print(f"stage: {one.stage}")
    for parameter in one.parameters:
        unit = "" if parameter.unit == "1" else f" [{parameter.unit}]"
        second = "; has no effect on its own" if parameter.secondary else ""
        print(f"parameter {parameter.name}{unit}: {parameter.meaning}")
        print(f"  prior {parameter.range_text}; none given: {_null(parameter)}{second}")
    print(f"touches: {', '.join(one.channels)}")
    if one.confounded_with:
        print(f"confounded with: {', '.join(one.confounded_with)}")
    if one.source:
        print(f"source: {one.source}")
    violation = EffectChecker().fast(one)
    print(f"engine fast: {'no, ' + violation if violation else 'yes'}")
    return 0


def _null(parameter: Parameter) -> str:
    if math.isnan(parameter.null):
        return "as in the study"
    if parameter.choices:
        return parameter.choices[int(parameter.null)]
    return f"{parameter.null:g}"


def _check(options: argparse.Namespace) -> int:
    from vsr2.simulation.effect_checks import EffectChecker

    if options.mesh is not None and not options.mesh.is_file():
        raise GeometryError(f"{options.mesh}: no such file; correct --mesh")
    effects = _wanted(options.what)
    checker = EffectChecker(options.mesh)
    failed = 0
    for one in effects:
        report = checker.check(one)
        failed += not report.good
        _print(report)
    print(f"{len(effects) - failed} of {len(effects)} effects pass all three checks")
    return 1 if failed else 0


def _wanted(what: list[str]) -> list[Effect]:
    from importlib.util import find_spec

    from vsr2.effects import effect, in_order, library, module_effects

    if not what:
        return in_order(library())
    found: list[Effect] = []
    for name in what:
        module = "." in name or "/" in name or find_spec(name) is not None
        found += module_effects(name) if module and name not in library() else [effect(name)]
    return found


def _ratios(found: Mapping[Rock, Liveness]) -> str:
    return ", ".join(
        f"{one.ratio:.3g} times the floor on the {rock} ({one.feature})"
        for rock, one in found.items()
    )


def _print(report: EffectReport) -> None:
    print(f"{report.effect.name}: {'passes' if report.good else 'FAILS'}")
    neutral = "yes" if report.neutral else "NO: the trajectory differs at the null value"
    print(f"  neutral: {neutral}")
    if report.step:
        told = "yes" if report.is_continuous else "NO: responses jump beside the null value"
        print(f"  continuous: {told}, {_ratios(report.step)}")
    elif report.effect.jump:
        print(f"  continuous: exempt, it declares a jump: {report.effect.jump}")
    else:
        print("  continuous: not told, the null value has no value beside it")
    print(f"  alive: {'yes' if report.is_alive else 'NO'}, {_ratios(report.alive)}")
    if report.right is None:
        print("  right: not told here, VSR2's own tests hold its closed forms")
    elif not report.right:
        print("  right: NO, its `verify` gives no check")
    for check in report.right or ():
        print(
            f"  right: {'yes' if check.good else 'NO'}, {check.what}: {check.measured:.5g}, "
            f"expected {check.expected:.5g} +- {check.tolerance:.2g}"
        )
    print(f"  engine fast: {'no, ' + report.fast if report.fast else 'yes'}")
