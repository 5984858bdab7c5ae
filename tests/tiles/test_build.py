"""Tiled builds: equality with the map in memory, interruptions and refusals."""

import json
import multiprocessing
import os
import re
import shutil
import signal
import time
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from cspace.errors import FileError, InputError
from tests.laws.any_map import CAR, MAP_INPUTS
from tests.soak.files import reseal


def random_workspace(shape, seed=0, two=False):
    """Build sparse random obstacles; with ``two``, inner and outer cells differ."""
    rng = np.random.default_rng(seed)
    outer = rng.random(shape) < (0.01 if len(shape) == 2 else 0.003)
    inner = outer & (rng.random(shape) < 0.5) if two else None
    return cspace.Workspace.from_array(
        outer, 0.1, lower=rng.uniform(-1, 1, len(shape)), inner=inner
    )


def tiles_of(path):
    """Return the folders of finished tiles by name."""
    return {
        entry.name: entry for entry in path.iterdir() if re.fullmatch(r"\d+(\.\d+)+", entry.name)
    }


def check_states(path, space):
    """Fail unless a tiled map has the states and obstacles of a map in memory."""
    tiled = cspace.open(path)
    whole = tiled.window(space.grid.lower, space.grid.upper)
    np.testing.assert_array_equal(whole.cell_states, space.cell_states)
    np.testing.assert_array_equal(whole.workspace.outer, space.workspace.outer)
    np.testing.assert_array_equal(whole.workspace.inner, space.workspace.inner)
    assert tiled.count() == space.count()
    for part in tiles_of(path).values():
        check_tile(part, space)


def check_tile(path, space):
    """Fail unless a tile is a saved map with the states of a part of a map in memory."""
    part = cspace.open(path)
    first = np.rint((np.array(part.grid.lower) - space.grid.lower) / space.grid.spacing).astype(int)
    box = tuple(map(slice, first, first + part.grid.shape))
    np.testing.assert_array_equal(part.cell_states, space.cell_states[(..., *box)])
    assert part.outside == "unknown"


@pytest.mark.parametrize("name", MAP_INPUTS)
@pytest.mark.parametrize("outside", ["blocked", "free"])
def test_tiled_build_equals_the_map_in_memory(name, outside, tmp_path):
    shape, robot, rotations = MAP_INPUTS[name]
    workspace = random_workspace(shape, two=outside == "free")
    space = cspace.build(workspace, robot, rotations=rotations, outside=outside)
    tiled = cspace.build(
        workspace, robot, rotations=rotations, outside=outside, store=tmp_path / "m", tile=7
    )
    check_states(tmp_path / "m", space)
    assert tiled.progress == 1.0


@pytest.mark.filterwarnings("ignore::cspace.UnitWarning")  # robots may be larger than the map
@settings(max_examples=10)
@given(
    seed=st.integers(0, 2**16),
    tile=st.tuples(st.integers(1, 50), st.integers(1, 50)),
    data=st.data(),
)
def test_tiled_build_equals_the_map_in_memory_for_any_tile_and_method(
    seed, tile, data, tmp_path_factory
):
    shape = data.draw(st.tuples(st.integers(1, 24), st.integers(1, 24)))
    workspace = random_workspace(shape, seed, two=data.draw(st.booleans()))
    options = {
        "outside": data.draw(st.sampled_from(["blocked", "free"])),
        "method": data.draw(st.sampled_from(["fft", "direct"])),
        "margin": data.draw(st.sampled_from([0.0, 0.13])),
        "inner": data.draw(st.booleans()),
        "rotations": data.draw(st.sampled_from([None, 3])),
    }
    store = tmp_path_factory.mktemp("any") / "m.zarr"
    cspace.build(workspace, CAR, store=store, tile=tile, **options)
    check_states(store, cspace.build(workspace, CAR, **options))


def test_tiled_build_of_a_real_map_keeps_unknown_cells(data, tmp_path):
    file = next(iter(sorted(data.rglob("*.yaml"))))
    for unknown in ("occupied", "free"):
        workspace = cspace.Workspace.from_ros_map(file, unknown=unknown)
        robot = cspace.Robot.disc(4.0 * workspace.grid.spacing)
        cspace.build(workspace, robot, store=tmp_path / unknown, tile=300)
        check_states(tmp_path / unknown, cspace.build(workspace, robot))


# ---- faults --------------------------------------------------------------------------------------


def build_in_a_child(workspace, robot, path):
    cspace.build(workspace, robot, rotations=8, store=path, tile=64, workers=2)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_killed_builds_resume_without_rebuilding_tiles(tmp_path):
    workspace = random_workspace((900, 800))
    space = cspace.build(workspace, CAR, rotations=8)
    rng, path, done, longest = np.random.default_rng(0), tmp_path / "m", set(), 0.08
    context = multiprocessing.get_context("fork")
    times = {}
    for _ in range(20):
        child = context.Process(target=build_in_a_child, args=(workspace, CAR, path))
        child.start()
        time.sleep(rng.uniform(0.0, longest))
        os.kill(child.pid, signal.SIGKILL)
        child.join()
        longest = min(1.5 * longest, 0.4)  # grows on a slow machine until a tile is finished
        if not path.exists():
            continue
        tiled = cspace.open(path)
        if tiled.progress < 1.0:
            with pytest.raises(FileError, match="done"):
                tiled.classify([0.0, 0.0, 0.0])
        now = tiles_of(path)
        for name in set(now) - done:
            check_tile(now[name], space)
        assert done <= set(now)
        longest *= 0.5 if len(now) > len(done) else 1.0
        done = set(now)
        for name, part in now.items():
            assert times.setdefault(name, part.stat().st_ino) == part.stat().st_ino
    assert done
    cspace.build(workspace, CAR, rotations=8, store=path, tile=64)
    check_states(path, space)
    for name, part in tiles_of(path).items():
        assert times.get(name, part.stat().st_ino) == part.stat().st_ino
    assert not list(path.rglob(".cspace-*"))


def test_build_resumes_after_a_full_disk(tmp_path, monkeypatch):
    workspace, written = random_workspace((40, 33)), []
    plain = Path.write_bytes

    def full(self, content):
        written.append(self)
        if len(written) > 60:
            plain(self, content[: len(content) // 2])
            raise OSError(28, "No space left on device")
        return plain(self, content)

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(FileError, match="No space left on device"):
        cspace.build(workspace, CAR, store=tmp_path / "m", tile=8)
    monkeypatch.undo()
    space = cspace.build(workspace, CAR)
    assert tiles_of(tmp_path / "m")
    for part in tiles_of(tmp_path / "m").values():
        check_tile(part, space)
    assert 0.0 < cspace.open(tmp_path / "m").progress < 1.0
    cspace.build(workspace, CAR, store=tmp_path / "m", tile=8)
    check_states(tmp_path / "m", space)


# ---- damaged and forged folders ------------------------------------------------------------------


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    folder = tmp_path_factory.mktemp("built")
    workspace = random_workspace((20, 17))
    for name, robot in (("m", CAR), ("other", cspace.Robot.disc(0.01))):
        cspace.build(workspace, robot, rotations=4, store=folder / name, tile=8)
    return folder


@pytest.mark.parametrize(
    "name", ["zarr.json", "slice_of/zarr.json", "slice_of/c/0", "exterior/c/0/0"]
)
@pytest.mark.parametrize("change", ["flip", "cut", "remove"])
def test_damaged_shared_files_are_refused_by_open(built, tmp_path, name, change):
    path = shutil.copytree(built / "m", tmp_path / "m")
    damage(path / name, change)
    with pytest.raises(FileError):
        cspace.open(path)


@pytest.mark.parametrize("name", ["0.1/zarr.json", "0.1/cell_states/c/0/0/0", "0.1/outer/c/0/0"])
@pytest.mark.parametrize("change", ["flip", "cut", "remove"])
def test_damaged_tiles_are_refused_by_queries(built, tmp_path, name, change):
    path = shutil.copytree(built / "m", tmp_path / "m")
    damage(path / name, change)
    opened = cspace.open(path)
    lower = opened.grid.lower
    assert isinstance(opened.classify([lower[0] + 0.1, lower[1] + 0.1, 0.0]), int)
    with pytest.raises(FileError):
        opened.classify([lower[0] + 0.1, lower[1] + 1.2, 0.0])


def damage(file, change):
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.unlink()
    if change != "remove":
        file.write_bytes(content if change == "flip" else content[: len(content) // 2])


@pytest.mark.parametrize("source", ["m/1.1", "other/0.1"])
def test_tiles_of_other_places_and_maps_are_refused(built, tmp_path, source):
    path = shutil.copytree(built / "m", tmp_path / "m")
    shutil.rmtree(path / "0.1")
    shutil.copytree(built / source, path / "0.1")
    lower = np.array(cspace.open(path).grid.lower)
    with pytest.raises(FileError, match="it is a tile of another"):
        cspace.open(path).classify([lower[0] + 0.1, lower[1] + 1.2, 0.0])


def test_a_build_does_not_complete_a_map_with_a_tile_of_another_one(built, tmp_path):
    # As from a worker that still builds a map whose folder was replaced.
    workspace = random_workspace((20, 17))
    path = shutil.copytree(built / "m", tmp_path / "m")
    attributes = json.loads((path / "zarr.json").read_bytes())["attributes"]
    arrays = attributes["arrays"].replace(" exterior", "")
    reseal(path, **{**attributes, "arrays": arrays})
    shutil.rmtree(path / "0.1")
    shutil.copytree(built / "other" / "0.1", path / "0.1")
    with pytest.raises(FileError, match="tile of another map"):
        cspace.build(workspace, CAR, rotations=4, store=path, tile=8)
    shutil.rmtree(path / "0.1")
    cspace.build(workspace, CAR, rotations=4, store=path, tile=8)
    check_states(path, cspace.build(workspace, CAR, rotations=4))


@pytest.mark.parametrize(
    "change",
    [
        {"tiles": None},
        {"tiles": {"shape": [20]}},
        {"tiles": {"shape": [20, 0]}},
        {"tiles": {"shape": [20, "b"]}},
        {"tiles": {"shape": None}},
        {"tiles": {"side": [8, 0]}},
        {"tiles": {"side": [-8, -8]}},
        {"tiles": {"side": [8, 8, 8]}},
        {"tiles": {"side": 8}},
        {"inner": "no"},
        {"format_version": 5},
        {"format": "cspace-map-of-maps"},
    ],
    ids=str,
)
def test_forged_attributes_are_refused_by_open(built, tmp_path, change):
    path = shutil.copytree(built / "m", tmp_path / "m")
    attributes = json.loads((path / "zarr.json").read_bytes())["attributes"]
    for name, value in change.items():
        attributes[name] = {**attributes[name], **value} if isinstance(value, dict) else value
    reseal(path, **attributes)
    with pytest.raises(FileError):
        cspace.open(path)


# ---- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize("tile", [0, -3, 2.5, "9", (4, 4, 4), None, (3, 0)])
def test_build_rejects_invalid_tiles(tile, tmp_path):
    with pytest.raises(InputError, match="tile"):
        cspace.build(random_workspace((9, 9)), CAR, store=tmp_path / "m", tile=tile)
    assert not (tmp_path / "m").exists()


@pytest.mark.parametrize(
    "other",
    [{"margin": 0.1}, {"tile": 3}, {"rotations": 5}, {"outside": "free"}, {"inner": False}],
    ids=str,
)
def test_build_rejects_maps_with_other_options(tmp_path, other):
    workspace = random_workspace((9, 9))
    cspace.build(workspace, CAR, store=tmp_path / "m", tile=4)
    with pytest.raises(FileError, match="holds another map"):
        cspace.build(workspace, CAR, store=tmp_path / "m", **{"tile": 4, **other})
    cspace.build(workspace, CAR, store=tmp_path / "m", tile=4, method="fft", workers=1)


def test_build_rejects_other_obstacles_robots_and_rotations(tmp_path):
    workspace, turns = random_workspace((9, 9)), [0.0, 1.0, 3.0, 2 * np.pi]
    cspace.build(workspace, CAR, rotations=turns, store=tmp_path / "m", tile=4)
    inverted = cspace.Workspace.from_array(~workspace.outer, 0.1, workspace.grid.lower)
    moved = cspace.Workspace.from_array(workspace.outer, 0.1, np.add(workspace.grid.lower, 0.1))
    for cells, robot, rotations in (
        (inverted, CAR, turns),
        (moved, CAR, turns),
        (workspace, cspace.Robot.disc(0.1), turns),
        (workspace, CAR, [0.0, 2.0, 3.0, 2 * np.pi]),
    ):
        with pytest.raises(FileError, match="holds another map"):
            cspace.build(cells, robot, rotations=rotations, store=tmp_path / "m", tile=4)


def test_build_rejects_other_shapes_of_the_same_cells(tmp_path):
    first, other = (
        cspace.Workspace.from_polygons([shapely.box(0.2, 0.2, 0.5 + far, 0.5)], 0.1, (0, 0, 1, 1))
        for far in (0, 1e-4)
    )
    assert (first.outer == other.outer).all()
    cspace.build(first, CAR, store=tmp_path / "p", tile=4)
    with pytest.raises(FileError, match="holds another map"):
        cspace.build(other, CAR, store=tmp_path / "p", tile=4)


def test_build_rejects_counts_and_folders_that_are_no_tiled_map(tmp_path):
    workspace = random_workspace((9, 9))
    with pytest.raises(InputError, match="counts"):
        cspace.build(workspace, CAR, store=tmp_path / "m", tile=4, counts=True)
    cspace.build(workspace, CAR).save(tmp_path / "saved.zarr")
    with pytest.raises(FileError, match="is no tiled map"):
        cspace.build(workspace, CAR, store=tmp_path / "saved.zarr", tile=4)


def test_build_rejects_tiles_that_exceed_the_memory(tmp_path, monkeypatch):
    monkeypatch.setattr("cspace.tiles.work.free_bytes", lambda: 10_000)
    with pytest.raises(InputError, match="use a smaller tile"):
        cspace.build(random_workspace((90, 90)), CAR, store=tmp_path / "m")
