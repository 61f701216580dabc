"""Shards: a batch in parts that know nothing of each other, for job arrays of a cluster.

OUT/shards/2-of-8/   journal.jsonl and logs of the 2nd, 10th, 18th, ... trial, counted from 1
OUT/shards/2-of-8/shard.json   where it ran, written once it is done
OUT/                 the result, once all shards are merged
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from vsr2.errors import ResultError, SimulationError
from vsr2.one_line import counted
from vsr2.results import (
    SHARD_FOLDER,
    BatchResult,
    Journal,
    adopt_trial_log,
    has_journal,
    log_mark,
    prepare_folder,
    read_journal,
    refuse_links,
)
from vsr2.results.atomic import write_text
from vsr2.simulation.batch import run_batch
from vsr2.simulation.planning import plan_sha256
from vsr2.trial import Trial

SHARD_FILE = "shard.json"
_NAME = re.compile(r"([1-9]\d*)-of-([1-9]\d*)")
_FACTS = ("vsr2", "python", "numpy", "platform", "processor", "created", "build", "wall_time_s")


@dataclass(frozen=True)
class Shard:
    """Every `count`-th trial from the `index`-th on.

    Attributes:
        index: of the shard, from 1.
        count: number of shards.

    Raises:
        SimulationError: the index does not lie in 1 to `count`.
    """

    index: int
    count: int

    def __post_init__(self) -> None:
        if not 1 <= self.index <= self.count:
            raise SimulationError(
                f"shard {self.index}/{self.count}: shards are counted from 1 to {self.count}; for "
                f"job arrays use --array=1-{max(1, self.count)}"
            )

    @classmethod
    def parse(cls, text: str) -> Self:
        """From text such as 2/8.

        Raises:
            SimulationError: the text is of another form.
        """
        match = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text)
        if not match:
            raise SimulationError(f"shard {text!r}: give it as I/N, for example 2/8")
        return cls(int(match[1]), int(match[2]))

    def __str__(self) -> str:
        return f"{self.index}/{self.count}"

    def positions(self, trials: int) -> range:
        """Of its trials among all, from 0."""
        return range(self.index - 1, trials, self.count)

    def folder(self, out: Path) -> Path:
        """Where it is kept, in the result's folder."""
        return out / SHARD_FOLDER / f"{self.index}-of-{self.count}"


def run_shard(
    trials: Sequence[Trial],
    shard: Shard,
    folder: Path,
    *,
    resume: bool = False,
    overwrite: bool = False,
    threads: int | None = None,
    progress: bool = False,
) -> BatchResult:
    """Run a shard into the result's folder.

    Args:
        trials: all trials of the batch.
        shard: which of them to run.
        folder: of the result; shards may run at the same time, on any machine that sees it.
        resume: go on with this shard where it was interrupted.
        overwrite: begin this shard again.
        threads: as of :func:`run_batch`.
        progress: as of :func:`run_batch`.

    Returns:
        The shard's trials, logs on disk only.

    Raises:
        SimulationError: there are fewer trials than shards, or as of `run_batch`.
        ResultError: the folder cannot be used, or holds the shard already.
    """
    _check_count(shard.count, len(trials))
    refuse_links(folder, (SHARD_FOLDER,))
    own = shard.folder(folder)
    prepare_folder(own, overwrite=overwrite, resume=resume)
    if not has_journal(own):
        (own / SHARD_FILE).unlink(missing_ok=True)
    chosen = [trials[i] for i in shard.positions(len(trials))]
    result = run_batch(chosen, threads=threads, progress=progress, checkpoint=own)
    if not (result.provenance["interrupted"] or (own / SHARD_FILE).exists()):
        facts = {"shard": str(shard)} | {name: result.provenance[name] for name in _FACTS}
        text = json.dumps(facts, indent=2) + "\n"
        write_text(own / SHARD_FILE, text)
    return result


def merge_shards(
    trials: Sequence[Trial], folder: Path, *, overwrite: bool = False
) -> list[dict[str, Any]]:
    """Assemble all shards of a result's folder into one checkpoint there.

    `run_batch` with that checkpoint then gives the result without running any trial. The shards
    stay as they are; where the file system can, their logs are linked, not copied.

    Args:
        trials: all trials of the batch.
        folder: of the result.
        overwrite: replace a result that is there.

    Returns:
        For the provenance: where each shard ran.

    Raises:
        ResultError: shards or trials are missing (names them), shards are of different counts or
            of other trials, or the folder cannot be used or holds a result.
    """
    shards = _shards(folder)
    _check_count(len(shards), len(trials))
    rows: list[dict[int, dict[str, Any]]] = []
    missing: list[str] = []
    for shard in shards:
        chosen = [trials[i] for i in shard.positions(len(trials))]
        own = shard.folder(folder)
        found = read_journal(own, plan_sha256(chosen), len(chosen)) if has_journal(own) else {}
        rows.append(found)
        if not found:
            missing.append(f"{shard} was not run")
        elif len(found) < len(chosen):
            missed = [i for k, i in enumerate(shard.positions(len(trials))) if k not in found]
            missing.append(f"{shard} lacks {_listing(missed)}")
    if missing:
        more = f", and {len(missing) - 10} more shards" if len(missing) > 10 else ""
        raise ResultError(
            f"{folder / SHARD_FOLDER}: not all shards are finished: {'; '.join(missing[:10])}"
            f"{more}. Run these with --shard I/{len(shards)} --resume, then merge"
        )
    prepare_folder(folder, overwrite=overwrite, resume=not overwrite)
    with Journal(folder, plan_sha256(trials), len(trials)) as journal:
        for shard, found in zip(shards, rows, strict=True):
            for k, i in enumerate(shard.positions(len(trials))):
                if i in journal.finished:
                    continue
                own = shard.folder(folder)
                if log_mark(own, k) != found[k]["log"]:
                    raise ResultError(
                        f"{own}: the log of trial {i} is gone or was changed; run shard {shard} "
                        "again with --resume"
                    )
                adopt_trial_log(folder, i, own, k)
                journal.record(i, found[k], found[k]["log"])
    return [_facts(shard, folder) for shard in shards]


def _check_count(count: int, trials: int) -> None:
    if count > trials:
        raise SimulationError(
            f"{count} shards for {counted(trials, 'trial')}; use at most {counted(trials, 'shard')}"
        )


def _shards(folder: Path) -> list[Shard]:
    """All shards of a folder, those included that were not run."""
    parent = folder / SHARD_FOLDER
    found = [_NAME.fullmatch(path.name) for path in parent.iterdir()] if parent.is_dir() else []
    counts = sorted({int(match[2]) for match in found if match})
    if not counts:
        raise ResultError(f"{parent}: holds no shards; run them with --shard I/N")
    if len(counts) > 1:
        raise ResultError(
            f"{parent}: holds shards of {' and of '.join(map(str, counts))}; remove those that do "
            "not belong to this run"
        )
    return [Shard(index, counts[0]) for index in range(1, counts[0] + 1)]


def _listing(trials: Sequence[int]) -> str:
    shown = ", ".join(map(str, trials[:5]))
    more = f" and {len(trials) - 5} more" if len(trials) > 5 else ""
    return f"trial{'s' * (len(trials) > 1)} {shown}{more}"


def _facts(shard: Shard, folder: Path) -> dict[str, Any]:
    try:
        facts = json.loads((shard.folder(folder) / SHARD_FILE).read_bytes())
    except (OSError, ValueError, RecursionError):
        facts = None
    return facts if isinstance(facts, dict) else {"shard": str(shard)}
