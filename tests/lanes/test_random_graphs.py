"""Audits of random route graphs of lanes and curves, against what shapely sweeps."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import example, given
from scipy.interpolate import BSpline
from shapely import affinity

import cspace
from cspace import Robot, Workspace
from cspace.lanes import HeadingRule, RouteGraph
from cspace.lanes._curves import cut_nurbs
from tests.helpers.regions import place_at
from tests.helpers.strategies import examples, seeds

MAX_AREA = 1e-9
"""Area, square metres, that robot and obstacles may have in common by rounding."""

SHRINK = 1.0 - 1e-9
"""Factor of rooms and margins, for rounding."""

CURVE_KNOTS = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
"""Knots of quadratic curves."""


@pytest.mark.filterwarnings("ignore:no cell of the map is FREE")
@examples(60)
@given(seeds)
@example(2)  # where more than 64 configurations are tried
def test_no_verdict_room_margin_or_turn_of_an_audit_is_refuted(seed):
    rng = np.random.default_rng(seed)
    sizes = rng.uniform(0.05, 0.5, 2)
    points = rng.uniform(-sizes, sizes, (int(rng.integers(3, 8)), 2))
    corners = shapely.MultiPoint(points).convex_hull
    space, walls = draw_map(rng, corners)
    graph, controls = draw_graph(rng, space)
    audit = cspace.lanes.audit(space, graph)
    for lane, row in zip(graph.lanes, audit.lanes, strict=True):
        poses = list(list_poses(rng, graph, lane, controls.get(lane.name)))
        if row.verdict == "blocked" and row.at is not None:
            assert shapely.intersects(place_at(corners, row.at), walls), row
        for first, last in poses if row.verdict == "free" else ():
            swept = shapely.convex_hull(
                shapely.union(place_at(corners, first), place_at(corners, last))
            )
            shapes = [shapely.buffer(swept, SHRINK * row.margin, quad_segs=32)]
            if lane.name not in controls and first[:2] != last[:2]:
                travel = np.subtract(last, first)[:2] / math.dist(first[:2], last[:2])
                for side, room in ((1.0, row.left), (-1.0, row.right)):
                    aside = side * SHRINK * room * np.array([-travel[1], travel[0]])
                    shifted = affinity.translate(swept, *aside)
                    shapes.append(shapely.convex_hull(shapely.union(swept, shifted)))
            meets = shapely.area(shapely.intersection(shapes, walls)).max() > MAX_AREA
            assert not meets, (row, first, last)
    for node in audit.nodes:
        for low, high in node.free_yaws:
            for yaw in rng.uniform(low, high, 5).tolist():
                robot = place_at(corners, (*node.position, yaw))
                assert shapely.intersection(robot, walls).area <= MAX_AREA, (node, yaw)


def draw_map(rng, corners):
    """Draw a map of a convex robot, and everything that it must not touch."""
    spacing = float(rng.choice([0.05, 0.1, 0.13]))
    shape = rng.integers(20, 50, 2)
    frame = shapely.box(0.0, 0.0, *(spacing * shape))
    if rng.random() < 0.5:
        cells = rng.random(tuple(shape)) < rng.choice([0.0, 0.001, 0.01])
        lower = spacing * np.argwhere(cells)
        walls = [*shapely.box(*lower.T, *(lower + spacing).T)]
        workspace = Workspace.from_array(cells, spacing)
    else:
        centers = rng.uniform(0.0, spacing * shape, (int(rng.integers(1, 8)), 2))
        walls = [
            shapely.MultiPoint(center + rng.uniform(-0.3, 0.3, (5, 2))).convex_hull
            for center in centers
        ]
        walls = [shapely.intersection(wall, frame) for wall in walls]
        walls = [wall for wall in walls if wall.area > 0.0] or [shapely.box(0.0, 0.0, 0.1, 0.1)]
        workspace = Workspace.from_polygons(walls, spacing=spacing, bounds=frame.bounds)
    beyond = shapely.difference(shapely.buffer(frame, 9.0), frame)
    robot = Robot.polygon(shapely.get_coordinates(corners)[:-1])
    space = cspace.build(workspace, robot, rotations=int(rng.choice([1, 5, 16, 72])))
    return space, shapely.union_all([*walls, beyond])


def draw_graph(rng, space):
    """Draw a graph of straight lanes and curves, and the control points of the curves."""
    count = int(rng.integers(2, 7))
    upper = np.array(space.grid.upper)
    nodes = rng.uniform(-0.02 * upper, 1.02 * upper, (count, 2))
    edges = rng.integers(0, count, (int(rng.integers(1, 9)), 2))
    words = ["forward", "backward", "both", "any", float(rng.uniform(-7.0, 7.0)), 0.0]
    headings = [words[int(k)] for k in rng.integers(0, len(words), len(edges))]
    yaws = np.where(rng.random(count) < 0.3, rng.uniform(-4.0, 4.0, count), math.nan)
    graph = RouteGraph.from_arrays(nodes, edges, headings, yaws=yaws)
    lanes, controls = [], {}
    for lane in graph.lanes:
        ends = nodes[[lane.start, lane.end]]
        if lane.start != lane.end and rng.random() < 0.3:
            points = np.insert(ends, 1, rng.uniform(0.0, upper), axis=0)
            controls[lane.name] = points
            lane = lane._replace(legs=cut_nurbs(2, CURVE_KNOTS, points, np.ones(3)))
        deviation = float(rng.choice([0.0, 0.0, 0.05]))
        lanes.append(lane._replace(deviation=deviation))
    graph = RouteGraph(graph.names, graph.positions, tuple(lanes), graph.yaws)
    widths = rng.choice([0.0, 0.0, 0.02, 0.3, 2.0, 3.0], count)
    given = {name: width for name, width in zip(graph.names, widths.tolist(), strict=True) if width}
    return replace(graph, yaw_deviations=given), controls


def list_poses(rng, graph, lane, controls):
    """Yield pairs of poses of a lane, which a robot that keeps its yaw joins, within its corridor."""
    places = graph.positions[[lane.start, lane.end]]
    travels = [math.atan2(*(places[1] - places[0])[::-1])] * 2
    if controls is not None:
        curve = BSpline(CURVE_KNOTS, controls, 2)
        times = rng.uniform(0.0, 1.0, 20)
        places = np.concatenate([places[:1], curve(times), places[1:]])
        slopes = curve(np.concatenate([[0.0], times, [1.0]]), 1)
        travels = np.arctan2(slopes[:, 1], slopes[:, 0]).tolist()
    aside = lane.deviation * rng.choice([-0.7, 0.7], 2)
    for rule in list_rules(rng, graph, lane):
        yaws = [
            travel + rule.yaws[0] if rule.frame == "lane" else rule.yaws[0] for travel in travels
        ]
        poses = [(*(place + aside), yaw) for place, yaw in zip(places, yaws, strict=True)]
        if controls is None:
            yield poses[0], poses[-1]
        else:
            yield from zip(poses, poses, strict=True)
        if lane.heading.frame == "any":
            continue
        for node, yaw in ((lane.start, yaws[0]), (lane.end, yaws[-1])):
            width = graph.yaw_deviations.get(graph.names[node], 0.0)
            given = graph.yaws[node] + rng.uniform(-width, width, 5)
            for share, last in zip(rng.uniform(0.0, 1.0, 5), given, strict=True):
                turn = math.remainder(last - yaw, math.tau)
                pose = (*(graph.positions[node] + aside), yaw + share * turn)
                yield from [] if math.isnan(turn) else [(pose, pose)]


def list_rules(rng, graph, lane):
    """Return rules of one yaw each, a random one if all yaws are allowed."""
    is_point = not lane.legs and lane.start == lane.end
    if lane.heading.frame == "any" or (is_point and lane.heading.frame == "lane"):
        return [HeadingRule("map", (float(yaw),)) for yaw in rng.uniform(-4.0, 4.0, 8)]
    return [HeadingRule(lane.heading.frame, (yaw,)) for yaw in lane.heading.yaws]
