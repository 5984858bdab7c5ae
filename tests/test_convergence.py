"""The rate of convergence: exact distances to the border of the C-obstacle, and suggestions."""

import itertools
import math

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from shapely import affinity

import cspace
from cspace import BLOCKED, FREE, MIXED, Robot, Rotations, Workspace
from cspace._rotations.quaternion import MAX_ANGLE_TIMES_PARTS
from tests.helpers.refusals import refusals
from tests.helpers.strategies import examples, seeds

CONSTANT = 2.0
"""Constant of the theorem."""

MAX_CELLS = 500
"""Maximum number of cells that are tested at a rotation."""

ROUNDING = 1.0 + 2.0**-18
"""Factor on the spacing that covers rounding."""


class Part:
    """A convex part of a robot or of the obstacles."""

    def __init__(self, vertices, radius=0.0):
        self.vertices = np.asarray(vertices)
        self.radius = radius

    def turn(self, matrix):
        return Part(self.vertices @ matrix.T, self.radius)

    def reach(self):
        return float(np.linalg.norm(self.vertices, axis=1).max()) + self.radius

    def erode(self, t):
        """Return the points whose ball of radius t lies in the part; None if there are none."""
        if len(self.vertices) == 1:
            return Part(self.vertices, self.radius - t) if t <= self.radius else None
        eroded = shapely.MultiPoint(self.vertices).convex_hull.buffer(-t, join_style="mitre")
        if eroded.is_empty:
            return None
        return Part(np.asarray(eroded.exterior.coords)[:-1])

    def distance_from(self, eroded):
        """Return how far a point of the part may be from its erosion."""
        if len(self.vertices) == 1:
            return self.radius - eroded.radius
        hull = shapely.MultiPoint(eroded.vertices).convex_hull
        return float(shapely.distance(shapely.points(self.vertices), hull).max())


class Cube(Part):
    """A rotated box in space; its corners are in the order of their coordinates before that."""

    def turn(self, matrix):
        return Cube(self.vertices @ matrix.T)

    def erode(self, t):
        edges = self.vertices[[4, 2, 1]] - self.vertices[0]
        lengths = np.linalg.norm(edges, axis=1)
        if 2.0 * t > lengths.min():
            return None
        inward = np.array(list(itertools.product((1.0, -1.0), repeat=3)))
        return Cube(self.vertices + t * inward @ (edges / lengths[:, None]))

    def distance_from(self, eroded):
        return float(np.linalg.norm(self.vertices - eroded.vertices, axis=1).max())


def signed_distances(robot, obstacle, points):
    """Return how far positions lie outside the sum of two parts; negative inside.

    Outside, in space, it is a lower bound.
    """
    differences = (obstacle.vertices[:, None] - robot.vertices).reshape(-1, points.shape[1])
    radius = robot.radius + obstacle.radius
    if points.shape[1] == 3:
        equations = ConvexHull(differences).equations
        return (points @ equations[:, :3].T + equations[:, 3]).max(axis=1) - radius
    hull = shapely.MultiPoint(differences).convex_hull
    places = shapely.points(points)
    outside = shapely.distance(hull, places)
    inside = shapely.distance(hull.boundary, places)
    return np.where(shapely.covers(hull, places), -inside, outside) - radius


def check_rate(space, robots, obstacles, rng, constant=CONSTANT, depth=1.0):
    """Assert the theorems at the corners of MIXED cells.

    Return the largest distance of a corner outside the C-obstacle, over the bound.
    """
    largest = 0.0
    spacing = space.grid.spacing * ROUNDING
    dim = space.grid.dim
    diagonal = spacing * math.sqrt(dim)
    corners = np.array(list(itertools.product((0, 1), repeat=dim)))
    for cell, q in draw_rotations(space.rotations, rng):
        matrix = space.rotations.make_matrices(q, dim)
        angle = space.rotations.covering_angles[cell]
        states = space.states_at(q) if len(q) else space.states_at()
        reach = max(part.reach() for part in robots)
        growth = 2.0 * reach * math.sin(min(angle, math.pi) / 2.0)
        cells = rng.permutation(np.argwhere(states == MIXED))[:MAX_CELLS]
        points = space.grid.lower + space.grid.spacing * (cells[:, None] + corners)
        points = points.reshape(-1, dim)
        nearest = np.full(len(points), np.inf)
        for robot, obstacle in itertools.product(robots, obstacles):
            distances = signed_distances(robot.turn(matrix), obstacle, points)
            nearest = np.minimum(nearest, distances)
            inner_obstacle = obstacle.erode(depth * diagonal)
            inner_robot = robot.erode(depth * (diagonal + 2.0 * growth))
            if inner_obstacle is None or inner_robot is None:
                continue
            overlaps = signed_distances(inner_robot.turn(matrix), inner_obstacle, points) < -1e-12
            assert not overlaps.any(), "theorem 2"
            deepest = obstacle.distance_from(inner_obstacle) + robot.distance_from(inner_robot)
            assert (distances >= -deepest - 1e-9).all(), "theorem 3"
        bound = constant * (diagonal + growth)
        assert (nearest <= bound).all(), "theorem 1"
        largest = max(largest, float(nearest.max(initial=0.0)) / bound)
    return largest


def draw_rotations(rotations, rng):
    """Yield rotation cells, and rotations in them, at borders too."""
    if not rotations.names:
        yield 0, np.empty(0)
        return
    for cell in rng.choice(len(rotations), min(3, len(rotations)), replace=False):
        if rotations._about_z:
            low, high = rotations.borders[cell : cell + 2]
            for share in (1e-7, 0.5, rng.random(), 1.0 - 1e-7):
                yield cell, np.array([low + share * (high - low)])
        else:
            yield cell, rotations._sample(np.array([cell]), 0.0, rng)[0]


def draw_polygon(rng, size, place):
    """Draw the corners of a convex polygon around a place."""
    points = rng.uniform(-size, size, (int(rng.integers(3, 9)), 2)) + rng.uniform(-place, place, 2)
    return np.asarray(shapely.MultiPoint(points).convex_hull.exterior.coords)[:-1]


def draw_plane(rng, kind, spacing, rotations):
    """Build a map of random parts in the plane, with these parts."""
    if kind == "discs":
        centers = rng.uniform(-0.4, 0.4, (2, 2))
        radii = rng.uniform(0.1, 0.6, 2)
        robots = [Part([center], radius) for center, radius in zip(centers, radii, strict=True)]
        robot = Robot.from_balls(centers, radii)
    else:
        size = rng.uniform(0.4, 1.1)
        robots = [Part(draw_polygon(rng, size, 0.3)) for _ in range(rng.integers(1, 3))]
        robot = Robot.polygon([shapely.Polygon(part.vertices) for part in robots])
    obstacles = [Part(draw_polygon(rng, 1.0, 0.7)) for _ in range(rng.integers(1, 4))]
    polygons = [shapely.Polygon(part.vertices) for part in obstacles]
    low = rng.uniform(-2.0, -1.8, 2)
    workspace = Workspace.from_polygons(polygons, spacing, bounds=(*low, 1.8, 1.8))
    space = cspace.build(workspace, robot, rotations=rotations, outside="free")
    return space, robots, obstacles


@examples(20)
@given(seeds, st.sampled_from(["discs", "polygons"]), st.sampled_from([None, 5, 60]))
def test_maps_of_the_plane_decide_all_beyond_the_bound(seed, kind, rotations):
    rng = np.random.default_rng(seed)
    spacing = float(rng.choice([0.05, 0.09, 0.17]))
    check_rate(*draw_plane(rng, kind, spacing, rotations), rng)


@examples(8)
@given(seeds, st.sampled_from([None, 36, "all"]))
def test_maps_of_space_decide_all_beyond_the_bound(seed, rotations):
    rng = np.random.default_rng(seed)
    if rotations == "all":
        rotations = Rotations.quaternions(4)
    sides = rng.uniform(0.4, 1.1, 3)
    center = rng.uniform(-0.3, 0.3, 3)
    cube = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
    robots = [Cube(center + sides * cube)]
    obstacle_sides = rng.uniform(0.5, 1.4, 3)
    turn = Rotation.random(random_state=rng).as_matrix()
    obstacles = [Cube(obstacle_sides * cube @ turn.T)]
    mesh = trimesh.convex.convex_hull(obstacles[0].vertices)
    bounds = (-1.3, -1.35, -1.2, 1.3, 1.2, 1.25)
    workspace = Workspace.from_mesh(mesh, 0.1, bounds=bounds)
    robot = Robot.box(sides, center)
    space = cspace.build(workspace, robot, rotations=rotations, outside="free")
    check_rate(space, robots, obstacles, rng)


@pytest.mark.filterwarnings("ignore::cspace.UnitWarning")  # points
@pytest.mark.parametrize("rotations, least", [(None, 0.99), (24, 0.9)])
def test_the_constant_is_sharp(rotations, least):
    # A point near the upper corner of its cell; a robot that is one, far from the axis if it turns.
    spacing = 0.05
    tiny = 1e-6 * np.array([(-1, -1), (1, -1), (0, 1)])
    obstacle = Part(tiny + 0.998 * spacing)
    robot = Part(tiny + (3.0 if rotations else 0.001 * spacing))
    reach = 5.0 if rotations else 0.2
    polygon = shapely.Polygon(obstacle.vertices)
    workspace = Workspace.from_polygons([polygon], spacing, bounds=(-reach, -reach, reach, reach))
    options = {"rotations": rotations, "outside": "free"}
    space = cspace.build(workspace, Robot.polygon(robot.vertices), **options)
    assert least <= check_rate(space, [robot], [obstacle], np.random.default_rng(0)) <= 1.0
    with pytest.raises(AssertionError):
        check_rate(space, [robot], [obstacle], np.random.default_rng(0), constant=2.0 * least)


def test_the_depth_of_blocked_cells_is_sharp():
    # A square on an arm, deep in a large obstacle: two thirds of its depth are too little.
    corners = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    square = 3.0 + 0.9 * corners
    robot = Part(square)
    obstacle = Part(1.5 * corners)
    polygon = shapely.Polygon(obstacle.vertices)
    workspace = Workspace.from_polygons([polygon], 0.04, bounds=(-7.0, -7.0, 7.0, 7.0))
    space = cspace.build(workspace, Robot.polygon(square), rotations=120, outside="free")
    check_rate(space, [robot], [obstacle], np.random.default_rng(0))
    with pytest.raises(AssertionError, match="theorem 2"):
        check_rate(space, [robot], [obstacle], np.random.default_rng(0), depth=0.65)


def test_bodies_without_inside_are_never_blocked():
    wall = shapely.LineString([(-1.0, 0.0), (1.0, 0.0)])
    for spacing in (0.1, 0.02):
        workspace = Workspace.from_polygons([wall], spacing, bounds=(-2.0, -2.0, 2.0, 2.0))
        space = cspace.build(workspace, Robot.disc(0.5), outside="free")
        assert space.classify((0.0, 0.0)) == MIXED
        assert space.classify((0.0, 0.5 + 3.0 * spacing)) == FREE


def test_depth_in_a_union_decides_nothing():
    # A square a hair larger than a hole: contact all around, a deep overlap nowhere.
    block = shapely.box(-2.0, -2.0, 2.0, 2.0)
    ring = block.difference(shapely.box(-0.5, -0.5, 0.5, 0.5))
    workspace = Workspace.from_polygons([ring], 0.03, bounds=(-2.0, -2.0, 2.0, 2.0))
    for side, state in ((1.004, MIXED), (1.2, BLOCKED)):
        robot = Robot.rectangle(side, side)
        assert cspace.build(workspace, robot, outside="free").classify((0.0, 0.0)) == state


def draw_doorway(rng, gap, workspace_spacing, thickness=0.6):
    """Draw a wall in any direction with a gap anywhere in it.

    Returns the workspace and a position on either side.
    """
    turn = rng.uniform(0.0, 180.0)
    middle = rng.uniform(-0.3, 0.3)
    walls = [
        shapely.box(-9.0, -thickness / 2.0, middle - gap / 2.0, thickness / 2.0),
        shapely.box(middle + gap / 2.0, -thickness / 2.0, 9.0, thickness / 2.0),
    ]
    turned = [affinity.rotate(wall, turn, origin=(0.0, 0.0)) for wall in walls]
    bounds = (-2.6, -2.6, 2.6, 2.6)
    inside = [wall.intersection(shapely.box(*bounds)) for wall in turned]
    workspace = Workspace.from_polygons(inside, workspace_spacing, bounds=bounds)
    normal = np.array([-math.sin(math.radians(turn)), math.cos(math.radians(turn))])
    return workspace, 1.5 * normal, -1.5 * normal


@examples(8)
@given(seeds, st.sampled_from(["disc", "rectangle", "balls"]), st.floats(0.08, 0.3))
def test_maps_as_suggested_find_the_gap_and_prove_narrower_ones_shut(seed, kind, excess):
    rng = np.random.default_rng(seed)
    radius = rng.uniform(0.25, 0.4)
    robot = {
        "disc": Robot.disc(radius),
        "rectangle": Robot.rectangle(2.6 * radius, 2.0 * radius),
        "balls": Robot.from_balls([[0.0, 0.0], [0.2, 0.1]], [radius, radius]),
    }[kind]
    gap = 2.0 * radius + max(excess, 0.14 if kind != "disc" else 0.0)
    workspace, start, goal = draw_doorway(rng, gap, 0.1)
    suggestion = cspace.suggest(workspace, robot, gap=gap)
    for width, is_open in ((gap, True), (4.0 * radius - gap, False)):
        workspace, start, goal = draw_doorway(rng, width, suggestion.spacing)
        space = cspace.build(workspace, robot, rotations=suggestion.rotations)
        yaw = () if suggestion.rotations is None else (0.3,)
        assert space.is_connected((*start, *yaw), (*goal, *yaw)) == is_open
        assert space.is_disconnected((*start, *yaw), (*goal, *yaw)) != is_open


@pytest.mark.parametrize("rotations, turn", [("yaw", (0.0,)), ("all", (0.0, 0.0, 0.0, 1.0))])
def test_suggestions_in_space_find_the_gap(rotations, turn):
    walls = ["box:1.3x0.8x2@-1.35,0,0", "box:1.3x0.8x2@1.35,0,0"]  # 1.4 m apart
    bounds = (-1.2, -1.4, -0.7, 1.2, 1.4, 0.7)
    robot = Robot.box((0.8, 0.4, 0.3))
    workspace = Workspace.from_shapes(walls, 0.1, bounds)
    suggestion = cspace.suggest(workspace, robot, gap=1.4, rotations=rotations)
    workspace = Workspace.from_shapes(walls, suggestion.spacing, bounds)
    space = cspace.build(workspace, robot, rotations=suggestion.rotations)
    assert suggestion.memory == space.grid.size * len(space.slice_rotations)
    assert space.is_connected((0.0, -0.95, 0.0, *turn), (0.0, 0.95, 0.0, *turn))


def test_covering_angles_times_parts_are_bounded():
    for n in (*range(1, 12), 32):
        assert Rotations.quaternions(n).covering_angles.max() * n <= MAX_ANGLE_TIMES_PARTS


PLANE = Workspace.from_array(np.zeros((40, 40), bool), 0.1)


@refusals(
    "workspace, robot, options, text",
    (PLANE, "rect:0.9x0.6", {"gap": 0.0}, "gap is 0"),
    (PLANE, "rect:0.9x0.6", {"gap": math.nan}, "gap is nan"),
    (PLANE, "rect:0.9x0.6", {"gap": 0.6}, "gap is 0.6 m and the robot is 0.6 m wide"),
    (PLANE, "rect:0.9x0.6", {"gap": 1.0, "rotations": "fixed"}, "robot is 1.08167 m wide"),
    (PLANE, "rect:0.9x0.6", {"gap": 0.6001}, "needs rotation cells smaller than"),
    (PLANE, "disc:0.3", {"gap": math.nextafter(0.6, 1.0)}, "gap needs cells of"),
    (PLANE, "disc:0.3", {"gap": 0.8, "rotations": "roll"}, "rotations"),
    (PLANE, "rect:0.9x0.6", {"gap": 0.8, "rotations": "all"}, "rotations are"),
    (PLANE, "box:1x1x1", {"gap": 0.8}, "robot has 3 dimensions"),
    ("map.yaml", "disc:0.3", {"gap": 0.8}, "workspace is 'map.yaml'"),
)
def test_suggest_refuses(workspace, robot, options, text):
    with pytest.raises(cspace.InputError, match=text):
        cspace.suggest(workspace, robot, **options)
