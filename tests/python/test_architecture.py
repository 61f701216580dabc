"""The structure that docs/architecture.md shows: rooms import upstream only, and stay light."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "python" / "vsr2"
PARTED = ("ensemble", "diagnosis", "causes", "blind")
"""Rooms with rooms of their own."""
MODULES = sorted(PACKAGE.rglob("*.py"))
HEAVY = {
    "matplotlib",
    "scipy",
    "trimesh",
    "xarray",
    "viser",
    "pandas",
    "sklearn",
    "statsmodels",
    "optuna",
    "cma",
    "distributed",
    "dask",
    "mujoco",
    "arviz",
}


def order(room: str = "") -> list[set[str]]:
    """Rooms of an arrow line in docs/architecture.md, most upstream first."""
    text = (ROOT / "docs" / "architecture.md").read_text()
    start = f"{room}: " if room else "codes, errors, near_words, one_line, read_only ->"
    line = next(line for line in text.splitlines() if line.startswith(start))
    stages = [re.sub(r"\(.*?\)", "", stage) for stage in line.removeprefix(f"{room}:").split("->")]
    return [{name.strip() for name in stage.split(",")} for stage in stages]


def imports(path: Path) -> Iterator[tuple[str, bool]]:
    """Imported modules of a file, and whether they are imported when the file is."""
    tree = ast.parse(path.read_text())
    inner = {
        id(node)
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef)
        for node in ast.walk(function)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            inner |= {id(child) for child in ast.walk(node)}
    for node in ast.walk(tree):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names = [node.module or ""]
        for name in names:
            yield name, id(node) not in inner


def test_every_room_is_on_the_line() -> None:
    rooms = {p.name for p in PACKAGE.iterdir() if p.is_dir() and p.name != "__pycache__"}
    modules = {p.stem for p in PACKAGE.glob("*.py")} - {"__init__", "__main__"}
    assert rooms | modules == set().union(*order())


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_go_upstream_only(path: Path) -> None:
    stages = order()
    place = {room: i for i, stage in enumerate(stages) for room in stage}
    own = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    if own in ("__init__", "__main__", "py"):
        return
    for name, _ in imports(path):
        parts = name.split(".")
        if parts[0] != "vsr2" or len(parts) < 2 or parts[1] in (own, "_native"):
            continue
        assert place[parts[1]] < place[own], f"{own} imports {name}, which lies downstream"


@pytest.mark.parametrize("room", PARTED)
def test_imports_inside_a_room_go_upstream_only(room: str) -> None:
    stages = order(room)
    folders = {p.name for p in (PACKAGE / room).iterdir() if (p / "__init__.py").exists()}
    assert folders == set().union(*stages)
    place = {name: i for i, stage in enumerate(stages) for name in stage}
    for path in (PACKAGE / room).rglob("*.py"):
        own = path.relative_to(PACKAGE / room).parts[0]
        if own not in place:
            continue
        for name, _ in imports(path):
            parts = name.split(".")
            if parts[:2] != ["vsr2", room] or parts[2] == own:
                continue
            assert parts[2] in place, f"{own} imports {name}, which puts the rooms together"
            assert place[parts[2]] < place[own], f"{own} imports {name}, which lies downstream"


def test_the_blind_diagnosis_knows_neither_custodian_nor_scores() -> None:
    names = [name for name, _ in imports(PACKAGE / "blind" / "pack_diagnoses.py")]
    assert {name.split(".")[2] for name in names if name.startswith("vsr2.blind.")} == {"form"}


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_heavy_packages_are_imported_where_they_are_used(path: Path) -> None:
    for name, at_import in imports(path):
        assert not (at_import and name.split(".")[0] in HEAVY), name


def test_importing_the_package_stays_light() -> None:
    code = f"import sys, vsr2; print(*sorted(set(sys.modules) & {HEAVY!r}))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == ""


def test_names_of_the_package_are_found_when_they_are_asked_for() -> None:
    import vsr2

    assert set(vsr2.__all__) <= set(dir(vsr2))
    for name in vsr2.__all__:
        assert getattr(vsr2, name).__module__.startswith("vsr2.")
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = vsr2.nothing


def test_no_drawers() -> None:
    names = {p.stem for p in PACKAGE.rglob("*")} | {p.stem for p in (ROOT / "cpp").rglob("*")}
    assert not names & {"utils", "util", "helpers", "misc", "common"}


def test_no_two_modules_share_a_name() -> None:
    """Of the package, and of what stands beside it: an import or a word of it means one file."""
    beside = [
        path
        for folder in ("studies", "benchmarks", "scripts", "models", "configs", "tests")
        for path in (ROOT / folder).rglob("*.py")
    ]
    stems = [p.stem for p in (*MODULES, *beside) if p.stem not in ("__init__", "__main__")]
    assert {stem for stem in stems if stems.count(stem) > 1} == set()


def test_no_two_files_of_the_core_and_its_binding_share_a_name() -> None:
    folders = ("cpp", "python/bindings", "tests/cpp")
    names = [
        path.name
        for folder in folders
        for path in (ROOT / folder).rglob("*")
        if path.suffix in (".cpp", ".hpp")
    ]
    assert "scene_parts.cpp" in names
    assert {name for name in names if names.count(name) > 1} == set()


EQUAL_CLASS_NAMES = {
    # What a bench measures in a trial, of either engine: blind/mujoco imports nothing of VSR2.
    "Response": {"effects/effect.py", "blind/mujoco/mujoco_trial.py"},
    # One number of an effect, of either engine, for the same reason.
    "Parameter": {"effects/parameter.py", "blind/mujoco/mujoco_effects.py"},
}
"""Public names of two rooms that mean the same in each, with the files that define them."""


def test_no_two_public_classes_share_a_name() -> None:
    """Private ones aside: they are read in their own module alone."""
    files: dict[str, list[str]] = {}
    for path in MODULES:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                files.setdefault(node.name, []).append(path.relative_to(PACKAGE).as_posix())
    equal = {name: found for name, found in files.items() if len(found) > 1}
    assert equal == {name: sorted(found) for name, found in EQUAL_CLASS_NAMES.items()}


@pytest.mark.parametrize("folder", ["cpp", "python", "tests", "studies", "benchmarks", "scripts"])
def test_modules_and_functions_stay_short(folder: str) -> None:
    sources = [p for p in (ROOT / folder).rglob("*") if p.suffix in (".py", ".cpp", ".hpp")]
    long = [p for p in sources if len(p.read_text().splitlines()) > 500]
    assert not long
    functions = [
        (path, node)
        for path in sources
        if path.suffix == ".py"
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    for path, node in functions:
        assert (node.end_lineno or 0) - node.lineno < 80, f"{path}: {node.name}"
        # Of all functions alike: self and cls are not given by who calls.
        named = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        given = named[1:] if named and named[0].arg in ("self", "cls") else named
        assert len(given) <= 8, f"{path}: {node.name}"
        # A typed dictionary of further keywords hides parameters; a dataclass holds them.
        hidden = node.args.kwarg and node.args.kwarg.annotation
        assert "Unpack" not in ast.unparse(hidden or ast.Constant("")), f"{path}: {node.name}"


def test_the_core_knows_no_python() -> None:
    for path in (ROOT / "cpp").rglob("*.?pp"):
        assert not re.search(r"#include\s*[<\"](Python\.h|pybind11)", path.read_text()), path


def test_stubs_are_up_to_date() -> None:
    pytest.importorskip("pybind11_stubgen", reason="the dev extra installs pybind11-stubgen")
    check = subprocess.run(
        [ROOT / "scripts" / "stubs.sh", "check"],
        check=False,
        capture_output=True,
        text=True,
        env=os.environ | {"VSR2_VENV": sys.prefix},
    )
    assert check.returncode == 0, f"run ./scripts/stubs.sh\n{check.stdout}{check.stderr}"
