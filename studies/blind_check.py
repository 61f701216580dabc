"""The blind check of the diagnosis: makes, diagnoses and scores packs, in parts.

    python studies/blind_check.py development --minutes 30
    python studies/blind_check.py validation --minutes 60      # again and again until it says done
    python studies/blind_check.py validation --part 2          # beside one of another part
    python studies/blind_check.py validation --score           # diagnoses may not change then
    python studies/blind_check.py leave-one-out

Each check consists of parts, packs of their own with a seed, a protocol and a key each, under
`out/blind/CHECK/PART/`. A run continues where the last one stopped. `--score` scores the parts that
are finished, whose diagnoses may not change from then on, and writes the scores over all of them to
`docs/results/blind_CHECK/` (or `--results`), with sizes, seeds, hashes, versions and the command,
and every verdict. A new round of a check has its own `--out` and `--results`; `OUT/development`
trains the baselines.
"""

from __future__ import annotations

import argparse
import csv
import gzip
import json
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vsr2.blind import (
    PackSettings,
    diagnose_pack,
    make_pack,
    pool_packs,
    score_pack,
)
from vsr2.blind.diagnose import DRAWS
from vsr2.blind.form.seal import open_key, read_json
from vsr2.blind.scoring.cases import Case, read_cases
from vsr2.blind.scoring.kept import keep_diagnoses, kept_cases
from vsr2.blind.scoring.packs import Scored
from vsr2.blind.scoring.score import leading_class, magnitude, score_cases, top_one
from vsr2.config import load_study

ROOT = Path(__file__).resolve().parents[1]
ENGINES = ("bullet", "mujoco")
COMMITS = "commits.json"
"""In a part's folder: which commits made and diagnosed it."""


@dataclass(frozen=True)
class Check:
    """Parts and what each of them holds."""

    parts: int
    settings: PackSettings
    draws: int


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
        DRAWS,
    ),
    "validation": Check(
        2,
        PackSettings(
            engines=ENGINES, single=(30, 10), none=(16, 4), unknown=(10, 4), pair=(10, 2), hidden=5
        ),
        DRAWS,
    ),
    "leave-one-out": Check(
        1,
        PackSettings(engines=("bullet",), single=0, none=10, unknown=0, pair=0, leave_one_out=1),
        DRAWS,
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
    parser.add_argument(
        "--tier", action="append", choices=["B", "M", "T"], help="these alone (default: all)"
    )
    parser.add_argument("--part", type=int, action="append", help="these alone (default: all)")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--score", action="store_true", help="score finished parts")
    parser.add_argument("--results", type=Path, help="of --score (default: docs/results/...)")
    parser.add_argument(
        "--recompute", action="store_true", help="compare scores with those from what is kept"
    )
    options = parser.parse_args()
    check = CHECKS[options.check]
    numbers = options.part or range(1, check.parts + 1)
    if not set(numbers) <= set(range(1, check.parts + 1)):
        parser.error(f"--part: {options.check} has parts 1 to {check.parts}")
    folders = [options.out / options.check / f"part{i}" for i in numbers]
    default = ROOT / "docs" / "results" / f"blind_{options.check.replace('-', '_')}"
    if options.recompute:
        return recompute(options.results or default)
    if options.score:
        return score(options.check, folders, options.out, options.results or default, options.tier)
    limit = None if options.minutes is None else time.monotonic() + 60 * options.minutes

    def say(text: str) -> None:
        print(f"{time.strftime('%H:%M:%S')} {text}", flush=True)
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
                draws=check.draws,
                threads=options.threads,
                say=say,
            )
            print(f"{folder}: {progress.done} diagnoses, {len(progress.failed)} failed")
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
    pool_packs(parts, results, training=training, tiers=tiers)
    (results / "README.md").write_text(
        page(name, parts, len(folders), commit, out, results, training, tiers), encoding="utf-8"
    )
    rows = verdict_rows(parts, tiers)
    with (results / "verdicts.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    for number, (data, key, verdicts) in enumerate(parts, 1):
        shutil.copyfile(data.parent / "scores" / "scores.md", results / f"part{number}.md")
        packed = gzip.compress((key / "key.json").read_bytes(), mtime=0)
        (results / f"key{number}.json.gz").write_bytes(packed)
        keep(data, key, verdicts, results / f"diagnoses{number}.json.gz", tiers)
    print(f"wrote {results}")
    return 0


def keep(data: Path, key: Path, verdicts: Path, path: Path, tiers: Sequence[str] | None) -> None:
    """Write what scoring reads of a pack's diagnoses, the same bytes each time."""
    content = keep_diagnoses(data, open_key(data, key), verdicts, tiers)
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    path.write_bytes(gzip.compress(text.encode(), mtime=0))


def recompute(results: Path) -> int:
    """Compare the scores with those from the keys and diagnoses that are kept beside them.

    Later versions know more scores, and widen an interval that does not hold its value: scores that
    are not told at all are left out, and told intervals are widened so. All else is compared.
    """
    cases = []
    for path in sorted(results.glob("diagnoses*.json.gz")):
        key = results / path.name.replace("diagnoses", "key")
        opened = json.loads(gzip.decompress(key.read_bytes()))["key"]
        cases += kept_cases(json.loads(gzip.decompress(path.read_bytes())), opened, str(path))
    tiers = {case.tier for case in cases}
    found = Scored(score_cases(cases), [], cases, False).to_json()["scores"]
    read = read_json(results / "scores.json")["scores"]
    told = [_widened(row) for row in read if row["tier"] in tiers]
    names = {row["score"] for row in told}
    found = [row for row in found if row["score"] in names]
    differ = [row for row in told if row not in found] + [row for row in found if row not in told]
    for row in differ:
        print(row)
    print(f"{results}: {len(told)} scores, {len(differ)} differ")
    return 1 if differ or not told else 0


def _widened(row: dict[str, Any]) -> dict[str, Any]:
    """A score whose interval holds its value."""
    if row["low"] is None or row["value"] is None:
        return row
    low, high = min(row["low"], row["value"]), max(row["high"], row["value"])
    return row | {"low": low, "high": high}


def verdict_rows(
    parts: list[tuple[Path, Path, Path]], tiers: Sequence[str] | None
) -> list[dict[str, Any]]:
    """What was asked and what was said, a row a campaign and tier."""
    rows = []
    for number, (data, key, verdicts) in enumerate(parts, 1):
        opened: dict[str, Any] = json.loads((key / "key.json").read_text())["key"]
        for case in read_cases(data, opened, verdicts, tiers):
            named = case.verdict.kind in ("effect", "class", "pair")
            leads = case.kind == "single" and case.first[0] in case.truth
            rows.append(
                {
                    "part": number,
                    "engine": case.engine,
                    "kind": case.kind,
                    "tier": case.tier,
                    "effects": " ".join(effect["name"] for effect in case.effects),
                    "floors": " ".join(f"{effect['relative']:.4g}" for effect in case.effects),
                    "verdict": case.verdict.kind,
                    "named": " ".join(case.verdict.effects) if named else "",
                    "probability": f"{case.verdict.probability:.3f}",
                    "right": int(top_one(case)) if named else "",
                    "answer": case.first[0],
                    "stated": f"{case.first[1]:.3f}",
                    "first": leading_class(case),
                    "leads": int(leads) if case.kind == "single" else "",
                    "closure": "" if case.verdict.closure is None else case.verdict.closure,
                    **_magnitude(case),
                    "withheld": _withheld(verdicts / case.id / case.tier / "diagnosis.json"),
                }
            )
    return rows


def _withheld(path: Path) -> str:
    """Why a diagnosis names nothing, where it is unresolved: a code, once a sentence."""
    if not path.exists():
        return ""
    verdict = read_json(path)["verdict"]
    if verdict["kind"] != "unresolved":
        return ""
    reason = verdict["reasons"][-1]
    return reason["code"] if isinstance(reason, dict) else reason


def _magnitude(case: Case) -> dict[str, Any]:
    """Error, interval and its width, as scored; blank where they are not told."""
    told = magnitude(case)
    if told is None:
        return {"error": "", "held": "", "width": ""}
    error, held, width = told
    return {"error": f"{error:.3g}", "held": int(held), "width": f"{width:.3g}"}


def finished(data: Path, verdicts: Path, tiers: Sequence[str] | None) -> bool:
    """Whether every campaign has a diagnosis, or a failure, at the tiers, or at all of the pack."""
    if not (data / "pack.json").exists():
        return False
    pack = read_json(data / "pack.json")
    return all(
        any(
            (verdicts / entry["id"] / tier / f"{kind}.json").exists()
            for kind in ("diagnosis", "failed")
        )
        for entry in pack["campaigns"]
        for tier in tiers or pack["tiers"]
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
        f"are scored. Scores: [scores.md](scores.md), by part beside it. Scored by commit "
        f"`{commit}`. `keyN.json.gz` holds salt and key of part N, whose SHA-256 was published "
        "in its pack (`vsr2.blind.form.seal.commitment`), `diagnosesN.json.gz` what scoring reads "
        "of its diagnoses; `python studies/blind_check.py "
        f"{name} --recompute --results {_shown(results)}` computes the scores of the tiers from "
        f"both; the baselines' columns need the packs' data, which are not kept. In a checkout of "
        "the commit that made a part, `vsr2.blind.make_pack` with its seed and the settings of "
        f"`CHECKS` draws its campaigns again. {_trained(training)}",
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
        how = f"draws {submission.get('draws')}, seed {submission['seed']}"
        versions = ", ".join(
            f"{key} {value}"
            for key, value in opened["versions"].items()
            if key in ("version", "bullet", "mujoco", "numpy", "python")
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
    """A path as it is given in the root of the repository."""
    whole = path.resolve()
    return str(whole.relative_to(ROOT)) if whole.is_relative_to(ROOT) else str(path)


if __name__ == "__main__":
    sys.exit(main())
