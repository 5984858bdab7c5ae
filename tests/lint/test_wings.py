"""The edge: each file is in the core or around it, and without a wing the rest still works.

What needs a wing says so when the wing is missing.
"""

import os
import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers.repository import ROOT, SOURCES

REST_OF = """
import importlib, pkgutil, sys
import numpy as np, cspace, planners

for package in (cspace, planners):
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)

workspace = cspace.Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1)
space = cspace.build(workspace, "rect:0.4x0.2", rotations=8)
ends = (1, 1, 0), (3, 2, 1)
assert planners.plan(space, *ends).certified
walled = np.zeros((40, 30), dtype=bool)
walled[20] = True
rooms = cspace.build(cspace.Workspace.from_array(walled, 0.1), "disc:0.2")
assert "from (1.0, 1.0) to (3.0, 2.0)" in str(planners.plan(rooms, (1, 1), (3, 2)))
space.add_obstacle("crate", cspace.Robot.rectangle(0.2, 0.2).shape)
assert not space.is_free((0.0, 0.0, 0.0))
space.save("map.zarr")
assert cspace.open("map.zarr").count() == space.count()
for call in CALLS:
    try:
        exec(call)
    except ImportError as error:
        print(error)
"""
"""Import all modules that are left, map, plan with and without success, update, save and open.

Then make the calls that need the wing.
"""


DOCS = ROOT / "docs"

LISTS = runpy.run_path(str(DOCS / "lists.py"))

WINGS = tuple(part[:-1] for part in LISTS["AROUND"] if part[-1] == "/" and part != "planners/")
"""Folders of cspace; the folders of their tests have the names without the underscore."""


def test_each_file_is_in_the_core_or_around_it():
    entries = [entry for entry in (ROOT / "cspace").iterdir() if entry.suffix in (".py", "")]
    found = [entry.stem + "/" * entry.is_dir() for entry in entries if entry.stem != "__pycache__"]
    assert sorted([*found, "planners/"]) == sorted(LISTS["AROUND"] + LISTS["CORE"])


def test_each_wing_says_that_it_is_experimental_in_its_code_and_on_its_pages():
    for name in ("planners", *(f"cspace.{wing}" for wing in WINGS)):
        summary = SOURCES[name].read_text(encoding="utf-8").partition("\n")[0]
        assert "(experimental)" in summary, name
    page = (DOCS / "explanation/architecture.md").read_text(encoding="utf-8")
    around = page.partition("## Around the core")[2].partition("## The core")[0]
    linked = set(re.findall(r"\]\(\.\./(\S+?\.md)", around))
    labelled = {
        file.relative_to(DOCS).as_posix()
        for file in DOCS.rglob("*.md")
        if "<!-- list: experimental -->" in file.read_text(encoding="utf-8")
    }
    assert linked == labelled


@pytest.mark.thorough
def test_tests_of_the_core_import_no_wing(tmp_path):
    gone = {ROOT / "cspace" / wing for wing in WINGS} | {
        ROOT / "tests" / wing.strip("_") for wing in WINGS
    }

    def is_ignored(folder, names):
        return [name for name in names if name == "__pycache__" or Path(folder, name) in gone]

    for package in ("cspace", "planners", "tests", "benchmarks"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=is_ignored)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    result = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-n0", "-m", "", "--collect-only"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert result.returncode == 0, result.stdout


READ_BY_ARMS = (
    "cspace.Robot.from_urdf('robot.urdf')",
    "cspace.Robot.open('robot.urdf')",
    "cspace.Workspace.from_moveit_scene('scene.yaml', 0.1)",
)
"""Calls of the core that a wing answers."""


@pytest.mark.parametrize(
    "wing, built_on_it, calls",
    [
        ("arms", ["view"], ("cspace.arms.Arm", *READ_BY_ARMS)),
        ("_cli", [], ("import cspace._cli",)),
        ("export", [], ("space.export('map.npz')", "space.to_xarray()")),
        ("lanes", [], ("cspace.lanes.audit(space, 'graph.yaml')",)),
        ("plot", ["view"], ("space.plot()", "workspace.plot()")),
        ("reasons", [], ("space.explain(*ends)",)),
        ("regions", [], ("space.free_region(ends[0])",)),
        ("spectral", [], ("cspace.spectral.Bump",)),
        ("_tiles", [], ("cspace.build(workspace, 'disc:0.1', store='tiles.zarr')",)),
        ("view", [], ("space.view(block=False)",)),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_the_rest_works_without_a_wing(wing, built_on_it, calls, tmp_path):
    for package in ("cspace", "planners"):
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, tmp_path / package, ignore=ignored)
    for folder in (wing, *built_on_it):
        shutil.rmtree(tmp_path / "cspace" / folder)
    result = subprocess.run(
        [sys.executable, "-c", REST_OF.replace("CALLS", repr(calls))],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    # A call that does not name the wing says that it is missing.
    messages = [
        f"No module named 'cspace.{wing}'"
        if f"cspace.{wing}" in call
        else f"cspace.{wing} is missing"
        for call in calls
    ]
    assert [line.split(";")[0] for line in result.stdout.splitlines()] == messages, result.stderr
