"""Exports: boundary meshes, VTK images, GeoTIFF, netCDF, ROS maps."""

import sys
from collections import Counter
from itertools import product

import numpy as np
import pytest
import trimesh
import xarray
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import Image

import cspace
from cspace import BLOCKED, FREE, MIXED, Grid, Workspace
from cspace.errors import FileError, MissingPackageError
from cspace.export._free_boundary import free_boundary
from cspace.export._plane_images import write_ros_map
from tests.helpers.maps import MAP_BUILDERS
from tests.helpers.strategies import examples

# ---- the border of the free space ----------------------------------------------------------------

STATES = hnp.arrays(
    np.uint8, st.tuples(*[st.integers(1, 5)] * 3), elements=st.integers(0, 2)
).filter(lambda state: bool((state == cspace.FREE).any()))


def list_squares(state):
    """Return boundary squares by brute force, as twice their centers, and outward normals."""
    free = set(map(tuple, np.argwhere(state == cspace.FREE).tolist()))
    normals = [
        tuple(row) for row in np.vstack([np.eye(3, dtype=int), -np.eye(3, dtype=int)]).tolist()
    ]
    squares = Counter()
    for cell, normal in product(free, normals):
        if tuple(np.add(cell, normal).tolist()) not in free:
            center = 2 * np.array(cell) + 1 + normal
            squares[tuple(center.tolist()), normal] += 1
    return squares


@given(state=STATES, spacing=st.sampled_from([0.1, 0.37, 2.0]), shift=st.floats(-50.0, 50.0))
@examples(60)
def test_the_boundary_of_free_cells_is_closed(state, spacing, shift):
    lower = (shift, -shift, 0.5)
    vertices, faces = free_boundary(state, cspace.Grid(lower, spacing, state.shape))
    indices = np.round((vertices - lower) / spacing)
    assert (vertices == lower + spacing * indices).all()
    corners = indices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1]).astype(int)
    low = corners.min(axis=1)
    high = corners.max(axis=1)
    assert (np.sort(high - low, axis=1) == [0.0, 1.0, 1.0]).all()
    centers = (low + high).astype(int)
    sides = Counter(zip(map(tuple, centers.tolist()), map(tuple, normals.tolist()), strict=True))
    assert sides == Counter({square: 2 * count for square, count in list_squares(state).items()})
    # Two triangles of half a square each fill it only if they differ.
    assert len({tuple(sorted(face)) for face in faces.tolist()}) == len(faces)
    assert len(np.unique(vertices, axis=0)) == len(vertices)
    edges = Counter((face[i], face[i - 2]) for face in faces.tolist() for i in range(3))
    assert all(edges[a, b] == edges[b, a] <= 2 for a, b in edges)


@pytest.fixture(scope="module")
def ball():
    """Build a map of a ball among voxels.

    No two FREE cells touch only in an edge.
    """
    cells = np.zeros((20, 18, 16), dtype=bool)
    cells[4:9, 5:8, 3:12] = True
    cells[13, 12, 8] = True
    workspace = cspace.Workspace.from_array(cells, 0.1, (-0.7, 3.0, 0.3))
    return cspace.build(workspace, cspace.Robot.ball(0.13), outside="free", counts=True)


def test_a_mesh_file_reads_back(tmp_path, ball):
    path = tmp_path / "free.PLY"
    ball.export(path)
    mesh = trimesh.load_mesh(path)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(ball.count()[0] * ball.grid.spacing**3, rel=1e-5)
    vertices, faces = free_boundary(ball.cell_states, ball.grid)
    own = cspace.make_mesh(path, "surface")
    np.testing.assert_array_equal(own.vertices[own.faces], vertices[faces])


# ---- VTK images ----------------------------------------------------------------------------------


def to_numpy(array):
    """Return an array of VTK as one of numpy."""
    return pytest.importorskip("vtkmodules.util.numpy_support").vtk_to_numpy(array)


def read_vti(path):
    """Read an image and its cell arrays, indexed [x, y, z], by VTK."""
    reader = pytest.importorskip("vtkmodules.vtkIOXML").vtkXMLImageDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    assert reader.GetErrorCode() == 0
    image = reader.GetOutput()
    shape = [max(1, count - 1) for count in image.GetDimensions()]
    data = image.GetCellData()
    arrays = [data.GetArray(number) for number in range(data.GetNumberOfArrays())]
    return image, {array.GetName(): to_numpy(array).reshape(shape, order="F") for array in arrays}


@pytest.mark.thorough
@pytest.mark.parametrize("name", MAP_BUILDERS)
def test_vtk_reads_one_or_all_rotations(tmp_path, name):
    space = MAP_BUILDERS[name]()
    dataset = space.to_xarray()
    space.export(tmp_path / "map.vti")
    image, arrays = read_vti(tmp_path / "map.vti")
    np.testing.assert_array_equal(arrays["outer"].reshape(space.grid.shape), space.workspace.outer)
    assert image.GetCellData().GetScalars().GetName() == min(arrays)
    flat = (0.0,) * (3 - space.grid.dim)
    assert image.GetOrigin() == (*space.grid.lower, *flat)
    assert image.GetSpacing() == (space.grid.spacing,) * 3
    assert image.GetExtent()[1::2] == (*space.grid.shape, *flat)
    if "overlap_counts" in arrays:
        counts = arrays["overlap_counts"].reshape(space.grid.shape)
        np.testing.assert_array_equal(counts, space.overlap_counts)
    turns = space.rotations.centers
    if turns.shape[1] == 0:
        cells = arrays["cell_states"].reshape(space.grid.shape)
        np.testing.assert_array_equal(cells, dataset.cell_states)
        return
    stack = [arrays[label] for label in sorted(arrays) if label.startswith("cell_states")]
    cells = np.reshape(stack, (len(turns), *space.grid.shape))
    np.testing.assert_array_equal(cells, space.cell_states.reshape(cells.shape))
    fields = [image.GetFieldData().GetArray(axis) for axis in space.rotations.names]
    np.testing.assert_array_equal(np.transpose(list(map(to_numpy, fields))), turns)
    space.export(tmp_path / "one.vti", rotation=turns[-1])
    _, arrays = read_vti(tmp_path / "one.vti")
    np.testing.assert_array_equal(arrays["cell_states"].reshape(space.grid.shape), cells[-1])


# ---- ROS maps, GeoTIFF and netCDF, as GDAL reads them --------------------------------------------


def list_centers(space):
    """Return cell centers, shape (ny, nx, 2), from the top down."""
    x, y = (space.grid.centers(axis) for axis in range(2))
    return np.stack(np.meshgrid(x, y[::-1]), axis=-1)


@pytest.mark.thorough
@pytest.mark.parametrize("name, rotation", [("plane", None), ("grid", None), ("turning", 1.0)])
def test_a_geotiff_places_every_cell(tmp_path, name, rotation):
    space = MAP_BUILDERS[name]()
    states = space.cell_states if rotation is None else space.states_at(rotation)
    space.export(tmp_path / "map.tif", rotation=rotation)
    image = pytest.importorskip("rioxarray").open_rasterio(tmp_path / "map.tif")
    centers = np.stack(np.meshgrid(image.x, image.y), axis=-1)
    np.testing.assert_allclose(centers, list_centers(space), atol=1e-9)
    bounds = (*space.grid.lower, *space.grid.upper)
    np.testing.assert_allclose(image.rio.bounds(), bounds, atol=1e-9)
    np.testing.assert_array_equal(image.values[0], states.T[::-1])
    assert 'UNIT["metre",1' in image.rio.crs.to_wkt()
    shades = np.asarray(Image.open(tmp_path / "map.tif").convert("L")).astype(int)
    brightness = [shades[image.values[0] == state].min() for state in np.unique(states)]
    assert len(brightness) > 1
    assert (np.diff(brightness) < 0).all()


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["plane", "turning"])
@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_netcdf_places_a_plane_map(tmp_path, name):
    space = MAP_BUILDERS[name]()
    space.export(tmp_path / "map.nc")
    read = pytest.importorskip("rioxarray").open_rasterio
    opened = read(tmp_path / "map.nc", variable="cell_states")
    image = opened[0] if isinstance(opened, list) else opened
    centers = np.stack(np.meshgrid(image.x, image.y), axis=-1)
    np.testing.assert_allclose(centers, list_centers(space), atol=1e-9)
    turns = np.sort(space.rotations.centers[:, 0]) if name == "turning" else [()]
    states = [space.states_at(turn).T[::-1] for turn in turns]
    np.testing.assert_array_equal(image["cell_states"].values, states)


def test_netcdf_holds_maps_in_space_and_single_rotations(tmp_path, ball):
    ball.export(tmp_path / "ball.nc")
    with xarray.open_dataset(tmp_path / "ball.nc") as dataset:
        assert dataset["x"].attrs["units"] == "m"
        assert dataset["cell_states"].dims == ("z", "y", "x")
        np.testing.assert_array_equal(dataset["cell_states"].values.T, ball.cell_states)
        np.testing.assert_array_equal(dataset["outer"].values.T, ball.workspace.outer)
        flags = dataset["cell_states"].attrs
        assert flags["flag_meanings"] == "free mixed blocked"
        assert flags["flag_values"].tolist() == [cspace.FREE, cspace.MIXED, cspace.BLOCKED]
    space = MAP_BUILDERS["turning"]()
    space.export(tmp_path / "one.nc", rotation=1.0)
    with xarray.open_dataset(tmp_path / "one.nc") as dataset:
        np.testing.assert_array_equal(dataset["cell_states"].values.T, space.states_at(1.0))
        assert abs(float(dataset["yaw"]) - 1.0) <= float(dataset["covering_angle"])


@pytest.mark.parametrize("rotations", [5, 8, (-0.4, 1.0, 2.0, 5.0, 5.883185307179586)])
@pytest.mark.parametrize(
    "robot", ["disc:0.2", "rect:0.4x0.2", [(-0.2, -0.1), (0.4, -0.1), (0.0, 0.3)]]
)
def test_yaws_of_a_dataset_ascend(robot, rotations, tmp_path):
    """They are an index, whose slices hold the states at these yaws."""
    workspace = cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1)
    space = cspace.build(workspace, robot, rotations=rotations)
    dataset = space.to_xarray()
    space.export(tmp_path / "map.nc")
    with xarray.open_dataset(tmp_path / "map.nc") as opened:
        np.testing.assert_array_equal(opened.yaw, dataset.yaw)
        states = opened.cell_states.transpose(*dataset.cell_states.dims)
        np.testing.assert_array_equal(states, dataset.cell_states)
    yaws = dataset.yaw.values
    assert (np.diff(yaws) > 0.0).all() and set(yaws) == set(space.rotations.centers[:, 0])
    low, high = dataset.yaw_bounds.values.T
    assert ((low < yaws) & (yaws < high)).all()
    np.testing.assert_allclose(high[:-1], low[1:], atol=1e-12)
    assert high[-1] - low[0] == pytest.approx(2.0 * np.pi)
    for yaw in np.random.default_rng(1).uniform(low[0], high[-1], 20):
        one = dataset.isel(rotation=int(((low <= yaw) & (yaw <= high)).argmax()))
        np.testing.assert_array_equal(one.cell_states, space.states_at(yaw))
        nearest = dataset.sel(yaw=yaw, method="nearest")
        assert abs(float(nearest.yaw) - yaw) == np.abs(yaws - yaw).min()
        same_slice = space.slice_of[int(space.rotations.cell_of(yaw))]
        assert one.slice_of == same_slice


def test_netcdf_without_xarray_names_the_extra_and_writes_nothing(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(MissingPackageError, match=r"type: pip install .*\[xarray\]"):
        MAP_BUILDERS["grid"]().export(tmp_path / "map.nc")
    assert not list(tmp_path.iterdir())


@given(
    state=hnp.arrays(
        np.uint8,
        st.tuples(st.integers(1, 7), st.integers(1, 7)),
        elements=st.sampled_from([FREE, MIXED, BLOCKED]),
    ),
    lower=st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)),
    spacing=st.floats(1e-3, 1e3) | st.just(1e-3 / 3.0),
)
def test_written_maps_read_back_identically(tmp_path_factory, state, lower, spacing):
    path = tmp_path_factory.mktemp("written") / "a map.yaml"
    grid = Grid(lower, spacing, state.shape)
    (path.parent / "a map.pgm").write_text("precious")
    with pytest.raises(FileError, match=r"a map\.pgm: exists"):
        write_ros_map(state, grid, path)
    assert [file.read_text() for file in path.parent.iterdir()] == ["precious"]
    write_ros_map(state, grid, path, overwrite=True)
    cautious = Workspace.open(path)
    bold = Workspace.open(path, unknown="free")
    assert cautious.grid == bold.grid == grid
    assert np.array_equal(cautious.outer, state != FREE)
    assert np.array_equal(bold.outer, state == BLOCKED)
    assert sorted(file.name for file in path.parent.iterdir()) == ["a map.pgm", "a map.yaml"]
