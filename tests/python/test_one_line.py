"""Values that show themselves as one line."""

from __future__ import annotations

import importlib
import pkgutil
import re
from pathlib import Path

import vsr2
from vsr2.diagnosis import Diagnosis
from vsr2.one_line import OneLine, counted


def below(kind: type) -> set[type]:
    """Classes that are made from one, at any depth."""
    return {one for direct in kind.__subclasses__() for one in (direct, *below(direct))}


def test_no_dataclass_writes_a_repr_of_its_own() -> None:
    rooms = (
        "campaign", "scene", "results", "ensemble", "posterior", "diagnosis", "prediction",
        "coverage", "causes", "fragility", "simulation", "trial",
    )  # fmt: skip
    for room in rooms:
        found = importlib.import_module(f"vsr2.{room}")
        for module in pkgutil.walk_packages(found.__path__, f"{found.__name__}."):
            importlib.import_module(module.name)
    kinds = below(OneLine)
    assert {Diagnosis, vsr2.BatchResult, vsr2.Trial} <= kinds
    assert [one for one in kinds if one.__repr__ is not OneLine.__repr__] == []


def test_a_diagnosis_is_one_line() -> None:
    content = {"verdict": {"kind": "effect", "effects": ["catch"]}, "where": ["x"] * 1000}
    assert repr(Diagnosis(content)) == "<Diagnosis: kind='effect', effects=['catch']>"


def test_a_count_agrees_with_its_noun_in_every_line_of_the_log() -> None:
    assert [counted(n, "trial") for n in (0, 1, 2)] == ["0 trials", "1 trial", "2 trials"]
    package = Path(vsr2.__file__).parent
    lines = re.compile(r"_logger\.\w+\(\s*\"([^\"]*%d (?:\w+ )?\w+s\b[^\"]*)")
    found = {p.name: lines.findall(p.read_text()) for p in package.rglob("*.py")}
    assert {name: texts for name, texts in found.items() if texts} == {}


def test_a_count_agrees_with_its_noun_in_messages() -> None:
    """A length before a regular plural; `none of the 2 trials` has another word for one."""
    package = Path(vsr2.__file__).parent
    joined = re.compile(r"\"\s*\n\s*f?\"")
    counts = re.compile(
        r"(?<!none of the )\{(?:len\([^{}]*\)|[\w.]+\.size)\} (?:\w+ )?[a-z]+s\b(?! of)"
    )
    irregular = re.compile(r"(?:vertices|probabilities|intensities|entries|body\.parts)")
    found = {}
    for path in package.rglob("*.py"):
        if path.parent.name == "mujoco":  # It imports nothing of VSR2.
            continue
        texts = counts.findall(joined.sub("", path.read_text()))
        found[path.name] = [text for text in texts if not irregular.search(text)]
    assert {name: texts for name, texts in found.items() if texts} == {}
