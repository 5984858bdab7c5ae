"""Components of stored maps equal those of the same map in memory."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from handmade import fill_boxes
from maps import proven_paths
from tiles.test_build import CAR, random_workspace


def endpoints(space, n, rng):
    """Draw pairs of configurations in and around the grid."""
    grid = space.grid
    position = rng.uniform(np.array(grid.lower) - 0.3, np.array(grid.upper) + 0.3, (2, n, grid.dim))
    turn = rng.normal(size=(2, n, space.size - grid.dim)) * 3.0
    if turn.shape[-1] == 4:
        turn /= np.linalg.norm(turn, axis=-1)[..., None]
    return np.concatenate([position, turn], axis=-1)


def same_answers(tiled, space, rng, n=300):
    q0, q1 = endpoints(space, n, rng)
    expected = proven_paths(space, q0, q1)
    np.testing.assert_array_equal(proven_paths(tiled, q0, q1), expected)
    assert proven_paths(tiled, q0[0], q1[0]) is expected[0]
    return {str(answer) for answer in expected}


@settings(max_examples=4)
@given(seed=st.integers(0, 2**16), tile=st.integers(4, 20), density=st.sampled_from([0.05, 0.3, 0.5]))
def test_tiled_components_equal_those_in_memory(seed, tile, density, tmp_path_factory):
    """Walls that wind through many tiles; a robot smaller than a cell leaves all three answers."""
    rng = np.random.default_rng(seed)
    outer = rng.random((22, 17)) < density
    workspace = cspace.Workspace.from_array(outer, 0.1)
    robot, rotations = (cspace.Robot.disc(0.04), None) if seed % 2 else (cspace.Robot.rectangle(0.16, 0.02), 6)
    path = tmp_path_factory.mktemp("maze") / "m"
    space = cspace.build(workspace, robot, rotations=rotations)
    tiled = cspace.build(workspace, robot, rotations=rotations, store=path, tile=tile)
    same_answers(tiled, space, rng)
    cells, low = rng.random((6, 6)) < 0.4, rng.integers(0, 11, 2)
    space.update(cells, low)
    tiled.update(cells, low)
    same_answers(tiled, space, rng)


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
    assert same_answers(cspace.open(tmp_path / "m"), space, np.random.default_rng(0))
