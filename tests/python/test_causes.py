"""Causes of a campaign by margins, from a scene to tables, in Python and on the command line."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import jsonschema
import numpy as np
import pytest

from command_line import run
from planted import shaken_campaign
from vsr2._native import build_facts
from vsr2.campaign import Campaign, save_campaign
from vsr2.causes import causes_schema, find_causes
from vsr2.causes.causes import FILES, _corrected, _drawn
from vsr2.causes.explained_gap import _floor_scores
from vsr2.causes.inferred_causes import parameter_sizes
from vsr2.causes.margins.acting_posterior import SAMPLER
from vsr2.causes.margins.cause_space import cause_space
from vsr2.causes.margins.held_out_causes import HELD_OUT_CAUSES
from vsr2.causes.margins.outcome_model import Particles
from vsr2.causes.margins.simulated_scenes import SCENES
from vsr2.config import load_study, study_from_mapping
from vsr2.diagnosis.how_far.ensemble_losses import Ensemble
from vsr2.effects import library
from vsr2.ensemble import Execution, Hypotheses
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
from vsr2.ensemble.simulated.simulator import Request, Responses
from vsr2.errors import DiagnosisError, ResultError
from vsr2.report.causes_figure import causes_figure
from vsr2.report.messages import found_causes
from vsr2.report.messages.found_causes import causes_text
from vsr2.report.pages import plain

BOX = {
    "name": "box",
    "engine": {"mode": "fast"},
    "rock": {"shape": "box", "size": [0.4, 0.55, 0.95], "density": 2700.0},
    "motion": {"mode": "all_recordings", "folder": "."},
    "outcome": {"tail": 1.0},
}
OFFERED = {name: library()[name] for name in ("table_gain", "table_bandwidth", "friction_rate")}
ASKED = Hypotheses(library=OFFERED, contact_family=())
PLANTED = {"table_gain": (0.5,)}


def scene():
    return study_from_mapping(BOX, base=Path())


@pytest.fixture(scope="module", autouse=True)
def few_particles():
    """Enough for what is asked here, at a tenth of the time."""
    with pytest.MonkeyPatch.context() as patch:
        few = replace(HELD_OUT_CAUSES, particles=40, everything=40, folds=4)
        patch.setattr("vsr2.causes.margins.held_out_causes.HELD_OUT_CAUSES", few)
        patch.setattr("vsr2.causes.causes.SAMPLER", replace(SAMPLER, final=SAMPLER.particles))
        yield


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    """Outcomes under motions that are stronger by half, and draws that no search has."""
    shaken = shaken_campaign(8, 4, duration=1.0, pga_g=(0.4, 1.1), session_size=8)
    truth = SceneSimulator(shaken, scene(), hypotheses=ASKED, seed=77)
    acting = tuple(PLANTED.items())
    ends = truth.run([Request(i, acting, 3, 1) for i in range(len(shaken))]).overturned
    trials = [replace(t, overturned=bool(e)) for t, e in zip(shaken.trials, ends, strict=True)]
    return replace(shaken, trials=tuple(trials))


@pytest.fixture(scope="module")
def half(campaign) -> Campaign:
    """Half of its trials, of all motions."""
    return campaign.select(np.arange(len(campaign)) % 4 < 2)


@pytest.fixture(scope="module")
def found(campaign, tmp_path_factory):
    folder = tmp_path_factory.mktemp("causes")
    result = find_causes(
        campaign, scene(), out=folder, scenes=SCENES.least, hypotheses=ASKED,
        execution=Execution(threads=1),
    )  # fmt: skip
    return result, folder


def test_the_size_of_the_planted_cause_is_held(campaign, found) -> None:
    result, _ = found
    assert 0.2 < np.mean(campaign.overturned) < 0.8
    acting = result.acting
    assert set(acting) == set(OFFERED)
    assert acting["table_gain"] > 0.8
    # One expects one and a half of three: what 32 outcomes tell nothing of keeps its prior.
    assert acting["table_bandwidth"] == pytest.approx(0.5, abs=0.1)
    rows = {row["name"]: row["parameters"] for row in result.content["causes"]}
    low, high = rows["table_gain"]["change"]["interval"]
    assert 0 < low < 0.5 < high
    assert rows["table_bandwidth"]["corner"]["unit"] == "Hz"
    sets = result.content["together"]
    assert sum(one["probability"] for one in sets) == pytest.approx(1.0)
    waterfall = result.content["held_out"]["waterfall"]
    assert len(waterfall) == 4
    assert waterfall[1]["causes"] == ["table_gain"]
    assert "table_gain" in causes_text(result)


def test_every_key_is_explained(found) -> None:
    page = (Path(__file__).parents[2] / "docs" / "reference" / "outputs.md").read_text()
    content = json.loads(found[0].to_json())
    jsonschema.Draft202012Validator.check_schema(causes_schema())
    jsonschema.validate(content, causes_schema())
    assert set(content) == set(causes_schema()["properties"])
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(content | {"together": "registration"}, causes_schema())
    held_out = content["held_out"]
    parts = (content, content["emulator"], held_out, held_out["all"], content["causes"][0])
    for part in (*parts, held_out["likely"], held_out["controls"], held_out["logistic"]):
        lacking = [key for key in part if f"`{key}`" not in page]
        assert lacking == []
    for key in ("scene", "scene_effects", "priors", "seed", "constants", "simulations"):
        assert key in content["provenance"]


def test_scatter_is_no_cause(found) -> None:
    """What fitted scatter closes is kept apart from what causes close beyond it."""
    held_out = found[0].content["held_out"]
    scatter, beyond = held_out["scatter_alone"], held_out["beyond_scatter"]
    nothing = held_out["waterfall"][0]
    assert nothing["causes"] == []
    assert scatter == {"loss": nothing["loss"], "closure": nothing["closure"]}
    together = held_out["all"]["closure"]["value"]
    assert scatter["closure"]["value"] + beyond["value"] == pytest.approx(together)
    # Of equal replicates, so narrower than the two closures apart would make it.
    low, high = beyond["ci95"]
    assert low < beyond["value"] < high
    curve = held_out["logistic"]["closure"]["value"]
    assert curve + held_out["beyond_logistic"]["value"] == pytest.approx(together)
    text = " ".join(causes_text(found[0]).split())
    said = [f"{one['value']:.3f} [{one['ci95'][0]:.3f}, {one['ci95'][1]:.3f}]" for one in (
        scatter["closure"], beyond, held_out["all"]["closure"],
    )]  # fmt: skip
    assert (
        f"of the gap fitted scatter alone, which is no cause, closes {said[0]}; "
        f"causes close a further {said[1]}; together {said[2]}"
    ) in text
    for label, value in (("scatter alone", scatter["closure"]), ("causes beyond scatter", beyond)):
        assert f"{label} {value['value']:.3f} [" in text
    assert "causes beyond the logistic curve" in text


def test_what_is_likely_in_each_fold_is_judged(found) -> None:
    result, folder = found
    likely = result.content["held_out"]["likely"]
    assert likely["of"] == 4
    assert likely["folds"]["table_gain"] == 4
    with (folder / "held_out.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    own = np.array([float(row["likely"]) for row in rows])
    np.testing.assert_allclose(own, result.held_out["likely"])
    assert likely["loss"]["value"] < result.content["held_out"]["as_it_is"]["loss"]["value"]
    assert "outside each of 4 folds: table_gain in 4" in causes_text(result)


def test_folds_sum_to_the_campaign(campaign, found) -> None:
    result, folder = found
    with (folder / "folds.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    overturned = campaign.overturned > 0
    trials = np.array([int(row["trials"]) for row in rows])
    assert trials.sum() == len(overturned)
    assert sum(int(row["overturned"]) for row in rows) == overturned.sum()
    for name in ("all", "likely"):
        wrong = ((result.held_out[name] > 0.5) != overturned).sum()
        assert sum(int(row[f"wrong_{name}"]) for row in rows) == wrong
        loss = np.array([float(row[f"loss_{name}"]) for row in rows])
        mean = result.content["held_out"][name]["loss"]["value"]
        assert (loss * trials).sum() / trials.sum() == pytest.approx(mean, abs=1e-5)
    assert all("table_gain" in row["likely_causes"].split() for row in rows)


def test_a_campaign_without_a_gap_has_scores(campaign, found) -> None:
    """No simulation is predicted perfectly by others, and none worse than by a guess."""
    held_out = found[0].content["held_out"]
    scores = held_out["floor"]["scores"]
    assert set(scores) == {"accuracy", "precision", "recall", "objective"}
    low, high = scores["objective"]["ci95"]
    assert 0.5 < low <= scores["objective"]["value"] <= high <= 1
    mean = np.mean([scores[name]["value"] for name in ("accuracy", "precision", "recall")])
    assert scores["objective"]["value"] == pytest.approx(mean)


def test_the_scores_of_a_campaign_without_a_gap_are_those_of_its_simulations() -> None:
    """Two trials that always end alike, and a third that overturned once in three."""
    ends = np.array([[1.0, 0, 1], [1, 0, 0], [1, 0, 0]])
    scores = _floor_scores(Ensemble(ends, np.zeros((3, 3, 0))))
    # The first is mistaken in the third trial; the others are predicted by one each way: 1/2.
    assert scores["accuracy"]["value"] == pytest.approx((2 / 3 + 1 + 1) / 3)
    assert scores["precision"]["value"] == pytest.approx(1.0)
    assert scores["recall"]["value"] == pytest.approx((1 / 2 + 1 + 1) / 3)


def test_without_a_gap_nothing_is_closed(found) -> None:
    content = json.loads(found[0].to_json())
    none = {"value": None, "ci95": None}
    held_out = content["held_out"]
    for part in (
        held_out["all"],
        held_out["likely"],
        held_out["scatter_alone"],
        *held_out["controls"].values(),
    ):
        part["closure"] = none
    held_out |= dict.fromkeys(("beyond_scatter", "beyond_controls", "beyond_logistic"), none)
    jsonschema.validate(content, causes_schema())
    without = replace(found[0], content=content)
    assert "no closure is given" in causes_text(without)
    assert causes_figure(content).axes[1].get_title() == ""


def test_the_figure_shows_scatter_as_no_cause(found) -> None:
    """In one colour with the controls, and beside what causes close beyond it."""
    content = found[0].content
    panel = causes_figure(content).axes[1]
    names = [label.get_text() for label in panel.get_yticklabels()]
    colours = [bar.get_facecolor() for bar in panel.patches]
    assert len(names) == len(colours)
    of = dict(zip(names, colours, strict=True))
    assert of["scatter fitted"] == of["control: rescaled"]
    assert of["scatter fitted"] not in (of[plain("+ table_gain")], of["with all effects"])
    legend = dict(zip(*reversed(panel.get_legend_handles_labels()), strict=True))
    assert legend["no cause"].patches[0].get_facecolor() == of["scatter fitted"]
    held_out = content["held_out"]
    beyond = held_out["beyond_scatter"]
    for number in (held_out["scatter_alone"]["closure"]["value"], beyond["value"], *beyond["ci95"]):
        assert f"{number:.2f}" in panel.get_title()


def test_what_a_search_cost_and_what_it_ran_on_are_stated(found) -> None:
    provenance = found[0].content["provenance"]
    assert 0 < provenance["search_time_s"] < provenance["wall_time_s"]
    assert provenance["threads"] == 1
    assert 0 < provenance["simulated"] <= provenance["simulations"]
    assert provenance["build"] == build_facts()
    minutes = [provenance["wall_time_s"] / 60, provenance["search_time_s"] / 60]
    text = causes_text(found[0])
    assert f"took {minutes[0]:.1f} min with 1 thread, {minutes[1]:.1f} of them for" in text


def test_a_finished_search_with_another_seed_is_not_replaced(campaign, found) -> None:
    _, folder = found
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    with pytest.raises(ResultError, match="a search for causes of another scene, campaign, seed"):
        find_causes(
            campaign, scene(), out=folder, scenes=SCENES.least, hypotheses=ASKED, seed=1,
            execution=Execution(threads=1),
        )  # fmt: skip
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
    first, *others = campaign.trials
    flipped = (replace(first, overturned=not first.overturned), *others)
    with pytest.raises(ResultError, match="a search for causes of another scene, campaign, seed"):
        find_causes(
            replace(campaign, trials=flipped), scene(), out=folder, scenes=SCENES.least,
            hypotheses=ASKED, execution=Execution(threads=1),
        )  # fmt: skip
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_threads_and_what_is_there_change_no_byte(campaign, found, tmp_path) -> None:
    result, folder = found
    (tmp_path / "again").mkdir()
    kept = (folder / "simulations.jsonl").read_bytes()
    half = kept[: len(kept) // 2].rsplit(b"\n", 1)[0] + b"\n"
    (tmp_path / "again" / "simulations.jsonl").write_bytes(half)
    again = find_causes(
        campaign, scene(), out=tmp_path / "again", scenes=SCENES.least, hypotheses=ASKED,
        execution=Execution(threads=2), seed=np.int64(0),
    )  # fmt: skip
    first, second = (json.loads(one.to_json()) for one in (result, again))
    for content in (first, second):
        for volatile in ("created", "wall_time_s", "search_time_s", "threads", "simulated"):
            del content["provenance"][volatile]
    assert first == second
    for name in ("causes.csv", "held_out.csv", "folds.csv"):
        assert (folder / name).read_bytes() == (tmp_path / "again" / name).read_bytes()


def test_the_corrected_scene_can_be_run_and_searched_again(found) -> None:
    result, folder = found
    likely = {name for name, acts in result.acting.items() if acts >= 0.5}
    assert "table_gain" in likely
    assert set(result.content["corrected"]) == likely
    study = load_study(folder / "corrected.yaml", check_files=False)
    assert set(study.effects) == likely


def test_a_cause_that_no_study_can_add_does_not_cost_the_others_their_scene() -> None:
    """The scene has a step at another date than the likely one."""
    own = study_from_mapping(
        {**BOX, "effects": {"session": {"at": 0.6, "friction_factor": 0.8}}}, base=Path()
    )
    rows = [
        {"name": name, "acts": 0.9, "parameters": {k: {"mean": v} for k, v in values.items()}}
        for name, values in (
            ("table_gain", {"change": 0.1}),
            ("session", {"at": 0.2, "friction_factor": 0.9}),
            ("slenderness", {"change": -0.05}),
        )
    ]
    corrected, added, not_stated = _corrected(own, rows)
    assert corrected is not None
    assert set(corrected.effects) == {"session", "table_gain", "slenderness"}
    assert corrected.effects["session"]["at"] == 0.6
    assert list(added) == ["table_gain", "slenderness"]
    assert not_stated == ["session"]
    content = {"corrected": added, "not_stated": not_stated}
    assert found_causes._corrected(content) == (
        "the corrected scene adds table_gain, slenderness; no study can add session to the scene"
    )


def test_the_verb_writes_what_the_function_does(half, tmp_path, capsys) -> None:
    save_campaign(half, tmp_path / "campaign")
    study = tmp_path / "box.yaml"
    study.write_text(
        json.dumps({**BOX, "motion": {"mode": "all_recordings", "folder": "campaign/motions"}})
    )
    names = [name for name in library() if name not in OFFERED]
    excluded = [part for name in names for part in ("--exclude", name)]
    run(
        "campaign", "causes", study, tmp_path / "campaign", "--out", tmp_path / "out",
        "--scenes", str(SCENES.least), "--threads", "2", "--json", "--quiet",
        "--posterior-draws", "3", *excluded,
    )  # fmt: skip
    content = json.loads(capsys.readouterr().out)
    assert {row["name"] for row in content["causes"]} == set(OFFERED)
    assert content == json.loads((tmp_path / "out" / "causes.json").read_text())
    written = [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
    for path in written:
        assert any(path.relative_to(tmp_path / "out").match(pattern) for pattern in FILES), path
    names = {path.name for path in written}
    assert {"causes.png", "draw_000.yaml", "draw_002.yaml"} <= names
    assert "draw_003.yaml" not in names
    draw = load_study(tmp_path / "out" / "corrected_draws" / "draw_000.yaml", check_files=False)
    assert set(draw.effects) <= set(OFFERED)


def test_drawn_scenes_are_a_sample_of_what_acts(tmp_path) -> None:
    """Particles of one descent lie beside each other: here the second half has the effect."""
    space = replace(cause_space(library()), names=("friction",))
    points = space.draw(1000, np.random.default_rng(3))
    acts = np.zeros((1000, 2), dtype=bool)
    acts[500:, 0] = True
    still = np.zeros(1000)
    particles = Particles(points, acts, np.zeros((1000, 1)), still, np.zeros((1000, 2)), still)
    model = SimpleNamespace(space=space, names=space.all_names)
    study = study_from_mapping(BOX, base=tmp_path)
    drawn = _drawn(study, model, particles, 100, np.random.default_rng(0))
    assert len(drawn) == 100
    # 4 standard deviations of a binomial share.
    assert abs(sum("friction" in one.effects for one in drawn) - 50) <= 20
    assert len({json.dumps(one.effects) for one in drawn if one.effects}) > 20


def test_sizes_of_angles_and_of_what_may_be_off() -> None:
    """As a diagnosis gives them: angles about their direction, infinite nulls by their inverse."""
    filtered = library()["input_filter"].parameters[0]
    corner = parameter_sizes(filtered, np.array([10.0, 30.0, np.inf]))
    assert corner["mean"] == pytest.approx(3 / (1 / 10 + 1 / 30))
    assert corner["interval"] == [10.0, None]
    off = parameter_sizes(filtered, np.full(3, np.inf))
    assert off == {"mean": None, "interval": [None, None]}
    azimuth = library()["com_offset"].parameters[1]
    around = parameter_sizes(azimuth, np.array([300.0, 310.0, 320.0, 5.0, 355.0]))
    assert 0 <= around["mean"] < 360
    assert around["interval"][0] == pytest.approx(302)
    assert 360 < around["interval"][1] < 366


def test_results_go_into_a_new_folder_or_none(found, tmp_path) -> None:
    result, folder = found
    paths = result.save(tmp_path / "new" / "folder")
    assert {path.name for path in paths} <= set(FILES)
    assert (tmp_path / "new/folder/causes.json").read_bytes() == (
        folder / "causes.json"
    ).read_bytes()
    (tmp_path / "file").touch()
    with pytest.raises(DiagnosisError, match="cannot be used"):
        result.save(tmp_path / "file")


def shaken_by(monkeypatch, rule):
    """Outcomes of a campaign by a rule on requests, without simulations."""

    def run(self, requests):
        ends = np.array([float(rule(one)) for one in requests])
        return Responses(ends, np.where(ends > 0.5, np.pi, 0.1), None)

    monkeypatch.setattr(SceneSimulator, "run", run)


def far(request, threshold):
    """Whether a motion overturns a rock that sharp edges make safe."""
    gain, radius = (
        dict(request.effects).get(name, (0.0,))[0] for name in ("table_gain", "table_bandwidth")
    )
    return np.log1p(gain) + 20 * radius > threshold[request.trial]


def searched(campaign, **asked):
    return find_causes(
        campaign, scene(), scenes=SCENES.least + 3, execution=Execution(threads=1),
        hypotheses=replace(ASKED, **asked),
    )  # fmt: skip


def test_a_trial_that_always_fails_is_no_witness(half, monkeypatch) -> None:
    threshold = np.random.default_rng(0).normal(0.1, 0.3, len(half))
    shaken_by(monkeypatch, lambda one: np.nan if one.trial == 3 else far(one, threshold))
    result = searched(half)
    assert result.held_out["all"][3] == 0.5
    assert all(np.isfinite(p).all() for p in result.held_out.values())
    assert json.loads(result.to_json())["emulator"]["used"] == SCENES.least + 3


def test_simulations_that_all_fail_are_refused(half, monkeypatch) -> None:
    shaken_by(monkeypatch, lambda one: np.nan)
    with pytest.raises(
        DiagnosisError, match="too few trials end with an outcome; try the scene with"
    ):
        searched(half)


@pytest.mark.parametrize("always", [True, False])
def test_a_scene_in_which_nothing_matters_says_so(half, monkeypatch, always) -> None:
    shaken_by(monkeypatch, lambda one: always)
    result = searched(half)
    assert json.loads(result.to_json())["emulator"]["error"] is None
    assert "equal in all of them, and tell nothing" in causes_text(result)


def test_scores_that_do_not_exist_are_null(half, monkeypatch) -> None:
    threshold = np.full(len(half), 0.9)
    shaken_by(monkeypatch, lambda one: far(one, threshold))
    trials = [replace(t, overturned=i == 5) for i, t in enumerate(half.trials)]
    result = searched(replace(half, trials=tuple(trials)))
    assert (result.held_out["all"] < 0.5).all()
    scores = json.loads(result.to_json())["held_out"]["scores"]
    assert scores["precision"] == {"value": None, "ci95": None}
    assert scores["log_loss"]["value"] > 0
    assert "precision" in causes_text(result)


def test_the_strength_of_the_motion_can_be_left_out(half, monkeypatch) -> None:
    threshold = np.random.default_rng(0).normal(0.1, 0.3, len(half))
    shaken_by(monkeypatch, lambda one: far(one, threshold))
    result = searched(half, exclude=("table_gain",))
    assert set(result.acting) == set(OFFERED) - {"table_gain"}
    assert result.content["excluded"] == ["table_gain"]
    assert result.content["motion_stronger_by"] == {"mean": 0.0, "interval": [0.0, 0.0]}
    assert not any("table_gain" in name for name in result.held_out)


def test_what_cannot_be_asked_is_refused_before_any_simulation(campaign) -> None:
    with pytest.raises(DiagnosisError, match=f"scenes is 3; give {SCENES.least} or more"):
        find_causes(campaign, scene(), scenes=3)
    with pytest.raises(DiagnosisError, match=f"posterior draws: -1; give 0 to {SAMPLER.particles}"):
        find_causes(campaign, scene(), posterior_draws=-1)
    with pytest.raises(DiagnosisError, match="seed is -1"):
        find_causes(campaign, scene(), seed=-1)
    standing = replace(
        campaign, trials=tuple(replace(t, overturned=False) for t in campaign.trials)
    )
    with pytest.raises(DiagnosisError, match="none overturned; causes need both kinds"):
        find_causes(standing, scene())
    fallen = replace(campaign, trials=tuple(replace(t, overturned=True) for t in campaign.trials))
    with pytest.raises(DiagnosisError, match="none stood"):
        find_causes(fallen, scene())
    one = campaign.select(np.asarray(campaign.motion_ids) == campaign.motion_ids[0])
    outcomes = [i % 2 == 0 for i in range(len(one))]
    mixed = replace(
        one,
        trials=tuple(replace(t, overturned=o) for t, o in zip(one.trials, outcomes, strict=True)),
    )
    with pytest.raises(DiagnosisError, match="has one ground motion"):
        find_causes(mixed, scene())
    with pytest.raises(DiagnosisError, match="margins need the effect table_gain"):
        find_causes(campaign, scene(), hypotheses=Hypotheses(library={"wear": library()["wear"]}))
    stronger = replace(ASKED, priors={"table_gain.change": (0.1, 0.4)})
    with pytest.raises(DiagnosisError, match=r"prior of table_gain.change: .* exclude table_gain"):
        find_causes(campaign, scene(), hypotheses=stronger)
    alone = Hypotheses(library={"table_gain": library()["table_gain"]})
    with pytest.raises(DiagnosisError, match="no effect is left"):
        find_causes(campaign, scene(), hypotheses=alone)
