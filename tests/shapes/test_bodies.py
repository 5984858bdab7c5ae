"""Solids of bodies: shared triangles, self-intersections, orientation and nesting."""

import warnings

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from cspace import Grid, Mesh, MeshWarning
from cspace.shapes.bodies import find_bodies
from tests.helpers.mesh_files import join_meshes, make_box
from tests.helpers.oracles import winding_numbers
from tests.helpers.strategies import seeds


def fan(radius, low, high, count=24):
    """Make a cylinder or a cone frustum."""
    turn = 2 * np.pi * np.arange(count) / count
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    first, second = np.broadcast_to(radius, 2)
    rings = [
        np.column_stack([r * circle, np.full(count, z)]) for r, z in ((first, low), (second, high))
    ]
    vertices = np.concatenate([*rings, [[0, 0, low], [0, 0, high]]])
    i, j, n = np.arange(count), np.roll(np.arange(count), -1), np.full(count, count)
    sides = [np.stack([i, j, j + n], axis=-1), np.stack([i, j + n, i + n], axis=-1)]
    caps = [np.stack([j, i, 2 * n], axis=-1), np.stack([i + n, j + n, 2 * n + 1], axis=-1)]
    return vertices, np.concatenate([*sides, *caps])


def separate_triangles(part):
    """Give each triangle separate vertices, as in an STL file."""
    return part[0][part[1]].reshape(-1, 3), np.arange(part[1].size).reshape(-1, 3)


def reverse_triangles(part, *numbers):
    """Reverse the orientation of some triangles."""
    faces = np.array(part[1])
    faces[list(numbers)] = faces[list(numbers), ::-1]
    return part[0], faces


def inside(part, points):
    """Test if points lie inside, after a comparison with cells and rasters."""
    mesh = Mesh.of(part)
    points = np.asarray(points, dtype=float)
    answers = mesh.contains(points)
    spacing = 0.125
    lower, upper = mesh.bounds
    lower = lower - 2 * spacing
    grid = Grid(lower, spacing, tuple(np.ceil((upper - lower) / spacing).astype(int) + 2))
    outer, inner = mesh.cells(grid)
    a_out, a_in = mesh.rasters(spacing)
    for point, within in zip(points, answers, strict=True):
        cell = tuple(np.floor((point - lower) / spacing).astype(int))
        index = np.round(point / spacing).astype(int)
        there = []
        for raster in (a_out, a_in):
            position = tuple(index - raster.lower)
            known = all(0 <= i < n for i, n in zip(position, raster.cells.shape, strict=True))
            there.append(known and bool(raster.cells[position]))
        assert inner[cell] <= within <= outer[cell]
        assert there[1] <= within <= there[0]
    return answers.tolist()


SHARING = {
    "boxes on one base": (
        [make_box((0, 0, 0), (4, 4, 4)), make_box((0, 0, 0), (4, 4, 8))],
        [(1.9, 2.1, 2), (2, 2.2, 6)],
    ),
    "cones on one base": (
        [fan((4, 0.5), 0, 4), fan((4, 0.5), 0, 8)],
        [(0.1, 0.2, 1), (0.1, 0.2, 5)],
    ),
    "coaxial cylinders": ([fan(3, 0, 4), fan(3, 0, 8)], [(0.1, 0.2, 2), (0.1, 0.2, 6)]),
    "cylinder on cylinder": ([fan(3, 0, 4), fan(3, 4, 8)], [(0.1, 0.2, 2), (0.1, 0.2, 6)]),
    "three levels": (
        [make_box((0, 0, 0), (6, 6, z)) for z in (2, 4, 6)],
        [(2.9, 3.1, 1), (2.9, 3.1, 3), (2.9, 3.1, 5)],
    ),
}


@pytest.mark.parametrize("name", SHARING)
@pytest.mark.parametrize("soup", [False, True])
def test_bodies_that_share_triangles_do_not_cancel(name, soup):
    parts, points = SHARING[name]
    mesh = join_meshes(*parts)
    assert inside(separate_triangles(mesh) if soup else mesh, points) == [True] * len(points)


def lattice_box(low, high, diagonal):
    """Make an outward box of unit squares, cut along the given diagonals."""
    low, high = np.asarray(low), np.asarray(high)
    triangles = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (0, 1):
            for a in range(low[u], high[u]):
                for b in range(low[v], high[v]):
                    square = np.zeros((4, 3))
                    square[:, axis] = (low, high)[side][axis]
                    square[:, u], square[:, v] = (
                        a + np.array([0, 1, 1, 0]),
                        b + np.array([0, 0, 1, 1]),
                    )
                    square = np.roll(square[:: 1 if side else -1], diagonal(), axis=0)
                    triangles += [square[[0, 1, 2]], square[[0, 2, 3]]]
    return np.concatenate(triangles), np.arange(3 * len(triangles)).reshape(-1, 3)


@settings(max_examples=30)
@given(seeds, st.integers(2, 5), st.booleans(), st.booleans())
def test_coincident_boxes_are_solid_in_their_union(seed, count, soup, cut_at_random):
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
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mesh = Mesh.of(join_meshes(*parts))
    centers = np.moveaxis(np.indices(solid.shape), 0, -1) + 0.5 + np.array([0.013, 0.027, 0.041])
    assert (mesh.contains(centers) == solid).all()


@settings(max_examples=30)
@given(seeds, st.integers(1, 4))
def test_bodies_agree_with_their_winding_numbers(seed, count):
    # The balls overlap, have both orientations and some reversed triangles.
    rng = np.random.default_rng(seed)
    parts = []
    for _ in range(count):
        ball = trimesh.creation.icosphere(subdivisions=1, radius=rng.uniform(0.3, 1.5))
        part = (
            np.array(ball.vertices) + rng.normal(0, 0.6, 3),
            np.array(ball.faces)[:, :: rng.choice([-1, 1])],
        )
        parts.append(reverse_triangles(part, *rng.integers(0, len(part[1]), rng.integers(0, 3))))
    vertices, faces = join_meshes(*parts)
    points = rng.uniform(-2.5, 2.5, (200, 3))
    bodies = find_bodies(vertices, faces)
    assert len(bodies) == count
    numbers = np.zeros(len(points), dtype=int)
    for body in bodies:
        assert body.closed
        turned = np.where(body.turns[:, None] == 1, faces[body.faces], faces[body.faces][:, ::-1])
        numbers += winding_numbers(points, vertices[turned])
    assert (Mesh.of((vertices, faces)).contains(points) == (numbers != 0)).all()
    # Inward bodies have all corners in outward bodies, so every point outside the cavities is
    # solid.
    solid, hollow = (np.zeros(len(points), dtype=bool) for _ in range(2))
    for body in bodies:
        turned = np.where(body.turns[:, None] == 1, faces[body.faces], faces[body.faces][:, ::-1])
        (hollow if body.volume < 0 else solid)[winding_numbers(points, vertices[turned]) != 0] = (
            True
        )
    assert (numbers != 0)[solid & ~hollow].all()


def tube(turns=1.15, radius=3.0, thickness=1.0, along=40, around=12):
    """Make a tube whose end intersects its beginning."""
    t, a = np.linspace(0, 2 * np.pi * turns, along), 2 * np.pi * np.arange(around) / around
    out = np.stack([np.cos(t), np.sin(t), 0 * t], axis=-1)
    center = radius * out + np.array([0, 0, 0.25]) * t[:, None] / (2 * np.pi)
    ring = thickness * (
        np.cos(a)[:, None] * out[:, None] + np.sin(a)[:, None] * np.array([0, 0, 1])
    )
    vertices = np.concatenate([(center[:, None] + ring).reshape(-1, 3), center[:1], center[-1:]])
    p = np.arange((along - 1) * around)
    q = p - p % around + (p + 1) % around
    faces = [np.stack([p, q, q + around], axis=-1), np.stack([p, q + around, p + around], axis=-1)]
    i, j, end = np.arange(around), np.roll(np.arange(around), -1), (along - 1) * around
    faces.append(np.stack([j, i, np.full(around, along * around)], axis=-1))
    faces.append(np.stack([end + i, end + j, np.full(around, along * around + 1)], axis=-1))
    return vertices, np.concatenate(faces)


def prism(polygon, low, high):
    """Make a closed prism over a polygon that may intersect itself."""
    polygon, n = np.asarray(polygon, dtype=float), len(polygon)
    caps = [np.column_stack([polygon, np.full(n, z)]) for z in (low, high)]
    vertices = np.concatenate(
        [*caps, [[*polygon.mean(axis=0), low]], [[*polygon.mean(axis=0), high]]]
    )
    i, j, k = np.arange(n), np.roll(np.arange(n), -1), np.full(n, 2 * n)
    faces = [(i, j, j + n), (i, j + n, i + n), (j, i, k), (i + n, j + n, k + 1)]
    return vertices, np.concatenate([np.stack(face, axis=-1) for face in faces])


def test_a_reversed_triangle_is_corrected():
    # The winding number of the self-intersection is 2, so even-odd parity would be wrong.
    crossing = [(3 * np.cos(0.4), 3 * np.sin(0.4), 0.14)]
    assert inside(tube(), crossing) == [True]
    for number in (0, 300, 950):
        part = reverse_triangles(tube(), number)
        assert np.unique(Mesh.of(part).bodies[0].turns, return_counts=True)[1].min() == 1
        assert inside(part, crossing) == [True]


def test_pockets_with_cancelling_windings_are_hollow():
    # The winding numbers of overlapping lobes with opposite orientation cancel.
    lobes = [(0, 0), (6, 0), (6, 6), (0, 6), (0, 0.01), (3, 3), (3, 9), (9, 9), (9, 3), (3, 3.01)]
    assert inside(prism(lobes, 0, 4), [(5, 5.2, 2), (1, 4.5, 2), (8, 8, 2), (1, 8, 2)]) == [
        False,
        True,
        True,
        False,
    ]
    # The winding number in the pocket of a spindle torus is two.
    spindle = trimesh.creation.torus(1.0, 2.5)
    numbers = winding_numbers(np.array([(0.05, 0.05, 0.05)]), spindle.triangles)
    answers = inside(
        (spindle.vertices, spindle.faces), [(0.05, 0.05, 0.05), (2, 0, 0), (0, 0, 2.45)]
    )
    assert answers == [numbers[0] != 0, True, False]


@pytest.mark.parametrize("soup", [False, True])
def test_a_box_drawn_twice_stays_solid_with_other_diagonals(soup):
    vertices, faces = make_box((0, 0, 0), (4, 4, 4))
    mirrored = vertices[:, [1, 0, 2]], faces[:, ::-1]
    point = [(2.1, 2.2, 2.3)]
    shaped = separate_triangles if soup else join_meshes
    assert inside(shaped(join_meshes((vertices, faces), mirrored)), point) == [True]
    # A box drawn once for each side cancels, with a warning.
    with pytest.warns(MeshWarning, match="cancel"):
        assert inside(shaped(join_meshes((vertices, faces), (mirrored[0], faces))), point) == [
            False
        ]
    with pytest.warns(MeshWarning, match="are open"):
        inside(shaped(join_meshes((vertices, faces), reverse_triangles(mirrored, 0))), point)


@pytest.mark.parametrize("name", ["moebius", "klein"])
def test_a_surface_with_one_side_has_no_inside(name):
    # A Moebius strip is open and Klein's bottle is closed; neither can be oriented.
    n, m = 24, 12
    u, v = np.meshgrid(2 * np.pi * np.arange(n) / n, np.arange(m), indexing="ij")
    i, j = np.meshgrid(np.arange(n), np.arange(m - (name == "moebius")), indexing="ij")

    def number(i, j):
        j = np.where(i >= n, (-j if name == "klein" else m - 1 - j), j)
        return (i % n) * m + j % m

    if name == "moebius":
        w = v / (m - 1) - 0.5
        r = 2 + w * np.cos(u / 2)
        vertices = np.stack([r * np.cos(u), r * np.sin(u), w * np.sin(u / 2)], axis=-1)
    else:
        w = 2 * np.pi * v / m
        r = 2 + 0.7 * (np.cos(u / 2) * np.sin(w) - np.sin(u / 2) * np.sin(2 * w))
        z = 0.7 * (np.sin(u / 2) * np.sin(w) + np.cos(u / 2) * np.sin(2 * w))
        vertices = np.stack([r * np.cos(u), r * np.sin(u), z], axis=-1)
    quads = [number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)]
    faces = np.concatenate(
        [np.stack([quads[a] for a in t], axis=-1).reshape(-1, 3) for t in ((0, 1, 2), (0, 2, 3))]
    )
    with pytest.warns(MeshWarning, match="1 of 1 bodies"):
        mesh = Mesh.of((vertices.reshape(-1, 3), faces))
    assert not mesh.encloses
    assert not mesh.cells(Grid((-3, -3, -1), 0.25, (24, 24, 8)))[1].any()


def bent_hollow(flip):
    """Make a block with a hollow whose duct no axis-parallel ray passes.

    With ``flip``, one triangle is reversed.
    """
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
    return reverse_triangles(part, 7) if flip else part


@pytest.mark.parametrize("flip", [False, True])
def test_a_hollow_with_a_bent_exit_is_outside(flip):
    part = bent_hollow(flip)
    mesh = Mesh.of(part)
    assert len(mesh.bodies) == 1
    assert inside(part, [(4.25, 4.25, 4.25), (3.1, 3.2, 3.3), (1.5, 1.5, 1.5)]) == [
        False,
        False,
        True,
    ]


def inward(part):
    return part[0], part[1][:, ::-1]


def two_sided(part):
    """Add the reverse of each triangle."""
    vertices, faces = part
    return vertices, np.stack([faces, faces[:, ::-1]], axis=1).reshape(-1, 3)


OUTER, MIDDLE, INNER = (make_box((k,) * 3, (12 - k,) * 3) for k in (0, 3, 5))
IN_WALL, AT_CENTER = (1.5, 1.6, 1.7), (6.1, 6.2, 6.3)
NESTED = {
    "cavity": ([OUTER, inward(MIDDLE)], False),
    "island": ([OUTER, inward(MIDDLE), INNER], True),
    "inward island": ([OUTER, inward(MIDDLE), inward(INNER)], True),
    "solid": ([OUTER, MIDDLE], True),
    "all inward": ([inward(OUTER), inward(MIDDLE)], True),
    "inward": ([inward(OUTER)], True),
    "inward room with furniture": ([inward(OUTER), MIDDLE], True),
    "overlapping cavities": (
        [OUTER, make_box((2,) * 3, (7,) * 3, True), make_box((4,) * 3, (10,) * 3, True)],
        True,
    ),
    "column through the wall of a cavity": (
        [OUTER, inward(MIDDLE), make_box((5, 5, 1), (7, 7, 7))],
        True,
    ),
    "cavity with a reversed triangle": ([OUTER, reverse_triangles(inward(MIDDLE), 0)], True),
    "wall with a reversed triangle": ([reverse_triangles(OUTER, 0), inward(MIDDLE)], False),
    "cavity in a cavity": ([OUTER, make_box((2,) * 3, (10,) * 3, True), inward(MIDDLE)], True),
    "cavity in a body in a body": ([make_box((-1,) * 3, (13,) * 3), OUTER, inward(MIDDLE)], True),
    "two-sided": ([two_sided(OUTER), two_sided(inward(MIDDLE))], True),
    "two-sided, equal order": ([two_sided(OUTER), two_sided(MIDDLE)], True),
    "inward, sticking out": ([OUTER, make_box((5, 5, 5), (13, 7, 7), True)], True),
    "inward, piercing both walls": ([OUTER, make_box((-1, 5, 5), (13, 7, 7), True)], True),
}


@pytest.mark.parametrize("name", NESTED)
@pytest.mark.parametrize("soup", [False, True])
def test_bodies_within_bodies_are_cavities_and_islands(name, soup):
    # Winding numbers add up; an inward body is a cavity only inside an outward body.
    parts, expected = NESTED[name]
    mesh = join_meshes(*parts)
    assert inside(separate_triangles(mesh) if soup else mesh, [IN_WALL, AT_CENTER]) == [
        True,
        expected,
    ]


@pytest.mark.parametrize("soup", [False, True])
def test_a_room_of_slabs_is_free(soup):
    low, high = np.array([0, 0, 0]), np.array([8, 8, 8])
    slabs = []
    for axis in range(3):
        unit = np.eye(3, dtype=int)[axis]
        slabs += [make_box(low, high - 6 * unit), make_box(low + 6 * unit, high)]
    room = join_meshes(*slabs)
    assert inside(
        separate_triangles(room) if soup else room, [(4.1, 4.2, 4.3), (1.1, 4.2, 4.3)]
    ) == [False, True]


def test_crossing_bars_of_opposite_orientation_are_solid_together():
    # The edges of bars of equal height meet in points and pierce no face, at inexact rotations.
    for seed in range(20):
        turn = trimesh.transformations.random_rotation_matrix(
            np.random.default_rng(seed).random(3)
        )[:3, :3]
        vertices, faces = join_meshes(
            make_box((-3, -1, -1), (3, 1, 1)), make_box((-1, -3, -1), (1, 3, 1), inward=True)
        )
        points = np.array([(0, 0, 0), (2, 0, 0), (0, 2, 0), (2, 2, 0)]) @ turn.T
        assert Mesh.of((vertices @ turn.T, faces)).contains(points).tolist() == [
            True,
            True,
            True,
            False,
        ]
