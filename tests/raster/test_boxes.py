"""Rasters of balls, boxes and voxels, against exact rational arithmetic."""

from fractions import Fraction

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cspace import Grid, InputError, make_mesh
from cspace._grid import SLACK
from cspace._raster.rounded_boxes import RoundedBoxes, rounded_rasters
from cspace._rotations import RotationCell
from cspace._shapes import Balls, Box, Polygons, Voxels
from tests.helpers.mesh_files import make_box
from tests.helpers.strategies import examples, seeds

UNIT = 2**120
"""Metres are counted in whole numbers of 1 / UNIT, which holds every float used here exactly."""

EDGE = 4 * SLACK
"""How far, in cells, a raster may stray from its definition."""

SPACINGS = [0.25, 0.1, 1.0, 0.37]
MARGINS = [0.0, 0.125, 0.3]
GRID = Grid((0.0, 0.0, 0.0), 1.0, (4, 4, 4))
SMALL_BOX = make_box((0, 0, 0), (1, 1, 1))
FAR_MESH = make_mesh(make_box((0, 0, 0), (1, 1, 1e7)))


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
        self.lows, self.highs, self.radii = lows, highs, radii
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

    def covered(self, extra):
        """Return True if disjoint boxes contain the cubes."""
        whole, volume = 1, 1
        for a, (first, last) in enumerate(self.sides):
            first, last = first - extra * self.edge, last + extra * self.edge
            part = np.minimum(self.highs[:, a, None], last) - np.maximum(
                self.lows[:, a, None], first
            )
            shape = [-1 if a == axis else 1 for axis in range(len(self.sides))]
            whole = whole * (last - first).reshape(shape)
            volume = volume * np.maximum(part, 0).reshape(len(part), *shape)
        return (volume.sum(axis=0) == whole).astype(bool)


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


@examples(40)
@given(
    st.data(), st.sampled_from([2, 3]), st.sampled_from(SPACINGS), st.sampled_from([0.0, 2.0**20])
)
def test_balls_cover_the_cells_within_their_radius(data, dim, spacing, far):
    """Include balls, far away, that are nearly half-spaces."""
    count = data.draw(st.integers(1, 3))
    lower = data.draw(coordinates(spacing, (dim,), 2))
    centers = data.draw(coordinates(spacing, (count, dim), 4))
    radii = np.abs(data.draw(coordinates(spacing, (count,), 2)))
    centers[0, 0] -= far * spacing
    radii[0] += far * spacing
    grid = Grid(lower, spacing, (5, 4, 3)[:dim])
    outer, inner = Balls(centers, radii).cells(grid)
    centers = to_integers(centers)
    truth = Definition(centers, centers, to_integers(radii), grid.shape, lower, spacing, 0, 1)
    check(outer, truth.touched(0), truth.touched(1))
    check(inner, truth.inside(1), truth.inside(0))


@examples(30)
@given(st.data(), st.sampled_from(SPACINGS), st.sampled_from(MARGINS), st.booleans())
def test_rasters_of_rounded_boxes_agree_with_arithmetic(data, spacing, margin, is_round):
    count = data.draw(st.integers(1, 2))
    corners = np.sort(data.draw(coordinates(spacing, (2, count, 3), 2)), axis=0)
    radii = np.abs(data.draw(coordinates(spacing, (count,), 1))) * is_round
    boxes = RoundedBoxes(*corners, radii)
    outer, inner = rounded_rasters(boxes, spacing, np.full(count, margin), np.zeros(count))
    reach = 5 + int(margin / spacing)
    frame = ((2 * reach + 1,) * 3, (0.0,) * 3, spacing)
    corners, radii = to_integers(corners), to_integers(radii)
    truth = Definition(*corners, radii + to_integers(margin), *frame, -1, 1, -reach)
    check(spread(outer, reach), truth.touched(0), truth.touched(1))
    truth = Definition(*corners, radii, *frame, 0, 0, -reach)
    check(spread(inner, reach), truth.inside(1), truth.inside(0))


@examples(15)
@given(
    st.data(),
    seeds,
    st.sampled_from(SPACINGS),
    st.sampled_from(MARGINS),
    st.sampled_from([1.0, 0.5, 0.4, 0.25, 2.0, 1.37]),
    st.sampled_from([0.3, 0.7, 1.0]),
    st.sampled_from([0.0, 2e-3, -2e-3, 1e-7, -1e-7]),
)
def test_voxels_agree_with_arithmetic(data, seed, spacing, margin, ratio, density, shift):
    occupied = np.random.default_rng(seed).random((3, 2, 4)) < density
    occupied[-1, -1, -1] = True
    lower = data.draw(coordinates(spacing, (3,), 1.5)) + shift * spacing
    voxel = spacing * ratio
    voxels = Voxels(occupied, voxel, lower)
    outer, inner = voxels.rasters(spacing, margin)
    # Integers represent the voxels' corners exactly, floats do not.
    reach = 4 + int(4 * ratio) + int(margin / spacing)
    frame = ((2 * reach + 1,) * 3, (0.0,) * 3, spacing)
    cells = np.argwhere(occupied).astype(object)
    lows, highs = (to_integers(lower) + to_integers(voxel) * (cells + b) for b in (0, 1))
    zeros = np.zeros(len(cells), dtype=object)
    truth = Definition(lows, highs, zeros + to_integers(margin), *frame, -1, 1, -reach)
    check(spread(outer, reach), truth.touched(0), truth.touched(1))
    truth = Definition(lows, highs, zeros, *frame, 0, 0, -reach)
    check(spread(inner, reach), truth.covered(1), truth.inside(0))
    grid = Grid((-1.5 * spacing,) * 3, spacing, (7, 6, 8))
    outer, inner = voxels.cells(grid)
    truth = Definition(lows, highs, zeros, grid.shape, grid.lower, spacing, 0, 1)
    check(outer, truth.touched(0), truth.touched(1))
    check(inner, truth.covered(1), truth.covered(0))


def test_slabs_of_threads_join_to_the_whole(monkeypatch):
    """Compare rasters made in one slab and in slabs of three layers."""
    rng = np.random.default_rng(9)
    balls = Balls(rng.uniform(-1.0, 7.0, (40, 3)), rng.uniform(0.0, 1.2, 40))
    surface = make_mesh(trimesh.creation.icosphere(2, 2.5))
    turn = RotationCell(Rotation.from_rotvec([0.3, 0.2, 0.1]).as_matrix(), 0.05)
    grid = Grid((0.0, 0.0, 0.0), 0.2, (30, 20, 10))
    calls = (
        lambda: balls.cells(grid),
        lambda: surface.cells(grid),
        lambda: [raster.cells for raster in surface.rasters(0.5, 0.1, turn)],
    )
    whole = [call() for call in calls]
    monkeypatch.setattr("cspace._raster.MIN_SLABS_PER_THREAD", 3)
    monkeypatch.setattr("cspace._support.threads.count_cores", lambda: 16)
    for expected, call in zip(whole, calls, strict=True):
        for cells, part in zip(expected, call(), strict=True):
            assert cells.any() and (cells == part).all()


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: Balls(np.array([[-3e6, 0, 0]]), np.array([2e6])).cells(GRID), "map's corner"),
        (lambda: Polygons([shapely.box(0, 0, 1e9, 1)]).cells(Grid((0, 0), 1.0, (4, 4))), "corner"),
        (lambda: FAR_MESH.cells(GRID), "map's corner"),
        (lambda: FAR_MESH.rasters(1.0), "its origin"),
        (lambda: Box.of((2.0, 2.0, 2.0)).rasters(1e-3), "cells large at this spacing"),
        (lambda: make_mesh(SMALL_BOX, "fill").cells(Grid((0, 0, 0), 1e-5, (4, 4, 4))), "filled"),
    ],
    ids=["far balls", "far polygon", "far mesh", "far robot", "many cells", "many filled cells"],
)
def test_shapes_too_far_or_too_large_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
