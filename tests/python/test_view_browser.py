"""The replay in a real browser without a screen: what is seen, and that it follows the time."""

from __future__ import annotations

import io
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from headless import NEEDS_BROWSER, open_browser, show_at
from synthetic_results import falling_log, make_result
from vsr2.results import save_models, save_result
from vsr2.scene import Box
from vsr2.scene.shapes import box_surface
from vsr2.view import ReplayServer, write_page

pytest.importorskip("viser")
keys = pytest.importorskip("selenium.webdriver.common.keys").Keys
image = pytest.importorskip("PIL.Image")

pytestmark = NEEDS_BROWSER

PATIENCE = 60.0
"""Longest wait for a picture; software rendering on a busy machine draws a few a second [s]."""
ROCK_COLORED = (40, 130)
"""Share of brown pixels in a thousand, least and most, that the rock covers in the picture."""

Pixels = NDArray[np.float64]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    driver = open_browser((700, 500), draws_3d=True)
    yield driver
    driver.quit()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("result")
    outcome = np.array(["overturned", "rocked"], dtype=object)
    result = make_result([falling_log(seed=1), falling_log(end=0.2)], outcome=outcome)
    save_result(result, path)
    save_models(
        path,
        box_surface(Box((0.4, 0.4, 1.0))),
        box_surface(Box((4.0, 4.0, 0.5), center=(0.0, 0.0, 2.25))),
    )
    return path


@pytest.fixture(scope="module")
def live(browser: Any, folder: Path) -> Iterator[ReplayServer]:
    """A server whose page the browser has opened; once, because drawing starts slowly."""
    with ReplayServer(folder) as server:
        browser.get(server.url)
        yield server
        # An open page would look for its server after the end, and log that it is gone.
        browser.get("about:blank")


def picture(browser: Any) -> Pixels:
    """What the browser shows, without the panel at the right, shape (rows, columns, 3)."""
    shown = image.open(io.BytesIO(browser.get_screenshot_as_png())).convert("RGB")
    pixels = np.asarray(shown, dtype=np.float64)
    return pixels[:, : int(0.66 * pixels.shape[1])]


def rock_pixels(pixels: Pixels) -> NDArray[np.bool_]:
    """Brown pixels: the rock's alone."""
    red, _, blue = np.moveaxis(pixels, -1, 0)
    return (red - blue > 30) & (red - blue < 130) & (red < 245)


def wait_for(condition: Callable[[], bool], what: str) -> None:
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if condition():
            return
        time.sleep(0.2)
    pytest.fail(f"not within {PATIENCE} s: {what}")


def close_notices(browser: Any) -> None:
    """viser tells that software draws; the note covers the scene."""
    for button in browser.find_elements("css selector", ".mantine-Notification-closeButton"):
        button.click()


def severe_messages(browser: Any) -> list[str]:
    log = browser.get_log("browser")
    return [entry["message"] for entry in log if entry["level"] == "SEVERE"]


def inputs(browser: Any) -> list[str]:
    return [str(e.get_attribute("value")) for e in browser.find_elements("css selector", "input")]


def sliders(browser: Any) -> list[Any]:
    return list(browser.find_elements("css selector", "[role=slider]"))


def spread(mask: NDArray[np.bool_]) -> tuple[float, float]:
    """Width and height of the brown area [pixels], single pixels aside; 0: there is none."""
    if not mask.any():
        return 0.0, 0.0
    rows, columns = np.nonzero(mask)
    low, high = np.percentile(columns, [2, 98]), np.percentile(rows, [2, 98])
    return float(low[1] - low[0]), float(high[1] - high[0])


def is_drawn(browser: Any) -> bool:
    close_notices(browser)
    share = 1000 * rock_pixels(picture(browser)).mean()
    return bool(ROCK_COLORED[0] < share < ROCK_COLORED[1])


def test_the_slider_moves_the_rock(browser: Any, live: ReplayServer, tmp_path: Path) -> None:
    wait_for(lambda: bool(sliders(browser)), "the time slider")
    wait_for(lambda: is_drawn(browser), "the rock drawn")
    upright = picture(browser)
    image.fromarray(upright.astype(np.uint8)).save(tmp_path / "upright.png")
    assert upright.std() > 20  # not blank
    width, height = spread(rock_pixels(upright))
    assert height > 1.5 * width
    assert "0.00" in inputs(browser)

    sliders(browser)[0].send_keys(keys.END)
    wait_for(lambda: live.time == 2.0, "the server knows the new time")
    # 1.5 rad at the end of `falling_log`: the rock lies on its side.
    wait_for(lambda: "85.94" in inputs(browser), "the tilt read out")

    def lies() -> bool:
        wide, high = spread(rock_pixels(picture(browser)))
        return wide > 1.5 * high

    wait_for(lies, "the rock drawn on its side")
    lying = picture(browser)
    image.fromarray(lying.astype(np.uint8)).save(tmp_path / "lying.png")
    changed = np.abs(lying - upright).max(axis=2) > 30
    assert changed.mean() > 0.02
    assert severe_messages(browser) == []


def test_contacts_are_drawn(browser: Any, live: ReplayServer) -> None:
    def red() -> float:
        r, g, b = np.moveaxis(picture(browser), -1, 0)
        return float(np.mean((r > 150) & (g < 90) & (b < 90)))

    live.show(1.0)
    wait_for(lambda: red() > 2e-4, "red contact points")


PANEL = """
    let found = [...document.querySelectorAll("*")].find((one) => one.textContent === "Trial");
    while (found && getComputedStyle(found).position !== "fixed") found = found.parentElement;
    return found ? found.getBoundingClientRect().top : null;"""
"""Top of the panel that holds the controls [px]."""


def test_the_panel_leaves_the_rocks_foot_free_on_a_phone(browser: Any, live: ReplayServer) -> None:
    live.show(0.0)
    show_at(browser, 420, 900)
    try:
        wait_for(lambda: browser.execute_script(PANEL) is not None, "panel of a phone")
        wait_for(lambda: rock_pixels(picture(browser)).any(), "rock")
        top = browser.execute_script(PANEL)
        foot = int(np.flatnonzero(rock_pixels(picture(browser)).sum(axis=1) > 5).max())
        # A rock that the panel covers would end where the panel begins.
        assert foot < top - 10
        assert not browser.execute_script(
            "return [...document.querySelectorAll('*')].some("
            "(one) => one.textContent === 'Slip x, y [mm]' && one.offsetHeight > 0)"
        )
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_play_and_pause(browser: Any, live: ReplayServer) -> None:
    def press(label: str) -> bool:
        script = """
            const wanted = arguments[0];
            const found = [...document.querySelectorAll("button")]
                .find((button) => button.textContent.trim() === wanted);
            found?.click();
            return Boolean(found);
        """
        return bool(browser.execute_script(script, label))

    live._loop.value = True  # so that it lasts longer than a slow browser needs to redraw
    live.show(0.0)
    wait_for(lambda: press("Play"), "the play button")
    wait_for(lambda: live.time > 0.1, "the time running")
    wait_for(lambda: press("Pause"), "the same button as pause")
    wait_for(lambda: not live._playing, "the pause")
    stopped = live.time
    time.sleep(0.3)
    assert live.time == stopped


def test_another_trial(browser: Any, live: ReplayServer) -> None:
    live.show(1.0)
    # As a choice in the browser would.
    live._trial.value = "trial 1: trial 1, rocked"
    assert live.time == 0.0
    live.show(2.0)
    # 0.2 rad in degrees.
    wait_for(lambda: "11.46" in inputs(browser), "the second trial's tilt")
    wait_for(lambda: is_drawn(browser), "the rock drawn again")
    assert severe_messages(browser) == []


def test_playing_ends_or_starts_again(folder: Path) -> None:
    with ReplayServer(folder) as server:
        server.show(1.95)
        server._toggle()
        wait_for(lambda: not server._playing, "the end")
        assert server.time == 2.0
        server._loop.value = True
        server._toggle()  # from the end it starts at the beginning
        assert server.time < 1.0
        server.show(1.9)
        wait_for(lambda: server.time < 1.0, "the start of the next round")
        assert server._playing


def test_two_servers_take_two_ports(folder: Path) -> None:
    with ReplayServer(folder) as first, ReplayServer(folder, port=first.port) as second:
        assert first.port != second.port
        assert second.url.endswith(str(second.port))


def test_the_page_stands_alone(browser: Any, folder: Path, tmp_path: Path) -> None:
    page = write_page(folder, tmp_path / "replay.html", trial=0)
    text = page.read_text()
    assert "<script src=" not in text
    browser.get(page.as_uri())
    wait_for(lambda: is_drawn(browser), "the rock drawn")
    seen = set()

    def both_seen() -> bool:
        wide, high = spread(rock_pixels(picture(browser)))
        seen.add("lying" if wide > 1.2 * high else "upright" if high > 0 else "none")
        return {"lying", "upright"} <= seen

    # It plays by itself and starts again at its end.
    wait_for(both_seen, "the rock upright and lying in turn")
    assert severe_messages(browser) == []
