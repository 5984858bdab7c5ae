"""What bodies enclose that share triangles, pass through themselves, are not turned alike, or lie in one another."""

import warnings

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from cspace import Grid
from cspace.shapes.mesh import Mesh
from cspace.raster.solids import mesh_rasters, rasterize_mesh
from cspace.raster.solids.inside import AMBIGUOUS, HOLLOW, INSIDE, OUTSIDE
from cspace.raster.solids.near import Crossings
from strategies import seeds


def box(low, high, inward=False):
    mesh = trimesh.creation.box(bounds=[low, high])
    faces = np.array(mesh.faces)
    return np.array(mesh.vertices), faces[:, ::-1] if inward else faces


def fan(radius, low, high, count=24):
    """A cylinder, or a cone where one radius is zero."""
    turn = 2 * np.pi * np.arange(count) / count
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    first, second = np.broadcast_to(radius, 2)
    rings = [np.column_stack([r * circle, np.full(count, z)]) for r, z in ((first, low), (second, high))]
    vertices = np.concatenate([*rings, [[0, 0, low], [0, 0, high]]])
    i, j, n = np.arange(count), np.roll(np.arange(count), -1), np.full(count, count)
    sides = [np.stack([i, j, j + n], axis=-1), np.stack([i, j + n, i + n], axis=-1)]
    caps = [np.stack([j, i, 2 * n], axis=-1), np.stack([i + n, j + n, 2 * n + 1], axis=-1)]
    return vertices, np.concatenate([*sides, *caps])


def joined(*parts):
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts[:-1])])
    return (
        np.concatenate([vertices for vertices, _ in parts]),
        np.concatenate([faces + start for (_, faces), start in zip(parts, starts, strict=True)]),
    )


def apart(part):
    """Each triangle with corners of its own, as a file in STL has them."""
    return part[0][part[1]].reshape(-1, 3), np.arange(part[1].size).reshape(-1, 3)


def turned_over(part, *numbers):
    faces = np.array(part[1])
    faces[list(numbers)] = faces[list(numbers), ::-1]
    return part[0], faces


def codes(part, points):
    """Codes of some points, which must agree with the rasters of the mesh as an obstacle and as a robot."""
    mesh = Mesh.of(part)
    points = np.asarray(points, dtype=float)
    found = mesh.inside_tester(mesh.triangles).codes(points)
    assert mesh.contains(points).tolist() == np.isin(found, (INSIDE, AMBIGUOUS)).tolist()
    spacing = 0.125
    lower = mesh.bounds[0] - 2 * spacing
    grid = Grid(lower, spacing, tuple(np.ceil((mesh.bounds[1] - lower) / spacing).astype(int) + 2))
    outer, inner = rasterize_mesh(mesh, grid)
    a_out, a_in = mesh_rasters(mesh, spacing)
    for point, code in zip(points, found, strict=True):
        cell = tuple(np.floor((point - lower) / spacing).astype(int))
        place = [tuple(np.round(point / spacing).astype(int) - raster.lower) for raster in (a_out, a_in)]
        there = [
            all(0 <= i < n for i, n in zip(index, raster.cells.shape, strict=True)) and bool(raster.cells[index])
            for index, raster in zip(place, (a_out, a_in), strict=True)
        ]
        if code in (INSIDE, AMBIGUOUS):
            assert outer[cell]
            assert there[0]
        if code != INSIDE:
            assert not inner[cell]
            assert not there[1]
    return found.tolist()


SHARING = {
    "boxes on one base": (
        [box((0, 0, 0), (4, 4, 4)), box((0, 0, 0), (4, 4, 8))],
        [(1.9, 2.1, 2), (2, 2.2, 6)],
    ),
    "cones on one base": ([fan((4, 0.5), 0, 4), fan((4, 0.5), 0, 8)], [(0.1, 0.2, 1), (0.1, 0.2, 5)]),
    "coaxial cylinders": ([fan(3, 0, 4), fan(3, 0, 8)], [(0.1, 0.2, 2), (0.1, 0.2, 6)]),
    "cylinder on cylinder": ([fan(3, 0, 4), fan(3, 4, 8)], [(0.1, 0.2, 2), (0.1, 0.2, 6)]),
    "three levels": (
        [box((0, 0, 0), (6, 6, z)) for z in (2, 4, 6)],
        [(2.9, 3.1, 1), (2.9, 3.1, 3), (2.9, 3.1, 5)],
    ),
}


@pytest.mark.parametrize("name", SHARING)
@pytest.mark.parametrize("soup", [False, True])
def test_bodies_that_share_triangles_do_not_cancel(name, soup):
    parts, points = SHARING[name]
    mesh = joined(*parts)
    assert codes(apart(mesh) if soup else mesh, points) == [INSIDE] * len(points)


def lattice_box(low, high, diagonal):
    """An outward box of unit squares, each cut along the diagonal that is asked for."""
    low, high = np.asarray(low), np.asarray(high)
    triangles = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (0, 1):
            for a in range(low[u], high[u]):
                for b in range(low[v], high[v]):
                    square = np.zeros((4, 3))
                    square[:, axis] = (low, high)[side][axis]
                    square[:, u], square[:, v] = a + np.array([0, 1, 1, 0]), b + np.array([0, 0, 1, 1])
                    square = np.roll(square[:: 1 if side else -1], diagonal(), axis=0)
                    triangles += [square[[0, 1, 2]], square[[0, 2, 3]]]
    return np.concatenate(triangles), np.arange(3 * len(triangles)).reshape(-1, 3)


@settings(max_examples=60)
@given(seeds, st.integers(2, 5), st.booleans(), st.booleans(), st.integers(0, 2))
def test_boxes_on_a_lattice_are_their_union(seed, count, soup, cut_at_random, flips):
    """Faces, edges and corners coincide in every way: nothing solid is left out, nothing outside is proven solid."""
    rng, side = np.random.default_rng(seed), 4
    parts, solid = [], np.zeros((side,) * 3, dtype=bool)
    for _ in range(count):
        low = rng.integers(0, side - 1, 3)
        high = np.minimum(side, low + rng.integers(1, 4, 3))
        part = lattice_box(low, high, lambda: int(cut_at_random and rng.integers(2)))
        if not soup:
            vertices, numbers = np.unique(part[0], axis=0, return_inverse=True)
            part = vertices, numbers.reshape(-1, 3)
        parts.append(part)
        solid[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = True
    vertices, faces = joined(*parts)
    mesh = turned_over((vertices, faces), *rng.integers(0, len(faces), flips))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mesh = Mesh.of(mesh)
    middles = np.moveaxis(np.indices(solid.shape), 0, -1) + 0.5 + np.array([0.013, 0.027, 0.041])
    found = mesh.inside_tester(mesh.triangles).codes(middles.reshape(-1, 3)).reshape(solid.shape)
    assert np.isin(found[solid], (INSIDE, AMBIGUOUS)).all()
    assert np.isin(found[~solid], (OUTSIDE, AMBIGUOUS)).all()
    if not flips:
        assert (found[~solid & (np.arange(side)[:, None, None] == 0)] == OUTSIDE).all()


def tube(turns=1.15, radius=3.0, thickness=1.0, along=40, around=12):
    """A tube that runs into its own beginning."""
    t, a = np.linspace(0, 2 * np.pi * turns, along), 2 * np.pi * np.arange(around) / around
    out = np.stack([np.cos(t), np.sin(t), 0 * t], axis=-1)
    middle = radius * out + np.array([0, 0, 0.25]) * t[:, None] / (2 * np.pi)
    ring = thickness * (np.cos(a)[:, None] * out[:, None] + np.sin(a)[:, None] * np.array([0, 0, 1]))
    vertices = np.concatenate([(middle[:, None] + ring).reshape(-1, 3), middle[:1], middle[-1:]])
    p = np.arange((along - 1) * around)
    q = p - p % around + (p + 1) % around
    faces = [np.stack([p, q, q + around], axis=-1), np.stack([p, q + around, p + around], axis=-1)]
    i, j, end = np.arange(around), np.roll(np.arange(around), -1), (along - 1) * around
    faces.append(np.stack([j, i, np.full(around, along * around)], axis=-1))
    faces.append(np.stack([end + i, end + j, np.full(around, along * around + 1)], axis=-1))
    return vertices, np.concatenate(faces)


def prism(polygon, low, high):
    """A closed prism over a closed polygon that may cross itself."""
    polygon, n = np.asarray(polygon, dtype=float), len(polygon)
    ends = [np.column_stack([polygon, np.full(n, z)]) for z in (low, high)]
    vertices = np.concatenate([*ends, [[*polygon.mean(axis=0), low]], [[*polygon.mean(axis=0), high]]])
    i, j, k = np.arange(n), np.roll(np.arange(n), -1), np.full(n, 2 * n)
    faces = [(i, j, j + n), (i, j + n, i + n), (j, i, k), (i + n, j + n, k + 1)]
    return vertices, np.concatenate([np.stack(face, axis=-1) for face in faces])


def test_a_triangle_that_is_turned_over_is_turned_back():
    """Where the tube runs into itself its winding number is 2: the parity says outside, and that is not asked."""
    crossing = [(3 * np.cos(0.4), 3 * np.sin(0.4), 0.14)]
    assert codes(tube(), crossing) == [INSIDE]
    for number in (0, 300, 950):
        part = turned_over(tube(), number)
        assert not Mesh.of(part).bodies[0].oriented
        assert codes(part, crossing) == [INSIDE]


def test_a_pocket_of_a_body_that_passes_through_itself_is_ambiguous():
    # Lobes of opposite turns that overlap: the winding numbers cancel.
    lobes = [(0, 0), (6, 0), (6, 6), (0, 6), (0, 0.01), (3, 3), (3, 9), (9, 9), (9, 3), (3, 3.01)]
    assert codes(prism(lobes, 0, 4), [(5, 5.2, 2), (1, 4.5, 2), (8, 8, 2), (1, 8, 2)]) == [
        AMBIGUOUS,
        INSIDE,
        INSIDE,
        OUTSIDE,
    ]
    spindle = trimesh.creation.torus(1.0, 2.5)
    assert codes((spindle.vertices, spindle.faces), [(0.05, 0.05, 0.05), (2, 0, 0), (0, 0, 2.45)]) == [
        AMBIGUOUS,
        INSIDE,
        OUTSIDE,
    ]


@pytest.mark.parametrize("soup", [False, True])
def test_a_box_drawn_twice_with_other_diagonals(soup):
    vertices, faces = box((0, 0, 0), (4, 4, 4))
    mirrored = vertices[:, [1, 0, 2]], faces[:, ::-1]
    point = [(2.1, 2.2, 2.3)]
    shaped = apart if soup else joined
    assert codes(shaped(joined((vertices, faces), mirrored)), point) == [INSIDE]
    assert codes(shaped(joined((vertices, faces), (mirrored[0], faces))), point) == [AMBIGUOUS]
    found = codes(shaped(joined((vertices, faces), turned_over(mirrored, 0))), point)
    assert found == [AMBIGUOUS] if soup else found[0] in (INSIDE, AMBIGUOUS)


def bent_hollow(flip):
    """A block with a hollow that a bent duct opens: every ray along an axis from within meets it."""
    outside = np.pad(np.zeros((7, 7, 7), dtype=bool), 1)
    block = np.ones((7, 7, 7), dtype=bool)
    block[2:5, 2:5, 2:5] = False
    block[4, 4, 5] = block[4, 4:6, 5] = block[4, 5, 5:] = False
    filled = outside.copy()
    filled[1:-1, 1:-1, 1:-1] = block
    triangles = []
    for axis in range(3):
        for sign in (-1, 1):
            for cell in np.argwhere(filled & ~np.roll(filled, -sign, axis)):
                square = np.zeros((4, 3))
                u, v = (axis + 1) % 3, (axis + 2) % 3
                square[:, u], square[:, v] = np.array([0, 1, 1, 0]), np.array([0, 0, 1, 1])
                square[:, axis] = sign > 0
                square = (square + cell)[::sign]
                triangles += [square[[0, 1, 2]], square[[0, 2, 3]]]
    vertices, numbers = np.unique(np.concatenate(triangles), axis=0, return_inverse=True)
    part = vertices, numbers.reshape(-1, 3)
    return turned_over(part, 7) if flip else part


@pytest.mark.parametrize("flip", [False, True])
def test_a_hollow_that_can_be_left_only_round_a_bend_is_outside(flip):
    part = bent_hollow(flip)
    mesh = Mesh.of(part)
    assert len(mesh.bodies) == 1
    assert codes(part, [(4.25, 4.25, 4.25), (3.1, 3.2, 3.3), (1.5, 1.5, 1.5)]) == [OUTSIDE, OUTSIDE, INSIDE]


def test_which_bodies_pass_through_themselves():
    def simple(part):
        mesh = Mesh.of(part)
        crossings: Crossings = mesh._crossings
        crossings.learn(np.arange(len(crossings.simple)), pairs=False)
        return crossings.simple.tolist()

    rng = np.random.default_rng(0)
    for seed in range(5):
        turn = trimesh.transformations.random_rotation_matrix(np.random.default_rng(seed).random(3))[:3, :3]
        ball = trimesh.creation.icosphere(subdivisions=3)
        cube = trimesh.creation.box((1, 1, 1)).subdivide().subdivide()
        ring = trimesh.creation.torus(2.0, 0.5)
        for solid in (ball, cube, ring):
            assert simple((solid.vertices @ turn.T, solid.faces)) == [1]
        spindle, pipe = trimesh.creation.torus(1.0, 2.5), tube()
        assert simple((spindle.vertices @ turn.T, spindle.faces)) == [0]
        assert simple((pipe[0] @ turn.T, pipe[1])) == [0]
        # One corner pushed through the other side, or so far that it touches it; at a common corner there is no pocket.
        for depth, expected in ((2.5, 0), (2.0 + 1e-12, 0), (2.0, 1), (1.9, 1)):
            vertices = np.array(ball.vertices)
            vertices[0] *= 1 - depth
            assert simple((vertices @ turn.T, ball.faces)) == [expected]
        inner = rng.integers(len(cube.vertices))
        vertices = np.array(cube.vertices)
        vertices[inner] *= 1 - 1e-3
        assert simple((vertices @ turn.T, cube.faces)) == [1]


A, B, C = ((0, 0, 0), (12, 12, 12)), ((3, 3, 3), (9, 9, 9)), ((5, 5, 5), (7, 7, 7))
WALL, MIDDLE = (1.5, 1.6, 1.7), (6.1, 6.2, 6.3)


def both_ways(part, back_first=False):
    vertices, faces = part
    pair = [faces[:, ::-1], faces] if back_first else [faces, faces[:, ::-1]]
    return vertices, np.stack(pair, axis=1).reshape(-1, 3)


NESTED = {
    "cavity": ([box(*A), box(*B, True)], HOLLOW),
    "island": ([box(*A), box(*B, True), box(*C)], INSIDE),
    "solid": ([box(*A), box(*B)], INSIDE),
    "all inward": ([box(*A, True), box(*B, True)], INSIDE),
    "room and furniture": ([box(*A, True), box(*B)], AMBIGUOUS),
    "cavities that overlap": (
        [box(*A), box((2, 2, 2), (7, 7, 7), True), box((4, 4, 4), (10, 10, 10), True)],
        AMBIGUOUS,
    ),
    "column through the wall of a cavity": ([box(*A), box(*B, True), box((5, 5, 1), (7, 7, 7))], AMBIGUOUS),
    "cavity with a triangle turned over": ([box(*A), turned_over(box(*B, True), 0)], AMBIGUOUS),
    "wall with a triangle turned over": ([turned_over(box(*A), 0), box(*B, True)], AMBIGUOUS),
    "cavity in a cavity": ([box(*A), box((2, 2, 2), (10, 10, 10), True), box(*B, True)], AMBIGUOUS),
    "cavity in a body in a body": ([box((-1, -1, -1), (13, 13, 13)), box(*A), box(*B, True)], AMBIGUOUS),
    "both ways": ([both_ways(box(*A)), both_ways(box(*B), True)], AMBIGUOUS),
    "both ways, the same first": ([both_ways(box(*A)), both_ways(box(*B))], AMBIGUOUS),
    "cavity and what fills it": ([box(*A), box(*B, True), box(*B)], AMBIGUOUS),
    "what fills a cavity, and it": ([box(*A), box(*B), box(*B, True)], AMBIGUOUS),
}


@pytest.mark.parametrize("name", NESTED)
@pytest.mark.parametrize("soup", [False, True])
def test_bodies_in_bodies(name, soup):
    """INSIDE or HOLLOW only where every reading says so: bodies are solid however they face, or inward ones hollow."""
    parts, expected = NESTED[name]
    mesh = joined(*parts)
    wall, middle = codes(apart(mesh) if soup else mesh, [WALL, MIDDLE])
    assert wall == INSIDE
    assert middle == expected


def test_a_room_of_slabs_is_free_where_the_slabs_are_told_apart():
    low, high = np.array([0, 0, 0]), np.array([8, 8, 8])
    slabs = []
    for axis in range(3):
        unit = np.eye(3, dtype=int)[axis]
        slabs += [box(low, high - 6 * unit), box(low + 6 * unit, high)]
    point = [(4.1, 4.2, 4.3)]
    assert codes(joined(*slabs), point) == [OUTSIDE]
    # Without the numbers of the corners they are one body, and whether its pocket is meant nobody can tell.
    assert codes(apart(joined(*slabs)), point) == [AMBIGUOUS]
