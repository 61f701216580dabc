"""Values that show themselves as one line."""

from __future__ import annotations

import importlib
import pkgutil
import re
from pathlib import Path

import numpy as np

import vsr2
from vsr2.diagnosis import Diagnosis
from vsr2.hazard import HazardCurve
from vsr2.motion import Record, ResponseSpectrum
from vsr2.one_line import OneLine, counted
from vsr2.scene.body import MassProperties


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


def test_values_of_arrays_are_one_line_too() -> None:
    period = np.array([0.1, 2.0])
    shown = {
        ResponseSpectrum(period, 0.1 * period, 0.05): "periods=2, from_s=0.1, to_s=2, damping=0.05",
        HazardCurve(
            "pga_g", period, 0.01 / period
        ): "measure='pga_g', levels=2, lowest=0.1, highest=2",
        Record("r", 0.01, acceleration=np.zeros(16)): (
            "name='r', channels=['acceleration'], samples=16, sample_interval_s=0.01"
        ),
        MassProperties(2.0, np.zeros(3), np.ones(3), np.eye(3)): (
            "mass_kg=2, mass_center_m=[0.0, 0.0, 0.0], principal_inertia_kg_m2=[1.0, 1.0, 1.0]"
        ),
    }
    for value, line in shown.items():
        assert repr(value) == f"<{type(value).__name__}: {line}>"
        assert value._repr_html_().startswith(f"<b>{type(value).__name__}</b>: ")


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
