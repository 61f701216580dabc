"""A study that states a tolerance in place of a time step, and every verb that simulates it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from command_line import run
from diagnosis_samples import few_effects, few_simulations
from vsr2 import Study, diagnose, load_study, run_batch
from vsr2.analysis import TimeStepWarning, choose_time_step, compare_time_steps
from vsr2.analysis.time_steps import TIME_STEPS, drawn_trials
from vsr2.campaign import RunOptions, load_campaign, save_campaign, simulate_campaign
from vsr2.causes.margins.held_out_causes import HELD_OUT_CAUSES
from vsr2.causes.margins.simulated_scenes import SCENES
from vsr2.config import dump_study
from vsr2.effects import library
from vsr2.ensemble import campaign_step_trials
from vsr2.errors import ConfigError, ResultError
from vsr2.fragility import fragility_step_trials, load_fragility
from vsr2.simulation import Simulation, study_trials

SCENE = """
name: box
seed: 3
rock: {shape: box, size: [0.25, 0.5, 1.0], density: 2700.0, start: {mode: yaw, yaw: 30.0}}
outcome: {tail: 1.0}
output: {log_every: 0}
"""
MOTION = """
motion:
  mode: grid_cosine
  pga_g: {min: 0.3, max: 0.6, step: 0.1}
  pgv_pga_s: {min: 0.06, max: 0.18, step: 0.03}
"""
"""The block and the motions of configs/block_grid.yaml, fewer of them."""
WIDE, NARROW = 0.5, 1e-6
"""Tolerances that every step keeps, and none."""
CALIBRATION = """
campaign: campaign
parameters:
  yaw: {keys: [rock.start.yaw], range: [0.0, 20.0], unit: deg}
method: {kind: joint, design: 2, refine: 0, profile_points: 0}
folds: 0
replicates: 1
resamples: 100
"""
FRAGILITY = f"{MOTION}fragility: {{measures: [pga_g], replicates: 1}}\n"
KEPT = ("table_gain", "friction", "catch")
"""Effects that a search for causes looks for here."""
EFFORT = ("--campaigns", 24, "--no-how-far", "--threads", 1)
Verb = Callable[[Path, Path, Path], Any]


@contextmanager
def quick() -> Iterator[None]:
    with few_simulations(), few_effects("friction", "catch"):
        yield


@pytest.fixture(autouse=True)
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two steps, a start of each motion and few halvings: what is chosen counts, not how well."""
    few = replace(TIME_STEPS, steps=(0.001, 0.002), replicates=1, halvings=3)
    for module in ("time_steps", "time_step_choice"):
        monkeypatch.setattr(f"vsr2.analysis.{module}.TIME_STEPS", few)
    monkeypatch.setitem(compare_time_steps.__kwdefaults__, "replicates", 1)
    monkeypatch.setattr(compare_time_steps, "__defaults__", (few.steps,))


def written(folder: Path, engine: str, more: str = MOTION) -> Path:
    path = folder / "study.yaml"
    path.write_text(f"{SCENE}engine: {{mode: fast, {engine}}}\n{more}")
    return path


def study(tolerance: float) -> Study:
    return Study.from_dict(
        {
            "rock": {"shape": "box", "size": [0.25, 0.5, 1.0], "density": 2700.0},
            "engine": {"mode": "fast", "time_step_tolerance": tolerance},
            "motion": {
                "mode": "grid_cosine",
                "pga_g": {"min": 0.3, "max": 0.6, "step": 0.1},
                "pgv_pga_s": {"min": 0.06, "max": 0.18, "step": 0.03},
            },
        }
    )


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("measured")
    made = simulate_campaign(load_study(written(folder, "time_step: 0.002")), run=RunOptions(1))
    save_campaign(made, folder / "campaign")
    return folder / "campaign"


# What is chosen.


def test_the_step_is_the_longest_that_surely_keeps_the_tolerance() -> None:
    given = study(WIDE)
    chosen, choice = choose_time_step(given, threads=1)
    assert choice is not None
    rows = compare_time_steps(given, threads=1)
    assert [one.time_step for one in choice.found] == [one.time_step for one in rows]
    assert [one.margin_change for one in choice.found] == [one.margin_change for one in rows]
    assert choice.kept
    assert chosen.engine.time_step == choice.time_step == 0.002
    assert rows[1].within(WIDE)
    # With the step in it is the study that states it.
    assert chosen == given.at_time_step(0.002)
    assert chosen.engine.time_step_tolerance is None


def test_where_none_keeps_it_the_default_is_taken_with_a_warning() -> None:
    with pytest.warns(TimeStepWarning, match=r"tolerance 1e-06: .* 1 ms .*larger.*--replicates"):
        chosen, choice = choose_time_step(study(NARROW), threads=1)
    assert choice is not None
    assert not choice.kept
    assert chosen.engine.time_step == choice.time_step == 0.001


def test_too_few_motions_are_said_before_any_is_run(monkeypatch: pytest.MonkeyPatch) -> None:
    one = study(WIDE).model_copy(update={"motion": load_single()})
    monkeypatch.setattr("vsr2.analysis.time_steps.run_batch", None)
    with pytest.warns(TimeStepWarning, match=r"1 motions; .* needs 8; give more motions"):
        chosen, choice = choose_time_step(one)
    assert choice is not None
    assert (choice.found, chosen.engine.time_step) == ((), 0.001)


def load_single() -> Any:
    motion = {"mode": "single_cosine", "pga_g": 0.4, "pgv_pga_s": 0.1}
    rock = {"shape": "box", "size": [1.0, 1.0, 1.0], "mass": 1.0}
    return Study.from_dict({"rock": rock, "motion": motion}).motion


def test_a_study_without_a_tolerance_comes_back_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vsr2.analysis.time_steps.run_batch", None)
    given = study(WIDE).at_time_step(0.001)
    chosen, choice = choose_time_step(given)
    assert chosen is given
    assert choice is None


def test_the_choice_depends_on_no_thread_and_again_is_the_same() -> None:
    first, *others = [choose_time_step(study(WIDE), threads=n)[1] for n in (1, 2, 1)]
    assert first is not None
    for other in others:
        assert other is not None
        assert other.to_json() == first.to_json()


def test_a_step_that_the_study_refuses_ends_the_comparison() -> None:
    def trials_of(given: Study) -> list[Any]:
        if given.engine.time_step > 0.001:
            raise ConfigError("too coarse")
        return study_trials(given)

    steps = (0.0005, 0.001, 0.002, 0.004)
    rows = compare_time_steps(study(WIDE), steps, trials_of=trials_of, threads=1)
    assert [one.time_step for one in rows] == [0.0005, 0.001]
    with pytest.raises(ConfigError, match="too coarse"):
        compare_time_steps(study(WIDE), (0.001, 0.002), trials_of=trials_of, threads=1)


def test_one_trial_of_each_motion_is_drawn_and_no_more_than_the_bound() -> None:
    names = [f"motion {i % 120}" for i in range(360)]
    drawn = drawn_trials(names, 5)
    assert len(drawn) == TIME_STEPS.motions == len({names[i] for i in drawn})
    assert drawn == sorted(drawn) == drawn_trials(names, 5) != drawn_trials(names, 6)
    assert drawn_trials(["a", "b", "c"], 0) == [0, 1, 2]


def test_trials_of_a_campaign_are_one_of_each_motion(campaign: Path) -> None:
    measured = load_campaign(campaign)
    trials = campaign_step_trials(measured)(study(WIDE).at_time_step(0.002))
    assert len(trials) == len(set(measured.motion_ids.tolist())) == len(measured)
    assert {trial.scene.engine.time_step for trial in trials} == {0.002}


def test_trials_of_a_fragility_study_are_one_of_each_motion(tmp_path: Path) -> None:
    more = f"{MOTION}fragility: {{azimuths: [0, 30], replicates: 2, jitter: {{yaw: 1.0}}}}\n"
    loaded = load_fragility(written(tmp_path, f"time_step_tolerance: {WIDE}", more))
    trials = fragility_step_trials(loaded)(loaded.study.at_time_step(0.002))
    assert len({trial.motion.name for trial in trials}) == len(trials) == 20


# The key.


def test_both_keys_together_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path, "time_step: 0.001, time_step_tolerance: 0.02")
    wanted = r"engine\.time_step_tolerance: .*engine\.time_step states one \(0\.001 s\)"
    with pytest.raises(ConfigError, match=wanted):
        load_study(path)
    with pytest.raises(ConfigError, match=wanted):
        run("config", "check", path)
    kept = load_study(path, overrides=["engine.time_step_tolerance=null"])
    assert kept.engine.time_step == 0.001


@pytest.mark.parametrize("tolerance", [0, -0.1, 1.5, True, "0.02"])
def test_what_is_no_tolerance_is_refused(tolerance: object) -> None:
    with pytest.raises(ConfigError, match=r"engine\.time_step_tolerance"):
        study(tolerance)  # type: ignore[arg-type]


def test_a_study_is_written_with_its_tolerance_or_with_its_step(tmp_path: Path) -> None:
    given = study(WIDE)
    for one, key in ((given, "time_step_tolerance"), (given.at_time_step(0.002), "time_step")):
        text = dump_study(one)
        (tmp_path / "again.yaml").write_text(text)
        assert load_study(tmp_path / "again.yaml").engine == one.engine
        stated = set(one.model_dump()["engine"]) & {"time_step", "time_step_tolerance"}
        assert stated == {key}


@pytest.mark.parametrize(
    "use",
    [
        run_batch,
        simulate_campaign,
        lambda given: Simulation(given).run(0.1),
    ],
    ids=["run_batch", "simulate_campaign", "Simulation"],
)
def test_functions_refuse_a_step_that_is_not_chosen(use: Callable[[Study], object]) -> None:
    with pytest.raises(ConfigError, match=r"time_step_tolerance is 0\.5.*choose_time_step"):
        use(study(WIDE))


def test_a_diagnosis_refuses_a_step_that_is_not_chosen(campaign: Path) -> None:
    wanted = r"time_step_tolerance is 0\.5.*choose_time_step"
    with quick(), pytest.raises(ConfigError, match=wanted):
        diagnose(campaign, study(WIDE))


def test_a_halving_without_any_change_is_known_no_better_than_its_width() -> None:
    rows = compare_time_steps(study(WIDE), threads=1)
    assert rows[0].standard_error == 0.0
    assert rows[1].standard_error >= 2 / 2**3 / 6**0.5 / rows[1].motions ** 0.5


# The verbs.


def provenance(out: Path) -> Any:
    return json.loads((out / "provenance.json").read_text())


def ran(path: Path, campaign: Path, out: Path) -> Any:
    run("run", path, "--out", out, "--no-figures", "--threads", 1)
    return provenance(out)


def simulated(path: Path, campaign: Path, out: Path) -> Any:
    run("campaign", "simulate", path, "--out", out, "--threads", 1)
    return load_campaign(out).provenance


def fragile(path: Path, campaign: Path, out: Path) -> Any:
    path.write_text(path.read_text().replace(MOTION, FRAGILITY))
    run("fragility", path, "--out", out, "--no-figures", "--threads", 1)
    return provenance(out)


def calibrated(path: Path, campaign: Path, out: Path) -> Any:
    more = CALIBRATION.replace("campaign: campaign", f"campaign: {campaign}")
    path.write_text(path.read_text().replace(MOTION, more))
    run("calibrate", path, "--out", out, "--no-figures", "--threads", 1)
    return provenance(out)


def diagnosed(path: Path, campaign: Path, out: Path) -> Any:
    with quick():
        run("diagnose", campaign, "--scene", path, "--out", out, *EFFORT)
    return json.loads((out / "diagnosis.json").read_text())["provenance"]


def predicted(path: Path, campaign: Path, out: Path) -> Any:
    run("campaign", "predict", path, campaign, "--out", out, "--replicates", 1, "--threads", 1)
    return provenance(out)


def attributed(path: Path, campaign: Path, out: Path) -> Any:
    left_out = [part for name in library() if name not in KEPT for part in ("--exclude", name)]
    given = ("--scenes", SCENES.least, "--threads", 1)
    few = replace(HELD_OUT_CAUSES, particles=20, everything=20, judged=1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("vsr2.causes.margins.held_out_causes.HELD_OUT_CAUSES", few)
        run("campaign", "causes", path, campaign, "--out", out, *given, *left_out)
    return json.loads((out / "causes.json").read_text())["provenance"]


VERBS: dict[str, Verb] = {
    "run": ran,
    "campaign simulate": simulated,
    "fragility": fragile,
    "calibrate": calibrated,
    "diagnose": diagnosed,
    "campaign predict": predicted,
    "campaign causes": attributed,
}


@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_takes_the_step_says_it_and_keeps_how(
    verb: str,
    campaign: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = written(tmp_path, f"time_step_tolerance: {WIDE}")
    found = VERBS[verb](path, campaign, tmp_path / "out")
    said = capsys.readouterr().err
    assert "choosing the time step" in said
    assert f"vsr2 {verb}: time step 2 ms: the longest that surely keeps the tolerance 0.5" in said
    how = found["time_step"]
    assert (how["tolerance"], how["time_step"], how["kept"]) == (WIDE, 0.002, True)
    assert [row["time_step"] for row in how["compared"]] == [0.001, 0.002]
    assert (how["constants"]["motions"], how["constants"]["replicates"]) == (100, 1)
    if "study" in found:
        assert found["study"]["engine"]["time_step"] == 0.002


def test_a_comparison_with_a_reference_takes_the_step(
    campaign: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, f"time_step_tolerance: {WIDE}")
    with quick():
        run("campaign", "compare", path, campaign, "--threads", 1, "--json")
    assert json.loads(capsys.readouterr().out)["time_step"]["time_step"] == 0.002


def test_a_run_by_tolerance_is_the_run_at_its_step(tmp_path: Path) -> None:
    for engine in (f"time_step_tolerance: {WIDE}", "time_step: 0.002"):
        ran(written(tmp_path, engine), tmp_path, tmp_path / engine[:12])
    first, second = sorted(tmp_path.glob("time_step*/trials.csv"))
    drop = {"wall_time"}
    one, other = (
        [{k: v for k, v in row.items() if k not in drop} for row in rows(path)]
        for path in (first, second)
    )
    assert one == other


def rows(path: Path) -> list[dict[str, str]]:
    head, *lines = path.read_text().splitlines()
    return [dict(zip(head.split(","), line.split(","), strict=True)) for line in lines]


def test_a_run_that_is_resumed_keeps_its_step(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = written(tmp_path, f"time_step_tolerance: {WIDE}"), tmp_path / "out"
    before = ran(path, path, out)["plan_sha256"]
    capsys.readouterr()
    run("run", path, "--out", out, "--resume", "--no-figures", "--threads", 2)
    assert "nothing to do" in capsys.readouterr().out
    assert provenance(out)["plan_sha256"] == before


@pytest.mark.parametrize("verb", ["run", "fragility"])
def test_a_result_that_is_there_is_refused_before_a_step_is_chosen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, verb: str
) -> None:
    made = fragile if verb == "fragility" else ran
    path = written(tmp_path, "time_step: 0.002")
    made(path, path, tmp_path / "out")
    path.write_text(path.read_text().replace("time_step: 0.002", f"time_step_tolerance: {WIDE}"))
    monkeypatch.setattr("vsr2.analysis.time_steps.run_batch", None)
    with pytest.raises(ResultError, match="already holds a result"):
        run(verb, path, "--out", tmp_path / "out", "--threads", 1)


def test_a_verb_warns_where_no_step_keeps_the_tolerance(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, f"time_step_tolerance: {NARROW}")
    with pytest.warns(TimeStepWarning, match="no time step surely keeps it"):
        found = ran(path, path, tmp_path / "out")
    assert "time step 1 ms, the default: none surely keeps" in capsys.readouterr().err
    assert (found["time_step"]["kept"], found["study"]["engine"]["time_step"]) == (False, 0.001)


def test_shards_do_not_choose(tmp_path: Path) -> None:
    path = written(tmp_path, f"time_step_tolerance: {WIDE}")
    for part in (("--shard", "1/2"), ("--merge",)):
        with pytest.raises(ConfigError, match=r"each part would choose .*config time-step"):
            run("run", path, "--out", tmp_path / "out", *part)


def test_a_pack_states_its_step(tmp_path: Path) -> None:
    path = written(tmp_path, f"time_step_tolerance: {WIDE}")
    with pytest.raises(ConfigError, match=r"time_step_tolerance is 0\.5"):
        run("blind", "make", path, "--out", tmp_path / "pack", "--development", "--seed", 1)
    assert not (tmp_path / "pack").exists()


def test_a_check_does_not_choose(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vsr2.analysis.time_steps.run_batch", None)
    path = written(tmp_path, f"time_step_tolerance: {WIDE}")
    assert run("config", "check", path) == 0
    said = capsys.readouterr().out
    assert "time_step_tolerance: 0.5" in said
    assert "time_step: " not in said


def test_the_table_of_steps_takes_the_tolerance_of_the_study(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, f"time_step_tolerance: {WIDE}")
    run("config", "time-step", path, "--json", "--threads", 1)
    assert json.loads(capsys.readouterr().out)["tolerance"] == WIDE
