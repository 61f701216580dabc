"""Pages with names that somebody else chose, in a real browser: names stay text."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from diagnosis_content import named_throughout
from headless import HOSTILE_NAMES, MARKDOWN_FRAME, NEEDS_BROWSER, open_browser
from synthetic_results import falling_log, make_result
from vsr2.fragility import load_fragility, run_fragility
from vsr2.report.diagnosis_page import diagnosis_page
from vsr2.report.fragility_page import write_fragility_report
from vsr2.results import save_models, save_result
from vsr2.scene import Box
from vsr2.scene.shapes import box_surface
from vsr2.view import ReplayServer, write_page

pytestmark = NEEDS_BROWSER

PATIENCE = 60.0
"""Longest wait for a page that a script builds, on a busy machine [s]."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    driver = open_browser((1280, 800), draws_3d=True)
    yield driver
    driver.quit()


def taken_for_markup(browser: Any) -> dict[str, Any]:
    """What a name would have left in the page that is shown, were it taken for markup."""
    return dict(
        browser.execute_script(
            """
            const found = (selector) => document.querySelectorAll(selector).length;
            return {
              ran: document.title === "run",
              images: found("img[src='x'], img[src*='seen.png']"),
              scripts: [...document.querySelectorAll("script")].filter(
                (one) => one.textContent.startsWith("document.title")).length,
              links: found("a[href^='javascript:']"),
              handlers: found("[onerror]"),
            };"""
        )
    )


NOTHING = {"ran": False, "images": 0, "scripts": 0, "links": 0, "handlers": 0}


@pytest.mark.parametrize("name", HOSTILE_NAMES)
def test_names_on_the_diagnosis_page(name: str, browser: Any, tmp_path: Path) -> None:
    page = tmp_path / "index.html"
    page.write_text(diagnosis_page(named_throughout(name)))
    browser.get(page.as_uri())
    assert taken_for_markup(browser) == NOTHING
    shown = browser.execute_script("return document.body.textContent")
    # Blanks are one blank on a page.
    assert " ".join(name.split()) in " ".join(shown.split())


FRAGILITY = """
name: fragility
engine: {mode: fast}
rock: {shape: box, size: [0.25, 0.5, 1.0], density: 2700.0}
motion: {mode: all_recordings, folder: records, pattern: "*.csv"}
outcome: {tail: 1.0}
fragility: {measures: [pga_g], target_pga_g: [0.2, 0.4, 0.8]}
"""


def test_names_on_the_fragility_page(browser: Any, tmp_path: Path) -> None:
    markdown_it = pytest.importorskip("markdown_it")
    times = np.arange(101) * 0.01
    rows = np.stack([times, 0.02 * (1 - np.cos(2 * np.pi * times))], axis=1)
    (tmp_path / "records").mkdir()
    # A study's name holds no such characters, and a file's no slash.
    for name in (one for one in HOSTILE_NAMES if "/" not in one):
        np.savetxt(
            tmp_path / "records" / f"{name}.csv", rows, delimiter=",", comments="",
            header="time_s,displacement_m",
        )  # fmt: skip
    study = tmp_path / "study.yaml"
    study.write_text(FRAGILITY)
    result = run_fragility(load_fragility(study), threads=1)
    assert len(set(result.motion)) == 5
    (tmp_path / "out").mkdir()
    *_, report = write_fragility_report(result, tmp_path / "out")
    html = markdown_it.MarkdownIt("commonmark", {"html": True}).enable("table")
    page = report.with_name("report.html")
    page.write_text(MARKDOWN_FRAME.format("fragility", html.render(report.read_text())))
    browser.get(page.as_uri())
    assert taken_for_markup(browser) == NOTHING
    assert browser.title == "fragility"


def in_view(browser: Any, name: str) -> bool:
    """Whether the choice of trials shows a name, in time."""
    end = time.monotonic() + PATIENCE
    shown = "return [...document.querySelectorAll('input')].map(one => one.value).join('|')"
    while time.monotonic() < end:
        if name in browser.execute_script(shown):
            return True
        time.sleep(0.2)
    return False


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result whose trials bear the names."""
    folder = tmp_path_factory.mktemp("view") / "result"
    names = np.array(HOSTILE_NAMES, dtype=object)
    logs = [falling_log() for _ in HOSTILE_NAMES]
    save_result(make_result(logs, name=names, motion=names), folder)
    save_models(folder, box_surface(Box((0.5, 0.5, 1.0))), box_surface(Box((4.0, 4.0, 0.5))))
    return folder


def test_names_in_the_3d_view(browser: Any, result: Path) -> None:
    pytest.importorskip("viser")
    with ReplayServer(result) as server:
        browser.get(server.url)
        for number, name in enumerate(HOSTILE_NAMES):
            flat = name.replace("\n", "?")
            server._trial.value = f"trial {number}: {flat}, stable"
            assert in_view(browser, flat)
            assert taken_for_markup(browser) == NOTHING
        # An open page would look for its server after the end.
        browser.get("about:blank")


def test_names_in_a_3d_page_of_its_own(browser: Any, result: Path, tmp_path: Path) -> None:
    pytest.importorskip("viser")
    for number in range(2):
        page = write_page(result, tmp_path / "replay.html", trial=number)
        assert HOSTILE_NAMES[number] not in page.read_text()
        browser.get(page.as_uri())
        assert taken_for_markup(browser) == NOTHING


def test_a_page_that_takes_names_for_markup_is_found(browser: Any, tmp_path: Path) -> None:
    page = tmp_path / "index.html"
    page.write_text(f"<!doctype html><title>mine</title><body>{''.join(HOSTILE_NAMES[:2])}</body>")
    browser.get(page.as_uri())
    assert taken_for_markup(browser) == NOTHING | {
        "ran": True, "images": 1, "scripts": 1, "handlers": 1
    }  # fmt: skip
