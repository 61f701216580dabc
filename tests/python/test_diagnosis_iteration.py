"""Diagnosis of the corrected scene, again and again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from command_line import run
from diagnosis_samples import few_effects, few_simulations
from planted import shaken_campaign
from vsr2.campaign import Campaign, save_campaign
from vsr2.config import Study, load_study, study_from_mapping
from vsr2.diagnosis import Budget, Diagnosis, iterate
from vsr2.diagnosis.corrected import with_correction, write_corrected
from vsr2.diagnosis.iteration import Asked, Ended
from vsr2.effects import effect, library
from vsr2.ensemble import DEFAULT_NUISANCES, Execution, Hypotheses, with_deviations
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
from vsr2.ensemble.simulated.simulator import Request
from vsr2.errors import DiagnosisError
from vsr2.report.messages.commands import iteration_table

BOX = {
    "name": "box",
    "engine": {"mode": "fast"},
    "rock": {"shape": "box", "size": [0.4, 0.55, 0.95], "density": 2700.0},
    "motion": {"mode": "all_recordings", "folder": "."},
    "outcome": {"tail": 1.0},
}
NUMBER = {"value": 0.5, "ci95": [0.4, 0.6]}
GAP = dict.fromkeys(("before", "floor", "excess", "closure", "headline"), NUMBER)
Own = Mapping[str, Mapping[str, float]]


def scene(own: Own | None = None) -> Study:
    return study_from_mapping({**BOX, "effects": own or {}}, base=Path())


@pytest.fixture(scope="module")
def shaken() -> Campaign:
    return shaken_campaign(4, 5, duration=1.0, pga_g=(0.7, 1.4), session_size=5)


class StubDiagnose:
    """Stands for `diagnose`: names the truth that it is given, of scenes that lack it.

    Args:
        truth: effects of which the first that a scene lacks is named.
    """

    def __init__(self, truth: Own) -> None:
        self.truth = truth
        self.calls: list[Study] = []
        self.references: list[int] = []

    def __call__(self, campaign, study, *, out, **asked) -> Diagnosis:
        self.calls.append(study)
        self.references.append(len(asked.get("hypotheses", Hypotheses()).references))
        missing = [name for name in self.truth if name not in study.effects][:1]
        rows = [
            {"name": name, "probability": 0.9,
             "parameters": {key: {"mean": value} for key, value in self.truth[name].items()}}
            for name in missing
        ]  # fmt: skip
        kind = "effect" if missing else "none"
        content = {
            "campaign": {"name": campaign.name},
            "verdict": {
                "kind": kind,
                "effects": missing,
                "findings": [missing],
                "probability": 0.9,
            },
            "effects": rows,
            "gap": GAP,
            "none_probability": 0.1,
            "corrected": None,
            "provenance": {"seed": 0},
        }
        found = with_correction(Diagnosis(content), study, {n: effect(n) for n in missing})
        out.mkdir(parents=True, exist_ok=True)
        (out / "diagnosis.json").write_text(found.to_json())
        write_corrected(found, study, out)
        return found


@pytest.fixture
def stub(monkeypatch) -> StubDiagnose:
    made = StubDiagnose({"table_gain": {"change": 0.05}, "friction": {"factor": 0.7}})
    monkeypatch.setattr("vsr2.diagnosis.iteration.diagnose", made)
    return made


def test_each_round_diagnoses_the_scene_that_the_last_one_corrected(shaken, stub, tmp_path) -> None:
    found = iterate(
        shaken, scene(), tmp_path, asked=Asked(hypotheses=Hypotheses(references=[shaken]))
    )
    assert [one.effects for one in stub.calls] == [
        {}, {"table_gain": {"change": 0.05}},
        {"table_gain": {"change": 0.05}, "friction": {"factor": 0.7}},
    ]  # fmt: skip
    assert stub.references == [1, 0, 0], "a reference tells of the scene as given"
    assert found.ended is Ended.NOTHING_NAMED
    assert [one.folder.name for one in found.rounds] == ["round_1", "round_2", "round_3"]
    assert load_study(tmp_path / "corrected.yaml") == found.scene == stub.calls[-1]
    for before, after in zip(found.rounds, found.rounds[1:], strict=False):
        assert load_study(before.folder / "corrected.yaml") == after.scene
    content = json.loads((tmp_path / "iteration.json").read_text())
    assert content["ended"] == "nothing_named"
    assert [one["corrected"] for one in content["rounds"]] == [
        {"table_gain": {"change": 0.05}}, {"friction": {"factor": 0.7}}, None,
    ]  # fmt: skip
    assert content["scene"] == found.scene.effects


def test_finished_rounds_are_not_run_again(shaken, stub, tmp_path) -> None:
    def fail(found: Diagnosis, study: Study, folder: Path) -> None:
        if folder.name == "round_2":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        iterate(shaken, scene(), tmp_path, finished=fail)
    assert len(stub.calls) == 2
    again = iterate(shaken, scene(), tmp_path, asked=Asked(execution=Execution(threads=1)))
    # The second round's page was not written: it counts as under way.
    assert [len(one.effects) for one in stub.calls[2:]] == [1, 2]
    stub.calls.clear()
    same = iterate(shaken, scene(), tmp_path)
    assert stub.calls == []
    assert same.to_json() == again.to_json()
    # What is asked otherwise is asked again.
    other = Asked(seed=1, tier="B")
    for another in (
        lambda: iterate(shaken, scene(), tmp_path, asked=Asked(seed=1)),
        lambda: iterate(shaken, scene(), tmp_path, asked=other),
        lambda: iterate(shaken, scene({"wear": {"loss": 0.01}}), tmp_path, asked=other),
        lambda: iterate(replace(shaken, name="other"), scene(), tmp_path),
        lambda: iterate(shaken, scene(), tmp_path, asked=Asked(budget=Budget(campaigns=200))),
    ):
        stub.calls.clear()
        another()
        assert len(stub.calls) == 3


def test_rounds_end_where_they_are_asked_to(shaken, stub, tmp_path) -> None:
    found = iterate(shaken, scene(), tmp_path, most=1)
    assert (len(found.rounds), found.ended) == (1, Ended.MOST_ROUNDS)
    assert found.scene.effects == {"table_gain": {"change": 0.05}}
    more = iterate(shaken, scene(), tmp_path, most=2)
    assert (len(more.rounds), len(stub.calls)) == (2, 2)
    with pytest.raises(DiagnosisError, match="most rounds is 0"):
        iterate(shaken, scene(), tmp_path, most=0)


def test_what_leads_a_gap_that_is_not_resolved_is_not_named(shaken, stub, tmp_path) -> None:
    found = iterate(shaken, scene(), tmp_path)
    last = found.rounds[-1].found.content
    last["verdict"] |= {"kind": "unresolved", "effects": ["catch", "friction"]}
    _, *rounds, ended = iteration_table(found).splitlines()
    assert [one.split()[1:3] for one in rounds] == [
        ["effect", "table_gain"], ["effect", "friction"], ["unresolved", "-"],
    ]  # fmt: skip
    assert ended == "the last round names nothing"


@pytest.mark.parametrize(
    ("own", "named", "ended"),
    [
        ({"catch": {"slack": 8.0}}, {"catch": {"slack": 10.0}}, Ended.NOTHING_CHANGED),
        (
            {"table_resonance": {"amplification": 1.5}},
            {"table_resonance": {"amplification": 1.2, "frequency": 9.0}},
            Ended.NOT_STATED,
        ),
    ],
)
def test_rounds_end_where_no_scene_is_other(
    shaken, tmp_path, monkeypatch, own, named, ended
) -> None:
    stub = StubDiagnose(named)
    # It names the effect although the scene has it.
    monkeypatch.setattr(
        "vsr2.diagnosis.iteration.diagnose",
        lambda campaign, study, **asked: _named_again(stub, campaign, study, **asked),
    )
    found = iterate(shaken, scene(own), tmp_path)
    assert (len(found.rounds), found.ended) == (1, ended)
    assert found.scene == scene(own)
    assert not (tmp_path / "corrected.yaml").exists()


def _named_again(stub: StubDiagnose, campaign: Campaign, study: Study, **asked) -> Diagnosis:
    bare = stub(campaign, study.model_copy(update={"effects": {}}), **asked)
    return with_correction(bare, study, {name: effect(name) for name in stub.truth})


@pytest.fixture(scope="module")
def gained(shaken) -> Campaign:
    """Under a table that moves by 14 % more."""
    hypotheses = Hypotheses(library={}, nuisances=STILL[:3], contact_family=())
    own = scene({"table_gain": {"change": 0.14}})
    truth = SceneSimulator(shaken, own, hypotheses=hypotheses, seed=5)
    given = truth.run([Request(i, (), 3, 1) for i in range(len(shaken))])
    trials = tuple(
        replace(trial, overturned=bool(given.overturned[i]), peak_tilt=float(given.peak_tilt[i]))
        for i, trial in enumerate(shaken.trials)
    )
    return replace(shaken, trials=trials)


STILL = with_deviations({"yaw": 0.0, "offset": 0.0})


def test_a_planted_cause_is_corrected_and_not_named_again(gained, tmp_path) -> None:
    hypotheses = Hypotheses(
        {name: library()[name] for name in ("table_gain", "catch")},
        nuisances=STILL[:3], contact_family=(),
    )  # fmt: skip
    with few_simulations():
        found = iterate(
            gained, scene(), tmp_path,
            asked=Asked(
                "M", Budget(campaigns=100, held_out=False), hypotheses, Execution(threads=1),
            ),
        )  # fmt: skip
    first, *others = found.to_json()["rounds"]
    assert list(first["corrected"]) == ["table_gain"]
    assert 0.08 < first["corrected"]["table_gain"]["change"] <= 0.15
    assert others, "the corrected scene is diagnosed"
    for later in others:
        again = later["corrected"] or {}
        assert "table_gain" not in again
    assert others[0]["before"]["value"] < first["before"]["value"]
    assert found.ended is Ended.NOTHING_NAMED
    content = json.loads((tmp_path / "round_2" / "diagnosis.json").read_text())
    assert content["provenance"]["scene_effects"] == first["corrected"]


def test_the_command_line_iterates_and_writes_draws(gained, tmp_path, capsys) -> None:
    save_campaign(gained, tmp_path / "campaign")
    motion = {"mode": "single_cosine", "amplitude": 0.05, "frequency": 1}
    (tmp_path / "scene.yaml").write_text(json.dumps({**BOX, "motion": motion}))
    # Of one effect, and without nuisances, so few simulations name something.
    still = [part for one in DEFAULT_NUISANCES for part in ("--nuisance", f"{one.name}=0")]
    given = ("diagnose", tmp_path / "campaign", "--scene", tmp_path / "scene.yaml", "--tier", "M",
             "--campaigns", 36, "--no-how-far", "--threads", 1, *still)  # fmt: skip
    with few_simulations(), few_effects("table_gain"):
        for again in ((), ("--resume",)):
            assert run(*given, "--out", tmp_path / "out", "--iterate", "--most-rounds", 1,
                       "--posterior-draws", 3, *again) == 0  # fmt: skip
    printed = capsys.readouterr()
    assert "added to the scene" in printed.out
    below = tmp_path / "out" / "round_1"
    assert (below / "index.html").exists()
    content = json.loads((below / "diagnosis.json").read_text())
    corrected = content["corrected"]
    assert corrected is not None
    assert len(list((below / "corrected_draws").iterdir())) == 3
    assert load_study(tmp_path / "out" / "corrected.yaml").effects == corrected["scene"]
    # The second call found the round finished.
    assert printed.err.count("vsr2 diagnose: judging 100%") == 1


def test_the_command_line_says_why_no_draws_come(shaken, monkeypatch, tmp_path, capsys) -> None:
    monkeypatch.setattr("vsr2.diagnosis.iteration.diagnose", StubDiagnose({}))
    monkeypatch.setattr("vsr2.report.diagnosis_page.write_diagnosis_page", lambda *_: None)
    save_campaign(shaken, tmp_path / "campaign")
    motion = {"mode": "single_cosine", "amplitude": 0.05, "frequency": 1}
    (tmp_path / "scene.yaml").write_text(json.dumps({**BOX, "motion": motion}))
    out = tmp_path / "out"
    assert run("diagnose", tmp_path / "campaign", "--scene", tmp_path / "scene.yaml", "--out", out,
               "--iterate", "--posterior-draws", 3) == 0  # fmt: skip
    folder = out / "round_1"
    why = "nothing is named that a study can state"
    said = f"0 of 3 draws of the posterior are written to {folder}: {why}"
    assert said in capsys.readouterr().out
    assert not (folder / "corrected_draws").exists()
