"""A result states every chosen number that it rests on: those of all modules it imports."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "python" / "vsr2"
KINDS = ("Constants", "Rules")
"""Ends of the names of dataclasses that hold chosen numbers."""
RESULTS = {
    "a batch": ("simulation.batch", "simulation.run_constants.run_constants"),
    "a diagnosis": ("diagnosis.api", "diagnosis.diagnosis_constants.diagnosis_constants"),
    "a check of a posterior": (
        "coverage.posterior_check",
        "coverage.posterior_check.check_constants",
    ),
    "a comparison with a reference": (
        "ensemble.reference_campaign",
        "ensemble.reference_campaign.reference_constants",
    ),
    "a prediction": ("prediction.prediction", "prediction.prediction.prediction_constants"),
    "causes": ("causes.causes", "causes.causes.causes_constants"),
    "an iteration": ("diagnosis.iteration", "diagnosis.diagnosis_constants.diagnosis_constants"),
    "a calibration": ("calibration.calibrate", "calibration.calibrate.calibration_constants"),
    "a fragility study": ("fragility.run", "fragility.run.fragility_constants"),
    "a comparison of time steps": (
        "analysis.time_steps",
        "analysis.time_steps.time_step_constants",
    ),
    "a report of stability": ("scene.stability", "scene.stability.stability_constants"),
    "a simulated campaign": ("campaign.simulate", "simulation.run_constants.run_constants"),
}
"""Module that makes each kind of result, and the function that gathers its constants."""
NO_RESULT_RESTS_ON = {
    "simulation.distributed.CLUSTER": "how trials are dealt to a cluster",
    "simulation.native_trials.QUEUE": "how many trials wait for threads",
}
"""Of modules that results import, what may be left out."""
STATED_ELSEWHERE = {
    "analysis.tracking.TRACKING": "a figure, and `vsr2.analysis.tracking` returns what it used",
    "hazard.overturning_rate.RATE": "`vsr2 hazard --json` prints how the rates were drawn",
    "report.diagnosis_figures.FIGURES": "a figure",
    "simulation.bench.BENCH": "a machine's speed",
    "simulation.effect_checks.CHECK": "whether an effect is sound; the report prints them",
}
"""Of modules that no result with a provenance imports."""
BLIND = ("blind.custodian", "blind.mujoco", "blind.scoring")
"""Rooms whose constants a pack's key and its scores state; tests of packs compare them."""


def file_of(module: str) -> Path:
    path = PACKAGE.parent.joinpath(*module.split("."))
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


@cache
def imported(module: str) -> frozenset[str]:
    """Modules of the package that a module imports, in functions too; names that a room exports
    stand for the modules that define them."""
    tree = ast.parse(file_of(module).read_text())
    typing = {
        id(child)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for child in ast.walk(node)
    }
    out = set()
    for node in ast.walk(tree):
        if id(node) in typing or not isinstance(node, ast.ImportFrom) or node.module is None:
            continue
        if not node.module.startswith("vsr2.") or not file_of(node.module).exists():
            continue  # another package, or the native module
        out.add(node.module)
        for alias in node.names:
            defined = getattr(getattr(import_module(node.module), alias.name), "__module__", "")
            if isinstance(defined, str) and defined.startswith("vsr2."):
                out.add(defined)
    # An `__init__` imports what nobody may have asked for.
    return frozenset(one for one in out if file_of(one).exists())


def imports_of(module: str) -> set[str]:
    """With what these import in turn."""
    found: set[str] = set()
    waiting = {module}
    while waiting:
        one = waiting.pop()
        found.add(one)
        if file_of(one).name != "__init__.py":
            waiting |= imported(one) - found
    return found


@cache
def constants_of(module: str) -> Mapping[str, Any]:
    """Values at a module's top whose class, defined there, holds chosen numbers."""
    return {
        f"{module.removeprefix('vsr2.')}.{name}": value
        for name, value in vars(import_module(module)).items()
        if type(value).__module__ == module and type(value).__name__.endswith(KINDS)
    }


def modules() -> Iterator[str]:
    for path in sorted(PACKAGE.rglob("*.py")):
        if path.name not in ("__init__.py", "__main__.py"):
            yield ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)


def stated_by(gatherer: str) -> list[dict[str, Any]]:
    module, _, name = gatherer.rpartition(".")
    return list(getattr(import_module(f"vsr2.{module}"), name)().values())


@pytest.mark.parametrize("result", RESULTS)
def test_a_result_states_every_constant_that_it_rests_on(result: str) -> None:
    module, gatherer = RESULTS[result]
    stated = stated_by(gatherer)
    needed = {k: v for one in imports_of(f"vsr2.{module}") for k, v in constants_of(one).items()}
    assert needed
    left_out = [name for name, value in needed.items() if asdict(value) not in stated]
    assert set(left_out) <= set(NO_RESULT_RESTS_ON), result


def test_every_constant_of_the_package_is_stated_somewhere() -> None:
    stated = [one for _, gatherer in RESULTS.values() for one in stated_by(gatherer)]
    left_out = {
        name
        for module in modules()
        for name, value in constants_of(module).items()
        if asdict(value) not in stated and not name.startswith(BLIND)
    }
    assert left_out == set(NO_RESULT_RESTS_ON) | set(STATED_ELSEWHERE)


def test_modules_that_a_function_imports_count() -> None:
    found = imports_of("vsr2.simulation.batch")
    assert "vsr2.effects.standing" in found, "by a room's name for it"
    assert "vsr2.diagnosis.api" not in found


def test_constants_share_no_name() -> None:
    """Neither the name of their value nor that of their class stands for anything else."""
    owners: dict[str, set[str]] = {}
    chosen: set[str] = set()
    for module in modules():
        for node in ast.parse(file_of(module).read_text()).body:
            targets: list[ast.expr] = []
            if isinstance(node, ast.Assign):
                targets = [one for target in node.targets for one in ast.walk(target)]
            names = [one.id for one in targets if isinstance(one, ast.Name)]
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                names = [node.target.id]
            if isinstance(node, ast.ClassDef):
                names = [node.name]
            for name in names:
                owners.setdefault(name, set()).add(module)
        found = constants_of(module)
        chosen |= {name.rpartition(".")[2] for name in found}
        chosen |= {type(value).__name__ for value in found.values()}
    assert {name: owners[name] for name in chosen if len(owners[name]) > 1} == {}
