"""Files for the command line: workspaces of every kind and a map of each space."""

from pathlib import Path

import numpy as np
import pytest

from tests.helpers.commands import run
from tests.helpers.handmade import fill_boxes

CUBE_OBJ = """v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
f 1 3 2
f 1 4 3
f 5 6 7
f 5 7 8
f 1 2 6
f 1 6 5
f 2 3 7
f 2 7 6
f 3 4 8
f 3 8 7
f 4 1 5
f 4 5 8
"""


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write workspaces and maps of two rooms with a window between them and a closed cupboard.

    The rooms are 1.2 m by 1.2 m by 0.8 m, with cells of 0.1 m.
    """
    folder = tmp_path_factory.mktemp("files")
    occupied = fill_boxes(
        (25, 12, 8), 12, np.s_[21:, :4, :4], but=(np.s_[12, 4:8, 2:6], np.s_[22:, :3, :3])
    )
    np.save(folder / "rooms.npy", occupied)
    np.save(folder / "floor.npy", occupied[:, :, 2])
    rows = [
        "voxel 25 12 8",
        *(" ".join(map(str, index)) for index in np.argwhere(occupied).tolist()),
    ]
    (folder / "rooms.3dmap").write_text("\n".join(rows) + "\n")
    (folder / "cube.obj").write_text(CUBE_OBJ)
    (folder / "open.obj").write_text(CUBE_OBJ.rpartition("f ")[0])
    (folder / "cloud.xyz").write_text("0 0 0\n1 0 0\n1 2 0.5\n")
    (folder / "wall.wkt").write_text("POLYGON ((0 0, 1 0, 0 1, 0 0))")
    for workspace, robot, rotations, name in (
        ("rooms.npy", "box:0.1x0.1x0.1", (), "space.zarr"),
        ("rooms.npy", "box:0.06x0.04x0.06", ("--rotations", 4), "both.zarr"),
        ("rooms.npy", "box:0.06x0.04x0.06", ("--rotations", "quaternions:2"), "free.zarr"),
        ("floor.npy", "rect:0.1x0.05", (), "plane.zarr"),
        ("floor.npy", "rect:0.1x0.05", ("--rotations", 8), "turning.zarr"),
    ):
        command = [
            "map",
            folder / workspace,
            "--robot",
            robot,
            "--spacing",
            0.1,
            *rotations,
            "-o",
            folder / name,
        ]
        assert run(*command).exit_code == 0
    return folder


@pytest.fixture
def room(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Enter a folder with links to the files."""
    monkeypatch.chdir(tmp_path)
    for file in folder.iterdir():
        (tmp_path / file.name).symlink_to(file)
    return tmp_path
