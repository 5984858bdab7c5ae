"""Components of tiled maps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from tests.helpers.maps import proven_paths
from tests.helpers.placements import draw_configurations
from tests.laws.any_map import CAR, MAP_INPUTS
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


def test_components_are_computed_once(tmp_path):
    workspace, steps = random_workspace((40, 33)), []
    tiled = cspace.build(workspace, CAR, rotations=4, store=tmp_path / "m", tile=9)
    tiled.compute_components(progress=lambda *step: steps.append(step))
    assert steps[-1] == (20, 20)
    steps.clear()
    tiled.compute_components(progress=lambda *step: steps.append(step))
    assert not steps
