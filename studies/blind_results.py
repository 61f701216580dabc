r"""Committed results of a blind check: keys and verdicts, and what follows from them.

Of each part a results folder holds `keyN.json.gz` (salt and key) and `verdictsN.json.gz`: what
scoring reads of each diagnosis, and the ids of trials. `record.json.gz` holds what needs the packs'
data: scores of the baselines, rates, leaks, and hashes of packs and diagnoses. All else is computed
from these:

    python studies/blind_check.py validation --results docs/results/blind_validation_5 \
        --recompute FOLDER
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from vsr2.analysis.intervals import Score
from vsr2.blind.form.diagnosis_form import ReportedVerdict
from vsr2.blind.form.pack_settings import Kind
from vsr2.blind.form.seal import commitment, write_json
from vsr2.blind.scoring.cases import Case, case_of
from vsr2.blind.scoring.leaks import Leak
from vsr2.blind.scoring.packs import SCORES
from vsr2.blind.scoring.score import ScoreCode, leading_class, magnitude, right, score_cases, wrong
from vsr2.blind.scoring.scored import Scored
from vsr2.errors import BlindError
from vsr2.report.blind_page import write_scores
from vsr2.results.atomic import csv_text

SCHEMA = "vsr2.blind-verdicts/2"
RECORD = "record.json.gz"
_VERDICT = TypeAdapter(ReportedVerdict)


def read_gz(path: Path) -> Any:
    """Content of a packed JSON file."""
    return json.loads(gzip.decompress(path.read_bytes()))


def write_gz(path: Path, content: object) -> None:
    """Write packed JSON, the same bytes for the same content."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    path.write_bytes(gzip.compress(text.encode(), mtime=0))


def committed_verdicts(pack: str, cases: Sequence[Case]) -> dict[str, Any]:
    """Content of a `verdictsN.json.gz`: what scoring reads.

    Args:
        pack: hash of the pack's key.
        cases: all of the pack.
    """
    verdicts: dict[str, dict[str, Any]] = {}
    for case in cases:
        strengths = {effect["name"]: effect["strength"] for effect in case.effects}
        plain = _VERDICT.dump_python(case.verdict, mode="json", exclude_defaults=True)
        plain["parameters"] = {
            name: {strength: own[strength]}
            for name, strength in strengths.items()
            if strength in (own := plain.get("parameters", {}).get(name, {}))
        }
        for one in plain.get("where", ()):
            one["trials"] = sorted(one["trials"])
        verdicts.setdefault(case.id, {})[case.tier] = plain
    trials = {case.id: list(case.trials) for case in cases}
    return {"schema": SCHEMA, "pack": pack, "trials": trials, "verdicts": verdicts}


def committed_cases(content: Mapping[str, Any], key: Mapping[str, Any], label: str) -> list[Case]:
    """The cases of a pack, as :func:`vsr2.blind.scoring.cases.read_cases` reads them.

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


def read_parts(results: Path) -> list[list[Case]]:
    """The cases of each committed part of a check.

    Raises:
        BlindError: there is none, or as :func:`committed_cases` and :func:`read_key`.
    """
    paths = sorted(results.glob("verdicts*.json.gz"))
    if not paths:
        raise BlindError(f"{results}: holds no verdicts, from which scores could be computed")
    return [
        committed_cases(read_gz(path), read_key(results, number), str(path))
        for number, path in enumerate(paths, 1)
    ]


def record_of(content: Mapping[str, Any], tiers: set[str]) -> dict[str, Any]:
    """Content of a `record.json.gz`.

    Args:
        content: of `scores.json`.
        tiers: whose scores follow from the verdicts.
    """
    kept = {name: content[name] for name in ("rates", "leaks", "packs", "submissions")}
    return kept | {"scores": [row for row in content["scores"] if row["tier"] not in tiers]}


def scored_again(results: Path) -> Scored:
    """Scores of what is committed, with what is recorded beside them.

    Args:
        results: the committed folder.
    """
    cases = [case for part in read_parts(results) for case in part]
    record = read_gz(results / RECORD)
    scores = score_cases(cases)
    for row in record["scores"]:
        own = scores.setdefault((row["tier"], row["group"]), {})
        own[ScoreCode(row["score"])] = _score(row)
    rates = [{kind: _score(row) for kind, row in one.items()} for one in record["rates"]]
    leaks = [[Leak(**leak) for leak in one] for one in record["leaks"]]
    return Scored(scores, rates, cases, False, leaks)


def _score(row: Mapping[str, Any]) -> Score:
    low, high = (float("nan") if row[end] is None else row[end] for end in ("low", "high"))
    return Score(row["value"], low, high, row["campaigns"])


def recompute(results: Path, out: Path) -> None:
    """Write all tables and the figure of the tiers from what is committed.

    Args:
        results: the committed folder.
        out: gets them.
    """
    scored = scored_again(results)
    out.mkdir(parents=True, exist_ok=True)
    write_json(out / SCORES, scored.to_json())
    write_scores(scored, out)
    (out / "verdicts.csv").write_text(csv_text(verdict_rows(scored.cases), ".4g"))
    print(f"{results}: {len(scored.cases)} verdicts; wrote {out}")


def verdict_rows(cases: Sequence[Case]) -> list[dict[str, Any]]:
    """What was asked and what was answered, a row a campaign and tier."""
    rows = []
    for case in cases:
        single = case.kind == Kind.SINGLE
        estimated = magnitude(case) if single else None
        error, holds = (None, None) if estimated is None else estimated
        rows.append(
            {
                "engine": case.engine,
                "kind": case.kind,
                "tier": case.tier,
                "effects": " ".join(effect["name"] for effect in case.effects),
                "limits": " ".join(f"{effect['relative']:.4g}" for effect in case.effects),
                "verdict": str(case.verdict.kind),
                "named": " ".join(case.verdict.effects) if case.verdict.kind.names_effects else "",
                "right": int(right(case)),
                "wrong": int(bool(wrong(case))),
                "answer": case.first[0],
                "stated": case.first[1],
                "leading": leading_class(case),
                "error": "" if error is None else error,
                "holds": "" if holds is None else int(holds),
            }
        )
    return rows
