"""Peak memory of a diagnosis while it simulates, of all of it by stage, or of its training.

    vsr2 campaign import-lab SOURCE --out out/lab
    python benchmarks/diagnosis_memory.py out/lab studies/lab_diagnosis.yaml [--threads N]
                                          [--trials N] [--campaigns N]
    python benchmarks/diagnosis_memory.py --train CAMPAIGNS [--trials N] [--most-effects N]
                                          [--passes N]

Simulates whole campaigns, each under an effect that gives every trial a motion of its own, and 40
trials at half the time step, through the simulation cache, as `vsr2.diagnose` does. Prints one line
of JSON: resident memory before the first simulation and at its peak [MB], simulations, and the
hash of the responses, which versions and numbers of threads share.

With `--campaigns`, at least 150, a diagnosis of the campaign is made from so many simulated ones,
with training, verdict and judging. The line then gives the peak of each stage [MB], on Linux.

With `--train` a posterior is trained on so many made-up campaigns at tier T: what acts in them is
drawn as a diagnosis draws it, and outcomes and all 21 features answer it linearly, under noise. The
line gives resident memory before the training and at its peak [MB], its CPU time [s], and of the
first campaigns the most probable set with its probability, by which versions compare.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import resource
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from vsr2.campaign import Campaign, load_campaign
from vsr2.config import Study, load_study
from vsr2.diagnosis import Budget, diagnose
from vsr2.effects import Effect, library
from vsr2.ensemble import Execution, Hypotheses
from vsr2.ensemble.execution import Progress
from vsr2.ensemble.observed.features import LARGEST_TILT, REST_FEATURES, TILT_FEATURES
from vsr2.ensemble.observed.observations import Observations
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.campaigns import Campaigns, draw_set
from vsr2.ensemble.simulated.library import free_parameters, primary_parameters, sides, values_at
from vsr2.ensemble.simulated.look import Limit, tried_parameters
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
from vsr2.ensemble.simulated.simulator import HALF_STEP, Effects, Request
from vsr2.posterior import network
from vsr2.posterior.training import train

EFFECTS = ("table_resonance", "table_bandwidth", "time_scale")
"""Each gives every trial a motion of its own."""
EXCLUDED = ("base_slope",)
SHARE = 0.25
"""Of an effect's range."""
VARIED = 40
"""Trials at half the time step: those of the noise floor."""
LIMIT = Limit(0.04, jumps=False)
"""Of each effect in campaigns that are made up."""
PRINTED = 10
"""Campaigns of which the most probable set is printed."""


def acting(effect: Effect) -> Effects:
    """The effect at a share of its range."""
    primary = len(primary_parameters(effect))
    secondary = [0.5] * (len(free_parameters(effect)) - primary)
    return ((effect.name, values_at(effect, sides(effect)[0], [SHARE] * primary, secondary)),)


def resident() -> float:
    """Peak so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6


class Stages:
    """Peak resident memory of each stage of a diagnosis, from its last report to its next [MB]."""

    def __init__(self) -> None:
        self.peaks: dict[str, int] = {}
        self.stage = "set-up"

    def note(self, progress: Progress | None = None) -> None:
        """Count the peak since the last note to the stage that was reported then."""
        status = Path("/proc/self/status").read_text()
        peak = next(int(row.split()[1]) for row in status.splitlines() if row.startswith("VmHWM"))
        megabytes = round(peak * 1024 / 1e6)
        self.peaks[self.stage] = max(megabytes, self.peaks.get(self.stage, 0))
        Path("/proc/self/clear_refs").write_text("5")  # Sets the peak back to what is resident.
        if progress is not None:
            self.stage = str(progress.stage)


def diagnosed(campaign: Campaign, study: Study, threads: int, campaigns: int) -> dict[str, int]:
    """Peak of each stage of a diagnosis [MB]."""
    stages = Stages()
    diagnose(
        campaign,
        study,
        budget=Budget(minutes=1e4, campaigns=campaigns),
        hypotheses=Hypotheses(exclude=EXCLUDED),
        execution=Execution(threads=threads, report=stages.note),
    )
    stages.note()
    return stages.peaks


def made_up(campaigns: int, trials: int, most: int) -> tuple[Observations, Campaigns]:
    """An observed campaign and simulated ones, whose responses are linear in what acts."""
    known, rng = library(), np.random.default_rng(0)
    limits = dict.fromkeys(tried_parameters(known), LIMIT)
    sets = tuple(draw_set(known, limits, i, 0, most) for i in range(campaigns))
    names = list(known)
    size = np.zeros((campaigns, len(names)))
    for row, own in enumerate(sets):
        for one in own:
            size[row, names.index(one.name)] = one.side * min(one.size, 8.0)
    columns = len(TILT_FEATURES) + len(REST_FEATURES)
    features = np.empty((campaigns, trials, columns), dtype=np.float32)
    ways = rng.standard_normal((columns + 1, len(names), trials)) / 8
    for k, way in enumerate(ways[1:]):
        features[..., k] = size @ way + rng.standard_normal((campaigns, trials))
    tilt = size @ ways[0] + rng.standard_normal((campaigns, trials))
    overturned = (tilt > rng.standard_normal(trials)).astype(np.float64)
    simulated = Campaigns(
        sets, rng.standard_normal((campaigns, 8)), overturned, 0.1 * np.exp(tilt), features
    )
    index, blank = np.arange(trials), np.zeros(trials)
    measured = (LARGEST_TILT, *TILT_FEATURES, *REST_FEATURES)
    seen = Observations(
        # Training asks an observed campaign what it measures, and not for its trials.
        None, "T", blank, np.zeros((trials, len(measured))), measured,  # type: ignore[arg-type]
        0.003, 0.001, 0.0, blank > 0, (0.01, 0.001), index // 5, blank.astype(int),
        blank.astype(int), index / trials, blank, blank,
    )  # fmt: skip
    return seen, simulated


def trained(campaigns: int, trials: int, most: int) -> dict[str, object]:
    """Memory and CPU time of a training, and what it makes of the first campaigns."""
    seen, simulated = made_up(campaigns, trials, most)
    stages = Stages()
    stages.note()
    stages.stage = "training"
    before = int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 1e6
    started = time.process_time()
    posterior = train(seen, simulated, library(), np.arange(trials), most=most)
    cpu_s = time.process_time() - started
    stages.note()
    noted = seen.noted(
        simulated.overturned[:PRINTED], simulated.peak_tilt[:PRINTED],
        np.asarray(simulated.features)[:PRINTED], np.random.default_rng(1),
    )  # fmt: skip
    found = [
        posterior.infer(outcome, own.astype(np.float64)).probability
        for outcome, own in zip(simulated.overturned, noted, strict=False)
    ]
    return {
        "before": round(before),
        "peak": stages.peaks["training"],
        "cpu_s": round(cpu_s, 1),
        "sets": [(int(p.argmax()), round(float(p.max()), 6)) for p in found],
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("campaign", type=Path, nargs="?")
    parser.add_argument("scene", type=Path, nargs="?")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--trials", type=int, help="of each campaign, fewer than all")
    parser.add_argument("--campaigns", type=int, help="simulated for a whole diagnosis")
    parser.add_argument("--train", type=int, help="on so many campaigns that are made up")
    parser.add_argument("--most-effects", type=int, default=2, help="of these")
    parser.add_argument("--passes", type=int, help="of the networks, which take no memory")
    options = parser.parse_args()
    if options.passes is not None:
        network.NETWORK = replace(network.NETWORK, passes=options.passes, least_passes=1)
    if options.train is not None:
        print(json.dumps(trained(options.train, options.trials or 150, options.most_effects)))
        return
    campaign = load_campaign(options.campaign).on_file().with_motion()
    study, threads = load_study(options.scene), options.threads
    if options.campaigns is not None:
        kept = np.linspace(0, len(campaign) - 1, min(options.trials or 10**9, len(campaign)))
        thinned = replace(campaign, trials=tuple(campaign.trials[int(i)] for i in kept))
        print(json.dumps({"peaks": diagnosed(thinned, study, threads, options.campaigns)}))
        return
    simulator = SceneSimulator(
        campaign, study, hypotheses=Hypotheses(exclude=EXCLUDED), threads=threads
    )
    begin, count = resident(), len(campaign)
    chosen = np.linspace(0, count - 1, min(count, options.trials or count)).astype(int).tolist()
    requests = [
        Request(i, acting(simulator.library[name]), 1000 + k, 1)
        for k, name in enumerate(EFFECTS)
        for i in chosen
    ]
    requests += [Request(i, (), 0, HALF_STEP) for i in chosen[:VARIED]]
    found = SimulationCache(simulator).run(requests)
    digest = hashlib.sha256(found.overturned.tobytes() + found.peak_tilt.tobytes()).hexdigest()
    facts = {"before": round(begin), "peak": round(resident()), "simulations": len(requests)}
    print(json.dumps({**facts, "responses": digest[:16]}))


if __name__ == "__main__":
    main()
