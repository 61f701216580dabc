"""The site of the documentation: every page has a place in it, and a bad link ends its build."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
ROOMS = sorted(path.parent.name for path in (ROOT / "python" / "vsr2").glob("*/__init__.py"))


def menu() -> set[Path]:
    """Pages that `docs/index.rst` lists."""
    lines = re.findall(r"^   (\w[\w/\[\]*-]*)$", (DOCS / "index.rst").read_text(), re.M)
    return {
        path
        for line in lines
        for end in (".md", ".rst", ".ipynb")
        for path in DOCS.glob(line + end)
    }


def test_every_page_has_a_place_in_the_menu():
    pages = {path for end in ("md", "rst", "ipynb") for path in DOCS.rglob(f"*.{end}")}
    assert pages - {DOCS / "README.md", DOCS / "index.rst"} == menu()


def test_every_room_has_a_page_of_its_docstrings():
    assert {path.stem for path in (DOCS / "reference" / "api").glob("*.rst")} == {*ROOMS} - {"cli"}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[a](other.md#here) $x^2$\n\n```math\nx\n```", ""),
        ("[a](other.md#there)", "there"),
        ("[a](nowhere.md)", "nowhere"),
    ],
)
def test_a_link_that_leads_nowhere_ends_the_build(tmp_path, text, said):
    pytest.importorskip("myst_nb", reason="extra `docs`")
    pytest.importorskip("furo", reason="extra `docs`")
    source = tmp_path / "docs"
    source.mkdir()
    (source / "index.md").write_text(f"# Index\n\n{text}\n\n```{{toctree}}\nother\n```\n")
    (source / "other.md").write_text("# Other\n\n## Here\n")
    build = [sys.executable, "-m", "sphinx", "-qW", "-c", DOCS / "_site", source, tmp_path / "site"]
    done = subprocess.run(
        build,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT / "python")},
    )
    assert done.returncode == bool(said), done.stderr
    assert said in done.stderr
    if not said:
        page = (tmp_path / "site" / "index.html").read_text()
        assert page.count('class="math notranslate') == 2
        assert not re.search(r'<(script|link)[^>]*(src|href)="(https?:)?//', page)
