"""Pages and notebooks stay readable: at most 25 words a sentence on average, 40 in one."""

import json
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = runpy.run_path(str(ROOT / "scripts" / "prose.py"))
AVERAGE, LONGEST = SCRIPT["AVERAGE"], SCRIPT["LONGEST"]
measure, text_of = SCRIPT["measure"], SCRIPT["text_of"]
PAGES = SCRIPT["pages"](ROOT)


@pytest.mark.parametrize("page", PAGES, ids=[str(page.relative_to(ROOT)) for page in PAGES])
def test_sentences_are_short(page):
    prose = measure(text_of(page))
    assert prose.average <= AVERAGE
    assert [sentence for words, sentence in prose.long if words > LONGEST] == []


def test_all_that_a_user_reads_is_measured():
    named = {str(page.relative_to(ROOT)) for page in PAGES}
    assert {"README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md"} <= named
    assert {"docs/architecture.md", "models/README.md", "docs/notebooks/batches.ipynb"} <= named
    assert {str(p.relative_to(ROOT)) for p in (ROOT / "docs").rglob("*.ipynb")} <= named


def test_of_a_notebook_its_text_is_measured(tmp_path):
    page = tmp_path / "page.ipynb"
    cells = [
        {"cell_type": "markdown", "source": ["One two\n", "three."]},
        {"cell_type": "code", "source": ["not a word of this"]},
        {"cell_type": "markdown", "source": "Four five."},
    ]
    page.write_text(json.dumps({"cells": cells}))
    assert [count for count, _ in measure(text_of(page)).sentences] == [3, 2]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("# A heading of five words\n\nOne two three. Four five.", [3, 2]),
        ("One two\nthree four.\n\nFive six", [4, 2]),
        ("- One two\n  three.\n- Four five.\n1. Six seven.", [3, 2, 2]),
        ("One `two three four` [five six](seven.md).", [4]),
        ("One two:\n\n```bash\nnot a word of this\n```\n\nThree four.", [2, 2]),
        ("![not this](figure.png) One two.", [2]),
        ("| one two | three |\n| --- | --- |\n| " + "word " * 20 + "| four |", [20]),
        ("One two, e.g. three. It is 3.5 m. `Code` follows? Yes it does.", [4, 4, 2, 3]),
    ],
)
def test_sentences_are_counted(text, words):
    assert [count for count, _ in measure(text).sentences] == words


def test_the_script_fails_on_long_prose(tmp_path, monkeypatch, capsys):
    page = tmp_path / "page.md"
    page.write_text("word " * 41 + ". Two words." * 9)
    monkeypatch.setattr("sys.argv", ["prose.py", str(page)])
    assert SCRIPT["main"]() == 1
    assert "41 words" in capsys.readouterr().out
    page.write_text("One two three.")
    assert SCRIPT["main"]() == 0
