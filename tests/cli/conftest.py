"""Files for the command line: workspaces of every kind, and a map of each space."""

from pathlib import Path

import numpy as np
import pytest

from commands import run

# Two rooms of 1.2 m by 1.2 m by 0.8 m with a window between them, and a cupboard that is shut; cells of 0.1 m.
CUBE = """v 0 0 0
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
    folder = tmp_path_factory.mktemp("files")
    occupied = np.zeros((25, 12, 8), dtype=bool)
    occupied[12] = True
    occupied[12, 4:8, 2:6] = False
    occupied[21:, :4, :4] = True
    occupied[22:, :3, :3] = False
    np.save(folder / "rooms.npy", occupied)
    np.save(folder / "floor.npy", occupied[:, :, 2])
    rows = ["voxel 25 12 8", *(" ".join(map(str, index)) for index in np.argwhere(occupied).tolist())]
    (folder / "rooms.3dmap").write_text("\n".join(rows) + "\n")
    (folder / "cube.obj").write_text(CUBE)
    (folder / "open.obj").write_text(CUBE.rpartition("f ")[0])
    (folder / "cloud.xyz").write_text("0 0 0\n1 0 0\n1 2 0.5\n")
    (folder / "wall.wkt").write_text("POLYGON ((0 0, 1 0, 0 1, 0 0))")
    space = ["map", folder / "rooms.npy", "--robot", "box:0.1x0.1x0.1", "--spacing", 0.1]
    assert run(*space, "-o", folder / "space.zarr").exit_code == 0
    turning = ["map", folder / "rooms.npy", "--robot", "box:0.06x0.04x0.06", "--spacing", 0.1, "--rotations", 4]
    assert run(*turning, "-o", folder / "both.zarr").exit_code == 0
    free = [
        "map",
        folder / "rooms.npy",
        "--robot",
        "box:0.06x0.04x0.06",
        "--spacing",
        0.1,
        "--rotations",
        "quaternions:2",
    ]
    assert run(*free, "-o", folder / "free.zarr").exit_code == 0
    flat = ["map", folder / "floor.npy", "--robot", "rect:0.1x0.05", "--spacing", 0.1]
    assert run(*flat, "-o", folder / "plane.zarr").exit_code == 0
    assert run(*flat, "--rotations", 8, "-o", folder / "turning.zarr").exit_code == 0
    return folder


@pytest.fixture
def room(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with links to the files."""
    monkeypatch.chdir(tmp_path)
    for file in folder.iterdir():
        (tmp_path / file.name).symlink_to(file)
    return tmp_path
