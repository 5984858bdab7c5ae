"""The page in a real browser."""

from __future__ import annotations

import io
import shutil

import numpy as np
import pytest
from PIL import Image

import cspace
from cspace.plot.scene import CellClass
from cspace.view._blocks import hex_to_rgb
from tests.helpers.waiting import until

pytest.importorskip("viser")
webdriver = pytest.importorskip("selenium.webdriver")

pytestmark = pytest.mark.thorough

FLAGS = (
    "--headless=new --no-sandbox --disable-gpu --disable-quic --no-first-run "
    "--disable-background-networking --disable-component-update --disable-sync --use-gl=angle "
    "--use-angle=swiftshader --enable-unsafe-swiftshader --window-size=1000,700 "
    "--force-device-scale-factor=0.5 --app=data:,"
)
"""Options of a browser without network requests; it renders few pixels, because in software."""

SLOW = """
window.requestAnimationFrame = draw => setTimeout(() => draw(performance.now()), 100);
window.cancelAnimationFrame = clearTimeout;
"""
"""Script that lowers the frame rate of a page from 60 to 10 per second."""


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """Start Debian's Chromium."""
    from selenium.webdriver.chrome.service import Service

    program = shutil.which("chromium")
    driver = shutil.which("chromedriver")
    if not program or not driver:
        pytest.skip("install Debian's chromium and chromium-driver")
    options = webdriver.ChromeOptions()
    options.binary_location = program
    for flag in (*FLAGS.split(), f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(flag)
    # Without this, it opens connections in advance, and a stopping server waits for their requests.
    options.add_experimental_option("prefs", {"net.network_prediction_options": 2})
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    browser = webdriver.Chrome(options=options, service=Service(driver))
    browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": SLOW})
    yield browser
    browser.quit()


def wait_for_text(browser, text):
    until(lambda: text in browser.execute_script("return document.body.innerText"))


def take_screenshot(browser):
    """Return a screenshot of the page, shape (height, width, 3)."""
    with Image.open(io.BytesIO(browser.get_screenshot_as_png())) as picture:
        return np.asarray(picture.convert("RGB")).astype(np.int64)


def shows_obstacles(browser):
    """Return True if the page has many pixels in the colour of C-obstacles."""
    away = np.abs(take_screenshot(browser) - hex_to_rgb(CellClass.COLLIDES.color)).max(axis=-1)
    return bool((away < 12).mean() > 0.01)


def press(browser, label):
    """Click a button."""
    browser.find_element("xpath", f"//button[.//text()='{label}']").click()


def test_a_page_in_the_plane_draws_moves_plans_and_plays(browser):
    from selenium.webdriver.common.keys import Keys

    occupied = np.zeros((80, 60), dtype=bool)
    occupied[40:42, :25] = True
    workspace = cspace.Workspace.from_array(occupied, 0.1)
    space = cspace.build(workspace, cspace.Robot.rectangle(0.8, 0.4), rotations=24)
    with space.view(block=False, port=0, start=(1.0, 1.0, 0.0), goal=(6.5, 1.0, 0.0)) as viewer:
        browser.get(viewer.url)
        wait_for_text(browser, "A path exists: proven.")
        until(lambda: shows_obstacles(browser))
        slider = "(//*[text()='yaw (°)']/following::*[@role='slider'])[1]"
        browser.find_element("xpath", slider).send_keys(Keys.END, Keys.ARROW_LEFT, Keys.ARROW_LEFT)
        wait_for_text(browser, "yaw 178°, in a rotation cell of 15°")
        np.testing.assert_allclose(viewer.canvas.robot, [1.0, 1.0, np.radians(178.0)], atol=1e-6)
        press(browser, "Plan")
        wait_for_text(browser, "Path found, certified: every edge is proven free.")
        press(browser, "Play")
        until(lambda: viewer.canvas.robot[0] > 1.2)
        press(browser, "Stop")
        until(lambda: browser.find_elements("xpath", "//button[.//text()='Play']"))
        entries = "return performance.getEntries().map(entry => entry.name)"
        urls = [name for name in browser.execute_script(entries) if "://" in name]
        assert urls and all(name.removeprefix("blob:").startswith(viewer.url) for name in urls)
        assert not [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]
