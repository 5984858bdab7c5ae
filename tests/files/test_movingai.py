"""Maps and problems of the MovingAI benchmark."""

import numpy as np
import pytest

from cspace import FileError, Grid, Workspace
from cspace._files.images import read_movingai_map, read_movingai_voxels
from tests.helpers.maps import MOVINGAI_MAPS, proven_paths, read_problems
from tests.helpers.refusals import refusals

TINY_MAP = "type octile\nheight 2\nwidth 4\nmap\n.GS.\n@OTW\n"
VOXELS = "voxel 2 3 4\n0 0 0\n1 2 3\n1 0 2\n"


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_tiny_maps_are_read(tmp_path, end):
    path = tmp_path / "tiny.map"
    path.write_bytes((TINY_MAP + "\n").replace("\n", end).encode())
    workspace = Workspace.open(path, spacing=0.5)
    assert workspace.grid == Grid((0.0, 0.0), 0.5, (4, 2))
    assert workspace.outer.tolist() == [[True, False]] * 4
    assert workspace.source == str(path)
    path = tmp_path / "tiny.3dmap"
    path.write_bytes((VOXELS + "\n1  0 2").replace("\n", end).encode())
    blocked = read_movingai_voxels(path)
    assert blocked.shape == (2, 3, 4)
    assert np.argwhere(blocked).tolist() == [[0, 0, 0], [1, 0, 2], [1, 2, 3]]
    assert Workspace.open(path).grid == Grid((0.0, 0.0, 0.0), 1.0, (2, 3, 4))


@refusals(
    "read, text, message",
    (read_movingai_map, TINY_MAP.replace("width", "height"), "'height H', 'width W'"),
    (read_movingai_voxels, VOXELS + "1 2\n", "line 5 is '1 2'; it must hold 'x y z'"),
    (read_movingai_voxels, VOXELS + "\n\n2 0 0\n", "line 7 is .* inside 2 x 3 x 4, counted from 0"),
)
def test_malformed_maps_are_refused(tmp_path, read, text, message):
    (tmp_path / "bad.map").write_text(text, encoding="utf-8", errors="surrogateescape")
    with pytest.raises(FileError, match=message):
        read(tmp_path / "bad.map")


@pytest.mark.parametrize("name", MOVINGAI_MAPS)
def test_problems_of_real_maps_have_paths_and_bounds_near_the_published_length(data, name):
    path = data / "movingai" / f"{name}.map"
    rows = path.read_text().splitlines()[4:]
    blocked = np.isin(np.array(list(map(list, rows))), list("@OTW"))
    assert np.array_equal(Workspace.open(path).outer, np.flipud(blocked).T)
    space, starts, goals, optimal = read_problems(path)
    assert space.is_free(starts).all()
    assert space.is_free(goals).all()
    assert all(answer is True for answer in proven_paths(space, starts, goals))
    # The published lengths are of paths along eight directions, at most 1.0824 of the shortest.
    for problem in np.linspace(0, len(starts) // 2, 3, dtype=int):
        bound = space.min_path_length(starts[problem], goals[problem])
        assert optimal[problem] / 1.0824 / 1.03 - 1.0 <= bound <= optimal[problem]
