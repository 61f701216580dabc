"""C++ keeps the bounds of Python: functions below 80 lines, at most 8 parameters, lambdas too.

`test_architecture` counts the lines of its files.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = sorted(
    path
    for folder in ("cpp", "python/bindings", "tests/cpp")
    for path in (ROOT / folder).rglob("*")
    if path.suffix in (".cpp", ".hpp")
)
NO_FUNCTIONS = {
    "if",
    "for",
    "while",
    "switch",
    "catch",
    "constexpr",
    "requires",
    "return",
    "noexcept",
}
BEGINS = re.compile(r"([\w~]+|[\])>])\s*\(")
GOES_ON = re.compile(
    r"\s*(?:(?:const|noexcept|override|final|mutable|&&?)\s*)*(?:->[^;{}()]*?)?\s*(\{|(?<!:):(?!:))"
)
PAIRS = {"(": ")", "{": "}", "[": "]", "<": ">"}


class Function(NamedTuple):
    """Of a source: its name (`]`: a lambda), first line, lines, parameters."""

    name: str
    line: int
    lines: int
    parameters: int


def blanked(source: str) -> str:
    """Without comments, texts and preprocessor lines; places and lines stay."""
    found = re.compile(
        r"//[^\n]*|/\*.*?\*/|\"(?:\\.|[^\"\\\n])*\"|(?<!\w)'(?:\\.|[^'\\\n])'|^[ \t]*#[^\n]*",
        re.DOTALL | re.MULTILINE,
    )
    return found.sub(lambda m: re.sub(r"[^\n]", " ", m[0]), source)


def end_of(text: str, start: int) -> int:
    """Index of the bracket that closes the one at `start`."""
    opened, closed = text[start], PAIRS[text[start]]
    depth = 0
    for i in range(start, len(text)):
        depth += (text[i] == opened) - (text[i] == closed)
        if depth == 0:
            return i
    raise AssertionError(f"a bracket stays open: {text[start : start + 60]!r}")


def body_of(text: str, after: int) -> int | None:
    """Index of the brace that opens the body behind a list of parameters; None: there is none."""
    found = GOES_ON.match(text, after)
    if found is None:
        return None
    if found[1] == "{":
        return found.end() - 1
    # Members that a constructor begins with: name(...) or name{...}, then the body.
    place = found.end()
    while member := re.compile(r"\s*[\w:<>]+\s*([({])").match(text, place):
        place = end_of(text, member.end() - 1) + 1
        comma = re.compile(r"\s*(,|\{)").match(text, place)
        if comma is None:
            return None
        if comma[1] == "{":
            return comma.end() - 1
        place = comma.end()
    return None


def count(parameters: str) -> int:
    """Parts between the commas that stand in no bracket."""
    depth, parts = 0, 1
    for before, one in zip(" " + parameters, parameters, strict=False):
        if one in "([{<":
            depth += 1
        elif one in ")]}" or (one == ">" and before != "-"):
            depth -= 1
        parts += one == "," and depth == 0
    return parts if parameters.strip() else 0


def functions(source: str) -> Iterator[Function]:
    text = blanked(source)
    for begin in BEGINS.finditer(text):
        if begin[1] in NO_FUNCTIONS:
            continue
        closed = end_of(text, begin.end() - 1)
        body = body_of(text, closed + 1)
        if body is not None:
            lines = text.count("\n", begin.start(), end_of(text, body)) + 1
            line = text.count("\n", 0, begin.start()) + 1
            yield Function(begin[1], line, lines, count(text[begin.end() : closed]))


def test_functions_are_found_in_every_form() -> None:
    source = """
    int plain(int a, std::pair<int, int> b = {1, 2}) { return f(a); }  // other(x) {
    Thing::Thing(int a, double b) : a_(a), b_{b, 2} {
      if (a) { call("text(a, b) {"); }
    }
    auto x = [&](int a, int b, auto... c) -> std::vector<int> {
      return g(a, [](int d) mutable { return d; });
    };
    bool operator()(int a) const noexcept { return a ? h(a) : k(a); }
    void none() override {}
    """
    found = [(one.name, one.lines, one.parameters) for one in functions(source)]
    assert found == [
        ("plain", 1, 2), ("Thing", 3, 2), ("]", 3, 3), ("]", 1, 1), (")", 1, 1), ("none", 1, 0),
    ]  # fmt: skip


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_functions_are_short_and_take_few(path: Path) -> None:
    source = path.read_text()
    for one in functions(source):
        assert one.lines < 80, one
        assert one.parameters <= 8, one
