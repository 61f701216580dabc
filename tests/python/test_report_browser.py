"""The diagnosis page in a real browser: what is seen at once, on a desk and on a phone."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from diagnosis_content import CONTENT, ROWS, estimate
from headless import NEEDS_BROWSER, open_browser, show_at
from vsr2.diagnosis import Diagnosis
from vsr2.report.diagnosis_page import diagnosis_page

pytestmark = NEEDS_BROWSER

CAUSES = [
    {"name": name, **dict.fromkeys(("share", "first", "last"), estimate(share))}
    for name, share in (("wear", 0.4), ("catch", 0.1))
]
FALLS = {
    "effects": CAUSES,
    "steps": [
        {"effects": [], "loss": estimate(0.8)},
        {"effects": ["wear"], "loss": estimate(0.4)},
        {"effects": ["wear", "catch"], "loss": estimate(0.3)},
    ],
    "everything": estimate(0.25),
    "floor": estimate(0.2),
    "closure": estimate(0.9),
}
FIRST = [
    "What to measure next",
    "How far the gap shrinks",
    "Cause by cause",
    "Where: the conditions",
]
ENDS = """
return [...document.querySelectorAll("section")].map(section => [
  section.querySelector("h2")?.textContent ?? section.className,
  (section.querySelector("svg") ?? section).getBoundingClientRect().bottom,
])
"""
"""Lower end of each section's drawing, or of the section [pixel], by its heading."""


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    page: Path = tmp_path_factory.mktemp("page") / "index.html"
    page.write_text(diagnosis_page(Diagnosis({**CONTENT, "waterfall": FALLS}, ROWS)))
    driver = open_browser((1280, 800))
    driver.get(page.as_uri())
    yield driver
    driver.quit()


def test_what_matters_is_seen_without_scrolling(browser: Any) -> None:
    show_at(browser, 1280, 800)
    ends = dict(browser.execute_script(ENDS))
    assert {name: ends[name] for name in ("verdict", *FIRST) if ends[name] > 800} == {}


def test_a_phone_shows_the_verdict_first_and_nothing_is_wider_than_it(browser: Any) -> None:
    show_at(browser, 420, 860)
    ends = dict(browser.execute_script(ENDS))
    assert list(ends)[: 1 + len(FIRST)] == ["verdict", *FIRST]
    assert ends["What to measure next"] < 860
    assert browser.execute_script("return document.documentElement.scrollWidth") == 420


def test_marks_tell_their_values(browser: Any) -> None:
    titles = browser.execute_script(
        "return [...document.querySelectorAll('.first svg title')].map(one => one.textContent)"
    )
    assert "before: 0.800 [0.790, 0.810] nat" in titles
    assert any(text.startswith("+ wear: 0.400 [") for text in titles)
    assert sum(text.startswith(tuple(row["trial"] for row in ROWS)) for text in titles) == len(ROWS)
