"""Exports: boundary meshes, VTK images, GeoTIFF, netCDF, ROS maps."""

from collections import Counter
from collections.abc import Callable
from fractions import Fraction
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
import rioxarray
import trimesh
import xarray
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import Image
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOXML import vtkXMLImageDataReader

import cspace
from cspace.errors import FileError, InputError
from cspace.export.boundaries import WRITERS, free_boundary
from cspace.export.vti import write_vti
from tests.helpers.maps import MAP_BUILDERS
from tests.helpers.missing import output_without
from tests.helpers.refusals import refusals

states = hnp.arrays(
    np.uint8, st.tuples(*[st.integers(1, 5)] * 3), elements=st.integers(0, 2)
).filter(lambda state: bool((state == cspace.FREE).any()))

Surface = tuple[np.ndarray, np.ndarray]


def find_border(
    state: np.ndarray, lower: tuple[float, ...] = (0.0, 0.0, 0.0), spacing: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    return free_boundary(state, cspace.Grid(lower, spacing, state.shape))


# ---- the border of the free space ----------------------------------------------------------------


def list_squares(state: np.ndarray) -> Counter[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Return boundary squares by brute force.

    Each is twice its center, and its outward normal.
    """
    free = {tuple(cell.tolist()) for cell in np.argwhere(state == cspace.FREE)}
    normals = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    return Counter(
        (tuple(2 * i + 1 + n for i, n in zip(cell, normal, strict=True)), normal)
        for cell, normal in product(free, normals)
        if tuple(i + n for i, n in zip(cell, normal, strict=True)) not in free
    )


@given(state=states)
@settings(max_examples=60)
def test_the_boundary_of_free_cells_is_closed(state: np.ndarray) -> None:
    vertices, faces = find_border(state)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1])
    np.testing.assert_array_equal(np.abs(normals).sum(axis=1), 1.0)
    low, high = corners.min(axis=1), corners.max(axis=1)
    np.testing.assert_array_equal(
        np.sort(high - low, axis=1), np.tile([0.0, 1.0, 1.0], (len(faces), 1))
    )
    sides = Counter(
        (tuple(center), tuple(normal))
        for center, normal in zip(
            (low + high).astype(int).tolist(), normals.astype(int).tolist(), strict=True
        )
    )
    assert sides == Counter({square: 2 * count for square, count in list_squares(state).items()})
    # Two triangles of half a square each fill it only if they differ.
    assert len({tuple(sorted(face)) for face in faces.tolist()}) == len(faces)
    assert len(np.unique(vertices, axis=0)) == len(vertices)
    assert np.array_equal(np.unique(faces), np.arange(len(vertices)))
    edges = Counter((face[i], face[i - 2]) for face in faces.tolist() for i in range(3))
    assert set(Counter(tuple(sorted(edge)) for edge in edges.elements()).values()) <= {2, 4}
    assert all(edges[a, b] == edges[b, a] for a, b in edges)


@given(state=states, spacing=st.sampled_from([0.1, 0.37, 2.0]), shift=st.floats(-50.0, 50.0))
@settings(max_examples=30)
def test_the_boundary_encloses_the_volume_of_the_free_cells(
    state: np.ndarray, spacing: float, shift: float
) -> None:
    vertices, faces = find_border(state, (shift, -shift, 0.5), spacing)
    volume = Fraction(0)
    for a, b, c in np.vectorize(Fraction, otypes=[object])(vertices - vertices[0])[faces]:
        volume += sum(a[i] * (b[i - 2] * c[i - 1] - b[i - 1] * c[i - 2]) for i in range(3))
    assert float(volume / 6) == pytest.approx(
        np.count_nonzero(state == cspace.FREE) * spacing**3, rel=1e-9
    )
    for axis, n in enumerate(state.shape):
        assert np.isin(
            vertices[:, axis], (shift, -shift, 0.5)[axis] + spacing * np.arange(n + 1)
        ).all()


@pytest.fixture(scope="module")
def ball() -> cspace.CSpace:
    """Build a map of a ball among voxels.

    No two FREE cells touch only in an edge.
    """
    cells = np.zeros((20, 18, 16), dtype=bool)
    cells[4:9, 5:8, 3:12] = cells[13, 12, 8] = True
    workspace = cspace.Workspace.from_array(cells, 0.1, (-0.7, 3.0, 0.3))
    return cspace.build(workspace, cspace.Robot.ball(0.13), outside="free", counts=True)


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_mesh_file_reads_back(tmp_path: Path, ball: cspace.CSpace, suffix: str) -> None:
    path = tmp_path / f"free{suffix.upper()}"
    ball.export(path)
    mesh = trimesh.load_mesh(path)
    assert mesh.is_watertight and mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(ball.count()[0] * ball.grid.spacing**3, rel=1e-5)
    vertices, faces = free_boundary(ball.cell_states, ball.grid)
    exact = vertices if suffix != ".stl" else vertices.astype(np.float32).astype(np.float64)
    np.testing.assert_array_equal(
        np.sort(mesh.triangles, axis=None), np.sort(exact[faces], axis=None)
    )
    if suffix == ".stl":
        assert not path.read_bytes().startswith(
            b"solid"
        )  # which readers would take for an STL file in text
        return
    # The others keep every bit, and share vertices; our own reader says so too.
    own = cspace.shapes.Mesh.of(path, "surface")
    np.testing.assert_array_equal(own.vertices, vertices)
    np.testing.assert_array_equal(own.faces, faces)


def test_stl_holds_unit_normals_or_refuses_coinciding_coordinates(tmp_path: Path) -> None:
    vertices, faces = find_border(np.zeros((2, 3, 1), np.uint8), (1e-30, 0.0, 0.0), 1e-30)
    with (tmp_path / "free.stl").open("wb") as file:
        WRITERS[".stl"](file, vertices, faces)
    content = (tmp_path / "free.stl").read_bytes()
    rows = (
        np.frombuffer(content[84:], np.uint8)
        .reshape(-1, 50)[:, :48]
        .copy()
        .view("<f4")
        .reshape(-1, 4, 3)
    )
    edges = np.diff(vertices[faces] / 1e-30, axis=1)
    np.testing.assert_allclose(rows[:, 0], np.cross(edges[:, 0], edges[:, 1]), atol=1e-6)
    np.testing.assert_array_equal(rows[:, 1:], vertices[faces].astype(np.float32))
    for spacing in (1e-60, 1e60):
        mesh = find_border(np.zeros((2, 2, 2), np.uint8), spacing=spacing)
        with (
            (tmp_path / "free").open("wb") as file,
            pytest.raises(
                InputError, match=r"in which some coordinates coincide.*write .ply or .obj"
            ),
        ):
            WRITERS[".stl"](file, *mesh)


@pytest.mark.parametrize("far", [2.0**22 - 6, -(2.0**22) + 6, 1e5])
def test_an_stl_far_from_the_origin_is_closed(far: float) -> None:
    vertices, faces = find_border(np.zeros((5, 4, 3), np.uint8), (far * 0.1, 0.0, -far * 0.1), 0.1)
    single = vertices.astype(np.float32)
    assert len(np.unique(single, axis=0)) == len(vertices)
    assert trimesh.Trimesh(single.astype(float), faces, process=False).is_watertight


def build_full_map() -> cspace.CSpace:
    """Build a map without FREE cells."""
    return cspace.build(
        cspace.Workspace.from_array(np.ones((3, 3, 3), bool), 0.1), cspace.Robot.ball(0.1)
    )


@refusals(
    "make, suffix, rotation, message",
    (
        build_full_map,
        ".stl",
        None,
        "the map has no FREE cell; a boundary needs at least one; build it with",
    ),
    (MAP_BUILDERS["plane"], ".ply", None, ".ply holds maps in space only"),
    (MAP_BUILDERS["solid"], ".stl", 0.5, "rotation has shape .*the robot does not turn"),
    (MAP_BUILDERS["solid"], ".yaml", None, ".yaml holds maps of the plane only"),
    (MAP_BUILDERS["solid"], ".tif", None, ".tif holds maps of the plane only"),
    (MAP_BUILDERS["turning"], ".yaml", None, "rotation is missing"),
    (MAP_BUILDERS["turning"], ".yml", None, "rotation is missing"),
    (MAP_BUILDERS["turning"], ".npz", 1.0, "holds every slice"),
    (MAP_BUILDERS["turning"], ".zarr", 1.0, "holds every slice"),
)
def test_export_refuses_unsuitable_maps(
    tmp_path: Path,
    make: Callable[[], cspace.CSpace],
    suffix: str,
    rotation: float | None,
    message: str,
) -> None:
    with pytest.raises(InputError, match=message):
        make().export(tmp_path / f"map{suffix}", rotation=rotation)
    assert not list(tmp_path.iterdir())


# ---- VTK images ----------------------------------------------------------------------------------


def read(path: Path) -> tuple[Any, dict[str, np.ndarray]]:
    """Read an image and its cell arrays by VTK."""
    reader = vtkXMLImageDataReader()
    assert reader.CanReadFile(str(path))
    reader.SetFileName(str(path))
    reader.Update()
    assert reader.GetErrorCode() == 0
    image = reader.GetOutput()
    cells, data = [max(1, n - 1) for n in image.GetDimensions()], image.GetCellData()
    return image, {
        data.GetArrayName(i): vtk_to_numpy(data.GetArray(i)).reshape(cells[::-1]).T
        for i in range(data.GetNumberOfArrays())
    }


@given(data=st.data())
@settings(max_examples=30)
def test_vtk_reads_written_arrays_back(data: st.DataObject) -> None:
    dim = data.draw(st.integers(2, 3))
    shape = data.draw(st.tuples(*[st.integers(1, 9)] * dim))
    lower = data.draw(st.tuples(*[st.floats(-100.0, 100.0)] * dim))
    grid = cspace.Grid(lower, data.draw(st.floats(1e-3, 50.0)), shape)
    arrays = {
        "cell_states": data.draw(hnp.arrays(np.uint8, shape)),
        "outer": data.draw(hnp.arrays(bool, shape)),
        "overlap_counts": data.draw(hnp.arrays(np.int32, shape)),
    }
    with TemporaryDirectory() as folder:
        path = Path(folder) / "map.vti"
        write_vti(arrays, grid, path)
        image, arrays_read = read(path)
    assert list(arrays_read) == list(arrays)
    for name, array in arrays.items():
        assert arrays_read[name].dtype == (np.uint8 if array.dtype == bool else array.dtype)
        np.testing.assert_array_equal(arrays_read[name], array.reshape(arrays_read[name].shape))
    missing = (0.0,) * (3 - dim)
    assert image.GetOrigin() == (*grid.lower, *missing)
    assert image.GetSpacing() == (grid.spacing,) * 3
    assert image.GetExtent() == tuple(n for count in (*shape, *missing) for n in (0, count))
    assert image.GetCellData().GetScalars().GetName() == "cell_states"


@pytest.mark.parametrize("make", MAP_BUILDERS.values(), ids=MAP_BUILDERS)
def test_vtk_reads_the_slice_at_a_rotation(
    tmp_path: Path, make: Callable[[], cspace.CSpace]
) -> None:
    space = make()
    turn = space.rotations.centers[-1]
    space.export(tmp_path / "map.vti", rotation=turn if len(turn) else None)
    image, arrays = read(tmp_path / "map.vti")
    expected = space.to_xarray()
    if len(turn):
        expected = expected.isel(rotation=-1)
    names = {name for name in expected if expected[name].dims == expected.cell_states.dims}
    names -= {"inner"} if space.workspace.inner is space.workspace.outer else set()
    assert set(arrays) == names
    for name in names:
        np.testing.assert_array_equal(arrays[name].reshape(space.grid.shape), expected[name])
    origin, spacing = np.array(image.GetOrigin()), np.array(image.GetSpacing())
    points = np.random.default_rng(3).uniform(
        space.grid.lower, space.grid.upper, (50, space.grid.dim)
    )
    flat = np.pad(points, ((0, 0), (0, 3 - space.grid.dim)))
    cells = [
        image.ComputeCellId(np.floor((point - origin) / spacing).astype(int)) for point in flat
    ]
    q = np.hstack([points, np.tile(turn, (50, 1))])
    np.testing.assert_array_equal(arrays["cell_states"].ravel(order="F")[cells], space.classify(q))


@pytest.mark.parametrize("name", ["turning", "symmetric", "round", "solid_turning"])
def test_vtk_reads_all_rotations_from_one_file(tmp_path: Path, name: str) -> None:
    space = MAP_BUILDERS[name]()
    space.export(tmp_path / "map.vti")
    image, arrays = read(tmp_path / "map.vti")
    cells, rotations = space.to_xarray(), image.GetFieldData()
    count = len(space.rotations)
    for number in range(count):
        key = f"cell_states_{number:0{len(str(count - 1))}d}"
        np.testing.assert_array_equal(
            arrays[key].reshape(space.grid.shape), cells.cell_states.isel(rotation=number)
        )
    turns = np.array(
        [
            [rotations.GetArray(axis).GetValue(k) for axis in space.rotations.names]
            for k in range(count)
        ]
    )
    np.testing.assert_array_equal(turns, space.rotations.centers)
    assert len([key for key in arrays if key.startswith("cell_states")]) == count
    assert image.GetCellData().GetScalars().GetName() == min(
        key for key in arrays if key.startswith("cell_states")
    )


# ---- ROS maps, and what holds for all ------------------------------------------------------------


@pytest.mark.parametrize("name", ["grid", "turning"])
@pytest.mark.parametrize("suffix", [".yaml", ".yml"])
def test_a_ros_map_is_the_slice_at_a_yaw(tmp_path: Path, name: str, suffix: str) -> None:
    space = MAP_BUILDERS[name]()
    yaw = None if not space.rotations.names else 1.0
    space.export(tmp_path / f"map{suffix}", rotation=yaw)
    for unknown, expected in (("occupied", cspace.FREE), ("free", cspace.MIXED)):
        workspace = cspace.Workspace.from_ros_map(tmp_path / f"map{suffix}", unknown=unknown)
        np.testing.assert_array_equal(workspace.outer, space.states_at(yaw or ()) > expected)


# ---- GeoTIFF and netCDF, as GDAL reads them ------------------------------------------------------


def list_centers(space: cspace.CSpace) -> Any:
    """Return cell centers (ny, nx, 2) from the top down."""
    x, y = (space.grid.centers(axis) for axis in range(2))
    return np.stack(np.meshgrid(x, y[::-1]), axis=-1)


@pytest.mark.parametrize(("name", "rotation"), [("plane", None), ("grid", None), ("turning", 1.0)])
def test_a_geotiff_places_every_cell(tmp_path: Path, name: str, rotation: float | None) -> None:
    space = MAP_BUILDERS[name]()
    space.export(tmp_path / "map.tif", rotation=rotation)
    image = rioxarray.open_rasterio(tmp_path / "map.tif")
    centers = list_centers(space)
    np.testing.assert_allclose(np.stack(np.meshgrid(image.x, image.y), axis=-1), centers, atol=1e-9)
    np.testing.assert_allclose(
        image.rio.bounds(), (*space.grid.lower, *space.grid.upper), atol=1e-9
    )
    q = (
        centers
        if rotation is None
        else np.concatenate([centers, np.full((*centers.shape[:2], 1), rotation)], axis=-1)
    )
    assert (image.values[0] == space.classify(q)).all()
    assert 'UNIT["metre",1' in image.rio.crs.to_wkt()
    shades = np.asarray(
        Image.open(tmp_path / "map.tif").convert("L")
    )  # as a viewer of images shows it
    brightness = [shades[image.values[0] == state].min() for state in np.unique(image.values)]
    assert len(brightness) > 1 and (np.diff(np.array(brightness, dtype=int)) < 0).all()


@pytest.mark.parametrize("name", ["plane", "turning"])
@pytest.mark.filterwarnings(
    "ignore::rasterio.errors.NotGeoreferencedWarning"
)  # of the table of bounds
def test_netcdf_places_a_plane_map(tmp_path: Path, name: str) -> None:
    space = MAP_BUILDERS[name]()
    space.export(tmp_path / "map.nc")
    opened = rioxarray.open_rasterio(tmp_path / "map.nc", variable="cell_states")
    image = opened[0] if isinstance(opened, list) else opened
    np.testing.assert_allclose(
        np.stack(np.meshgrid(image.x, image.y), axis=-1), list_centers(space), atol=1e-9
    )
    expected = (
        [space.cell_states]
        if name == "plane"
        else [space.states_at(yaw) for yaw in space.rotations.centers[:, 0]]
    )
    assert (image["cell_states"].values == np.stack([state.T[::-1] for state in expected])).all()


def test_netcdf_holds_maps_in_space_and_single_rotations(
    tmp_path: Path, ball: cspace.CSpace
) -> None:
    ball.export(tmp_path / "ball.nc")
    with xarray.open_dataset(tmp_path / "ball.nc") as dataset:
        assert dataset["cell_states"].dims == ("z", "y", "x") and dataset["x"].attrs["units"] == "m"
        assert (dataset["cell_states"].transpose("x", "y", "z") == ball.cell_states).all()
        assert (dataset["outer"].transpose("x", "y", "z") == ball.workspace.outer).all()
        flags = dataset["cell_states"].attrs
        assert dict(
            zip(flags["flag_meanings"].split(), flags["flag_values"].tolist(), strict=True)
        ) == {
            "free": cspace.FREE,
            "mixed": cspace.MIXED,
            "blocked": cspace.BLOCKED,
        }
    space = MAP_BUILDERS["turning"]()
    space.export(tmp_path / "one.nc", rotation=1.0)
    with xarray.open_dataset(tmp_path / "one.nc") as dataset:
        assert dataset["cell_states"].dims == ("y", "x")
        assert (dataset["cell_states"].values == space.states_at(1.0).T).all()
        assert abs(float(dataset["yaw"]) - 1.0) <= float(dataset["covering_angle"])


def test_without_xarray_netcdf_names_the_extra_and_writes_nothing(tmp_path: Path) -> None:
    code = f"""
import numpy, cspace
workspace = cspace.Workspace.from_array(numpy.eye(9, dtype=bool), 0.1)
try:
    cspace.build(workspace, cspace.Robot.disc(0.1)).export({str(tmp_path / "map.nc")!r})
except cspace.MissingPackageError as error:
    print(error)
"""
    assert 'pip install "cspace[xarray]"' in output_without("xarray", code)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".vti", ".yaml", ".stl", ".tif", ".nc"])
def test_an_existing_export_is_kept_without_overwrite(
    tmp_path: Path, ball: cspace.CSpace, suffix: str
) -> None:
    space = MAP_BUILDERS["grid"]() if suffix in (".yaml", ".tif") else ball
    path = tmp_path / f"map{suffix}"
    path.write_text("years of work")
    with pytest.raises(FileError, match="overwrite=True"):
        space.export(path)
    assert path.read_text() == "years of work"
    space.export(path, overwrite=True)
    assert path.read_bytes() != b"years of work"
