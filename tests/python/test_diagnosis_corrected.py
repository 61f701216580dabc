"""The corrected scene: what a diagnosis names, on top of the scene's own effects."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from vsr2.config import Study, load_study, study_from_mapping
from vsr2.diagnosis import Diagnosis
from vsr2.diagnosis.corrected import (
    corrected_study,
    drawn_studies,
    with_correction,
    write_corrected,
    write_draws,
)
from vsr2.effects import Effect, EffectRangeWarning, effect
from vsr2.ensemble.simulated.library import free_parameters
from vsr2.errors import DiagnosisError
from vsr2.fragility import load_fragility
from vsr2.simulation import study_trials

BOX = {
    "name": "box",
    "rock": {"shape": "box", "size": [0.4, 0.55, 0.95], "density": 2700.0},
    "motion": {"mode": "single_cosine", "amplitude": 0.05, "frequency": 1.0},
}
SAMPLES = 40


def scene(own: Mapping[str, Mapping[str, float | str]] | None = None) -> Study:
    return study_from_mapping({**BOX, "effects": own or {}}, base=Path())


def diagnosis(
    kind: str,
    effects: list[str],
    means: Mapping[str, Mapping[str, float | None]],
    samples: Mapping[str, np.ndarray] | None = None,
    probability: Mapping[str, float] | None = None,
) -> Diagnosis:
    """What of a diagnosis the corrected scene is made of."""
    findings = [[name] for name in effects] if kind == "pair" else [effects]
    rows = [
        {
            "name": name,
            "acts": (probability or {}).get(name, 0.5),
            "parameters": {key: {"mean": value} for key, value in own.items()},
        }
        for name, own in means.items()
    ]
    content = {
        "verdict": {"kind": kind, "effects": effects, "findings": findings},
        "effects": rows,
        "corrected": None,
        "provenance": {"seed": 3},
    }
    return Diagnosis(content, (), samples or {})


def corrected(found: Diagnosis, study: Study, **library: Effect) -> Diagnosis:
    known = {row["name"]: effect(row["name"]) for row in found.content["effects"]}
    return with_correction(found, study, known | library)


def test_what_is_named_is_put_on_top_of_the_scene_s_own() -> None:
    study = scene({"table_gain": {"change": 0.08}, "friction": {"factor": 0.5}})
    found = corrected(
        diagnosis("pair", ["table_gain", "wear"],
                  {"table_gain": {"change": 0.05}, "wear": {"loss": 0.0801234567}}), study,
    )  # fmt: skip
    assert found.content["corrected"] == {
        "effects": {"table_gain": {"change": 0.05}, "wear": {"loss": 0.0801235}},
        "among": ["table_gain", "wear"],
        "scene": {
            "table_gain": {"change": 0.134},
            "friction": {"factor": 0.5},
            "wear": {"loss": 0.0801235},
        },
    }
    made = corrected_study(found, study)
    assert made is not None
    assert made.effects == found.content["corrected"]["scene"]
    assert made.model_copy(update={"effects": study.effects}) == study


def test_of_each_cause_the_first_is_taken() -> None:
    found = diagnosis("pair", ["catch", "outcome_rule", "wear"],
                      {"outcome_rule": {"tilt": 0.4}, "catch": {"slack": 8.0},
                       "wear": {"loss": 0.1}})  # fmt: skip
    found.content["verdict"]["findings"] = [["catch", "outcome_rule"], ["wear"]]
    state = corrected(found, scene()).content["corrected"]
    assert state["effects"] == {"catch": {"slack": 8.0}, "wear": {"loss": 0.1}}


def test_of_a_class_the_first_is_taken() -> None:
    found = corrected(
        diagnosis("class", ["catch", "outcome_rule"],
                  {"outcome_rule": {"tilt": 0.4}, "catch": {"slack": 8.0}}), scene(),
    )  # fmt: skip
    assert found.content["corrected"]["effects"] == {"catch": {"slack": 8.0}}
    assert found.content["corrected"]["among"] == ["catch", "outcome_rule"]


@pytest.mark.parametrize("kind", ["none", "unknown", "unresolved"])
def test_where_nothing_is_named_there_is_nothing_to_correct(kind, tmp_path) -> None:
    named = [] if kind != "unresolved" else ["wear"]
    found = corrected(diagnosis(kind, named, {"wear": {"loss": 0.1}}), scene())
    assert found.content["corrected"] is None
    assert corrected_study(found, scene()) is None
    (tmp_path / "corrected.yaml").write_text("of an earlier diagnosis")
    assert write_corrected(found, scene(), tmp_path) is None
    assert list(tmp_path.iterdir()) == []
    assert drawn_studies(found, scene(), 3) == []


@pytest.mark.parametrize(
    ("named", "mean", "own", "stated"),
    [
        # An angle lies about its mean direction, an infinite mean is none.
        ("com_offset", {"distance": 0.004, "azimuth": -20.0}, {},
         {"distance": 0.004, "azimuth": 340.0}),
        # It is written within its prior, which here begins at half a turn.
        ("registration", {"yaw": 204.0, "lean": 0.0}, {}, {"yaw": -156.0}),
        ("table_saturation", {"velocity": None, "acceleration": 5.0}, {}, {"acceleration": 5.0}),
        ("table_bandwidth", {"corner": 900.0, "delay": 0.01}, {}, {"corner": 400.0, "delay": 0.01}),
        # The null of a scene's own is the scene's.
        ("restitution", {"energy_ratio": 0.9}, {"energy_ratio": 0.8}, {"energy_ratio": 0.9}),
        ("inertia", {"change": 0.1}, {"rule": "aabb"}, {"change": 0.1, "rule": "aabb"}),
        # What cancels the scene's own leaves nothing.
        ("com_offset", {"distance": 0.005, "azimuth": 180.0}, {"distance": 0.005}, None),
        ("contact_stiffness", {"decades": -0.3}, {"decades": 0.3}, None),
    ],
)  # fmt: skip
def test_values_are_those_of_a_study(named, mean, own, stated) -> None:
    study = scene({named: own} if own else {})
    found = corrected(diagnosis("effect", [named], {named: mean}), study)
    state = found.content["corrected"]["scene"].get(named)
    if named == "com_offset" and stated is None:
        assert state["distance"] < 1e-9
    else:
        assert state == stated


def test_beyond_the_prior_the_scene_is_written_all_the_same() -> None:
    study = scene({"slenderness": {"change": 0.05}})
    named = diagnosis("effect", ["slenderness"], {"slenderness": {"change": 0.05}})
    found = corrected(named, study)
    assert found.content["corrected"]["scene"] == {"slenderness": {"change": 0.1025}}
    made = corrected_study(found, study)
    with pytest.warns(EffectRangeWarning, match="slenderness"):
        study_trials(made)


def test_what_no_study_states_leaves_no_corrected_scene(tmp_path) -> None:
    study = scene({"table_resonance": {"amplification": 1.5}})
    mean = {"amplification": 1.2, "frequency": 9.0}
    samples = np.tile([1.2, 9.0], (SAMPLES, 1))
    found = corrected(
        diagnosis("effect", ["table_resonance"], {"table_resonance": mean},
                  {"table_resonance": samples}), study,
    )  # fmt: skip
    state = found.content["corrected"]
    assert state["scene"] is None
    assert state["effects"] == {"table_resonance": mean}
    assert write_corrected(found, study, tmp_path) is None
    assert write_draws(found, study, tmp_path, 2) == []


def samples_of(name: str, *columns: np.ndarray) -> np.ndarray:
    assert len(columns) == len(free_parameters(effect(name)))
    return np.stack(columns, axis=1)


def test_files_load_and_run(tmp_path) -> None:
    study = scene({"friction": {"factor": 0.5}})
    change = np.linspace(0.01, 0.05, SAMPLES)
    found = corrected(
        diagnosis("class", ["slenderness", "table_gain"],
                  {"slenderness": {"change": 0.03}, "table_gain": {"change": 0.1}},
                  {"slenderness": samples_of("slenderness", change),
                   "table_gain": samples_of("table_gain", -change)},
                  {"slenderness": 0.6, "table_gain": 0.3}), study,
    )  # fmt: skip
    path = write_corrected(found, study, tmp_path)
    assert path is not None
    assert path.read_text().splitlines()[:3] == [
        "# corrected_for: slenderness",
        "# values: posterior_mean",
        "# equivalent: slenderness or table_gain",
    ]
    loaded = load_study(path)
    assert loaded == corrected_study(found, study)
    (trial,) = study_trials(loaded)
    assert {one.effect.name for one in trial.effects} == {"friction", "slenderness"}
    assert load_fragility(path, overrides=["fragility={}"]).study.effects == loaded.effects

    stale = write_draws(found, study, tmp_path, 30)
    assert len(stale) == 30
    paths = write_draws(found, study, tmp_path, 20)
    assert sorted((tmp_path / "corrected_draws").iterdir()) == paths
    effects = [load_study(one).effects for one in paths]
    assert [load_study(one) for one in stale[:20]] == [load_study(one) for one in paths]
    assert all(one["friction"] == {"factor": 0.5} for one in effects)
    lower = [one["slenderness"]["change"] for one in effects if "slenderness" in one]
    moved = [one["table_gain"]["change"] for one in effects if "table_gain" in one]
    assert len(lower) + len(moved) == 20
    # Two to one, as the diagnosis has it.
    assert 8 <= len(lower) <= 18
    assert set(lower) <= {float(f"{value:.6g}") for value in change}
    assert len(set(lower)) == len(lower)
    assert set(moved) <= {float(f"{-value:.6g}") for value in change}
    with pytest.raises(DiagnosisError, match=f"give 0 to {SAMPLES}"):
        write_draws(found, study, tmp_path, SAMPLES + 1)
    assert write_draws(found, study, tmp_path, 0) == []


def test_draws_of_two_that_act_together_hold_both() -> None:
    found = corrected(
        diagnosis("pair", ["wear", "com_offset"],
                  {"wear": {"loss": 0.08}, "com_offset": {"distance": 0.01, "azimuth": 20.0}},
                  {"wear": samples_of("wear", np.full(SAMPLES, 0.05)),
                   "com_offset": samples_of("com_offset", np.full(SAMPLES, 0.01),
                                            np.linspace(0, 360, SAMPLES))}), scene(),
    )  # fmt: skip
    drawn = drawn_studies(found, scene(), 5)
    assert [set(one.effects) for one in drawn] == [{"wear", "com_offset"}] * 5
    assert drawn[0].effects["com_offset"] == {"distance": 0.01}
    assert len({repr(one.effects) for one in drawn}) == 5
