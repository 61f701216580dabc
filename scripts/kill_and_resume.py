"""Kill a verb at random moments, resume it, and compare with an undisturbed run.

    python scripts/kill_and_resume.py STUDY.yaml --work out/kills --kills 200 [--seed 0] [--dask]

STUDY is a plain study; a diagnosis, a prediction and a pack have small work of their own. Each
round takes a verb that keeps unfinished work, begins it in an empty folder, ends it by SIGKILL at a
random moment of its processor time, again and again with `--resume`, and lets it end. It must then
hold, to the bit, what an undisturbed run wrote. Exit code 1: something differs, or a verb ended
with an error. One line a round; the table `kills.csv` in the folder of --work is written after
each. Needs Linux.
"""

from __future__ import annotations

import argparse
import csv
import logging
import os
import random
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
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
  pgv_pga_s: {min: 0.06, max: 0.18, step: 0.04}
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


@dataclass
class Row:
    """Of a verb in the table.

    Attributes:
        usual_s: processor time of the undisturbed run [s].
        files: number of files that are compared.
        rounds: times it was begun again.
        kills: SIGKILLs.
        with_work: kills that found something written.
        wrong: rounds whose end differs from the undisturbed run, or is an error.
        spent_s: duration of all rounds [s].
    """

    usual_s: float
    files: int
    rounds: int = 0
    kills: int = 0
    with_work: int = 0
    wrong: int = 0
    spent_s: float = 0.0


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


@contextmanager
def workers() -> Iterator[str]:
    """Address of two Dask workers of a thread each."""
    import distributed

    with distributed.LocalCluster(  # type: ignore[no-untyped-call]
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL + 1
    ) as cluster:
        yield str(cluster.scheduler_address)


def client_of(study: Path, address: str) -> dict[str, Verb]:
    """The client of a run on Dask workers, which is killed alone."""
    line = ("run", str(study), "--no-figures", "--set", "output.log_every=10", "--quiet")
    return {"run --scheduler": Verb((*line, "--scheduler", address), ("trials.csv", "logs/*"))}


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
    run = ("run", str(study), "--no-figures", "--set", "output.log_every=10", *quick)
    return {
        "run": Verb(run, ("trials.csv", "logs/*", "models/*")),
        "run --shard": Verb((*run, "--shard", "1/2"), ("shards/**/*.jsonl", "shards/**/logs/*")),
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
        "campaign causes": Verb(
            ("campaign", "causes", str(small), str(few), "--scenes", "48", *left_out, *quick),
            ("*.csv", "corrected.yaml"),
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


def kept(out: Path) -> tuple[Path, ...]:
    """A folder, and what verbs keep beside it."""
    return out, *(out.with_name(f"{out.name}{end}") for end in (".checkpoint", "-key"))


def remove(out: Path) -> None:
    """A folder, and what verbs keep beside it."""
    for left in kept(out):
        shutil.rmtree(left, ignore_errors=True)


def content(verb: Verb, out: Path) -> dict[str, bytes]:
    """Files that are compared, by name."""
    files = [path for form in verb.compared for path in sorted(out.glob(form)) if path.is_file()]
    return {str(path.relative_to(out)): path.read_bytes() for path in files}


def disturbed(verb: Verb, out: Path, chance: random.Random, row: Row) -> str:
    """One round, counted in `row`: what went wrong; "": nothing."""
    row.rounds += 1
    for left in reversed(range(KILLS + 1)):
        # Before the first file a resumed run begins, as it does without one.
        child = start(verb.line, out, *(("--resume",) if left < KILLS else ()))
        if left and killed(child, chance.uniform(0.0, row.usual_s)):
            row.kills += 1
            row.with_work += any(path.exists() and any(path.iterdir()) for path in kept(out))
            continue
        said = child.communicate()[1].decode()
        return "" if child.returncode in (0, 1) else said[-500:]
    return "it never ended"


def killed(child: subprocess.Popen[bytes], moment_s: float) -> bool:
    """Whether a process was still running at a moment of its own processor time, and killed then.

    On the clock a busy machine would move all moments towards the start, an idle one past the end.
    """
    stat = Path(f"/proc/{child.pid}/stat")
    tick_s = 1 / os.sysconf("SC_CLK_TCK")
    while child.poll() is None:
        # User and system time, the 14th and 15th field; the name before may hold blanks.
        user, system = stat.read_text().rpartition(")")[2].split()[11:13]
        if (int(user) + int(system)) * tick_s >= moment_s:
            # The counts of the system are coarse.
            time.sleep(tick_s * random.random())
            child.kill()
            child.communicate()
            return child.returncode < 0
        time.sleep(tick_s)
    return False


def write_table(rows: dict[str, Row], path: Path) -> None:
    """A row a verb."""
    with path.open("w", newline="") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(
            ["verb", "undisturbed_cpu_s", "files_compared", "rounds", "kills", "with_work", "wrong"]
        )
        for name, row in rows.items():
            numbers = row.files, row.rounds, row.kills, row.with_work, row.wrong
            table.writerow([name, f"{row.usual_s:.1f}", *numbers])


def undisturbed(name: str, verb: Verb, out: Path) -> tuple[dict[str, bytes], Row]:
    """What a verb writes when it is left alone.

    Raises:
        SystemExit: it ended with an error, or wrote nothing to compare.
    """
    remove(out)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    child = start(verb.line, out)
    said = child.communicate()[1].decode()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    usual_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    alike = content(verb, out)
    if child.returncode not in (0, 1) or not alike:
        raise SystemExit(f"{name}: exit code {child.returncode}, {len(alike)} files; {said}")
    row = Row(usual_s, len(alike))
    print(
        f"{name}: undisturbed in {row.usual_s:.1f} s of processor time, {row.files} files",
        flush=True,
    )
    return alike, row


def main() -> int:
    """Rounds until the kills are counted or the time is over."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("study", type=Path)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--kills", type=int, default=200, help="of all verbs together")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="at most, of rounds")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--verb", action="append", help="kill this verb alone; may be repeated")
    parser.add_argument("--dask", action="store_true", help="kill the client of `run --scheduler`")
    asked = parser.parse_args()
    if not asked.dask:
        return rounds(asked, verbs)
    with workers() as address:
        return rounds(asked, lambda study, _: client_of(study, address))


def rounds(asked: argparse.Namespace, made: Callable[[Path, Path], dict[str, Verb]]) -> int:
    """The same of some verbs, which are made of the study and the folder of --work."""
    work = asked.work.resolve()
    work.mkdir(parents=True, exist_ok=True)
    chance = random.Random(asked.seed)
    known = made(asked.study.resolve(), work)
    chosen = asked.verb or list(known)
    for words, folder in {read for name in chosen if (read := known[name].reads) is not None}:
        remove(folder)
        start(words, folder).communicate()
    outs = {name: work / name.replace(" ", "_") for name in chosen}
    expected = {name: undisturbed(name, known[name], outs[name]) for name in chosen}
    rows = {name: row for name, (_, row) in expected.items()}
    ends = time.monotonic() + asked.seconds
    while (total := sum(row.kills for row in rows.values())) < asked.kills:
        if time.monotonic() > ends:
            break
        # Each verb gets as much time as the others, so that the quick ones are killed more often.
        name = min(chosen, key=lambda one: rows[one].spent_s)
        out, row = outs[name].with_name(f"{outs[name].name}_killed"), rows[name]
        remove(out)
        began = time.monotonic()
        wrong = disturbed(known[name], out, chance, row)
        if not wrong and content(known[name], out) != expected[name][0]:
            wrong = "what it holds differs from an undisturbed run"
        row.spent_s += time.monotonic() - began
        row.wrong += bool(wrong)
        print(f"{name}: {row.kills} kills{': ' + wrong if wrong else ''}", flush=True)
        write_table(rows, work / "kills.csv")
    bad = sum(row.wrong for row in rows.values())
    print(f"{total} kills, {bad} rounds wrong")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
