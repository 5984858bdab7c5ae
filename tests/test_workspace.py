"""Workspaces: arrays, readers by suffix, bounds, spacing and shapes."""

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest
import shapely
import trimesh
import xarray
from hypothesis import given
from hypothesis import strategies as st

import cspace
from cspace import Grid, Robot, Workspace
from cspace.errors import FileError, InputError
from cspace.files.formats import WORKSPACE_FORMATS, read_dimension
from cspace.workspace import covering_grid
from tests.helpers.mesh_files import TETRAHEDRON
from tests.helpers.refusals import refusals

L_CELLS = [[1, 1, 0], [0, 1, 0]]
"""Obstacle cells of an L, two cells along x and three along y."""


@pytest.mark.parametrize("dtype", [bool, np.uint8, np.int64])
def test_arrays_become_cells(dtype: type) -> None:
    workspace = Workspace.from_array(np.array(L_CELLS, dtype=dtype), 0.5, (-1.0, 2.0))
    assert workspace.grid == Grid((-1.0, 2.0), 0.5, (2, 3))
    assert workspace.outer.dtype == np.bool_
    assert workspace.outer.tolist() == [[True, True, False], [False, True, False]]
    assert workspace.inner is workspace.outer
    assert workspace.source == "array"


def test_lists_and_three_axes_are_accepted() -> None:
    workspace = Workspace.from_array([[[True, False]], [[False, False]]], 1.0)
    assert workspace.grid == Grid((0.0, 0.0, 0.0), 1.0, (2, 1, 2))
    assert workspace.outer.sum() == 1
    assert not Workspace.from_array(
        np.ma.array(np.zeros((3, 2), bool)), 0.1
    ).outer.any()  # nothing is masked


def test_arrays_are_read_only_copies() -> None:
    outer = np.array(L_CELLS, dtype=bool)
    inner = np.zeros_like(outer)
    workspace = Workspace.from_array(outer.T, 1.0, inner=inner.T)
    outer[:], inner[:] = False, True
    assert workspace.outer.sum() == 3
    assert workspace.inner.sum() == 0
    for array in (workspace.outer, workspace.inner):
        assert array.flags.c_contiguous
        with pytest.raises(ValueError):
            array[0, 0] = False


def test_a_read_only_array_of_the_caller_is_copied_too() -> None:
    outer = np.array(L_CELLS, dtype=bool)
    view = outer.view()
    view.setflags(write=False)
    workspace = Workspace(Grid((0.0, 0.0), 1.0, (2, 3)), view, view)
    outer[0, 0] = False
    assert workspace.outer[0, 0]


def test_inner_that_equals_outer_is_the_same_object() -> None:
    cells = np.array(L_CELLS, dtype=bool)
    workspace = Workspace.from_array(cells, 1.0, inner=cells.copy())
    assert workspace.inner is workspace.outer


def test_repr_is_short() -> None:
    assert len(repr(Workspace.from_array(np.zeros((500, 500), dtype=bool), 1.0))) < 200


@refusals(
    "arguments, message",
    ({"occupied": np.zeros((2, 2))}, "dtype float64"),
    ({"occupied": np.array([[0.0, 1.0], [float("nan"), 0.0]])}, r"occupied\[1, 0\] is nan"),
    ({"occupied": np.array([["a", "b"]])}, "dtype <U1"),
    ({"occupied": np.array([[0, 1], [1, 7]])}, r"occupied\[1, 1\] is 7"),
    ({"occupied": np.array([[0, -1]])}, r"occupied\[0, 1\] is -1"),
    ({"occupied": [[True], [True, False]]}, "ragged"),
    ({"occupied": np.zeros(3, dtype=bool)}, r"shape \(3,\)"),
    ({"occupied": np.zeros((1, 1, 1, 1), dtype=bool)}, r"shape \(1, 1, 1, 1\)"),
    ({"occupied": np.zeros((0, 3), dtype=bool)}, r"shape \(0, 3\)"),
    ({"spacing": 0.0}, "spacing is 0.0"),
    ({"spacing": -0.1}, "spacing is -0.1"),
    ({"spacing": float("nan")}, "spacing is nan"),
    ({"lower": (0.0, 0.0, 0.0)}, "lower has shape .* must be 2 numbers"),
    ({"lower": (0.0, float("inf"))}, r"lower\[1\] is inf"),
    ({"inner": np.zeros((3, 2), dtype=bool)}, r"inner has shape \(3, 2\)"),
    ({"inner": np.ones((2, 3), dtype=bool)}, r"has cell \(0, 2\)"),
    ({"occupied": np.ma.array(np.zeros((3, 2), bool), mask=[[True, False]] * 3)}, "3 masked"),
)
def test_unusable_arrays_are_refused(arguments: dict[str, Any], message: str) -> None:
    given = {"occupied": np.array(L_CELLS, dtype=bool), "spacing": 1.0} | arguments
    with pytest.raises(InputError, match=message):
        Workspace.from_array(**given)


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """Write a file for every reader, each with the obstacles of L_CELLS."""
    from PIL import Image

    pixels = np.where(np.array(L_CELLS, dtype=bool).T[::-1], 0, 255).astype(np.uint8)
    for suffix in (".png", ".pgm", ".bmp"):
        Image.fromarray(pixels).save(tmp_path / f"map{suffix}")
    (tmp_path / "map.map").write_text("type octile\nheight 3\nwidth 2\nmap\n..\n@@\n@.\n")
    header = "image: map.pgm\nresolution: 1.0\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    (tmp_path / "map.yaml").write_text(header)
    (tmp_path / "map.YML").write_text(header)
    np.save(tmp_path / "map.npy", np.array(L_CELLS, dtype=bool))
    (tmp_path / "map.wkt").write_text("MULTIPOINT (0.5 0.5, 0.5 1.5, 1.5 1.5, 2 3)")
    return tmp_path


@pytest.mark.parametrize(
    "name", ["map.png", "map.pgm", "map.bmp", "map.npy", "map.map", "map.yaml", "map.YML"]
)
def test_open_chooses_the_reader_by_suffix(files: Path, name: str) -> None:
    path = files / name
    options = {} if path.suffix.lower() in (".map", ".yaml", ".yml") else {"spacing": 1.0}
    workspace = Workspace.open(path, **options)
    assert workspace.grid == Grid((0.0, 0.0), 1.0, (2, 3))
    assert np.array_equal(workspace.outer, np.array(L_CELLS, dtype=bool))
    assert workspace.source == str(path)


def test_open_passes_options_on(files: Path) -> None:
    workspace = Workspace.open(files / "map.png", spacing=0.5, lower=(1.0, 2.0), dark="free")
    assert workspace.grid == Grid((1.0, 2.0), 0.5, (2, 3))
    assert np.array_equal(workspace.outer, ~np.array(L_CELLS, dtype=bool))
    polygons = Workspace.open(str(files / "map.wkt"), spacing=1.0, bounds=(0, 0, 2, 2))
    assert polygons.outer.tolist() == [[True, True], [False, True]]


@refusals(
    "name, options, message",
    ("map.png", {}, "spacing is missing"),
    ("map.npy", {}, "spacing is missing"),
    ("map.wkt", {"bounds": (0, 0, 1, 1)}, "spacing is missing"),
    ("map.yaml", {"spacing": 0.1}, "spacing is given .* takes unknown"),
    ("map.map", {"unknown": "free"}, "unknown is given .* takes spacing"),
    (
        "map.step",
        {"spacing": 0.1},
        r"with suffix '.step'.*\.yaml, \.yml, .*\.map, \.3dmap, ",
    ),
    ("map", {}, "with suffix ''"),
    ("map.png", {"spacing": 0.0}, "spacing is 0.0"),
    ("map.map", {"spacing": -1.0}, "spacing is -1.0"),
)
def test_open_refuses_options_of_other_readers(
    files: Path, name: str, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        Workspace.open(files / name, **options)


@pytest.mark.parametrize("suffix", WORKSPACE_FORMATS)
def test_missing_files_and_folders_are_named(tmp_path: Path, suffix: str) -> None:
    spacing = inspect.signature(
        getattr(Workspace, WORKSPACE_FORMATS[suffix].method)
    ).parameters.get("spacing")
    options = (
        {}
        if spacing is None or spacing.default is not inspect.Parameter.empty
        else {"spacing": 1.0}
    )
    path = tmp_path / f"absent{suffix}"
    with pytest.raises(FileError, match=f"absent{suffix}: does not exist"):
        Workspace.open(path, **options)
    path.mkdir()
    what = "holds no array" if suffix == ".zarr" else "is a folder"
    with pytest.raises(FileError, match=f"absent{suffix}: {what}"):
        Workspace.open(path, **options)


@refusals(
    "array, message",
    (np.full((2, 2), 0.5), "dtype float64"),
    (np.arange(30).reshape(10, 3), r"occupied\[0, 2\] is 2; whole numbers must be 0 or 1"),
)
def test_npy_files_of_other_values_are_refused(tmp_path: Path, array: Any, message: str) -> None:
    np.save(tmp_path / "other.npy", array)
    with pytest.raises(InputError, match=message):
        Workspace.open(tmp_path / "other.npy", spacing=0.1)
    np.save(tmp_path / "cells.npy", np.arange(30).reshape(10, 3) % 2)
    assert Workspace.open(tmp_path / "cells.npy", spacing=0.1).grid.shape == (10, 3)


def test_files_without_permission_are_refused(files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        Path, "read_bytes", mock.Mock(side_effect=PermissionError(13, "Permission denied"))
    )
    with pytest.raises(FileError, match=r"map\.map: cannot be read: Permission denied"):
        Workspace.open(files / "map.map")


def test_cells_must_fit_the_grid_and_be_in_the_order_of_its_axes() -> None:
    cells = np.zeros((2, 3), dtype=bool)
    with pytest.raises(InputError, match=r"outer has shape \(2, 3\) but the grid has \(3, 2\)"):
        Workspace(Grid((0.0, 0.0), 1.0, (3, 2)), cells, cells)
    labelled = xarray.DataArray(cells, dims=("y", "x"))
    with pytest.raises(InputError, match="transpose"):
        Workspace.from_array(labelled, 0.1)
    assert Workspace.from_array(labelled.transpose("x", "y"), 0.1).grid.shape == (3, 2)


def test_odd_bytes_become_plain_booleans():
    cells = np.array([[0, 255], [101, 0]], np.uint8).view(bool)
    assert Workspace.from_array(cells, 0.1).outer.view(np.uint8).tolist() == [[0, 1], [1, 0]]


def make_workspaces(scale: float, bounds: Any = None) -> list[Callable[[], Workspace]]:
    """Return builders of a mesh, a cloud and a polygon."""
    vertices, faces = TETRAHEDRON
    flat = None if bounds is None else (*bounds[:2], *bounds[3:5])
    return [
        lambda: Workspace.from_mesh((vertices * scale, faces), 0.1, bounds),
        lambda: Workspace.from_points(vertices * scale, 0.1, bounds, radius=0.01),
        lambda: Workspace.from_polygons(f"POLYGON ((0 0, {scale} 0, 0 {scale}, 0 0))", 0.1, flat),
    ]


@pytest.mark.parametrize("bounds", [None, (-1, -1, -1, 1, 1, 1)])
@pytest.mark.parametrize("kind", range(3))
def test_obstacles_smaller_than_a_cell_warn(bounds: Any, kind: int) -> None:
    with pytest.warns(
        UserWarning, match=r"is 0\.001 m x 0\.001 m.* fits into one cell of 0\.1 m; its units"
    ) as caught:
        make_workspaces(1e-3, bounds)[kind]()
    assert len(caught) == 1
    make_workspaces(0.2, bounds)[kind]()


def test_obstacles_at_least_a_quarter_of_a_cell_wide_do_not_warn() -> None:
    # A thin pillar within bounds may be intended, and so may a map of one full cell.
    bounds = (-1, -1, -1, 1, 1, 1)
    for make in make_workspaces(0.026, bounds):
        make()
    for make in make_workspaces(0.024, bounds) + make_workspaces(0.099):
        with pytest.warns(UserWarning, match="units are probably wrong"):
            make()
    assert Workspace.from_polygons("POLYGON ((7 7, 7.1 7, 7.1 7.1, 7 7))", 0.1).outer.all()


def test_a_single_point_does_not_warn() -> None:
    assert Workspace.from_points([[1.0, 1.0, 1.0]], 0.1).outer.all()
    assert Workspace.from_polygons("POINT (1 1)", 0.1, (0, 0, 2, 2)).outer.any()


def test_bounds_of_shapely_and_trimesh_are_accepted() -> None:
    # Bounds are numbers in a row, or the lower and the upper corner.
    mesh, area = trimesh.creation.box(bounds=[(0, 0, 0), (3, 2, 1)]), shapely.box(0, 0, 3, 2)
    for bounds in (mesh.bounds, mesh.bounds.ravel(), [(0, 0, 0), (3, 2, 1)], (0, 0, 0, 3, 2, 1)):
        made = [
            Workspace.from_mesh(mesh, 0.5, bounds),
            Workspace.from_balls([(1, 1, 0)], [0.2], 0.5, bounds),
        ]
        made.append(Workspace.from_points([(1, 1, 0)], 0.5, bounds))
        assert {each.grid for each in made} == {Grid((0, 0, 0), 0.5, (6, 4, 2))}
    for flat in (area.bounds, mesh.bounds[:, :2], ((0, 0), (3, 2))):
        assert Workspace.from_polygons(area, 0.5, flat).grid == Grid((0, 0), 0.5, (6, 4))
    for wrong in (mesh.bounds.T, mesh.bounds[:, :2], [mesh.bounds], mesh.bounds[0], 1.0):
        with pytest.raises(
            InputError, match=r"six numbers; pass \(xmin.* or the lower and the upper corner"
        ):
            Workspace.from_mesh(mesh, 0.5, wrong)
    with pytest.raises(InputError, match="xmax, ymax must be above xmin, ymin"):
        Workspace.from_polygons(area, 0.5, [(0, 3), (0, 2)])  # the ends of each axis


@pytest.mark.parametrize("kind", range(3))
def test_bounds_without_an_obstacle_warn(kind: int) -> None:
    with pytest.warns(
        UserWarning, match=r"none lies within the bounds, \(10, 10.* has no obstacle"
    ) as caught:
        make_workspaces(1.0, (10, 10, 10, 12, 12, 12))[kind]()
    assert len(caught) == 1


@pytest.mark.parametrize("name", ["none.stl", "none.xyz", "none.wkt"])
def test_bounds_are_checked_before_the_file_is_read(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="bounds is"):
        Workspace.open(tmp_path / name, spacing=0.1, bounds=(0, 0, 0, 0, 1, 1))


@given(st.lists(st.floats(1.0, 1e3), min_size=2, max_size=3), st.integers(10**6, 10**9))
def test_the_spacing_that_a_refusal_advises_fits_in_memory(sides: list[float], free: int) -> None:
    corners = np.array([np.zeros(len(sides)), sides])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cspace.limits.free_bytes", lambda: free)
        with pytest.raises(InputError, match=r"use a spacing of at least (\S+) m") as error:
            covering_grid(corners, 1e-7, 8)
        advised = float(error.value.hint.split()[6])
        # A cell cut by the upper bound counts in part.
        assert 8.0 * np.prod(np.maximum(1.0, corners[1] / advised)) <= free or min(sides) < advised


@pytest.mark.parametrize(
    ("name", "dim"),
    [
        ("a.yaml", 2),
        ("a.png", 2),
        ("a.wkt", 2),
        ("a.map", 2),
        ("a.3dmap", 3),
        ("a.stl", 3),
        ("a.bt", 3),
        ("a.csv", 3),
    ],
)
def test_dimensions_follow_the_suffix(name: str, dim: int) -> None:
    assert read_dimension(name) == dim


def test_dimensions_of_an_array_follow_its_header(tmp_path: Path) -> None:
    for array, dim in (
        (np.zeros((3, 3), bool), 2),
        (np.zeros((3, 3, 3), bool), 3),
        (np.zeros((4, 3)), 3),
    ):
        np.save(tmp_path / "a.npy", array)
        assert read_dimension(tmp_path / "a.npy") == dim


def test_workspaces_accept_shapes_of_every_kind():
    shapes = [
        shapely.box(0, 0, 1, 3),
        Robot.disc(0.5, (3, 1)),
        "ellipse:0.6,0.3@2,2.5",
        [(1, 1), (2, 1), (1, 2)],
    ]
    workspace = Workspace.from_shapes(iter(shapes), 0.1, (0, 0, 4, 3))
    empty = Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1)
    space = cspace.build(empty, Robot.disc(0.2), outside="free")
    for number, shape in enumerate(shapes):
        space.add_obstacle(str(number), shape)
    assert (workspace.outer == space.workspace.outer).all()
    assert (workspace.inner == space.workspace.inner).all()
    built = cspace.build(workspace, Robot.disc(0.2), outside="free")
    assert (built.cell_states == space.cell_states).all()
    q = np.random.default_rng(0).uniform((0, 0), (4, 3), (500, 2))
    assert (built.is_free(q, exact=True) == space.is_free(q, exact=True)).all()
    polygons = [shapely.box(0, 0, 1, 3), shapely.box(2, 1, 2.55, 4)]
    one, other = Workspace.from_shapes(polygons, 0.1), Workspace.from_polygons(polygons, 0.1)
    assert (one.grid, one.outer.tolist(), one.inner.tolist()) == (
        other.grid,
        other.outer.tolist(),
        other.inner.tolist(),
    )
    solids = Workspace.from_shapes([Robot.cylinder(0.3, 1.0), trimesh.creation.box((1, 1, 1))], 0.1)
    assert solids.grid.dim == 3


@refusals(
    "shapes, message",
    ([], "shapes is empty; at least one shape is needed"),
    ({"cart": shapely.box(0, 0, 1, 1)}, r"shapes is a dict; .* space\.add_obstacle\(name, shape\)"),
    ("disc:0.3", "shapes is a str; it must be a list of shapes; pass a list"),
    (shapely.box(0, 0, 1, 1), "shapes is a Polygon"),
    (Robot.disc(1.0), "shapes is a Robot"),
    ([Robot.disc(1.0), Robot.ball(1.0)], r"shapes\[1\] is in space; all must be in the plane"),
    ([Robot.disc(1.0), "cube:1"], r"shapes\[1\] is 'cube:1'; it must be a short text"),
    ([Robot.disc(1.0), None], r"shapes\[1\] is a NoneType"),
)
def test_from_shapes_rejects_invalid_arguments(shapes, message):
    with pytest.raises(InputError, match=message):
        Workspace.from_shapes(shapes, 0.1)


def test_unknown_cells_of_ros_are_not_made_free_by_the_hint_of_an_array() -> None:
    cells = np.array([[0, -1], [100, 0]], dtype=np.int8)
    for array in (cells, cells[::-1]):
        with pytest.raises(cspace.InputError, match=r"unknown cells of ROS.*from_occupancy_grid"):
            Workspace.from_array(array, 0.1)
    with pytest.raises(cspace.InputError, match=r"threshold first, e.g. array >= 50"):
        Workspace.from_array(np.abs(cells) * 2, 0.1)
