"""Tiled maps on the command line."""

from pathlib import Path

import numpy as np
import pytest

import cspace
import cspace._builder
from tests.helpers.commands import document, run
from tests.helpers.handmade import fill_boxes


@pytest.fixture
def city(tmp_path, monkeypatch):
    """Enter a folder with the cells of a city."""
    monkeypatch.chdir(tmp_path)
    occupied = fill_boxes((60, 50), np.s_[20:30, 10:25], np.s_[40:45, 20:50])
    np.save("city.npy", occupied)
    return cspace.Workspace.from_array(occupied, 0.1)


BUILD = "build city.npy --robot rect:0.5x0.3 --rotations 8 --spacing 0.1 --tile 16 -o map.zarr"


def stop_after_five_tiles(done, total):
    if done == 5:
        raise KeyboardInterrupt


def test_commands_build_plan_on_and_export_a_tiled_map(city):
    space = cspace.build(city, cspace.Robot.rectangle(0.5, 0.3), rotations=8)
    printed = document(BUILD)
    assert printed["done_percent"] == 100.0
    assert list(printed["cells"].values()) == list(space.count())
    assert document("info map.zarr")["cells"] == printed["cells"]
    planned = document("plan map.zarr --start 0.7,0.7,0 --goal 5.3,0.7,0 --picture path.png")
    assert planned["certified"] and space.certify_path(planned["path"]).all()
    document("export map.zarr part.zarr --window 0.5,0.5,2,1.5")
    part = cspace.open("part.zarr")
    assert part.outside == "unknown"
    assert part.is_free([1.0, 1.0, 0.0]) == space.is_free([1.0, 1.0, 0.0])


def test_the_same_command_resumes_an_interrupted_build(city, monkeypatch):
    build = cspace.build

    def build_and_stop(*arguments, **options):
        return build(*arguments, **options | {"progress": stop_after_five_tiles, "workers": 1})

    with monkeypatch.context() as patch:
        patch.setattr("cspace.build", build_and_stop)
        result = run(BUILD)
    assert (result.exit_code, result.stderr) == (130, "cspace: interrupted\n")
    assert 0.0 < document("info map.zarr")["done_percent"] < 100.0
    refused = run("plan map.zarr --start 1,1,0 --goal 2,2,0")
    assert "a map must be complete to be read" in refused.stderr
    refused = run(f"{BUILD} --margin 0.2")
    assert "holds another map" in refused.stderr
    assert document(BUILD)["done_percent"] == 100.0
    assert document(f"{BUILD} --margin 0.2 --overwrite")["margin_m"] == 0.2
    for name in ("notes", "whole/notes", "0.0/cell_states/notes"):
        Path("map.zarr", name).touch()
        assert "holds more" in run(f"{BUILD} --overwrite").stderr
        Path("map.zarr", name).unlink()
    assert document(f"{BUILD} --overwrite")["margin_m"] == 0.0
