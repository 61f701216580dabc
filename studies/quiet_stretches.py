"""Show what the quiet stretches of `fast` leave out: nothing that a move of the start does not.

    python studies/quiet_stretches.py [--scenes NAME ...] [--records N] [--replicates N]
    VSR2_LAB_DATA=FOLDER python studies/quiet_stretches.py --scenes SP1

With `engine.skip: quiet` the engine `fast` does not step a rock that is bound to rest
(docs/explanation/engines.md). Replicates with perturbed starts under borderline records, as in
engine_equivalence.py, are run three times: with every step, with quiet stretches from the same
starts, and with every step from starts that are moved and lifted by 1e-6 m and turned by 2e-6 rad.
A rocking response is chaotic, so single outcomes differ in all three; quiet stretches may flip no
more of them than the move does, and the overturn probability has to stay.

`SP1-family` is the laboratory's campaign as a diagnosis simulates it (`out/lab`, by `vsr2 campaign
import-lab`): there a record is a draw of nuisances and contact model, and its replicates are the
campaign's trials. On soft contacts the rock swings as long as the pedestal moves.

The rock settles by the default criterion, where specimen SP1 takes half a minute. The contact and
the damping are VSR2's. Each ensemble is written to `--parts` when it is done, and a run that was
stopped goes on from there. Writes `quiet_stretches.csv`, one row a scene.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from engine_equivalence import (
    ROOT,
    borderline_records,
    part,
    replicates,
    scene_of,
    settled_pose,
    vars_of,
    write_table,
)
from vsr2.campaign import load_campaign
from vsr2.config import load_study
from vsr2.config.study import Contact, Engine, Settling
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
from vsr2.ensemble.simulated.simulator import Request
from vsr2.motion import Motion
from vsr2.scene import Pose, Scene
from vsr2.simulation import run_batch
from vsr2.trial import Trial

SCENES = ("block", "pbr_scan", "SP1")
FAMILY = "SP1-family"
"""A campaign instead of borderline records: :func:`family`."""
MOVE = 1e-6
"""Of the start [m]; turned by as much about x, y and z, as components of the quaternion."""
SETTLING = Settling(timeout=120.0)


def scene(name: str, skip: str) -> Scene:
    """The rock of a scene with VSR2's own contact and damping."""
    given = scene_of(name, "fast")
    contact = given.contact if name == "block" else Contact()
    return Scene(given.rock, given.pedestal, Engine(mode="fast", skip=skip), contact)


def moved(trial: Trial) -> Trial:
    """From a start that is moved and turned."""
    x, y, z = trial.start_pose.position
    turned = np.add(trial.start_pose.orientation, (MOVE, -MOVE, MOVE, 0.0))
    turned /= np.linalg.norm(turned)
    return replace(trial, start=Pose((x + MOVE, y, z + MOVE), tuple(turned.tolist())))


def ensembles(
    name: str, base: Pose, motion: Motion, seed: int, options: argparse.Namespace
) -> dict[str, Any]:
    """Outcomes, steps and CPU time of the three runs under one record."""
    found: dict[str, Any] = {}
    for run, skip in (("every", "none"), ("quiet", "quiet"), ("moved", "none")):
        trials = [
            replace(trial, settling=SETTLING)
            for trial in replicates(
                scene(name, skip), base, motion, options.replicates, [13, seed, 0]
            )
        ]
        if run == "moved":
            trials = [moved(trial) for trial in trials]
        begun = time.process_time()
        result = run_batch(trials, threads=options.threads, keep_logs=False)
        found[f"{run}_cpu_s"] = time.process_time() - begun
        bad = ~np.isin(result["status"], ("ok", "tail_timeout"))
        if bad.any():
            raise SystemExit(f"{bad.sum()} trials failed: {result['status'][bad][0]}")
        found[run] = (result["outcome"] == "overturned").tolist()
        found[f"{run}_steps"] = int(result["steps"].sum())
    return found


def family(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """The laboratory's trials under nuisances and contact models drawn as for a diagnosis."""
    campaign = load_campaign(ROOT / "out" / "lab").with_motion()
    every = np.linspace(0, len(campaign) - 1, min(len(campaign), options.replicates))
    trials = tuple(campaign.trials[i] for i in every.round().astype(int))
    campaign = replace(campaign, trials=trials)
    study = load_study(ROOT / "studies" / "lab_diagnosis.yaml")
    simulators = {
        skip: SceneSimulator(
            campaign,
            study.model_copy(update={"engine": study.engine.model_copy(update={"skip": skip})}),
            threads=options.threads,
        )
        for skip in ("none", "quiet")
    }
    for draw in range(1, options.records + 1):
        found: dict[str, Any] = {}
        for run, skip, replicate in (
            ("every", "none", 0),
            ("quiet", "quiet", 0),
            ("moved", "none", -1),
        ):
            begun = time.process_time()
            asked = [Request(i, (), draw, replicate) for i in range(len(trials))]
            found[run] = (simulators[skip].run(asked).overturned == 1).tolist()
            found[f"{run}_cpu_s"] = time.process_time() - begun
        yield found


def row_of(name: str, found: list[dict[str, Any]]) -> dict[str, str]:
    """One row of the table."""
    every, quiet, move = (np.array([f[run] for f in found]) for run in ("every", "quiet", "moved"))
    difference = quiet.mean(axis=1) - every.mean(axis=1)
    flipped = (quiet != every).mean(axis=1)
    # McNemar's variance of a paired difference, with one pseudo-count.
    n = every.shape[1]
    variance = np.maximum(flipped + 1 / n - difference**2, 1 / n) / n
    total = {
        key: sum(f[key] for f in found) for key in found[0] if not isinstance(found[0][key], list)
    }
    return {
        "scene": name,
        "records": str(len(found)),
        "replicates": str(n),
        "overturned_every_step": f"{every.mean():.4f}",
        "overturned_quiet": f"{quiet.mean():.4f}",
        "overturned_moved": f"{move.mean():.4f}",
        "difference_quiet": f"{difference.mean():+.4f}",
        "standard_error": f"{math.sqrt(variance.sum()) / len(found):.4f}",
        "flipped_quiet": f"{flipped.mean():.4f}",
        "flipped_moved": f"{(move != every).mean():.4f}",
        "steps_quiet_over_every": (
            f"{total['quiet_steps'] / total['every_steps']:.3f}" if "quiet_steps" in total else ""
        ),
        "cpu_quiet_over_every": f"{total['quiet_cpu_s'] / total['every_cpu_s']:.3f}",
    }


def options_of(
    description: str, study: str, scenes: Sequence[str], *, records: int, replicates: int
) -> argparse.Namespace:
    """Options of a study of ensembles by scene, with its own sizes.

    Args:
        description: of the study, its first line.
        study: name of its parts.
        scenes: that it knows.
        records: borderline records a scene.
        replicates: a record.
    """
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", choices=scenes, default=scenes)
    parser.add_argument("--records", type=int, default=records)
    parser.add_argument("--replicates", type=int, default=replicates)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--parts", type=Path, default=ROOT / "out" / study)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "results")
    return parser.parse_args()


def by_scene(
    options: argparse.Namespace, skip: str, run: Callable[[str, Pose, Motion, int], dict[str, Any]]
) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Each scene with what a run found under its borderline records; what is done is read.

    Args:
        options: of :func:`options_of`.
        skip: of the engine with which records are sought.
        run: ensembles of a scene from a settled start under one record, with its seed.
    """
    for name in options.scenes:
        folder = options.parts / f"{name}_{options.replicates}"
        folder.mkdir(parents=True, exist_ok=True)
        given = scene(name, skip)
        pose = part(folder / "start.json", partial(settled, given))
        base = Pose(tuple(pose["position"]), tuple(pose["orientation"]))
        yield (
            name,
            [
                part(folder / f"runs_{seed:03d}.json", partial(run, name, base, motion, seed))
                for seed, motion in borderline_records(given, base, folder, options)
            ],
        )


def settled(given: Scene) -> dict[str, Any]:
    """Where the rock rests, as a part keeps it."""
    return vars_of(settled_pose(given))


def main() -> None:
    """Run what parts are missing and write the table."""
    options = options_of(__doc__, "quiet_stretches", (*SCENES, FAMILY), records=20, replicates=300)
    asked_family = FAMILY in options.scenes
    options.scenes = [name for name in options.scenes if name != FAMILY]
    rows = []
    for name, found in by_scene(options, "none", partial(ensembles, options=options)):
        rows.append(row_of(name, found))
        print(*rows[-1].values(), flush=True)
    if asked_family:
        rows.append(row_of(FAMILY, list(family(options))))
        print(*rows[-1].values(), flush=True)
    write_table(rows, options.out / "quiet_stretches.csv")


if __name__ == "__main__":
    main()
