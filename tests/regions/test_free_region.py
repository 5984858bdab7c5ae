"""Convex regions around configurations, against rational arithmetic and shapely."""

import math
import pickle
import warnings
from contextlib import suppress
from fractions import Fraction
from itertools import product

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

import cspace
import planners
from cspace import FREE, Robot, Workspace
from cspace.errors import AngleWarning, ConfigurationError, InputError
from cspace.regions import ConvexRegion
from tests.helpers.handmade import build_empty
from tests.helpers.placements import collides, is_free_around
from tests.helpers.refusals import check_refused, refusals
from tests.helpers.slits import build_slit, draw_only_exact
from tests.helpers.strategies import examples, exteriors, seeds

CLEAR = 1e-10
"""Margin of a comparison in metres from which on float64 decides it; below, fractions do.

Coordinates are at most 2,000 m, so that float64 is off by at most 2e-12 m.
"""


def lies_beyond(corners, normal, offset):
    """Return whether each convex set of corners, shape (n, k, d), lies beyond a half-space.

    Entries of corners are fractions; the comparison is exact.
    """
    margins = (corners.astype(float) @ normal).min(axis=1) - offset
    beyond = margins > 0.0
    exact = [Fraction(value) for value in normal.tolist()]
    for k in np.flatnonzero(np.abs(margins) < CLEAR):
        lowest = min(sum(map(Fraction.__mul__, exact, corner)) for corner in corners[k].tolist())
        beyond[k] = lowest > Fraction(offset)
    return beyond


def list_corners(grid, cells):
    """Return the corners of cells as fractions, shape (n, 2^d, d)."""
    steps = np.array(list(product((0, 1), repeat=grid.dim)))
    indices = (cells[:, np.newaxis] + steps).astype(object)
    lower = np.array([Fraction(value) for value in grid.lower], dtype=object)
    return lower + Fraction(grid.spacing) * indices


def list_taken(space, region, rotation=(), around=2):
    """Return the cells in and around the box of a region that are not FREE at a rotation.

    Around are that many cells more on each side.
    """
    grid = space.grid
    dim = grid.dim
    low, high = (grid.cell_of(corner[:dim]) for corner in region.bounds)
    cells = low - around + np.array(list(np.ndindex(*(high - low + 2 * around + 1))))
    inside = ((cells >= 0) & (cells < grid.shape)).all(axis=1)
    states = np.empty(len(cells), dtype=np.uint8)
    states[inside] = space.states_at(rotation)[tuple(cells[inside].T)]
    centers = grid.center_of(cells[~inside])
    turned = np.column_stack([centers, np.tile(rotation, (len(centers), 1))])
    states[~inside] = space.classify(turned) if len(turned) else 0
    return cells[states != FREE]


def list_rotations(space, region):
    """Return a rotation of each cell that a region's arc meets; one is empty without a yaw."""
    if space.axes[-1] != "yaw":
        return [()]
    low, high = -region.b[-1], region.b[-2]
    bounds = np.column_stack([space.rotations.borders[:-1], space.rotations.borders[1:]])
    turns = math.tau * np.arange(-3, 4)
    meets = (bounds[:, :1] + turns < high + 1e-9) & (bounds[:, 1:] + turns > low - 1e-9)
    return space.rotations.centers[meets.any(axis=1)].tolist()


def check_proof(space, region):
    """Check that each cell near a region that is not FREE lies beyond one of its half-spaces."""
    dim = space.dim
    rows = [(a[:dim], b) for a, b in zip(region.A, region.b, strict=True) if a[:dim].any()]
    for rotation in list_rotations(space, region):
        corners = list_corners(space.grid, list_taken(space, region, rotation))
        left = np.ones(len(corners), dtype=bool)
        for normal, offset in rows:
            left[left] = ~lies_beyond(corners[left], normal, offset)
        assert not left.any(), corners[left]


def touches_only_free(space, q):
    """Return whether all closed cells that contain a configuration are FREE."""
    return is_free_around(space, [q], 1e-7 * space.grid.spacing, 1e-8)[0]


def draw_seed(space, rng):
    """Draw a FREE configuration, often on borders of cells; None if no cell is FREE."""
    if not space.count()[0]:
        return None
    q = space.sample_free(1, rng=rng)[0]
    grid = space.grid
    cell = grid.cell_of(q[: grid.dim])
    share = rng.choice([0.0, 0.5, rng.random()], grid.dim)
    q[: grid.dim] = np.asarray(grid.lower) + grid.spacing * (cell + share)
    if space.axes[-1] == "yaw" and rng.random() < 0.3:
        q[-1] = rng.choice(space.rotations.borders[:-1])
    return q if space.is_free(q) else None


def build_random(rng, outside, dim=2, rotations=None):
    """Build a map of few cells at random places, at corners of each other and at sides."""
    shape = rng.integers(1, {2: 12, 3: 6}[dim], dim)
    occupied = rng.random(shape) < rng.choice([0.0, 0.05, 0.2, 0.4])
    spacing = rng.choice([0.1, 0.25, 1.0 / 3.0])
    lower = rng.choice([0.0, -3.7, 1234.5]) * np.ones(dim)
    workspace = Workspace.from_array(occupied, spacing, lower=lower)
    sides = spacing * rng.uniform(0.01, 1.5, dim)
    robot = Robot.rectangle(*sides) if dim == 2 else Robot.box(tuple(sides))
    return cspace.build(workspace, robot, rotations=rotations, outside=outside)


@examples(80)
@given(seeds, exteriors, st.sampled_from([(2, None), (3, None), (2, 5), (2, 1), (3, 3)]))
def test_no_cell_that_is_not_free_meets_a_region(seed, outside, kind):
    rng, (dim, rotations) = np.random.default_rng(seed), kind
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # some maps have no FREE cell
        space = build_random(rng, outside, dim, rotations)
    for _ in range(8):
        q = draw_seed(space, rng)
        if q is None:
            continue
        reach = float(space.grid.spacing * rng.choice([0.3, 1.0, 3.7, 40.0]))
        options = {}
        if rotations and rng.random() < 0.5:
            options["yaw_width"] = float(rng.choice([0.01, 1.0, 7.0]))
        try:
            region = space.free_region(q, reach=reach, **options)
        except ConfigurationError:
            assert not touches_only_free(space, q)
            continue
        except InputError as error:
            assert error.argument == "yaw_width"
            continue
        assert region.contains(tuple(q)) and touches_only_free(space, q)
        low, high = (corner[:dim] for corner in region.bounds)
        assert (low >= q[:dim] - reach - 1e-6).all() and (high <= q[:dim] + reach + 1e-6).all()
        check_proof(space, region)


def sample_region(region, rng, count):
    """Draw configurations of a region, some of them near its corners; yaws are wrapped."""
    vertices = region.vertices
    weights = rng.dirichlet(np.full(len(vertices), 0.3), count)
    q = weights @ vertices
    q += 1e-9 * (region.center - q)
    assert region.contains(q).mean() > 0.99
    if region.axes[-1] == "yaw":
        q[:, -1] = (q[:, -1] + np.pi) % (2.0 * np.pi) - np.pi
    return q[region.contains(q)]


ROBOT = shapely.Polygon([(-0.3, -0.2), (0.5, -0.2), (0.2, 0.3)])


def build_yard(rotations, size=60, seed=3):
    """Build a map of a robot without symmetry among boxes."""
    rng = np.random.default_rng(seed)
    occupied = np.zeros((size, size), dtype=bool)
    for i, j in rng.integers(0, size - 6, (12, 2)):
        occupied[i : i + rng.integers(1, 6), j : j + rng.integers(1, 6)] = True
    workspace = Workspace.from_array(occupied, 0.1)
    return cspace.build(workspace, Robot.polygon(ROBOT), rotations=rotations)


@pytest.mark.parametrize(
    "regions, samples", [(10, 300), pytest.param(100, 10_000, marks=pytest.mark.thorough)]
)
def test_robots_in_a_region_and_motions_there_are_free(regions, samples):
    space = build_yard(24)
    rng = np.random.default_rng(0)
    for k, q in enumerate(space.sample_free(regions, rng=rng)):
        region = space.free_region(q, reach=2.0, yaw_width=(None, 1e-6)[k % 2])
        drawn = sample_region(region, rng, samples)
        assert not collides(space, drawn).any()
        # Motions turn the shorter way, which leaves an arc wider than half a turn.
        yaws = region.unwrap(drawn)[:, 2]
        stays = np.abs(np.diff(yaws)) < math.pi
        assert space.motion_is_free(drawn[:-1], drawn[1:])[stays].all()


def test_a_region_of_joints_is_free_and_stays_within_their_range():
    from tests.helpers.urdfs import CONTINUOUS, POSTS, build_plane_arm, planar_arm_meets

    space = build_plane_arm(**CONTINUOUS)
    joint_map = cspace.build_joint_map(space, 0.1)
    rng = np.random.default_rng(1)
    for q in joint_map.sample_free(10, rng=rng):
        region = joint_map.free_region(q, reach=1.0)
        drawn = sample_region(region, rng, 200)
        assert not planar_arm_meets(drawn, POSTS).any()
        assert joint_map.motion_is_free(drawn[:-1], drawn[1:]).all()
        with suppress(ConfigurationError):
            region = joint_map.free_region(q, reach=0.4, margin=0.25)
            assert measure_gap(joint_map, region, 0.25) >= 0.25 - 1e-9
    # A continuous joint goes on beyond the ends of the map, a region does not.
    seam = joint_map.nearest_free((np.pi, 0.0))
    low, high = joint_map.free_region(seam, reach=1.0).bounds
    assert low[0] > joint_map.grid.lower[0] and high[0] < joint_map.grid.upper[0]


# ---- how large regions are -----------------------------------------------------------------------


def test_a_region_fills_an_empty_room():
    space = build_empty((40, 30), Robot.disc(0.15))
    region = space.free_region((1.0, 1.0))
    free = 0.1**2 * space.count()[0]
    assert region.volume == pytest.approx(free, rel=1e-6)
    np.testing.assert_allclose(region.bounds, [(0.2, 0.2), (3.8, 2.8)], atol=1e-6)
    np.testing.assert_allclose(region.center, (2.0, 1.5), atol=1e-6)
    assert space.free_region((1.0, 1.0), reach=0.5).volume == pytest.approx(1.0, rel=1e-6)


def test_a_region_reaches_beyond_the_grid_of_an_open_map():
    workspace = Workspace.from_array(np.eye(3, dtype=bool), 0.5)
    space = cspace.build(workspace, Robot.disc(0.1), outside="free")
    region = space.free_region((0.7, 2.2), reach=20.0)
    low, high = region.bounds
    assert high[1] > 20.0 and low[0] < -15.0
    check_proof(space, region)
    assert space.free_region((900.0, 2.0), reach=20.0).volume == pytest.approx(1600.0)


def test_volumes_are_at_least_those_of_the_largest_box():
    """The largest free rectangle around a cell is convex, so a region is nearly as large."""
    space = build_yard(None)
    free = space.cell_states == FREE
    shares = []
    for q in space.sample_free(25, rng=np.random.default_rng(5)):
        i, j = space.grid.cell_of(q)
        largest = 0
        for i0, i1 in product(range(max(i - 20, 0), i + 1), range(i + 1, min(i + 21, 60) + 1)):
            rows = free[i0:i1].all(axis=0)
            if not rows[j]:
                continue
            taken = np.flatnonzero(~rows)
            low = max(taken[taken < j].max(initial=-1) + 1, j - 20)
            high = min(taken[taken > j].min(initial=60), j + 21)
            largest = max(largest, (i1 - i0) * (high - low))
        shares.append(space.free_region(q, reach=2.05).volume / (0.01 * largest))
    assert np.median(shares) > 1.0


def test_turning_the_world_turns_the_region():
    rng = np.random.default_rng(2)
    occupied = rng.random((40, 40)) < 0.02
    turned = np.rot90(occupied)  # cell (i, j) moves to (39 - j, i)
    spaces = [
        cspace.build(Workspace.from_array(cells, 0.1), Robot.disc(0.15))
        for cells in (occupied, turned)
    ]
    for x, y in spaces[0].sample_free(10, rng=rng):
        first = spaces[0].free_region((x, y), reach=1.5)
        second = spaces[1].free_region((4.0 - y, x), reach=1.5)
        assert second.volume == pytest.approx(first.volume, rel=1e-6)
        corners = first.vertices
        images = np.column_stack([4.0 - corners[:, 1], corners[:, 0]])
        distances = np.linalg.norm(images[:, np.newaxis] - second.vertices, axis=2)
        assert distances.min(axis=1).max() < 1e-6


def measure_gap(space, region, margin):
    """Return the distance of a region's positions from cells that are not FREE, at most a few cells.

    By shapely in the plane; in space, that of its corners and many points between them.
    """
    grid = space.grid
    dim = grid.dim
    around = 2 + math.ceil(margin / grid.spacing)
    gaps = [math.inf]
    vertices = region.vertices[:, :dim]
    for rotation in list_rotations(space, region):
        centers = grid.center_of(list_taken(space, region, rotation, around))
        if not len(centers):
            continue
        if dim == 2:
            half = 0.5 * grid.spacing
            taken = shapely.box(*(centers - half).T, *(centers + half).T)
            hull = shapely.MultiPoint(vertices).convex_hull
            gaps.append(shapely.distance(hull, taken).min())
            continue
        weights = np.random.default_rng(0).dirichlet(np.full(len(vertices), 0.2), 300)
        points = np.vstack([vertices, weights @ vertices])
        steps = np.abs(points[:, np.newaxis] - centers) - 0.5 * grid.spacing
        gaps.append(np.linalg.norm(np.maximum(steps, 0.0), axis=2).min())
    return min(gaps)


@examples(60)
@given(seeds, exteriors, st.sampled_from([(2, None), (3, None), (2, 5), (3, 3)]))
def test_a_region_keeps_its_margin_also_where_its_box_ends(seed, outside, kind):
    rng = np.random.default_rng(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # some maps have no FREE cell
        space = build_random(rng, outside, *kind)
    spacing = space.grid.spacing
    for _ in range(6):
        q = draw_seed(space, rng)
        if q is None:
            continue
        margin = float(spacing * rng.choice([0.1, 0.5, 1.3, 3.0]))
        reach = float(spacing * rng.choice([0.3, 1.0, 3.7]))
        try:
            region = space.free_region(q, reach=reach, margin=margin)
        except ConfigurationError:
            assert space.clearance(q) < margin + spacing * (math.sqrt(space.dim) + 1e-6)
            continue
        assert region.contains(q) and measure_gap(space, region, margin) >= margin - 1e-9


# ---- yaws ----------------------------------------------------------------------------------------


def test_yaws_are_wrapped_around_the_center():
    space = build_yard(24)
    q = (*space.nearest_free((3.0, 3.0, math.pi))[:2], -math.pi)
    region = space.free_region(q, yaw_width=0.4)
    assert region.contains([(*q[:2], yaw) for yaw in (3.0, -3.0, 3.3, 2.9, 0.0)]).tolist() == [
        *(True, True, True, False, False)
    ]
    low, high = region.bounds
    assert high[2] - low[2] == pytest.approx(0.4) and region.center[2] == pytest.approx(-math.pi)
    assert region.unwrap((0.0, 0.0, 3.0))[2] == pytest.approx(3.0 - math.tau)
    assert region.volume == pytest.approx(
        0.4 * shapely.MultiPoint(region.vertices[:, :2]).convex_hull.area
    )


def test_the_widest_arc_keeps_half_of_the_positions():
    space = build_yard(36)
    widths = []
    for q in space.sample_free(20, rng=np.random.default_rng(6)):
        narrow = space.free_region(q, reach=2.0, yaw_width=1e-3)
        wide = space.free_region(q, reach=2.0)
        width = wide.b[-2] + wide.b[-1]
        widths.append(width)
        assert wide.volume / width >= 0.499 * narrow.volume / 1e-3
    assert min(widths) >= math.tau / 36 - 1e-8 and max(widths) > 1.0


def test_a_round_robot_is_free_at_all_yaws():
    workspace = Workspace.from_array(np.eye(30, dtype=bool), 0.1)
    space = cspace.build(workspace, Robot.disc(0.2), rotations=8)
    region = space.free_region((0.5, 2.0, 1.0))
    yaws = np.linspace(-math.pi, math.pi, 100)
    assert region.contains([(0.5, 2.0, yaw) for yaw in yaws]).all()
    with pytest.warns(AngleWarning):
        assert region.contains((0.5, 2.0, 500.0))


def test_degrees_are_noticed_but_not_whole_turns_of_a_path():
    space = build_empty((30, 30), Robot.disc(0.2), rotations=8)
    region = space.free_region((1.0, 1.0, 1.5), yaw_width=0.6)
    for ask in (region.contains, region.unwrap):
        for q in ((1.0, 1.0, 90.0), [(1.0, 1.0, 0.0), (1.0, 1.0, 90.0)]):
            with pytest.warns(AngleWarning, match="yaw is beyond a whole turn"):
                ask(q)
        assert ask([(1.0, 1.0, 1.5), (1.0, 1.0, 1.5 - math.tau)]).all()
    via = [(1.0, 1.0, yaw) for yaw in (-2.5, -0.5, 1.5, 2.9)]
    turning = planners.plan(space, (1.0, 1.0, 2.5), (1.0, 1.0, -2.0), via=via).corridor()
    assert abs(turning.path[-1, 2]) > math.tau
    assert turning.regions[-1].contains(turning.path[-1])


# ---- the record ----------------------------------------------------------------------------------


def test_a_region_is_described_and_read_only():
    space = build_yard(None)
    region = space.free_region(space.nearest_free((3.0, 3.0)))
    assert isinstance(region, ConvexRegion) and region.axes == ("x", "y")
    assert repr(region).startswith(
        "ConvexRegion(center=("
    ) and f"half_spaces={len(region.b)}" in repr(region)
    np.testing.assert_allclose(np.linalg.norm(region.A, axis=1), 1.0)
    with pytest.raises(ValueError):
        region.b[0] = 1.0
    with pytest.raises(ValueError):
        region.A[0] = 1.0
    hull = shapely.MultiPoint(region.vertices).convex_hull
    assert region.volume == pytest.approx(hull.area)
    np.testing.assert_allclose(region.center, hull.centroid.coords[0])


def test_regions_are_drawn_over_a_map():
    space = build_yard(None)
    region = space.free_region(space.nearest_free((3.0, 3.0)))
    axes = space.plot()
    before = len(axes.collections)
    assert region.plot(axes, facecolor="red") is axes
    assert len(axes.collections) == before + 1
    solid = build_empty((9, 9, 9), Robot.ball(0.1)).free_region((0.4, 0.4, 0.4))
    drawn = solid.plot()
    assert drawn.name == "3d" and len(drawn.collections) == 1
    with pytest.raises(InputError, match=r"ax has the projection 'rectilinear' and the.*'3d'"):
        solid.plot(axes)


# ---- refusals ------------------------------------------------------------------------------------


@refusals(
    "options, message",
    ({"reach": 0.0}, "reach is 0.0; it must be one number above zero"),
    ({"margin": -1.0}, "margin is -1.0; it must be one number, zero or above"),
    ({"yaw_width": 0.1}, "only a yaw has a width"),
    ({"q": (math.nan, 1.0)}, "q[0] is nan; it must be finite"),
    ({"q": [(1.0, 1.0)]}, "q has shape (1, 2)"),
    ({"q": (3.05, 3.05)}, "lies in a BLOCKED cell"),
    ({"q": (2.75, 3.05)}, "lies in a MIXED cell"),
    ({"q": (3.4, 3.05)}, "is FREE but lies on the border of a cell that is not"),
    ({"q": (0.45, 3.0), "margin": 0.5}, "lies within the margin of 0.5"),
)
def test_arguments_are_refused(options, message):
    occupied = np.zeros((60, 60), dtype=bool)
    occupied[30, 30] = True
    space = cspace.build(Workspace.from_array(occupied, 0.1), Robot.disc(0.25))
    with pytest.raises(InputError) as caught:
        space.free_region(**{"q": (1.0, 1.0)} | options)
    assert message in str(caught.value)


def test_an_arc_at_which_the_robot_is_not_free_is_refused():
    occupied = np.zeros((60, 60), dtype=bool)
    occupied[30, 30] = True
    workspace = Workspace.from_array(occupied, 0.1)
    turning = cspace.build(workspace, Robot.rectangle(1.0, 0.2), rotations=36)
    q = (3.05, 3.4, 0.0)
    check_refused(
        lambda: turning.free_region(q, yaw_width=3.0),
        "yaw_width is 3 and the robot is not FREE at (3.05, 3.4, 0) ... region",
    )


def test_other_spaces_are_refused(tmp_path):
    rotations = cspace.Rotations.quaternions(1)
    tilting = build_empty((9, 9, 9), Robot.box((0.2, 0.1, 0.1)), rotations=rotations)
    check_refused(
        lambda: tilting.free_region((0.4, 0.4, 0.4, 0, 0, 0, 1)),
        "space has the axes (x, y, z, qx, qy, qz, qw) ... consist",
    )
    tiled = build_empty((90, 90), Robot.disc(0.2), store=tmp_path / "tiles.zarr")
    check_refused(
        lambda: tiled.free_region((2.0, 2.0)),
        "space is TiledCSpace(90 x 90 cells of 0.1 m, disc 0.2 m: 1 ... map in memory",
    )


def test_the_exact_map_grows_regions_of_whole_cells_alone():
    space = build_slit()
    only_exact = draw_only_exact(space)
    exact = pickle.loads(pickle.dumps(space.exact))
    for view, row in product((space.exact, exact), only_exact[:20]):
        with pytest.raises(InputError, match="lies in a MIXED cell"):
            view.free_region(row)
        with pytest.raises(InputError, match="FREE"):
            view.free_regions(around=row)


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9, 1e160, 1e300])
def test_a_region_of_half_spaces_is_measured_in_any_unit(unit):
    normals = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    box = ConvexRegion(normals, unit * np.array([3.0, -2.0, 1.0, 1.0]), ("x", "y"))
    assert np.array(box.bounds) / unit == pytest.approx(np.array([[2.0, -1.0], [3.0, 1.0]]))
    assert box.volume == pytest.approx(2.0 * unit * unit)
    empty = ConvexRegion(normals, unit * np.array([1.0, -2.0, 1.0, 1.0]), ("x", "y"))
    assert empty.volume == 0.0 and np.isfinite(empty.bounds).all()
