"""Workspaces: arrays, readers by suffix, bounds, spacing and shapes."""

import re
import warnings
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given
from hypothesis import strategies as st

import cspace
from cspace import Grid, Robot, Workspace
from cspace._workspace import covering_grid
from cspace.errors import FileError, InputError
from tests.helpers.handmade import build_empty

L_CELLS = [[1, 1, 0], [0, 1, 0]]
"""Obstacle cells of an L, two cells along x and three along y."""


def test_arrays_are_read_only_copies():
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


def test_a_read_only_array_of_the_caller_is_copied_too():
    outer = np.array(L_CELLS, dtype=bool)
    view = outer.view()
    view.setflags(write=False)
    workspace = Workspace(Grid((0.0, 0.0), 1.0, (2, 3)), view, view)
    outer[0, 0] = False
    assert workspace.outer[0, 0]


@pytest.fixture
def files(tmp_path):
    """Write an image, a benchmark map and shapes, each with the obstacles of L_CELLS."""
    from PIL import Image

    pixels = np.where(np.array(L_CELLS, dtype=bool).T[::-1], 0, 255).astype(np.uint8)
    Image.fromarray(pixels).save(tmp_path / "map.png")
    (tmp_path / "map.map").write_text("type octile\nheight 3\nwidth 2\nmap\n..\n@@\n@.\n")
    (tmp_path / "map.wkt").write_text("MULTIPOINT (0.5 0.5, 0.5 1.5, 1.5 1.5, 2 3)")
    return tmp_path


def test_open_passes_options_on(files):
    workspace = Workspace.open(files / "map.png", spacing=0.5, lower=(1.0, 2.0), dark="free")
    assert workspace.grid == Grid((1.0, 2.0), 0.5, (2, 3))
    assert np.array_equal(workspace.outer, ~np.array(L_CELLS, dtype=bool))
    polygons = Workspace.open(str(files / "map.wkt"), spacing=1.0, bounds=(0, 0, 2, 2))
    assert polygons.outer.tolist() == [[True, True], [False, True]]


def test_files_without_permission_are_refused(files, monkeypatch):
    monkeypatch.setattr(
        Path, "read_bytes", mock.Mock(side_effect=PermissionError(13, "Permission denied"))
    )
    with pytest.raises(FileError, match=r"map\.map: cannot be read: Permission denied"):
        Workspace.open(files / "map.map")


@given(st.lists(st.floats(1.0, 1e3), min_size=2, max_size=3), st.integers(10**6, 10**9))
def test_the_spacing_that_a_refusal_advises_fits_in_memory(sides, free):
    corners = np.array([np.zeros(len(sides)), sides])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cspace._support.limits.free_bytes", lambda: free)
        with pytest.raises(InputError, match=r"cells of \S+ m fit") as error:
            covering_grid(corners, 1e-7, 8)
        advised = float(error.value.hint.split()[2])
        # A cell cut by the upper bound counts in part.
        assert 8.0 * np.prod(np.maximum(1.0, corners[1] / advised)) <= free or min(sides) < advised


def test_workspaces_accept_shapes_of_every_kind():
    shapes = [
        shapely.box(0, 0, 1, 3),
        Robot.disc(0.5, (3, 1)),
        "ellipse:0.6,0.3@2,2.5",
        [(1, 1), (2, 1), (1, 2)],
    ]
    workspace = Workspace.from_shapes(iter(shapes), 0.1, (0, 0, 4, 3))
    space = build_empty((40, 30), Robot.disc(0.2), outside="free")
    for number, shape in enumerate(shapes):
        space.add_obstacle(str(number), shape)
    assert (workspace.outer == space.workspace.outer).all()
    assert (workspace.inner == space.workspace.inner).all()
    solids = Workspace.from_shapes([Robot.cylinder(0.3, 1.0), trimesh.creation.box((1, 1, 1))], 0.1)
    assert solids.grid.dim == 3


def test_bounds_of_shapely_and_trimesh_are_accepted():
    # Bounds are numbers in a row, or the lower and the upper corner.
    mesh, area = trimesh.creation.box(bounds=[(0, 0, 0), (3, 2, 1)]), shapely.box(0, 0, 3, 2)
    for bounds in (mesh.bounds, (0, 0, 0, 3, 2, 1)):
        assert Workspace.from_mesh(mesh, 0.5, bounds).grid == Grid((0, 0, 0), 0.5, (6, 4, 2))
    for flat in (area.bounds, ((0, 0), (3, 2))):
        assert Workspace.from_polygons(area, 0.5, flat).grid == Grid((0, 0), 0.5, (6, 4))
    with pytest.raises(InputError, match=r"it must be xmin.* or the lower and the upper"):
        Workspace.from_mesh(mesh, 0.5, mesh.bounds.T)
    with pytest.raises(InputError, match=r"bounds is \[\[0\.0, 3\.0\], \[0\.0, 2\.0\]\].*xmax"):
        Workspace.from_polygons(area, 0.5, [(0, 3), (0, 2)])


@pytest.mark.parametrize(
    "extent, bounds, warns",
    [
        (0.099, None, True),
        (0.1, None, False),
        (0.024, (-1, -1, 1, 1), True),
        (0.026, (-1, -1, 1, 1), False),
        (1.0, (10, 10, 12, 12), True),
    ],
)
def test_obstacles_smaller_than_a_cell_or_outside_the_bounds_warn(extent, bounds, warns):
    square = shapely.box(0.0, 0.0, extent, extent)
    with warnings.catch_warnings(record=True, action="always") as caught:
        Workspace.from_polygons(square, 0.1, bounds)
    texts = [str(warning.message) for warning in caught]
    assert len(texts) == warns
    assert all(re.search("fits into one cell|has no obstacle", text) for text in texts)


def test_a_mesh_in_millimetres_is_refused_with_its_size():
    hall = trimesh.creation.box((900, 800, 300))
    with pytest.raises(InputError, match=r"900 m x 800 m x 300 m large.*says how"):
        Workspace.from_mesh(hall, 0.1)


def test_unknown_cells_of_ros_are_refused_in_an_array():
    cells = np.array([[0, -1], [100, 0]])
    with pytest.raises(
        InputError, match=r"occupied\[0, 1\] is -1, and some cells are -1,.*unknown"
    ):
        Workspace.from_array(cells, 0.1)
    message = cspace.ros.OccupancyGrid()
    message.info.width, message.info.height, message.info.resolution = 2, 2, 0.1
    message.data = cells.T.ravel()
    assert Workspace.from_occupancy_grid(message).outer.tolist() == [[False, True], [True, False]]


@pytest.mark.parametrize("suffix", ["gltf", "dae", "obj", "xyz", "csv", "stl", "geojson"])
def test_a_file_of_one_long_line_without_a_spacing_is_refused(tmp_path, suffix):
    file = tmp_path / f"long.{suffix}"
    file.write_text("0.1 " * 60_000)
    with pytest.raises(cspace.CspaceError, match=r"spacing|cannot be read"):
        cspace.Workspace.open(file)
