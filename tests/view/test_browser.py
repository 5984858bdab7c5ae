"""The page in a real browser."""

from __future__ import annotations

import io
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

import cspace
from cspace.plot.artists import CLASSES, COLLIDES, OBSTACLE, UNDECIDED
from cspace.view import Viewer
from cspace.view.scene import rgb
from tests.helpers.pages import node
from tests.helpers.urdfs import planar, planar_with_tool, posed_box
from tests.helpers.waiting import until

pytest.importorskip("viser")
webdriver = pytest.importorskip("selenium.webdriver")

FLAGS = (
    "--headless=new --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader "
    "--window-size=1000,700 --force-device-scale-factor=0.5 --app=data:,"
)
"""Options of a headless browser without network requests and start page; it renders in software, so
only few pixels."""


SLOW = """
window.requestAnimationFrame = draw => setTimeout(() => draw(performance.now()), 100);
window.cancelAnimationFrame = clearTimeout;
"""
"""Script that lowers the frame rate of a page from 60 to 10 per second."""


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Start Debian's Chromium."""
    from selenium.webdriver.chrome.service import Service

    program, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not program or not driver:
        pytest.skip(
            "there is no chromium, or no chromedriver, on the PATH: apt-get install chromium chromium-driver"
        )
    options = webdriver.ChromeOptions()
    options.binary_location = program
    for flag in (*FLAGS.split(), f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(flag)
    # Without this, it opens connections in advance, and a stopping server waits for their requests.
    options.add_experimental_option("prefs", {"net.network_prediction_options": 2})
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    made = webdriver.Chrome(options=options, service=Service(driver))
    made.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": SLOW})
    yield made
    made.quit()


def read_text(browser: Any) -> str:
    """Return the text of the page."""
    return str(browser.execute_script("return document.body.innerText"))


def take_screenshot(browser: Any) -> NDArray[np.int64]:
    """Return a screenshot of the page, shape (height, width, 3)."""
    with Image.open(io.BytesIO(browser.get_screenshot_as_png())) as picture:
        return np.asarray(picture.convert("RGB")).astype(np.int64)


def measure_shares(browser: Any) -> dict[int, float]:
    """Return the share of each colour of cells."""
    page = take_screenshot(browser)
    colors = {number: rgb(CLASSES[number][1]) for number in (UNDECIDED, COLLIDES, OBSTACLE)}
    return {
        number: float((np.abs(page - color).max(axis=-1) < 12).mean())
        for number, color in colors.items()
    }


def measure_green(browser: Any) -> float:
    """Return the green share of the page.

    A FREE robot is green in any light.
    """
    red, green, blue = np.moveaxis(take_screenshot(browser), -1, 0)
    return float((green > np.maximum(red, blue) + 3).mean())


def press(browser: Any, label: str) -> None:
    """Click a button."""
    browser.find_element("xpath", f"//button[.//text()='{label}']").click()


def show_robot(browser: Any, label: str, *keys: str) -> None:
    """Move the slider with a label by keys."""
    thumb = browser.find_element(
        "xpath", f"(//*[text()='{label}']/following::*[@role='slider'])[1]"
    )
    thumb.send_keys(*keys)


@pytest.fixture(scope="module")
def flat() -> Iterator[tuple[cspace.CSpace, Viewer]]:
    """Build two connected rooms and a closed one."""
    occupied = np.zeros((80, 60), dtype=bool)
    occupied[40:42, :25] = occupied[40:42, 46:] = occupied[40:, 46:48] = True
    space = cspace.build(
        cspace.Workspace.from_array(occupied, 0.1), cspace.Robot.rectangle(0.8, 0.4), rotations=24
    )
    with space.view(block=False, port=0, start=(1.0, 1.0, 0.0), goal=(6.5, 1.0, 0.0)) as viewer:
        yield space, viewer


def test_page_in_the_plane_draws_moves_and_plans(
    browser: Any, flat: tuple[cspace.CSpace, Viewer]
) -> None:
    from selenium.webdriver.common.keys import Keys

    space, viewer = flat
    browser.get(viewer.url)
    until(lambda: "A path exists: proven." in read_text(browser))
    drawn = until(lambda: (seen := measure_shares(browser))[COLLIDES] > 0.01 and seen)
    assert drawn[UNDECIDED] > 0.005

    show_robot(browser, "yaw (°)", Keys.END, Keys.ARROW_LEFT, Keys.ARROW_LEFT)
    until(lambda: viewer.page.panel.sliders[2].value == 178.0)
    until(
        lambda: "yaw 178°, in a rotation cell of 15°" in read_text(browser)
    )  # the panel counts it
    np.testing.assert_allclose(viewer.canvas.robot, [1.0, 1.0, np.radians(178.0)], atol=1e-6)
    assert viewer.page.wait(20.0)
    canvas: Any = viewer.canvas
    cell = int(space.rotations.find_cells(np.array([0.0, 0.0, np.pi])))
    there = canvas.stage.section(canvas.cells.at(cell), canvas.cut)
    np.testing.assert_array_equal(node(viewer, "/section").image, there.image)

    press(browser, "Plan")
    until(lambda: "Path found, certified: every edge is proven free." in read_text(browser))
    assert viewer.plan is not None
    assert viewer.plan.certified
    press(browser, "Play")
    until(lambda: np.linalg.norm(viewer.canvas.robot[:2] - [1.0, 1.0]) > 0.2)
    press(browser, "Stop")
    until(lambda: browser.find_elements("xpath", "//button[.//text()='Play']"))

    viewer.page.mark("goal", np.array([6.5, 5.3, 0.0]))
    until(lambda: "No path exists: proven." in read_text(browser))
    press(browser, "Plan")
    until(lambda: read_text(browser).count("No path exists: proven.") == 2)


def test_page_loads_nothing_from_other_hosts(
    browser: Any, flat: tuple[cspace.CSpace, Viewer]
) -> None:
    asked = browser.execute_script("return performance.getEntries().map(entry => entry.name)")
    assert asked
    assert all(
        name.startswith((flat[1].url, "blob:" + flat[1].url)) for name in asked if "://" in name
    )
    errors = [
        entry["message"] for entry in browser.get_log("browser") if entry["level"] == "SEVERE"
    ]
    assert not errors


def test_page_of_an_arm_moves_and_plans(browser: Any, tmp_path: Path) -> None:
    from selenium.webdriver.common.keys import Keys

    pytest.importorskip("yourdfpy")
    arm = cspace.Arm.from_urdf(planar(tmp_path))
    space = cspace.build_arm_space({"post": posed_box((0.2, 0.2, 1.0), 1.2, 1.2)}, arm)
    with space.view(block=False, port=0, start=(-0.4, 0.3), goal=(2.0, -0.6)) as viewer:
        assert viewer.page.wait(60.0)  # compile before the browser waits
        browser.get(viewer.url)
        until(lambda: "The straight motion is not proven free." in read_text(browser))
        before = until(lambda: (seen := measure_green(browser)) > 0.003 and seen)
        show_robot(browser, "shoulder (°)", Keys.HOME, Keys.ARROW_RIGHT)
        until(lambda: viewer.page.panel.sliders[0].value == -171.7)
        until(lambda: np.allclose(viewer.canvas.robot, [np.radians(-171.7), 0.3], atol=1e-4))
        viewer.page.move(np.array([np.pi / 4, 0.0]))
        until(lambda: "BLOCKED: proven in collision" in read_text(browser))
        until(lambda: measure_green(browser) < 0.3 * before)  # it is light blue
        viewer.page.panel.time_limit.value = 30.0
        press(browser, "Plan")
        until(
            lambda: "Path found, certified: every edge is proven free." in read_text(browser), 60.0
        )  # compiles
        viewer.page.move(np.array([-0.3, 0.3]))
        press(browser, "goal")
        until(lambda: "The straight motion is free: proven." in read_text(browser))
        np.testing.assert_allclose(viewer.page.marks["goal"], [-0.3, 0.3])


def test_a_mouse_drags_the_tool_of_an_arm_to_a_plan(browser: Any, tmp_path: Path) -> None:
    pytest.importorskip("yourdfpy")
    space = cspace.build_arm_space({}, cspace.Arm.from_urdf(planar_with_tool(tmp_path)))
    with space.view(block=False, port=0, start=(-0.6, 0.9), goal=(2.0, -0.6)) as viewer:
        assert viewer.page.wait(60.0)
        browser.get(viewer.url)
        until(lambda: viewer.server.get_clients() and measure_green(browser) > 0.003)
        (client,) = viewer.server.get_clients().values()
        tool = node(viewer, "/tool")
        center, along = (
            np.array(tool.position),
            Rotation.from_quat(tool.wxyz, scalar_first=True).apply((0.0, 1.0, 0.0)),
        )
        drag(
            browser,
            *(project(client.camera, center + share * tool.scale * along) for share in (0.9, 1.8)),
        )
        until(lambda: viewer.plan is not None, 60.0)  # compiles
        assert viewer.page.wait(60.0)
        assert viewer.plan is not None and viewer.plan.certified
        moved = np.array(tool.position) - center
        np.testing.assert_allclose(
            moved / np.linalg.norm(moved), along, atol=1e-2
        )  # the axis that the mouse drew
        np.testing.assert_allclose(viewer.plan.path[0], (-0.6, 0.9))
        until(lambda: "Path found, certified: every edge is proven free." in read_text(browser))


def project(camera: Any, point: Any) -> NDArray[np.int64]:
    """Return the pixel at which a camera shows a point."""
    turn = Rotation.from_quat(camera.wxyz, scalar_first=True)
    *across, depth = turn.inv().apply(np.asarray(point) - camera.position)
    focal = camera.image_height / (2.0 * np.tan(camera.fov / 2.0))
    center = np.array([camera.image_width, camera.image_height]) / 2.0
    return np.rint(center + focal * np.array(across) / depth).astype(np.int64)


def drag(browser: Any, first: NDArray[np.int64], last: NDArray[np.int64]) -> None:
    """Drag the mouse from a pixel to another one."""
    chain = webdriver.ActionChains(browser, duration=100)
    mouse = chain.w3c_actions.pointer_action
    mouse.move_to_location(*first.tolist())
    mouse.click_and_hold()
    for share in np.linspace(0.2, 1.0, 5):
        mouse.move_to_location(*np.rint(first + share * (last - first)).astype(int).tolist())
    mouse.release()
    chain.perform()
