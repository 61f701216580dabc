"""A real browser without a screen, for tests of pages."""

from __future__ import annotations

import importlib.util
import shutil
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")
NEEDS_BROWSER = pytest.mark.skipif(
    CHROMIUM is None or DRIVER is None or importlib.util.find_spec("selenium") is None,
    reason="needs a browser: apt-get install chromium chromium-driver, pip install selenium",
)

HOSTILE_NAMES = (
    "<script>document.title='run'</script>",
    "<img src=x onerror=\"document.title='run'\">",
    "![seen](http://127.0.0.1:9/seen.png)",
    "[here](javascript:document.title='run')",
    "a | b | c",
    "two\n\n# lines",
    "&lt;b&gt;",
)
"""Names that a file of somebody else may hold; a page that takes one for markup gets another
title, an image or a link."""
MARKDOWN_FRAME = """<!doctype html><meta charset="utf-8"><title>{}</title>
<meta name="viewport" content="width=device-width">
<style>table {{ display: block; overflow: auto }} h3 {{ overflow-wrap: anywhere }}</style>{}"""
"""As viewers of Markdown frame a page of a title: wide tables scroll by themselves."""


def open_browser(size: tuple[int, int], *, draws_3d: bool = False) -> Any:
    """A driver of a browser that reaches this machine alone, `size` in pixels."""
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    drawing = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    for argument in (
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        *(drawing if draws_3d else ()),
        "--disable-background-networking",
        "--disable-dev-shm-usage",
        "--hide-scrollbars",
        f"--window-size={size[0]},{size[1]}",
        # Nothing but this machine can be reached, so what the page needs it brings.
        "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
    ):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    return webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))


def show_at(browser: Any, width: int, height: int) -> None:
    """Give the page a size in CSS pixels; headless windows are never narrower than 500."""
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600},
    )
