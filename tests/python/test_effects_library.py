"""Every effect of the library: neutral, alive, right; and the library's table."""

from __future__ import annotations

import csv
import dataclasses
import importlib
import math
import pkgutil
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import vsr2.effects
from check_effects import engines_differ
from effect_closed_forms import FORMS, closed_forms
from vsr2._native import FastRefusal
from vsr2.effects import Effect, Parameter, in_order, library, with_effects
from vsr2.effects.registry import BUILT_IN
from vsr2.report.messages.commands import effect_report
from vsr2.scene import Hull
from vsr2.simulation import run_batch
from vsr2.simulation.bench import EffectBench, Rock
from vsr2.simulation.effect_checks import (
    ROCKS,
    EffectChecker,
    EffectReport,
    beside_null,
    ensemble,
)
from vsr2.trial import Trial

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "reference" / "effects.md").read_text()
NAMES = set(re.findall(r"^### `(\w+)`", PAGE, re.MULTILINE))
EFFECTS = in_order(library())


@pytest.fixture(scope="module")
def checker() -> EffectChecker:
    return EffectChecker(ROOT / "models" / "pbr_scan.obj")


def by_name(effect: Effect) -> str:
    return effect.name


def test_the_library_is_complete() -> None:
    found: set[str] = set()
    for module in pkgutil.iter_modules(vsr2.effects.__path__, "vsr2.effects."):
        defined = vars(importlib.import_module(module.name)).values()
        classes = [one for one in defined if isinstance(one, type) and issubclass(one, Effect)]
        found |= {one.name for one in classes if hasattr(one, "name")}
    assert found == set(library())
    assert len(library()) == len(BUILT_IN)


def test_the_page_names_every_effect() -> None:
    assert set(library()) == NAMES, "write the pages again: python studies/effects_page.py"
    for name in NAMES:
        figure = ROOT / "docs" / "results" / "effects" / f"{name}.png"
        assert figure.is_file(), f"draw {figure}: python studies/figure_effects.py {name}"


@pytest.mark.parametrize("effect", EFFECTS, ids=by_name)
def test_neutral(effect: Effect, checker: EffectChecker) -> None:
    assert checker.neutral(effect)


@pytest.mark.parametrize("effect", EFFECTS, ids=by_name)
def test_continuous(effect: Effect, checker: EffectChecker) -> None:
    if effect.jump:
        assert effect.name in ("base_asperity", "edge_rounding", "outcome_rule", "support")
        return
    for found in checker.step(effect).values():
        assert found.is_continuous, found


def test_null_values_alone_are_those_of_the_study() -> None:
    alone = {effect.name for effect in EFFECTS if beside_null(effect) is None}
    assert alone == {"restitution"}


@pytest.mark.parametrize("rock", ROCKS)
@pytest.mark.parametrize("effect", EFFECTS, ids=by_name)
def test_alive(effect: Effect, rock: Rock, checker: EffectChecker) -> None:
    found = checker.alive(effect, rock)
    assert found.ratio > 3.0, found


class PerturbedHull(Effect):
    """Nothing but another draw of the points of a hull."""

    name = "perturbed_hull"
    meaning = "points of a hull elsewhere by chance"
    parameters = (
        Parameter("size", "m", 0.0, 0.0, 1.0, "uniform", "standard deviation"),
        Parameter("seed", "1", 0.0, 0.0, 99.0, "uniform", "of the draw", secondary=True),
    )
    stage = "geometry"

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        rng = np.random.default_rng([7, int(values["seed"])])
        parts = tuple(
            Hull(part.points + values["size"] * rng.standard_normal(part.points.shape))
            if isinstance(part, Hull)
            else part
            for part in trial.scene.rock.parts
        )
        return trial.with_scene(rock=dataclasses.replace(trial.scene.rock, parts=parts))


@pytest.mark.parametrize("size", [1e-9, 1e-7, 1e-5])
def test_a_hull_perturbed_again_is_not_alive(size: float, checker: EffectChecker) -> None:
    for seed in (0.0, 1.0):
        found = checker.alive(PerturbedHull(), "scan", {"size": size, "seed": seed})
        assert not found.good, found


@pytest.mark.parametrize("rock", ROCKS)
def test_trials_of_the_checks_end_at_rest(rock: Rock, checker: EffectChecker) -> None:
    standing = checker.bench.block() if rock == "block" else checker.bench.scan()
    trials = ensemble(standing, checker.motions(rock), 0.0, 1)
    quick = [trials[0], trials[-1]]
    assert all(status == "ok" for status in run_batch(quick, threads=1)["status"])


@pytest.mark.parametrize("effect", EFFECTS, ids=by_name)
def test_exact_and_fast_agree(effect: Effect, checker: EffectChecker) -> None:
    # By rounding, over the first swing; a rounded edge lies flat on facets, which adds some, and
    # under the hardest pulse, of 4 g, grows within it.
    seconds = 0.25 if effect.name == "edge_rounding" else 0.3
    assert engines_differ(checker, effect, "block", seconds) < 2e-6


@pytest.mark.parametrize("effect", EFFECTS, ids=by_name)
def test_right(effect: Effect, checker: EffectChecker) -> None:
    assert type(effect).verify is Effect.verify, "its closed forms stand outside the package"
    checks = closed_forms(effect, checker.bench)
    assert checks
    for check in checks:
        assert check.good, check
        assert check.tolerance == 0 or math.isfinite(check.tolerance)


def test_closed_forms_of_no_effect_and_effects_without() -> None:
    assert set(FORMS) == NAMES
    message = r"'perturbed_hull'.*`perturbed_hull\(.*studies/effect_closed_forms"
    with pytest.raises(LookupError, match=message):
        closed_forms(PerturbedHull(), EffectBench())


def test_the_report_says_where_the_closed_forms_of_the_library_stand() -> None:
    report = EffectReport(library()["wear"], True, {}, {}, None, FastRefusal.none)
    assert "hold `wear` in studies/effect_closed_forms" in effect_report(report)


@pytest.mark.parametrize("effect", EFFECTS, ids=by_name)
def test_null_values_give_the_trial_back(effect: Effect, checker: EffectChecker) -> None:
    trials = [checker.bench.block()] * 2

    def last(values: dict[str, float]) -> Trial:
        return with_effects(trials, [(effect, values)], sessions=["a", "b"])[1]

    assert last(effect.null()) is trials[1]
    changed = last(effect.extreme())
    assert [one.effect for one in changed.effects] == [effect]
    if effect.stage != "outcome":
        assert changed.sha256 != dataclasses.replace(trials[1], effects=changed.effects).sha256


@pytest.mark.parametrize("effect", EFFECTS, ids=by_name)
def test_nominal_values_are_null_or_those_of_the_trial(
    effect: Effect, checker: EffectChecker
) -> None:
    values = effect.nominal(checker.bench.block())
    for name, null in effect.null().items():
        assert values[name] == null or (math.isnan(null) and math.isfinite(values[name]))


def test_nominal_values_leave_a_trial_with_the_effect_as_it_is(checker: EffectChecker) -> None:
    trial = checker.bench.block()
    spin, impact = library()["spin_friction"], library()["restitution"]
    turning = spin.change(trial, {"coefficient": 0.2})
    assert turning.scene.contact.pair.spinning_friction == pytest.approx(0.2)
    same = spin.change(turning, spin.nominal(turning))
    assert same.scene.contact.pair.spinning_friction == pytest.approx(0.2)
    assert impact.nominal(trial) == {"energy_ratio": 1.0}
    softer = impact.change(trial, {"energy_ratio": 0.8})
    assert impact.nominal(softer) == {"energy_ratio": 0.8}


@pytest.mark.parametrize("effect", EFFECTS, ids=by_name)
def test_descriptions_are_complete(effect: Effect) -> None:
    assert set(effect.confounded_with) <= NAMES
    assert effect.meaning
    assert effect.source
    assert effect.channels
    for parameter in effect.parameters:
        assert parameter.meaning
        low, high = parameter.limits or (parameter.lower, parameter.upper)
        assert low <= parameter.lower <= parameter.upper <= high
        ends = [parameter.ppf(0.0), parameter.ppf(1.0)]
        if parameter.prior == "fixed":
            assert ends == [parameter.null] * 2
        else:
            assert ends == pytest.approx([parameter.lower, parameter.upper])
            assert parameter.lower < parameter.ppf(0.5) < parameter.upper


def test_none_leaves_the_domain_of_fast(checker: EffectChecker) -> None:
    assert {checker.fast_refusal(effect) for effect in EFFECTS} == {FastRefusal.none}


def test_the_pages_are_up_to_date(tmp_path: Path) -> None:
    command = [sys.executable, str(ROOT / "studies" / "effects_page.py"), "--out", str(tmp_path)]
    subprocess.run(command, check=True)
    for page in ("reference/effects.md", "validation/effects.md"):
        assert (ROOT / "docs" / page).read_text() == (tmp_path / page).read_text(), (
            f"write docs/{page} again: python studies/effects_page.py"
        )


def test_the_table_of_checks_holds_every_effect_and_none_that_fails() -> None:
    text = (ROOT / "docs" / "results" / "effects" / "checks.csv").read_text()
    rows = list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
    names = [effect.name for effect in EFFECTS]
    assert [row["effect"] for row in rows] == names, "python studies/check_effects.py"
    for row in rows:
        assert row["neutral"] == "true"
        assert row["fast"] == "yes"
        met, of, all_of = row["right"].split()
        assert (met, of) == (all_of, "of")
        for rock in ROCKS:
            assert float(row[f"alive_{rock}"]) > 3.0, row["effect"]
            step = row[f"step_{rock}"]
            assert step in ("jump", "none") or float(step) <= 2.0
