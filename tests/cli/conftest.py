"""Files for the command line: workspaces of every kind and a map of each space."""

import numpy as np
import pytest
import trimesh

from tests.helpers.commands import run
from tests.helpers.handmade import fill_boxes

MAPS = {
    "plane": "floor.npy --robot rect:0.1x0.05",
    "turning": "floor.npy --robot rect:0.1x0.05 --rotations 8",
    "space": "rooms.npy --robot box:0.1x0.1x0.1",
    "free": "rooms.npy --robot box:0.06x0.04x0.06 --rotations quaternions:2",
}
"""Workspace and robot of each map, by its name."""


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """Write workspaces and maps of two rooms with a window between them and a closed cupboard.

    The rooms are 1.2 m by 1.2 m by 0.8 m, with cells of 0.1 m.
    """
    folder = tmp_path_factory.mktemp("files")
    boxes = 12, np.s_[21:, :4, :4]
    gaps = np.s_[12, 4:8, 2:6], np.s_[22:, :3, :3]
    occupied = fill_boxes((25, 12, 8), *boxes, but=gaps)
    np.save(folder / "rooms.npy", occupied)
    np.save(folder / "floor.npy", occupied[:, :, 2])
    np.savetxt(
        folder / "rooms.3dmap", np.argwhere(occupied), "%d", header="voxel 25 12 8", comments=""
    )
    cube = trimesh.creation.box(bounds=[(0, 0, 0), (1, 1, 1)])
    cube.export(folder / "cube.obj")
    cube.update_faces(np.arange(11))
    cube.export(folder / "open.obj")
    (folder / "cloud.xyz").write_text("0 0 0\n1 0 0\n1 2 0.5\n")
    (folder / "wall.wkt").write_text("POLYGON ((0 0, 1 0, 0 1, 0 0))")
    for name, command in MAPS.items():
        file, _, options = command.partition(" ")
        made = run(f"build --spacing 0.1 {options}", folder / file, "-o", folder / f"{name}.zarr")
        assert made.exit_code == 0, made.output
    return folder


@pytest.fixture
def room(folder, tmp_path, monkeypatch):
    """Enter a folder with links to the files."""
    monkeypatch.chdir(tmp_path)
    for file in folder.iterdir():
        (tmp_path / file.name).symlink_to(file)
    return tmp_path
