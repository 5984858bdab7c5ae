"""Rasters of meshes, against FCL, arithmetic and formulas."""

import math
import warnings
from itertools import product

import numpy as np
import pytest
import trimesh
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from cspace import Grid, InputError, Mesh, MeshWarning
from cspace.raster.triangles import mark_within, subdivide, sweep_triangles
from tests.helpers import solids
from tests.helpers.mesh_files import join_meshes, make_box
from tests.helpers.oracles import cross, distance_to_triangles, dot, units
from tests.helpers.placements import ORACLE_BAND
from tests.helpers.strategies import seeds


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
    if kind == "random":
        return rng.uniform(-1, 6, (n, 3, 3))
    if kind == "sliver":
        start, along = rng.uniform(-1, 6, (n, 1, 3)), rng.normal(size=(n, 1, 3)) * 3
        bend = rng.normal(size=(n, 1, 3)) * 10.0 ** rng.uniform(-12, -3, (n, 1, 1))
        return np.concatenate(
            [start, start + along, start + along * rng.uniform(0, 1, (n, 1, 1)) + bend], axis=1
        )
    if kind == "touching":
        triangles = rng.uniform(0, 5, (n, 3, 3))
        triangles[:, :, int(rng.integers(3))] = rng.integers(0, 6, (n, 1))
        return triangles
    if kind == "lattice":
        return rng.integers(-1, 7, (n, 3, 3)).astype(float)
    if kind == "degenerate":
        triangles = rng.choice(
            [rng.uniform(0, 5, (n, 3, 3)), rng.integers(0, 6, (n, 3, 3)).astype(float)]
        )
        triangles[:, 2] = triangles[:, int(rng.integers(2))]
        if rng.random() < 0.3:
            triangles[:, 1] = triangles[:, 0]
        return triangles
    assert kind == "huge"
    far = rng.uniform(-1, 1, (n, 3, 3)) * 2.0 ** rng.uniform(3, 21)
    # Through the center of the grid, so that each huge triangle meets it.
    return far - far.mean(axis=1, keepdims=True) + rng.uniform(0, 5, (n, 1, 3))


MESH_KINDS = ["random", "sliver", "touching", "lattice", "degenerate", "huge"]


@pytest.mark.parametrize("kind", MESH_KINDS)
@pytest.mark.parametrize("lower", [0.0, 2.0**20 + 0.3, -(2.0**21)])
def test_touched_cells_agree_with_exact_separating_axes(kind, lower):
    rng = np.random.default_rng([MESH_KINDS.index(kind), abs(int(lower))])
    for spacing in (1.0, 0.1):
        grid = Grid((lower * spacing,) * 3, spacing, (4, 3, 5))
        mesh = Mesh.of(make_soup(grid.lower + spacing * draw_small_mesh(rng, kind)), "surface")
        outer, inner = mesh.cells(grid)
        check_touched(outer, mesh.triangles, grid)
        assert not inner.any()


def test_touched_cells_of_over_200_meshes_agree_with_fcl():
    rng = np.random.default_rng(5)
    for number in range(204):
        kind = ("random", "touching", "lattice", "boxes")[number % 4]
        h, corner = [(1.0, 0.0), (0.05, 3.0), (1.0, 2.0**21 - 10)][number % 3]
        grid = Grid((corner,) * 3, h, (5, 5, 5))
        if kind == "boxes":
            lows = rng.choice(
                [rng.integers(-1, 4, (2, 3)).astype(float), rng.uniform(-1, 4, (2, 3))]
            )
            vertices, faces = join_meshes(
                *(make_box(low, low + rng.integers(1, 4, 3)) for low in lows)
            )
        else:
            vertices, faces = make_soup(draw_small_mesh(rng, kind))
        mesh = Mesh.of((corner + h * vertices, faces), "surface")
        outer, _ = mesh.cells(grid)
        # In cells of the grid, because FCL's tolerance is absolute.
        surface = solids.surface((mesh.vertices - corner) / h, faces)
        for cell in np.ndindex(*grid.shape):
            side = 1.0 + ORACLE_BAND if outer[cell] else 1.0 - ORACLE_BAND
            cube = solids.box((side, side, side), np.add(cell, 0.5))
            assert solids.meet(surface, cube) == outer[cell], (number, kind, cell)


@given(seeds, st.sampled_from(["random", "sliver", "touching", "lattice"]))
def test_touching_cells_obey_their_laws(seed, kind):
    """Commute with translations by cells, quarter turns and unions."""
    rng = np.random.default_rng(seed)
    triangles = draw_small_mesh(rng, kind)
    grid = Grid((0, 0, 0), 1.0, (6, 6, 6))

    def touched(part, on=grid):
        return Mesh.of(make_soup(part), "surface").cells(on)[0]

    whole = touched(triangles)
    if kind in ("lattice", "touching"):
        shift = rng.integers(-1000, 1000, 3)
        exact = np.round(triangles * 64) / 64
        assert (
            touched(exact) == touched(exact + shift, Grid(shift.astype(float), 1.0, (6, 6, 6)))
        ).all()
        turned = np.stack([6.0 - exact[..., 1], exact[..., 0], exact[..., 2]], axis=-1)
        assert (touched(turned) == touched(exact).transpose(1, 0, 2)[::-1]).all()
        swapped = exact[..., [2, 0, 1]]
        assert (touched(swapped) == touched(exact).transpose(2, 0, 1)).all()
    assert not (touched(triangles[:1]) & ~whole).any()
    assert (np.logical_or.reduce([touched(one) for one in triangles]) == whole).all()


def test_a_grid_inside_a_mesh_is_full_and_one_outside_is_empty():
    mesh = Mesh.of(make_box((0, 0, 0), (10, 10, 10)))
    for outer, inner, expected in (
        (*mesh.cells(Grid((4, 4, 4), 0.5, (3, 4, 5))), True),
        (*mesh.cells(Grid((40, 4, 4), 0.5, (3, 4, 5))), False),
    ):
        assert outer.shape == inner.shape == (3, 4, 5)
        assert (outer == expected).all()
        assert (inner == expected).all()


def test_a_map_that_cuts_through_a_solid_is_part_of_the_larger_map():
    mesh = Mesh.of(
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
    ):
        part = Grid(np.multiply(start, 0.5), 0.5, tuple(np.subtract(stop, start).tolist()))
        window = tuple(slice(a, b) for a, b in zip(start, stop, strict=True))
        for cells, all_cells in zip(mesh.cells(part), whole, strict=True):
            assert (cells == all_cells[window]).all()


def find_covered(boxes, side, fine=4):
    """Return masks of cells meeting boxes, and inside them.

    The corners of the boxes are at odd multiples of 1 / (2 fine).
    """
    centers = (np.arange(side * fine) + 0.5) / fine
    filled = np.zeros((side * fine,) * 3, dtype=bool)
    for low, high in boxes:
        x, y, z = ((centers > a) & (centers < b) for a, b in zip(low, high, strict=True))
        filled |= x[:, None, None] & y[None, :, None] & z[None, None, :]
    blocks = filled.reshape(side, fine, side, fine, side, fine)
    return blocks.any(axis=(1, 3, 5)), blocks.all(axis=(1, 3, 5))


def find_touched(boxes, side):
    """Return cells that surfaces of boxes meet."""
    cells = np.arange(side)
    touched = np.zeros((side,) * 3, dtype=bool)
    for low, high in boxes:
        meet = [(cells <= b) & (cells + 1 >= a) for a, b in zip(low, high, strict=True)]
        within = [(cells > a) & (cells + 1 < b) for a, b in zip(low, high, strict=True)]
        outer, inner = (
            x[:, None, None] & y[None, :, None] & z[None, None, :] for x, y, z in (meet, within)
        )
        touched |= outer & ~inner
    return touched


@settings(max_examples=40)
@given(seeds, st.integers(1, 4))
def test_overlapping_boxes_are_their_union_whatever_way_they_face(seed, count):
    rng = np.random.default_rng(seed)
    side = 12
    lows = rng.integers(1, 6, (count, 3)) + rng.choice([0.25, 0.5, 0.75], (count, 3))
    highs = lows + rng.integers(1, 7, (count, 3)) - 0.25
    boxes = list(zip(lows, np.minimum(highs, side - 0.25), strict=True))
    meeting, lying = find_covered(boxes, side)
    surface = find_touched(boxes, side)
    grid = Grid((0, 0, 0), 1.0, (side,) * 3)
    for inward in (np.zeros(count, dtype=bool), np.ones(count, dtype=bool)):
        outer, inner = Mesh.of(
            join_meshes(*(make_box(*b, inward=way) for b, way in zip(boxes, inward, strict=True)))
        ).cells(grid)
        assert (outer == meeting | surface).all()
        assert (inner == lying & ~surface).all()
    inward = rng.random(count) < 0.5
    outer, inner = Mesh.of(
        join_meshes(*(make_box(*b, inward=way) for b, way in zip(boxes, inward, strict=True)))
    ).cells(grid)
    # Skip boxes that face inward and may be cavities of others.
    nested = np.zeros_like(outer)
    for a, b in product(range(count), repeat=2):
        if (
            inward[a] != inward[b]
            and (lows[a] < lows[b]).all()
            and (boxes[b][1] < boxes[a][1]).all()
        ):
            nested |= find_covered([boxes[b]], side)[0]
    assert not (inner & ~lying).any()
    assert outer[meeting & ~nested].all()
    assert outer[surface].all()


def test_doubled_faces_change_nothing():
    vertices, faces = make_box((1.5, 1.5, 1.5), (6.5, 6.5, 6.5))
    single = Mesh.of((vertices, faces)).cells(Grid((0, 0, 0), 1.0, (16,) * 3))
    for again in (faces, faces[:, ::-1], faces[:1], faces[5:6, ::-1]):
        mesh = Mesh.of((vertices, np.concatenate([faces, again])))
        assert mesh.is_watertight
        double = mesh.cells(Grid((0, 0, 0), 1.0, (16,) * 3))
        assert all((a == b).all() for a, b in zip(single, double, strict=True))
    for inward in (False, True):
        both, numbers = join_meshes(
            (vertices, faces), make_box((6.5, 1.5, 1.5), (11.5, 6.5, 6.5), inward)
        )
        with warnings.catch_warnings():
            # Boxes of one size that face opposite ways have no winding number together.
            warnings.simplefilter("ignore" if inward else "error", MeshWarning)
            mesh = Mesh.of(make_soup(both[numbers]))
        assert len(mesh.bodies) == 1
        assert mesh.is_watertight
        outer, inner = mesh.cells(Grid((0, 0, 0), 1.0, (16,) * 3))
        assert inner[2:6, 2:6, 2:6].all()
        assert inner[7:11, 2:6, 2:6].all()
        assert not outer[12:].any()


def test_an_open_mesh_is_rasterised_by_its_policy():
    vertices, faces = make_box((1.5, 1.5, 1.5), (8.5, 8.5, 8.5))
    grid = Grid((0, 0, 0), 1.0, (10,) * 3)
    open_box = (vertices, faces[1:])
    surface = Mesh.of(open_box, "surface").cells(grid)
    assert not surface[0][4, 4, 4]
    # Half a face is missing, so the interior is open; one warning says so.
    filled = Mesh.of(open_box, "fill")
    with pytest.warns(
        MeshWarning, match="mesh is open and encloses no cell of 1 m.*; close its gaps"
    ) as caught:
        assert all((a == b).all() for a, b in zip(filled.cells(grid), surface, strict=True))
        assert not filled.cells(grid)[1].any()
    assert len(caught) == 1
    with pytest.warns(MeshWarning, match="encloses no cell of 0.5 m"):
        assert not Mesh.of(open_box, "fill").rasters(0.5)[1].count
    slit = join_meshes(*(make_soup(triangle) for triangle in vertices[faces] * 0.998 + 0.01))
    outer, inner = Mesh.of(slit, "fill").cells(grid)
    assert inner[2:8, 2:8, 2:8].all()
    assert outer[1:9, 1:9, 1:9].all()
    # Filling uses the whole mesh, even if the map cuts through it.
    part = Grid((3, 3, 3), 1.0, (10, 2, 3))
    for cells, every in zip(Mesh.of(slit, "fill").cells(part), (outer, inner), strict=True):
        assert (cells[:7] == every[3:, 3:5, 3:6]).all()
        assert not cells[7:].any()


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [0.0, 4.0])
def test_filling_leaves_a_box_without_a_face_open(axis, side):
    """Leave out a face at the border of cells, which are touched on both sides of it."""
    vertices, faces = make_box((0.0, 0.0, 0.0), (4.0, 4.0, 4.0))
    is_left_out = (vertices[faces][:, :, axis] == side).all(axis=1)
    grid = Grid((-2, -2, -2), 1.0, (9, 9, 9))
    with pytest.warns(MeshWarning, match="encloses no cell"):
        assert not Mesh.of((vertices, faces[~is_left_out]), "fill").cells(grid)[1].any()
    assert Mesh.of((vertices, faces), "fill").cells(grid)[1].sum() == 2**3


def measure_torus_distance(points, major=2.0, minor=0.8):
    return np.hypot(np.hypot(points[..., 0], points[..., 1]) - major, points[..., 2]) - minor


def test_round_solids_agree_with_their_formulas():
    """Test cells well inside and well outside."""
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=2.5)
    torus = trimesh.creation.torus(
        major_radius=2.0, minor_radius=0.8, major_sections=160, minor_sections=80
    )
    for solid, distance, sag in (
        (sphere, lambda p: np.linalg.norm(p, axis=-1) - 2.5, 0.01),
        (torus, measure_torus_distance, 0.01),
    ):
        mesh = Mesh.of(solid)
        grid = Grid((-3.1, -3.2, -3.05), 0.15, (42, 43, 41))
        outer, inner = mesh.cells(grid)
        centers = grid.center_of(np.moveaxis(np.indices(grid.shape), 0, -1))
        depth, half = distance(centers), 0.15 * math.sqrt(3) / 2
        assert inner[depth < -half - sag].all()
        assert not inner[depth > -0.075].any()
        assert outer[depth < 0.075 - sag].all()
        assert not outer[depth > half + ORACLE_BAND].any()
        assert mesh.contains(centers)[depth < -sag].all()
        assert not mesh.contains(centers)[depth > 0].any()
        a_out, a_in = mesh.rasters(0.15)
        for raster, must, may in (
            (a_out, 0.15 - sag, 0.15 * math.sqrt(3) + ORACLE_BAND),
            (a_in, -sag, 0.0),
        ):
            points = (
                np.moveaxis(np.indices(np.array(raster.cells.shape) + 4), 0, -1) - 2 + raster.lower
            )
            cells = np.pad(raster.cells, 2)
            depth = distance(points * 0.15)
            assert cells[depth < must].all()
            assert not cells[depth >= may].any()


@settings(max_examples=25)
@given(seeds, st.sampled_from([0.0, 0.0, 0.3, 0.75]))
@example(0, 0.5)
def test_robot_boxes_agree_with_arithmetic(seed, margin):
    rng = np.random.default_rng(seed)
    low = rng.choice([rng.uniform(-2, 0, 3), rng.integers(-8, 0, 3) / 4.0])
    high = low + rng.choice([rng.uniform(0.1, 3, 3), rng.integers(1, 12, 3) / 4.0])
    spacing = 0.25
    outer, inner = Mesh.of(make_box(low, high)).rasters(spacing, margin)
    points = np.moveaxis(np.indices((48,) * 3), 0, -1) - 20
    gap = np.maximum(0, np.maximum(low - (points + 1) * spacing, (points - 1) * spacing - high))
    gap = np.linalg.norm(gap, axis=-1)
    depth = np.minimum(points * spacing - low, high - points * spacing).min(axis=-1)
    for raster, must, may in (
        (outer, gap <= margin, gap <= margin + 1e-5),
        # Lattice points on the boundary itself are skipped, because rounding may put them on either
        # side.
        (inner, depth > ORACLE_BAND, depth > 1e-9),
    ):
        cells = np.zeros((48,) * 3, dtype=bool)
        start = np.add(raster.lower, 20)
        assert (start >= 0).all() or not raster.count
        window = tuple(slice(a, a + n) for a, n in zip(start, raster.cells.shape, strict=True))
        cells[window] = raster.cells
        assert cells[must].all()
        assert not cells[~may].any()


def measure_cube_distance(triangle, center, half):
    """Return a triangle's distance from a cube."""
    corners = np.array(list(product((-half, half), repeat=3))) + center
    differences = (triangle[:, None] - corners).reshape(-1, 3)
    system = np.vstack([differences.T, np.ones(len(differences))])
    weights = nnls(system, np.array([0.0, 0.0, 0.0, 1.0]))[0]
    return float(np.linalg.norm(differences.T @ weights / weights.sum()))


def test_margins_agree_with_minimum_distances():
    rng = np.random.default_rng(11)
    for number in range(60):
        triangles = draw_small_mesh(
            rng, ("random", "touching", "lattice", "degenerate", "sliver")[number % 5]
        )[:2]
        radius = float(rng.choice([0.3, 1.0, 1.7]))
        outer, inner = Mesh.of(make_soup(triangles), "surface").rasters(0.5, radius * 0.5)
        assert not inner.count
        outer_cells = np.pad(outer.cells, 1)
        cells = np.argwhere(np.ones_like(outer_cells))
        excess = 2.0**-12 * 30 if number % 5 >= 3 else 1e-5
        chosen = cells[rng.permutation(len(cells))[:250]]
        centers = chosen - 1.0 + outer.lower
        for cell, center, middle in zip(
            chosen, centers, distance_to_triangles(centers, triangles * 2.0), strict=True
        ):
            gap = max(
                0.0, middle - 1.0
            )  # bounded above by a ball in the cube, and below by a ball around it
            if gap > radius - 1e-9 and middle - math.sqrt(3.0) <= radius + excess:
                gap = min(
                    measure_cube_distance(triangle * 2.0, center, 1.0) for triangle in triangles
                )
            if gap <= radius - 1e-9:
                assert outer_cells[tuple(cell)], (number, cell, gap, radius)
            if gap > radius + excess:
                assert not outer_cells[tuple(cell)], (number, cell, gap, radius)


@pytest.mark.parametrize("size", [0.3, 1.0, 4.0])
def test_the_distance_of_a_cube_is_exact(size):
    """Test radii just above and just below the distance."""
    rng = np.random.default_rng(3)
    for _ in range(700):
        triangle = rng.normal(size=(3, 3)) * size + rng.normal(size=3) * 3.0
        gap = measure_cube_distance(triangle, np.zeros(3), 1.0)
        if gap < 1e-3:
            continue
        for radius, expected in ((gap * (1 + 1e-9), True), (gap - 1e-5, False)):
            out = np.zeros((1, 1, 1), dtype=bool)
            mark_within(out, sweep_triangles(triangle[None], 0.0, False), 1.0, radius)
            assert out[0, 0, 0] == expected, (triangle, gap, radius)


def test_subdivided_triangles_are_short_and_cover_the_originals():
    rng = np.random.default_rng(4)
    triangles = rng.normal(size=(20, 3, 3)) * 3.0
    pieces = subdivide(triangles, 0.7, 0.0, False)
    assert np.linalg.norm(pieces - np.roll(pieces, -1, axis=1), axis=2).max() <= 0.7
    areas = [
        np.linalg.norm(np.cross(part[:, 1] - part[:, 0], part[:, 2] - part[:, 0]), axis=1).sum()
        for part in (triangles, pieces)
    ]
    assert areas[0] == pytest.approx(areas[1])
    assert (subdivide(triangles, np.inf, 0.0, False) == triangles).all()


@pytest.mark.parametrize("margin", [0.0, 0.3, 1.0])
def test_a_filled_robot_is_as_large_as_what_it_encloses(margin):
    vertices, faces = make_box((-1.3, -1.3, -1.3), (1.3, 1.3, 1.3))
    spacing = 0.25
    filled = Mesh.of((vertices, faces), "fill").rasters(spacing, margin)
    solid = Mesh.of((vertices, faces)).rasters(spacing, margin)
    low = np.subtract(solid[0].lower, filled[0].lower)
    window = tuple(slice(a, a + n) for a, n in zip(low, solid[0].cells.shape, strict=True))
    assert filled[0].cells[window][solid[0].cells].all()
    assert filled[0].count <= 1.4 * solid[0].count
    assert (np.array(filled[1].lower) == -4).all()
    assert filled[1].cells.all()
    assert filled[1].cells.shape == (9, 9, 9)


@pytest.mark.filterwarnings("ignore::cspace.MeshWarning")  # some enclose nothing
@pytest.mark.parametrize("margin", [0.0, 0.8])
def test_a_filled_robot_covers_its_filled_cells(margin):
    """Enclose a cube by leaky walls."""
    rng = np.random.default_rng(8)
    filled = 0
    for _ in range(30):
        centers = rng.uniform(0, 7, (70, 1, 3))
        mesh = Mesh.of(make_soup(centers + rng.normal(size=(70, 3, 3)) * 0.7), "fill")
        outer, inner = mesh.rasters(1.0, margin)
        filled += inner.count
        points = np.moveaxis(np.indices(np.array(outer.cells.shape) + 2), 0, -1) - 1 + outer.lower
        cells = np.pad(outer.cells, 1)
        for member in np.argwhere(inner.cells) + inner.lower:
            gap = np.linalg.norm(np.maximum(np.abs(points - member) - 1.5, 0), axis=-1)
            near = (np.abs(points - member) < 1.5).all(axis=-1) if margin == 0.0 else gap <= margin
            assert cells[near].all()
    assert filled


def test_a_thin_robot_is_never_too_small():
    """Compare a sliver with the segment that it approximates."""
    for bend in (0.0, 1e-13, 1e-9, 1e-4):
        mesh = Mesh.of(make_soup([[(0, 0, 0), (3, 1, 0.5), (1.5, 0.5 + bend, 0.25)]]), "surface")
        outer, _ = mesh.rasters(0.25, 0.4)
        points = np.moveaxis(np.indices(outer.cells.shape), 0, -1) + outer.lower
        along = np.linspace(0, 1, 4001)[:, None] * np.array([3, 1, 0.5]) / 0.25
        gaps = np.array(
            [np.linalg.norm(np.maximum(np.abs(points - p) - 1, 0), axis=-1) for p in along[::40]]
        ).min(axis=0)
        assert outer.cells[gaps <= 1.6].all()
        assert not outer.cells[gaps > 1.6 + 0.1].any()


@pytest.mark.parametrize("call", ["grid", "robot"])
def test_meshes_too_far_for_the_certificate_are_refused(call):
    mesh = Mesh.of(make_box((0, 0, 0), (1, 1, 1e6)))
    with pytest.raises(InputError, match="rounding"):
        if call == "grid":
            mesh.cells(Grid((0, 0, 0), 0.1, (4, 4, 4)))
        else:
            mesh.rasters(0.1)


def test_filling_a_mesh_far_larger_than_the_map_is_refused():
    with pytest.raises(InputError, match="fill"):
        Mesh.of(make_box((0, 0, 0), (1, 1, 1)), "fill").cells(Grid((0, 0, 0), 1e-5, (4, 4, 4)))
