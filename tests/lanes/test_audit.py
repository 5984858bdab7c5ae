"""Audits of route graphs, against shapely's hulls of the swept shape."""

import copy
import math
import pickle
import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from shapely import affinity

import cspace
from cspace.errors import AngleWarning, InputError
from cspace.lanes import RouteGraph
from tests.helpers.handmade import build_empty
from tests.helpers.placements import obstacles_of
from tests.helpers.refusals import check_refused, write
from tests.helpers.regions import place_polygon
from tests.helpers.strategies import few

ROBOT = [(0.4, 0.2), (-0.3, 0.25), (-0.3, -0.2), (0.4, -0.2)]


def sweep(p, q, yaw):
    """Return what the robot sweeps on a straight motion without a turn; it is convex."""
    poses = np.array([(*p, yaw), (*q, yaw)])
    return shapely.convex_hull(shapely.union(*place_polygon(shapely.Polygon(ROBOT), poses)))


def build(occupied, spacing=0.1, rotations=72, **options):
    workspace = cspace.Workspace.from_array(occupied, spacing)
    return cspace.build(workspace, cspace.Robot.polygon(ROBOT), rotations=rotations, **options)


@pytest.fixture(scope="module")
def rooms():
    """Return the map of two rooms of 4 m with a door of 0.8 m."""
    occupied = np.zeros((80, 50), dtype=np.bool_)
    occupied[40:42] = True
    occupied[40:42, 21:29] = False
    occupied[10:13, 30:34] = True
    return build(occupied)


@pytest.mark.parametrize(
    "forbidden, parts",
    [
        ((), [["A", "B", "C"]]),
        (("BC", "Start"), [["A", "B"], ["B", "C"]]),
        (("AB", "End"), [["A", "B"], ["B", "C"]]),
        (("BA", "Start"), [["A", "B"], ["B", "C"]]),
        (("CB", "End"), [["A", "B"], ["B", "C"]]),
        (("AB", "Start"), [["A", "B", "C"]]),
    ],
)
def test_a_turn_that_a_layout_forbids_joins_no_lanes(rooms, tmp_path, forbidden, parts):
    places = {"A": (5.0, 1.0), "B": (7.0, 1.0), "C": (7.0, 3.0)}
    nodes = [{"nodeId": k, "nodePosition": {"x": x, "y": y}} for k, (x, y) in places.items()]
    edges = [make_edge("AB"), make_edge("BA", math.pi), make_edge("BC"), make_edge("CB", math.pi)]
    for edge in edges:
        if forbidden and edge["edgeId"] == forbidden[0]:
            edge["vehicleTypeEdgeProperties"][0][f"rotationAt{forbidden[1]}NodeAllowed"] = "NONE"
    layout = {"layoutId": "L", "nodes": nodes, "edges": edges, "stations": []}
    file = write(tmp_path, "lif.json", {"metaInformation": {}, "layouts": [layout]})
    found = cspace.lanes.audit(rooms, RouteGraph.open(file))
    assert found.counts["free"] == 4 and found.parts == parts


def test_a_turn_one_way_counts_as_a_turn_with_a_warning(tmp_path):
    nodes = [{"nodeId": k, "nodePosition": {"x": x, "y": 1.0}} for k, x in (("A", 5.0), ("B", 7.0))]
    edges = [make_edge("AB"), make_edge("BA")]
    edges[0]["vehicleTypeEdgeProperties"][0]["rotationAtEndNodeAllowed"] = "CCW"
    layout = {"layoutId": "L", "nodes": nodes, "edges": edges, "stations": []}
    file = write(tmp_path, "lif.json", {"metaInformation": {}, "layouts": [layout]})
    with pytest.warns(UserWarning, match="rotationAtEndNodeAllowed 'CCW'; turns both ways count"):
        assert RouteGraph.open(file).lanes[0].turns == (True, True)


def make_edge(ends, yaw=0.0):
    """Return an edge of LIF that is driven at a yaw from its direction."""
    rule = {"vehicleTypeId": "v", "vehicleOrientation": yaw, "orientationType": "TANGENTIAL"}
    edge = {"edgeId": ends, "startNodeId": ends[0], "endNodeId": ends[1]}
    return edge | {"vehicleTypeEdgeProperties": [rule | {"rotationAllowed": False}]}


def true_room(space, p, q, yaw, side):
    """Return how far a lane may shift to a side, within a millimetre."""
    walls = obstacles_of(space)
    ahead = np.subtract(q, p) / np.hypot(*np.subtract(q, p))
    left = side * np.array([-ahead[1], ahead[0]])
    shape = sweep(p, q, yaw)
    far = shapely.convex_hull(shapely.union(shape, affinity.translate(shape, *(2.0 * left))))
    hit = shapely.intersection(far, walls)
    if hit.is_empty:
        return 2.0
    low, high = 0.0, 2.0
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        swept = shapely.convex_hull(
            shapely.union(shape, affinity.translate(shape, *(middle * left)))
        )
        low, high = (low, middle) if shapely.intersects(swept, walls) else (middle, high)
    return high


def check(space, audit, offset=0.0):
    """Compare the verdicts of straight lanes with the shape that the robot sweeps."""
    walls = obstacles_of(space)
    graph = audit.graph
    for lane, row in zip(graph.lanes, audit.lanes, strict=True):
        p, q = graph.positions[[lane.start, lane.end]]
        yaw = math.atan2(*(q - p)[::-1]) + offset
        common = shapely.intersection(sweep(p, q, yaw), walls).area
        if row.verdict == "free":
            assert common == 0.0, row
            for side, room in ((1, row.left), (-1, row.right)):
                assert room <= true_room(space, p, q, yaw, side) + 1e-3, row
            grown = shapely.buffer(sweep(p, q, yaw), row.margin * (1 - 1e-9))
            assert shapely.intersection(grown, walls).area < 1e-9, row
        if row.verdict == "blocked":
            assert shapely.intersects(sweep(row.at[:2], row.at[:2], row.at[2]), walls), row
            assert shapely.distance(shapely.LineString([p, q]), shapely.Point(row.at[:2])) < 1e-9
            assert common > 0.0
        if row.verdict == "undecided":  # only at contact
            assert shapely.distance(sweep(p, q, yaw).buffer(-1e-4), walls) < 1e-3, row


def build_on_floor(seed):
    """Return the map of a prism on a floor, and that of its footprint at its heights."""
    rng = np.random.default_rng(seed)
    occupied = rng.random((80, 50, 8)) < 0.002
    occupied[:, :, 5:] |= rng.random((80, 50, 3)) < 0.2  # above the robot
    prism = trimesh.creation.extrude_polygon(shapely.Polygon(ROBOT), 0.3)
    robot = cspace.Robot.from_mesh(prism.apply_translation((0.0, 0.0, 0.1)))
    workspace = cspace.Workspace.from_array(occupied, 0.1)
    space = cspace.build(workspace, robot, rotations=72, floor=0.05)
    return space, build(occupied[:, :, 1:5].any(axis=2))


def test_lanes_on_a_floor_agree_with_swept_hulls_at_the_heights_of_the_robot():
    space, flat = build_on_floor(3)
    rng = np.random.default_rng(0)
    positions = rng.uniform((0.2, 0.2), (7.8, 4.8), (40, 2))
    edges = rng.integers(0, 40, (60, 2))
    edges = edges[edges[:, 0] != edges[:, 1]]
    audit = cspace.lanes.audit(space, RouteGraph.from_arrays(positions, edges), max_room=0.4)
    assert min(audit.counts["free"], audit.counts["blocked"]) > 5
    check(flat, audit)
    named = [row.obstacle for row in audit.lanes if row.verdict == "blocked"]
    places = [re.findall(r"-?[0-9.]+", text) for text in named if "obstacle at" in text]
    assert places
    for place_ in places:
        assert space.workspace.outer[tuple(space.workspace.grid.cell_of(list(map(float, place_))))]
        assert 0.1 < float(place_[2]) < 0.5
    space.update(cspace.Workspace.from_array(np.zeros((80, 50, 8), dtype=bool), 0.1))
    space.add_obstacle("lamp", trimesh.creation.box(bounds=[(2, 0, 0.55), (3, 5, 0.7)]))
    space.add_obstacle("shelf", trimesh.creation.box(bounds=[(3, 0, 0.3), (4, 5, 0.6)]))
    lane = RouteGraph.from_arrays([(1.0, 2.5), (7.0, 2.5)], [(0, 1)])
    (row,) = cspace.lanes.audit(space, lane).lanes
    assert (row.verdict, row.obstacle) == ("blocked", "'shelf'")
    assert 2.6 <= row.at[0] <= 4.3


def test_conflicts_on_a_floor_are_where_footprints_meet():
    space, flat = build_on_floor(3)
    nodes = np.random.default_rng(4).uniform((0.5, 0.5), (7.5, 4.5), (8, 2))
    graph = RouteGraph.from_arrays(nodes, [(0, 1), (2, 3), (4, 5), (6, 7)])
    found, expected = (cspace.lanes.conflicts(each, graph) for each in (space, flat))
    meeting = {(row.first, row.second) for row in expected.pairs}
    assert {(row.first, row.second) for row in found.pairs} == meeting and meeting
    # A robot may pass under another, so that nothing is proven where footprints meet.
    assert {row.verdict for row in found.pairs} == {"undecided"}


PORTAL = (
    ((-0.4, -0.5, 0.0), (0.4, -0.4, 0.5)),
    ((-0.4, 0.4, 0.0), (0.4, 0.5, 0.5)),
    ((-0.4, -0.5, 0.5), (0.4, 0.5, 0.7)),
)
CART = (((-0.3, -0.2, 0.02), (0.3, 0.2, 0.3)),)
"""Corners of the boxes of two robots; the cart fits between the legs of the portal."""


def share_a_point(first, second):
    """Return whether two robots, boxes and a pose each, meet at some height."""
    for low, high in first[0]:
        for under, over in second[0]:
            if low[2] <= over[2] and under[2] <= high[2]:
                outlines = shapely.box(*low[:2], *high[:2]), shapely.box(*under[:2], *over[:2])
                poses = np.array([first[1]]), np.array([second[1]])
                if shapely.intersects(*map(place_polygon, outlines, poses))[0]:
                    return True
    return False


def test_robots_whose_footprints_meet_at_different_heights_are_not_said_to_touch():
    scene = cspace.Workspace.from_array(np.zeros((80, 50, 8), dtype=bool), 0.1)
    graph = RouteGraph.from_arrays(
        [(1.0, 2.5), (7.0, 2.5), (4.0, 1.0), (4.0, 4.0), (1.0, 4.0), (3.0, 4.0)],
        [(0, 1), (2, 3), (4, 5)],
    )
    spaces = []
    for boxes in (PORTAL, CART):
        mesh = trimesh.util.concatenate([trimesh.creation.box(bounds=box) for box in boxes])
        spaces.append(cspace.build(scene, cspace.Robot.from_mesh(mesh), rotations=72, floor=0.01))
    spaces.append(build_empty((80, 50), cspace.Robot.rectangle(0.6, 0.4), rotations=72))
    portal, cart, flat = spaces
    # The cart drives along the portal's lane, between its legs.
    assert not share_a_point((PORTAL, (4.0, 2.5, 0.0)), (CART, (4.0, 2.5, 0.0)))
    for others in ({"cart": (cart, graph)}, {"flat": (flat, graph)}):
        found = cspace.lanes.conflicts(portal, graph, others=others, name="portal")
        meeting = {frozenset((row.first, row.second)): row for row in found.pairs}
        of_both = [
            row
            for row in found.pairs
            if row.first.startswith("portal") and row.second.startswith(tuple(others))
        ]
        assert {row.verdict for row in of_both} == {"undecided"}
        assert all(row.poses is None for row in of_both)
        # Pairs that are not listed are apart at every height.
        rng = np.random.default_rng(3)
        names = [name for name in found.elements if ": " in name]
        for one in names:
            for other in names:
                kinds = [PORTAL if name.startswith("portal") else CART for name in (one, other)]
                if one == other or frozenset((one, other)) in meeting:
                    continue
                for _ in range(20):
                    poses = []
                    for name in (one, other):
                        (x0, y0), (x1, y1) = found.elements[name].nodes
                        share = rng.random()
                        yaw = math.atan2(y1 - y0, x1 - x0)
                        poses.append((x0 + share * (x1 - x0), y0 + share * (y1 - y0), yaw))
                    assert not share_a_point(*zip(kinds, poses, strict=True))


def test_a_robot_without_a_yaw_that_is_round_from_above_alone_has_no_lanes():
    base = trimesh.creation.cylinder(0.4, 0.2, sections=24)
    mast = trimesh.creation.box((0.5, 0.1, 0.3))
    mast.apply_translation((0.0, 0.0, 0.2))
    robot = cspace.Robot.from_mesh(trimesh.util.concatenate([base, mast]))
    workspace = cspace.Workspace.from_array(np.zeros((40, 40, 8), dtype=bool), 0.1)
    graph = RouteGraph.from_arrays([(1.0, 1.0), (3.0, 3.0)], [(0, 1)])
    space = cspace.build(workspace, robot, floor=0.2)
    check_refused(lambda: cspace.lanes.audit(space, graph), "turns on the lane")
    round_robot = cspace.Robot.cylinder(0.3, 0.4)
    space = cspace.build(workspace, round_robot, floor=0.3)
    assert cspace.lanes.audit(space, graph).counts["free"] == 1


@pytest.mark.thorough
def test_depot_agrees_with_swept_hulls(data):
    workspace = cspace.Workspace.open(data / "maps" / "depot.yaml", unknown="free")
    space = cspace.build(workspace, cspace.Robot.polygon(ROBOT), rotations=72)
    rng = np.random.default_rng(1)
    positions = rng.uniform(space.grid.lower, space.grid.upper, (300, 2))
    free = positions[space.is_free(np.column_stack([positions, np.zeros(300)]))][:40]
    edges = [
        (a, b) for a in range(len(free)) for b in np.argsort(np.hypot(*(free - free[a]).T))[1:4]
    ]
    audit = cspace.lanes.audit(space, RouteGraph.from_arrays(free, edges))
    assert audit.counts["free"] > 10
    assert audit.counts["blocked"] > 0
    check(space, audit)


@given(
    x=st.floats(0.5, 7.5),
    y=st.floats(0.3, 4.7),
    angle=st.floats(-math.pi, math.pi),
    gap=st.sampled_from([-0.01, -1e-3, 1e-3, 0.01, 0.05]),
)
def test_lanes_near_contact_are_decided(rooms, x, y, angle, gap):
    # Move a lane of 1 m sideways until it is a given gap from contact.
    ahead = np.array([math.cos(angle), math.sin(angle)])
    left = np.array([-ahead[1], ahead[0]])
    p, q = np.array([x, y]), np.array([x, y]) + ahead
    if shapely.intersects(sweep(p, q, angle), obstacles_of(rooms)):
        return
    room = true_room(rooms, p, q, angle, 1) - gap
    if not 0.0 < room < 1.9:
        return
    ends = np.array([p + room * left, q + room * left])
    audit = cspace.lanes.audit(rooms, RouteGraph.from_arrays(ends, [(0, 1)]))
    check(rooms, audit)
    if gap == 0.05:
        assert audit.lanes[0].verdict == "free"
    if gap == -0.01:
        # A corner that is 1 cm deep leaves too little area only if it is very sharp.
        assert audit.lanes[0].verdict != "free"


def test_a_lane_pushed_into_a_wall_by_a_centimetre_is_blocked(rooms):
    for y, verdict in ((0.201, "free"), (0.19, "blocked")):
        graph = RouteGraph.from_arrays([(1, y), (3, y)], [(0, 1)])
        (row,) = cspace.lanes.audit(rooms, graph).lanes
        assert row.verdict == verdict
    assert row.obstacle == "the border of the map"
    assert row.at[:2] == (1, 0.19)


def test_rooms_of_straight_lanes_are_within_two_cells_of_the_truth(rooms):
    spacing = rooms.grid.spacing
    for p, q in (
        ((1, 1), (3, 1)),
        ((1, 0.202), (3, 0.202)),
        ((5, 1), (7, 3)),
        ((1, 2.5), (7, 2.5)),
    ):
        graph = RouteGraph.from_arrays([p, q], [(0, 1)])
        (row,) = cspace.lanes.audit(rooms, graph, max_room=2.0).lanes
        assert row.verdict == "free"
        yaw = math.atan2(q[1] - p[1], q[0] - p[0])
        for side, room in ((1, row.left), (-1, row.right)):
            truth = true_room(rooms, p, q, yaw, side)
            assert truth - 2 * spacing <= room <= truth + 1e-3, (p, q, side, room, truth)


@pytest.mark.parametrize("row", [14, 15, 16, 24, 25, 26])
def test_no_post_is_skipped_beside_a_lane(row):
    # A post of one cell, and a robot smaller than a cell, fit between wide strips.
    occupied = np.zeros((60, 40), dtype=np.bool_)
    occupied[30, row] = True
    space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), "disc:0.02")
    graph = RouteGraph.from_arrays([(2, 2), (4, 2)], [(0, 1)])
    (lane,) = cspace.lanes.audit(space, graph).lanes
    beside = abs(0.1 * row + 0.05 - 2.0) - 0.05 - 0.02
    room = lane.left if row > 20 else lane.right
    assert beside - 0.2 <= room <= beside
    assert beside - 0.2 <= lane.margin <= beside
    assert max(lane.left, lane.right) == 1.0


@pytest.mark.parametrize("post", [(3.85, 3.0), (3.6, 3.6), (1.0, 1.4), (2.6, 3.4)])
def test_margins_hold_around_the_ends_of_diagonal_lanes(post):
    box = shapely.box(*np.subtract(post, 0.005), *np.add(post, 0.005))
    with pytest.warns(cspace.UnitWarning):  # of a box smaller than a cell
        workspace = cspace.Workspace.from_polygons([box], spacing=0.05, bounds=(-1, -1, 6, 6))
    space = cspace.build(workspace, "disc:0.07")
    graph = RouteGraph.from_arrays([(2, 2), (3, 3)], [(0, 1)])
    (row,) = cspace.lanes.audit(space, graph, max_room=2.0).lanes
    truth = shapely.LineString([(2, 2), (3, 3)]).distance(box) - 0.07
    assert truth - 0.15 <= row.margin <= truth


def test_headings_decide_the_yaw(rooms):
    # Through the door, 0.8 m wide, only along the robot; across it, the robot is 0.7 m long.
    nodes = [(3.0, 2.5), (5.0, 2.5)]
    for heading, verdict in (
        ("forward", "free"),
        ("backward", "free"),
        ("both", "free"),
        (0.0, "free"),
        ("any", "blocked"),
        (math.radians(45), "blocked"),
    ):
        graph = RouteGraph.from_arrays(nodes, [(0, 1)], heading)
        (row,) = cspace.lanes.audit(rooms, graph).lanes
        assert row.verdict == verdict, heading


def test_an_asymmetric_robot_differs_backwards():
    occupied = np.zeros((40, 20), dtype=np.bool_)
    space = build(occupied)
    for heading, verdict in (("forward", "blocked"), ("backward", "free"), ("both", "blocked")):
        graph = RouteGraph.from_arrays([(1, 1), (3.65, 1)], [(0, 1)], heading)
        assert cspace.lanes.audit(space, graph).lanes[0].verdict == verdict


def test_a_node_with_a_yaw_needs_the_turn(rooms):
    nodes = [(1.0, 0.3), (3.0, 0.3)]
    for yaws, verdict in (((math.nan, math.nan), "free"), ((math.pi / 2, math.nan), "blocked")):
        graph = RouteGraph.from_arrays(nodes, [(0, 1)], yaws=yaws)
        assert cspace.lanes.audit(rooms, graph).lanes[0].verdict == verdict


def list_turned(heading, yaw, width):
    """Return yaws of the shorter ways between a heading and all yaws within a width of another."""
    steps = [
        math.remainder(yaw + share * width - heading, math.tau) for share in np.linspace(-1, 1, 301)
    ]
    return heading + np.linspace(min(*steps, 0.0), max(*steps, 0.0), 361)


@pytest.mark.parametrize("count", few([150, 1500]))
def test_a_node_with_a_range_of_yaws_needs_the_turns_to_all_of_them(count):
    rng = np.random.default_rng(8)
    occupied = np.zeros((120, 120), dtype=np.bool_)
    occupied[tuple(rng.integers(0, 120, (2, 250)))] = True
    space = build(occupied)
    walls = obstacles_of(space)
    starts = rng.uniform(0.6, 11.4, (count, 2))
    directions = rng.uniform(-math.pi, math.pi, count)
    ends = starts + 0.2 * np.column_stack([np.cos(directions), np.sin(directions)])
    yaws = rng.uniform(-math.pi, math.pi, 2 * count)
    yaws[rng.random(2 * count) < 0.4] = math.nan
    widths = rng.choice([0.0, 0.02, 0.3, 1.0, 2.0, 3.0], 2 * count)
    edges = np.column_stack([np.arange(count), np.arange(count, 2 * count)])
    graph = RouteGraph.from_arrays(np.concatenate([starts, ends]), edges, yaws=yaws)
    given = {name: width for name, width in zip(graph.names, widths, strict=True) if width}
    graph = replace(graph, yaw_deviations=given)
    seen = Counter()
    for k, row in enumerate(cspace.lanes.audit(space, graph).lanes):
        hit = shapely.intersects(sweep(starts[k], ends[k], directions[k]), walls)
        gap = shapely.distance(sweep(starts[k], ends[k], directions[k]), walls)
        for node, (x, y) in ((k, starts[k]), (count + k, ends[k])):
            if not math.isnan(yaws[node]):
                turned = list_turned(directions[k], yaws[node], widths[node])
                poses = np.insert(turned[:, np.newaxis], 0, [[x], [y]], axis=1)
                gaps = shapely.distance(place_polygon(shapely.Polygon(ROBOT), poses), walls)
                hit, gap = hit or gaps.min() == 0.0, min(gap, gaps.min())
        # Contact is undecided, and so is a touch between the yaws that are tried here.
        assert row.verdict == ("blocked" if hit else "free") or gap < 5e-3, (k, row)
        assert not (row.verdict == "free" and hit)
        seen[row.verdict, bool(given.get(graph.names[k])) and not math.isnan(yaws[k])] += 1
    assert min(seen[verdict, True] for verdict in ("free", "blocked")) > count // 15


def test_a_range_of_yaws_needs_a_map_with_a_yaw():
    graph = RouteGraph.from_arrays([(1, 1), (3, 1)], [(0, 1)], 0.0, yaws=[0.0, math.nan])
    bar = build_empty((60, 40), "rect:0.6x0.2")
    assert cspace.lanes.audit(bar, graph).lanes[0].verdict == "free"
    graph = replace(graph, yaw_deviations={"0": 0.1})
    check_refused(lambda: cspace.lanes.audit(bar, graph), "has the yaw -0.1 at the node '0'")
    disc = build_empty((60, 40), "disc:0.3")
    assert cspace.lanes.audit(disc, graph).lanes[0].verdict == "free"


@pytest.mark.parametrize("turn", [0.0, math.pi / 2, math.pi, -math.pi / 2])
def test_lanes_join_at_one_yaw_however_it_is_written(turn):
    # A corridor in which the robot fits at one yaw, driven one way ahead and the other in reverse.
    walls = [shapely.box(0, 0, 6, 2.795), shapely.box(0, 3.205, 6, 6)]
    walls = [affinity.rotate(wall, turn, (3, 3), use_radians=True) for wall in walls]
    workspace = cspace.Workspace.from_polygons(walls, spacing=0.1, bounds=(0, 0, 6, 6))
    space = cspace.build(workspace, "rect:0.6x0.4", rotations=24)
    ahead = np.array([math.cos(turn), math.sin(turn)])
    nodes = [3.0 - 2.0 * ahead, (3.0, 3.0), 3.0 + 2.0 * ahead]
    edges, headings = [(0, 1), (1, 0), (1, 2), (2, 1)], ["forward", "backward", turn, turn]
    audit = cspace.lanes.audit(space, RouteGraph.from_arrays(nodes, edges, headings))
    assert audit.counts["free"] == 4
    assert not len(audit.nodes[1].free_yaws)
    assert audit.parts == [["0", "1", "2"]]


def test_lanes_without_length_and_loops_and_borders(rooms):
    nodes = [(2, 1), (0.0, 2.5), (8.0, 2.5), (20.0, 2.5), (2, 1)]
    edges = [(0, 0), (0, 4), (0, 1), (0, 2), (0, 3)]
    audit = cspace.lanes.audit(rooms, RouteGraph.from_arrays(nodes, edges))
    verdicts = [row.verdict for row in audit.lanes]
    assert verdicts == ["free", "free", "blocked", "blocked", "blocked"]
    assert audit.nodes[0].turns_around
    assert not len(audit.nodes[1].free_yaws)
    fixed = RouteGraph.from_arrays(nodes, [(0, 0)], 1.0)
    assert cspace.lanes.audit(rooms, fixed).lanes[0].verdict == "free"
    empty = cspace.lanes.audit(rooms, RouteGraph.from_arrays(np.empty((0, 2)), np.empty((0, 2))))
    assert empty.lanes == empty.parts == []
    assert "0 free" in str(empty)


def test_nodes_turn_between_proven_yaws(rooms):
    walls = obstacles_of(rooms)
    nodes = [(4.1, 2.5), (2, 1), (0.35, 2.5), (1.0, 2.75)]
    audit = cspace.lanes.audit(rooms, RouteGraph.from_arrays(nodes, []))
    assert [row.turns_around for row in audit.nodes] == [False, True, False, False]
    for row in audit.nodes:
        for low, high in row.free_yaws:
            for yaw in np.linspace(low, high, 100):
                assert not shapely.intersects(sweep(row.position, row.position, yaw), walls)


def test_named_obstacles_are_named():
    space = build(np.zeros((60, 40), dtype=np.bool_))
    space.add_obstacle("crate", shapely.box(2.0, 1.5, 2.5, 2.5))
    graph = RouteGraph.from_arrays([(1, 2), (4, 2), (1, 3)], [(0, 1), (0, 2)])
    first, second = cspace.lanes.audit(space, graph).lanes
    assert first.obstacle == "'crate'"
    assert second.verdict == "free"


def test_polygons_are_exact_obstacles():
    walls = [shapely.box(0, 0, 4, 0.523), shapely.box(0, 1.0, 4, 1.5)]
    bounds = (0, 0, 4, 1.5)
    workspace = cspace.Workspace.from_polygons(walls, spacing=0.1, bounds=bounds)
    space = cspace.build(workspace, cspace.Robot.rectangle(0.5, 0.4), rotations=36)
    for y, verdict in ((0.76, "free"), (0.715, "blocked"), (0.805, "blocked")):
        graph = RouteGraph.from_arrays([(1, y), (3, y)], [(0, 1)])
        (row,) = cspace.lanes.audit(space, graph).lanes
        assert row.verdict == verdict, y


@pytest.mark.filterwarnings("ignore:the robot is")
def test_a_robot_without_an_inside_is_audited():
    wall = shapely.box(2.03, 0, 2.17, 3)
    workspace = cspace.Workspace.from_polygons([wall], spacing=0.1, bounds=(0, 0, 4, 3))
    space = cspace.build(workspace, cspace.Robot.disc(1e-8))
    graph = RouteGraph.from_arrays([(1, 1), (1.5, 1), (2.03, 1)], [(0, 1), (1, 2)])
    verdicts = [row.verdict for row in cspace.lanes.audit(space, graph).lanes]
    assert verdicts == ["free", "undecided"]


def test_yaws_between_those_of_a_part_are_proven():
    # The corner is nearest to the wall at 32.5 degrees, in the middle between two parts of 5.
    slope = math.radians(32.5)
    robot = cspace.Robot.rectangle(0.6, 0.6 * math.tan(slope))
    wall = shapely.box(0, 0, 4, 0.5)
    workspace = cspace.Workspace.from_polygons([wall], spacing=0.1, bounds=(0, 0, 4, 2))
    space = cspace.build(workspace, robot, rotations=72)
    reach = 0.3 / math.cos(slope)
    assert reach * math.cos(math.radians(2.5)) < reach - 3e-4
    for gap, is_free in ((0.05, True), (-2e-4, False), (-0.02, False)):
        y = 0.5 + reach + gap
        graph = RouteGraph.from_arrays([(1, y), (3, y)], [(0, 1), (0, 0)], "any")
        lanes = cspace.lanes.audit(space, graph).lanes
        assert [row.verdict == "free" for row in lanes] == [is_free] * 2, gap


def test_a_map_without_a_yaw_is_for_a_round_robot_or_one_that_never_turns():
    disc = build_empty((40, 30), "disc:0.3")
    graph = RouteGraph.from_arrays([(1, 1), (3, 2)], [(0, 1)])
    audit = cspace.lanes.audit(disc, graph)
    assert audit.lanes[0].verdict == "free"
    assert audit.nodes[0].turns_around
    bar = build_empty((40, 30), "rect:0.6x0.2")
    still = RouteGraph.from_arrays([(1, 1), (3, 2)], [(0, 1)], 0.0)

    def build_again():
        return cspace.lanes.audit(bar, still)

    check_refused(
        lambda: cspace.lanes.audit(bar, graph),
        "space has no yaw, but rectangle 0.6 m x 0.2 m turns on the ... needed",
    )
    standing = build_again()
    assert standing.lanes[0].verdict == "free"
    assert not standing.nodes[0].turns_around
    np.testing.assert_array_equal(standing.nodes[0].free_yaws, [[0.0, 0.0]])
    turned = RouteGraph.from_arrays([(1, 1), (3, 2)], [(0, 1)], 0.0, yaws=[0.0, 1.5])
    with pytest.raises(InputError, match=r"has the yaw 1.5 at the node '1'"):
        cspace.lanes.audit(bar, turned)
    assert cspace.lanes.audit(disc, turned).lanes[0].verdict == "free"


def test_tiles_give_the_verdicts_of_memory(tmp_path):
    rng = np.random.default_rng(3)
    occupied = rng.random((120, 90)) < 0.004
    whole = build(occupied, rotations=24)
    workspace = cspace.Workspace.from_array(occupied, 0.1)
    robot = cspace.Robot.polygon(ROBOT)
    tiled = cspace.build(workspace, robot, rotations=24, store=tmp_path / "map.zarr", tile=40)
    positions = rng.uniform((0, 0), (12, 9), (15, 2))
    graph = RouteGraph.from_arrays(positions, rng.integers(0, 15, (25, 2)), two_way=True)
    one, other = cspace.lanes.audit(whole, graph), cspace.lanes.audit(tiled, graph)
    assert [row[3] for row in one.lanes] == [row[3] for row in other.lanes]
    assert one.parts == other.parts
    assert one.lost == other.lost


@pytest.mark.parametrize("far", few([20.0, 1e100, 1e6, 1e15], 2))
@pytest.mark.parametrize("outside", ["blocked", "free"])
@pytest.mark.parametrize("tile", few([None, 32]))
def test_a_node_far_outside_is_named_at_once(tmp_path, far, outside, tile):
    options = {"store": tmp_path / "map", "tile": tile} if tile else {}
    space = build_empty((60, 60), "rect:0.6x0.4", rotations=24, outside=outside, **options)
    for node in ((far, 5.0), (-far, far), (3.0, -far)):
        graph = RouteGraph.from_arrays([(1, 1), (5, 5), node], [(0, 1), (1, 2), (2, 0)])
        audit = cspace.lanes.audit(space, graph)
        near, *others = audit.lanes
        assert near.verdict == "free"
        if outside == "blocked":
            assert {row.verdict for row in others} == {"blocked"}
            assert {row.obstacle for row in others} == {"node 2 lies outside the map"}
        else:
            assert "blocked" not in {row.verdict for row in others}


def test_audits_are_pickled_and_copied(rooms):
    graph = RouteGraph.from_arrays([(1, 1), (3, 1), (7, 1)], [(0, 1), (1, 2)])
    audit = cspace.lanes.audit(rooms, graph)
    for twin in (pickle.loads(pickle.dumps(audit)), copy.deepcopy(audit)):
        assert str(twin) == str(audit)


def test_wrong_arguments_are_refused(rooms):
    graph = RouteGraph.from_arrays([(1, 1)], [])
    with pytest.raises(InputError, match=r"graph is a list.*RouteGraph"):
        cspace.lanes.audit(rooms, [(0, 1)])
    with pytest.raises(InputError, match=r"space is a str.*map"):
        cspace.lanes.audit("map", graph)
    with pytest.raises(InputError, match=r"space has the axes x, y, z.*lanes"):
        cspace.lanes.audit(build_empty((9, 9, 9), "ball:0.1"), graph)


def test_yaws_in_degrees_are_named_once(rooms):
    with pytest.warns(AngleWarning) as caught:
        graph = RouteGraph.from_arrays([(1.0, 0.3), (3.0, 0.3)], [(0, 1)], 450.0, yaws=(90, 180))
        cspace.lanes.audit(rooms, graph)
    assert [str(each.message).partition(":")[0] for each in caught] == ["headings", "yaws"]
    np.testing.assert_allclose(np.cos(graph.yaws), np.cos([90, 180]), atol=1e-12)
