"""Cylinders, capsules and ellipses, which have outer and inner bounds."""

import json
import math
from fractions import Fraction

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import cspace
from cspace import Robot, Workspace
from cspace._rotations import RotationCell
from tests.helpers.handmade import half_turns
from tests.helpers.strategies import examples

RADIUS = 0.31
LENGTH = 0.57


def in_cylinder(points, wider=0.0):
    axis = np.linalg.norm(points[..., :2], axis=-1)
    height = np.abs(points[..., 2])
    return (axis <= RADIUS + wider) & (height <= LENGTH / 2 + wider)


def in_capsule(points, wider=0.0):
    height = np.clip(points[..., 2], -LENGTH / 2, LENGTH / 2)
    return (
        np.linalg.norm(points - np.stack([0 * height, 0 * height, height], axis=-1), axis=-1)
        <= RADIUS + wider
    )


ROUND_SOLIDS = {"cylinder": (Robot.cylinder, in_cylinder), "capsule": (Robot.capsule, in_capsule)}


@pytest.fixture(params=ROUND_SOLIDS)
def kind(request):
    return ROUND_SOLIDS[request.param]


def points_within(inside, rng, count=3000):
    points = rng.uniform(-1, 1, (20 * count, 3)) * (RADIUS, RADIUS, LENGTH / 2 + RADIUS)
    return points[inside(points)][:count]


@pytest.mark.parametrize("angle", [0.0, 0.2])
def test_rasters_bound_the_exact_shape(kind, angle):
    make, inside = kind
    spacing = 0.07
    rng = np.random.default_rng(3)
    middle = Rotation.random(rng=rng)
    outer, inner = make(RADIUS, LENGTH).shape.rasters(
        spacing, 0.0, RotationCell(middle.as_matrix(), angle)
    )
    for _ in range(4):
        axis = rng.normal(size=3)
        turn = (
            Rotation.from_rotvec(
                axis / np.linalg.norm(axis) * rng.choice([angle, angle * rng.random()])
            )
            * middle
        )
        points = turn.apply(points_within(inside, rng)) / spacing
        for corner in np.ndindex(2, 2, 2):
            offsets = np.floor(points).astype(int) + corner - outer.lower
            assert outer.cells[tuple(offsets.T)].all()
        lattice = spacing * (np.argwhere(inner.cells) + inner.lower)
        assert len(lattice) > 10
        assert inside(turn.inv().apply(lattice)).all()


lengths = st.floats(0.01, 10.0)


@given(lengths, lengths, st.tuples(*[st.floats(-3.0, 3.0)] * 3))
@examples(4)  # the footprint of a capsule takes half a second
@pytest.mark.parametrize("name", ROUND_SOLIDS)
def test_outer_and_inner_shapes_enclose_exact_values(name, radius, length, center):
    robot = ROUND_SOLIDS[name][0](radius, length, center)
    ends = 4.0 / 3.0 * math.pi * radius**3 if name == "capsule" else 0.0
    volume = math.pi * radius**2 * length + ends
    half = np.array([radius, radius, length / 2.0 + (radius if name == "capsule" else 0.0)])
    shape = robot.shape
    flat = robot.footprint().shape
    assert shape.inner.measure < volume < shape.outer.measure < 1.01 * shape.inner.measure
    assert flat.inner.measure < math.pi * radius**2 < flat.outer.measure
    sizes = [np.subtract(*side.bounds[::-1]) for side in (shape.inner, shape.outer)]
    assert (sizes[0] <= 2.0 * half * (1.0 + 1e-12) + 1e-12).all()
    assert (2.0 * half <= sizes[1] * (1.0 + 1e-12) + 1e-12).all()
    fits = max(radius - math.hypot(*center[:2]), 0.0)
    assert fits - 0.002 * radius - 2e-6 <= robot.footprint().shape.inner.inscribed_radius <= fits
    assert flat.outer.inscribed_radius >= fits


def test_a_capsule_without_length_is_a_ball():
    shape = Robot.capsule(0.5, 0.0).shape
    volume = 4.0 / 3.0 * math.pi * 0.5**3
    assert shape.inner.measure < volume < shape.outer.measure < 1.01 * shape.inner.measure
    radii = [np.linalg.norm(side.vertices, axis=1) for side in (shape.inner, shape.outer)]
    assert 0.49 < radii[0].min() <= radii[0].max() <= 0.5 <= radii[1].max() < 0.51


semi_axes = st.floats(1e-3, 1e3)
coordinates = st.floats(-1e5, 1e5)


@given(semi_axes, semi_axes, st.tuples(coordinates, coordinates))
def test_an_ellipse_lies_between_its_polygons_in_rational_arithmetic(a, b, center):
    shape = Robot.ellipse(a, b, center).shape

    def scaled(side):
        """Scale the corners so that the ellipse becomes the unit circle."""
        points = np.asarray(side.geometries[0].exterior.coords)[:-1]
        return [
            tuple(
                (Fraction(x) - Fraction(c)) / Fraction(r)
                for x, c, r in zip(p, center, (a, b), strict=True)
            )
            for p in points.tolist()
        ]

    assert all(x * x + y * y <= 1 for x, y in scaled(shape.inner))
    corners = scaled(shape.outer)
    for (x, y), (u, v) in zip(corners, [*corners[1:], corners[0]], strict=True):
        across = x * v - y * u
        assert across > 0
        assert across**2 >= (u - x) ** 2 + (v - y) ** 2
    assert max(x * x + y * y for x, y in corners) < Fraction(1.0025)


def test_an_ellipse_has_two_mirror_axes():
    assert Robot.ellipse(0.5, 0.3).shape.symmetry == 2
    assert Robot.ellipse(0.5, 0.5).shape.symmetry == 0
    assert Robot.ellipse(0.5, 0.3, (0.1, 0)).shape.symmetry == 1
    again = Robot.from_spec(Robot.ellipse(0.5, 0.5).spec)
    assert again.shape.is_round


def test_an_ellipse_of_numbers_of_numpy_has_a_description_in_plain_ones():
    radii = np.float64(0.5), np.float64(0.3)
    assert json.dumps(Robot.ellipse(*radii).spec) == json.dumps(Robot.ellipse(0.5, 0.3).spec)


def test_an_upright_solid_needs_one_slice_unless_off_its_axis(kind):
    make, _ = kind
    one = make(0.2, 0.3)
    above = make(0.2, 0.3, (0, 0, 0.4))
    assert one.shape.symmetry == above.shape.symmetry == 0
    assert (half_turns(one.shape), half_turns(above.shape)) == ((0, 1, 2), (2,))
    assert make(0.2, 0.3, (0.1, 0, 0)).shape.symmetry == 1
    again = Robot.from_spec(one.spec)
    assert (again.shape.symmetry, again.shape.outer.bounds[0].tolist()) == (
        0,
        one.shape.outer.bounds[0].tolist(),
    )


def test_exact_queries_use_the_outer_shape(kind):
    # The walls are hardly farther apart than the shape is wide.
    make, _ = kind
    walls = [
        trimesh.creation.box((0.2, 2, 2)).apply_translation((x, 0, 0))
        for x in (-0.1 - 0.003, 2 * RADIUS + 0.103)
    ]
    around = Workspace.from_mesh(
        trimesh.util.concatenate(walls), 0.1, bounds=(-0.2, -1, -1, 0.8, 1, 1)
    )
    space = cspace.build(around, make(RADIUS, LENGTH), outside="free")
    assert space.classify((RADIUS, 0.0, 0.0)) == cspace.MIXED
    assert space.exact.is_free((RADIUS, 0.0, 0.0))
    assert not space.exact.is_free((RADIUS - 0.004, 0.0, 0.0))
