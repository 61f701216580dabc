"""What is kept of a scored pack, so that its scores can be computed again without the data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vsr2.blind.form.seal import read_json
from vsr2.blind.form.verdict import DIAGNOSIS_FILE, Verdict, verdict_of
from vsr2.blind.scoring.cases import Case, case_of, read_cases
from vsr2.errors import BlindError

KEPT_SCHEMA = "vsr2.blind-diagnoses/1"
_READ = ("schema", "conformal_set_90", "none_probability")
_READ_OF = {
    "verdict": ("kind", "effects", "probability"),
    "unknown": ("probability", "novelty_p"),
    "effects": ("name", "probability", "closure"),
    "where": ("axis", "p_familywise", "trials"),
}


def keep_diagnoses(
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
    trials: dict[str, list[str]] = {}
    kept: dict[str, dict[str, Any]] = {}
    for case in read_cases(data, key, diagnoses, tiers):
        trials[case.id] = list(case.trials)
        if case.verdict.failed:
            content: dict[str, Any] = {"failed": case.verdict.failed}
        else:
            content = what_is_read(read_json(diagnoses / case.id / case.tier / DIAGNOSIS_FILE))
            if verdict_of(content, case.id) != case.verdict:
                raise BlindError(f"{case.id}: scoring reads more of tier {case.tier} than is kept")
        kept.setdefault(case.id, {})[case.tier] = content
    pack = read_json(diagnoses / "submission.json")["pack"]
    return {"schema": KEPT_SCHEMA, "pack": pack, "trials": trials, "diagnoses": kept}


def what_is_read(content: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of a `diagnosis.json` that scoring reads (docs/reference/blind.md lists them)."""
    out: dict[str, Any] = {name: content[name] for name in _READ if name in content}
    for name, keys in _READ_OF.items():
        found = content.get(name)
        if isinstance(found, Mapping):
            out[name] = _part(found, keys)
        elif found is not None:
            out[name] = [_part(one, keys) for one in found]
    for one, entry in zip(content.get("effects") or (), out.get("effects", ()), strict=True):
        if one.get("parameters"):
            entry["parameters"] = {
                name: _part(value, ("mean", "ci95")) for name, value in one["parameters"].items()
            }
    gap = content.get("gap")
    if gap and "closure" in gap:
        out["gap"] = {"closure": gap["closure"]}
    return out


def _part(content: Mapping[str, Any], keys: tuple[str, ...]) -> dict[str, Any]:
    return {name: content[name] for name in keys if name in content}


def kept_cases(kept: Mapping[str, Any], key: Mapping[str, Any], label: str) -> list[Case]:
    """The cases of a pack, as those that :mod:`vsr2.blind.scoring.cases` reads from its folders.

    Args:
        kept: what :func:`keep_diagnoses` gave.
        key: of the same pack, opened.
        label: of the file that holds them, in front of messages.

    Raises:
        BlindError: it is of another form or another pack, or a value is missing or of a wrong kind.
    """
    if kept.get("schema") != KEPT_SCHEMA:
        raise BlindError(f"{label}: schema is {kept.get('schema')!r}; wanted is {KEPT_SCHEMA!r}")
    if set(kept["diagnoses"]) != set(key["campaigns"]):
        raise BlindError(f"{label}: its campaigns are not those of the key")
    out = []
    for name, tiers in sorted(kept["diagnoses"].items()):
        for tier, content in sorted(tiers.items()):
            if "failed" in content:
                verdict = Verdict("unresolved", failed=str(content["failed"]))
            else:
                verdict = verdict_of(content, f"{label}: {name}, {tier}")
            trials = tuple(kept["trials"][name])
            out.append(case_of(key, name, tier, verdict, trials, (Path(name), Path(label))))
    return out
