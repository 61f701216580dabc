"""Opens the key of a pack once, and scores the diagnoses."""

from __future__ import annotations

import datetime
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vsr2.analysis.intervals import Score
from vsr2.blind.form.events import EventCode, Say, unheard
from vsr2.blind.form.seal import (
    canonical,
    folder_sha256,
    is_open,
    make_folder,
    open_key,
    read_json,
    read_pack,
    write_json,
)
from vsr2.blind.scoring.baselines import baseline_cases, rate_alone
from vsr2.blind.scoring.cases import Case, read_cases
from vsr2.blind.scoring.leaks import find_leaks
from vsr2.blind.scoring.score import score_cases
from vsr2.blind.scoring.scored import Scored
from vsr2.codes import Statement
from vsr2.errors import BlindError, ResultError

RECEIPT = "receipt.json"
SCORES = "scores.json"
Opened = tuple[Path, Mapping[str, Any], Path]
"""A pack's data folder, its opened key and its diagnoses."""


def score_pack(
    data: Path,
    key: Path,
    diagnoses: Path,
    out: Path,
    *,
    training: tuple[Path, Path] | None = None,
    tiers: Sequence[str] | None = None,
    say: Say = unheard,
) -> Scored:
    """Score the diagnoses of a pack and write `scores.json`.

    The key, and all that it seals, are verified first. A pack is scored once: the key folder gets a
    receipt with the scores, and other diagnoses are refused from then on; the same ones are scored
    again, as after a run that was killed while it wrote. Open packs (development) have no receipt.

    Args:
        data: the pack's data folder.
        key: its key folder.
        diagnoses: what `vsr2 blind diagnose` wrote.
        out: gets the scores.
        training: data and key folder of a development pack that trains the trivial baselines;
            None: there are none.
        tiers: to be scored; None: all of the pack.
        say: gets an event for each stage.

    Raises:
        BlindError: a hash is wrong, a diagnosis is missing or of a wrong form, other diagnoses of
            the pack have been scored, or `out` lies in one of the other folders or cannot be
            written to. Nothing is scored then.
    """
    check_apart(out, data, key, diagnoses)
    opened = open_key(data, key)
    if not diagnoses.is_dir():
        raise BlindError(
            f"{diagnoses}: no such folder; name the one that holds the diagnoses, the `--out` of "
            "`vsr2 blind diagnose`"
        )
    submission = folder_sha256(diagnoses, "*.json")
    receipt = key / RECEIPT
    again = receipt.exists() and not is_open(opened)
    if again and (left := read_receipt(receipt)).get("submission") != submission:
        raise BlindError(
            f"{receipt}: the pack was scored on {left.get('scored')}, with other "
            f"diagnoses than those in {diagnoses} now; a pack is scored once: make a new one"
        )
    say(Statement.of(EventCode.OPENED, key=str(key)))
    scored = judge([(data, opened, diagnoses)], training=training, tiers=tiers)
    content = scored.to_json() | {
        "pack": read_pack(data).commitment.sha256,
        "submission": submission,
        "development": is_open(opened),
    }
    canonical(content)
    make_folder(out)
    if not is_open(opened) and not again:
        today = datetime.datetime.now(datetime.UTC).date().isoformat()
        try:
            write_json(receipt, {"scored": today, **content}, private=True)
        except ResultError as error:
            raise BlindError(f"{error}; without a receipt nothing is scored") from None
    write_json(out / SCORES, content)
    return scored


def judge(
    parts: Sequence[Opened],
    *,
    training: tuple[Path, Path] | None = None,
    tiers: Sequence[str] | None = None,
) -> Scored:
    """Scores over packs whose keys are open; nothing is written.

    Args:
        parts: data folder, opened key and diagnoses of each pack.
        training: as in :func:`score_pack`.
        tiers: likewise.

    Raises:
        BlindError: a diagnosis is missing or of a wrong form, or the training pack is not open.
    """
    cases: list[Case] = []
    trivial: list[Case] = []
    rates: list[Mapping[str, Score]] = []
    for data, opened, diagnoses in parts:
        own = read_cases(data, opened, diagnoses, tiers)
        cases += own
        if training is not None:
            trained = _open_training(training, data)
            trivial += baseline_cases(own, data, training[0], trained)
            rates.append(rate_alone(data, opened))
    development = all(is_open(opened) for _, opened, _ in parts)
    leaks = [find_leaks(data, opened) for data, opened, _ in parts]
    return Scored(score_cases([*cases, *trivial]), rates, cases, development, leaks)


def check_apart(out: Path, *folders: Path) -> None:
    """Refuse to write among files whose hashes are sealed, or are those of a submission.

    Raises:
        BlindError: `out` lies in one of the folders.
    """
    for folder in folders:
        if out.resolve().is_relative_to(folder.resolve()):
            raise BlindError(
                f"{out}: lies in {folder}, whose files must stay as they are; choose another --out"
            )


def _open_training(training: tuple[Path, Path], data: Path) -> Mapping[str, Any]:
    """The key of the pack that trains the baselines, which may be neither scored nor sealed."""
    folder, key = training
    if read_pack(folder).commitment == read_pack(data).commitment:
        raise BlindError(
            f"{folder}: trains the baselines and is scored; give another pack to train"
        )
    opened = open_key(folder, key)
    if not is_open(opened):
        raise BlindError(
            f"{key}: is the key of a sealed pack, which training would open; train the baselines "
            "on a development pack"
        )
    return opened


def read_receipt(path: Path) -> dict[str, Any]:
    """The receipt of a scored pack.

    Raises:
        BlindError: it cannot be read.
    """
    try:
        return read_json(path)
    except BlindError:
        raise BlindError(
            f"{path}: cannot be read; it says which diagnoses were scored, so get it back from a "
            "copy: without it the pack is not scored again"
        ) from None
