"""Sources of tiled builds: lazy arrays and indexed shapes."""

import os
import pickle
from contextlib import contextmanager

import numpy as np
import pytest
import shapely
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from cspace.errors import FileError, InputError
from tests.laws.any_map import CAR, CRATE
from tests.tiles.test_build import check_states, random_workspace

WRITE_EMPTY_CHUNKS = {"write_empty_chunks": True}


def lazy_arrays(cells, folder):
    """Return cells as every kind of lazy array."""
    da, xarray = pytest.importorskip("dask.array"), pytest.importorskip("xarray")
    np.save(folder / "a.npy", cells)
    mapped = np.load(folder / "a.npy", mmap_mode="r")
    stored = zarr.create_array(
        str(folder / "a.zarr"),
        data=cells.astype(np.uint8),
        chunks=(10, 10),
        config=WRITE_EMPTY_CHUNKS,
    )
    lazily = da.from_array(cells, chunks=(13, 7))
    return {
        "memmap": mapped,
        "view": np.load(folder / "a.npy", mmap_mode="r").T[::-1].T[:, ::-1],
        "zarr": stored,
        "dask": lazily,
        "xarray": xarray.DataArray(lazily, dims=("x", "y")),
        "rioxarray": in_geotiff(cells, folder / "a.tif"),
    }


def in_geotiff(cells, path):
    """Write cells as a GeoTIFF with rows from the north; open it lazily."""
    rasterio, rioxarray = pytest.importorskip("rasterio"), pytest.importorskip("rioxarray")
    about = {
        "width": cells.shape[0],
        "height": cells.shape[1],
        "count": 1,
        "dtype": "uint8",
        "crs": "EPSG:32633",
    }
    north_west = rasterio.Affine(0.1, 0.0, 0.0, 0.0, -0.1, 0.1 * cells.shape[1])
    with rasterio.open(
        path, "w", **about, transform=north_west, tiled=True, blockxsize=16, blockysize=16
    ) as file:
        file.write(np.where(cells, 200, 50).astype(np.uint8).T[::-1], 1)
    shades = rioxarray.open_rasterio(path, chunks=16).squeeze("band", drop=True)
    return (shades > 127).transpose("x", "y")[:, ::-1]


@contextmanager
def read_in_parts(workspace):
    """Fail if all cells of a workspace are read together."""
    source, read = type(workspace.cells), type(workspace.cells).read

    def read_part(cells_of_workspace, box):
        cells = read(cells_of_workspace, box)
        assert cells[0].shape != workspace.grid.shape
        return cells

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(source, "read", read_part)
        patch.setattr("cspace.obstacles._DIGESTED_CELLS", 100)
        yield


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::PendingDeprecationWarning")
def test_arrays_are_read_tile_by_tile(tmp_path):
    cells = random_workspace((40, 33)).outer
    for name, array in lazy_arrays(cells, tmp_path).items():
        workspace = cspace.Workspace.from_array(array, 0.1)
        assert isinstance(workspace, cspace.workspace.LazyWorkspace), name
        assert "read at need" in repr(workspace)
        workspace = pickle.loads(pickle.dumps(workspace))  # as sent to a worker
        with read_in_parts(workspace):
            cspace.build(workspace, CAR, store=tmp_path / f"{name}.map", tile=16)
        expected = cells if name != "view" else np.ascontiguousarray(cells.T[::-1].T[:, ::-1])
        check_states(
            tmp_path / f"{name}.map", cspace.build(cspace.Workspace.from_array(expected, 0.1), CAR)
        )
        np.testing.assert_array_equal(workspace.outer, expected)


def test_shapes_are_rasterized_tile_by_tile(tmp_path):
    rng = np.random.default_rng(0)
    boxes = [
        shapely.box(x, y, x + w, y + h)
        for x, y, w, h in rng.integers(0, 40, (30, 4)) * [0.1, 0.1, 0.02, 0.02] + 0.1
    ]
    boxes.append(shapely.LineString([(0.3, 0.1), (3.9, 4.1)]))
    bounds = (0.1, 0.1, 4.4, 4.0)
    lazy = cspace.Workspace.from_polygons(boxes, 0.1, bounds, lazy=True)
    with read_in_parts(lazy):
        cspace.build(lazy, CAR, store=tmp_path / "a", tile=9)
    check_states(
        tmp_path / "a", cspace.build(cspace.Workspace.from_polygons(boxes, 0.1, bounds), CAR)
    )
    trimesh = pytest.importorskip("trimesh")
    ball = trimesh.creation.icosphere(subdivisions=2, radius=1.6)
    lazy = cspace.Workspace.from_mesh(ball, 0.1, lazy=True)
    with read_in_parts(lazy):
        cspace.build(lazy, CRATE, store=tmp_path / "b", tile=4)
    check_states(tmp_path / "b", cspace.build(cspace.Workspace.from_mesh(ball, 0.1), CRATE))


@settings(max_examples=10)
@given(
    seed=st.integers(0, 2**16),
    spacing=st.sampled_from([0.05, 0.07, 1 / 3]),
    tile=st.integers(3, 40),
)
def test_aligned_shapes_give_the_same_cells_in_every_tile(seed, spacing, tile, tmp_path_factory):
    # Rounding of a tile's lower corner changes no cell.
    rng = np.random.default_rng(seed)
    shape = rng.integers(8, 40, 2)
    lower = spacing * rng.integers(-1000, 1000, 2)
    corners = lower + spacing * rng.integers(0, shape, (6, 2))
    parts = [
        shapely.box(*corner, *(corner + spacing * rng.integers(1, 9, 2))) for corner in corners
    ]
    parts += [
        shapely.Point(corners[0]),
        shapely.LineString([corners[0], corners[0] + [3 * spacing, 2 * spacing]]),
    ]
    bounds = (*lower, *(lower + spacing * shape))
    whole = cspace.Workspace.from_polygons(parts, spacing, bounds)
    lazy = cspace.Workspace.from_polygons(parts, spacing, bounds, lazy=True)
    path = tmp_path_factory.mktemp("aligned") / "m"
    robot = cspace.Robot.disc(1.3 * spacing)
    cspace.build(lazy, robot, store=path, tile=tile)
    check_states(path, cspace.build(whole, robot))


def lazy_pairs(cells, folder):
    """Return two arrays of one shape, such as two floors of one file, for every kind of lazy array."""
    da, xarray = (pytest.importorskip(name) for name in ("dask.array", "xarray"))
    np.save(folder / "a.npy", cells)
    mapped = np.load(folder / "a.npy", mmap_mode="r")
    group = zarr.open_group(folder / "a.zarr", mode="w")
    stores = [zarr.storage.MemoryStore() for _ in cells]
    return {
        "memmap": (mapped[0], mapped[1]),
        "memmap transposed": (mapped[0].T, mapped[0]),
        "memmap in memory": (mapped[0].copy(), mapped[1].copy()),
        "dask": tuple(da.from_array(part, chunks=8) for part in cells),
        "xarray of dask": tuple(
            xarray.DataArray(da.from_array(part, chunks=8), dims=("x", "y")) for part in cells
        ),
        "xarray of a memmap": tuple(xarray.DataArray(mapped[k], dims=("x", "y")) for k in (0, 1)),
        "zarr": tuple(
            group.create_array(f"{k}", data=cells[k], config=WRITE_EMPTY_CHUNKS) for k in (0, 1)
        ),
        "zarr in memory": tuple(
            zarr.create_array(store, data=part, config=WRITE_EMPTY_CHUNKS)
            for store, part in zip(stores, cells, strict=True)
        ),
    }


def test_build_resumes_on_the_same_lazy_array_only(tmp_path):
    cells = np.array([random_workspace((20, 20), seed=seed).outer for seed in (0, 1)])
    for name, pair in lazy_pairs(cells, tmp_path).items():
        first, other = (cspace.Workspace.from_array(array, 0.1) for array in pair)
        store = tmp_path / f"{name}.map"

        def stop(done, total):
            if done == 2:
                raise InterruptedError

        with pytest.raises(InterruptedError):
            cspace.build(first, CAR, store=store, tile=8, workers=1, progress=stop)
        with pytest.raises(FileError, match="other obstacles"):
            cspace.build(other, CAR, store=store, tile=8)
        cspace.build(pickle.loads(pickle.dumps(first)), CAR, store=store, tile=8)  # as on a worker
        expected = cspace.Workspace.from_array(np.asarray(pair[0]).astype(bool), 0.1)
        check_states(store, cspace.build(expected, CAR))


def test_build_stops_if_its_source_changes(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((30, 30), dtype=bool))

    def change(done, total):
        if done == 2:
            np.save(tmp_path / "a.npy", np.ones((30, 30), dtype=bool))
            os.utime(tmp_path / "a.npy", ns=(1, 1))

    workspace = cspace.Workspace.from_array(tmp_path / "a.npy", 0.1, lazy=True)
    with pytest.raises(FileError, match="has changed"):
        cspace.build(workspace, CAR, store=tmp_path / "m", tile=5, workers=1, progress=change)
    assert 0.0 < cspace.open(tmp_path / "m").progress < 1.0
    changed = cspace.Workspace.from_array(tmp_path / "a.npy", 0.1, lazy=True)
    with pytest.raises(FileError, match="other obstacles"):
        cspace.build(changed, CAR, store=tmp_path / "m", tile=5)


def test_lazy_arrays_with_swapped_dimensions_are_rejected():
    xarray, da = pytest.importorskip("xarray"), pytest.importorskip("dask.array")
    with pytest.raises(InputError, match="transpose"):
        cspace.Workspace.from_array(
            xarray.DataArray(da.zeros((4, 5), dtype=bool), dims=("y", "x")), 0.1
        )


def boxes_in_the_plane(rng):
    """Build a workspace of polygons, nested collections, a line and points."""
    corners = rng.uniform(0, 4, (60, 2))
    parts = [shapely.box(*corner, *(corner + rng.uniform(0.02, 0.5, 2))) for corner in corners]
    nested = shapely.GeometryCollection(
        [shapely.MultiPoint(rng.uniform(0, 4, (5, 2))), shapely.GeometryCollection(parts[40:])]
    )
    lines = shapely.LineString(rng.uniform(0, 4, (4, 2)))
    return cspace.Workspace.from_polygons(
        [*parts[:40], nested, lines], 0.1, (0.3, 0.2, 4.2, 4.6), lazy=True
    )


def balls_in_space(rng):
    """Build a workspace of closed bodies, some nested, and loose triangles."""
    trimesh = pytest.importorskip("trimesh")
    balls = [
        trimesh.creation.icosphere(2, radius).apply_translation(at)
        for radius, at in zip(rng.uniform(0.1, 0.8, 12), rng.uniform(0, 3, (12, 3)), strict=True)
    ]
    flat = trimesh.Trimesh(rng.uniform(0, 3, (30, 3)), np.arange(30).reshape(10, 3), process=False)
    return cspace.Workspace.from_mesh(trimesh.util.concatenate([*balls, flat]), 0.1, lazy=True)


@pytest.mark.filterwarnings("ignore::cspace.shapes.MeshWarning")
@pytest.mark.parametrize("make", [boxes_in_the_plane, balls_in_space])
def test_parts_of_a_source_equal_the_whole(make):
    rng = np.random.default_rng(0)
    workspace = make(rng)
    shape = np.array(workspace.grid.shape)
    whole = workspace.cells.read(tuple(slice(0, n) for n in shape))
    for _ in range(40):
        first = rng.integers(0, shape)
        box = tuple(
            slice(low, high)
            for low, high in zip(
                first, np.minimum(first + rng.integers(1, 16, len(shape)), shape), strict=True
            )
        )
        for part, cells in zip(workspace.cells.read(box), whole, strict=True):
            np.testing.assert_array_equal(part, cells[box])
