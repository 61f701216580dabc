"""What each mechanism, and a pedestal that moves in space, costs a step: ratio of on to off.

    python benchmarks/mechanism_cost.py [--mesh MESH --mass KG] [--rounds N] [--steps N]
        [--engines ...]

One rock through one record (embedded: configs/motions/synthetic_07.csv, too weak to overturn), each
engine in turn. In every round a batch with the mechanism follows one without, so that a change of
the machine's speed meets both; the table gives the median of the rounds' ratios and its quartiles.
CPU time of the whole trial, settling and building of the world included. What changes the response
changes the cost too: a rock that comes to rest sooner is cheaper.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from engine_speed import record
from vsr2.config.study import (
    Contact,
    Engine,
    MeshRock,
    Outcome,
    Output,
    PrismPedestal,
    Settling,
)
from vsr2.motion import Motion, SideMotion
from vsr2.scene import Mechanisms, PedestalBody, PitchSpring, Scene, build_pedestal, build_rock
from vsr2.simulation import run_batch
from vsr2.trial import Trial

ROOT = Path(__file__).resolve().parent.parent
MECHANISMS = {
    "impact_energy_ratio 0.8": Mechanisms(impact_energy_ratio=0.8),
    "rocking_damping 0.02": Mechanisms(rocking_damping=0.02),
    "rolling_resistance 5 mm": Mechanisms(rolling_resistance=0.005),
    "friction_ratio 1.3": Mechanisms(friction_ratio=1.3),
    "adhesion 20 kPa": Mechanisms(adhesion=2e4),
    "catch_slack 0.2 rad": Mechanisms(catch_slack=0.2),
}
SPRING = PitchSpring(frequency=10.0, damping=0.1, compliance=0.0, inertia=500.0)
"""Of a pedestal that only the rock turns, so that the response stays much the same."""


def in_space(motion: Motion) -> Motion:
    """The motion with channels beside x that are nearly at rest."""
    side = SideMotion(1e-9 * motion.displacement, 1e-9 * motion.velocity)
    return replace(motion, transverse=side, vertical=side, pitch=side)


def cpu_time(trial: Trial) -> float:
    """CPU seconds a step of a trial."""
    start = time.process_time()
    result = run_batch([trial], threads=1)
    seconds = time.process_time() - start
    if not result.judged[0]:
        raise SystemExit(result["status"][0])
    return float(seconds / result["steps"][0])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", type=Path, default=ROOT / "models/pbr_scan.obj")
    parser.add_argument("--mass", type=float, default=455.0)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--steps", type=int, default=10_000)
    parser.add_argument("--engines", nargs="+", default=["parity", "exact", "fast"])
    arguments = parser.parse_args()
    pedestal = build_pedestal(PrismPedestal())
    rock = build_rock(
        MeshRock(shape="mesh", file=arguments.mesh, mass=arguments.mass), pedestal, clearance=0.002
    )
    motion = record(arguments.steps)
    print(f"{'engine':8} {'with':26} {'ratio':>6}  quartiles")
    for mode in arguments.engines:

        def trial_with(
            mechanisms: Mechanisms,
            shaken: Motion,
            mode: str = mode,
            stand: PedestalBody = pedestal,
        ) -> Trial:
            scene = Scene(rock, stand, Engine(mode=mode), Contact(), mechanisms)
            return Trial(
                scene=scene,
                motion=shaken,
                settling=Settling(timeout=10.0),
                outcome=Outcome(tail=1e-3),
                output=Output(log_every=0),
            )

        plain = trial_with(Mechanisms(), motion)
        sprung = replace(pedestal, pitch_spring=SPRING)
        cases = {
            "channels beside x": trial_with(Mechanisms(), in_space(motion)),
            "sprung pitch joint": trial_with(Mechanisms(), motion, stand=sprung),
        }
        for name, mechanisms in MECHANISMS.items():
            cases[name] = trial_with(mechanisms, motion)
        for name, trial in cases.items():
            ratios = []
            for _ in range(arguments.rounds):
                off = cpu_time(plain)
                ratios.append(cpu_time(trial) / off)
            low, middle, high = np.percentile(ratios, [25, 50, 75])
            print(f"{mode:8} {name:26} {middle:6.2f}  {low:.2f} to {high:.2f}", flush=True)


if __name__ == "__main__":
    main()
