#!/usr/bin/env python3
"""Write the tables of keys in docs/reference/ from the models, so that each default stands once.

    python scripts/reference_tables.py

`configuration.md` is written as a whole; in other pages, what stands between
`<!-- keys: MODULE.SECTION -->` and `<!-- end of keys -->`.
"""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path

from vsr2.config.reference import key_tables, reference_markdown
from vsr2.config.section import Section

PAGES = Path(__file__).resolve().parents[1] / "docs" / "reference"
_BLOCK = re.compile(r"(<!-- keys: ([\w.]+)\.(\w+) -->\n).*?(<!-- end of keys -->)", re.DOTALL)


def keys_markdown(section: type[Section]) -> str:
    """Tables of the keys of a section and of those below, for a page that has a heading of it."""
    return "\n".join(key_tables(section)).replace("\n## ", "\n### ").strip() + "\n"


def filled(text: str) -> str:
    """A page with its tables as the models have them."""
    return _BLOCK.sub(
        lambda m: f"{m[1]}\n{keys_markdown(getattr(import_module(m[2]), m[3]))}\n{m[4]}", text
    )


def pages() -> dict[Path, str]:
    """The text of every page that holds tables of keys."""
    out = {path: filled(path.read_text(encoding="utf-8")) for path in sorted(PAGES.glob("*.md"))}
    return {path: text for path, text in out.items() if _BLOCK.search(text)} | {
        PAGES / "configuration.md": reference_markdown()
    }


if __name__ == "__main__":
    for path, text in pages().items():
        path.write_text(text, encoding="utf-8")
