"""Tiled maps on the command line."""

import json

import numpy as np
import pytest
import zarr

import cspace
import cspace.builder
from cspace.plot import save_plot
from tests.helpers.commands import run
from tests.helpers.handmade import fill_boxes


@pytest.fixture(scope="module")
def city(tmp_path_factory):
    folder = tmp_path_factory.mktemp("city")
    occupied = fill_boxes((120, 100), np.s_[40:60, 20:50], np.s_[80:90, 40:100])
    zarr.create_array(
        str(folder / "city.zarr"),
        data=occupied,
        chunks=(50, 50),
        config={"write_empty_chunks": True},
    )
    np.save(folder / "city.npy", occupied)
    return folder, cspace.Workspace.from_array(occupied, 0.1)


def test_commands_build_plan_on_draw_and_export_a_tiled_map(city):
    folder, workspace = city
    options = (
        "--robot",
        "rect:0.5x0.3",
        "--rotations",
        "8",
        "--spacing",
        "0.1",
        "--tile",
        "32",
        "--json",
    )
    space = cspace.build(workspace, cspace.Robot.parse("rect:0.5x0.3"), rotations=8)
    for source in ("city.zarr", "city.npy"):
        out = folder / f"map-{source}.zarr"
        printed = json.loads(run("map", str(folder / source), *options, "-o", str(out)).stdout)
        assert printed["done_percent"] == 100.0
        assert printed["cells"] == dict(
            zip(("free", "mixed", "blocked"), space.count(), strict=True)
        )
    done = json.loads(
        run("map", str(folder / "city.npy"), *options, "-o", str(out)).stdout
    )  # all tiles exist
    assert done["cells"] == printed["cells"]
    assert run("info", str(out)).stdout.count("100")
    plan = ("plan", str(out), "--start", "1,1,0", "--goal", "11,9,0", "--seed", "1", "--json")
    plan_printed = json.loads(
        run(*plan, "--picture", str(folder / "path.png"), "--overwrite").stdout
    )
    assert plan_printed["certified"] is True
    run("plot", str(out), "-o", str(folder / "map.png"), "--dpi", "30", "--overwrite")
    save_plot(cspace.open(out), folder / "own.png", overwrite=True, dpi=30)
    assert (folder / "map.png").read_bytes() == (folder / "own.png").read_bytes()
    run("export", str(out), str(folder / "part.zarr"), "--window", "1,1,4,3")
    part = cspace.open(folder / "part.zarr")
    assert part.outside == "unknown"
    assert part.is_free([2.0, 2.0, 0.0]) == space.is_free([2.0, 2.0, 0.0])


def test_the_same_command_resumes_an_interrupted_build(city, tmp_path, monkeypatch):
    out = tmp_path / "stopped.zarr"
    build = cspace.builder.build

    def stop(done, total):
        if done == 5:
            raise KeyboardInterrupt

    def stopped(*arguments, **settings):
        return build(*arguments, **{**settings, "progress": stop, "workers": 1})

    cells = str(city[0] / "city.npy")
    command = ("map", cells, "--robot", "disc:0.2", "--spacing", "0.1", "--tile", "20", "-o", out)
    with monkeypatch.context() as patch:
        patch.setattr("cspace.builder.build", stopped)
        result = run(*command)
    assert (result.exit_code, result.stderr) == (130, "cspace: interrupted\n")
    assert 0.0 < json.loads(run("info", str(out), "--json").stdout)["done_percent"] < 100.0
    assert json.loads(run(*command, "--json").stdout)["done_percent"] == 100.0


def test_an_interruption_in_memory_leaves_no_map(city, tmp_path, monkeypatch):
    def stop(*arguments, **settings):
        raise KeyboardInterrupt

    monkeypatch.setattr("cspace.builder.build", stop)
    out = tmp_path / "map.zarr"
    result = run(
        "map", str(city[0] / "city.npy"), "--robot", "disc:0.2", "--spacing", "0.1", "-o", str(out)
    )
    assert (result.exit_code, result.stderr) == (130, "cspace: interrupted\n") and not out.exists()


def test_an_unfinished_store_is_reported_and_resumed(city, monkeypatch):
    folder, workspace = city
    out = folder / "half.zarr"

    def stop(done, total):
        if done == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cspace.build(
            workspace, cspace.Robot.disc(0.2), store=out, tile=20, workers=1, progress=stop
        )
    assert 0.0 < json.loads(run("info", str(out), "--json").stdout)["done_percent"] < 100.0
    refused = run("plan", str(out), "--start", "1,1", "--goal", "2,2")
    assert "run the same build again" in refused.stderr
    options = ("--robot", "disc:0.2", "--spacing", "0.1", "--tile", "20", "-o", str(out))
    other = run("map", str(folder / "city.npy"), *options)
    assert "one of other obstacles" in other.stderr
    run("map", str(folder / "city.npy"), *options, "--overwrite")
    assert cspace.open(out).progress == 1.0


def test_invalid_combinations_of_tile_options_are_refused(city):
    folder, _ = city
    options = ("map", str(folder / "city.npy"), "--robot", "disc:0.2", "--spacing", "0.1")
    assert "--tile" in run(*options, "--tile", "0", "-o", str(folder / "x.zarr")).stderr
    (folder / "other.zarr").mkdir()
    assert "exists" in run(*options, "--tile", "9", "-o", str(folder / "other.zarr")).stderr
    run(*options, "-o", str(folder / "plain.zarr"))
    assert (
        "tiled maps"
        in run(
            "export", str(folder / "plain.zarr"), str(folder / "p.npz"), "--window", "0,0,1,1"
        ).stderr
    )
