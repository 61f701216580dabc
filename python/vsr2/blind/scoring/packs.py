"""Opens the key of a pack once, scores the diagnoses and writes the tables."""

from __future__ import annotations

import datetime
import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np

from vsr2.blind.form.seal import (
    canonical,
    folder_sha256,
    is_open,
    json_text,
    make_folder,
    open_key,
    read_json,
    read_pack,
    write_json,
)
from vsr2.blind.form.verdict import NONE, UNKNOWN
from vsr2.blind.scoring.baselines import BASELINES, baseline_cases, rate_alone
from vsr2.blind.scoring.cases import ALL, Case, read_cases
from vsr2.blind.scoring.intervals import Score, reliability
from vsr2.blind.scoring.leaks import Leak, find_leaks
from vsr2.blind.scoring.score import (
    ANSWER,
    BEST_HIGH,
    BEST_LOW,
    NAMED,
    SAYING_NOTHING,
    Scores,
    is_alarm,
    score_cases,
    top_one,
)
from vsr2.errors import BlindError, ResultError
from vsr2.results.atomic import write_atomic

RECEIPT = "receipt.json"


@dataclass(frozen=True, eq=False)
class Scored:
    """What scoring a pack gave.

    Attributes:
        scores: by tier, or name of a trivial baseline, and group.
        rates: how well the overturn rate alone tells kinds apart, a pack each.
        cases: one a campaign and tier.
        development: whether the pack is open.
        leaks: what metadata tell of engine, kind and class, a pack each.
    """

    scores: Mapping[tuple[str, str], Scores]
    rates: Sequence[Mapping[str, Score]]
    cases: Sequence[Case]
    development: bool
    leaks: Sequence[Sequence[Leak]] = ()

    def margins(self, score: str, group: str = ALL) -> dict[str, float]:
        """By tier, how much better a score is than the best baseline's; {} without baselines."""
        found = {
            column: scores[score].value
            for (column, own), scores in self.scores.items()
            if own == group and score in scores
        }
        sign = -1.0 if score in BEST_LOW else 1.0
        trivial = [sign * value for name, value in found.items() if name in BASELINES]
        if not trivial:
            return {}
        tiers = {column: value for column, value in found.items() if column not in BASELINES}
        return {tier: sign * value - max(trivial) for tier, value in sorted(tiers.items())}

    def groups(self) -> list[str]:
        """Of campaigns: all first, the others by name."""
        return sorted({group for _, group in self.scores}, key=lambda name: (name != ALL, name))

    def to_json(self) -> dict[str, Any]:
        """Plain data; single campaigns of an open pack only."""
        out: dict[str, Any] = {
            "scores": [
                {"tier": tier, "group": group, "score": name, **_plain(score)}
                for (tier, group), scores in self.scores.items()
                for name, score in scores.items()
            ],
            "rates": [
                {"score": name, **_plain(score)}
                for one in self.rates
                for name, score in one.items()
            ],
            "above_baselines": [
                {"group": group, "score": score, "tier": tier, "value": round(value, 6)}
                for group in self.groups()
                for score in (*BEST_HIGH, *BEST_LOW)
                for tier, value in self.margins(score, group).items()
            ],
            "leaks": [[asdict(leak) for leak in one] for one in self.leaks],
        }
        if self.development:
            out["campaigns"] = [
                {
                    "id": case.id,
                    "tier": case.tier,
                    "kind": case.kind,
                    "engine": case.engine,
                    "truth": [dict(effect) for effect in case.effects],
                    "verdict": case.verdict.kind,
                    "effects": list(case.verdict.effects),
                    "failed": case.verdict.failed,
                    "right": top_one(case),
                    "alarm": is_alarm(case),
                }
                for case in self.cases
            ]
        return out


def score_pack(
    data: Path,
    key: Path,
    diagnoses: Path,
    out: Path,
    *,
    training: tuple[Path, Path] | None = None,
    tiers: Sequence[str] | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Scored:
    """Score the diagnoses of a pack and write `scores.json`, `scores.md` and `reliability.png`.

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
        say: gets a line for each stage.

    Raises:
        BlindError: a hash is wrong, a diagnosis is missing or of a wrong form, other diagnoses of
            the pack have been scored, or `out` lies in one of the other folders or cannot be
            written to. Nothing is scored then.
    """
    _check_apart(out, data, key, diagnoses)
    pack = read_pack(data)
    opened = open_key(data, key)
    open_pack = is_open(opened)
    if not diagnoses.is_dir():
        raise BlindError(
            f"{diagnoses}: no such folder; name the one that holds the diagnoses, the `--out` of "
            "`vsr2 blind diagnose`"
        )
    submission = folder_sha256(diagnoses, "*.json")
    receipt = key / RECEIPT
    again = receipt.exists() and not open_pack
    if again and (left := _read_receipt(receipt)).get("submission") != submission:
        raise BlindError(
            f"{receipt}: the pack was scored on {left.get('scored')}, with other "
            f"diagnoses than those in {diagnoses} now; a pack is scored once: make a new one"
        )
    say(f"{key}: opened, and all that it seals found right")
    cases = read_cases(data, opened, diagnoses, tiers)
    say(f"{diagnoses}: {len(cases)} diagnoses read")
    trivial, rates = _baselines(cases, data, opened, training)
    leaks = [find_leaks(data, opened)]
    say("trivial baselines and leaks are done; scores and their intervals follow")
    scored = Scored(score_cases([*cases, *trivial]), rates, cases, open_pack, leaks)
    more = {
        "pack": pack["commitment"]["sha256"],
        "submission": submission,
        "development": open_pack,
    }
    content = scored.to_json() | more
    canonical(content)
    files = _files(scored, content)
    make_folder(out)
    if not open_pack and not again:
        _leave_receipt(receipt, content)
    _write(files, out)
    return scored


def pool_packs(
    parts: Sequence[tuple[Path, Path, Path]],
    out: Path,
    *,
    training: tuple[Path, Path] | None = None,
    tiers: Sequence[str] | None = None,
) -> Scored:
    """Scores over several packs that were scored already, written as :func:`score_pack` does.

    Args:
        parts: data folder, key folder and diagnoses of each pack.
        out: gets the scores.
        training: as in :func:`score_pack`.
        tiers: likewise.

    Raises:
        BlindError: a pack is not scored yet, its diagnoses are not those that were scored, or `out`
            lies in one of its folders.
    """
    for part in parts:
        _check_apart(out, *part)
    cases: list[Case] = []
    trivial: list[Case] = []
    rates: list[dict[str, Score]] = []
    leaks: list[list[Leak]] = []
    packs, submissions, development = [], [], []
    for data, key, diagnoses in parts:
        pack, opened = read_pack(data), open_key(data, key)
        development.append(is_open(opened))
        submission = folder_sha256(diagnoses, "*.json")
        if not development[-1]:
            if not (key / RECEIPT).exists():
                raise BlindError(f"{data}: is not scored yet; run `vsr2 blind score` on it first")
            if _read_receipt(key / RECEIPT).get("submission") != submission:
                raise BlindError(f"{diagnoses}: were changed after they were scored")
        own = read_cases(data, opened, diagnoses, tiers)
        cases += own
        found = _baselines(own, data, opened, training)
        trivial += found[0]
        rates += found[1]
        leaks.append(find_leaks(data, opened))
        packs.append(pack["commitment"]["sha256"])
        submissions.append(submission)
    scored = Scored(score_cases([*cases, *trivial]), rates, cases, all(development), leaks)
    files = _files(scored, scored.to_json() | {"packs": packs, "submissions": submissions})
    make_folder(out)
    _write(files, out)
    return scored


def _check_apart(out: Path, *folders: Path) -> None:
    """Refuse to write among files whose hashes are sealed, or are those of a submission."""
    for folder in folders:
        if out.resolve().is_relative_to(folder.resolve()):
            raise BlindError(
                f"{out}: lies in {folder}, whose files must stay as they are; choose another --out"
            )


def _baselines(
    cases: Sequence[Case],
    data: Path,
    key: Mapping[str, Any],
    training: tuple[Path, Path] | None,
) -> tuple[list[Case], list[dict[str, Score]]]:
    """Cases of the trivial baselines, and what the overturn rate alone tells; nothing untrained."""
    if training is None:
        return [], []
    folder, kept = training
    if read_pack(folder)["commitment"] == read_pack(data)["commitment"]:
        raise BlindError(
            f"{folder}: trains the baselines and is scored; give another pack to train"
        )
    opened = open_key(folder, kept)
    if not is_open(opened):
        raise BlindError(
            f"{kept}: is the key of a sealed pack, which training would open; train the baselines "
            "on a development pack"
        )
    return baseline_cases(cases, data, folder, opened), [rate_alone(data, key)]


def _files(scored: Scored, content: Mapping[str, Any]) -> dict[str, bytes]:
    """What is written, by name."""
    return {
        "scores.json": json_text(content).encode(),
        "scores.md": format_scores(scored).encode(),
        "reliability.png": _drawn(scored),
    }


def _write(files: Mapping[str, bytes], out: Path) -> None:
    for name, content in files.items():
        write_atomic(out / name, partial(_put, content))


def _put(content: bytes, file: IO[bytes]) -> None:
    file.write(content)


def _read_receipt(path: Path) -> dict[str, Any]:
    try:
        return read_json(path)
    except BlindError:
        raise BlindError(
            f"{path}: cannot be read; it tells which diagnoses were scored, so get it back from a "
            "copy: without it the pack is not scored again"
        ) from None


def _leave_receipt(path: Path, content: Mapping[str, Any]) -> None:
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    try:
        write_json(path, {"scored": today, **content}, private=True)
    except ResultError as error:
        raise BlindError(f"{error}; without a receipt nothing is scored") from None


def _plain(score: Score) -> dict[str, float | int | None]:
    def finite(value: float) -> float | None:
        return round(float(value), 6) if math.isfinite(value) else None

    return {
        "value": finite(score.value),
        "low": finite(score.low),
        "high": finite(score.high),
        "campaigns": score.count,
    }


def format_scores(scored: Scored) -> str:
    """The scores as Markdown: one table a group, tiers and baselines side by side."""
    columns = list(dict.fromkeys(tier for tier, _ in scored.scores))
    trivial = [name for name in BASELINES if name in columns]
    columns = [*sorted(set(columns) - set(trivial)), *trivial]
    lines: list[str] = []
    if not trivial:
        lines += ["", "Without trivial baselines: none were trained (`--train`)."]
    for group in scored.groups():
        found = {column: scored.scores.get((column, group), {}) for column in columns}
        lines += ["", f"### {group}", "", "| score | " + " | ".join(columns) + " |"]
        lines.append("| --- |" + " --- |" * len(columns))
        for name in dict.fromkeys(name for scores in found.values() for name in scores):
            cells = [
                f"{SAYING_NOTHING[name]:.2f}"
                if column in trivial and name in SAYING_NOTHING
                else _cell(found[column].get(name))
                for column in columns
            ]
            lines.append(f"| {name} | " + " | ".join(cells) + " |")
        lines += _against_baselines(scored, group)
    for number, rates in enumerate(scored.rates, 1):
        if rates:
            lines += ["", f"### overturn rate alone, pack {number}", "", "| score | value |"]
            lines.append("| --- | --- |")
            lines += [f"| {name} | {_cell(score)} |" for name, score in rates.items()]
    for number, leaks in enumerate(scored.leaks, 1):
        lines += ["", f"### what metadata tell, pack {number}", ""]
        if not leaks:
            lines.append("Not asked: too few campaigns to tell by their neighbours.")
        else:
            lines += ["| question | p | told best by | told | by chance | campaigns |"]
            lines.append("| --- | --- | --- | --- | --- | --- |")
            lines += [
                f"| {leak.question} | {leak.p:.3f} | {leak.told_by} | {leak.rate:.2f} "
                f"| {leak.chance:.2f} | {leak.count} |"
                for leak in leaks
            ]
    return "\n".join(lines).lstrip() + "\n"


def _against_baselines(scored: Scored, group: str) -> list[str]:
    """What the scores of a group are beside those of the best trivial baseline."""
    lines = []
    for score in (ANSWER, NAMED):
        margins = scored.margins(score, group)
        if margins:
            told = ", ".join(f"{tier} {value:+.2f}" for tier, value in margins.items())
            lines += ["", f"Above the best baseline, {score}: {told}."]
    beaten = {
        score: [tier for tier, value in scored.margins(score, group).items() if value < 0]
        for score in (*BEST_HIGH, *BEST_LOW)
    }
    told = "; ".join(f"{score} ({', '.join(tiers)})" for score, tiers in beaten.items() if tiers)
    return [*lines, "", f"A baseline does better in: {told}."] if told else lines


def _cell(score: Score | None) -> str:
    if score is None or not math.isfinite(score.value):
        return ""
    span = f" [{score.low:.2f}, {score.high:.2f}]" if math.isfinite(score.low) else ""
    return f"{score.value:.2f}{span} ({score.count})"


def _drawn(scored: Scored) -> bytes:
    """The reliability figure (PNG)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.5, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color="0.7", linewidth=1)
    for tier in sorted({case.tier for case in scored.cases}):
        told = [c for c in scored.cases if c.tier == tier and c.kind in ("single", NONE, UNKNOWN)]
        if told:
            rows = np.array([(min(c.first[1], 1.0), c.first[0] in c.truth) for c in told])
            bins = reliability(rows.astype(np.float64), 10)
            axes.plot(
                [stated for _, stated, _, _ in bins],
                [true for _, _, true, _ in bins],
                "o-",
                markersize=4,
                label=f"tier {tier} ({len(told)})",
            )
    axes.set_xlabel("stated probability of the first class")
    axes.set_ylabel("share in which it was true")
    axes.set_xlim(0, 1)
    axes.set_ylim(0, 1)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper left")
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=120)
    return drawn.getvalue()
