"""Whether a corrected scene, diagnosed again, is `none` or names something new.

    python studies/rediagnosis.py [--draws N] [--campaigns N] [--threads N] [--out FOLDER]

The block of configs/blind.yaml, shaken as in diagnosis_budget.py, has one effect planted at a time,
each under several draws of nuisances that the diagnosis does not know. What a diagnosis at tier M
names is put into the scene, and the campaign is diagnosed again (:func:`vsr2.diagnosis.iterate`,
two rounds). Writes `table.csv`, one row a campaign; a run goes on where the last one stopped.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from diagnosis_budget import ROOT, block, shaken
from diagnosis_planar import write
from vsr2.diagnosis import Budget, iterate
from vsr2.diagnosis.iteration import Asked, Round
from vsr2.ensemble import Execution, ProtocolCache
from vsr2.ensemble.simulated.simulator import Effects

PLANTED: tuple[Effects, ...] = (
    (("restitution", (0.75,)),),
    (("table_gain", (0.08,)),),
    (("time_scale", (0.025,)),),
    (("slenderness", (0.05,)),),
    (("rocking_damping", (0.045,)),),
    (("wear", (0.1,)),),
)


def summary(one: Round, number: int) -> dict[str, Any]:
    """What a round came to."""
    content = one.found.content
    first = content["effects"][0]
    return {
        f"verdict_{number}": content["verdict"]["kind"],
        f"named_{number}": " ".join(content["verdict"]["effects"]),
        f"leading_{number}": first["name"],
        f"none_{number}": f"{content['none_probability']:.3f}",
    }


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=3, help="of nuisances, of each effect")
    parser.add_argument("--campaigns", type=int, default=800)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "rediagnosis")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    setup, rows = block(), []
    for draw in range(1, 1 + options.draws):
        for planted in PLANTED:
            [(name, [size])] = planted
            found = iterate(
                shaken(setup, planted, draw),
                setup.scene,
                options.out / f"{name}_{draw}",
                asked=Asked(
                    budget=Budget(campaigns=options.campaigns, held_out=False),
                    execution=Execution(
                        options.threads, cache=ProtocolCache(options.out / "cache")
                    ),
                ),
                most=2,
            )
            rows.append({"planted": name, "size": f"{size:g}", "draw": draw})
            for number, one in enumerate(found.rounds, 1):
                rows[-1] |= summary(one, number)
            print(rows[-1], flush=True)
            write(options.out / "table.csv", rows)


if __name__ == "__main__":
    main()
