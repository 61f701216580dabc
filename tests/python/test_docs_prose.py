"""Pages of the documentation stay readable: at most 25 words a sentence on average, 40 in one."""

import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = runpy.run_path(str(ROOT / "scripts" / "prose.py"))
AVERAGE, LONGEST, measure = SCRIPT["AVERAGE"], SCRIPT["LONGEST"], SCRIPT["measure"]
PAGES = SCRIPT["pages"](ROOT)


@pytest.mark.parametrize("page", PAGES, ids=[str(page.relative_to(ROOT)) for page in PAGES])
def test_sentences_are_short(page):
    prose = measure(page.read_text(encoding="utf-8"))
    assert prose.average <= AVERAGE
    assert [sentence for words, sentence in prose.long if words > LONGEST] == []


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
