"""Windows and overviews of tiled maps."""

import numpy as np
import pytest
import shapely
import trimesh

import cspace
from cspace.errors import ConfigurationError, InputError
from tests.laws.any_map import CAR
from tests.tiles.test_space import build_both


def draw_within(space, lower, upper, n, rng):
    """Draw configurations in a box, almost surely none on a cell boundary."""
    position = rng.uniform(lower, upper, (n, len(lower)))
    return np.hstack([position, rng.uniform(-4, 4, (n, space.size - len(lower)))])


def triangles():
    corners = [
        [(x, y), (x + 1.1, y + 0.07), (x + 0.31, y + 0.83)] for x in (0.1, 1.7) for y in (0.4, 2.3)
    ]
    return cspace.Workspace.from_polygons(
        [shapely.Polygon(each) for each in corners], 0.1, (0, 0, 4, 4)
    )


def box():
    turned = trimesh.transformations.euler_matrix(0.3, 0.4, 0.5)
    turned[:3, 3] = 0.7, 0.6, 0.5
    made = trimesh.creation.box((0.7, 0.6, 0.5), turned)
    return cspace.Workspace.from_mesh(made, 0.1, (0, 0, 0, 1.6, 1.6, 1.6))


@pytest.mark.parametrize("outside", ["blocked", "free"])
@pytest.mark.parametrize(
    ("obstacles", "robot", "rotations"),
    [(triangles, CAR, 6), (box, cspace.Robot.ball(0.13), None)],
    ids=["plane", "space"],
)
def test_window_uses_exact_shapes(obstacles, robot, rotations, outside, tmp_path):
    workspace = obstacles()
    space = cspace.build(workspace, robot, rotations=rotations, outside=outside)
    tiled = cspace.build(
        workspace, robot, rotations=rotations, outside=outside, store=tmp_path / "m", tile=11
    )
    rng, size = np.random.default_rng(0), np.asarray(space.grid.upper)
    for low, high in ((0.3, 0.7), (0.0, 0.45)):
        window = tiled.window(low * size, high * size)
        q, p = (draw_within(space, low * size, high * size, 400, rng) for _ in range(2))
        p[:, : len(size)] = np.clip(
            q[:, : len(size)] + rng.normal(size=(400, len(size))) * 0.1, low * size, high * size
        )
        free = space.is_free(q, exact=True)
        np.testing.assert_array_equal(window.is_free(q, exact=True), free)
        np.testing.assert_array_equal(
            window.motion_is_free(q, p, exact=True), space.motion_is_free(q, p, exact=True)
        )
        assert (free != space.is_free(q)).any()


def test_window_of_the_whole_map_equals_it(tmp_path):
    space, tiled = build_both("yaw", tmp_path, tile=9, seed=3)
    window = tiled.window(space.grid.lower, space.grid.upper)
    assert (window.outside, window.grid) == (space.outside, space.grid)
    np.testing.assert_array_equal(window.cell_states, space.cell_states)
    q = draw_within(
        space,
        np.array(space.grid.lower) - 2,
        np.array(space.grid.upper) + 2,
        500,
        np.random.default_rng(0),
    )
    np.testing.assert_array_equal(window.classify(q), space.classify(q))
    np.testing.assert_array_equal(window.clearance(q), space.clearance(q))
    q0, q1 = q.reshape(2, 250, -1)
    np.testing.assert_array_equal(window.is_disconnected(q0, q1), space.is_disconnected(q0, q1))


def test_saved_window_keeps_its_unknown_exterior(tmp_path):
    _, tiled = build_both("plane", tmp_path, "free", tile=9, seed=3, two=True)
    window = tiled.window(np.add(tiled.grid.lower, 1.0), np.add(tiled.grid.lower, 1.5))
    window.save(tmp_path / "part.zarr")
    opened = cspace.open(tmp_path / "part.zarr")
    assert opened.outside == "unknown"
    assert opened.classify([1e3, 1e3]) == cspace.MIXED
    with pytest.raises(ConfigurationError, match="window of a larger one"):
        opened.update(np.ones((1, 1), bool), (0, 0))
    with pytest.raises(InputError, match="outside"):
        cspace.build(window.workspace, CAR, outside="unknown")


@pytest.mark.parametrize(
    ("lower", "upper"),
    [((1, 1), (0, 0)), ((90, 90), (99, 99)), ((0,), (1,)), ((0, np.nan), (1, 1))],
    ids=["reversed", "outside", "short", "nan"],
)
def test_window_rejects_invalid_boxes(tmp_path, lower, upper):
    _, tiled = build_both("plane", tmp_path, tile=9, seed=3)
    with pytest.raises(InputError):
        tiled.window(lower, upper)


@pytest.mark.parametrize("name", ["plane", "yaw in space"])
def test_overview_states_are_proven(name, tmp_path):
    # A coarse cell is FREE or BLOCKED if all its cells are, otherwise MIXED.
    space, tiled = build_both(name, tmp_path, "free", tile=9, seed=3, two=True)
    for most in (5, 12, 1000):
        seen = tiled.overview(most)
        assert max(seen.grid.shape) <= most
        factor = round(seen.grid.spacing / space.grid.spacing)
        states = np.stack([space.states_at(turn) for turn in space.slice_rotations])
        sides = [factor * n for n in seen.grid.shape]
        padded = np.full((len(states), *sides), cspace.MIXED, dtype=np.uint8)
        padded[(slice(None), *(slice(0, n) for n in space.grid.shape))] = states
        pieces = padded.reshape(
            len(states), *(part for n in seen.grid.shape for part in (n, factor))
        )
        axes = tuple(range(2, pieces.ndim, 2))
        free, blocked = (
            (pieces == cspace.FREE).all(axis=axes),
            (pieces == cspace.BLOCKED).all(axis=axes),
        )
        expected = np.where(free, cspace.FREE, np.where(blocked, cspace.BLOCKED, cspace.MIXED))
        ours = np.stack([seen.states_at(turn) for turn in seen.slice_rotations])
        np.testing.assert_array_equal(ours, expected)
    with pytest.raises(InputError, match="max_cells"):
        tiled.overview(0)
