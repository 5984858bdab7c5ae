"""The stubs of ROS 2 and Nav2 declare what installed headers declare, as far as the package for Nav2 uses it."""

import os
from pathlib import Path

import pytest

from tests.helpers.cpp import build_program, why_no_compiler
from tests.helpers.nav2 import ANSWERS, PACKAGE, list_stubs

pytestmark = pytest.mark.skipif(bool(why_no_compiler()), reason=why_no_compiler())

SIGNATURES = ANSWERS / "signatures.cpp"


def find_installed_folders():
    """Return the folders of headers of each ROS 2 that has Nav2: sourced ones first, then others."""
    sourced = filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))
    prefixes = [*map(Path, sourced), *sorted(Path("/opt/ros").glob("*"))]
    # Each package has a folder of its own, or all share one, as in older releases.
    folders = [
        folder
        for prefix in prefixes
        for pattern in ("include/*", "include", "opt/*/include")
        for folder in prefix.glob(pattern)
        if folder.is_dir()
    ]
    has_nav2 = any((folder / "nav2_core/global_planner.hpp").exists() for folder in folders)
    return folders if has_nav2 else []


def check(source, target, folders):
    """Check that a source compiles; warnings of installed headers do not count."""
    is_main = any((folder / "nav2_ros_common").is_dir() for folder in folders)
    standard = "-std=c++20" if is_main else "-std=c++17"
    options = [option for folder in folders for option in ("-isystem", str(folder))]
    own = f"-I{PACKAGE / 'include'}"
    build_program(target, "-fsyntax-only", standard, own, *options, source=source)


@pytest.mark.parametrize("version", ["jazzy", "main"])
def test_the_stubs_declare_all_that_the_package_relies_on(version, tmp_path):
    check(SIGNATURES, tmp_path / "program", list_stubs(version))


@pytest.mark.parametrize("source", [SIGNATURES, *sorted((PACKAGE / "src").glob("*.cpp"))])
def test_installed_headers_declare_the_same(source, tmp_path):
    folders = find_installed_folders()
    if not folders:
        pytest.skip("no Nav2 is installed: neither AMENT_PREFIX_PATH nor /opt/ros has its headers")
    check(source, tmp_path / "program", folders)
