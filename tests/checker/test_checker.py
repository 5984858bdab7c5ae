"""The checker shows what is true by 10 micrometres, and refuses what is false by as much."""

import ast
import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from tests.checker import apart, bodies, no_path, pieces, plane
from tests.checker.verdict import FREE, NOT_SHOWN, PROVEN, TOUCHES, Budget

TINY = 1e-5
LARGE = Budget(10**7)
BOX = np.array([(-0.4, -0.2), (0.4, -0.2), (0.4, 0.2), (-0.4, 0.2)])
SIDES = [[0, 1, 3], [0, 3, 2], [0, 4, 5], [0, 5, 1], [0, 2, 6], [0, 6, 4]]
SIDES += [[4, 6, 7], [4, 7, 5], [2, 3, 7], [2, 7, 6], [1, 5, 7], [1, 7, 3]]


def box(low, high):
    """Return the triangles of a box."""
    corners = np.array([[n >> 2 & 1, n >> 1 & 1, n & 1] for n in range(8)])
    return np.where(corners, high, low)[SIDES]


def check_flat(motion, parts, shapes, **options):
    """Check a motion in the plane."""
    return plane.check_plane(motion, parts, plane.Plane(shapes, **options), LARGE).kind


@pytest.mark.parametrize("gap", [TINY, -TINY])
def test_gaps_are_decided(gap):
    expected = FREE if gap > 0.0 else TOUCHES
    part, disc = plane.Part(BOX), plane.Part(np.zeros((1, 2)), 0.3)
    # A box drives along a wall, a disc past a corner, and a box along the border of its room.
    wall = shapely.box(0.0, -3.0, 9.0, -0.2 - gap)
    line = pieces.make_lines([(0.0, 0.0, 0.0), (8.0, 0.0, 0.0)], [2])
    assert check_flat(line, [part], [wall]) == expected
    diagonal = pieces.make_lines([(0.0, 0.0), (4.0, 4.0)])
    corner = shapely.box(2.0 + (0.3 + gap) * math.sqrt(2.0), 0.0, 5.0, 2.0)
    assert check_flat(diagonal, [disc], [corner]) == expected
    post = shapely.Point(2.0 + (0.5 + gap) * math.sqrt(0.5), 2.0 - (0.5 + gap) * math.sqrt(0.5))
    assert check_flat(diagonal, [disc], [post], radii=0.2) == expected
    assert check_flat(line, [part], [], room=[(-0.4, -0.2 - gap), (9.0, 1.0)]) == expected
    # A box turns on the spot beside a wall, a point drives an arc around a disc.
    reach = math.hypot(0.4, 0.2)
    turn = pieces.make_lines([(0.0, 0.0, 2.5), (0.0, 0.0, -2.5)], [2])
    assert check_flat(turn, [part], [shapely.box(-1.0, reach + gap, 1.0, 2.0)]) == FREE
    assert check_flat(turn, [part], [shapely.box(-2.0, -1.0, -reach - gap, 1.0)]) == expected
    arc = pieces.make_arcs(np.array([(1.0, 0.0, math.pi / 2)]), [(0.0, 2.5, 2.5)])
    ahead = plane.Part(np.array([(0.0, 0.0), (0.3, 0.0)]))
    assert check_flat(arc, [ahead], [shapely.Point(0.0, 0.0)], radii=1.0 - gap) == expected
    # A disc drives past another one, whose error grows.
    discs = [
        apart.Timed(
            [disc], lambda t: np.stack([t - 2.0, 0.0 * t], 1), lambda t0, t1: (1.0 + 0.0 * t0, 0.0)
        ),
        apart.Timed(
            [disc],
            lambda t: np.tile((0.0, 0.8 + gap), (len(t), 1)),
            lambda t0, t1: (0.0, 0.0),
            0.0,
            0.1,
        ),
    ]
    assert apart.check_apart(*discs, 0.0, 2.0, LARGE).kind == expected
    assert apart.check_apart(*discs, 0.0, 1.9, LARGE, 0.01).kind == FREE


@pytest.mark.parametrize("gap", [0.02, -0.02])
def test_gaps_in_space_are_decided(gap):
    expected = FREE if gap > 0.0 else TOUCHES
    brick = bodies.Body(box((-0.4, -0.2, -0.1), (0.4, 0.2, 0.1)))
    for wall in (
        bodies.Body(box((0.0, 0.2 + gap, -1.0), (9.0, 1.0, 1.0))),
        bodies.Body(centers=[(3.0, 0.5 + gap, 0.0)], radii=[0.3]),
    ):
        line = pieces.make_lines([(0.0, 0.0, 0.0, 0.0), (8.0, 0.0, 0.0, 0.0)], [3])
        assert bodies.check_solid(line, brick, [wall], LARGE).kind == expected
    room = np.array([(-0.4, -0.2 - gap, -1.0), (9.0, 1.0, 1.0)])
    assert bodies.check_solid(line, brick, [], LARGE, room=room).kind == expected
    spin = np.array([(0.0, 0.0, 0.0, 1.0), (0.0, math.sqrt(0.5), 0.0, -math.sqrt(0.5))])
    turn = pieces.make_lines(np.zeros((2, 6)), (), spin)
    floor = bodies.Body(box((-1.0, -1.0, -2.0), (1.0, 1.0, -math.hypot(0.4, 0.1) - gap)))
    assert bodies.check_solid(turn, brick, [floor], LARGE).kind == expected
    inside = bodies.Body(box((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)))
    assert bodies.check_solid(turn, brick, [inside], LARGE).kind == TOUCHES
    # Two links of 1 m: the arm folds, and its tip passes a wall and its own base.
    frames = np.tile(np.eye(4), (3, 1, 1))
    frames[2, 0, 3] = 1.0
    axes, still = np.tile((0.0, 0.0, 1.0), (3, 1)), np.zeros(3)
    chain = bodies.Chain(
        np.array([0, 0, 1]), frames, axes, still > 0, np.array([-1, 0, 1]), still + 1.0, still
    )
    link = bodies.Body(box((0.2, -0.05, -0.05), (1.0, 0.05, 0.05)))
    post = bodies.Body(box((-0.1, -0.1, -1.0), (0.1, 0.1, 1.0)))
    wall = bodies.Body(box((-3.0, math.hypot(2.0, 0.05) + gap, -1.0), (3.0, 4.0, 1.0)))
    parts = [(0, wall), (0, post), (1, link), (2, link)]
    swing = pieces.make_lines([(0.2, 0.0), (3.0, 0.0)])
    pairs = [(0, 2, 0.0), (0, 3, 0.0), (1, 3, 0.0)]
    assert bodies.check_chain(swing, chain, parts, pairs, LARGE).kind == expected
    folded = pieces.make_lines([(0.2, 0.0), (0.2, math.pi)])
    assert bodies.check_chain(folded, chain, parts, [(1, 3, 0.0)], LARGE).kind == TOUCHES


@pytest.mark.parametrize("seed", range(6))
def test_curves_agree_with_many_poses(seed):
    rng = np.random.default_rng(seed)
    rates = np.zeros((1, 3, 3))
    rates[0, :, :2] = rng.uniform(-1.0, 1.0, (3, 2))
    rates[0, 0, 0] += 3.0
    heading = np.array([rng.choice([-1, 0, 1])])
    rates[0, :, 2] = rng.normal(size=3) * (heading == 0)
    motion = pieces.Pieces(np.zeros((1, 3)), rates, heading > 1, heading)
    t = np.linspace(0.0, 1.0, 1000)
    q = motion.at(np.zeros(len(t), int), t)
    corners = pieces.turn(np.tile(BOX, (len(t), 1, 1)), q[:, 2:]) + q[:, None, :2]
    points = shapely.points(rng.uniform(-1.0, 4.0, (30, 2)))
    away = shapely.distance(shapely.polygons(corners)[:, None], points).min(axis=0)
    for point, distance in zip(points, away, strict=True):
        found = check_flat(motion, [plane.Part(BOX)], [point], radii=0.02)
        assert abs(distance - 0.02) < 1e-4 or (found == FREE) == (distance > 0.02)


@pytest.mark.parametrize("gap", [TINY, -TINY])
def test_a_disc_that_heads_along_its_curve_starts_from_rest(gap):
    # Where the robot rests, its curve has no direction, and no bound of its turning.
    rates = np.zeros((1, 3, 3))
    rates[0, 1, 0] = 2.0
    motion = pieces.Pieces(np.zeros((1, 3)), rates, np.zeros(1, bool), np.ones(1, int))
    found = check_flat(motion, [plane.Part(np.zeros((1, 2)), 0.3)], [shapely.Point(1.3 + gap, 0)])
    assert found == (FREE if gap > 0.0 else TOUCHES)


@pytest.mark.parametrize("gap", [-1e-3, 1e-3])
def test_things_that_stand_are_decided(gap):
    for gone in (0.0, 0.8 + gap):
        still = [
            apart.Timed(
                [plane.Part(BOX)],
                lambda t, x=x: np.stack([x + 0.0 * t, 0.0 * t], 1),
                lambda *_: (0, 0),
            )
            for x in (0.0, gone)
        ]
        found = apart.check_apart(*still, 0.0, 30.0, LARGE).kind
        assert found == (FREE if gone and gap > 0.0 else TOUCHES)


def test_what_holds_no_point_is_no_obstacle():
    shapes = [shapely.Point(), shapely.Polygon(), shapely.Point(0.5, 0.0)]
    line = pieces.make_lines([(0.0, 0.0), (1.0, 0.0)])
    world = plane.Plane(shapes, 0.1)
    assert check_flat(line, [plane.Part(BOX)], shapes[:2], radii=0.1) == FREE
    assert check_flat(line, [plane.Part(BOX)], shapes, radii=0.1) == TOUCHES
    assert world.cover(np.array([(0.45, 0.0)]), np.array([(0.55, 0.05)])).all()


def test_rows_off_a_motion_are_seen():
    line = pieces.make_lines([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)])
    rows, which, times = (
        np.array([(0, 0), (0.5, 0), (1, 0.3), (1, 1)]),
        [0, 0, 1, 1],
        [0, 0.5, 0.3, 1],
    )
    which, times = np.array(which), np.array(times)
    assert pieces.find_gap(line, rows, which, times) == pytest.approx(0.0)
    assert pieces.find_gap(line, np.add(rows, (0.0, 1e-3)), which, times) == pytest.approx(1e-3)
    assert pieces.find_gap(line, rows[[0, 2, 1, 3]], which[[0, 2, 1, 3]], times) == np.inf
    jump = line._replace(start=np.add(line.start, [(0.0, 0.0), (0.0, 1e-3)]))
    assert pieces.find_gap(jump, rows, which, times) >= 1e-3


def make_bars(turns):
    """Return the arguments of the claim that a wall parts a hall of 12 x 6 cells of 1 m."""
    parts = [plane.Part(np.array([(-1.6, -0.9), (1.6, -0.9), (1.6, 0.9), (-1.6, 0.9)]))]
    world = plane.Plane([shapely.box(5.0, 0.0, 7.0, 6.0)], room=[(0.0, 0.0), (12.0, 6.0)])
    borders = np.linspace(-math.pi, math.pi, turns + 1) if turns else []
    bars = np.array([(k, 5, y) for k in range(turns or 1) for y in range(6)])
    places = [[no_path.Place((2.5, 2.5), yaw=0.1)], [no_path.Place((9.5, 2.5))]]
    grid = (0.0, 0.0), 1.0, (12, 6)
    return [parts, world, grid, borders, places, bars, np.zeros((len(bars), 2))]


@pytest.mark.parametrize("turns", [0, 8])
def test_bars_are_replayed(turns):
    claim = make_bars(turns)
    assert no_path.check_no_path(*claim, LARGE).kind == PROVEN
    assert no_path.check_no_path(*claim, LARGE, is_open=True).kind == NOT_SHOWN  # around the wall
    for number, other in (
        (5, claim[5][1:]),  # a cell is not barred
        (6, claim[6] + (0.0, 0.95)),  # a witness is no point of the robot
        (5, claim[5] + (0, 2, 0)),  # or in no obstacle
        (1, plane.Plane([shapely.box(5.0, 0.0, 7.0, 5.9)])),
        (4, [[claim[4][0][0], no_path.Place((9.5, 1.5))], claim[4][1]]),  # another start
        (4, [claim[4][0], [no_path.Place((9.5, 2.5), distance=6.0)]]),  # a larger goal
        (4, [claim[4][0], [no_path.Place(shapely.box(4.0, 0.0, 9.0, 9.0))]]),
    ):
        wrong = [*claim]
        wrong[number] = other
        wrong[6] = wrong[6][: len(wrong[5])]
        assert no_path.check_no_path(*wrong, LARGE).kind == NOT_SHOWN, number
    # No component has both a start and the place on its way to the goal.
    one, other = claim[4][0][0], claim[4][1][0]
    claim[4] = [[one, other], [no_path.Place((3.5, 1.5))], [no_path.Place((8.5, 1.5))]]
    assert no_path.check_no_path(*claim, LARGE).kind == PROVEN
    turned = no_path.Place((0.0, 0.0), 0.5, 3.0, 0.5)
    assert turned.holds((0.3, 0.4, -3.0)) and not turned.holds((0.3, 0.4, 2.4))


def test_less_work_than_needed_decides_nothing():
    line = pieces.make_lines([(0.0, 0.0), (1.0, 0.0)])
    parts, world = [plane.Part(BOX)], plane.Plane([shapely.box(3, 3, 4, 4)])
    assert plane.check_plane(line, parts, world, Budget(0)).kind == NOT_SHOWN
    assert no_path.check_no_path(*make_bars(0), Budget(3)).kind == NOT_SHOWN


def test_it_imports_nothing_of_ours():
    allowed = {"numpy", "shapely", "fcl", "math", "typing", "collections", ""}
    for file in Path(__file__).parent.glob("*.py"):
        for node in (
            ast.walk(ast.parse(file.read_text())) if file.name != Path(__file__).name else ()
        ):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += (
                [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
            )
            assert {name.partition(".")[0] for name in names} <= allowed
