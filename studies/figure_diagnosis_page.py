"""Pictures of a diagnosis for the tutorial: its page in a browser, and the waterfall.

Diagnoses a campaign of a planar block whose cause is known, a tether that holds the block from a
tilt of 0.12 rad on, and takes a picture of what the page shows first. Needs chromium,
chromium-driver and selenium. Run from the repository's root (about two minutes on one core):

    python studies/figure_diagnosis_page.py [--campaigns N] [--out docs/tutorial]
"""

from __future__ import annotations

import argparse
import base64
import io
import shutil
import tempfile
from pathlib import Path

from planar.planar_library import PLANAR_LIBRARY
from planar.planar_simulator import PlanarSimulator
from planted import observe, shaken_campaign
from vsr2.diagnosis import Budget, Diagnosis, Question, diagnose_with
from vsr2.report.diagnosis_figures import waterfall_figure
from vsr2.report.diagnosis_page import write_diagnosis_page
from vsr2.report.panels import save_figure

LIBRARY = ("table_gain", "base_slope", "com_offset", "restitution", "catch")
"""Effects that are looked for: few, so that few campaigns tell them apart."""
PLANTED = (("catch", (0.12,)),)
SIZE = (1280, 800)
"""Of the picture of the page [px]."""


def diagnosed(campaigns: int) -> Diagnosis:
    """A campaign with a known cause, diagnosed."""
    shaken = shaken_campaign(12, 8, seed=4)
    observed = observe(
        shaken, PlanarSimulator(shaken, seed=99), PLANTED, nuisance=2, tier="M", seed=2
    )
    library = {name: PLANAR_LIBRARY[name] for name in LIBRARY}
    return diagnose_with(
        PlanarSimulator(shaken, library=library, seed=1), observed, Question(waterfall=True),
        budget=Budget(campaigns=campaigns, waterfall=True),
    )  # fmt: skip


def page_picture(page: Path) -> bytes:
    """What a browser shows of a page first, as PNG."""
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    driver = webdriver.ChromeService(shutil.which("chromedriver"))
    for argument in ("--headless=new", "--no-sandbox", "--hide-scrollbars", "--disable-gpu"):
        options.add_argument(argument)
    browser = webdriver.Chrome(options=options, service=driver)
    try:
        browser.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": SIZE[0], "height": SIZE[1], "deviceScaleFactor": 1, "mobile": False},
        )
        browser.get(page.resolve().as_uri())
        return base64.b64decode(browser.get_screenshot_as_base64())
    finally:
        browser.quit()


def main() -> None:
    """Write both pictures."""
    from PIL import Image

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--campaigns", type=int, default=600)
    parser.add_argument("--out", type=Path, default=Path("docs/tutorial"))
    options = parser.parse_args()
    found = diagnosed(options.campaigns)
    print(found)
    with tempfile.TemporaryDirectory() as folder:
        shown = page_picture(write_diagnosis_page(found, folder))
    picture = options.out / "diagnosis_page.webp"
    Image.open(io.BytesIO(shown)).convert("RGB").save(picture, quality=70, method=6)
    [figure] = save_figure(
        waterfall_figure(found.content), options.out / "waterfall", ("png",), dpi=100
    )
    for path in (picture, figure):
        print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
