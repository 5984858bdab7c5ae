"""What VTK finds in a map."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOXML import vtkXMLImageDataReader

import cspace
from cspace.errors import FileError, InputError
from cspace.io import vti
from cspace.io.vti import write_vti
from cspace.io.writing import export


def read(path: Path) -> tuple[Any, dict[str, np.ndarray]]:
    """The image and its cell arrays, indexed in the order of the coordinates."""
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
@settings(max_examples=60)
def test_vtk_finds_what_was_written(data: st.DataObject) -> None:
    dim = data.draw(st.integers(2, 3))
    shape = data.draw(st.tuples(*[st.integers(1, 9)] * dim))
    lower = data.draw(st.tuples(*[st.floats(-100.0, 100.0)] * dim))
    grid = cspace.Grid(lower, data.draw(st.floats(1e-3, 50.0)), shape)
    arrays = {
        "state": data.draw(hnp.arrays(np.uint8, shape)),
        "outer": data.draw(hnp.arrays(bool, shape)),
        "overlap": data.draw(hnp.arrays(np.int32, shape)),
        "penetration": data.draw(hnp.arrays(np.float64, shape)),
    }
    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(vti, "_SLAB", data.draw(st.sampled_from([1, 50, 2**24])))
        path = Path(folder) / "map.vti"
        write_vti(arrays, grid, path)
        image, found = read(path)
    assert list(found) == list(arrays)
    for name, array in arrays.items():
        assert found[name].dtype == (np.uint8 if array.dtype == bool else array.dtype)
        np.testing.assert_array_equal(found[name], array.reshape(found[name].shape))
    missing = (0.0,) * (3 - dim)
    assert image.GetOrigin() == (*grid.lower, *missing)
    assert image.GetSpacing() == (grid.spacing,) * 3
    assert image.GetExtent() == tuple(n for count in (*shape, *missing) for n in (0, count))
    assert image.GetNumberOfCells() == grid.size
    assert image.GetCellData().GetScalars().GetName() == "state"


def test_a_map_in_space(tmp_path: Path) -> None:
    cells = np.zeros((8, 7, 6), dtype=bool)
    cells[3, 4, 2] = True
    workspace = cspace.Workspace.from_array(cells, 0.1, (-0.3, 1.0, 0.7))
    space = cspace.build(workspace, cspace.Robot.ball(0.12), overlap=True, outside="free")
    export(space, tmp_path / "map.vti")
    image, found = read(tmp_path / "map.vti")
    assert list(found) == ["state", "outer", "overlap"]
    np.testing.assert_array_equal(found["state"], space.state)
    np.testing.assert_array_equal(found["outer"], cells)
    np.testing.assert_array_equal(found["overlap"], space.overlaps)
    q = np.random.default_rng(3).uniform(space.grid.lower, space.grid.upper, (200, 3))
    located = [
        image.ComputeCellId(np.floor((point - image.GetOrigin()) / image.GetSpacing()).astype(int)) for point in q
    ]
    np.testing.assert_array_equal(found["state"].ravel(order="F")[located], space.classify(q))


def test_inner_is_there_where_it_differs(tmp_path: Path) -> None:
    outer = np.ones((4, 3, 2), dtype=bool)
    workspace = cspace.Workspace.from_array(outer, 0.1, inner=np.zeros_like(outer))
    export(cspace.build(workspace, cspace.Robot.ball(0.1)), tmp_path / "map.vti")
    _, found = read(tmp_path / "map.vti")
    assert list(found) == ["state", "outer", "inner"]
    assert not found["inner"].any()
    assert found["outer"].all()


@pytest.mark.parametrize(
    "robot", [cspace.Robot.rectangle(0.5, 0.2), cspace.Robot.polygon([(0, 0), (0.4, 0), (0, 0.2)])]
)
def test_a_robot_that_turns_shows_the_slice_at_a_yaw(tmp_path: Path, robot: cspace.Robot) -> None:
    workspace = cspace.Workspace.from_array(np.eye(9, 7, dtype=bool), 0.1)
    space = cspace.build(workspace, robot, rotations=8, overlap=True)
    with pytest.raises(InputError, match=r"yaw is missing for .*map.vti; .* 8 rotation cells; pass .*yaw=0.0"):
        export(space, tmp_path / "map.vti")
    export(space, tmp_path / "map.vti", yaw=4.0)
    _, found = read(tmp_path / "map.vti")
    np.testing.assert_array_equal(found["state"][..., 0], space.slice_at(4.0))
    assert space.rotations is not None
    x, y = np.meshgrid(space.grid.centers(0), space.grid.centers(1), indexing="ij")
    np.testing.assert_array_equal(found["overlap"][..., 0], space.overlap(np.stack([x, y, np.full_like(x, 4.0)], -1)))
    plane = cspace.build(workspace, robot)
    with pytest.raises(InputError, match=r"yaw is 0.5 for a robot that only translates; .*leave it out"):
        export(plane, tmp_path / "other.vti", yaw=0.5)


@pytest.mark.parametrize("array", [np.zeros((3, 3), np.uint8), np.zeros((3, 2), np.float32), np.zeros((3, 2, 1), bool)])
def test_other_arrays_are_refused(tmp_path: Path, array: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"state has shape .* it must have the grid's shape \(3, 2\) and be uint8"):
        write_vti({"state": array}, cspace.Grid((0.0, 0.0), 1.0, (3, 2)), tmp_path / "map.vti")
    assert not list(tmp_path.iterdir())


def test_an_earlier_file_is_kept_unless_told_otherwise(tmp_path: Path) -> None:
    path, grid = tmp_path / "map.vti", cspace.Grid((0.0, 0.0), 1.0, (3, 2))
    path.write_text("years of work")
    with pytest.raises(FileError, match="--overwrite"):
        write_vti({"state": np.zeros((3, 2), np.uint8)}, grid, path)
    assert path.read_text() == "years of work"
    write_vti({"state": np.ones((3, 2), np.uint8)}, grid, path, overwrite=True)
    assert read(path)[1]["state"].all()
    assert len(list(tmp_path.iterdir())) == 1
