"""Instructions of a time step of `fast`, and which parts of the step take them.

    VSR2_LAB_DATA=... python benchmarks/instructions.py [--out CSV]

valgrind's callgrind counts instructions in a process that runs each trial twice, in two lengths.
The difference of the counts over the difference of the steps is a step, and scene and settling drop
out. No other program disturbs a count, and no clock is read.

The rocks are shaken by the embedded record (configs/motions/synthetic_07.csv), and every step is
taken (`engine.skip: none`): the block of configs/blind.yaml while it rocks, pbr_scan at rest and
SP1 (needs VSR2_LAB_DATA) while it rocks, both scans with the original's contact as in
engine_speed.py. The committed table is docs/results/instructions.csv.

The parts are callgrind's inclusive counts of the core's functions. They need the functions' names,
which an installed module lacks: `pip install . -C cmake.define.CMAKE_STRIP= -C install.strip=false`
keeps them. Where valgrind or the names are absent nothing is counted, and the command says so.
"""

from __future__ import annotations

import argparse
import csv
import os
import pickle
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from engine_speed import SETTLING, record, scene_of, settled
from vsr2.config import load_study
from vsr2.config.study import MeshRock, Outcome, Output
from vsr2.scene import Scene, build_scene
from vsr2.simulation import native_scene, run_batch
from vsr2.trial import Trial

ROOT = Path(__file__).resolve().parent.parent
LAB = Path(os.environ.get("VSR2_LAB_DATA", ROOT.parent / "shared" / "lab"))
SHORT, LONG = 1000, 10_000
"""Steps of the two trials."""
STRENGTHS = {"block": 1.8, "pbr_scan": 0.6, "SP1": 1.2}
"""Of the record, over its own: block and SP1 rock and do not overturn."""
MASS = 446.6
"""Of the scans, as engine_speed.py has it [kg]."""
FUNCTIONS = {
    "trial": "vsr2::run_trial(",
    "detection": "vsr2::FastStepper::detect(",
    "advance": "vsr2::FastStepper::advance(",
    "solved at once": "vsr2::solve_sticking(",
    "swept": "vsr2::solve(",
}
"""Of the core, whose inclusive counts are taken."""
PARTS = ("detection", "rows and integration", "solved at once", "swept", "rest of the trial")
HEADER = ["scene", "hull_vertices", "largest tilt [mrad]", "instructions a step", *PARTS]
Counts = dict[str, int]


def scenes() -> dict[str, Scene]:
    """Those whose data are at hand, by name; says which are skipped."""
    overrides = ("engine.skip=none", "output.log_every=0")
    found = {"block": build_scene(load_study(ROOT / "configs" / "blind.yaml", overrides=overrides))}
    meshes = {
        "pbr_scan": ROOT / "models" / "pbr_scan.obj",
        "SP1": LAB / "models" / "final_sp1_pca.obj",
    }
    for name, mesh in meshes.items():
        if mesh.is_file():
            found[name] = scene_of(settled(MeshRock(shape="mesh", file=mesh, mass=MASS)), "fast")
        else:
            print(f"{name} is skipped: there is no {mesh} (VSR2_LAB_DATA)")
    return found


def trial_of(scene: Scene, steps: int, strength: float) -> Trial:
    """The scene shaken for so many steps."""
    return Trial(
        scene=scene,
        motion=record(steps, strength),
        settling=SETTLING,
        outcome=Outcome(tail=scene.engine.time_step),
        output=Output(log_every=0),
    )


def run_all(file: Path) -> None:
    """Run the pickled trials one after another; prints their steps and largest tilts [rad]."""
    for trial in pickle.loads(file.read_bytes()):
        result = run_batch([trial], threads=1)
        if not result.judged[0] or result.overturned[0]:
            raise SystemExit(f"a trial ended as {result['status'][0]}, {result['outcome'][0]}")
        print(int(result["steps"][0]), float(result["peak_tilt"][0]))


def counted(trials: list[Trial], folder: Path) -> list[tuple[int, float, Counts]]:
    """Steps of each trial, its largest tilt [rad] and the instructions of its functions.

    Raises:
        SystemExit: the module holds no names of functions.
    """
    file, out = folder / "trials.pickle", folder / "callgrind.out"
    file.write_bytes(pickle.dumps(trials))
    tool = ["valgrind", "--tool=callgrind", "-q", f"--callgrind-out-file={out}"]
    tool.append(f"--dump-after={FUNCTIONS['trial']}*")
    ours = [sys.executable, str(Path(__file__).resolve()), "--all", str(file)]
    lines = output_of([*tool, *ours]).splitlines()
    found = []
    for index, line in enumerate(lines, 1):
        dump = Path(f"{out}.{index}")
        if not dump.is_file():
            raise SystemExit("nothing is counted: the native module holds no names of functions")
        steps, tilt = line.split()
        table = output_of(["callgrind_annotate", "--inclusive=yes", "--threshold=100", str(dump)])
        found.append((int(steps), float(tilt), counts_of(table)))
    return found


def output_of(command: list[str]) -> str:
    """What a command prints."""
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def counts_of(table: str) -> Counts:
    """Inclusive instructions from the text of callgrind_annotate."""
    counts = dict.fromkeys(FUNCTIONS, 0)
    for line in table.splitlines():
        read = re.match(r"\s*([\d,]+) \([ \d.]+%\)\s+(.*)", line)
        if read is None:
            continue
        count, name = int(read[1].replace(",", "")), read[2]
        for key, function in FUNCTIONS.items():
            if f":{function}" in name and "'2" not in name:
                counts[key] = max(counts[key], count)
    return counts


def parts_of(count: dict[str, float]) -> list[float]:
    """Of `PARTS`, from what functions take with all that they call."""
    solved, swept = count["solved at once"], count["swept"]
    ours = count["advance"] - solved - swept
    rest = count["trial"] - count["detection"] - count["advance"]
    return [count["detection"], ours, solved, swept, rest]


def table() -> list[list[object]]:
    """One line a scene."""
    known = scenes()
    trials = [
        trial_of(scene, steps, STRENGTHS[name])
        for name, scene in known.items()
        for steps in (SHORT, LONG)
    ]
    with tempfile.TemporaryDirectory() as folder:
        found = counted(trials, Path(folder))
    rows: list[list[object]] = []
    for (name, scene), short, long in zip(known.items(), found[::2], found[1::2], strict=True):
        steps = long[0] - short[0]
        count = {key: (long[2][key] - short[2][key]) / steps for key in FUNCTIONS}
        parts = [f"{part:.0f}" for part in (count["trial"], *parts_of(count))]
        vertices = len(native_scene(scene).rock_hull_vertices)
        rows.append([name, vertices, f"{1e3 * long[1]:.1f}", *parts])
    return rows


def main() -> None:
    """Count all scenes and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="also write the table as CSV")
    parser.add_argument("--all", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.all:
        run_all(options.all)
        return
    if shutil.which("valgrind") is None:
        print("nothing is counted: valgrind was not found (apt-get install valgrind)")
        return
    rows = table()
    for row in rows:
        print(dict(zip(HEADER, row, strict=True)))
    if options.out is not None:
        with options.out.open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([HEADER, *rows])


if __name__ == "__main__":
    main()
