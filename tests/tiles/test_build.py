"""Tiled builds: equality with the map in memory, interruptions and refusals."""

import multiprocessing
import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
import shapely
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from cspace.errors import FileError, InputError
from cspace.store import Store
from tests.laws.any_map import CAR, MAP_INPUTS


def random_workspace(shape, seed=0, two=False):
    """Build sparse random obstacles; with ``two``, inner and outer cells differ."""
    rng = np.random.default_rng(seed)
    outer = rng.random(shape) < (0.01 if len(shape) == 2 else 0.003)
    inner = outer & (rng.random(shape) < 0.5) if two else None
    return cspace.Workspace.from_array(outer, 0.1, lower=rng.uniform(-1, 1, len(shape)), inner=inner)


def stored_states(path):
    """Read all states of a store with Zarr, by slice."""
    return zarr.open_group(str(path), mode="r")["cell_states"][...]


def check_states(path, space):
    """Fail unless a store has the states of a map in memory."""
    np.testing.assert_array_equal(stored_states(path).reshape(space._seen.shape), space._seen)


@pytest.mark.parametrize("name", MAP_INPUTS)
@pytest.mark.parametrize("outside", ["blocked", "free"])
def test_tiled_build_equals_the_map_in_memory(name, outside, tmp_path):
    shape, robot, rotations = MAP_INPUTS[name]
    workspace = random_workspace(shape, two=outside == "free")
    space = cspace.build(workspace, robot, rotations=rotations, outside=outside)
    tiled = cspace.build(workspace, robot, rotations=rotations, outside=outside, store=tmp_path / "m", tile=7)
    check_states(tmp_path / "m", space)
    assert tiled.count() == space.count()
    assert tiled.progress == 1.0
    group = zarr.open_group(str(tmp_path / "m"), mode="r")
    np.testing.assert_array_equal(group["outer"][...], workspace.outer)
    if outside == "free":
        np.testing.assert_array_equal(group["inner"][...], workspace.inner)


@pytest.mark.filterwarnings("ignore::cspace.UnitWarning")  # robots may be larger than the map
@settings(max_examples=10)
@given(seed=st.integers(0, 2**16), tile=st.tuples(st.integers(1, 50), st.integers(1, 50)), data=st.data())
def test_tiled_build_equals_the_map_in_memory_for_any_tile_and_method(seed, tile, data, tmp_path_factory):
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


# ---- faults ----------------------------------------------------------------------------------------------------------


def check_finished_tiles(path, space, known=()):
    """Check the finished tiles except ``known``; return all finished tiles."""
    store = Store.open(path)
    for index in set(store.done()) - set(known):
        record = store.known(index)
        for layer in range(store.layers):
            states = store.states(index, layer, record)
            cells = store.cells(index)
            inside = tuple(slice(0, part.stop - part.start) for part in cells)
            for k, number in enumerate(store.numbers(layer)):
                np.testing.assert_array_equal(states[(k, *inside)], space._seen[(number, *cells)])
    return set(store.done())


def build_in_a_child(workspace, robot, path):
    cspace.build(workspace, robot, rotations=8, store=path, tile=64, workers=2)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_killed_builds_resume_without_rebuilding_tiles(tmp_path):
    workspace = random_workspace((900, 800))
    space = cspace.build(workspace, CAR, rotations=8)
    rng, path, kills, done, longest = np.random.default_rng(0), tmp_path / "m", 0, set(), 0.08
    context = multiprocessing.get_context("fork")
    times = {}
    while kills < 20:
        child = context.Process(target=build_in_a_child, args=(workspace, CAR, path))
        child.start()
        time.sleep(rng.uniform(0.0, longest))
        os.kill(child.pid, signal.SIGKILL)
        child.join()
        kills += 1
        longest = min(1.5 * longest, 0.4)  # grows on a slow machine until a tile is finished
        if not path.exists():
            continue
        tiled = cspace.open(path)
        if tiled.progress < 1.0:
            with pytest.raises(FileError, match="done"):
                tiled.classify([0.0, 0.0, 0.0])
        now = check_finished_tiles(path, space, done)
        assert done <= now
        longest *= 0.5 if len(now) > len(done) else 1.0
        done = now
        for index in done:
            file = path / "record" / "c" / "/".join(map(str, (*index, 0)))
            assert times.setdefault(index, file.stat().st_mtime_ns) == file.stat().st_mtime_ns
    assert done
    steps = []
    cspace.build(workspace, CAR, rotations=8, store=path, tile=64, progress=lambda *step: steps.append(step))
    check_states(path, space)
    for index, written in times.items():
        file = path / "record" / "c" / "/".join(map(str, (*index, 0)))
        assert file.stat().st_mtime_ns == written
    assert not list(path.rglob(".cspace-*"))


def test_build_resumes_after_a_full_disk(tmp_path, monkeypatch):
    workspace, written = random_workspace((40, 33)), []
    plain = Path.write_bytes

    def full(self, content):
        written.append(self)
        if len(written) > 30:
            plain(self, content[: len(content) // 2])
            raise OSError(28, "No space left on device")
        return plain(self, content)

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(FileError, match="No space left on device"):
        cspace.build(workspace, CAR, store=tmp_path / "m", tile=8)
    monkeypatch.undo()
    space = cspace.build(workspace, CAR)
    check_finished_tiles(tmp_path / "m", space)
    assert 0.0 < cspace.open(tmp_path / "m").progress < 1.0
    cspace.build(workspace, CAR, store=tmp_path / "m", tile=8)
    check_states(tmp_path / "m", space)


# ---- refusals --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tile", [0, -3, 2.5, "9", (4, 4, 4), None, (3, 0)])
def test_build_rejects_invalid_tiles(tile, tmp_path):
    with pytest.raises(InputError, match="tile"):
        cspace.build(random_workspace((9, 9)), CAR, store=tmp_path / "m", tile=tile)
    assert not (tmp_path / "m").exists()


def test_build_rejects_stores_of_other_maps(tmp_path):
    workspace = random_workspace((9, 9))
    space = cspace.build(workspace, CAR)
    space.save(tmp_path / "saved.zarr")
    assert cspace.build(workspace, CAR, store=tmp_path / "saved.zarr").count() == space.count()
    with pytest.raises(FileError, match="another map: tile is"):
        cspace.build(workspace, CAR, store=tmp_path / "saved.zarr", tile=4)
    cspace.build(workspace, CAR, store=tmp_path / "m", tile=4)
    for other in ({"margin": 0.1}, {"tile": 3}, {"rotations": 5}, {"outside": "free"}, {"inner": False}):
        with pytest.raises(FileError, match="holds another map"):
            cspace.build(workspace, CAR, store=tmp_path / "m", **{"tile": 4, **other})
    with pytest.raises(FileError, match="built on other obstacles"):
        inverted = cspace.Workspace.from_array(~workspace.outer, 0.1, workspace.grid.lower)
        cspace.build(inverted, CAR, store=tmp_path / "m", tile=4)
    cspace.build(workspace, CAR, store=tmp_path / "r", rotations=[0.0, 1.0, 3.0, 2 * np.pi])
    with pytest.raises(FileError, match="another map: rotations"):
        cspace.build(workspace, CAR, store=tmp_path / "r", rotations=[0.0, 2.0, 3.0, 2 * np.pi])
    first, other = (
        cspace.Workspace.from_polygons([shapely.box(0.2, 0.2, 0.5 + far, 0.5)], 0.1, (0, 0, 1, 1)) for far in (0, 1e-4)
    )
    assert (first.outer == other.outer).all()
    cspace.build(first, CAR, store=tmp_path / "p", tile=4)
    with pytest.raises(FileError, match="built on other obstacles"):
        cspace.build(other, CAR, store=tmp_path / "p", tile=4)
    with pytest.raises(InputError, match="counts"):
        cspace.build(workspace, CAR, store=tmp_path / "m", tile=4, counts=True)


def test_build_rejects_tiles_that_exceed_the_memory(tmp_path, monkeypatch):
    monkeypatch.setattr("cspace.tiles.work.free_bytes", lambda: 10_000)
    with pytest.raises(InputError, match="use a smaller tile"):
        cspace.build(random_workspace((90, 90)), CAR, store=tmp_path / "m")
