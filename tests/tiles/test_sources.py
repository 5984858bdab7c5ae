"""Sources of tiled builds: lazy arrays and indexed shapes."""

import os
import pickle

import numpy as np
import pytest
import shapely
import trimesh
import zarr
from hypothesis import given
from hypothesis import strategies as st

import cspace
from cspace.errors import FileError
from tests.helpers.strategies import examples
from tests.tiles.worlds import CAR, check_states, random_workspace


def map_transposed_file(cells, path):
    np.save(path.with_suffix(".npy"), np.flip(cells).T)
    return np.load(path.with_suffix(".npy"), mmap_mode="r").T[::-1, ::-1]


def store_zarr(cells, path):
    values = cells.astype(np.uint8)
    config = {"write_empty_chunks": True}
    return zarr.create_array(str(path), data=values, chunks=(10, 10), config=config)


def chunk_by_dask(cells, path):
    return pytest.importorskip("dask.array").from_array(cells, chunks=(13, 7))


def stop_after_two_tiles(done, total):
    if done == 2:
        raise InterruptedError


@pytest.mark.parametrize("make", [map_transposed_file, store_zarr, chunk_by_dask])
def test_lazy_arrays_are_read_tile_by_tile_and_resume_only_themselves(make, tmp_path, monkeypatch):
    cells = random_workspace((40, 33)).outer
    lazy = cspace.Workspace.from_array(make(cells, tmp_path / "a"), 0.1)
    other = cspace.Workspace.from_array(make(cells[::-1], tmp_path / "b"), 0.1)
    read = type(lazy.cells).read

    def read_part(source, box):
        outer, inner = read(source, box)
        assert outer.size < cells.size
        return outer, inner

    with monkeypatch.context() as patch:
        patch.setattr(type(lazy.cells), "read", read_part)
        patch.setattr("cspace._files.lazy_arrays._DIGESTED_CELLS", 100)
        with pytest.raises(InterruptedError):
            cspace.build(
                lazy, CAR, store=tmp_path / "m", tile=16, workers=1, progress=stop_after_two_tiles
            )
        with pytest.raises(FileError, match="other obstacles"):
            cspace.build(other, CAR, store=tmp_path / "m", tile=16)
        on_worker = pickle.loads(pickle.dumps(lazy))
        cspace.build(on_worker, CAR, store=tmp_path / "m", tile=16)
    space = cspace.build(cspace.Workspace.from_array(cells, 0.1), CAR)
    check_states(tmp_path / "m", space)


def test_a_build_stops_if_its_source_changes(tmp_path):
    file = tmp_path / "a.npy"
    np.save(file, np.zeros((30, 30), dtype=bool))

    def change(done, total):
        if done == 2:
            np.save(file, np.ones((30, 30), dtype=bool))
            os.utime(file, ns=(1, 1))

    workspace = cspace.Workspace.from_array(file, 0.1, lazy=True)
    with pytest.raises(FileError, match="has changed"):
        cspace.build(workspace, CAR, store=tmp_path / "m", tile=5, workers=1, progress=change)
    assert 0.0 < cspace.open(tmp_path / "m").progress < 1.0
    changed = cspace.Workspace.from_array(file, 0.1, lazy=True)
    with pytest.raises(FileError, match="other obstacles"):
        cspace.build(changed, CAR, store=tmp_path / "m", tile=5)
    assert cspace.build(changed, CAR, store=tmp_path / "other", tile=5).count()[2] == 900


def draw_polygons(rng, spacing):
    """Draw boxes, a line and a point with corners on those of cells, and a nested collection."""
    shape = rng.integers(8, 40, 2)
    lower = spacing * rng.integers(-1000, 1000, 2)
    corners = lower + spacing * rng.integers(0, shape, (6, 2))
    sizes = spacing * rng.integers(1, 9, (6, 2))
    boxes = [shapely.box(*ends) for ends in np.hstack([corners, corners + sizes])]
    points = shapely.MultiPoint(rng.uniform(lower, lower + spacing * shape, (5, 2)))
    nested = shapely.GeometryCollection([points, shapely.GeometryCollection(boxes[:2])])
    line = shapely.LineString([corners[0], corners[0] + [3 * spacing, 2 * spacing]])
    shapes = [*boxes[2:], nested, line, shapely.Point(corners[0])]
    bounds = (*lower, *(lower + spacing * shape))
    return [
        cspace.Workspace.from_polygons(shapes, spacing, bounds, lazy=lazy) for lazy in (False, True)
    ]


def draw_meshes(rng, spacing):
    """Draw closed bodies, some nested, and loose triangles."""
    bodies = []
    for radius, center in zip(rng.uniform(1.0, 8.0, 8), rng.uniform(0, 20, (8, 3)), strict=True):
        bodies.append(trimesh.creation.icosphere(1, radius).apply_translation(center))
    corners = rng.uniform(0, 20, (30, 3))
    loose = trimesh.Trimesh(corners, np.arange(30).reshape(10, 3), process=False)
    mesh = trimesh.util.concatenate([*bodies, loose]).apply_scale(spacing)
    return [cspace.Workspace.from_mesh(mesh, spacing, lazy=lazy) for lazy in (False, True)]


@pytest.mark.filterwarnings("ignore::cspace.MeshWarning")
@examples(10)
@given(
    seed=st.integers(0, 2**16),
    spacing=st.sampled_from([0.05, 0.07, 1 / 3]),
    draw=st.sampled_from([draw_polygons, draw_meshes]),
)
def test_parts_of_lazy_shapes_equal_the_whole(seed, spacing, draw):
    rng = np.random.default_rng(seed)
    whole, lazy = draw(rng, spacing)
    shape = whole.grid.shape
    for _ in range(8):
        first = rng.integers(0, shape)
        stop = np.minimum(first + rng.integers(1, 16, len(shape)), shape)
        box = tuple(map(slice, first, stop))
        outer, inner = lazy.cells.read(box)
        np.testing.assert_array_equal(outer, whole.outer[box])
        np.testing.assert_array_equal(inner, whole.inner[box])


def test_a_damaged_array_is_refused_until_it_is_restored():
    dask = pytest.importorskip("dask.array")
    is_damaged = True

    def read(block):
        if is_damaged:
            raise OSError("a disk error")
        return block

    cells = dask.zeros((8, 8), dtype=bool, chunks=4).map_blocks(read, dtype=bool)
    workspace = cspace.Workspace.from_array(cells, 0.1)
    with pytest.raises(FileError, match=r"dask array: cannot be read as an array of.*missing"):
        cspace.build(workspace, CAR)
    is_damaged = False
    assert cspace.build(workspace, CAR).grid.shape == (8, 8)
