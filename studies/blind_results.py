"""Committed results of a blind check: keys, verdicts and scores, and what follows from them.

Of each part a results folder holds `keyN.json.gz` (salt and key) and `verdictsN.json.gz`: what
scoring read of each diagnosis, why an unresolved one names nothing, and the ids of trials.
`scores.json.gz` records the scores as published, baselines and leaks among them, which need
the packs' data. All tables and figures of the tiers are computed from keys and verdicts:

    python studies/blind_check.py validation --recompute --results docs/results/blind_validation_5
"""

from __future__ import annotations

import csv
import gzip
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from vsr2.blind.form.diagnosis_form import DIAGNOSIS_FILE, NAMING, Verdict
from vsr2.blind.form.pack_settings import Kind
from vsr2.blind.form.seal import commitment, read_json
from vsr2.blind.scoring.cases import Case, case_of, read_cases
from vsr2.blind.scoring.score import leading_class, magnitude, score_cases, top_one
from vsr2.blind.scoring.tables import Scored, score_files, write_files
from vsr2.errors import BlindError

SCHEMA = "vsr2.blind-verdicts/1"
SCORES = "scores.json.gz"
_VERDICT = TypeAdapter(Verdict)


@dataclass(frozen=True)
class Part:
    """A scored pack.

    Attributes:
        number: of the part, from 1.
        cases: one a campaign and tier.
        withheld: by campaign and tier, the code of the last reason of an unresolved verdict.
    """

    number: int
    cases: list[Case]
    withheld: Mapping[tuple[str, str], str]


def read_gz(path: Path) -> Any:
    """Content of a packed JSON file."""
    return json.loads(gzip.decompress(path.read_bytes()))


def write_gz(path: Path, content: object) -> None:
    """Write packed JSON, the same bytes for the same content."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    path.write_bytes(gzip.compress(text.encode(), mtime=0))


def committed_verdicts(
    data: Path, key: Mapping[str, Any], diagnoses: Path, tiers: Sequence[str] | None = None
) -> dict[str, Any]:
    """Of each campaign its trials' ids, and of each diagnosis what scoring reads.

    Args:
        data: the pack's data folder.
        key: opened.
        diagnoses: folder of them.
        tiers: to be kept; None: all of the pack.

    Raises:
        BlindError: as :func:`vsr2.blind.scoring.cases.read_cases`.
    """
    cases = read_cases(data, key, diagnoses, tiers)
    withheld = {}
    for case in cases:
        path = diagnoses / case.id / case.tier / DIAGNOSIS_FILE
        reasons = read_json(path)["verdict"].get("reasons") if path.exists() else None
        if reasons and case.verdict.kind == "unresolved":
            code = reasons[-1]["code"] if isinstance(reasons[-1], Mapping) else reasons[-1]
            withheld[case.id, case.tier] = code
    return part_content(read_json(diagnoses / "submission.json")["pack"], cases, withheld)


def part_content(
    pack: str, cases: Sequence[Case], withheld: Mapping[tuple[str, str], str]
) -> dict[str, Any]:
    """Content of a `verdictsN.json.gz`."""
    verdicts: dict[str, dict[str, Any]] = {}
    for case in cases:
        plain = _VERDICT.dump_python(case.verdict, mode="json", exclude_defaults=True)
        for one in plain.get("where", ()):
            one["trials"] = sorted(one.get("trials") or ()) if "trials" in one else None
        verdicts.setdefault(case.id, {})[case.tier] = plain
    return {
        "schema": SCHEMA,
        "pack": pack,
        "trials": {case.id: list(case.trials) for case in cases},
        "verdicts": verdicts,
        "withheld": {f"{name} {tier}": code for (name, tier), code in withheld.items()},
    }


def committed_cases(content: Mapping[str, Any], key: Mapping[str, Any], label: str) -> list[Case]:
    """The cases of a pack, as those that :mod:`vsr2.blind.scoring.cases` reads from its folders.

    Args:
        content: what :func:`committed_verdicts` gave.
        key: of the same pack, opened.
        label: of the file that holds them, in front of messages.

    Raises:
        BlindError: it is of another form or another pack, or a value is missing or of a wrong kind.
    """
    if content.get("schema") != SCHEMA:
        raise BlindError(f"{label}: schema is {content.get('schema')!r}; it should be {SCHEMA!r}")
    if set(content["verdicts"]) != set(key["campaigns"]):
        raise BlindError(f"{label}: its campaigns are not those of the key")
    out = []
    for name, tiers in sorted(content["verdicts"].items()):
        trials = tuple(content["trials"][name])
        for tier, plain in sorted(tiers.items()):
            try:
                verdict = _VERDICT.validate_python(plain)
            except ValueError as error:
                raise BlindError(f"{label}: {name}, {tier}: {error}") from None
            out.append(case_of(key, name, tier, verdict, trials, (Path(name), Path(label))))
    return out


def read_key(results: Path, number: int) -> dict[str, Any]:
    """The committed key of a part, after its hash was found that of the published pack.

    Raises:
        BlindError: it is not.
    """
    sealed = read_gz(results / f"key{number}.json.gz")
    path = results / f"verdicts{number}.json.gz"
    key: dict[str, Any] = sealed["key"]
    if path.exists() and commitment(sealed["salt"], key) != read_gz(path)["pack"]:
        raise BlindError(f"{results}: key{number}.json.gz is not that of the scored pack")
    return key


def read_parts(results: Path) -> Iterator[Part]:
    """The committed parts of a check.

    Raises:
        BlindError: as :func:`committed_cases` and :func:`read_key`.
    """
    for number in range(1, 1 + len(list(results.glob("verdicts*.json.gz")))):
        path = results / f"verdicts{number}.json.gz"
        content = read_gz(path)
        cases = committed_cases(content, read_key(results, number), str(path))
        withheld = {tuple(at.split()): code for at, code in content["withheld"].items()}
        yield Part(number, cases, withheld)


def recompute(results: Path, out: Path | None = None) -> int:
    """Compare recorded scores with those of the committed keys and verdicts; 0: they agree.

    Later versions know more scores; those that are not recorded at all are left out.

    Args:
        results: the committed folder.
        out: gets all tables and the figure of the tiers, of each part and of all together.
    """
    parts = list(read_parts(results))
    cases = [case for part in parts for case in part.cases]
    tiers = {case.tier for case in cases}
    scored = Scored(score_cases(cases), [], cases, False)
    content = scored.to_json()
    recorded = [row for row in read_gz(results / SCORES)["scores"] if row["tier"] in tiers]
    names = {row["score"] for row in recorded}
    found = [row for row in content["scores"] if row["score"] in names]
    differ = [row for row in recorded if row not in found]
    differ += [row for row in found if row not in recorded]
    for row in differ:
        print(row)
    print(f"{results}: {len(recorded)} scores, {len(differ)} differ")
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        files = score_files(scored, content)
        for part in parts:
            own = Scored(score_cases(part.cases), [], part.cases, False)
            files[f"part{part.number}.md"] = score_files(own, own.to_json())["scores.md"]
        write_files(files | {"verdicts.csv": verdict_table(parts)}, out)
        print(f"wrote {out}")
    return 1 if differ or not recorded else 0


def verdict_table(parts: Sequence[Part]) -> bytes:
    """`verdicts.csv`: what was asked and what was answered, a row a campaign and tier."""
    rows = verdict_rows(parts)
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()


def verdict_rows(parts: Sequence[Part]) -> list[dict[str, Any]]:
    """Rows of :func:`verdict_table`."""
    rows = []
    for part in parts:
        for case in part.cases:
            named = case.verdict.kind in NAMING
            single = case.kind == Kind.SINGLE
            estimated = magnitude(case)
            error, held, width = ("", "", "") if estimated is None else estimated
            rows.append(
                {
                    "part": part.number,
                    "engine": case.engine,
                    "kind": case.kind,
                    "tier": case.tier,
                    "effects": " ".join(effect["name"] for effect in case.effects),
                    "magnitude": " ".join(f"{effect['relative']:.4g}" for effect in case.effects),
                    "verdict": str(case.verdict.kind),
                    "named": " ".join(case.verdict.effects) if named else "",
                    "probability": f"{case.verdict.probability:.3f}",
                    "right": int(top_one(case)) if named else "",
                    "answer": case.first[0],
                    "stated": f"{case.first[1]:.3f}",
                    "first": leading_class(case),
                    "leads": int(case.first[0] in case.truth) if single else "",
                    "closure": "" if case.verdict.closure is None else case.verdict.closure,
                    "error": "" if estimated is None else f"{error:.3g}",
                    "held": "" if estimated is None else int(held),
                    "width": "" if estimated is None else f"{width:.3g}",
                    "withheld": part.withheld.get((case.id, case.tier), ""),
                }
            )
    return rows
