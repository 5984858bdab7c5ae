"""The deletion test: without a wing, the rest still works, and what needs the wing says so."""

import os
import shutil
import subprocess
import sys

import pytest

from tests.helpers.repository import ROOT

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
space.add_obstacle("crate", cspace.Robot.rectangle(0.2, 0.2).shape)
assert not space.is_free((0.0, 0.0, 0.0))
space.save("map.zarr")
assert cspace.open("map.zarr").count() == space.count()
try:
    CALL
except ModuleNotFoundError as error:
    print(error)
"""
"""Import all modules that are left, map, plan, update, save and open; then call what needs the wing."""


@pytest.mark.parametrize(
    ("wing", "built_on_it", "call"),
    [
        ("arms", ["view"], "cspace.Arm.from_urdf"),
        ("_cli", [], "import cspace._cli"),
        ("export", [], "space.export('map.npz')"),
        ("lanes", [], "planners.audit(space, 'graph.yaml')"),
        ("plot", ["view"], "space.plot()"),
        ("reasons", [], "space.explain(*ends)"),
        ("spectral", [], "cspace.spectral.Bump"),
        ("_tiles", [], "cspace.build(workspace, 'disc:0.1', store='tiles.zarr')"),
        ("view", [], "space.view(block=False)"),
    ],
    ids=lambda value: value if isinstance(value, str) and "." not in value else "",
)
def test_the_rest_works_without_a_wing(wing, built_on_it, call, tmp_path):
    for package in ("cspace", "planners"):
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, tmp_path / package, ignore=ignored)
    for folder in (wing, *built_on_it):
        shutil.rmtree(tmp_path / "cspace" / folder)
    result = subprocess.run(
        [sys.executable, "-c", REST_OF.replace("CALL", call)],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert result.stdout.strip() == f"No module named 'cspace.{wing}'", result.stderr
