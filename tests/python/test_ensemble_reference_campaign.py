"""A nominal scene against reference campaigns whose cause is known."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from command_line import run
from planar.planar_simulator import PlanarSimulator
from planted import observe, shaken_campaign
from vsr2.campaign import (
    Campaign,
    MeasurementNoise,
    RunOptions,
    load_campaign,
    save_campaign,
    simulate_campaign,
)
from vsr2.config import load_study
from vsr2.ensemble.observed.observations import observe_campaign
from vsr2.ensemble.reference_campaign import (
    REFERENCE,
    Agreement,
    ReferenceConstants,
    _holm,
    agreement,
    compare_reference,
)
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.simulator import Effects
from vsr2.errors import ConfigError
from vsr2.report.messages.commands import reference_table

FEW = ReferenceConstants(19, 2, significant=0.25)
"""Five measures, each of which may be the largest of twenty by chance."""


PLANTED: Effects = (("table_gain", (0.12,)),)


@pytest.fixture(scope="module")
def blank() -> Campaign:
    return shaken_campaign(8, 10)


@pytest.fixture(scope="module")
def cache(blank: Campaign) -> SimulationCache:
    return SimulationCache(PlanarSimulator(blank, seed=0))


def compared(
    cache: SimulationCache, blank: Campaign, planted: Effects, tier: str = "M"
) -> dict[str, Agreement]:
    truth = PlanarSimulator(blank, seed=10_001)
    seen = observe_campaign(observe(blank, truth, planted, nuisance=2, tier=tier))
    return {one.measure: one for one in agreement(cache, seen)}


def test_a_reference_of_the_same_scene_agrees(cache, blank) -> None:
    found = compared(cache, blank, ())
    assert list(found) == ["outcomes", "tilt_mean", "tilt_size"]
    assert not any(one.differs for one in found.values())
    assert found["outcomes"].trials == len(blank)
    assert found["tilt_size"].campaign >= abs(found["tilt_mean"].campaign)
    assert found["outcomes"].low <= found["outcomes"].campaign <= 0.2


def test_an_effect_differs(cache, blank) -> None:
    found = compared(cache, blank, PLANTED)
    assert found["outcomes"].differs
    assert found["tilt_mean"].differs
    assert found["tilt_mean"].campaign > 0.1, "a stronger table tilts more"
    assert found["outcomes"].p_value == pytest.approx(len(found) / (1 + REFERENCE.draws))


def test_p_values_hold_for_all_measures_together() -> None:
    # Holm: the least times their number, the next times one less, none below the one before.
    assert _holm([0.01, 0.04, 0.03, 0.9]) == pytest.approx([0.04, 0.09, 0.09, 0.9])
    assert _holm([0.5, 0.6]) == [1.0, 1.0]
    # As long as there are so many draws that each measure may differ.
    assert 5 / (1 + ReferenceConstants().draws) <= ReferenceConstants().significant


def test_outcomes_alone_are_compared_alone(cache, blank) -> None:
    assert list(compared(cache, blank, (), tier="B")) == ["outcomes"]


def test_the_table_shows_the_floor_and_says_what_differs() -> None:
    found = [
        Agreement("outcomes", 150, 0.07, 0.02, 0.01, 0.05, 0.025),
        Agreement("turn_mean", 90, 0.0, 0.001, -0.02, 0.02, 0.5),
    ]
    lines = reference_table(found).splitlines()
    assert " ".join(lines[1].split()) == "outcomes that differ % 150 7 2 1 to 5 0.025"
    assert "-1.15 to 1.15" in lines[2]
    assert lines[3].startswith("differs by more than")
    assert "outcomes that differ." in lines[3]
    assert "turn" not in lines[3]
    agrees = reference_table([replace(found[0], p_value=0.4)]).splitlines()
    assert agrees[-1].startswith("agrees within")


SCENE = """
name: box
rock: {shape: box, size: [0.25, 0.5, 1.0], density: 2700.0}
motion:
  mode: grid_cosine
  pga_g: {min: 0.25, max: 0.6, step: 0.05}
  pgv_pga_s: {min: 0.08, max: 0.2, step: 0.02}
engine: {mode: fast}
outcome: {tail: 2.0}
output: {log_every: 0}
"""
EFFECTS = {"table_gain": {"change": 0.15}}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene, the same with an effect, and the campaign with that effect, series included."""
    out = tmp_path_factory.mktemp("reference")
    (out / "plain.yaml").write_text(SCENE)
    (out / "known.yaml").write_text(f"{SCENE}effects: {json.dumps(EFFECTS)}\n")
    study = load_study(out / "known.yaml")
    save_campaign(
        simulate_campaign(study, series_every=10, run=RunOptions(threads=1)), out / "campaign"
    )
    return out


def test_a_known_effect_stands_in_the_scene(folder, capsys, monkeypatch) -> None:
    monkeypatch.setattr("vsr2.ensemble.reference_campaign.REFERENCE", FEW)
    said = {}
    for name, code in (("known", 0), ("plain", 1)):
        line = ["campaign", "compare", folder / f"{name}.yaml", folder / "campaign"]
        assert run(*line, "--threads", 1, "--json") == code
        found = json.loads(capsys.readouterr().out)
        assert found["constants"]["reference"]["draws"] == 19
        said[name] = {one["measure"]: one for one in found["measures"]}
    # Without noise or nuisance the campaign is the nominal scene's own, bit for bit.
    assert said["known"]["outcomes"]["campaign"] == 0
    assert said["known"]["tilt_size"]["campaign"] == pytest.approx(0, abs=1e-6)
    assert said["known"]["turn_size"]["campaign"] == pytest.approx(0, abs=1e-3)
    assert said["plain"]["outcomes"]["campaign"] > 0
    assert said["plain"]["tilt_mean"]["campaign"] > 0.05


def test_an_effect_that_there_is_not_is_refused(folder) -> None:
    study = load_study(folder / "plain.yaml")
    campaign = load_campaign(folder / "campaign")
    with pytest.raises(ConfigError, match="table_gian"):
        compare_reference(campaign, study.model_copy(update={"effects": {"table_gian": {}}}))


def test_the_noise_of_orientations_is_part_of_the_floor(folder, monkeypatch) -> None:
    monkeypatch.setattr("vsr2.ensemble.reference_campaign.REFERENCE", FEW)
    study = load_study(folder / "known.yaml")
    noisy = simulate_campaign(
        study,
        series_every=10,
        noise=MeasurementNoise(orientation=0.01),
        run=RunOptions(threads=1),
    )
    found = {one.measure: one for one in compare_reference(noisy, study, threads=1)}
    silent = replace(
        noisy,
        noise=MeasurementNoise(),
        trials=tuple(
            replace(trial, series=replace(trial.series, noise_orientation=None))
            for trial in noisy.trials
        ),
    )
    unsaid = {one.measure: one for one in compare_reference(silent, study, threads=1)}
    assert unsaid["turn_size"].differs
    assert not found["turn_size"].differs
    assert not found["turn_mean"].differs
