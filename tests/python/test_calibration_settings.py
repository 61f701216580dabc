"""Calibration studies: what is read, and what is refused with which words."""

from __future__ import annotations

import pytest

from calibration_samples import STUDY
from vsr2.calibration import load_calibration
from vsr2.calibration.calibration_study import (
    CalibrationSettings,
    start_values,
    study_values,
)
from vsr2.config.problems import _CALIBRATION
from vsr2.errors import ConfigError


@pytest.fixture
def study(tmp_path):
    (tmp_path / "truth" / "motions").mkdir(parents=True)

    def load(*changes: tuple[str, str], overrides=()):
        text = STUDY
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "study.yaml"
        path.write_text(text)
        return load_calibration(path, overrides=overrides)

    return load


def test_values_of_tied_keys_reach_the_study(study):
    found = study()
    assert start_values(found) == {"yaw": 0.0, "restitution": 0.35}
    values = study_values(found, {"yaw": 12.5, "restitution": 0.5})
    made = found.with_values(values)
    assert made.rock.start.yaw == 12.5
    assert made.contact.rock.restitution == made.contact.pedestal.restitution == 0.5
    assert found.study.contact.rock.restitution == 0.35
    assert found.study.motion.folder.name == "truth"


def test_keys_may_lead_into_lists_and_overrides_into_parameters(study):
    found = study(("[rock.start.yaw]", "[rock.start.position_xy.1]"))
    made = found.with_values({"rock.start.position_xy.1": 0.25})
    assert made.rock.start.position_xy == (0.0, 0.25)
    found = study(overrides=["method.refine=7", "contact.rock.restitution=0.2", "folds=0",
                             "contact.pedestal.restitution=0.2"])  # fmt: skip
    assert found.own.method.refine == 7
    assert start_values(found)["restitution"] == 0.2


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("folds: 3", "fold: 3", r"study.yaml:14: fold: is no key here; did you mean `folds`\?"),
        ("folds: 3", "folds: 1", "folds: 1 leaves nothing to choose with"),
        (
            "folds: 3", "objective: logloss",
            r"objective: must be mean_of_three or log_loss .*; did you mean log_loss\?",
        ),
        ("campaign: truth", "campaign: nowhere", "no such folder .*nowhere"),
        ("refine: 3", "refined: 3", r"study.yaml:13: method.refined: .*did you mean `refine`\?"),
        ("kind: joint", "kind: jont", r"method.kind: must be .* \(is 'jont'\); did you mean joint"),
        ("kind: joint, design: 8, refine: 3, profile_points: 4", "kind: sequential",
         "parameters.yaw: the sequential procedure goes over a list; give `values`"),
        ("range: [0.0, 60.0]", "range: [60.0, 0.0]", r"parameters.yaw: .*must be below"),
        ("range: [0.0, 60.0]", "range: [0.0, 60.0], scale: log", "needs it above 0"),
        ("range: [0.0, 60.0]", "range: [0.0, 60.0], values: [1, 2]", "exactly one of"),
        ("range: [0.0, 60.0]", "values: [1, 2], scale: log", "divides a range"),
        ("range: [0.0, 60.0]", "values: [1, 1]", "one is there twice"),
        ("  yaw:", "  objective:", "is a column of the tables; rename it"),
        ("[rock.start.yaw]", "[rock.start.jaw]", "'jaw' is no key of the study"),
        ("[rock.start.yaw]", "[rock.start]", "not a single value"),
        ("[rock.start.yaw]", "[contact.rock.restitution]", "is varied twice"),
        ("[rock.start.yaw]", "[rock.start.position_xy.2]", "'2' is no key"),
        ("range: [0.0, 0.9]", "range: [0.0, 1.9]", "parameters.restitution at 1.9.*at most 1"),
        ("outcome: {tail: 2.0}", "contact: {rock: {restitution: 0.1}}",
         "tied keys have the values 0.1, 0.35"),
        ("outcome: {tail: 2.0}", "motion: {mode: single_cosine}", "motion.mode: has no place"),
        ("outcome: {tail: 2.0}", "motion: {chanel: fused}", "motion.chanel: has no place"),
        ("outcome: {tail: 2.0}", "motion: {channel: fussed}", "did you mean fused"),
        ("outcome: {tail: 2.0}", "outcome: {tale: 2.0}", r"outcome.tale: .*did you mean `tail`"),
        ("outcome: {tail: 2.0}", "effects: {edge_ronding: {radius: 0.01}}",
         "study.yaml:.*effects.edge_ronding: .*edge_rounding"),
        ("refine: 3", "sets: [{}], screen: 10", r"screen \(10\) is more than design \(8\)"),
        ("refine: 3", "sets: [{jaw: 1.0}]", r"method\.sets\.0\.jaw: is no parameter"),
        ("refine: 3", "sets: [{}, {yaw: 61.0}]", r"method\.sets\.1\.yaw: 61.* outside"),
        ("folds: 3", "judged_with: {engine.mode: sloppy}", "engine.mode"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_named(study, old, new, match):
    with pytest.raises(ConfigError, match=match):
        study((old, new))


def test_the_evolution_strategy_takes_ranges_alone(study):
    cma = ("kind: joint", "kind: joint, proposals: cma")
    assert study(cma).own.method.proposals == "cma"
    with pytest.raises(ConfigError, match=r"parameters\.yaw: method\.proposals `cma` goes over"):
        study(cma, ("range: [0.0, 60.0]", "values: [0.0, 60.0]"))


def test_an_effects_parameter_can_be_varied(study):
    radius = "  radius: {keys: [effects.edge_rounding.radius], range: [0.0, 0.01]}\nmethod:"
    rounded = ("outcome:", "effects: {edge_rounding: {radius: 0.0}}\noutcome:")
    found = study(rounded, ("method:", radius))
    assert start_values(found)["radius"] == 0.0
    made = found.with_values(study_values(found, {"radius": 0.004}))
    assert made.effects == {"edge_rounding": {"radius": 0.004}}
    with pytest.raises(ConfigError, match=r"parameters\.radius at -0\.1: effects.*radius"):
        study(rounded, ("method:", radius.replace("[0.0,", "[-0.1,")))


def test_a_plain_study_names_the_verb_of_every_key_of_a_calibration() -> None:
    assert {*CalibrationSettings.model_fields} == {*_CALIBRATION}
