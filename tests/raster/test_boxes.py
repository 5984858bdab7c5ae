"""Rasters of balls, boxes and voxels, against exact rational arithmetic."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from cspace import Grid, InputError
from cspace.grid import SLACK
from cspace.raster.bitmaps import cover_with_boxes
from cspace.raster.boxes import RoundedBoxes, rounded_rasters
from cspace.shapes import Balls, Box, Voxels
from tests.helpers.strategies import seeds

UNIT = 2**120
"""Metres are counted in whole numbers of 1 / UNIT, which holds every float used here exactly."""

EDGE = 4 * SLACK
"""How far, in cells, a raster may stray from its definition."""

SPACINGS = [0.25, 0.1, 1.0, 0.37]
MARGINS = [0.0, 0.125, 0.3]


def to_integers(values):
    """Convert floats to integers in units of the oracles."""
    array = np.asarray(values, dtype=float)
    scaled = [Fraction(float(value)) * UNIT for value in array.flat]
    assert all(value.denominator == 1 for value in scaled)
    return np.array([value.numerator for value in scaled], dtype=object).reshape(array.shape)


def compute_cube_sides(count, first, lower, spacing, b):
    """Return the end ``b`` of each cube, as integers."""
    return to_integers(lower) + to_integers(spacing) * (np.arange(count).astype(object) + first + b)


def sum_outer(parts):
    """Sum parts (boxes, n) over axes to (boxes, *shape)."""
    total = 0
    for axis, part in enumerate(parts):
        total = total + part.reshape(
            len(part), *(-1 if a == axis else 1 for a in range(len(parts)))
        )
    return total


class Definition:
    """Rounded boxes and cubes, in integers.

    Cubes are ``lower + spacing * (i + first + [b0, b1]^d)``.
    """

    def __init__(self, lows, highs, radii, shape, lower, spacing, b0, b1, first=0):
        self.lows, self.highs, self.radii = to_integers(lows), to_integers(highs), radii
        self.edge = to_integers(EDGE * spacing)
        dims = range(len(shape))
        self.sides = [
            [compute_cube_sides(shape[a], first, lower[a], spacing, b) for b in (b0, b1)]
            for a in dims
        ]

    def squares(self, low, high):
        """Return squared distances of boxes along each axis."""
        gaps = [
            np.maximum(
                np.maximum(self.lows[:, a, None] - high[a], low[a] - self.highs[:, a, None]), 0
            )
            for a in range(len(low))
        ]
        return [gap**2 for gap in gaps]

    def within(self, squares, extra):
        """Return True for points in a grown box."""
        reach = (self.radii + extra * self.edge).reshape(-1, *(1 for _ in self.sides))
        return ((reach >= 0) & (squares <= reach**2)).any(axis=0).astype(bool)

    def touched(self, extra):
        first, last = zip(*self.sides, strict=True)
        return self.within(sum_outer(self.squares(first, last)), extra)

    def inside(self, extra):
        """Return True if all corners lie in one box."""
        first, last = (self.squares(ends, ends) for ends in zip(*self.sides, strict=True))
        farthest = [np.maximum(a, b) for a, b in zip(first, last, strict=True)]
        return self.within(sum_outer(farthest), -extra)

    def covered(self):
        """Return True if disjoint boxes contain the cubes."""
        parts = [
            np.minimum(self.highs[:, a, None], side + self.edge)
            - np.maximum(self.lows[:, a, None], side - self.edge)
            for a, (side, _) in enumerate(self.sides)
        ]
        parts = [np.maximum(part, 0) for part in parts]
        volume = (
            parts[0][:, :, None, None] * parts[1][:, None, :, None] * parts[2][:, None, None, :]
        )
        return (volume.sum(axis=0) == (2 * self.edge) ** 3).astype(bool)


def check(cells, least, most):
    """Fail unless a raster has the required cubes only."""
    assert cells[least].all(), f"missing {np.argwhere(least & ~cells)[:3]}"
    assert most[cells].all(), f"too many {np.argwhere(cells & ~most)[:3]}"


def spread(raster, reach):
    """Expand a raster to the offsets from ``-reach`` to ``reach``."""
    out = np.zeros((2 * reach + 1,) * 3, dtype=bool)
    if raster.cells.size:
        assert min(raster.lower) >= -reach
        assert max(raster.upper) <= reach
        out[
            tuple(
                slice(a + reach, b + reach + 1)
                for a, b in zip(raster.lower, raster.upper, strict=True)
            )
        ] = raster.cells
    return out


@st.composite
def coordinates(draw, spacing, shape, reach):
    """Draw coordinates, some at multiples of half cells."""
    count = int(np.prod(shape))
    whole = st.integers(-int(2 * reach), int(2 * reach)).map(lambda n: n * spacing / 2)
    other = st.floats(-reach * spacing, reach * spacing).map(lambda x: round(x, 9))
    return np.array(draw(st.lists(whole | other, min_size=count, max_size=count))).reshape(shape)


@settings(max_examples=40)
@given(st.data(), st.sampled_from([2, 3]), st.sampled_from(SPACINGS))
def test_balls_cover_the_cells_within_their_radius(data, dim, spacing):
    count = data.draw(st.integers(1, 3))
    lower = data.draw(coordinates(spacing, (dim,), 2))
    centers = data.draw(coordinates(spacing, (count, dim), 4))
    radii = np.abs(data.draw(coordinates(spacing, (count,), 2)))
    grid = Grid(lower, spacing, (5, 4, 3)[:dim])
    outer, inner = Balls(centers, radii).cells(grid)
    truth = Definition(centers, centers, to_integers(radii), grid.shape, lower, spacing, 0, 1)
    check(outer, truth.touched(0), truth.touched(1))
    check(inner, truth.inside(1), truth.inside(0))


@settings(max_examples=20)
@given(st.data(), st.sampled_from(SPACINGS), st.sampled_from(MARGINS))
def test_rasters_of_ball_robots_agree_with_arithmetic(data, spacing, margin):
    count = data.draw(st.integers(1, 2))
    centers = data.draw(coordinates(spacing, (count, 3), 1))
    radii = np.abs(data.draw(coordinates(spacing, (count,), 2))) + spacing / 8
    outer, inner = Balls(centers, radii).rasters(spacing, margin)
    check_robot(centers, centers, radii, spacing, margin, outer, inner, 4)


@settings(max_examples=20)
@given(st.data(), st.sampled_from(SPACINGS), st.sampled_from(MARGINS))
def test_rasters_of_box_robots_agree_with_arithmetic(data, spacing, margin):
    corners = np.sort(data.draw(coordinates(spacing, (2, 3), 2)), axis=0)
    box = RoundedBoxes(corners[:1], corners[1:], np.zeros(1))
    outer, inner = rounded_rasters(box, spacing, np.full(1, margin), np.zeros(1))
    check_robot(corners[:1], corners[1:], np.zeros(1), spacing, margin, outer, inner, 3)


def check_robot(lows, highs, radii, spacing, margin, outer, inner, reach):
    """Check the rasters of rounded boxes.

    A lattice point deep in one box is inside.
    """
    reach += 1 + int(margin / spacing)
    frame = ((2 * reach + 1,) * 3, (0.0,) * 3, spacing)
    truth = Definition(lows, highs, to_integers(radii) + to_integers(margin), *frame, -1, 1, -reach)
    check(spread(outer, reach), truth.touched(0), truth.touched(1))
    truth = Definition(lows, highs, to_integers(radii), *frame, 0, 0, -reach)
    cells = spread(inner, reach)
    if radii.any():
        check(cells, truth.inside(1), truth.inside(0))
    else:
        check(cells, truth.covered(), truth.inside(0))


@settings(max_examples=15)
@given(
    st.data(),
    seeds,
    st.sampled_from(SPACINGS),
    st.sampled_from(MARGINS),
    st.sampled_from([1.0, 0.5, 0.4, 0.25, 2.0, 1.37]),
    st.sampled_from([0.3, 0.7, 1.0]),
    st.sampled_from([0.0, 2e-3, -2e-3, 1e-7, -1e-7]),
)
def test_rasters_of_voxel_robots_agree_with_arithmetic(
    data, seed, spacing, margin, ratio, density, shift
):
    occupied = np.random.default_rng(seed).random((3, 2, 4)) < density
    occupied[-1, -1, -1] = True
    lower = data.draw(coordinates(spacing, (3,), 1.5)) + shift * spacing
    voxel = spacing * ratio
    outer, inner = Voxels(occupied, voxel, lower).rasters(spacing, margin)
    # Integers represent the voxels' corners exactly, floats do not.
    reach = 4 + int(4 * ratio) + int(margin / spacing)
    frame = ((2 * reach + 1,) * 3, (0.0,) * 3, spacing)
    cells = np.argwhere(occupied).astype(object)
    lows, highs = (to_integers(lower) + to_integers(voxel) * (cells + b) for b in (0, 1))
    truth = Definition([], [], np.array([to_integers(margin)] * len(cells)), *frame, -1, 1, -reach)
    truth.lows, truth.highs = lows, highs
    check(spread(outer, reach), truth.touched(0), truth.touched(1))
    truth = Definition([], [], np.array([0] * len(cells), dtype=object), *frame, 0, 0, -reach)
    truth.lows, truth.highs = lows, highs
    check(spread(inner, reach), truth.covered(), truth.inside(0))


def test_points_on_shared_faces_of_voxels_are_inside():
    _, inner = Voxels.of(np.ones((3, 3, 3), dtype=bool), 0.1, (-0.1, -0.1, -0.1)).rasters(0.1)
    assert inner.lower == (0, 0, 0)
    assert inner.cells.all()
    assert inner.count == 8


def test_a_hole_in_a_voxel_robot_stays_open():
    occupied = np.ones((5, 5, 5), dtype=bool)
    occupied[2, 2, 2] = False
    _, inner = Voxels.of(occupied, 0.4, (-1.0, -1.0, -1.0)).rasters(0.1)
    filled = spread(inner, 10)[10 - 9 : 10 + 10, 10 - 9 : 10 + 10, 10 - 9 : 10 + 10]
    expected = np.ones((19, 19, 19), dtype=bool)
    expected[7:12, 7:12, 7:12] = False
    assert (filled == expected).all()


@settings(max_examples=30)
@given(seeds, st.sampled_from([0.1, 0.5, 0.9]), st.sampled_from([2, 3]))
def test_boxes_of_cells_are_disjoint_and_cover_the_set(seed, density, dim):
    rng = np.random.default_rng(seed)
    occupied = rng.random(tuple(rng.integers(1, 9, dim))) < density
    counts = np.zeros(occupied.shape, dtype=int)
    for low, high in zip(*cover_with_boxes(occupied, 1.0, (0.0,) * dim), strict=True):
        counts[tuple(slice(int(a), int(b)) for a, b in zip(low, high, strict=True))] += 1
    assert (counts == occupied).all()


@settings(max_examples=30)
@given(seeds, st.sampled_from([0.5, 1.0, 1.3, 2.0]), st.sampled_from([2, 3]))
def test_bitmap_obstacles_set_the_cells_that_they_touch_and_fill(seed, ratio, dim):
    """Compare on a lattice of quarters.

    Cells at the bitmap's boundary may be inner or not.
    """
    rng = np.random.default_rng(seed)
    occupied = rng.random((4, 3, 4)[:dim]) < 0.6
    occupied[(0,) * dim] = True
    lower = rng.integers(-8, 9, dim) / 8.0
    outer, inner = Voxels(occupied, ratio, lower).cells(Grid((-2.0,) * dim, 1.0, (7, 6, 8)[:dim]))
    for cell in np.ndindex(outer.shape):
        low = np.array(cell) - 2.0 - lower
        spans = [(np.ceil(a / ratio - 1 - 1e-9), np.floor((a + 1) / ratio + 1e-9) + 1) for a in low]
        touched = [slice(max(0, int(first)), max(0, int(stop))) for first, stop in spans]
        assert outer[cell] == occupied[tuple(touched)].any()
        over = [
            range(int(np.floor(a / ratio - 1e-9)), int(np.floor((a + 1) / ratio + 1e-9)) + 1)
            for a in low
        ]
        held = all(
            all(0 <= i < n for i, n in zip(index, occupied.shape, strict=True)) and occupied[index]
            for index in product(*over)
        )
        assert inner[cell] == held


@pytest.mark.parametrize("dim", [2, 3])
def test_a_point_on_boundaries_is_in_every_cell_that_shares_them(dim):
    grid = Grid((0.0,) * dim, 0.5, (4,) * dim)
    outer, inner = Balls(np.full((1, dim), 1.0), np.zeros(1)).cells(grid)
    assert sorted(map(tuple, np.argwhere(outer))) == list(product((1, 2), repeat=dim))
    assert not inner.any()


@pytest.mark.parametrize("dim", [2, 3])
def test_balls_within_the_slack_of_a_boundary_are_decided_safely(dim):
    grid = Grid((0.0,) * dim, 1.0, (6,) * dim)
    for offset, met in ((0.0, True), (SLACK / 2, True), (8 * SLACK, False)):
        center = np.full((1, dim), 2.5)
        center[0, 0] = 3.0 + 0.5 + offset
        outer, _ = Balls(center, np.array([0.5])).cells(grid)
        assert outer[(2, *(2,) * (dim - 1))] == met
    for offset, inside in ((0.0, False), (8 * SLACK, True)):
        _, inner = Balls(np.full((1, dim), 2.5), np.array([np.sqrt(dim) / 2 + offset])).cells(grid)
        assert inner.sum() == inside


def test_random_points_are_in_one_cell_each():
    rng = np.random.default_rng(7)
    grid = Grid((-1.0, 2.0, 0.5), 0.13, (40, 30, 50))
    points = rng.uniform((-2.0, 1.0, 0.0), (5.0, 7.0, 8.0), (60_000, 3))
    outer, inner = Balls(points, np.zeros(len(points))).cells(grid)
    cells = np.floor((points - grid.lower) / grid.spacing).astype(int)
    cells = cells[((cells >= 0) & (cells < grid.shape)).all(axis=1)]
    expected = np.zeros(grid.shape, dtype=bool)
    expected[tuple(cells.T)] = True
    assert (outer == expected).all()
    assert not inner.any()


@pytest.mark.parametrize("radius", [0.05, 0.3, 0.8])
def test_balls_of_a_cloud_agree_with_a_tree(radius):
    rng = np.random.default_rng(8)
    grid = Grid((0.0, 0.0, 0.0), 0.1, (40, 30, 50))
    points = rng.uniform(0.0, 5.0, (3000, 3))
    outer, inner = Balls(points, np.full(len(points), radius)).cells(grid)
    middles = np.stack(
        np.meshgrid(*(grid.centers(axis) for axis in range(3)), indexing="ij"), axis=-1
    )
    distance, _ = cKDTree(points).query(middles)
    corner = grid.spacing * np.sqrt(3) / 2
    assert outer[distance <= radius].all()
    assert (distance[outer] <= radius + corner + 1e-9).all()
    assert inner[distance <= radius - corner - 1e-6].all()
    assert (distance[inner] <= radius - grid.spacing / 2).all()


def test_rasters_of_unions_do_not_depend_on_the_number_of_threads():
    rng = np.random.default_rng(9)
    grid = Grid((0.0, 0.0, 0.0), 0.1, (60, 20, 30))
    centers, radii = rng.uniform(-1.0, 7.0, (800, 3)), rng.uniform(0.0, 1.2, 800)
    outer, inner = Balls(centers, radii).cells(grid)
    parts = [Balls(centers[n : n + 1], radii[n : n + 1]).cells(grid) for n in range(len(radii))]
    assert (outer == np.logical_or.reduce([part[0] for part in parts])).all()
    assert (inner == np.logical_or.reduce([part[1] for part in parts])).all()
    assert inner.any()


@given(st.integers(0, 5), st.integers(0, 5), st.integers(0, 5))
@example(0, 0, 0)
@settings(max_examples=5)
def test_a_disc_is_a_section_of_a_ball(x, y, radius):
    plane, space = Grid((0.0, 0.0), 0.5, (7, 6)), Grid((0.0, 0.0, 0.0), 0.5, (7, 6, 1))
    center, size = np.array([[x / 2, y / 2]]), np.array([radius / 4])
    flat, _ = Balls(center, size).cells(plane)
    solid, _ = Balls(np.hstack([center, [[0.25]]]), size).cells(space)
    assert (flat == solid[:, :, 0]).all()


@pytest.mark.parametrize(("center", "radius"), [(1e9, 0.1), (0.0, 1e9), (-3e6, 2e6)])
def test_balls_too_far_for_the_slack_are_refused(center, radius):
    grid = Grid((0.0, 0.0, 0.0), 1.0, (4, 4, 4))
    with pytest.raises(InputError, match="cells from the map's corner"):
        Balls(np.array([[0.0, 0.0, center]]), np.array([radius])).cells(grid)


def test_large_coordinates_stay_exact():
    grid = Grid((2.0**21, -(2.0**21), 0.0), 1.0, (6, 6, 6))
    centers = np.array([[2.0**21 - 2.0**20 + 2.5, -(2.0**21) + 2.5, 2.5]])
    radius = np.array([2.0**20])
    outer, inner = Balls(centers, radius).cells(grid)
    truth = Definition(centers, centers, to_integers(radius), grid.shape, grid.lower, 1.0, 0, 1)
    check(outer, truth.touched(0), truth.touched(1))
    check(inner, truth.inside(1), truth.inside(0))
    assert 0 < inner.sum() < outer.sum() < outer.size


def test_a_robot_of_too_many_cells_is_refused():
    with pytest.raises(InputError, match="larger spacing"):
        Box.of((2.0, 2.0, 2.0)).rasters(1e-3)
