"""Windows and overviews of tiled maps."""

import numpy as np
import pytest
import shapely

import cspace
import planners
from cspace import Workspace
from cspace.errors import ConfigurationError, InputError
from tests.helpers.strategies import few
from tests.tiles.worlds import CAR, build_kind, build_pair


def draw_within(space, lower, upper, n, rng):
    """Draw configurations in a box.

    None lies on a cell boundary, where a map and its window may count it to other cells.
    """
    positions = rng.uniform(lower, upper, (n, len(lower)))
    return np.hstack([positions, rng.uniform(-4, 4, (n, space.size - len(lower)))])


@pytest.mark.parametrize("outside", ["blocked", "free"])
def test_windows_use_exact_shapes(outside, tmp_path):
    triangle = shapely.Polygon([(0.1, 0.4), (1.2, 0.47), (0.41, 1.23)])
    steps = (0.0, 0.0), (1.6, 0.0), (0.3, 1.9)
    shapes = [shapely.affinity.translate(triangle, *step) for step in steps]
    workspace = cspace.Workspace.from_polygons(shapes, 0.1, (0, 0, 4, 4))
    options = {"rotations": 6, "outside": outside, "tile": 11}
    space, tiled = build_pair(workspace, CAR, tmp_path / "m", **options)
    rng = np.random.default_rng(0)
    for low, high in (((1.2, 1.2), (2.8, 2.8)), ((0.0, 0.0), (1.8, 1.8))):
        window = tiled.window(low, high)
        q = draw_within(space, low, high, 400, rng)
        ends = draw_within(space, low, high, 400, rng)
        ends[:, :2] = q[:, :2] + 0.1 * (ends[:, :2] - q[:, :2])
        is_free = space.exact.is_free(q)
        np.testing.assert_array_equal(window.exact.is_free(q), is_free)
        np.testing.assert_array_equal(
            window.exact.motion_is_free(q, ends), space.exact.motion_is_free(q, ends)
        )
        assert (is_free != space.is_free(q)).any()


def test_saved_windows_keep_their_unknown_exterior(tmp_path):
    _, tiled = build_kind("plane", tmp_path / "m", "free")
    window = tiled.window(np.add(tiled.grid.lower, 1.0), np.add(tiled.grid.lower, 1.5))
    window.save(tmp_path / "part.zarr")
    opened = cspace.open(tmp_path / "part.zarr")
    assert opened.outside == "unknown"
    assert opened.classify((1e3, 1e3)) == cspace.MIXED
    with pytest.raises(ConfigurationError, match="window of a larger one"):
        opened.update(np.ones((1, 1), bool), (0, 0))


@pytest.fixture(scope="module")
def tiled_plane(tmp_path_factory):
    """Build a map in tiles that tests share and none changes."""
    return build_kind("plane", tmp_path_factory.mktemp("tiles") / "m")[1]


@pytest.mark.parametrize(
    "method, arguments",
    [
        ("window", ((1, 1), (0, 0))),
        ("window", ((90, 90), (99, 99))),
        ("window", ((0,), (1,))),
        ("window", ((0, np.nan), (1, 1))),
        ("overview", (0,)),
    ],
    ids=["reversed", "outside", "short", "nan", "no cells"],
)
def test_windows_and_overviews_refuse_invalid_arguments(tiled_plane, method, arguments):
    message = (
        r"window.*(box in the map|in metres|finite)" if method == "window" else "max_cells is 0"
    )
    with pytest.raises(InputError, match=message):
        getattr(tiled_plane, method)(*arguments)


@pytest.mark.parametrize("kind", ["plane", "yaw in space"])
@pytest.mark.parametrize("max_cells", few([5, 3, 12, 1000]))
def test_a_coarse_cell_of_an_overview_has_the_state_of_all_its_cells(kind, max_cells, tmp_path):
    space, tiled = build_kind(kind, tmp_path / "m", "free")
    overview = tiled.overview(max_cells)
    assert max(overview.grid.shape) <= max_cells
    factor = round(overview.grid.spacing / space.grid.spacing)
    fine = space.cell_states.reshape(-1, *space.grid.shape)
    coarse = overview.cell_states.reshape(-1, *overview.grid.shape)
    for rotation, *cell in np.ndindex(coarse.shape):
        first = factor * np.array(cell)
        block = fine[rotation, *map(slice, first, first + factor)]
        states = np.unique(block)
        is_whole = block.size == factor**space.grid.dim  # nothing is known beyond the map
        expected = states[0] if is_whole and len(states) == 1 else cspace.MIXED
        assert coarse[rotation, *cell] == expected


WALL = shapely.box(0.0, 0.0, 1.0, 0.2)


def test_what_does_not_fit_into_memory_is_built_in_tiles_and_smaller_windows(tmp_path, monkeypatch):
    lazy = Workspace.from_polygons([WALL], 0.02, bounds=(0, 0, 30, 30), lazy=True)
    tiled = cspace.build(lazy, "disc:0.1", store=tmp_path / "map.zarr", tile=512)
    with monkeypatch.context() as patch:
        patch.setattr("cspace._support.limits.free_bytes", lambda: 4_000_000)
        with pytest.raises(InputError, match="the window has"):
            tiled.window((0, 0), (30, 30))
        assert tiled.window((0, 0), (1, 1)).grid.size
    assert tiled.overview(1024).grid.size
    window = tiled.window(*tiled.grid.center_of([(900, 900), (1000, 1000)]))
    assert planners.plan(window, (19.0, 19.0), (19.5, 19.5))
