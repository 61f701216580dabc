"""Whether a rock that rests on a tremor creeps, rocks or stays, and what of it the contact makes.

    VSR2_LAB_DATA=FOLDER python studies/creep.py [--scenes NAME ...] [--out CSV]

The table moves for a minute by a sine of 2 Hz that fades in and out, at 0.02 g, which no rock of
these feels by friction or by overturning. The rock settles first and every step is taken, with
VSR2's own contact and damping: `fast` as it is, with the contact ten times as stiff, with swept
contacts, and `exact`. Without a tremor the table rests for as long. Writes what the foot travelled
and turned from the start of the motion to its end, and the largest tilt on the way; the committed
table is docs/results/creep.csv.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from engine_equivalence import ROOT, settled_pose, write_table
from quiet_stretches import SCENES, SETTLING, scene
from vsr2.config.study import Contact, Outcome, Output
from vsr2.motion import STANDARD_GRAVITY, Motion
from vsr2.scene import Scene
from vsr2.simulation import run_batch
from vsr2.trial import Trial

STEP, DURATION, FREQUENCY, STRENGTH = 1e-3, 60.0, 2.0, 0.02
"""[s], [s], [Hz], [g]."""
STIFFER = 10.0


def tremor(strength: float) -> Motion:
    """A sine that fades in and out; its strength is the peak acceleration [g]."""
    time = np.arange(0.0, DURATION + STEP / 2, STEP)
    omega = 2 * np.pi * FREQUENCY
    fade = np.sin(np.pi * time / DURATION) ** 2
    place = strength * STANDARD_GRAVITY / omega**2 * fade * np.sin(omega * time)
    velocity = np.gradient(place, STEP)
    return Motion(
        f"tremor_{strength:g}", STEP, place, velocity, np.gradient(velocity, STEP), "recording"
    )


def models(name: str) -> Iterator[tuple[str, Scene]]:
    """The scene in each contact and engine."""
    given = scene(name, "none")

    def of(contact: Contact, **engine: object) -> Scene:
        return Scene(given.rock, given.pedestal, given.engine.model_copy(update=engine), contact)

    pair = {
        side: getattr(given.contact, side).model_copy(
            update={"stiffness": STIFFER * getattr(given.contact, side).stiffness}
        )
        for side in ("rock", "pedestal")
    }
    yield "fast", given
    yield "fast, 10 times as stiff", of(given.contact.model_copy(update=pair))
    yield "fast, swept", of(given.contact, converged_contacts=False)
    yield "exact", of(given.contact, mode="exact")


def main() -> None:
    """Run all and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=SCENES)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "results" / "creep.csv")
    options = parser.parse_args()
    rows = []
    for name in options.scenes:
        start = settled_pose(scene(name, "none"))
        for model, made in models(name):
            for strength in (0.0, STRENGTH):
                trial = Trial(
                    made,
                    tremor(strength),
                    start=start,
                    settling=SETTLING,
                    outcome=Outcome(tail=STEP),
                    output=Output(log_every=0),
                )
                result = run_batch([trial], threads=1)
                if not result.judged[0]:
                    raise SystemExit(f"{name}, {model}: {result['status'][0]}")
                rows.append(
                    {
                        "scene": name,
                        "model": model,
                        "pga_g": f"{strength:g}",
                        "travelled_um": f"{1e6 * result['final_slip'][0]:.3g}",
                        "turned_urad": f"{1e6 * result['final_yaw'][0]:.3g}",
                        "largest_tilt_urad": f"{1e6 * result['peak_tilt'][0]:.3g}",
                        "last_tilt_urad": f"{1e6 * result['final_tilt'][0]:.3g}",
                    }
                )
                print(*rows[-1].values(), flush=True)
    write_table(rows, options.out)


if __name__ == "__main__":
    main()
