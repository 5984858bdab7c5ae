"""The commands of the page "On a Nav2 robot", word for word, where ROS 2 with Nav2 and colcon are installed.

`CSPACE_ROS_PREFIX` names the folder of a ROS 2 elsewhere than in `/opt/ros/jazzy`, of one that is built from sources, say.
"""

import os
import re
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest

from tests.helpers.repository import ROOT

USUAL = "/opt/ros/jazzy"
PREFIX = os.environ.get("CSPACE_ROS_PREFIX", USUAL)
NEEDS = (Path(PREFIX, "share/nav2_bringup"), Path(PREFIX, "bin/ros2"))
pytestmark = pytest.mark.skipif(
    not all(map(Path.exists, NEEDS)) or not shutil.which("colcon"),
    reason="no ROS 2 with Nav2 and colcon is installed",
)


def test_the_robot_of_a_first_path_arrives(tmp_path):
    page = (ROOT / "docs/howto/nav2.md").read_text(encoding="utf-8").replace(USUAL, PREFIX)
    build, launch, ask, *_ = re.findall(r"^```sh\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    clone = tmp_path / "clone"
    subprocess.run(["git", "clone", "-q", ROOT, clone], check=True)
    run = {"cwd": clone, "executable": "/bin/bash", "shell": True, "text": True}
    subprocess.run("set -e\n" + build, check=True, **run)
    server = subprocess.Popen(launch, start_new_session=True, **run)
    try:
        for _ in range(20):
            answer = subprocess.run(
                ask, capture_output=True, timeout=300, check=False, **run
            ).stdout
            if "SUCCEEDED" in answer:
                break
            time.sleep(5)
        assert "SUCCEEDED" in answer, answer
    finally:
        os.killpg(server.pid, signal.SIGINT)
        assert server.wait(60) == 0
