"""Solids of bodies: shared triangles, self-intersections, orientation and nesting."""

import warnings

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from cspace import Grid, MeshWarning, make_mesh
from cspace._shapes.bodies import find_bodies
from tests.helpers.mesh_files import join_meshes, make_box
from tests.helpers.oracles import winding_numbers
from tests.helpers.strategies import examples, seeds


def separate_triangles(part):
    """Give each triangle separate vertices, as in an STL file."""
    return part[0][part[1]].reshape(-1, 3), np.arange(part[1].size).reshape(-1, 3)


def reverse_triangles(part, *numbers):
    """Reverse the orientation of some triangles."""
    faces = np.array(part[1])
    faces[list(numbers)] = faces[list(numbers), ::-1]
    return part[0], faces


def inside(part, points):
    """Test if points lie inside, after a comparison with the cells around them."""
    mesh = make_mesh(part)
    points = np.asarray(points, dtype=float)
    answers = mesh.contains(points)
    lower, upper = mesh.bounds
    grid = Grid(lower - 0.25, 0.125, tuple(np.ceil((upper - lower) / 0.125).astype(int) + 4))
    outer, inner = (cells[tuple(grid.cell_of(points).T)] for cells in mesh.cells(grid))
    assert (inner <= answers).all() and (answers <= outer).all()
    return answers.tolist()


@examples(30)
@given(seeds, st.integers(2, 20), st.booleans())
def test_coincident_boxes_are_solid_in_their_union(seed, count, is_soup):
    """Draw cells of a lattice; some share faces, and some repeat."""
    cells = np.random.default_rng(seed).integers(0, 3, (count, 3))
    solid = np.zeros((3, 3, 3), dtype=bool)
    solid[tuple(cells.T)] = True
    boxes = join_meshes(*(make_box(cell, cell + 1) for cell in cells))
    if not is_soup:
        vertices, numbers = np.unique(boxes[0], axis=0, return_inverse=True)
        boxes = vertices, numbers[boxes[1]]
    with warnings.catch_warnings(action="error"):
        mesh = make_mesh(boxes)
    centers = np.moveaxis(np.indices(solid.shape), 0, -1) + 0.5 + np.array([0.013, 0.027, 0.041])
    assert (mesh.contains(centers) == solid).all()


@examples(30)
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
        turned = np.where(
            body.multiplicities[:, None] == 1, faces[body.faces], faces[body.faces][:, ::-1]
        )
        numbers += winding_numbers(points, vertices[turned])
    assert (make_mesh((vertices, faces)).contains(points) == (numbers != 0)).all()


def test_a_box_drawn_twice_stays_solid_with_other_diagonals():
    vertices, faces = make_box((0, 0, 0), (4, 4, 4))
    mirrored = vertices[:, [1, 0, 2]], faces[:, ::-1]
    point = [(2.1, 2.2, 2.3)]
    assert inside(join_meshes((vertices, faces), mirrored), point) == [True]
    # A box drawn once for each side cancels, with a warning.
    with pytest.warns(MeshWarning, match="cancel"):
        assert inside(join_meshes((vertices, faces), (mirrored[0], faces)), point) == [False]
    with pytest.warns(MeshWarning, match="are open"):
        inside(join_meshes((vertices, faces), reverse_triangles(mirrored, 0)), point)


ONE_SIDED = {
    "open Moebius strip": [(k, (k + 1) % 5, (k + 2) % 5) for k in range(5)],
    "closed projective plane": [
        *[(5, k, (k + 1) % 5) for k in range(5)],
        *[(k, (k + 1) % 5, (k + 3) % 5) for k in range(5)],
    ],
}


@pytest.mark.parametrize("name", ONE_SIDED)
def test_a_surface_that_cannot_be_oriented_has_no_inside(name):
    vertices = np.random.default_rng(0).uniform(-2, 2, (6, 3))
    with pytest.warns(MeshWarning, match="1 of 1 bodies"):
        mesh = make_mesh((vertices, ONE_SIDED[name]))
    assert not mesh.encloses
    assert not mesh.cells(Grid((-2, -2, -2), 0.25, (16, 16, 16)))[1].any()


def inward(part):
    return part[0], part[1][:, ::-1]


def two_sided(part):
    """Add the reverse of each triangle."""
    vertices, faces = part
    return vertices, np.stack([faces, faces[:, ::-1]], axis=1).reshape(-1, 3)


OUTER, MIDDLE, INNER = (make_box((k,) * 3, (12 - k,) * 3) for k in (0, 3, 5))


NESTED = {
    "cavity": ([OUTER, inward(MIDDLE)], False),
    "island": ([OUTER, inward(MIDDLE), INNER], True),
    "inward island": ([OUTER, inward(MIDDLE), inward(INNER)], True),
    "solid": ([OUTER, MIDDLE], True),
    "all inward": ([inward(OUTER), inward(MIDDLE)], True),
    "overlapping cavities": (
        [OUTER, make_box((2,) * 3, (7,) * 3, True), make_box((4,) * 3, (10,) * 3, True)],
        True,
    ),
    "wall with a reversed triangle": ([reverse_triangles(OUTER, 0), inward(MIDDLE)], False),
    "two-sided": ([two_sided(OUTER), two_sided(inward(MIDDLE))], True),
    "inward, sticking out": ([OUTER, make_box((5, 5, 5), (13, 7, 7), True)], True),
    "inward, piercing both walls": ([OUTER, make_box((-1, 5, 5), (13, 7, 7), True)], True),
}


@pytest.mark.parametrize("name", NESTED)
def test_bodies_within_bodies_are_cavities_and_islands(name):
    # Winding numbers add up; an inward body is a cavity only inside an outward body.
    parts, expected = NESTED[name]
    mesh = separate_triangles(join_meshes(*parts))
    assert inside(mesh, [(1.5, 1.6, 1.7), (6.1, 6.2, 6.3)]) == [True, expected]
