"""Errors for misspelt file names, which name the nearest file."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zarr

import cspace
from cspace import Arm, CspaceError, FileError, Mesh, Robot, Workspace
from cspace.files.access import suggest_file
from tests.helpers.commands import run

Reader = Callable[[Path], object]

MISSPELT_FILES: dict[str, tuple[str, str, Reader]] = {
    "ROS map": ("floor.yaml", "floo.yaml", Workspace.open),
    "suffix of a map": ("floor.yaml", "floor.ymal", Workspace.open),
    "upper case": ("Floor.PNG", "floo.png", lambda path: Workspace.open(path, spacing=0.1)),
    "array": ("cells.npy", "cels.npy", lambda path: Workspace.from_array(path, 0.1)),
    "Zarr array": ("cells.zarr", "cell.zarr", lambda path: Workspace.open(path, spacing=0.1)),
    "saved map": ("floor.zarr", "floo.zarr", cspace.open),
    "mesh": ("part.stl", "prat.stl", Mesh.of),
    "robot": ("robot.geojson", "robto.geojson", Robot.open),
    "suffix of a robot": ("robot.urdf", "robot.udrf", Robot.open),
    "shape": ("cart.geojson", "cart.geojsn", lambda path: Robot("cart", path)),
    "arm": ("arm.urdf", "amr.urdf", Arm.from_urdf),
}


@pytest.mark.parametrize("case", MISSPELT_FILES)
def test_the_error_names_the_nearest_file_of_the_folder(case: str, tmp_path: Path) -> None:
    pytest.importorskip("yourdfpy")
    name, misspelt, read = MISSPELT_FILES[case]
    for each in (name, "other.dat", ".hidden", "notes.md"):
        (tmp_path / each).touch()
    with pytest.raises(CspaceError) as refused:
        read(tmp_path / misspelt)
    assert f"did you mean {tmp_path / name}?" in refused.value.hint


def test_no_name_is_suggested_if_none_is_similar(tmp_path: Path) -> None:
    (tmp_path / "floor.yaml").touch()
    for missing in ("quite-another.stl", "no folder/floor.yaml", "x" * 5000):
        assert suggest_file(tmp_path / missing, "hint") == "hint"
    assert suggest_file(tmp_path / "floor.yaml", "hint") == "hint"  # it exists
    with pytest.raises(CspaceError, match=r"does not exist; .*; check the name and the folder"):
        Workspace.open(tmp_path / "quite-another.yaml")


def test_a_missing_chunk_takes_no_search_for_a_similar_name(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    array = zarr.create_array(tmp_path / "cells.zarr", shape=(8, 8), chunks=(4, 4), dtype=bool)
    array[:] = True
    next(path for path in (tmp_path / "cells.zarr" / "c").rglob("1") if path.is_file()).unlink()
    monkeypatch.setattr(
        "cspace.files.access.suggest_file", lambda path, hint: pytest.fail(str(path))
    )
    with pytest.raises(FileError, match="chunk"):
        np.asarray(Workspace.open(tmp_path / "cells.zarr", spacing=0.1).outer)


def test_commands_name_the_nearest_file(tmp_path: Path) -> None:
    (tmp_path / "floor.zarr").mkdir()
    result = run("info", tmp_path / "floo.zarr")
    assert result.exit_code == 2
    assert f"did you mean {tmp_path / 'floor.zarr'}?" in result.stderr
