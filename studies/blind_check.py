r"""The blind check of the diagnosis: makes, diagnoses and scores packs, in parts.

    python studies/blind_check.py development --minutes 30
    python studies/blind_check.py validation --minutes 60      # again and again until it says done
    python studies/blind_check.py validation --part 2          # beside one of another part
    python studies/blind_check.py validation --score           # diagnoses may not change then
    python studies/blind_check.py leave-one-out
    python studies/blind_check.py other-engine              # most campaigns by MuJoCo
    python studies/blind_check.py validation --results docs/results/blind_validation_5 \
        --recompute out/scores5                                # all tables from what is committed

Each check consists of parts, packs of their own with a seed, a protocol and a key each, under
`out/blind/CHECK/PART/`. A run continues where the last one stopped. `--score` scores the parts that
are finished, whose diagnoses may not change from then on, and writes the scores over all of them to
`OUT/CHECK/scores/`, and what is committed (:mod:`blind_results`) to `docs/results/blind_CHECK/` (or
`--results`), with sizes, seeds, hashes, versions and the command. A new round of a check has its
own `--out` and `--results`; `OUT/development` trains the baselines.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from blind_results import RECORD, committed_verdicts, recompute, record_of, write_gz
from vsr2.blind import PackSettings, diagnose_pack, make_pack, score_pack
from vsr2.blind.form.pack_settings import EngineName
from vsr2.blind.form.seal import (
    folder_sha256,
    is_open,
    make_folder,
    open_key,
    read_json,
    read_pack,
    write_json,
)
from vsr2.blind.scoring.cases import read_cases
from vsr2.blind.scoring.packs import RECEIPT, SCORES, check_apart, judge, read_receipt
from vsr2.blind.scoring.scored import Scored
from vsr2.campaign import TIERS
from vsr2.codes import Statement
from vsr2.config import load_study
from vsr2.diagnosis import Budget
from vsr2.ensemble import Execution
from vsr2.errors import BlindError
from vsr2.report.blind_page import write_scores
from vsr2.report.messages.blind_packs import diagnosed_pack, event_text

ROOT = Path(__file__).resolve().parents[1]
ENGINES = (EngineName.BULLET, EngineName.MUJOCO)
"""In the order in which a pack draws their campaigns."""
COMMITS = "commits.json"
"""In a part's folder: which commits made and diagnosed it."""


@dataclass(frozen=True)
class Check:
    """Parts and what each of them holds."""

    parts: int
    settings: PackSettings
    campaigns: int


CHECKS = {
    "development": Check(
        1,
        PackSettings(
            engines=ENGINES,
            single=(20, 4),
            none=(10, 2),
            unknown=(6, 1),
            pair=(6, 1),
            development=True,
        ),
        1000,
    ),
    "validation": Check(
        1,
        PackSettings(
            engines=ENGINES,
            single=(60, 20),
            none=(32, 8),
            unknown=(20, 8),
            pair=(20, 4),
            reference=(2, 4),
            hidden=5,
            replicates=8,
            signal_trials=32,
        ),
        4000,
    ),
    "other-engine": Check(
        1,
        PackSettings(
            engines=ENGINES,
            single=(12, 20),
            none=(8, 16),
            unknown=(4, 8),
            pair=(0, 4),
            reference=(0, 4),
            hidden=5,
            replicates=8,
            signal_trials=32,
        ),
        2000,
    ),
    "leave-one-out": Check(
        1,
        PackSettings(
            engines=(EngineName.BULLET,), single=0, none=20, unknown=0, pair=0, leave_one_out=2
        ),
        2000,
    ),
}


class OutOfTimeError(Exception):
    """The minutes are spent."""


def main() -> int:
    """Run what is missing, or score what is there."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("check", choices=sorted(CHECKS))
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "blind")
    parser.add_argument("--scene", type=Path, default=ROOT / "configs" / "blind.yaml")
    parser.add_argument("--minutes", type=float, help="stop after so many (default: at the end)")
    parser.add_argument("--tier", action="append", choices=TIERS, help="these alone (default: all)")
    parser.add_argument("--part", type=int, action="append", help="these alone (default: all)")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument(
        "--no-how-far",
        action="store_true",
        help="do not judge how far gaps shrink, which costs most",
    )
    parser.add_argument("--score", action="store_true", help="score finished parts")
    parser.add_argument("--results", type=Path, help="of --score (default: docs/results/...)")
    parser.add_argument(
        "--recompute", type=Path, metavar="FOLDER", help="gets all tables from what is committed"
    )
    options = parser.parse_args()
    check = CHECKS[options.check]
    numbers = options.part or range(1, check.parts + 1)
    if not set(numbers) <= set(range(1, check.parts + 1)):
        parser.error(f"--part: {options.check} has parts 1 to {check.parts}")
    folders = [options.out / options.check / f"part{i}" for i in numbers]
    default = ROOT / "docs" / "results" / f"blind_{options.check.replace('-', '_')}"
    if options.recompute:
        try:
            recompute(options.results or default, options.recompute)
        except BlindError as error:
            print(error, file=sys.stderr)
            return 2
        return 0
    if options.score:
        return score(options.check, folders, options.out, options.results or default, options.tier)
    limit = None if options.minutes is None else time.monotonic() + 60 * options.minutes

    def say(event: Statement) -> None:
        print(f"{time.strftime('%H:%M:%S')} {event_text(event)}", flush=True)
        if limit is not None and time.monotonic() > limit:
            raise OutOfTimeError

    try:
        for folder in folders:
            if not (folder / "data" / "pack.json").exists():
                study = load_study(options.scene)
                note_commit(folder, "made")
                made = make_pack(study, folder, folder / "key", check.settings, say=say)
                print(f"{folder}: sealed as {made.commitment}; not drawn: {made.not_drawn}")
            note_commit(folder, "diagnosed")
            progress = diagnose_pack(
                folder / "data",
                folder / "verdicts",
                tiers=options.tier,
                budget=Budget(campaigns=check.campaigns, held_out=not options.no_how_far),
                execution=Execution(options.threads),
                say=say,
            )
            print(diagnosed_pack(progress, folder))
    except OutOfTimeError:
        print("time is up; run the same command to continue")
        return 3
    print("done; --score scores it")
    return 0


def note_commit(folder: Path, what: str) -> None:
    """Keep which commit makes or diagnoses a part; all of them where a part spans several."""
    path = folder / COMMITS
    noted = read_json(path) if path.exists() else {}
    head = _commit()
    if head not in noted.setdefault(what, []):
        noted[what].append(head)
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(noted, indent=1) + "\n")


def _commit() -> str:
    """The commit of this repository, marked where files differ from it."""
    said = subprocess.run(
        ["git", "describe", "--always", "--dirty", "--abbrev=40", "--match", ""],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    return said.stdout.strip() or "unknown"


def score(
    name: str, folders: list[Path], out: Path, results: Path, tiers: Sequence[str] | None
) -> int:
    """Score the finished parts, then all of them together; `tiers`: these alone.

    What was scored is scored again, as later versions may, if its diagnoses are unchanged.
    """
    commit = _commit()  # before the results are written over
    parts: list[tuple[Path, Path, Path]] = []
    development = out / "development" / "part1"
    known = name != "development" and (development / "data" / "pack.json").exists()
    training = (development / "data", development / "key") if known else None
    for folder in folders:
        data, key, verdicts = folder / "data", folder / "key", folder / "verdicts"
        if not finished(data, verdicts, tiers):
            print(f"{folder}: not finished")
            continue
        score_pack(data, key, verdicts, folder / "scores", training=training, tiers=tiers)
        parts.append((data, key, verdicts))
    if not parts:
        return 1
    tables = folders[0].parent / "scores"
    scored = pool_packs(parts, tables, training=training, tiers=tiers)
    results.mkdir(parents=True, exist_ok=True)
    known_tiers = {case.tier for case in scored.cases}
    write_gz(results / RECORD, record_of(read_json(tables / SCORES), known_tiers))
    (results / "README.md").write_text(
        page(name, parts, len(folders), commit, out, results, training, tiers), encoding="utf-8"
    )
    for number, (data, key, verdicts) in enumerate(parts, 1):
        write_gz(results / f"key{number}.json.gz", read_json(key / "key.json"))
        cases = read_cases(data, open_key(data, key), verdicts, tiers)
        content = committed_verdicts(read_pack(data).commitment.sha256, cases)
        write_gz(results / f"verdicts{number}.json.gz", content)
    print(f"wrote {results}; {tables} has the tables, with baselines and leaks")
    return 0


def pool_packs(
    parts: Sequence[tuple[Path, Path, Path]],
    out: Path,
    *,
    training: tuple[Path, Path] | None = None,
    tiers: Sequence[str] | None = None,
) -> Scored:
    """Scores over several packs that were scored already, written as `vsr2 blind score` does.

    Args:
        parts: data folder, key folder and diagnoses of each pack.
        out: gets the scores.
        training: as in `score_pack`.
        tiers: likewise.

    Raises:
        BlindError: a pack is not scored yet, its diagnoses are not those that were scored, or `out`
            lies in one of its folders.
    """
    opened = []
    for data, key, diagnoses in parts:
        check_apart(out, data, key, diagnoses)
        opened.append((data, open_key(data, key), diagnoses))
    submissions = [folder_sha256(diagnoses, "*.json") for _, _, diagnoses in parts]
    for (data, folder, diagnoses), (_, sealed, _), submission in zip(
        parts, opened, submissions, strict=True
    ):
        if is_open(sealed):
            continue
        if not (folder / RECEIPT).exists():
            raise BlindError(f"{data}: is not scored yet; run `vsr2 blind score` on it first")
        if read_receipt(folder / RECEIPT).get("submission") != submission:
            raise BlindError(f"{diagnoses}: were changed after they were scored")
    scored = judge(opened, training=training, tiers=tiers)
    packs = [read_pack(data).commitment.sha256 for data, _, _ in parts]
    content = scored.to_json() | {"packs": packs, "submissions": submissions}
    make_folder(out)
    write_json(out / SCORES, content)
    write_scores(scored, out)
    return scored


def finished(data: Path, verdicts: Path, tiers: Sequence[str] | None) -> bool:
    """Whether every campaign has a diagnosis, or a failure, at the tiers, or at all of the pack."""
    if not (data / "pack.json").exists():
        return False
    pack = read_pack(data)
    return all(
        any(
            (verdicts / listed.id / tier / f"{kind}.json").exists()
            for kind in ("diagnosis", "failed")
        )
        for listed in pack.campaigns
        for tier in tiers or pack.tiers
    )


def page(
    name: str,
    parts: list[tuple[Path, Path, Path]],
    total: int,
    commit: str,
    out: Path,
    results: Path,
    training: tuple[Path, Path] | None,
    tiers: Sequence[str] | None,
) -> str:
    """What was scored, and how to do it again."""
    asked = "".join(f" --tier {tier}" for tier in tiers or ())
    lines = [
        f"# Blind check: {name}",
        "",
        f"`python studies/blind_check.py {name} --out {_shown(out)}{asked}`, then with `--score "
        f"--results {_shown(results)}`. {len(parts)} of {total} parts "
        f"are scored, by commit `{commit}`. `keyN.json.gz` holds salt and key of part N, whose "
        "SHA-256 was published in its pack (`vsr2.blind.form.seal.commitment`). "
        "`verdictsN.json.gz` holds what scoring reads of its diagnoses. `record.json.gz` holds "
        "what needs the packs' data: scores of the baselines, leaks, hashes of the diagnoses. "
        f"`python studies/blind_check.py {name} --results {_shown(results)} --recompute FOLDER` "
        "computes all scores of the tiers and writes all tables. In a "
        "checkout of the commit that made a part, `vsr2.blind.make_pack` with its seed and the "
        f"settings of `CHECKS` draws its campaigns again. {_trained(training)}",
        "",
        "| part | campaigns | trials | seed | pack (SHA-256) | key's versions | diagnosis "
        "| made by | diagnosed by |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for number, (data, key, verdicts) in enumerate(parts, 1):
        pack = read_json(data / "pack.json")
        opened: dict[str, Any] = json.loads((key / "key.json").read_text())["key"]
        kinds = Counter(
            f"{entry['engine']} {entry['kind']}" for entry in opened["campaigns"].values()
        )
        submission = read_json(verdicts / "submission.json")
        how = f"campaigns {submission.get('campaigns')}, seed {submission['seed']}"
        versions = ", ".join(
            f"{key} {value}"
            for key, value in opened["versions"].items()
            if key in ("version", *EngineName, "numpy", "python")
        )
        counts = ", ".join(f"{kind} {count}" for kind, count in sorted(kinds.items()))
        lines.append(
            f"| {number} | {counts} | {opened['settings']['trials']} | {opened['seed']} "
            f"| `{pack['commitment']['sha256']}` | {versions} | {how} "
            f"| {_noted(data.parent, 'made')} | {_noted(data.parent, 'diagnosed')} |"
        )
    return "\n".join(lines) + "\n"


def _noted(folder: Path, what: str) -> str:
    """The commits that made or diagnosed a part."""
    path = folder / COMMITS
    return ", ".join(f"`{c}`" for c in read_json(path).get(what, [])) if path.exists() else "?"


def _trained(training: tuple[Path, Path] | None) -> str:
    """Which pack trained the baselines."""
    if training is None:
        return "No baselines were trained."
    opened = open_key(*training)
    kinds = Counter(str(entry["kind"]) for entry in opened["campaigns"].values())
    counts = ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))
    sealed = read_json(training[0] / "pack.json")["commitment"]["sha256"]
    return (
        f"The baselines were trained on the development pack `{sealed}` of "
        f"{len(opened['campaigns'])} campaigns ({counts}), seed {opened['seed']}."
    )


def _shown(path: Path) -> str:
    """A path as it is given in the root of the repository; of one outside its name alone."""
    full = path.resolve()
    return str(full.relative_to(ROOT)) if full.is_relative_to(ROOT) else full.name


if __name__ == "__main__":
    sys.exit(main())
