"""Components of tiled maps."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from tests.handmade import fill_boxes
from tests.laws.any_map import CAR
from tests.maps import proven_paths
from tests.placements import draw_configurations
from tests.tiles.test_build import random_workspace


def check_connectivity(tiled, space, rng, n=300):
    """Compare a tiled map with the map in memory."""
    q0, q1 = draw_configurations(space, rng, 2 * n).reshape(2, n, -1)
    expected = proven_paths(space, q0, q1)
    np.testing.assert_array_equal(proven_paths(tiled, q0, q1), expected)
    assert proven_paths(tiled, q0[0], q1[0]) is expected[0]


@settings(max_examples=4)
@given(seed=st.integers(0, 2**16), tile=st.integers(4, 20), density=st.sampled_from([0.05, 0.3, 0.5]))
def test_connectivity_of_tiled_maps_equals_that_in_memory(seed, tile, density, tmp_path_factory):
    # Random walls wind through many tiles; a robot smaller than a cell leaves undecided pairs.
    rng = np.random.default_rng(seed)
    outer = rng.random((22, 17)) < density
    workspace = cspace.Workspace.from_array(outer, 0.1)
    robot, rotations = (cspace.Robot.disc(0.04), None) if seed % 2 else (cspace.Robot.rectangle(0.16, 0.02), 6)
    path = tmp_path_factory.mktemp("maze") / "m"
    space = cspace.build(workspace, robot, rotations=rotations)
    tiled = cspace.build(workspace, robot, rotations=rotations, store=path, tile=tile)
    check_connectivity(tiled, space, rng)
    cells, low = rng.random((6, 6)) < 0.4, rng.integers(0, 11, 2)
    space.update(cells, low)
    tiled.update(cells, low)
    check_connectivity(tiled, space, rng)


def test_update_relabels_only_changed_tiles(tmp_path):
    workspace = cspace.Workspace.from_array(fill_boxes((60, 60), np.s_[30]), 0.1)
    tiled = cspace.build(workspace, cspace.Robot.disc(0.1), store=tmp_path / "m", tile=10)
    assert tiled.is_disconnected([1.0, 1.0], [5.0, 5.0])
    written = {file: file.stat().st_mtime_ns for file in (tmp_path / "m" / "labels_0").rglob("*") if file.is_file()}
    tiled.update(np.zeros((10, 10), bool), (25, 45))
    assert tiled.is_connected([1.0, 1.0], [5.0, 5.0])
    changed = [file for file, time in written.items() if file.stat().st_mtime_ns != time]
    assert 0 < len(changed) <= 4


def test_damaged_labels_are_recomputed(tmp_path):
    workspace = random_workspace((40, 33))
    tiled = cspace.build(workspace, CAR, rotations=4, store=tmp_path / "m", tile=9)
    tiled.compute_components()
    for file in list((tmp_path / "m" / "labels_1" / "c").rglob("0"))[:3]:
        if file.is_file():
            file.write_bytes(file.read_bytes()[:-3])
    space = cspace.build(workspace, CAR, rotations=4)
    check_connectivity(cspace.open(tmp_path / "m"), space, np.random.default_rng(0))
