"""Nearest points of robot and obstacles, against shapely in the plane and FCL in space."""

import fcl
import numpy as np
import pytest
import scipy.optimize
import shapely
import trimesh
from hypothesis import assume, given
from scipy.spatial.transform import Rotation

import cspace
from cspace import InputError, Robot, Workspace
from tests.helpers import solids
from tests.helpers.regions import place_polygon
from tests.helpers.strategies import examples, seeds

ROBOT = shapely.Polygon([(-0.4, -0.2), (0.5, -0.2), (0.3, 0.3), (-0.4, 0.2)])
SIDES = np.array([0.5, 0.3, 0.4])


def place(q):
    """Return the robot's polygon at a configuration."""
    return place_polygon(ROBOT, q[np.newaxis])[0]


def differentiate(measure, q, rates):
    """Return derivatives by central differences, along each of the rates."""
    step = 1e-6
    return np.array([(measure(q, step * rate) - measure(q, -step * rate)) for rate in rates]) / (
        2.0 * step
    )


@pytest.mark.parametrize("margin", [0.0, 0.1])
@examples(15)
@given(seeds)
def test_points_and_gradients_in_the_plane_are_shapelys(margin, seed):
    rng = np.random.default_rng(seed)
    shapes = [
        shapely.box(*low, *(low + rng.uniform(0.2, 1.0, 2)))
        for low in rng.uniform(0.5, 4.5, (3, 2))
    ]
    workspace = Workspace.from_polygons(shapes, spacing=0.1, bounds=((0, 0), (6, 6)))
    space = cspace.build(
        workspace, Robot.polygon(ROBOT), rotations=12, margin=margin, outside="free"
    )
    obstacles = shapely.union_all(shapes)
    rows = rng.uniform((0.0, 0.0, -3.0), (6.0, 6.0, 3.0), (200, 3))
    gaps = shapely.distance(place_polygon(ROBOT, rows), obstacles)
    # One in two lies within the margin.
    near = np.argmin(np.where(gaps > 1e-3, gaps, np.inf)) if rng.random() < 0.5 else 0
    q = rows[near]

    def measure(q, step):
        return shapely.distance(place(q + step), obstacles)

    line = shapely.shortest_line(place(q), obstacles)
    assume(line.length > 1e-3)
    found = space.closest(q)
    assert found.distance <= line.length + 1e-9
    if space.exact.is_free(q):
        assert found.distance == pytest.approx(line.length, abs=1e-6)
    points = shapely.points(found.points)
    assert shapely.distance(points[0], place(q)) < 1e-9
    assert shapely.distance(points[1], obstacles) < 1e-9
    assert points[0].distance(points[1]) == pytest.approx(line.length, abs=1e-9)
    slopes = np.array([differentiate(measure, q, [rate])[0] for rate in np.eye(3)])
    # Where two pairs are equally near, the distance has no derivative.
    ahead = (measure(q, 1e-5 * slopes) - line.length) / 1e-5
    assume(abs(ahead - slopes @ slopes) < 1e-3)
    np.testing.assert_allclose(found.gradient, slopes, atol=1e-3)


@pytest.mark.parametrize("name, inflate", [("disc", 0.3), ("polygon", 0.0), ("ring", 0.0)])
def test_in_a_collision_the_gradient_is_zero(name, inflate):
    """Shallow overlaps, whole robots in an obstacle, and obstacles in the hole of a ring."""
    ring = shapely.box(-0.9, -0.9, 0.9, 0.9).difference(shapely.box(-0.8, -0.8, 0.8, 0.8))
    outline = {"disc": shapely.Point(0, 0), "polygon": ROBOT, "ring": ring}[name]
    robot = Robot.disc(inflate) if inflate else Robot.polygon(outline)
    obstacles = shapely.union(shapely.box(1, 1, 3, 3), shapely.box(4.5, 1, 4.9, 1.4))
    workspace = Workspace.from_polygons([obstacles], spacing=0.1, bounds=((0, 0), (6, 4)))
    space = cspace.build(workspace, robot, margin=0.05, outside="free")
    is_still = 0
    for x, y in np.random.default_rng(0).uniform((0.3, 0.3), (5.7, 3.7), (100, 2)):
        gap = shapely.affinity.translate(outline, x, y).distance(obstacles) - inflate
        length = np.linalg.norm(space.closest((x, y)).gradient)
        assert length == pytest.approx(float(gap > 0.0)) or abs(gap) < 1e-6
        is_still += length == 0.0
    assert 20 < is_still < 95


@pytest.mark.parametrize("radius", [0.0, 0.25])
def test_in_a_collision_in_space_the_gradient_is_zero(radius):
    sides = np.full(3, 1.4)
    mesh = trimesh.creation.box(
        sides, transform=trimesh.transformations.translation_matrix([2] * 3)
    )
    workspace = Workspace.from_mesh(mesh, 0.2, bounds=((0, 0, 0), (4, 4, 4)))
    robot = Robot.ball(radius) if radius else Robot.box(SIDES)
    space = cspace.build(workspace, robot, outside="free")
    half = 0.5 * (sides + (0.0 if radius else SIDES))
    is_still = 0
    for q in np.random.default_rng(0).uniform(0.8, 3.2, (60, 3)):
        gap = np.linalg.norm(np.maximum(np.abs(q - 2.0) - half, 0.0)) - radius
        length = np.linalg.norm(space.closest(q).gradient)
        assert length == pytest.approx(float(gap > 0.0)) or abs(gap) < 1e-6
        is_still += length == 0.0
    assert 10 < is_still < 50


@pytest.mark.parametrize("kind", ["turning", "floor", "still"])
@examples(8)
@given(seeds)
def test_points_in_space_are_fcls(kind, seed):
    rng = np.random.default_rng(seed)
    cells = np.zeros((16, 16, 12), dtype=bool)
    i, j, k = rng.integers(2, 9, 3)
    cells[i : i + 4, j : j + 3, k : k + 3] = True
    workspace = Workspace.from_array(cells, 0.25)
    options = {
        "turning": {"rotations": cspace.Rotations.quaternions(2)},
        "floor": {"rotations": 8, "floor": 0.7},
        "still": {},
    }[kind]
    space = cspace.build(workspace, Robot.box(SIDES), outside="free", **options)
    position = rng.uniform(0.3, 3.0, 3)
    turn = Rotation.identity()
    if kind == "turning":
        turn = Rotation.random(random_state=seed)
    if kind == "floor":
        position[2] = 0.7
        turn = Rotation.from_euler("z", rng.uniform(-3.0, 3.0))
    rotation = {"turning": turn.as_quat(), "floor": [turn.as_rotvec()[2]], "still": []}[kind]
    q = np.concatenate([position[:2] if kind == "floor" else position, rotation])
    low, sides = 0.25 * np.array([i, j, k]), 0.25 * np.array([4, 3, 3])
    block = solids.box(sides, low + sides / 2.0)

    def measure(q, step):
        placed = position.copy()
        placed[: space.dim] += step[: space.dim]
        turned = Rotation.from_rotvec(np.pad(step[space.dim :], (3 - len(step[space.dim :]), 0)))
        robot = solids.box(SIDES, placed, (turned * turn).as_matrix())
        return fcl.distance(robot, block, fcl.DistanceRequest(), fcl.DistanceResult())

    rates = np.eye({"turning": 6, "floor": 3, "still": 3}[kind])
    distance = measure(q, 0.0 * rates[0])
    assume(distance > 0.05)
    found = space.closest(q)
    assert found.points.shape == (2, 3)
    assert np.linalg.norm(found.points[0] - found.points[1]) == pytest.approx(distance, abs=1e-5)
    assert found.distance == pytest.approx(distance, abs=1e-5)
    seen = turn.inv().apply(found.points[0] - position)
    assert (np.abs(seen) <= SIDES / 2.0 + 1e-9).all()
    assert (np.abs(found.points[1] - low - sides / 2.0) <= sides / 2.0 + 1e-9).all()
    step = 1e-3
    for rate, slope in zip(rates, found.gradient, strict=True):
        # A distance of convex bodies has one-sided slopes.
        change = [(measure(q, way * step * rate) - distance) / step for way in (1.0, -1.0)]
        assert min(change[0], -change[1]) - 0.02 <= slope <= max(change[0], -change[1]) + 0.02


def test_balls_walls_and_obstacles_that_the_robot_touches():
    empty = Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1)
    found = cspace.build(empty, Robot.disc(0.3)).closest((0.5, 1.4))
    np.testing.assert_allclose(found.points, [(0.2, 1.4), (0.0, 1.4)], atol=1e-9)
    np.testing.assert_allclose(found.gradient, [1.0, 0.0], atol=1e-9)
    assert found.distance == pytest.approx(0.2, abs=1e-6)
    touching = cspace.build(empty, Robot.disc(0.3)).closest((0.2, 1.4))
    assert touching.distance == 0.0


def test_without_obstacles_and_on_maps_of_joints_nothing_is_closest():
    empty = Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1)
    space = cspace.build(empty, Robot.disc(0.3), outside="free")
    with pytest.raises(InputError, match="obstacles are none; there is nothing to touch"):
        space.closest((1.0, 1.0))
    with pytest.raises(InputError, match="q has"):
        space.closest([(1.0, 1.0), (2.0, 1.0)])


def test_nearest_points_of_large_hulls_need_few_pairs_of_corners(monkeypatch):
    """All pairs of two balls of 162 corners would be 26,244 columns."""
    columns = []
    solve = scipy.optimize.lsq_linear

    def count(equations, *arguments, **options):
        columns.append(equations.shape[1])
        return solve(equations, *arguments, **options)

    monkeypatch.setattr(scipy.optimize, "lsq_linear", count)
    ball, wall = (trimesh.creation.icosphere(2, radius) for radius in (0.3, 0.4))
    workspace = Workspace.from_mesh(wall, 0.2, (-2, -2, -2, 2, 2, 2))
    space = cspace.build(workspace, Robot.from_mesh(ball), outside="free")
    found = space.closest((0.7, 0.5, 0.4))
    assert np.linalg.norm(np.subtract(*found.points)) == pytest.approx(found.distance, abs=1e-9)
    assert max(columns) < 30
