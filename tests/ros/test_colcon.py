"""`colcon build` makes both packages of the workspace with the real ament_cmake; where Nav2 is missing, over its stubs."""

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers.cpp import why_no_compiler
from tests.helpers.nav2 import PACKAGE, list_needs, list_stubs
from tests.helpers.repository import ROOT

PREFIX = Path(sys.prefix)
IS_MISSING = (
    why_no_compiler()
    or ("" if shutil.which("cmake") else "no cmake here")
    or ("" if importlib.util.find_spec("colcon_core") else "no colcon here")
    or ("" if (PREFIX / "share/ament_cmake/cmake").is_dir() else "no ament_cmake here")
)
pytestmark = pytest.mark.skipif(bool(IS_MISSING), reason=IS_MISSING)

NOT_ROS = {"ament_cmake", "libzstd-dev"}
"""Keys of rosdep that are no packages of ROS, or real ones here."""

STUBS = """
template <typename Message> void stub_publish(const Message&) {}
namespace rclcpp_lifecycle { class LifecycleNode; }
inline void stub_spin_once(rclcpp_lifecycle::LifecycleNode&) {}
"""
"""What stubs of nodes leave to tests."""


def write_packages(prefix):
    """Write a package of CMake for each package of ROS that package.xml names, with the stubs as its headers."""
    for name in list_needs(PACKAGE) - NOT_ROS:
        folder = prefix / "share" / name / "cmake"
        folder.mkdir(parents=True)
        folders = ";".join(map(str, list_stubs("jazzy")))
        text = f'set({name}_INCLUDE_DIRS "{folders}")\n'
        if name == "pluginlib":
            text += "function(pluginlib_export_plugin_description_file)\nendfunction()\n"
        (folder / f"{name}Config.cmake").write_text(text)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Build a clone's workspace; return the folder of what is installed."""
    clone = tmp_path_factory.mktemp("clone")
    shutil.copytree(ROOT / "ros", clone / "ros", ignore=shutil.ignore_patterns("build", "install"))
    (clone / "cspace").symlink_to(ROOT / "cspace")
    write_packages(clone / "stubs")
    (clone / "stubs.hpp").write_text(STUBS)
    places = os.pathsep.join((str(clone / "stubs"), str(PREFIX)))
    environment = {
        **os.environ,
        "PATH": f"{PREFIX / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "AMENT_PREFIX_PATH": places,
        "CMAKE_PREFIX_PATH": places,
        "CXXFLAGS": f"-include {clone / 'stubs.hpp'} -w",
    }
    command = ["-m", "colcon", "build", "--executor", "sequential"]
    options = ["--cmake-args", "-DCMAKE_BUILD_TYPE=Debug"]
    done = subprocess.run(
        [sys.executable, *command, *options],
        cwd=clone / "ros",
        env=environment,
        text=True,
        capture_output=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "2 packages finished" in done.stdout
    return clone / "ros" / "install"


def test_what_is_launched_is_installed(built):
    programs = built / "cspace_nav2/lib/cspace_nav2"
    assert {file.name for file in programs.iterdir()} == {"gate_node"}
    assert (built / "cspace_nav2/lib/libcspace_nav2.so").exists()
    shared = built / "cspace_nav2/share/cspace_nav2"
    for name in ("planner.xml", "package.xml", "launch/navigation.launch.py"):
        assert (shared / name).exists()
    for name in ("params/navigation.yaml", "behavior_trees/replan_if_invalid.xml"):
        assert (shared / name).exists()
    index = "share/ament_index/resource_index/packages"
    for package in ("cspace_nav2", "cspace_nav2_py"):
        assert (built / package / index / package).exists()


def test_the_installed_planner_node_starts_and_refuses_wrong_parameters(built):
    program = built / "cspace_nav2_py/lib/cspace_nav2_py/planner_node"
    package = next((built / "cspace_nav2_py/lib").glob("python*/site-packages"))
    searched = os.pathsep.join((str(package), str(ROOT)))
    environment = {**os.environ, "PYTHONPATH": searched, "PATH": f"{PREFIX / 'bin'}:/usr/bin:/bin"}
    command = [program, "--ros-args", "-p", "drive:=dubins"]
    done = subprocess.run(command, env=environment, text=True, capture_output=True, check=False)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("cspace_planner: turning_radius ")
