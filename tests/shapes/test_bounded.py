"""Cylinders, capsules and ellipses, which have outer and inner bounds."""

import math
from fractions import Fraction

import fcl
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

import cspace
from cspace import InputError, Robot, Rotations, Workspace
from cspace.rotations import RotationCell
from cspace.spectral import decompose
from tests.helpers import solids
from tests.helpers.handmade import half_turns
from tests.helpers.refusals import refusals

RADIUS, LENGTH = 0.31, 0.57


def in_cylinder(points, wider=0.0):
    axis, height = np.linalg.norm(points[..., :2], axis=-1), np.abs(points[..., 2])
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
@pytest.mark.parametrize("spacing", [0.05, 0.11])
def test_rasters_bound_the_exact_shape(kind, angle, spacing):
    make, inside = kind
    rng = np.random.default_rng(3)
    middle = Rotation.random(rng=rng)
    outer, inner = make(RADIUS, LENGTH).rasters(
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


def test_outer_and_inner_bounds_are_as_close_as_stated(kind):
    make, inside = kind
    shape, rng = make(RADIUS, LENGTH).shape, np.random.default_rng(4)
    outer, inner = shape.outer, shape.inner
    points = rng.uniform(-1, 1, (20_000, 3)) * (0.4, 0.4, 0.7)
    assert inside(points[outer.contains(points)], 0.0025 * RADIUS).all()
    assert outer.contains(points[inside(points)]).all()
    assert inside(points[inner.contains(points)]).all()
    assert inner.contains(points[inside(points, -0.0025 * RADIUS)]).all()


ONE_SIDED_ATTRIBUTES = (
    *(
        "boundary",
        "bounds",
        "boxes",
        "contains",
        "encloses",
        "facts",
        "inscribed_radius",
        "is_boxes",
        "measure",
    ),
    *("outline", "regions", "surface"),
)


@pytest.mark.parametrize("name", ONE_SIDED_ATTRIBUTES)
def test_bounded_shapes_lack_one_sided_attributes(kind, name):
    shape = kind[0](RADIUS, LENGTH).shape
    assert hasattr(type(shape.outer), name)
    assert hasattr(type(shape.inner), name)
    assert not hasattr(shape, name)


lengths = st.floats(0.01, 10.0)


@given(lengths, lengths, st.tuples(*[st.floats(-3.0, 3.0)] * 3))
@settings(max_examples=8)  # the footprint of a capsule takes half a second
@pytest.mark.parametrize("name", ROUND_SOLIDS)
def test_outer_and_inner_shapes_enclose_exact_values(name, radius, length, center):
    robot = ROUND_SOLIDS[name][0](radius, length, center)
    ends = 4.0 / 3.0 * math.pi * radius**3 if name == "capsule" else 0.0
    volume = math.pi * radius**2 * length + ends
    half = np.array([radius, radius, length / 2.0 + (radius if name == "capsule" else 0.0)])
    shape, flat = robot.shape, robot.footprint().shape
    assert shape.inner.measure < volume < shape.outer.measure < 1.01 * shape.inner.measure
    assert flat.inner.measure < math.pi * radius**2 < flat.outer.measure
    sizes = [np.subtract(*side.bounds[::-1]) for side in (shape.inner, shape.outer)]
    assert (sizes[0] <= 2.0 * half * (1.0 + 1e-12) + 1e-12).all()
    assert (2.0 * half <= sizes[1] * (1.0 + 1e-12) + 1e-12).all()
    fits = max(radius - math.hypot(*center[:2]), 0.0)
    assert fits - 0.002 * radius - 2e-6 <= robot.footprint().inscribed_radius <= fits
    assert flat.outer.inscribed_radius >= fits


semi_axes, coordinates = st.floats(1e-3, 1e3), st.floats(-1e5, 1e5)


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


@pytest.mark.parametrize("rotations", [None, 12])
def test_maps_of_an_ellipse_agree_with_its_equation(rotations):
    a, b = 0.43, 0.18
    workspace = Workspace.from_points(
        np.random.default_rng(0).uniform(0, 3, (12, 2)), 0.05, (0, 0, 3, 3)
    )
    points = workspace.shapes[0].centers
    space = cspace.build(workspace, Robot.ellipse(a, b), rotations=rotations, outside="free")
    q = np.random.default_rng(1).uniform(0, 3, (4000, 2))
    yaw = np.random.default_rng(2).uniform(-3, 3, 4000) * (rotations is not None)
    full = q if rotations is None else np.column_stack([q, yaw])
    x, y = np.moveaxis(points - q[:, None], -1, 0)
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    hit = ((((c * x + s * y) / a) ** 2 + ((c * y - s * x) / b) ** 2) <= 1.0).any(axis=1)
    states = space.classify(full)
    assert not hit[states == cspace.FREE].any()
    assert not hit[space.is_free(full, exact=True)].any()
    assert min(np.bincount(states, minlength=3)[[cspace.FREE, cspace.MIXED]]) > 100


@pytest.mark.parametrize("radius", [0.2, 0.3, 0.45])
def test_costs_are_positive_within_the_inflation_radius(kind, radius):
    make, _ = kind
    space = cspace.build(
        Workspace.from_array(np.eye(40, dtype=bool), 0.1),
        make(radius, 1.0).footprint(),
        outside="free",
    )
    middles = space.grid.center_of(np.indices((40, 40)).reshape(2, -1).T)
    occupied = middles[np.eye(40, dtype=bool).ravel()]
    gaps = np.maximum(np.abs(middles[:, None] - occupied) - 0.05, 0.0)
    apart = np.linalg.norm(gaps, axis=-1).min(axis=1).reshape(40, 40)
    for reach in (0.5, 0.7, 1.0):
        costs = (
            np.array(space.to_costmap(inflation_radius=reach, cost_scaling_factor=1.0).data)
            .reshape(40, 40)
            .T
        )
        assert (apart[costs == 0] > reach).all()
        assert (costs == 0).any()


@pytest.mark.parametrize("way", [{"tolerance": 0.06}, {"number": 8}], ids=["tolerance", "number"])
@pytest.mark.parametrize("side", ["inner", "outer"])
def test_bounds_of_a_decomposition_hold_for_the_exact_shape(kind, side, way):
    make, inside = kind
    balls = decompose(make(RADIUS, LENGTH).shape, kind=side, **way)
    ends = 4.0 / 3.0 * math.pi * RADIUS**3 if make == Robot.capsule else 0.0
    low, high = balls.shape_measure
    assert low < math.pi * RADIUS**2 * LENGTH + ends < high < 1.01 * low
    rng = np.random.default_rng(8)
    angle, height = rng.uniform(0, 2 * math.pi, 4000), rng.uniform(-LENGTH / 2, LENGTH / 2, 4000)
    side_points = np.stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), height], axis=1)
    points = np.concatenate([points_within(inside, rng), side_points])
    if side == "inner":
        gap = float((cdist(points, balls.centers) - balls.radii).min(axis=1).max())
    else:
        assert ((cdist(points, balls.centers) - balls.radii).min(axis=1) <= 0.0).all()
        way_out = rng.normal(size=(300, 1, 3))
        rim = balls.centers + balls.radii[:, None] * way_out / np.linalg.norm(
            way_out, axis=-1, keepdims=True
        )
        across, along = np.linalg.norm(rim[..., :2], axis=-1), np.abs(rim[..., 2])
        up = np.maximum(along - LENGTH / 2, 0.0)
        gaps = (
            np.hypot(np.maximum(across - RADIUS, 0.0), up)
            if not ends
            else np.hypot(across, up) - RADIUS
        )
        gap = float(gaps.max())
    assert gap <= balls.hausdorff.upper
    assert balls.hausdorff.lower <= gap + 0.05
    if "tolerance" in way:
        assert balls.hausdorff.upper <= 1.1 * way["tolerance"]


OBSTACLE_BOXES = (((1.0, 0.8, 0.6), (0.9, 0.8, 0.4)), ((0.3, 1.2, 1.5), (2.0, 1.2, 1.0)))


def workspace():
    mesh = trimesh.util.concatenate(
        [trimesh.creation.box(size).apply_translation(at) for size, at in OBSTACLE_BOXES]
    )
    return Workspace.from_mesh(mesh, 0.08, bounds=(0, 0, 0, 2.6, 2.2, 2.0))


@pytest.mark.parametrize(
    "rotations", [None, 8, Rotations.quaternions(1)], ids=["still", "yaw", "quaternions"]
)
def test_maps_agree_with_fcl(kind, rotations):
    make, _ = kind
    space = cspace.build(workspace(), make(RADIUS, LENGTH), rotations=rotations, outside="free")
    rng = np.random.default_rng(5)
    q = np.column_stack(
        [rng.uniform(0, (2.6, 2.2, 2.0), (800, 3)), rng.normal(size=(800, space.size - 3))]
    )
    if space.size == 7:
        q[:, 3:] /= np.linalg.norm(q[:, 3:], axis=1, keepdims=True)
    boxes = [solids.box(*each) for each in OBSTACLE_BOXES]
    robot = {"cylinder": fcl.Cylinder, "capsule": fcl.Capsule}[make.__name__](RADIUS, LENGTH)
    states = space.classify(q)
    assert min(np.bincount(states, minlength=3)) > 40
    for state, one in zip(states.tolist(), q, strict=True):
        placed = fcl.CollisionObject(
            robot, fcl.Transform(solids.rotation_of(one).as_matrix(), one[:3])
        )
        hit = any(solids.meet(placed, each) for each in boxes)
        assert state == cspace.MIXED or hit == (state == cspace.BLOCKED)


def test_an_upright_solid_needs_one_slice_unless_off_its_axis(kind):
    make, _ = kind
    one, above = make(0.2, 0.3), make(0.2, 0.3, (0, 0, 0.4))
    assert one.shape.symmetry == above.shape.symmetry == 0
    assert (half_turns(one.shape), half_turns(above.shape)) == ((0, 1, 2), (2,))
    assert make(0.2, 0.3, (0.1, 0, 0)).shape.symmetry == 1
    again = Robot.from_spec(one.spec)
    assert (again.shape.symmetry, again.shape.outer.bounds[0].tolist()) == (
        0,
        one.shape.outer.bounds[0].tolist(),
    )


def test_inner_balls_lie_in_the_exact_shape(kind):
    make, inside = kind
    balls = decompose(make(RADIUS, LENGTH).shape, kind="inner", tolerance=0.1)
    way = np.random.default_rng(6).normal(size=(500, 3))
    for center, radius in zip(balls.centers, balls.radii, strict=True):
        assert inside(center + radius * way / np.linalg.norm(way, axis=1, keepdims=True)).all()


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
    assert space.is_free((RADIUS, 0.0, 0.0), exact=True)
    assert not space.is_free((RADIUS - 0.004, 0.0, 0.0), exact=True)


@refusals(
    "make, message",
    (lambda: Robot.cylinder(0, 1), "radius is 0; it must be one number above zero"),
    (lambda: Robot.cylinder(1, -1), "height is -1"),
    (lambda: Robot.capsule(1, 0), "length is 0"),
    (lambda: Robot.capsule(float("nan"), 1), "radius is nan"),
    (lambda: Robot.cylinder(1, 1, (0, 0)), "center has shape"),
)
def test_bounded_shapes_refuse_invalid_arguments(make, message):
    with pytest.raises(InputError, match=message):
        make()
