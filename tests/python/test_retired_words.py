"""Words of a private vocabulary, which the field does not use, stay out of code and prose."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

OWN = Path(__file__).resolve()
ROOT = OWN.parents[2]
FOLDERS = (
    "python",
    "cpp",
    "studies",
    "benchmarks",
    "docs",
    "scripts",
    "configs",
    "models",
    "tests",
)
ENDS = {
    ".py",
    ".pyi",
    ".cpp",
    ".hpp",
    ".md",
    ".rst",
    ".toml",
    ".yaml",
    ".j2",
    ".html",
    ".sh",
    ".css",
    ".js",
    ".ipynb",
    ".json",
}
RETIRED = (
    "strangers", "noticed", "placebo", "verge", "stray", "bent", "anew", "foretold", "told",
    "mates", "cargo", "workshop",
)  # fmt: skip
"""In no sense."""
ORDINARY = {
    "whole": "undivided; of numbers: without a fraction",
    "shared": "used by several at once",
    "dropped": "left out, as a contact that opened or a loose part",
    "places": "where something stands; puts somewhere",
    "orders": "of derivatives; in which effects can be added",
}
"""Allowed in prose in these senses alone, and in no name but `NAMES`."""
NAMES = {
    "whole": {"store.py", "steps.py", "evaluation_store.py"},  # numbers without a fraction
    "orders": {"sample_spline.py", "test_motion_sample_spline.py"},  # of derivatives
    "whole_blocks": {"low_vertices.cpp"},
}
"""Files in which a name may hold an ordinary word."""


CODE = re.compile(r"[a-z]+(?:_[a-z0-9]+)+")
"""A text of several words without a space: a code or a key."""


def sources(*ends: str) -> Iterator[Path]:
    for found in (ROOT.glob("*.md"), *((ROOT / folder).rglob("*") for folder in FOLDERS)):
        for path in sorted(found):
            results = path.is_relative_to(ROOT / "docs" / "results")
            # This module names the words.
            if path.suffix in (ends or ENDS) and not results and path.is_file() and path != OWN:
                yield path


def names_of(path: Path) -> Iterator[str]:
    """Names in a source: of variables, arguments, attributes, functions, classes, codes, keys."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".toml":
        yield from re.findall(r"^\[?([\w.]+)(?:\]| *=)", text, re.MULTILINE)
        return
    if path.suffix != ".py":
        text = re.sub(r"//[^\n]*", "", text)
        yield from filter(CODE.fullmatch, re.findall(r"\"([^\"\n]*)\"", text))
        yield from re.findall(r"\b[A-Za-z_]\w*", re.sub(r"\"[^\"\n]*\"", "", text))
        return
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.Constant(value=str(code)) if CODE.fullmatch(code):
                yield code
            case ast.ClassDef(bases=[*bases], body=body) if is_enumeration(bases):
                yield node.name
                values = (one.value for one in body if isinstance(one, ast.Assign))
                parts = (part for value in values for part in ast.walk(value))
                yield from (
                    part.value
                    for part in parts
                    if isinstance(part, ast.Constant) and isinstance(part.value, str)
                )
            case ast.Name(id=name) | ast.arg(arg=name) | ast.Attribute(attr=name):
                yield name
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                yield name
            case ast.keyword(arg=str(name)):
                yield name


def is_enumeration(bases: list[ast.expr]) -> bool:
    return any(ast.unparse(base).endswith(("Enum", "Code")) for base in bases)


def words_of(name: str) -> set[str]:
    return set(re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower().split("_"))


def test_pages_beside_the_folders_are_searched() -> None:
    assert {ROOT / "README.md", ROOT / "CHANGELOG.md"} <= set(sources())


@pytest.mark.parametrize("word", RETIRED)
def test_a_retired_word_stands_nowhere(word: str) -> None:
    spelled = re.compile(rf"(?<![A-Za-z]){word}(?![a-z])", re.IGNORECASE)
    found = {
        f"{path.relative_to(ROOT)}:{number}"
        for path in sources()
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if spelled.search(line)
    }
    assert found == set()


def test_no_file_has_such_a_name() -> None:
    retired = {*RETIRED, *ORDINARY}
    assert [p for p in sources() if words_of(re.sub(r"\W", "_", p.stem)) & retired] == []


@pytest.mark.parametrize(
    ("name", "source"),
    [
        ("one.py", 'class Phase(StrEnum):\n    ALL = "whole"\n'),
        ("two.py", 'PHASE = {"whole_response": 1}\n'),
        ("three.cpp", 'const char* phase = "whole_response";\n'),
        ("four.toml", '[phases]\nwhole_response = "response"\n'),
    ],
)
def test_a_word_in_a_code_is_seen(tmp_path: Path, name: str, source: str) -> None:
    (tmp_path / name).write_text(source)
    assert any("whole" in words_of(found) for found in names_of(tmp_path / name))


def test_words_with_an_ordinary_sense_stand_in_no_other_name() -> None:
    standard = {"shared_ptr", "make_shared", "enable_shared_from_this"}
    found: dict[str, set[str]] = {}
    for path in sources(".py", ".cpp", ".hpp", ".toml"):
        for name in set(names_of(path)) - standard:
            if words_of(name) & set(ORDINARY):
                found.setdefault(name, set()).add(path.name)
    assert found == NAMES
