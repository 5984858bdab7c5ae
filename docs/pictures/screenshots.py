"""Draw the page of an arm in a browser: ``python docs/pictures/screenshots.py`` rewrites ``docs/view_arm.png``.

It needs Debian's chromium and chromium-driver.
"""

from __future__ import annotations

import shutil
import tempfile
import time
from pathlib import Path
from typing import Final

import numpy as np
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

import cspace
from cspace.view import Viewer

LINKS: Final = {
    "shoulder": ("z", 0.0, 0.3),
    "upper": ("y", 0.3, 0.6),
    "fore": ("y", 0.6, 0.5),
    "wrist_1": ("y", 0.5, 0.12),
    "wrist_2": ("z", 0.12, 0.12),
    "wrist_3": ("y", 0.12, 0.12),
}
"""Joints with their axis, height above the joint before, and length of their link, metres."""
START: Final = (0.0, 1.0, 0.8, 0.3, 0.0, 0.0)
GOAL: Final = (1.5, 0.9, 0.8, 0.2, 0.0, 0.0)
SIZE: Final = (1200, 811)
"""Width and height of the window; the page has 143 pixels less."""
LOADING_SECONDS: Final = 20.0
"""Time for a browser without a graphics card to draw the page."""


def build_arm(folder: Path) -> cspace.Arm:
    """Write and read an arm of six joints and cylinders."""
    lines = ['<robot name="six"><link name="base"/>']
    parent = "base"
    for name, (axis, height, length) in LINKS.items():
        vector = " ".join(str(int(axis == each)) for each in "xyz")
        solid = f'<geometry><cylinder radius="0.06" length="{length}"/></geometry>'
        lines += [
            f'<link name="{name}_link"><collision><origin xyz="0 0 {length / 2}"/>{solid}</collision></link>',
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name}_link"/>',
            f'<origin xyz="0 0 {height}"/><axis xyz="{vector}"/>',
            '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>',
        ]
        parent = f"{name}_link"
    lines += [
        '<link name="tool0"/><joint name="mount" type="fixed"><child link="tool0"/>',
        f'<parent link="{parent}"/><origin xyz="0 0 0.12"/></joint></robot>',
    ]
    file = folder / "six.urdf"
    file.write_text("\n".join(lines), encoding="utf-8")
    return cspace.Arm.from_urdf(file)


def see_wall() -> np.ndarray:
    """Return points of a wall behind a post whose shadow has no points."""
    across, up = np.meshgrid(np.arange(-0.8, 1.2, 0.01), np.arange(0.0, 1.2, 0.01))
    points = np.column_stack([across.ravel(), np.full(across.size, 1.6), up.ravel()])
    return points[np.abs(points[:, 0] - 0.3) > 0.1]


def take_screenshot(viewer: Viewer, file: Path) -> None:
    """Write a picture of a page."""
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or "chromium"
    for flag in (
        "--headless=new --no-sandbox --use-gl=angle --use-angle=swiftshader "
        f"--enable-unsafe-swiftshader --hide-scrollbars --window-size={SIZE[0]},{SIZE[1]}"
    ).split():
        options.add_argument(flag)
    browser = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    try:
        browser.get(viewer.url)
        time.sleep(LOADING_SECONDS)
        for button in browser.find_elements("css selector", ".mantine-Notification-closeButton"):
            button.click()  # a note that this browser draws slowly
        time.sleep(1.0)
        browser.save_screenshot(str(file))
    finally:
        browser.quit()


def main() -> None:
    """Plan past a post, stop on the way, and write the picture."""
    with tempfile.TemporaryDirectory() as folder:
        arm = build_arm(Path(folder))
    space = cspace.build_arm_space({}, arm)
    pose = np.eye(4)
    pose[:3, 3] = 0.65, 0.65, 0.3
    space.add_obstacle("post", cspace.Robot.box((0.1, 0.1, 0.6)), pose)
    space.add_obstacle("scan", see_wall(), radius=0.01)
    with space.view(block=False, port=0, start=START, goal=GOAL, frame="tool0") as viewer:
        viewer.page.panel.time_limit.value = 60.0
        viewer.page.search()
        viewer.page.wait()
        viewer.page.panel.share.value = 45.0
        viewer.page.go(0.45)
        viewer.page.wait()
        take_screenshot(viewer, Path(__file__).parents[1] / "view_arm.png")


if __name__ == "__main__":
    main()
