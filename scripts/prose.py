#!/usr/bin/env python3
"""Measure the prose of Markdown pages and notebooks in words per sentence.

    python scripts/prose.py [--worst N] [PAGE ...]      (default: all pages that a user reads)

Headings, code blocks, images and short table cells are not prose. A table cell of more than
CELL words is. Inline code is one word, a link is its text. Ends with 1 if a page exceeds AVERAGE,
or one of its sentences LONGEST.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from dataclasses import dataclass
from pathlib import Path

AVERAGE = 25.0  # words per sentence that a page may have on average
LONGEST = 40  # words that a sentence may have
LONG = 35  # words above which a sentence is listed
CELL = 15  # words above which a table cell counts as prose

_FENCE = re.compile(r"^ *```.*?^ *```[^\n]*$", re.MULTILINE | re.DOTALL)
_ITEM = re.compile(r"^\s*(?:[-*+]|\d+\.)\s+")
_ABBREVIATION = re.compile(r"\b(e\.g|i\.e|cf|vs|al|Fig|Eq|Sec|No)\.(?=\s)")
_SENTENCE_END = re.compile(r"(?<=[.!?])[)\"*_]*\s+(?=[\"'(*_]*[A-Z0-9`])")


@dataclass(frozen=True)
class Prose:
    """The sentences of one page with their numbers of words."""

    sentences: tuple[tuple[int, str], ...]

    @property
    def average(self) -> float:
        """Words per sentence; 0 for a page without prose."""
        counts = [words for words, _ in self.sentences]
        return sum(counts) / len(counts) if counts else 0.0

    @property
    def longest(self) -> int:
        """Words of the longest sentence; 0 for a page without prose."""
        return max((words for words, _ in self.sentences), default=0)

    @property
    def long(self) -> list[tuple[int, str]]:
        """Sentences above `LONG` words, the longest first."""
        return sorted((s for s in self.sentences if s[0] > LONG), reverse=True)


def measure(markdown: str) -> Prose:
    """Split a page into sentences."""
    found: list[tuple[int, str]] = []
    for paragraph in _paragraphs(markdown):
        for sentence in _SENTENCE_END.split(_ABBREVIATION.sub(r"\1", paragraph)):
            words = [word for word in sentence.split() if re.search(r"\w", word)]
            if len(words) > 1:
                found.append((len(words), " ".join(sentence.split())))
    return Prose(tuple(found))


def _paragraphs(markdown: str) -> list[str]:
    text = _FENCE.sub("\n", markdown)
    text = re.sub(r"<!--.*?-->|!\[[^\]]*\]\([^)]*\)", "", text, flags=re.DOTALL)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"`+[^`]+`+", "`code`", text)
    paragraphs: list[str] = [""]
    for line in text.splitlines():
        if line.lstrip().startswith("|"):
            cells = re.split(r"(?<!\\)\|", line)
            paragraphs += [cell for cell in cells if len(cell.split()) > CELL]
        elif line.startswith("#") or not line.strip():
            paragraphs.append("")
        elif _ITEM.match(line):
            paragraphs.append(_ITEM.sub("", line))
        else:
            paragraphs[-1] += " " + line
    return paragraphs


def text_of(page: Path) -> str:
    """The Markdown of a page: of a notebook, its cells of text."""
    text = page.read_text(encoding="utf-8")
    if page.suffix != ".ipynb":
        return text
    cells = json.loads(text)["cells"]
    return "\n\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "markdown")


def pages(root: Path) -> list[Path]:
    """The pages of the top folder, and all pages and notebooks of `docs/` and of what it shows."""
    folders = [root.glob("*.md"), (root / "docs").rglob("*.ipynb")]
    folders += [(root / name).rglob("*.md") for name in ("docs", "configs", "models")]
    return [page for folder in folders for page in sorted(folder)]


def main() -> int:
    """Print one row a page and its longest sentences."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pages", nargs="*", type=Path)
    parser.add_argument("--worst", type=int, default=3, help="long sentences listed per page")
    options = parser.parse_args()
    failed = False
    print(f"{'average':>7} {'longest':>7} {'> ' + str(LONG):>5}  page")
    for page in options.pages or pages(Path(__file__).parents[1]):
        prose = measure(text_of(page))
        above = prose.average > AVERAGE or prose.longest > LONGEST
        mark = "  <-- above the limit" if above else ""
        failed |= above
        print(f"{prose.average:7.1f} {prose.longest:7d} {len(prose.long):5d}  {page}{mark}")
        for words, sentence in prose.long[: options.worst]:
            print(f"{words:23d} words: {sentence[:150]}")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
