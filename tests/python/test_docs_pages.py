"""Links, commands and studies in the documentation are real, and results are quoted."""

import contextlib
import functools
import importlib
import io
import os
import re
import shlex
import subprocess
from pathlib import Path

import pytest
import yaml

from vsr2.cli.main import main
from vsr2.config import study_from_mapping

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "docs" / "results"
PAGES = [
    *(ROOT / name for name in ("README.md", "models/README.md", "configs/motions/README.md")),
    *(page for page in sorted((ROOT / "docs").rglob("*.md")) if RESULTS not in page.parents),
]
IDS = [str(page.relative_to(ROOT)) for page in PAGES]
GROUPS = ("config", "motion", "campaign", "effects", "blind")
"""Commands that have verbs of their own."""


def links(page: Path) -> list[tuple[Path, str]]:
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    found = [link.partition("#") for link in re.findall(r"\]\(([^)\s]+)\)", text)]
    return [
        ((page.parent / path).resolve() if path else page, anchor)
        for path, _, anchor in found
        if "://" not in path
    ]


def anchors(page: Path) -> set[str]:
    """Of headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=IDS)
def test_links_lead_somewhere(page):
    for target, anchor in links(page):
        assert target.exists(), target
        if anchor:
            assert anchor in anchors(target), f"{target}#{anchor}"


def test_every_page_is_reached_from_the_index():
    index = ROOT / "docs" / "README.md"
    reached, waiting = {index}, [index]
    while waiting:
        for target, _ in links(waiting.pop()):
            if target in PAGES and target not in reached:
                reached.add(target)
                waiting.append(target)
    assert {page for page in PAGES if page.is_relative_to(ROOT / "docs")} <= reached


def test_pages_lie_in_the_part_of_their_readers():
    docs = ROOT / "docs"
    parts = {"tutorial", "how-to", "reference", "explanation", "contributing", "validation"}
    beside = {"_site", "examples", "notebooks", "results"}
    assert {path.name for path in docs.iterdir() if path.is_dir()} == parts | beside
    # The index, what every part uses, and the page that the code names by its path.
    assert {path.name for path in docs.glob("*.md")} == {
        "README.md",
        "glossary.md",
        "architecture.md",
    }


def test_every_result_is_linked_from_a_page():
    linked = {target for page in PAGES for target, _ in links(page)}
    kept = [path for path in RESULTS.rglob("*") if path.is_file()]
    blind = [path for path in kept if path.relative_to(RESULTS).parts[0].startswith("blind_")]
    assert [path for path in kept if path not in blind and path not in linked] == []


def test_pages_that_the_code_names_exist():
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("not in a checkout")
    for name in listed.stdout.split():
        if (
            name.endswith((".py", ".pyi", ".cpp", ".hpp", ".yaml", ".sh"))
            and (ROOT / name).exists()
        ):
            text = (ROOT / name).read_text(encoding="utf-8")
            for page in re.findall(r"\bdocs/[\w/-]+\.md\b", text):
                assert (ROOT / page).exists(), f"{name}: {page}"


def test_names_on_the_page_of_the_python_functions_exist():
    text = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1:-1] for line in text.splitlines() if line.startswith("| `")]
    named = 0
    for first, second in rows:
        own = re.fullmatch(r" `(vsr2\.\w+)` ", first)
        module = importlib.import_module(own[1] if own else "vsr2")
        for name in re.findall(r"`(\w+)[`(]", second if own else first):
            assert hasattr(module, name), f"{module.__name__}.{name}"
            named += 1
    assert named > 60


def commands(page: Path) -> list[str]:
    """Lines `vsr2 ...` of blocks of shell, and in-line commands of the command line's page."""
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"^```bash\n(.*?)^```", text, re.M | re.S)
    lines = "".join(blocks).replace("\\\n", " ").splitlines()
    if page.name == "command_line.md":
        lines += re.findall(r"`(vsr2 [a-z][^`]*)`", text)
    return [line for line in lines if line.startswith("vsr2 ")]


@functools.cache
def help_text(verb: tuple[str, ...]) -> str:
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.suppress(SystemExit):
        main([*verb, "--help"])
    return out.getvalue()


@pytest.mark.parametrize("page", [page for page in PAGES if commands(page)], ids=lambda p: p.name)
def test_commands_have_the_options_that_pages_give_them(page, monkeypatch):
    monkeypatch.setitem(os.environ, "COLUMNS", "200")
    for line in commands(page):
        words = shlex.split(line, comments=True)[1:]
        verb = tuple(words[: 2 if words[0] in GROUPS else 1])
        if words[0].startswith("-") or words == ["VERB", "--help"]:
            verb = ()
        known = help_text(verb)
        assert " ".join(("vsr2", *verb)) in known, line
        for word in words:
            if word.startswith("--"):
                assert word.partition("=")[0] in known, line


def studies() -> list[tuple[str, dict]]:
    found = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for block in re.findall(r"^```yaml\n(.*?)^```", text, re.M | re.S):
            mapping = yaml.safe_load(block) or {}  # A block may be one comment.
            if {"rock", "motion"} <= set(mapping):
                found.append((page.name, mapping))
    return found


@pytest.mark.parametrize(("name", "mapping"), studies())
def test_studies_in_pages_are_read(name, mapping):
    mapping.pop("fragility", None)
    study_from_mapping(mapping, ROOT)
