"""Conflicts of lanes and nodes, against dense poses of both robots laid down by shapely."""

import csv
import itertools
import json
import math
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st
from matplotlib import pyplot

import cspace
from cspace.errors import FileError, InputError
from cspace.lanes import RouteGraph
from tests.helpers.commands import run
from tests.helpers.handmade import build_empty
from tests.helpers.refusals import check_refused, refusals, write
from tests.helpers.regions import place_at, place_polygon
from tests.helpers.strategies import examples, few
from tests.lanes.test_graph_files import ENTRY, edit
from tests.lanes.test_reports import open_arc, open_order

SHAPES = {
    "arrow": [(0.4, 0.2), (-0.3, 0.25), (-0.3, -0.2), (0.4, -0.2)],
    "notched": [
        (-0.4, -0.3),
        (0.4, -0.3),
        (0.4, -0.1),
        (-0.1, 0.0),
        (0.4, 0.1),
        (0.4, 0.3),
        (-0.4, 0.3),
    ],
    "outside": [(0.3, 0.1), (0.9, 0.2), (0.9, 0.5), (0.4, 0.5)],
}
"""Robots: one without symmetry, one with a notch, one beside its reference point."""


def build(shape, rotations=72, spacing=0.1, **options):
    """Return an empty map of 8 m by 6 m for a robot."""
    robot = cspace.Robot.polygon(SHAPES[shape]) if shape in SHAPES else shape
    return build_empty((80, 60), robot, spacing, rotations=rotations, **options)


@pytest.fixture(scope="module")
def spaces():
    """Return a map for each robot, made once."""
    return {shape: build(shape) for shape in SHAPES}


def yaws_of(graph, lane):
    """Return the yaws of a straight lane; 36 of them if it allows any."""
    frame, yaws = lane.heading
    if frame == "any":
        return np.linspace(-math.pi, math.pi, 36, endpoint=False)
    step = np.subtract(graph.positions[lane.end], graph.positions[lane.start])
    return np.array(yaws) + (math.atan2(step[1], step[0]) if frame == "lane" else 0.0)


def poses_of(graph, number, count=40):
    """Return poses of an element of straight lanes, written anew from the claim."""
    if number < len(graph.lanes):
        lane = graph.lanes[number]
        ends = graph.positions[[lane.start, lane.end]]
        shares = np.linspace(0, 1, count)[:, None]
        line = ends[0] + shares * (ends[1] - ends[0])
        return [(*point, yaw) for yaw in yaws_of(graph, lane) for point in line]
    node = number - len(graph.lanes)
    lanes = [lane for lane in graph.lanes if node in (lane.start, lane.end)]
    if not lanes or any(lane.heading.frame == "any" for lane in lanes):
        yaws = np.linspace(-math.pi, math.pi, 72)
    else:
        found = [yaw for lane in lanes for yaw in yaws_of(graph, lane)]
        yaws = [
            first + share * math.remainder(last - first, math.tau)
            for first, last in itertools.product(found, found)
            for share in np.linspace(0, 1, count)
        ]
    return [(*graph.positions[node], yaw) for yaw in yaws]


def draw_graph(rng, side=4.0):
    """Draw a few nodes and lanes with headings of all kinds."""
    count = int(rng.integers(2, 6))
    positions = rng.uniform(1.0, 1.0 + side, (count, 2))
    edges = np.array(list(itertools.permutations(range(count), 2)))
    edges = rng.permutation(edges)[: int(rng.integers(1, 5))]
    kinds = ["forward", "backward", "both", "any", 0.7]
    headings = [kinds[k] for k in rng.integers(0, 5, len(edges))]
    return RouteGraph.from_arrays(positions, edges, headings)


@pytest.mark.parametrize("number", few([4, 100]))
def test_random_graphs_agree_with_dense_poses(spaces, number):
    rng = np.random.default_rng(5)
    seen = {"apart": 0, "touch": 0, "undecided": 0}
    for _ in range(number):
        one, other = rng.choice(list(SHAPES), 2)
        polygons = {"": shapely.Polygon(SHAPES[one]), "b": shapely.Polygon(SHAPES[other])}
        graphs = {"": draw_graph(rng), "b": draw_graph(rng)}
        distance = float(rng.choice([0.0, 0.15]))
        others = {"b": (spaces[other], graphs["b"])}
        found = cspace.lanes.conflicts(spaces[one], graphs[""], others=others, margin=distance)
        swept = {}
        for robot, graph in graphs.items():
            names = [name for name, row in found.elements.items() if row.robot == robot]
            for k, name in enumerate(names):
                bodies = place_polygon(polygons[robot], np.array(poses_of(graph, k)))
                assert shapely.covers(found.outlines[name], bodies).all()
                swept[name] = shapely.union_all(bodies)
        for first, second in itertools.combinations(found.elements, 2):
            row = found.between(first, second)
            seen[row.verdict] += 1
            gap = shapely.distance(swept[first], swept[second])
            if row.verdict == "apart":
                assert gap > distance
            elif row.verdict == "touch":
                check_touch(found, graphs, polygons, row)
            else:
                assert abs(gap - distance) < 0.04
    assert min(seen["apart"], seen["touch"]) > 10 * seen["undecided"]


def check_touch(found, graphs, polygons, row):
    """Check that the two poses touch, and that each is on its element."""
    placed = []
    for name, pose in zip((row.first, row.second), row.poses, strict=True):
        element = found.elements[name]
        placed.append(place_at(polygons[element.robot], pose))
        graph = graphs[element.robot]
        line = shapely.LineString(element.line) if len(element.line) > 1 else None
        spot = line or shapely.Point(element.line[0])
        assert shapely.distance(spot, shapely.Point(pose[:2])) < 1e-9
        if element.kind == "lane":
            names = [name for name, each in found.elements.items() if each.robot == element.robot]
            lane = graph.lanes[names.index(name)]
            if lane.heading.frame != "any":
                turns = [math.remainder(pose[2] - yaw, math.tau) for yaw in yaws_of(graph, lane)]
                assert min(map(abs, turns)) < 1e-9
    assert shapely.distance(*placed) <= found.margin
    assert shapely.distance(placed[0], shapely.Point(row.at)) <= found.margin / 2 + 1e-9


@examples(150)
@given(
    angle=st.floats(-math.pi, math.pi),
    gap=st.sampled_from([-0.01, -1e-4, 1e-6, 1e-3, 0.01]),
    distance=st.sampled_from([0.0, 0.3]),
    slide=st.floats(-1.5, 1.3),
)
@example(angle=0.0, gap=-1e-4, distance=0.0, slide=1.0)
def test_parallel_lanes_near_contact_are_decided(spaces, angle, gap, distance, slide):
    # The left sides of both robots are 0.2 to 0.25 m beside their lanes.
    space = spaces["arrow"]
    ahead = np.array([math.cos(angle), math.sin(angle)])
    left = np.array([-ahead[1], ahead[0]])
    start = np.array([4.0, 3.0])
    other = start + (0.25 + 0.25 + distance + gap) * left
    nodes = [start - ahead, start + ahead, other + (slide + 1) * ahead, other + (slide - 1) * ahead]
    graph = RouteGraph.from_arrays(nodes, [(0, 1), (2, 3)])
    row = cspace.lanes.conflicts(space, graph, margin=distance).between("0: 0 to 1", "1: 2 to 3")
    assert row.verdict == ("apart" if gap > 0 else "touch")


@examples(200)
@given(st.lists(st.integers(0, 24), min_size=6, max_size=6), st.integers(0, 3))
def test_corners_that_meet_exactly_are_never_apart(numbers, pull):
    # Lanes along the axes, on a grid of eighths: exact fractions say whether the outlines meet.
    space = build("rect:1.0x0.5", rotations=None)
    eighths = [Fraction(number, 8) for number in numbers]
    (x, y, x2), (u, v, v2) = eighths[:3], eighths[3:]
    shift = Fraction(1, 10**pull) if pull else Fraction(0)
    boxes = []
    nodes = []
    for a, b, c, d in ((x, y, x2, y), (u + shift, v + shift, u + shift, v2 + shift)):
        boxes.append((min(a, c) - Fraction(1, 2), max(a, c) + Fraction(1, 2)))
        boxes.append((min(b, d) - Fraction(1, 4), max(b, d) + Fraction(1, 4)))
        nodes += [(float(a), float(b)), (float(c), float(d))]
    graph = RouteGraph.from_arrays(nodes, [(0, 1), (2, 3)], 0.0)
    row = cspace.lanes.conflicts(space, graph).between("0: 0 to 1", "1: 2 to 3")
    gaps = [max(boxes[2 + k][0] - boxes[k][1], boxes[k][0] - boxes[2 + k][1]) for k in (0, 1)]
    gap = max(gaps)
    assert row.verdict == ("apart" if gap > 0 else "touch" if gap < 0 else "undecided")


def test_verdicts_are_symmetric_and_an_element_touches_itself(spaces):
    rng = np.random.default_rng(3)
    graph, other = draw_graph(rng), draw_graph(rng)
    pair = (spaces["notched"], other)
    one = cspace.lanes.conflicts(spaces["arrow"], graph, others={"b": pair}, name="a")
    two = cspace.lanes.conflicts(*pair, others={"a": (spaces["arrow"], graph)}, name="b")
    for first, second in itertools.combinations(one.elements, 2):
        row, back = one.between(first, second), one.between(second, first)
        assert row.verdict == back.verdict == two.between(first, second).verdict
        assert row.poses is None or row.poses == back.poses[::-1]
    for name in one.elements:
        row = one.between(name, name)
        assert row.verdict == "touch"
        assert row.poses[0] == row.poses[1]
    # Two margins of 5 cm count as a distance of 10 cm.
    graph = draw_graph(np.random.default_rng(4))
    grown = cspace.lanes.conflicts(build("arrow", margin=0.05), graph)
    assert grown.counts == cspace.lanes.conflicts(spaces["arrow"], graph, margin=0.1).counts


def test_round_robots_and_discs_have_their_exact_size():
    space = build("disc:0.3", rotations=None)
    for gap, verdict in ((1e-6, "apart"), (-1e-6, "touch")):
        graph = RouteGraph.from_arrays([(1, 1), (3, 1), (3.0, 1.6 + gap), (5, 4)], [(0, 1), (2, 3)])
        found = cspace.lanes.conflicts(space, graph)
        assert found.between("0: 0 to 1", "node 2").verdict == verdict
    pair = cspace.Robot.from_balls([(0.0, 0.5), (0.0, -0.5)], [0.1, 0.2])
    space = build(pair)
    graph = RouteGraph.from_arrays([(1, 3), (3, 3), (1, 3.1), (3, 3.1)], [(0, 1), (2, 3)])
    found = cspace.lanes.conflicts(space, graph)
    assert found.between("0: 0 to 1", "1: 2 to 3").verdict == "touch"
    assert found.outlines["0: 0 to 1"].geom_type == "MultiPolygon"


def test_nodes_have_the_turns_between_their_lanes():
    space = build("rect:1.0x0.2")
    nodes = [(1, 1), (3, 1), (3, 3), (3.4, 0.6), (5, 5)]
    graph = RouteGraph.from_arrays(nodes, [(0, 1), (1, 2)])
    found = cspace.lanes.conflicts(space, graph)
    # The turn to the left sweeps from (3.5, 1) to (3, 1.5), and from (2.5, 1) to (3, 0.5).
    corner = found.outlines["node 1"]
    for angle, inside in ((45, True), (80, True), (135, False), (225, True), (-45, False)):
        point = shapely.Point(
            3 + 0.48 * math.cos(math.radians(angle)), 1 + 0.48 * math.sin(math.radians(angle))
        )
        assert corner.contains(point) == inside, angle
    # Nothing says how the robot stands at a node without lanes, so it may stand in any way.
    assert found.outlines["node 4"].area == pytest.approx(math.pi * 0.26, rel=0.01)
    still = RouteGraph.from_arrays(nodes, [(0, 1), (1, 2)], yaws=[0.0] * 5)
    outline = cspace.lanes.conflicts(space, still).outlines["node 4"]
    assert outline.area == pytest.approx(0.2)


@examples(60)
@given(
    first=st.floats(-math.pi, math.pi, exclude_max=True),
    direction=st.floats(-math.pi, math.pi),
    backward=st.booleans(),
    width=st.sampled_from([0.0, 0.1, 1.0, 2.5]),
)
@example(first=-1.87, direction=2.78, backward=False, width=0.0)
@example(first=1.7, direction=-1.7, backward=True, width=0.0)
@example(first=1.6290320322047709, direction=1.629032033204771, backward=True, width=0.0)
@example(first=0.5, direction=1.0, backward=False, width=1.0)
@example(first=0.5, direction=-2.0, backward=False, width=2.5)
def test_a_lane_turns_the_shorter_ways_from_the_yaws_of_its_node(
    spaces, first, direction, backward, width
):
    ends = [(4.0, 3.0), (4.0 + 0.5 * math.cos(direction), 3.0 + 0.5 * math.sin(direction))]
    heading = "backward" if backward else "forward"
    graph = RouteGraph.from_arrays(ends, [(0, 1)], heading, yaws=[first, math.nan])
    graph = replace(graph, yaw_deviations={"0": width} if width else {})
    found = cspace.lanes.conflicts(spaces["outside"], graph)
    robot, last = shapely.Polygon(SHAPES["outside"]), direction + math.pi * backward
    shares = np.linspace(-1.0, 1.0, 50 if width else 1)
    steps = [math.remainder(first + share * width - last, math.tau) for share in shares]

    def place_along(rounding):
        """Place the robot; half a turn, within rounding, may go either way."""
        ways = [*steps, *(-step for step in steps if abs(step) > math.pi - rounding), 0.0]
        turned = [(*ends[0], last + way) for way in np.linspace(min(ways), max(ways), 200)]
        driven = [(*point, last) for point in np.linspace(*ends, 30)]
        return place_polygon(robot, np.array(turned)), place_polygon(robot, np.array(driven))

    on_node, on_lane = place_along(5e-10)
    assert shapely.covers(found.outlines["node 0"], on_node).all()
    outline = found.outlines["0: 0 to 1"]
    assert shapely.covers(outline, [*on_node, *on_lane]).all()
    if width < 2.5:  # else the shorter way between its yaws is all around
        bodies = shapely.union_all(np.concatenate(place_along(2e-9)))
        assert shapely.difference(outline, bodies).area < 0.1


@pytest.mark.parametrize(
    ("first", "last", "touched"), [(1.7, -1.7, 1), (-2.8, 0.5, 1), (math.pi, 0.0, 2)]
)
def test_a_corner_is_turned_the_shorter_way_and_half_a_turn_both_ways(
    tmp_path, first, last, touched
):
    robot = cspace.Robot.polygon(shapely.box(-0.1, -0.1, 1.0, 0.1))
    corner = np.array([4.0, 3.0])
    before = np.subtract(corner, (math.cos(first), math.sin(first)))
    after = np.add(corner, (math.cos(last), math.sin(last)))
    points = [{"x": float(x), "y": float(y)} for x, y in (before, corner, after)]
    drawn = {"degree": 1, "knotVector": [0, 0, 1, 2, 2], "controlPoints": points}
    graph = open_order(tmp_path, before, after, trajectory=drawn)
    middle = first + 0.5 * math.remainder(last - first, math.tau)
    places = [
        corner + 0.9 * np.array([math.cos(yaw), math.sin(yaw)])
        for yaw in (middle, middle + math.pi)
    ]
    others = {"cart": (build("disc:0.1", rotations=None), RouteGraph.from_arrays(places, []))}
    found = cspace.lanes.conflicts(build(robot), graph, others=others)
    verdicts = [found.between("e: a to b", f"cart node {k}").verdict for k in range(2)]
    assert verdicts == ["touch"] * touched + ["apart"] * (2 - touched)
    # The audit finds a post on each way that the robot may turn.
    for k, place in enumerate(places):
        space = build(robot)
        space.add_obstacle("post", shapely.Point(place).buffer(0.1))
        (lane,) = cspace.lanes.audit(space, graph).lanes
        assert lane.verdict == ("blocked" if k < touched else "free")


def test_a_curve_at_any_yaw_sweeps_a_disc_at_once(spaces, tmp_path, monkeypatch):
    layout = edit("lif.json", (*ENTRY, "rotationAllowed"), True)
    graph = RouteGraph.open(write(tmp_path, "a.json", layout))
    counts = []
    hull = shapely.convex_hull
    monkeypatch.setattr(
        shapely, "convex_hull", lambda shapes: counts.append(np.size(shapes)) or hull(shapes)
    )
    found = cspace.lanes.conflicts(spaces["notched"], graph)
    # 2 for each leg, and 2 for each of 5 degrees in each of 2 nodes and 2 parts.
    assert sum(counts) < 2000
    reach = max(math.hypot(*corner) for corner in SHAPES["notched"])
    angles = np.linspace(0.0, math.pi / 2, 1000)
    arc = shapely.LineString(np.column_stack([np.cos(angles), np.sin(angles)]))
    outline = found.outlines["ab: a to b"]
    assert outline.covers(arc.buffer(reach - 1e-9, quad_segs=64))
    assert arc.buffer(reach + 0.003, quad_segs=64).covers(outline)


def test_curves_and_deviations_count_as_the_audit_counts_them(tmp_path):
    space, disc = build("rect:0.4x0.2"), build("disc:0.05", rotations=None)
    box = shapely.box(-0.2, -0.1, 0.2, 0.1)
    corridor = {"corridor": {"leftWidth": 0.2, "rightWidth": 0.1}}
    outer = math.hypot(1.1, 0.2) + 0.05
    for radius, verdict in ((outer - 0.01, "touch"), (outer + 0.01, "apart")):
        for more, extra in ((0.0, {}), (0.2, corridor)):
            spot = 1.0 + (radius + more) * np.array([0.6, 0.8])
            others = {"disc": (disc, RouteGraph.from_arrays([spot], []))}
            found = cspace.lanes.conflicts(space, open_arc(tmp_path, **extra), others=others)
            row = found.between("e: a to b", "disc node 0")
            assert row.verdict == verdict, (radius, more)
            if verdict == "touch":
                x, y, _ = row.poses[0]
                assert place_at(box, row.poses[0]).distance(shapely.Point(spot)) <= 0.05 + 1e-12
                assert abs(math.hypot(x - 1, y - 1) - 1.0) <= more + 1e-6
    # The polygon of the outline holds the robot all along the circle.
    outline = cspace.lanes.conflicts(space, open_arc(tmp_path)).outlines["e: a to b"]
    angles = np.linspace(0.0, math.pi / 2, 500)
    poses = np.column_stack([1 + np.cos(angles), 1 + np.sin(angles), angles + math.pi / 2])
    assert outline.covers(place_polygon(box, poses)).all()


@pytest.mark.parametrize("number", few([2, 30]))
@pytest.mark.parametrize("distance", [0.0, 0.2])
def test_one_robot_in_each_zone_keeps_all_apart(spaces, distance, number):
    rng = np.random.default_rng(8)
    polygon = shapely.Polygon(SHAPES["notched"])
    close = 0
    for _ in range(number):
        graph = draw_graph(rng)
        found = cspace.lanes.conflicts(spaces["notched"], graph, margin=distance)
        zones = found.zones()
        shapes = list(zones.polygons)
        assert all(shape.is_valid and not shape.interiors for shape in shapes)
        assert not any(a.intersects(b) for a, b in itertools.combinations(shapes, 2))
        for k, j in itertools.combinations(range(len(found.elements)), 2):
            pairs = itertools.product(*(rng.permutation(poses_of(graph, n))[:12] for n in (k, j)))
            for pose, other in pairs:
                bodies = place_at(polygon, pose), place_at(polygon, other)
                if shapely.distance(*bodies) <= distance:
                    close += 1
                    both = [zone for zone in shapes if shapely.intersects(zone, bodies).all()]
                    assert both
    assert close > 15 * number


RMF = {
    "levels": {
        "L1": {
            "vertices": [
                *([1.0, 1.0, {"name": "a"}], [4.0, 1.0, {"name": "b"}]),
                *([1.0, 1.3, {"name": "c"}], [4.0, 1.3, {"name": "d", "mutex": "end"}]),
                *([1.0, 4.0, {"name": "e", "mutex": ""}], [4.0, 4.0, {"name": "f"}]),
            ],
            "lanes": [
                [0, 1, {"mutex": "hall"}],
                [2, 3, {"mutex": "hall", "is_bidirectional": True}],
                [4, 5, {"mutex": "far"}],
                [5, 4, {"mutex": 7}],
            ],
        }
    }
}


def open_rmf(folder, change=lambda lanes: None):
    """Write the graph of Open-RMF with changed lanes, and open it for lanes driven forward."""
    document = json.loads(json.dumps(RMF))
    change(document["levels"]["L1"]["lanes"])
    return RouteGraph.open(write(folder, "rmf.yaml", document), heading="forward")


def test_mutex_groups_of_open_rmf_are_audited(spaces, tmp_path):
    graph = open_rmf(tmp_path)
    assert [lane.mutex for lane in graph.lanes] == ["hall", "hall", "hall", "far", "7"]
    assert graph.node_mutexes == {"d": "end"}
    found = cspace.lanes.conflicts(spaces["arrow"], graph)
    assert found.between("0: a to b", "1: c to d").groups == ("hall",)
    unguarded = {(row.first, row.second) for row in found.unguarded}
    assert ("0: a to b", "1: c to d") not in unguarded
    assert ("2: e to f", "3: f to e") not in unguarded  # they share nodes
    assert ("0: a to b", "node d") in unguarded
    assert all(row.verdict == "touch" and not row.groups for row in found.unguarded)
    assert "guard nothing" not in str(found)
    assert [row for row in found.failing() if row.shares_node] == []
    assert found.unguarded == found.failing()
    assert f"{len(found.failing())} pairs touch and share no node and no mutex group" in str(found)

    def move(lanes):
        """Put the two lanes that are far from each other into one group."""
        lanes[0][2]["mutex"] = lanes[2][2]["mutex"] = "vain"

    found = cspace.lanes.conflicts(spaces["arrow"], open_rmf(tmp_path, move))
    assert "mutex groups that guard nothing: vain" in str(found)
    assert "0: a to b" in {name for row in found.failing() for name in (row.first, row.second)}


def test_graphs_without_groups_do_not_fail(spaces):
    graph = RouteGraph.from_arrays([(1, 1), (3, 1), (1, 1.1), (3, 1.1)], [(0, 1), (2, 3)])
    found = cspace.lanes.conflicts(spaces["arrow"], graph)
    assert found.counts["touch"] > 0
    between = [row for row in found.pairs if row.verdict == "touch" and not row.shares_node]
    assert found.unguarded == between != []
    assert found.failing(strict=True) == []


def test_reports_hold_every_pair(spaces, tmp_path):
    found = cspace.lanes.conflicts(spaces["arrow"], open_rmf(tmp_path))
    found.to_csv(tmp_path / "a.csv")
    rows = list(csv.DictReader((tmp_path / "a.csv").read_text().splitlines()))
    assert [row["first"] for row in rows] == [row.first for row in found.pairs]
    assert tuple(map(float, rows[0]["first_pose"].split())) == found.pairs[0].poses[0]
    found.to_geojson(tmp_path / "a.geojson")
    features = json.loads((tmp_path / "a.geojson").read_text())["features"]
    assert len(features) == len(found.elements) + len(found.pairs)
    outlines = [shapely.geometry.shape(each["geometry"]) for each in features]
    assert outlines[0].equals(found.outlines["0: a to b"])
    assert all(each.exterior.is_ccw for each in outlines[: len(found.elements)])
    found.to_junit(tmp_path / "a.xml")
    suite = ElementTree.parse(tmp_path / "a.xml").getroot()
    assert suite.get("failures") == str(len(found.failing())) != "0"
    assert len(suite) == sum(not row.shares_node for row in found.pairs)
    assert repr(found).startswith("Conflicts(polygon")
    assert sum(found.counts.values()) == len(found.elements) * (len(found.elements) - 1) // 2
    axes = found.plot()
    labels = [text.get_text() for text in axes.figure.legends[0].get_texts()]
    assert any("touch, with a common node" in label for label in labels)
    pyplot.close(axes.figure)


def test_pictures_of_tall_maps_have_whole_titles_and_all_verdicts():
    """Pairs that only a margin joins have no area in common, and an entry of their own."""
    space = build_empty((30, 200), cspace.Robot.rectangle(0.6, 0.4), 0.1, rotations=16)
    points = [(1.0, 5.0), (1.0, 15.0), (1.7, 5.0), (1.7, 15.0)]
    graph = RouteGraph.from_arrays(points, [(0, 1), (2, 3)])
    found = cspace.lanes.conflicts(space, graph, margin=0.4)
    for axes in (found.plot(), cspace.lanes.audit(space, graph).plot()):
        figure = axes.figure
        figure.canvas.draw()
        width, height = figure.canvas.get_width_height()
        title = figure._suptitle.get_window_extent()
        assert title.x0 >= 0 and title.x1 <= width and title.y1 <= height
    labels = [text.get_text() for text in found.plot().figure.legends[0].get_texts()]
    shown = {row.verdict for row in found.pairs if not row.shares_node}
    for verdict in shown:
        count = sum(row.verdict == verdict and not row.shares_node for row in found.pairs)
        assert f"{count} {verdict}" in labels
    assert shown


def test_zones_are_written_for_others(spaces, tmp_path):
    found = cspace.lanes.conflicts(spaces["arrow"], open_rmf(tmp_path))
    zones = found.zones()
    assert len(zones) == len(zones.polygons) == len(zones.elements)
    assert {name for names in zones.elements for name in names} == set(found.elements)
    zones.to_geojson(tmp_path / "zones.geojson")
    features = json.loads((tmp_path / "zones.geojson").read_text())["features"]
    shapes = [shapely.geometry.shape(each["geometry"]) for each in features]
    assert shapes[0].equals(zones.polygons[0])
    assert all(shape.exterior.is_ccw for shape in shapes)
    zone_set = zones.to_vda5050("hall", "lanes")["zoneSet"]
    assert (zone_set["mapId"], zone_set["zoneSetId"]) == ("hall", "lanes")
    assert {zone["zoneType"] for zone in zone_set["zones"]} == {"RELEASE"}
    corners = [(vertex["x"], vertex["y"]) for vertex in zone_set["zones"][0]["vertices"]]
    assert shapely.Polygon(corners).equals(zones.polygons[0])
    alone = cspace.lanes.conflicts(spaces["arrow"], RouteGraph.from_arrays([(1, 1), (4, 4)], []))
    assert (len(alone.zones()), alone.pairs) == (0, [])
    with pytest.raises(InputError, match="map_id"):
        zones.to_vda5050(3, "lanes")


def test_a_zone_of_most_elements_is_warned_of():
    space = build("disc:0.1", rotations=None)
    nodes = [(0.5 + 0.3 * k, 3.0) for k in range(12)]
    graph = RouteGraph.from_arrays(nodes, [(k, k + 1) for k in range(11)], two_way=True)
    with pytest.warns(UserWarning, match="one zone has 34 of 34 elements"):
        assert len(cspace.lanes.conflicts(space, graph).zones()) == 1


def test_tiles_and_graphs_with_names_that_repeat(tmp_path):
    tiled = build("arrow", store=tmp_path / "map.zarr", tile=32)
    graph = RouteGraph.from_arrays([(1, 1), (7, 4), (7, 1), (1, 4)], [(0, 1), (2, 3)])
    lanes = (graph.lanes[0], graph.lanes[0], graph.lanes[1])
    twice = RouteGraph(graph.names, graph.positions, lanes, graph.yaws)
    found = cspace.lanes.conflicts(tiled, twice)
    assert list(found.elements)[:2] == ["0: 0 to 1", "0: 0 to 1 (2)"]
    assert found.between("0: 0 to 1 (2)", "1: 2 to 3").verdict == "touch"
    assert found.counts == cspace.lanes.conflicts(build("arrow"), twice).counts


def test_names_that_repeat_between_robots_or_kinds_are_numbered(spaces):
    space = spaces["arrow"]
    nodes, names = [(1, 2), (4, 2), (1, 4)], ["a", "b", "x: a to b"]
    first = RouteGraph.from_arrays(nodes, [(0, 1)], names=names, edge_names=["node x"])
    second = RouteGraph.from_arrays(nodes, [(0, 1)], names=names, edge_names=["x"])
    found = cspace.lanes.conflicts(space, first, others={"node": (space, second)})
    alike = [name for name in found.elements if name.startswith("node x: a to b")]
    assert alike == ["node x: a to b", "node x: a to b (2)", "node x: a to b (3)"]
    assert [found.elements[name].kind for name in alike] == ["lane", "node", "lane"]


@pytest.mark.parametrize("far", [1e6, 1e15, 1e100])
def test_nodes_far_away_do_not_harm_near_pairs(spaces, far):
    nodes = [(1, 1), (3, 1), (1, 2), (3, 2), (far, 5.0)]
    graph = RouteGraph.from_arrays(nodes, [(0, 1), (2, 3), (3, 4)])
    found = cspace.lanes.conflicts(spaces["arrow"], graph)
    assert found.between("0: 0 to 1", "1: 2 to 3").verdict == "apart"
    assert found.between("1: 2 to 3", "2: 3 to 4").verdict != "apart"


def elsewhere(frame="map", count=80):
    """Return a map of another frame or extent."""
    cells = np.zeros((count, 60), dtype=np.bool_)
    grid = cspace.Grid((0.0, 0.0), 0.1, cells.shape, frame_id=frame)
    return cspace.build(cspace.Workspace(grid, cells, cells), "disc:0.2")


SMALL = elsewhere()
LANES = RouteGraph.from_arrays([(1, 1), (3, 1)], [(0, 1)])


@refusals(
    "options, message",
    ({"others": 3}, "others is a int ... give"),
    ({"others": {"": (SMALL, LANES)}}, "has the name ''"),
    ({"others": {"a": SMALL}}, "others['a'] is a CSpace"),
    ({"others": {"a": (SMALL, 3)}}, "others['a'] is a int"),
    ({"others": {"a": (3, LANES)}}, "others['a'] is a int ... map"),
    ({"others": {"a": (elsewhere("hall"), LANES)}}, "has the frame 'hall'"),
    (
        {"others": {"a": (elsewhere(count=90), LANES)}},
        "others['a'] has a map from [0.0, 0.0] to [9.0, 6.0] ... 8.0",
    ),
    ({"margin": -0.1}, "margin is -0.1"),
)
def test_wrong_arguments_are_refused_in_one_line(spaces, options, message):
    check_refused(lambda: cspace.lanes.conflicts(spaces["arrow"], LANES, **options), message)


def test_unknown_names_and_groups_are_refused(spaces, tmp_path):
    found = cspace.lanes.conflicts(spaces["arrow"], LANES)
    with pytest.raises(InputError, match="did you mean 'node 0'"):
        found.between("0: 0 to 1", "node0")
    with pytest.raises(FileError, match="it must be the name of a group"):
        open_rmf(tmp_path, lambda lanes: lanes[0][2].update(mutex=["hall"]))


# ---- the command line ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """Write a room, and lanes of Open-RMF."""
    folder = tmp_path_factory.mktemp("conflicts")
    np.save(folder / "room.npy", np.zeros((60, 60), dtype=np.bool_))
    write(folder, "rmf.yaml", RMF)
    return folder


def audit(folder, *arguments):
    """Run the command on the room."""
    return run("audit", folder / "room.npy", folder / "rmf.yaml", "--spacing=0.1", *arguments)


def test_exit_codes_tell_of_unguarded_pairs(room):
    robot = "--robot=rect:0.4x0.2"
    assert audit(room, robot).exit_code == 0
    result = audit(room, robot, "--conflicts")
    assert result.exit_code == 1
    assert "pairs touch and share no node and no mutex group" in result.stdout
    # Robots of 0.2 m by 0.1 m stay apart, except where they share a node.
    assert audit(room, "--robot=rect:0.2x0.1", "--conflicts").exit_code == 0
    # At a distance of 0.1 m the lanes touch within rounding.
    tight = "--robot=disc:0.1", "--conflicts", "--conflicts-margin=0.1"
    assert audit(room, *tight).exit_code == 0
    assert audit(room, *tight, "--strict").exit_code == 2


def test_conflicts_have_reports_of_their_own(room):
    outputs = [f"--output={room / name}" for name in ("a.csv", "a.xml", "a.geojson", "a.png")]
    robots = "--robot=slim=rect:0.4x0.2", "--robot=disc=disc:0.2"
    result = audit(room, *robots, "--conflicts", "--conflicts-margin=0.05", *outputs, "--json")
    assert result.exit_code == 1
    document = json.loads(result.stdout)
    assert document["conflicts"]["touch"] > 0
    assert document["slim"]["free"] == document["disc"]["free"] > 0
    assert len(document["reports"]) == 3
    for name in ("slim", "disc", "conflicts"):
        assert {file.suffix for file in room.glob(f"a-{name}.*")} == {
            *(".csv", ".xml", ".geojson", ".png")
        }
    refused = audit(room, "--robot=disc:0.2", "--conflicts-margin=0.05")
    assert refused.exit_code == 2
    assert "robots keep it where they are in conflict" in refused.stderr
    refused = audit(room, "--robot=conflicts=disc:0.2", "--conflicts")
    assert "the report of conflicts has that name" in refused.stderr
    assert audit(room, "--robot=other=disc:0.02", "--conflicts").exit_code == 0
