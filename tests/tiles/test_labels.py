"""Components of tiled maps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from tests.laws.any_map import CAR, MAP_INPUTS
from tests.maps import proven_paths
from tests.placements import draw_configurations
from tests.tiles.test_build import random_workspace
from tests.tiles.test_space import build_both


def check_connectivity(tiled, space, rng, n=300):
    """Compare a tiled map with the map in memory."""
    q0, q1 = draw_configurations(space, rng, 2 * n).reshape(2, n, -1)
    expected = proven_paths(space, q0, q1)
    np.testing.assert_array_equal(proven_paths(tiled, q0, q1), expected)
    assert proven_paths(tiled, q0[0], q1[0]) is expected[0]


@pytest.mark.parametrize("outside", ["blocked", "free"])
@pytest.mark.parametrize("name", MAP_INPUTS)
def test_connectivity_equals_the_map_in_memory(name, outside, tmp_path):
    space, tiled = build_both(name, tmp_path, outside)
    check_connectivity(tiled, space, np.random.default_rng(0), 1000)


@settings(max_examples=12)
@given(
    seed=st.integers(0, 2**16), tile=st.integers(3, 20), density=st.sampled_from([0.05, 0.3, 0.5])
)
def test_connectivity_in_mazes_equals_the_map_in_memory(seed, tile, density, tmp_path_factory):
    # Random walls wind through many tiles; a robot smaller than a cell leaves undecided pairs.
    rng = np.random.default_rng(seed)
    outer = rng.random((22, 17)) < density
    workspace = cspace.Workspace.from_array(outer, 0.1)
    robot, rotations = (
        (cspace.Robot.disc(0.04), None) if seed % 2 else (cspace.Robot.rectangle(0.16, 0.02), 6)
    )
    path = tmp_path_factory.mktemp("maze") / "m"
    space = cspace.build(workspace, robot, rotations=rotations)
    tiled = cspace.build(workspace, robot, rotations=rotations, store=path, tile=tile)
    check_connectivity(tiled, space, rng)
    cells, low = rng.random((6, 6)) < 0.4, rng.integers(0, 11, 2)
    space.update(cells, low)
    tiled.update(cells, low)
    check_connectivity(tiled, space, rng)


FORGED_COMPONENTS = {
    "fewer offsets": lambda saved: saved.update(offsets_0=saved["offsets_0"][:-1]),
    "falling offsets": lambda saved: saved.update(
        offsets_1=saved["offsets_1"][::-1] - saved["offsets_1"][-1]
    ),
    "pairs of no nodes": lambda saved: saved["pairs_1"].__iadd__(10**6),
    "pairs of floats": lambda saved: saved.update(pairs_0=saved["pairs_0"] + 0.5),
    "triples": lambda saved: saved.update(pairs_0=np.zeros((2, 3), dtype=np.int64)),
    "no pairs": lambda saved: saved.pop("pairs_0"),
}


@pytest.mark.parametrize("forge", FORGED_COMPONENTS.values(), ids=FORGED_COMPONENTS)
def test_forged_components_are_computed_again(tmp_path, forge):
    workspace = random_workspace((40, 33))
    cspace.build(workspace, CAR, rotations=4, store=tmp_path / "m", tile=9).compute_components()
    file = tmp_path / "m" / "components.npz"
    with np.load(file) as opened:
        saved = dict(opened)
    forge(saved)
    np.savez(file, **saved)
    space = cspace.build(workspace, CAR, rotations=4)
    check_connectivity(cspace.open(tmp_path / "m"), space, np.random.default_rng(0))


def test_components_with_other_numbers_of_nodes_are_refused(tmp_path):
    space = cspace.build(random_workspace((40, 33)), CAR, rotations=4, store=tmp_path / "m", tile=9)
    space.compute_components()
    file = tmp_path / "m" / "components.npz"
    with np.load(file) as opened:
        saved = dict(opened)
    for kind in (0, 1):
        saved[f"offsets_{kind}"] += np.arange(21)
    np.savez(file, **saved)
    q = np.random.default_rng(0).uniform(
        [*space.grid.lower, -3.0], [*space.grid.upper, 3.0], (200, 3)
    )
    with pytest.raises(cspace.FileError, match="of another map"):
        cspace.open(tmp_path / "m").is_connected(q[:100], q[100:])


@pytest.mark.parametrize("content", [None, b"", b"PK half", "another map"])
def test_lost_damaged_and_foreign_components_are_computed_again(tmp_path, content):
    workspace, steps = random_workspace((40, 33)), []
    tiled = cspace.build(workspace, CAR, rotations=4, store=tmp_path / "m", tile=9)
    tiled.compute_components(progress=lambda *step: steps.append(step))
    assert steps[-1] == (20, 20)
    file = tmp_path / "m" / "components.npz"
    steps.clear()
    cspace.open(tmp_path / "m").compute_components(progress=lambda *step: steps.append(step))
    assert not steps  # they were read
    if content == "another map":
        other = cspace.build(
            random_workspace((40, 33), 1), CAR, rotations=4, store=tmp_path / "o", tile=9
        )
        other.compute_components()
        file.write_bytes((tmp_path / "o" / "components.npz").read_bytes())
    elif content is None:
        file.unlink()
    else:
        file.write_bytes(content)
    space = cspace.build(workspace, CAR, rotations=4)
    check_connectivity(cspace.open(tmp_path / "m"), space, np.random.default_rng(0))
