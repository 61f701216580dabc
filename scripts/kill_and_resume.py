"""Kill a verb at random moments, resume it, and compare with an undisturbed run.

    python scripts/kill_and_resume.py STUDY.yaml --work out/kills --seconds 600 [--seed 0]

STUDY is a plain study; a diagnosis, a prediction and a pack have small work of their own. Each
round takes a verb that keeps unfinished work, begins it in an empty folder, ends it by SIGKILL at a
random moment, again and again with `--resume`, and lets it end. It must then hold, to the bit, what
an undisturbed run wrote. Exit code 1: something differs, or a verb ended with an error. One line a
round, and the number of kills at the end.
"""

from __future__ import annotations

import argparse
import random
import shutil
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from vsr2.effects import library

KILLS = 4
"""Of a round, at most."""
CALIBRATION = """
name: calibration
campaign: {campaign}
rock: {{shape: box, size: [0.25, 0.5, 1.0], density: 2700.0}}
engine: {{mode: fast}}
outcome: {{tail: 5.0}}
parameters:
  yaw: {{keys: [rock.start.yaw], range: [0.0, 60.0], unit: deg}}
method: {{kind: joint, design: 8, refine: 4, profile_points: 3}}
folds: 3
"""


BLIND = """
name: blind
engine: {mode: fast, time_step: 0.002}
rock: {shape: box, size: [0.4, 0.55, 0.95], density: 2700.0}
motion: {mode: single_cosine, amplitude: 0.05, frequency: 1.0, drive: prescribed}
contact: {rock: {lateral_friction: 0.9}, pedestal: {lateral_friction: 0.9}}
"""
SMALL = """
name: small
rock: {shape: box, size: [0.25, 0.5, 1.0], density: 2700.0, start: {mode: yaw, yaw: 30.0}}
motion:
  mode: grid_cosine
  pga_g: {min: 0.2, max: 0.65, step: 0.05}
  pgv_pga: {min: 0.06, max: 0.18, step: 0.04}
engine: {mode: fast, time_step: 0.005}
outcome: {tail: 0.5}
output: {log_every: 0}
"""
"""Of 40 trials, the fewest that a diagnosis takes; it simulates them more than 150 times."""
KEPT = ("friction", "restitution", "table_gain")
"""Effects of a diagnosis and of a pack; each more costs it simulations."""
PACK = (
    *("--development", "--seed", "1", "--engine", "bullet", "--series-interval", "0"),
    *(word for name in KEPT for word in ("--effect", name)),
    *("--single", "1", "--none", "1", "--pair", "0", "--unknown", "0"),
    *("--trials", "40", "--motions", "4", "--sessions", "3", "--catalogue", "5"),
    *("--signal-trials", "8", "--replicates", "6"),
)
"""A pack of two small campaigns."""


@dataclass(frozen=True)
class Verb:
    """A verb that keeps unfinished work.

    Attributes:
        line: its words, without --out.
        compared: patterns of the files that equal runs write alike.
        reads: words of the verb that writes what this one reads, and its folder.
    """

    line: tuple[str, ...]
    compared: tuple[str, ...]
    reads: tuple[tuple[str, ...], Path] | None = None


def verbs(study: Path, work: Path) -> dict[str, Verb]:
    """What is killed."""
    quick = ("--threads", "1", "--quiet")
    simulate = ("campaign", "simulate", str(study), "--series-every", "50", *quick)
    campaign, few, pack = work / "campaign", work / "few", work / "pack"
    calibration, small, scene = (work / f"{n}.yaml" for n in ("calibration", "small", "blind"))
    calibration.write_text(CALIBRATION.format(campaign=campaign))
    small.write_text(SMALL)
    scene.write_text(BLIND)
    simulate_few = ("campaign", "simulate", str(small), *quick)
    make = ("blind", "make", str(scene), *PACK, "--quiet")
    # So little that only the fewest simulations are made, the same ones in every run.
    least = ("--seed", "1", "--budget-minutes", "0.001", "--no-how-far", "--tier", "M")
    left_out = [word for name in sorted(set(library()) - set(KEPT)) for word in ("--exclude", name)]
    return {
        "run": Verb(
            ("run", str(study), "--no-figures", *quick), ("trials.csv", "logs/*", "models/*")
        ),
        "fragility": Verb(("fragility", str(study), "--no-figures", *quick), ("*.csv",)),
        "campaign simulate": Verb(simulate, ("trials.csv", "motions/*", "series/*")),
        "calibrate": Verb(
            ("calibrate", str(calibration), "--no-figures", *quick),
            ("best.yaml", "predictions.csv", "folds.csv", "scores.csv", "profiles.csv"),
            (simulate, campaign),
        ),
        "campaign predict": Verb(
            ("campaign", "predict", str(small), str(few), "--replicates", "16", *quick),
            ("*.csv",),
            (simulate_few, few),
        ),
        "diagnose": Verb(
            ("diagnose", str(few), "--scene", str(small), *least, *left_out, *quick),
            ("*.csv",),
            (simulate_few, few),
        ),
        "blind make": Verb(make, ("data/**/*",)),
        "blind diagnose": Verb(
            ("blind", "diagnose", str(pack / "data"), *least, *quick),
            ("*/*/*.csv",),
            (make, pack),
        ),
    }


def start(words: tuple[str, ...], out: Path, *more: str) -> subprocess.Popen[bytes]:
    """A verb, in a process of its own."""
    line = [sys.executable, "-m", "vsr2", *words, "--out", str(out), *more]
    return subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def remove(out: Path) -> None:
    """A folder, and what verbs keep beside it."""
    for left in (out, *(out.with_name(f"{out.name}{end}") for end in (".checkpoint", "-key"))):
        shutil.rmtree(left, ignore_errors=True)


def content(verb: Verb, out: Path) -> dict[str, bytes]:
    """Files that are compared, by name."""
    files = [path for form in verb.compared for path in sorted(out.glob(form)) if path.is_file()]
    return {str(path.relative_to(out)): path.read_bytes() for path in files}


def disturbed(verb: Verb, out: Path, chance: random.Random, usual_s: float) -> tuple[int, str]:
    """Kills of one round, and what went wrong; "": nothing."""
    kills = 0
    for more in [(), *[("--resume",)] * KILLS]:
        # Before the first file a resumed run begins, as it does without one.
        child = start(verb.line, out, *more)
        try:
            said = child.communicate(
                timeout=chance.uniform(0.0, usual_s) if kills < KILLS else None
            )
        except subprocess.TimeoutExpired:
            child.kill()
            child.communicate()
            kills += 1
            continue
        if child.returncode not in (0, 1):
            return kills, said[1].decode()[-500:]
        return kills, ""
    return kills, "it never ended"


def main() -> int:
    """Rounds until the time is over."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("study", type=Path)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--verb", action="append", help="kill this verb alone; may be repeated")
    asked = parser.parse_args()
    work = asked.work.resolve()
    work.mkdir(parents=True, exist_ok=True)
    chance = random.Random(asked.seed)
    known = verbs(asked.study.resolve(), work)
    chosen = asked.verb or list(known)
    for words, folder in {read for name in chosen if (read := known[name].reads) is not None}:
        remove(folder)
        start(words, folder).communicate()
    expected: dict[str, tuple[dict[str, bytes], float]] = {}
    for name in chosen:
        out = work / f"{name.replace(' ', '_')}_undisturbed"
        remove(out)
        began = time.monotonic()
        child = start(known[name].line, out)
        said = child.communicate()[1].decode()
        if child.returncode not in (0, 1):
            print(f"{name}: {said}")
            return 1
        expected[name] = content(known[name], out), time.monotonic() - began
    kills: Counter[str] = Counter()
    bad = 0
    ends = time.monotonic() + asked.seconds
    while time.monotonic() < ends:
        for name in chosen:
            out = work / f"{name.replace(' ', '_')}_killed"
            remove(out)
            alike, usual_s = expected[name]
            count, wrong = disturbed(known[name], out, chance, usual_s)
            kills[name] += count
            if not wrong and content(known[name], out) != alike:
                wrong = "what it holds differs from an undisturbed run"
            bad += bool(wrong)
            print(f"{name}: {count} kills{': ' + wrong if wrong else ''}", flush=True)
            if time.monotonic() > ends:
                break
    print(f"{kills.total()} kills ({dict(kills)}), {bad} rounds wrong")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
