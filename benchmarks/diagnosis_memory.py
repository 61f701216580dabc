"""Peak memory of a diagnosis while it simulates, or of all of it by stage.

    vsr2 campaign import-lab SOURCE --out out/lab
    python benchmarks/diagnosis_memory.py out/lab studies/lab_diagnosis.yaml [--threads N]
                                          [--trials N] [--campaigns N]

Simulates whole campaigns, each under an effect that gives every trial a motion of its own, and 40
trials at half the time step, through the simulation cache, as `vsr2.diagnose` does. Prints one line
of JSON: resident memory before the first simulation and at its peak [MB], simulations, and the
hash of the responses, which versions and numbers of threads share.

With `--campaigns`, at least 150, a diagnosis of the campaign is made from so many simulated ones,
with training, verdict and judging. The line then gives the peak of each stage [MB], on Linux.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import resource
from dataclasses import replace
from pathlib import Path

import numpy as np

from vsr2.campaign import Campaign, load_campaign
from vsr2.config import Study, load_study
from vsr2.diagnosis import Budget, diagnose
from vsr2.effects import Effect
from vsr2.ensemble import Execution, Hypotheses
from vsr2.ensemble.execution import Progress
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.library import free_parameters, primary_parameters, sides, values_at
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
from vsr2.ensemble.simulated.simulator import HALF_STEP, Effects, Request

EFFECTS = ("table_resonance", "table_bandwidth", "time_scale")
"""Each gives every trial a motion of its own."""
EXCLUDED = ("base_slope",)
SHARE = 0.25
"""Of an effect's range."""
VARIED = 40
"""Trials at half the time step: those of the noise floor."""


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
        self._stage = "set-up"

    def note(self, progress: Progress | None = None) -> None:
        """Count the peak since the last note to the stage that was reported then."""
        status = Path("/proc/self/status").read_text()
        peak = next(int(row.split()[1]) for row in status.splitlines() if row.startswith("VmHWM"))
        megabytes = round(peak * 1024 / 1e6)
        self.peaks[self._stage] = max(megabytes, self.peaks.get(self._stage, 0))
        Path("/proc/self/clear_refs").write_text("5")  # Sets the peak back to what is resident.
        if progress is not None:
            self._stage = str(progress.stage)


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


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("campaign", type=Path)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--trials", type=int, help="of each campaign, fewer than all")
    parser.add_argument("--campaigns", type=int, help="simulated for a whole diagnosis")
    options = parser.parse_args()
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
