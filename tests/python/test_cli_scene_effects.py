"""Every verb on a scene with effects of its own: they act, or they are refused."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from cyclopts import App

from command_line import run
from diagnosis_samples import few_effects, few_simulations
from vsr2.campaign import RunOptions, load_campaign, save_campaign, simulate_campaign
from vsr2.causes.margins.acting_posterior import SAMPLER
from vsr2.causes.margins.held_out_causes import HELD_OUT_CAUSES
from vsr2.causes.margins.simulated_scenes import SCENES
from vsr2.cli.main import app
from vsr2.config import load_study
from vsr2.effects import library
from vsr2.errors import BlindError, ConfigError, SimulationError
from vsr2.simulation import Simulation

EFFECTS = {"table_gain": {"change": 0.15}, "slenderness": {"change": -0.06}}
SCENE = """
name: box
rock: {shape: box, size: [0.4, 0.55, 0.95], density: 2700.0}
contact: {rock: {lateral_friction: 0.9}, pedestal: {lateral_friction: 0.9}}
engine: {mode: fast, time_step: 0.002}
outcome: {tail: 1.0}
output: {log_every: 0}
"""
MOTION = """
motion:
  mode: grid_cosine
  pga_g: {min: 0.45, max: 0.85, step: 0.1}
  pgv_pga_s: {min: 0.1, max: 0.19, step: 0.03}
"""
CALIBRATION = """
campaign: campaign
parameters:
  yaw: {keys: [rock.start.yaw], range: [0.0, 20.0], unit: deg}
method: {kind: joint, design: 4, refine: 0, profile_points: 2}
folds: 2
resamples: 100
"""
FRAGILITY = f"{MOTION}fragility: {{measures: [pga_g], replicates: 1}}\n"
PACK = """
--engine bullet --development --seed 1 --single 0 --pair 0 --unknown 0 --none 1 --trials 20
--motions 4 --sessions 2 --catalogue 4 --quiet
""".split()  # noqa: SIM905
KEPT = ("table_gain", "friction", "catch")
"""Effects that a search for causes looks for here."""
EFFORT = ("--campaigns", 24, "--no-how-far", "--quiet", "--threads", 1)


@contextmanager
def quick() -> Iterator[None]:
    with few_simulations(), few_effects("friction", "catch"):
        yield


def scene(folder: Path, more: str = MOTION, *, effects: bool) -> Path:
    own = f"effects: {json.dumps(EFFECTS)}\n" if effects else ""
    path = folder / f"{'own' if effects else 'plain'}{len(more)}.yaml"
    path.write_text(SCENE + more + own)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of the scene without effects, and packs of the scene without and with them."""
    out = tmp_path_factory.mktemp("own")
    study = load_study(scene(out, effects=False))
    save_campaign(simulate_campaign(study, run=RunOptions(threads=1)), out / "campaign")
    with quick():
        for effects in (False, True):
            run(
                "blind", "make", scene(out, effects=effects), "--out", out / f"pack{effects}", *PACK
            )
    return out


def written(out: Path) -> str:
    """Outcomes and largest tilts of a result or a campaign."""
    return (out / "trials.csv").read_text()


def ran(folder: Path, out: Path, *, effects: bool) -> object:
    run("run", scene(folder, effects=effects), "--out", out, "--quiet", "--no-figures")
    return written(out)


def simulated(folder: Path, out: Path, *, effects: bool) -> object:
    run("campaign", "simulate", scene(folder, effects=effects), "--out", out, "--quiet")
    return load_campaign(out).overturned.tolist()


def compared(folder: Path, out: Path, *, effects: bool) -> object:
    with quick():
        return run("campaign", "compare", scene(folder, effects=effects), folder / "campaign")


def predicted(folder: Path, out: Path, *, effects: bool) -> object:
    path, given = scene(folder, effects=effects), ("--replicates", 2, "--threads", 1, "--quiet")
    run("campaign", "predict", path, folder / "campaign", "--out", out, *given)
    return (out / "predictions.csv").read_text()


def attributed(folder: Path, out: Path, *, effects: bool) -> object:
    path, given = scene(folder, effects=effects), ("--scenes", SCENES.least, "--threads", 1)
    few = replace(HELD_OUT_CAUSES, particles=20, everything=20, judged=1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("vsr2.causes.margins.held_out_causes.HELD_OUT_CAUSES", few)
        patch.setattr("vsr2.causes.causes.SAMPLER", replace(SAMPLER, final=SAMPLER.particles))
        left_out = [part for name in library() if name not in KEPT for part in ("--exclude", name)]
        run("campaign", "causes", path, folder / "campaign", "--out", out, *given, *left_out)
    return (out / "held_out.csv").read_text()


def calibrated(folder: Path, out: Path, *, effects: bool) -> object:
    study = scene(folder, CALIBRATION, effects=effects)
    run("calibrate", study, "--out", out, "--quiet", "--no-figures")
    lines = (out / "evaluations.jsonl").read_text().splitlines()
    return [one.get("predicted") for one in map(json.loads, lines)]


def fragile(folder: Path, out: Path, *, effects: bool) -> object:
    study = scene(folder, FRAGILITY, effects=effects)
    run("fragility", study, "--out", out, "--quiet", "--no-figures")
    return written(out)


def checked(folder: Path, out: Path, *, effects: bool) -> object:
    return run("config", "check", scene(folder, effects=effects))


def stepped(folder: Path, out: Path, *, effects: bool) -> object:
    return run("config", "time-step", scene(folder, effects=effects), "--threads", 1, "--json")


def found(out: Path) -> object:
    content = json.loads((out / "diagnosis.json").read_text())
    return content["none_probability"], content["gap"]["before"]


def diagnosed(folder: Path, out: Path, *, effects: bool) -> object:
    path = scene(folder, effects=effects)
    with quick():
        run("diagnose", folder / "campaign", "--scene", path, "--out", out, *EFFORT)
    return found(out)


def packed(folder: Path, out: Path, *, effects: bool) -> object:
    (listed,) = json.loads((folder / f"pack{effects}/data/pack.json").read_text())["campaigns"]
    return load_campaign(folder / f"pack{effects}/data" / listed["id"]).overturned.tolist()


def pack_diagnosed(folder: Path, out: Path, *, effects: bool) -> object:
    """The campaign of one pack, with the scene of the other or with its own."""
    shutil.copytree(folder / "packFalse/data", out / "data")
    shutil.copy(folder / f"pack{effects}/data/scene.yaml", out / "data/scene.yaml")
    with quick():
        run("blind", "diagnose", out / "data", "--out", out / "found", "--tier", "M", *EFFORT)
    (verdict,) = (out / "found").rglob("diagnosis.json")
    return found(verdict.parent)


VERBS: dict[tuple[str, ...], Callable[..., object]] = {
    ("run",): ran,
    ("campaign", "simulate"): simulated,
    ("campaign", "compare"): compared,
    ("campaign", "predict"): predicted,
    ("campaign", "causes"): attributed,
    ("calibrate",): calibrated,
    ("fragility",): fragile,
    ("config", "check"): checked,
    ("config", "time-step"): stepped,
    ("diagnose",): diagnosed,
    ("blind", "make"): packed,
    ("blind", "diagnose"): pack_diagnosed,
}
WITHOUT_A_SCENE = {
    ("view",), ("inertia",), ("motion", "info"), ("motion", "convert"), ("motion", "generate"),
    ("motion", "fuse"), ("motion", "rotate"), ("hazard",), ("new",),
    ("campaign", "import-lab"), ("campaign", "check"), ("campaign", "info"),
    ("effects", "list"), ("effects", "show"), ("effects", "check"), ("blind", "score"),
    ("config", "import-ros2"), ("config", "reference"), ("config", "schema"),
}  # fmt: skip


def verbs(of: App, path: tuple[str, ...] = ()) -> set[tuple[str, ...]]:
    inner = [name for name in of if not name.startswith("-")]
    return set().union(*(verbs(of[name], (*path, name)) for name in inner)) if inner else {path}


def test_no_verb_is_left_out() -> None:
    assert verbs(app) == WITHOUT_A_SCENE | set(VERBS)


@pytest.mark.parametrize("verb", VERBS, ids=" ".join)
def test_effects_of_the_scene_act(verb, folder, tmp_path, capsys) -> None:
    seen = []
    for effects in (False, True):
        capsys.readouterr()
        out = tmp_path / str(effects)
        seen.append((VERBS[verb](folder, out, effects=effects), capsys.readouterr().out))
    said = [text for _, text in seen]
    if verb[0] == "config":
        assert verb[1] != "check" or "slenderness" in said[1]
        assert said[0] != said[1]
    else:
        assert seen[0][0] != seen[1][0]


def test_packs_of_mujoco_refuse_effects_of_the_scene(folder, tmp_path) -> None:
    line = [one if one != "bullet" else "mujoco" for one in PACK]
    wanted = r"effects\.table_gain is \{'change': 0\.15\}, .* leave them out, or --engine bullet"
    with quick(), pytest.raises(BlindError, match=wanted):
        run("blind", "make", scene(folder, effects=True), "--out", tmp_path / "pack", *line)
    assert not list(tmp_path.iterdir())


def test_a_world_that_is_stepped_by_hand_refuses_effects(folder) -> None:
    with pytest.raises(SimulationError, match=r"effects: .*table_gain, slenderness.*leave them"):
        Simulation(scene(folder, effects=True))


@pytest.mark.parametrize(
    "line",
    [
        ("run",),
        ("campaign", "simulate", "SCENE", "--out", "OUT"),
        ("campaign", "compare", "SCENE", "CAMPAIGN"),
        ("diagnose", "CAMPAIGN", "--scene", "SCENE", "--out", "OUT"),
        ("blind", "make", "SCENE", "--out", "OUT", *PACK),
    ],
    ids=lambda line: " ".join(line[:2]),
)
def test_an_effect_that_there_is_not_is_named_with_its_line(line, folder, tmp_path) -> None:
    path = tmp_path / "slip.yaml"
    path.write_text(f"{SCENE}{MOTION}effects:\n  table_gian: {{change: 0.1}}\n")
    of = {"SCENE": path, "OUT": tmp_path / "out", "CAMPAIGN": folder / "campaign"}
    words = [of.get(word, word) for word in line]
    with (
        quick(),
        pytest.raises(ConfigError, match=r"slip\.yaml:\d+: effects\.table_gian: .*`table_gain`"),
    ):
        run(*words, *([path] if line == ("run",) else []))
    assert not (tmp_path / "out").exists()
