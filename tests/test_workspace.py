"""Workspaces from arrays, and the choice of a reader by suffix."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cspace import Grid, Workspace
from cspace.errors import FileError, InputError
from cspace.workspace import READERS

L_SHAPE = [[1, 1, 0], [0, 1, 0]]
"""Two cells along x, three along y."""


@pytest.mark.parametrize("dtype", [bool, np.uint8, np.int64])
def test_array_by_hand(dtype: type) -> None:
    workspace = Workspace.from_array(np.array(L_SHAPE, dtype=dtype), 0.5, (-1.0, 2.0))
    assert workspace.grid == Grid((-1.0, 2.0), 0.5, (2, 3))
    assert workspace.outer.dtype == np.bool_
    assert workspace.outer.tolist() == [[True, True, False], [False, True, False]]
    assert workspace.inner is workspace.outer
    assert workspace.source == "array"


def test_lists_and_three_axes_are_accepted() -> None:
    workspace = Workspace.from_array([[[True, False]], [[False, False]]], 1.0)
    assert workspace.grid == Grid((0.0, 0.0, 0.0), 1.0, (2, 1, 2))
    assert workspace.outer.sum() == 1


def test_arrays_are_read_only_copies() -> None:
    outer = np.array(L_SHAPE, dtype=bool)
    inner = np.zeros_like(outer)
    workspace = Workspace.from_array(outer.T, 1.0, inner=inner.T)
    outer[:], inner[:] = False, True
    assert workspace.outer.sum() == 3
    assert workspace.inner.sum() == 0
    for array in (workspace.outer, workspace.inner):
        assert array.flags.c_contiguous
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = False


def test_a_read_only_array_of_the_caller_is_copied_too() -> None:
    outer = np.array(L_SHAPE, dtype=bool)
    view = outer.view()
    view.setflags(write=False)
    workspace = Workspace(Grid((0.0, 0.0), 1.0, (2, 3)), view, view)
    outer[0, 0] = False
    assert workspace.outer[0, 0]


def test_inner_that_equals_outer_is_the_same_object() -> None:
    cells = np.array(L_SHAPE, dtype=bool)
    workspace = Workspace.from_array(cells, 1.0, inner=cells.copy())
    assert workspace.inner is workspace.outer


def test_repr_is_short() -> None:
    assert len(repr(Workspace.from_array(np.zeros((500, 500), dtype=bool), 1.0))) < 200


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
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
        ({"lower": (0.0, 0.0, 0.0)}, "lower is .* occupied has 2 axes"),
        ({"lower": (0.0, float("inf"))}, r"lower\[1\] is inf"),
        ({"inner": np.zeros((3, 2), dtype=bool)}, r"inner has shape \(3, 2\)"),
        ({"inner": np.ones((2, 3), dtype=bool)}, r"cell \(0, 2\) is in inner"),
    ],
)
def test_bad_arrays(arguments: dict[str, Any], message: str) -> None:
    given = {"occupied": np.array(L_SHAPE, dtype=bool), "spacing": 1.0} | arguments
    with pytest.raises(InputError, match=message):
        Workspace.from_array(**given)


def test_arrays_of_another_shape_than_the_grid() -> None:
    cells = np.zeros((2, 3), dtype=bool)
    with pytest.raises(InputError, match=r"outer has shape \(2, 3\) on a grid of \(3, 2\)"):
        Workspace(Grid((0.0, 0.0), 1.0, (3, 2)), cells, cells)


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """One file for every kind of reader, each with obstacles in L_SHAPE."""
    from PIL import Image

    pixels = np.where(np.array(L_SHAPE, dtype=bool).T[::-1], 0, 255).astype(np.uint8)
    for suffix in (".png", ".pgm", ".bmp"):
        Image.fromarray(pixels).save(tmp_path / f"map{suffix}")
    (tmp_path / "map.map").write_text("type octile\nheight 3\nwidth 2\nmap\n..\n@@\n@.\n")
    header = (
        "image: map.pgm\nresolution: 1.0\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    (tmp_path / "map.yaml").write_text(header)
    (tmp_path / "map.YML").write_text(header)
    np.save(tmp_path / "map.npy", np.array(L_SHAPE, dtype=bool))
    (tmp_path / "map.wkt").write_text("MULTIPOINT (0.5 0.5, 0.5 1.5, 1.5 1.5, 2 3)")
    return tmp_path


@pytest.mark.parametrize("name", ["map.png", "map.pgm", "map.bmp", "map.npy", "map.map", "map.yaml", "map.YML"])
def test_open_by_suffix(files: Path, name: str) -> None:
    path = files / name
    options = {} if path.suffix.lower() in (".map", ".yaml", ".yml") else {"spacing": 1.0}
    workspace = Workspace.open(path, **options)
    assert workspace.grid == Grid((0.0, 0.0), 1.0, (2, 3))
    assert np.array_equal(workspace.outer, np.array(L_SHAPE, dtype=bool))
    assert workspace.source == str(path)


def test_open_passes_options_on(files: Path) -> None:
    workspace = Workspace.open(files / "map.png", spacing=0.5, lower=(1.0, 2.0), dark="free")
    assert workspace.grid == Grid((1.0, 2.0), 0.5, (2, 3))
    assert np.array_equal(workspace.outer, ~np.array(L_SHAPE, dtype=bool))
    polygons = Workspace.open(str(files / "map.wkt"), spacing=1.0, bounds=(0, 0, 2, 2))
    assert polygons.outer.tolist() == [[True, True], [False, True]]


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("map.png", {}, "spacing is missing"),
        ("map.npy", {}, "spacing is missing"),
        ("map.wkt", {"bounds": (0, 0, 1, 1)}, "spacing is missing"),
        ("map.yaml", {"spacing": 0.1}, "spacing is given .* takes unknown"),
        ("map.map", {"unknown": "free"}, "unknown is given .* takes spacing"),
        ("map.stl", {"spacing": 0.1}, r"ends in '.stl'.*\.yaml, \.yml, \.map, \.geojson"),
        ("map", {}, "ends in ''"),
        ("map.png", {"spacing": 0.0}, "spacing is 0.0"),
        ("map.map", {"spacing": -1.0}, "spacing is -1.0"),
    ],
)
def test_open_with_wrong_options(files: Path, name: str, options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Workspace.open(files / name, **options)


def test_open_of_something_that_is_no_name() -> None:
    with pytest.raises(InputError, match="path is 7"):
        Workspace.open(7)  # type: ignore[arg-type]


@pytest.mark.parametrize("suffix", READERS)
def test_missing_files_and_folders_are_named(tmp_path: Path, suffix: str) -> None:
    options = {} if suffix in (".yaml", ".yml", ".map") else {"spacing": 1.0}
    path = tmp_path / f"absent{suffix}"
    with pytest.raises(FileError, match=f"absent{suffix} does not exist"):
        Workspace.open(path, **options)
    path.mkdir()
    with pytest.raises(FileError, match=f"absent{suffix} is a folder"):
        Workspace.open(path, **options)


def test_unreadable_file(files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any, **__: Any) -> str:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_text", refuse)
    with pytest.raises(FileError, match=r"map\.map cannot be read: Permission denied"):
        Workspace.open(files / "map.map")


@pytest.mark.parametrize("content", [b"", b"\x93NUMPY garbage", b"PK\x03\x04"])
def test_a_damaged_npy_file(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "bad.npy").write_bytes(content)
    with pytest.raises(FileError, match=r"bad\.npy cannot be read"):
        Workspace.open(tmp_path / "bad.npy", spacing=1.0)


def test_npy_file_of_floats(tmp_path: Path) -> None:
    np.save(tmp_path / "floats.npy", np.full((2, 2), 0.5))
    with pytest.raises(InputError, match="dtype float64"):
        Workspace.open(tmp_path / "floats.npy", spacing=1.0)


def test_masked_cells_are_refused():
    cells = np.ma.array(np.zeros((3, 2), bool), mask=[[True, False]] * 3)
    with pytest.raises(InputError, match="3 masked"):
        Workspace.from_array(cells, 0.1)
    assert not Workspace.from_array(np.ma.array(np.zeros((3, 2), bool)), 0.1).outer.any()


def test_labelled_cells_must_be_in_the_order_of_the_coordinates():
    import xarray

    cells = xarray.DataArray(np.eye(3, dtype=bool)[:2], dims=("y", "x"))
    with pytest.raises(InputError, match="transpose"):
        Workspace.from_array(cells, 0.1)
    assert Workspace.from_array(cells.transpose("x", "y"), 0.1).grid.shape == (3, 2)


def test_odd_bytes_become_plain_booleans():
    cells = np.array([[0, 255], [101, 0]], np.uint8).view(bool)
    assert Workspace.from_array(cells, 0.1).outer.view(np.uint8).tolist() == [[0, 1], [1, 0]]
