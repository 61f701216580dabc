"""One piece of work of benchmarks/throughput.py, in a process of its own.

    python benchmarks/throughput_work.py WORK ENGINE ROUND [--trials N] [--draws N] [--threads N]

The vsr2 that is imported is measured: PYTHONPATH chooses it. Prints one line of JSON: how many
trials, wall and CPU time [s], that of the thread that makes the trials, and the share that
overturned.

Works:

- `campaign-block`: the block of configs/blind.yaml under motions of the blind packs, as a diagnosis
  simulates it: `SceneSimulator.run` on whole campaigns, each with a fresh draw of all nuisances and
  of none, one or two effects. Drawing, scenes, scaled motions, settling: everything is timed.
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
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

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
Done = tuple[float, float]
"""Trials, and the share that overturned."""


def block() -> tuple[Campaign, Study]:
    """The block's campaign, all trials that there are, and its study."""
    study = load_study(ROOT / "configs" / "blind.yaml", overrides=("output.log_every=0",))
    width, _, height = study.rock.size  # type: ignore[union-attr]
    records = []
    for i in range(TRIALS["campaign-block"] // SCALINGS):
        ground = ground_motion(f"m{i}", np.random.default_rng([1, i]))
        for strength in np.geomspace(*STRENGTHS, SCALINGS):
            moved = ground.displacement * (9.81 * width / height * strength)
            records.append(Record(f"m{i}-{strength:.2f}", ground.interval, displacement=moved))
    return campaign_of(records, "block"), study


def laboratory() -> tuple[Campaign, Study]:
    """SP1's campaign, evenly spread over the trials that have a motion, and its study."""
    with (LAB / "trials.csv").open(newline="") as file:
        named = [f"Test{int(row['test']):03d}" for row in csv.DictReader(file)]
    paths = [LAB / "motions" / f"{name}.npz" for name in named]
    paths = [path for path in paths if path.is_file()]
    chosen = np.linspace(0, len(paths) - 1, TRIALS["campaign-SP1"]).round().astype(int)
    overrides = (
        f"rock.file={LAB / 'models' / 'final_sp1.obj'}",
        f"motion.folder={LAB / 'motions'}",
        "output.log_every=0",
    )
    study = load_study(ROOT / "studies" / "lab_diagnosis.yaml", overrides=overrides)
    return campaign_of([read_record(paths[i]) for i in chosen], "SP1"), study


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


def drawn_effects(library: Any, index: int) -> tuple[tuple[str, tuple[float, ...]], ...]:
    """What acts in a campaign: none, one or two effects at a log-uniform share of their range."""
    library_of = simulated_part("library")

    rng = np.random.default_rng([2, index])
    kind = rng.random()
    names = [name for name in library if library_of.sides(library[name])]
    if kind < NONE:
        return ()
    found = []
    for i in sorted(rng.permutation(len(names))[: 2 if kind > 1 - TWO else 1]):
        effect = library[names[i]]
        primary = len(library_of.primary_parameters(effect))
        shares = np.exp(rng.uniform(np.log(SMALLEST), 0.0, primary)).tolist()
        secondary = rng.random(len(library_of.free_parameters(effect)) - primary).tolist()
        side = int(rng.choice(library_of.sides(effect)))
        found.append((names[i], library_of.values_at(effect, side, shares, secondary)))
    return tuple(found)


def simulated_part(name: str) -> Any:
    """A module of simulated campaigns, which versions before 0.2.0 have elsewhere."""
    for room in ("vsr2.ensemble", "vsr2.diagnosis"):
        with contextlib.suppress(ModuleNotFoundError):
            return importlib.import_module(f"{room}.simulated.{name}")
    raise ModuleNotFoundError(f"this version has no simulated campaigns: {name}")


def simulated(
    campaign: Campaign, study: Study, round_: int, draws: int, threads: int
) -> Callable[[], Done]:
    """Whole campaigns as a diagnosis simulates them; no draw is used twice."""
    Request = simulated_part("simulator").Request  # noqa: N806
    simulator = simulated_part("scene_simulator").SceneSimulator(campaign, study, threads=threads)
    indices = range(round_ * draws, (round_ + 1) * draws)
    simulator.run([Request(0, (), 1, 1)])  # what is imported late is imported here

    def run() -> Done:
        requests = []
        for index in indices:
            effects = drawn_effects(simulator.library, index)
            requests += [Request(i, effects, FIRST_DRAW + index, 1) for i in range(len(campaign))]
        found = simulator.run(requests)
        return len(requests), float(np.nanmean(found.overturned))

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
        return len(trials), float(np.mean(result["outcome"] == "overturned"))

    return run


def rolled_out(trials: list[Trial], threads: int) -> Callable[[], Done]:
    """All motions by `mujoco.rollout`."""
    from mujoco_rock import MujocoRock

    rock = MujocoRock(trials[0].scene)
    forces = [rock.forces(trial.motion) for trial in trials]
    rock.overturned([forces[0][:100]], threads)

    def run() -> Done:
        return len(forces), rock.overturned(forces, threads) / len(forces)

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
        return share, float("nan")

    return run


def window(force: Array) -> Array:
    """`WINDOW` steps round the strongest, shape (`WINDOW`, 6)."""
    begin = int(np.abs(force[:, 0]).argmax()) - WINDOW // 2
    begin = max(0, min(begin, len(force) - WINDOW))
    return force[begin : begin + WINDOW]


def prepared(options: argparse.Namespace) -> Callable[[], Done]:
    """What is to be timed, with all that goes before it done."""
    kind, rock = options.work.split("-")
    campaign, study = block() if rock == "block" else laboratory()
    campaign = thinned(campaign, options.trials or TRIALS[options.work])
    if kind == "campaign":
        draws = options.draws or DRAWS[options.work]
        return simulated(campaign, study, options.round, draws, options.threads)
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
    run = prepared(parser.parse_args())
    clocks = {"wall": time.perf_counter, "cpu": time.process_time, "making": time.thread_time}
    begin = {name: clock() for name, clock in clocks.items()}
    trials, overturned = run()
    took = {name: clock() - begin[name] for name, clock in clocks.items()}
    print(json.dumps({"trials": trials, **took, "overturned": overturned}))


if __name__ == "__main__":
    main()
