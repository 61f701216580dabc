"""One piece of work of benchmarks/throughput.py, in a process of its own.

    python benchmarks/throughput_work.py WORK ENGINE ROUND [--trials N] [--draws N] [--threads N]
                                         [--time-step S] [--given] [--know]

The vsr2 that is imported is measured: PYTHONPATH chooses it. Prints one line of JSON: how many
trials, wall and CPU time [s], that of the thread that makes the trials, the share that overturned
and how many trials have no outcome.

What acts in a campaign is a `Draw`: values by name. With `--given` draws are read as JSON from
standard input, so that several versions simulate the same campaigns; else they are drawn from all
that this version has. `--know` prints what that is in place of doing the work.

Works:

- `campaign-block`: the block of configs/blind.yaml under motions of the blind packs, as a diagnosis
  simulates it: `SceneSimulator.run` on whole campaigns, each with a fresh draw of nuisances and of
  none, one or two effects. Scenes, scaled motions, settling: everything but the draw is timed.
- `campaign-SP1`: the same with specimen SP1 in the scene of studies/lab_diagnosis.yaml under the
  laboratory's motions.
- `batch-block`, `batch-SP1`: the same trials without nuisances and effects, by `run_batch`, or the
  motions alone by MuJoCo: from the settled rock to the motion's last sample.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import importlib
import json
import os
import sys
import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from vsr2.blind.mujoco import ground_motion
from vsr2.campaign import Campaign, CampaignTrial, Specimen
from vsr2.config import Study, load_study
from vsr2.config.motion_source import AllRecordings, SingleRecording
from vsr2.motion import Record, build_recorded_motion, read_record
from vsr2.trial import Trial

Array = NDArray[np.float64]
ROOT = Path(__file__).resolve().parent.parent
LAB = Path(os.environ.get("VSR2_LAB_DATA", ROOT.parent / "shared" / "lab"))
TRIALS = {"campaign-block": 150, "campaign-SP1": 100, "batch-block": 150, "batch-SP1": 100}
"""Of a campaign or a batch."""
DRAWS = {"campaign-block": 4, "campaign-SP1": 2}
"""Simulated campaigns a round."""
STRENGTHS = (0.8, 2.4)
"""Range of peak accelerations of the block's motions, over that of uplift."""
SCALINGS = 10
"""Strengths of each of the block's motions."""
NONE, TWO = 0.1, 0.25
"""Shares of campaigns without effect and with two."""
SMALLEST = 1 / 32
"""Least size of an effect, over its range."""
FIRST_DRAW = 1000
"""Of the nuisances."""
WINDOW = 400
"""Steps of a motion that MJX and Warp run."""
ALIKE = 2e-3
"""Median distance of their rocks from MuJoCo's at the window's end that single precision leaves
[m]."""
Done = tuple[float, float, int]
"""Trials, the share of those with an outcome that overturned, and how many have none."""
Known = dict[str, dict[str, Any]]
"""What a version can draw from: `effects` and `nuisances`, each by name with what it has to have in
common with that of another version."""


class Draw(TypedDict):
    """What acts in one simulated campaign, in words that any version takes.

    Attributes:
        index: of the draw, by which a version draws what belongs to single trials.
        nuisances: the value of each that holds for the campaign; None: each trial has its own.
        effects: values of the open parameters, by the effect's name.
    """

    index: int
    nuisances: dict[str, float | None]
    effects: dict[str, dict[str, float]]


def study_of(rock: str, time_step: float | None = None) -> Study:
    """The study of `block` or `SP1`.

    Args:
        rock: which.
        time_step: [s]; None: the study's own.
    """
    overrides = ["output.log_every=0"]
    if time_step is not None:
        overrides.append(f"engine.time_step={time_step!r}")
    if rock == "block":
        return load_study(ROOT / "configs" / "blind.yaml", overrides=tuple(overrides))
    overrides.append(f"rock.file={LAB / 'models' / 'final_sp1.obj'}")
    overrides.append(f"motion.folder={LAB / 'motions'}")
    return load_study(ROOT / "studies" / "lab_diagnosis.yaml", overrides=tuple(overrides))


def block(time_step: float | None = None) -> tuple[Campaign, Study]:
    """The block's campaign, all trials that there are, and its study."""
    study = study_of("block", time_step)
    width, _, height = study.rock.size  # type: ignore[union-attr]
    records = []
    for i in range(TRIALS["campaign-block"] // SCALINGS):
        ground = ground_motion(f"m{i}", np.random.default_rng([1, i]))
        for strength in np.geomspace(*STRENGTHS, SCALINGS):
            moved = ground.displacement * (9.81 * width / height * strength)
            records.append(Record(f"m{i}-{strength:.2f}", ground.interval, displacement=moved))
    return campaign_of(records, "block"), study


def laboratory(time_step: float | None = None) -> tuple[Campaign, Study]:
    """SP1's campaign, evenly spread over the trials that have a motion, and its study."""
    with (LAB / "trials.csv").open(newline="") as file:
        named = [f"Test{int(row['test']):03d}" for row in csv.DictReader(file)]
    paths = [LAB / "motions" / f"{name}.npz" for name in named]
    paths = [path for path in paths if path.is_file()]
    chosen = np.linspace(0, len(paths) - 1, TRIALS["campaign-SP1"]).round().astype(int)
    campaign = campaign_of([read_record(paths[i]) for i in chosen], "SP1")
    return campaign, study_of("SP1", time_step)


def campaign_of(records: Sequence[Record], specimen: str) -> Campaign:
    """One trial a record."""
    trials = tuple(
        CampaignTrial(
            trial=f"T{i:03d}",
            motion=record.name,
            session=f"S{i // 20:02d}",
            order=i,
            specimen=specimen,
            motion_file=record.name,
        )
        for i, record in enumerate(records)
    )
    motions = {record.name: record for record in records}
    return Campaign(
        name="throughput", trials=trials, motions=motions, specimens={specimen: Specimen()}
    )


def thinned(campaign: Campaign, count: int) -> Campaign:
    """So many of its trials, evenly spread."""
    kept = np.linspace(0, len(campaign) - 1, min(count, len(campaign))).round().astype(int)
    return replace(campaign, trials=tuple(campaign.trials[i] for i in kept))


def known(library: Any, nuisances: Mapping[str, Any]) -> Known:
    """What this version can draw from.

    An effect is described by its open parameters, whose values a draw has. Others stay at their
    null. A nuisance that holds for a campaign is described by the meaning of its value, one that
    is drawn for each trial by all that it is, because the version draws it.
    """
    part = simulated_part("library")
    effects = {
        name: sorted(p.name for p in part.free_parameters(effect))
        for name, effect in library.items()
        if part.sides(effect)
    }
    described = {
        name: [one.direction, one.relative] if holds_for_campaign(one) else one.to_json()
        for name, one in nuisances.items()
    }
    return {"effects": effects, "nuisances": described}


def usual_nuisances() -> dict[str, Any]:
    """Those that a diagnosis draws, contact models among them, by names that tell them apart."""
    usual = simulated_part("hypotheses").Hypotheses()
    every = (*usual.nuisances, *usual.contact_family)
    return {f"{one.acting.name}.{one.parameter} of a {one.scope}": one for one in every}


def holds_for_campaign(nuisance: Any) -> bool:
    """Whether its value is drawn once a campaign."""
    return str(nuisance.scope) == "campaign"


def drawn(
    library: Any, nuisances: Mapping[str, Any], common: Known, indices: Iterable[int]
) -> list[Draw]:
    """What acts in campaigns: nuisances, and effects that are known.

    Args:
        library: of this version.
        nuisances: of this version.
        common: names of those that are drawn.
        indices: of the draws.
    """
    normal = simulated_part("simulator").nuisance_normal
    effects = {name: effect for name, effect in library.items() if name in common["effects"]}
    acting = {name: one for name, one in nuisances.items() if name in common["nuisances"]}
    wide = [name for name, one in acting.items() if holds_for_campaign(one)]
    draws = []
    for index in indices:
        values: dict[str, float | None] = dict.fromkeys(acting)
        normals = normal(0, len(wide), FIRST_DRAW + index).tolist()
        for name, z in zip(wide, normals, strict=True):
            values[name] = acting[name].prior.value(z)
        draws.append(
            Draw(index=FIRST_DRAW + index, nuisances=values, effects=drawn_effects(effects, index))
        )
    return draws


def drawn_effects(library: Mapping[str, Any], index: int) -> dict[str, dict[str, float]]:
    """None, one or two effects at a log-uniform share of their range."""
    part = simulated_part("library")
    rng = np.random.default_rng([2, index])
    kind = rng.random()
    names = [*library]
    if kind < NONE:
        return {}
    found = {}
    for i in sorted(rng.permutation(len(names))[: 2 if kind > 1 - TWO else 1]):
        effect = library[names[i]]
        primary = len(part.primary_parameters(effect))
        shares = np.exp(rng.uniform(np.log(SMALLEST), 0.0, primary)).tolist()
        secondary = rng.random(len(part.free_parameters(effect)) - primary).tolist()
        side = int(rng.choice(part.sides(effect)))
        values = part.values_at(effect, side, shares, secondary)
        named = dict(zip((p.name for p in effect.parameters), values, strict=True))
        found[names[i]] = {p.name: named[p.name] for p in part.free_parameters(effect)}
    return found


def simulated_part(name: str) -> Any:
    """A module of simulated campaigns, which versions before 0.2.0 have elsewhere."""
    for room in ("vsr2.ensemble", "vsr2.diagnosis"):
        with contextlib.suppress(ModuleNotFoundError):
            return importlib.import_module(f"{room}.simulated.{name}")
    raise ModuleNotFoundError(f"this version has no simulated campaigns: {name}")


class Given:
    """Prior of a nuisance whose value comes from outside, whatever a version draws.

    Args:
        first: value until another is given.
    """

    sd = 1.0

    def __init__(self, first: float) -> None:
        self.given = first

    def value(self, z: float) -> float:
        """The given one."""
        return self.given


class GivenCampaigns:
    """Whole campaigns as a diagnosis simulates them, under draws that are given.

    Args:
        campaign: simulated once a draw.
        study: of its scene.
        nuisances: names of those that any of its draws has, in their order.
        threads: of the core.

    Raises:
        KeyError: this version has no such nuisance.
    """

    def __init__(
        self, campaign: Campaign, study: Study, nuisances: Collection[str], threads: int
    ) -> None:
        usual = usual_nuisances()
        self._campaign = campaign
        self._priors = {
            name: Given(usual[name].prior.value(0.0))
            for name in nuisances
            if holds_for_campaign(usual[name])
        }
        acting = tuple(
            replace(usual[name], prior=self._priors[name]) if name in self._priors else usual[name]
            for name in nuisances
        )
        hypotheses = simulated_part("hypotheses").Hypotheses(nuisances=acting, contact_family=())
        self._simulator = simulated_part("scene_simulator").SceneSimulator(
            campaign, study, hypotheses=hypotheses, threads=threads
        )

    def import_late(self, draw: Draw) -> None:
        """Import what is imported when trials run, by one of them."""
        self._run({**draw, "index": 1, "effects": {}}, range(1))

    def overturned(self, draw: Draw) -> Array:
        """1 or 0 by trial, NaN where one has no outcome.

        Raises:
            KeyError: this version has no such effect.
            ValueError: nuisances are others than those of the first draw, or an effect has no
                such parameter.
        """
        return self._run(draw, range(len(self._campaign)))

    def _run(self, draw: Draw, trials: Iterable[int]) -> Array:
        given = {name: value for name, value in draw["nuisances"].items() if value is not None}
        if given.keys() != self._priors.keys():
            raise ValueError(f"nuisances are {[*given]} and not {[*self._priors]}")
        for name, value in given.items():
            self._priors[name].given = value
        effects = tuple((name, self._values(name, own)) for name, own in draw["effects"].items())
        make = simulated_part("simulator").Request
        found = self._simulator.run([make(i, effects, draw["index"], 1) for i in trials])
        return np.asarray(found.overturned)

    def _values(self, name: str, given: Mapping[str, float]) -> tuple[float, ...]:
        """Of all parameters of an effect, in their order; those not given are at their null."""
        parameters = self._simulator.library[name].parameters
        if unknown := given.keys() - {p.name for p in parameters}:
            raise ValueError(f"{name} has no parameter {sorted(unknown)[0]}")
        return tuple(float(given.get(p.name, p.null)) for p in parameters)


def library_of(campaign: Campaign, study: Study) -> Any:
    """Effects that this version can have in the campaign, by name."""
    return simulated_part("scene_simulator").SceneSimulator(campaign, study).library


def simulated(
    campaign: Campaign, study: Study, draws: Sequence[Draw], threads: int
) -> Callable[[], Done]:
    """Whole campaigns, one a draw."""
    given = GivenCampaigns(campaign, study, [*draws[0]["nuisances"]], threads)
    given.import_late(draws[0])

    def run() -> Done:
        overturned = np.concatenate([given.overturned(draw) for draw in draws])
        return overturned.size, float(np.nanmean(overturned)), int(np.isnan(overturned).sum())

    return run


def trials_of(campaign: Campaign, study: Study) -> list[Trial]:
    """The campaign's trials as the study says, without nuisances and effects."""
    from vsr2.scene import build_scene

    scene, motion = build_scene(study), study.motion
    given: dict[str, Any] = {}
    if isinstance(motion, SingleRecording | AllRecordings):
        given = {"channel": motion.channel, "filter": motion.filter}
    return [
        Trial(
            scene=scene,
            motion=build_recorded_motion(record, study.engine.time_step, **given),
            settling=study.settling,
            outcome=study.outcome,
            output=study.output,
        )
        for record in (campaign.motions[str(trial.motion_file)] for trial in campaign.trials)
    ]


def batch(trials: list[Trial], threads: int) -> Callable[[], Done]:
    """All trials by `run_batch`: settling, motion and tail."""
    from vsr2.simulation import run_batch

    run_batch(trials[:1], threads=1)

    def run() -> Done:
        result = run_batch(trials, threads=threads)
        failed = result["outcome"] == "failed"
        overturned = result["outcome"][~failed] == "overturned"
        return len(trials), float(np.mean(overturned)), int(failed.sum())

    return run


def rolled_out(trials: list[Trial], threads: int) -> Callable[[], Done]:
    """All motions by `mujoco.rollout`."""
    from mujoco_rock import MujocoRock

    rock = MujocoRock(trials[0].scene)
    forces = [rock.forces(trial.motion) for trial in trials]
    rock.overturned([forces[0][:100]], threads)

    def run() -> Done:
        return len(forces), rock.overturned(forces, threads) / len(forces), 0

    return run


def together(trials: list[Trial], engine: str) -> Callable[[], Done]:
    """A window of all motions, round their strongest step, in MJX or Warp.

    Trials are counted by the share of their steps that the window is.

    Raises:
        SystemExit: rocks end elsewhere than in MuJoCo.
    """
    from mujoco_batched import JaxBatch, WarpBatch, stepped_by_mujoco
    from mujoco_rock import MujocoRock

    rock = MujocoRock(trials[0].scene)
    driven = [rock.forces(trial.motion) for trial in trials]
    forces = np.stack([window(force) for force in driven])
    made = (JaxBatch if engine == "mjx" else WarpBatch)(rock, forces)
    apart = np.abs(made.run() - stepped_by_mujoco(rock, forces))[:, 0]
    if not np.median(apart) < ALIKE:
        raise SystemExit(f"{engine}: rocks end {np.median(apart):.2g} m away from MuJoCo's")
    share = sum(WINDOW / len(force) for force in driven)

    def run() -> Done:
        made.run()
        return share, float("nan"), 0

    return run


def window(force: Array) -> Array:
    """`WINDOW` steps round the strongest, shape (`WINDOW`, 6)."""
    begin = int(np.abs(force[:, 0]).argmax()) - WINDOW // 2
    begin = max(0, min(begin, len(force) - WINDOW))
    return force[begin : begin + WINDOW]


def campaign_and_study(
    work: str, trials: int | None = None, time_step: float | None = None
) -> tuple[Campaign, Study]:
    """Of a work, with so many trials; None: all of them, and the study's own time step."""
    made = block if work.endswith("block") else laboratory
    campaign, study = made(time_step)
    return thinned(campaign, trials or TRIALS[work]), study


def prepared(
    options: argparse.Namespace, given: Sequence[Draw] | None = None
) -> Callable[[], Done]:
    """What is to be timed, with all that goes before it done.

    Args:
        options: of the command.
        given: what acts in campaigns; None: drawn from all that this version has.
    """
    campaign, study = campaign_and_study(options.work, options.trials, options.time_step)
    if options.work.startswith("campaign"):
        if given is None:
            count = options.draws or DRAWS[options.work]
            indices = range(options.round * count, (options.round + 1) * count)
            pools = library_of(campaign, study), usual_nuisances()
            given = drawn(*pools, known(*pools), indices)
        return simulated(campaign, study, given, options.threads)
    trials = trials_of(campaign, study)
    if options.engine == "vsr2":
        return batch(trials, options.threads)
    if options.engine == "mujoco":
        return rolled_out(trials, options.threads)
    return together(trials, options.engine)


def main() -> None:
    """Do the work once and print what it took."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("work", choices=TRIALS)
    parser.add_argument("engine", choices=("vsr2", "mujoco", "mjx", "warp"))
    parser.add_argument("round", type=int)
    parser.add_argument("--trials", type=int)
    parser.add_argument("--draws", type=int)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--time-step", type=float, help="[s]; of the study, if not given")
    parser.add_argument("--given", action="store_true", help="read draws from standard input")
    parser.add_argument("--know", action="store_true", help="print what can be drawn from")
    options = parser.parse_args()
    if options.know:
        campaign, study = campaign_and_study(options.work, options.trials, options.time_step)
        print(json.dumps(known(library_of(campaign, study), usual_nuisances())))
        return
    run = prepared(options, json.load(sys.stdin) if options.given else None)
    clocks = {"wall": time.perf_counter, "cpu": time.process_time, "making": time.thread_time}
    begin = {name: clock() for name, clock in clocks.items()}
    trials, overturned, failed = run()
    took = {name: clock() - begin[name] for name, clock in clocks.items()}
    print(json.dumps({"trials": trials, **took, "overturned": overturned, "failed": failed}))


if __name__ == "__main__":
    main()
