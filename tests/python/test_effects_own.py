"""Effects of a user's own: found, checked, refused."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from vsr2.cli.main import main
from vsr2.cli.verb_effects import _wanted
from vsr2.effects import Effect, Parameter, effect, registry, with_effects
from vsr2.simulation.bench import EffectBench
from vsr2.trial import Trial

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def own_effects_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "_registered", {})


def test_one_s_own_effect_is_checked(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vsr2.effects.registry._registered", {})
    assert main(["effects", "check", str(ROOT / "docs" / "examples" / "soft_pad.py")]) == 0
    out = capsys.readouterr().out
    assert "soft_pad: passes" in out
    assert "neutral: yes" in out


def test_a_module_is_distinguished_from_an_effect(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "bare_pads.py").write_text((ROOT / "docs/examples/soft_pad.py").read_text())
    monkeypatch.syspath_prepend(str(tmp_path))
    assert [one.name for one in _wanted(("bare_pads",))] == ["soft_pad"]
    assert [one.name for one in _wanted(("catch",))] == ["catch"]
    assert main(["effects", "check", "bare_pad"]) == 2
    assert "no effect 'bare_pad'" in capsys.readouterr().err


OWN = """
from vsr2.effects import Effect, Parameter

class Own(Effect):
    name = "own"
    meaning = "of one's own"
    stage = "contact"
    parameters = (Parameter("size", "1", 0.0, 0.0, 1.0, "uniform", "of it"),)
"""

GRAVITY = """    stage = "inertia"
    parameters = (Parameter("size", "1", {null}, -0.05, 0.05, "uniform", "of it"),)

    def change(self, trial, values):
        gravity = trial.scene.engine.gravity * ({factor})
        engine = trial.scene.engine.model_copy(update={{"gravity": gravity}})
        return trial.with_scene(engine=engine)
"""


@pytest.mark.parametrize(
    ("body", "reported"),
    [
        (
            "",
            [
                "alive: NO, 0 times the floor",
                "more than 3 times is wanted",
                "right: NO, its `verify` gives no check",
            ],
        ),
        (
            # Acts at its null value, too.
            "    def is_null(self, values):\n        return False\n"
            "    def change(self, trial, values):\n"
            "        contact = trial.scene.contact\n"
            "        soft = contact.rock.model_copy(update={'stiffness': 1e6})\n"
            "        return trial.with_scene(contact=contact.model_copy(update={'rock': soft}))\n",
            ["neutral: NO: the trajectory differs at the null value"],
        ),
        (
            # As if its null value were -0.05.
            GRAVITY.format(null=0.0, factor="1.05 + values['size']"),
            ["neutral: yes", "continuous: NO: responses jump beside the null value"],
        ),
        (
            # Null is 0, not 0.04.
            GRAVITY.format(null=0.04, factor="1 + values['size']"),
            ["neutral: yes", "continuous: NO: responses jump beside the null value"],
        ),
    ],
    ids=["dead", "leaky", "shifted", "wrong null"],
)
def test_an_effect_that_fails_a_check_is_reported(
    body: str, reported: list[str], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "own.py").write_text(OWN + body)
    assert main(["effects", "check", str(tmp_path / "own.py")]) == 1
    out = capsys.readouterr().out
    assert "own: FAILS" in out
    for text in reported:
        assert text in out


@pytest.mark.parametrize(
    ("source", "reported"),
    [
        ("x = 1\n", "defines no class derived from vsr2.effects.Effect"),
        ("class Own(:\n", r"cannot be imported \(SyntaxError"),
        (OWN.replace('    stage = "contact"\n', ""), "Own: lacks the attribute `stage`"),
        (OWN.replace('"contact"', '"geometri"'), "stage 'geometri' is not one of geometry"),
        (OWN.replace('"own"', '"catch"'), "'catch': the name is taken"),
        (OWN.replace('"own"', '"my own"'), "'my own' is no name"),
        (OWN.replace('"own"', "5"), "5 is no name"),
        (OWN.replace('    name = "own"\n', ""), r"vsr2\.effects\.Effect that has a `name`"),
        (OWN.replace('"uniform"', '"gaussian"'), "prior is 'gaussian'; give one of uniform"),
        (OWN.replace("(Parameter(", "(dict(").replace('"size", "1", 0.0, 0.0, 1.0, "uniform", ', "")
         .replace('"of it"', ""), "`parameters` holds {}, which is no Parameter"),
        (OWN.replace('"uniform", "of it"', '"loguniform", "of it"'), "positive lower end"),
        (OWN + "    channels = ('tilts',)\n", "'tilts' is no channel; known are motion, tilt"),
        (
            OWN + "    def change(self, trial, values):\n        pass\n",
            "`change` must return a Trial .returned NoneType",
        ),
        (
            OWN + "    def change(self, trial, values):\n        return values['length']\n",
            "effect 'own' fails a small step from its null value: KeyError: 'length'",
        ),
    ],
)  # fmt: skip
def test_bad_modules_are_refused_clearly(
    source: str, reported: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "bad.py").write_text(source)
    assert main(["effects", "check", str(tmp_path / "bad.py")]) == 2
    assert re.search(reported, capsys.readouterr().err)


def test_modules_that_are_not_there_are_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects", "check", "nowhere/own.py"]) == 2
    assert "nowhere/own.py: no such file" in capsys.readouterr().err
    assert main(["effects", "check", "no_such_package.own"]) == 2
    assert "cannot be imported (ModuleNotFoundError" in capsys.readouterr().err


def test_the_list_prints_all(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects", "list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) >= 29
    assert main(["effects", "show", "base_slope"]) == 0
    assert "confounded with: com_offset" in capsys.readouterr().out
    assert main(["effects", "show", "slope"]) == 2
    assert "base_slope" in capsys.readouterr().err


class Noted(Effect):
    name = "noted"
    meaning = "of one's own"
    stage = "outcome"
    parameters = (Parameter("size", "1", 0.0, 0.0, 1.0, "uniform", "of it"),)


class Turned(Noted):
    def observe(self, observation, values):
        return replace(observation, outcome="overturned")


class Kept(Noted):
    def observe(self, observation, values):
        return observation


def test_the_code_of_an_effect_of_ones_own_is_part_of_a_trials_hash() -> None:
    """What it writes down instead of what happened stands nowhere else in the trial."""
    trial = EffectBench().block()

    def under(one: Effect, values: dict[str, float]) -> Trial:
        return with_effects([trial], [(one, values)])[0]

    turned, kept = (under(kind(), {"size": 1.0}) for kind in (Turned, Kept))
    assert turned.sha256 != kept.sha256
    assert turned.sha256 == under(Turned(), {"size": 1.0}).sha256
    gained = under(effect("table_gain"), {"change": 0.1})
    assert gained.effects[0].key == "table_gain(('change', 0.1),)", "no code of the library's"
