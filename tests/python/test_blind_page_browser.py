"""The scores of a blind check in a real browser, with names that a foreign key may hold."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from headless import (
    HOSTILE_NAMES,
    MARKDOWN_FRAME,
    NEEDS_BROWSER,
    open_browser,
    show_at,
)
from vsr2.analysis.intervals import Score
from vsr2.blind.scoring.leaks import Leak
from vsr2.blind.scoring.score import ScoreCode
from vsr2.blind.scoring.scored import Scored
from vsr2.report.blind_page import scores_page

markdown_it = pytest.importorskip("markdown_it")
pytestmark = NEEDS_BROWSER


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    score = {ScoreCode.ANSWER: Score(0.5, 0.25, 0.75, 10)}
    scores = {
        ("M", group): score for group in ("all", *(f"engine {name}" for name in HOSTILE_NAMES))
    }
    leaks = [[Leak("engine", 0.5, name, 0.5, 0.4, 20) for name in HOSTILE_NAMES]]
    text = scores_page(Scored(scores, [], [], False, leaks))
    # Raw HTML is taken over, as the least careful viewer does.
    html = markdown_it.MarkdownIt("commonmark", {"html": True}).enable("table").render(text)
    page: Path = tmp_path_factory.mktemp("page") / "scores.html"
    page.write_text(MARKDOWN_FRAME.format("scores", html))
    driver = open_browser((1280, 800))
    driver.get(page.as_uri())
    yield driver
    driver.quit()


def found(browser: Any, selector: str) -> list[str]:
    script = "return [...document.querySelectorAll(arguments[0])].map(one => one.textContent)"
    return list(browser.execute_script(script, selector))


def test_names_stay_text(browser: Any) -> None:
    assert browser.title == "scores"
    assert found(browser, "script, img, a, h1") == []
    flat = [name.replace("\n", "?") for name in HOSTILE_NAMES]
    assert found(browser, "h3")[1 : 1 + len(flat)] == sorted(f"engine {name}" for name in flat)
    cells = found(browser, "table:last-of-type td:nth-child(3)")
    assert cells[-len(flat) :] == flat


def test_every_row_has_the_cells_of_its_head(browser: Any) -> None:
    counts = browser.execute_script(
        "return [...document.querySelectorAll('table')].map("
        "one => [...one.rows].map(row => row.cells.length))"
    )
    assert len(counts) == 2 + len(HOSTILE_NAMES)
    for rows in counts:
        assert len(set(rows)) == 1


@pytest.mark.parametrize("width", [1280, 420])
def test_the_page_is_as_wide_as_the_screen(browser: Any, width: int) -> None:
    show_at(browser, width, 860)
    assert browser.execute_script("return document.documentElement.scrollWidth") == width
