"""Rasters of meshes, against FCL, arithmetic and formulas."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import nnls

from cspace import Grid, MeshWarning, make_mesh
from cspace._raster.triangles import mark_within, sweep_triangles
from cspace._shapes import Box
from tests.helpers.mesh_files import join_meshes, make_box
from tests.helpers.oracles import cross, dot, units
from tests.helpers.strategies import examples, seeds


def make_soup(triangles):
    triangles = np.asarray(triangles, dtype=float).reshape(-1, 3, 3)
    return triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)


def meets(triangle, low, high):
    """Return True if a triangle meets a box.

    Separating axes are exact for integers.
    """
    edges = [
        tuple(b - a for a, b in zip(triangle[i], triangle[(i + 1) % 3], strict=True))
        for i in range(3)
    ]
    units = [(1, 0, 0), (0, 1, 0), (0, 0, 1)]
    axes = [
        *units,
        cross(edges[0], edges[1]),
        *(cross(edge, unit) for edge in edges for unit in units),
    ]
    for axis in axes:
        along = [dot(axis, corner) for corner in triangle]
        first = sum(
            min(a * start, a * stop) for a, start, stop in zip(axis, low, high, strict=True)
        )
        last = sum(max(a * start, a * stop) for a, start, stop in zip(axis, low, high, strict=True))
        if max(along) < first or min(along) > last:
            return False
    return True


def check_touched(marked, triangles, grid, slack=2.0**-24):
    """Fail unless exactly a triangle's cells are marked."""
    (h, more), lower = units((grid.spacing, grid.spacing * slack)), units(grid.lower)
    exact = [[units(corner) for corner in triangle] for triangle in triangles]
    for cell in product(*map(range, grid.shape)):
        low = [a + h * i for a, i in zip(lower, cell, strict=True)]
        high = [a + h for a in low]
        if not marked[cell]:
            assert not any(meets(t, low, high) for t in exact), f"missed {cell}"
        else:
            wide = [a - more for a in low], [b + more for b in high]
            assert any(meets(t, *wide) for t in exact), f"too much: {cell}"


def draw_small_mesh(rng, kind):
    """Draw a few triangles in a small grid."""
    n = int(rng.integers(1, 6))
    triangles = rng.uniform(-1, 6, (n, 3, 3))
    if kind == "lattice" or (kind == "degenerate" and rng.random() < 0.5):
        triangles = np.rint(triangles)
    if kind == "touching":
        triangles[:, :, rng.integers(3)] = rng.integers(0, 6, (n, 1))
    elif kind == "sliver":
        share, bend = rng.uniform(0, 1, (n, 1)), 10.0 ** rng.uniform(-12, -3, (n, 1))
        along = triangles[:, 0] + share * (triangles[:, 1] - triangles[:, 0])
        triangles[:, 2] = along + bend * rng.normal(size=(n, 3))
    elif kind == "degenerate":
        triangles[:, 2] = triangles[:, rng.integers(2)]
        triangles[:, 1] = triangles[:, rng.choice([0, 1, 1])]
    elif kind == "huge":  # through the grid
        far = triangles * 2.0 ** rng.uniform(3, 19)
        triangles = far - far.mean(axis=1, keepdims=True) + rng.uniform(0, 5, (n, 1, 3))
    return triangles


MESH_KINDS = ["random", "sliver", "touching", "lattice", "degenerate", "huge"]


@examples(40)
@given(
    seeds,
    st.sampled_from(MESH_KINDS),
    st.sampled_from([0.0, 2.0**20 + 0.3, -(2.0**21)]),
    st.sampled_from([1.0, 0.1]),
)
def test_touched_cells_agree_with_exact_separating_axes(seed, kind, lower, spacing):
    rng = np.random.default_rng(seed)
    grid = Grid((lower * spacing,) * 3, spacing, (4, 3, 5))
    mesh = make_mesh(make_soup(grid.lower + spacing * draw_small_mesh(rng, kind)), "surface")
    outer, inner = mesh.cells(grid)
    check_touched(outer, mesh.triangles, grid)
    assert not inner.any()


@examples(30)
@given(seeds, st.booleans())
def test_a_box_as_a_mesh_has_the_cells_of_the_box(seed, inward):
    rng = np.random.default_rng(seed)
    grid = Grid((0, 0, 0), 1.0, (9, 8, 7))
    low = rng.integers(-2, 5, 3) + rng.choice([0.25, 0.5, 0.75], 3)
    extents = rng.integers(1, 9, 3) - rng.choice([0.125, 0.625], 3)
    mesh = make_mesh(make_box(low, low + extents, inward))
    expected = Box(extents, low + extents / 2).cells(grid)
    for cells, box_cells in zip(mesh.cells(grid), expected, strict=True):
        np.testing.assert_array_equal(cells, box_cells)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_filling_leaves_a_box_without_a_face_open(axis):
    """Leave out a face at the border of cells, which are touched on both sides of it."""
    vertices, faces = make_box((0.0, 0.0, 0.0), (4.0, 4.0, 4.0))
    is_left_out = (vertices[faces][:, :, axis] == 4.0).all(axis=1)
    grid = Grid((-2, -2, -2), 1.0, (9, 9, 9))
    with pytest.warns(MeshWarning, match="encloses no cell"):
        assert not make_mesh((vertices, faces[~is_left_out]), "fill").cells(grid)[1].any()
    assert make_mesh((vertices, faces), "fill").cells(grid)[1].sum() == 2**3


def test_a_map_that_cuts_through_a_solid_is_part_of_the_larger_map():
    mesh = make_mesh(
        join_meshes(
            make_box((0.3, 0.3, 0.3), (8.6, 7.7, 5.4)),
            make_box((1.5, 1.5, 1.5), (4.5, 4.5, 4.4), inward=True),
        )
    )
    whole = mesh.cells(Grid((0, 0, 0), 0.5, (20, 20, 20)))
    for start, stop in (
        ((2, 2, 2), (9, 20, 20)),
        ((4, 4, 4), (8, 8, 8)),
        ((11, 0, 3), (12, 20, 4)),
        ((10, 4, 4), (14, 8, 8)),  # full
        ((18, 4, 4), (20, 8, 8)),  # empty
    ):
        part = Grid(np.multiply(start, 0.5), 0.5, tuple(np.subtract(stop, start).tolist()))
        window = tuple(slice(a, b) for a, b in zip(start, stop, strict=True))
        for cells, all_cells in zip(mesh.cells(part), whole, strict=True):
            assert (cells == all_cells[window]).all()


def test_a_filled_mesh_is_what_its_cells_enclose():
    """Fill a box through narrow slits, also if the map cuts through it."""
    vertices, faces = make_box((1.5, 1.5, 1.5), (8.5, 8.5, 8.5))
    slit = join_meshes(*(make_soup(triangle) for triangle in vertices[faces] * 0.998 + 0.01))
    outer, inner = make_mesh(slit, "fill").cells(Grid((0, 0, 0), 1.0, (10,) * 3))
    assert inner[2:8, 2:8, 2:8].all() and inner.sum() == 6**3
    assert outer[1:9, 1:9, 1:9].all() and outer.sum() == 8**3
    part = Grid((3, 3, 3), 1.0, (10, 2, 3))
    for cells, whole in zip(make_mesh(slit, "fill").cells(part), (outer, inner), strict=True):
        assert (cells[:7] == whole[3:, 3:5, 3:6]).all()
        assert not cells[7:].any()


def measure_cube_distance(triangle, center, half):
    """Return a triangle's distance from a cube."""
    corners = np.array(list(product((-half, half), repeat=3))) + center
    differences = (triangle[:, None] - corners).reshape(-1, 3)
    system = np.vstack([differences.T, np.ones(len(differences))])
    weights = nnls(system, np.array([0.0, 0.0, 0.0, 1.0]))[0]
    return float(np.linalg.norm(differences.T @ weights / weights.sum()))


def test_the_distance_of_a_cube_is_exact():
    """Test radii just above and just below the distance; slivers may be marked too early."""
    rng = np.random.default_rng(3)
    for size in np.repeat([0.3, 1.0, 4.0], 200):
        cell = tuple(rng.integers(0, 3, 3).tolist())
        triangle = cell + rng.normal(size=(3, 3)) * size + rng.normal(size=3) * 3.0
        is_thin = rng.random() < 0.3
        if is_thin:
            bend = 10.0 ** rng.uniform(-16.0, -3.0) * rng.normal(size=3)
            triangle[2] = triangle[:2].mean(axis=0) + bend
        gap = measure_cube_distance(triangle, np.array(cell), 1.0)
        if gap < 1e-3:
            continue
        marks = np.zeros((2, 3, 3, 3), dtype=bool)
        for out, radius in zip(marks, (gap * (1 + 1e-9), gap - 1e-5), strict=True):
            mark_within(out, sweep_triangles(triangle[None], 0.0, False), 1.0, radius)
        is_marked, is_early = marks[:, *cell]
        assert is_marked and (is_thin or not is_early), (triangle, gap)
